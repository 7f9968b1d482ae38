use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::{Instant, sleep};

use super::{
    Authority, CommandError, DeviceRole, Drive, Fence, Hashes, Lease, LeaseError, Leases, LiveEvent, MachineError, Mode,
    Objection, ObservedPair, Pair, PauseCause, RunHandle, RunOptions, RunReason, RunState, Safeguards, StopCause, Watch, dry_run,
    live, simulate, simulate_with,
};
use crate::cell::{AbbEgmSpec, Configuration};
use crate::execution::audit::tests::log_on_full_disk;
use crate::execution::device::{
    Capture, Captured, DeviceError, DeviceState, Direction, Identity, MotionDevice, STOP_ATTEMPT, Target, Trigger, WITHDRAWAL,
    WireLog,
};
use crate::execution::drivers::egm::{AbbArm, AbbEgm};
use crate::execution::drivers::stream::within;
use crate::execution::protocol::egm::ExternalAxes;
use crate::execution::record::{RunRecord, StepKind};
use crate::execution::simulators::egm::EgmController;
use crate::execution::tests::fault_table::{FAULTS, FaultyCell, fault_in_each_state};
use crate::execution::tests::rehearsal::{CELL, Chance, Twins, attend, hashes, job, job_of, planned, short_job, twins, until};
use crate::execution::twin::{Planted, Twin, TwinAccess, TwinTrigger};
use crate::program::Step;

/// A live run on twins, armed.
async fn armed(options: RunOptions) -> (RunHandle, Twins, Leases, Lease) {
    let (machine, trigger, access) = twins();
    let leases = Leases::after(Fence(7));
    let lease = leases.acquire(CELL, "operator", Duration::from_secs(2)).expect("free");
    let authority = Authority { leases: leases.clone(), cell: CELL.into() };
    let handle = live(job(), machine, trigger, authority, options);
    assert_eq!(until(&handle, RunState::Ready).await, RunState::Ready);
    handle.arm(lease.token).await.expect("may");
    (handle, access, leases, lease)
}

/// A live run on twins, whose client renews its lease, 0.7 s after it began to move.
async fn under_way() -> (RunHandle, Twins, Lease) {
    let (handle, access, leases, lease) = armed(RunOptions::default()).await;
    attend(&handle, &leases, lease.token);
    until(&handle, RunState::Running).await;
    sleep(Duration::from_millis(700)).await;
    (handle, access, lease)
}

fn cause(record: &RunRecord) -> &StopCause {
    let RunReason::Ended(cause) = &record.status.reason else { panic!("no stop: {:?}", record.status) };
    cause
}

fn assert_all_steps(record: &RunRecord) {
    assert_eq!(record.status.state, RunState::Done, "{}", record.status.reason);
    let steps: Vec<usize> = record.steps.iter().map(|step| step.step).collect();
    assert_eq!(steps, (0..planned().program.steps.len()).collect::<Vec<_>>());
    let most = record.max_deviation();
    assert!(most.optical_axis_deg < 1.0 && most.max_axis_deg <= 0.1, "{most:?}");
}

#[tokio::test(start_paused = true)]
async fn a_whole_part_runs_through_the_twin_in_the_planned_time() {
    let record = simulate(job(), RunOptions::default()).ended().await;
    assert_all_steps(&record);
    assert_eq!(record.scans().count(), 3);
    assert!(record.max_deviation().position_mm < 1e-6);
    let (planned, real) = (planned().program.cycle_secs, record.real_secs);
    assert!((record.planned_secs - planned).abs() < 1e-9);
    assert!((real / planned - 1.0).abs() < 0.05, "planned {planned} s, took {real} s");
    assert_eq!(record.stop, None);
    assert_eq!(record.mode, Mode::Simulate);
}

#[tokio::test]
async fn the_twins_time_can_run_quicker() {
    let began = std::time::Instant::now();
    let record = simulate(job(), RunOptions { time_factor: 20.0, ..RunOptions::default() }).ended().await;
    assert_all_steps(&record);
    let planned = planned().program.cycle_secs;
    let wall_secs = began.elapsed().as_secs_f64();
    assert!(wall_secs < 0.5 * planned);
    // Only the motion is scaled: the host's own work, and what a busy machine notices late, counts once.
    let real_secs = record.real_secs;
    assert!(
        real_secs > 0.98 * planned && real_secs < planned + wall_secs,
        "planned {planned} s, took {real_secs} s in {wall_secs} s"
    );
}

/// A server that planned beside it stopped simulated runs: "no state of the arm for 119 ms; check its network".
#[tokio::test]
async fn a_state_that_is_late_does_not_stop_the_twin() {
    let safeguards = Safeguards { state_max_age: Duration::ZERO, ..Safeguards::default() };
    let record = simulate(job(), RunOptions { time_factor: 100.0, safeguards, ..RunOptions::default() }).ended().await;
    assert_all_steps(&record);
}

#[tokio::test(start_paused = true)]
async fn events_rise_by_one_replay_and_tell_where_it_is() {
    let handle = simulate(job(), RunOptions::default());
    handle.ended().await;
    let (events, _) = handle.events_after(0);
    assert!(events.windows(2).all(|pair| pair[1].id == pair[0].id + 1));
    let (late, _) = handle.events_after(events[events.len() - 3].id);
    assert_eq!(late[..], events[events.len() - 2..]);
    let last = handle.latest().expect("told");
    assert_eq!((last.status.state, last.step), (RunState::Done, Some(planned().program.steps.len() - 1)));
    let rate = events.len() as f64 / last.secs;
    assert!((10.0..50.0).contains(&rate) || events.len() == 1200, "{rate} Hz");
}

