//! The presets, parsed once for all requests.

use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

use crate::cell::{CellSpec, NotFound, Presets, RobotSpec, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec};
use crate::geometry::Mesh;

/// The presets that ship with the program.
pub(super) static PRESETS: LazyLock<ParsedPresets> = LazyLock::new(ParsedPresets::parse);

/// Presets by name.
pub(super) struct ParsedPresets {
    scanners: BTreeMap<String, ScannerSpec>,
    robots: BTreeMap<String, RobotSpec>,
    turntables: BTreeMap<String, TurntableSpec>,
    cells: BTreeMap<String, CellSpec>,
}

impl ParsedPresets {
    fn parse() -> Self {
        Self {
            scanners: all(SpecKind::Scanner, |name| Presets.scanner(name)),
            robots: all(SpecKind::Robot, |name| Presets.robot(name)),
            turntables: all(SpecKind::Turntable, |name| Presets.turntable(name)),
            cells: all(SpecKind::Cell, |name| Presets.cell(name)),
        }
    }
}

/// All presets of a kind; a test of them holds that each parses.
fn all<T>(kind: SpecKind, parse: impl Fn(&str) -> Result<T, NotFound>) -> BTreeMap<String, T> {
    Presets.names(kind).into_iter().filter_map(|name| parse(&name).ok().map(|spec| (name, spec))).collect()
}

fn find<T: Clone>(specs: &BTreeMap<String, T>, name: &str) -> Result<T, NotFound> {
    specs.get(name).cloned().ok_or(NotFound::Unknown)
}

impl SpecLibrary for ParsedPresets {
    fn scanner(&self, name: &str) -> Result<ScannerSpec, NotFound> {
        find(&self.scanners, name)
    }

    fn robot(&self, name: &str) -> Result<RobotSpec, NotFound> {
        find(&self.robots, name)
    }

    fn turntable(&self, name: &str) -> Result<TurntableSpec, NotFound> {
        find(&self.turntables, name)
    }

    fn cell(&self, name: &str) -> Result<CellSpec, NotFound> {
        find(&self.cells, name)
    }

    fn mesh(&self, name: &str) -> Result<Arc<Mesh>, NotFound> {
        Presets.mesh(name)
    }

    fn names(&self, kind: SpecKind) -> Vec<String> {
        Presets.names(kind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_there_as_it_is_written() {
        for name in Presets.names(SpecKind::Scanner) {
            assert_eq!(PRESETS.scanner(&name), Presets.scanner(&name), "{name}");
        }
        for name in Presets.names(SpecKind::Robot) {
            assert_eq!(PRESETS.robot(&name), Presets.robot(&name), "{name}");
        }
        for name in Presets.names(SpecKind::Turntable) {
            assert_eq!(PRESETS.turntable(&name), Presets.turntable(&name), "{name}");
        }
        for name in Presets.names(SpecKind::Cell) {
            assert_eq!(PRESETS.cell(&name), Presets.cell(&name), "{name}");
        }
        assert_eq!(PRESETS.robot("nobody"), Err(NotFound::Unknown));
    }
}
