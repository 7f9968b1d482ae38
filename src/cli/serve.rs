//! `vantage serve`: the server, until SIGTERM or ctrl-c. The first signal lets what is open end, the second does not.

use std::net::SocketAddr;
use std::path::PathBuf;

use super::signals::Signals;
use super::{CliError, EXIT_INTERRUPTED, failed, telemetry};
use crate::http::{self, Server};
use crate::service::App;
use crate::settings::{Flags, Settings};

/// Run the server.
#[derive(Debug, Default, clap::Args)]
#[command(
    after_help = "Settings come from the built-in defaults, then --config FILE, then the environment (VANTAGE_SERVER__LISTEN
for server.listen), then these flags. An address that other machines reach needs a key (server.api_key) or --insecure.

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
    let settings = settings(args)?;
    telemetry::start(&settings.telemetry)?;
    runtime()?.block_on(async {
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

/// The runtime that answers; planning has its own threads.
pub(super) fn runtime() -> Result<tokio::runtime::Runtime, CliError> {
    tokio::runtime::Builder::new_multi_thread().enable_all().build().map_err(|error| failed("the runtime", &error))
}

/// Opens the service.
pub(super) async fn open(settings: &Settings) -> Result<App, CliError> {
    http::install_metrics();
    let data = settings.store.data_dir.display().to_string();
    App::open(settings.service()).await.map_err(|error| failed(&format!("the store in {data}"), &error))
}

/// Serves until a signal comes.
pub(super) async fn serve(server: Server, app: App, settings: &Settings) -> Result<(), CliError> {
    let mut signals = Signals::listen()?;
    let router = http::router(app.clone(), settings.http());
    let stopped = async move {
        let signal = signals.next().await;
        tracing::info!(signal, "stopping");
        tokio::spawn(async move {
            signals.next().await;
            tracing::warn!("stopping at once");
            std::process::exit(EXIT_INTERRUPTED);
        });
        // Questions are still answered while planning comes to its halt.
        app.stop().await;
    };
    if !server.run(router, stopped).await {
        tracing::warn!("some requests were cut off: they did not end within server.drain_timeout_secs");
    }
    Ok(())
}
