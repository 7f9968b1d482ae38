//! Lists of jobs: pages of job summaries, without the parameters. Every filter has its index, and the cost of a page depends
//! on its size, not on the number of stored jobs; queue positions are counted once per page.

use std::collections::HashMap;

use futures_util::TryStreamExt;
use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row, Sqlite};

use super::jobs::{read_problem, read_state};
use super::pages::Page;
use super::stored::{VERSION, read_leniently};
use super::{Store, summaries};
use crate::service::error::Error;
use crate::wire::{JobFile, JobListItem, JobPage, JobState};

/// Filters of a job listing.
#[derive(Clone, Debug, Default)]
pub(crate) struct JobFilter {
    pub state: Option<JobState>,
    /// Key, and value if one is given.
    pub label: Option<(String, Option<String>)>,
    pub part_number: Option<String>,
}

impl Store {
    /// A page of jobs, newest first.
    pub(crate) async fn jobs(&self, filter: &JobFilter, page: &Page) -> Result<JobPage, Error> {
        let rows = query(filter, page).build().fetch_all(&self.reader).await?;
        let mut items: Vec<JobListItem> = rows.iter().filter_map(read).collect();
        // Unreadable rows are skipped; the next page begins after the last readable one.
        let next_page_token = page.cut(&mut items, |job| job.id.to_string())?;
        if items.iter().any(|job| job.state == JobState::Queued) {
            let positions = self.queue_positions(&items).await?;
            for job in &mut items {
                job.queue_position = positions.get(&job.id.to_string()).copied();
            }
        }
        Ok(JobPage { items, next_page_token })
    }

    /// Positions in the queue, counted from 1, of the queued ones of these jobs.
    async fn queue_positions(&self, jobs: &[JobListItem]) -> Result<HashMap<String, u64>, Error> {
        let wanted: Vec<String> = jobs.iter().filter(|job| job.state == JobState::Queued).map(|job| job.id.to_string()).collect();
        let mut positions: HashMap<String, u64> = HashMap::with_capacity(wanted.len());
        let mut queue = sqlx::query_scalar::<_, String>(
            "SELECT id FROM job INDEXED BY job_queue WHERE state = 'queued' ORDER BY priority DESC, id",
        )
        .fetch(&self.reader);
        let (wanted, mut position): (std::collections::HashSet<_>, u64) = (wanted.into_iter().collect(), 0);
        while let Some(id) = queue.try_next().await? {
            position += 1;
            if wanted.contains(&id) {
                positions.insert(id, position);
            }
            if positions.len() == wanted.len() {
                break;
            }
        }
        Ok(positions)
    }
}

/// Query of a page. A label is looked up first, in its own index; the other filters have their own.
fn query(filter: &JobFilter, page: &Page) -> QueryBuilder<Sqlite> {
    let mut query = QueryBuilder::new(
        "SELECT job.id, state, mesh_id, part_number, serial, cell, scanner, labels, priority, stage, fraction, attempts, timings,
            problem, created_at, started_at, ended_at,
            (SELECT json_group_array(json_object('name', name, 'sha256', sha256, 'size_bytes', size_bytes))
                FROM (SELECT * FROM artifact WHERE job_id = job.id ORDER BY name)) AS results,
            (SELECT summary FROM job_summary WHERE job_id = job.id) AS summary
         FROM ",
    );
    let order = match &filter.label {
        None => {
            query.push("job WHERE job.id < ").push_bind(page.before.clone());
            "job.id"
        }
        Some((key, value)) => {
            query.push("job_label AS label CROSS JOIN job ON job.id = label.job_id WHERE label.key = ").push_bind(key.clone());
            if let Some(value) = value {
                query.push(" AND label.value = ").push_bind(value.clone());
            }
            query.push(" AND label.job_id < ").push_bind(page.before.clone());
            "label.job_id"
        }
    };
    if let Some(state) = filter.state {
        query.push(" AND state = ").push_bind(state.as_str());
    }
    if let Some(part_number) = &filter.part_number {
        query.push(" AND part_number = ").push_bind(part_number.clone());
    }
    query.push(" ORDER BY ").push(order).push(" DESC LIMIT ").push_bind(page.limit());
    query
}

/// Reads a row; unreadable fields are left empty, and a row with an unreadable id is skipped.
fn read(row: &SqliteRow) -> Option<JobListItem> {
    let text = |column: &str| row.try_get::<Option<String>, _>(column).ok().flatten();
    let id = text("id")?;
    let Ok(id) = id.parse() else {
        tracing::warn!(id, "a job is missing in a list: its id cannot be read");
        return None;
    };
    let state = read_state(&text("state").unwrap_or_default());
    let results: Vec<JobFile> =
        text("results").and_then(|json| read_leniently(VERSION, &json).ok()).map_or_else(Vec::new, |read| read.0);
    Some(JobListItem {
        id,
        state: state.as_ref().copied().unwrap_or(JobState::Failed),
        mesh_id: text("mesh_id")?.parse().ok()?,
        cell: text("cell").unwrap_or_default(),
        scanner: text("scanner").unwrap_or_default(),
        labels: text("labels").and_then(|json| serde_json::from_str(&json).ok()).unwrap_or_default(),
        part_number: text("part_number"),
        serial: text("serial"),
        priority: row.try_get("priority").unwrap_or_default(),
        stage: text("stage"),
        fraction: row.try_get("fraction").unwrap_or_default(),
        queue_position: None,
        attempts: row.try_get("attempts").unwrap_or_default(),
        created_at: text("created_at").unwrap_or_default(),
        started_at: text("started_at"),
        ended_at: text("ended_at"),
        timings: text("timings").and_then(|json| serde_json::from_str(&json).ok()).unwrap_or_default(),
        problem: state.err().or_else(|| read_problem(text("problem"))),
        plan_sha256: results.iter().find(|file| file.name == "plan.json").map(|file| file.sha256.clone()),
        summary: summaries::read(text("summary")),
        results,
    })
}
