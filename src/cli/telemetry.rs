//! Log of the program, on standard error. A log that cannot be written stops nothing: where something moves or is served, a thread of
//! its own writes it, and lines that it has no room for are dropped and counted.

use std::io::{self, Write};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use tracing::Level;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

use super::{CliError, failed, output};
use crate::cell::did_you_mean;
use crate::settings::{LogFormat, TelemetrySettings};

/// Levels of the log, by their names.
const LEVELS: [&str; 6] = ["off", "error", "warn", "info", "debug", "trace"];
/// Lines that may wait to be written.
const MAX_WAITING_LINES: usize = 4096;
/// Longest time that the end of a command waits for them.
const FLUSH_LIMIT: Duration = Duration::from_millis(500);
/// Time between two looks at whether they are written.
const FLUSH_INTERVAL: Duration = Duration::from_millis(2);

/// Queue of a log that is detached from the threads that tell it something.
static QUEUE: OnceLock<LogQueue> = OnceLock::new();

/// Starts the log of a server: as set, more with `--verbose`, errors only with `--quiet`.
pub(super) fn start(settings: &TelemetrySettings) -> Result<DetachedLog, CliError> {
    let filter = if output::is_quiet() { "error".to_owned() } else { server_filter(&settings.log, output::verbosity()) };
    let format = if output::is_json() { LogFormat::Json } else { settings.format };
    let log = detach()?;
    start_with(&filter, format)?;
    Ok(log)
}

/// Filter of a server's log. `--verbose` adds the server's own details to what is set, not those of every library: a line for
/// each statement to the database would bury them. Modules of the server that the setting names keep their levels.
fn server_filter(set: &str, verbosity: u8) -> String {
    let own = match verbosity {
        0 => return set.to_owned(),
        1 => Level::DEBUG,
        2 => Level::TRACE,
        _ => return "trace".to_owned(),
    };
    let is_told = targets(set).is_ok_and(|set| set.would_enable("vantage", &own));
    // Without a level for all others, a filter has errors alone.
    if is_told { set.to_owned() } else { format!("error,{set},vantage={own}") }
}

/// Starts the log of any other command, which has none without `--verbose`.
pub(super) fn start_if_verbose() -> Result<(), CliError> {
    let Some(filter) = command_filter(output::verbosity()) else { return Ok(()) };
    start_with(filter, if output::is_json() { LogFormat::Json } else { LogFormat::Text })
}

/// Filter of the log of any other command. As with a server's, the details are the program's own at first.
fn command_filter(verbosity: u8) -> Option<&'static str> {
    match verbosity {
        0 => None,
        1 => Some("info"),
        2 => Some("info,vantage=debug"),
        _ => Some("trace"),
    }
}

fn start_with(filter: &str, format: LogFormat) -> Result<(), CliError> {
    let filter = targets(filter).map_err(|reason| CliError::BadInput(format!("telemetry.log {filter:?}: {reason}")))?;
    let (filtered, lines) = (tracing_subscriber::registry().with(filter), tracing_subscriber::fmt::layer());
    let lines = lines.with_writer(|| LogWriter).log_internal_errors(false);
    let started = match format {
        LogFormat::Text => filtered.with(lines.with_ansi(io::IsTerminal::is_terminal(&io::stderr()))).try_init(),
        LogFormat::Json => filtered.with(lines.json()).try_init(),
    };
    started.map_err(|error| CliError::Failed(format!("the log: {error}")))
}

/// Parses a filter: levels of modules, and of all others. Without any, errors are logged.
fn targets(filter: &str) -> Result<Targets, String> {
    let words: Vec<&str> = filter.split(',').map(str::trim).filter(|word| !word.is_empty()).collect();
    words.iter().try_for_each(|word| check_word(word))?;
    if words.is_empty() {
        return Ok(Targets::new().with_default(LevelFilter::ERROR));
    }
    words.join(",").parse().map_err(|error: tracing_subscriber::filter::ParseError| error.to_string())
}

/// Refuses a word that is no level, which the filter would take for the name of a module and log nothing else, and one that names a
/// span or a field.
fn check_word(word: &str) -> Result<(), String> {
    let allowed = || format!("allowed are {}, and MODULE=LEVEL", LEVELS.join(", "));
    if word.contains(['[', ']']) {
        return Err(format!("{word:?} names a span or a field; {}", allowed()));
    }
    if word.contains(['=', ':']) || word.parse::<LevelFilter>().is_ok() {
        return Ok(());
    }
    Err(format!("{word:?} is not a level; {}{}", allowed(), did_you_mean(word, LEVELS)))
}

