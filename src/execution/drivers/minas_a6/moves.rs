//! A target as blocks: speed and ramps in the drive's units, never above those asked for, save where the drive knows no ramp so slow:
//! there its slowest, if the table is rated for it.

use std::f64::consts::TAU;

use tokio::time::{Instant, sleep};

use super::{BLOCK_RUNS, GOAL_SHARE, MinasA6Table, POLL, START_WAIT};
use crate::execution::device::{DeviceError, Target};
use crate::execution::drivers::table_units::whole_units;
use crate::execution::protocol::minas_a6::{BlockTravel, MAX_RAMP_MS, MoveBlock, RAMP_R_PER_MIN, coil, output, register};
use crate::execution::protocol::modbus::registers_of;

/// Blocks that one move may take.
const MAX_BLOCKS: i64 = 8;
/// Longest distance of one block where positions repeat with every turn, share of a turn: less than half, so that there is
/// one way.
const MAX_BLOCK_SHARE: f64 = 0.45;

/// Acceleration of the motor on the drive's slowest ramp.
const MIN_RAMP_R_PER_S2: f64 = RAMP_R_PER_MIN / 60.0 / (1e-3 * MAX_RAMP_MS);

impl MinasA6Table {
    /// Returns true if a position is the one of a target.
    pub(super) fn is_near(&self, position: i64, goal: i64) -> bool {
        (position - goal).abs() as f64 <= GOAL_SHARE * self.units.per_turn
    }

    /// Writes the blocks of a move, starts the first and waits until the drive has it.
    pub(super) async fn start_blocks(&mut self, target: &Target<1>) -> Result<(), DeviceError> {
        if self.is_busy().await? {
            return Err(DeviceError::NotReady { reason: BLOCK_RUNS.into() });
        }
        let goal = self.units.position(target.positions_rad[0])?;
        let (demand, _) = self.positions().await?;
        self.goal = Some(goal);
        if goal == demand || target.max_speed_rad_s[0] <= 0.0 {
            return Ok(());
        }
        let travels = self.travels(demand, goal)?;
        self.write_rates(target, goal - demand).await?;
        self.write_blocks(&travels).await?;
        self.strobe(goal).await
    }

    /// Distances, or the position, that lead to the target.
    fn travels(&self, demand: i64, goal: i64) -> Result<Vec<BlockTravel>, DeviceError> {
        let too_far = || DeviceError::Unsupported {
            what: format!("turn by {} units at once; bring the table nearer to the program's angle by hand", goal - demand),
        };
        if !self.spec.has_infinite_rotation {
            return Ok(vec![BlockTravel::Absolute(i32::try_from(goal).map_err(|_| too_far())?)]);
        }
        let distance = goal - demand;
        let count = (distance.abs() as f64 / (MAX_BLOCK_SHARE * self.units.per_turn)).ceil().max(1.0) as i64;
        if count > MAX_BLOCKS {
            return Err(too_far());
        }
        let end = |block: i64| distance * block / count;
        (0..count)
            .map(|block| i32::try_from(end(block + 1) - end(block)).map(BlockTravel::Relative).map_err(|_| too_far()))
            .collect()
    }

