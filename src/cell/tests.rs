use std::sync::Arc;

use super::{
    Axes, AxisSpec, Cell, CellSpec, Configuration, FieldError, MAX_MESH_BODIES, MAX_TRIANGLES, Named, NotFound, Presets,
    RobotSpec, RotationSpec, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec, preset_text,
};
use crate::geometry::Mesh;
use crate::testing::box_mesh;

fn cell_spec() -> CellSpec {
    Presets.cell("e05-transcan").expect("preset parses")
}

fn findings(spec: &CellSpec) -> Vec<FieldError> {
    spec.build(&Presets).map(|cell: Cell| cell.name).expect_err("must be refused")
}

fn assert_finding(errors: &[FieldError], pointer: &str, words: &str) {
    assert!(
        errors.iter().any(|e| e.pointer == pointer && e.detail.contains(words)),
        "no {pointer:?} with {words:?} in {errors:#?}"
    );
}

#[test]
fn every_preset_parses_builds_and_carries_its_file_name() {
    for name in Presets.names(SpecKind::Scanner) {
        assert_eq!(Presets.scanner(&name).expect("parses").build().expect("builds").name, name);
    }
    for name in Presets.names(SpecKind::Robot) {
        assert_eq!(Presets.robot(&name).expect("parses").build().expect("builds").name, name);
    }
    for name in Presets.names(SpecKind::Turntable) {
        assert_eq!(Presets.turntable(&name).expect("parses").build().expect("builds").name, name);
    }
    for name in Presets.names(SpecKind::Cell) {
        let cell = Presets.cell(&name).expect("parses").build(&Presets);
        assert_eq!(cell.unwrap_or_else(|errors| panic!("{errors:#?}")).name, name);
    }
    assert!(preset_text(SpecKind::Robot, "none").is_none());
}

#[test]
fn specs_survive_json_and_toml() {
    let spec = cell_spec();
    let json = serde_json::to_string(&spec).expect("writes");
    assert_eq!(serde_json::from_str::<CellSpec>(&json).expect("reads"), spec);
    let robot = Presets.robot("hans-e05").expect("preset");
    let toml = toml::to_string(&robot).expect("writes");
    assert_eq!(toml::from_str::<RobotSpec>(&toml).expect("reads"), robot);
}

#[test]
fn default_robot_is_at_most_as_wide_and_fast_as_the_thesis() {
    let tight = Presets.robot("hans-e05").expect("preset").build().expect("builds");
    let wide = Presets.robot("hans-e05-thesis").expect("preset").build().expect("builds");
    for (a, b) in tight.joints.iter().zip(&wide.joints) {
        assert!(a.min_rad >= b.min_rad && a.max_rad <= b.max_rad && a.max_speed_rad_per_s <= b.max_speed_rad_per_s);
    }
    assert_eq!(tight.kinematics, wide.kinematics);
}

#[test]
fn unknown_names_list_the_known_ones() {
    let mut spec = cell_spec();
    spec.robot = Named::Name("hans-e5".into());
    assert_finding(&findings(&spec), "/robot", "hans-e05, hans-e05-thesis");
    spec.obstacles =
        vec![toml::from_str("name = \"column\"\nshape = { kind = \"mesh\", mesh = \"column.stl\" }").expect("body parses")];
    assert_finding(&findings(&spec), "/obstacles/0/shape/mesh", "\"column.stl\"");
}

/// Presets, and a cube under any name; counts how often it is asked for one.
struct Cubes {
    asked: std::cell::Cell<usize>,
    triangles: usize,
}

impl SpecLibrary for Cubes {
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
        self.asked.set(self.asked.get() + 1);
        let mut cube = box_mesh([0.0; 3], [1.0; 3]);
        cube.faces = cube.faces.into_iter().cycle().take(self.triangles).collect();
        Ok(Arc::new(cube))
    }

    fn names(&self, _: SpecKind) -> Vec<String> {
        Vec::new()
    }
}

