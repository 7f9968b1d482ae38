//! Lookup of what a cell's specification names: the presets that ship with the program, or a store that adds its
//! own to them.

use std::fmt;
use std::sync::Arc;

use serde::de::{self, DeserializeOwned, MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use super::layout::CellSpec;
use super::robot::RobotSpec;
use super::scanner::ScannerSpec;
use super::turntable::TurntableSpec;
use crate::geometry::Mesh;

/// A specification by name, or written out in place.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[serde(untagged)]
pub enum Named<T> {
    /// Name of a preset or of a stored specification.
    Name(String),
    /// The specification itself.
    Inline(Box<T>),
}

impl<T> Named<T> {
    /// Puts the specification in the place of its name, if `find` knows it.
    pub fn inline(&mut self, find: impl FnOnce(&str) -> Option<T>) {
        if let Self::Name(name) = self
            && let Some(spec) = find(name)
        {
            *self = Self::Inline(Box::new(spec));
        }
    }
}

impl CellSpec {
    /// Puts the specifications of scanner, robot and turntable in the place of their names, where the library knows them.
    pub fn inline_devices(&mut self, library: &dyn SpecLibrary) {
        self.scanner.inline(|name| library.scanner(name).ok());
        self.robot.inline(|name| library.robot(name).ok());
        self.turntable.inline(|name| library.turntable(name).ok());
    }
}

/// Hand-written, so that an error inside an inline specification keeps its own words.
impl<'de, T: Deserialize<'de>> Deserialize<'de> for Named<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameOrMap<T>(std::marker::PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for NameOrMap<T> {
            type Value = Named<T>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a name or a specification")
            }
            fn visit_str<E: de::Error>(self, name: &str) -> Result<Self::Value, E> {
                Ok(Named::Name(name.to_owned()))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map)).map(|spec| Named::Inline(Box::new(spec)))
            }
        }
        deserializer.deserialize_any(NameOrMap(std::marker::PhantomData))
    }
}

/// Kind of a specification in a library.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpecKind {
    /// Scanners.
    Scanner,
    /// Robots.
    Robot,
    /// Turntables.
    Turntable,
    /// Cells.
    Cell,
    /// Meshes of obstacles and bodies.
    Mesh,
}

impl SpecKind {
    /// Singular name.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Scanner => "scanner",
            Self::Robot => "robot",
            Self::Turntable => "turntable",
            Self::Cell => "cell",
            Self::Mesh => "mesh",
        }
    }
}

/// Reason why a library does not give what a name stands for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotFound {
    /// No entry has this name.
    #[error("is unknown")]
    Unknown,
    /// The entry of this name cannot be used, and why.
    #[error("cannot be used: {0}")]
    Unusable(String),
}

/// Finds specifications by name. An implementation that holds its own is expected to fall back on [`Presets`].
///
/// Every lookup's error is [`NotFound`].
#[expect(clippy::missing_errors_doc, reason = "said once, for all")]
pub trait SpecLibrary {
    /// The scanner of this name.
    fn scanner(&self, name: &str) -> Result<ScannerSpec, NotFound>;
    /// The robot of this name.
    fn robot(&self, name: &str) -> Result<RobotSpec, NotFound>;
    /// The turntable of this name.
    fn turntable(&self, name: &str) -> Result<TurntableSpec, NotFound>;
    /// The cell of this name.
    fn cell(&self, name: &str) -> Result<CellSpec, NotFound>;
    /// The mesh of this id or file, millimetres. A cell that is built asks once for each name.
    fn mesh(&self, name: &str) -> Result<Arc<Mesh>, NotFound>;
    /// Every name of a kind, for messages and lists.
    fn names(&self, kind: SpecKind) -> Vec<String>;
}

/// Specifications that ship with the program, from `config/`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Presets;

macro_rules! presets {
    ($folder:literal: $($name:literal),+) => {
        &[$(($name, include_str!(concat!("../../config/", $folder, "/", $name, ".toml")))),+]
    };
}

const SCANNERS: &[(&str, &str)] = presets!("scanners": "transcan-c", "transcan-c-nominal");
const ROBOTS: &[(&str, &str)] = presets!(
    "robots": "hans-e05", "hans-e05-thesis", "hans-elfin10", "abb-irb1600-6-12", "abb-irb1600-8-145", "abb-irb2400-10",
    "abb-irb2600-12-165", "fanuc-m20ia", "kuka-kr6-r700", "kuka-kr6-r900-2", "kuka-kr10-r1420", "staubli-tx2-60",
    "staubli-tx2-60l", "staubli-tx2-160l", "ur3e", "ur5e", "ur10e"
);
const TURNTABLES: &[(&str, &str)] = presets!("turntables": "minas-a6-500");
const CELLS: &[(&str, &str)] = presets!("cells": "e05-transcan");

/// The preset as it is written, with its comments.
#[must_use]
pub fn preset_text(kind: SpecKind, name: &str) -> Option<&'static str> {
    table(kind).iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

fn table(kind: SpecKind) -> &'static [(&'static str, &'static str)] {
    match kind {
        SpecKind::Scanner => SCANNERS,
        SpecKind::Robot => ROBOTS,
        SpecKind::Turntable => TURNTABLES,
        SpecKind::Cell => CELLS,
        SpecKind::Mesh => &[],
    }
}

/// A test holds that every preset parses.
fn parse<T: DeserializeOwned>(kind: SpecKind, name: &str) -> Result<T, NotFound> {
    let text = preset_text(kind, name).ok_or(NotFound::Unknown)?;
    // By way of JSON, as every specification is read: a type is compiled for one source of its fields.
    let value: serde_json::Value = toml::from_str(text).map_err(|error| NotFound::Unusable(error.to_string()))?;
    T::deserialize(&value).map_err(|error| NotFound::Unusable(error.to_string()))
}

impl SpecLibrary for Presets {
    fn scanner(&self, name: &str) -> Result<ScannerSpec, NotFound> {
        parse(SpecKind::Scanner, name)
    }

    fn robot(&self, name: &str) -> Result<RobotSpec, NotFound> {
        parse(SpecKind::Robot, name)
    }

    fn turntable(&self, name: &str) -> Result<TurntableSpec, NotFound> {
        parse(SpecKind::Turntable, name)
    }

    fn cell(&self, name: &str) -> Result<CellSpec, NotFound> {
        parse(SpecKind::Cell, name)
    }

    fn mesh(&self, _: &str) -> Result<Arc<Mesh>, NotFound> {
        Err(NotFound::Unknown)
    }

    fn names(&self, kind: SpecKind) -> Vec<String> {
        table(kind).iter().map(|(name, _)| (*name).to_owned()).collect()
    }
}
