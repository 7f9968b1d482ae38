use nalgebra::{Isometry3, Point3, Vector2, Vector3};

use super::capsules::{around, smallest_circle};
use super::{Imported, UrdfError, UrdfOptions, import};
use crate::cell::Dialect;
use crate::geometry::Mesh;
use crate::testing::arm_urdf;

fn options() -> UrdfOptions {
    UrdfOptions { name: None, base_link: None, tip_link: None, payload_kg: 5.0, ramp_secs: 0.5 }
}

fn no_mesh(name: &str) -> Result<Mesh, String> {
    Err(format!("no mesh {name}"))
}

#[test]
fn a_urdf_gives_joints_limits_and_capsules_in_millimetres() {
    let spec = import(&arm_urdf("continuous"), &options(), &mut no_mesh).expect("a robot").robot;
    let robot = spec.build().expect("a sound one");
    assert_eq!((spec.name.as_str(), spec.links.len(), robot.joints[5].max_rad), ("six", 6, std::f64::consts::TAU));
    assert!((robot.joints[0].max_speed_rad_per_s - 1.5).abs() < 1e-12);
    assert!((robot.joints[0].max_acceleration_rad_per_s2 - 3.0).abs() < 1e-12);
    // The stand below base_link is no part of the arm.
    let frames = robot.link_frames(&[0.0; 6]);
    assert!((frames[6].translation.vector.z - 1100.0).abs() < 1e-9, "{}", frames[6]);
    // A cylinder of radius 40 and length 100 lies in a capsule that is little wider; all of it is in its link's frame.
    for link in &robot.links {
        // The last is given in the frame of the flange, 30 mm ahead of its own.
        let ahead = if link.link == 6 { 30.0 } else { 0.0 };
        let deepest = link.from_mm.z.min(link.to_mm.z) - link.radius_mm + ahead;
        assert!(link.radius_mm > 40.0 && link.radius_mm < 75.0 && deepest <= 0.0 && deepest > -42.0, "{link:?}");
    }
    // Axes 4 and 6 are in line and 5 crosses them: an ortho-parallel arm.
    assert_eq!(robot.kinematics.ik_solutions(&robot.base_from_flange(&[0.1, 0.3, 0.5, 0.2, 0.7, -0.4])).len(), 8);
}

#[test]
fn what_is_no_arm_is_refused_by_name() {
    let refused = |text: &str, options: &UrdfOptions| import(text, options, &mut no_mesh).expect_err("refused").to_string();
    let told = refused("<robot", &options());
    assert!(told.contains("is not a URDF file"), "{told}");
    let told = refused("<sdf version=\"1.9\"><model name=\"a\"/></sdf>", &options());
    assert!(told.contains("line 1: <sdf> is not <robot>"), "{told}");
    let told = refused(&arm_urdf("fixed"), &options());
    assert!(told.contains("six turning joints from \"base_link\"") && told.contains("tool0"), "{told}");
    let told = refused(&arm_urdf("prismatic"), &UrdfOptions { tip_link: Some("tool0".into()), ..options() });
    assert!(told.contains("joint_6") && told.contains("prismatic"), "{told}");
    let told = refused(&arm_urdf("revolute"), &UrdfOptions { tip_link: Some("hand".into()), ..options() });
    assert!(told.starts_with("has no link \"hand\"; its links are [\"world\", \"base_link\", "), "{told}");
    assert!(told.ends_with("\"tool0\"]: name one of them with --base or --tip"), "{told}");
    let told = refused(&arm_urdf("revolute").replace("velocity=\"1.5\"", "velocity=\"0\""), &options());
    assert!(told.contains("the speed 0"), "{told}");
    let meshed =
        arm_urdf("revolute").replace("<cylinder radius=\"0.04\" length=\"0.1\"/>", "<mesh filename=\"package://x/a.stl\"/>");
    assert!(matches!(import(&meshed, &options(), &mut no_mesh), Err(UrdfError::Mesh { .. })));
    let circle = "<robot name=\"o\"><link name=\"a\"/><link name=\"b\"/>\
        <joint name=\"1\" type=\"fixed\"><parent link=\"a\"/><child link=\"b\"/></joint>\
        <joint name=\"2\" type=\"fixed\"><parent link=\"b\"/><child link=\"a\"/></joint></robot>";
    refused(circle, &options());
}

