//! Hardware specifications: four collections with the same routes.

/// Defines the routes of one collection.
macro_rules! collection {
    ($module:ident, $spec:ident, $variant:ident, $one:literal, $list_path:literal, $item_path:literal, [$list_id:literal, $get_id:literal, $put_id:literal, $delete_id:literal]) => {
        #[doc = concat!("Routes of ", $list_path, ".")]
        pub(in crate::http) mod $module {
            use axum::extract::{Path, State};
            use axum::http::header::{CONTENT_TYPE, ETAG};
            use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
            use axum::response::{IntoResponse, Response};

            use crate::cell::$spec;
            use crate::http::extract::{Json, Params, check_if_match, etag_matches};
            use crate::http::problem::ApiError;
            use crate::http::router::ApiState;
            use crate::service::{Precondition, SpecEntry};
            use crate::wire::{SpecCollection, SpecList};

            #[utoipa::path(
                get,
                summary = concat!("List all ", $one, "s, presets and stored ones, by name"),
                path = $list_path,
                tag = "specifications",
                operation_id = $list_id,
                responses((status = 200, description = "All specifications of the collection, by name.", body = SpecList))
            )]
            pub(in crate::http) async fn list(State(state): State<ApiState>, params: Params) -> Result<Json<SpecList>, ApiError> {
                params.deny_unknown()?;
                Ok(Json(state.app.specs(SpecCollection::$variant).await?))
            }

            #[utoipa::path(
                get,
                summary = concat!("Get a ", $one),
                path = $item_path,
                tag = "specifications",
                operation_id = $get_id,
                params(
                    ("name" = String, Path, description = "Name of the specification.", pattern = "^[a-z0-9][a-z0-9._-]{0,63}$"),
                ),
                responses(
                    (status = 200, description = "The specification.", body = $spec,
                        headers(("ETag" = String, description = "Entity tag, for `If-Match`."))),
                    (status = 304, description = "The client has the current version."),
                )
            )]
            pub(in crate::http) async fn get(
                State(state): State<ApiState>,
                Path(name): Path<String>,
                headers: HeaderMap,
                params: Params,
            ) -> Result<Response, ApiError> {
                params.deny_unknown()?;
                let entry = state.app.spec(SpecCollection::$variant, &name).await?;
                check_if_match(&headers, &entry.etag)?;
                if etag_matches(&headers, &entry.etag) {
                    return Ok((StatusCode::NOT_MODIFIED, tag(&entry)).into_response());
                }
                Ok((StatusCode::OK, tag(&entry), JSON, entry.body).into_response())
            }

            #[utoipa::path(
                put,
                summary = concat!("Store a ", $one),
                description = "To replace a stored specification, send the entity tag of its current version in `If-Match`. Presets cannot be replaced.",
                path = $item_path,
                tag = "specifications",
                operation_id = $put_id,
                params(
                    ("name" = String, Path, description = "Name of the specification; must equal `name` in the body.", example = "mine", pattern = "^[a-z0-9][a-z0-9._-]{0,63}$"),
                    ("If-Match" = Option<String>, Header, description = "Entity tag of the version to replace."),
                    ("If-None-Match" = inline(Option<super::super::super::openapi::AnyVersion>), Header, description = "`*`: store only if no specification has this name."),
                ),
                request_body = $spec,
                responses(
                    (status = 200, description = "The specification was replaced.", body = $spec,
                        headers(("ETag" = String, description = "Entity tag, for `If-Match`."))),
                    (status = 201, description = "The specification was created.", body = $spec,
                        headers(("ETag" = String, description = "Entity tag, for `If-Match`."))),
                )
            )]
            pub(in crate::http) async fn put(
                State(state): State<ApiState>,
                Path(name): Path<String>,
                only_if: Precondition,
                params: Params,
                Json(spec): Json<$spec>,
            ) -> Result<Response, ApiError> {
                params.deny_unknown()?;
                let entry = state.app.put_spec(&name, spec, only_if).await?;
                let status = if entry.created { StatusCode::CREATED } else { StatusCode::OK };
                Ok((status, tag(&entry), JSON, entry.body).into_response())
            }

            #[utoipa::path(
                delete,
                summary = concat!("Delete a stored ", $one),
                description = "Accepted jobs are not affected: they have their own copy.",
                path = $item_path,
                tag = "specifications",
                operation_id = $delete_id,
                params(
                    ("name" = String, Path, description = "Name of the specification.", example = "mine",
                        pattern = "^[a-z0-9][a-z0-9._-]{0,63}$"),
                    ("If-Match" = Option<String>, Header, description = "Entity tag of the version to delete."),
                ),
                responses((status = 204, description = "The specification was deleted."))
            )]
            pub(in crate::http) async fn delete(
                State(state): State<ApiState>,
                Path(name): Path<String>,
                only_if: Precondition,
                params: Params,
            ) -> Result<StatusCode, ApiError> {
                params.deny_unknown()?;
                state.app.delete_spec(SpecCollection::$variant, &name, only_if).await?;
                Ok(StatusCode::NO_CONTENT)
            }

            const JSON: [(HeaderName, &str); 1] = [(CONTENT_TYPE, "application/json")];

            fn tag(entry: &SpecEntry) -> [(HeaderName, HeaderValue); 1] {
                // Tags consist of quotes, letters and digits: a valid header value.
                [(ETAG, HeaderValue::from_str(&entry.etag).unwrap_or(HeaderValue::from_static("\"\"")))]
            }
        }
    };
}

collection! {
    scanners, ScannerSpec, Scanner, "scanner", "/scanners", "/scanners/{name}",
    ["list_scanners", "get_scanner", "put_scanner", "delete_scanner"]
}
collection! {
    robots, RobotSpec, Robot, "robot", "/robots", "/robots/{name}",
    ["list_robots", "get_robot", "put_robot", "delete_robot"]
}
collection! {
    turntables, TurntableSpec, Turntable, "turntable", "/turntables", "/turntables/{name}",
    ["list_turntables", "get_turntable", "put_turntable", "delete_turntable"]
}
collection! {
    cells, CellSpec, Cell, "cell", "/cells", "/cells/{name}",
    ["list_cells", "get_cell", "put_cell", "delete_cell"]
}
