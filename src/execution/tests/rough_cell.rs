//! Arm and table of a rehearsal as their real drivers have them: Han's controller and a MINAS A6 drive, simulated, each behind a
//! network that can fail. What goes to the wire, and what a session asks of a driver, is watched.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};
use tokio::sync::watch;
use tokio::time::{Instant, sleep};

use super::fault_table::{FaultStage, FaultyCell, ROOM};
use super::rehearsal::{CELL, hashes, planned, short_job};
use super::simulated_network::{NetworkDialer, Passage, RoughNetwork, Weather};
use crate::cell::Configuration;
use crate::execution::device::{DeviceError, DeviceState, Direction, FaultCode, Identity, MotionDevice, Target, WireLog};
use crate::execution::drivers::hans::HansArm;
use crate::execution::drivers::minas_a6::MinasA6Table;
use crate::execution::drivers::modbus_link::ModbusLink;
use crate::execution::drivers::stream::Wiring;
use crate::execution::protocol::hans::{HansFrames, HansRequest};
use crate::execution::protocol::minas_a6::coil;
use crate::execution::protocol::modbus::{ModbusAdu, ModbusFraming, ModbusRequest, ModbusSide};
use crate::execution::session::{DeviceRole, Fence, Leases, Pair, RunJob, RunState, RunStatus, StopCause};
use crate::execution::simulators::faults::FaultCommand;
use crate::execution::simulators::hans::HansController;
use crate::execution::simulators::minas_a6::{DriveSetup, MinasA6Simulator};
use crate::execution::twin::{TriggerAccess, TwinTrigger};

/// Command units of a turn of the table.
const UNITS_PER_TURN: f64 = 1_600_000.0;
/// Longest time in which a device brakes to rest.
pub(crate) const BRAKING: Duration = Duration::from_millis(1500);
/// Time for which a run may go on after its lease: a look at it, and no more.
const GRACE: Duration = Duration::from_millis(25);

/// Deeds of one run, and whatever it must not have done.
#[derive(Default)]
pub(crate) struct SeenBytes {
    inner: Mutex<Deeds>,
}

#[derive(Default)]
struct Deeds {
    breaches: Vec<String>,
    targets: u64,
    /// Bytes of arm and table.
    is_armed: [bool; 2],
    stopped_at: [Option<Instant>; 2],
    sequence: [u64; 2],
    sent_sequence: u64,
    arm_frames: HansFrames,
    table_bytes: Vec<u8>,
    status: Option<watch::Receiver<RunStatus>>,
    lease: Option<(Leases, Fence)>,
    held_at: Option<Instant>,
}

impl SeenBytes {
    /// Watches the run's state from here on, and its lease.
    pub(crate) fn follow(&self, status: watch::Receiver<RunStatus>, leases: Leases, token: Fence) {
        let mut deeds = self.deeds();
        (deeds.status, deeds.lease) = (Some(status), Some((leases, token)));
    }

    pub(crate) fn breaches(&self) -> Vec<String> {
        self.deeds().breaches.clone()
    }

    /// Notes that the lease is held now, if it is.
    pub(crate) fn look_at_lease(&self) {
        self.deeds().look_at_lease();
    }

    /// Returns true if a device may be moving by this run's will.
    pub(crate) fn may_move(&self, device: DeviceRole) -> bool {
        let deeds = self.deeds();
        let place = usize::from(device == DeviceRole::Table);
        let brakes = deeds.stopped_at[place].is_some_and(|stopped| stopped.elapsed() <= BRAKING);
        deeds.is_armed[place] || brakes
    }

    fn deeds(&self) -> std::sync::MutexGuard<'_, Deeds> {
        self.inner.lock().expect("whole")
    }
}

impl Deeds {
    fn look_at_lease(&mut self) {
        if let Some((leases, token)) = &self.lease
            && leases.check(CELL, *token).is_ok()
        {
            self.held_at = Some(Instant::now());
        }
    }

    /// A byte that moves something is on the wire.
    fn motion(&mut self, device: &str) {
        self.look_at_lease();
        self.targets += 1;
        let state = self.status.as_ref().map(|status| status.borrow().state);
        if state.is_some_and(|state| state != RunState::Running) {
            self.breaches.push(format!("motion of the {device} on the wire while {state:?}"));
        }
        if self.lease.is_some() && self.held_at.is_none_or(|held| held.elapsed() > GRACE) {
            self.breaches.push(format!("motion of the {device} on the wire without the lease"));
        }
    }

