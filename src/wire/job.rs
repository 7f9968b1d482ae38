//! A planning job: its request and its state.

use std::collections::BTreeMap;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use super::echo::Echo;
use super::ids::{JobId, MeshId};
use super::plan::RegionCoverageDocument;
use super::problem::JobProblem;
use super::summary::Summary;
use super::warnings::FieldWarning;
use super::words::is_control;
use crate::cell::{CellSpec, FieldError, Findings, Named, ScannerSpec, field_ranges};
use crate::planning::params::PlanParams;

/// A request for a planning job. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct JobRequest {
    /// Id of the mesh to plan for.
    pub mesh_id: MeshId,
    /// Cell: name of a stored one, a specification, or `"none"` to plan viewpoints only. Default `e05-transcan`.
    #[serde(default = "default_cell")]
    pub cell: Named<CellSpec>,
    /// Scanner of a job without a cell: name of a stored one, or a specification. Default `transcan-c`. A cell has its own; no
    /// other is accepted beside it.
    #[serde(default)]
    pub scanner: Option<Named<ScannerSpec>>,
    /// Planning parameters.
    #[serde(default)]
    pub params: PlanParams,
    /// Labels, copied to the job, the plan and the program: at most 32, keys of 1 to 64 characters without `=`, and values of up to
    /// 256 characters.
    #[serde(default)]
    pub labels: BTreeMap<String, String>,
    /// Part number, copied like the labels. A blank one is the same as none.
    #[serde(default, deserialize_with = "read_number")]
    #[schema(max_length = 128)]
    pub part_number: Option<String>,
    /// Serial number, copied like the labels. A blank one is the same as none.
    #[serde(default, deserialize_with = "read_number")]
    #[schema(max_length = 128)]
    pub serial: Option<String>,
    /// Priority, -100 to 100; jobs with a higher one start first. Default 0.
    #[serde(default)]
    pub priority: i32,
}

/// Largest priority of a job; the lowest is its negative.
pub(super) const MAX_PRIORITY: f64 = 100.0;

field_ranges! {
    JobRequest {
        PRIORITY = "priority", [-MAX_PRIORITY, MAX_PRIORITY] "";
    }
}

/// Reads a part number or a serial number.
fn read_number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    Option::deserialize(deserializer).map(unless_blank)
}

/// The part number or serial number, unless it is blank: that is the same as none.
pub(crate) fn unless_blank(number: Option<String>) -> Option<String> {
    number.filter(|number| !number.trim().is_empty())
}

fn default_cell() -> Named<CellSpec> {
    Named::Name("e05-transcan".into())
}

impl JobRequest {
    /// A request with the default of every field but the mesh.
    #[must_use]
    pub fn new(mesh_id: MeshId) -> Self {
        Self {
            mesh_id,
            cell: default_cell(),
            scanner: None,
            params: PlanParams::default(),
            labels: BTreeMap::new(),
            part_number: None,
            serial: None,
            priority: 0,
        }
    }

    /// The scanner given; without one, the default of a job without a cell.
    #[must_use]
    pub fn scanner_or_default(&self) -> Named<ScannerSpec> {
        self.scanner.clone().unwrap_or_else(|| Named::Name("transcan-c".into()))
    }

    /// The fields that are copied to the plan and the program.
    #[must_use]
    pub fn echo(&self) -> Echo {
        Echo::given(self.labels.clone(), self.part_number.clone(), self.serial.clone())
    }

    /// Checks the ranges of all fields and parameters. The service checks that the mesh, cell and scanner exist.
    ///
    /// # Errors
    /// All invalid fields.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut errors = self.echo().check().err().unwrap_or_default();
        let mut findings = Findings::default();
        Self::PRIORITY.check("", &self.priority, &mut findings);
        errors.extend(findings.into_result().err().into_iter().flatten());
        errors.extend(self.params.check().err().into_iter().flatten().map(|e| below("/params", e)));
        if errors.is_empty() { Ok(()) } else { Err(errors) }
    }
}

impl Echo {
    /// Labels and numbers that were given; a blank number is the same as none.
    #[must_use]
    pub fn given(labels: BTreeMap<String, String>, part_number: Option<String>, serial: Option<String>) -> Self {
        Self { labels, part_number: unless_blank(part_number), serial: unless_blank(serial) }
    }

    /// Checks the lengths and the characters of labels and numbers.
    ///
    /// # Errors
    /// All invalid fields.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        check_labels(&mut findings, &self.labels);
        for (pointer, value) in [("/part_number", &self.part_number), ("/serial", &self.serial)] {
            if let Some(value) = value {
                text(&mut findings, pointer, value, 0, 128);
            }
        }
        findings.into_result()
    }
}

/// Max labels of a job.
pub const MAX_LABELS: usize = 32;

