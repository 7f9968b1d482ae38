//! Triggers of scanners: a digital handshake with the arm's controller, a request, or a program of the operator's. A capture that is
//! not acknowledged by its deadline is an error; none is skipped.

use std::pin::Pin;
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;

use hyper::body::{Body, Incoming};
use hyper::client::conn::http1::handshake;
use hyper::header::{CONTENT_TYPE, HOST};
use hyper::{Request, StatusCode};
use hyper_util::rt::TokioIo;
use serde_json::{Value, json};
use tokio::process::Command;
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep, timeout};

use super::hans::HansSignals;
use super::stream::{Wiring, within};
use crate::cell::{ArmControllerSpec, CommandTriggerSpec, ControllersSpec, DigitalTriggerSpec, HttpTriggerSpec, TriggerSpec};
use crate::execution::device::{Capture, Captured, DeviceError, Direction, Trigger, WITHDRAWAL, WireLog};

/// Name of the trigger in the log.
const DEVICE: &str = "trigger";
/// Longest time in which a scanner takes its acknowledgement away once the output is off.
const RELEASE: Duration = Duration::from_millis(500);
/// Largest answer to a request, bytes.
const MAX_ANSWER_BYTES: usize = 64 << 10;

/// Trigger of a cell file.
#[derive(Debug)]
pub enum ScannerTrigger {
    /// Digital signals of the arm's controller.
    Digital(DigitalTriggerSpec, Box<HansSignals>),
    /// A request to the scanner's software.
    Http(HttpTrigger),
    /// A program.
    Command(CommandTrigger),
    /// A cell without a trigger: the predicted time of the capture is waited out.
    Wait,
}

impl ScannerTrigger {
    /// Makes the trigger that a cell file names.
    ///
    /// # Errors
    /// A sentence: the driver of the arm has no digital signals.
    pub fn new(controllers: &ControllersSpec, log: Arc<dyn WireLog>) -> Result<Self, String> {
        match (&controllers.trigger, &controllers.arm) {
            (TriggerSpec::Digital(spec), ArmControllerSpec::Hans(arm)) => {
                Ok(Self::Digital(spec.clone(), Box::new(HansSignals::new(arm.clone(), Wiring::over_tcp(DEVICE, log)))))
            }
            (TriggerSpec::Digital(_), arm) => {
                Err(format!("the driver of {} has no digital signals; trigger the scanner by http or by a command", arm.name()))
            }
            (TriggerSpec::Http(spec), _) => Ok(Self::Http(HttpTrigger { spec: spec.clone(), log })),
            (TriggerSpec::Command(spec), _) => Ok(Self::Command(CommandTrigger { spec: spec.clone(), log })),
            (TriggerSpec::None(_), _) => Ok(Self::Wait),
        }
    }

    /// Error of a capture that nothing acknowledged by its deadline.
    fn unacknowledged(&self, capture: &Capture) -> DeviceError {
        match self {
            Self::Digital(DigitalTriggerSpec { output, input, .. }, _) => capture.unacknowledged(
                format!("input {input} did not come on after output {output}"),
                "see whether the scanner took the capture, and check its cable and both numbers in the cell file",
            ),
            Self::Http(HttpTrigger { spec, .. }) => capture.unacknowledged(
                format!("{} did not answer", spec.url),
                "see whether the scanner's software took the capture or waits for something, and check url in the cell file",
            ),
            Self::Command(CommandTrigger { spec, .. }) => capture.unacknowledged(
                format!("the program {} did not end", spec.program),
                "see what it waits for: run it by hand with the arguments of the cell file",
            ),
            Self::Wait => capture.unacknowledged("the time of the capture did not pass", "see what keeps this machine busy"),
        }
    }
}

impl Trigger for ScannerTrigger {
    /// Brightness goes with the capture: no trigger has a way of its own for it.
    async fn set_brightness(&mut self, _level: u8) -> Result<(), DeviceError> {
        Ok(())
    }

    async fn capture(&mut self, capture: &Capture) -> Result<Captured, DeviceError> {
        let began = Instant::now();
        let acknowledged = timeout(capture.deadline, async {
            match self {
                Self::Digital(spec, signals) => handshake_by_signals(spec, signals).await.map(|()| None),
                Self::Http(trigger) => trigger.capture(capture).await,
                Self::Command(trigger) => trigger.capture(capture).await.map(|()| None),
                Self::Wait => {
                    sleep(capture.expected).await;
                    Ok(None)
                }
            }
        });
        let id = acknowledged.await.unwrap_or_else(|_| Err(self.unacknowledged(capture)));
        let took = began.elapsed();
        if id.is_err()
            && let Self::Digital(spec, signals) = self
        {
            // A scanner that goes by the level would take captures from here on. The error that is told is the first. A run gives a
            // trigger more than this beyond its deadline.
            let _ = within(WITHDRAWAL, signals.set_output(spec.output, false)).await;
        }
        Ok(Captured { id: id?, took })
    }

    async fn withdraw(&mut self) {
        if let Self::Digital(spec, signals) = self
            && signals.may_be_on(spec.output)
        {
            // What fails is tried again by the next withdrawal.
            let _ = signals.set_output(spec.output, false).await;
        }
    }
}

/// Sets the output until the input acknowledges.
async fn handshake_by_signals(spec: &DigitalTriggerSpec, signals: &mut HansSignals) -> Result<(), DeviceError> {
    signals.set_output(spec.output, false).await?;
    // The acknowledgement of the capture before, at another brightness, may have just come.
    if !signals.goes_off(spec.input, RELEASE).await? {
        let (input, release_ms) = (spec.input, RELEASE.as_millis());
        let reason = format!(
            "input {input} of the scanner is on before the capture, and was for {release_ms} ms after its output was switched off; see \
             what holds it"
        );
        return Err(DeviceError::NotReady { reason });
    }
    signals.set_output(spec.output, true).await?;
    let acknowledged = signals.wait_for_input(spec.input).await;
    signals.set_output(spec.output, false).await?;
    acknowledged
}