    fn sent_to_arm(&mut self, bytes: &[u8]) {
        self.arm_frames.push(bytes);
        while let Some(message) = self.arm_frames.next_message() {
            if let Ok(Ok(HansRequest::WayPoint(point))) = message.map(|message| HansRequest::parse(&message)) {
                self.motion("arm");
                let sequence = point.command_id.trim_start_matches('V').parse().unwrap_or(0);
                if sequence <= self.sent_sequence {
                    self.breaches.push(format!("target {sequence} on the wire after {}", self.sent_sequence));
                }
                self.sent_sequence = sequence;
            }
        }
    }

    fn sent_to_table(&mut self, bytes: &[u8]) {
        self.table_bytes.extend_from_slice(bytes);
        while let Ok(Some(adu)) = ModbusAdu::take(&mut self.table_bytes, ModbusFraming::Rtu, ModbusSide::Server) {
            if ModbusRequest::parse(&adu.pdu) == Ok(ModbusRequest::WriteCoil { address: coil::STROBE, on: true }) {
                self.motion("table");
            }
        }
    }
}

impl WireLog for SeenBytes {
    fn record(&self, device: &'static str, direction: Direction, bytes: &[u8]) {
        match (direction, device) {
            (Direction::Sent, "arm") => self.deeds().sent_to_arm(bytes),
            (Direction::Sent, _) => self.deeds().sent_to_table(bytes),
            (Direction::Received, _) => {}
        }
    }
}

/// A driver that is watched.
pub(crate) struct Watched<D> {
    driver: D,
    seen: Arc<SeenBytes>,
    place: usize,
}

impl<const N: usize, D: MotionDevice<N>> MotionDevice<N> for Watched<D> {
    async fn connect(&mut self) -> Result<Identity, DeviceError> {
        self.driver.connect().await
    }

    async fn state(&mut self) -> Result<DeviceState<N>, DeviceError> {
        self.driver.state().await
    }

    async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        {
            let mut deeds = self.seen.deeds();
            (deeds.is_armed[self.place], deeds.stopped_at[self.place]) = (true, None);
        }
        self.driver.arm(watchdog).await
    }

    async fn start(&mut self, target: &Target<N>) -> Result<(), DeviceError> {
        {
            let mut deeds = self.seen.deeds();
            if !deeds.is_armed[self.place] {
                deeds.breaches.push(format!("target {} unarmed", target.sequence));
            }
            if target.sequence <= deeds.sequence[self.place] {
                deeds.breaches.push(format!("target {} out of order", target.sequence));
            }
            deeds.sequence[self.place] = target.sequence;
        }
        self.driver.start(target).await
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        self.driver.keep_alive().await
    }

    async fn stop(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        let acknowledged = self.driver.stop(sent_at).await?;
        let mut deeds = self.seen.deeds();
        (deeds.is_armed[self.place], deeds.stopped_at[self.place]) = (false, Some(Instant::now()));
        Ok(acknowledged)
    }

    async fn release(&mut self) -> Result<(), DeviceError> {
        self.driver.release().await
    }

    fn fault_text(&self, fault: FaultCode) -> Option<&'static str> {
        self.driver.fault_text(fault)
    }
}

/// The session's side of the cell.
pub(crate) type RoughPair = Pair<Watched<HansArm>, Watched<MinasA6Table>>;

/// The cell.
pub(crate) struct RoughCell {
    pub(crate) controller: HansController,
    pub(crate) drive: MinasA6Simulator,
    pub(crate) networks: [Arc<RoughNetwork>; 2],
    home_units: i32,
    trigger: Option<TriggerAccess>,
    seen: Arc<SeenBytes>,
}

