use std::time::Duration;

use tokio::time::{advance, sleep};

use super::{Planted, Twin};
use crate::execution::device::{DeviceError, MotionDevice, Target};

const WATCHDOG: Duration = Duration::from_secs(60);

fn target(sequence: u64, to: f64) -> Target<1> {
    Target {
        sequence,
        positions_rad: [to],
        max_speed_rad_s: [1.0],
        max_acceleration_rad_s2: [2.0],
        duration: Duration::from_secs_f64(to + 0.5),
    }
}

#[tokio::test(start_paused = true)]
async fn a_twin_moves_by_the_trapezoid_and_rests_to_the_bit() {
    let mut twin = Twin::at([0.0], 1.0);
    assert!(matches!(twin.start(&target(1, 2.0)).await, Err(DeviceError::NotReady { .. })), "not armed");
    twin.arm(WATCHDOG).await.expect("arms");
    twin.start(&target(1, 2.0)).await.expect("starts");
    assert!(matches!(twin.start(&target(2, 1.0)).await, Err(DeviceError::Refused { code: 20004, .. })), "moves already");
    sleep(Duration::from_millis(1250)).await;
    let state = twin.state().await.expect("reads");
    assert!((state.positions_rad[0] - 1.0).abs() < 1e-9 && state.condition.moving && !state.condition.in_position);
    sleep(Duration::from_millis(1250)).await;
    let state = twin.state().await.expect("reads");
    assert_eq!(state.positions_rad, [2.0]);
    assert!(!state.condition.moving && state.condition.in_position);
}

#[tokio::test(start_paused = true)]
async fn its_time_can_run_quicker() {
    let mut twin = Twin::at([0.0], 10.0);
    twin.arm(WATCHDOG).await.expect("arms");
    twin.start(&target(1, 2.0)).await.expect("starts");
    advance(Duration::from_millis(125)).await;
    assert!((twin.state().await.expect("reads").positions_rad[0] - 1.0).abs() < 1e-9);
}

#[tokio::test(start_paused = true)]
async fn a_stop_brakes_on_the_way_and_takes_no_target_until_armed() {
    let mut twin = Twin::at([0.0], 1.0);
    twin.arm(WATCHDOG).await.expect("arms");
    twin.start(&target(1, 2.0)).await.expect("starts");
    sleep(Duration::from_secs(1)).await;
    twin.stop(&mut None).await.expect("stops");
    assert!(twin.state().await.expect("reads").condition.moving, "braking takes its time");
    sleep(Duration::from_millis(500)).await;
    let state = twin.state().await.expect("reads");
    // 0.75 rad on the way, then 0.5 s from 1 rad/s to rest.
    assert!((state.positions_rad[0] - 1.0).abs() < 1e-9 && !state.condition.moving, "{state:?}");
    assert!(twin.start(&target(2, 2.0)).await.is_err());
    twin.arm(WATCHDOG).await.expect("arms");
    twin.start(&target(3, 2.0)).await.expect("starts");
    assert_eq!(twin.access().asked().targets_unarmed, 1);
}

#[tokio::test(start_paused = true)]
async fn a_watchdog_that_is_not_fed_brakes() {
    let mut twin = Twin::at([0.0], 1.0);
    let access = twin.access();
    twin.arm(Duration::from_millis(200)).await.expect("arms");
    twin.start(&target(1, 5.0)).await.expect("starts");
    for _ in 0..5 {
        sleep(Duration::from_millis(150)).await;
        twin.keep_alive().await.expect("fed");
    }
    sleep(Duration::from_secs(2)).await;
    assert!(!access.is_moving());
    // 0.75 s, 0.2 s of watchdog, 0.5 s of braking, at 1 rad/s after 0.5 s of acceleration.
    assert!((access.positions_rad()[0] - 0.95).abs() < 1e-6, "{:?}", access.positions_rad());
}

#[tokio::test(start_paused = true)]
async fn planted_errors_show_in_what_is_measured() {
    let mut twin = Twin::at([0.0; 6], 1.0);
    let access = twin.access();
    access.mismeasure([0.0, 0.0, 0.01, 0.0, 0.0, 0.0]);
    assert_eq!(twin.state().await.expect("reads").positions_rad[2], 0.01);
    assert_eq!(access.positions_rad()[2], 0.0);
    access.plant(Some(Planted::EmergencyStop));
    assert!(twin.state().await.expect("reads").condition.emergency_stop);
    access.plant(Some(Planted::Closed));
    assert!(twin.state().await.is_err());
}
