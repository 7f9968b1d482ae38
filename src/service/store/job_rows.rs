//! Reading of the rows of jobs. What cannot be read harms itself alone: the job is shown with the reason, and can be cancelled and
//! deleted.

use sqlx::sqlite::SqliteRow;
use sqlx::{Row, SqliteConnection};

use super::stored::{VERSION, read_leniently};
use super::{artifacts, parsed, summaries};
use crate::service::error::Error;
use crate::service::jobs::failure;
use crate::wire::warnings::FieldWarning;
use crate::wire::{FailureCode, Job, JobId, JobProblem, JobRequest, JobState, parse, unless_blank, warnings};

/// `SELECT` of everything that [`read`] needs.
macro_rules! select_job {
    () => {
        "SELECT id, state, mesh_id, part_number, serial, cell, scanner, labels, version, request, priority, stage, fraction, attempts,
            timings, problem, created_at, started_at, ended_at, submitted_by, warnings,
            CASE WHEN json_valid(input) THEN input -> '$.warnings' END AS found,
            CASE WHEN state = 'queued' THEN (SELECT count(*) FROM job AS other INDEXED BY job_queue WHERE other.state = 'queued'
                AND (other.priority > job.priority OR (other.priority = job.priority AND other.id <= job.id))) END AS position,
            (SELECT json_group_array(json_object('name', name, 'sha256', sha256, 'size_bytes', size_bytes))
                FROM (SELECT * FROM artifact WHERE job_id = job.id ORDER BY name)) AS results,
            (SELECT summary FROM job_summary WHERE job_id = job.id) AS summary
         FROM job LEFT JOIN job_body ON job_body.job_id = job.id "
    };
}

/// State of a job. An unreadable state counts as failed, so that the job can be deleted.
pub(super) async fn state_of(tx: &mut SqliteConnection, id: JobId) -> Result<JobState, Error> {
    let state: Option<String> =
        sqlx::query_scalar("SELECT state FROM job WHERE id = ?1").bind(id.to_string()).fetch_optional(tx).await?;
    Ok(read_state(&state.ok_or(Error::JobNotFound(id))?).unwrap_or(JobState::Failed))
}

pub(super) async fn fetch(tx: &mut SqliteConnection, id: JobId) -> Result<Job, Error> {
    let row = sqlx::query(concat!(select_job!(), "WHERE id = ?1")).bind(id.to_string()).fetch_optional(tx).await?;
    read(&row.ok_or(Error::JobNotFound(id))?)
}

/// Share of a job that is done, of its row. One that cannot be read keeps no job from ending.
pub(super) fn fraction_of(row: &SqliteRow) -> f64 {
    row.try_get("fraction").unwrap_or_default()
}

/// The problem of a job that cannot be read.
pub(super) fn unreadable(reason: String) -> JobProblem {
    failure(FailureCode::JobUnreadable, reason, Vec::new())
}

/// Parses a job's state; if it is unreadable, returns the problem to show with the job.
pub(super) fn read_state(text: &str) -> Result<JobState, JobProblem> {
    text.parse().map_err(|_| unreadable(format!("its state {text:?} is unknown to this version")))
}

/// Stored problem of a failed job.
pub(super) fn read_problem(text: Option<String>) -> Option<JobProblem> {
    let text = text?;
    let read = read_leniently(VERSION, &text).map(|(problem, _)| problem);
    Some(read.unwrap_or_else(|reason| unreadable(format!("the stored reason for its failure cannot be read: {reason}"))))
}

/// Reads a row. An unreadable request is replaced by the defaults, with the reason as `problem`, so that the job can still be
/// seen, cancelled and deleted.
fn read(row: &SqliteRow) -> Result<Job, Error> {
    let text = |column: &str| row.try_get::<Option<String>, _>(column).ok().flatten();
    let (state, mesh_id) = (read_state(&text("state").unwrap_or_default()), text("mesh_id").unwrap_or_default());
    let request = match (text("request"), row.try_get("version")) {
        (Some(request), Ok(version)) => read_leniently::<JobRequest>(version, &request).map(|(request, _)| request),
        _ => Err("its request is missing in the database".to_owned()),
    };
    let (request, unreadable_request) = match request {
        Ok(request) => (request, None),
        Err(reason) => (JobRequest::new(parsed("job.mesh_id", &mesh_id)?), Some(unreadable(reason))),
    };
    let scanner = request.scanner_or_default();
    let results = artifacts::listed(parse(row.try_get::<String, _>("results")?.as_bytes())?);
    let position: Option<i64> = row.try_get("position")?;
    let problem = read_problem(text("problem")).or(unreadable_request);
    let mut warnings = warnings::of_params(&request.params, "/params");
    // Jobs of earlier versions have none; one that cannot be read tells no less of the job.
    warnings.extend(text("found").and_then(|json| parse::<Vec<FieldWarning>>(json.as_bytes()).ok()).unwrap_or_default());
    let stored = text("warnings").and_then(|json| parse::<Vec<FieldWarning>>(json.as_bytes()).ok()).unwrap_or_default();
    warnings.extend(stored.into_iter().filter(|warning| warning.code.is_of_plan()));
    Ok(Job {
        id: parsed("job.id", &row.try_get::<String, _>("id")?)?,
        state: state.as_ref().copied().unwrap_or(JobState::Failed),
        mesh_id: request.mesh_id,
        cell: request.cell,
        scanner,
        // Sent again as they are shown, they are those of the same plan: with its defaults a preset would be refused.
        params: request.params.preset.apply(&request.params),
        labels: text("labels").and_then(|json| parse(json.as_bytes()).ok()).unwrap_or_default(),
        part_number: unless_blank(text("part_number")),
        serial: unless_blank(text("serial")),
        priority: row.try_get("priority")?,
        stage: text("stage"),
        fraction: row.try_get("fraction")?,
        queue_position: position.map(i64::unsigned_abs),
        attempts: row.try_get("attempts")?,
        created_at: row.try_get("created_at")?,
        started_at: text("started_at"),
        ended_at: text("ended_at"),
        timings: text("timings").and_then(|json| parse(json.as_bytes()).ok()).unwrap_or_default(),
        warnings,
        regions: Vec::new(),
        problem: state.err().or(problem),
        submitted_by: text("submitted_by"),
        plan_sha256: results.iter().find(|file| file.name == "plan.json").and_then(|file| file.sha256.clone()),
        summary: summaries::read(text("summary")),
        results,
    })
}
