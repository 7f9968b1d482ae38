//! Meshes: received while hashed, looked into, kept by content.

use std::path::PathBuf;

use bytes::Bytes;
use tokio::sync::{OwnedSemaphorePermit, mpsc};
use tokio::task::JoinHandle;

use super::app::App;
use super::error::{Error, Fault};
use super::plan_job::PREVIEW_TRIANGLES;
use super::store::{NewMesh, Page, Received, blocking};
use crate::geometry::mesh_io::{self, Limits};
use crate::geometry::{self, LengthUnit};
use crate::wire::{Mesh, MeshHealth, MeshId, MeshPage};

/// Pieces of an upload that may wait for the disk.
const PIECES_AHEAD: usize = 8;

/// An upload under way: pieces go to a thread that hashes and writes them. Dropped, it leaves nothing behind.
pub struct Upload {
    pieces: mpsc::Sender<Piece>,
    writer: JoinHandle<Result<Option<Received>, Error>>,
    received_bytes: u64,
    limit_bytes: u64,
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
    /// Begins an upload, once there is a place for it: each holds a thread that writes.
    ///
    /// # Errors
    /// [`Error::Draining`].
    pub async fn receive(&self) -> Result<Upload, Error> {
        self.check_open()?;
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
        Ok(Upload { pieces: sender, writer, received_bytes: 0, limit_bytes, _place: place })
    }

    /// Looks into an upload and keeps it, if it is a mesh.
    ///
    /// # Errors
    /// [`Error::MeshUnreadable`], [`Error::StorageFull`], [`Error::Draining`], [`Error::Internal`].
    pub async fn add_mesh(&self, upload: FinishedUpload, about: MeshUpload) -> Result<Mesh, Error> {
        self.check_open()?;
        let app = self.clone();
        self.to_the_end(async move {
            let FinishedUpload(received) = upload;
            let _one_of_few = app.0.parsing.acquire().await.map_err(|_| Error::Draining)?;
            let limits = Limits { max_triangles: app.0.options.max_triangles };
            let (received, health) = blocking(move || {
                let health = inspect(&std::fs::read(received.file.path())?, about.unit, &limits)?;
                Ok((received, health))
            })
            .await?;
            let new = NewMesh { received, unit: about.unit.as_str().to_owned(), name: about.name, health };
            app.0.store.add_mesh(new).await
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

    /// A mesh and where its file is.
    ///
    /// # Errors
    /// [`Error::MeshNotFound`], [`Error::Internal`].
    pub async fn mesh_file(&self, id: MeshId) -> Result<(Mesh, PathBuf), Error> {
        let mesh = self.0.store.mesh(id).await?;
        let path = self.0.store.files().path(&mesh.sha256);
        Ok((mesh, path))
    }

    /// A thinned mesh for viewers, as binary glTF, and its SHA-256; made when it is first asked for.
    ///
    /// # Errors
    /// [`Error::MeshNotFound`], [`Error::Internal`].
    pub async fn preview(&self, id: MeshId) -> Result<(String, Vec<u8>), Error> {
        let sha256 = match self.0.store.preview(id).await? {
            Some(sha256) => sha256,
            None => self.make_preview(id).await?,
        };
        let files = self.0.store.files().clone();
        blocking(move || files.read(&sha256).map(|bytes| (sha256, bytes))).await
    }

    async fn make_preview(&self, id: MeshId) -> Result<String, Error> {
        let (mesh, _) = self.mesh_file(id).await?;
        let app = self.clone();
        self.to_the_end(async move {
            let _one_of_few = app.0.parsing.acquire().await.map_err(|_| Error::Draining)?;
            let (files, limits) = (app.0.store.files().clone(), Limits { max_triangles: app.0.options.max_triangles });
            let unit = unit_of(&mesh)?;
            let bytes = blocking(move || preview(&files.read(&mesh.sha256)?, unit, &limits)).await?;
            app.0.store.keep_preview(id, bytes).await
        })
        .await
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

/// What a file is as a mesh.
fn inspect(bytes: &[u8], unit: LengthUnit, limits: &Limits) -> Result<MeshHealth, Error> {
    let read = mesh_io::read(bytes, Some(unit), limits).map_err(|error| Error::MeshUnreadable(error.to_string()))?;
    Ok(MeshHealth::new(&read))
}

/// The mesh of a file, thinned, as binary glTF.
fn preview(bytes: &[u8], unit: LengthUnit, limits: &Limits) -> Result<Vec<u8>, Error> {
    let read = mesh_io::read(bytes, Some(unit), limits).map_err(|error| Error::MeshUnreadable(error.to_string()))?;
    Ok(geometry::glb(&geometry::preview(&read.mesh, PREVIEW_TRIANGLES)))
}