/// The file with a link on `parent`, by a joint of a kind and an origin.
fn with_link(text: &str, link: &str, parent: &str, kind: &str, origin: &str) -> String {
    let joint = format!(
        "<joint name=\"to_{link}\" type=\"{kind}\"><parent link=\"{parent}\"/><child link=\"{link}\"/><origin {origin}/>\
         <axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" velocity=\"1\" effort=\"0\"/></joint></robot>"
    );
    text.replace("</robot>", &joint)
}

const BOX: &str = "<geometry><box size=\"0.1 0.1 0.1\"/></geometry>";

/// A forearm that has a visual shape alone was left out in silence.
#[test]
fn bodies_that_are_left_out_are_told_with_the_reason() {
    assert_eq!(import(&arm_urdf("revolute"), &options(), &mut no_mesh).expect("a robot").remarks, [], "frames have no body");
    let shape = "<geometry><cylinder radius=\"0.04\" length=\"0.1\"/></geometry>";
    let of_link_3 = format!("<link name=\"link_3\"><collision><origin xyz=\"0 0 0.05\"/>{shape}</collision>");
    let text = arm_urdf("revolute");
    assert!(text.contains(&of_link_3));
    let text = text.replace(&of_link_3, &format!("<link name=\"link_3\"><visual>{shape}</visual>"));
    let text = with_link(&text, "finger", "tool0", "prismatic", "xyz=\"0 0 0\"");
    let body = |name: &str| format!("<link name=\"{name}\"><collision>{BOX}</collision></link>");
    let bodies = format!("{}{}</robot>", body("finger"), body("pillar"));
    let text = with_link(&text, "pillar", "world", "fixed", "xyz=\"1 0 0\"").replace("</robot>", &bodies);
    let imported = import(&text, &options(), &mut no_mesh).expect("a robot");
    let told: Vec<&str> = imported.remarks.iter().map(|remark| remark.detail.as_str()).collect();
    assert_eq!(told.len(), 3, "{told:?}");
    assert!(told[0].contains("\"link_3\", which has no collision shape"), "{told:?}");
    assert!(told[1].contains("\"finger\", which moves by joint \"to_finger\""), "{told:?}");
    assert!(told[2].contains("\"pillar\", which does not hang on \"base_link\""), "{told:?}");
    assert!(imported.robot.links.iter().all(|link| link.link != 3));
}

/// Base as UR has it: `base`, the controller's, is a mark on `base_link`, turned half round. Who names either has chosen.
#[test]
fn a_base_that_is_fixed_to_the_arm_s_is_one_and_a_turn_between_both_is_told_where_none_is_named() {
    let text = arm_urdf("revolute").replace("</robot>", "<link name=\"base\"/></robot>");
    let text = with_link(&text, "base", "base_link", "fixed", "xyz=\"0 0 0\" rpy=\"0 0 3.141592653589793\"");
    let at = |base: Option<&str>| {
        let options = UrdfOptions { base_link: base.map(str::to_owned), ..options() };
        import(&text, &options, &mut no_mesh).expect("a robot")
    };
    let [preset, turned, chosen] = [None, Some("base"), Some("base_link")].map(at);
    let [remark] = &preset.remarks[..] else { panic!("one remark: {:?}", preset.remarks) };
    assert_eq!(remark.detail, "base \"base_link\" is turned against the controller's, the file's link \"base\", by 180° about z");
    assert!(remark.remedy.contains("--base base,") && remark.remedy.contains("--base base_link"), "{remark:?}");
    assert!(turned.remarks.is_empty() && chosen.remarks.is_empty(), "{:?} {:?}", turned.remarks, chosen.remarks);
    let joints = [0.3, -0.4, 0.9, 0.2, 0.7, -0.5];
    let [seen, expected] = [&turned, &preset].map(|each| each.robot.build().expect("a sound one").link_frames(&joints));
    let half_turn = Isometry3::rotation(Vector3::z() * std::f64::consts::PI);
    for (seen, expected) in seen.iter().zip(&expected).skip(1) {
        let apart = seen.inv_mul(&(half_turn * expected));
        assert!(apart.translation.vector.norm() < 1e-9 && apart.rotation.angle() < 1e-9, "{seen} {expected}");
    }
    // The shapes move with the same joints.
    let links = |imported: &Imported| imported.surfaces.iter().map(|surface| surface.link).collect::<Vec<_>>();
    assert_eq!((links(&turned), turned.surfaces.len()), (links(&preset), 6));
}

