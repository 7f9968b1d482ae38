//! The arm behind the sockets: what it is asked, what state it is in, and where it is.

use std::collections::BTreeMap;

use crate::cell::Robot;
use crate::execution::protocol::hans::{
    ActualPosition, FSM_DISABLED, FSM_MOVING, FSM_STANDBY, HansCommand, HansRequest, HansWayPoint, RobotFlags, texts,
};
use crate::execution::protocol::hans_state::HansRealtimeState;
use crate::execution::simulators::faults::FaultState;
use crate::execution::simulators::motion::MovingAxes;

/// Time of a capture of the simulated scanner, s.
const CAPTURE_SECS: f64 = 0.5;
/// Time for which its acknowledgement stays on once the output is off, s.
const RELEASE_SECS: f64 = 0.1;
/// Code of the maker's for a move while another is under way.
const ALREADY_MOVING: i64 = 20_004;
/// Code of the maker's for an arm that is not initialised. What the controller says to a move while it is disabled is not documented.
const NOT_INITIALISED: i64 = 40_000;
/// Code of the maker's for a parameter that is not allowed.
const PARAMETER_ERROR: i64 = 40_034;
/// State: emergency stop.
const FSM_EMERGENCY_STOP: i32 = 5;
/// State: no power.
const FSM_BLACKOUT: i32 = 7;
/// State: guard open.
const FSM_SAFETY_GUARD: i32 = 12;
/// State: error.
const FSM_ERROR: i32 = 22;
/// State: braking to rest.
const FSM_STOPPING: i32 = 27;
/// State: guided by hand.
const FSM_FREE_DRIVE: i32 = 31;
/// State: move held.
const FSM_HOLDING: i32 = 32;
/// State of a path that can be followed.
const PATH_COMPUTED: u8 = 3;
/// Largest number of paths that it keeps.
const MAX_PATHS: usize = 16;
/// Largest number of points of a path.
const MAX_PATH_POINTS: usize = 4096;
/// Fewest points of a path.
const MIN_PATH_POINTS: usize = 5;
/// Largest speed of servo targets, of the rated, over the time since the last and [`SERVO_BUNCH_SECS`]: beyond it the arm is in error.
const MAX_SERVO_SPEED: f64 = 1.5;
/// Time of servo targets that the network may bunch together, s.
const SERVO_BUNCH_SECS: f64 = 0.02;

/// A simulated arm.
#[derive(Debug)]
pub(super) struct SimulatedArm {
    robot: Robot,
    axes: MovingAxes<6>,
    is_electrified: bool,
    is_enabled: bool,
    is_stopping: bool,
    is_guided: bool,
    error_code: i64,
    faults: FaultState,
    override_fraction: f64,
    way_point: Option<HansWayPoint>,
    is_held: bool,
    paths: BTreeMap<String, HansPath>,
    /// Points of a path under way that are still to come.
    ahead_deg: Vec<[f64; 6]>,
    servo_since: Option<f64>,
    /// Digital outputs that were set; to each a scanner is wired.
    outputs: BTreeMap<u8, ScannerLine>,
}

/// Output to a simulated scanner, which acknowledges by the input of the same number.
#[derive(Clone, Copy, Debug)]
struct ScannerLine {
    is_on: bool,
    /// Time at which it was set, s.
    since: f64,
    /// Time until which an acknowledgement stays on behind the output, s.
    acknowledged_until: f64,
}

impl ScannerLine {
    /// Returns true if the input is on: a capture's time after the output, and for a while behind it.
    fn acknowledges(self, now: f64) -> bool {
        self.is_on && now - self.since >= CAPTURE_SECS || now < self.acknowledged_until
    }
}

/// A path that was uploaded.
#[derive(Debug, Default)]
struct HansPath {
    speed_fraction: f64,
    points_deg: Vec<[f64; 6]>,
    is_ended: bool,
}

type Answer = Result<Vec<String>, i64>;

impl SimulatedArm {
    pub(super) fn at(robot: Robot, joints_rad: [f64; 6]) -> Self {
        Self {
            robot,
            axes: MovingAxes::at(joints_rad),
            is_electrified: true,
            is_enabled: true,
            is_stopping: false,
            is_guided: false,
            error_code: 0,
            faults: FaultState::default(),
            override_fraction: 1.0,
            way_point: None,
            is_held: false,
            paths: BTreeMap::new(),
            ahead_deg: Vec::new(),
            servo_since: None,
            outputs: BTreeMap::new(),
        }
    }

    pub(super) fn joints_rad(&self, now: f64) -> [f64; 6] {
        self.axes.positions(now)
    }

