//! The stop: asked of both devices at once, again of the one that did not acknowledge it, and verified by their states. Whatever
//! happens on the way is written down; nothing here gives up early.

use std::time::Duration;

use tokio::time::{Instant, sleep, timeout};

use super::machine::{Drive, StateAnswers, StopAnswers};
use crate::execution::device::{DeviceError, STOP_ATTEMPT};
use crate::execution::record::DeviceStop;

/// Times that a stop is asked for where it is not acknowledged.
const ATTEMPTS: u32 = 3;
/// Time in which both have to be at rest.
const REST: Duration = Duration::from_secs(5);
/// Time between two states.
const POLL: Duration = Duration::from_millis(20);
/// Words for a device of which nothing is known after a fault of this program's own.
pub(super) const UNKNOWN: &str = "not known to have stopped; see that it stands before anybody goes near it";
/// Largest turn between two states of an axis at rest, radians.
const STILL_RAD: f64 = 1e-4;

/// Stops arm and table; times are since `asked`. Also where they were found last. Whatever is known meanwhile goes to `tell`.
pub(super) async fn stop<M: Drive>(
    machine: &mut M,
    asked: Instant,
    mut tell: impl FnMut(&[DeviceStop; 2]),
) -> ([DeviceStop; 2], [Option<Vec<f64>>; 2]) {
    let mut stops = [DeviceStop::default(), DeviceStop::default()];
    for _ in 0..ATTEMPTS {
        ask(machine, &mut stops, asked).await;
        tell(&stops);
        if stops.iter().all(|stop| stop.acknowledged.is_some()) {
            break;
        }
    }
    let mut found = [None, None];
    let is_verified = timeout(REST, verify(machine, &mut stops, &mut found, asked, tell)).await.is_ok();
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

/// Stops arm and table after a fault of this program's own on the way: asks both once more, and verifies nothing.
pub(super) async fn stop_once<M: Drive>(machine: &mut M, asked: Instant) -> [DeviceStop; 2] {
    let mut stops = [DeviceStop::default(), DeviceStop::default()];
    ask(machine, &mut stops, asked).await;
    for stop in &mut stops {
        let because = stop.error.take().map_or_else(String::new, |error| format!(" ({error})"));
        stop.error = Some(format!("not verified at rest{because}; see that it stands before anybody goes near it"));
    }
    stops
}

/// Asks those to stop that have not acknowledged it, and notes what they answer.
async fn ask<M: Drive>(machine: &mut M, stops: &mut [DeviceStop; 2], asked: Instant) {
    let asks = [stops[0].acknowledged.is_none(), stops[1].acknowledged.is_none()];
    let StopAnswers { arm, table, sent_at } = machine.stop(asks, STOP_ATTEMPT).await;
    for ((stop, answer), sent_at) in stops.iter_mut().zip([arm, table]).zip(sent_at) {
        // The first request counts, whichever was acknowledged.
        stop.sent = stop.sent.or_else(|| sent_at.map(|at| at.saturating_duration_since(asked)));
        note(stop, answer, asked);
    }
}

fn note(stop: &mut DeviceStop, answer: Option<Result<Instant, DeviceError>>, asked: Instant) {
    match answer {
        None => {}
        Some(Ok(acknowledged_at)) => {
            stop.acknowledged = Some(acknowledged_at.saturating_duration_since(asked));
            stop.error = None;
        }
        Some(Err(error)) => stop.error = Some(error.to_string()),
    }
}

/// Reads until both were found at rest in two states in a row, each for itself. One that did not acknowledge the stop is asked again as
/// soon as it can be read, and now and then where it cannot: its link was dead for all the attempts, and with the link back it would
/// end the move that it holds.
async fn verify<M: Drive>(
    machine: &mut M,
    stops: &mut [DeviceStop; 2],
    found: &mut [Option<Vec<f64>>; 2],
    asked: Instant,
    mut tell: impl FnMut(&[DeviceStop; 2]),
) {
    let at_rest = |stops: &[DeviceStop; 2]| stops.iter().filter(|stop| stop.at_rest.is_some()).count();
    let mut asked_last = Instant::now();
    while at_rest(stops) < stops.len() {
        let before = at_rest(stops);
        // A watchdog that is not fed would make a fault of a pause.
        let StateAnswers { arm, table } = machine.states_fed(STOP_ATTEMPT).await;
        let arm = arm.map(|state| (state.condition.moving, state.positions_rad.to_vec()));
        let table = table.map(|state| (state.condition.moving, state.positions_rad.to_vec()));
        let is_back = [arm.is_ok(), table.is_ok()];
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
        // What is known of both is told by whoever asked for the stop.
        if (before + 1..stops.len()).contains(&at_rest(stops)) {
            tell(stops);
        }
        let is_due = asked_last.elapsed() >= STOP_ATTEMPT;
        if stops.iter().zip(is_back).any(|(stop, is_back)| stop.acknowledged.is_none() && (is_back || is_due)) {
            ask(machine, stops, asked).await;
            asked_last = Instant::now();
            tell(stops);
        }
        sleep(POLL).await;
    }
}

fn is_still(former: &[f64], here: &[f64]) -> bool {
    former.iter().zip(here).all(|(former, here)| (former - here).abs() <= STILL_RAD)
}