/// Details of the remarks on a robot.
fn told(imported: &Imported) -> Vec<&str> {
    imported.remarks.iter().map(|remark| remark.detail.as_str()).collect()
}

/// A RAPID program for an IRB 2400 from its URDF was wrong by joint 2, without a word.
#[test]
fn joint_3_of_an_abb_arm_is_remarked_on_once_by_its_name_or_its_language() {
    let read = |name: &str| {
        let text = arm_urdf("revolute").replace("<robot name=\"six\">", &format!("<robot name=\"{name}\">"));
        import(&text, &options(), &mut no_mesh).expect("a robot")
    };
    for name in ["abb_irb2400", "IRB4400", "my ABB"] {
        let mut named = read(name);
        named.set_dialect(Some(Dialect::Rapid));
        let told = told(&named);
        assert!(told.len() == 1 && told[0].contains("counts joint 3 from the upper arm"), "{name}: {told:?}");
        assert!(named.remarks[0].remedy.contains("joint_3_from_ground = true"), "{:?}", named.remarks);
    }
    let mut other = read("crabbot");
    assert!(other.remarks.is_empty(), "{:?}", other.remarks);
    other.set_dialect(Some(Dialect::Urscript));
    assert!(other.remarks.is_empty() && other.robot.dialect == Some(Dialect::Urscript), "{:?}", other.remarks);
    other.set_dialect(Some(Dialect::Rapid));
    assert_eq!(told(&other).len(), 1, "{:?}", other.remarks);
}

/// The file with an element inside joint 3.
fn with_in_joint_3(element: &str) -> String {
    let start = "<joint name=\"joint_3\" type=\"revolute\">";
    let text = arm_urdf("revolute");
    assert!(text.contains(start));
    text.replace(start, &format!("{start}{element}"))
}

#[test]
fn a_joint_of_the_arm_that_follows_another_is_refused_by_name() {
    let text = with_in_joint_3("<mimic joint=\"joint_2\" multiplier=\"-1\"/>");
    let error = import(&text, &options(), &mut no_mesh).expect_err("refused");
    assert!(matches!(error, UrdfError::Mimic { .. }), "{error}");
    let told = error.to_string();
    assert!(told.contains("\"joint_3\"") && told.contains("follows joint \"joint_2\" (mimic)"), "{told}");
}

#[test]
fn soft_limits_narrow_a_joint_and_are_told() {
    let read = |limits: &str| {
        let text = with_in_joint_3(&format!("<safety_controller {limits} k_position=\"20\" k_velocity=\"10\"/>"));
        import(&text, &options(), &mut no_mesh)
    };
    // The joint's own are -2 to 2.5 rad.
    for (limits, [min_rad, max_rad], remarks) in [
        ("soft_lower_limit=\"-1\" soft_upper_limit=\"1.5\"", [-1.0, 1.5], 1),
        ("soft_lower_limit=\"-3\" soft_upper_limit=\"1.5\"", [-2.0, 1.5], 1),
        ("soft_lower_limit=\"-3\" soft_upper_limit=\"3\"", [-2.0, 2.5], 0),
        ("soft_lower_limit=\"0\" soft_upper_limit=\"0\"", [-2.0, 2.5], 0),
        ("", [-2.0, 2.5], 0),
    ] {
        let imported = read(limits).expect("a robot");
        let joint = &imported.robot.joints[2];
        let off_rad = [joint.min_deg.to_radians() - min_rad, joint.max_deg.to_radians() - max_rad];
        assert!(off_rad.iter().all(|off| off.abs() < 1e-9), "{limits}: {joint:?}");
        assert_eq!(told(&imported).len(), remarks, "{limits}: {:?}", imported.remarks);
        assert!(imported.remarks.iter().all(|remark| remark.detail.contains("\"joint_3\"")), "{:?}", imported.remarks);
    }
    let refused = read("soft_lower_limit=\"3\" soft_upper_limit=\"4\"").expect_err("no range").to_string();
    assert!(refused.contains("\"joint_3\" has the soft limits 3 to 4 rad"), "{refused}");
}

