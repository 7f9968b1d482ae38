//! Scans of parts: uploaded for a job, stored by content, read when the job is inspected.

use std::fs::File;

use super::app::App;
use super::error::Error;
use super::meshes::FinishedUpload;
use super::store::{Page, blocking};
use crate::inspection::ingest::ScanFrame;
use crate::wire::inspection::{Scan, ScanPage};
use crate::wire::{JobId, JobState, ScanId};

/// Facts that its sender states about an uploaded scan.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ScanUpload {
    /// Viewpoint of the plan.
    pub view: Option<u32>,
    /// Name of the file.
    pub name: Option<String>,
    /// Unit of the coordinates.
    pub unit: Option<String>,
    /// Frame of the coordinates.
    pub frame: Option<ScanFrame>,
}

impl App {
    /// Stores an upload as a scan of a job that has a plan. It is read when the job is inspected.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::NoResults`], [`Error::StorageFull`], [`Error::Draining`], [`Error::Internal`].
    pub async fn add_scan(&self, job: JobId, upload: FinishedUpload, about: ScanUpload) -> Result<Scan, Error> {
        self.check_open()?;
        self.check_planned(job).await?;
        let ScanUpload { view, name, unit, frame } = about;
        let id = ScanId::generate();
        let (sha256, created_at) = (String::new(), String::new());
        let scan = Scan { id, job_id: job, view, name, unit, frame, sha256, size_bytes: 0, created_at };
        let app = self.clone();
        self.run_to_completion(async move { app.0.store.add_scan(scan, upload.into_received()).await }).await
    }

    /// Refuses a job without a plan.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::NoResults`], [`Error::Internal`].
    pub async fn check_planned(&self, job: JobId) -> Result<(), Error> {
        let state = self.job_state(job).await?;
        if state == JobState::Succeeded { Ok(()) } else { Err(self.0.store.no_results(job, state).await) }
    }

    /// Number of viewpoints of a job's plan, which are numbered from 0; `None` where its summary cannot be read.
    ///
    /// # Errors
    /// Errors of [`App::check_planned`].
    pub async fn planned_views(&self, job: JobId) -> Result<Option<usize>, Error> {
        self.check_planned(job).await?;
        Ok(self.job(job).await?.summary.map(|summary| summary.views_chosen))
    }

    /// One scan.
    ///
    /// # Errors
    /// [`Error::ScanNotFound`], [`Error::Internal`].
    pub async fn scan(&self, id: ScanId) -> Result<Scan, Error> {
        self.0.store.scan(id).await
    }

    /// A page of a job's scans, oldest first.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::BadPageToken`], [`Error::Internal`].
    pub async fn scans(&self, job: JobId, page_size: u32, page_token: Option<&str>) -> Result<ScanPage, Error> {
        self.job_state(job).await?;
        self.0.store.scans(job, &Page::new(page_size, page_token, &format!("scans {job}"))?).await
    }

    /// Opens the file of a scan, once its bytes have been compared with its hash.
    ///
    /// # Errors
    /// [`Error::FileDamaged`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn open_scan(&self, scan: &Scan) -> Result<File, Error> {
        let (files, sha256) = (self.0.store.files().clone(), scan.sha256.clone());
        blocking(move || files.open_checked(&sha256)).await
    }

    /// Deletes a scan, unless its job is held or an inspection of its job has not ended.
    ///
    /// # Errors
    /// [`Error::ScanNotFound`], [`Error::JobHeld`], [`Error::ScanInUse`], [`Error::StorageBusy`], [`Error::Internal`].
    pub async fn delete_scan(&self, id: ScanId) -> Result<(), Error> {
        let app = self.clone();
        self.run_to_completion(async move {
            let hold = &app.0.options.retention.hold_label;
            app.freeing(|| app.0.store.delete_scan(id, hold)).await
        })
        .await
    }
}
