//! Han's controllers in program mode (port 10003): one way point at a time, so that the arm holds at most one move when this
//! process ends. The controller documents no stop for a lost client: what it was sent, it finishes. With servo streaming
//! configured, moves are streamed instead (port 8892) and end with the stream; a session that gives no sign of life within the
//! watchdog's time has them ramped down.
//!
//! Replies come in the order of the requests, so a request that was given up leaves its reply to be thrown away, and nothing
//! else.

mod link;
mod servo;
mod signals;

use std::time::Duration;

use nalgebra::{Rotation3, Vector3};
use tokio::time::{Instant, sleep};

use self::link::TextLink;
use self::servo::{ServoStream, realtime_state};
pub use self::signals::HansSignals;
use super::stream::{NOT_ARMED, STOP_WAIT, Wiring, ms, not_connected, reconnected, within};
use crate::cell::{HansServoSpec, HansSpec, Kinematics};
use crate::execution::device::{ArmState, Condition, DeviceError, FaultCode, Identity, MotionDevice, Target};
use crate::execution::protocol::hans::{
    ActualPosition, FSM_DISABLED, FSM_STANDBY, HansCommand, HansRequest, HansWayPoint, RobotFlags, error_text, fsm_text,
    is_hand_guided_fsm, position_mm,
};
use crate::execution::session::streamer::Jitter;

/// Longest wait for the drives to be enabled.
const ENABLE_WAIT: Duration = Duration::from_secs(10);
/// Distance within which the controller's "in position" is believed to be of the last target, degrees.
const TARGET_TOLERANCE_DEG: f64 = 0.2;
/// Joints at which the controller's kinematics are compared with the cell's, degrees. A constant turn about axis 1 between
/// the two base frames is left; joint 6 does not show, for the flange's origin lies on its axis.
const PROBES_DEG: [[f64; 6]; 3] =
    [[0.0, -20.0, 70.0, 10.0, 40.0, 0.0], [40.0, 10.0, 60.0, -30.0, 50.0, 20.0], [-70.0, -40.0, 100.0, 60.0, -30.0, 90.0]];

/// An arm on Han's controller.
#[derive(Debug)]
pub struct HansArm {
    spec: HansSpec,
    kinematics: Kinematics,
    wiring: Wiring,
    link: Option<TextLink>,
    /// The controller on the link is the one that connecting checked.
    is_checked: bool,
    is_armed: bool,
    enabled_here: bool,
    goal_deg: Option<[f64; 6]>,
    servo: Option<ServoStream>,
}

impl HansArm {
    /// An arm at the address of its specification, not connected.
    #[must_use]
    pub fn new(spec: HansSpec, kinematics: Kinematics, wiring: Wiring) -> Self {
        let (link, goal_deg, servo) = (None, None, None);
        Self { spec, kinematics, wiring, link, is_checked: false, is_armed: false, enabled_here: false, goal_deg, servo }
    }

    /// Values that a request is answered with. A link that failed is not used again.
    async fn ask(&mut self, request: &HansRequest) -> Result<Vec<String>, DeviceError> {
        let link = self.link.as_mut().ok_or_else(not_connected)?;
        let answer = link.ask(request).await;
        if matches!(answer, Err(DeviceError::Closed { .. } | DeviceError::Malformed { .. })) {
            self.link = None;
        }
        answer
    }

    async fn command(&mut self, command: HansCommand) -> Result<Vec<String>, DeviceError> {
        self.ask(&HansRequest::Plain(command)).await
    }

    async fn open(&mut self, patience: Duration) -> Result<(), DeviceError> {
        let connection = self.wiring.connect(&self.spec.address, patience).await?;
        self.link = Some(TextLink::new(connection, ms(self.spec.reply_timeout_ms)));
        Ok(())
    }

    async fn fsm(&mut self) -> Result<i32, DeviceError> {
        let values = self.command(HansCommand::ReadCurFsm).await?;
        values.first().and_then(|value| value.parse().ok()).ok_or_else(|| malformed("ReadCurFSM", &values))
    }

