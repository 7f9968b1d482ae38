//! Values of files and parameters that are accepted, although they are hardly what was meant: most of them are in another unit.

use std::f64::consts::{FRAC_PI_4, PI, TAU};
use std::path::Path;

use nalgebra::{Point3, Vector3};
use serde_json::Value;

use super::check::warn;
use super::files::{self, FileLibrary};
use crate::cell::{
    ArmControllerSpec, BodySpec, ControllersSpec, JointThreeOrigin, KinematicsSpec, PoseSpec, Presets, RobotSpec, ScannerSpec,
    ShapeSpec, SpecKind, SpecLibrary, TableControllerSpec, TriggerSpec, metres_in_mm,
};
use crate::check::kind_of;
use crate::geometry::{Aabb, Base, Table, listed};
use crate::program::Program;
use crate::wire::program::ProgramDocument;
use crate::wire::warnings::{FieldWarning, WarningCode};
use crate::wire::{DocumentKind, decode};

/// Largest incidence in radians, π/2, with room for rounding.
const MAX_INCIDENCE_RAD: f64 = 1.58;
/// Speed that no joint of an arm exceeds, rad/s, and that none stays below in degrees per second.
const MAX_SPEED_RAD_PER_S: f64 = 7.0;
/// Rounding of angles that were written in radians.
const ROUNDED_RAD: f64 = 0.01;
/// Extent that every obstacle of a cell exceeds in some direction, mm.
const MIN_OBSTACLE_MM: f64 = 10.0;
/// Smallest distance of the foot of a hanging robot from the face of the plate, mm: arm and scanner go in between.
const MIN_HANGING_MM: f64 = 300.0;
/// Depth of a plate below the floor up to which the two are level, mm.
const LEVEL_MM: f64 = 0.5;
/// Share of the common field by which a practical volume may exceed it, for rounding.
const VOLUME_ROUNDING: f64 = 0.01;

/// Warning of a value that is accepted, and hardly what was meant.
pub(super) fn doubt(pointer: impl Into<String>, detail: impl Into<String>, remedy: impl Into<String>) -> FieldWarning {
    let (pointer, detail, remedy) = (pointer.into(), detail.into(), remedy.into());
    FieldWarning { code: WarningCode::DoubtfulValue, pointer, detail, remedy }
}

/// Doubt about angles that look like radians.
fn in_radians(pointer: String, written: impl std::fmt::Debug, degrees: impl std::fmt::Debug) -> FieldWarning {
    doubt(pointer, format!("is {written:?}, as if in radians"), format!("if it is in radians, give {degrees:?} (degrees)"))
}

/// Doubt about an angle in degrees that looks like radians.
pub(super) fn radians(pointer: &str, written: f64) -> Option<FieldWarning> {
    look_like_radians(&[written]).then(|| in_radians(pointer.to_owned(), written, degrees(&[written])[0]))
}

/// Warns of doubtful values in the file that gives a device or a cell; presets have none.
pub(super) fn warn_of_file(kind: SpecKind, name: &str) {
    if let Some(document) = file_of(kind, name) {
        warn(name, &of_document(&document));
    }
}

/// Doubts about a document, whose kind is recognised by its content; for a cell also those about the files of its devices.
pub(super) fn of_document(document: &Value) -> Vec<FieldWarning> {
    let mut doubts = Vec::new();
    match kind_of(document) {
        Some(DocumentKind::Scanner) => of_scanner(document, "", &mut doubts),
        Some(DocumentKind::Robot) => of_robot(document, "", &mut doubts),
        Some(DocumentKind::Cell) => of_cell(document, &mut doubts),
        Some(DocumentKind::Params) => return of_params(document),
        Some(DocumentKind::Turntable | DocumentKind::Plan | DocumentKind::Program) | None => {}
    }
    of_euler_angles(document, "", &mut doubts);
    doubts
}

/// Doubts about parameters.
pub(super) fn of_params(params: &Value) -> Vec<FieldWarning> {
    let mut doubts = Vec::new();
    for (name, angle) in params["limits"].as_object().into_iter().flatten().filter(|(name, _)| name.ends_with("_deg")) {
        doubts.extend(incidence(angle, format!("/limits/{name}")));
    }
    if let Some(rolls) = numbers(&params["candidates"]["rolls_deg"]).filter(|rolls| look_like_radians(rolls)) {
        doubts.push(in_radians("/candidates/rolls_deg".to_owned(), &rolls, degrees(&rolls)));
    }
    of_euler_angles(params, "", &mut doubts);
    doubts
}

/// Doubts about controllers beside the robot of their cell, which is named or written out: an arm's of another maker, one that counts
/// joint 3 otherwise than the robot is planned, a trigger by signals that the arm's driver does not have, and states that may come later
/// than the watchdogs lapse or a reply is waited for.
pub(super) fn of_controllers(controllers: &ControllersSpec, robot: &Value) -> Vec<FieldWarning> {
    let robot: Option<RobotSpec> = robot.as_str().map_or_else(|| decode(robot).ok(), |name| FileLibrary.robot(name).ok());
    let doubts = |robot: &RobotSpec| [of_maker(&controllers.arm, robot), of_joint_3(&controllers.arm, robot)];
    let of_any_robot = [of_trigger(controllers), of_state_age(controllers)];
    let of_replies = of_reply_timeouts(controllers);
    robot.as_ref().map(doubts).into_iter().flatten().chain(of_any_robot).flatten().chain(of_replies).collect()
}

