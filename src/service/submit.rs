//! Submission of jobs: everything that a request names is resolved and checked first, and stored with the job, so that a
//! later change of a cell does not change accepted jobs.

mod regions;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::app::App;
use super::cells::{BuiltCell, mesh_names, mesh_of};
use super::error::{Error, InternalError};
use super::library::Library;
use super::planner::{JobInput, MeshSource};
use super::rescan_job::RescanJob;
use super::store::{Attempt, Files, IdempotencyKey, JobQuery, MeshFile, NewJob, Page, blocking, read_leniently};
use crate::cell::{CellSpec, FieldError, Named, NotFound, ScannerSpec, SpecKind, SpecLibrary, did_you_mean};
use crate::planning::params::RescanParams;
use crate::wire::inspection::{InspectionJob, RescanState};
use crate::wire::part_size::SizeLimits;
use crate::wire::warnings::FieldWarning;
use crate::wire::{Job, JobBatch, JobBatchRequest, JobPage, JobRequest, MAX_LABELS, MeshId, warnings};

/// Circumstances in which a request for jobs was sent.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Submission {
    /// Key under which the same request gives the same answer.
    pub idempotency_key: Option<String>,
    /// Time within which everything that the request names must be resolved.
    pub limit: Option<Duration>,
    /// Name of the key that its sender presented.
    pub submitted_by: Option<String>,
}

impl Submission {
    /// The key with the fingerprint of the request, in canonical form with method and path. Senders with keys of their own do not meet
    /// each other's.
    pub(super) fn idempotency(&self, canonical: &str) -> Option<IdempotencyKey> {
        let key = self.idempotency_key.as_ref()?;
        // A key is visible ASCII: no line end is part of it.
        let own = self.submitted_by.as_ref().map_or_else(|| key.clone(), |sender| format!("{sender}\n{key}"));
        Some(IdempotencyKey::new(&own, canonical))
    }
}

/// A request with everything that it names.
struct ResolvedJob {
    request: JobRequest,
    /// Planning input, every name resolved, as JSON.
    input: String,
    /// Meshes that it reads.
    meshes: Vec<MeshId>,
    warnings: Vec<FieldWarning>,
}

impl ResolvedJob {
    fn new(mut request: JobRequest, input: &StoredInput, meshes: Vec<MeshId>) -> Result<Self, Error> {
        // The job shows the scanner that it plans with.
        let of_cell = input.cell.as_ref().map(|_| Named::Name(input.scanner.name.clone()));
        request.scanner = of_cell.or_else(|| Some(request.scanner_or_default()));
        let mut warnings = warnings::of_params(&request.params, "/params");
        warnings.extend(input.warnings.iter().cloned());
        Ok(Self { request, input: serde_json::to_string(input)?, meshes, warnings })
    }

    fn into_job(self, submitted_by: Option<String>) -> NewJob {
        let Self { request, input, meshes, warnings } = self;
        NewJob { request, input, meshes, warnings, submitted_by, scanned: None }
    }
}

/// Input of a job as stored with it, every name resolved.
#[derive(Debug, Serialize, Deserialize)]
struct StoredInput {
    mesh: MeshFile,
    part_name: String,
    fixture: Option<MeshFile>,
    cell: Option<CellSpec>,
    scanner: ScannerSpec,
    body_meshes: BTreeMap<String, MeshFile>,
    /// Warnings on the part's size, on the cell and on the scanner, found when the job was submitted.
    #[serde(default)]
    warnings: Vec<FieldWarning>,
    /// State after scans, of a job that plans what they lack.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rescan: Option<StoredRescan>,
}

/// Finding at the id of a mesh that is not there.
const NO_MESH: &str = "no mesh has this id; upload it with POST /api/v1/meshes";
/// Label of a job of further views: the id of the inspection whose scans lack them.
const RESCAN_LABEL: &str = "rescan_of";

/// A rescan as stored with its job.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct StoredRescan {
    pub(super) state: RescanState,
    pub(super) params: RescanParams,
}

