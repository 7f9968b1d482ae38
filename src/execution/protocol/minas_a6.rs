//! Panasonic MINAS A6 over Modbus: addresses, blocks, order of words, alarms.
//!
//! Source: Panasonic SX-DSV03384 R2.2, "Modbus communication & Block operation"; numbers of its sections in parentheses.

/// Coils (2-1-4-3).
pub mod coil {
    /// Servo on.
    pub const SERVO_ON: u16 = 0x0060;
    /// Clears an alarm, where it can be cleared; held for at least 120 ms.
    pub const ALARM_CLEAR: u16 = 0x0061;
    /// First of the logical outputs: servo ready.
    pub const OUTPUTS: u16 = 0x00A0;
    /// Starts the block when it rises.
    pub const STROBE: u16 = 0x0120;
    /// Stops at once while it is set.
    pub const IMMEDIATE_STOP: u16 = 0x0123;
    /// Decelerates and stops while it is set.
    pub const DECELERATION_STOP: u16 = 0x0124;
    /// A block runs.
    pub const BUSY: u16 = 0x0140;
}

/// Number of the logical outputs that are read at once, from [`coil::OUTPUTS`].
pub const OUTPUT_COUNT: u16 = 16;
/// Places of outputs from [`coil::OUTPUTS`] on (2-1-4-3). The manual has `INP` at 00A2h.
pub mod output {
    /// The servo can be switched on.
    pub const SERVO_READY: usize = 0;
    /// An alarm is on.
    pub const ALARM: usize = 1;
    /// Position reached.
    pub const IN_POSITION: usize = 2;
    /// The brake is released.
    pub const BRAKE_RELEASED: usize = 3;
    /// The motor has no current.
    pub const MOTOR_FREE: usize = 15;
}

/// Holding registers (2-1-4-4).
pub mod register {
    /// Model of the amplifier, eight registers.
    pub const MODEL: u16 = 0x1000;
    /// Version of its software, eight registers.
    pub const SOFTWARE: u16 = 0x1010;
    /// Error, main number in the high byte.
    pub const ERROR: u16 = 0x4001;
    /// Right to control by Modbus.
    pub const EXECUTION_RIGHT: u16 = 0x4300;
    /// Number of the block that the strobe starts.
    pub const BLOCK_NUMBER: u16 = 0x4414;
    /// First of sixteen speeds, r/min of the motor.
    pub const SPEEDS: u16 = 0x4600;
    /// First of sixteen accelerations, ms from rest to 3000 r/min.
    pub const ACCELERATIONS: u16 = 0x4610;
    /// First of sixteen decelerations.
    pub const DECELERATIONS: u16 = 0x4620;
    /// First of 256 blocks, four registers each.
    pub const BLOCKS: u16 = 0x4800;
    /// Resolution of the encoder, two registers.
    pub const ENCODER_RESOLUTION: u16 = 0x4D02;
    /// Position that is asked for, two registers.
    pub const POSITION_DEMAND: u16 = 0x600B;
    /// Position of the motor, two registers.
    pub const POSITION_ACTUAL: u16 = 0x600F;
}

/// Value of [`register::EXECUTION_RIGHT`] that takes the right.
pub const ACQUIRE_RIGHT: u16 = 0x55;
/// Value that gives it back.
pub const RELEASE_RIGHT: u16 = 0xAA;

/// Register of a servo parameter, two registers (2-1-4-4, 3000h).
#[must_use]
pub const fn parameter(class: u16, number: u16) -> u16 {
    0x3000 + 0x100 * class + 2 * number
}

/// Absolute encoder: 4 turns without end (Pr0.15).
pub const ABSOLUTE_ENCODER: u16 = parameter(0, 15);
/// Time without a message that raises Err80.0 while the execution right is held, ms; 0 never (Pr5.40). In effect at once.
pub const COMMUNICATION_TIMEOUT: u16 = parameter(5, 40);
/// Block operation: 1 started by Modbus (Pr6.28).
pub const BLOCK_OPERATION: u16 = parameter(6, 28);
/// Turns of the motor in one of the table, less one (Pr6.88).
pub const MULTI_TURN_LIMIT: u16 = parameter(6, 88);
/// Value of [`ABSOLUTE_ENCODER`] for turns without end.
pub const INFINITE_ROTATION: i32 = 4;

/// Resolutions of the encoders of the series, counts a turn.
pub const RESOLUTIONS: [i32; 3] = [1 << 23, 1 << 20, 1 << 17];

/// Slowest change of speed that the drive knows, ms from rest to 3000 r/min.
pub const MAX_RAMP_MS: f64 = 10_000.0;
/// Speed that ramps are counted to, r/min.
pub const RAMP_R_PER_MIN: f64 = 3000.0;

/// A block that moves (4-2, 4-3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MoveBlock {
    /// Target or distance.
    pub travel: BlockTravel,
    /// Number of the speed, 0 to 15.
    pub speed: u8,
    /// Number of the acceleration, 0 to 15.
    pub acceleration: u8,
    /// Number of the deceleration, 0 to 15.
    pub deceleration: u8,
    /// True if the next block follows when this one has ended.
    pub is_followed: bool,
}