    async fn identity(&mut self) -> Result<Identity, DeviceError> {
        let model = self.command(HansCommand::ReadRobotModel).await?.into_iter().next().unwrap_or_default();
        let firmware = self.command(HansCommand::ReadVersion).await?.into_iter().next();
        let expected = self.spec.model.clone().unwrap_or_default();
        if !model.to_lowercase().contains(&expected.to_lowercase()) {
            return Err(DeviceError::OtherDevice { expected, found: model });
        }
        Ok(Identity { maker: "Han's".into(), model, serial: None, firmware })
    }

    /// Compares the controller's kinematics with the cell's.
    async fn check_kinematics(&mut self) -> Result<(), DeviceError> {
        let mut turn = None;
        for joints_deg in PROBES_DEG {
            let values = self.ask(&HansRequest::Acs2Pcs { joints_deg, tool: [0.0; 6], user_frame: [0.0; 6] }).await?;
            let theirs = Vector3::from(position_mm(&values).ok_or_else(|| malformed("ACS2PCS", &values))?);
            let flange = self.kinematics.base_from_flange(&joints_deg.map(f64::to_radians));
            let ours = flange.isometry().translation.vector;
            let azimuth = theirs.y.atan2(theirs.x) - ours.y.atan2(ours.x);
            let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), *turn.get_or_insert(azimuth)) * ours;
            if (turned - theirs).norm() > self.spec.kinematics_tolerance_mm {
                return Err(DeviceError::OtherDevice {
                    expected: format!("the flange at {} mm for joints {joints_deg:?}°", shown(&turned)),
                    found: format!("a controller that has it at {} mm", shown(&theirs)),
                });
            }
        }
        Ok(())
    }

    /// Waits until the drives are enabled.
    async fn enable(&mut self) -> Result<i32, DeviceError> {
        // Before it is sent: whoever gives the reply up, or gets none, leaves drives that are enabled all the same.
        self.enabled_here = true;
        self.command(HansCommand::GrpPowerOn).await?;
        let deadline = Instant::now() + ENABLE_WAIT;
        loop {
            let fsm = self.fsm().await?;
            if fsm == FSM_STANDBY || Instant::now() >= deadline {
                return Ok(fsm);
            }
            sleep(ms(self.spec.poll_ms)).await;
        }
    }

    /// The move as the controller takes it: speed and acceleration of the joint that turns furthest, with which the others
    /// keep step.
    fn way_point(&self, target: &Target<6>) -> Result<HansWayPoint, DeviceError> {
        let joints_deg = target.positions_rad.map(f64::to_degrees);
        let max = |values: [f64; 6]| values.into_iter().fold(0.0, f64::max).to_degrees();
        let (speed, acceleration) = (max(target.max_speed_rad_s), max(target.max_acceleration_rad_s2));
        if !joints_deg.iter().chain([&speed, &acceleration]).all(|value| value.is_finite()) {
            return Err(DeviceError::Unsupported { what: "move to a target that is not a number; plan again".into() });
        }
        Ok(HansWayPoint {
            pose: [0.0; 6],
            joints_deg,
            tool: self.spec.tool.clone(),
            user_frame: self.spec.user_frame.clone(),
            speed,
            acceleration,
            radius_mm: 0.0,
            is_linear: false,
            is_joint_target: true,
            command_id: format!("V{}", target.sequence),
        })
    }

    /// Begins to stream the joints where the arm stands, once the controller's cycle is the one configured.
    async fn begin_servo(&mut self, spec: &HansServoSpec, watchdog: Duration) -> Result<(), DeviceError> {
        let cycle_ms = realtime_state(spec, &self.wiring, ms(self.spec.connect_timeout_ms)).await?.cycle_ms;
        if i64::from(cycle_ms) != i64::from(spec.period_ms) {
            let reason = format!("its cycle is {cycle_ms} ms and servo.period_ms is {}; set one to the other", spec.period_ms);
            return Err(DeviceError::NotReady { reason });
        }
        let position = self.position().await?;
        self.servo = Some(ServoStream::begin(spec, position.joints_deg, watchdog, &self.wiring).await?);
        Ok(())
    }

    /// Nothing is pushed from here on; returns false where nothing was.
    async fn end_servo(&mut self) -> bool {
        let Some(servo) = self.servo.take() else { return false };
        servo.end().await;
        true
    }

    /// Ends the stream, if there is one, by a stop: to the controller a stream that stands is a motion, and without a stop it
    /// stays in it.
    async fn leave_servo(&mut self) -> Result<(), DeviceError> {
        if self.end_servo().await && self.link.is_some() { self.command(HansCommand::GrpStop).await.map(drop) } else { Ok(()) }
    }

    async fn position(&mut self) -> Result<ActualPosition, DeviceError> {
        let values = self.command(HansCommand::ReadActPos).await?;
        ActualPosition::read(&values).ok_or_else(|| malformed("ReadActPos", &values))
    }

    /// Sends a stop over the link that there is.
    async fn stop_once(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        let link = self.link.as_mut().ok_or_else(not_connected)?;
        let stop = HansRequest::Plain(HansCommand::GrpStop);
        link.send(&stop).await?;
        sent_at.get_or_insert_with(Instant::now);
        link.reply(&stop).await?;
        Ok(Instant::now())
    }
}