/// Guard that raises its flag when dropped: the caller no longer waits for the lookup.
struct AbandonGuard(Arc<AtomicBool>);

impl Drop for AbandonGuard {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl App {
    /// Accepts a job. If the idempotency key was used for the same request before, returns the earlier answer. If not everything
    /// that the request names is resolved in time, or if the caller goes away before, no job is created.
    ///
    /// # Errors
    /// [`Error::Invalid`], [`Error::IdempotencyMismatch`], [`Error::QueueFull`], [`Error::Draining`], [`Error::TooSlow`],
    /// [`Error::StorageFull`], [`Error::StorageLow`], [`Error::Unrecovered`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn submit(&self, request: JobRequest, submission: Submission) -> Result<Job, Error> {
        let idempotency = submission.idempotency(&format!("POST /api/v1/jobs {}", serde_json::to_string(&request)?));
        if let Some(answer) = self.answered_before(idempotency.as_ref()).await? {
            return Ok(answer);
        }
        let resolve = move |library: &Library| {
            let (input, meshes) = resolve(&request, library, None).map_err(Error::Invalid)?;
            ResolvedJob::new(request, &input, meshes)
        };
        let new = self.with_library(submission.limit, resolve).await?.into_job(submission.submitted_by);
        let app = self.clone();
        self.run_to_completion(async move {
            let job = app.0.store.submit(&new, idempotency.as_ref(), app.0.options.max_queued_jobs).await;
            let job = job.map_err(|error| of_gone_mesh(error, [(String::new(), &new)]))?;
            app.0.runner.wake();
            Ok(job)
        })
        .await
    }

    /// Accepts a job that plans further views for what the scans of another job lack. It takes part, cell, parameters and labels of that
    /// job, part and fixture also where their meshes were deleted, and names the inspection in the label [`RESCAN_LABEL`] unless the job
    /// has as many labels as it may have.
    ///
    /// # Errors
    /// Errors of [`App::submit`]; [`Error::JobNotFound`]; [`Error::Invalid`] also where the scans do not fit the part.
    pub(super) async fn submit_rescan(
        &self,
        from: &InspectionJob,
        rescan: StoredRescan,
        submission: Submission,
    ) -> Result<Job, Error> {
        rescan.state.check_found().map_err(|error| Error::Invalid(vec![error]))?;
        let of = from.job_id;
        let attempt = self.0.store.body(of).await?.ok_or(Error::JobNotFound(of))?;
        let (input, _): (StoredInput, _) = read_leniently(0, &attempt.input).map_err(InternalError::Row)?;
        let mut request = attempt.request;
        if input.cell.is_some() {
            // Of earlier releases it may be another than the cell's.
            request.scanner = None;
        }
        // Earlier releases took keys that are refused now.
        request.labels.retain(|key, _| !key.contains('='));
        if request.labels.len() < MAX_LABELS || request.labels.contains_key(RESCAN_LABEL) {
            request.labels.insert(RESCAN_LABEL.to_owned(), from.id.to_string());
        }
        let canonical = format!("POST /api/v1/inspections/{}/rescans {}", from.id, serde_json::to_string(&rescan)?);
        let idempotency = submission.idempotency(&canonical);
        if let Some(answer) = self.answered_before(idempotency.as_ref()).await? {
            return Ok(answer);
        }
        let resolve = move |library: &Library| {
            let resolved = resolve(&request, library, Some(&input));
            let (mut input, meshes) = resolved.map_err(|errors| of_scanned(Error::Invalid(errors)))?;
            input.rescan = Some(rescan);
            ResolvedJob::new(request, &input, meshes)
        };
        let job = self.with_library(submission.limit, resolve).await?.into_job(submission.submitted_by);
        let new = NewJob { scanned: Some(of), ..job };
        let app = self.clone();
        self.run_to_completion(async move {
            let job = app.0.store.submit(&new, idempotency.as_ref(), app.0.options.max_queued_jobs).await;
            let job = job.map_err(|error| of_scanned(of_gone_mesh(error, [(String::new(), &new)])))?;
            app.0.runner.wake();
            Ok(job)
        })
        .await
    }

