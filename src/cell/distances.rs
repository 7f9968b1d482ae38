//! A cell from distances: robot, scanner and turntable, where the table stands, and which face of the scanner the flange is on.

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::body::{Body, not_found};
use super::body_meshes::BodyMeshes;
use super::field_error::{FieldError, Findings};
use super::layout::CellSpec;
use super::library::{Named, SpecKind, SpecLibrary};
use super::mounting::HousingFace;
use super::pose_spec::PoseSpec;
use super::scanner::ScannerSpec;
use super::shape_spec::{BodySpec, ShapeSpec};
use crate::geometry::{Aabb, Base, Pose, Table};

/// Radius of the adapter between flange and scanner, mm.
const ADAPTER_RADIUS_MM: f64 = 40.0;
/// Adapters that are thinner have no body, mm.
const MIN_ADAPTER_MM: f64 = 1.0;
/// Distance from the robot's foot within which no table stands: lengths so short are metres, mm.
const MIN_TABLE_MM: f64 = 10.0;
/// Radius and least height of a pedestal below the foot, mm.
const PEDESTAL_MM: [f64; 2] = [100.0, 1.0];

/// Distances of a cell. Lengths are millimetres in the frame of the robot's foot, angles degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct CellDistances {
    /// Name of the cell.
    pub name: String,
    /// Name of the scanner: a preset, or a file.
    pub scanner: String,
    /// Name of the robot.
    pub robot: String,
    /// Name of the turntable.
    pub turntable: String,
    /// Centre of the plate's upper face.
    pub table_at_mm: [f64; 3],
    /// Angle by which the table's zero is turned about its axis.
    pub table_yaw_deg: f64,
    /// Face of the scanner's housing that is bolted to the flange.
    pub mount: HousingFace,
    /// Distance between flange and housing.
    pub adapter_mm: f64,
    /// Mass of the adapter, kg.
    pub adapter_kg: f64,
    /// Height of the floor.
    pub floor_mm: Option<f64>,
    /// True if the robot stands on a pedestal that reaches down to the floor.
    pub pedestal: bool,
    /// Joints 1 to 6 and the table where a program begins. Default: found.
    pub home_deg: Option<[f64; 7]>,
}

