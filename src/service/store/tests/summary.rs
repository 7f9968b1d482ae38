//! Summaries: stored with the results, shown with the job, in lists and in the event, and gone with the job.

use serde_json::json;

use super::*;
use crate::wire::summary::{PlanVerdict, Summary};

fn summary() -> Summary {
    let shares = [
        "of_visible",
        "grades_a_b_of_visible",
        "within_35_deg_of_visible",
        "within_60_deg_of_visible",
        "of_asked",
        "of_coverable",
    ];
    let mut coverage = json!({"of_total": 0.7});
    shares.iter().for_each(|share| coverage[share] = json!(0.9));
    serde_json::from_value(json!({
        "schema": "vantage.summary/1", "level": "ready", "title": "Ready to scan", "verdict": "target_met", "verdict_text": "Target met", "views": 9, "views_chosen": 10,
        "setups": 1, "views_text": "9 views", "coverage": coverage, "coverage_text": "90 %",
        "grades": {"A": 0.4, "B": 0.3, "C": 0.0, "D": 0.0}, "cycle_secs": null, "cycle_parts": null, "cycle_text": null,
        "regions_with_target": 0, "regions_unmet": 0, "missed_of_asked": 0.3, "missed_spots": 0, "missed_text": "nothing",
        "missed": [], "action": null, "plan_sha256": "ab"
    }))
    .expect("a summary")
}

/// A job that succeeded with the summary.
async fn summarised(store: &Store) -> JobId {
    let mesh = add_mesh(store, b"one").await.id;
    let id = submit(store, mesh).await;
    store.claim_next().await.expect("the queue").expect("the job");
    let outcome = AttemptOutcome::Succeeded { files: Vec::new(), summary: Some(Box::new(summary())), warnings: Vec::new() };
    assert_eq!(store.end_attempt(id, &outcome, "{}").await.expect("an end"), JobState::Succeeded);
    id
}

async fn listed(store: &Store) -> Option<Summary> {
    let page = store.jobs(&JobQuery::default(), &Page::new(10, None, "").expect("a page")).await.expect("a list");
    page.items.into_iter().next().expect("a job").summary
}

#[tokio::test]
async fn a_summary_is_with_the_job_in_lists_and_in_its_event() {
    let opened = open().await;
    let id = summarised(&opened.store).await;
    let opened = opened.reopen().await;
    let store = &opened.store;
    assert_eq!(store.job(id).await.expect("it").summary, Some(summary()));
    assert_eq!(listed(store).await, Some(summary()));
    let events = store.events_after(Some(id), 0, 100).await.expect("events").events;
    let told: Vec<_> = events.iter().map(|event| (event.kind, event.summary.as_ref().map(|summary| summary.verdict))).collect();
    assert_eq!(
        told,
        [(EventKind::Queued, None), (EventKind::Started, None), (EventKind::Succeeded, Some(PlanVerdict::TargetMet))]
    );
}

#[tokio::test]
async fn a_summary_that_cannot_be_read_hides_itself_alone() {
    let opened = open().await;
    let store = &opened.store;
    let id = summarised(store).await;
    for damage in ["UPDATE job_summary SET summary = '{'", "UPDATE job_summary SET summary = '{\"verdict\": \"splendid\"}'"] {
        sqlx::query(damage).execute(&store.reader).await.expect("damaged");
        let job = store.job(id).await.expect("it");
        assert_eq!((job.state, job.summary, job.problem), (JobState::Succeeded, None, None), "{damage}");
        assert_eq!(listed(store).await, None, "{damage}");
    }
}

#[tokio::test]
async fn a_summary_goes_with_its_job_and_a_job_that_was_cancelled_has_none() {
    let opened = open().await;
    let store = &opened.store;
    let id = summarised(store).await;
    let count = async || -> i64 {
        sqlx::query_scalar("SELECT count(*) FROM job_summary").fetch_one(&store.reader).await.expect("a number")
    };
    assert_eq!(count().await, 1);
    store.delete_job(id, "hold", None).await.expect("deleted");
    assert_eq!(count().await, 0);
    let mesh = add_mesh(store, b"two").await.id;
    let cancelled = submit(store, mesh).await;
    store.claim_next().await.expect("the queue").expect("the job");
    store.cancel(cancelled).await.expect("asked");
    let outcome = AttemptOutcome::Succeeded { files: Vec::new(), summary: Some(Box::new(summary())), warnings: Vec::new() };
    assert_eq!(store.end_attempt(cancelled, &outcome, "{}").await.expect("an end"), JobState::Cancelled);
    assert_eq!((count().await, store.job(cancelled).await.expect("it").summary), (0, None));
}
