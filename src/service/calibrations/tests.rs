//! Calibrations while the disk is full.

use super::*;
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