impl MotionDevice<6> for HansArm {
    async fn connect(&mut self) -> Result<Identity, DeviceError> {
        self.end_servo().await;
        (self.link, self.is_checked, self.is_armed, self.goal_deg) = (None, false, false, None);
        self.open(ms(self.spec.connect_timeout_ms)).await?;
        let identity = self.identity().await?;
        self.check_kinematics().await?;
        self.is_checked = true;
        Ok(identity)
    }

    async fn state(&mut self) -> Result<ArmState, DeviceError> {
        // Whoever reads the state is there: a table that answers slowly takes most of the watchdog's time between two feeds.
        if let Some(servo) = &self.servo {
            servo.feed();
        }
        let values = self.command(HansCommand::ReadRobotState).await?;
        let flags = RobotFlags::read(&values).ok_or_else(|| malformed("ReadRobotState", &values))?;
        let fsm = self.fsm().await?;
        // Measured later than this.
        let at = Instant::now();
        let position = self.position().await?;
        let is_at_goal = is_at(&position.joints_deg, self.goal_deg.as_ref());
        let mut condition = condition(&flags, fsm, is_at_goal);
        if let Some(servo) = &self.servo {
            // To the controller, a stream that stands is a motion too.
            condition.moving = servo.is_under_way() || !is_at_goal;
            condition.in_position = !condition.moving;
        }
        Ok(ArmState { at, positions_rad: position.joints_deg.map(f64::to_radians), condition })
    }

