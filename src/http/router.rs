//! The router: every route, on one screen.

use std::sync::Arc;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{get, post};
use tower_http::catch_panic::CatchPanicLayer;
use utoipa::OpenApi as _;
use utoipa::openapi::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::keys::Keys;
use super::no_body::{NoBodyRoutes, refuse_body};
use super::options::ServerOptions;
use super::pacer::Pacer;
use super::quotas::{self, Quotas};
use super::routes::{
    calibrations, cells, checks, events, inspections, jobs, leases, meshes, results, robots, run_commands, runs, scanners, scans,
    session, storage, system, turntables,
};
use super::sessions::Sessions;
use super::{auth, dashboard, docs, hosts, layers, openapi};
use crate::service::App;

/// Path below which the API lies.
const API: &str = "/api/v1";

/// State that every handler shares.
#[derive(Clone)]
pub(super) struct ApiState {
    /// The service.
    pub app: App,
    /// Options of the server.
    pub options: Arc<ServerOptions>,
    /// Quotas of the resources that clients hold for long.
    pub quotas: Arc<Quotas>,
    /// Keys that clients present.
    pub keys: Arc<Keys>,
    /// Sessions of browsers that presented a key.
    pub sessions: Arc<Sessions>,
    /// Pace of downloads.
    pub downloads: Arc<Pacer>,
}

/// Routes whose response begins at once.
fn quick() -> OpenApiRouter<ApiState> {
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
        .routes(routes!(jobs::update, jobs::delete))
        .routes(routes!(jobs::put_labels))
        .routes(routes!(storage::storage))
        .routes(routes!(jobs::cancel))
        .routes(routes!(events::all))
        .routes(routes!(events::of_job))
        .merge(execution())
        .routes(routes!(calibrations::list))
        .routes(routes!(calibrations::delete))
        .routes(routes!(calibrations::cancel))
        .routes(routes!(calibrations::result))
        .routes(routes!(calibrations::cell))
        .routes(routes!(calibrations::report))
        .merge(inspection())
        .routes(routes!(session::begin, session::end))
        .routes(routes!(system::openapi))
        .merge(stored())
}

/// Routes of runs and of leases.
fn execution() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(runs::list))
        .routes(routes!(runs::delete))
        .routes(routes!(runs::events))
        .routes(routes!(run_commands::arm))
        .routes(routes!(run_commands::pause))
        .routes(routes!(run_commands::resume))
        .routes(routes!(run_commands::stop))
        // Taken too: an answer that there is no such path would leave arm and table moving.
        .route("/runs/{id}/pause/", post(run_commands::pause))
        .route("/runs/{id}/stop/", post(run_commands::stop))
        .routes(routes!(run_commands::step))
        .routes(routes!(run_commands::set_override))
        .routes(routes!(run_commands::located))
        .routes(routes!(runs::record))
        .routes(routes!(runs::record_csv))
        .routes(routes!(runs::audit))
        .routes(routes!(leases::take, leases::list))
        .routes(routes!(leases::renew, leases::give_back))
}

/// Routes of scans and of inspections.
fn inspection() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(scans::list))
        .routes(routes!(scans::get, scans::delete))
        .routes(routes!(scans::file))
        .routes(routes!(inspections::list))
        .routes(routes!(inspections::delete))
        .routes(routes!(inspections::cancel))
        .routes(routes!(inspections::result))
        .routes(routes!(inspections::losses))
        .routes(routes!(inspections::deviation))
        .routes(routes!(inspections::learned))
        .routes(routes!(inspections::report))
}

/// Routes of results, which are stored compressed and streamed as stored to clients that accept gzip.
fn stored() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(results::plan))
        .routes(routes!(results::program))
        .routes(routes!(results::program_2))
        .routes(routes!(results::program_3))
        .routes(routes!(results::program_4))
        .routes(routes!(results::program_text))
        .routes(routes!(results::program_text_2))
        .routes(routes!(results::program_text_3))
        .routes(routes!(results::program_text_4))
        .routes(routes!(results::viewpoints))
        .routes(routes!(results::viewpoints_csv))
        .routes(routes!(results::coverage))
        .routes(routes!(results::coverage_csv))
        .routes(routes!(results::missed))
        .routes(routes!(results::candidates))
        .routes(routes!(results::timings))
        .routes(routes!(results::report))
        .routes(routes!(results::report_text))
        .routes(routes!(results::coverage_bin))
        .routes(routes!(results::file))
}

