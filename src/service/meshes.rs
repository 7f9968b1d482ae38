//! Meshes: hashed while they are received, parsed and checked, stored by content.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio::task::JoinHandle;

use super::app::App;
use super::error::{Error, InternalError};
use super::hashing_reader::HashingReader;
use super::parse_memory::bytes_to_read;
use super::plan_job::PREVIEW_TRIANGLES;
use super::store::{NewMesh, Page, Received, blocking};
use crate::geometry::mesh_io::{self, Limits, MeshError, ReadError, ReadMesh};
use crate::geometry::{self, LengthUnit, Poll};
use crate::wire::{MeshHealthReport, MeshId, MeshPage, UploadedMesh};

/// Max pieces of an upload that wait to be written.
const MAX_PENDING_PIECES: usize = 8;

/// Received bytes after which an upload checks the free space again.
const SPACE_CHECK_BYTES: u64 = 16 << 20;

/// An upload in progress: a thread hashes and writes its pieces. If dropped, it leaves nothing behind.
pub struct Upload {
    pieces: mpsc::Sender<Piece>,
    writer: JoinHandle<Result<Option<Received>, Error>>,
    received_bytes: u64,
    limit_bytes: u64,
    app: App,
    /// Received bytes when the free space was last checked.
    checked_bytes: u64,
    _permit: OwnedSemaphorePermit,
}

enum Piece {
    Bytes(Bytes),
    End,
}

/// A complete upload on the disk, which no row refers to yet.
pub struct FinishedUpload(Received);

impl FinishedUpload {
    /// Number of its bytes.
    #[must_use]
    pub fn size_bytes(&self) -> u64 {
        self.0.size_bytes
    }

    pub(super) fn into_received(self) -> Received {
        self.0
    }
}

/// Unit and name of an uploaded mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeshUpload {
    /// Unit of its coordinates.
    pub unit: LengthUnit,
    /// Name of the mesh.
    pub name: Option<String>,
}

impl Upload {
    /// Appends a piece.
    ///
    /// # Errors
    /// [`Error::UploadTooLarge`], [`Error::StorageFull`], [`Error::Internal`].
    pub async fn write(&mut self, bytes: Bytes) -> Result<(), Error> {
        self.received_bytes += bytes.len() as u64;
        if self.received_bytes > self.limit_bytes {
            return Err(Error::UploadTooLarge { limit_bytes: self.limit_bytes });
        }
        if self.received_bytes - self.checked_bytes >= SPACE_CHECK_BYTES {
            self.checked_bytes = self.received_bytes;
            self.app.check_space(0)?;
        }
        if self.pieces.send(Piece::Bytes(bytes)).await.is_err() {
            // The thread has ended, and returns the reason.
            return Err((&mut self.writer).await?.err().unwrap_or_else(ended_early));
        }
        Ok(())
    }

    /// Finishes the file and syncs it to the disk. If a SHA-256 was announced, it must match.
    ///
    /// # Errors
    /// [`Error::DigestMismatch`], [`Error::StorageFull`], [`Error::Internal`].
    pub async fn finish(self, announced: Option<&str>) -> Result<FinishedUpload, Error> {
        // If this cannot be sent, the thread has ended and returns the reason below.
        let _ = self.pieces.send(Piece::End).await;
        let received = self.writer.await??.ok_or_else(ended_early)?;
        match announced {
            Some(announced) if announced != received.sha256 => {
                Err(Error::DigestMismatch { found: received.sha256, announced: announced.to_owned() })
            }
            _ => Ok(FinishedUpload(received)),
        }
    }
}

fn ended_early() -> Error {
    InternalError::Task("an upload ended early".to_owned()).into()
}