/// The preset with so many obstacles far away, of the meshes that `name` gives.
fn with_mesh_obstacles(count: usize, name: impl Fn(usize) -> String) -> CellSpec {
    let obstacle = |index: usize| {
        let text = format!(
            "name = \"o\"\nowner_from_body = {{ translation_mm = [9000.0, 0.0, 0.0], quaternion_xyzw = [0.0, 0.0, 0.0, 1.0] }}\nshape = {{ kind = \"mesh\", mesh = {:?} }}",
            name(index)
        );
        toml::from_str(&text).unwrap_or_else(|error| panic!("{error}"))
    };
    CellSpec { obstacles: (0..count).map(obstacle).collect(), ..cell_spec() }
}

#[test]
fn a_mesh_that_many_bodies_name_is_read_once() {
    let library = Cubes { asked: std::cell::Cell::new(0), triangles: 12 };
    let spec = with_mesh_obstacles(MAX_MESH_BODIES, |index| format!("mesh {}", index % 3));
    let cell = spec.build(&library).unwrap_or_else(|errors| panic!("{errors:#?}"));
    assert_eq!((cell.obstacles.len(), cell.surfaces().len(), library.asked.get()), (MAX_MESH_BODIES, 3, 3));
}

#[test]
fn more_bodies_and_triangles_than_a_cell_may_have_are_refused_by_number() {
    let library = Cubes { asked: std::cell::Cell::new(0), triangles: 12 };
    let refused = |spec: &CellSpec, library: &Cubes| spec.build(library).map(|cell| cell.name).expect_err("must be refused");
    let errors = refused(&with_mesh_obstacles(1000, |_| "cube".into()), &library);
    assert_finding(&errors, "/obstacles/200/shape", "one of 1000 bodies that are meshes of the cell; allowed are 200");
    assert_eq!((errors.len(), library.asked.get()), (1, 0), "no mesh is read");
    let box_of = |_| toml::from_str("name = \"b\"\nshape = { kind = \"box\", size_mm = [1.0, 1.0, 1.0] }").expect("parses");
    let mut many = cell_spec();
    many.obstacles = (0..2000).map(box_of).collect();
    assert!(refused(&many, &library).iter().any(|error| error.detail.contains("bodies of the cell; allowed are 2000")));
    let heavy = Cubes { triangles: MAX_TRIANGLES / 3, ..library };
    let errors = refused(&with_mesh_obstacles(4, |index| index.to_string()), &heavy);
    assert_finding(&errors, "/obstacles/3/shape/mesh", "triangles; allowed are 5000000");
}

#[test]
fn what_links_carry_is_checked_with_its_field() {
    let body = |link: u8, shape: &str| toml::from_str(&format!("link = {link}\nname = \"it\"\nshape = {shape}")).expect("parses");
    let with = |surface: &str, cable: &str| {
        let mut robot = Presets.robot("hans-e05").expect("preset");
        robot.surfaces = vec![body(6, surface)];
        CellSpec { robot: Named::Inline(Box::new(robot)), cable: vec![body(3, cable)], ..cell_spec() }
    };
    let (small, ball) =
        ("{ kind = \"box\", size_mm = [20.0, 20.0, 20.0] }", "{ kind = \"capsule\", radius_mm = 9.0, length_mm = 1.0 }");
    let cell = with(small, ball).build(&Presets).unwrap_or_else(|errors| panic!("{errors:#?}"));
    assert_eq!((cell.link_surfaces[0].link, cell.cable[0].link), (6, 3));
    // The flange's capsule ends 29 mm ahead of it.
    let errors = findings(&with("{ kind = \"box\", size_mm = [20.0, 20.0, 80.0] }", ball));
    assert_finding(&errors, "/robot/surfaces/0", "no capsule of link 6 holds: it stands 12.");
    let missing = "{ kind = \"mesh\", mesh = \"hose.stl\" }";
    let errors = findings(&with(missing, missing));
    assert_finding(&errors, "/robot/surfaces/0/shape/mesh", "\"hose.stl\"");
    assert_finding(&errors, "/cable/0/shape/mesh", "\"hose.stl\"");
    let mut nowhere = with(small, ball);
    nowhere.cable[0].link = 7;
    assert_finding(&findings(&nowhere), "/cable/0/link", "7");
}

#[test]
fn an_inline_spec_keeps_its_own_error() {
    let mut json = serde_json::to_value(cell_spec()).expect("writes");
    json["turntable"] = serde_json::json!({"name": "t", "plate_diameter": 500.0});
    let error = serde_json::from_value::<CellSpec>(json).expect_err("must be refused").to_string();
    assert!(error.contains("plate_diameter"), "{error}");
}