impl CellDistances {
    /// The specification, with a home if one is given or found; else all zeros. The cell's own checks are left to its build.
    ///
    /// # Errors
    /// All distances that are out of range, each at the name of its option, and what is wrong with the devices.
    pub fn spec(&self, library: &dyn SpecLibrary) -> Result<CellSpec, Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check(&mut findings);
        findings.into_result()?;
        let scanner = library.scanner(&self.scanner).map_err(|error| {
            let detail = not_found(&error, SpecKind::Scanner, &self.scanner, library);
            vec![FieldError { pointer: "--scanner".into(), detail }]
        })?;
        let housing = envelope(&scanner, library)?;
        let mut spec = CellSpec {
            name: self.name.clone(),
            scanner: Named::Name(self.scanner.clone()),
            robot: Named::Name(self.robot.clone()),
            turntable: Named::Name(self.turntable.clone()),
            base_from_table: self.base_from_table(),
            flange_from_scanner: PoseSpec::from(&self.mount.flange_from_scanner(&housing, self.adapter_mm)),
            mount: self.adapter().into_iter().collect(),
            mount_mass_kg: self.adapter_kg,
            cable: Vec::new(),
            home_deg: self.home_deg.unwrap_or_default(),
            obstacles: self.pedestal_body().into_iter().collect(),
            floor_mm: self.floor_mm,
            calibrated: None,
        };
        if self.home_deg.is_none() {
            let home = spec.assemble(library)?.free_home();
            // Tenths of a degree, for people; the cell's own check tells if they are no longer free.
            let rounded = home.map(|home| home.axes_rad().map(|angle| (angle.to_degrees() * 10.0).round() / 10.0 + 0.0));
            spec.home_deg = rounded.unwrap_or_default();
        }
        Ok(spec)
    }

    /// Faults of the specification, at the options that they follow from: what its user gave.
    #[must_use]
    pub fn blamed(&self, errors: Vec<FieldError>, library: &dyn SpecLibrary) -> Vec<FieldError> {
        errors.into_iter().map(|error| self.blamed_one(error, library)).collect()
    }

    /// Returns true if the arm carries the scanner, but not the adapter too.
    fn is_adapter_too_heavy(&self, library: &dyn SpecLibrary) -> bool {
        let masses = library.scanner(&self.scanner).ok().zip(library.robot(&self.robot).ok());
        masses.is_some_and(|(scanner, robot)| {
            scanner.mass_kg <= robot.payload_kg && scanner.mass_kg + self.adapter_kg > robot.payload_kg
        })
    }

    fn blamed_one(&self, error: FieldError, library: &dyn SpecLibrary) -> FieldError {
        if error.pointer == "/scanner" && self.is_adapter_too_heavy(library) {
            let detail = format!("is {} kg, too much beside the scanner, which {}", self.adapter_kg, error.detail);
            return FieldError { pointer: "--adapter-mass".into(), detail };
        }
        let mut names = error.pointer.split('/').skip(1);
        let option = match names.next().unwrap_or_default() {
            "home_deg" if self.home_deg.is_none() => {
                let searched =
                    "leaves no collision-free home that looks at the plate; move the table, or give --home (at 0° of every axis";
                return FieldError { pointer: "--table-at".into(), detail: format!("{searched}, the cell {})", error.detail) };
            }
            "home_deg" => "--home",
            "base_from_table" => "--table-at",
            "flange_from_scanner" | "mount" => "--adapter",
            "mount_mass_kg" => "--adapter-mass",
            "floor_mm" => "--floor",
            "obstacles" => "--pedestal",
            "scanner" => "--scanner",
            "robot" => "--robot",
            "turntable" => "--turntable",
            _ => return error,
        };
        let below = names.map(|name| format!("/{name}")).collect::<String>();
        FieldError { pointer: option.to_owned() + &below, detail: error.detail }
    }

    fn base_from_table(&self) -> PoseSpec {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.table_yaw_deg.to_radians());
        PoseSpec::from(&Pose::<Base, Table>::from_parts(self.table_at_mm.into(), turn))
    }

    fn adapter(&self) -> Option<BodySpec> {
        (self.adapter_mm >= MIN_ADAPTER_MM).then(|| BodySpec {
            name: "adapter".into(),
            owner_from_body: PoseSpec { translation_mm: [0.0, 0.0, 0.5 * self.adapter_mm], ..PoseSpec::default() },
            shape: ShapeSpec::Cylinder { radius_mm: ADAPTER_RADIUS_MM, height_mm: self.adapter_mm },
        })
    }

    fn pedestal_body(&self) -> Option<BodySpec> {
        let [radius_mm, min_height_mm] = PEDESTAL_MM;
        let height_mm = self.floor_mm.filter(|_| self.pedestal).map(|floor_mm| -floor_mm)?;
        (height_mm >= min_height_mm).then(|| BodySpec {
            name: "pedestal".into(),
            owner_from_body: PoseSpec { translation_mm: [0.0, 0.0, -0.5 * height_mm], ..PoseSpec::default() },
            shape: ShapeSpec::Cylinder { radius_mm, height_mm },
        })
    }

    fn check(&self, findings: &mut Findings) {
        findings.require(!self.name.is_empty(), "--name", || "is empty; name the cell".into());
        for distance_mm in self.table_at_mm {
            findings.range("--table-at", distance_mm, -10_000.0, 10_000.0, "mm");
        }
        let is_in_the_foot = Vector3::from(self.table_at_mm).norm() < MIN_TABLE_MM;
        findings.require(!is_in_the_foot, "--table-at", || {
            // Rounded: a factor adds digits.
            let told = |factor: f64| self.table_at_mm.map(|length| ((length * factor * 1e6).round() / 1e6).to_string()).join(",");
            format!("is {} mm, inside the robot's foot; give millimetres: {} if these are metres", told(1.0), told(1e3))
        });
        findings.range("--table-yaw", self.table_yaw_deg, -360.0, 360.0, "°");
        findings.range("--adapter", self.adapter_mm, 0.0, 1000.0, "mm");
        findings.range("--adapter-mass", self.adapter_kg, 0.0, 1000.0, "kg");
        if let Some(height_mm) = self.floor_mm {
            findings.range("--floor", height_mm, -10_000.0, 10_000.0, "mm");
            let is_above = height_mm > 0.0 && height_mm <= 10_000.0;
            findings.require(!is_above, "--floor", || {
                format!("is {height_mm} mm; the floor lies below the robot's foot: give a negative height, {} mm", -height_mm)
            });
            let plate_mm = self.table_at_mm[2];
            let is_buried = (-10_000.0..=0.0).contains(&height_mm) && plate_mm < height_mm;
            findings.require(!is_buried, "--floor", || {
                let plate = format!("the plate, which --table-at puts at a height of {plate_mm} mm");
                format!("is {height_mm} mm, above {plate}; give a lower floor or a higher plate")
            });
        }
        let stands = !self.pedestal || self.floor_mm.is_some_and(|height_mm| height_mm < 0.0);
        findings
            .require(stands, "--pedestal", || "needs --floor below the foot, which is at 0 mm; give --floor -500, say".into());
        for angle in self.home_deg.into_iter().flatten() {
            findings.range("--home", angle, -3600.0, 3600.0, "°");
        }
    }
}

