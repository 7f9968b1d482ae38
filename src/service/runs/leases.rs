//! Leases of cells as clients see them: an id that only the holder knows, and the fencing token that commands name. Tokens rise
//! over restarts too.

use std::collections::{BTreeSet, HashMap};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::time::Instant;

use crate::cell::{FieldError, NotFound, SpecKind, SpecLibrary as _, did_you_mean};
use crate::execution::session::{Fence, Lease, LeaseError, Leases};
use crate::service::app::App;
use crate::service::error::Error;
use crate::service::store::IdempotencyKey;
use crate::service::submit::Submission;
use crate::wire::LeaseId;
use crate::wire::run::{HeldLease, LeaseDocument, LeaseList, LeaseRequest};

/// Leases with their ids.
pub(super) struct HeldLeases {
    pub(super) leases: Leases,
    ids: Mutex<HashMap<LeaseId, (String, Fence)>>,
}

impl HeldLeases {
    /// An empty set of leases; tokens are above `last`.
    pub(super) fn after(last: u64) -> Self {
        Self { leases: Leases::after(Fence(last)), ids: Mutex::default() }
    }

    /// Names a new lease, and forgets the names of those that have ended.
    fn name(&self, lease: &Lease) -> LeaseId {
        let (mut ids, id) = (self.ids(), LeaseId::generate());
        ids.retain(|_, (cell, token)| self.leases.check(cell, *token).is_ok());
        ids.insert(id, (lease.cell.clone(), lease.token));
        id
    }

    fn get(&self, id: LeaseId) -> Result<(String, Fence), Error> {
        self.ids().get(&id).cloned().ok_or(Error::LeaseNotFound(id))
    }

    /// Leases that are held, by the name of their cell.
    pub(super) fn current(&self) -> Vec<Lease> {
        let mut cells: Vec<String> = self.ids().values().map(|(cell, _)| cell.clone()).collect();
        cells.sort();
        cells.dedup();
        cells.iter().filter_map(|cell| self.leases.current(cell)).collect()
    }

