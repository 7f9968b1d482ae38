//! Names for the variants of tagged enums: a generator of clients makes a type of each schema that has a name, and gives up on an
//! enum whose variants have none. Tagged enums refuse unknown fields, which the derived schemas of their variants leave out.

use std::collections::BTreeMap;
use std::mem;

use utoipa::openapi::schema::{AdditionalProperties, Object, Schema};
use utoipa::openapi::{Ref, RefOr};

/// Prefix of the schemas of specifications that are given by name or as a whole.
const NAMED: &str = "Named_";

/// Moves the variants of tagged enums to schemas of their own, named after enum and tag, which allow no other fields. A specification
/// inside one that may be given by name too becomes a reference.
pub(super) fn name_variants(schemas: &mut BTreeMap<String, RefOr<Schema>>) {
    let mut variants = BTreeMap::new();
    for (name, schema) in schemas.iter_mut() {
        let RefOr::T(Schema::OneOf(one_of)) = schema else { continue };
        for variant in &mut one_of.items {
            match (name.strip_prefix(NAMED), tag(variant)) {
                (Some(spec), _) if object(variant).is_some_and(|object| !object.properties.is_empty()) => {
                    *variant = Ref::from_schema_name(spec).into();
                }
                (None, Some(tag)) => {
                    let of_variant = format!("{name}{}", in_pascal_case(&tag));
                    let reference = Ref::from_schema_name(&of_variant).into();
                    variants.insert(of_variant, closed(mem::replace(variant, reference)));
                }
                _ => {}
            }
        }
    }
    schemas.append(&mut variants);
}

/// The variant without additional properties; one that is put together of several schemas cannot say so.
fn closed(mut variant: RefOr<Schema>) -> RefOr<Schema> {
    if let RefOr::T(Schema::Object(object)) = &mut variant {
        object.additional_properties = Some(Box::new(AdditionalProperties::FreeForm(false)));
    }
    variant
}

/// The value of the property that tells a variant from the others: the one that a string must have.
fn tag(variant: &RefOr<Schema>) -> Option<String> {
    if let RefOr::T(Schema::AllOf(all_of)) = variant {
        return all_of.items.iter().find_map(tag);
    }
    object(object_property(variant)?)?.enum_values.as_ref()?.first()?.as_str().map(str::to_owned)
}

/// The first required property of an object that has one value.
fn object_property(variant: &RefOr<Schema>) -> Option<&RefOr<Schema>> {
    let variant = object(variant)?;
    let has_one_value = |property: &&RefOr<Schema>| {
        object(property).is_some_and(|p| p.enum_values.as_ref().is_some_and(|values| values.len() == 1))
    };
    variant.required.iter().filter_map(|name| variant.properties.get(name)).find(has_one_value)
}

fn object(schema: &RefOr<Schema>) -> Option<&Object> {
    match schema {
        RefOr::T(Schema::Object(object)) => Some(object),
        RefOr::Ref(_) | RefOr::T(_) => None,
    }
}

/// `half_space` as `HalfSpace`.
fn in_pascal_case(name: &str) -> String {
    let capital =
        |word: &str| word.chars().next().map_or_else(String::new, |first| first.to_uppercase().to_string() + &word[1..]);
    name.split('_').map(capital).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};
    use utoipa::PartialSchema as _;

    use super::*;
    use crate::cell::{KinematicsSpec, ShapeSpec};

    #[test]
    fn variants_have_names_and_allow_no_other_fields() {
        let mut schemas = BTreeMap::from([
            ("ShapeSpec".to_owned(), ShapeSpec::schema()),
            ("KinematicsSpec".to_owned(), KinematicsSpec::schema()),
        ]);
        name_variants(&mut schemas);
        let shown = |name: &str| serde_json::to_value(&schemas[name]).expect("JSON");
        assert_eq!(shown("ShapeSpec")["oneOf"][0]["$ref"], "#/components/schemas/ShapeSpecBox");
        for shape in ["ShapeSpecBox", "ShapeSpecCylinder", "ShapeSpecCapsule", "ShapeSpecMesh"] {
            assert_eq!(shown(shape)["additionalProperties"], json!(false), "{shape}");
        }
        // The dimensions of an arm and its tag are two schemas.
        assert_eq!(shown("KinematicsSpecUr")["additionalProperties"], Value::Null);
        assert_eq!(shown("KinematicsSpecUr")["allOf"].as_array().map(Vec::len), Some(2));
    }
}
