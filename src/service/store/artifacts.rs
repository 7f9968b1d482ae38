//! Result files of jobs. Text is compressed once, when it is stored, and kept only in that form: clients that accept gzip
//! get the file as stored, for others it is decompressed on the fly.

use std::io::{self, Read, Write};
use std::sync::Arc;

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use sha2::{Digest, Sha256};
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, SqliteConnection};

use super::files::Files;
use super::job_rows::read_problem;
use super::pinned::FilePin;
use super::{Store, blocking};
use crate::service::error::{Error, InternalError};
use crate::service::failpoint;
use crate::service::plan_job::{REPORT_DRAFT_FILE, REPORT_FILE, TEXT_REPORT_FILE};
use crate::service::planner::Artifact;
use crate::wire::candidates::CANDIDATES_FILE;
use crate::wire::hex;
use crate::wire::{JobFile, JobId, JobState};

/// Min size of a result to be compressed.
const MIN_COMPRESSED_BYTES: usize = 1024;
/// zlib's compression level: 62 MB of JSON take a second at 3, and three at 6 for a tenth less.
const LEVEL: Compression = Compression::new(3);

/// Encoding of a result in its stored file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FileEncoding {
    /// Byte for byte.
    Identity,
    /// Compressed with gzip (RFC 1952).
    Gzip,
}

impl FileEncoding {
    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::Identity => "identity",
            Self::Gzip => "gzip",
        }
    }
}

/// Name, hash and size of a result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StoredResult {
    /// Name of the result.
    pub name: String,
    /// SHA-256 of its bytes, lower-case hexadecimal.
    pub sha256: String,
    /// Number of its bytes.
    pub size_bytes: u64,
}

/// A result and the file that holds it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ResultFile {
    /// The result.
    pub result: StoredResult,
    /// Hash of the stored file.
    pub file_sha256: String,
    /// Size of the stored file.
    pub file_bytes: u64,
    /// Encoding of the result in the file.
    pub encoding: FileEncoding,
}

impl ResultFile {
    /// Description of a result that no file holds: that of a file with its bytes.
    pub(crate) fn of_bytes(name: &str, bytes: &[u8]) -> Self {
        let (sha256, size_bytes) = (hex(&Sha256::digest(bytes)), bytes.len() as u64);
        Self {
            result: StoredResult { name: name.to_owned(), sha256: sha256.clone(), size_bytes },
            file_sha256: sha256,
            file_bytes: size_bytes,
            encoding: FileEncoding::Identity,
        }
    }
}

/// Names by which people know the part of a job.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PartNames {
    /// Part number.
    pub part_number: Option<String>,
    /// Serial number.
    pub serial: Option<String>,
    /// Name of the mesh, unless it was deleted.
    pub mesh: Option<String>,
}

/// Results on the disk that no row refers to yet. They are pinned as long as this value lives.
#[derive(Debug)]
pub(crate) struct StoredArtifacts {
    /// The result files.
    pub files: Vec<ResultFile>,
    /// Hashes of those that were not in the store before, for [`Store::take_back`].
    pub written: Vec<String>,
    _pin: FilePin,
}

/// A result, encoded for its file.
struct Packed {
    result: StoredResult,
    bytes: Vec<u8>,
    sha256: String,
    encoding: FileEncoding,
}

impl Store {
    /// Stores result files; the caller adds the rows. Where one of them cannot be stored, none is left: on a full disk they would take
    /// the room that others need. `check_room` is asked first whether there is room for the bytes of those that are not in the store.
    pub(crate) async fn put_artifacts_if(
        &self,
        artifacts: Arc<Vec<Artifact>>,
        check_room: impl FnOnce(u64) -> Result<(), Error> + Send + 'static,
    ) -> Result<StoredArtifacts, Error> {
        let packed = blocking(move || artifacts.iter().map(pack).collect::<Result<Vec<_>, Error>>()).await?;
        let pin = self.pinned.pin(packed.iter().map(|packed| packed.sha256.clone()).collect()).await;
        let files = self.files.clone();
        let (stored, written) = blocking(move || {
            check_room(new_bytes(&files, &packed))?;
            let mut written = Vec::new();
            let stored = packed.into_iter().map(|packed| store_one(&files, packed, &mut written));
            let stored = stored.collect::<Result<Vec<_>, Error>>();
            Ok((stored, written))
        })
        .await?;
        match stored {
            Ok(files) => Ok(StoredArtifacts { files, written, _pin: pin }),
            Err(error) => {
                drop(pin);
                self.take_back(written).await;
                Err(error)
            }
        }
    }