/// Trigger by requests.
pub struct HttpTrigger {
    spec: HttpTriggerSpec,
    log: Arc<dyn WireLog>,
}

impl std::fmt::Debug for HttpTrigger {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("HttpTrigger").field("spec", &self.spec).finish_non_exhaustive()
    }
}

impl HttpTrigger {
    /// Posts the capture; returns the `id` of the answer, if it has one.
    async fn capture(&self, capture: &Capture) -> Result<Option<String>, DeviceError> {
        let (authority, path) = self.parts();
        let Capture { run, step, view, brightness, .. } = capture;
        let deadline_ms = capture.deadline.as_millis() as u64;
        let body =
            json!({"run": run, "step": step, "view": view, "brightness": brightness, "deadline_ms": deadline_ms}).to_string();
        let request = Request::post(path).header(HOST, authority).header(CONTENT_TYPE, "application/json").body(body.clone());
        let request = request.map_err(|error| malformed(&error))?;
        let address = if authority.contains(':') { authority.to_owned() } else { format!("{authority}:80") };
        // Without further attempts: a capture that nobody takes holds the run.
        let wiring = Wiring::over_tcp(DEVICE, Arc::new(()));
        let stream = wiring.connect(&address, Duration::from_millis(self.spec.deadline_ms.into())).await?.into_stream();
        let (mut sender, connection) = handshake(TokioIo::new(stream)).await.map_err(|error| closed(&error))?;
        self.log.record(DEVICE, Direction::Sent, body.as_bytes());
        let carried = AbortOnDrop(tokio::spawn(connection));
        let response = sender.send_request(request).await.map_err(|error| closed(&error))?;
        let status = response.status();
        let answer = answer_of(response.into_body()).await?;
        drop(carried);
        self.log.record(DEVICE, Direction::Received, format!("{status} ").as_bytes());
        self.log.record(DEVICE, Direction::Received, &answer);
        acknowledged(status, &answer)
    }

    /// Authority and path of the address.
    fn parts(&self) -> (&str, &str) {
        let rest = self.spec.url.strip_prefix("http://").unwrap_or(&self.spec.url);
        rest.find('/').map_or((rest, "/"), |at| rest.split_at(at))
    }
}

/// A task that ends with its owner.
struct AbortOnDrop<T>(JoinHandle<T>);

impl<T> Drop for AbortOnDrop<T> {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Identifier of an answer that acknowledges.
fn acknowledged(status: StatusCode, answer: &[u8]) -> Result<Option<String>, DeviceError> {
    if !status.is_success() {
        let text = String::from_utf8_lossy(answer).chars().take(200).collect();
        return Err(DeviceError::Refused { code: status.as_u16().into(), text });
    }
    let id = serde_json::from_slice::<Value>(answer).ok().and_then(|answer| answer.get("id")?.as_str().map(str::to_owned));
    Ok(id)
}

/// Bytes of an answer, at most [`MAX_ANSWER_BYTES`].
async fn answer_of(mut body: Incoming) -> Result<Vec<u8>, DeviceError> {
    let mut answer = Vec::new();
    while let Some(frame) = std::future::poll_fn(|ctx| Pin::new(&mut body).poll_frame(ctx)).await {
        let frame = frame.map_err(|error| closed(&error))?;
        answer.extend(frame.data_ref().into_iter().flatten());
        if answer.len() > MAX_ANSWER_BYTES {
            return Err(DeviceError::Malformed { what: format!("an answer of more than {MAX_ANSWER_BYTES} bytes") });
        }
    }
    Ok(answer)
}

fn malformed(error: &impl ToString) -> DeviceError {
    DeviceError::Malformed { what: error.to_string() }
}

fn closed(error: &hyper::Error) -> DeviceError {
    DeviceError::Closed { reason: error.to_string() }
}

/// Trigger by a program.
pub struct CommandTrigger {
    spec: CommandTriggerSpec,
    log: Arc<dyn WireLog>,
}

impl std::fmt::Debug for CommandTrigger {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CommandTrigger").field("spec", &self.spec).finish_non_exhaustive()
    }
}

impl CommandTrigger {
    /// Runs the program; its end with exit code 0 acknowledges. It is killed where nobody waits for it any longer.
    async fn capture(&self, capture: &Capture) -> Result<(), DeviceError> {
        let CommandTriggerSpec { program, arguments, .. } = &self.spec;
        let arguments: Vec<String> = arguments.iter().map(|argument| filled_in(argument, capture)).collect();
        self.log.record(DEVICE, Direction::Sent, format!("{program} {}", arguments.join(" ")).as_bytes());
        let mut command = Command::new(program);
        command.args(&arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).kill_on_drop(true);
        let not_started = |error: std::io::Error| DeviceError::NotReady {
            reason: format!("the program {program} cannot be started ({error}); check its path in the cell file, and its rights"),
        };
        let status = command.status().await.map_err(not_started)?;
        self.log.record(DEVICE, Direction::Received, status.to_string().as_bytes());
        if status.success() {
            return Ok(());
        }
        Err(DeviceError::Refused { code: status.code().unwrap_or(-1).into(), text: format!("{program} ended with {status}") })
    }
}

/// An argument with the values of a capture.
fn filled_in(argument: &str, capture: &Capture) -> String {
    let filled = argument.replace("{run}", &capture.run).replace("{step}", &capture.step.to_string());
    filled.replace("{view}", &capture.view.to_string()).replace("{brightness}", &capture.brightness.to_string())
}

#[cfg(test)]
mod tests;