/// A lower limit that is left out was told as the upper one, and an upper one that is left out was passed on as infinite.
#[test]
fn a_limit_that_a_joint_lacks_is_told_by_its_name() {
    for (left_out, told) in [("lower=\"-2\" ", "the lower limit -inf"), ("upper=\"2.5\" ", "the upper limit inf")] {
        let text = arm_urdf("revolute").replacen("<robot", "<robot version=\"1.2\"", 1).replacen(left_out, "", 1);
        let error = import(&text, &options(), &mut no_mesh).expect_err("refused").to_string();
        assert!(error.contains("\"joint_1\"") && error.contains(told), "{error}");
    }
}

/// `tool0` of some public files has z square to axis 6.
#[test]
fn a_flange_whose_z_is_off_axis_6_is_told() {
    let read = |rpy: &str| {
        let at = "<origin xyz=\"0 0 0.03\"/>";
        let text = arm_urdf("revolute").replace(at, &format!("<origin xyz=\"0 0 0.03\" rpy=\"{rpy}\"/>"));
        import(&text, &options(), &mut no_mesh).expect("a robot")
    };
    let square = read("0 1.5707963267948966 0");
    let [remark] = &square.remarks[..] else { panic!("one remark: {:?}", square.remarks) };
    assert!(remark.detail.contains("\"tool0\" is 90.0° off axis 6 (joint \"joint_6\")"), "{remark:?}");
    assert!(remark.remedy.contains("--tip"), "{remark:?}");
    for along in ["0 0 1.2", "3.141592653589793 0 0"] {
        assert!(read(along).remarks.is_empty(), "{along}");
    }
}

/// The first of several ends was taken as the flange without a word, and a hand-eye calibration to another one was off by as much.
#[test]
fn a_flange_that_no_name_tells_is_told_with_the_other_links_that_move_with_it() {
    let text = arm_urdf("revolute").replace("tool0", "hand");
    let text = with_link(&text, "camera", "link_6", "fixed", "xyz=\"0 0 0.03\" rpy=\"0 0 1.5707963267948966\"");
    let text = with_link(&text, "same", "hand", "fixed", "xyz=\"0 0 0\"");
    let text = text.replace("</robot>", "<link name=\"camera\"/><link name=\"same\"/></robot>");
    let read = |text: &str, tip: Option<&str>| {
        let options = UrdfOptions { tip_link: tip.map(str::to_owned), ..options() };
        import(text, &options, &mut no_mesh).expect("a robot")
    };
    let found = read(&text, None);
    assert_eq!((found.base_link.as_str(), found.flange_link.as_str()), ("base_link", "camera"));
    let [remark] = &found.remarks[..] else { panic!("one remark: {:?}", found.remarks) };
    let others =
        "\"link_6\" (30.0 mm away, turned by -90° about z), \"hand\" (turned by -90° about z), \"same\" (turned by -90° about z)";
    assert_eq!(remark.detail, format!("takes link \"camera\" as the flange; other links move with it: {others}"));
    assert!(remark.remedy.contains("--tip link_6;") && remark.remedy.contains("--tip camera"), "{remark:?}");
    assert_eq!(read(&text, Some("camera")).remarks, [], "who names the flange has chosen");
    let named = read(&text.replace("camera", "tool0"), None);
    assert_eq!((named.flange_link.as_str(), &named.remarks[..]), ("tool0", &[][..]));
}

