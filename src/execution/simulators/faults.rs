//! Faults of a simulated controller, set while it runs: by the tests that own it, or line by line over a socket, where it is
//! also asked for where it stands.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde::Serialize;
use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, BufReader};
use tokio::net::TcpListener;
use tokio::sync::watch;

/// Longest line of a control connection, bytes.
const MAX_LINE_BYTES: u64 = 256;
/// Longest delay of replies.
const MAX_LATE: Duration = Duration::from_secs(60);

/// A look at a simulated device from beside it, whatever its connections do.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DeviceLook {
    /// Position of each axis.
    pub positions_deg: Vec<f64>,
    /// True if the device moves.
    pub is_moving: bool,
    /// Error that it is in.
    pub error: Option<u32>,
}

/// Answer to `state`.
#[derive(Debug, Serialize)]
struct LookAnswer {
    #[serde(flatten)]
    look: DeviceLook,
    faults: FaultState,
}

/// Faults in force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FaultState {
    /// The emergency stop is pressed.
    pub is_emergency_stop: bool,
    /// The guard is open.
    pub is_guard_open: bool,
    /// The device is in this error.
    pub alarm: Option<u32>,
    /// Delay of every reply.
    #[serde(rename = "late_secs", serialize_with = "in_secs")]
    pub late: Duration,
    /// True if no request is answered.
    pub is_silent: bool,
    /// 32-bit values come in the other order of words.
    pub swaps_words: bool,
    /// Times that everything was reset, as at the device itself.
    #[serde(skip)]
    pub resets: u64,
}

/// A change of the faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultCommand {
    /// Presses the emergency stop, or pulls it out.
    EmergencyStop(bool),
    /// Opens the guard, or closes it.
    Guard(bool),
    /// Raises an error, or ends it.
    Alarm(Option<u32>),
    /// Delays every reply.
    Late(Duration),
    /// Answers nothing, or again.
    Silent(bool),
    /// Swaps the words of 32-bit values, or no longer.
    WordOrder(bool),
    /// Cuts every connection.
    Cut,
    /// Ends all faults, and resets the device as somebody does who stands in front of it.
    Clear,
}

/// Commands, for messages.
const COMMANDS: &str =
    "emergency_stop on|off, guard on|off, alarm NUMBER|off, late MS, silent on|off, word_order on|off, cut, clear, state";

impl FaultCommand {
    /// Reads a line.
    ///
    /// # Errors
    /// The commands that there are.
    pub fn parse(line: &str) -> Result<Self, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let is_on = |word: &str| ["off", "on"].iter().position(|known| *known == word).map(|index| index == 1);
        let command = match words.as_slice() {
            ["emergency_stop", word] => is_on(word).map(Self::EmergencyStop),
            ["guard", word] => is_on(word).map(Self::Guard),
            ["alarm", "off"] => Some(Self::Alarm(None)),
            ["alarm", number] => {
                number.parse().ok().filter(|number| (1..=65_535).contains(number)).map(|number| Self::Alarm(Some(number)))
            }
            ["late", ms] => ms.parse().ok().map(Duration::from_millis).filter(|late| *late <= MAX_LATE).map(Self::Late),
            ["silent", word] => is_on(word).map(Self::Silent),
            ["word_order", word] => is_on(word).map(Self::WordOrder),
            ["cut"] => Some(Self::Cut),
            ["clear"] => Some(Self::Clear),
            _ => None,
        };
        command.ok_or_else(|| format!("is none of: {COMMANDS}"))
    }
}

/// Faults of one simulator.
#[derive(Debug)]
pub struct Faults {
    state: Mutex<FaultState>,
    /// Rises with every cut.
    cuts: watch::Sender<u64>,
}

impl Default for Faults {
    fn default() -> Self {
        Self { state: Mutex::default(), cuts: watch::Sender::new(0) }
    }
}

impl Faults {
    /// Faults in force.
    #[must_use]
    pub fn state(&self) -> FaultState {
        *self.lock()
    }