    /// Error that the controller is in.
    pub(super) fn error(&self) -> Option<u32> {
        u32::try_from(self.error_code).ok().filter(|code| *code != 0)
    }

    /// Lets faults act, and a path go on.
    pub(super) fn feel(&mut self, faults: &FaultState, now: f64) {
        if faults.is_emergency_stop || faults.is_guard_open || faults.alarm.is_some() {
            self.halt(now);
        }
        if faults.is_emergency_stop || faults.alarm.is_some() {
            self.is_enabled = false;
        }
        if let Some(alarm) = faults.alarm {
            self.error_code = alarm.into();
        }
        self.faults = *faults;
        if !self.axes.is_moving(now) {
            self.is_stopping = false;
            if let Some(next) = self.ahead_deg.pop() {
                self.go(next, f64::INFINITY, f64::INFINITY, now);
            }
        }
    }

    /// Brakes and forgets what was ahead.
    fn halt(&mut self, now: f64) {
        self.is_stopping = self.axes.is_moving(now);
        self.axes.brake(now);
        (self.way_point, self.is_held, self.servo_since) = (None, false, None);
        self.ahead_deg = Vec::new();
    }

    pub(super) fn fsm(&self, now: f64) -> i32 {
        match () {
            () if !self.is_electrified => FSM_BLACKOUT,
            () if self.faults.is_emergency_stop => FSM_EMERGENCY_STOP,
            () if self.faults.is_guard_open => FSM_SAFETY_GUARD,
            () if self.error_code != 0 => FSM_ERROR,
            () if !self.is_enabled => FSM_DISABLED,
            () if self.is_guided => FSM_FREE_DRIVE,
            () if self.is_stopping => FSM_STOPPING,
            () if self.is_held => FSM_HOLDING,
            () if self.is_moving(now) => FSM_MOVING,
            () => FSM_STANDBY,
        }
    }

    fn set_output(&mut self, output: u8, is_on: bool, now: f64) {
        let before = self.outputs.get(&output);
        let acknowledged_until = match before {
            Some(line) if line.is_on && !is_on && line.acknowledges(now) => now + RELEASE_SECS,
            Some(line) => line.acknowledged_until,
            None => f64::NEG_INFINITY,
        };
        self.outputs.insert(output, ScannerLine { is_on, since: now, acknowledged_until });
    }

    pub(super) fn is_moving(&self, now: f64) -> bool {
        self.axes.is_moving(now) || self.servo_since.is_some() || !self.ahead_deg.is_empty()
    }

    /// Answers a request.
    pub(super) fn answer(&mut self, request: &HansRequest, now: f64) -> Answer {
        match request {
            HansRequest::Plain(command) => self.command(*command, now),
            HansRequest::SetOverride { fraction } => {
                self.override_fraction = Some(*fraction).filter(|share| (0.01..=1.0).contains(share)).ok_or(PARAMETER_ERROR)?;
                Ok(Vec::new())
            }
            HansRequest::SetBoxDo { output, is_on } => {
                self.set_output(*output, *is_on, now);
                Ok(Vec::new())
            }
            HansRequest::ReadBoxDi { input } => {
                let is_on = self.outputs.get(input).is_some_and(|line| line.acknowledges(now));
                Ok(vec![u8::from(is_on).to_string()])
            }
            HansRequest::WayPoint(point) => self.start(point, now),
            HansRequest::StartPushMovePath { name, speed_fraction, .. } => self.begin_path(name, *speed_fraction),
            HansRequest::PushMovePathJ { name, joints_deg } => self.push_point(name, joints_deg),
            HansRequest::EndPushMovePath { name } => self.end_path(name),
            HansRequest::ReadMovePathState { name } => {
                let path = self.paths.get(name).ok_or(PARAMETER_ERROR)?;
                Ok(vec![if path.is_ended { PATH_COMPUTED } else { 0 }.to_string()])
            }
            HansRequest::MovePath { name } => self.move_path(name, now),
            HansRequest::StartServo { .. } => {
                self.check_ready(now)?;
                self.servo_since = Some(now);
                Ok(Vec::new())
            }
            HansRequest::PushServoJ { joints_deg } => self.push_servo(joints_deg, now),
            HansRequest::Acs2Pcs { joints_deg, tool, user_frame } => {
                // Tools and user frames are not modelled.
                let is_plain = tool.iter().chain(user_frame).all(|value| *value == 0.0);
                if is_plain { Ok(texts(&self.pose(&joints_deg.map(f64::to_radians)))) } else { Err(PARAMETER_ERROR) }
            }
        }
    }

