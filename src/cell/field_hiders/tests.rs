use nalgebra::Isometry3;

use super::{FieldHider, HiderPlace, lines_to_field};
use crate::cell::{Body, Cell, CellDistances, DeviceName, HousingFace, Named, PoseSpec, Presets, Shape, SpecKind, SpecLibrary};
use crate::geometry::Pose;

fn default_cell() -> Cell {
    Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset")
}

/// The default cell with one more body on its mount, flange frame.
fn with_on_mount(name: &str, middle_mm: [f64; 3], size_mm: [f64; 3]) -> Cell {
    let mut cell = default_cell();
    let owner_from_body = Isometry3::translation(middle_mm[0], middle_mm[1], middle_mm[2]);
    cell.mount.push(Body { name: name.into(), owner_from_body, shape: Shape::Box { size_mm } });
    cell
}

/// The default cell with its scanner turned about x by half a turn: it looks back along the flange's axis.
fn looking_back() -> Cell {
    let mut spec = Presets.cell("e05-transcan").expect("a preset");
    spec.flange_from_scanner = PoseSpec { translation_mm: [0.0, 0.0, 30.0], quaternion_xyzw: [1.0, 0.0, 0.0, 0.0] };
    spec.build(&Presets).expect("nothing else is wrong with it")
}

fn at(hiders: &[FieldHider], place: HiderPlace) -> &FieldHider {
    hiders.iter().find(|hider| hider.place == place).unwrap_or_else(|| panic!("nothing hides at {place:?}: {hiders:#?}"))
}

/// Smallest and largest share of a device's field that is hidden.
fn share(hider: &FieldHider, device: DeviceName) -> [f64; 2] {
    let found = hider.shares.iter().find(|share| share.device == device);
    found.map_or([0.0; 2], |share| [share.min, share.max])
}

/// "Target met" was said of plans in it.
#[test]
fn a_scanner_that_looks_back_through_its_wrist_has_its_field_hidden_by_the_arm() {
    let hiders = looking_back().field_hiders();
    let arm = at(&hiders, HiderPlace::Arm);
    for name in ["flange", "wrist"] {
        assert!(arm.names.iter().any(|known| known == name), "{name:?} is not among {:?}", arm.names);
    }
    assert!(share(arm, DeviceName::Projector)[0] > 0.999, "{arm:#?}");
    // Beside the flange, link 5 hides more or less as joint 6 turns it.
    for camera in [DeviceName::Left, DeviceName::Right] {
        let [min, max] = share(arm, camera);
        assert!(min > 0.2 && max > min + 0.1 && max <= 1.0, "{camera:?}: {arm:#?}");
    }
    assert!(share(at(&hiders, HiderPlace::Mount(0)), DeviceName::Projector)[0] > 0.9, "the adapter is in front: {hiders:#?}");
}

#[test]
fn a_plate_between_the_devices_and_the_field_hides_all_of_it() {
    let cell = with_on_mount("cover", [190.0, 0.0, 95.0], [10.0, 400.0, 200.0]);
    let hiders = cell.field_hiders();
    let [cover] = &hiders[..] else { panic!("{hiders:#?}") };
    assert_eq!((cover.place, &cover.names[..]), (HiderPlace::Mount(1), &["cover".to_owned()][..]));
    for device in DeviceName::ALL {
        assert!(share(cover, device)[0] > 0.999, "{device:?}: {cover:#?}");
    }
}

/// Link 6 does not move against the scanner, and its lines were cast at each of 25 angles of joint 6.
#[test]
fn lines_are_cast_at_each_angle_of_joint_6_past_link_5_alone() {
    let cell = looking_back();
    let lines = lines_to_field(&cell.scanner);
    let casts: Vec<_> = cell.end_of_arm(&lines).iter().map(|body| (body.name.clone(), body.hidden(&lines[0]).len())).collect();
    assert!(casts.contains(&("flange".to_owned(), 1)) && casts.contains(&("wrist".to_owned(), 25)), "{casts:?}");
    assert!(casts.iter().all(|(_, count)| [1, 25].contains(count)), "{casts:?}");
}

