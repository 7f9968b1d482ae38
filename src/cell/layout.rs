//! The cell: which scanner, robot and turntable, and where each is. Joints to scanner, and plate to base, in the chain
//! FK(joints) · flange_from_scanner = base_from_table · Rz(table angle) · table_from_part · part_from_scanner.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::axis::{Axes, Configuration};
use super::body::{Body, LinkBody, Shape, not_found};
use super::body_meshes::{self, BodyMeshes};
use super::collision::{CollisionScene, MIN_CLEARANCE_MM};
use super::field_error::{FieldError, Findings};
use super::field_ranges;
use super::library::{Named, NotFound, SpecKind, SpecLibrary};
use super::pose_spec::{PoseInput, PoseSpec, metres_in_mm};
use super::provenance::{CalibrationObjection, CalibrationProvenance, UseConditions};
use super::robot::{LinkCapsule, Robot, RobotSpec};
use super::scanner::{Scanner, ScannerSpec};
use super::shape_spec::{BodySpec, LinkBodySpec, ShapeSpec};
use super::turntable::{Turntable, TurntableSpec};
use crate::geometry::{Base, Flange, Mesh, Plate, Pose, ScannerFrame, Table};

/// Difference of a written angle from a whole number that is none, degrees: angles were turned into radians and back.
const WHOLE_NUMBER: f64 = 1e-6;
/// Standard gravity (CGPM 1901).
const GRAVITY_M_PER_S2: f64 = 9.806_65;
/// Largest distance that a link's surface may stand out of its capsules, mm: no more than half of the smallest clearance.
const OUT_OF_CAPSULES_MM: f64 = 0.5 * MIN_CLEARANCE_MM;

/// A cell. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CellSpec {
    /// Name, unique among cells.
    pub name: String,
    /// Scanner: a name or a specification.
    pub scanner: Named<ScannerSpec>,
    /// Robot: a name or a specification.
    pub robot: Named<RobotSpec>,
    /// Turntable: a name or a specification; of a table that stands still, one that turns from 0° to 0.001°.
    pub turntable: Named<TurntableSpec>,
    /// Pose of the plate's centre, at angle zero, seen from the robot's foot.
    #[schema(value_type = PoseInput)]
    pub base_from_table: PoseSpec,
    /// Pose of the scanner on the flange, mm and degrees: the hand-eye result.
    #[schema(value_type = PoseInput)]
    pub flange_from_scanner: PoseSpec,
    /// Bodies that hold the scanner, in the flange frame.
    #[serde(default)]
    pub mount: Vec<BodySpec>,
    /// Mass of what holds the scanner, kg, 0 to 1000; the arm carries it too. Default 0.
    #[serde(default)]
    pub mount_mass_kg: f64,
    /// Room that cables, hoses and what leads them take along the arm, each piece with the link that it moves with. It may
    /// touch that link and those beside it, nothing else. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cable: Vec<LinkBodySpec>,
    /// Joints 1 to 6 and the table angle where a program begins and ends, degrees, -3600 to 3600 each, within the axes' limits.
    #[schema(min_items = 7, max_items = 7)]
    pub home_deg: [f64; 7],
    /// Bodies that stand around and do not move, in the base frame.
    #[serde(default)]
    pub obstacles: Vec<BodySpec>,
    /// Height of the floor in the base frame, mm, -10000 to 10000; nothing moves below it. Default: no floor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor_mm: Option<f64>,
    /// Calibration that `base_from_table` and `flange_from_scanner` were taken from. Default: none; they were typed in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibrated: Option<CalibrationProvenance>,
}