/// Doubt about a state that may be awaited for as long as a watchdog lasts: it is fed once the state is there.
fn of_state_age(controllers: &ControllersSpec) -> Option<FieldWarning> {
    let ControllersSpec { state_max_age_ms, watchdog_ms, .. } = controllers;
    (state_max_age_ms >= watchdog_ms).then(|| {
        let detail = format!(
            "is {state_max_age_ms} ms, not below watchdog_ms = {watchdog_ms} ms: while a state is that late nothing feeds the \
             watchdog, and the device stops by itself in the middle of a run"
        );
        let remedy = format!("give less than {watchdog_ms} ms, half of it as a rule, or raise watchdog_ms (500 ms at most)");
        doubt("/controllers/state_max_age_ms", detail, remedy)
    })
}

/// Doubts about a state that may be older than a reply may take: the shorter time ends the run.
fn of_reply_timeouts(controllers: &ControllersSpec) -> Vec<FieldWarning> {
    let arm_ms = match &controllers.arm {
        ArmControllerSpec::Hans(spec) => Some(spec.reply_timeout_ms),
        ArmControllerSpec::Ur(_)
        | ArmControllerSpec::FanucRmi(_)
        | ArmControllerSpec::KukaRsi(_)
        | ArmControllerSpec::AbbEgm(_) => None,
    };
    let table_ms = match &controllers.table {
        TableControllerSpec::MinasA6(spec) => Some(spec.reply_timeout_ms),
        TableControllerSpec::ModbusPlc(spec) => Some(spec.reply_timeout_ms),
        TableControllerSpec::WithArm {} => None,
    };
    let age_ms = controllers.state_max_age_ms;
    let doubted = |device: &str, reply_ms: u32| {
        let detail = format!(
            "is {age_ms} ms, above {device}.reply_timeout_ms = {reply_ms} ms, which decides: a reply that takes longer than that \
             ends the run, however old a state may be"
        );
        let remedy = format!("give {reply_ms} ms at most, or raise {device}.reply_timeout_ms to {age_ms} ms");
        doubt("/controllers/state_max_age_ms", detail, remedy)
    };
    let replies = [("arm", arm_ms), ("table", table_ms)].into_iter().filter_map(|(device, ms)| Some((device, ms?)));
    replies.filter(|(_, reply_ms)| age_ms > *reply_ms).map(|(device, reply_ms)| doubted(device, reply_ms)).collect()
}

/// Doubt about a trigger with which no run begins.
fn of_trigger(controllers: &ControllersSpec) -> Option<FieldWarning> {
    let is_digital = matches!(controllers.trigger, TriggerSpec::Digital(_));
    (is_digital && !controllers.arm.has_digital_signals()).then(|| {
        let detail = format!("is digital, but the driver of {} has no digital signals: no run can begin", controllers.arm.name());
        doubt("/controllers/trigger/protocol", detail, "trigger the scanner by http or by a command")
    })
}

/// Doubt about a document that is a program of several brightness levels, where the cell's trigger does not tell them.
pub(super) fn of_captures(controllers: &ControllersSpec, document: &Value) -> Option<FieldWarning> {
    let is_program = kind_of(document) == Some(DocumentKind::Program);
    let read: Option<ProgramDocument> = is_program.then(|| decode(document).ok()).flatten();
    of_levels(controllers, &read?.program().ok()?)
}

/// Doubt about a program of several brightness levels, where the cell's trigger does not tell them.
pub(super) fn of_levels(controllers: &ControllersSpec, program: &Program) -> Option<FieldWarning> {
    let (levels, trigger) = (program.brightness_levels(), &controllers.trigger);
    let levels: Vec<String> = levels.iter().map(ToString::to_string).collect();
    if levels.len() < 2 || trigger.tells_brightness() {
        return None;
    }
    let (levels, name) = (listed(&levels), trigger.name());
    let detail = format!("scans at brightness levels {levels}; the cell's trigger {name} does not send the level");
    let remedy =
        "trigger the scanner by http, or by a command with {brightness}, or have its own software switch before each scan";
    Some(doubt("/steps", detail, remedy))
}

/// Doubt about a controller whose maker is not that of the robot.
fn of_maker(arm: &ArmControllerSpec, robot: &RobotSpec) -> Option<FieldWarning> {
    let own = robot.dialect.filter(|own| !own.is_neutral() && *own != arm.dialect())?;
    let (protocol, name) = (arm.name(), &robot.name);
    let detail = format!("is {protocol}, of another maker than robot {name}, whose controller's language is {}", own.as_str());
    Some(doubt(
        "/controllers/arm/protocol",
        detail,
        "give the protocol of the robot's own controller, or the robot's own dialect",
    ))
}

