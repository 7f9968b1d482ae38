//! Every route, on one screen.

use std::sync::Arc;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::get;
use tower_http::catch_panic::CatchPanicLayer;
use utoipa::OpenApi as _;
use utoipa::openapi::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::options::Options;
use super::routes::{cells, events, jobs, meshes, results, robots, scanners, session, storage, system, turntables};
use super::sessions::Sessions;
use super::shares::{self, Shares};
use super::{auth, docs, hosts, layers, openapi, page};
use crate::service::App;

/// What every handler may use.
#[derive(Clone)]
pub(super) struct Site {
    /// The service.
    pub app: App,
    /// How it is offered.
    pub options: Arc<Options>,
    /// What clients hold for long.
    pub shares: Arc<Shares>,
    /// Browsers that have shown the key.
    pub sessions: Arc<Sessions>,
}

/// Answers that begin at once.
fn quick() -> OpenApiRouter<Site> {
    OpenApiRouter::new()
        .routes(routes!(meshes::list))
        .routes(routes!(meshes::get, meshes::delete))
        .routes(routes!(scanners::list))
        .routes(routes!(scanners::get, scanners::put, scanners::delete))
        .routes(routes!(robots::list))
        .routes(routes!(robots::get, robots::put, robots::delete))
        .routes(routes!(turntables::list))
        .routes(routes!(turntables::get, turntables::put, turntables::delete))
        .routes(routes!(cells::list))
        .routes(routes!(cells::get, cells::put, cells::delete))
        .routes(routes!(jobs::list))
        .routes(routes!(jobs::delete))
        .routes(routes!(jobs::put_labels))
        .routes(routes!(storage::storage))
        .routes(routes!(jobs::cancel))
        .routes(routes!(events::all))
        .routes(routes!(events::of_job))
        .routes(routes!(session::begin, session::end))
        .routes(routes!(system::openapi))
        .merge(stored())
}

/// Results: stored compressed, and streamed as they are stored to whoever takes that.
fn stored() -> OpenApiRouter<Site> {
    OpenApiRouter::new()
        .routes(routes!(results::plan))
        .routes(routes!(results::program))
        .routes(routes!(results::program_2))
        .routes(routes!(results::program_3))
        .routes(routes!(results::program_4))
        .routes(routes!(results::viewpoints))
        .routes(routes!(results::coverage))
        .routes(routes!(results::missed))
        .routes(routes!(results::timings))
        .routes(routes!(results::report))
        .routes(routes!(results::coverage_bin))
        .routes(routes!(results::file))
}

/// Answers that wait for work on a mesh, and those that limit their own time.
fn slow() -> OpenApiRouter<Site> {
    OpenApiRouter::new()
        .routes(routes!(meshes::file))
        .routes(routes!(meshes::preview))
        // Looking up may be given up, but once a job is on its way to the disk its answer is waited for: else a 503 could
        // be a job.
        .routes(routes!(jobs::create))
        .routes(routes!(storage::retention, storage::apply_retention))
}

/// Answers that wait for an upload.
fn uploads() -> OpenApiRouter<Site> {
    OpenApiRouter::new().routes(routes!(meshes::upload)).layer(DefaultBodyLimit::disable())
}

/// Answers that may wait for a job.
fn waits() -> OpenApiRouter<Site> {
    OpenApiRouter::new().routes(routes!(jobs::get))
}

/// What needs no key.
fn open() -> OpenApiRouter<Site> {
    OpenApiRouter::new()
        .routes(routes!(system::healthz))
        .routes(routes!(system::readyz))
        .routes(routes!(system::version))
        .routes(routes!(system::metrics))
        .routes(routes!(docs::problems))
}

/// Pages for people; no part of the interface.
fn pages() -> Router<Site> {
    Router::new()
        .route("/", get(page::index))
        .route("/assets/{name}", get(page::asset))
        .route("/docs", get(docs::redirect))
        .route("/docs/", get(docs::index))
        .route("/docs/{file}", get(docs::file))
}

fn documented(site: Option<&Site>) -> OpenApiRouter<Site> {
    let mut api = OpenApiRouter::new().merge(quick()).merge(slow()).merge(uploads()).merge(waits());
    if let Some(site) = site {
        api = OpenApiRouter::new()
            .merge(quick().layer(from_fn_with_state(site.clone(), layers::limit_time)))
            .merge(slow())
            .merge(uploads().layer(from_fn_with_state(site.clone(), shares::upload)))
            .merge(waits().layer(from_fn_with_state(site.clone(), shares::wait)))
            .layer(from_fn_with_state(site.clone(), auth::require_key));
    }
    OpenApiRouter::with_openapi(openapi::ApiDoc::openapi()).nest("/api/v1", api).merge(open())
}

/// The router that serves `app`.
pub fn router(app: App, options: Options) -> Router {
    let site = Site { app, options: Arc::new(options), shares: Arc::default(), sessions: Arc::default() };
    let (router, _) = documented(Some(&site)).split_for_parts();
    router
        .merge(pages())
        .layer(CatchPanicLayer::custom(layers::panicked))
        .layer(from_fn(auth::refuse_cross_site))
        .layer(from_fn_with_state(site.clone(), hosts::check))
        .layer(from_fn(layers::keep_reserve))
        .layer(from_fn_with_state(site.clone(), layers::observe))
        .with_state(site)
}

/// The OpenAPI document.
#[must_use]
pub fn document() -> OpenApi {
    let (_, mut document) = documented(None).split_for_parts();
    openapi::complete(&mut document);
    document
}