    /// Accepts several jobs, or none of them. Findings have pointers such as `/jobs/3/cell`. For the rest as [`App::submit`].
    ///
    /// # Errors
    /// Errors of [`App::submit`].
    pub async fn submit_batch(&self, batch: JobBatchRequest, submission: Submission) -> Result<JobBatch, Error> {
        batch.check().map_err(Error::Invalid)?;
        let idempotency = submission.idempotency(&format!("POST /api/v1/jobs/batch {}", serde_json::to_string(&batch)?));
        if let Some(answer) = self.answered_before(idempotency.as_ref()).await? {
            return Ok(answer);
        }
        let (count, limit) = (batch.jobs.len(), self.0.options.max_queued_jobs);
        if count as u64 > limit {
            // An empty queue has no room for it either.
            let detail = format!("has {count} entries; limits.queued_jobs allows {limit}");
            return Err(Error::Invalid(vec![FieldError { pointer: "/jobs".to_owned(), detail }]));
        }
        let resolved = self.with_library(submission.limit, move |library| resolve_all(batch.jobs, library)).await?;
        let jobs: Vec<NewJob> = resolved.into_iter().map(|job| job.into_job(submission.submitted_by.clone())).collect();
        let app = self.clone();
        self.run_to_completion(async move {
            let answer = app.0.store.submit_batch(&jobs, idempotency.as_ref(), app.0.options.max_queued_jobs).await;
            let named = jobs.iter().enumerate().map(|(index, job)| (format!("/jobs/{index}"), job));
            let answer = answer.map_err(|error| of_gone_mesh(error, named))?;
            app.0.runner.wake();
            Ok(answer)
        })
        .await
    }

    /// Earlier answer to a request with this key, if any; otherwise checks that the service takes another.
    pub(super) async fn answered_before<T: DeserializeOwned>(
        &self,
        idempotency: Option<&IdempotencyKey>,
    ) -> Result<Option<T>, Error> {
        let answer = match idempotency {
            Some(key) => self.0.store.replay(key).await?,
            None => None,
        };
        if answer.is_none() {
            self.check_open()?;
            self.check_recovered()?;
            self.check_space(0)?;
        }
        Ok(answer)
    }

    /// Runs `resolve` with the library on a thread that may block, for a few requests at a time. Once the caller no longer
    /// waits, the thread stops at the next mesh.
    pub(super) async fn with_library<T: Send + 'static>(
        &self,
        limit: Option<Duration>,
        resolve: impl FnOnce(&Library) -> Result<T, Error> + Send + 'static,
    ) -> Result<T, Error> {
        let guard = AbandonGuard(Arc::default());
        let (app, abandoned) = (self.clone(), Arc::clone(&guard.0));
        let work = async {
            let permit = app.0.resolving.clone().acquire_owned().await.map_err(|_| Error::Draining)?;
            blocking(move || {
                let _permit = permit;
                let library = Library::new(app, abandoned);
                let resolved = resolve(&library);
                library.take_error().map_or(resolved, Err)
            })
            .await
        };
        match limit {
            None => work.await,
            Some(limit) => tokio::time::timeout(limit, work).await.map_err(|_| Error::TooSlow)?,
        }
    }

    /// A page of jobs, newest first.
    ///
    /// # Errors
    /// [`Error::BadPageToken`], [`Error::Internal`].
    pub async fn jobs(&self, query: &JobQuery, page_size: u32, page_token: Option<&str>) -> Result<JobPage, Error> {
        let page = Page::new(page_size, page_token, &format!("jobs {query:?}"))?;
        self.0.store.jobs(query, &page).await
    }
}

