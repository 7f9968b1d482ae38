//! Lists of jobs: pages of job summaries, without the parameters. Every filter and every order has its index, and the cost of a
//! page depends on its size, not on the number of stored jobs; queue positions are counted once per page. A filter together with
//! an order other than by creation is sorted on the way, and costs as much as the jobs that it finds.

use std::collections::HashMap;

use futures_util::TryStreamExt;
use sqlx::sqlite::SqliteRow;
use sqlx::{QueryBuilder, Row, Sqlite};

use super::job_rows::{read_problem, read_state};
use super::pages::{Page, Place};
use super::stored::{VERSION, read_leniently};
use super::{Store, artifacts, summaries};
use crate::service::error::Error;
use crate::wire::{
    JobFile, JobId, JobListItem, JobPage, JobSelection, JobSort, JobSortKey, JobState, UtcTime, parse, unless_blank,
};

/// Filters and order of a job listing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JobQuery {
    /// Jobs that are listed.
    pub selection: JobSelection,
    /// Order of the jobs.
    pub sort: JobSort,
}

/// A job that filters match.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MatchingJob {
    pub id: JobId,
    pub has_ended: bool,
    /// True if it has the hold label.
    pub is_held: bool,
}

/// Key of a job that has not ended, after every time.
const NOT_ENDED: &str = "~";

impl Store {
    /// A page of jobs. Rows that cannot be read are left out, and the next page begins behind the last row, readable or not.
    pub(crate) async fn jobs(&self, asked: &JobQuery, page: &Page) -> Result<JobPage, Error> {
        let rows = query(asked, page).build().fetch_all(&self.reader).await?;
        let (mut items, next_page_token) = page.cut(rows.iter().map(|row| (place(row, asked.sort.key), read(row))))?;
        if items.iter().any(|job| job.state == JobState::Queued) {
            let positions = self.queue_positions(&items).await?;
            for job in &mut items {
                job.queue_position = positions.get(&job.id.to_string()).copied();
            }
        }
        Ok(JobPage { items, next_page_token })
    }

