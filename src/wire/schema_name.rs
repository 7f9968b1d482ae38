//! Names of the schemas of documents, as the API document lists them.

use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};

/// Declares the type of a field that always holds the name of its document's schema: in the API document an enum of one value.
macro_rules! schema_name {
    ($kind:ident, $name:expr) => {
        struct $kind;

        impl utoipa::PartialSchema for $kind {
            fn schema() -> utoipa::openapi::RefOr<utoipa::openapi::Schema> {
                crate::wire::schema_name::only($name)
            }
        }

        impl utoipa::ToSchema for $kind {}
    };
}

pub(super) use schema_name;

/// Schema of a text that is always `name`.
pub(super) fn only(name: &str) -> RefOr<Schema> {
    ObjectBuilder::new()
        .schema_type(Type::String)
        .description(Some("Name and version of the schema of a document."))
        .enum_values(Some([name]))
        .into()
}