fn check_labels(findings: &mut Findings, labels: &BTreeMap<String, String>) {
    findings.require(labels.len() <= MAX_LABELS, "/labels", || {
        format!("has {} entries; at most {MAX_LABELS} are allowed", labels.len())
    });
    for (key, value) in labels {
        let at = format!("/labels/{}", key.replace('~', "~0").replace('/', "~1"));
        let length = key.chars().count();
        findings.require((1..=64).contains(&length), &*at, || format!("has a key of {length} characters; allowed are 1 to 64"));
        findings
            .require(!key.chars().any(is_control), &*at, || "has a control character in its key; none are allowed".to_owned());
        // A list would take what follows for the value.
        findings.require(!key.contains('='), &*at, || {
            "has \"=\" in its key; any other character is allowed, since `?label=key=value` finds jobs by it".to_owned()
        });
        text(findings, &at, value, 0, 256);
    }
}

/// Reason for which a filter by a label, `key` or `key=value`, finds no job, ever: it names no key. `None` for any other.
#[must_use]
pub fn label_filter_fault(filter: &str) -> Option<String> {
    let is_keyless = filter.is_empty() || filter.starts_with('=');
    is_keyless
        .then(|| format!("is {filter:?}, which names no key; allowed is key or key=value, with a key of 1 to 64 characters"))
}

fn text(findings: &mut Findings, pointer: &str, value: &str, low: usize, high: usize) {
    let length = value.chars().count();
    findings.require((low..=high).contains(&length), pointer, || format!("has {length} characters; allowed are {low} to {high}"));
    findings.require(!value.chars().any(is_control), pointer, || "has a control character; none are allowed".into());
}

/// The finding, its pointer moved below `prefix`.
fn below(prefix: &str, error: FieldError) -> FieldError {
    FieldError { pointer: format!("{prefix}{}", error.pointer), detail: error.detail }
}

/// State of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Waits for its turn.
    Queued,
    /// Is being planned.
    Running,
    /// Is being planned, and stops as soon as possible.
    Cancelling,
    /// Ended with results.
    Succeeded,
    /// Ended without a result; `problem` gives the reason.
    Failed,
    /// Was cancelled before its end.
    Cancelled,
}

impl JobState {
    /// Every state.
    pub const ALL: [Self; 6] = [Self::Queued, Self::Running, Self::Cancelling, Self::Succeeded, Self::Failed, Self::Cancelled];

    /// Name in files and responses.
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

    /// Returns true if the job has ended, in whichever way.
    #[must_use]
    pub fn is_ended(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }
}

impl FromStr for JobState {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|state| state.as_str() == text).ok_or_else(|| format!("unknown job state {text:?}"))
    }
}

/// A planning job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Job {
    /// Id of the job.
    pub id: JobId,
    /// State of the job.
    pub state: JobState,
    /// Id of the planned mesh.
    pub mesh_id: MeshId,
    /// Cell, as given in the request.
    pub cell: Named<CellSpec>,
    /// Scanner that the job plans with: the name of the cell's; if `cell` is `"none"`, as given in the request. Jobs in a cell
    /// from earlier releases show that of the request.
    pub scanner: Named<ScannerSpec>,
    /// Planning parameters, with defaults and what the preset sets filled in.
    pub params: PlanParams,
    /// Labels, as given in the request or replaced by `PUT /jobs/{id}/labels`.
    pub labels: BTreeMap<String, String>,
    /// Part number, as given in the request.
    pub part_number: Option<String>,
    /// Serial number, as given in the request.
    pub serial: Option<String>,
    /// Priority, -100 to 100, as given in the request or changed by `PATCH /jobs/{id}`; jobs with a higher one start first.
    pub priority: i32,
    /// Stage of planning, while the job runs.
    #[schema(value_type = Option<crate::planning::context::Stage>)]
    pub stage: Option<String>,
    /// Completed share of the work, 0 to 1; never falls within an attempt.
    pub fraction: f64,
    /// Position in the queue, from 1, while the job is queued.
    pub queue_position: Option<u64>,
    /// Number of times that the job was started.
    pub attempts: u32,
    /// Time at which the job was accepted, UTC.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Start of the last attempt, UTC.
    #[schema(format = DateTime)]
    pub started_at: Option<String>,
    /// Time at which the job ended, UTC.
    #[schema(format = DateTime)]
    pub ended_at: Option<String>,
    /// Seconds spent in each stage so far.
    #[schema(value_type = BTreeMap<crate::planning::context::Stage, f64>)]
    pub timings: BTreeMap<String, f64>,
    /// Warnings on what was accepted: a part whose size suggests a wrong unit (`/mesh_id`), a doubtful cell, tolerances too fine
    /// for the scanner's noise. Once the job has succeeded, also those of its plan: regions and features that miss their target,
    /// reach it only on the samples that views were chosen on, or contain nothing of the part; excluded regions that contain
    /// nothing of it; views that do not tolerate pose errors; and a list of all candidates that was asked for but is too large.
    /// Before the job has ended, also that its results or its end cannot be stored yet.
    #[serde(default)]
    pub warnings: Vec<FieldWarning>,
    /// Coverage of each region of interest and each feature, once the job has succeeded.
    #[serde(default)]
    pub regions: Vec<RegionCoverageDocument>,
    /// Reason for the failure of the job. With the code `job_unreadable` the stored request cannot be read, and `cell`, `scanner`
    /// and `params` are defaults.
    pub problem: Option<JobProblem>,
    /// SHA-256 of `plan.json`, once the job has succeeded.
    pub plan_sha256: Option<String>,
    /// Summary of the plan, once the job has succeeded; `null` for jobs from before it was introduced.
    pub summary: Option<Summary>,
    /// Name of the key with which the job was submitted: of a key in `server.api_keys_file`, or `api_key` for the one in the
    /// settings; `null` without a key.
    pub submitted_by: Option<String>,
    /// Result files, sorted by name; each is at `/jobs/{id}/files/{name}`. A job that failed with the code `no_plan` has a report
    /// on the reasons.
    pub results: Vec<JobFile>,
}