/// Doubt about a controller that takes joint 3 as counted from another link than the robot is planned with.
fn of_joint_3(arm: &ArmControllerSpec, robot: &RobotSpec) -> Option<FieldWarning> {
    let ArmControllerSpec::FanucRmi(rmi) = arm else { return None };
    // Of the models only that of an ortho-parallel arm can count it from the ground.
    let from_ground = match &robot.kinematics {
        KinematicsSpec::Opw(opw) => Some(opw.joint_3_from_ground),
        KinematicsSpec::Ur(_) | KinematicsSpec::Chain(_) => None,
    };
    let planned = if from_ground == Some(true) { JointThreeOrigin::Ground } else { JointThreeOrigin::UpperArm };
    let Some(told) = rmi.joint_3_from else {
        let detail = "is not given, so nothing is sent to the arm".to_owned();
        return Some(doubt("/controllers/arm/joint_3_from", detail, format!("give {:?}", planned.as_str())));
    };
    (told != planned).then(|| {
        let [is, meant] = [told, planned].map(JointThreeOrigin::as_str);
        let or_the_robot = from_ground.map_or_else(String::new, |from_ground| {
            format!(", or set the robot's kinematics.joint_3_from_ground = {}", !from_ground)
        });
        let detail =
            format!("is {is}; robot {} is planned with joint 3 counted from the {}", robot.name, meant.replace('_', " "));
        doubt("/controllers/arm/joint_3_from", detail, format!("give {meant:?}{or_the_robot}"))
    })
}

fn of_cell(cell: &Value, doubts: &mut Vec<FieldWarning>) {
    for (index, obstacle) in cell["obstacles"].as_array().into_iter().flatten().enumerate() {
        doubts.extend(small_obstacle(&obstacle["shape"], &format!("/obstacles/{index}/shape")));
    }
    for pose in ["base_from_table", "flange_from_scanner"] {
        let written = numbers(&cell[pose]["translation_mm"]).and_then(|lengths| <[f64; 3]>::try_from(lengths).ok());
        if let Some((written, meant)) = written.and_then(|written| Some((written, metres_in_mm(written)?))) {
            let detail = format!("is {written:?} mm, as if in metres");
            doubts.push(doubt(format!("/{pose}/translation_mm"), detail, format!("if it is in metres, give {meant:?} (mm)")));
        }
    }
    let plate: Option<PoseSpec> = decode(&cell["base_from_table"]).ok();
    doubts.extend(plate.and_then(|plate| upside_down(&plate, cell["floor_mm"].is_number())));
    doubts.extend(plate.zip(cell["floor_mm"].as_f64()).and_then(|(plate, floor_mm)| below_floor(&plate, floor_mm)));
    for kind in [SpecKind::Scanner, SpecKind::Robot] {
        let device = &cell[kind.as_str()];
        let read = device.as_str().and_then(|name| file_of(kind, name));
        let (at, document) = (format!("/{}", kind.as_str()), read.as_ref().unwrap_or(device));
        if kind == SpecKind::Scanner {
            of_scanner(document, &at, doubts)
        } else {
            of_robot(document, &at, doubts)
        }
        if let Some(read) = &read {
            of_euler_angles(read, &at, doubts);
        }
    }
}

/// Doubt about a plate that faces down in the base frame. A robot that hangs has it so: its foot is well above the plate's face, and
/// nothing below it in its own frame is a floor.
fn upside_down(plate: &PoseSpec, has_floor: bool) -> Option<FieldWarning> {
    let plate = plate.pose::<Base, Table>();
    let up = plate.direction(&Vector3::z());
    let may_hang = !has_floor && -up.dot(&plate.origin_mm().coords) >= MIN_HANGING_MM;
    (up.z < 0.0 && !may_hang).then(|| {
        doubt(
            "/base_from_table",
            "turns the plate upside down: the plate faces down, unless the robot hangs upside down",
            "give the pose whose z axis points up from the plate; the order of a quaternion is x, y, z, w",
        )
    })
}

/// Doubt about a plate below the floor. A part that stands well above its plate may still be scanned, so that it is no error.
fn below_floor(plate: &PoseSpec, floor_mm: f64) -> Option<FieldWarning> {
    let plate_mm = plate.pose::<Base, Table>().origin_mm().z;
    (plate_mm < floor_mm - LEVEL_MM).then(|| {
        let detail = format!("is {floor_mm} mm, above the plate, whose centre base_from_table puts at a height of {plate_mm} mm");
        doubt("/floor_mm", detail, "give the height of the floor, or of the plate, both as seen from the robot's foot, in mm")
    })
}

/// Content of the file that gives a device or a cell; `None` for a preset, and for a pipe, which is read once.
fn file_of(kind: SpecKind, name: &str) -> Option<Value> {
    let is_preset = Presets.names(kind).iter().any(|preset| preset == name);
    let path = Some(Path::new(name)).filter(|path| !is_preset && path.is_file())?;
    files::spec_value(path).ok()
}

