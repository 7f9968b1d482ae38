use std::sync::atomic::AtomicBool;

use nalgebra::{Point3, Vector3};

use super::{CanExecute, MissAnalysis, explain, spots};
use crate::geometry::Mesh;
use crate::planning::PlanInput;
use crate::planning::context::{Context, Silent};
use crate::planning::ids::CandidateIndex;
use crate::planning::params::{PartParams, PlanParams, RegionParams, Strategy};
use crate::planning::plan::{Cause, Grade, Remedy, RemedyKind, Verdict};
use crate::planning::problem::{EvaluatedSetups, SampledPart};
use crate::planning::surface::{self, Surface};
use crate::testing::{box_mesh, nominal_scanner};

/// A square plate of two triangles, 60 mm wide, in patches of at most 4 mm.
fn plate() -> (Mesh, Surface) {
    let vertices_mm = [[0.0, 0.0], [60.0, 0.0], [0.0, 60.0], [60.0, 60.0]].map(|[x, y]| Point3::new(x, y, 0.0)).into();
    let mesh = Mesh { vertices_mm, faces: vec![[0, 1, 3], [0, 3, 2]], source_face: vec![5, 6], groups: Vec::new() };
    let part = PartParams { patch_edge_mm: Some(4.0), samples_per_mm2: Some(2.0), ..PartParams::default() };
    let surface = surface::sample(&mesh, &part, &RegionParams::default(), 0).expect("a surface");
    (mesh, surface)
}

fn spots_where(missed: impl Fn(&Point3<f64>) -> Option<Cause>) -> Vec<spots::Spot> {
    let (mesh, surface) = plate();
    let verdict = |p: &Point3<f64>| missed(p).map_or(Verdict::Measured(Grade::A), Verdict::Missed);
    let verdicts: Vec<_> = surface.sample_mm.iter().map(verdict).collect();
    spots::find(&mesh, &surface, &verdicts)
}

#[test]
fn two_places_on_one_facet_are_two_spots_and_one_across_facets_is_one() {
    let disc = |p: &Point3<f64>, x: f64, y: f64, radius: f64| (p - Point3::new(x, y, 0.0)).norm() <= radius;
    // The first two lie on the lower facet; the third across the diagonal, over both.
    let found = spots_where(|p| {
        let any = disc(p, 30.0, 8.0, 5.0) || disc(p, 50.0, 12.0, 4.0) || disc(p, 40.0, 40.0, 7.0);
        any.then_some(Cause::ShadowLeft)
    });
    assert_eq!(found.len(), 3);
    let faces: Vec<_> = found.iter().map(|spot| spot.source_faces.as_slice()).collect();
    assert_eq!(faces, [&[5, 6][..], &[5], &[5]]);
    for (spot, (x, y, radius)) in found.iter().zip([(40.0, 40.0, 7.0), (30.0, 8.0, 5.0), (50.0, 12.0, 4.0)]) {
        let disc_mm2 = std::f64::consts::PI * radius * radius;
        assert!((spot.area_mm2 - disc_mm2).abs() < 0.05 * disc_mm2, "{} of {disc_mm2}", spot.area_mm2);
        assert!((spot.centre_mm - Point3::new(x, y, 0.0)).norm() < 0.3, "{:?}", spot.centre_mm);
        // Whole patches: up to their longest edge more on either side.
        let beyond = spot.extent_mm - Vector3::new(2.0 * radius, 2.0 * radius, 0.0);
        assert!(beyond.x >= -0.5 && beyond.y >= -0.5 && beyond.max() <= 8.0 && spot.extent_mm.z == 0.0, "{:?}", spot.extent_mm);
    }
}

#[test]
fn causes_are_apart_in_their_order() {
    let found = spots_where(|p| Some(if p.x < 20.0 { Cause::NotChosen } else { Cause::Facing }));
    let causes: Vec<_> = found.iter().map(|spot| spot.cause).collect();
    assert_eq!(causes, [Cause::Facing, Cause::NotChosen]);
    let area_mm2: f64 = found.iter().map(|spot| spot.area_mm2).sum();
    assert!((area_mm2 - 3600.0).abs() < 1e-6);
}

