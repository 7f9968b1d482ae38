//! A planning job: what is asked for, and how it stands.

use std::collections::BTreeMap;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::echo::Echo;
use super::ids::{JobId, MeshId};
use super::problem::JobProblem;
use crate::cell::{CellSpec, FieldError, Findings, Named, ScannerSpec};
use crate::planning::params::PlanParams;

/// What is to be planned. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct JobRequest {
    /// The mesh to plan for.
    pub mesh_id: MeshId,
    /// The cell: a stored name, a specification, or `"none"` for viewpoints alone. Default `e05-transcan`.
    #[serde(default = "default_cell")]
    pub cell: Named<CellSpec>,
    /// The scanner, when `cell` is `"none"`: a stored name or a specification. Default `transcan-c`. A cell has its own.
    #[serde(default = "default_scanner")]
    pub scanner: Named<ScannerSpec>,
    /// Parameters of the plan.
    #[serde(default)]
    pub params: PlanParams,
    /// Labels, echoed in job, plan and program: at most 32, keys of 1 to 64 and values of up to 256 characters.
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
    /// Part number, echoed likewise.
    #[serde(default)]
    #[schema(max_length = 128)]
    pub part_number: Option<String>,
    /// Serial number, echoed likewise.
    #[serde(default)]
    #[schema(max_length = 128)]
    pub serial: Option<String>,
    /// Higher goes first, -100 to 100. Default 0.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    pub priority: i32,
}

fn default_cell() -> Named<CellSpec> {
    Named::Name("e05-transcan".into())
}

fn default_scanner() -> Named<ScannerSpec> {
    Named::Name("transcan-c".into())
}

impl JobRequest {
    /// A request with every default.
    #[must_use]
    pub fn new(mesh_id: MeshId) -> Self {
        Self {
            mesh_id,
            cell: default_cell(),
            scanner: default_scanner(),
            params: PlanParams::default(),
            labels: BTreeMap::new(),
            part_number: None,
            serial: None,
            priority: 0,
        }
    }

    /// The fields that are echoed.
    #[must_use]
    pub fn echo(&self) -> Echo {
        Echo { labels: self.labels.clone(), part_number: self.part_number.clone(), serial: self.serial.clone() }
    }

    /// Checks ranges, the parameters' included; whether what is named exists is for the service to say.
    ///
    /// # Errors
    /// All fields at fault.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check_echo(&mut findings);
        findings.range("/priority", f64::from(self.priority), -100.0, 100.0, "");
        let mut errors = findings.into_result().err().unwrap_or_default();
        errors.extend(self.params.check().err().into_iter().flatten().map(|e| below("/params", e)));
        if errors.is_empty() { Ok(()) } else { Err(errors) }
    }

    fn check_echo(&self, findings: &mut Findings) {
        check_labels(findings, &self.labels);
        for (pointer, value) in [("/part_number", &self.part_number), ("/serial", &self.serial)] {
            if let Some(value) = value {
                text(findings, pointer, value, 0, 128);
            }
        }
    }
}

fn check_labels(findings: &mut Findings, labels: &BTreeMap<String, String>) {
    findings.require(labels.len() <= 32, "/labels", || format!("has {} entries; allowed are up to 32", labels.len()));
    for (key, value) in labels {
        text(findings, "/labels", key, 1, 64);
        text(findings, &format!("/labels/{}", key.replace('~', "~0").replace('/', "~1")), value, 0, 256);
    }
}

fn text(findings: &mut Findings, pointer: &str, value: &str, low: usize, high: usize) {
    let length = value.chars().count();
    findings.require((low..=high).contains(&length), pointer, || format!("has {length} characters; allowed are {low} to {high}"));
    findings.require(!value.chars().any(char::is_control), pointer, || "has a control character; none is allowed".into());
}

/// The finding, as one of a part at `prefix`.
fn below(prefix: &str, error: FieldError) -> FieldError {
    FieldError { pointer: format!("{prefix}{}", error.pointer), detail: error.detail }
}

/// Where a job stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Waits for its turn.
    Queued,
    /// Is planned.
    Running,
    /// Is planned, and will stop.
    Cancelling,
    /// Has results.
    Succeeded,
    /// Ended without a result; `problem` says why.
    Failed,
    /// Was cancelled.
    Cancelled,
}

impl JobState {
    /// Every state.
    pub const ALL: [Self; 6] = [Self::Queued, Self::Running, Self::Cancelling, Self::Succeeded, Self::Failed, Self::Cancelled];

    /// Name in files and answers.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Cancelling => "cancelling",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    /// Whether nothing will happen to the job any more.
    #[must_use]
    pub fn is_ended(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }
}