    fn ids(&self) -> MutexGuard<'_, HashMap<LeaseId, (String, Fence)>> {
        // Consistent after every operation, so a poisoned lock is usable.
        self.ids.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl App {
    /// Takes the lease of a cell without an idempotency key: each call asks for a lease of its own.
    ///
    /// # Errors
    /// Errors of [`App::submit_lease`].
    pub async fn take_lease(&self, request: LeaseRequest) -> Result<LeaseDocument, Error> {
        self.submit_lease(request, Submission::default()).await
    }

    /// Takes the lease of a cell for a submission with an idempotency key. It is acknowledged once its token is on the disk. If the key was
    /// used for the same request before, returns the lease that was given for it, with the time that it has left, unless it has ended.
    ///
    /// # Errors
    /// [`Error::Invalid`], [`Error::IdempotencyMismatch`], [`Error::LeaseHeld`], [`Error::Draining`], [`Error::StorageBusy`],
    /// [`Error::Internal`].
    pub async fn submit_lease(&self, request: LeaseRequest, submission: Submission) -> Result<LeaseDocument, Error> {
        request.check().map_err(Error::Invalid)?;
        let idempotency = submission.idempotency(&format!("POST /api/v1/leases {}", serde_json::to_string(&request)?));
        self.check_open()?;
        self.check_cell_exists(&request.cell).await?;
        let app = self.clone();
        // To its end though the caller goes away: what is acquired is noted, or given back.
        self.run_to_completion(async move {
            let _turn = app.0.runs.accepting.lock().await;
            match app.lease_given_for(idempotency.as_ref()).await? {
                Some(given) => Ok(given),
                None => app.give_lease(&request, idempotency.as_ref()).await,
            }
        })
        .await
    }

    /// Gives the lease of a cell that is free.
    async fn give_lease(&self, request: &LeaseRequest, idempotency: Option<&IdempotencyKey>) -> Result<LeaseDocument, Error> {
        let (held, options) = (&self.0.runs.leases, &self.0.options.execution);
        let lease = held
            .leases
            .acquire(&request.cell, &request.holder, options.lease_ttl)
            .map_err(|error| Error::LeaseHeld(error.to_string()))?;
        let given = self.shown(held.name(&lease), &lease);
        if let Err(error) = self.0.store.note_fence(lease.token.0, idempotency.map(|key| (key, &given))).await {
            // Nobody has its id: it would keep everybody from the cell until it ran out.
            let _ = held.leases.release(&lease.cell, lease.token);
            return Err(error);
        }
        Ok(self.shown(given.id, &lease))
    }

    /// Lease that was given for this key, as it stands now; none once it has ended.
    async fn lease_given_for(&self, idempotency: Option<&IdempotencyKey>) -> Result<Option<LeaseDocument>, Error> {
        let Some(key) = idempotency else { return Ok(None) };
        let Some(given) = self.0.store.replay::<LeaseDocument>(key).await? else { return Ok(None) };
        let held = &self.0.runs.leases;
        // Names of leases that have ended are forgotten, all of them by a restart.
        let Ok((cell, token)) = held.get(given.id) else { return Ok(None) };
        let lease = held.leases.current(&cell).filter(|lease| lease.token == token);
        Ok(lease.map(|lease| self.shown(given.id, &lease)))
    }

    /// Refuses the name of a cell that is neither the operator's nor stored nor a preset: its lease would protect nothing.
    async fn check_cell_exists(&self, cell: &str) -> Result<(), Error> {
        let (cell, operated) = (cell.to_owned(), self.0.options.execution.cells.iter().map(|operated| operated.name.clone()));
        let operated: Vec<String> = operated.collect();
        if operated.contains(&cell) {
            return Ok(());
        }
        self.with_library(None, move |library| match library.cell(&cell) {
            Err(NotFound::Unknown) => {
                // The operator's cell may have the name of a stored one or of a preset.
                let names: BTreeSet<String> = operated.into_iter().chain(library.names(SpecKind::Cell)).collect();
                let question = did_you_mean(&cell, names.iter().map(String::as_str));
                let names = Vec::from_iter(names).join(", ");
                let detail = format!("no cell is named {cell:?}; known names are {names}{question}");
                Err(Error::Invalid(vec![FieldError { pointer: "/cell".to_owned(), detail }]))
            }
            Ok(_) | Err(NotFound::Unusable(_)) => Ok(()),
        })
        .await
    }

    /// Renews a lease: the heartbeat of its holder, which the runs under it hear too.
    ///
    /// # Errors
    /// [`Error::LeaseNotFound`].
    pub fn renew_lease(&self, id: LeaseId) -> Result<LeaseDocument, Error> {
        let (cell, token) = self.0.runs.leases.get(id)?;
        let lease = self.0.runs.leases.leases.renew(&cell, token).map_err(|_| Error::LeaseNotFound(id))?;
        for session in self.0.runs.under_lease(&cell) {
            // Only that of the run which this token armed listens.
            let _ = session.heartbeat(Some(token));
        }
        Ok(self.shown(id, &lease))
    }

    /// Gives a lease back; a live run under it stops.
    ///
    /// # Errors
    /// [`Error::LeaseNotFound`].
    pub fn give_lease_back(&self, id: LeaseId) -> Result<(), Error> {
        let (cell, token) = self.0.runs.leases.get(id)?;
        self.0.runs.leases.leases.release(&cell, token).map_err(|_| Error::LeaseNotFound(id))
    }

    /// Leases that are held.
    #[must_use]
    pub fn leases(&self) -> LeaseList {
        let item =
            |lease: &Lease| HeldLease { cell: lease.cell.clone(), holder: lease.holder.clone(), expires_in_ms: left_ms(lease) };
        LeaseList { items: self.0.runs.leases.current().iter().map(item).collect() }
    }

    /// Refuses a token that does not hold the lease of the cell.
    pub(super) fn check_token(&self, cell: &str, token: Option<u64>) -> Result<Fence, Error> {
        let token = Fence(token.ok_or_else(|| Error::LeaseRequired { cell: cell.to_owned() })?);
        self.0.runs.leases.leases.check(cell, token).map_err(|error: LeaseError| Error::TokenRefused(error.to_string()))?;
        Ok(token)
    }

    fn shown(&self, id: LeaseId, lease: &Lease) -> LeaseDocument {
        LeaseDocument {
            id,
            cell: lease.cell.clone(),
            holder: lease.holder.clone(),
            token: lease.token.0,
            ttl_ms: millis(lease.ttl),
            heartbeat_ms: millis(self.0.options.execution.heartbeat),
            expires_in_ms: left_ms(lease),
        }
    }
}

fn left_ms(lease: &Lease) -> u64 {
    millis(lease.expires_at.saturating_duration_since(Instant::now()))
}

fn millis(time: std::time::Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use serde_json::json;

    use super::*;
    use crate::planning::context::Context;
    use crate::service::OperatorCell;
    use crate::service::planner::JobInput;
    use crate::service::tests::{options, service};

    #[tokio::test]
    async fn a_lease_whose_token_cannot_be_stored_keeps_nobody_from_the_cell() {
        let (app, _folder) = service().await;
        app.0.store.fill_disk_at("UPDATE ON run_fence").await;
        let take = async || app.take_lease(LeaseRequest { cell: "e05-transcan".to_owned(), holder: String::new() }).await;
        let refused = take().await;
        assert!(matches!(refused, Err(Error::StorageFull)), "{refused:?}");
        take().await.expect("nobody holds it");
    }

    /// A client whose connection broke before the answer had no token, and nobody could have the cell.
    #[tokio::test]
    async fn a_request_for_a_lease_that_comes_again_with_its_key_gets_the_same_lease_until_that_has_ended() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut options = options(folder.path());
        // None ends by itself while the test is slow.
        options.execution.lease_ttl = Duration::from_secs(30);
        let planner = Arc::new(|_: &JobInput, _: &Context<'_>| Ok(Vec::new()));
        let app = App::open_with(options, planner, None).await.expect("a service");
        let take = async |key: &str, holder: &str| {
            let submission = Submission { idempotency_key: Some(key.to_owned()), ..Submission::default() };
            let request = LeaseRequest { cell: "e05-transcan".to_owned(), holder: holder.to_owned() };
            app.submit_lease(request, submission).await
        };
        let (first, second) = tokio::join!(take("k1", "a"), take("k1", "a"));
        let (first, second) = (first.expect("a lease"), second.expect("the same"));
        assert_eq!((second.id, second.token), (first.id, first.token));
        let refused = take("k1", "b").await;
        assert!(matches!(refused, Err(Error::IdempotencyMismatch)), "{refused:?}");
        let refused = take("k2", "a").await;
        assert!(matches!(refused, Err(Error::LeaseHeld(_))), "{refused:?}");
        let said = refused.expect_err("held").to_string();
        assert!(said.starts_with("cell e05-transcan is leased to a for another "), "{said}");
        // Who was refused was told to ask the holder, but not for what.
        let ways = "; wait until it ends, or have its holder give it back with DELETE /api/v1/leases/{id}; if it is yours and its \
                    answer was lost, repeat the request with its Idempotency-Key";
        assert!(said.ends_with(ways), "{said}");
        app.give_lease_back(first.id).expect("held");
        let next = take("k1", "a").await.expect("the cell is free");
        assert!(next.token > first.token && next.id != first.id, "{next:?}");
    }

    #[tokio::test]
    async fn a_lease_is_of_a_cell_that_there_is() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut options = options(folder.path());
        let controllers = json!({
            "arm": {"protocol": "hans", "address": "10.0.0.1:10003"},
            "table": {"protocol": "minas_a6", "address": "tcp://10.0.0.2:502", "units_per_turn": 1_600_000, "gear_ratio": 40},
        });
        // The second has the name of a preset.
        for name in ["line-3", "e05-transcan"] {
            options.execution.cells.push(OperatorCell {
                name: name.to_owned(),
                cell_sha256: "00".to_owned(),
                controllers: serde_json::from_value(controllers.clone()).expect("controllers"),
            });
        }
        let planner = Arc::new(|_: &JobInput, _: &Context<'_>| Ok(Vec::new()));
        let app = App::open_with(options, planner, None).await.expect("a service");
        let take = async |cell: &str| app.take_lease(LeaseRequest { cell: cell.to_owned(), holder: String::new() }).await;
        take("e05-transcan").await.expect("a preset");
        take("line-3").await.expect("the operator's");
        let Err(Error::Invalid(errors)) = take("e5-transcan").await else { panic!("no cell has this name") };
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert_eq!(errors[0].pointer, "/cell");
        let told = &errors[0].detail;
        assert!(told.starts_with("no cell is named \"e5-transcan\"") && told.ends_with("did you mean e05-transcan?"), "{told}");
        assert_eq!(told.matches(" e05-transcan").count(), 2, "it is listed once, and asked about: {told}");
        let Err(Error::Invalid(errors)) = take("line3").await else { panic!("no cell has this name") };
        assert!(errors[0].detail.ends_with("did you mean line-3?"), "{}", errors[0].detail);
        assert_eq!(app.leases().items.len(), 2);
    }
}
