//! The signals that end a command: ctrl-c, and SIGTERM where there is one. They are waited for on a thread of their own,
//! so that they are heard also when everything else hangs.

use std::time::Duration;

use super::{CliError, EXIT_INTERRUPTED, failed};

/// From now on the first signal does not end the process by itself but is told to `first`; the second ends it at once.
/// With `patience`, so does the end of that time after the first: the command did not come to its end in it.
pub(super) fn on_signals(first: impl FnOnce(&'static str) + Send + 'static, patience: Option<Duration>) -> Result<(), CliError> {
    let (listening, heard) = std::sync::mpsc::channel();
    let wait = move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let signals = runtime.map_err(|error| failed("the runtime for signals", &error)).and_then(|runtime| {
            let signals = runtime.block_on(async { Signals::listen() })?;
            Ok((runtime, signals))
        });
        match signals {
            Ok((runtime, signals)) => {
                // The one who asks waits for this.
                let _ = listening.send(Ok(()));
                runtime.block_on(end_by(signals, first, patience));
            }
            Err(error) => drop(listening.send(Err(error))),
        }
    };
    let thread = std::thread::Builder::new().name("signals".to_owned()).spawn(wait);
    thread.map_err(|error| failed("the thread for signals", &error))?;
    heard.recv().map_err(|error| failed("the thread for signals", &error))?
}

async fn end_by(mut signals: Signals, first: impl FnOnce(&'static str), patience: Option<Duration>) {
    first(signals.next().await);
    let second = tokio::time::timeout(patience.unwrap_or(Duration::MAX), signals.next());
    if second.await.is_err() {
        tracing::warn!("stopping without what does not end");
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

    /// The next one, by name.
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
