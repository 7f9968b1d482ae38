//! Hardware specifications: stored ones and the presets that ship with the program.

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::app::App;
use super::error::Error;
use super::library::Library;
use super::presets::PRESETS;
use super::store::{Precondition, PutResult, StoredSpec};
use crate::cell::{CellSpec, FieldError, RobotSpec, ScannerSpec, SpecLibrary, TurntableSpec, preset_text};
use crate::wire::hex;
use crate::wire::{SpecCollection, SpecList, SpecListItem, is_spec_name};

/// A specification as clients receive it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpecEntry {
    /// JSON of the specification.
    pub body: String,
    /// Strong entity tag of the specification, quotes included.
    pub etag: String,
    /// True if it was just created.
    pub created: bool,
}

/// A kind of specification: its collection and its check.
pub(crate) trait Spec: Serialize + Send + 'static {
    /// Collection that it belongs to.
    const COLLECTION: SpecCollection;
    /// Name in the specification.
    fn name(&self) -> &str;
    /// Checks every field; names are looked up in `library`.
    fn check(&self, library: &dyn SpecLibrary) -> Result<(), Vec<FieldError>>;
}

impl Spec for ScannerSpec {
    const COLLECTION: SpecCollection = SpecCollection::Scanner;
    fn name(&self) -> &str {
        &self.name
    }
    fn check(&self, _: &dyn SpecLibrary) -> Result<(), Vec<FieldError>> {
        self.build().map(drop)
    }
}

impl Spec for RobotSpec {
    const COLLECTION: SpecCollection = SpecCollection::Robot;
    fn name(&self) -> &str {
        &self.name
    }
    fn check(&self, _: &dyn SpecLibrary) -> Result<(), Vec<FieldError>> {
        self.build().map(drop)
    }
}

impl Spec for TurntableSpec {
    const COLLECTION: SpecCollection = SpecCollection::Turntable;
    fn name(&self) -> &str {
        &self.name
    }
    fn check(&self, _: &dyn SpecLibrary) -> Result<(), Vec<FieldError>> {
        self.build().map(drop)
    }
}

impl Spec for CellSpec {
    const COLLECTION: SpecCollection = SpecCollection::Cell;
    fn name(&self) -> &str {
        &self.name
    }
    fn check(&self, library: &dyn SpecLibrary) -> Result<(), Vec<FieldError>> {
        self.build(library).map(drop)
    }
}

impl App {
    /// All specifications of a collection.
    ///
    /// # Errors
    /// [`Error::Internal`].
    pub async fn specs(&self, collection: SpecCollection) -> Result<SpecList, Error> {
        let stored = self.0.store.specs(collection).await?;
        let mut items: Vec<_> = stored.into_iter().map(|(name, etag)| SpecListItem { name, preset: false, etag }).collect();
        for name in PRESETS.names(collection.kind()) {
            let etag = preset(collection, &name)?.map(|entry| entry.etag).unwrap_or_default();
            items.push(SpecListItem { name, preset: true, etag });
        }
        items.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(SpecList { items })
    }

    /// One specification.
    ///
    /// # Errors
    /// [`Error::SpecNotFound`], [`Error::Internal`].
    pub async fn spec(&self, collection: SpecCollection, name: &str) -> Result<SpecEntry, Error> {
        if let Some(entry) = preset(collection, name)? {
            return Ok(entry);
        }
        let stored = self.0.store.spec(collection, name).await?;
        let StoredSpec { body, etag, .. } = stored.ok_or_else(|| not_found(collection, name))?;
        Ok(SpecEntry { body, etag, created: false })
    }

    /// Stores a specification under its own name, which must be `name`.
    ///
    /// # Errors
    /// [`Error::Invalid`], [`Error::SpecIsPreset`], [`Error::PreconditionRequired`], [`Error::PreconditionFailed`],
    /// [`Error::Internal`].
    pub(crate) async fn put_spec<T: Spec>(&self, name: &str, spec: T, only_if: Precondition) -> Result<SpecEntry, Error> {
        let collection = T::COLLECTION;
        refuse_preset(collection, name)?;
        check_name(collection, name, spec.name())?;
        self.check_space(0)?;
        let body = self.with_library(None, move |library| check(&spec, library)).await?;
        let (app, name) = (self.clone(), name.to_owned());
        self.run_to_completion(async move {
            let PutResult { created, etag } = app.0.store.put_spec(collection, &name, &body, &only_if).await?;
            Ok(SpecEntry { body, etag, created })
        })
        .await
    }

    /// Deletes a stored specification.
    ///
    /// # Errors
    /// [`Error::SpecNotFound`], [`Error::SpecIsPreset`], [`Error::PreconditionFailed`], [`Error::Internal`].
    pub async fn delete_spec(&self, collection: SpecCollection, name: &str, only_if: Precondition) -> Result<(), Error> {
        refuse_preset(collection, name)?;
        let (app, name) = (self.clone(), name.to_owned());
        self.run_to_completion(async move { app.freeing(|| app.0.store.delete_spec(collection, &name, &only_if)).await }).await
    }
}

/// Checks a specification and returns its JSON.
fn check<T: Spec>(spec: &T, library: &Library) -> Result<String, Error> {
    spec.check(library).map_err(Error::Invalid)?;
    Ok(serde_json::to_string(spec)?)
}

/// A preset, if there is one of this name.
fn preset(collection: SpecCollection, name: &str) -> Result<Option<SpecEntry>, Error> {
    let body = match collection {
        SpecCollection::Scanner => PRESETS.scanner(name).ok().map(|spec| serde_json::to_string(&spec)),
        SpecCollection::Robot => PRESETS.robot(name).ok().map(|spec| serde_json::to_string(&spec)),
        SpecCollection::Turntable => PRESETS.turntable(name).ok().map(|spec| serde_json::to_string(&spec)),
        SpecCollection::Cell => PRESETS.cell(name).ok().map(|spec| serde_json::to_string(&spec)),
    };
    let Some(body) = body.transpose()? else { return Ok(None) };
    let etag = format!("\"preset-{}\"", &hex(&Sha256::digest(&body))[..16]);
    Ok(Some(SpecEntry { body, etag, created: false }))
}

fn refuse_preset(collection: SpecCollection, name: &str) -> Result<(), Error> {
    match preset_text(collection.kind(), name) {
        Some(_) => Err(Error::SpecIsPreset { kind: collection, name: name.to_owned() }),
        None => Ok(()),
    }
}

fn check_name(collection: SpecCollection, name: &str, own: &str) -> Result<(), Error> {
    let finding = |detail: String| Err(Error::Invalid(vec![FieldError { pointer: "/name".to_owned(), detail }]));
    if !is_spec_name(name) {
        return finding(format!(
            "{name:?} is not a name: 1 to 64 of a-z, 0-9, '.', '_' and '-', beginning with a letter or digit"
        ));
    }
    if collection == SpecCollection::Cell && name == "none" {
        return finding("\"none\" is reserved and means no cell".to_owned());
    }
    if own != name {
        return finding(format!("is {own:?}; the path says {name:?}"));
    }
    Ok(())
}

fn not_found(collection: SpecCollection, name: &str) -> Error {
    Error::SpecNotFound { kind: collection, name: name.to_owned() }
}
