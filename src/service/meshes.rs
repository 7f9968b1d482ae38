//! Meshes: received while hashed, looked into, kept by content.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytes::Bytes;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio::task::JoinHandle;

use super::app::App;
use super::error::{Error, Fault};
use super::hashed::Hashed;
use super::plan_job::PREVIEW_TRIANGLES;
use super::store::{NewMesh, Page, Received, blocking};
use crate::geometry::mesh_io::{self, Limits, MeshError, ReadError, ReadMesh};
use crate::geometry::{self, LengthUnit, Poll};
use crate::wire::{Mesh, MeshHealth, MeshId, MeshPage};

/// Pieces of an upload that may wait for the disk.
const PIECES_AHEAD: usize = 8;

/// The free space is looked at again whenever an upload has brought this much.
const SPACE_CHECK_BYTES: u64 = 16 << 20;

/// An upload under way: pieces go to a thread that hashes and writes them. Dropped, it leaves nothing behind.
pub struct Upload {
    pieces: mpsc::Sender<Piece>,
    writer: JoinHandle<Result<Option<Received>, Error>>,
    received_bytes: u64,
    limit_bytes: u64,
    app: App,
    /// The free space was last looked at when this much had come.
    looked_at_bytes: u64,
    _place: OwnedSemaphorePermit,
}

enum Piece {
    Bytes(Bytes),
    End,
}

/// An upload that is on the disk, without a name yet.
pub struct FinishedUpload(Received);

/// What is said about an uploaded mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MeshUpload {
    /// Unit of its coordinates.
    pub unit: LengthUnit,
    /// Its name.
    pub name: Option<String>,
}

impl Upload {
    /// Takes one more piece.
    ///
    /// # Errors
    /// [`Error::UploadTooLarge`], [`Error::StorageFull`], [`Error::Internal`].
    pub async fn write(&mut self, bytes: Bytes) -> Result<(), Error> {
        self.received_bytes += bytes.len() as u64;
        if self.received_bytes > self.limit_bytes {
            return Err(Error::UploadTooLarge { limit_bytes: self.limit_bytes });
        }
        if self.received_bytes - self.looked_at_bytes >= SPACE_CHECK_BYTES {
            self.looked_at_bytes = self.received_bytes;
            self.app.check_space(0)?;
        }
        if self.pieces.send(Piece::Bytes(bytes)).await.is_err() {
            // The thread has ended, with the reason.
            return Err((&mut self.writer).await?.err().unwrap_or_else(ended_early));
        }
        Ok(())
    }

    /// Puts what was received onto the disk; if its SHA-256 was announced, it must be that.
    ///
    /// # Errors
    /// [`Error::DigestMismatch`], [`Error::StorageFull`], [`Error::Internal`].
    pub async fn finish(self, announced: Option<&str>) -> Result<FinishedUpload, Error> {
        // When this cannot be sent the thread has ended, and says why below.
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
    Fault::Task("an upload ended early".to_owned()).into()
}

impl App {
    /// Begins an upload of about so many bytes, once there is a place for it: each holds a thread that writes.
    ///
    /// # Errors
    /// [`Error::Draining`], [`Error::StorageLow`].
    pub async fn receive(&self, announced_bytes: u64) -> Result<Upload, Error> {
        self.check_open()?;
        self.check_space(announced_bytes)?;
        let place = self.0.uploads.clone().acquire_owned().await.map_err(|_| Error::Draining)?;
        let (sender, mut pieces) = mpsc::channel(PIECES_AHEAD);
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
        Ok(Upload { pieces: sender, writer, received_bytes: 0, limit_bytes, app, looked_at_bytes: 0, _place: place })
    }

    /// Looks into an upload and keeps it, if it is a mesh.
    ///
    /// # Errors
    /// [`Error::MeshUnreadable`], [`Error::StorageFull`], [`Error::Draining`], [`Error::Internal`].
    pub async fn add_mesh(&self, upload: FinishedUpload, about: MeshUpload) -> Result<Mesh, Error> {
        self.check_open()?;
        let FinishedUpload(received) = upload;
        let limits = Limits { max_triangles: self.0.options.max_triangles };
        let (received, health) = self
            .wanted(move |poll| {
                let (read, _) = read(received.file.path(), about.unit, &limits, poll)?;
                Ok((received, MeshHealth::new(&read)))
            })
            .await?;
        let new = NewMesh { received, unit: about.unit.as_str().to_owned(), name: about.name, health };
        let app = self.clone();
        self.to_the_end(async move { app.0.store.add_mesh(new).await }).await
    }