#[tokio::test(start_paused = true)]
async fn pausing_rests_on_the_way_and_resuming_goes_on_from_there() {
    let (handle, access, lease) = under_way().await;
    assert!(access.arm.is_moving());
    handle.pause().await.expect("runs");
    until(&handle, RunState::Paused).await;
    assert_eq!(handle.status().reason, RunReason::Paused(PauseCause::Client));
    let (arm, table) = (access.arm.positions_rad(), access.table.positions_rad());
    sleep(Duration::from_secs(20)).await;
    assert_eq!((access.arm.positions_rad(), access.table.positions_rad()), (arm, table));
    assert_eq!(handle.pause().await, Err(CommandError::NotNow { state: RunState::Paused, command: "pause" }));
    let no_token = LeaseError::NoToken { cell: CELL.into() };
    assert_eq!(handle.resume(None).await, Err(CommandError::Lease(no_token)), "moving needs a token");
    handle.resume(Some(lease.token)).await.expect("paused");
    let record = handle.ended().await;
    assert_all_steps(&record);
    assert_eq!(record.steps[0].attempts, 2);
    // The pause is no part of the step's time.
    assert!(record.steps[0].real_secs < record.steps[0].planned_secs + 2.0);
    assert_eq!((access.arm.asked().targets_unarmed, access.table.asked().targets_unarmed), (0, 0));
}

/// Real time passes: the driver streams from a thread of its own.
#[tokio::test]
async fn an_arm_that_is_streamed_to_is_paused_on_the_way_and_goes_on() {
    // Longer than a busy machine takes, and fed four times in it.
    const WATCHDOG: Duration = Duration::from_secs(1);
    let home = planned().program.home_rad;
    let free = tokio::net::UdpSocket::bind("127.0.0.1:0").await.expect("a port");
    let client = free.local_addr().expect("an address");
    drop(free);
    let controller = EgmController {
        client,
        cycle: Duration::from_millis(12),
        comm_timeout: Duration::from_secs(5),
        joints_deg: home.joints_rad.map(f64::to_degrees),
        external: ExternalAxes::default(),
    };
    tokio::spawn(async move { controller.run(|_| {}).await });
    let spec = AbbEgmSpec { address: client.to_string(), controller_host: None, cycle_ms: 12, table_axis: 1 };
    let arm: AbbArm<6> = AbbEgm::arm(&spec, Arc::new(()));
    let machine = Pair { arm, table: Twin::at([home.table_rad], 1.0) };
    let safeguards = Safeguards { watchdog: WATCHDOG, state_max_age: WATCHDOG, ..Safeguards::default() };
    let options = RunOptions { safeguards, ..RunOptions::default() };
    let handle = simulate_with(short_job(0.3, [hashes(), hashes()]), machine, TwinTrigger::new(1.0), options);
    let (_, mut events) = handle.events_after(0);
    while events.recv().await.expect("told").off_path_rad.is_none() {
        assert!(!handle.status().state.is_final(), "{}", handle.status().reason);
    }
    handle.pause().await.expect("runs");
    assert_eq!(until(&handle, RunState::Paused).await, RunState::Paused, "{}", handle.status().reason);
    let paused = Instant::now();
    while paused.elapsed() < WATCHDOG / 2 {
        events.recv().await.expect("told");
        assert_eq!(handle.status().state, RunState::Paused, "{}", handle.status().reason);
    }
    handle.resume(None).await.expect("paused");
    let record = handle.ended().await;
    assert_eq!(record.status.state, RunState::Done, "{}", record.status.reason);
    assert!(record.steps.iter().any(|step| step.attempts == 2), "{:?}", record.steps);
}

/// A device that takes its time to arm and to start, and is asked all the while, as drivers do that wait for an outcome.
struct Slow<D> {
    device: D,
    arming: Duration,
    starting: Duration,
}

impl<const N: usize, D: MotionDevice<N>> MotionDevice<N> for Slow<D> {
    async fn connect(&mut self) -> Result<Identity, DeviceError> {
        self.device.connect().await
    }

    async fn state(&mut self) -> Result<DeviceState<N>, DeviceError> {
        self.device.state().await
    }

    async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        ask_for(&mut self.device, self.arming).await?;
        self.device.arm(watchdog).await
    }

    async fn start(&mut self, target: &Target<N>) -> Result<(), DeviceError> {
        ask_for(&mut self.device, self.starting).await?;
        self.device.start(target).await
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        self.device.keep_alive().await
    }

    async fn stop(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        self.device.stop(sent_at).await
    }

    async fn release(&mut self) -> Result<(), DeviceError> {
        self.device.release().await
    }
}

async fn ask_for<const N: usize>(device: &mut impl MotionDevice<N>, time: Duration) -> Result<(), DeviceError> {
    let began = Instant::now();
    while began.elapsed() < time {
        device.keep_alive().await?;
        sleep(Duration::from_millis(20)).await;
    }
    Ok(())
}

/// Runs of twins, the arm and then the table of which is slow.
async fn run_with_slow(arming: Duration, starting: Duration) {
    for slow in [DeviceRole::Arm, DeviceRole::Table] {
        let (Pair { arm, table }, trigger, access) = twins();
        let times = |device| if device == slow { (arming, starting) } else { (Duration::ZERO, Duration::ZERO) };
        let ((arm_arming, arm_starting), (table_arming, table_starting)) = (times(DeviceRole::Arm), times(DeviceRole::Table));
        let arm = Slow { device: arm, arming: arm_arming, starting: arm_starting };
        let table = Slow { device: table, arming: table_arming, starting: table_starting };
        let job = short_job(0.1, [hashes(), hashes()]);
        let record = simulate_with(job, Pair { arm, table }, trigger, RunOptions::default()).ended().await;
        assert_eq!(record.status.state, RunState::Done, "slow {slow}: {}", record.status.reason);
        assert_eq!((access.arm.asked().targets_unarmed, access.table.asked().targets_unarmed), (0, 0));
    }
}

#[tokio::test(start_paused = true)]
async fn a_device_stays_armed_while_its_partner_enables_its_drives() {
    run_with_slow(Duration::from_secs(10), Duration::ZERO).await;
}

#[tokio::test(start_paused = true)]
async fn a_device_stays_armed_while_its_partner_takes_its_target() {
    run_with_slow(Duration::ZERO, Duration::from_millis(300)).await;
}

