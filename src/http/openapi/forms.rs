//! Query parameters that choose the form of a job's result. Every other form has a route of its own, so that each response keeps one
//! media type and one schema a status: the parameter lists the form of its route alone.

use serde_json::json;
use utoipa::openapi::path::{ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{ObjectBuilder, Type};
use utoipa::openapi::{OpenApi, RefOr, Required};

/// Results with the parameter that chooses their form, and the form that their route documents.
const FORMS: [(&str, &str, &str); 12] = [
    ("plan", "format", "json"),
    ("program", "dialect", "json"),
    ("program-2", "dialect", "json"),
    ("program-3", "dialect", "json"),
    ("program-4", "dialect", "json"),
    ("viewpoints", "format", "json"),
    ("coverage", "format", "json"),
    ("coverage.bin", "format", "bin"),
    ("missed", "format", "json"),
    ("candidates", "format", "json"),
    ("timings", "format", "json"),
    ("report", "format", "html"),
];

/// Adds the parameters.
pub(super) fn add(openapi: &mut OpenApi) {
    for (result, name, form) in FORMS {
        let item = openapi.paths.paths.get_mut(&format!("/api/v1/jobs/{{id}}/{result}"));
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