/// Detaches the log: a thread of its own writes it from now on, so that a terminal that is paused or a pipe that nobody reads holds
/// up nothing.
///
/// # Errors
/// [`CliError::Failed`] without a thread for it.
pub(super) fn detach() -> Result<DetachedLog, CliError> {
    let tell = |lines: u64| tracing::warn!(lines, "log lines were dropped, because the log could not be written");
    let queue = LogQueue::start(io::stderr(), tell).map_err(|error| failed("the thread of the log", &error))?;
    // A process has one log; the thread of a second one ends with its queue.
    let _ = QUEUE.set(queue);
    Ok(DetachedLog)
}

/// Waits for a short time until the lines of a detached log are written.
pub(super) fn flush() {
    if let Some(queue) = QUEUE.get() {
        queue.flush(FLUSH_LIMIT);
    }
}

/// Log that is detached; flushed at the end of the command.
#[must_use]
pub(super) struct DetachedLog;

impl Drop for DetachedLog {
    fn drop(&mut self) {
        flush();
    }
}

/// Standard error, by way of the queue if the log is detached.
struct LogWriter;

impl Write for LogWriter {
    /// Takes a whole line.
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        match QUEUE.get() {
            Some(queue) => queue.push(line),
            None => io::stderr().write_all(line)?,
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Lines on their way to the thread that writes them.
struct LogQueue {
    lines: SyncSender<Vec<u8>>,
    counts: Arc<LogCounts>,
}

#[derive(Default)]
struct LogCounts {
    /// Lines that are not written yet.
    waiting: AtomicUsize,
    /// Lines for which there was no room, not told yet.
    dropped: AtomicU64,
}

impl LogQueue {
    /// Starts the thread that writes to `log`. `tell` is told the number of lines dropped, once those that waited are written.
    fn start(log: impl Write + Send + 'static, tell: impl Fn(u64) + Send + 'static) -> io::Result<Self> {
        let (lines, waiting) = mpsc::sync_channel(MAX_WAITING_LINES);
        let counts = Arc::new(LogCounts::default());
        let of_thread = Arc::clone(&counts);
        std::thread::Builder::new().name("log".to_owned()).spawn(move || write_lines(&waiting, &of_thread, log, tell))?;
        Ok(Self { lines, counts })
    }

    /// Adds a line, or drops it if too many wait. Never waits.
    fn push(&self, line: &[u8]) {
        self.counts.waiting.fetch_add(1, Ordering::Relaxed);
        if self.lines.try_send(line.to_vec()).is_err() {
            self.counts.waiting.fetch_sub(1, Ordering::Relaxed);
            self.counts.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Waits until all lines are written, at most for `limit`.
    fn flush(&self, limit: Duration) {
        let end = Instant::now() + limit;
        while self.counts.waiting.load(Ordering::Relaxed) > 0 && Instant::now() < end {
            std::thread::sleep(FLUSH_INTERVAL);
        }
    }
}

fn write_lines(lines: &Receiver<Vec<u8>>, counts: &LogCounts, mut log: impl Write, tell: impl Fn(u64)) {
    let mut write = |line: Vec<u8>| {
        // Nobody can be told if the log cannot be written.
        let _ = log.write_all(&line);
        counts.waiting.fetch_sub(1, Ordering::Relaxed);
    };
    while let Ok(line) = lines.recv() {
        write(line);
        lines.try_iter().for_each(&mut write);
        let dropped = counts.dropped.swap(0, Ordering::Relaxed);
        if dropped > 0 {
            tell(dropped);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log that takes nothing until it is released, like a terminal that is paused.
    struct Paused {
        released: Receiver<()>,
        written: mpsc::Sender<Vec<u8>>,
    }

    impl Write for Paused {
        fn write(&mut self, line: &[u8]) -> io::Result<usize> {
            // Ends once the other side is gone.
            let _ = self.released.recv();
            self.written.send(line.to_vec()).expect("the test reads");
            Ok(line.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_log_that_cannot_be_written_holds_up_nobody_and_tells_what_it_dropped() {
        let (release, released) = mpsc::channel();
        let (written, lines) = mpsc::channel();
        let (tell, told) = mpsc::channel();
        let queue = LogQueue::start(Paused { released, written }, move |dropped| tell.send(dropped).expect("the test reads"));
        let queue = queue.expect("a thread");
        // The thread may have taken one line, which it cannot write.
        let total = MAX_WAITING_LINES + 10;
        (0..total).for_each(|number| queue.push(format!("{number}\n").as_bytes()));
        queue.flush(Duration::from_millis(1));
        assert!(lines.try_recv().is_err(), "nothing is written");
        drop(release);
        let dropped = told.recv().expect("told");
        assert!((9..=10).contains(&dropped), "{dropped}");
        queue.flush(Duration::from_secs(10));
        let lines: Vec<Vec<u8>> = lines.try_iter().collect();
        assert_eq!((lines.len() as u64, lines[0].as_slice()), (total as u64 - dropped, b"0\n".as_slice()));
    }

    #[test]
    fn a_word_that_is_no_level_is_refused_with_the_one_that_was_meant() {
        for filter in ["info", "WARN", "info,vantage::http=debug", "warn, hyper=off", "vantage::http", "3", "info,"] {
            assert!(targets(filter).is_ok(), "{filter}");
        }
        let told = targets("info,debgu").expect_err("no level");
        assert!(
            told.starts_with("\"debgu\" is not a level; allowed are off, error") && told.ends_with("did you mean debug?"),
            "{told}"
        );
        assert!(targets("[span]=debug").expect_err("no module").contains("names a span or a field"));
        assert!(targets("everything").is_err());
    }

    /// Each line of the database was a line of the log, and the levels that were set were gone.
    #[test]
    fn a_verbose_server_tells_its_own_details_and_keeps_the_levels_that_are_set() {
        let told = |set: &str, verbosity: u8, module: &str| {
            let filter = targets(&server_filter(set, verbosity)).expect("a filter");
            let levels = [Level::ERROR, Level::WARN, Level::INFO, Level::DEBUG, Level::TRACE];
            levels.into_iter().filter(|level| filter.would_enable(module, level)).count()
        };
        let set = "warn,vantage::http=error";
        assert_eq!([0, 1, 2, 3].map(|verbosity| told(set, verbosity, "vantage::service")), [2, 4, 5, 5]);
        assert_eq!([0, 1, 2, 3].map(|verbosity| told(set, verbosity, "vantage_core::planning")), [2, 4, 5, 5]);
        assert_eq!([0, 1, 2, 3].map(|verbosity| told(set, verbosity, "vantage::http::events")), [1, 1, 1, 5]);
        assert_eq!([0, 1, 2, 3].map(|verbosity| told("info", verbosity, "sqlx::query")), [3, 3, 3, 5]);
        assert_eq!(told("trace", 1, "vantage::service"), 5, "no less than is set");
        assert_eq!([0, 1].map(|verbosity| told(" ", verbosity, "sqlx::query")), [1, 1]);
    }

    /// Each step of a library was a line of the log.
    #[test]
    fn a_verbose_command_tells_its_own_details_before_those_of_libraries() {
        assert_eq!(command_filter(0), None);
        let told = |verbosity: u8, module: &str| {
            let filter = targets(command_filter(verbosity).expect("a log")).expect("a filter");
            [Level::INFO, Level::DEBUG, Level::TRACE].map(|level| filter.would_enable(module, &level))
        };
        for module in ["vantage::cli", "vantage_core::planning"] {
            let wanted = [[true, false, false], [true, true, false], [true; 3], [true; 3]];
            assert_eq!([1, 2, 3, 4].map(|verbosity| told(verbosity, module)), wanted, "{module}");
        }
        let wanted = [[true, false, false], [true, false, false], [true; 3], [true; 3]];
        assert_eq!([1, 2, 3, 4].map(|verbosity| told(verbosity, "sqlx::query")), wanted);
    }

    #[test]
    fn a_filter_gives_each_module_its_level() {
        let filter = targets("warn, vantage::http=debug, hyper=off").expect("a filter");
        let levels = [("vantage::http::events", true), ("vantage::service", false), ("hyper::client", false)];
        for (module, logs_debug) in levels {
            assert_eq!(filter.would_enable(module, &tracing::Level::DEBUG), logs_debug, "{module}");
        }
        assert!(filter.would_enable("vantage::service", &tracing::Level::WARN));
        assert!(!filter.would_enable("hyper::client", &tracing::Level::ERROR));
        let errors = targets(" , ").expect("a filter");
        assert_eq!(
            ["ERROR", "WARN"].map(|level| errors.would_enable("vantage", &level.parse().expect("a level"))),
            [true, false]
        );
    }
}
