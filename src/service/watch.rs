//! Looking at jobs and their results, waiting for a job's end, cancelling and deleting it.

use std::time::Duration;

use tokio::sync::broadcast::error::RecvError;
use tokio::time::{Instant, timeout_at};

use super::app::App;
use super::error::Error;
use super::store::blocking;
use crate::wire::{Job, JobFile, JobId};

impl App {
    /// One job.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::Internal`].
    pub async fn job(&self, id: JobId) -> Result<Job, Error> {
        self.0.store.job(id).await
    }

    /// One job, once it has ended, or as it is after `wait`.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::Internal`].
    pub async fn job_when_ended(&self, id: JobId, wait: Duration) -> Result<Job, Error> {
        let until = Instant::now() + wait;
        // Listening begins before the first look, so that no end is missed between the two.
        let mut events = self.0.store.listen();
        loop {
            let job = self.0.store.job(id).await?;
            if job.state.is_ended() {
                return Ok(job);
            }
            let next = async {
                loop {
                    match events.recv().await {
                        Ok(event) if event.job_id != id || !event.state.is_ended() => {}
                        Ok(_) | Err(RecvError::Lagged(_)) => return true,
                        Err(RecvError::Closed) => return false,
                    }
                }
            };
            tokio::select! {
                () = self.0.stopping.cancelled() => return Ok(job),
                looked_again = timeout_at(until, next) => if !matches!(looked_again, Ok(true)) {
                    return self.0.store.job(id).await;
                },
            }
        }
    }

    /// Asks for a job's cancellation.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::JobEnded`], [`Error::Internal`].
    pub async fn cancel(&self, id: JobId) -> Result<Job, Error> {
        let app = self.clone();
        self.to_the_end(async move {
            let job = app.0.store.cancel(id).await?;
            app.0.runner.cancel(id);
            Ok(job)
        })
        .await
    }

    /// Deletes an ended job and its results.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::JobNotEnded`], [`Error::Internal`].
    pub async fn delete_job(&self, id: JobId) -> Result<(), Error> {
        let app = self.clone();
        self.to_the_end(async move { app.0.store.delete_job(id).await }).await
    }

    /// What is known of one of a job's files, and nothing read yet.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::NoResults`], [`Error::NoSuchResult`], [`Error::Internal`].
    pub async fn result(&self, id: JobId, name: &str) -> Result<JobFile, Error> {
        self.0.store.result(id, name).await
    }

    /// The bytes of a job's file, checked against its hash.
    ///
    /// # Errors
    /// [`Error::Internal`].
    pub async fn read(&self, file: &JobFile) -> Result<Vec<u8>, Error> {
        let (files, sha256) = (self.0.store.files().clone(), file.sha256.clone());
        blocking(move || files.read(&sha256)).await
    }
}