/// Drives may take seconds to enable: until then the run rests, and would go on without a further word.
#[tokio::test(start_paused = true)]
async fn a_pause_that_is_asked_for_while_a_run_is_about_to_go_on_is_kept() {
    const ARMING: Duration = Duration::from_secs(3);
    let (Pair { arm, table }, trigger, access) = twins();
    let machine = Pair { arm: Slow { device: arm, arming: ARMING, starting: Duration::ZERO }, table };
    let handle = simulate_with(short_job(0.1, [hashes(), hashes()]), machine, trigger, RunOptions::default());
    until(&handle, RunState::Running).await;
    sleep(Duration::from_millis(200)).await;
    handle.pause().await.expect("runs");
    until(&handle, RunState::Paused).await;
    let (here, targets) = (access.arm.positions_rad(), access.arm.asked().targets);
    handle.resume(None).await.expect("paused");
    sleep(ARMING / 3).await;
    assert_eq!(handle.status().state, RunState::Paused, "it takes the right to move");
    handle.pause().await.expect("it is about to go on");
    sleep(10 * ARMING).await;
    assert_eq!(handle.status().state, RunState::Paused, "{}", handle.status().reason);
    assert_eq!((access.arm.positions_rad(), access.arm.asked().targets), (here, targets));
    // The last word counts.
    handle.resume(None).await.expect("paused");
    sleep(ARMING / 3).await;
    handle.pause().await.expect("it is about to go on");
    handle.resume(None).await.expect("paused");
    let record = handle.ended().await;
    assert_eq!(record.status.state, RunState::Done, "{}", record.status.reason);
    assert_eq!(record.steps[0].attempts, 2);
}

#[tokio::test(start_paused = true)]
async fn a_device_is_fed_while_its_partner_takes_its_time_to_stop_and_to_be_read() {
    const LATE: Duration = Duration::from_millis(400);
    let watchdog = Safeguards::default().watchdog;
    let (mut machine, _, access) = twins();
    Drive::arm(&mut machine, watchdog, STOP_ATTEMPT).await.expect("armed");
    access.arm.plant(Some(Planted::Late(LATE)));
    let enough = LATE.as_millis() as u64 / (watchdog.as_millis() as u64 / 4);
    let fed_before = access.table.asked().keep_alives;
    let stopped = machine.stop([true; 2], STOP_ATTEMPT).await;
    assert!(matches!((&stopped.arm, &stopped.table), (Some(Ok(_)), Some(Ok(_)))), "{stopped:?}");
    let fed = access.table.asked().keep_alives;
    assert!(fed - fed_before >= enough, "fed {} times while the arm stopped", fed - fed_before);
    let read = machine.states_fed(STOP_ATTEMPT).await;
    assert!(read.arm.is_ok() && read.table.is_ok(), "{read:?}");
    let fed_on = access.table.asked().keep_alives;
    assert!(fed_on - fed >= enough, "fed {} times while the arm was read", fed_on - fed);
}

#[tokio::test(start_paused = true)]
async fn a_request_that_is_not_answered_names_the_device_that_is_silent() {
    const WITHIN: Duration = Duration::from_millis(100);
    let watchdog = Safeguards::default().watchdog;
    let numbers = [0.1; 7];
    let target = Target {
        sequence: 1,
        positions_rad: numbers,
        max_speed_rad_s: numbers,
        max_acceleration_rad_s2: numbers,
        duration: Duration::from_secs(1),
    };
    let (mut machine, _, access) = twins();
    access.table.plant(Some(Planted::Silent));
    let silent: Result<(), MachineError> =
        Err(MachineError { device: DeviceRole::Table, error: DeviceError::Silent { waited: WITHIN } });
    assert_eq!(Watch::connect(&mut machine, WITHIN).await.map(|_| ()), silent);
    assert_eq!(Drive::arm(&mut machine, watchdog, WITHIN).await, silent);
    assert_eq!(Drive::start(&mut machine, &target, WITHIN).await, silent);
    assert_eq!(Drive::keep_alive(&mut machine, WITHIN).await, silent);
}

/// A driver that waits 60 ms for a reply.
struct Impatient(Twin<6>);

impl MotionDevice<6> for Impatient {
    async fn connect(&mut self) -> Result<Identity, DeviceError> {
        self.0.connect().await
    }

    async fn state(&mut self) -> Result<DeviceState<6>, DeviceError> {
        within(Duration::from_millis(60), self.0.state()).await
    }

    async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        self.0.arm(watchdog).await
    }

    async fn start(&mut self, target: &Target<6>) -> Result<(), DeviceError> {
        self.0.start(target).await
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        self.0.keep_alive().await
    }

    async fn stop(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        self.0.stop(sent_at).await
    }

    async fn release(&mut self) -> Result<(), DeviceError> {
        self.0.release().await
    }
}

/// "No state for 60 ms" was told where 100 ms were permitted, and nothing of the wait for a reply that decided.
#[tokio::test(start_paused = true)]
async fn a_reply_timeout_below_the_age_that_a_state_may_have_is_named_where_it_ends_a_run() {
    let (Pair { arm, table }, trigger, access) = twins();
    let machine = Pair { arm: Impatient(arm), table };
    let handle = simulate_with(short_job(0.1, [hashes(), hashes()]), machine, trigger, RunOptions::default());
    until(&handle, RunState::Running).await;
    sleep(Duration::from_millis(300)).await;
    access.arm.plant(Some(Planted::Silent));
    let record = handle.ended().await;
    assert!(matches!(cause(&record), StopCause::Stale { by_reply_timeout: true, .. }), "{:?}", record.status);
    let told = record.status.reason.to_string();
    assert!(told.contains("reply_timeout_ms = 60 ms") && record.status.reason.code() == "state_stale", "{told}");
}

