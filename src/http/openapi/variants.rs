//! Names for the variants of tagged enums: a generator of clients makes a type of each schema that has a name, and gives up on an
//! enum whose variants have none.

use std::collections::BTreeMap;
use std::mem;

use utoipa::openapi::schema::{Object, Schema};
use utoipa::openapi::{Ref, RefOr};

/// Prefix of the schemas of specifications that are given by name or as a whole.
const NAMED: &str = "Named_";

/// Moves the variants of tagged enums to schemas of their own, named after enum and tag. A specification inside one that may be
/// given by name too becomes a reference.
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
                    variants.insert(of_variant, mem::replace(variant, reference));
                }
                _ => {}
            }
        }
    }
    schemas.append(&mut variants);
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
