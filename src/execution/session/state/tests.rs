use std::time::Duration;

use super::{RunEvent, RunState, RunStatus};
use crate::execution::device::DeviceError;
use crate::execution::session::{DeviceRole, Fence, LeaseError, Objection, PauseCause, RunReason, StopCause};

fn causes() -> Vec<StopCause> {
    let device = DeviceRole::Arm;
    let lease = LeaseError::Expired { cell: "cell".into(), token: Fence(1) };
    vec![
        StopCause::Client,
        StopCause::Unattended(PauseCause::Trigger { step: 2, view: 7, error: DeviceError::Closed { reason: "reset".into() } }),
        StopCause::HeartbeatLost { after: Duration::from_millis(600) },
        StopCause::LeaseLost(lease),
        StopCause::ServerGone,
        StopCause::ArmExpired,
        StopCause::EmergencyStop(device),
        StopCause::GuardOpen(device),
        StopCause::HandGuided(device),
        StopCause::HeldAtDevice(device),
        StopCause::PowerLost(device),
        StopCause::Stale { device, age: Duration::from_millis(120), by_reply_timeout: false },
        StopCause::Audit("no space".into()),
        StopCause::Misplaced("too far".into()),
        StopCause::Device { device, error: DeviceError::Closed { reason: "reset".into() } },
        StopCause::Device { device, error: DeviceError::Refused { code: 1, text: "no".into() } },
        StopCause::Fault { device, code: 7, text: None },
        StopCause::Objections(vec![Objection::TargetNotFinite]),
        StopCause::OffPath { axis: 1, off_deg: 6.0, allowed_deg: 5.0 },
        StopCause::NotReached { axis: 7, off_deg: 1.0 },
        StopCause::Internal("panic".into()),
    ]
}

fn events() -> Vec<RunEvent> {
    let pauses = [PauseCause::Client, PauseCause::SingleStep, PauseCause::Locating].map(RunEvent::Paused);
    let plain = [RunEvent::Prepared, RunEvent::Armed, RunEvent::Started, RunEvent::Resumed, RunEvent::Finished, RunEvent::Read];
    let stopping = [RunEvent::Stopping(None), RunEvent::Stopping(Some(StopCause::Client))];
    pauses.into_iter().chain(plain).chain(stopping).chain(causes().into_iter().map(RunEvent::Stopped)).collect()
}

#[test]
fn every_event_in_every_state_leads_where_the_drawing_says() {
    use RunState::{Armed, Done, Failed, Paused, Preparing, Ready, Running, Stopped};
    for state in RunState::ALL {
        for event in events() {
            let status = RunStatus { state, reason: RunReason::UnderWay };
            let next = status.after(event.clone()).map(|status| status.state);
            let wanted = match &event {
                RunEvent::Stopped(cause) => {
                    let by_hand = matches!(cause, StopCause::Client | StopCause::ServerGone | StopCause::ArmExpired);
                    let fails = matches!(
                        cause,
                        StopCause::Fault { .. }
                            | StopCause::Objections(_)
                            | StopCause::OffPath { .. }
                            | StopCause::NotReached { .. }
                            | StopCause::Internal(_)
                            | StopCause::Device { error: DeviceError::Refused { .. }, .. }
                    );
                    let before = matches!(state, Preparing | Ready);
                    let end = if !by_hand && (fails || before) { Failed } else { Stopped };
                    (!matches!(state, Done | Stopped | Failed)).then_some(end)
                }
                RunEvent::Prepared => (state == Preparing).then_some(Ready),
                RunEvent::Armed => (state == Ready).then_some(Armed),
                RunEvent::Started => (state == Armed).then_some(Running),
                RunEvent::Paused(_) => (state == Running).then_some(Paused),
                RunEvent::Resumed => (state == Paused).then_some(Running),
                RunEvent::Finished => (state == Running).then_some(Done),
                RunEvent::Read => matches!(state, Preparing | Ready).then_some(Done),
                RunEvent::Stopping(_) => (!state.is_final()).then_some(state),
            };
            assert_eq!(next, wanted, "{event:?} while {state:?}");
        }
    }
}

#[test]
fn nothing_but_a_client_leads_into_motion() {
    for state in RunState::ALL.into_iter().filter(|state| *state != RunState::Running) {
        for event in events() {
            let next = RunStatus { state, reason: RunReason::UnderWay }.after(event.clone());
            if next.is_some_and(|next| next.state == RunState::Running) {
                assert!(matches!(event, RunEvent::Started | RunEvent::Resumed), "{event:?}");
            }
        }
    }
}

#[test]
fn every_reason_has_a_code_of_its_own_and_says_something() {
    let causes = causes();
    let mut codes: Vec<&str> = causes.iter().map(StopCause::code).collect();
    codes.dedup();
    assert_eq!(codes.len(), causes.len() - 1, "two errors of a device have one");
    assert!(causes.iter().all(|cause| cause.to_string().len() > 5));
}