    fn command(&mut self, command: HansCommand, now: f64) -> Answer {
        let one = |value: i64| Ok(vec![value.to_string()]);
        match command {
            HansCommand::ConnectToBox | HansCommand::StartMaster | HansCommand::CloseMaster => return Ok(Vec::new()),
            HansCommand::Electrify => self.is_electrified = true,
            HansCommand::BlackOut => {
                self.halt(now);
                (self.is_electrified, self.is_enabled) = (false, false);
            }
            HansCommand::IsSimulation | HansCommand::ReadControllerState => return one(1),
            HansCommand::ReadVersion => return Ok(vec!["vantage-sim".to_owned(), env!("CARGO_PKG_VERSION").to_owned()]),
            HansCommand::ReadRobotModel => return Ok(vec![self.robot.name.clone()]),
            HansCommand::GrpPowerOn => self.power_on()?,
            HansCommand::GrpPowerOff => {
                self.halt(now);
                self.is_enabled = false;
            }
            HansCommand::GrpReset => {
                if self.faults.alarm.is_none() {
                    self.error_code = 0;
                }
            }
            HansCommand::GrpStop => self.halt(now),
            HansCommand::GrpInterrupt => {
                self.is_held = self.axes.is_moving(now);
                self.axes.brake(now);
            }
            HansCommand::GrpContinue => self.go_on(now),
            HansCommand::GrpOpenFreeDriver => {
                self.check_ready(now)?;
                self.is_guided = true;
            }
            HansCommand::GrpCloseFreeDriver => self.is_guided = false,
            HansCommand::ReadActPos => return Ok(self.position(now).values()),
            HansCommand::ReadRobotState => return Ok(self.flags(now).values()),
            HansCommand::ReadEmergencyInfo => {
                let (stop, guard) = (i64::from(self.faults.is_emergency_stop), i64::from(self.faults.is_guard_open));
                return Ok([0, stop, 0, guard].map(|value| value.to_string()).to_vec());
            }
            HansCommand::ReadCurFsm => return one(self.fsm(now).into()),
            HansCommand::ReadCurWayPointId => {
                return Ok(vec![self.way_point.as_ref().map_or_else(String::new, |point| point.command_id.clone())]);
            }
        }
        Ok(Vec::new())
    }

    fn power_on(&mut self) -> Result<(), i64> {
        let is_able = self.is_electrified && !self.faults.is_emergency_stop && self.error_code == 0;
        self.is_enabled = is_able;
        if is_able { Ok(()) } else { Err(NOT_INITIALISED) }
    }

    /// Error unless it can take a move now.
    fn check_ready(&self, now: f64) -> Result<(), i64> {
        match self.fsm(now) {
            FSM_STANDBY => Ok(()),
            FSM_MOVING | FSM_STOPPING => Err(ALREADY_MOVING),
            _ => Err(NOT_INITIALISED),
        }
    }

    fn start(&mut self, point: &HansWayPoint, now: f64) -> Answer {
        self.check_ready(now)?;
        let is_known = point.is_joint_target && !point.is_linear;
        if !is_known || point.speed <= 0.0 || point.acceleration <= 0.0 || !self.allows(&point.joints_deg) {
            return Err(PARAMETER_ERROR);
        }
        self.way_point = Some(point.clone());
        self.go(point.joints_deg, point.speed.to_radians(), point.acceleration.to_radians(), now);
        Ok(Vec::new())
    }

    /// Moves there: no joint faster than `speed`, nor than its rating allows under the override.
    fn go(&mut self, joints_deg: [f64; 6], speed_rad_s: f64, acceleration_rad_s2: f64, now: f64) {
        let share = self.override_fraction;
        let speed = self.robot.joints.map(|joint| speed_rad_s.min(joint.max_speed_rad_per_s) * share);
        let acceleration = self.robot.joints.map(|joint| acceleration_rad_s2.min(joint.max_acceleration_rad_per_s2));
        self.axes.start(joints_deg.map(f64::to_radians), &speed, &acceleration, now);
    }

    fn go_on(&mut self, now: f64) {
        if let Some(point) = self.way_point.clone().filter(|_| self.is_held) {
            self.is_held = false;
            self.go(point.joints_deg, point.speed.to_radians(), point.acceleration.to_radians(), now);
        }
    }

    fn allows(&self, joints_deg: &[f64; 6]) -> bool {
        // Degrees with six decimals may lie that much beyond a limit in radians.
        let near = 1e-6;
        let mut joints = self.robot.joints.iter().zip(joints_deg);
        joints.all(|(joint, degrees)| (joint.min_rad - near..=joint.max_rad + near).contains(&degrees.to_radians()))
    }

