//! Digital signals of the control box, over a connection of their own: a capture may take longer than the arm's state may be old.

use std::time::Duration;

use tokio::time::{Instant, sleep};

use super::link::TextLink;
use crate::cell::HansSpec;
use crate::execution::device::DeviceError;
use crate::execution::drivers::stream::Wiring;
use crate::execution::protocol::hans::HansRequest;

/// Inputs and outputs of Han's control box.
#[derive(Debug)]
pub struct HansSignals {
    spec: HansSpec,
    wiring: Wiring,
    link: Option<TextLink>,
    /// Output that was switched on, or may have been, and was not switched off since.
    on: Option<u8>,
}

impl HansSignals {
    /// Signals of the controller at the address of its specification, not connected.
    #[must_use]
    pub fn new(spec: HansSpec, wiring: Wiring) -> Self {
        Self { spec, wiring, link: None, on: None }
    }

    /// Sets a digital output.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn set_output(&mut self, output: u8, is_on: bool) -> Result<(), DeviceError> {
        if is_on {
            // Before it is sent: whoever gives the answer up leaves it on all the same.
            self.on = Some(output);
        }
        self.ask(&HansRequest::SetBoxDo { output, is_on }).await?;
        if !is_on && self.may_be_on(output) {
            self.on = None;
        }
        Ok(())
    }

    /// Returns true if a digital output was switched on here, and is not known to be off since.
    #[must_use]
    pub fn may_be_on(&self, output: u8) -> bool {
        self.on == Some(output)
    }

    /// Reads a digital input.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn input(&mut self, input: u8) -> Result<bool, DeviceError> {
        let values = self.ask(&HansRequest::ReadBoxDi { input }).await?;
        match values.iter().map(String::as_str).collect::<Vec<_>>()[..] {
            ["0"] => Ok(false),
            ["1"] => Ok(true),
            _ => Err(DeviceError::Malformed { what: format!("the level of input {input} as {values:?}") }),
        }
    }

    /// Waits until a digital input is on.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn wait_for_input(&mut self, input: u8) -> Result<(), DeviceError> {
        while !self.input(input).await? {
            sleep(self.poll()).await;
        }
        Ok(())
    }

    /// Waits until a digital input is off; returns false where it is read as on after `patience`.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn goes_off(&mut self, input: u8, patience: Duration) -> Result<bool, DeviceError> {
        let deadline = Instant::now() + patience;
        while self.input(input).await? {
            if Instant::now() >= deadline {
                return Ok(false);
            }
            sleep(self.poll()).await;
        }
        Ok(true)
    }

    /// Time between two readings of an input.
    fn poll(&self) -> Duration {
        Duration::from_millis(self.spec.poll_ms.into())
    }

    async fn ask(&mut self, request: &HansRequest) -> Result<Vec<String>, DeviceError> {
        let mut link = match self.link.take() {
            Some(link) => link,
            None => {
                let patience = Duration::from_millis(self.spec.connect_timeout_ms.into());
                let connection = self.wiring.connect(&self.spec.address, patience).await?;
                TextLink::new(connection, Duration::from_millis(self.spec.reply_timeout_ms.into()))
            }
        };
        let answer = link.ask(request).await;
        // A link that failed, or whose answer nobody waited for, is not used again.
        if answer.is_ok() {
            self.link = Some(link);
        }
        answer
    }
}
