//! Hardware specifications: four collections with the same routes.

/// The routes of one collection.
macro_rules! collection {
    ($module:ident, $spec:ident, $variant:ident, $one:literal, $list_path:literal, $item_path:literal, [$list_id:literal, $get_id:literal, $put_id:literal, $delete_id:literal]) => {
        #[doc = concat!("Routes of ", $list_path, ".")]
        pub(in crate::http) mod $module {
            use axum::extract::{Path, State};
            use axum::http::header::{CONTENT_TYPE, ETAG};
            use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
            use axum::response::{IntoResponse, Response};

            use crate::cell::$spec;
            use crate::http::extract::{Json, Params, is_known};
            use crate::http::problem::Problem;
            use crate::http::router::Site;
            use crate::service::{Precondition, SpecEntry};
            use crate::wire::{SpecCollection, SpecList};

            #[utoipa::path(
                get,
                summary = concat!("List all ", $one, "s, presets and stored ones, by name"),
                path = $list_path,
                tag = "specifications",
                operation_id = $list_id,
                responses((status = 200, description = "All of them, by name.", body = SpecList))
            )]
            pub(in crate::http) async fn list(State(site): State<Site>, params: Params) -> Result<axum::Json<SpecList>, Problem> {
                params.end()?;
                Ok(axum::Json(site.app.specs(SpecCollection::$variant).await?))
            }

            #[utoipa::path(
                get,
                summary = concat!("Look at a ", $one),
                path = $item_path,
                tag = "specifications",
                operation_id = $get_id,
                params(("name" = String, Path, description = "Its name.")),
                responses(
                    (status = 200, description = "The specification.", body = $spec,
                        headers(("ETag" = String, description = "For `If-Match`."))),
                    (status = 304, description = "The client has it."),
                )
            )]
            pub(in crate::http) async fn get(
                State(site): State<Site>,
                Path(name): Path<String>,
                headers: HeaderMap,
                params: Params,
            ) -> Result<Response, Problem> {
                params.end()?;
                let entry = site.app.spec(SpecCollection::$variant, &name).await?;
                if is_known(&headers, &entry.etag) {
                    return Ok((StatusCode::NOT_MODIFIED, tag(&entry)).into_response());
                }
                Ok((StatusCode::OK, tag(&entry), JSON, entry.body).into_response())
            }

            #[utoipa::path(
                put,
                summary = concat!("Store a ", $one),
                description = "To replace one, say which version, with `If-Match`. Presets cannot be replaced.",
                path = $item_path,
                tag = "specifications",
                operation_id = $put_id,
                params(
                    ("name" = String, Path, description = "Its name, as in the body.", example = "mine", pattern = "^[a-z0-9][a-z0-9._-]{0,63}$"),
                    ("If-Match" = Option<String>, Header, description = "Tag of the version to be replaced."),
                    ("If-None-Match" = inline(Option<super::super::super::openapi::AnyVersion>), Header, description = "`*`: only if there is none."),
                ),
                request_body = $spec,
                responses(
                    (status = 200, description = "It was replaced.", body = $spec,
                        headers(("ETag" = String, description = "For `If-Match`."))),
                    (status = 201, description = "It is new.", body = $spec,
                        headers(("ETag" = String, description = "For `If-Match`."))),
                )
            )]
            pub(in crate::http) async fn put(
                State(site): State<Site>,
                Path(name): Path<String>,
                only_if: Precondition,
                params: Params,
                Json(spec): Json<$spec>,
            ) -> Result<Response, Problem> {
                params.end()?;
                let entry = site.app.put_spec(&name, spec, only_if).await?;
                let status = if entry.created { StatusCode::CREATED } else { StatusCode::OK };
                Ok((status, tag(&entry), JSON, entry.body).into_response())
            }

            #[utoipa::path(
                delete,
                summary = concat!("Delete a stored ", $one),
                description = "Accepted jobs have their own copy and go on with it.",
                path = $item_path,
                tag = "specifications",
                operation_id = $delete_id,
                params(
                    ("name" = String, Path, description = "Its name.", example = "mine"),
                    ("If-Match" = Option<String>, Header, description = "Tag of the version to be deleted."),
                ),
                responses((status = 204, description = "It is gone."))
            )]
            pub(in crate::http) async fn delete(
                State(site): State<Site>,
                Path(name): Path<String>,
                only_if: Precondition,
                params: Params,
            ) -> Result<StatusCode, Problem> {
                params.end()?;
                site.app.delete_spec(SpecCollection::$variant, &name, only_if).await?;
                Ok(StatusCode::NO_CONTENT)
            }

            const JSON: [(HeaderName, &str); 1] = [(CONTENT_TYPE, "application/json")];

            fn tag(entry: &SpecEntry) -> [(HeaderName, HeaderValue); 1] {
                // Tags are made of quotes, letters and digits: a proper header value.
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
