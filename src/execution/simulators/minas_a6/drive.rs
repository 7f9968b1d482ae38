//! The drive behind the line: coils, registers, blocks, alarms, time-out.

use std::collections::BTreeMap;

use super::DriveSetup;
use crate::cell::WordOrder;
use crate::execution::protocol::minas_a6::{
    ABSOLUTE_ENCODER, ACQUIRE_RIGHT, BLOCK_OPERATION, BlockTravel, COMMUNICATION_TIMEOUT, ERROR_FORCED_ALARM, ERROR_SAFETY_INPUT,
    ERROR_TIMEOUT, INFINITE_ROTATION, MULTI_TURN_LIMIT, MoveBlock, RAMP_R_PER_MIN, RELEASE_RIGHT, RESOLUTIONS, coil,
    error_register, output, register, registers_of_text,
};
use crate::execution::protocol::modbus::{ModbusReply, ModbusRequest, registers_of, values_of};
use crate::execution::simulators::faults::{DeviceLook, FaultState};
use crate::execution::simulators::motion::MovingAxes;

/// Exception: no such address.
const NO_ADDRESS: u8 = 2;
/// Exception: a value that is not allowed.
const WRONG_VALUE: u8 = 3;
/// Error of a block without a command, or with a speed or a ramp of zero.
const ERROR_BLOCK_DATA: u32 = 9301;
/// Error of a start while another block runs, or with the servo off.
const ERROR_BLOCK_OPERATION: u32 = 9400;
/// Time from the servo's coil to a motor with current.
const SERVO_ON_SECS: f64 = 0.05;
/// Time that the alarm's coil is held to clear it.
const CLEAR_SECS: f64 = 0.12;
/// Model that it gives itself.
const MODEL: &str = "MADLT15SF";
/// Version of its software.
const SOFTWARE: &str = "SIM1.00";

/// A simulated drive. Positions are units, turns counted.
#[derive(Debug)]
pub(super) struct SimulatedDrive {
    setup: DriveSetup,
    axis: MovingAxes<1>,
    faults: FaultState,
    error: u32,
    servo_on_since: Option<f64>,
    clear_since: Option<f64>,
    strobe: bool,
    immediate_stop: bool,
    deceleration_stop: bool,
    has_right: bool,
    heard: f64,
    block_number: u16,
    /// Block under way, and whether another follows.
    running: Option<(u8, bool)>,
    rates: [u16; 0x30],
    parameters: BTreeMap<u16, i32>,
    blocks: Vec<[i32; 2]>,
}

impl SimulatedDrive {
    pub(super) fn new(setup: &DriveSetup) -> Self {
        let encoder = if setup.has_infinite_rotation { INFINITE_ROTATION } else { 0 };
        let parameters = [
            (BLOCK_OPERATION, 1),
            (ABSOLUTE_ENCODER, encoder),
            (MULTI_TURN_LIMIT, setup.gear_ratio as i32 - 1),
            (COMMUNICATION_TIMEOUT, 0),
        ];
        Self {
            setup: *setup,
            axis: MovingAxes::at([setup.position.into()]),
            faults: FaultState::default(),
            error: 0,
            servo_on_since: None,
            clear_since: None,
            strobe: false,
            immediate_stop: false,
            deceleration_stop: false,
            has_right: false,
            heard: 0.0,
            block_number: 0,
            running: None,
            rates: [0; 0x30],
            parameters: parameters.into(),
            blocks: vec![[0; 2]; 256],
        }
    }

    pub(super) fn position(&self, now: f64) -> f64 {
        self.axis.positions(now)[0]
    }

    pub(super) fn look(&self, now: f64) -> DeviceLook {
        let turns = self.position(now) / f64::from(self.setup.units_per_turn);
        let error = (self.error != 0).then_some(self.error);
        DeviceLook { positions_deg: vec![360.0 * turns], is_moving: self.axis.is_moving(now), error }
    }

    fn order(&self) -> WordOrder {
        if self.faults.swaps_words { WordOrder::HighFirst } else { WordOrder::LowFirst }
    }