/// A cell, checked and in radians. Made from a [`CellSpec`].
#[derive(Clone, Debug)]
pub struct Cell {
    /// Name of the specification.
    pub name: String,
    /// Scanner of the cell.
    pub scanner: Scanner,
    /// Robot of the cell.
    pub robot: Robot,
    /// Turntable of the cell.
    pub turntable: Turntable,
    /// The table at angle zero.
    pub base_from_table: Pose<Base, Table>,
    /// Pose of the scanner on the flange.
    pub flange_from_scanner: Pose<Flange, ScannerFrame>,
    /// Configuration where a program begins and ends.
    pub home_rad: Configuration,
    /// Envelope of the scanner, in the scanner frame.
    pub scanner_bodies: Vec<Body>,
    /// Bodies that hold the scanner, in the flange frame.
    pub mount: Vec<Body>,
    /// Mass of that, kg.
    pub mount_mass_kg: f64,
    /// Surfaces of the links within their capsules, where they are known.
    pub link_surfaces: Vec<LinkBody>,
    /// Envelope of cables and hoses along the arm.
    pub cable: Vec<LinkBody>,
    /// Bodies below the plate, in the table frame.
    pub table_bodies: Vec<Body>,
    /// Bodies that stand around, in the base frame.
    pub obstacles: Vec<Body>,
    /// Height of the floor in the base frame.
    pub floor_mm: Option<f64>,
    /// Calibration of its poses.
    pub calibrated: Option<CalibrationProvenance>,
}

field_ranges! {
    CellSpec {
        MOUNT_MASS_KG = "mount_mass_kg", [0.0, 1000.0] "kg";
        HOME_DEG = "home_deg", [-3600.0, 3600.0] "°";
        FLOOR_MM = "floor_mm", [-10_000.0, 10_000.0] "mm";
    }
}

impl CellSpec {
    /// Finds what the specification names, checks every field and builds the cell.
    ///
    /// # Errors
    /// All fields that are unknown, out of range or inconsistent with each other.
    pub fn build(&self, library: &dyn SpecLibrary) -> Result<Cell, Vec<FieldError>> {
        let cell = self.assemble(library)?;
        cell.check()?;
        Ok(cell)
    }

    /// Builds the cell without the checks of what only its parts together show, such as home: for a sketch of what was meant.
    ///
    /// # Errors
    /// All fields that are unknown or out of range.
    pub fn assemble(&self, library: &dyn SpecLibrary) -> Result<Cell, Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check(&mut findings);
        let scanner_spec = find(&self.scanner, SpecKind::Scanner, |name| library.scanner(name), library, &mut findings);
        let robot_spec = find(&self.robot, SpecKind::Robot, |name| library.robot(name), library, &mut findings);
        let turntable_spec = find(&self.turntable, SpecKind::Turntable, |name| library.turntable(name), library, &mut findings);
        let scanner = scanner_spec.as_ref().and_then(|spec| below(spec.build(), "/scanner", &mut findings));
        let robot = robot_spec.as_ref().and_then(|spec| below(spec.build(), "/robot", &mut findings));
        let turntable = turntable_spec.as_ref().and_then(|spec| below(spec.build(), "/turntable", &mut findings));
        let surfaces = robot_spec.as_ref().map_or(&[][..], |spec| &spec.surfaces);
        let table_specs = turntable_spec.as_ref().map_or(&[][..], |spec| &spec.body);
        let scanner_specs = scanner.as_ref().map_or(&[][..], |scanner| &scanner.body);
        let rigid = [
            (&self.mount[..], "/mount"),
            (&self.obstacles, "/obstacles"),
            (table_specs, "/turntable/body"),
            (scanner_specs, "/scanner/body"),
        ];
        let carried = [(surfaces, "/robot/surfaces"), (&self.cable, "/cable")];
        if !body_meshes::check_count(shapes(&rigid, &carried), &mut findings) {
            return Err(findings.into_result().err().unwrap_or_default());
        }
        let mut meshes = BodyMeshes::new(library);
        let [mount, obstacles, table_bodies, scanner_bodies] =
            rigid.map(|(specs, pointer)| Body::resolve(specs, pointer, &mut meshes, &mut findings));
        let [link_surfaces, cable] =
            carried.map(|(specs, pointer)| LinkBody::resolve(specs, pointer, &mut meshes, &mut findings));
        findings.into_result()?;
        // Without findings the three are there.
        let (Some(scanner), Some(robot), Some(turntable)) = (scanner, robot, turntable) else { return Err(Vec::new()) };
        Ok(Cell {
            name: self.name.clone(),
            scanner,
            robot,
            turntable,
            base_from_table: self.base_from_table.pose(),
            flange_from_scanner: self.flange_from_scanner.pose(),
            home_rad: Configuration::from_axes_rad(self.home_deg.map(f64::to_radians)),
            scanner_bodies,
            mount,
            mount_mass_kg: self.mount_mass_kg,
            link_surfaces,
            cable,
            table_bodies,
            obstacles,
            floor_mm: self.floor_mm,
            calibrated: self.calibrated.clone(),
        })
    }

    fn check(&self, findings: &mut Findings) {
        findings.require(!self.name.is_empty(), "/name", || "is empty; name the cell".into());
        self.base_from_table.check("/base_from_table", findings);
        self.flange_from_scanner.check("/flange_from_scanner", findings);
        Self::MOUNT_MASS_KG.check("", &self.mount_mass_kg, findings);
        Self::HOME_DEG.check("", &self.home_deg, findings);
        for (field, bodies) in [("mount", &self.mount), ("obstacles", &self.obstacles)] {
            for (index, body) in bodies.iter().enumerate() {
                body.check(&format!("/{field}/{index}"), findings);
            }
        }
        for (index, body) in self.cable.iter().enumerate() {
            body.check(&format!("/cable/{index}"), findings);
        }
        Self::FLOOR_MM.check("", &self.floor_mm, findings);
        if let Some(calibrated) = &self.calibrated {
            calibrated.check("/calibrated", findings);
        }
    }
}

