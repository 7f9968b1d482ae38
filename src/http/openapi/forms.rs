//! Query parameters that choose the form of a job's result. Every other form has a route of its own, so that each response keeps one
//! media type and one schema a status: the parameter lists the form of its route alone, and the description of the response names the
//! others with their media types.

use serde_json::json;
use utoipa::openapi::path::{ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{ObjectBuilder, Type};
use utoipa::openapi::{OpenApi, RefOr, Required};

use crate::http::negotiate::Representation;
use crate::http::routes::results::{AskedParameter, asked_parameters};

/// Adds the parameters.
pub(super) fn add(openapi: &mut OpenApi) {
    for AskedParameter { path, name, form, others } in asked_parameters() {
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
        let Some(RefOr::T(response)) = operation.responses.responses.get_mut("200") else { continue };
        let essence = |form: &Representation| form.media_type.split(';').next().unwrap_or_default();
        let others: Vec<String> = others.iter().map(|form| format!("`{}` (`{}`)", form.name, essence(form))).collect();
        if !others.is_empty() {
            let about = format!(" Other forms, on request by `Accept` or `{name}`: {}.", others.join(", "));
            response.description += &about;
        }
    }
}
