//! Parts of results. Every stored result is sent by one function, which answers `Range`; routes of uploaded files list it
//! themselves.

use utoipa::openapi::path::{Operation, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{ObjectBuilder, Type};
use utoipa::openapi::{OpenApi, RefOr, Required, ResponseBuilder};

/// Tags of the routes that send stored results.
const TAGS: [&str; 2] = ["results", "inspections"];
/// Headers that ask for a part.
const HEADERS: [(&str, &str); 2] = [
    ("Range", "One range of bytes, for example `bytes=0-99`."),
    ("If-Range", "Entity tag of the version that the range is for; if the file is another version, the whole of it is sent."),
];

/// Adds the headers and the answer. A part of a document does not follow its schema, so the answer has none; 416 is among the
/// problems.
pub(super) fn add(openapi: &mut OpenApi) {
    let operations = openapi.paths.paths.values_mut().filter_map(|item| item.get.as_mut());
    for operation in operations.filter(|operation| sends_result(operation)) {
        let parameters = operation.parameters.get_or_insert_default();
        for (name, description) in HEADERS {
            let parameter = ParameterBuilder::new()
                .name(name)
                .parameter_in(ParameterIn::Header)
                .required(Required::False)
                .description(Some(description))
                .schema(Some(ObjectBuilder::new().schema_type(Type::String)));
            parameters.push(RefOr::T(parameter.build()));
        }
        let part = ResponseBuilder::new().description("The requested part of the result, in the media type of the whole.");
        operation.responses.responses.insert("206".to_owned(), part.build().into());
    }
}

/// Returns true for a route of a stored result, which has a tag and may be known to the client, that does not list parts itself.
fn sends_result(operation: &Operation) -> bool {
    let has = |status: &str| operation.responses.responses.contains_key(status);
    let is_tagged = operation.tags.iter().flatten().any(|tag| TAGS.contains(&tag.as_str()));
    is_tagged && has("304") && !has("206")
}
