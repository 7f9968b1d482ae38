//! `vantage serve`: runs the server until SIGTERM or ctrl-c. After the first signal open requests may finish within
//! `server.drain_timeout_secs`; a second signal ends the process at once.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

use super::signals::on_signals;
use super::{CliError, failed, files, open_files, output, telemetry};
use crate::http::{self, Server};
use crate::service::{App, OperatorCell, THREAD_STACK_BYTES};
use crate::settings::{DEFAULTS, Flags, Settings};

/// Run the server, with its REST API and dashboard.
#[derive(Debug, Default, clap::Args)]
#[command(after_help = "Settings are read from the built-in defaults, then from --config FILE, then from the environment \
(VANTAGE_SERVER__LISTEN for server.listen), then from these flags; later ones override earlier ones. To listen on an \
address that other machines can reach, set a key (server.api_key or server.api_keys_file) or give --insecure.

SIGTERM, SIGHUP or ctrl-c stops the server within server.drain_timeout_secs, with exit code 0; a second signal stops it at once, \
with exit code 130.

Examples:
  vantage serve
  vantage serve --print-defaults > vantage.toml
  vantage serve --data /var/lib/vantage --config /etc/vantage.toml
  VANTAGE_SERVER__API_KEY=$(openssl rand -hex 16) vantage serve \\
      --listen 0.0.0.0:8080")]
pub struct ServeArgs {
    /// Address and port to listen on [default: 127.0.0.1:8080].
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = listen)]
    pub listen: Option<SocketAddr>,
    /// Folder for the server's data; created if it does not exist [default: vantage-data].
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Settings file in TOML, to override the built-in defaults.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Accept requests from other machines without a key.
    #[arg(long)]
    pub insecure: bool,
    /// Print the built-in settings with meanings and ranges, as a file for --config, and exit.
    #[arg(long)]
    pub print_defaults: bool,
}

fn listen(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| "give ADDRESS:PORT, as in 127.0.0.1:8080, or 0.0.0.0:8080 for other machines too".to_owned())
}

/// Address of a server, as `--json` prints it.
#[derive(serde::Serialize)]
pub(super) struct Listening<'a> {
    pub(super) url: &'a str,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &ServeArgs) -> Result<(), CliError> {
    if args.print_defaults {
        let settings: serde_json::Value = toml::from_str(DEFAULTS).map_err(|error| CliError::Failed(error.to_string()))?;
        return output::result(&settings, DEFAULTS);
    }
    let mut settings = settings(args)?;
    let _log = telemetry::start(&settings.telemetry)?;
    let stop = stopped_by_signal(&settings)?;
    open_files::raise_limit(&mut settings);
    run_to_completion(async {
        let server = Server::bind(&settings.http()).await.map_err(|error| CliError::Failed(error.to_string()))?;
        let Some(app) = open(&settings, &stop).await? else { return Ok(()) };
        let url = format!("http://{}", server.address());
        output::result(&Listening { url: &url }, format_args!("Vantage listens on {url}\n"))?;
        serve(server, app, &settings, stop).await
    })
}

fn settings(args: &ServeArgs) -> Result<Settings, CliError> {
    let mut flags = Flags::new();
    flags.extend(args.listen.map(|listen| ("server.listen", listen.to_string())));
    if let Some(data) = &args.data {
        // SQLite takes no other names; with their bytes replaced they would be another folder.
        let name = data.to_str().ok_or_else(|| CliError::BadInput(format!("--data {}: is not UTF-8", data.display())))?;
        flags.push(("store.data_dir", name.to_owned()));
    }
    flags.extend(args.insecure.then(|| ("server.insecure", "true".to_owned())));
    Settings::load(args.config.as_deref(), &flags).map_err(|error| CliError::BadInput(error.to_string()))
}

/// Maximum wait for blocked threads once everything else has ended.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_millis(500);

