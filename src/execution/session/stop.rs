//! The stop: asked of both devices at once, again where it was not acknowledged, and verified by their states. Whatever happens on
//! the way is written down; nothing here gives up early.

use std::time::Duration;

use tokio::time::{Instant, sleep, timeout};

use super::machine::{Drive, StateAnswers, StopAnswers};
use crate::execution::device::{DeviceError, STOP_ATTEMPT, StopAcknowledged};
use crate::execution::record::DeviceStop;

/// Times that a stop is asked for where it is not acknowledged.
const ATTEMPTS: u32 = 3;
/// Time in which both have to be at rest.
const REST: Duration = Duration::from_secs(5);
/// Time between two states.
const POLL: Duration = Duration::from_millis(20);
/// Largest turn between two states of an axis at rest, radians.
const STILL_RAD: f64 = 1e-4;

/// Stops arm and table; times are since `asked`. Also where they were found last.
pub(super) async fn stop<M: Drive>(machine: &mut M, asked: Instant) -> ([DeviceStop; 2], [Option<Vec<f64>>; 2]) {
    let mut stops = [DeviceStop::default(), DeviceStop::default()];
    for _ in 0..ATTEMPTS {
        let StopAnswers { arm, table } = machine.stop(STOP_ATTEMPT).await;
        note(&mut stops[0], arm, asked);
        note(&mut stops[1], table, asked);
        if stops.iter().all(|stop| stop.acknowledged.is_some()) {
            break;
        }
    }
    let mut found = [None, None];
    let is_verified = timeout(REST, verify(machine, &mut stops, &mut found, asked)).await.is_ok();
    for stop in stops.iter_mut().filter(|stop| !is_verified && stop.at_rest.is_none()) {
        let because = stop.error.take().map_or_else(String::new, |error| format!(" ({error})"));
        let rest_secs = REST.as_secs();
        stop.error =
            Some(format!("not verified at rest within {rest_secs} s{because}; see that it stands before anybody goes near it"));
    }
    (stops, found)
}

/// Returns true if both acknowledged the stop and are at rest.
pub(super) fn is_complete(stops: &[DeviceStop; 2]) -> bool {
    stops.iter().all(|stop| stop.acknowledged.is_some() && stop.at_rest.is_some())
}

fn note(stop: &mut DeviceStop, answer: Result<StopAcknowledged, DeviceError>, asked: Instant) {
    match answer {
        Ok(_) if stop.acknowledged.is_some() => {}
        Ok(StopAcknowledged { sent_at, acknowledged_at }) => {
            stop.sent = Some(sent_at.saturating_duration_since(asked));
            stop.acknowledged = Some(acknowledged_at.saturating_duration_since(asked));
            stop.error = None;
        }
        Err(error) => stop.error = Some(error.to_string()),
    }
}

/// Reads until both were found at rest in two states in a row, each for itself.
async fn verify<M: Drive>(machine: &mut M, stops: &mut [DeviceStop; 2], found: &mut [Option<Vec<f64>>; 2], asked: Instant) {
    while stops.iter().any(|stop| stop.at_rest.is_none()) {
        // A watchdog that is not fed would make a fault of a pause.
        let StateAnswers { arm, table } = machine.states_fed(STOP_ATTEMPT).await;
        let arm = arm.map(|state| (state.condition.moving, state.positions_rad.to_vec()));
        let table = table.map(|state| (state.condition.moving, state.positions_rad.to_vec()));
        for ((stop, former), answer) in stops.iter_mut().zip(found.iter_mut()).zip([arm, table]) {
            match answer {
                Ok((is_moving, here)) => {
                    let is_still = former.replace(here.clone()).is_some_and(|former| is_still(&former, &here));
                    let is_at_rest = is_still && !is_moving;
                    stop.at_rest = stop.at_rest.or_else(|| is_at_rest.then(|| asked.elapsed()));
                }
                Err(error) => stop.error = Some(error.to_string()),
            }
        }
        sleep(POLL).await;
    }
}

fn is_still(former: &[f64], here: &[f64]) -> bool {
    former.iter().zip(here).all(|(former, here)| (former - here).abs() <= STILL_RAD)
}