impl App {
    /// Begins an upload of about `announced_bytes`, once one of the limited slots is free: each upload holds a thread.
    ///
    /// # Errors
    /// [`Error::Draining`], [`Error::StorageLow`].
    pub async fn receive(&self, announced_bytes: u64) -> Result<Upload, Error> {
        self.check_open()?;
        self.check_space(announced_bytes)?;
        let permit = self.0.uploads.clone().acquire_owned().await.map_err(|_| Error::Draining)?;
        let (sender, mut pieces) = mpsc::channel(MAX_PENDING_PIECES);
        let files = self.0.store.files().clone();
        let writer = tokio::task::spawn_blocking(move || {
            let mut receiver = files.receive()?;
            while let Some(piece) = pieces.blocking_recv() {
                match piece {
                    Piece::Bytes(bytes) => receiver.write(&bytes)?,
                    Piece::End => return Ok(Some(receiver.finish()?)),
                }
            }
            Ok(None)
        });
        let limit_bytes = self.0.options.max_upload_bytes;
        let app = self.clone();
        Ok(Upload { pieces: sender, writer, received_bytes: 0, limit_bytes, app, checked_bytes: 0, _permit: permit })
    }

    /// Parses and checks an upload, and stores it if it is a usable mesh.
    ///
    /// # Errors
    /// [`Error::MeshUnreadable`], [`Error::StorageFull`], [`Error::Draining`], [`Error::Internal`].
    pub async fn add_mesh(&self, upload: FinishedUpload, about: MeshUpload) -> Result<UploadedMesh, Error> {
        self.check_open()?;
        let FinishedUpload(received) = upload;
        let limits = Limits { max_triangles: self.0.options.max_triangles };
        let path = received.file.path().to_owned();
        let (received, health) = self
            .run_abandonable(path, move |poll| {
                let (read, _) = read(received.file.path(), about.unit, &limits, poll)?;
                Ok((received, MeshHealthReport::new(&read)))
            })
            .await?;
        let new = NewMesh { received, unit: about.unit.as_str().to_owned(), name: about.name, health };
        let app = self.clone();
        self.run_to_completion(async move { app.0.store.add_mesh(new).await }).await
    }

    /// Runs work on the mesh of a file on a thread that may block: a few at a time, which together stay within the memory for it. Whoever
    /// waits for memory takes no turn from others. The work is interrupted when the caller goes away, when the service stops, and at the
    /// time limit.
    async fn run_abandonable<T: Send + 'static>(
        &self,
        path: PathBuf,
        work: impl FnOnce(&Poll<'_>) -> Result<T, Error> + Send + 'static,
    ) -> Result<T, Error> {
        let max_triangles = self.0.options.max_triangles;
        let bytes = blocking(move || Ok(bytes_to_read(&path, max_triangles)?)).await?;
        // In this order: who has a turn never waits for memory, so that turns are given back whatever the others wait for.
        let memory = self.0.parse_memory.take(bytes).await?;
        let permit = Arc::clone(&self.0.parsing).acquire_owned().await.map_err(|_| Error::Draining)?;
        let (abandoned, limit) = (self.0.stopping.child_token(), self.0.options.parse_limit);
        // Dropped, and so cancelling, when the caller goes away.
        let _guard = abandoned.clone().drop_guard();
        blocking(move || {
            let _held = (permit, memory);
            let began = Instant::now();
            let stop = || abandoned.is_cancelled() || began.elapsed() > limit;
            work(&Poll::new(&stop)).map_err(|error| {
                let is_over_time = matches!(error, Error::Draining) && !abandoned.is_cancelled();
                if is_over_time { timed_out(limit) } else { error }
            })
        })
        .await
    }

    /// One mesh.
    ///
    /// # Errors
    /// [`Error::MeshNotFound`], [`Error::Internal`].
    pub async fn mesh(&self, id: MeshId) -> Result<UploadedMesh, Error> {
        self.0.store.mesh(id).await
    }

    /// A page of meshes, newest first.
    ///
    /// # Errors
    /// [`Error::BadPageToken`], [`Error::Internal`].
    pub async fn meshes(&self, page_size: u32, page_token: Option<&str>) -> Result<MeshPage, Error> {
        self.0.store.meshes(&Page::new(page_size, page_token, "meshes")?).await
    }

