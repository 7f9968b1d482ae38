//! Triggers of the scanner: a request to its software, a program of the operator's, or the program's own capture time. An
//! acknowledgement that does not come is an error, never a skip.

use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use serde_json::{Value, json};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::{Instant, sleep, timeout};

use crate::cell::{CommandTriggerSpec, HttpTriggerSpec, TriggerSpec};
use crate::execution::device::{Capture, Captured, DeviceError, Direction, Trigger, WireLog};

/// Bytes of an answer that are read at most.
const MAX_ANSWER: usize = 64 << 10;
/// Interval at which a program is asked whether it has ended.
const POLL: Duration = Duration::from_millis(5);

/// Trigger of a cell file.
pub struct ScannerTrigger {
    kind: Kind,
    log: Arc<dyn WireLog>,
}

enum Kind {
    Http(HttpTriggerSpec),
    Command(CommandTriggerSpec),
    Wait,
}

impl ScannerTrigger {
    /// The trigger of a specification.
    ///
    /// # Errors
    /// A trigger that this version has no driver for.
    pub fn new(spec: &TriggerSpec, log: Arc<dyn WireLog>) -> Result<Self, String> {
        let kind = match spec {
            TriggerSpec::Http(spec) => Kind::Http(spec.clone()),
            TriggerSpec::Command(spec) => Kind::Command(spec.clone()),
            TriggerSpec::None(_) => Kind::Wait,
            TriggerSpec::Digital(_) => {
                return Err("this version has no driver for a digital trigger; trigger by http or by a command".to_owned());
            }
        };
        Ok(Self { kind, log })
    }
}

impl Trigger for ScannerTrigger {
    async fn set_brightness(&mut self, _level: u8) -> Result<(), DeviceError> {
        // Each capture carries its own.
        Ok(())
    }

    async fn capture(&mut self, capture: &Capture) -> Result<Captured, DeviceError> {
        let (began, waited) = (Instant::now(), capture.deadline);
        let acknowledged = async {
            match &self.kind {
                Kind::Http(spec) => request(spec, capture, &*self.log).await,
                Kind::Command(spec) => command(spec, capture).await,
                Kind::Wait => {
                    sleep(capture.expected).await;
                    Ok(None)
                }
            }
        };
        let id = timeout(waited, acknowledged).await.unwrap_or(Err(DeviceError::Silent { waited }))?;
        Ok(Captured { id, took: began.elapsed() })
    }
}

/// Posts a capture; the `id` of a JSON answer is the capture's name.
async fn request(spec: &HttpTriggerSpec, capture: &Capture, log: &dyn WireLog) -> Result<Option<String>, DeviceError> {
    let rest = spec.url.trim_start_matches("http://");
    let (host, path) = rest.split_once('/').map_or((rest, "/".to_owned()), |(host, path)| (host, format!("/{path}")));
    let address =
        if host.rsplit(']').next().is_some_and(|end| end.contains(':')) { host.to_owned() } else { format!("{host}:80") };
    let closed = |error: std::io::Error| DeviceError::Closed { reason: error.to_string() };
    let unreachable = |error: std::io::Error| DeviceError::Unreachable { address: address.clone(), reason: error.to_string() };
    let mut stream = TcpStream::connect(&address).await.map_err(unreachable)?;
    let Capture { run, step, view, brightness, .. } = capture;
    let body = json!({"run": run, "step": step, "viewpoint": view, "brightness": brightness}).to_string();
    let length = body.len();
    let message = format!(
        "POST {path} HTTP/1.1\r\nHost: {host}\r\nContent-Type: application/json\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{body}"
    );
    stream.write_all(message.as_bytes()).await.map_err(closed)?;
    log.record("trigger", Direction::Sent, message.as_bytes());
    let mut answer = Vec::new();
    stream.take(MAX_ANSWER as u64).read_to_end(&mut answer).await.map_err(closed)?;
    log.record("trigger", Direction::Received, &answer);
    read_answer(&answer)
}

/// The name that the scanner gave a capture, in an answer that acknowledges it.
fn read_answer(answer: &[u8]) -> Result<Option<String>, DeviceError> {
    let text = String::from_utf8_lossy(answer);
    let status = text.strip_prefix("HTTP/1.").and_then(|rest| rest.split(' ').nth(1)).and_then(|code| code.parse::<i64>().ok());
    let head = text.lines().next().unwrap_or_default();
    match status {
        Some(200..=299) => {}
        Some(code) => return Err(DeviceError::Refused { code, text: head.to_owned() }),
        None => return Err(DeviceError::Malformed { what: head.chars().take(80).collect() }),
    }
    let body: Option<Value> = text.split_once("\r\n\r\n").and_then(|(_, body)| serde_json::from_str(body).ok());
    Ok(body.and_then(|body| body["id"].as_str().map(str::to_owned)))
}

/// A program that ends with its owner.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // One that has ended already is neither killed nor waited for.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs the operator's program for a capture.
async fn command(spec: &CommandTriggerSpec, capture: &Capture) -> Result<Option<String>, DeviceError> {
    let filled = |argument: &String| {
        let words = [
            ("{run}", capture.run.clone()),
            ("{step}", capture.step.to_string()),
            ("{view}", capture.view.to_string()),
            ("{brightness}", capture.brightness.to_string()),
        ];
        words.iter().fold(argument.clone(), |argument, (name, value)| argument.replace(name, value))
    };
    let mut program = Command::new(&spec.program);
    program.args(spec.arguments.iter().map(filled)).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let unreachable =
        |error: std::io::Error| DeviceError::Unreachable { address: spec.program.clone(), reason: error.to_string() };
    let mut running = Running(program.spawn().map_err(unreachable)?);
    loop {
        let ended = running.0.try_wait().map_err(|error| DeviceError::Closed { reason: error.to_string() })?;
        match ended {
            None => sleep(POLL).await,
            Some(status) if status.success() => return Ok(None),
            Some(status) => {
                let code = status.code().map_or(-1, i64::from);
                return Err(DeviceError::Refused { code, text: status.to_string() });
            }
        }
    }
}

#[cfg(test)]
mod tests;
