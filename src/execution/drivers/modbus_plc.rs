//! A table behind a PLC, Modbus TCP, by the register map of its specification. The PLC stops the table by itself when the
//! heartbeat ceases, if it has one.

use std::time::Duration;

use tokio::time::Instant;

use super::modbus_link::ModbusLink;
use super::stream::{NOT_ARMED, STOP_WAIT, Wiring, ms, not_connected, reconnected};
use super::table_units::{TableUnits, whole_units};
use crate::cell::ModbusPlcSpec;
use crate::execution::device::{Condition, DeviceError, FaultCode, Identity, MotionDevice, TableState, Target};
use crate::execution::protocol::modbus::{ModbusFraming, ModbusRequest};

/// Bit of the command that starts a move.
const START: u16 = 1;
/// Bit of the command that stops.
const STOP: u16 = 2;
/// Fault of a PLC that has no register for its number.
const UNNUMBERED_FAULT: u32 = 1;
/// Distance within which the PLC's "in position" is believed to be of the last target, share of a turn: 0.2°.
const GOAL_SHARE: f64 = 0.2 / 360.0;

/// A table behind a PLC.
#[derive(Debug)]
pub struct PlcTable {
    spec: ModbusPlcSpec,
    units: TableUnits,
    wiring: Wiring,
    link: Option<ModbusLink>,
    /// The controller on the link is the one that connecting found.
    is_checked: bool,
    goal: Option<i64>,
    is_armed: bool,
    beat: u16,
}

impl PlcTable {
    /// A table at the address of its specification, not connected.
    #[must_use]
    pub fn new(spec: ModbusPlcSpec, wiring: Wiring) -> Self {
        let units =
            TableUnits { per_turn: spec.units_per_turn.into(), home: spec.home_units.into(), is_reversed: spec.is_reversed };
        Self { spec, units, wiring, link: None, is_checked: false, goal: None, is_armed: false, beat: 0 }
    }

    fn link(&mut self) -> Result<&mut ModbusLink, DeviceError> {
        self.link.as_mut().ok_or_else(not_connected)
    }

    async fn open(&mut self, patience: Duration) -> Result<(), DeviceError> {
        let connection = self.wiring.connect(&self.spec.address, patience).await?;
        self.link = Some(ModbusLink::new(connection, ModbusFraming::Tcp, self.spec.unit, ms(self.spec.reply_timeout_ms)));
        Ok(())
    }

    async fn status(&mut self) -> Result<PlcStatus, DeviceError> {
        let address = self.spec.state_register;
        let bits = self.link()?.registers(address, 1).await?.first().copied().unwrap_or_default();
        Ok(PlcStatus(bits))
    }

    async fn set_value(&mut self, address: u16, value: i32) -> Result<(), DeviceError> {
        let order = self.spec.word_order;
        self.link()?.set_value(address, value, order).await
    }

    async fn set_command(&mut self, command: u16) -> Result<(), DeviceError> {
        let address = self.spec.command_register;
        self.link()?.set_register(address, command).await
    }

    async fn stop_once(&mut self, patience: Duration, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
        let stop = ModbusRequest::WriteRegister { address: self.spec.command_register, value: STOP };
        self.link()?.stop(&stop, patience, sent_at).await
    }

    /// Units of a speed or an acceleration, of a turn that is predicted to last so long.
    fn rate(&self, rad: f64, unit: &str, duration: Duration) -> Result<i32, DeviceError> {
        whole_units(rad * self.units.per_turn / std::f64::consts::TAU, unit, f64::from(i32::MAX), duration)
            .map(|units| units as i32)
    }
}

/// Bits of the state.
#[derive(Clone, Copy, Debug)]
struct PlcStatus(u16);

impl PlcStatus {
    fn bit(self, bit: u16) -> bool {
        self.0 >> bit & 1 == 1
    }

    fn is_ready(self) -> bool {
        self.bit(0)
    }