/// The links of the second arm were told as ones that move with the flange of the first.
#[test]
fn links_of_another_arm_on_the_same_base_are_none_that_move_with_the_flange() {
    let text = arm_urdf("revolute").replace("tool0", "hand");
    let (_, other) = text.split_once("</joint>").expect("the stand's joint");
    let other = other.replace("link_", "left_").replace("joint_", "left_joint_").replace("hand", "left_hand");
    let both = text.replace("</robot>", &other.replace("\"end\"", "\"left_end\""));
    let found = import(&both, &options(), &mut no_mesh).expect("a robot");
    let told: Vec<_> = found.remarks.iter().filter(|remark| remark.detail.starts_with("takes link")).collect();
    let [remark] = &told[..] else { panic!("one remark: {:?}", found.remarks) };
    let detail = "takes link \"hand\" as the flange; other links move with it: \"link_6\" (30.0 mm away)";
    assert_eq!((found.flange_link.as_str(), remark.detail.as_str()), ("hand", detail));
}

#[test]
fn a_flange_that_the_base_does_not_carry_is_told_so() {
    let options = UrdfOptions { base_link: Some("link_3".into()), tip_link: Some("link_2".into()), ..options() };
    let told = import(&arm_urdf("revolute"), &options, &mut no_mesh).expect_err("refused").to_string();
    assert!(told.contains("\"link_2\" does not hang on \"link_3\""), "{told}");
}

#[test]
fn surfaces_of_simple_shapes_are_closed_around_them_and_lie_in_their_capsules() {
    let shapes = [
        // Volumes by hand; those of what is round are of the polyhedra around them, at most a few percent more.
        ("<box size=\"0.1 0.2 0.3\"/>", 6.0e6, 1.0),
        ("<cylinder radius=\"0.04\" length=\"0.1\"/>", 502_654.8, 1.02),
        ("<sphere radius=\"0.05\"/>", 523_598.8, 1.04),
        ("<capsule radius=\"0.05\" length=\"0.2\"/>", 2_094_395.1, 1.04),
    ];
    for (shape, volume_mm3, most) in shapes {
        let text = arm_urdf("revolute").replace("<cylinder radius=\"0.04\" length=\"0.1\"/>", shape);
        let imported = import(&text, &options(), &mut no_mesh).expect("a robot");
        assert_eq!(imported.surfaces.len(), 6, "{shape}");
        for surface in &imported.surfaces {
            let mesh = &surface.mesh;
            let edges = |flip: bool| {
                let corners = |face: &[u32; 3]| [0, 1, 2].map(|i| (face[i], face[(i + 1) % 3]));
                let mut edges: Vec<_> = mesh.faces.iter().flat_map(corners).collect();
                edges.iter_mut().filter(|_| flip).for_each(|(a, b)| std::mem::swap(a, b));
                edges.sort_unstable();
                edges
            };
            assert_eq!(edges(false), edges(true), "{shape} is closed, and all of one side is out");
            let volume = |face: usize| {
                let [a, b, c] = mesh.corners(face).map(|corner| corner.coords);
                a.dot(&b.cross(&c)) / 6.0
            };
            let found = (0..mesh.faces.len()).map(volume).sum::<f64>() / volume_mm3;
            assert!((1.0 - 1e-9..most + 1e-9).contains(&found), "{shape}: {found} of its volume");
            let robot = imported.robot.build().expect("a sound one");
            let held = |face: usize| {
                let own = robot.links.iter().filter(|capsule| capsule.link == usize::from(surface.link));
                own.filter(|capsule| mesh.corners(face).iter().all(|corner| capsule.outside_mm(corner) <= 0.0)).count() > 0
            };
            assert!((0..mesh.faces.len()).all(held), "{shape}");
        }
    }
}