    fn begin_path(&mut self, name: &str, speed_fraction: f64) -> Answer {
        let is_able = (0.01..=1.0).contains(&speed_fraction) && (self.paths.len() < MAX_PATHS || self.paths.contains_key(name));
        if !is_able {
            return Err(PARAMETER_ERROR);
        }
        self.paths.insert(name.to_owned(), HansPath { speed_fraction, ..HansPath::default() });
        Ok(Vec::new())
    }

    fn push_point(&mut self, name: &str, joints_deg: &[f64; 6]) -> Answer {
        let is_allowed = self.allows(joints_deg);
        let path =
            self.paths.get_mut(name).filter(|path| is_allowed && !path.is_ended && path.points_deg.len() < MAX_PATH_POINTS);
        path.ok_or(PARAMETER_ERROR)?.points_deg.push(*joints_deg);
        Ok(Vec::new())
    }

    fn end_path(&mut self, name: &str) -> Answer {
        let path = self.paths.get_mut(name).filter(|path| path.points_deg.len() >= MIN_PATH_POINTS).ok_or(PARAMETER_ERROR)?;
        path.is_ended = true;
        Ok(Vec::new())
    }

    /// Moves from point to point, stopping at each: blends are not modelled.
    fn move_path(&mut self, name: &str, now: f64) -> Answer {
        self.check_ready(now)?;
        let path = self.paths.get(name).filter(|path| path.is_ended).ok_or(PARAMETER_ERROR)?;
        self.override_fraction = path.speed_fraction;
        self.ahead_deg = path.points_deg.iter().rev().copied().collect();
        Ok(Vec::new())
    }

    /// Follows a servo target at once; one that is too far for the time since the last puts the arm in error.
    fn push_servo(&mut self, joints_deg: &[f64; 6], now: f64) -> Answer {
        let since = self.servo_since.ok_or(NOT_INITIALISED)?;
        let target = joints_deg.map(f64::to_radians);
        let secs = now - since + SERVO_BUNCH_SECS;
        let here = self.axes.positions(now);
        let mut joints = self.robot.joints.iter().zip(here.iter().zip(target));
        let is_near = joints.all(|(joint, (here, to))| (to - here).abs() <= MAX_SERVO_SPEED * joint.max_speed_rad_per_s * secs);
        if !is_near || !self.allows(joints_deg) {
            self.halt(now);
            self.error_code = PARAMETER_ERROR;
            return Err(PARAMETER_ERROR);
        }
        self.axes.place(target);
        self.servo_since = Some(now);
        Ok(Vec::new())
    }

    fn flags(&self, now: f64) -> RobotFlags {
        let is_moving = self.is_moving(now);
        RobotFlags {
            is_moving,
            is_enabled: self.is_enabled,
            error_code: self.error_code,
            error_axis: 0,
            are_brakes_open: self.is_enabled,
            is_paused: self.is_held,
            is_emergency_stop: self.faults.is_emergency_stop,
            is_guard_open: self.faults.is_guard_open,
            is_electrified: self.is_electrified,
            is_box_connected: true,
            is_blending_done: !is_moving,
            is_in_position: !is_moving,
        }
    }

    /// Flange in the base, mm and degrees: the rotation as roll, pitch and yaw, whose order the maker does not state.
    fn pose(&self, joints_rad: &[f64; 6]) -> [f64; 6] {
        let pose = *self.robot.base_from_flange(joints_rad).isometry();
        let (at, (roll, pitch, yaw)) = (pose.translation.vector, pose.rotation.euler_angles());
        [at.x, at.y, at.z, roll.to_degrees(), pitch.to_degrees(), yaw.to_degrees()]
    }

    fn position(&self, now: f64) -> ActualPosition {
        let joints_rad = self.axes.positions(now);
        ActualPosition { pose: self.pose(&joints_rad), joints_deg: joints_rad.map(f64::to_degrees) }
    }

    /// Binary state.
    pub(super) fn realtime(&self, cycle_ms: i32, now: f64) -> HansRealtimeState {
        let (joints_deg, speeds) = (self.axes.positions(now).map(f64::to_degrees), self.axes.speeds(now).map(f64::to_degrees));
        HansRealtimeState {
            cycle_ms,
            target_deg: joints_deg,
            target_deg_s: speeds,
            actual_deg: joints_deg,
            actual_deg_s: speeds,
            actual_tool: self.position(now).pose,
            speed_scaling: self.override_fraction,
            time_us: (now * 1e6) as u64,
            fsm: self.fsm(now),
        }
    }
}