#[tokio::test(start_paused = true)]
async fn a_device_that_is_slow_to_feed_does_not_lengthen_a_stop() {
    let (mut machine, _, access) = twins();
    Drive::arm(&mut machine, Safeguards::default().watchdog, STOP_ATTEMPT).await.expect("armed");
    access.arm.plant(Some(Planted::Late(Duration::from_millis(300))));
    access.table.plant(Some(Planted::Silent));
    let asked = Instant::now();
    let stopped = machine.stop([true; 2], STOP_ATTEMPT).await;
    assert!(matches!((&stopped.arm, &stopped.table), (Some(Ok(_)), Some(Err(_)))), "{stopped:?}");
    assert!(asked.elapsed() <= STOP_ATTEMPT + Duration::from_millis(10), "{:?}", asked.elapsed());
}

#[tokio::test(start_paused = true)]
async fn an_arm_that_moves_during_a_capture_stops_the_run() {
    let steps = &planned().program.steps;
    let scan = steps.iter().position(|step| matches!(step, Step::Scan { .. })).expect("a scan");
    // Less than what a run may begin beside its program; and less than what counts as a motion.
    for (off_deg, is_stopped) in [(0.4_f64, true), (0.08, false)] {
        let (handle, access, leases, lease) = armed(RunOptions::default()).await;
        attend(&handle, &leases, lease.token);
        while handle.latest().and_then(|event| event.step) != Some(scan) {
            sleep(Duration::from_millis(5)).await;
        }
        sleep(Duration::from_millis(60)).await;
        access.arm.mismeasure([0.0, off_deg.to_radians(), 0.0, 0.0, 0.0, 0.0]);
        let record = handle.ended().await;
        let is_recorded = record.steps.iter().any(|step| step.step == scan);
        assert_eq!(is_recorded, !is_stopped, "{:?}", record.status);
        if is_stopped {
            assert!(matches!(cause(&record), StopCause::OffPath { axis: 2, .. }), "{:?}", record.status);
        }
    }
}

#[tokio::test(start_paused = true)]
async fn the_override_that_is_told_is_the_one_in_force() {
    let options = RunOptions { is_first_live: true, ..RunOptions::default() };
    let cap = options.safeguards.first_run_speed;
    let (handle, _access, leases, lease) = armed(options).await;
    attend(&handle, &leases, lease.token);
    until(&handle, RunState::Running).await;
    for (asked, in_force) in [(1.0, cap), (cap / 2.0, cap / 2.0)] {
        handle.set_override(Some(lease.token), asked).await.expect("runs");
        assert_eq!((handle.speed_override(), handle.latest().expect("told").speed_override), (in_force, in_force));
    }
}

#[tokio::test(start_paused = true)]
async fn single_steps_wait_for_each_other() {
    let (handle, _access, leases, lease) = armed(RunOptions { single_step: true, ..RunOptions::default() }).await;
    attend(&handle, &leases, lease.token);
    until(&handle, RunState::Armed).await;
    sleep(Duration::from_secs(3)).await;
    assert_eq!(handle.status().reason, RunReason::AwaitsStart);
    for taken in 1..=2 {
        handle.step(Some(lease.token)).await.expect("waits");
        until(&handle, RunState::Running).await;
        until(&handle, RunState::Paused).await;
        assert_eq!(handle.status().reason, RunReason::Paused(PauseCause::SingleStep));
        // A new run from the step that is told repeats none; it is told as soon as the one before it is done.
        let told = handle.latest().and_then(|event| event.step);
        assert_eq!((told, handle.steps_from(0).len()), (Some(taken), taken));
        let is_early = |event: &LiveEvent| (event.status.state, event.step) == (RunState::Running, Some(taken));
        assert!(handle.events_after(0).0.iter().any(is_early), "before it rests for the pause");
    }
    handle.resume(Some(lease.token)).await.expect("paused");
    let record = handle.ended().await;
    assert_all_steps(&record);
}

#[tokio::test(start_paused = true)]
async fn an_armed_run_that_nobody_moves_expires() {
    let (handle, access, leases, lease) = armed(RunOptions { single_step: true, ..RunOptions::default() }).await;
    attend(&handle, &leases, lease.token);
    let record = handle.ended().await;
    assert_eq!((record.status.state, cause(&record)), (RunState::Stopped, &StopCause::ArmExpired));
    assert_eq!(access.arm.asked().targets, 0);
}

#[tokio::test(start_paused = true)]
async fn an_override_scales_what_follows_and_the_first_live_run_is_capped() {
    let secs = async |value: f64, is_first_live: bool| {
        let (handle, _access, leases, lease) = armed(RunOptions { is_first_live, ..RunOptions::default() }).await;
        attend(&handle, &leases, lease.token);
        handle.set_override(Some(lease.token), value).await.expect("in range");
        let record = handle.ended().await;
        assert_all_steps(&record);
        (
            record.steps.iter().filter(|step| step.kind == StepKind::Move).map(|step| step.real_secs).sum::<f64>(),
            record.speed_override,
        )
    };
    let (whole, _) = secs(1.0, false).await;
    let (half, _) = secs(0.5, false).await;
    let (capped, in_force) = secs(1.0, true).await;
    assert!(half > 1.4 * whole && half < 2.1 * whole, "{whole} s and {half} s");
    assert!(capped > 2.0 * whole && in_force == 0.25, "{whole} s and {capped} s");
    let (handle, _access, _leases, lease) = armed(RunOptions::default()).await;
    assert_eq!(handle.set_override(Some(lease.token), 1.5).await, Err(CommandError::Override(1.5)));
}

