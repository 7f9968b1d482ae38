//! Signals that end a command: ctrl-c, and on Unix SIGTERM. A separate thread waits for them, so they are handled even when
//! everything else hangs.

use std::time::Duration;

use super::{CliError, EXIT_INTERRUPTED, failed};

/// Passes the first signal to `first` instead of ending the process; a second signal ends the process at once. With
/// `grace`, the process also ends if the command has not ended that long after the first signal.
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
    let second = tokio::time::timeout(grace.unwrap_or(Duration::MAX), signals.next());
    if second.await.is_err() {
        tracing::warn!("stopping although some work has not ended");
        std::process::exit(0);
    }
    tracing::warn!("stopping at once");
    std::process::exit(EXIT_INTERRUPTED);
}

struct Signals {
    #[cfg(unix)]
    terminate: tokio::signal::unix::Signal,
    #[cfg(unix)]
    interrupt: tokio::signal::unix::Signal,
}

impl Signals {
    #[cfg(unix)]
    fn listen() -> Result<Self, CliError> {
        use tokio::signal::unix::{SignalKind, signal};
        let listen = |kind, name| signal(kind).map_err(|error| failed(name, &error));
        Ok(Self { terminate: listen(SignalKind::terminate(), "SIGTERM")?, interrupt: listen(SignalKind::interrupt(), "SIGINT")? })
    }

    /// Waits for the next signal; its name.
    #[cfg(unix)]
    async fn next(&mut self) -> &'static str {
        tokio::select! {
            _ = self.terminate.recv() => "SIGTERM",
            _ = self.interrupt.recv() => "SIGINT",
        }
    }

    #[cfg(not(unix))]
    fn listen() -> Result<Self, CliError> {
        Ok(Self {})
    }

    #[cfg(not(unix))]
    async fn next(&mut self) -> &'static str {
        let _ = tokio::signal::ctrl_c().await;
        "ctrl-c"
    }
}