/// The shapes of bodies, each with its pointer.
fn shapes<'s>(
    rigid: &'s [(&'s [BodySpec], &'s str)],
    carried: &'s [(&'s [LinkBodySpec], &'s str)],
) -> impl Iterator<Item = (String, &'s ShapeSpec)> {
    let numbered = |at: &'s str, shapes: Vec<&'s ShapeSpec>| {
        shapes.into_iter().enumerate().map(move |(index, shape)| (format!("{at}/{index}/shape"), shape))
    };
    let rigid = rigid.iter().flat_map(move |(specs, at)| numbered(at, specs.iter().map(|spec| &spec.shape).collect()));
    rigid.chain(carried.iter().flat_map(move |(specs, at)| numbered(at, specs.iter().map(|spec| &spec.shape).collect())))
}

/// The specification meant, or a finding that says why there is none.
fn find<T: Clone>(
    named: &Named<T>,
    kind: SpecKind,
    lookup: impl Fn(&str) -> Result<T, NotFound>,
    library: &dyn SpecLibrary,
    findings: &mut Findings,
) -> Option<T> {
    match named {
        Named::Inline(spec) => Some((**spec).clone()),
        Named::Name(name) => {
            let found = lookup(name);
            found.map_err(|error| findings.push(format!("/{}", kind.as_str()), not_found(&error, kind, name, library))).ok()
        }
    }
}

/// The value built, or its findings moved below `pointer`.
fn below<T>(built: Result<T, Vec<FieldError>>, pointer: &str, findings: &mut Findings) -> Option<T> {
    match built {
        Ok(value) => Some(value),
        Err(errors) => {
            for FieldError { pointer: field, detail } in errors {
                findings.push(format!("{pointer}{field}"), detail);
            }
            None
        }
    }
}

impl Cell {
    /// The seven axes.
    #[must_use]
    pub fn axes(&self) -> Axes {
        let joints = &self.robot.joints;
        Axes(std::array::from_fn(|axis| joints.get(axis).copied().unwrap_or(self.turntable.axis)))
    }