    /// Lets time and faults act.
    pub(super) fn pass(&mut self, faults: &FaultState, now: f64) {
        if faults.resets > self.faults.resets {
            self.error = 0;
        }
        self.faults = *faults;
        let timeout_ms = self.parameters.get(&COMMUNICATION_TIMEOUT).copied().unwrap_or(0);
        let silent_ms = 1e3 * (now - self.heard) / self.setup.factor;
        if self.has_right && timeout_ms > 0 && silent_ms > f64::from(timeout_ms) {
            // It stopped when the time was over, not when somebody looks.
            let at = self.heard + 1e-3 * f64::from(timeout_ms) * self.setup.factor;
            self.raise(ERROR_TIMEOUT, at);
        }
        if faults.is_emergency_stop {
            self.raise(ERROR_FORCED_ALARM, now);
        }
        if faults.is_guard_open {
            self.raise(ERROR_SAFETY_INPUT, now);
        }
        if let Some(alarm) = faults.alarm {
            self.raise(alarm, now);
        }
        if !self.axis.is_moving(now)
            && let Some((block, is_followed)) = self.running.take()
            && is_followed
        {
            self.run(block.wrapping_add(1), now);
        }
    }

    /// Puts the drive into an error, if it is in none: the motor stops and loses its current.
    fn raise(&mut self, error: u32, now: f64) {
        if self.error == 0 {
            self.error = error;
        }
        self.brake(now);
        self.servo_on_since = None;
    }

    fn brake(&mut self, now: f64) {
        self.axis.brake(now);
        if let Some((_, is_followed)) = &mut self.running {
            *is_followed = false;
        }
    }

    fn has_current(&self, now: f64) -> bool {
        self.servo_on_since.is_some_and(|since| now >= since + SERVO_ON_SECS)
    }

    /// Answers a request, or refuses it with an exception.
    pub(super) fn answer(&mut self, request: &ModbusRequest, now: f64) -> Result<ModbusReply, u8> {
        self.heard = now;
        match request {
            ModbusRequest::ReadCoils { address, count } => {
                let coils = range(*address, *count).map(|coil| self.coil(coil?, now).ok_or(NO_ADDRESS));
                coils.collect::<Result<_, _>>().map(ModbusReply::Coils)
            }
            ModbusRequest::ReadRegisters { address, count } => {
                let registers = range(*address, *count).map(|register| self.register(register?, now).ok_or(NO_ADDRESS));
                registers.collect::<Result<_, _>>().map(ModbusReply::Registers)
            }
            ModbusRequest::WriteCoil { address, on } => self.set_coil(*address, *on, now).map(|()| ModbusReply::Written),
            ModbusRequest::WriteCoils { address, on } => {
                for (coil, on) in range(*address, on.len() as u16).zip(on) {
                    self.set_coil(coil?, *on, now)?;
                }
                Ok(ModbusReply::Written)
            }
            ModbusRequest::WriteRegister { address, value } => {
                self.set_registers(*address, &[*value]).map(|()| ModbusReply::Written)
            }
            ModbusRequest::WriteRegisters { address, values } => {
                self.set_registers(*address, values).map(|()| ModbusReply::Written)
            }
        }
    }

    fn coil(&self, address: u16, now: f64) -> Option<bool> {
        let is_moving = self.axis.is_moving(now);
        let speed = self.axis.speeds(now)[0];
        match address {
            coil::SERVO_ON => Some(self.servo_on_since.is_some()),
            coil::ALARM_CLEAR => Some(self.clear_since.is_some()),
            coil::OUTPUTS..=0x00BF => Some(self.output(usize::from(address - coil::OUTPUTS), now)),
            0x0102 => Some(speed < 0.0),
            0x0103 => Some(speed > 0.0),
            coil::STROBE | 0x0130 => Some(self.strobe),
            coil::IMMEDIATE_STOP | 0x0133 => Some(self.immediate_stop),
            coil::DECELERATION_STOP | 0x0134 => Some(self.deceleration_stop),
            coil::BUSY => Some(is_moving || self.running.is_some()),
            0x0141 => Some(true),
            0x0060..=0x007F | 0x0100..=0x0107 | 0x0121..=0x0147 => Some(false),
            _ => None,
        }
    }