/// Doubt about an obstacle that is small in every direction.
fn small_obstacle(shape: &Value, at: &str) -> Option<FieldWarning> {
    let mut sizes_mm = numbers(&shape["size_mm"]).unwrap_or_default();
    sizes_mm.extend(["radius_mm", "height_mm", "length_mm"].iter().filter_map(|name| shape[*name].as_f64()));
    let is_small = !sizes_mm.is_empty() && sizes_mm.iter().all(|size_mm| *size_mm < MIN_OBSTACLE_MM);
    let in_mm: Vec<f64> = sizes_mm.iter().map(|metres| (metres * 1e6).round() / 1e3).collect();
    is_small.then(|| {
        let detail = format!("is {sizes_mm:?} mm, less than {MIN_OBSTACLE_MM} mm in every direction: metres?");
        doubt(at, detail, format!("if it is in metres, give {in_mm:?} (mm)"))
    })
}

fn of_scanner(scanner: &Value, at: &str, doubts: &mut Vec<FieldWarning>) {
    for device in ["left", "right", "projector"] {
        doubts.extend(incidence(&scanner[device]["incidence_max_deg"], format!("{at}/{device}/incidence_max_deg")));
    }
    let spec: Option<ScannerSpec> = decode(scanner).ok();
    doubts.extend(spec.iter().flat_map(|spec| [large_volume(spec, at), small_housing(spec, at)]).flatten());
}

/// Doubt about a housing that is shorter than the distance between the cameras in it.
fn small_housing(spec: &ScannerSpec, at: &str) -> Option<FieldWarning> {
    let baseline_mm = spec.build().ok()?.baseline_mm();
    let around = spec.body.iter().try_fold(Aabb::empty(), |around, body| around_body(body, around))?;
    let longest_mm = around.extent_mm().max();
    (!spec.body.is_empty() && longest_mm < baseline_mm).then(|| {
        let detail = format!(
            "is {longest_mm:.0} mm long, shorter than the distance of {baseline_mm:.0} mm between the cameras: collisions with \
             the rest of the scanner are not seen"
        );
        doubt(format!("{at}/body"), detail, "give the housing with both cameras in it, in mm")
    })
}

/// The box around `around` and a body; `None` for a mesh, whose size its file has.
fn around_body(body: &BodySpec, around: Aabb) -> Option<Aabb> {
    let size_mm = match body.shape {
        ShapeSpec::Box { size_mm } => size_mm,
        ShapeSpec::Cylinder { radius_mm, height_mm } => [2.0 * radius_mm, 2.0 * radius_mm, height_mm],
        ShapeSpec::Capsule { radius_mm, length_mm } => [2.0 * radius_mm, 2.0 * radius_mm, length_mm + 2.0 * radius_mm],
        ShapeSpec::Mesh { .. } => return None,
    };
    let (half_mm, pose) = (Vector3::from(size_mm) * 0.5, body.owner_from_body.pose::<(), ()>());
    let corners = (0..8_u8).map(|corner| {
        let side = |axis: u8| if (corner >> axis) & 1 == 0 { -1.0 } else { 1.0 };
        pose.point(&Point3::from(half_mm.component_mul(&Vector3::new(side(0), side(1), side(2)))))
    });
    Some(corners.fold(around, |around, corner| around.with(&corner)))
}

/// Doubt about a practical volume that the devices do not have in common, not even at the far end of the working depth.
fn large_volume(spec: &ScannerSpec, at: &str) -> Option<FieldWarning> {
    let scanner = spec.build().ok()?;
    let [width, height] = scanner.common_field_at(scanner.far_mm).size_mm();
    let seen_mm = [width, height, scanner.far_mm - scanner.near_mm];
    let stated_mm = spec.practical_volume_mm;
    let is_larger = stated_mm.iter().zip(seen_mm).any(|(stated, seen)| *stated > (1.0 + VOLUME_ROUNDING) * seen);
    is_larger.then(|| {
        let [x, y, z] = seen_mm;
        let detail = format!(
            "is {stated_mm:?} mm; all three devices see at most {x:.0} × {y:.0} mm, at the far end of the working depth, which is \
             {z:.0} mm long"
        );
        doubt(format!("{at}/practical_volume_mm"), detail, "give the volume that all three devices see")
    })
}

fn of_robot(robot: &Value, at: &str, doubts: &mut Vec<FieldWarning>) {
    doubts.extend(bare_links(robot, at));
    for (index, joint) in robot["joints"].as_array().into_iter().flatten().enumerate() {
        let at = format!("{at}/joints/{index}");
        let speed = joint["max_speed_deg_per_s"].as_f64().filter(|speed| (0.0..=MAX_SPEED_RAD_PER_S).contains(speed));
        if let Some(speed) = speed {
            let remedy = format!("if it is in rad/s, give {:?} (degrees per second)", degrees(&[speed])[0]);
            doubts.push(doubt(format!("{at}/max_speed_deg_per_s"), format!("is {speed:?}, as if in radians per second"), remedy));
        }
        let limits = joint["min_deg"].as_f64().zip(joint["max_deg"].as_f64());
        if let Some((min, max)) = limits.filter(|(min, max)| min.abs().max(max.abs()) <= TAU + ROUNDED_RAD) {
            let meant = degrees(&[min, max]);
            let remedy = format!("if they are in radians, give min_deg {:?} and max_deg {:?}", meant[0], meant[1]);
            doubts.push(doubt(at, format!("has min_deg {min:?} and max_deg {max:?}, as if in radians"), remedy));
        }
    }
}