    /// Reasons for which its calibrated poses may not be used under these conditions; none where they were typed in.
    #[must_use]
    pub fn calibration_objections(&self, conditions: &UseConditions) -> Vec<CalibrationObjection> {
        let calibrated = self.calibrated.iter();
        calibrated.flat_map(|known| known.objections(&self.name, &self.flange_from_scanner, conditions)).collect()
    }

    /// The plate after the table has turned.
    #[must_use]
    pub fn base_from_plate(&self, table_angle_rad: f64) -> Pose<Base, Plate> {
        self.base_from_table * self.turntable.table_from_plate(table_angle_rad)
    }

    /// The scanner as the plate sees it.
    #[must_use]
    pub fn plate_from_scanner(&self, configuration: &Configuration) -> Pose<Plate, ScannerFrame> {
        self.base_from_plate(configuration.table_rad).inverse() * self.base_from_scanner(&configuration.joints_rad)
    }

    /// The scanner at these joints.
    #[must_use]
    pub fn base_from_scanner(&self, joints_rad: &[f64; 6]) -> Pose<Base, ScannerFrame> {
        self.robot.base_from_flange(joints_rad) * self.flange_from_scanner
    }

    /// The meshes that its bodies are made of, each once.
    #[must_use]
    pub fn surfaces(&self) -> Vec<&Mesh> {
        let carried = self.link_surfaces.iter().chain(&self.cable).map(|body| &body.body);
        let bodies =
            self.scanner_bodies.iter().chain(&self.mount).chain(&self.table_bodies).chain(&self.obstacles).chain(carried);
        let mut surfaces: Vec<&Mesh> = Vec::new();
        for body in bodies {
            if let Shape::Mesh(mesh) = &body.shape
                && !surfaces.iter().any(|known| std::ptr::eq(*known, &raw const **mesh))
            {
                surfaces.push(mesh);
            }
        }
        surfaces
    }

    /// Static moment of scanner and mount about the flange's centre in the posture where it is largest, N·m. The scanner's
    /// centre of mass is that of its specification, else the mean of its bodies' centres; the mount's is the mean of its.
    #[must_use]
    pub fn flange_moment_nm(&self) -> f64 {
        let mean = |bodies: &[Body]| {
            let sum: Vector3<f64> = bodies.iter().map(|body| body.owner_from_body.translation.vector).sum();
            Point3::from(sum / bodies.len().max(1) as f64)
        };
        let scanner = self.scanner.centre_of_mass_mm.map_or_else(|| mean(&self.scanner_bodies), Point3::from);
        let scanner = self.flange_from_scanner.point(&scanner).coords * self.scanner.mass_kg;
        let mount = mean(&self.mount).coords * self.mount_mass_kg;
        GRAVITY_M_PER_S2 * (scanner + mount).norm() / 1000.0
    }

