//! The run of the demo: simulated controllers on sockets of this machine, and a live run of the sample's program on them.

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::cell::{Presets, SpecKind, SpecLibrary, preset_text};
use crate::cli::{CliError, failed};
use crate::execution::protocol::modbus::ModbusFraming;
use crate::execution::simulators::hans::HansSimulator;
use crate::execution::simulators::minas_a6::{DriveSetup, MinasA6Simulator};
use crate::service::{App, Error};
use crate::settings::ExecutionSettings;
use crate::wire::JobId;
use crate::wire::run::{ArmRequest, LeaseRequest, Run, RunMode, RunRequest};

/// Cell of the demo.
const CELL: &str = "e05-transcan";
/// Name that leases and runs have for who armed them.
const OPERATOR: &str = "vantage demo";
/// Longest wait for the program's check and the controllers' answer.
const PREPARING: Duration = Duration::from_secs(60);
/// Time within which a simulated controller answers, ms: longer than a real one takes, so that other work on this machine does not end the
/// run.
const REPLY_MS: u32 = 400;
/// Address on which simulated controllers listen, on free ports.
const ADDRESS: &str = "127.0.0.1:0";

/// Starts an arm and a table, writes the cell file that names them, and lets runs move them: nothing else is in that file.
pub(super) async fn start_controllers(folder: &Path, execution: &mut ExecutionSettings) -> Result<(), CliError> {
    let unusable = |found: String| CliError::Failed(format!("cell {CELL}: {found}"));
    let spec = Presets.cell(CELL).map_err(|error| unusable(error.to_string()))?;
    let cell = spec.build(&Presets).map_err(|found| unusable(format!("{found:?}")))?;
    let listening = |error: std::io::Error| failed("a simulated controller", &error);
    let arm = HansSimulator::listen(ADDRESS, cell.robot, cell.home_rad.joints_rad, 1.0).await.map_err(listening)?;
    let arm_address = arm.addresses().map_err(listening)?.text;
    let setup = DriveSetup::default();
    let (listener, table_address) = MinasA6Simulator::listen(ADDRESS).await.map_err(listening)?;
    let text = format!(
        "{}\n[controllers]\nfirst_run_speed = 1.0\nwatchdog_ms = 500\nstate_max_age_ms = {REPLY_MS}\n\
         [controllers.arm]\nprotocol = \"hans\"\naddress = \"{arm_address}\"\nreply_timeout_ms = {REPLY_MS}\n\
         [controllers.table]\nprotocol = \"minas_a6\"\naddress = \"tcp://{table_address}\"\nreply_timeout_ms = {REPLY_MS}\n\
         units_per_turn = {}\ngear_ratio = {}\n",
        preset_text(SpecKind::Cell, CELL).unwrap_or_default(),
        setup.units_per_turn,
        setup.gear_ratio,
    );
    let file: PathBuf = folder.join("rehearsal.toml");
    std::fs::write(&file, text).map_err(|error| failed("the cell file of the demo", &error))?;
    (execution.live, execution.cells) = (true, vec![file]);
    tokio::spawn(arm.serve());
    tokio::spawn(MinasA6Simulator::new(&setup).serve(listener, ModbusFraming::Rtu));
    Ok(())
}

/// Runs the program of a job on the controllers, to its end.
pub(super) async fn run(app: &App, job: JobId) -> Result<Run, Error> {
    let lease = app.take_lease(LeaseRequest { cell: CELL.to_owned(), holder: OPERATOR.to_owned() }).await?;
    let request = RunRequest { mode: RunMode::Live, ..RunRequest::new(job) };
    let carried_out = async {
        let run = app.start_run(request, Some(lease.token), None).await?;
        let run = app.run_when_prepared(run.id, PREPARING).await?;
        if run.state.is_ended() {
            return Ok(run);
        }
        let arm = ArmRequest { operator: OPERATOR.to_owned(), cell: CELL.to_owned() };
        app.arm_run(run.id, arm, Some(lease.token)).await?;
        app.run_when_ended(run.id, Duration::from_secs(3600)).await
    };
    let renewed = async {
        loop {
            tokio::time::sleep(Duration::from_millis(lease.heartbeat_ms)).await;
            if let Err(error) = app.renew_lease(lease.id) {
                return error;
            }
        }
    };
    tokio::select! {
        run = carried_out => run,
        error = renewed => Err(error),
    }
}