#[tokio::test(start_paused = true)]
async fn a_stop_is_sent_acknowledged_and_verified_and_nothing_moves_after_it() {
    let (handle, access, lease) = under_way().await;
    handle.stop(StopCause::Client);
    handle.stop(StopCause::ServerGone);
    let record = handle.ended().await;
    assert_eq!((record.status.state, cause(&record)), (RunState::Stopped, &StopCause::Client), "the first cause counts");
    let report = record.stop.as_ref().expect("stopped");
    for stop in [report.arm.as_ref().expect("armed"), report.table.as_ref().expect("armed")] {
        let [sent, acknowledged, at_rest] = [stop.sent, stop.acknowledged, stop.at_rest].map(|time| time.expect("told"));
        assert!(sent <= acknowledged && acknowledged < at_rest, "{stop:?}");
        assert!(sent < Duration::from_millis(10) && at_rest < Duration::from_secs(2), "{stop:?}");
    }
    let asked = access.arm.asked();
    let here = access.arm.positions_rad();
    sleep(Duration::from_secs(5)).await;
    assert_eq!((access.arm.positions_rad(), access.arm.asked().targets), (here, asked.targets));
    assert_eq!(handle.resume(Some(lease.token)).await, Err(CommandError::NotNow { state: RunState::Stopped, command: "resume" }));
}

/// The run was told as under way for the seconds in which its end was awaited, and a stop pressed then as not heard.
#[tokio::test(start_paused = true)]
async fn a_stop_that_was_sent_is_told_while_the_rest_of_a_table_that_answers_nothing_is_awaited() {
    let (handle, access, _) = under_way().await;
    access.table.plant(Some(Planted::Silent));
    handle.stop(StopCause::Client);
    let stopping = RunReason::Stopping(Some(StopCause::Client));
    let mut status = handle.watch_status();
    let told = status.wait_for(|status| status.reason != RunReason::UnderWay).await.expect("told").clone();
    assert_eq!((told.state, &told.reason), (RunState::Running, &stopping));
    assert!(told.reason.to_string().contains("keep clear"), "{}", told.reason);
    sleep(Duration::from_secs(5)).await;
    assert_eq!(handle.status().reason, stopping, "the table is not known to be at rest");
    let [arm, table] = handle.latest().and_then(|event| event.stop).expect("what is known of it");
    assert!(arm.acknowledged.is_some() && arm.at_rest.is_some(), "{arm:?}");
    assert!(table.acknowledged.is_none() && table.error.is_some(), "{table:?}");
    assert!(table.sent.is_some_and(|sent| sent < STOP_ATTEMPT), "the first request went out: {table:?}");
    let record = handle.ended().await;
    assert_eq!((record.status.state, cause(&record)), (RunState::Stopped, &StopCause::Client));
}

/// A command was refused once the run had ended, seconds later.
#[tokio::test(start_paused = true)]
async fn a_command_to_a_run_that_is_being_stopped_is_refused_at_once_with_the_cause_of_the_stop() {
    let (handle, access, lease) = under_way().await;
    access.table.plant(Some(Planted::Silent));
    handle.stop(StopCause::Client);
    let stopping = RunReason::Stopping(Some(StopCause::Client));
    let mut status = handle.watch_status();
    status.wait_for(|status| status.reason == stopping).await.expect("told");
    let (asked, token) = (Instant::now(), Some(lease.token));
    let told = [
        (handle.pause().await, "pause"),
        (handle.resume(token).await, "resume"),
        (handle.step(token).await, "step"),
        (handle.set_override(token, 0.5).await, "change its speed"),
    ];
    assert_eq!(asked.elapsed(), Duration::ZERO, "none waits");
    for (told, command) in told {
        assert_eq!(told, Err(CommandError::Stopping { cause: StopCause::Client, command }));
    }
    assert_eq!(handle.status().reason, stopping);
    handle.ended().await;
    assert_eq!(handle.pause().await, Err(CommandError::NotNow { state: RunState::Stopped, command: "pause" }));
}

/// The run went on to wait for the rest of the pause, and the stop was neither told nor asked for.
#[tokio::test(start_paused = true)]
async fn a_stop_overtakes_a_pause_whose_rest_is_still_awaited() {
    let (handle, access, _) = under_way().await;
    access.table.plant(Some(Planted::Silent));
    handle.pause().await.expect("runs");
    sleep(Duration::from_millis(200)).await;
    assert_eq!(handle.status().reason, RunReason::Stopping(None));
    let asked = Instant::now();
    handle.stop(StopCause::Client);
    let mut status = handle.watch_status();
    let told = status.wait_for(|status| status.reason != RunReason::Stopping(None)).await.expect("told").reason.clone();
    assert_eq!((told, asked.elapsed()), (RunReason::Stopping(Some(StopCause::Client)), Duration::ZERO), "at once");
    let record = handle.ended().await;
    assert_eq!((record.status.state, cause(&record)), (RunState::Stopped, &StopCause::Client));
    assert!(!access.arm.is_moving());
}

/// A device that had acknowledged a stop was asked again with its partner, three times and once for each later attempt.
#[tokio::test(start_paused = true)]
async fn of_arm_and_table_the_one_that_did_not_acknowledge_a_stop_alone_is_asked_again() {
    let (handle, access, _) = under_way().await;
    access.table.plant(Some(Planted::Silent));
    handle.stop(StopCause::Client);
    let healed = access.table.clone();
    tokio::spawn(async move {
        sleep(3 * STOP_ATTEMPT).await;
        healed.plant(None);
    });
    let record = handle.ended().await;
    let report = record.stop.as_ref().expect("stopped");
    for stop in [report.arm.as_ref().expect("armed"), report.table.as_ref().expect("armed")] {
        assert!(stop.acknowledged.is_some() && stop.at_rest.is_some(), "{stop:?}");
        assert!(stop.sent.is_some_and(|sent| sent < STOP_ATTEMPT), "the first request counts: {stop:?}");
    }
    assert_eq!((access.arm.asked().stops, access.table.asked().stops), (1, 1));
}

/// Place at which a driver has a fault of our own.
#[derive(Clone, Copy, Debug, PartialEq)]
enum PanicsAt {
    Stop,
    StateAfterStop,
    Release,
}

/// An arm whose driver panics.
struct Panicking {
    arm: Twin<6>,
    at: PanicsAt,
    is_stopped: bool,
}

impl MotionDevice<6> for Panicking {
    async fn connect(&mut self) -> Result<Identity, DeviceError> {
        self.arm.connect().await
    }