/// Halfway to the field: from the projector, its corner from a third of the half width and two thirds of the half height on.
#[test]
fn a_clip_before_a_corner_hides_a_small_share_from_the_devices_that_look_past_it() {
    let cell = with_on_mount("clip", [295.0, 75.0, 140.0], [4.0, 50.0, 30.0]);
    let hiders = cell.field_hiders();
    let [clip] = &hiders[..] else { panic!("{hiders:#?}") };
    let devices: Vec<_> = clip.shares.iter().map(|share| share.device).collect();
    assert_eq!(devices, [DeviceName::Right, DeviceName::Projector], "{clip:#?}");
    for found in &clip.shares {
        assert!((0.005..0.2).contains(&found.max) && found.max - found.min < 1e-12, "{clip:#?}");
    }
}

#[test]
fn a_body_beside_the_lines_hides_nothing() {
    assert_eq!(with_on_mount("handle", [190.0, 0.0, 260.0], [10.0, 400.0, 40.0]).field_hiders(), []);
    assert_eq!(with_on_mount("shield", [40.0, 0.0, 95.0], [10.0, 400.0, 200.0]).field_hiders(), [], "behind the devices");
}

/// Housings as they are drawn hold the optical centres, which lie some way behind the front.
#[test]
fn a_housing_is_looked_out_of_and_a_plate_before_it_is_not() {
    let mut cell = default_cell();
    let body = |name: &str, middle_mm: f64, size_mm: [f64; 3]| Body {
        name: name.into(),
        owner_from_body: Isometry3::translation(0.0, 0.0, middle_mm),
        shape: Shape::Box { size_mm },
    };
    cell.scanner_bodies = vec![body("housing", -40.0, [300.0, 130.0, 120.0])];
    assert_eq!(cell.field_hiders(), [], "its front is 20 mm before the optical centres");
    cell.scanner_bodies.push(body("front", 25.0, [300.0, 130.0, 4.0]));
    let hiders = cell.field_hiders();
    let [front] = &hiders[..] else { panic!("{hiders:#?}") };
    assert_eq!((front.place, &front.names[..]), (HiderPlace::Scanner(1), &["front".to_owned()][..]));
    // On the mount, of a scanner without bodies; beside one with bodies it is in the way.
    let mut on_mount = with_on_mount("housing", [15.0, 0.0, 95.0], [120.0, 300.0, 130.0]);
    assert_eq!(on_mount.field_hiders().len(), 1);
    on_mount.scanner_bodies.clear();
    assert_eq!(on_mount.field_hiders(), []);
}

#[test]
fn no_cell_that_is_shipped_hides_its_own_field() {
    for name in Presets.names(SpecKind::Cell) {
        let cell = Presets.cell(&name).expect("a preset").build(&Presets).expect("a valid preset");
        assert_eq!(cell.field_hiders(), [], "{name}");
    }
}

#[test]
fn no_robot_preset_hides_the_field_of_a_scanner_that_is_bolted_to_it_by_any_face() {
    let scanner = Presets.scanner("transcan-c").expect("a preset");
    for robot in Presets.names(SpecKind::Robot) {
        let mut spec = Presets.cell("e05-transcan").expect("a preset");
        spec.robot = Named::Name(robot.clone());
        for mount in HousingFace::ALL {
            let distances = CellDistances {
                name: "mine".into(),
                scanner: scanner.name.clone(),
                robot: robot.clone(),
                turntable: "minas-a6-500".into(),
                table_at_mm: [900.0, 0.0, 100.0],
                table_yaw_deg: 0.0,
                mount,
                adapter_mm: 0.0,
                adapter_kg: 0.0,
                floor_mm: None,
                pedestal: false,
                home_deg: Some([0.0; 7]),
            };
            spec.flange_from_scanner = distances.spec(&Presets).expect("in range").flange_from_scanner;
            spec.mount.clear();
            let cell = spec.assemble(&Presets).expect("every field is in range");
            assert_eq!(cell.field_hiders(), [], "{robot}, {}", mount.as_str());
        }
    }
}

#[test]
fn a_pose_that_is_inverted_has_the_arm_before_the_devices() {
    let mut cell = default_cell();
    cell.flange_from_scanner = Pose::claim(*cell.flange_from_scanner.inverse().isometry());
    let hiders = cell.field_hiders();
    assert!(share(at(&hiders, HiderPlace::Arm), DeviceName::Projector)[0] > 0.9, "{hiders:#?}");
}
