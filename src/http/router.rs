//! Every route, on one screen.

use std::sync::Arc;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::get;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use utoipa::OpenApi as _;
use utoipa::openapi::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::options::Options;
use super::routes::{cells, events, jobs, meshes, results, robots, scanners, system, turntables};
use super::{auth, docs, layers, openapi, page};
use crate::service::App;

/// What every handler may use.
#[derive(Clone)]
pub(super) struct Site {
    /// The service.
    pub app: App,
    /// How it is offered.
    pub options: Arc<Options>,
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
        .routes(routes!(jobs::create, jobs::list))
        .routes(routes!(jobs::delete))
        .routes(routes!(jobs::cancel))
        .routes(routes!(events::all))
        .routes(routes!(events::of_job))
        .merge(large())
}

/// Answers that are large and that compression makes small. None of them has a tag that is sent back in `If-Match`.
fn large() -> OpenApiRouter<Site> {
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
        .routes(routes!(system::openapi))
        .layer(CompressionLayer::new())
}

/// Answers that wait: for an upload, for a job, for work on a mesh.
fn slow() -> OpenApiRouter<Site> {
    OpenApiRouter::new()
        .routes(routes!(meshes::upload))
        .routes(routes!(meshes::file))
        .routes(routes!(meshes::preview))
        .routes(routes!(jobs::get))
        .layer(DefaultBodyLimit::disable())
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
        .layer(CompressionLayer::new())
}

fn documented(site: Option<&Site>) -> OpenApiRouter<Site> {
    let mut api = OpenApiRouter::new().merge(quick()).merge(slow());
    if let Some(site) = site {
        api = OpenApiRouter::new()
            .merge(quick().layer(from_fn_with_state(site.clone(), layers::limit_time)))
            .merge(slow())
            .layer(from_fn_with_state(site.clone(), auth::require_key));
    }
    OpenApiRouter::with_openapi(openapi::ApiDoc::openapi()).nest("/api/v1", api).merge(open())
}

/// The router that serves `app`.
pub fn router(app: App, options: Options) -> Router {
    let site = Site { app, options: Arc::new(options) };
    let (router, _) = documented(Some(&site)).split_for_parts();
    router
        .merge(pages())
        .layer(CatchPanicLayer::custom(layers::panicked))
        .layer(from_fn(auth::refuse_cross_site))
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
