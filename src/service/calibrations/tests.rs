//! Calibrations while the disk is full.

use super::*;
use crate::cell::{Named, Presets, SpecLibrary as _};
use crate::service::tests::service;
use crate::wire::example;

async fn submitted(app: &App) -> CalibrationId {
    let request = serde_json::from_value(example::calibration()).expect("a request");
    app.submit_calibration(request, Submission::default()).await.expect("accepted").id
}

#[tokio::test]
async fn a_result_is_stored_once_the_disk_has_room() {
    let (app, _folder) = service().await;
    app.0.store.fill_disk_at("UPDATE ON calibration WHEN NEW.state = 'succeeded'").await;
    let id = submitted(&app).await;
    let ended = app.calibration_when_ended(id, Duration::from_secs(60)).await.expect("it");
    assert_eq!((ended.state, ended.problem), (CalibrationState::Succeeded, None));
    app.calibration_result(id).await.expect("its result");
}

#[tokio::test]
async fn a_cancellation_and_a_deletion_have_the_room_that_is_kept_for_them() {
    let (app, folder) = service().await;
    let _turn = app.0.calibrations.turn.lock().await;
    let id = submitted(&app).await;
    let keep_room = || std::fs::write(folder.path().join("reserve"), b"room").expect("a file");
    keep_room();
    app.0.store.fill_disk_at("UPDATE ON calibration WHEN NEW.state = 'cancelled'").await;
    assert_eq!(app.cancel_calibration(id).await.expect("cancelled").state, CalibrationState::Cancelled);
    keep_room();
    app.0.store.fill_disk_at("DELETE ON calibration").await;
    app.delete_calibration(id).await.expect("deleted");
}

/// The cancellation was told as done, and recovery began the calibration again.
#[tokio::test]
async fn a_calibration_that_an_earlier_process_left_is_cancelled_before_it_is_recovered() {
    let (app, _folder) = service().await;
    let _turn = app.0.calibrations.turn.lock().await;
    let id = submitted(&app).await;
    let run = |job: &mut CalibrationJob| job.state = CalibrationState::Running;
    app.change_calibration(id, &[CalibrationState::Queued], run, None).await.expect("running");
    assert_eq!(app.cancel_calibration(id).await.expect("told").state, CalibrationState::Running, "whoever computes it ends it");
    app.forget_recovery();
    assert_eq!(app.cancel_calibration(id).await.expect("cancelled").state, CalibrationState::Cancelled);
    app.recover_calibrations().await.expect("recovered");
    assert_eq!(app.calibration(id).await.expect("it").state, CalibrationState::Cancelled);
}

/// The server waited for its end.
#[tokio::test]
async fn a_calibration_that_the_stop_of_the_service_interrupts_waits_for_the_next_process() {
    let (app, _folder) = service().await;
    let _turn = app.0.calibrations.turn.lock().await;
    let id = submitted(&app).await;
    app.0.stopping.cancel();
    // By hand: its task waits for its turn no longer.
    app.compute_calibration(id).await.expect("interrupted");
    let job = app.calibration(id).await.expect("it");
    assert_eq!((job.state, job.problem, job.ended_at), (CalibrationState::Queued, None, None));
}

/// A second calibration was computed.
#[tokio::test]
async fn a_key_starts_one_calibration_however_often_it_comes() {
    let (app, _folder) = service().await;
    let _turn = app.0.calibrations.turn.lock().await;
    let submit = async |hold_out: u16| {
        let request: CalibrationRequest = serde_json::from_value(example::calibration()).expect("a request");
        let submission = Submission { idempotency_key: Some("key".to_owned()), ..Submission::default() };
        app.submit_calibration(CalibrationRequest { hold_out, ..request }, submission).await
    };
    let (first, second) = tokio::join!(submit(0), submit(0));
    let first = first.expect("accepted");
    assert_eq!(second.expect("the same"), first);
    assert_eq!(submit(0).await.expect("the same"), first);
    let refused = submit(1).await;
    assert!(matches!(refused, Err(Error::IdempotencyMismatch)), "{refused:?}");
    let all = app.calibrations(&CalibrationSelection::default(), 10, None).await.expect("a list");
    assert_eq!(all.items, [first]);
}

#[tokio::test]
async fn observations_that_are_held_out_leave_enough_to_calibrate_from() {
    let (app, _folder) = service().await;
    let _turn = app.0.calibrations.turn.lock().await;
    let held_out = async |hold_out: u16| {
        let request: CalibrationRequest = serde_json::from_value(example::calibration()).expect("a request");
        app.submit_calibration(CalibrationRequest { hold_out, ..request }, Submission::default()).await
    };
    let Err(Error::Invalid(errors)) = held_out(6).await else { panic!("nothing remains") };
    assert_eq!(errors.len(), 1, "{errors:?}");
    assert_eq!(
        (errors[0].pointer.as_str(), errors[0].detail.as_str()),
        ("/hold_out", "is 6 of 6 observations; at least 3 must remain")
    );
    held_out(3).await.expect("three remain");
}

/// `vantage calibrate cell` tells it too: the result is about to be stored as the cell.
#[tokio::test]
async fn a_result_far_from_the_cell_that_was_observed_is_doubted() {
    let (app, _folder) = service().await;
    let ended = async |shift_mm: f64| {
        let mut spec = Presets.cell("e05-transcan").expect("a preset");
        spec.flange_from_scanner.translation_mm[0] += shift_mm;
        let request: CalibrationRequest = serde_json::from_value(example::calibration()).expect("a request");
        let request = CalibrationRequest { cell: Named::Inline(Box::new(spec)), ..request };
        let id = app.submit_calibration(request, Submission::default()).await.expect("accepted").id;
        app.calibration_when_ended(id, Duration::from_secs(60)).await.expect("it")
    };
    let near = ended(0.0).await;
    assert_eq!((near.state, near.warnings), (CalibrationState::Succeeded, Vec::new()));
    let far = ended(80.0).await;
    assert_eq!(far.state, CalibrationState::Succeeded, "{far:?}");
    let told: Vec<&str> = far.warnings.iter().map(|warning| warning.pointer.as_str()).collect();
    assert_eq!(told, ["/cell/flange_from_scanner"]);
    assert!(far.warnings[0].detail.contains("80 mm"), "{far:?}");
}