/// Error of the store at jobs of these places in a request. A mesh that was deleted since the request was checked is told as if it had
/// not been there at all.
fn of_gone_mesh<'a>(error: Error, jobs: impl IntoIterator<Item = (String, &'a NewJob)>) -> Error {
    let Error::MeshNotFound(mesh) = error else { return error };
    let finding = |(place, job): (String, &NewJob)| {
        let request = &job.request;
        let fixture = request.params.part.fixture_mesh.as_ref().and_then(|id| id.parse::<MeshId>().ok());
        let pointer = if request.mesh_id == mesh {
            "/mesh_id"
        } else if fixture == Some(mesh) {
            "/params/part/fixture_mesh"
        } else {
            "/cell"
        };
        FieldError { pointer: format!("{place}{pointer}"), detail: NO_MESH.to_owned() }
    };
    Error::Invalid(jobs.into_iter().filter(|(_, job)| job.meshes.contains(&mesh)).map(finding).collect())
}

/// Findings on the job that was scanned, whose fields the request for further views does not have.
fn of_scanned(error: Error) -> Error {
    let Error::Invalid(errors) = error else { return error };
    Error::Invalid(errors.into_iter().map(of_scanned_job).collect())
}

/// A finding on the job that was scanned, whose fields the request for further views does not have.
fn of_scanned_job(error: FieldError) -> FieldError {
    let FieldError { pointer, detail } = error;
    FieldError { pointer: String::new(), detail: format!("{} of the scanned job {detail}", pointer.trim_start_matches('/')) }
}

/// Resolves and checks everything that the requests of a batch name; findings of all of them together.
fn resolve_all(jobs: Vec<JobRequest>, library: &Library) -> Result<Vec<ResolvedJob>, Error> {
    let (mut resolved, mut errors) = (Vec::with_capacity(jobs.len()), Vec::new());
    for (index, request) in jobs.into_iter().enumerate() {
        match resolve(&request, library, None) {
            Ok((input, meshes)) => resolved.push(ResolvedJob::new(request, &input, meshes)?),
            Err(found) => errors.extend(found.into_iter().map(|error| error.below(&format!("/jobs/{index}")))),
        }
    }
    if errors.is_empty() { Ok(resolved) } else { Err(Error::Invalid(errors)) }
}

/// Resolves and checks everything that a request names; part and fixture are those of the job that was scanned, if any.
fn resolve(
    request: &JobRequest,
    library: &Library,
    scanned: Option<&StoredInput>,
) -> Result<(StoredInput, Vec<MeshId>), Vec<FieldError>> {
    let mut errors = request.check().err().unwrap_or_default();
    let mut lookup = Lookup::new(library, &mut errors);
    let (mesh, fixture) = match scanned {
        Some(scanned) => (Some(scanned.mesh.clone()), scanned.fixture.clone()),
        None => {
            let mesh = lookup.mesh("/mesh_id", &request.mesh_id.to_string());
            let fixture = request.params.part.fixture_mesh.as_ref();
            (mesh, fixture.and_then(|id| lookup.mesh("/params/part/fixture_mesh", id)))
        }
    };
    let cell = lookup.cell(&request.cell);
    let scanner = match &cell {
        Some(cell) => lookup.scanner_of(cell, request.scanner.as_ref()),
        None => lookup.scanner(&request.scanner_or_default()),
    };
    // Without a cell, the scanner's body is kept with the job all the same.
    let of_scanner = scanner.iter().filter(|_| cell.is_none()).flat_map(|scanner| &scanner.body).map(|body| &body.shape);
    let names = of_scanner.filter_map(mesh_of).chain(cell.iter().flat_map(mesh_names));
    let body_meshes: BTreeMap<_, _> = names.filter_map(|id| lookup.mesh("/cell", id).map(|file| (id.clone(), file))).collect();
    let (used, built_cell) = (std::mem::take(&mut lookup.used), lookup.built_cell.take());
    let beyond = scanner.as_ref().map(|scanner| limits_beyond(request, scanner, &errors));
    errors.extend(beyond.into_iter().flatten());
    let absent = library.faces_in_file(request.mesh_id).map(|file| regions::absent(&request.params, &file, &errors));
    errors.extend(absent.into_iter().flatten());
    match (mesh, fixture, scanner) {
        (Some(mesh), fixture, Some(scanner)) if errors.is_empty() => {
            let part_name = scanned.map_or_else(|| library.part_name(request.mesh_id), |scanned| scanned.part_name.clone());
            let warnings = warnings_on(request, built_cell.as_deref(), &scanner, library);
            let input = StoredInput { mesh, part_name, fixture, cell, scanner, body_meshes, warnings, rescan: None };
            Ok((input, used.into_iter().collect()))
        }
        _ => Err(errors),
    }
}