    /// Writes speed, acceleration and deceleration. Where the drive knows no ramp so slow, as for the small turn of a long move, it
    /// has its slowest, and the lower speed that takes the predicted time all the same.
    async fn write_rates(&mut self, target: &Target<1>, distance: i64) -> Result<(), DeviceError> {
        let motor_r_per_min = |rad_s: f64| rad_s / TAU * 60.0 * self.spec.gear_ratio;
        let mut speed = motor_r_per_min(target.max_speed_rad_s[0]);
        let mut ramp_ms = (1e3 * RAMP_R_PER_MIN / motor_r_per_min(target.max_acceleration_rad_s2[0])).ceil();
        let max_r_per_min = f64::from(self.spec.max_motor_r_per_min);
        if !(1.0..=max_r_per_min).contains(&speed) {
            let allowed = format!("allowed is 1 to {max_r_per_min}: change the speed of the run");
            return Err(DeviceError::Unsupported { what: format!("turn the motor at {speed:.1} r/min; {allowed}") });
        }
        if ramp_ms > MAX_RAMP_MS || ramp_ms.is_nan() {
            self.check_slowest_ramp()?;
            let turns = distance.abs() as f64 / self.units.per_turn * self.spec.gear_ratio;
            speed = speed.min((60.0 * cruise_r_per_s(turns, target.duration.as_secs_f64())).ceil()).max(1.0);
            ramp_ms = MAX_RAMP_MS;
        }
        let speed = whole_units(speed, "r/min of the motor", max_r_per_min, target.duration)? as u16;
        let (number, ramp_ms) = (u16::from(self.spec.speed_number), ramp_ms.clamp(1.0, MAX_RAMP_MS) as u16);
        for (first, value) in [(register::SPEEDS, speed), (register::ACCELERATIONS, ramp_ms), (register::DECELERATIONS, ramp_ms)]
        {
            self.link()?.set_register(first + number, value).await?;
        }
        Ok(())
    }

    /// Error unless the table is rated for the drive's slowest ramp.
    fn check_slowest_ramp(&self) -> Result<(), DeviceError> {
        let slowest_rad_s2 = MIN_RAMP_R_PER_S2 * TAU / self.spec.gear_ratio;
        if slowest_rad_s2 <= self.max_acceleration_rad_s2 {
            return Ok(());
        }
        let [slowest, rated] = [slowest_rad_s2, self.max_acceleration_rad_s2].map(f64::to_degrees);
        let gear = self.spec.gear_ratio;
        let what = format!(
            "accelerate below {slowest:.1}°/s² at gear ratio {gear}; the table is rated for {rated:.1}°/s²: check both in the \
             cell file"
        );
        Err(DeviceError::Unsupported { what })
    }

    async fn write_blocks(&mut self, travels: &[BlockTravel]) -> Result<(), DeviceError> {
        let (first, number) = (self.spec.first_block, self.spec.speed_number);
        for (index, travel) in travels.iter().enumerate() {
            let is_followed = index + 1 < travels.len();
            let block = MoveBlock { travel: *travel, speed: number, acceleration: number, deceleration: number, is_followed };
            let registers = registers_of(&block.words(), self.spec.word_order);
            self.link()?.set_registers(MoveBlock::register(first + index as u8), registers).await?;
        }
        self.link()?.set_register(register::BLOCK_NUMBER, first.into()).await
    }

    /// Raises the strobe, waits until the block runs or has run, and lowers it.
    async fn strobe(&mut self, goal: i64) -> Result<(), DeviceError> {
        // It was lowered by arming, or behind the last start.
        self.link()?.set_coil(coil::STROBE, true).await?;
        let deadline = Instant::now() + START_WAIT;
        let has_started = loop {
            if self.is_busy().await? {
                break true;
            }
            let (demand, _) = self.positions().await?;
            if demand == goal && self.outputs().await?[output::IN_POSITION] {
                break true;
            }
            if Instant::now() >= deadline {
                break false;
            }
            sleep(POLL).await;
        };
        self.link()?.set_coil(coil::STROBE, false).await?;
        if has_started {
            return Ok(());
        }
        self.check_fault().await?;
        let reason = "the block did not start; see whether a stop input is on at the drive's connector".to_owned();
        Err(DeviceError::NotReady { reason })
    }
}

/// Speed of the motor that takes it through so many turns in that time with the slowest ramps; infinite where they are too slow.
fn cruise_r_per_s(turns: f64, secs: f64) -> f64 {
    let under_root = secs * secs - 4.0 * turns / MIN_RAMP_R_PER_S2;
    if under_root >= 0.0 { 2.0 * turns / (secs + under_root.sqrt()) } else { f64::INFINITY }
}
