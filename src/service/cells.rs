//! Cells that were built lately, with what was found out about each once: many jobs name the same cell, and building it tests its
//! home for collisions. The key is what a cell is made of, so a change of any device is another cell.

use std::collections::BTreeMap;
use std::sync::Arc;

use sha2::{Digest, Sha256};

use super::kept::Kept;
use super::planner::MeshSource;
use crate::cell::{Cell, CellSpec, FieldError, Named, ShapeSpec, SpecLibrary};
use crate::planning::sequence::Roadmaps;
use crate::wire::hex;
use crate::wire::warnings::{self, FieldWarning};

/// Cells that are kept at most.
const MAX_KEPT: usize = 16;
/// Triangles of a cell's bodies beyond which it is not kept.
const MAX_KEPT_TRIANGLES: usize = 500_000;

/// A cell that was built.
#[derive(Debug)]
pub struct BuiltCell {
    /// The cell.
    pub cell: Cell,
    /// Warnings on it; pointers begin with `/cell`.
    pub warnings: Vec<FieldWarning>,
}

/// Cells built lately, and what planning keeps of them.
#[derive(Debug)]
pub struct KeptCells {
    built: Kept<Arc<BuiltCell>>,
    /// Roadmaps and collision scenes.
    pub(super) roadmaps: Roadmaps,
}

impl Default for KeptCells {
    fn default() -> Self {
        Self { built: Kept::new(MAX_KEPT), roadmaps: Roadmaps::default() }
    }
}

impl KeptCells {
    /// The cell of a specification with its devices inlined, built unless it is kept. `meshes` are the files of its bodies' meshes by
    /// name, which `library` reads.
    ///
    /// # Errors
    /// Errors of [`CellSpec::build`].
    pub fn built(
        &self,
        spec: &CellSpec,
        meshes: &BTreeMap<String, MeshSource>,
        library: &dyn SpecLibrary,
    ) -> Result<Arc<BuiltCell>, Vec<FieldError>> {
        let key = key(spec, meshes);
        if let Some(built) = key.as_ref().and_then(|key| self.built.get(key)) {
            return Ok(built);
        }
        // Not under a lock: others need not wait, and two who build the same one build it equal.
        let cell = spec.build(library)?;
        let warnings = warnings::of_cell(&cell, "/cell");
        let is_small = cell.surfaces().iter().map(|mesh| mesh.faces.len()).sum::<usize>() <= MAX_KEPT_TRIANGLES;
        let built = Arc::new(BuiltCell { cell, warnings });
        if let Some(key) = key.filter(|_| is_small) {
            self.built.put(key, Arc::clone(&built));
        }
        Ok(built)
    }
}

/// SHA-256 of all that a cell is made of; `None` if it names anything that could change.
fn key(spec: &CellSpec, meshes: &BTreeMap<String, MeshSource>) -> Option<String> {
    let is_inlined =
        matches!((&spec.scanner, &spec.robot, &spec.turntable), (Named::Inline(_), Named::Inline(_), Named::Inline(_)));
    let mut hashed = Sha256::new();
    hashed.update(serde_json::to_vec(spec).ok().filter(|_| is_inlined)?);
    for name in mesh_names(spec) {
        let MeshSource { sha256, unit, .. } = meshes.get(name)?;
        hashed.update(format!("\n{name:?} {sha256} {unit}"));
    }
    Some(hex(&hashed.finalize()))
}

/// Names of the meshes of a cell's bodies.
pub(super) fn mesh_names(spec: &CellSpec) -> impl Iterator<Item = &String> {
    shapes(spec).filter_map(mesh_of)
}

/// Shapes of a cell with inlined devices.
fn shapes(cell: &CellSpec) -> impl Iterator<Item = &ShapeSpec> {
    let scanner = match &cell.scanner {
        Named::Inline(scanner) => &scanner.body[..],
        Named::Name(_) => &[],
    };
    let turntable = match &cell.turntable {
        Named::Inline(turntable) => &turntable.body[..],
        Named::Name(_) => &[],
    };
    let surfaces = match &cell.robot {
        Named::Inline(robot) => &robot.surfaces[..],
        Named::Name(_) => &[],
    };
    let rigid = scanner.iter().chain(&cell.mount).chain(&cell.obstacles).chain(turntable);
    rigid.map(|body| &body.shape).chain(surfaces.iter().chain(&cell.cable).map(|body| &body.shape))
}