    /// Applies a command.
    pub fn apply(&self, command: FaultCommand) {
        let mut state = self.lock();
        match command {
            FaultCommand::EmergencyStop(on) => state.is_emergency_stop = on,
            FaultCommand::Guard(on) => state.is_guard_open = on,
            FaultCommand::Alarm(alarm) => state.alarm = alarm,
            FaultCommand::Late(late) => state.late = late,
            FaultCommand::Silent(on) => state.is_silent = on,
            FaultCommand::WordOrder(on) => state.swaps_words = on,
            FaultCommand::Cut => self.cuts.send_modify(|cuts| *cuts += 1),
            FaultCommand::Clear => *state = FaultState { resets: state.resets + 1, ..FaultState::default() },
        }
    }

    /// Waits for the next cut.
    pub(super) fn next_cut(&self) -> impl Future<Output = ()> + Send + use<> {
        let mut cuts = self.cuts.subscribe();
        async move {
            if cuts.changed().await.is_err() {
                std::future::pending::<()>().await;
            }
        }
    }

    /// Takes commands from a listener, one client after another.
    pub async fn serve(&self, listener: TcpListener, look: impl Fn() -> DeviceLook) {
        while let Ok((mut stream, _)) = listener.accept().await {
            let (reader, writer) = stream.split();
            self.obey(reader, writer, &look).await;
        }
    }

    /// Takes commands line by line and answers each, until the input ends.
    pub async fn obey(
        &self,
        reader: impl AsyncRead + Unpin,
        mut writer: impl AsyncWrite + Unpin,
        look: &impl Fn() -> DeviceLook,
    ) {
        let mut lines = BufReader::new(reader);
        loop {
            let mut line = String::new();
            match (&mut lines).take(MAX_LINE_BYTES).read_line(&mut line).await {
                Ok(read) if read > 0 => {}
                _ => return,
            }
            let answer = match line.trim() {
                "" => continue,
                "state" => serde_json::to_string(&LookAnswer { look: look(), faults: self.state() })
                    .unwrap_or_else(|error| format!("error: {error}")),
                line => match FaultCommand::parse(line) {
                    Ok(command) => {
                        self.apply(command);
                        "ok".to_owned()
                    }
                    Err(error) => format!("error: {line:?} {error}"),
                },
            };
            if writer.write_all(format!("{answer}\n").as_bytes()).await.is_err() {
                return;
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, FaultState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn in_secs<S: serde::Serializer>(duration: &Duration, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(duration.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn lines_set_faults_and_unknown_ones_are_answered_with_what_there_is() {
        let faults = Faults::default();
        let mut answers = Vec::new();
        let look = || DeviceLook { positions_deg: vec![12.5], is_moving: true, error: Some(16) };
        let lines = b"emergency_stop on\nlate 250\nalarm 2400\nfly\n\nalarm 0\nstate\n";
        faults.obey(&lines[..], &mut answers, &look).await;
        let mut answers = String::from_utf8(answers).expect("text");
        let state: serde_json::Value = serde_json::from_str(answers.lines().last().expect("a line")).expect("JSON");
        let told = (&state["positions_deg"][0], &state["is_moving"], &state["error"], &state["faults"]["late_secs"]);
        assert_eq!(told, (&12.5.into(), &true.into(), &16.into(), &0.25.into()));
        answers.truncate(answers.find('{').expect("the state"));
        let firsts: Vec<&str> = answers.lines().map(|line| line.split(':').next().expect("a word")).collect();
        assert_eq!(firsts, ["ok", "ok", "ok", "error", "error"]);
        let expected =
            FaultState { is_emergency_stop: true, late: Duration::from_millis(250), alarm: Some(2400), ..FaultState::default() };
        assert_eq!(faults.state(), expected);
        let cut = faults.next_cut();
        faults.apply(FaultCommand::Cut);
        cut.await;
        faults.apply(FaultCommand::Clear);
        assert_eq!(faults.state(), FaultState { resets: 1, ..FaultState::default() });
    }
}