    fn output(&self, place: usize, now: f64) -> bool {
        match place {
            output::SERVO_READY => self.error == 0,
            output::ALARM => self.error != 0,
            output::IN_POSITION => !self.axis.is_moving(now),
            output::BRAKE_RELEASED => self.has_current(now),
            output::MOTOR_FREE => !self.has_current(now),
            _ => false,
        }
    }

    fn set_coil(&mut self, address: u16, on: bool, now: f64) -> Result<(), u8> {
        match address {
            coil::SERVO_ON if on && self.error == 0 => drop(self.servo_on_since.get_or_insert(now)),
            coil::SERVO_ON if !on => {
                self.brake(now);
                self.servo_on_since = None;
            }
            coil::ALARM_CLEAR => self.clear(on, now),
            coil::STROBE => {
                let rises = on && !self.strobe;
                self.strobe = on;
                if rises {
                    self.start(now);
                }
            }
            coil::IMMEDIATE_STOP => {
                self.immediate_stop = on;
                if on {
                    self.running = None;
                    self.axis.place(self.axis.positions(now));
                }
            }
            coil::DECELERATION_STOP => {
                self.deceleration_stop = on;
                if on {
                    self.brake(now);
                }
            }
            0x0060..=0x007F | 0x0120..=0x0124 => {}
            _ => return Err(NO_ADDRESS),
        }
        Ok(())
    }

    /// Clears the error when the coil falls after it was held long enough, unless the cause lasts.
    fn clear(&mut self, on: bool, now: f64) {
        if on {
            self.clear_since.get_or_insert(now);
        } else if self.clear_since.take().is_some_and(|since| (now - since) / self.setup.factor >= CLEAR_SECS) {
            self.error = 0;
        }
    }

    /// Starts the block that is chosen.
    fn start(&mut self, now: f64) {
        if self.immediate_stop || self.deceleration_stop {
            return;
        }
        if self.running.is_some() || self.axis.is_moving(now) || !self.has_current(now) {
            return self.raise(ERROR_BLOCK_OPERATION, now);
        }
        match u8::try_from(self.block_number) {
            Ok(block) => self.run(block, now),
            Err(_) => self.raise(ERROR_BLOCK_DATA, now),
        }
    }

    fn run(&mut self, number: u8, now: f64) {
        let block = MoveBlock::read(self.blocks[usize::from(number)]);
        let rate = |first: u16, number: u8| f64::from(self.rates[usize::from(first - register::SPEEDS + u16::from(number))]);
        let Some(block) = block else { return self.raise(ERROR_BLOCK_DATA, now) };
        let speed = rate(register::SPEEDS, block.speed);
        let ramps = [rate(register::ACCELERATIONS, block.acceleration), rate(register::DECELERATIONS, block.deceleration)];
        // One ramp for both ends: the slower.
        let ramp_ms = if ramps.contains(&0.0) { 0.0 } else { ramps[0].max(ramps[1]) };
        if speed <= 0.0 || ramp_ms <= 0.0 {
            return self.raise(ERROR_BLOCK_DATA, now);
        }
        let here = self.position(now);
        let to = match block.travel {
            BlockTravel::Relative(units) => here + f64::from(units),
            BlockTravel::Absolute(units) if self.setup.has_infinite_rotation => here + self.shorter_way(f64::from(units) - here),
            BlockTravel::Absolute(units) => units.into(),
        };
        let units_per_motor_turn = f64::from(self.setup.units_per_turn) / self.setup.gear_ratio;
        let speed_units = speed / 60.0 * units_per_motor_turn;
        let ramp_units = 1e3 * RAMP_R_PER_MIN / ramp_ms / 60.0 * units_per_motor_turn;
        self.axis.start([to], &[speed_units], &[ramp_units], now);
        self.running = Some((number, block.is_followed));
    }

