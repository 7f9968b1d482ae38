//! `vantage serve`: the server, until SIGTERM or ctrl-c. The first signal lets what is open end, within
//! `server.drain_timeout_secs`; the second does not.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

use super::signals::on_signals;
use super::{CliError, failed, open_files, telemetry};
use crate::http::{self, Server};
use crate::service::App;
use crate::settings::{Flags, Settings};

/// Run the server.
#[derive(Debug, Default, clap::Args)]
#[command(
    after_help = "Settings come from the built-in defaults, then --config FILE, then the environment (VANTAGE_SERVER__LISTEN
for server.listen), then these flags. An address that other machines reach needs a key (server.api_key) or --insecure.

SIGTERM and ctrl-c end it within server.drain_timeout_secs, with exit code 0; a second one at once, with 130.

Examples:
  vantage serve
  vantage serve --data /var/lib/vantage --config /etc/vantage.toml
  VANTAGE_SERVER__API_KEY=$(openssl rand -hex 16) vantage serve --listen 0.0.0.0:8080"
)]
pub struct ServeArgs {
    /// Address and port [default: 127.0.0.1:8080].
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub listen: Option<SocketAddr>,
    /// Folder of the database and the files; made if need be [default: vantage-data].
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// File of settings, TOML.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Take requests from other machines without a key.
    #[arg(long)]
    pub insecure: bool,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &ServeArgs) -> Result<(), CliError> {
    let mut settings = settings(args)?;
    telemetry::start(&settings.telemetry)?;
    open_files::fit(&mut settings);
    run_to_the_end(async {
        let server = Server::bind(&settings.http()).await.map_err(|error| CliError::Failed(error.to_string()))?;
        let app = open(&settings).await?;
        println!("Vantage listens on http://{}", server.address());
        serve(server, app, &settings).await
    })
}

fn settings(args: &ServeArgs) -> Result<Settings, CliError> {
    let mut flags = Flags::new();
    flags.extend(args.listen.map(|listen| ("server.listen", listen.to_string())));
    flags.extend(args.data.as_ref().map(|data| ("store.data_dir", data.display().to_string())));
    flags.extend(args.insecure.then(|| ("server.insecure", "true".to_owned())));
    Settings::load(args.config.as_deref(), &flags).map_err(|error| CliError::BadInput(error.to_string()))
}

/// Threads that block are not waited for any longer than this once everything else has ended.
const LAST_WAIT: Duration = Duration::from_millis(500);

/// Runs on the threads that answer; planning has its own.
pub(super) fn run_to_the_end(work: impl Future<Output = Result<(), CliError>>) -> Result<(), CliError> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build();
    let runtime = runtime.map_err(|error| failed("the runtime", &error))?;
    let result = runtime.block_on(work);
    // A thread that hangs would else keep the process for ever. What it does is not promised to anybody yet.
    runtime.shutdown_timeout(LAST_WAIT);
    result
}

/// Opens the service.
pub(super) async fn open(settings: &Settings) -> Result<App, CliError> {
    http::install_metrics();
    let data = settings.store.data_dir.display().to_string();
    App::open(settings.service()).await.map_err(|error| failed(&format!("the store in {data}"), &error))
}

/// What the orderly end may take beyond the time for open requests, before the process ends without it.
const OVERTIME: Duration = Duration::from_secs(1);

/// Serves until a signal comes.
pub(super) async fn serve(server: Server, app: App, settings: &Settings) -> Result<(), CliError> {
    let drain = Duration::from_secs_f64(settings.server.drain_timeout_secs);
    let asked = CancellationToken::new();
    let ask = asked.clone();
    let told = move |signal| {
        tracing::info!(signal, "stopping");
        ask.cancel();
    };
    on_signals(told, Some(drain + OVERTIME))?;
    let router = http::router(app.clone(), settings.http());
    let store = app.clone();
    let stopped = async move {
        asked.cancelled().await;
        let deadline = Instant::now() + drain;
        // Questions are still answered while planning comes to its halt.
        if tokio::time::timeout_at(deadline.into(), app.stop()).await.is_err() {
            tracing::warn!("a job did not halt within server.drain_timeout_secs; it starts again with the next process");
        }
        deadline
    };
    if !server.run(router, stopped).await {
        tracing::warn!("some requests were cut off: they did not end within server.drain_timeout_secs");
    }
    store.close().await;
    Ok(())
}