    /// Removes files that this process wrote and for which it has no row to write in the end, unless a row refers to them or they are
    /// pinned. What cannot be removed is left to the sweep.
    pub(crate) async fn take_back(&self, written: Vec<String>) {
        if let Err(error) = self.remove_unreferenced(written).await {
            let error = &error as &dyn std::error::Error;
            tracing::warn!(error, "files that no result needs cannot be removed; they are swept later");
        }
    }

    /// One of a job's results and the file that holds it. A job that failed has none but the report on the reasons, if any.
    pub(crate) async fn result(&self, id: JobId, name: &str) -> Result<ResultFile, Error> {
        let state = self.job_state(id).await?;
        if !matches!(state, JobState::Succeeded | JobState::Failed) {
            return Err(self.no_results(id, state).await);
        }
        let row = sqlx::query(
            "SELECT name, sha256, size_bytes, file_sha256, file_bytes, encoding FROM artifact WHERE job_id = ?1 AND name = ?2",
        )
        .bind(id.to_string())
        .bind(name)
        .fetch_optional(&self.reader)
        .await?;
        match row {
            Some(row) => read_file(&row),
            None if state == JobState::Failed => Err(self.no_results(id, state).await),
            None => Err(Error::NoSuchResult { job: id, name: name.to_owned(), advice: self.advice_on(id, name).await? }),
        }
    }

    /// Error of a job that has not succeeded; where it failed, with its problem and what tells more of it.
    pub(crate) async fn no_results(&self, job: JobId, state: JobState) -> Error {
        let reason = if state == JobState::Failed { self.reason_of_failure(job).await } else { Ok(String::new()) };
        match reason {
            Ok(reason) => Error::NoResults { job, state, reason },
            Err(error) => error,
        }
    }

    async fn reason_of_failure(&self, id: JobId) -> Result<String, Error> {
        let row = sqlx::query(
            "SELECT problem, EXISTS (SELECT 1 FROM artifact WHERE job_id = job.id AND name = ?2) AS has_report FROM job WHERE id = ?1",
        )
        .bind(id.to_string())
        .bind(TEXT_REPORT_FILE)
        .fetch_optional(&self.reader)
        .await?
        .ok_or(Error::JobNotFound(id))?;
        let problem = row.try_get::<Option<String>, _>("problem").ok().flatten();
        let Some(problem) = read_problem(problem) else { return Ok(String::new()) };
        let report = if row.try_get::<bool, _>("has_report")? { "/report" } else { "" };
        Ok(format!(" ({}, see /api/v1/jobs/{id}{report})", problem.code))
    }