/// Runs `work` on the threads that answer requests; planning has its own.
pub(super) fn run_to_completion(work: impl Future<Output = Result<(), CliError>>) -> Result<(), CliError> {
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    let runtime = builder.thread_stack_size(THREAD_STACK_BYTES).enable_all().build();
    let runtime = runtime.map_err(|error| failed("the runtime", &error))?;
    let result = runtime.block_on(work);
    // Otherwise a hanging thread would keep the process alive for ever. Nobody has been promised its result yet.
    runtime.shutdown_timeout(SHUTDOWN_TIMEOUT);
    result
}

/// Opens the service; `None` if the server is stopped before it is open.
pub(super) async fn open(settings: &Settings, stop: &CancellationToken) -> Result<Option<App>, CliError> {
    http::install_metrics();
    let data = settings.store.data_dir.display().to_string();
    let mut options = settings.service();
    options.execution.cells = operator_cells(&settings.execution.cells)?;
    // A large database takes minutes.
    tracing::info!(data, "checking the database");
    tokio::select! {
        biased;
        () = stop.cancelled() => Ok(None),
        app = App::open(options) => app.map(Some).map_err(|error| failed(&format!("the store in {data}"), &error)),
    }
}

/// Loads the operator's cells.
fn operator_cells(paths: &[PathBuf]) -> Result<Vec<OperatorCell>, CliError> {
    let mut cells: Vec<OperatorCell> = Vec::with_capacity(paths.len());
    for path in paths {
        let cell = files::operator_cell(&path.display().to_string())?;
        if cells.iter().any(|other| other.name == cell.name) {
            let detail = format!("execution.cells names two files for cell {:?}; each cell has one file", cell.name);
            return Err(CliError::BadInput(detail));
        }
        cells.push(cell);
    }
    Ok(cells)
}

/// Time for an orderly shutdown after the time for open requests; then the process ends without it.
const SHUTDOWN_MARGIN: Duration = Duration::from_secs(1);

/// Token that the first signal cancels. Signals are heard before anything else begins: the first process of a container would lose
/// one that nobody hears.
pub(super) fn stopped_by_signal(settings: &Settings) -> Result<CancellationToken, CliError> {
    let stop = CancellationToken::new();
    let on_first = stop.clone();
    let begin_stop = move |signal| {
        // What moves stops first of all.
        on_first.cancel();
        tracing::info!(signal, "stopping");
    };
    on_signals(begin_stop, Some(drain(settings) + SHUTDOWN_MARGIN))?;
    Ok(stop)
}

/// Time for open requests and running jobs after the first signal.
fn drain(settings: &Settings) -> Duration {
    Duration::from_secs_f64(settings.server.drain_timeout_secs)
}

/// Serves until `stop` is cancelled.
pub(super) async fn serve(server: Server, app: App, settings: &Settings, stop: CancellationToken) -> Result<(), CliError> {
    let drain = drain(settings);
    let router = http::router(app.clone(), settings.http());
    let store = app.clone();
    let stopped = async move {
        stop.cancelled().await;
        let deadline = Instant::now() + drain;
        // Requests are still answered while planning stops.
        if tokio::time::timeout_at(deadline.into(), app.stop()).await.is_err() {
            tracing::warn!("a job did not stop within server.drain_timeout_secs; it is planned again at the next start");
        }
        deadline
    };
    if !server.run(router, stopped).await {
        tracing::warn!("some requests were cut off because they did not finish within server.drain_timeout_secs");
    }
    store.close().await;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_signal_while_the_store_is_opened_ends_the_server() {
        let folder = tempfile::tempdir().expect("a folder");
        let args = ServeArgs { data: Some(folder.path().join("data")), ..ServeArgs::default() };
        let stop = CancellationToken::new();
        stop.cancel();
        let opened = open(&settings(&args).expect("settings"), &stop).await.expect("no fault");
        assert!(opened.is_none());
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_whose_name_is_not_utf_8_is_refused() {
        use std::os::unix::ffi::OsStringExt as _;
        let data = PathBuf::from(std::ffi::OsString::from_vec(b"data-\xff".to_vec()));
        let error = settings(&ServeArgs { data: Some(data), ..ServeArgs::default() }).expect_err("another folder");
        assert!(error.exit_code() == 2 && error.to_string().contains("is not UTF-8"), "{error}");
    }
}