/// Doubt about an arm with a link that no collision is seen with.
fn bare_links(robot: &Value, at: &str) -> Option<FieldWarning> {
    // Without any, or with another structure, the robot is refused.
    let links = robot["links"].as_array().filter(|links| !links.is_empty())?;
    let bodies = links.iter().chain(robot["surfaces"].as_array().into_iter().flatten());
    let covered: Vec<u64> = bodies.filter_map(|body| body["link"].as_u64()).collect();
    let bare: Vec<String> = (1..=5).filter(|link| !covered.contains(link)).map(|link| link.to_string()).collect();
    (!bare.is_empty()).then(|| {
        let detail = format!("has no capsule for link {}: collisions with it are not seen", bare.join(", "));
        doubt(format!("{at}/links"), detail, "give capsules around each of the links 1 to 5")
    })
}

/// Doubt about a limit of incidence of at most π/2.
fn incidence(angle: &Value, pointer: String) -> Option<FieldWarning> {
    let written = angle.as_f64().filter(|angle| (0.0..=MAX_INCIDENCE_RAD).contains(angle))?;
    Some(in_radians(pointer, written, degrees(&[written])[0]))
}

/// Doubts about every `rpy_deg` below `at`.
fn of_euler_angles(value: &Value, at: &str, doubts: &mut Vec<FieldWarning>) {
    match value {
        Value::Object(fields) => {
            for (name, field) in fields {
                let pointer = format!("{at}/{name}");
                match numbers(field).filter(|_| name == "rpy_deg") {
                    Some(angles) if look_like_radians(&angles) => {
                        doubts.push(in_radians(pointer, &angles, degrees(&angles)));
                    }
                    Some(_) => {}
                    None => of_euler_angles(field, &pointer, doubts),
                }
            }
        }
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(index, item)| of_euler_angles(item, &format!("{at}/{index}"), doubts));
        }
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
    }
}

/// Returns true for angles within ±π of which one is a multiple of π/4, other than 0, as radians.
fn look_like_radians(angles: &[f64]) -> bool {
    let is_marked = |angle: f64| {
        let eighths = (angle / FRAC_PI_4).round();
        eighths != 0.0 && (angle - eighths * FRAC_PI_4).abs() <= ROUNDED_RAD
    };
    angles.iter().all(|angle| angle.abs() <= PI + ROUNDED_RAD) && angles.iter().any(|angle| is_marked(*angle))
}

/// Radians in degrees, to a tenth.
fn degrees(angles: &[f64]) -> Vec<f64> {
    angles.iter().map(|angle| (angle.to_degrees() * 10.0).round() / 10.0).collect()
}

