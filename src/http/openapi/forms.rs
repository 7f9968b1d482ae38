//! Query parameters that choose the form of a job's result. Every other form has a route of its own, so that each response keeps one
//! media type and one schema a status: the parameter lists the form of its route alone.

use serde_json::json;
use utoipa::openapi::path::{ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{ObjectBuilder, Type};
use utoipa::openapi::{OpenApi, RefOr, Required};

use crate::http::routes::results::{AskedParameter, asked_parameters};

/// Adds the parameters.
pub(super) fn add(openapi: &mut OpenApi) {
    for AskedParameter { path, name, form } in asked_parameters() {
        let item = openapi.paths.paths.get_mut(&format!("/api/v1{path}"));
        let Some(operation) = item.and_then(|item| item.get.as_mut()) else { continue };
        let schema = ObjectBuilder::new().schema_type(Type::String).enum_values(Some([form]));
        let parameter = ParameterBuilder::new()
            .name(name)
            .parameter_in(ParameterIn::Query)
            .required(Required::False)
            .description(Some("Form of the response. Default: chosen by `Accept`. Other forms have routes of their own."))
            .schema(Some(schema))
            .example(Some(json!(form)));
        operation.parameters.get_or_insert_default().push(RefOr::T(parameter.build()));
    }
}