impl RoughCell {
    /// A cell at home; delays and what is split come from the seed.
    pub(crate) fn new(seed: u64) -> Self {
        let home = planned().program.home_rad;
        let home_units = 123_456;
        let position = home_units + (home.table_rad / std::f64::consts::TAU * UNITS_PER_TURN).round() as i32;
        let controller = HansController::new(planned().cell.robot.clone(), home.joints_rad, 1.0);
        let drive = MinasA6Simulator::new(&DriveSetup { position, ..DriveSetup::default() });
        let (arm, table) = (controller.clone(), drive.clone());
        let to_arm = RoughNetwork::new(seed, move |end| {
            let arm = arm.clone();
            tokio::spawn(async move { arm.talk(end).await });
        });
        let to_table = RoughNetwork::new(!seed, move |end| {
            let table = table.clone();
            tokio::spawn(async move { table.talk(end, ModbusFraming::Rtu).await });
        });
        Self { controller, drive, networks: [to_arm, to_table], home_units, trigger: None, seen: Arc::default() }
    }

    /// Drivers of a run, and the watch over them.
    pub(crate) fn drivers(&self) -> (RoughPair, Arc<SeenBytes>) {
        let seen = Arc::<SeenBytes>::default();
        let wiring = |device, network: &Arc<RoughNetwork>| Wiring {
            dialer: Arc::new(NetworkDialer(Arc::clone(network))),
            log: Arc::clone(&seen) as Arc<dyn WireLog>,
            device,
        };
        let arm = serde_json::json!({"address": "arm:10003", "model": "hans-e05"});
        let table = serde_json::json!({"address": "tcp://table:502", "units_per_turn": UNITS_PER_TURN as u32, "gear_ratio": 40,
            "home_units": self.home_units});
        let (arm, table) = (serde_json::from_value(arm).expect("sound"), serde_json::from_value(table).expect("sound"));
        let arm = HansArm::new(arm, planned().cell.robot.kinematics.clone(), wiring("arm", &self.networks[0]));
        let table = MinasA6Table::new(
            table,
            planned().cell.turntable.axis.max_acceleration_rad_per_s2,
            wiring("table", &self.networks[1]),
        );
        let arm = Watched { driver: arm, seen: Arc::clone(&seen), place: 0 };
        let table = Watched { driver: table, seen: Arc::clone(&seen), place: 1 };
        (Pair { arm, table }, seen)
    }

    pub(crate) fn configuration(&self) -> Configuration {
        let units = (self.drive.position())() - f64::from(self.home_units);
        Configuration { joints_rad: self.controller.joints_rad(), table_rad: units / UNITS_PER_TURN * std::f64::consts::TAU }
    }

    pub(crate) fn network(&self, device: DeviceRole) -> &Arc<RoughNetwork> {
        &self.networks[usize::from(device == DeviceRole::Table)]
    }

    /// Applies a fault of the simulated device itself.
    pub(crate) fn apply(&self, device: DeviceRole, fault: FaultCommand) {
        if device == DeviceRole::Table { self.drive.faults().apply(fault) } else { self.controller.faults().apply(fault) }
    }

    /// Ends every fault, and opens the networks.
    pub(crate) fn heal_all(&self) {
        self.controller.faults().apply(FaultCommand::Clear);
        self.drive.faults().apply(FaultCommand::Clear);
        self.networks.iter().for_each(|network| network.set_weather(Weather::FAIR));
    }

    /// A command to the arm by somebody else, such as at the pendant; again until it is taken.
    fn at_the_pendant(&self, command: &'static str) {
        let (controller, (mut here, there)) = (self.controller.clone(), duplex(4096));
        tokio::spawn(async move {
            let asking = async {
                for _ in 0..200 {
                    here.write_all(format!("{command},0,;").as_bytes()).await.expect("taken");
                    let mut reply = [0; 256];
                    let read = here.read(&mut reply).await.expect("a reply");
                    if reply[..read].windows(4).any(|window| window == b",OK,") {
                        return;
                    }
                    sleep(Duration::from_millis(20)).await;
                }
            };
            tokio::select! {
                () = controller.talk(there) => {}
                () = asking => {}
            }
        });
    }

    /// A coil of the table's drive, written by somebody else.
    async fn by_another_master(&self, address: u16, on: bool) {
        let (drive, (here, there)) = (self.drive.clone(), duplex(4096));
        let server = tokio::spawn(async move { drive.talk(there, ModbusFraming::Rtu).await });
        let connection = Wiring::over_tcp("other", Arc::new(())).connection(Box::new(here));
        let mut link = ModbusLink::new(connection, ModbusFraming::Rtu, 1, Duration::from_secs(1));
        link.set_coil(address, on).await.expect("written");
        server.abort();
    }
}

