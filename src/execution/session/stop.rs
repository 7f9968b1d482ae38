//! The stop: asked of both devices at once, again where it was not acknowledged, and verified by their states. Whatever happens on
//! the way is written down; nothing here gives up early.

use std::time::Duration;

use tokio::time::{Instant, sleep, timeout};

use super::machine::{Drive, StopAnswers};
use crate::cell::Configuration;
use crate::execution::device::{DeviceError, StopAcknowledged};
use crate::execution::record::DeviceStop;

/// Times that a stop is asked for where it is not acknowledged.
const ATTEMPTS: u32 = 3;
/// Time of an attempt.
const ATTEMPT: Duration = Duration::from_millis(500);
/// Time in which both have to be at rest.
const REST: Duration = Duration::from_secs(5);
/// Time between two states.
const POLL: Duration = Duration::from_millis(20);
/// Largest turn between two states of an axis at rest, radians.
const STILL_RAD: f64 = 1e-4;

/// Stops arm and table; times are since `asked`.
pub(super) async fn stop<M: Drive>(machine: &mut M, asked: Instant, state_max_age: Duration) -> [DeviceStop; 2] {
    let mut stops = [DeviceStop::default(), DeviceStop::default()];
    for _ in 0..ATTEMPTS {
        let StopAnswers { arm, table } = machine.stop(ATTEMPT).await;
        note(&mut stops[0], arm, asked);
        note(&mut stops[1], table, asked);
        if stops.iter().all(|stop| stop.acknowledged.is_some()) {
            break;
        }
    }
    verify(machine, &mut stops, asked, state_max_age).await;
    stops
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

async fn verify<M: Drive>(machine: &mut M, stops: &mut [DeviceStop; 2], asked: Instant, state_max_age: Duration) {
    let verified = async {
        let mut former: Option<Configuration> = None;
        while stops.iter().any(|stop| stop.at_rest.is_none()) {
            match machine.state(state_max_age).await {
                Ok(state) => {
                    let (here, now) = (state.configuration(), asked.elapsed());
                    let moving = [state.arm.condition.moving, state.table.condition.moving];
                    let still = former.map(|former| still(&former, &here));
                    for (device, stop) in stops.iter_mut().enumerate() {
                        let is_at_rest = !moving[device] && still.is_some_and(|still| still[device]);
                        stop.at_rest = stop.at_rest.or(is_at_rest.then_some(now));
                    }
                    former = Some(here);
                }
                Err(error) => stops[usize::from(error.device == super::Device::Table)].error = Some(error.error.to_string()),
            }
            sleep(POLL).await;
        }
    };
    if timeout(REST, verified).await.is_err() {
        for stop in stops.iter_mut().filter(|stop| stop.at_rest.is_none()) {
            let words = format!("not verified at rest within {} s", REST.as_secs());
            stop.error = Some(stop.error.take().map_or_else(|| words.clone(), |error| format!("{words}: {error}")));
        }
    }
}

fn still(former: &Configuration, here: &Configuration) -> [bool; 2] {
    let turns = former.travel_rad(here).map(|turn| turn.abs() <= STILL_RAD);
    [turns[..6].iter().all(|still| *still), turns[6]]
}