impl FromStr for JobState {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|state| state.as_str() == text).ok_or_else(|| format!("no job state is called {text:?}"))
    }
}

/// A job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Job {
    /// Its id.
    pub id: JobId,
    /// Where it stands.
    pub state: JobState,
    /// The mesh planned for.
    pub mesh_id: MeshId,
    /// The cell, as asked for.
    pub cell: Named<CellSpec>,
    /// The scanner, as asked for; counts when `cell` is `"none"`.
    pub scanner: Named<ScannerSpec>,
    /// Parameters, defaults filled in.
    pub params: PlanParams,
    /// Labels, as given, or as `PUT /jobs/{id}/labels` left them.
    pub labels: BTreeMap<String, String>,
    /// Part number, as given.
    pub part_number: Option<String>,
    /// Serial number, as given.
    pub serial: Option<String>,
    /// Higher goes first.
    pub priority: i32,
    /// Stage of planning, while it runs: `surface`, `candidates`, `stations`, `visibility`, `selection`, `sequence`,
    /// `missed`, `report`.
    pub stage: Option<String>,
    /// Share of the work that is done, 0 to 1; never falls within an attempt.
    pub fraction: f64,
    /// Its place in the queue from 1, while it is queued.
    pub queue_position: Option<u64>,
    /// How often it was started.
    pub attempts: u32,
    /// When it was accepted, UTC.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// When its last attempt began, UTC.
    #[schema(format = DateTime)]
    pub started_at: Option<String>,
    /// When it ended, UTC.
    #[schema(format = DateTime)]
    pub ended_at: Option<String>,
    /// Seconds spent in each stage so far.
    pub timings: BTreeMap<String, f64>,
    /// Why it failed; with the code `job_unreadable`, why its stored request cannot be shown: then `cell`, `scanner` and
    /// `params` are defaults.
    pub problem: Option<JobProblem>,
    /// SHA-256 of `plan.json`, once it succeeded.
    pub plan_sha256: Option<String>,
    /// The files that came out, by name; each is at `/jobs/{id}/files/{name}`.
    pub results: Vec<JobFile>,
}

/// A file that came out of a job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct JobFile {
    /// Its name.
    pub name: String,
    /// SHA-256, lower-case hexadecimal.
    pub sha256: String,
    /// Its size.
    pub size_bytes: u64,
}

/// A job in a list: how it stands, without what it was asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobListItem {
    /// Its id.
    pub id: JobId,
    /// Where it stands.
    pub state: JobState,
    /// The mesh planned for.
    pub mesh_id: MeshId,
    /// Name of the cell.
    pub cell: String,
    /// Name of the scanner; counts when `cell` is `"none"`.
    pub scanner: String,
    /// Labels.
    pub labels: BTreeMap<String, String>,
    /// Part number, as given.
    pub part_number: Option<String>,
    /// Serial number, as given.
    pub serial: Option<String>,
    /// Higher goes first.
    pub priority: i32,
    /// Stage of planning, while it runs.
    pub stage: Option<String>,
    /// Share of the work that is done, 0 to 1; never falls within an attempt.
    pub fraction: f64,
    /// Its place in the queue from 1, while it is queued.
    pub queue_position: Option<u64>,
    /// How often it was started.
    pub attempts: u32,
    /// When it was accepted, UTC.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// When its last attempt began, UTC.
    #[schema(format = DateTime)]
    pub started_at: Option<String>,
    /// When it ended, UTC.
    #[schema(format = DateTime)]
    pub ended_at: Option<String>,
    /// Seconds spent in each stage so far.
    pub timings: BTreeMap<String, f64>,
    /// Why it failed.
    pub problem: Option<JobProblem>,
    /// SHA-256 of `plan.json`, once it succeeded.
    pub plan_sha256: Option<String>,
    /// The files that came out, by name; each is at `/jobs/{id}/files/{name}`.
    pub results: Vec<JobFile>,
}

/// One page of jobs, newest first. A page ends early where its entries would take more than 4 MiB.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobPage {
    /// The jobs.
    pub items: Vec<JobListItem>,
    /// Token of the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_page_token: Option<String>,
}

/// Labels of a job, all of them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct JobLabels {
    /// At most 32, keys of 1 to 64 and values of up to 256 characters.
    pub labels: BTreeMap<String, String>,
}

impl JobLabels {
    /// Checks ranges.
    ///
    /// # Errors
    /// All fields at fault.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        check_labels(&mut findings, &self.labels);
        findings.into_result()
    }
}
