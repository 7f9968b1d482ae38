//! `vantage demo`: runs a server in a temporary folder, plans a sample part in it, runs its program on simulated controllers, scans it
//! with a simulated scanner, and inspects the scans.

mod inspection;
mod rehearsal;

use std::net::SocketAddr;
use std::time::Duration;

use bytes::Bytes;

use super::ranges::whole;
use super::serve::{Listening, open, run_to_completion, serve, stopped_by_signal};
use super::{CliError, failed, open_files, output, telemetry};
use crate::geometry::mesh_io::write_stl;
use crate::geometry::{LengthUnit, demo_parts};
use crate::http::{ServeError, Server};
use crate::service::{App, MeshUpload, Submission};
use crate::settings::{Flags, Settings};
use crate::wire::run::{ReportedState, RunStepOp, RunStepRecord};
use crate::wire::{Job, JobId, JobRequest, JobState};

/// Approximate number of triangles of the sample part.
const TRIANGLES: usize = 20_000;

/// Try Vantage: plan, run, scan and inspect a sample part on a temporary server with simulated devices.
#[derive(Debug, clap::Args)]
#[command(after_help = "Prints the address to open in a browser. Ctrl-C stops the server and deletes its temporary folder.

Example:
  vantage demo")]
pub struct DemoArgs {
    /// Port to listen on; if it is in use, Vantage picks a free one.
    #[arg(long, default_value_t = 8080, value_parser = whole::<u16>(0..=65_535))]
    port: u16,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &DemoArgs) -> Result<(), CliError> {
    let folder = tempfile::Builder::new().prefix("vantage-demo-").tempdir().map_err(|e| failed("a temporary folder", &e))?;
    let flags: Flags = vec![
        ("store.data_dir", folder.path().display().to_string()),
        ("server.listen", SocketAddr::from(([127, 0, 0, 1], args.port)).to_string()),
        ("telemetry.log", "warn".to_owned()),
    ];
    let mut settings = Settings::load(None, &flags).map_err(|error| CliError::BadInput(error.to_string()))?;
    let _log = telemetry::start(&settings.telemetry)?;
    let stop = stopped_by_signal(&settings)?;
    open_files::raise_limit(&mut settings);
    run_to_completion(async {
        rehearsal::start_controllers(folder.path(), &mut settings.execution).await?;
        let server = bind(&mut settings).await?;
        let Some(app) = open(&settings, &stop).await? else { return Ok(()) };
        let url = format!("http://{}", server.address());
        output::result(&Listening { url: &url }, format_args!("Open {url} in a browser. Ctrl-C ends the demo.\n"))?;
        tokio::spawn(show(app.clone()));
        serve(server, app, &settings, stop).await
    })
}

/// Listens on the requested port, or on a free one if it is in use.
async fn bind(settings: &mut Settings) -> Result<Server, CliError> {
    match Server::bind(&settings.http()).await {
        Err(ServeError::Bind { source, .. }) if source.kind() == std::io::ErrorKind::AddrInUse => {
            settings.server.listen.set_port(0);
            Server::bind(&settings.http()).await
        }
        bound => bound,
    }
    .map_err(|error| CliError::Failed(error.to_string()))
}

async fn show(app: App) {
    let told = match plan_sample(&app).await {
        Ok(job) if job.state == JobState::Succeeded => show_run(&app, job.id).await,
        Ok(job) => {
            let reason = job.problem.map(|problem| problem.detail).unwrap_or_default();
            output::line(format_args!("The sample part is {}: {reason}", job.state.as_str()))
        }
        Err(error) => Err(CliError::Failed(format!("the sample part: {error}"))),
    };
    // The server goes on, whatever became of its sample.
    if let Err(error) = told {
        output::error(&error);
    }
}

/// Runs the program of the sample on the simulated controllers.
async fn show_run(app: &App, job: JobId) -> Result<(), CliError> {
    output::line(
        "The sample part is planned; the page links to its report. Its program now runs on a simulated robot and turntable, over \
         sockets.",
    )?;
    let run = rehearsal::run(app, job).await.map_err(|error| CliError::Failed(format!("the run of the sample: {error}")))?;
    if run.state != ReportedState::Done {
        return output::line(format_args!("The run is {}: {}", run.state.as_str(), run.detail.unwrap_or_default()));
    }
    let record = app.run_record(run.id).await.map_err(|error| CliError::Failed(format!("its record: {error}")))?;
    let secs = |of: fn(&RunStepRecord) -> f64| record.steps.iter().map(of).sum::<f64>();
    let (planned, actual) = (secs(|step| step.planned_secs), secs(|step| step.actual_secs));
    let scans = || record.steps.iter().filter(|step| step.op == RunStepOp::Scan);
    let worst = |of: fn(&RunStepRecord) -> f64| scans().map(of).fold(0.0, f64::max);
    let (axis_deg, position_mm) = (worst(|step| step.optical_axis_deviation_deg), worst(|step| step.position_deviation_mm));
    let measured = run.coverage.map_or(0.0, |coverage| 100.0 * coverage.measured_of_asked);
    output::line(format_args!(
        "The run is done: {} steps in {actual:.1} s, planned {planned:.1} s; {} scans within {axis_deg:.3}° and {position_mm:.3} \
         mm of their poses; coverage from the measured poses {measured:.1} % of the asked area. Its record is at \
         /api/v1/runs/{}/record, every byte exchanged with the controllers at /api/v1/runs/{}/audit.",
        run.steps, run.scans, run.id, run.id
    ))?;
    inspection::show(app, job, run.id).await.map_err(|error| CliError::Failed(format!("the scans of the sample: {error}")))
}

async fn plan_sample(app: &App) -> Result<Job, Box<dyn std::error::Error + Send + Sync>> {
    let mesh = tokio::task::spawn_blocking(|| demo_parts::base(TRIANGLES)).await??;
    let stl = write_stl(&mesh);
    let mut upload = app.receive(stl.len() as u64).await?;
    upload.write(Bytes::from(stl)).await?;
    let about = MeshUpload { unit: LengthUnit::Millimetre, name: Some("sample base".to_owned()) };
    let mesh = app.add_mesh(upload.finish(None).await?, about).await?;
    let job = app.submit(JobRequest::new(mesh.id), Submission::default()).await?;
    loop {
        let job = app.job_when_ended(job.id, Duration::from_secs(3600)).await?;
        if job.state.is_ended() || app.stopping().is_cancelled() {
            return Ok(job);
        }
    }
}