/// The numbers of a list; `None` for anything else.
fn numbers(list: &Value) -> Option<Vec<f64>> {
    list.as_array()?.iter().map(Value::as_f64).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn preset(kind: SpecKind, name: &str) -> Value {
        let value = match kind {
            SpecKind::Scanner => serde_json::to_value(Presets.scanner(name).expect("a preset")),
            SpecKind::Robot => serde_json::to_value(Presets.robot(name).expect("a preset")),
            SpecKind::Turntable => serde_json::to_value(Presets.turntable(name).expect("a preset")),
            SpecKind::Cell => serde_json::to_value(Presets.cell(name).expect("a preset")),
            SpecKind::Mesh => panic!("no preset is a mesh"),
        };
        value.expect("JSON")
    }

    /// The only doubt about a document.
    fn only(document: &Value) -> (String, String, String) {
        let doubts = of_document(document);
        let [FieldWarning { pointer, detail, remedy, .. }] = &doubts[..] else { panic!("{doubts:#?}") };
        (pointer.clone(), detail.clone(), remedy.clone())
    }

    #[test]
    fn presets_and_defaults_are_beyond_doubt() {
        for kind in [SpecKind::Scanner, SpecKind::Robot, SpecKind::Turntable, SpecKind::Cell] {
            for name in Presets.names(kind) {
                assert_eq!(of_document(&preset(kind, &name)), [], "{name}");
            }
        }
        assert_eq!(of_params(&serde_json::to_value(crate::planning::params::PlanParams::default()).expect("JSON")), []);
    }

    #[test]
    fn a_controller_that_counts_joint_3_otherwise_than_the_robot_is_doubted() {
        let section = |joint_3_from: &str| -> ControllersSpec {
            let arm = json!({"protocol": "fanuc_rmi", "address": "10.0.0.2:16001", "joint_3_from": joint_3_from});
            let table = json!({"protocol": "with_arm"});
            serde_json::from_value(json!({"arm": arm, "table": table})).expect("a section")
        };
        let named = json!("fanuc-m20ia");
        assert_eq!(of_controllers(&section("ground"), &named), []);
        let [doubt] = &of_controllers(&section("upper_arm"), &named)[..] else { panic!("one doubt") };
        assert_eq!(doubt.pointer, "/controllers/arm/joint_3_from");
        assert!(doubt.detail.ends_with("is planned with joint 3 counted from the ground"), "{}", doubt.detail);
        let mut written = preset(SpecKind::Robot, "fanuc-m20ia");
        written["kinematics"]["joint_3_from_ground"] = json!(false);
        let [doubt] = &of_controllers(&section("ground"), &written)[..] else { panic!("one doubt") };
        assert!(doubt.remedy.starts_with("give \"upper_arm\""), "{}", doubt.remedy);
        assert_eq!(of_controllers(&section("upper_arm"), &written), []);
        assert_eq!(of_controllers(&section("ground"), &json!("nobody.toml")), [], "the cell itself is refused");
        // In a model without the flag each link hangs on the one before.
        let mut other = preset(SpecKind::Robot, "ur10e");
        other.as_object_mut().expect("an object").remove("dialect");
        let [doubt] = &of_controllers(&section("ground"), &other)[..] else { panic!("one doubt") };
        assert_eq!((doubt.pointer.as_str(), doubt.remedy.as_str()), ("/controllers/arm/joint_3_from", "give \"upper_arm\""));
        assert_eq!(of_controllers(&section("upper_arm"), &other), []);
        let mut unsaid = section("ground");
        let ArmControllerSpec::FanucRmi(rmi) = &mut unsaid.arm else { panic!("fanuc_rmi") };
        rmi.joint_3_from = None;
        let [doubt] = &of_controllers(&unsaid, &named)[..] else { panic!("one doubt") };
        assert!(doubt.detail.starts_with("is not given") && doubt.remedy == "give \"ground\"", "{doubt:?}");
    }

    #[test]
    fn a_trigger_by_signals_that_the_driver_does_not_have_is_doubted() {
        let section = |arm: Value| -> ControllersSpec {
            let (table, trigger) = (json!({"protocol": "with_arm"}), json!({"protocol": "digital", "output": 1, "input": 1}));
            serde_json::from_value(json!({"arm": arm, "table": table, "trigger": trigger})).expect("a section")
        };
        let hans = section(json!({"protocol": "hans", "address": "10.0.0.2:10003"}));
        assert_eq!(of_controllers(&hans, &json!("hans-e05")), []);
        let kuka = section(json!({"protocol": "kuka_rsi", "address": "10.0.0.1:49152"}));
        let doubts = of_controllers(&kuka, &json!("nobody.toml"));
        assert_eq!(doubts.iter().map(|doubt| doubt.pointer.as_str()).collect::<Vec<_>>(), ["/controllers/trigger/protocol"]);
    }

    /// A state that came late, and not too late, left the watchdog unfed, and the device stopped by itself.
    #[test]
    fn a_state_that_may_come_later_than_the_watchdog_lapses_is_doubted() {
        let doubted = |watchdog_ms: u32, state_max_age_ms: u32| -> Vec<(String, String)> {
            let arm = json!({"protocol": "hans", "address": "10.0.0.2:10003", "reply_timeout_ms": 300});
            let (table, times) = (json!({"protocol": "with_arm"}), [watchdog_ms, state_max_age_ms]);
            let section = json!({"arm": arm, "table": table, "watchdog_ms": times[0], "state_max_age_ms": times[1]});
            let section = serde_json::from_value(section).expect("a section");
            of_controllers(&section, &json!("hans-e05")).into_iter().map(|doubt| (doubt.pointer, doubt.detail)).collect()
        };
        assert_eq!(doubted(200, 100), []);
        for late_ms in [200, 300] {
            let [(pointer, detail)] = &doubted(200, late_ms)[..] else { panic!("one doubt") };
            assert_eq!(pointer, "/controllers/state_max_age_ms");
            assert!(detail.contains(&format!("is {late_ms} ms, not below watchdog_ms = 200 ms")), "{detail}");
        }
    }

    /// A state might be 450 ms old, and the run ended after 200 ms without a reply.
    #[test]
    fn a_state_that_may_be_older_than_a_reply_is_waited_for_is_doubted() {
        let doubted = |state_max_age_ms: u32| -> Vec<String> {
            let arm = json!({"protocol": "hans", "address": "10.0.0.2:10003", "reply_timeout_ms": 200});
            let table = json!({"protocol": "minas_a6", "address": "tcp://10.0.0.3:502", "units_per_turn": 1_600_000, "gear_ratio": 40,
                "reply_timeout_ms": 300});
            let section = json!({"arm": arm, "table": table, "watchdog_ms": 500, "state_max_age_ms": state_max_age_ms});
            let section = serde_json::from_value(section).expect("a section");
            let doubts = of_controllers(&section, &json!("hans-e05"));
            assert!(doubts.iter().all(|doubt| doubt.pointer == "/controllers/state_max_age_ms"), "{doubts:?}");
            doubts.into_iter().map(|doubt| doubt.detail).collect()
        };
        assert_eq!(doubted(200), Vec::<String>::new());
        for (age_ms, replies) in [
            (250, &["arm.reply_timeout_ms = 200 ms"][..]),
            (450, &["arm.reply_timeout_ms = 200 ms", "table.reply_timeout_ms = 300 ms"][..]),
        ] {
            let details = doubted(age_ms);
            assert_eq!(details.len(), replies.len(), "{details:?}");
            for (detail, reply) in details.iter().zip(replies) {
                assert!(detail.contains(&format!("is {age_ms} ms, above {reply}, which decides")), "{detail}");
            }
        }
    }

    #[test]
    fn a_program_of_levels_that_its_trigger_does_not_tell_is_doubted() {
        let section = |trigger: Value| -> ControllersSpec {
            let (arm, table) = (json!({"protocol": "hans", "address": "10.0.0.2:10003"}), json!({"protocol": "with_arm"}));
            serde_json::from_value(json!({"arm": arm, "table": table, "trigger": trigger})).expect("a section")
        };
        let scan = |level: u8| json!({"op": "scan", "viewpoint": 3, "brightness": level, "capture_secs": 1.0});
        let program = |levels: &[u8]| {
            json!({
                "schema": "vantage.program/1", "plan_sha256": "00".repeat(32), "robot": "hans-e05", "turntable": "minas-a6-500",
                "home_deg": [0.0, -30.0, 60.0, 0.0, 30.0, 0.0, 0.0], "cycle_secs": levels.len(),
                "steps": levels.iter().copied().map(scan).collect::<Vec<_>>(),
            })
        };
        let (silent, http) = (section(json!({"protocol": "none"})), section(json!({"protocol": "http", "url": "http://s/c"})));
        let told = of_captures(&silent, &program(&[9, 5, 9])).expect("a doubt");
        assert_eq!(told.pointer, "/steps");
        assert!(told.detail.starts_with("scans at brightness levels 5 and 9; the cell's trigger none "), "{}", told.detail);
        assert_eq!(of_captures(&silent, &program(&[9, 9])), None, "one level");
        assert_eq!(of_captures(&http, &program(&[5, 9])), None, "it is told");
        assert_eq!(of_captures(&silent, &preset(SpecKind::Cell, "e05-transcan")), None, "no program");
    }

    #[test]
    fn an_obstacle_in_metres_is_told_in_millimetres() {
        let mut cell = preset(SpecKind::Cell, "e05-transcan");
        let shape = json!({"kind": "box", "size_mm": [0.3, 0.6, 1.0]});
        cell["obstacles"] = json!([{"name": "w", "shape": shape}]);
        let (pointer, detail, remedy) = only(&cell);
        assert_eq!(pointer, "/obstacles/0/shape");
        assert!(detail.contains("is [0.3, 0.6, 1.0] mm") && detail.ends_with("metres?"), "{detail}");
        assert!(remedy.contains("[300.0, 600.0, 1000.0]"), "{remedy}");
        cell["obstacles"][0]["shape"] = json!({"kind": "box", "size_mm": [0.3, 600.0, 1000.0]});
        assert_eq!(of_document(&cell), [], "a thin sheet");
    }

    #[test]
    fn a_plate_that_faces_down_is_told_the_order_of_a_quaternion() {
        let mut cell = preset(SpecKind::Cell, "e05-transcan");
        cell["base_from_table"]["quaternion_xyzw"] = json!([1.0, 0.0, 0.0, 0.0]);
        let (pointer, detail, remedy) = only(&cell);
        assert_eq!(pointer, "/base_from_table");
        assert!(detail.contains("the plate faces down") && remedy.contains("x, y, z, w"), "{detail}; {remedy}");
    }

    /// A robot that hangs from a ceiling was refused by `check --strict`.
    #[test]
    fn a_plate_below_a_robot_that_hangs_is_beyond_doubt() {
        let mut cell = preset(SpecKind::Cell, "e05-transcan");
        cell["base_from_table"] = json!({"translation_mm": [400.0, 0.0, 900.0], "rpy_deg": [180.0, 0.0, 0.0]});
        assert!(only(&cell).1.contains("unless the robot hangs"), "the floor is below the foot: it stands");
        cell.as_object_mut().expect("an object").remove("floor_mm");
        assert_eq!(of_document(&cell), []);
        cell["base_from_table"]["translation_mm"] = json!([400.0, 0.0, -200.0]);
        assert_eq!(only(&cell).0, "/base_from_table", "the plate faces away from the foot");
    }

    /// The plan blamed the part.
    #[test]
    fn a_plate_below_the_floor_is_doubted() {
        let mut cell = preset(SpecKind::Cell, "e05-transcan");
        cell["base_from_table"] = json!({"translation_mm": [900.0, 0.0, -700.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]});
        cell["floor_mm"] = json!(-600.0);
        let (pointer, detail, _) = only(&cell);
        assert!(pointer == "/floor_mm" && detail.contains("is -600 mm") && detail.contains("-700 mm"), "{pointer}: {detail}");
        cell["floor_mm"] = json!(-700.0);
        assert_eq!(of_document(&cell), [], "level");
    }

    /// A housing in centimetres passed without a word, and nothing stood where the scanner is.
    #[test]
    fn a_housing_that_is_shorter_than_the_baseline_is_doubted() {
        let mut scanner = preset(SpecKind::Scanner, "transcan-c-nominal");
        scanner["body"][0]["shape"]["size_mm"] = json!([30.0, 13.0, 11.0]);
        let (pointer, detail, _) = only(&scanner);
        assert_eq!(pointer, "/body");
        assert!(detail.starts_with("is 30 mm long, shorter than the distance of 202 mm"), "{detail}");
        // One body for each camera is as long as both are apart.
        let half = |x_mm: f64| {
            let (shape, at) = (json!({"kind": "box", "size_mm": [60.0, 60.0, 60.0]}), json!([x_mm, 0.0, 0.0]));
            json!({"name": "camera", "owner_from_body": {"translation_mm": at, "rpy_deg": [0.0, 0.0, 0.0]}, "shape": shape})
        };
        scanner["body"] = json!([half(-101.0), half(101.0)]);
        assert_eq!(of_document(&scanner), []);
        // Turned, it is as long along another axis.
        scanner["body"] = json!([{
            "name": "post", "owner_from_body": {"translation_mm": [0.0, 0.0, 0.0], "rpy_deg": [0.0, 90.0, 0.0]},
            "shape": {"kind": "cylinder", "radius_mm": 50.0, "height_mm": 300.0},
        }]);
        assert_eq!(of_document(&scanner), []);
        scanner["body"] = json!([{"name": "mesh", "shape": {"kind": "mesh", "mesh": "housing.stl"}}]);
        assert_eq!(of_document(&scanner), [], "the size of a mesh is not known here");
    }

    #[test]
    fn a_robot_without_a_body_for_a_link_is_doubted() {
        let mut robot = preset(SpecKind::Robot, "ur10e");
        let links = robot["links"].as_array_mut().expect("capsules");
        links.retain(|link| link["link"] != 3);
        let (pointer, detail, _) = only(&robot);
        assert!(pointer == "/links" && detail.contains("no capsule for link 3:"), "{pointer}: {detail}");
    }

    #[test]
    fn a_flange_in_metres_is_told_in_millimetres() {
        let mut cell = preset(SpecKind::Cell, "e05-transcan");
        cell["flange_from_scanner"]["translation_mm"] = json!([0.0, 0.055, 0.095]);
        let (pointer, _, remedy) = only(&cell);
        assert_eq!(pointer, "/flange_from_scanner/translation_mm");
        assert!(remedy.contains("[0.0, 55.0, 95.0]"), "{remedy}");
    }

    #[test]
    fn angles_in_radians_are_told_in_degrees_where_they_stand() {
        let mut scanner = preset(SpecKind::Scanner, "transcan-c-nominal");
        scanner["left"]["incidence_max_deg"] = json!(1.047);
        let (pointer, detail, remedy) = only(&scanner);
        assert_eq!(pointer, "/left/incidence_max_deg");
        assert!(detail == "is 1.047, as if in radians" && remedy.contains("60.0"), "{detail}; {remedy}");
        let mut robot = preset(SpecKind::Robot, "ur10e");
        robot["joints"][1]["max_speed_deg_per_s"] = json!(2.09);
        let (pointer, detail, remedy) = only(&robot);
        assert!(pointer == "/joints/1/max_speed_deg_per_s" && detail.contains("radians per second"), "{pointer}: {detail}");
        assert!(remedy.contains("119.7"), "{remedy}");
        let mut robot = preset(SpecKind::Robot, "ur10e");
        (robot["joints"][2]["min_deg"], robot["joints"][2]["max_deg"]) = (json!(-3.1), json!(3.1));
        let (pointer, detail, _) = only(&robot);
        assert!(pointer == "/joints/2" && detail.contains("min_deg"), "{pointer}: {detail}");
        let mut cell = preset(SpecKind::Cell, "e05-transcan");
        cell["mount"] = json!([{"name": "m", "owner_from_body": {"translation_mm": [0, 0, 0], "rpy_deg": [1.57, 0, 1.57]}}]);
        assert_eq!(only(&cell).0, "/mount/0/owner_from_body/rpy_deg");
    }

    #[test]
    fn parameters_in_radians_are_told_in_degrees() {
        let doubts = of_params(&json!({"limits": {"camera_deg": 1.05}, "candidates": {"rolls_deg": [0, 1.57]}}));
        let found: Vec<&str> = doubts.iter().map(|doubt| doubt.pointer.as_str()).collect();
        assert_eq!(found, ["/limits/camera_deg", "/candidates/rolls_deg"]);
        assert!(doubts[1].remedy.contains("[0.0, 90.0]"), "{doubts:?}");
        assert_eq!(of_params(&json!({"limits": {"camera_deg": 60}, "candidates": {"rolls_deg": [0, 1, 2, 3]}})), []);
    }

    #[test]
    fn a_practical_volume_beyond_the_common_field_is_doubted() {
        let mut scanner = preset(SpecKind::Scanner, "transcan-c-nominal");
        scanner["practical_volume_mm"] = json!([640.0, 500.0, 140.0]);
        let (pointer, detail, _) = only(&scanner);
        assert_eq!(pointer, "/practical_volume_mm");
        assert!(detail.contains("is [640.0, 500.0, 140.0] mm; all three devices see at most"), "{detail}");
    }
}
