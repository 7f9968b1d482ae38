//! Reports drawn when somebody asks for them. A job leaves a draft, which holds all that its pictures need: neither the mesh nor the
//! plan is read again, so a report can be drawn after they were deleted, and by a later version. The first request draws it
//! on threads of its own and stores it in place of the draft; requests that come meanwhile wait for that. A full disk keeps the draft,
//! and each request draws the report. One report is drawn at a time, which bounds the memory: that of the draft, 50 MB at most for
//! parts of any size, and 25 MB for each thread of the pool.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::app::App;
use super::error::{Error, InternalError};
use super::plan_job::{Artifact, REPORT_DRAFT_FILE, REPORT_FILE, drawn_report};
use super::queries::ResultBody;
use super::store::ResultFile;
use crate::wire::JobId;

impl App {
    /// A job's result; its report is drawn if nobody has asked for it before.
    pub(super) async fn found_result(&self, id: JobId, name: &str) -> Result<ResultBody, Error> {
        if name == REPORT_DRAFT_FILE {
            return Err(Error::NoSuchResult { job: id, name: name.to_owned(), advice: "" });
        }
        match self.0.store.result(id, name).await {
            Err(Error::NoSuchResult { .. }) if name == REPORT_FILE => {
                let app = self.clone();
                // Whoever asked may go away: the next one has it then.
                self.run_to_completion(async move { app.draw_report(id).await }).await
            }
            found => Ok(self.body_of(found?)),
        }
    }

    async fn draw_report(&self, id: JobId) -> Result<ResultBody, Error> {
        let _alone = self.0.drawing.lock().await;
        let none = |error: Error| {
            if let Error::NoSuchResult { job, advice, .. } = error {
                return Error::NoSuchResult { job, name: REPORT_FILE.to_owned(), advice };
            }
            error
        };
        match self.0.store.result(id, REPORT_FILE).await {
            Err(Error::NoSuchResult { .. }) => {}
            drawn_meanwhile => return Ok(self.body_of(drawn_meanwhile?)),
        }
        let draft = self.0.store.result(id, REPORT_DRAFT_FILE).await.map_err(none)?;
        let draft = self.0.store.read_result(&draft).await?;
        let cancel = Arc::new(AtomicBool::new(false));
        let drawn = self.0.runner.compute(Arc::clone(&cancel), move |ctx| drawn_report(&draft, ctx));
        tokio::pin!(drawn);
        let drawn = tokio::select! {
            drawn = &mut drawn => drawn,
            () = self.0.stopping.cancelled() => {
                cancel.store(true, Ordering::Relaxed);
                (&mut drawn).await
            }
        };
        let unread = || InternalError::Row(format!("the {REPORT_DRAFT_FILE} of job {id} cannot be read by this version"));
        let report = match drawn.map_err(InternalError::Task)? {
            Ok(report) => report.ok_or_else(unread)?,
            Err(_) => return Err(Error::Draining),
        };
        self.keep_or_give(id, report).await
    }

    /// Stores a drawn report. Where the disk has no room for it, it is given out all the same, and drawn again for the next request.
    async fn keep_or_give(&self, id: JobId, report: Artifact) -> Result<ResultBody, Error> {
        match self.keep_drawn(id, report.clone()).await {
            Err(Error::StorageFull | Error::StorageLow { .. }) => Ok(self.body_of_unstored(report)),
            kept => Ok(self.body_of(kept?)),
        }
    }

    /// Stores a drawn report in place of its draft. One that no row names in the end, as that of a job that was deleted meanwhile, is
    /// taken back.
    async fn keep_drawn(&self, id: JobId, report: Artifact) -> Result<ResultFile, Error> {
        let stored = self.put_results(Arc::new(vec![report])).await?;
        let replaced = self.0.store.replace_draft(id, &stored).await;
        let written = stored.written.clone();
        // Pinned until here: whoever deletes the job from now on removes the file.
        drop(stored);
        let found = match replaced {
            Ok(()) => self.0.store.result(id, REPORT_FILE).await,
            Err(error) => Err(error),
        };
        if found.is_err() {
            self.0.store.take_back(written).await;
        }
        found
    }
}

#[cfg(test)]
mod tests;
