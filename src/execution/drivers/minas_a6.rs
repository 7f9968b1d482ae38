//! A table on a Panasonic MINAS A6 drive: block operation over Modbus. The drive's own communication time-out (Pr5.40) is set
//! when it is armed and stops it with Err80.0 when messages cease: the execution right, which is taken then, is what puts it
//! in force.
//!
//! A stop coil stays set after a stop, until the drive is armed again: nothing else starts it in between. With infinite
//! rotation, where positions repeat with every turn and an absolute block takes the shorter way round, moves are distances,
//! in blocks of less than half a turn.

mod moves;

use std::time::Duration;

use tokio::time::{Instant, sleep};

use super::modbus_link::ModbusLink;
use super::serial;
use super::stream::{NOT_ARMED, STOP_WAIT, Wiring, ms, not_connected, reconnected};
use super::table_units::TableUnits;
use crate::cell::{GatewayFraming, MinasA6Spec, WordOrder};
use crate::execution::device::{Condition, DeviceError, FaultCode, Identity, MotionDevice, TableState, Target};
use crate::execution::protocol::minas_a6::{
    ABSOLUTE_ENCODER, ACQUIRE_RIGHT, BLOCK_OPERATION, COMMUNICATION_TIMEOUT, ERROR_FORCED_ALARM, ERROR_SAFETY_INPUT,
    INFINITE_ROTATION, MULTI_TURN_LIMIT, OUTPUT_COUNT, RELEASE_RIGHT, RESOLUTIONS, coil, error_number, error_text, output,
    register, text_of,
};
use crate::execution::protocol::modbus::{ModbusFraming, ModbusRequest, values_of};

/// Longest wait for the servo to be on.
const SERVO_WAIT: Duration = Duration::from_secs(2);
/// Longest wait for a block to start.
const START_WAIT: Duration = Duration::from_millis(500);
/// Pause between questions while something is awaited.
const POLL: Duration = Duration::from_millis(5);
/// Words for a drive that is busy.
const BLOCK_RUNS: &str = "a block of the drive runs; wait until it has ended, or stop it at the drive";
/// Distance within which the drive's "in position" is believed to be of the last target, share of a turn: 0.2°.
const GOAL_SHARE: f64 = 0.2 / 360.0;

/// A table on a MINAS A6 drive.
#[derive(Debug)]
pub struct MinasA6Table {
    spec: MinasA6Spec,
    /// Acceleration that the table is rated for.
    max_acceleration_rad_s2: f64,
    units: TableUnits,
    wiring: Wiring,
    link: Option<ModbusLink>,
    /// The drive on the link is the one that connecting checked.
    is_checked: bool,
    /// Position last measured, turns counted.
    position: i64,
    goal: Option<i64>,
    is_armed: bool,
    switched_on_here: bool,
    /// Time-out that the drive had before it was armed, ms.
    found_timeout_ms: Option<i32>,
}

impl MinasA6Table {
    /// A table at the address of its specification, not connected; no ramp is above `max_acceleration_rad_s2`.
    #[must_use]
    pub fn new(spec: MinasA6Spec, max_acceleration_rad_s2: f64, wiring: Wiring) -> Self {
        let home = i64::from(spec.home_units);
        let units = TableUnits { per_turn: spec.units_per_turn.into(), home, is_reversed: spec.is_reversed };
        let (link, is_checked, goal) = (None, false, None);
        let (is_armed, switched_on_here, found_timeout_ms) = (false, false, None);
        Self {
            spec,
            max_acceleration_rad_s2,
            units,
            wiring,
            link,
            is_checked,
            position: home,
            goal,
            is_armed,
            switched_on_here,
            found_timeout_ms,
        }
    }

    fn link(&mut self) -> Result<&mut ModbusLink, DeviceError> {
        self.link.as_mut().ok_or_else(not_connected)
    }