    async fn state(&mut self) -> Result<DeviceState<6>, DeviceError> {
        assert!(!self.is_stopped || self.at != PanicsAt::StateAfterStop, "planted");
        self.arm.state().await
    }

    async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        self.arm.arm(watchdog).await
    }

    async fn start(&mut self, target: &Target<6>) -> Result<(), DeviceError> {
        self.arm.start(target).await
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        self.arm.keep_alive().await
    }

    async fn stop(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        assert!(self.at != PanicsAt::Stop, "planted");
        self.is_stopped = true;
        self.arm.stop(sent_at).await
    }

    async fn release(&mut self) -> Result<(), DeviceError> {
        assert!(self.at != PanicsAt::Release, "planted");
        self.arm.release().await
    }
}

/// Arm and table were dropped without a stop, and the run was told as under way for ever.
#[tokio::test(start_paused = true)]
async fn a_driver_that_panics_while_a_run_ends_keeps_no_device_from_being_stopped() {
    // Stops of arm and table: after a panic that was not in a stop both are asked once more.
    for (at, stops) in [(PanicsAt::Stop, [0, 1]), (PanicsAt::StateAfterStop, [2, 2]), (PanicsAt::Release, [1, 1])] {
        let (Pair { arm, table }, trigger, access) = twins();
        let machine = Pair { arm: Panicking { arm, at, is_stopped: false }, table };
        let handle = simulate_with(short_job(0.1, [hashes(), hashes()]), machine, trigger, RunOptions::default());
        until(&handle, RunState::Running).await;
        sleep(Duration::from_millis(300)).await;
        let ends_by_itself = at == PanicsAt::Release;
        if !ends_by_itself {
            handle.stop(StopCause::Client);
        }
        let record = handle.ended().await;
        assert_eq!([access.arm.asked().stops, access.table.asked().stops], stops, "{at:?}");
        // After a panic nobody waits for rest.
        sleep(Duration::from_secs(1)).await;
        assert!(!access.table.is_moving(), "{at:?}");
        let wanted = if ends_by_itself { RunState::Failed } else { RunState::Stopped };
        assert_eq!([handle.status().state, record.status.state], [wanted; 2], "{at:?}: {}", record.status.reason);
        assert_eq!(matches!(cause(&record), StopCause::Client), !ends_by_itself, "{at:?}: {}", record.status.reason);
        let arm = record.stop.as_ref().and_then(|report| report.arm.clone()).expect("armed");
        assert!(arm.error.is_some(), "{at:?}: {arm:?}");
    }
}

/// A stop was asked for three times at once and then never again: an arm whose link came back ended the move that it held.
#[tokio::test(start_paused = true)]
async fn a_stop_that_no_link_took_is_asked_for_again_once_the_link_is_back() {
    // Longer than the move: what stops the arm is the stop.
    let safeguards = Safeguards { watchdog: Duration::from_secs(600), ..Safeguards::default() };
    let (handle, access, leases, lease) = armed(RunOptions { safeguards, ..RunOptions::default() }).await;
    attend(&handle, &leases, lease.token);
    until(&handle, RunState::Running).await;
    sleep(Duration::from_millis(300)).await;
    access.arm.plant(Some(Planted::Closed));
    // All attempts are over at once, as each is refused.
    sleep(Duration::from_millis(300)).await;
    assert!(access.arm.is_moving() && access.arm.asked().stops == 0);
    let [arm, _] = handle.latest().and_then(|event| event.stop).expect("it stops");
    assert_eq!(arm.sent, None, "nothing went out");
    access.arm.plant(None);
    let record = handle.ended().await;
    let stop = record.stop.as_ref().and_then(|report| report.arm.clone()).expect("armed");
    assert!(stop.acknowledged.is_some() && stop.at_rest.is_some(), "{stop:?}");
    assert!(access.arm.asked().stops > 0 && !access.arm.is_moving());
}

#[tokio::test(start_paused = true)]
async fn a_pause_tells_that_rest_is_awaited_until_arm_and_table_stand() {
    let (handle, _, _) = under_way().await;
    handle.pause().await.expect("runs");
    until(&handle, RunState::Paused).await;
    let mut told: Vec<_> =
        handle.events_after(0).0.into_iter().map(|event| (event.status.state, event.status.reason.code(), event.stop)).collect();
    told.dedup();
    let wanted =
        [(RunState::Running, "under_way", None), (RunState::Running, "stopping", None), (RunState::Paused, "by_client", None)];
    assert_eq!(told[told.len() - 3..], wanted);
}

#[tokio::test(start_paused = true)]
async fn a_stopped_run_is_taken_up_by_a_new_one_that_stands_on_its_way() {
    let (handle, access, leases, lease) = armed(RunOptions::default()).await;
    attend(&handle, &leases, lease.token);
    while handle.latest().and_then(|event| event.step) != Some(3) {
        sleep(Duration::from_millis(20)).await;
    }
    sleep(Duration::from_millis(500)).await;
    handle.stop(StopCause::Client);
    let record = handle.ended().await;
    assert_eq!(record.next_step, 3);
    let here = record.last_measured.expect("read");
    let begin = |here: Configuration, from_step: usize| {
        let machine = Pair { arm: Twin::at(here.joints_rad, 1.0), table: Twin::at([here.table_rad], 1.0) };
        let options = RunOptions { from_step, ..RunOptions::default() };
        simulate_with(job(), machine, TwinTrigger::new(1.0), options)
    };
    drop(access);
    let taken_up = begin(here, 3).ended().await;
    assert_eq!(taken_up.status.state, RunState::Done, "{}", taken_up.status.reason);
    assert_eq!(taken_up.steps[0].step, 3);
    // From elsewhere it does not move at all.
    let refused = begin(here, 6).ended().await;
    assert_eq!(refused.status.state, RunState::Failed);
    assert!(matches!(cause(&refused), StopCause::Objections(found) if matches!(found[..], [Objection::OffStart { .. }])));
    assert_eq!(refused.stop.as_ref().and_then(|stop| stop.arm.clone()), None, "nothing was armed");
    let beyond = begin(here, 99).ended().await;
    assert!(
        matches!(cause(&beyond), StopCause::Objections(found) if matches!(found[..], [Objection::NoSuchStep { step: 99, .. }]))
    );
}