#[test]
fn inconsistent_cells_are_refused_with_the_field() {
    let mut spec = cell_spec();
    spec.flange_from_scanner.quaternion_xyzw = [0.0, 0.0, 0.5, 1.0];
    assert_finding(&findings(&spec), "/flange_from_scanner/quaternion_xyzw", "norm");

    let mut spec = cell_spec();
    spec.home_deg[2] = 170.0;
    assert_finding(&findings(&spec), "/home_deg/2", "149.5");

    let mut spec = cell_spec();
    let mut robot = Presets.robot("hans-e05").expect("preset");
    robot.payload_kg = 2.0;
    spec.robot = Named::Inline(Box::new(robot.clone()));
    assert_finding(&findings(&spec), "/scanner", "payload");

    let mut heavy = cell_spec();
    heavy.mount_mass_kg = 2.4;
    assert_finding(&findings(&heavy), "/scanner", "2.7 kg and its mount 2.4 kg, more than the robot's payload of 5 kg");
    heavy.mount_mass_kg = 2.3;
    assert!(heavy.build(&Presets).is_ok(), "5 kg in all");

    // 2.7 kg, 120 mm from the flange's axis in its frame: 3.18 N·m in the worst posture.
    let mut long = cell_spec();
    let mut scanner = Presets.scanner("transcan-c").expect("preset");
    let flange_from_scanner = long.flange_from_scanner.pose::<crate::geometry::Flange, crate::geometry::ScannerFrame>();
    let centre = flange_from_scanner.inverse().point(&nalgebra::Point3::new(120.0, 0.0, 0.0));
    scanner.centre_of_mass_mm = Some(centre.into());
    long.scanner = Named::Inline(Box::new(scanner));
    let mut weak = Presets.robot("hans-e05").expect("preset");
    weak.max_flange_moment_nm = Some(3.0);
    long.robot = Named::Inline(Box::new(weak.clone()));
    assert_finding(&findings(&long), "/flange_from_scanner", "3.18 N·m on the flange, more than the 3 N·m");
    weak.max_flange_moment_nm = Some(3.2);
    long.robot = Named::Inline(Box::new(weak));
    assert!(long.build(&Presets).is_ok(), "3.2 N·m are enough");

    robot.joints[3] = AxisSpec { min_deg: 10.0, max_deg: -10.0, ..robot.joints[3] };
    robot.payload_kg = 5.0;
    spec.robot = Named::Inline(Box::new(robot));
    assert_finding(&findings(&spec), "/robot/joints/3/min_deg", "not below");

    let mut spec = cell_spec();
    let mut table = Presets.turntable("minas-a6-500").expect("preset");
    table.rotation = RotationSpec::Limited { min_deg: 10.0, max_deg: 10.0 };
    spec.turntable = Named::Inline(Box::new(table));
    let told = "is 10°, not below max_deg 10°; for a table that stands still, give a max_deg 0.001° above it";
    assert_finding(&findings(&spec), "/turntable/rotation/min_deg", told);
}

#[test]
fn a_home_in_collision_is_refused_and_names_the_pair() {
    let mut spec = cell_spec();
    // A wall right through the arm at home.
    spec.obstacles.push(
        toml::from_str("name = \"wall\"\nshape = { kind = \"box\", size_mm = [3000.0, 3000.0, 3000.0] }").expect("body parses"),
    );
    assert_finding(&findings(&spec), "/home_deg", "wall");
}

#[test]
fn a_continuous_table_plans_within_a_turn_each_way() {
    let mut table: TurntableSpec = Presets.turntable("minas-a6-500").expect("preset");
    table.rotation = RotationSpec::Continuous {};
    let axis = table.build().expect("builds").axis;
    assert_eq!((axis.min_rad, axis.max_rad), (-std::f64::consts::TAU, std::f64::consts::TAU));
    assert_eq!(axis.windings(1.0).count(), 2);
    assert_eq!(axis.windings(0.0).count(), 3);
}