/// Parameters with candidates all around a part, on few samples.
fn all_around() -> PlanParams {
    let mut params = PlanParams::default();
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.2), Some(1000.0));
    (params.candidates.strategies, params.candidates.even_directions) = (vec![Strategy::Even], Some(60));
    params
}

/// The remedy of the top of a block, which is missed for a cause, in a cell that can execute some of the views, and has a path to some
/// of the candidates.
fn remedy_of_top(params: &PlanParams, cause: Cause, (can_execute, has_path_to): (&CanExecute<'_>, &CanExecute<'_>)) -> Remedy {
    let (mesh, scanner, cancel) = (box_mesh([-30.0; 3], [30.0; 3]), nominal_scanner(), AtomicBool::new(false));
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let ctx = Context::new(&cancel, &Silent);
    let sampled = SampledPart::new(&input, crate::planning::resolve(params, &input), None, &ctx).expect("samples");
    let setups = sampled.setups(&input, &ctx).expect("a setup");
    let EvaluatedSetups { on, evaluated, .. } = sampled.evaluate(&input, &setups, &ctx).expect("candidates");
    let part_alone = sampled.part_alone(&input, &setups, &ctx).expect("not cancelled");
    let poses: Vec<_> = setups.iter().map(|setup| setup.table_from_part).collect();
    let has_path = |candidate: CandidateIndex| has_path_to(&evaluated.candidates[candidate].part_from_scanner);
    let analysis = MissAnalysis {
        input: &input,
        sampled: &sampled,
        mesh: &mesh,
        surface: &on.surface,
        scanner: &scanner,
        params: &sampled.params,
        setups: &poses,
        first: poses[0],
        occluders: sampled.occluders(&setups),
        part_alone: &part_alone,
        candidates: &evaluated.candidates,
        rows: &evaluated.matrix.rows,
        choosable: vec![true; evaluated.candidates.remaining.len()],
        can_execute: Some(can_execute),
        has_path: &has_path,
    };
    let verdict = |sample| {
        let is_top = on.surface.patch_of(sample).normal.z > 0.9;
        if is_top { Verdict::Missed(cause) } else { Verdict::Measured(Grade::A) }
    };
    let verdicts: Vec<Verdict> = on.surface.samples().map(verdict).collect();
    let missed = explain(&analysis, &verdicts, &ctx).expect("not cancelled");
    missed[0].spots[0].remedy.clone().expect("one was looked for")
}

/// Such a view was told as the remedy, though no path leads to it.
#[test]
fn a_view_that_was_left_out_is_no_remedy_where_the_cell_cannot_execute_it() {
    let params = all_around();
    // What else the cell can execute says nothing of a candidate that has stations: it was refused for lines of sight to the part's
    // whole box.
    let remedy = remedy_of_top(&params, Cause::NotChosen, (&|_| Ok(false), &|_| Ok(true)));
    assert_eq!((remedy.kind, remedy.works()), (RemedyKind::View, true), "{remedy:?}");
    let refused = remedy.views[0].part_from_scanner;
    let other = remedy_of_top(&params, Cause::NotChosen, (&|_| Ok(false), &|pose| Ok(*pose != refused)));
    assert_eq!(other.kind, RemedyKind::View, "{other:?}");
    assert!(other.views.iter().all(|view| view.part_from_scanner != refused), "{other:?}");
    let none = remedy_of_top(&params, Cause::NotChosen, (&|_| Ok(false), &|_| Ok(false)));
    assert_eq!((none.kind, none.views.len()), (RemedyKind::None, 0), "{none:?}");
}

/// A larger limit for candidates as they are was told, though no path leads to any.
#[test]
fn a_larger_limit_is_no_remedy_where_the_cell_cannot_execute_any_view() {
    let mut params = all_around();
    (params.limits.camera_deg, params.limits.projector_deg) = (Some(60.0), Some(55.0));
    let remedy = remedy_of_top(&params, Cause::IncidenceLeft, (&|_| Ok(false), &|_| Ok(true)));
    assert_eq!((remedy.kind, remedy.views.len()), (RemedyKind::None, 0), "{remedy:?}");
}