/// Warnings on the size of a job's part, on its cell, and on what its features ask of the scanner.
fn warnings_on(request: &JobRequest, built: Option<&BuiltCell>, scanner: &ScannerSpec, library: &Library) -> Vec<FieldWarning> {
    let cell = built.map(|built| &built.cell);
    let alone = if cell.is_none() { scanner.build().ok() } else { None };
    let scanner = cell.map(|cell| &cell.scanner).or(alone.as_ref());
    let size = scanner.zip(library.part_size(request.mesh_id)).map(|(scanner, size)| {
        size.warnings(request.params.part.table_from_part.as_ref(), &SizeLimits::new(scanner, cell), "/mesh_id")
    });
    let spacing = scanner.map(|scanner| warnings::of_spacing(&request.params, scanner, "/params"));
    let of_cell = built.into_iter().flat_map(|built| built.warnings.iter().cloned());
    let goal = warnings::of_goal(&request.params, built.is_some(), "/params");
    size.into_iter().flatten().chain(of_cell).chain(spacing.into_iter().flatten()).chain(goal).collect()
}

/// Limits of incidence beyond the scanner's own, except for values that are known to be out of range.
fn limits_beyond(request: &JobRequest, scanner: &ScannerSpec, known: &[FieldError]) -> Vec<FieldError> {
    // Without its cell it is not known which scanner the job is for; one that cannot be built has errors of its own.
    let is_of_cell = |error: &FieldError| error.pointer.starts_with("/cell");
    let (false, Ok(scanner)) = (known.iter().any(is_of_cell), scanner.build()) else { return Vec::new() };
    let beyond = request.params.check_limits(&scanner).err().into_iter().flatten().map(|error| error.below("/params"));
    beyond.filter(|error| known.iter().all(|known| known.pointer != error.pointer)).collect()
}

/// Lookup of what a request names; collects an error for everything that does not exist or cannot be used.
pub(super) struct Lookup<'a> {
    library: &'a Library,
    errors: &'a mut Vec<FieldError>,
    used: BTreeSet<MeshId>,
    /// The cell that was found, built.
    pub(super) built_cell: Option<Arc<BuiltCell>>,
}

impl<'a> Lookup<'a> {
    pub(super) fn new(library: &'a Library, errors: &'a mut Vec<FieldError>) -> Self {
        Self { library, errors, used: BTreeSet::new(), built_cell: None }
    }

    pub(super) fn errors(&self) -> &[FieldError] {
        self.errors
    }

    pub(super) fn refuse(&mut self, pointer: &str, detail: String) {
        self.errors.push(FieldError { pointer: pointer.to_owned(), detail });
    }

    pub(super) fn mesh(&mut self, pointer: &str, id: &str) -> Option<MeshFile> {
        // Parsed, so that every spelling of an id is found.
        let id = id.parse::<MeshId>().ok();
        match id.and_then(|id| self.library.source(id).map(|source| (id, source))) {
            Some((id, source)) => {
                self.used.insert(id);
                Some(MeshFile { sha256: source.sha256.clone(), unit: source.unit.as_str().to_owned() })
            }
            None => {
                self.refuse(pointer, NO_MESH.to_owned());
                None
            }
        }
    }

    pub(super) fn find<T: Clone>(
        &mut self,
        pointer: &str,
        named: &Named<T>,
        kind: SpecKind,
        stored: impl Fn(&str) -> Result<T, NotFound>,
    ) -> Option<T> {
        let name = match named {
            Named::Inline(spec) => return Some((**spec).clone()),
            Named::Name(name) => name,
        };
        let kind_name = kind.as_str();
        let detail = match stored(name) {
            Ok(spec) => return Some(spec),
            Err(NotFound::Unknown) => {
                let names = self.library.names(kind);
                let question = did_you_mean(name, names.iter().map(String::as_str));
                format!("no {kind_name} is named {name:?}; known names are {}{question}", names.join(", "))
            }
            Err(NotFound::Unusable(reason)) => {
                format!(
                    "the stored {kind_name} {name:?} cannot be used: {reason}; store it again with PUT /api/v1/{kind_name}s/{name}"
                )
            }
        };
        self.refuse(pointer, detail);
        None
    }