#[test]
fn an_arm_with_more_windings_than_are_looked_at_is_refused() {
    let with_four_turns = |joints: usize| {
        let mut spec = Presets.robot("hans-e05").expect("preset");
        for (index, joint) in spec.joints.iter_mut().enumerate() {
            let limit_deg = if index < joints { 720.0 } else { 180.0 };
            (joint.min_deg, joint.max_deg) = (-limit_deg, limit_deg);
        }
        spec
    };
    assert_eq!(with_four_turns(4).build().expect("256 windings").joints.len(), 6);
    let found = with_four_turns(5).build().expect_err("1024 windings");
    assert_finding(&found, "/joints", "in 1024 windings");
    assert_finding(&found, "/joints", "allowed are 256");
    let spec = CellSpec { robot: Named::Inline(Box::new(with_four_turns(5))), ..cell_spec() };
    assert_finding(&findings(&spec), "/robot/joints", "in 1024 windings");
}

#[test]
fn move_time_is_the_trapezoid_of_the_slowest_axis() {
    let axis = AxisSpec { min_deg: -360.0, max_deg: 360.0, max_speed_deg_per_s: 90.0, max_acceleration_deg_per_s2: 180.0 };
    let axes = Axes([axis.build(); 7]);
    let to = |deg: f64| Configuration { joints_rad: [0.0, 0.0, deg.to_radians(), 0.0, 0.1, 0.0], table_rad: 0.0 };
    let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
    // 90° at 90°/s: 1 s of travel at full speed, and 0.5 s more for starting and stopping.
    assert!(near(axes.move_secs(&to(0.0), &to(90.0), 1.0), 1.5));
    // 20°: the top speed is never reached; 2·√(20/180).
    assert!(near(axes.move_secs(&to(0.0), &to(20.0), 1.0), 2.0 * (20.0_f64 / 180.0).sqrt()));
    assert!(near(axes.move_secs(&to(0.0), &to(90.0), 0.5), 90.0 / 45.0 + 45.0 / 90.0));
    assert_eq!(axes.move_secs(&to(30.0), &to(30.0), 1.0), 0.0);
    assert!(near(axes.path_secs(&[to(0.0), to(90.0), to(0.0)], 1.0), 3.0));
}

