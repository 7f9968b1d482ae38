//! A device moved there and back: what every driver must do beside its simulator.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::time::{Instant, sleep};

use crate::execution::device::{DeviceState, Direction, MotionDevice, Target, WireLog};

/// Watchdog of tests: longer than this machine may be busy.
pub(super) const WATCHDOG: Duration = Duration::from_millis(500);
/// Largest distance from a target that counts as reached, radians.
pub(super) const REACHED_RAD: f64 = 1e-4;
/// Time after which a simulator has settled.
const SETTLE: Duration = Duration::from_millis(50);

/// A log in memory.
#[derive(Default)]
pub(super) struct KeptBytes(Mutex<Vec<(Direction, Vec<u8>)>>);

impl KeptBytes {
    pub(super) fn new() -> Arc<Self> {
        Arc::default()
    }

    /// Bytes that were sent.
    pub(super) fn sent(&self) -> Vec<Vec<u8>> {
        let log = self.0.lock().expect("a log");
        log.iter().filter(|(direction, _)| *direction == Direction::Sent).map(|(_, bytes)| bytes.clone()).collect()
    }
}

impl WireLog for KeptBytes {
    fn record(&self, _device: &'static str, direction: Direction, bytes: &[u8]) {
        self.0.lock().expect("a log").push((direction, bytes.to_vec()));
    }
}

/// A log of the words among the bytes.
#[derive(Default)]
pub(super) struct KeptWords(Mutex<Vec<String>>);

impl KeptWords {
    pub(super) fn new() -> Arc<Self> {
        Arc::default()
    }

    /// Words that were noted, each behind the device.
    pub(super) fn noted(&self) -> Vec<String> {
        self.0.lock().expect("a log").clone()
    }
}

impl WireLog for KeptWords {
    fn record(&self, _device: &'static str, _direction: Direction, _bytes: &[u8]) {}

    fn note(&self, device: &'static str, words: &str) {
        self.0.lock().expect("a log").push(format!("{device}: {words}"));
    }
}

pub(super) fn target<const N: usize>(sequence: u64, positions_rad: [f64; N], duration: Duration) -> Target<N> {
    Target { sequence, positions_rad, max_speed_rad_s: [1.0; N], max_acceleration_rad_s2: [5.0; N], duration }
}

/// Keeps a device alive until it says that it is in position.
pub(super) async fn arrive<const N: usize>(device: &mut impl MotionDevice<N>) -> DeviceState<N> {
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        device.keep_alive().await.expect("alive");
        let state = device.state().await.expect("a state");
        if state.condition.in_position && !state.condition.moving {
            // What is measured lags behind the last set point, by cycles.
            sleep(SETTLE).await;
            return device.state().await.expect("a state");
        }
        assert!(Instant::now() < deadline, "still under way: {state:?}");
        sleep(Duration::from_millis(10)).await;
    }
}

/// Moves every axis by `delta_rad` and back; the device is armed before and stays so.
pub(super) async fn there_and_back<const N: usize>(device: &mut impl MotionDevice<N>, delta_rad: f64) {
    let start = device.state().await.expect("a state").positions_rad;
    for (sequence, delta_rad) in [(1, delta_rad), (2, 0.0)] {
        let goal: [f64; N] = std::array::from_fn(|axis| start[axis] + if axis % 2 == 0 { delta_rad } else { -0.5 * delta_rad });
        device.start(&target(sequence, goal, Duration::from_millis(300))).await.expect("accepted");
        let reached = arrive(device).await.positions_rad;
        for axis in 0..N {
            assert!((reached[axis] - goal[axis]).abs() < REACHED_RAD, "axis {axis}: {reached:?} for {goal:?}");
        }
    }
}
