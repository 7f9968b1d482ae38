//! A dry run: the devices are connected to and read, and what stands against motion is said. It is written for a machine that can
//! only be watched, so that nothing here can move one.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;

use super::cause::StopCause;
use super::gate::{self, RunJob, unfit};
use super::handle::{Control, Halt};
use super::live::Live;
use super::machine::Watch;
use super::runner::{connect, stop_now, unless_panicking};
use super::state::{RunEvent, RunState};
use super::watcher::Watcher;
use super::way;
use super::{Mode, RunOptions};
use crate::execution::record::RunRecord;

/// Time that a dry run reads.
const READING: Duration = Duration::from_secs(1);

/// Reads the devices for a while and says what would stand against motion.
pub(super) async fn read<M: Watch>(job: RunJob, machine: M, control: Control, live: Arc<Live>, options: RunOptions) {
    let (cell, safeguards) = (Arc::clone(&job.cell), options.safeguards.clone());
    let mut watcher = Watcher::new(machine, control, live, cell, safeguards, options.audit.clone(), 1.0);
    let mut identities = None;
    let mut objections = gate::to_run(&job, options.from_step, options.speed_override);
    let work = async {
        identities = Some(connect(&mut watcher, options.safeguards.connect_timeout).await?);
        let began = Instant::now();
        loop {
            let state = watcher.read().await?;
            if began.elapsed() >= READING {
                return Ok(state);
            }
            watcher.rest(watcher.poll).await?;
        }
    };
    let ended = unless_panicking(work).await.unwrap_or_else(|()| Err(Halt::Stop(stop_now("a panic"))));
    let (event, mut found) = match ended {
        Ok(state) => {
            let here = state.configuration();
            let (_, nearest) = way::nearest(&way::points(&job.program, options.from_step), &here);
            objections.extend(gate::to_start(&here, &nearest, &options.safeguards));
            // Judged as before it is armed, which switches the power on.
            let unfit = unfit(&state, RunState::Ready, state.arm.at.max(state.table.at), options.safeguards.state_max_age);
            (RunEvent::Read, unfit.into_iter().collect())
        }
        Err(Halt::Stop(request)) => (RunEvent::Stopped(request.cause), Vec::new()),
        Err(Halt::Pause(_)) => (RunEvent::Stopped(StopCause::Client), Vec::new()),
    };
    if !objections.is_empty() {
        found.push(StopCause::Objections(objections));
    }
    let status = watcher.live.status();
    let record = RunRecord {
        mode: Mode::DryRun,
        identities,
        next_step: options.from_step,
        speed_override: options.speed_override,
        objections: found,
        last_measured: watcher.last.map(|state| state.configuration()),
        ..RunRecord::lost(status.after(event.clone()).unwrap_or(status))
    };
    watcher.happen(event);
    watcher.control.end(record);
}