#[tokio::test(start_paused = true)]
async fn a_client_that_falls_silent_stops_the_run() {
    let (handle, access, leases, lease) = armed(RunOptions::default()).await;
    let attendant = attend(&handle, &leases, lease.token);
    until(&handle, RunState::Running).await;
    sleep(Duration::from_millis(700)).await;
    attendant.abort();
    let began = Instant::now();
    let record = handle.ended().await;
    assert!(matches!(cause(&record), StopCause::HeartbeatLost { .. }), "{:?}", record.status);
    assert_eq!(record.status.state, RunState::Stopped);
    assert!(began.elapsed() < Duration::from_secs(2));
    assert!(!access.arm.is_moving());
}

#[tokio::test(start_paused = true)]
async fn a_lease_that_is_lost_stops_the_run() {
    let (handle, access, leases, lease) = armed(RunOptions::default()).await;
    let beats = handle.clone();
    // Beats, but does not renew.
    tokio::spawn(async move {
        while beats.heartbeat(Some(lease.token)).is_ok() {
            sleep(Duration::from_millis(100)).await;
        }
    });
    let record = handle.ended().await;
    assert!(matches!(cause(&record), StopCause::LeaseLost(LeaseError::Expired { .. })), "{:?}", record.status);
    assert!(!access.arm.is_moving());
    let next = leases.acquire(CELL, "another", Duration::from_secs(2)).expect("free again");
    assert!(next.token > lease.token);
    assert!(handle.heartbeat(Some(lease.token)).is_err());
}

#[tokio::test(start_paused = true)]
async fn two_writers_are_one_too_many() {
    let (handle, _access, leases, lease) = armed(RunOptions::default()).await;
    attend(&handle, &leases, lease.token);
    assert!(matches!(leases.acquire(CELL, "another", Duration::from_secs(1)), Err(LeaseError::Held { .. })));
    let other_token = Some(Fence(lease.token.0 + 1));
    assert!(matches!(handle.set_override(other_token, 0.5).await, Err(CommandError::Lease(LeaseError::WrongToken { .. }))));
    assert!(matches!(handle.arm(lease.token).await, Err(CommandError::NotNow { .. })));
    // A second run on the cell cannot be armed with a token that is not the lease's.
    let (machine, trigger, access) = twins();
    let second = live(job(), machine, trigger, Authority { leases, cell: CELL.into() }, RunOptions::default());
    until(&second, RunState::Ready).await;
    assert!(matches!(second.arm(Fence(3)).await, Err(CommandError::Lease(LeaseError::WrongToken { .. }))));
    assert_eq!(access.arm.asked().arms, 0);
}

#[tokio::test(start_paused = true)]
async fn other_hashes_than_the_approved_are_refused_before_anything_is_connected() {
    let others = [
        ("plan", Hashes { plan: "00".repeat(32), ..hashes() }),
        ("cell", Hashes { cell: "00".repeat(32), ..hashes() }),
        ("compensation", Hashes { compensation: Some("00".repeat(32)), ..hashes() }),
    ];
    for (wanted, present) in others {
        let record = simulate(job_of([hashes(), present]), RunOptions::default()).ended().await;
        let StopCause::Objections(found) = cause(&record) else { panic!("{:?}", record.status) };
        assert!(matches!(found[..], [Objection::OtherHash { what, .. }] if what == wanted), "{found:?}");
        assert_eq!((record.status.state, record.identities.clone()), (RunState::Failed, None));
    }
}

#[tokio::test(start_paused = true)]
async fn a_silent_trigger_holds_the_run_and_the_view_is_taken_again() {
    let (handle, access, leases, lease) = armed(RunOptions::default()).await;
    attend(&handle, &leases, lease.token);
    access.trigger.silence(true);
    until(&handle, RunState::Paused).await;
    assert!(matches!(handle.status().reason, RunReason::Paused(PauseCause::Trigger { step: 2, .. })), "{:?}", handle.status());
    sleep(Duration::from_secs(60)).await;
    assert_eq!(handle.status().state, RunState::Paused, "never skipped, never resumed by itself");
    access.trigger.silence(false);
    handle.resume(Some(lease.token)).await.expect("paused");
    let record = handle.ended().await;
    assert_all_steps(&record);
    assert_eq!(record.steps[2].attempts, 2);
}

/// A trigger that nothing acknowledges, and that does not get its output back; what it was asked, it tells with the number of stops
/// of the arm before.
struct Unacknowledged {
    arm: TwinAccess<6>,
    told: tokio::sync::mpsc::UnboundedSender<(&'static str, u64)>,
}

impl Unacknowledged {
    async fn tell(&self, what: &'static str) {
        self.told.send((what, self.arm.asked().stops)).expect("heard");
        std::future::pending().await
    }
}

impl Trigger for Unacknowledged {
    async fn set_brightness(&mut self, _level: u8) -> Result<(), DeviceError> {
        Ok(())
    }

    async fn capture(&mut self, capture: &Capture) -> Result<Captured, DeviceError> {
        self.tell("capture").await;
        Err(DeviceError::Silent { waited: capture.deadline })
    }

