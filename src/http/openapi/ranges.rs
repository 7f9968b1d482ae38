//! Parts of results. Every stored result is sent by one function, which answers `Range`; routes of uploaded files list it
//! themselves.

use utoipa::openapi::path::{Operation, ParameterBuilder, ParameterIn};
use utoipa::openapi::schema::{ObjectBuilder, Type};
use utoipa::openapi::{OpenApi, RefOr, Required, Response};

/// Tags of the routes that send stored results.
const TAGS: [&str; 2] = ["results", "inspections"];
/// Headers that ask for a part.
const HEADERS: [(&str, &str); 2] = [
    ("Range", "One range of bytes, for example `bytes=0-99`."),
    ("If-Range", "Entity tag of the version that the range is for; if the file is another version, the whole of it is sent."),
];

/// Sentence on parts in the description of a JSON document.
const PART_OF_JSON: &str = " With the header `Range`, the response is 206 with that part of the bytes (RFC 9110, section 14), which \
                            is not a JSON document.";

/// Adds the headers and the answer, with the content of the whole: a part of a text or of bytes is one as well. A part of a JSON document
/// follows no schema, and clients that are made from the document would take it for another result: the description of the whole
/// tells of it. 416 is among the problems.
pub(super) fn add(openapi: &mut OpenApi) {
    let operations = openapi.paths.paths.values_mut().filter_map(|item| item.get.as_mut());
    for operation in operations.filter(|operation| sends_result(operation)) {
        if let Some(RefOr::T(whole)) = operation.responses.responses.get_mut("200").filter(|whole| is_json(whole)) {
            whole.description += PART_OF_JSON;
            continue;
        }
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
        let Some(RefOr::T(whole)) = operation.responses.responses.get("200") else { continue };
        let mut part = whole.clone();
        "The requested part of the result.".clone_into(&mut part.description);
        operation.responses.responses.insert("206".to_owned(), part.into());
    }
}

/// Returns true for a response with a JSON document.
fn is_json(whole: &RefOr<Response>) -> bool {
    matches!(whole, RefOr::T(whole) if whole.content.keys().any(|media| media.ends_with("json")))
}

/// Returns true for a route of a stored result: it has a tag and may be known to the client, and does not list parts itself.
fn sends_result(operation: &Operation) -> bool {
    let has = |status: &str| operation.responses.responses.contains_key(status);
    let is_tagged = operation.tags.iter().flatten().any(|tag| TAGS.contains(&tag.as_str()));
    is_tagged && has("304") && !has("206")
}