    fn is_moving(self) -> bool {
        self.bit(1)
    }

    fn has_fault(self) -> bool {
        self.bit(3)
    }
}

impl MotionDevice<1> for PlcTable {
    async fn connect(&mut self) -> Result<Identity, DeviceError> {
        (self.link, self.is_checked, self.is_armed, self.goal) = (None, false, false, None);
        self.open(ms(self.spec.connect_timeout_ms)).await?;
        self.status().await?;
        self.is_checked = true;
        Ok(Identity { maker: "PLC".into(), model: "Modbus TCP".into(), serial: None, firmware: None })
    }

    async fn state(&mut self) -> Result<TableState, DeviceError> {
        let status = self.status().await?;
        let fault = match (status.has_fault(), self.spec.fault_register) {
            (false, _) => None,
            (true, None) => Some(UNNUMBERED_FAULT),
            (true, Some(address)) => self.link()?.registers(address, 1).await?.first().map(|number| (*number).into()),
        };
        // Measured later than this.
        let at = Instant::now();
        let (address, order) = (self.spec.position_register, self.spec.word_order);
        let position = i64::from(self.link()?.value(address, order).await?);
        let is_at = |goal: i64| (position - goal).abs() as f64 <= GOAL_SHARE * self.units.per_turn;
        let condition = Condition {
            powered: status.is_ready(),
            brakes_open: status.is_ready(),
            moving: status.is_moving(),
            in_position: status.bit(2) && !status.is_moving() && self.goal.is_none_or(is_at),
            emergency_stop: status.bit(4),
            guard_open: status.bit(5),
            hand_guided: false,
            paused: false,
            fault: fault.map(FaultCode),
        };
        Ok(TableState { at, positions_rad: [self.units.angle_rad(position)], condition })
    }

    async fn arm(&mut self, _watchdog: Duration) -> Result<(), DeviceError> {
        self.goal = None;
        if !self.is_checked {
            return Err(reconnected());
        }
        self.set_command(0).await?;
        let status = self.status().await?;
        if !status.is_ready() || status.is_moving() || status.has_fault() {
            return Err(DeviceError::NotReady {
                reason: format!("the PLC's state is {:#08b}; make the table ready there", status.0),
            });
        }
        self.is_armed = true;
        self.keep_alive().await
    }

    async fn start(&mut self, target: &Target<1>) -> Result<(), DeviceError> {
        if !self.is_armed {
            return Err(DeviceError::NotReady { reason: NOT_ARMED.into() });
        }
        let goal = self.units.position(target.positions_rad[0])?;
        let too_far = || DeviceError::Unsupported {
            what: format!("turn to {goal} units, more than 32 bits hold; check units_per_turn and home_units in the cell file"),
        };
        let units = i32::try_from(goal).map_err(|_| too_far())?;
        self.goal = Some(goal);
        if target.max_speed_rad_s[0] <= 0.0 {
            return Ok(());
        }
        let speed = self.rate(target.max_speed_rad_s[0], "units/s", target.duration)?;
        // The ramps are the smaller part of a turn.
        let acceleration = match self.spec.acceleration_register {
            Some(address) => Some((address, self.rate(target.max_acceleration_rad_s2[0], "units/s²", Duration::ZERO)?)),
            None => None,
        };
        self.set_value(self.spec.target_register, units).await?;
        self.set_value(self.spec.speed_register, speed).await?;
        if let Some((address, acceleration)) = acceleration {
            self.set_value(address, acceleration).await?;
        }
        self.set_command(0).await?;
        self.set_command(START).await
    }

    async fn keep_alive(&mut self) -> Result<(), DeviceError> {
        let Some(address) = self.spec.heartbeat_register else { return self.status().await.map(drop) };
        self.beat = self.beat.wrapping_add(1);
        let beat = self.beat;
        self.link()?.set_register(address, beat).await
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
        if let Some(link) = self.link.take() {
            link.close().await;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