/// Routes that wait for work on a mesh, and routes that limit their own time.
fn slow() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(meshes::file))
        .routes(routes!(meshes::preview))
        // The lookups of a new job may time out, but once it is being stored the response waits for it: else a 503 could
        // hide an accepted job, run or inspection.
        .routes(routes!(jobs::create))
        .routes(routes!(jobs::create_batch))
        .routes(routes!(runs::create))
        .routes(routes!(inspections::create))
        .routes(routes!(jobs::delete_selected))
        .routes(routes!(checks::check))
        .routes(routes!(calibrations::create))
        .routes(routes!(inspections::rescan))
        .routes(routes!(storage::retention, storage::apply_retention))
}

/// Routes that receive an upload.
fn uploads() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new().routes(routes!(meshes::upload)).routes(routes!(scans::upload)).layer(DefaultBodyLimit::disable())
}

/// Routes that may wait for a job or a run.
fn waits() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(jobs::get))
        .routes(routes!(runs::get))
        .routes(routes!(calibrations::get))
        .routes(routes!(inspections::get))
}

/// Routes that need no key.
fn open() -> OpenApiRouter<ApiState> {
    OpenApiRouter::new()
        .routes(routes!(system::healthz))
        .routes(routes!(system::readyz))
        .routes(routes!(system::version))
        .routes(routes!(system::metrics))
        .routes(routes!(docs::problems))
}

/// Pages for people, which are not part of the API.
fn pages() -> Router<ApiState> {
    Router::new()
        .route("/", get(dashboard::index))
        .route("/assets/{name}", get(dashboard::asset))
        .route("/licences", get(dashboard::licences))
        .route("/docs", get(docs::redirect))
        .route("/docs/", get(docs::index))
        .route("/docs/{file}", get(docs::file))
        .route("/problems/{code}", get(docs::problem))
        .route("/parameters", get(docs::parameters))
}

/// The API with its OpenAPI description; with its middleware if `state` is given.
fn documented(state: Option<&ApiState>) -> OpenApiRouter<ApiState> {
    let mut api = OpenApiRouter::new().merge(quick()).merge(slow()).merge(uploads()).merge(waits());
    if let Some(state) = state {
        let no_body = NoBodyRoutes::of(api.get_openapi(), API, state.options.body_idle_timeout);
        api = OpenApiRouter::new()
            .merge(quick().layer(from_fn_with_state(state.clone(), layers::limit_response_time)))
            .merge(slow())
            .merge(uploads().layer(from_fn_with_state(state.clone(), quotas::limit_uploads)))
            .merge(waits().layer(from_fn_with_state(state.clone(), quotas::limit_waits)))
            .layer(from_fn_with_state(no_body, refuse_body))
            .layer(from_fn_with_state(state.clone(), auth::require_key));
    }
    OpenApiRouter::with_openapi(openapi::ApiDoc::openapi()).nest(API, api).merge(open())
}

/// The router that serves `app`.
pub fn router(app: App, options: ServerOptions) -> Router {
    let downloads = Arc::new(Pacer::new(options.download_bytes_per_sec));
    let keys = Arc::new(Keys::open(&options));
    let state = ApiState { app, options: Arc::new(options), quotas: Arc::default(), keys, sessions: Arc::default(), downloads };
    let (router, _) = documented(Some(&state)).split_for_parts();
    let mut router = router
        .merge(pages())
        .layer(CatchPanicLayer::custom(layers::panic_response))
        .layer(from_fn_with_state(state.clone(), auth::refuse_cross_site))
        .layer(from_fn(layers::answer_options));
    if let Some(cross_origin) = layers::cross_origin(&state.options.cors_origins) {
        router = router.layer(cross_origin);
    }
    router
        .layer(from_fn(layers::refuse_transfer_codings))
        .layer(from_fn_with_state(state.clone(), hosts::check))
        .layer(from_fn(layers::restrict_reserve))
        .layer(from_fn_with_state(state.clone(), layers::observe))
        .with_state(state)
}

/// The OpenAPI document.
#[must_use]
pub fn document() -> OpenApi {
    let (_, mut document) = documented(None).split_for_parts();
    openapi::complete(&mut document);
    document
}
