//! Signals that end a command: ctrl-c, and on Unix SIGTERM, SIGHUP (the terminal is closed) and SIGQUIT. A separate thread waits for
//! them, so they are handled even when everything else hangs.

use std::time::Duration;

use tokio::time::Instant;

use super::{CliError, EXIT_INTERRUPTED, failed, telemetry};

/// Time after the first signal within which others are echoes of it: `timeout` sends two at once, a terminal that is closed as many.
/// What moves is told to stop within a fraction of it.
const ECHO: Duration = Duration::from_millis(300);

/// Passes the first signal to `first` instead of ending the process; a second signal, unless it is an echo of the first, ends the
/// process at once. With `grace`, the process also ends if the command has not ended that long after the first signal.
pub(super) fn on_signals(first: impl FnOnce(&'static str) + Send + 'static, grace: Option<Duration>) -> Result<(), CliError> {
    let (listening, heard) = std::sync::mpsc::channel();
    let wait = move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let signals = runtime.map_err(|error| failed("the runtime for signals", &error)).and_then(|runtime| {
            let signals = runtime.block_on(async { Signals::listen() })?;
            Ok((runtime, signals))
        });
        match signals {
            Ok((runtime, signals)) => {
                // The caller waits for this.
                let _ = listening.send(Ok(()));
                runtime.block_on(end_by(signals, first, grace));
            }
            Err(error) => drop(listening.send(Err(error))),
        }
    };
    let thread = std::thread::Builder::new().name("signals".to_owned()).spawn(wait);
    thread.map_err(|error| failed("the thread for signals", &error))?;
    heard.recv().map_err(|error| failed("the thread for signals", &error))?
}

async fn end_by(mut signals: Signals, first: impl FnOnce(&'static str), grace: Option<Duration>) {
    first(signals.next().await);
    let second = tokio::time::timeout(grace.unwrap_or(Duration::MAX), without_echoes(async || signals.next().await));
    let code = if second.await.is_err() {
        tracing::warn!("stopping although some work has not finished");
        0
    } else {
        tracing::warn!("stopping at once");
        EXIT_INTERRUPTED
    };
    telemetry::flush();
    std::process::exit(code);
}

/// Waits for a signal that is no echo of one just now.
async fn without_echoes(mut next: impl AsyncFnMut() -> &'static str) {
    let first = Instant::now();
    loop {
        next().await;
        if first.elapsed() >= ECHO {
            return;
        }
    }
}

#[cfg(unix)]
struct Signals(Vec<(&'static str, tokio::signal::unix::Signal)>);

#[cfg(unix)]
impl Signals {
    fn listen() -> Result<Self, CliError> {
        use tokio::signal::unix::{SignalKind, signal};
        // It does not exist on other systems than Linux.
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let hearable = [("SIGHUP", SignalKind::hangup()), ("SIGQUIT", SignalKind::quit())];
        let hearable = hearable.into_iter().filter(|(_, kind)| !is_ignored(&status, kind.as_raw_value()));
        let kinds = [("SIGTERM", SignalKind::terminate()), ("SIGINT", SignalKind::interrupt())].into_iter().chain(hearable);
        let listen = |(name, kind)| signal(kind).map(|signal| (name, signal)).map_err(|error| failed(name, &error));
        kinds.map(listen).collect::<Result<_, CliError>>().map(Self)
    }

    /// Waits for the next signal; its name.
    async fn next(&mut self) -> &'static str {
        use std::task::Poll;
        std::future::poll_fn(|context| {
            let mut each = self.0.iter_mut();
            let raised = each.find_map(|(name, signal)| signal.poll_recv(context).is_ready().then_some(*name));
            raised.map_or(Poll::Pending, Poll::Ready)
        })
        .await
    }
}

/// Returns true for a signal that this process was started without, as by `nohup`, which keeps it alive without its terminal.
#[cfg(unix)]
fn is_ignored(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or_default();
    (mask >> (signal - 1)) & 1 == 1
}

#[cfg(not(unix))]
struct Signals;

#[cfg(not(unix))]
impl Signals {
    fn listen() -> Result<Self, CliError> {
        Ok(Self)
    }

    async fn next(&mut self) -> &'static str {
        let _ = tokio::signal::ctrl_c().await;
        "ctrl-c"
    }
}

#[cfg(all(test, unix))]
mod tests {
    use rustix::process::{Signal, getpid, kill_process};

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn echoes_of_a_signal_are_no_second_one() {
        let mut pauses = [Duration::ZERO, ECHO / 2, ECHO].into_iter();
        without_echoes(async || {
            tokio::time::sleep(pauses.next().expect("a third signal is none of the first")).await;
            "SIGTERM"
        })
        .await;
        assert_eq!(pauses.len(), 0, "the first two count");
    }

    #[tokio::test]
    async fn a_terminal_that_is_closed_ends_a_command_like_ctrl_c() {
        let mut signals = Signals::listen().expect("signals");
        for (name, signal) in
            [("SIGTERM", Signal::TERM), ("SIGINT", Signal::INT), ("SIGHUP", Signal::HUP), ("SIGQUIT", Signal::QUIT)]
        {
            // What the tests were started without stays unheard, and harmless.
            if signals.0.iter().any(|(heard, _)| *heard == name) {
                kill_process(getpid(), signal).expect("sent");
                assert_eq!(signals.next().await, name);
            }
        }
    }

    #[test]
    fn a_signal_that_a_command_was_started_without_stays_unheard() {
        let status = "Name:\tvantage\nSigBlk:\t0000000000000000\nSigIgn:\t0000000000000005\nSigCgt:\t0000000000004002\n";
        assert_eq!([1, 2, 3, 15].map(|signal| is_ignored(status, signal)), [true, false, true, false]);
        assert!(!is_ignored("", 1));
    }
}