    /// Work on a mesh that ends when nobody waits for it any more, when the service stops, and when it takes too long. It
    /// runs on a thread that may block, few at a time.
    async fn wanted<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Poll<'_>) -> Result<T, Error> + Send + 'static,
    ) -> Result<T, Error> {
        let place = Arc::clone(&self.0.parsing).acquire_owned().await.map_err(|_| Error::Draining)?;
        let (unwanted, limit) = (self.0.stopping.child_token(), self.0.options.parse_limit);
        // Cancels when this is dropped: when the client has gone.
        let _wanted = unwanted.clone().drop_guard();
        blocking(move || {
            let _one_of_few = place;
            let began = Instant::now();
            let stop = || unwanted.is_cancelled() || began.elapsed() > limit;
            work(&Poll::new(&stop)).map_err(|error| match error {
                Error::Draining if !unwanted.is_cancelled() => too_slow(limit),
                error => error,
            })
        })
        .await
    }

    /// One mesh.
    ///
    /// # Errors
    /// [`Error::MeshNotFound`], [`Error::Internal`].
    pub async fn mesh(&self, id: MeshId) -> Result<Mesh, Error> {
        self.0.store.mesh(id).await
    }

    /// A page of meshes, newest first.
    ///
    /// # Errors
    /// [`Error::BadPageToken`], [`Error::Internal`].
    pub async fn meshes(&self, page_size: u32, page_token: Option<&str>) -> Result<MeshPage, Error> {
        self.0.store.meshes(&Page::new(page_size, page_token, "meshes")?).await
    }

    /// The uploaded file of a mesh, open for reading, once its bytes have been compared with its hash.
    ///
    /// # Errors
    /// [`Error::FileDamaged`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn open_mesh(&self, mesh: &Mesh) -> Result<File, Error> {
        let (files, sha256) = (self.0.store.files().clone(), mesh.sha256.clone());
        blocking(move || files.check(&sha256)).await
    }

    /// A thinned mesh for viewers, as binary glTF, and its SHA-256; made when it is first asked for, and again when it was
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
        let bytes = self.wanted(move |poll| preview(&path, &mesh.sha256, unit, &limits, poll)).await?;
        let app = self.clone();
        self.to_the_end(async move { app.0.store.keep_preview(id, bytes).await }).await
    }

    /// Deletes a mesh that no unfinished job needs.
    ///
    /// # Errors
    /// [`Error::MeshNotFound`], [`Error::MeshInUse`], [`Error::Internal`].
    pub async fn delete_mesh(&self, id: MeshId) -> Result<(), Error> {
        let app = self.clone();
        self.to_the_end(async move { app.0.store.delete_mesh(id).await }).await
    }

    /// Refuses new work once the service stops.
    pub(super) fn check_open(&self) -> Result<(), Error> {
        if self.0.stopping.is_cancelled() { Err(Error::Draining) } else { Ok(()) }
    }
}

/// The unit that a stored mesh is in.
pub(super) fn unit_of(mesh: &Mesh) -> Result<LengthUnit, Error> {
    mesh.unit.parse().map_err(|_| Fault::Row(format!("unit {:?} of mesh {}", mesh.unit, mesh.id)).into())
}

fn too_slow(limit: Duration) -> Error {
    let secs = limit.as_secs_f64();
    Error::MeshUnreadable(format!(
        "reading it took longer than the {secs} s that limits.parse_secs allows; simplify the mesh, or raise the setting"
    ))
}

/// The mesh of a file, and the SHA-256 of the file. Told to stop, it ends with [`Error::Draining`].
fn read(path: &Path, unit: LengthUnit, limits: &Limits, poll: &Poll<'_>) -> Result<(ReadMesh, String), Error> {
    let file = File::open(path)?;
    let length_bytes = file.metadata()?.len();
    let mut file = Hashed::new(file);
    let read = mesh_io::read_from(&mut file, length_bytes, Some(unit), limits, poll).map_err(|error| match error {
        ReadError::Io(error) => error.into(),
        ReadError::Mesh(MeshError::Interrupted) => Error::Draining,
        ReadError::Mesh(error) => Error::MeshUnreadable(error.to_string()),
    })?;
    Ok((read, file.finish(poll)?.ok_or(Error::Draining)?))
}

/// The mesh of a file of the store, thinned, as binary glTF.
fn preview(path: &Path, sha256: &str, unit: LengthUnit, limits: &Limits, poll: &Poll<'_>) -> Result<Vec<u8>, Error> {
    let (read, found) = read(path, unit, limits, poll)?;
    if found != sha256 {
        return Err(Error::FileDamaged { sha256: sha256.to_owned(), missing: false });
    }
    let preview = geometry::preview(&read.mesh, PREVIEW_TRIANGLES, poll).map_err(|_| Error::Draining)?;
    drop(read);
    Ok(geometry::glb(&preview))
}