    /// Jobs that the filters match, oldest first.
    pub(crate) async fn matching(&self, asked: &JobQuery, hold: &str) -> Result<Vec<MatchingJob>, Error> {
        let mut query = QueryBuilder::new(
            "SELECT job.id, state, EXISTS (SELECT 1 FROM job_label AS hold WHERE hold.job_id = job.id AND hold.key = ",
        );
        query.push_bind(hold.to_owned()).push(") AS is_held FROM ");
        push_filters(&mut query, &asked.selection);
        let rows = query.push(" ORDER BY job.id").build().fetch_all(&self.reader).await?;
        let read = |row: &SqliteRow| -> Result<Option<MatchingJob>, Error> {
            // A job whose id cannot be read cannot be addressed by it.
            let Ok(id) = row.try_get::<String, _>("id")?.parse() else { return Ok(None) };
            // An unreadable state counts as failed, so that the job can be deleted.
            let has_ended = read_state(&row.try_get::<String, _>("state")?).map_or(true, JobState::is_ended);
            Ok(Some(MatchingJob { id, has_ended, is_held: row.try_get("is_held")? }))
        };
        rows.iter().filter_map(|row| read(row).transpose()).collect()
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

/// Place of a row in a listing.
fn place(row: &SqliteRow, key: JobSortKey) -> Place {
    let text = |column: &str| row.try_get::<Option<String>, _>(column).ok().flatten();
    let key = match key {
        JobSortKey::CreatedAt => None,
        JobSortKey::EndedAt => text("ended_at").or_else(|| Some(NOT_ENDED.to_owned())),
        JobSortKey::PartNumber => text("part_number"),
        JobSortKey::Serial => text("serial"),
    };
    Place { key: key.unwrap_or_default(), id: text("id").unwrap_or_default() }
}

/// Expression of an order's key, as its index has it; none for the order of the ids, which is that of creation.
fn key_expression(key: JobSortKey) -> Option<&'static str> {
    match key {
        JobSortKey::CreatedAt => None,
        JobSortKey::EndedAt => Some("coalesce(ended_at, '~')"),
        JobSortKey::PartNumber => Some("coalesce(part_number, '')"),
        JobSortKey::Serial => Some("coalesce(serial, '')"),
    }
}

/// Query of a page.
fn query(asked: &JobQuery, page: &Page) -> QueryBuilder<Sqlite> {
    let mut query = QueryBuilder::new(
        "SELECT job.id, state, mesh_id, part_number, serial, cell, scanner, labels, priority, stage, fraction, attempts, timings,
            problem, created_at, started_at, ended_at, submitted_by, warnings,
            (SELECT json_group_array(json_object('name', name, 'sha256', sha256, 'size_bytes', size_bytes))
                FROM (SELECT * FROM artifact WHERE job_id = job.id ORDER BY name)) AS results,
            (SELECT summary FROM job_summary WHERE job_id = job.id) AS summary
         FROM ",
    );
    push_filters(&mut query, &asked.selection);
    push_order(&mut query, asked, page);
    query
}

/// Adds the tables and conditions of the filters. A label is looked up first, in its own index; the other filters have their own.
fn push_filters(query: &mut QueryBuilder<Sqlite>, filter: &JobSelection) {
    match &filter.label {
        None => {
            query.push("job WHERE 1");
        }
        Some(label) => {
            let (key, value) = label.split_once('=').map_or((&label[..], None), |(key, value)| (key, Some(value)));
            query.push("job_label AS label CROSS JOIN job ON job.id = label.job_id WHERE label.key = ").push_bind(key.to_owned());
            if let Some(value) = value {
                query.push(" AND label.value = ").push_bind(value.to_owned());
            }
        }
    }
    if let Some(ids) = &filter.ids {
        query.push(" AND job.id IN (");
        let mut list = query.separated(", ");
        for id in ids {
            list.push_bind(id.to_string());
        }
        query.push(")");
    }
    let mesh_id = filter.mesh_id.map(|id| id.to_string());
    let created = |time: &Option<UtcTime>| time.as_ref().map(|time| time.as_str().to_owned());
    for (condition, value) in [
        ("state = ", filter.state.map(|state| state.as_str().to_owned())),
        ("part_number = ", filter.part_number.clone()),
        ("serial = ", filter.serial.clone()),
        ("mesh_id = ", mesh_id),
        ("cell = ", filter.cell.clone()),
        ("created_at >= ", created(&filter.created_after)),
        ("created_at < ", created(&filter.created_before)),
    ] {
        if let Some(value) = value {
            query.push(" AND ").push(condition).push_bind(value);
        }
    }
}

/// Adds the order, and the condition that a row comes after the previous page.
fn push_order(query: &mut QueryBuilder<Sqlite>, asked: &JobQuery, page: &Page) {
    let id = if asked.selection.label.is_some() { "label.job_id" } else { "job.id" };
    let (beyond, direction) = if asked.sort.descending { ("<", " DESC") } else { (">", "") };
    match (key_expression(asked.sort.key), &page.after) {
        (_, None) => {}
        (None, Some(place)) => {
            query.push(format!(" AND {id} {beyond} ")).push_bind(place.id.clone());
        }
        (Some(key), Some(place)) => {
            // The first comparison leads into the index; without OR, for which SQLite would look into two.
            query.push(format!(" AND {key} {beyond}= ")).push_bind(place.key.clone());
            query.push(format!(" AND NOT ({key} = ")).push_bind(place.key.clone());
            query.push(format!(" AND job.id {} ", if asked.sort.descending { ">=" } else { "<=" }));
            query.push_bind(place.id.clone()).push(")");
        }
    }
    query.push(" ORDER BY ");
    match key_expression(asked.sort.key) {
        None => query.push(id).push(direction),
        Some(key) => query.push(format!("{key}{direction}, job.id{direction}")),
    };
    query.push(" LIMIT ").push_bind(page.limit());
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
    let results = artifacts::listed(results);
    Some(JobListItem {
        id,
        state: state.as_ref().copied().unwrap_or(JobState::Failed),
        mesh_id: text("mesh_id")?.parse().ok()?,
        cell: text("cell").unwrap_or_default(),
        scanner: text("scanner").unwrap_or_default(),
        labels: text("labels").and_then(|json| parse(json.as_bytes()).ok()).unwrap_or_default(),
        part_number: unless_blank(text("part_number")),
        serial: unless_blank(text("serial")),
        priority: row.try_get("priority").unwrap_or_default(),
        stage: text("stage"),
        fraction: row.try_get("fraction").unwrap_or_default(),
        queue_position: None,
        attempts: row.try_get("attempts").unwrap_or_default(),
        created_at: text("created_at").unwrap_or_default(),
        started_at: text("started_at"),
        ended_at: text("ended_at"),
        timings: text("timings").and_then(|json| parse(json.as_bytes()).ok()).unwrap_or_default(),
        warnings: text("warnings").and_then(|json| parse(json.as_bytes()).ok()).unwrap_or_default(),
        problem: state.err().or_else(|| read_problem(text("problem"))),
        submitted_by: text("submitted_by"),
        plan_sha256: results.iter().find(|file| file.name == "plan.json").and_then(|file| file.sha256.clone()),
        summary: summaries::read(text("summary")),
        results,
    })
}