    fn scanner(&mut self, named: &Named<ScannerSpec>) -> Option<ScannerSpec> {
        let spec = self.find("/scanner", named, SpecKind::Scanner, |name| self.library.scanner(name))?;
        self.built("/scanner", spec.build()).map(|_| spec)
    }

    /// The scanner of a cell. Refuses another that is given beside the cell: it would not be used.
    fn scanner_of(&mut self, cell: &CellSpec, given: Option<&Named<ScannerSpec>>) -> Option<ScannerSpec> {
        let library = self.library;
        let own = self.find("/cell/scanner", &cell.scanner, SpecKind::Scanner, |name| library.scanner(name))?;
        let other = given.and_then(|given| match given {
            Named::Name(name) => (*name != own.name).then(|| format!("is {name:?}")),
            Named::Inline(spec) => (**spec != own).then(|| format!("is a specification named {:?}", spec.name)),
        });
        if let Some(other) = other {
            let detail = format!(
                "{other}, but the cell {:?} has its own scanner, {:?}; leave the scanner out, or set the cell to \"none\" to plan \
                 viewpoints only",
                cell.name, own.name
            );
            self.refuse("/scanner", detail);
        }
        Some(own)
    }

    /// The cell with its devices inlined; `None` for `"none"`, and if an error was recorded.
    pub(super) fn cell(&mut self, named: &Named<CellSpec>) -> Option<CellSpec> {
        if matches!(named, Named::Name(name) if name == "none") {
            return None;
        }
        let library = self.library;
        let mut cell = self.find("/cell", named, SpecKind::Cell, |name| library.cell(name))?;
        cell.inline_devices(library);
        self.built_cell = Some(self.built("/cell", library.built(&cell))?);
        Some(cell)
    }

    pub(super) fn built<T>(&mut self, pointer: &str, built: Result<T, Vec<FieldError>>) -> Option<T> {
        let errors = match built {
            Ok(value) => return Some(value),
            Err(errors) => errors,
        };
        self.errors.extend(errors.into_iter().map(|error| error.below(pointer)));
        None
    }
}

/// Replaces a name by the specification of that name.
/// Input of a job that is started, or looked at before.
pub(super) fn job_input(attempt: &Attempt, files: &Files, max_triangles: usize) -> Result<JobInput, Error> {
    let (input, unknown): (StoredInput, _) = read_leniently(0, &attempt.input).map_err(InternalError::Row)?;
    if !unknown.is_empty() {
        tracing::warn!(fields = unknown.join(", "), "unknown fields of a job's input are ignored");
    }
    let source = |file: MeshFile| -> Result<MeshSource, Error> {
        let unit = file.unit.parse().map_err(|_| InternalError::Row(format!("unit {:?}", file.unit)))?;
        Ok(MeshSource { path: files.path(&file.sha256), sha256: file.sha256, unit })
    };
    let body_meshes = input.body_meshes.into_iter().map(|(name, file)| Ok((name, source(file)?)));
    Ok(JobInput {
        mesh: source(input.mesh)?,
        part_name: input.part_name,
        fixture: input.fixture.map(source).transpose()?,
        cell: input.cell,
        scanner: input.scanner,
        body_meshes: body_meshes.collect::<Result<_, Error>>()?,
        max_triangles,
        params: attempt.request.params.clone(),
        echo: attempt.request.echo(),
        rescan: input.rescan.map(|StoredRescan { state, params }| RescanJob { state, params }),
        accepted_at: Some(attempt.created_at.clone()),
    })
}

#[cfg(test)]
mod tests;