    async fn open(&mut self, patience: Duration) -> Result<(), DeviceError> {
        let connection = match self.spec.address.strip_prefix("tcp://") {
            Some(address) => self.wiring.connect(address, patience).await?,
            None => {
                let line = serial::open(&self.spec.address, self.spec.baud, self.spec.parity);
                let unreachable = |error: std::io::Error| DeviceError::Unreachable {
                    address: self.spec.address.clone(),
                    reason: error.to_string(),
                };
                self.wiring.connection(line.map_err(unreachable)?)
            }
        };
        let framing = match self.spec.framing {
            GatewayFraming::Rtu => ModbusFraming::Rtu,
            GatewayFraming::Tcp => ModbusFraming::Tcp,
        };
        self.link = Some(ModbusLink::new(connection, framing, self.spec.node, ms(self.spec.reply_timeout_ms)));
        Ok(())
    }

    /// 32-bit values from a register on.
    async fn values(&mut self, address: u16, count: u16) -> Result<Vec<i32>, DeviceError> {
        let order = self.spec.word_order;
        self.link()?.values(address, count, order).await
    }

    async fn value(&mut self, address: u16) -> Result<i32, DeviceError> {
        let order = self.spec.word_order;
        self.link()?.value(address, order).await
    }

    async fn set_value(&mut self, address: u16, value: i32) -> Result<(), DeviceError> {
        let order = self.spec.word_order;
        self.link()?.set_value(address, value, order).await
    }

    /// Model, the first that is asked for. A gateway that takes other frames does not answer, or ends the connection.
    async fn model(&mut self) -> Result<String, DeviceError> {
        let answered = self.link()?.registers(register::MODEL, 8).await;
        let MinasA6Spec { address, framing, node, .. } = &self.spec;
        let hinted = |error: DeviceError| {
            let is_unanswered = matches!(error, DeviceError::Silent { .. } | DeviceError::Closed { .. });
            if is_unanswered && address.starts_with("tcp://") {
                DeviceError::Unanswered { error: Box::new(error), framing: framing.as_str(), node: *node }
            } else {
                error
            }
        };
        Ok(text_of(&answered.map_err(hinted)?))
    }

    async fn identity(&mut self) -> Result<Identity, DeviceError> {
        let model = self.model().await?;
        let firmware = text_of(&self.link()?.registers(register::SOFTWARE, 8).await?);
        if let Some(expected) = self.spec.model.clone().filter(|expected| !model.starts_with(expected)) {
            return Err(DeviceError::OtherDevice { expected, found: model });
        }
        Ok(Identity { maker: "Panasonic".into(), model, serial: None, firmware: Some(firmware) })
    }

    /// Reads the encoder's resolution, which is a known power of two in one order of words alone.
    async fn check_word_order(&mut self) -> Result<(), DeviceError> {
        let registers = self.link()?.registers(register::ENCODER_RESOLUTION, 2).await?;
        let read = |order: WordOrder| values_of(&registers, order).first().copied().unwrap_or_default();
        let configured = self.spec.word_order;
        let found = read(configured);
        if RESOLUTIONS.contains(&found) {
            return Ok(());
        }
        match WordOrder::ALL.into_iter().find(|order| RESOLUTIONS.contains(&read(*order))) {
            Some(other) => Err(DeviceError::WordOrder {
                configured: configured.as_str().into(),
                other: other.as_str().into(),
                found: found.into(),
            }),
            None => Err(DeviceError::Malformed { what: format!("an encoder of {found} counts a turn") }),
        }
    }

    /// Compares the drive's parameters with the specification.
    async fn check_parameters(&mut self) -> Result<(), DeviceError> {
        let not_ready = |reason: String| Err(DeviceError::NotReady { reason });
        let block_operation = self.value(BLOCK_OPERATION).await?;
        if block_operation != 1 {
            return not_ready(format!(
                "Pr6.28 is {block_operation}; set it to 1, block operation by Modbus, and switch the drive off and on"
            ));
        }
        let encoder = self.value(ABSOLUTE_ENCODER).await?;
        if (encoder == INFINITE_ROTATION) != self.spec.has_infinite_rotation {
            return not_ready(format!(
                "Pr0.15 is {encoder} and has_infinite_rotation is {}; 4 is infinite rotation: change one to match",
                self.spec.has_infinite_rotation
            ));
        }
        if !self.spec.has_infinite_rotation {
            return Ok(());
        }
        let turns = i64::from(self.value(MULTI_TURN_LIMIT).await?) + 1;
        if turns != self.spec.gear_ratio as i64 {
            return not_ready(format!(
                "Pr6.88 + 1 is {turns} and gear_ratio is {}; both are the motor's turns in one of the table: change one to \
                 match",
                self.spec.gear_ratio
            ));
        }
        Ok(())
    }