    /// Way to get a result that a job has succeeded without.
    async fn advice_on(&self, id: JobId, name: &str) -> Result<&'static str, Error> {
        if name == CANDIDATES_FILE {
            return Ok(if self.is_listing_asked_for(id).await? {
                "; it would have been too large: what to do stands in warnings of the job"
            } else {
                "; plan with params.output.candidates to have it written"
            });
        }
        let is_without_cell: bool = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM job WHERE id = ?1 AND cell = 'none')")
            .bind(id.to_string())
            .fetch_one(&self.reader)
            .await?;
        let is_program = is_without_cell && name.starts_with("program");
        Ok(if is_program { "; it was planned without a cell and holds viewpoints alone: plan the part in a cell" } else { "" })
    }

    /// Returns true if the job asks for the list of every candidate.
    async fn is_listing_asked_for(&self, id: JobId) -> Result<bool, Error> {
        let query = "SELECT EXISTS (SELECT 1 FROM job_body WHERE job_id = ?1
            AND CASE WHEN json_valid(request) THEN json_extract(request, '$.params.output.candidates') END)";
        Ok(sqlx::query_scalar(query).bind(id.to_string()).fetch_one(&self.reader).await?)
    }

    /// Replaces the draft of a job's report by the drawn report.
    pub(crate) async fn replace_draft(&self, id: JobId, drawn: &StoredArtifacts) -> Result<(), Error> {
        let mut tx = self.writer.begin().await?;
        let draft: Option<String> =
            sqlx::query_scalar("DELETE FROM artifact WHERE job_id = ?1 AND name = ?2 RETURNING file_sha256")
                .bind(id.to_string())
                .bind(REPORT_DRAFT_FILE)
                .fetch_optional(&mut *tx)
                .await?;
        // Without it the job was deleted meanwhile.
        let draft = draft.ok_or(Error::JobNotFound(id))?;
        insert(&mut tx, id, &drawn.files).await?;
        tx.commit().await?;
        self.remove_unreferenced(vec![draft]).await
    }

    /// Names of a job's part.
    pub(crate) async fn part_names(&self, id: JobId) -> Result<PartNames, Error> {
        let row = sqlx::query(
            "SELECT job.part_number, job.serial, mesh.name FROM job LEFT JOIN mesh ON mesh.id = job.mesh_id WHERE job.id = ?1",
        )
        .bind(id.to_string())
        .fetch_optional(&self.reader)
        .await?;
        let row = row.ok_or(Error::JobNotFound(id))?;
        Ok(PartNames { part_number: row.try_get("part_number")?, serial: row.try_get("serial")?, mesh: row.try_get("name")? })
    }

    /// Name of the robot that a job was planned for, and its dialect as its specification had it then; `None` without a cell.
    pub(crate) async fn robot(&self, id: JobId) -> Result<Option<(String, Option<String>)>, Error> {
        let row = sqlx::query(
            "SELECT CASE WHEN json_valid(input) THEN CAST(input ->> '$.cell.robot.name' AS TEXT) END AS name,
                CASE WHEN json_valid(input) THEN CAST(input ->> '$.cell.robot.dialect' AS TEXT) END AS dialect
             FROM job_body WHERE job_id = ?1",
        )
        .bind(id.to_string())
        .fetch_optional(&self.reader)
        .await?;
        let Some(row) = row else { return Ok(None) };
        let (name, dialect): (Option<String>, Option<String>) = (row.try_get("name")?, row.try_get("dialect")?);
        Ok(name.map(|name| (name, dialect)))
    }

    /// Opens the file of a result and checks its hash; decompresses it if `decompressed`.
    pub(crate) async fn open_result(&self, file: &ResultFile, decompressed: bool) -> Result<Box<dyn Read + Send>, Error> {
        let (files, file) = (self.files.clone(), file.clone());
        blocking(move || {
            let opened = files.open_checked(&file.file_sha256)?;
            Ok(match file.encoding {
                FileEncoding::Gzip if decompressed => Box::new(GzDecoder::new(opened)) as Box<dyn Read + Send>,
                FileEncoding::Gzip | FileEncoding::Identity => Box::new(opened),
            })
        })
        .await
    }

    /// Bytes of a result.
    pub(crate) async fn read_result(&self, file: &ResultFile) -> Result<Vec<u8>, Error> {
        let mut reader = self.open_result(file, true).await?;
        let size_bytes = usize::try_from(file.result.size_bytes).unwrap_or_default();
        let (files, sha256) = (self.files.clone(), file.file_sha256.clone());
        blocking(move || {
            let mut bytes = Vec::with_capacity(size_bytes);
            reader.read_to_end(&mut bytes).map_err(|error| files.read_error(&sha256, error))?;
            Ok(bytes)
        })
        .await
    }
}