/// The box around a scanner's bodies, scanner frame; a point at the viewpoint for a scanner without any.
fn envelope(scanner: &ScannerSpec, library: &dyn SpecLibrary) -> Result<Aabb, Vec<FieldError>> {
    let mut findings = Findings::below("--scanner");
    let bodies = Body::resolve(&scanner.body, "/body", &mut BodyMeshes::new(library), &mut findings);
    findings.into_result()?;
    let corners = bodies.iter().flat_map(Body::corners_mm);
    let around = corners.fold(Aabb::empty(), |all, corner| all.with(&corner));
    let is_empty = !around.extent_mm().iter().all(|edge_mm| edge_mm.is_finite());
    Ok(if is_empty { Aabb::around(&[Point3::origin()]) } else { around })
}

#[cfg(test)]
mod tests {
    use super::CellDistances;
    use crate::cell::{Cell, HousingFace, Presets, SpecKind, SpecLibrary};
    use crate::geometry::Aabb;

    fn distances() -> CellDistances {
        CellDistances {
            name: "mine".into(),
            scanner: "transcan-c-nominal".into(),
            robot: "ur10e".into(),
            turntable: "minas-a6-500".into(),
            table_at_mm: [900.0, 0.0, 100.0],
            table_yaw_deg: 0.0,
            mount: HousingFace::Back,
            adapter_mm: 30.0,
            adapter_kg: 0.5,
            floor_mm: Some(-600.0),
            pedestal: true,
            home_deg: None,
        }
    }

    fn built(distances: &CellDistances) -> Result<Cell, Vec<String>> {
        let told = |errors: Vec<crate::cell::FieldError>| errors.iter().map(ToString::to_string).collect::<Vec<_>>();
        distances.spec(&Presets).map_err(told)?.build(&Presets).map_err(told)
    }

    #[test]
    fn an_arm_a_scanner_and_a_table_become_a_cell_with_a_home() {
        let cell = built(&distances()).expect("a cell");
        let plate = cell.base_from_table.origin_mm();
        assert_eq!((plate.x, plate.y, plate.z), (900.0, 0.0, 100.0));
        let looks_at = cell.base_from_scanner(&cell.home_rad.joints_rad).point(&cell.scanner.best_focus_mm());
        assert!((looks_at - plate).xy().norm() < 10.0, "home looks at the table: {looks_at}");
        assert!(cell.obstacles.iter().any(|body| body.name == "pedestal") && cell.mount.len() == 1);
    }

    #[test]
    fn the_default_cell_can_be_given_by_its_distances() {
        let spec = CellDistances {
            scanner: "transcan-c".into(),
            robot: "hans-e05".into(),
            table_at_mm: [400.0, 0.0, -200.0],
            mount: HousingFace::Top,
            floor_mm: Some(-380.0),
            home_deg: Some([0.0, -30.0, 60.0, 0.0, 30.0, 0.0, 0.0]),
            ..distances()
        }
        .spec(&Presets)
        .expect("valid");
        let preset = Presets.cell("e05-transcan").expect("a preset");
        assert_eq!(
            (spec.base_from_table, &spec.obstacles, &spec.mount),
            (preset.base_from_table, &preset.obstacles, &preset.mount)
        );
        let apart = spec.flange_from_scanner.pose::<(), ()>().inverse() * preset.flange_from_scanner.pose::<(), ()>();
        assert!(apart.isometry().translation.vector.norm() < 1e-9 && apart.isometry().rotation.angle() < 1e-9);
        assert_eq!(Presets.names(SpecKind::Cell).len(), 1);
    }

    #[test]
    fn each_face_has_the_flange_outside_it_and_its_axis_into_it() {
        let housing = Aabb { min: nalgebra::Point3::new(-150.0, -65.0, -110.0), max: nalgebra::Point3::new(150.0, 65.0, 0.0) };
        for (face, flange_mm, into) in [
            (HousingFace::Back, [0.0, 0.0, -140.0], [0.0, 0.0, 1.0]),
            (HousingFace::Top, [0.0, -95.0, -55.0], [0.0, 1.0, 0.0]),
            (HousingFace::Bottom, [0.0, 95.0, -55.0], [0.0, -1.0, 0.0]),
            (HousingFace::Left, [-180.0, 0.0, -55.0], [1.0, 0.0, 0.0]),
            (HousingFace::Right, [180.0, 0.0, -55.0], [-1.0, 0.0, 0.0]),
        ] {
            let scanner_from_flange = face.flange_from_scanner(&housing, 30.0).inverse();
            let (origin, axis) = (scanner_from_flange.origin_mm(), scanner_from_flange.direction(&nalgebra::Vector3::z()));
            assert!((origin - nalgebra::Point3::from(flange_mm)).norm() < 1e-9, "{face:?}: {origin}");
            assert!((axis - nalgebra::Vector3::from(into)).norm() < 1e-9, "{face:?}: {axis}");
        }
    }