/// Name of the mesh that a shape is, if it is one.
pub(super) fn mesh_of(shape: &ShapeSpec) -> Option<&String> {
    if let ShapeSpec::Mesh { mesh } = shape { Some(mesh) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{BodySpec, NotFound, PoseSpec, Presets, RobotSpec, ScannerSpec, SpecKind, TurntableSpec};
    use crate::geometry::{LengthUnit, Mesh};
    use crate::testing::box_mesh;

    /// The presets, and one mesh for every name.
    struct OneMesh;

    impl SpecLibrary for OneMesh {
        fn scanner(&self, name: &str) -> Result<ScannerSpec, NotFound> {
            Presets.scanner(name)
        }
        fn robot(&self, name: &str) -> Result<RobotSpec, NotFound> {
            Presets.robot(name)
        }
        fn turntable(&self, name: &str) -> Result<TurntableSpec, NotFound> {
            Presets.turntable(name)
        }
        fn cell(&self, name: &str) -> Result<CellSpec, NotFound> {
            Presets.cell(name)
        }
        fn mesh(&self, _: &str) -> Result<Arc<Mesh>, NotFound> {
            Ok(Arc::new(box_mesh([0.0; 3], [10.0; 3])))
        }
        fn names(&self, kind: SpecKind) -> Vec<String> {
            Presets.names(kind)
        }
    }

    fn inlined() -> CellSpec {
        let mut cell = Presets.cell("e05-transcan").expect("a preset");
        cell.scanner = Named::Inline(Box::new(Presets.scanner("transcan-c").expect("a preset")));
        cell.robot = Named::Inline(Box::new(Presets.robot("hans-e05").expect("a preset")));
        cell.turntable = Named::Inline(Box::new(Presets.turntable("minas-a6-500").expect("a preset")));
        cell
    }

    fn source(sha256: &str) -> MeshSource {
        MeshSource { path: "nowhere".into(), sha256: sha256.into(), unit: LengthUnit::Millimetre }
    }

    #[test]
    fn a_cell_is_built_once_and_another_where_anything_differs() {
        let (kept, spec, none) = (KeptCells::default(), inlined(), BTreeMap::new());
        let first = kept.built(&spec, &none, &OneMesh).expect("a cell");
        assert!(Arc::ptr_eq(&first, &kept.built(&spec, &none, &OneMesh).expect("the same")));
        assert_eq!(first.warnings, warnings::of_cell(&first.cell, "/cell"));
        let lower = CellSpec { floor_mm: Some(-900.0), ..spec.clone() };
        let other = kept.built(&lower, &none, &OneMesh).expect("another");
        assert_eq!((first.cell.floor_mm, other.cell.floor_mm), (spec.floor_mm, Some(-900.0)));
        // A name may stand for something else tomorrow.
        let named = CellSpec { robot: Named::Name("hans-e05".into()), ..spec };
        let [a, b] = [(); 2].map(|()| kept.built(&named, &none, &OneMesh).expect("a cell"));
        assert!(!Arc::ptr_eq(&a, &b));
    }

    #[test]
    fn a_body_s_mesh_counts_by_its_content() {
        let (kept, mut spec) = (KeptCells::default(), inlined());
        let far = PoseSpec { translation_mm: [3000.0, 0.0, 0.0], quaternion_xyzw: [0.0, 0.0, 0.0, 1.0] };
        let shape = ShapeSpec::Mesh { mesh: "m".into() };
        spec.obstacles.push(BodySpec { name: "post".into(), shape, owner_from_body: far });
        let built =
            |sha256: &str| kept.built(&spec, &BTreeMap::from([("m".to_owned(), source(sha256))]), &OneMesh).expect("a cell");
        assert!(Arc::ptr_eq(&built("aa"), &built("aa")));
        assert!(!Arc::ptr_eq(&built("aa"), &built("bb")));
        // A mesh whose content is not known is not taken for one that is.
        let unknown = kept.built(&spec, &BTreeMap::new(), &OneMesh).expect("a cell");
        assert!(!Arc::ptr_eq(&built("aa"), &unknown));
    }
}