/// Faults of the cell and around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RoughFault {
    /// Fault of the simulated device.
    Of(DeviceRole, FaultCommand),
    /// Connections cut once.
    Cut(DeviceRole),
    /// The network of a device.
    Net(DeviceRole, Passage),
    /// Changed bytes.
    Garbled(DeviceRole),
    /// Networks of both.
    NetOfBoth(Passage),
    /// Command at the pendant of the arm.
    Pendant(&'static str),
    /// Coil of the table's drive, by another master.
    Coil(u16, bool),
    /// The scanner acknowledges nothing.
    ScannerSilent,
    /// The client is gone.
    ClientGone,
    /// The lease is given back while the run goes on.
    LeaseGivenBack,
    /// The lease goes to another client.
    LeaseToAnother,
    /// The client stops the run.
    StoppedByClient,
    /// Nobody holds the run any more.
    ServerGone,
    /// The disk of the audit log is full.
    AuditDiskFull,
    /// Another plan is in force than the one approved.
    OtherPlan,
    /// Another cell is in force than the one approved.
    OtherCell,
    /// Another compensation is in force than the one approved.
    OtherCompensation,
}

impl FaultyCell for RoughCell {
    type Fault = RoughFault;
    type Machine = RoughPair;
    type Trigger = TwinTrigger;

    async fn begin() -> (RoughPair, TwinTrigger, Self) {
        let mut cell = Self::new(7);
        let (machine, seen) = cell.drivers();
        let trigger = TwinTrigger::new(1.0);
        (cell.trigger, cell.seen) = (Some(trigger.access()), seen);
        (machine, trigger, cell)
    }

    fn job(fault: RoughFault) -> RunJob {
        let other = || "00".repeat(32);
        let mut present = hashes();
        if fault == RoughFault::OtherPlan {
            present.plan = other();
        }
        if fault == RoughFault::OtherCell {
            present.cell = other();
        }
        if fault == RoughFault::OtherCompensation {
            present.compensation = Some(other());
        }
        short_job(0.1, [hashes(), present])
    }

    async fn plant(&self, fault: RoughFault, stage: &FaultStage) {
        match fault {
            RoughFault::Of(device, fault) => self.apply(device, fault),
            RoughFault::Cut(device) => self.network(device).cut(),
            RoughFault::Net(device, passage) => self.network(device).set_passage(passage),
            RoughFault::Garbled(device) => {
                self.network(device).set_weather(Weather { is_garbled: true, ..self.network(device).weather() });
            }
            RoughFault::NetOfBoth(passage) => self.networks.iter().for_each(|network| network.set_passage(passage)),
            RoughFault::Pendant(command) => self.at_the_pendant(command),
            RoughFault::Coil(address, on) => self.by_another_master(address, on).await,
            RoughFault::ScannerSilent => {
                let trigger = self.trigger.clone().expect("begun");
                trigger.silence(true);
                tokio::spawn(async move {
                    sleep(Duration::from_secs(30)).await;
                    trigger.silence(false);
                });
            }
            RoughFault::ClientGone => stage.attendant.abort(),
            RoughFault::LeaseGivenBack => stage.leases.release(CELL, stage.token).expect("held"),
            RoughFault::LeaseToAnother => {
                stage.leases.release(CELL, stage.token).expect("held");
                stage.leases.acquire(CELL, "another", Duration::from_secs(30)).expect("free");
            }
            RoughFault::StoppedByClient => stage.handle().stop(StopCause::Client),
            RoughFault::ServerGone => {
                stage.attendant.abort();
                stage.handle.lock().expect("whole").take();
            }
            RoughFault::AuditDiskFull => {
                for _ in 0..2 * ROOM / 4096 {
                    stage.audit.record("arm", Direction::Sent, &[0; 4096]);
                }
                while stage.audit.failure().is_none() {
                    std::thread::yield_now();
                }
            }
            RoughFault::OtherPlan | RoughFault::OtherCell | RoughFault::OtherCompensation => {}
        }
    }

    fn heal(&self) {
        self.heal_all();
        if let Some(trigger) = &self.trigger {
            trigger.silence(false);
        }
    }

    fn positions_rad(&self) -> [f64; 7] {
        self.configuration().axes_rad()
    }

    fn targets(&self) -> u64 {
        self.seen.deeds().targets
    }

    fn breaches(&self) -> u64 {
        self.seen.breaches().len() as u64
    }
}