    async fn withdraw(&mut self) {
        self.tell("withdraw").await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_capture_that_is_given_up_is_withdrawn_after_the_stop_of_the_devices_and_delays_nothing() {
    let (machine, _, access) = twins();
    let (told, mut heard) = tokio::sync::mpsc::unbounded_channel();
    let trigger = Unacknowledged { arm: access.arm.clone(), told };
    let handle = simulate_with(short_job(0.3, [hashes(), hashes()]), machine, trigger, RunOptions::default());
    assert_eq!(heard.recv().await, Some(("capture", 0)));
    handle.pause().await.expect("runs");
    assert_eq!(heard.recv().await, Some(("withdraw", 1)), "at the pause");
    handle.resume(None).await.expect("paused");
    assert_eq!(heard.recv().await, Some(("capture", 1)));
    let asked = Instant::now();
    handle.stop(StopCause::Client);
    let record = handle.ended().await;
    assert_eq!(heard.recv().await, Some(("withdraw", 2)), "at the end");
    let at_rest = record.stop.as_ref().and_then(|report| report.arm.as_ref()?.at_rest).expect("stopped");
    assert!(asked.elapsed() <= at_rest + WITHDRAWAL + Duration::from_millis(50), "{:?}", asked.elapsed());
}

#[tokio::test(start_paused = true)]
async fn a_log_that_cannot_be_kept_stops_the_run() {
    let audit = log_on_full_disk(2000);
    let (handle, access, leases, lease) = armed(RunOptions { audit: Some(Arc::clone(&audit)), ..RunOptions::default() }).await;
    attend(&handle, &leases, lease.token);
    until(&handle, RunState::Running).await;
    for _ in 0..100 {
        audit.record("arm", Direction::Sent, &[0; 100]);
    }
    while audit.failure().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    let record = handle.ended().await;
    assert!(matches!(cause(&record), StopCause::Audit(_)), "{:?}", record.status);
    assert_eq!(record.status.state, RunState::Stopped);
    assert!(!access.arm.is_moving());
}

#[tokio::test(start_paused = true)]
async fn a_dry_run_reads_and_tells_what_stands_against_motion() {
    let (machine, _, access) = twins();
    access.table.plant(Some(Planted::GuardOpen));
    let record = dry_run(job(), ObservedPair::new(machine.arm, machine.table), RunOptions::default()).ended().await;
    assert_eq!((record.status.state, record.mode), (RunState::Done, Mode::DryRun), "{:?}", record.status);
    assert_eq!(record.objections, [StopCause::GuardOpen(DeviceRole::Table)]);
    assert!(record.identities.is_some());
    let asked = access.arm.asked();
    assert_eq!((asked.arms, asked.targets, asked.stops, asked.keep_alives), (0, 0, 0, 0));
    let (machine, _, access) = twins();
    access.arm.plant(Some(Planted::Closed));
    let record = dry_run(job(), ObservedPair::new(machine.arm, machine.table), RunOptions::default()).ended().await;
    assert_eq!(record.status.state, RunState::Failed);
}

#[tokio::test(start_paused = true)]
async fn a_run_whose_handles_are_gone_stops() {
    let (machine, trigger, access) = twins();
    let handle = simulate_with(job(), machine, trigger, RunOptions::default());
    until(&handle, RunState::Running).await;
    sleep(Duration::from_millis(700)).await;
    assert!(access.arm.is_moving());
    drop(handle);
    sleep(Duration::from_secs(2)).await;
    assert!(!access.arm.is_moving());
    assert!(access.arm.asked().stops > 0);
}

#[tokio::test(start_paused = true)]
async fn every_fault_in_every_state_ends_as_documented_and_nothing_moves_after() {
    for device in [DeviceRole::Arm, DeviceRole::Table] {
        for (planted, ends) in FAULTS {
            // A refusal of targets that no further target meets hinders nothing.
            let may_end_well = matches!(planted, Planted::Refuses | Planted::Stuck);
            let ends = [ends, if may_end_well { RunState::Done } else { ends }];
            fault_in_each_state::<Twins>((device, planted), &ends).await;
        }
    }
}

/// Operations on a run, in an order of chance.
async fn at_random(seed: u64) -> RunState {
    let mut random = Chance(seed);
    let mut chance = |of: u64| random.of(of);
    let (handle, access, leases, lease) = armed(RunOptions { single_step: chance(4) == 0, ..RunOptions::default() }).await;
    let attendant = attend(&handle, &leases, lease.token);
    let (token, axes) = (Some(lease.token), planned().cell.axes());
    for _ in 0..60 {
        sleep(Duration::from_millis(20 + chance(700))).await;
        // What is refused is refused.
        match chance(16) {
            0..3 => drop(handle.pause().await),
            3..8 => drop(handle.resume(token).await),
            8 | 9 => drop(handle.step(token).await),
            10 => drop(handle.set_override(token, 0.01 + chance(100) as f64 / 101.0).await),
            11 => access.trigger.silence(chance(2) == 0),
            12 if chance(12) == 0 => handle.stop(StopCause::Client),
            13 if chance(12) == 0 => access.arm.plant(Some(FAULTS[chance(FAULTS.len() as u64) as usize].0)),
            14 if chance(12) == 0 => access.table.plant(Some(FAULTS[chance(FAULTS.len() as u64) as usize].0)),
            15 if chance(20) == 0 => attendant.abort(),
            _ => {}
        }
        let here = Configuration { joints_rad: access.arm.positions_rad(), table_rad: access.table.positions_rad()[0] };
        assert!(axes.allow(&here), "seed {seed}: out of limits");
        let is_armed = handle.status().state.is_armed();
        assert!(is_armed || handle.status().state.is_final(), "seed {seed}: {:?}", handle.status());
    }
    access.trigger.silence(false);
    handle.stop(StopCause::Client);
    let record = handle.ended().await;
    attendant.abort();
    assert!(record.status.state.is_final());
    assert!(record.steps.windows(2).all(|pair| pair[0].step < pair[1].step), "seed {seed}: a step left out or taken twice");
    access.assert_rests(&format!("seed {seed}")).await;
    record.status.state
}

#[tokio::test(start_paused = true)]
#[ignore = "long: tests/all runs it"]
async fn whatever_happens_it_moves_only_when_armed_in_order_within_limits_and_ends() {
    let mut ends = BTreeSet::new();
    for seed in 0..150 {
        ends.insert(at_random(seed).await);
    }
    assert_eq!(ends, BTreeSet::from([RunState::Done, RunState::Stopped, RunState::Failed]), "each end is met");
}