    #[test]
    fn a_plate_beyond_the_arm_is_refused_with_the_distance_and_the_reach() {
        let errors = built(&CellDistances { table_at_mm: [2900.0, 0.0, 100.0], ..distances() }).expect_err("out of reach");
        assert!(
            errors.iter().any(|error| error.starts_with("/base_from_table: puts all of the plate at least 26")),
            "{errors:?}"
        );
        assert!(errors.iter().all(|error| error.contains("reach") || error.contains("/home_deg")), "{errors:?}");
    }

    #[test]
    fn metres_are_refused_at_the_option_that_has_them() {
        let metres = CellDistances { table_at_mm: [0.9, 0.0, 0.1], ..distances() };
        let errors = metres.spec(&Presets).expect_err("in the foot");
        let [error] = &errors[..] else { panic!("{errors:?}") };
        assert_eq!(error.pointer, "--table-at");
        assert!(error.detail.contains("inside the robot's foot") && error.detail.contains("900,0,100"), "{error}");
    }

    #[test]
    fn a_fault_of_the_cell_is_told_at_what_its_user_gave() {
        // The plate around the robot's foot: no home is free, and none was given.
        let around = CellDistances { table_at_mm: [60.0, 0.0, 20.0], ..distances() };
        let spec = around.spec(&Presets).expect("in range");
        let errors = around.blamed(spec.build(&Presets).expect_err("it collides"), &Presets);
        assert!(errors.iter().all(|error| error.pointer.starts_with("--")), "{errors:?}");
        let home = errors.iter().find(|error| error.pointer == "--table-at").expect("blamed");
        assert!(home.detail.contains("no collision-free home") && home.detail.contains("collides: "), "{home}");
        // A home that was given is to blame itself.
        let given = CellDistances { home_deg: Some([0.0; 7]), ..around };
        let errors = given.blamed(given.spec(&Presets).expect("in range").build(&Presets).expect_err("it collides"), &Presets);
        assert!(errors.iter().any(|error| error.pointer == "--home"), "{errors:?}");
    }

    /// The scanner was blamed, whose mass nobody had given.
    #[test]
    fn an_adapter_that_is_too_heavy_is_blamed_itself_and_not_the_scanner() {
        let heavy = CellDistances { adapter_kg: 20.0, ..distances() };
        let errors = heavy.spec(&Presets).expect("in range").build(&Presets).expect_err("more than the payload");
        let told: Vec<String> = heavy.blamed(errors, &Presets).iter().map(ToString::to_string).collect();
        let of_mass = told.iter().find(|error| error.starts_with("--adapter-mass: is 20 kg, too much beside the scanner"));
        assert!(of_mass.is_some_and(|error| error.contains("its mount 20 kg, more than the robot's payload")), "{told:?}");
        assert!(!told.iter().any(|error| error.starts_with("--scanner")), "{told:?}");
    }

    #[test]
    fn distances_out_of_range_are_named_by_their_option() {
        type Change = fn(&mut CellDistances);
        let cases: [(&str, Change); 9] = [
            ("--name", |d| d.name.clear()),
            ("--floor", |d| d.table_at_mm[2] = -700.0),
            ("--table-at", |d| d.table_at_mm[2] = 20_000.0),
            ("--table-yaw", |d| d.table_yaw_deg = 400.0),
            ("--adapter", |d| d.adapter_mm = -1.0),
            ("--floor", |d| d.floor_mm = Some(f64::NAN)),
            ("--floor", |d| d.floor_mm = Some(700.0)),
            ("--pedestal", |d| d.floor_mm = None),
            ("--scanner", |d| d.scanner = "nobody".into()),
        ];
        for (option, change) in cases {
            let mut changed = distances();
            change(&mut changed);
            let errors = changed.spec(&Presets).expect_err(option);
            assert!(errors.iter().any(|error| error.pointer == option), "{option}: {errors:?}");
        }
        let robot = CellDistances { robot: "nobody".into(), ..distances() }.spec(&Presets).expect_err("no such robot");
        assert!(robot[0].to_string().contains("ur10e"), "{robot:?}");
    }
}