    /// Position that is asked for and position measured, turns counted.
    async fn positions(&mut self) -> Result<(i64, i64), DeviceError> {
        // Asked for, internal and measured: two registers each, from 600Bh on.
        let values = self.values(register::POSITION_DEMAND, 3).await?;
        let &[demand, _, actual] = values.as_slice() else {
            return Err(DeviceError::Malformed { what: format!("{} values where 3 positions were due", values.len()) });
        };
        let (mut demand, mut actual) = (demand.into(), actual.into());
        if self.spec.has_infinite_rotation {
            actual = self.units.unwrapped(actual, self.position);
            demand = self.units.unwrapped(demand, actual);
        }
        self.position = actual;
        Ok((demand, actual))
    }

    async fn is_busy(&mut self) -> Result<bool, DeviceError> {
        Ok(self.link()?.coils(coil::BUSY, 1).await?.first().copied().unwrap_or(true))
    }

    async fn outputs(&mut self) -> Result<Vec<bool>, DeviceError> {
        self.link()?.coils(coil::OUTPUTS, OUTPUT_COUNT).await
    }

    async fn fault(&mut self) -> Result<Option<u32>, DeviceError> {
        let error = self.link()?.registers(register::ERROR, 1).await?.first().copied().unwrap_or_default();
        Ok((error != 0).then(|| error_number(error)))
    }

    /// Error unless the drive is without fault.
    async fn check_fault(&mut self) -> Result<(), DeviceError> {
        match self.fault().await? {
            Some(code) => Err(DeviceError::Fault { code, text: error_text(code).to_owned() }),
            None => Ok(()),
        }
    }

    /// Sets the drive's time-out and takes the right that puts it in force.
    async fn take_right(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        let wanted = i32::try_from(watchdog.as_millis()).unwrap_or(i32::MAX);
        let found = self.value(COMMUNICATION_TIMEOUT).await?;
        self.found_timeout_ms.get_or_insert(found);
        if found != wanted {
            self.set_value(COMMUNICATION_TIMEOUT, wanted).await?;
        }
        let set = self.value(COMMUNICATION_TIMEOUT).await?;
        if set != wanted {
            let reason = format!("Pr5.40 is {set} ms after {wanted} ms were written; see whether another master writes it");
            return Err(DeviceError::NotReady { reason });
        }
        self.link()?.set_register(register::EXECUTION_RIGHT, ACQUIRE_RIGHT).await
    }

    async fn clear_coils(&mut self) -> Result<(), DeviceError> {
        for address in [coil::STROBE, coil::IMMEDIATE_STOP, coil::DECELERATION_STOP] {
            self.link()?.set_coil(address, false).await?;
        }
        Ok(())
    }

    async fn switch_on(&mut self) -> Result<(), DeviceError> {
        if !self.outputs().await?[output::MOTOR_FREE] {
            return Ok(());
        }
        if !self.spec.switches_servo {
            return Err(DeviceError::NotReady { reason: "the servo is off; switch it on at the drive".into() });
        }
        // Before it is sent: whoever gives the answer up, or gets none, leaves a servo that comes on all the same.
        self.switched_on_here = true;
        self.link()?.set_coil(coil::SERVO_ON, true).await?;
        let deadline = Instant::now() + SERVO_WAIT;
        while self.outputs().await?[output::MOTOR_FREE] {
            if Instant::now() >= deadline {
                return Err(DeviceError::NotReady {
                    reason: "the servo does not come on; check main power and safety input".into(),
                });
            }
            sleep(POLL).await;
        }
        Ok(())
    }

    async fn stop_once(&mut self, patience: Duration, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        let stop = ModbusRequest::WriteCoil { address: coil::DECELERATION_STOP, on: true };
        self.link()?.stop(&stop, patience, sent_at).await
    }

