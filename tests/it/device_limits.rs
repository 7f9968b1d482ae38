//! Limits of incidence, a device each: facets at known angles by both engines, the views of a plan, what a plan says of the
//! limits in force, and jobs that ask for more than the hardware gives.

use std::sync::atomic::AtomicBool;

use nalgebra::{Point3, Rotation3, Vector3};
use vantage::cell::{DeviceName, FieldError, Scanner};
use vantage::geometry::Mesh;
use vantage::planning::context::{Context, PlanError, Silent};
use vantage::planning::ids::SampleId;
use vantage::planning::params::{CandidateParams, Engine, InterestParams, PlanParams, Region};
use vantage::planning::plan::Cause;
use vantage::planning::visibility::{self, Occluders};
use vantage::planning::{PlanInput, plan};
use vantage::wire::echo::Echo;
use vantage::wire::plan::PlanDocument;

use crate::closed_form::sampled;
use crate::miss_report::looking;
use crate::support::shapes::sphere;
use crate::support::{box_mesh, limited_to, nominal_scanner, plan_viewpoints};

const ENGINES: [Engine; 2] = [Engine::Raster, Engine::Rays];

/// Share of a facet of 2 × 2 mm at best focus, its normal turned by `tilt_deg` from the viewpoint towards the left camera, that
/// one view measures, and the causes why the rest is missed.
fn measured_of_facet(scanner: &Scanner, tilt_deg: f64, engine: Engine) -> (f64, Vec<Cause>) {
    let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), -tilt_deg.to_radians());
    let mut mesh = box_mesh([-1.0, -1.0, -2.0], [1.0, 1.0, 0.0]);
    mesh.vertices_mm.iter_mut().for_each(|p| *p = turn * *p);
    let surface = sampled(&mesh, 4000.0);
    let mut params = PlanParams::default();
    params.visibility.engine = engine;
    let (occluders, cancel) = (Occluders::new([&mesh]), AtomicBool::new(false));
    let view = looking(Point3::origin(), 0.0, 0.0, 0.0);
    let table = visibility::cast(&surface, &[view], &[true], scanner, &occluders, &params, &Context::new(&cancel, &Silent))
        .expect("a table");
    let up = turn * Vector3::z();
    let facet: Vec<_> = surface.samples().filter(|sample| surface.patch_of(*sample).normal.dot(&up) > 0.99).collect();
    let (measured, missed): (Vec<&SampleId>, Vec<&SampleId>) = facet.iter().partition(|sample| table.rows[0].holds(**sample));
    let mut causes: Vec<Cause> = missed.into_iter().map(|sample| table.furthest_cause[sample.index()]).collect();
    causes.dedup();
    (measured.len() as f64 / facet.len() as f64, causes)
}

/// The cameras stand at x = ∓101, 480 mm above: tilted by t to the left, a facet is seen by the right camera at
/// t + atan(101 / 480), by the left one at t less that.
#[test]
fn a_facet_is_measured_up_to_the_limit_of_the_camera_that_sees_it_most_obliquely() {
    let beside_deg = (101.0_f64 / 480.0).atan().to_degrees();
    let whole = (1.0, Vec::new());
    for engine in ENGINES {
        let seen = |own_deg, tilt_deg| measured_of_facet(&limited_to(nominal_scanner(), own_deg), tilt_deg, engine);
        for from_limit_deg in [-0.5, 0.5] {
            let tilt_deg = 45.0 + from_limit_deg - beside_deg;
            // At 45° the facet is at the edge of the right camera's limit; at 85° it is well within, as it is for the left one.
            let right = if from_limit_deg < 0.0 { whole.clone() } else { (0.0, vec![Cause::IncidenceRight]) };
            assert_eq!(seen([85.0, 45.0, 77.5], tilt_deg), right, "{engine:?} {tilt_deg}");
            assert_eq!(seen([85.0, 85.0, 77.5], tilt_deg), whole, "{engine:?} {tilt_deg}");
            assert_eq!(seen([45.0, 85.0, 77.5], tilt_deg), whole, "{engine:?} {tilt_deg}");
            // Its mirror image.
            let left = if from_limit_deg < 0.0 { whole.clone() } else { (0.0, vec![Cause::IncidenceLeft]) };
            assert_eq!(seen([45.0, 85.0, 77.5], -tilt_deg), left, "{engine:?} {tilt_deg}");
            assert_eq!(seen([85.0, 45.0, 77.5], -tilt_deg), whole, "{engine:?} {tilt_deg}");
        }
    }
}

/// Few samples of a block, and the thesis's candidates.
fn quick(mesh: &Mesh) -> PlanParams {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    params.part.samples_per_mm2 = Some(4_000.0 / mesh.area_mm2());
    params.missed.remedies = 0;
    params
}