/// A result file of a job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct JobFile {
    /// Name of the file.
    pub name: String,
    /// SHA-256 of the file, lower-case hexadecimal; `null` for a report that nobody has asked for yet: it is drawn then.
    pub sha256: Option<String>,
    /// Size of the file; `null` where its hash is.
    pub size_bytes: Option<u64>,
}

/// A job in a list: its state, without the full request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobListItem {
    /// Id of the job.
    pub id: JobId,
    /// State of the job.
    pub state: JobState,
    /// Id of the planned mesh.
    pub mesh_id: MeshId,
    /// Name of the cell.
    pub cell: String,
    /// Name of the scanner that the job plans with. Jobs in a cell from earlier releases show that of the request.
    pub scanner: String,
    /// Labels, as given in the request or replaced by `PUT /jobs/{id}/labels`.
    pub labels: BTreeMap<String, String>,
    /// Part number, as given in the request.
    pub part_number: Option<String>,
    /// Serial number, as given in the request.
    pub serial: Option<String>,
    /// Priority, -100 to 100, as given in the request or changed by `PATCH /jobs/{id}`; jobs with a higher one start first.
    pub priority: i32,
    /// Stage of planning, while the job runs.
    #[schema(value_type = Option<crate::planning::context::Stage>)]
    pub stage: Option<String>,
    /// Completed share of the work, 0 to 1; never falls within an attempt.
    pub fraction: f64,
    /// Position in the queue, from 1, while the job is queued.
    pub queue_position: Option<u64>,
    /// Number of times that the job was started.
    pub attempts: u32,
    /// Time at which the job was accepted, UTC.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Start of the last attempt, UTC.
    #[schema(format = DateTime)]
    pub started_at: Option<String>,
    /// Time at which the job ended, UTC.
    #[schema(format = DateTime)]
    pub ended_at: Option<String>,
    /// Seconds spent in each stage so far.
    #[schema(value_type = BTreeMap<crate::planning::context::Stage, f64>)]
    pub timings: BTreeMap<String, f64>,
    /// Warnings on what was accepted and, once the job has succeeded, those of its plan.
    #[serde(default)]
    pub warnings: Vec<FieldWarning>,
    /// Reason for the failure of the job.
    pub problem: Option<JobProblem>,
    /// SHA-256 of `plan.json`, once the job has succeeded.
    pub plan_sha256: Option<String>,
    /// Summary of the plan, once the job has succeeded; `null` for jobs from before it was introduced.
    pub summary: Option<Summary>,
    /// Name of the key with which the job was submitted: of a key in `server.api_keys_file`, or `api_key` for the one in the
    /// settings; `null` without a key.
    pub submitted_by: Option<String>,
    /// Result files, sorted by name; each is at `/jobs/{id}/files/{name}`.
    pub results: Vec<JobFile>,
}

/// A page of jobs, newest first. A page ends early where its entries would take more than 4 MiB.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobPage {
    /// Jobs on this page.
    pub items: Vec<JobListItem>,
    /// Token of the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_page_token: Option<String>,
}

/// The complete labels of a job.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct LabelsRequest {
    /// Labels: at most 32, keys of 1 to 64 characters without `=`, and values of up to 256 characters.
    pub labels: BTreeMap<String, String>,
}

impl LabelsRequest {
    /// Checks the number, the lengths and the characters of the labels.
    ///
    /// # Errors
    /// All invalid fields.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        check_labels(&mut findings, &self.labels);
        findings.into_result()
    }
}