    /// Checks what only the parts together show: payload, surfaces within their capsules, home within the limits and clear of
    /// everything.
    fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        let (scanner_kg, mount_kg, payload_kg) = (self.scanner.mass_kg, self.mount_mass_kg, self.robot.payload_kg);
        findings.require(scanner_kg + mount_kg <= payload_kg, "/scanner", || {
            format!("weighs {scanner_kg} kg and its mount {mount_kg} kg, more than the robot's payload of {payload_kg} kg")
        });
        let moment = self.flange_moment_nm();
        let max = self.robot.max_flange_moment_nm.unwrap_or(f64::INFINITY);
        findings.require(moment <= max, "/flange_from_scanner", || {
            format!("puts a moment of {moment:.2} N·m on the flange, more than the {max} N·m that the robot bears")
        });
        for (index, surface) in self.link_surfaces.iter().enumerate() {
            let (out_mm, at) = out_of_capsules(surface, &self.robot.links);
            findings.require(out_mm <= OUT_OF_CAPSULES_MM, format!("/robot/surfaces/{index}"), || {
                let (name, link, [x, y, z]) = (&surface.body.name, surface.link, <[f64; 3]>::from(at));
                format!(
                    "has a triangle of {name:?} that no capsule of link {link} holds: it stands {out_mm:.2} mm out at \
                     [{x:.1}, {y:.1}, {z:.1}]; allowed are {OUT_OF_CAPSULES_MM} mm: widen the capsules, or import both \
                     from the URDF"
                )
            });
        }
        self.check_home(&mut findings);
        let (nearest_mm, reach_mm) = self.plate_distance_mm();
        findings.require(nearest_mm <= reach_mm, "/base_from_table", || {
            format!(
                "puts all of the plate at least {nearest_mm:.0} mm from the robot's shoulder, out of reach: stretched, the arm and \
                 the scanner's far working depth reach {reach_mm:.0} mm; move the table nearer (lengths are millimetres)"
            )
        });
        findings.into_result()
    }

    fn check_home(&self, findings: &mut Findings) {
        let hint = self.home_in_radians().map_or_else(String::new, |home| {
            format!("; is home in radians? In degrees it would be {:?}", home.axes_tenths_deg())
        });
        let hint = hint + &self.metres_hint();
        for (index, (axis, angle)) in self.axes().0.iter().zip(self.home_rad.axes_rad()).enumerate() {
            if self.robot.has_limits_in_radians(index) && !axis.allows(angle) {
                let (min_deg, max_deg) = (axis.min_rad.to_degrees(), axis.max_rad.to_degrees());
                findings.push(
                    format!("/robot/joints/{index}"),
                    format!(
                        "has min_deg {min_deg:.3} and max_deg {max_deg:.3}, which do not allow home, {:.3}°; both lie within ±2π: \
                         are min_deg and max_deg in radians? In degrees they would be {:.1} and {:.1}",
                        angle.to_degrees(),
                        min_deg.to_degrees(),
                        max_deg.to_degrees()
                    ),
                );
                continue;
            }
            findings.require(axis.allows(angle), format!("/home_deg/{index}"), || {
                let (min_deg, max_deg) = (axis.min_rad.to_degrees(), axis.max_rad.to_degrees());
                format!("is {:.3}°; the axis allows {min_deg:.3} to {max_deg:.3}°{hint}", angle.to_degrees())
            });
        }
        if let Some(contact) = CollisionScene::without_part(self, MIN_CLEARANCE_MM).check(&self.home_rad) {
            findings.push("/home_deg", format!("collides: {contact} (closer than {MIN_CLEARANCE_MM} mm){hint}"));
        }
    }

    /// Question for the end of a message on home, where a pose of table or scanner looks like metres; empty if none does.
    fn metres_hint(&self) -> String {
        let poses = [
            ("base_from_table", self.base_from_table.origin_mm()),
            ("flange_from_scanner", self.flange_from_scanner.origin_mm()),
        ];
        let in_mm = poses.into_iter().filter_map(|(name, origin)| Some((name, metres_in_mm(origin.into())?)));
        in_mm.map(|(name, mm)| format!("; is {name} in metres? In mm its translation would be {mm:?}")).collect()
    }

    /// Home with its numbers read as radians, where they look like radians: every one within ±2π, one of them 0.3 or more,
    /// two or more of them no whole numbers, and all axes allow what they would mean. People write degrees as whole numbers, and a
    /// pose of the arm within 6° of all zeros is no place to begin from.
    #[must_use]
    pub fn home_in_radians(&self) -> Option<Configuration> {
        let written = self.home_rad.axes_rad().map(f64::to_degrees);
        let largest = written.iter().fold(0.0, |largest: f64, angle| largest.max(angle.abs()));
        let broken = written.iter().filter(|angle| (*angle - angle.round()).abs() > WHOLE_NUMBER).count();
        let looks_so = (0.3..=TAU + WHOLE_NUMBER).contains(&largest) && broken >= 2;
        let read = Configuration::from_axes_rad(written);
        (looks_so && self.axes().allow(&read)).then_some(read)
    }

    /// Smallest distance of the robot's shoulder from the room above the plate, as high as the plate is wide, and an upper bound of
    /// the distance from the shoulder that a measured point can have, mm.
    #[must_use]
    pub fn plate_distance_mm(&self) -> (f64, f64) {
        let (shoulder, reach_mm) = self.max_seen_mm();
        let (radius_mm, seen) = (self.turntable.plate_radius_mm, self.base_from_table.inverse().point(&shoulder));
        let beside_mm = (seen.x.hypot(seen.y) - radius_mm).max(0.0);
        let below_or_above_mm = (-seen.z).max(seen.z - 2.0 * radius_mm).max(0.0);
        (beside_mm.hypot(below_or_above_mm), reach_mm)
    }

    /// Distance of the plate's centre from the robot's shoulder, and the same bound, mm.
    #[must_use]
    pub fn plate_centre_distance_mm(&self) -> (f64, f64) {
        let (shoulder, reach_mm) = self.max_seen_mm();
        ((self.base_from_table.origin_mm() - shoulder).norm(), reach_mm)
    }

    /// The robot's shoulder, and an upper bound of the distance from it of a point that the scanner measures.
    fn max_seen_mm(&self) -> (Point3<f64>, f64) {
        let (shoulder, arm_mm) = self.robot.max_reach_mm();
        let from_flange_mm = |depth_mm: f64| {
            let [width_mm, height_mm] = self.scanner.common_field_at(depth_mm).size_mm();
            self.flange_from_scanner.point(&Point3::new(0.0, 0.0, depth_mm)).coords.norm() + 0.5 * width_mm.hypot(height_mm)
        };
        (shoulder, arm_mm + from_flange_mm(self.scanner.near_mm).max(from_flange_mm(self.scanner.far_mm)))
    }
}