#[test]
fn a_plan_holds_to_the_limit_of_each_device_and_states_it() {
    let mesh = sphere(40.0, 3);
    let scanner = limited_to(nominal_scanner(), [85.0, 45.0, 77.5]);
    let outcome = plan_viewpoints(&mesh, &scanner, &quick(&mesh));
    let mut most_oblique_deg = [0.0_f64; 2];
    for (view, row) in outcome.plan.views.iter().zip(&outcome.measured_by_view) {
        for sample in row.samples() {
            for (device, most_oblique_deg) in [DeviceName::Left, DeviceName::Right].into_iter().zip(&mut most_oblique_deg) {
                let centre_mm = view.part_from_scanner.point(&scanner.devices[device].scanner_from_device.origin_mm());
                let towards = centre_mm - outcome.surface.sample_mm[sample.index()];
                let incidence_rad = outcome.surface.patch_of(sample).normal.angle(&towards);
                *most_oblique_deg = most_oblique_deg.max(incidence_rad.to_degrees());
            }
        }
    }
    assert!(most_oblique_deg[1] <= 45.0 + 1e-6, "the right camera: {most_oblique_deg:?}");
    assert!(most_oblique_deg[0] > 45.0, "the left camera is not held to the right one's limit: {most_oblique_deg:?}");
    let document = PlanDocument::new(&outcome, &scanner, None, Echo::default());
    assert_eq!(limits_of(&document), [(85.0, None), (45.0, None), (77.5, None)]);
    assert_eq!((document.params.limits.camera_deg, document.params.limits.projector_deg), (None, Some(77.5)));
}

/// Limit in force and own limit of each device, as stated.
fn limits_of(document: &PlanDocument) -> Vec<(f64, Option<f64>)> {
    document.scanner.devices.iter().map(|device| (device.incidence_max_deg, device.incidence_own_deg)).collect()
}

#[test]
fn a_plan_states_the_job_s_limits_beside_the_devices_own() {
    let mesh = box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]);
    let mut params = quick(&mesh);
    params.limits.camera_deg = Some(40.0);
    let scanner = limited_to(nominal_scanner(), [85.0, 45.0, 77.5]);
    let document = PlanDocument::new(&plan_viewpoints(&mesh, &scanner, &params), &scanner, None, Echo::default());
    assert_eq!(limits_of(&document), [(40.0, Some(85.0)), (40.0, Some(45.0)), (77.5, None)]);
    assert_eq!(document.params.limits.camera_deg, Some(40.0));
    // Cameras of the same limit: one number says it of both.
    let scanner = nominal_scanner();
    let document = PlanDocument::new(&plan_viewpoints(&mesh, &scanner, &quick(&mesh)), &scanner, None, Echo::default());
    assert_eq!(limits_of(&document), [(85.0, None), (85.0, None), (77.5, None)]);
    assert_eq!(document.params.limits.camera_deg, Some(85.0));
    let json = serde_json::to_value(&document).expect("JSON");
    assert!(json["scanner"]["devices"][0].get("incidence_own_deg").is_none(), "{json}");
}

/// Findings with which a job is refused.
fn refused(scanner: &Scanner, params: &PlanParams) -> Vec<FieldError> {
    let (mesh, cancel) = (box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0]), AtomicBool::new(false));
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner, cell: None, roadmaps: None };
    match plan(&input, params, &Context::new(&cancel, &Silent)) {
        Err(PlanError::BadParams(findings)) => findings,
        other => panic!("not refused: {:?}", other.map(|outcome| outcome.plan.views.len())),
    }
}

#[test]
fn a_job_s_limit_beyond_a_device_s_own_is_refused_with_value_range_and_device() {
    let uneven = limited_to(nominal_scanner(), [85.0, 45.0, 77.5]);
    for (scanner, camera_deg, projector_deg, expected) in [
        (
            nominal_scanner(),
            Some(89.0),
            None,
            "/limits/camera_deg: is 89 °; allowed is 1 to 85 °, the own limit of the left camera",
        ),
        (
            nominal_scanner(),
            None,
            Some(80.0),
            "/limits/projector_deg: is 80 °; allowed is 1 to 77.5 °, the own limit of the projector",
        ),
        (
            uneven.clone(),
            Some(60.0),
            None,
            "/limits/camera_deg: is 60 °; allowed is 1 to 45 °, the own limit of the right camera",
        ),
    ] {
        let mut params = PlanParams::default();
        (params.limits.camera_deg, params.limits.projector_deg) = (camera_deg, projector_deg);
        let [finding] = &refused(&scanner, &params)[..] else { panic!("one finding") };
        assert!(finding.to_string().starts_with(expected), "{finding}");
    }
    let mut params = PlanParams::default();
    let region = Region::Sphere { centre_mm: [0.0; 3], radius_mm: 5.0 };
    params.regions.interest = vec![InterestParams {
        name: None,
        region,
        weight: 1.0,
        target: None,
        camera_deg: Some(46.0),
        projector_deg: Some(77.5),
        min_grade: None,
    }];
    let [finding] = &refused(&uneven, &params)[..] else { panic!("one finding") };
    assert_eq!(finding.pointer, "/regions/interest/0/camera_deg");
    // Up to the limits themselves a job may go.
    params.regions.interest.clear();
    (params.limits.camera_deg, params.limits.projector_deg) = (Some(45.0), Some(77.5));
    assert_eq!(params.check_limits(&uneven), Ok(()));
}
