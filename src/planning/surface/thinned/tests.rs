use std::sync::atomic::AtomicBool;

use super::*;
use crate::geometry::Mesh;
use crate::planning::context::{Context, Silent};
use crate::planning::params::{InterestParams, PlanParams, Region};
use crate::planning::surface::requirements;

/// A box of 100 × 80 × 60 mm, each side a grid of `cells` × `cells` squares, with a pin of 1 × 1 × 4 mm on top.
fn box_with_pin(cells: usize) -> Mesh {
    let mut mesh = Mesh { vertices_mm: Vec::new(), faces: Vec::new(), source_face: Vec::new(), groups: Vec::new() };
    let mut add = |min: [f64; 3], max: [f64; 3], cells: usize| {
        for axis in 0..3 {
            for (side, level) in [(false, min[axis]), (true, max[axis])] {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let first = mesh.vertices_mm.len() as u32;
                for i in 0..=cells {
                    for j in 0..=cells {
                        let mut p = [0.0; 3];
                        p[axis] = level;
                        p[u] = min[u] + (max[u] - min[u]) * i as f64 / cells as f64;
                        p[v] = min[v] + (max[v] - min[v]) * j as f64 / cells as f64;
                        mesh.vertices_mm.push(p.into());
                    }
                }
                let row = cells as u32 + 1;
                for (i, j) in (0..cells as u32).flat_map(|i| (0..cells as u32).map(move |j| (i, j))) {
                    let a = first + i * row + j;
                    let quad = [[a, a + row, a + row + 1], [a, a + row + 1, a + 1]];
                    mesh.faces.extend(quad.map(|[a, b, c]| if side { [a, b, c] } else { [a, c, b] }));
                }
            }
        }
    };
    add([0.0; 3], [100.0, 80.0, 60.0], cells);
    add([50.0, 40.0, 60.0], [51.0, 41.0, 64.0], 1);
    mesh.source_face = (0..mesh.faces.len() as u32).collect();
    mesh
}

fn sampled(mesh: &Mesh) -> Surface {
    sampled_with(mesh, &PlanParams::default())
}

fn sampled_with(mesh: &Mesh, params: &PlanParams) -> Surface {
    let cancel = AtomicBool::new(false);
    let surface = requirements::sampled(mesh, params, 1, &Context::new(&cancel, &Silent));
    surface.unwrap_or_else(|error| panic!("{error}"))
}

fn chosen_on(whole: &Surface) -> (Surface, Strata) {
    thinned(whole, default_count(whole.area_where(|_| true))).expect("fewer than all")
}

#[test]
fn what_is_chosen_on_does_not_grow_with_triangles() {
    let [coarse, fine] = [4, 200].map(|cells| {
        let whole = sampled(&box_with_pin(cells));
        (chosen_on(&whole).0.sample_mm.len() as f64, whole.sample_mm.len())
    });
    assert!(fine.1 > 4 * coarse.1, "{} and {} samples", coarse.1, fine.1);
    assert!((fine.0 / coarse.0 - 1.0).abs() < 0.05, "chosen on {} and {}", coarse.0, fine.0);
}

#[test]
fn every_stratum_keeps_its_area_and_a_small_feature_keeps_samples() {
    let whole = sampled(&box_with_pin(60));
    let (surface, strata) = chosen_on(&whole);
    let mut areas = vec![[0.0; 2]; strata.members.len()];
    whole.samples().for_each(|sample| areas[strata.of_sample[sample.index()] as usize][0] += whole.sample_area_mm2(sample));
    for (stratum, members) in strata.members.iter().enumerate() {
        assert!(!members.is_empty());
        areas[stratum][1] = members.iter().map(|member| surface.sample_area_mm2(*member)).sum();
    }
    assert!(areas.iter().all(|[all, chosen_on]| (all - chosen_on).abs() < 1e-9 * all));
    // The four sides of the pin, 4 mm² each, beside 37 600 mm² of box.
    let on_pin = |normal: Vector3<f64>| {
        let is_on_pin =
            |sample: &SampleId| surface.sample_mm[sample.index()].z > 60.0 && surface.patch_of(*sample).normal == normal;
        surface.samples().filter(is_on_pin).count()
    };
    for normal in [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y()] {
        assert!(on_pin(normal) >= 1, "side {normal:?}");
    }
}

#[test]
fn a_small_region_of_interest_keeps_every_sample_that_it_has() {
    let mut params = PlanParams::default();
    params.regions.interest = vec![InterestParams {
        name: None,
        region: Region::Sphere { centre_mm: [20.0, 20.0, 60.0], radius_mm: 2.5 },
        weight: 1.0,
        target: Some(0.95),
        camera_deg: None,
        projector_deg: None,
        min_grade: None,
    }];
    let whole = sampled_with(&box_with_pin(60), &params);
    let of_region = |surface: &Surface| {
        let is_held = |sample: &SampleId| !surface.requirements.of(*sample).regions.is_empty();
        let held: Vec<SampleId> = surface.samples().filter(is_held).collect();
        (held.len(), held.iter().map(|sample| surface.sample_area_mm2(*sample)).sum::<f64>())
    };
    let ((all, all_mm2), (kept, kept_mm2)) = (of_region(&whole), of_region(&chosen_on(&whole).0));
    assert!(all >= 100 && kept == all, "{kept} of {all} samples");
    assert!((kept_mm2 - all_mm2).abs() < 1e-9 && (all_mm2 - 6.25 * std::f64::consts::PI).abs() < 1.0, "{kept_mm2} mm²");
}

#[test]
fn samples_are_added_where_views_miss_more_than_was_known() {
    let whole = sampled(&box_with_pin(60));
    let (mut surface, mut strata) = chosen_on(&whole);
    let before_mm2 = surface.area_where(|_| true);
    let known = surface.sample_mm.len();
    // Views that miss a strip of the top, and what was chosen on knows nothing of it.
    let is_missed = |sample: &SampleId| {
        let p = &whole.sample_mm[sample.index()];
        p.z == 60.0 && p.x < 30.0 && p.y < 1.0
    };
    let missed: Vec<SampleId> = whole.samples().filter(is_missed).collect();
    let missed_mm2: f64 = missed.iter().map(|sample| whole.sample_area_mm2(*sample)).sum();
    let added = strata.refine(&mut surface, &whole, |_| true, &missed);
    assert!(!added.is_empty() && added.iter().all(|sample| missed.contains(sample)));
    assert!(added.is_sorted());
    assert_eq!(surface.sample_mm.len(), known + added.len());
    let added_mm2 = surface.area_where(|sample| sample.index() >= known);
    assert!((added_mm2 - missed_mm2).abs() < 1e-9 * missed_mm2, "{added_mm2} stands for {missed_mm2}");
    assert!((surface.area_where(|_| true) - before_mm2).abs() < 1e-9 * before_mm2);
    // Once it is known, nothing is added again.
    let again = strata.refine(&mut surface, &whole, |sample| sample.index() < known, &missed);
    assert_eq!(again, []);
}

#[test]
fn a_part_with_few_samples_is_chosen_on_all_of_them() {
    let whole = sampled(&box_with_pin(4));
    assert!(thinned(&whole, whole.sample_mm.len() as f64).is_none());
}