impl LinkBody {
    /// Returns true if a capsule of its link holds a triangle of it; what is not a mesh has one box around it.
    #[must_use]
    pub(super) fn is_in_part_of(&self, capsule: &LinkCapsule) -> bool {
        let body = &self.body;
        let holds = |corners: &[Point3<f64>]| corners.iter().all(|corner| capsule.outside_mm(corner) <= OUT_OF_CAPSULES_MM);
        match &body.shape {
            Shape::Mesh(mesh) => {
                mesh.faces.iter().any(|face| holds(&face.map(|vertex| body.owner_from_body * mesh.vertices_mm[vertex as usize])))
            }
            Shape::Box { .. } | Shape::Cylinder { .. } | Shape::Capsule { .. } => holds(&body.corners_mm()),
        }
    }
}

/// Distance by which the triangle of a surface that its link's capsules hold worst stands out of the one that holds it best,
/// mm, and where, in the link's frame. What is no mesh counts by the box around it.
fn out_of_capsules(surface: &LinkBody, capsules: &[LinkCapsule]) -> (f64, Point3<f64>) {
    let body = &surface.body;
    let own: Vec<&LinkCapsule> = capsules.iter().filter(|capsule| capsule.link == surface.link).collect();
    let worst = |corners: &[Point3<f64>]| {
        let farthest = |capsule: &LinkCapsule| {
            let out = corners.iter().map(|corner| (capsule.outside_mm(corner), *corner));
            out.max_by(|a, b| a.0.total_cmp(&b.0))
        };
        own.iter()
            .filter_map(|capsule| farthest(capsule))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((f64::INFINITY, corners[0]))
    };
    let of_mesh = |mesh: &Mesh| {
        let triangle = |face: &[u32; 3]| worst(&face.map(|vertex| body.owner_from_body * mesh.vertices_mm[vertex as usize]));
        mesh.faces.iter().map(triangle).max_by(|a, b| a.0.total_cmp(&b.0))
    };
    match &body.shape {
        Shape::Mesh(mesh) => of_mesh(mesh).unwrap_or((0.0, Point3::origin())),
        Shape::Box { .. } | Shape::Cylinder { .. } | Shape::Capsule { .. } => worst(&body.corners_mm()),
    }
}
