//! Requests and replies over one connection, in order.

use std::collections::VecDeque;
use std::time::Duration;

use crate::execution::device::DeviceError;
use crate::execution::drivers::stream::{Connection, within};
use crate::execution::protocol::hans::{HansFrames, HansOutcome, HansReply, HansRequest, error_text};

/// Requests whose replies were given up and have not come.
const MAX_OWED: usize = 16;

/// A text connection.
#[derive(Debug)]
pub(super) struct TextLink {
    connection: Connection,
    frames: HansFrames,
    /// Commands that were sent and not answered, the oldest first.
    owed: VecDeque<&'static str>,
    wait: Duration,
}

impl TextLink {
    pub(super) fn new(connection: Connection, wait: Duration) -> Self {
        Self { connection, frames: HansFrames::default(), owed: VecDeque::new(), wait }
    }

    /// Sends a request and waits for its reply.
    pub(super) async fn ask(&mut self, request: &HansRequest) -> Result<Vec<String>, DeviceError> {
        self.send(request).await?;
        self.reply(request).await
    }

    /// Hands a request to the wire.
    pub(super) async fn send(&mut self, request: &HansRequest) -> Result<(), DeviceError> {
        if self.owed.len() >= MAX_OWED {
            return Err(DeviceError::Silent { waited: self.wait });
        }
        // Both are done before anything is waited for: who gives this up leaves a reply that is expected.
        self.owed.push_back(request.name());
        within(self.wait, self.connection.send(request.encode().as_bytes())).await
    }

    /// Waits for the reply to the request that was sent last.
    pub(super) async fn reply(&mut self, request: &HansRequest) -> Result<Vec<String>, DeviceError> {
        let reply = within(self.wait, async {
            loop {
                let reply = self.next().await?;
                if self.owed.is_empty() {
                    return Ok(reply);
                }
            }
        });
        match reply.await?.outcome {
            HansOutcome::Done(values) => Ok(values),
            HansOutcome::Fail(code) => Err(DeviceError::Refused { code, text: error_text(code).to_owned() }),
            HansOutcome::Unknown => {
                let what = format!("take the command {}; see whether its firmware has it", request.name());
                Err(DeviceError::Unsupported { what })
            }
        }
    }

    /// Next reply, which answers the oldest request.
    async fn next(&mut self) -> Result<HansReply, DeviceError> {
        loop {
            if let Some(message) = self.frames.next_message() {
                let reply = message.and_then(|message| HansReply::parse(&message));
                let reply = reply.map_err(|error| DeviceError::Malformed { what: error.to_string() })?;
                let expected = self.owed.pop_front().unwrap_or("none");
                if reply.command != expected && reply.outcome != HansOutcome::Unknown {
                    let what = format!("a reply to {} where one to {expected} was due", reply.command);
                    return Err(DeviceError::Malformed { what });
                }
                return Ok(reply);
            }
            let mut bytes = Vec::new();
            self.connection.receive(&mut bytes).await?;
            self.frames.push(&bytes);
        }
    }

    pub(super) async fn close(self) {
        self.connection.close().await;
    }
}