#[test]
fn capsules_hold_every_corner_and_save_what_a_split_can_save() {
    // An elbow: two bars at a right angle.
    let bar = |along: usize, from: f64, to: f64| {
        let mut triangles = Vec::new();
        for step in 0..20 {
            let at = |t: f64, y: f64, z: f64| {
                let mut p = [y, y, y];
                p[along] = from + (to - from) * t;
                p[(along + 1) % 3] = y;
                p[(along + 2) % 3] = z;
                Point3::from(p)
            };
            let [a, b] = [f64::from(step) / 20.0, f64::from(step + 1) / 20.0];
            for (y, z) in [(-10.0, -10.0), (-10.0, 10.0), (10.0, -10.0), (10.0, 10.0)] {
                triangles.push([at(a, y, z), at(b, y, z), at(a, -y, z)]);
            }
        }
        triangles
    };
    let elbow = [bar(0, 0.0, 300.0), bar(1, 0.0, 300.0)].concat();
    let capsules = around(&elbow);
    assert!(capsules.len() >= 2 && capsules.len() <= 4, "{capsules:?}");
    assert!(capsules.iter().all(|capsule| capsule.radius_mm < 60.0), "{capsules:?}");
    let holds = |p: &Point3<f64>| {
        capsules.iter().any(|capsule| {
            let (along, out) = (capsule.to_mm - capsule.from_mm, p - capsule.from_mm);
            let t = (out.dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
            (out - along * t).norm() <= capsule.radius_mm
        })
    };
    assert!(elbow.iter().flatten().all(holds));
    assert!(around(&[]).is_empty());
}

#[test]
fn the_smallest_circle_is_that_of_closed_forms_and_of_every_triple() {
    let seen = |points: &[(f64, f64)]| points.iter().map(|(x, y)| (Vector2::new(*x, *y), 0.0)).collect::<Vec<_>>();
    let is_around = |points: &[(f64, f64)], expected: [f64; 2], expected_radius: f64| {
        let (centre, radius) = smallest_circle(&seen(points));
        assert!((centre - Vector2::from(expected)).norm() < 1e-9 && (radius - expected_radius).abs() < 1e-9, "{centre} {radius}");
    };
    is_around(&[(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (1.0, 0.3)], [1.0, 1.0], 2f64.sqrt());
    is_around(&[(-5.0, 0.0), (5.0, 0.0), (1.0, 0.5)], [0.0, 0.0], 5.0);
    // An equilateral triangle of side 6.
    is_around(&[(0.0, 0.0), (6.0, 0.0), (3.0, 27f64.sqrt())], [3.0, 3f64.sqrt()], 12f64.sqrt());
    is_around(&[(4.0, 4.0)], [4.0, 4.0], 0.0);
    is_around(&[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (4.0, 0.0)], [2.0, 0.0], 2.0);
    // A spiral: no circle through two or three of its points that holds all is smaller.
    let spiral: Vec<(f64, f64)> =
        (1..40).map(f64::from).map(|t| (t.sqrt() * (2.4 * t).cos(), t.sqrt() * (2.4 * t).sin())).collect();
    let points = seen(&spiral);
    let (_, radius) = smallest_circle(&points);
    for (i, (a, _)) in points.iter().enumerate() {
        for (j, (b, _)) in points.iter().enumerate().skip(i + 1) {
            let centres = [0.5 * (a + b)].into_iter().chain(points.iter().skip(j + 1).filter_map(|(c, _)| {
                let (ab, ac) = (b - a, c - a);
                let centre = nalgebra::Matrix2::from_rows(&[ab.transpose(), ac.transpose()]).try_inverse()?
                    * Vector2::new(ab.norm_squared(), ac.norm_squared());
                Some(a + 0.5 * centre)
            }));
            for centre in centres {
                let farthest = points.iter().map(|(p, _)| (p - centre).norm()).fold(0.0, f64::max);
                assert!(farthest >= radius - 1e-9, "{farthest} < {radius}");
            }
        }
    }
}

/// Elements of the arm's file in place of others, and the fault that is told of them.
#[test]
fn a_fault_of_an_element_is_told_with_its_line_name_and_value() {
    let text = arm_urdf("revolute").replacen("<link name=\"link_3\">", "\n<link name=\"link_3\">", 1);
    for (from, to, told) in [
        ("<child link=\"link_3\"/>", "", "line 2: <joint> \"joint_3\" has no child"),
        ("<child link=\"link_3\"/>", "<child/>", "line 2: <child> of joint \"joint_3\" has no link"),
        (
            "name=\"joint_3\" type=\"revolute\"",
            "name=\"joint_3\" type=\"hinge\"",
            "has the type \"hinge\"; allowed are revolute, ",
        ),
        ("name=\"joint_3\" type=\"revolute\"", "name=\"joint_3\"", "<joint> \"joint_3\" has no type"),
        ("<origin xyz=\"0 0 0.38\"/>", "<origin xyz=\"0 0\"/>", "has the xyz \"0 0\", which is not 3 finite numbers"),
        ("<origin xyz=\"0 0 0.38\"/>", "<origin xyz=\"0 0 inf\"/>", "has the xyz \"0 0 inf\", which is not 3"),
        ("<origin xyz=\"0 0 0.38\"/>", "<origin rpy=\"0 x 0\"/>", "<origin> of joint \"joint_3\" has the rpy \"0 x 0\""),
        ("upper=\"2.5\"", "upper=\"2,5\"", "has the upper \"2,5\", which is not a number"),
        ("radius=\"0.04\"", "radius=\"nan\"", "<cylinder> of link \"link_1\" has the radius \"nan\", which is not a number"),
        ("radius=\"0.04\" length=\"0.1\"", "radius=\"0.04\"", "<cylinder> of link \"link_1\" has no length"),
        ("<cylinder radius=\"0.04\" length=\"0.1\"/>", "<cone/>", "<cone> of link \"link_1\" is not a shape; allowed are box, "),
        ("<cylinder radius=\"0.04\" length=\"0.1\"/>", "", "<collision> of link \"link_1\" has no geometry"),
        ("<link name=\"world\"/>", "<link/>", "line 1: <link> has no name"),
    ] {
        assert!(text.contains(from), "{from}");
        let error = import(&text.replacen(from, to, 1), &options(), &mut no_mesh).expect_err("refused");
        assert!(error.to_string().contains(told), "{error}");
    }
    let macros = "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\" name=\"a\"><xacro:arm prefix=\"\"/></robot>";
    let error = import(macros, &options(), &mut no_mesh).expect_err("refused");
    assert!(error.to_string().contains("expand them first: xacro arm.urdf.xacro > arm.urdf"), "{error}");
}

#[test]
fn what_a_version_of_the_format_added_counts_from_it_on() {
    let (origin, quaternion) = ("<origin xyz=\"0 0 0.38\"/>", "<origin xyz=\"0 0 0.38\" quat_xyzw=\"0 0 1 1\"/>");
    let read = |version: &str, to: &str| {
        let text = arm_urdf("revolute").replacen("<robot", &format!("<robot version=\"{version}\""), 1);
        import(&text.replacen(origin, to, 1), &options(), &mut no_mesh)
    };
    let flange = |version: &str, to: &str| {
        let robot = read(version, to).expect("a robot").robot.build().expect("a sound one");
        robot.link_frames(&[0.0; 6])[6]
    };
    let turned = flange("1.0", "<origin xyz=\"0 0 0.38\" rpy=\"0 0 1.5707963267948966\"/>");
    assert!(flange("1.1", quaternion).rotation.angle_to(&turned.rotation) < 1e-9);
    assert!(flange("1.0", quaternion).rotation.angle() < 1e-9, "1.0 has no quaternions");
    let both = read("1.1", "<origin quat_xyzw=\"0 0 1 1\" rpy=\"0 0 0\"/>").expect_err("refused").to_string();
    assert!(both.contains("<origin> of joint \"joint_3\" has both rpy and quat_xyzw"), "{both}");
    let none = read("1.1", "<origin quat_xyzw=\"0 0 0 0\"/>").expect_err("refused").to_string();
    assert!(none.contains("has a quat_xyzw of length 0"), "{none}");
}