#[test]
fn a_value_that_should_be_an_object_is_refused_in_the_user_s_words() {
    fn refused<T: serde::de::DeserializeOwned>(text: &str) -> String {
        serde_json::from_str::<T>(text).err().map(|error| error.to_string()).unwrap_or_default()
    }
    let said = [
        refused::<super::ScannerSpec>(r#"{"depth_mm": 3}"#),
        refused::<RobotSpec>("3"),
        refused::<TurntableSpec>(r#"{"rotation": true}"#),
        refused::<CellSpec>("\"none\""),
        refused::<super::PoseSpec>("7"),
        refused::<super::BodySpec>(r#"{"shape": "box"}"#),
        refused::<AxisSpec>("3"),
        refused::<super::KinematicsSpec>(r#""opw""#),
        refused::<super::OpwSpec>("1.5"),
    ];
    for message in said {
        assert!(message.contains("expected an object"), "{message}");
    }
}

#[test]
fn a_home_in_radians_is_recognised_and_degrees_are_not() {
    let mut cell = cell_spec().build(&Presets).unwrap_or_else(|errors| panic!("{errors:#?}"));
    let mut read = |written: [f64; 7]| {
        cell.home_rad = Configuration::from_axes_rad(written.map(f64::to_radians));
        cell.home_in_radians().map(|home| home.axes_tenths_deg())
    };
    let in_degrees = [0.0, -30.0, 60.0, 0.0, 30.0, 0.0, 0.0];
    assert_eq!(read(in_degrees.map(f64::to_radians)), Some(in_degrees));
    assert_eq!(read([0.0, -1.57, 1.57, 0.0, 1.57, 0.0, 0.0]).map(|home| home[1]), Some(-90.0));
    for degrees in [in_degrees, [0.0; 7], [1.0, 2.0, 3.0, 0.0, 5.0, 0.0, 0.0], [0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]] {
        assert_eq!(read(degrees), None, "{degrees:?}");
    }
    assert_eq!(read([0.0, -1.57, 1.57, 0.0, 1.57, 0.0, 45.0]), None, "one of them is no angle in radians");
    assert_eq!(read([0.0, 0.1, 0.2, 0.0, 0.0, 0.0, 0.0]), None, "nearly zero either way");
}

#[test]
fn a_home_in_radians_that_collides_says_what_it_would_be_in_degrees() {
    let mut spec = cell_spec();
    // Stretched upwards as degrees; in radians past a wall.
    spec.obstacles.push(
        toml::from_str(
            "name = \"ceiling\"\nowner_from_body = { translation_mm = [0.0, 0.0, 900.0], rpy_deg = [0, 0, 0] }\n\
             shape = { kind = \"box\", size_mm = [3000.0, 3000.0, 100.0] }",
        )
        .expect("a body"),
    );
    spec.home_deg = [0.0, -0.52, 1.05, 0.0, 0.52, 0.0, 0.0];
    assert_finding(&findings(&spec), "/home_deg", "is home in radians? In degrees it would be [0.0, -29.8, 60.2,");
}

#[test]
fn joint_limits_in_radians_are_blamed_themselves_and_not_home() {
    let mut robot = Presets.robot("hans-e05").expect("a preset");
    for joint in &mut robot.joints {
        (joint.min_deg, joint.max_deg) = (-6.2, 6.2);
    }
    let spec = CellSpec { robot: Named::Inline(Box::new(robot)), ..cell_spec() };
    let found = findings(&spec);
    assert_finding(&found, "/robot/joints/1", "are min_deg and max_deg in radians? In degrees they would be -355.2 and 355.2");
    assert!(found.iter().all(|finding| !finding.pointer.starts_with("/home_deg")), "{found:#?}");
}

#[test]
fn a_home_that_collides_since_the_table_is_in_metres_says_so() {
    let mut spec = cell_spec();
    spec.base_from_table.translation_mm = [0.4, 0.0, -0.2];
    // Around the arm, so that home collides whatever the table does.
    spec.obstacles.push(
        toml::from_str(
            "name = \"block\"\nowner_from_body = { translation_mm = [0.0, 0.0, 500.0], rpy_deg = [0, 0, 0] }\n\
             shape = { kind = \"box\", size_mm = [600.0, 600.0, 1000.0] }",
        )
        .expect("a body"),
    );
    assert_finding(
        &findings(&spec),
        "/home_deg",
        "is base_from_table in metres? In mm its translation would be [400.0, 0.0, -200.0]",
    );
}

#[test]
fn a_table_out_of_reach_is_refused_and_one_at_the_edge_is_not() {
    let mut spec = cell_spec();
    spec.base_from_table.translation_mm = [2900.0, 0.0, -200.0];
    assert_finding(&findings(&spec), "/base_from_table", "out of reach");
    spec.base_from_table.translation_mm = [0.0, 0.0, -4000.0];
    spec.floor_mm = None;
    assert_finding(&findings(&spec), "/base_from_table", "move the table nearer");
    spec.base_from_table.translation_mm = [900.0, 0.0, -200.0];
    let cell = spec.build(&Presets).unwrap_or_else(|errors| panic!("{errors:#?}"));
    let (nearest_mm, reach_mm) = cell.plate_distance_mm();
    assert!(nearest_mm < reach_mm && cell.plate_centre_distance_mm().0 > nearest_mm);
}

/// The bound of the reach is one: no posture, at its limits or within, has the flange farther from the shoulder.
#[test]
fn no_posture_reaches_beyond_the_stretched_arm() {
    for name in Presets.names(SpecKind::Robot) {
        let robot = Presets.robot(&name).expect("a preset").build().expect("valid");
        let (shoulder, reach_mm) = robot.max_reach_mm();
        let mut farthest = 0.0_f64;
        for step in 0..2000_u32 {
            let share = |joint: usize| (f64::from(step + 1) * [0.618, 0.414, 0.732, 0.236, 0.317, 0.873][joint]).fract();
            let joints_rad = std::array::from_fn(|joint| {
                let axis = robot.joints[joint];
                axis.min_rad + share(joint) * (axis.max_rad - axis.min_rad)
            });
            farthest = farthest.max((robot.base_from_flange(&joints_rad).origin_mm() - shoulder).norm());
        }
        assert!(farthest <= reach_mm + 1e-6, "{name}: {farthest} beyond {reach_mm}");
        assert!(farthest > 0.6 * reach_mm, "{name}: {farthest} of {reach_mm}: the bound says nothing");
    }
}