    /// Opens the uploaded file of a mesh, once its bytes have been compared with its hash.
    ///
    /// # Errors
    /// [`Error::FileDamaged`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn open_mesh(&self, mesh: &UploadedMesh) -> Result<File, Error> {
        let (files, sha256) = (self.0.store.files().clone(), mesh.sha256.clone());
        blocking(move || files.open_checked(&sha256)).await
    }

    /// A simplified mesh for viewers, as binary glTF, and its SHA-256. Made on the first request, and again if its file is
    /// damaged.
    ///
    /// # Errors
    /// [`Error::MeshNotFound`], [`Error::FileDamaged`], [`Error::StorageFull`], [`Error::Internal`].
    pub async fn preview(&self, id: MeshId) -> Result<(String, Vec<u8>), Error> {
        let read = |sha256: String| {
            let files = self.0.store.files().clone();
            blocking(move || files.read(&sha256).map(|bytes| (sha256, bytes)))
        };
        if let Some(sha256) = self.0.store.preview(id).await? {
            match read(sha256).await {
                Err(Error::FileDamaged { .. }) => {}
                found => return found,
            }
        }
        read(self.make_preview(id).await?).await
    }

    async fn make_preview(&self, id: MeshId) -> Result<String, Error> {
        let mesh = self.mesh(id).await?;
        let path = self.0.store.files().path(&mesh.sha256);
        let (unit, limits) = (unit_of(&mesh)?, Limits { max_triangles: self.0.options.max_triangles });
        let file = path.clone();
        let bytes = self.run_abandonable(file, move |poll| preview(&path, &mesh.sha256, unit, &limits, poll)).await?;
        let app = self.clone();
        self.run_to_completion(async move { app.0.store.put_preview(id, bytes).await }).await
    }

    /// Deletes a mesh that no unfinished job needs.
    ///
    /// # Errors
    /// [`Error::MeshNotFound`], [`Error::MeshInUse`], [`Error::Internal`].
    pub async fn delete_mesh(&self, id: MeshId) -> Result<(), Error> {
        let app = self.clone();
        self.run_to_completion(async move { app.freeing(|| app.0.store.delete_mesh(id, 0)).await }).await
    }

    /// Refuses new work once the service stops.
    pub(super) fn check_open(&self) -> Result<(), Error> {
        if self.0.stopping.is_cancelled() { Err(Error::Draining) } else { Ok(()) }
    }
}

/// Unit of a stored mesh's coordinates.
pub(super) fn unit_of(mesh: &UploadedMesh) -> Result<LengthUnit, Error> {
    mesh.unit.parse().map_err(|_| InternalError::Row(format!("unit {:?} of mesh {}", mesh.unit, mesh.id)).into())
}

fn timed_out(limit: Duration) -> Error {
    let secs = limit.as_secs_f64();
    Error::MeshUnreadable(format!(
        "reading the mesh took longer than the {secs} s that limits.parse_secs allows; simplify the mesh, or raise the setting"
    ))
}

/// Reads a mesh file; returns the mesh and the file's SHA-256. Ends with [`Error::Draining`] if `poll` says stop.
fn read(path: &Path, unit: LengthUnit, limits: &Limits, poll: &Poll<'_>) -> Result<(ReadMesh, String), Error> {
    let file = File::open(path)?;
    let length_bytes = file.metadata()?.len();
    let mut file = HashingReader::new(file);
    let read = mesh_io::read_from(&mut file, length_bytes, Some(unit), limits, poll).map_err(|error| match error {
        ReadError::Io(error) => error.into(),
        ReadError::Mesh(MeshError::Interrupted) => Error::Draining,
        ReadError::Mesh(error) => Error::MeshUnreadable(error.to_string()),
    })?;
    Ok((read, file.finish(poll)?.ok_or(Error::Draining)?))
}

/// A simplified mesh of a file of the store, as binary glTF.
fn preview(path: &Path, sha256: &str, unit: LengthUnit, limits: &Limits, poll: &Poll<'_>) -> Result<Vec<u8>, Error> {
    let (read, found) = read(path, unit, limits, poll)?;
    if found != sha256 {
        return Err(Error::FileDamaged { sha256: sha256.to_owned(), missing: false });
    }
    let preview = geometry::preview(&read.mesh, PREVIEW_TRIANGLES, poll).map_err(|_| Error::Draining)?;
    drop(read);
    Ok(geometry::glb(&preview))
}
