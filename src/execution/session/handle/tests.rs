use std::sync::Arc;

use super::{Authority, CommandError, RunHandle, handle_and_control};
use crate::execution::session::live::Live;
use crate::execution::session::{Fence, LeaseError, Leases, Objection, RunState};

/// A run that is begun, and its side of the handle.
fn begun(authority: Option<Authority>) -> (RunHandle, super::Control) {
    let live = Arc::new(Live::new(1, 1.0));
    handle_and_control(&live, authority, (1.0, 1.0), false)
}

/// The order was told as "do that".
#[tokio::test]
async fn an_order_that_a_run_ends_before_it_hears_is_refused_by_its_name() {
    let (handle, control) = begun(None);
    let (told, ()) = tokio::join!(handle.step(None), async { drop(control) });
    assert_eq!(told, Err(CommandError::NotNow { state: RunState::Preparing, command: "step" }));
    let late = handle.resume(None).await.expect_err("the run is gone").to_string();
    assert_eq!(late, "a run that is preparing cannot be told to resume");
}

/// A missing token was told as token 0, which nobody had sent.
#[test]
fn a_missing_token_is_told_as_missing_and_another_as_wrong() {
    let authority = Authority { leases: Leases::default(), cell: "a".to_owned() };
    let (handle, _control) = begun(Some(authority));
    let told = |token: Option<u64>| handle.heartbeat(token.map(Fence)).expect_err("no lease").to_string();
    assert_eq!(told(None), "moving cell a needs the token of its lease; take the lease, and send its token with each command");
    assert_eq!(handle.heartbeat(None), Err(CommandError::Lease(LeaseError::NoToken { cell: "a".to_owned() })));
    assert_eq!(told(Some(0)), "token 0 is not that of the lease of cell a; take the lease first");
}

#[test]
fn an_override_out_of_range_is_told_in_the_same_words_before_a_run_and_in_it() {
    let told = [CommandError::Override(1.5).to_string(), Objection::Override(1.5).to_string()];
    assert_eq!(told, ["the speed override is 1.5; allowed is 0.01 to 1"; 2]);
}
