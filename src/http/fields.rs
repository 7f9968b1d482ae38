//! Parts of answers: the query parameter `fields` names the fields that a client wants.

use std::collections::BTreeSet;

use axum::response::{IntoResponse, Response};
use serde::Serialize;
use serde_json::Value;
use utoipa::PartialSchema;
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::Schema;

use super::extract::{Json, Params};
use super::problem::ApiError;

/// The field that every answer has.
const ALWAYS: &str = "id";

/// Fields that a client wants; all, if it named none.
pub(super) struct Fields(Option<BTreeSet<String>>);

impl Fields {
    /// Takes `fields`, names of fields of `T` with commas between them.
    ///
    /// # Errors
    /// `bad_query` for a name that is not a field of `T`.
    pub(super) fn take<T: PartialSchema>(params: &mut Params) -> Result<Self, ApiError> {
        let Some(text) = params.text("fields") else { return Ok(Self(None)) };
        let known = names::<T>();
        let named: BTreeSet<String> = text.split(',').chain([ALWAYS]).map(str::to_owned).collect();
        match named.iter().find(|name| !known.contains(name)) {
            Some(unknown) => {
                let said = format!("names the field {unknown:?}, which does not exist; known are {}", known.join(", "));
                Err(ApiError::query("fields", &said))
            }
            None => Ok(Self(Some(named))),
        }
    }

    /// The answer with the wanted fields of one object.
    pub(super) fn of(&self, object: &impl Serialize) -> Result<Response, serde_json::Error> {
        self.of_each(object, |whole| vec![whole])
    }

    /// The answer with the wanted fields of each entry of a page.
    pub(super) fn of_items(&self, page: &impl Serialize) -> Result<Response, serde_json::Error> {
        self.of_each(page, |page| page.get_mut("items").and_then(Value::as_array_mut).into_iter().flatten().collect())
    }

    fn of_each(
        &self,
        answer: &impl Serialize,
        objects: impl FnOnce(&mut Value) -> Vec<&mut Value>,
    ) -> Result<Response, serde_json::Error> {
        let Some(wanted) = &self.0 else { return Ok(Json(answer).into_response()) };
        let mut answer = serde_json::to_value(answer)?;
        for object in objects(&mut answer).into_iter().filter_map(Value::as_object_mut) {
            object.retain(|name, _| wanted.contains(name));
        }
        Ok(Json(answer).into_response())
    }
}

/// Names of the fields of an object.
pub(super) fn names<T: PartialSchema>() -> Vec<String> {
    match T::schema() {
        RefOr::T(Schema::Object(object)) => object.properties.keys().cloned().collect(),
        RefOr::Ref(_) | RefOr::T(_) => Vec::new(),
    }
}