    async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        self.leave_servo().await?;
        self.goal_deg = None;
        if !self.is_checked {
            return Err(reconnected());
        }
        let mut fsm = self.fsm().await?;
        if fsm == FSM_DISABLED && self.spec.enables_drives {
            fsm = self.enable().await?;
        }
        if fsm != FSM_STANDBY {
            return Err(DeviceError::NotReady {
                reason: format!("{} (state {fsm}); make it ready at the pendant", fsm_text(fsm)),
            });
        }
        if let Some(fraction) = self.spec.override_fraction {
            self.ask(&HansRequest::SetOverride { fraction }).await?;
        }
        if let Some(spec) = self.spec.servo.clone() {
            self.begin_servo(&spec, watchdog).await?;
        }
        self.is_armed = true;
        Ok(())
    }

    async fn start(&mut self, target: &Target<6>) -> Result<(), DeviceError> {
        if !self.is_armed {
            return Err(DeviceError::NotReady { reason: NOT_ARMED.into() });
        }
        let point = self.way_point(target)?;
        // Whether it was accepted stays open where no reply comes: then it counts as accepted.
        let previous = self.goal_deg.replace(point.joints_deg);
        if point.speed <= 0.0 {
            return Ok(());
        }
        if let Some(servo) = &self.servo {
            return servo.lead(target);
        }
        let accepted = self.ask(&HansRequest::WayPoint(Box::new(point))).await;
        if matches!(accepted, Err(DeviceError::Refused { .. })) {
            self.goal_deg = previous;
        }
        accepted.map(drop)
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        if let Some(servo) = &self.servo {
            servo.feed();
        }
        // The controller has no watchdog in program mode: this notices a lost link.
        self.fsm().await?;
        self.servo.as_ref().map_or(Ok(()), ServoStream::check)
    }

    async fn stop(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        self.is_armed = false;
        self.end_servo().await;
        let first = within(STOP_WAIT, self.stop_once(sent_at)).await;
        if first.is_ok() {
            return first;
        }
        // The arm may be moving on a link that is gone: the stop alone is worth a new one. The old one is given up first, so that
        // nothing which waits on it comes after the stop.
        (self.link, self.is_checked) = (None, false);
        self.open(ms(self.spec.reply_timeout_ms)).await?;
        self.stop_once(sent_at).await
    }

    async fn release(&mut self) -> Result<(), DeviceError> {
        self.is_armed = false;
        // The drives are disabled even where the controller does not answer this.
        let left = within(STOP_WAIT, self.leave_servo()).await;
        let disabled = if std::mem::take(&mut self.enabled_here) && self.link.is_some() {
            self.command(HansCommand::GrpPowerOff).await.map(drop)
        } else {
            Ok(())
        };
        if let Some(link) = self.link.take() {
            link.close().await;
        }
        left.and(disabled)
    }

    fn jitter(&self) -> Option<Jitter> {
        self.servo.as_ref().map(ServoStream::jitter)
    }

    fn fault_text(&self, fault: FaultCode) -> Option<&'static str> {
        Some(error_text(if fault == UNNAMED_FAULT { -1 } else { fault.0.into() }))
    }
}

/// Fault of a robot that is in error without a code.
const UNNAMED_FAULT: FaultCode = FaultCode(u32::MAX);
/// States in which the controller has an error.
const ERROR_STATES: [i32; 4] = [17, 20, 21, 22];

/// Condition of an arm.
fn condition(flags: &RobotFlags, fsm: i32, is_at_goal: bool) -> Condition {
    let coded = (flags.error_code != 0).then(|| u32::try_from(flags.error_code).map_or(UNNAMED_FAULT, FaultCode));
    Condition {
        powered: flags.is_electrified && flags.is_enabled,
        brakes_open: flags.are_brakes_open,
        moving: flags.is_moving,
        in_position: flags.is_blending_done && flags.is_in_position && !flags.is_moving && is_at_goal,
        emergency_stop: flags.is_emergency_stop,
        guard_open: flags.is_guard_open,
        hand_guided: is_hand_guided_fsm(fsm),
        paused: flags.is_paused,
        fault: coded.or(ERROR_STATES.contains(&fsm).then_some(UNNAMED_FAULT)),
    }
}

/// Returns true if the joints are at the target, or there is no target.
fn is_at(joints_deg: &[f64; 6], goal_deg: Option<&[f64; 6]>) -> bool {
    let near = |goal: &[f64; 6]| joints_deg.iter().zip(goal).all(|(joint, goal)| (joint - goal).abs() <= TARGET_TOLERANCE_DEG);
    goal_deg.is_none_or(near)
}

fn malformed(command: &str, values: &[String]) -> DeviceError {
    DeviceError::Malformed { what: format!("{command}: {}", values.join(",").chars().take(80).collect::<String>()) }
}

/// Millimetres of a point.
fn shown(point_mm: &Vector3<f64>) -> String {
    format!("({:.1}, {:.1}, {:.1})", point_mm.x, point_mm.y, point_mm.z)
}

#[cfg(test)]
mod tests;