/// Result files as clients are told of them: the draft of a report as the report that it will be.
pub(super) fn listed(mut results: Vec<JobFile>) -> Vec<JobFile> {
    for file in results.iter_mut().filter(|file| file.name == REPORT_DRAFT_FILE) {
        *file = JobFile { name: REPORT_FILE.to_owned(), sha256: None, size_bytes: None };
    }
    results.sort_by(|a, b| a.name.cmp(&b.name));
    results
}

/// The result file in a row.
pub(super) fn read_file(row: &SqliteRow) -> Result<ResultFile, Error> {
    let encoding = match row.try_get::<String, _>("encoding")?.as_str() {
        "identity" => FileEncoding::Identity,
        "gzip" => FileEncoding::Gzip,
        other => return Err(InternalError::Row(format!("encoding {other:?} of a result")).into()),
    };
    Ok(ResultFile {
        result: StoredResult {
            name: row.try_get("name")?,
            sha256: row.try_get("sha256")?,
            size_bytes: row.try_get::<i64, _>("size_bytes")?.unsigned_abs(),
        },
        file_sha256: row.try_get("file_sha256")?,
        file_bytes: row.try_get::<i64, _>("file_bytes")?.unsigned_abs(),
        encoding,
    })
}

/// Inserts the rows of a job's results.
pub(super) async fn insert(tx: &mut SqliteConnection, id: JobId, files: &[ResultFile]) -> Result<(), Error> {
    for file in files {
        sqlx::query(
            "INSERT INTO artifact (job_id, name, sha256, size_bytes, file_sha256, file_bytes, encoding)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
        )
        .bind(id.to_string())
        .bind(&file.result.name)
        .bind(&file.result.sha256)
        .bind(i64::try_from(file.result.size_bytes).unwrap_or(i64::MAX))
        .bind(&file.file_sha256)
        .bind(i64::try_from(file.file_bytes).unwrap_or(i64::MAX))
        .bind(file.encoding.as_str())
        .execute(&mut *tx)
        .await?;
    }
    Ok(())
}

/// Number of bytes that files of results add to the store.
fn new_bytes(files: &Files, packed: &[Packed]) -> u64 {
    let mut new: Vec<&Packed> = packed.iter().filter(|packed| !files.path(&packed.sha256).exists()).collect();
    new.sort_by(|a, b| a.sha256.cmp(&b.sha256));
    new.dedup_by(|a, b| a.sha256 == b.sha256);
    new.iter().map(|packed| packed.bytes.len() as u64).sum()
}

/// Stores the file of a result; notes its hash in `written` where there was none.
fn store_one(files: &Files, packed: Packed, written: &mut Vec<String>) -> Result<ResultFile, Error> {
    let Packed { result, bytes, sha256, encoding } = packed;
    let is_new = !files.path(&sha256).exists();
    let received = files.write(&bytes)?;
    if is_new {
        written.push(sha256.clone());
    }
    files.persist(received)?;
    failpoint::hit("artifact", "written");
    Ok(ResultFile { result, file_sha256: sha256, file_bytes: bytes.len() as u64, encoding })
}

/// Encodes a result for its file. Deterministic: equal bytes give equal files.
fn pack(artifact: &Artifact) -> Result<Packed, Error> {
    let bytes = &artifact.bytes;
    let sha256 = hex(&Sha256::digest(bytes));
    let result = StoredResult { name: artifact.name.to_string(), sha256: sha256.clone(), size_bytes: bytes.len() as u64 };
    if bytes.len() >= MIN_COMPRESSED_BYTES {
        let compressed = compress(bytes)?;
        if compressed.len() < bytes.len() / 10 * 9 {
            let sha256 = hex(&Sha256::digest(&compressed));
            return Ok(Packed { result, bytes: compressed, sha256, encoding: FileEncoding::Gzip });
        }
    }
    Ok(Packed { result, bytes: bytes.clone(), sha256, encoding: FileEncoding::Identity })
}

fn compress(bytes: &[u8]) -> io::Result<Vec<u8>> {
    // Without a name or a time in the header, so that equal bytes compress to equal files.
    let mut encoder = GzEncoder::new(Vec::with_capacity(bytes.len() / 4), LEVEL);
    encoder.write_all(bytes)?;
    encoder.finish()
}