    /// The shorter way round of a distance, where positions repeat with every turn.
    fn shorter_way(&self, distance: f64) -> f64 {
        let turn = f64::from(self.setup.units_per_turn);
        let ahead = distance.rem_euclid(turn);
        if ahead > 0.5 * turn { ahead - turn } else { ahead }
    }

    /// Position as it is read.
    fn read_position(&self, now: f64) -> i32 {
        let position = self.position(now).round();
        let turn = f64::from(self.setup.units_per_turn);
        if self.setup.has_infinite_rotation { position.rem_euclid(turn) as i32 } else { position as i32 }
    }

    fn register(&self, address: u16, now: f64) -> Option<u16> {
        let text = |text: &str, first: u16| registers_of_text(text, 8)[usize::from(address - first)];
        let half = |value: i32, first: u16| registers_of(&[value], self.order())[usize::from((address - first) % 2)];
        match address {
            register::MODEL..=0x1007 => Some(text(MODEL, register::MODEL)),
            register::SOFTWARE..=0x1017 => Some(text(SOFTWARE, register::SOFTWARE)),
            0x3000..=0x3FFF => Some(half(self.parameters.get(&(address & !1)).copied().unwrap_or(0), 0x3000)),
            register::ERROR | 0x6001 => Some(error_register(self.error)),
            register::EXECUTION_RIGHT => Some(if self.has_right { ACQUIRE_RIGHT } else { 0 }),
            register::BLOCK_NUMBER => Some(self.block_number),
            register::SPEEDS..=0x462F => Some(self.rates[usize::from(address - register::SPEEDS)]),
            register::BLOCKS..=0x4BFF => {
                let place = usize::from(address - register::BLOCKS);
                Some(half(self.blocks[place / 4][place / 2 % 2], register::BLOCKS))
            }
            register::ENCODER_RESOLUTION..=0x4D03 => Some(half(RESOLUTIONS[0], register::ENCODER_RESOLUTION)),
            // Asked for, internal and measured are one: there is no following error.
            register::POSITION_DEMAND..=0x6010 => Some(half(self.read_position(now), register::POSITION_DEMAND)),
            0x601C..=0x601D => Some(half(self.axis.speeds(now)[0] as i32, 0x601C)),
            _ => None,
        }
    }

    /// Writes registers; values of two registers as a whole.
    fn set_registers(&mut self, address: u16, values: &[u16]) -> Result<(), u8> {
        let whole = values_of(values, self.order());
        match (address, values) {
            (register::EXECUTION_RIGHT, [ACQUIRE_RIGHT]) => self.has_right = true,
            (register::EXECUTION_RIGHT, [RELEASE_RIGHT]) => self.has_right = false,
            (register::EXECUTION_RIGHT, _) => return Err(WRONG_VALUE),
            (register::BLOCK_NUMBER, [number]) => self.block_number = *number,
            (register::SPEEDS..=0x462F, values) => {
                for (place, value) in values.iter().enumerate() {
                    *self.rates.get_mut(usize::from(address - register::SPEEDS) + place).ok_or(NO_ADDRESS)? = *value;
                }
            }
            (0x3000..=0x3FFF, [_, _]) if address.is_multiple_of(2) => drop(self.parameters.insert(address, whole[0])),
            (register::BLOCKS..=0x4BFF, values) if address.is_multiple_of(2) && values.len() % 2 == 0 => {
                let first = usize::from(address - register::BLOCKS) / 2;
                for (place, value) in whole.into_iter().enumerate() {
                    let block = self.blocks.get_mut((first + place) / 2).ok_or(NO_ADDRESS)?;
                    block[(first + place) % 2] = value;
                }
            }
            _ => return Err(NO_ADDRESS),
        }
        Ok(())
    }
}

/// Addresses from `first` on; one beyond the last address is an error.
fn range(first: u16, count: u16) -> impl Iterator<Item = Result<u16, u8>> {
    (0..count).map(move |place| first.checked_add(place).ok_or(NO_ADDRESS))
}
