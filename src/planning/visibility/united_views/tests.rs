use std::sync::atomic::AtomicBool;

use super::*;
use crate::geometry::Mesh;
use crate::planning::candidates::{looking_along, spiral};
use crate::planning::context::Silent;
use crate::planning::params::{InterestParams, Region};
use crate::planning::setups::registration::union_of;
use crate::planning::surface::requirements;
use crate::planning::verdict::Grade;
use crate::planning::visibility::cast;
use crate::testing::{nominal_scanner, trough};

/// Views of the trough from all around, at best focus of its middle.
fn views(count: usize, best_mm: f64) -> Vec<Pose<Part, ScannerFrame>> {
    spiral(count, -1.0).map(|out| Pose::from_parts(out * best_mm, looking_along(&-out, 0.0))).collect()
}

fn params(engine: Engine, mesh: &Mesh) -> PlanParams {
    let mut params = PlanParams::default();
    (params.visibility.engine, params.part.patch_edge_mm) = (engine, Some(12.0));
    params.part.samples_per_mm2 = Some(3_000.0 / mesh.area_mm2());
    params
}

#[test]
fn views_measure_together_what_they_measure_one_by_one() {
    let (mesh, scanner, cancel) = (trough(), nominal_scanner(), AtomicBool::new(false));
    let (ctx, occluders) = (Context::new(&cancel, &Silent), Occluders::new([&mesh]));
    let poses = views(14, scanner.best_mm);
    let region = Region::HalfSpace { point_mm: [0.0; 3], normal: [1.0, 0.0, 0.0] };
    let (name, target, camera_deg, projector_deg, min_grade) = (None, None, None, None, Some(Grade::B));
    let well = InterestParams { name, region, weight: 1.0, target, camera_deg, projector_deg, min_grade };
    for (engine, interest) in [(Engine::Raster, vec![]), (Engine::Raster, vec![well]), (Engine::Rays, vec![])] {
        let mut params = params(engine, &mesh);
        params.regions.interest = interest;
        let surface = requirements::sampled(&mesh, &params, 1, &ctx).unwrap_or_else(|error| panic!("{error}"));
        let optics = Optics::new(&scanner, &params, &surface.requirements);
        let together = UnitedViews::new(&surface, &optics, &occluders, &params, &ctx);
        let usable = vec![true; poses.len()];
        let rows = cast(&surface, &poses, &usable, &scanner, &occluders, &params, &ctx).expect("not cancelled").rows;
        let expected = union_of(&rows, surface.sample_mm.len());
        assert!(expected.count() > 1_000 && expected.count() < surface.sample_mm.len(), "{}", expected.count());
        assert_eq!(together.measured(&poses).expect("not cancelled"), expected, "{engine:?}");
        // What is known is left out, and the rest of the row is as it was.
        let row = together.row(&poses[3], rows[2].measured()).expect("not cancelled");
        assert_eq!(*row.measured(), *rows[3].without(rows[2].measured()).measured());
        assert_eq!(*together.row(&poses[3], &together.nothing()).expect("not cancelled").measured(), *rows[3].measured());
    }
}