/// Travel of a block, command units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockTravel {
    /// A distance from the position that is asked for.
    Relative(i32),
    /// A position.
    Absolute(i32),
}

/// Code of a block that moves by a distance.
const RELATIVE: u8 = 0x01;
/// Code of a block that moves to a position.
const ABSOLUTE: u8 = 0x02;
/// Transition when the block has ended, and on to the next one (argument 5).
const FOLLOWED: u8 = 0b11;

impl MoveBlock {
    /// Command and data of the block.
    #[must_use]
    pub fn words(self) -> [i32; 2] {
        let (code, data) = match self.travel {
            BlockTravel::Relative(units) => (RELATIVE, units),
            BlockTravel::Absolute(units) => (ABSOLUTE, units),
        };
        let transition = if self.is_followed { FOLLOWED } else { 0 };
        let bytes = [code, self.speed << 4 | self.acceleration & 0xF, self.deceleration << 4 | transition, 0];
        [i32::from_be_bytes(bytes), data]
    }

    /// Reads command and data; `None` for a command that does not move so.
    #[must_use]
    pub fn read([command, data]: [i32; 2]) -> Option<Self> {
        let [code, first, second, last] = command.to_be_bytes();
        let travel = match code {
            RELATIVE => BlockTravel::Relative(data),
            ABSOLUTE => BlockTravel::Absolute(data),
            _ => return None,
        };
        let transition = second & 0xF;
        ((transition == 0 || transition == FOLLOWED) && last == 0).then_some(Self {
            travel,
            speed: first >> 4,
            acceleration: first & 0xF,
            deceleration: second >> 4,
            is_followed: transition == FOLLOWED,
        })
    }

    /// First register of a block.
    #[must_use]
    pub const fn register(block: u8) -> u16 {
        register::BLOCKS + 4 * block as u16
    }
}

/// Text of registers: two characters each, the first one in the low byte; what is not printable is left out.
#[must_use]
pub fn text_of(registers: &[u16]) -> String {
    let bytes = registers.iter().flat_map(|register| register.to_le_bytes());
    let text: String = bytes.filter(|byte| (b' '..=b'~').contains(byte)).map(char::from).collect();
    text.trim().to_owned()
}

/// Registers of a text, as many as asked for.
#[must_use]
pub fn registers_of_text(text: &str, count: usize) -> Vec<u16> {
    let byte = |index: usize| text.as_bytes().get(index).copied().unwrap_or(0);
    (0..count).map(|index| u16::from_le_bytes([byte(2 * index), byte(2 * index + 1)])).collect()
}

/// Number of an error: main times a hundred and sub, so that 8000 is Err80.0.
#[must_use]
pub const fn error_number(register: u16) -> u32 {
    (register >> 8) as u32 * 100 + (register & 0xFF) as u32
}

/// Register of an error.
#[must_use]
pub const fn error_register(number: u32) -> u16 {
    (((number / 100) << 8) | (number % 100)) as u16
}

/// Error of the communication time-out.
pub const ERROR_TIMEOUT: u32 = 8000;
/// Error of the forced alarm input, an emergency stop.
pub const ERROR_FORCED_ALARM: u32 = 8700;
/// Error of the safety input, which a guard opens.
pub const ERROR_SAFETY_INPUT: u32 = 3000;

/// Words for the number of an error.
#[must_use]
pub fn error_text(number: u32) -> &'static str {
    match number {
        8000 => "Err80.0: no Modbus message within the time-out",
        8700 => "Err87.0: the forced alarm input is on",
        9203 => {
            "Err92.3: the multi-turn limit of the encoder differs; normal once after Pr6.88 was set, switch the power off and on"
        }
        9301 => "Err93.1: a block has no command, or a speed or a ramp of zero",
        9400 => "Err94.0: block operation: started while another block ran, or with the servo off",
        9402 => "Err94.2: homing",
        _ => match number / 100 {
            11 => "Err11: the control power is too low",
            12 => "Err12: the voltage is too high",
            13 => "Err13: the main power is too low",
            14 => "Err14: the current is too high",
            15 => "Err15: the amplifier or the encoder is too hot",
            16 => "Err16: overload",
            18 => "Err18: regeneration overload",
            21 | 23 => "Err21, Err23: the encoder does not answer",
            24 => "Err24: the position deviates too far",
            26 => "Err26: the motor is too fast",
            27 => "Err27: the commanded pulses or the absolute data were cleared",
            30 => "Err30: the safety input",
            34 => "Err34: the motor left its working range",
            38 => "Err38: an over-travel input",
            40..=45 => "Err40 to Err45: the absolute encoder",
            92 => "Err92: the encoder's position cannot be restored",
            93 => "Err93: parameters are set wrongly",
            97 => "Err97: the control mode does not allow block operation",
            _ => "see the manual of the amplifier",
        },
    }
}

#[cfg(test)]
mod tests;