    /// Stops without deceleration: the coil H-STOP.
    ///
    /// # Errors
    /// [`DeviceError`].
    pub async fn stop_at_once(&mut self) -> Result<(), DeviceError> {
        self.is_armed = false;
        self.link()?.set_coil(coil::IMMEDIATE_STOP, true).await
    }

    /// Gives back what arming took.
    async fn give_back(&mut self) -> Result<(), DeviceError> {
        let cleared = self.link()?.set_coil(coil::STROBE, false).await;
        // The servo is switched off whatever became of the strobe.
        if std::mem::take(&mut self.switched_on_here) {
            self.link()?.set_coil(coil::SERVO_ON, false).await?;
        }
        cleared?;
        if let Some(found) = self.found_timeout_ms.take() {
            self.set_value(COMMUNICATION_TIMEOUT, found).await?;
            self.link()?.set_register(register::EXECUTION_RIGHT, RELEASE_RIGHT).await?;
        }
        // A stop coil that stays set keeps others from starting the drive.
        if self.is_busy().await? { Ok(()) } else { self.clear_coils().await }
    }
}

impl MotionDevice<1> for MinasA6Table {
    async fn connect(&mut self) -> Result<Identity, DeviceError> {
        (self.link, self.is_checked, self.is_armed, self.goal) = (None, false, false, None);
        self.open(ms(self.spec.connect_timeout_ms)).await?;
        let identity = self.identity().await?;
        self.check_word_order().await?;
        self.check_parameters().await?;
        self.position = self.units.home;
        self.positions().await?;
        self.is_checked = true;
        Ok(identity)
    }

    async fn state(&mut self) -> Result<TableState, DeviceError> {
        let (is_busy, outputs, fault) = (self.is_busy().await?, self.outputs().await?, self.fault().await?);
        // Measured later than this.
        let at = Instant::now();
        let (_, actual) = self.positions().await?;
        let is_at_goal = self.goal.is_none_or(|goal| self.is_near(actual, goal));
        let in_position = outputs[output::IN_POSITION] && !is_busy;
        let condition = Condition {
            powered: !outputs[output::MOTOR_FREE],
            brakes_open: outputs[output::BRAKE_RELEASED],
            moving: is_busy || !outputs[output::IN_POSITION],
            in_position: in_position && is_at_goal,
            emergency_stop: fault == Some(ERROR_FORCED_ALARM),
            guard_open: fault == Some(ERROR_SAFETY_INPUT),
            hand_guided: false,
            paused: false,
            fault: fault.map(FaultCode),
        };
        Ok(TableState { at, positions_rad: [self.units.angle_rad(actual)], condition })
    }

    async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
        self.goal = None;
        if !self.is_checked {
            return Err(reconnected());
        }
        self.check_fault().await?;
        if self.is_busy().await? {
            return Err(DeviceError::NotReady { reason: BLOCK_RUNS.into() });
        }
        self.take_right(watchdog).await?;
        self.clear_coils().await?;
        self.switch_on().await?;
        self.is_armed = true;
        Ok(())
    }

    async fn start(&mut self, target: &Target<1>) -> Result<(), DeviceError> {
        if !self.is_armed {
            return Err(DeviceError::NotReady { reason: NOT_ARMED.into() });
        }
        self.start_blocks(target).await
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        self.is_busy().await.map(drop)
    }

    async fn stop(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        self.is_armed = false;
        let first = self.stop_once(STOP_WAIT, sent_at).await;
        if first.is_ok() {
            return first;
        }
        // The table may be moving on a link that is gone: the stop alone is worth a new one.
        (self.link, self.is_checked) = (None, false);
        let patience = ms(self.spec.reply_timeout_ms);
        self.open(patience).await?;
        self.stop_once(patience, sent_at).await
    }

    async fn release(&mut self) -> Result<(), DeviceError> {
        self.is_armed = false;
        let given = if self.link.is_some() { self.give_back().await } else { Ok(()) };
        if let Some(link) = self.link.take() {
            link.close().await;
        }
        given
    }

    fn fault_text(&self, fault: FaultCode) -> Option<&'static str> {
        Some(error_text(fault.0))
    }
}

#[cfg(test)]
mod tests;
