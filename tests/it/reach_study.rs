//! Study of where to put robot, table and scanner: how much of the viewing hemisphere a layout reaches, collisions included. The
//! table in `config/cells/REACH.md` is written with `UPDATE_GOLDEN=1 cargo test --release --test it reach_study`; a plain run
//! recomputes the chosen layout and its neighbours and holds the file and the preset `e05-transcan` to it.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use vantage::cell::{BodySpec, CellSpec, PoseSpec, Presets, ShapeSpec, SpecLibrary};
use vantage::geometry::{Flange, Pose, ScannerFrame};
use vantage::planning::context::{Context, Silent};
use vantage::planning::studies::reach::{Layouts, Reached, mountings, reach};

/// Distance of the robot's foot from the table's axis.
const FOOT_MM: [f64; 6] = [300.0, 350.0, 375.0, 400.0, 450.0, 500.0];
/// Height of the plate above the foot.
const TABLE_MM: [f64; 7] = [0.0, -50.0, -100.0, -150.0, -200.0, -250.0, -300.0];
/// Edge of the cube on the plate.
const PART_MM: [f64; 2] = [120.0, 300.0];
/// Height of the plate above the floor: plate and housing.
const TABLE_STANDS_MM: f64 = 180.0;
/// Adapter between flange and scanner.
const ADAPTER_MM: f64 = 30.0;
/// The layout of the preset: foot, table, mount.
const CHOSEN: (f64, f64, Mount) = (400.0, -200.0, Mount::Top);

/// Face of the scanner's housing that the flange is on. Across the optical axis all but the last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mount {
    Top,
    Bottom,
    Left,
    Right,
    Back,
}

const MOUNTS: [Mount; 5] = [Mount::Top, Mount::Bottom, Mount::Left, Mount::Right, Mount::Back];

impl Mount {
    fn describe(self) -> &'static str {
        match self {
            Self::Top => "flange on the top face (−y), axis across the optical axis",
            Self::Bottom => "flange on the bottom face (+y), axis across the optical axis",
            Self::Left => "flange on the left end (−x), axis across the optical axis",
            Self::Right => "flange on the right end (+x), axis across the optical axis",
            Self::Back => "flange on the back (−z), axis along the optical axis",
        }
    }

    /// The housing is 300 × 130 × 110 mm with its front at z = 0. The flange's z axis points into it, its x axis along the
    /// scanner's z (x for the back).
    fn flange_from_scanner(self) -> Pose<Flange, ScannerFrame> {
        let (into, reach_mm) = match self {
            Self::Top => (Vector3::y(), 65.0),
            Self::Bottom => (-Vector3::y(), 65.0),
            Self::Left => (Vector3::x(), 150.0),
            Self::Right => (-Vector3::x(), 150.0),
            Self::Back => (Vector3::z(), 55.0),
        };
        let x = if self == Self::Back { Vector3::x() } else { Vector3::z() };
        let axes = Rotation3::from_basis_unchecked(&[x, into.cross(&x), into]);
        let origin = Vector3::new(0.0, 0.0, -55.0) - into * (reach_mm + ADAPTER_MM);
        let scanner_from_flange = Isometry3::from_parts(Translation3::from(origin), UnitQuaternion::from_rotation_matrix(&axes));
        Pose::<ScannerFrame, Flange>::claim(scanner_from_flange).inverse()
    }
}

fn upright(x: f64, z: f64) -> PoseSpec {
    PoseSpec { translation_mm: [x, 0.0, z], quaternion_xyzw: [0.0, 0.0, 0.0, 1.0] }
}

/// The layout, with floor and pedestal where the table's height has them.
fn layout(foot_mm: f64, table_mm: f64, mount: Mount) -> CellSpec {
    let floor_mm = table_mm - TABLE_STANDS_MM;
    let preset = Presets.cell("e05-transcan").expect("preset");
    CellSpec {
        base_from_table: upright(foot_mm, table_mm),
        flange_from_scanner: PoseSpec::from(&mount.flange_from_scanner()),
        mount: vec![BodySpec {
            name: "adapter".into(),
            owner_from_body: upright(0.0, 0.5 * ADAPTER_MM),
            shape: ShapeSpec::Cylinder { radius_mm: 40.0, height_mm: ADAPTER_MM },
        }],
        obstacles: vec![BodySpec {
            name: "pedestal".into(),
            owner_from_body: upright(0.0, 0.5 * floor_mm),
            shape: ShapeSpec::Cylinder { radius_mm: 100.0, height_mm: -floor_mm },
        }],
        floor_mm: Some(floor_mm),
        ..preset
    }
}

/// `None` where the bodies do not fit beside each other.
fn reached(foot_mm: f64, table_mm: f64, mount: Mount, part_mm: f64) -> Option<Reached> {
    let cell = layout(foot_mm, table_mm, mount).build(&Presets).ok()?;
    let mountings = mountings(&cell, ADAPTER_MM).into_iter().take(1).collect();
    let layouts = Layouts { part_mm, foot_mm: vec![foot_mm], table_mm: vec![table_mm], mountings, clearance_mm: 5.0 };
    let flag = AtomicBool::new(false);
    reach(&cell, &layouts, &Context::new(&flag, &Silent)).expect("not cancelled")[0].reached
}

fn entry(foot_mm: f64, table_mm: f64, mount: Mount) -> String {
    let [Some(small), Some(large)] = PART_MM.map(|edge_mm| reached(foot_mm, table_mm, mount, edge_mm)) else {
        return "does not fit".into();
    };
    format!("{} · {} / {} · {}", small.elevations, small.directions, large.elevations, large.directions)
}

fn row(table_mm: f64, entries: &[String]) -> String {
    format!("| {table_mm:.0} | {} |", entries.join(" | "))
}

fn document() -> String {
    let mut text = String::from(include_str!("reach_study_head.md"));
    for mount in MOUNTS {
        let _ = write!(text, "\n## {}\n\n| table, mm |", mount.describe());
        for foot_mm in FOOT_MM {
            let _ = write!(text, " foot {foot_mm:.0} mm |");
        }
        text.push_str("\n|---|---|---|---|---|---|---|\n");
        for table_mm in TABLE_MM {
            let entries: Vec<_> = FOOT_MM.iter().map(|foot_mm| entry(*foot_mm, table_mm, mount)).collect();
            let _ = writeln!(text, "{}", row(table_mm, &entries));
        }
    }
    text
}

fn file() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/config/cells/REACH.md"))
}

/// The entry of one layout in the document.
fn recorded(text: &str, foot_mm: f64, table_mm: f64, mount: Mount) -> String {
    let section = text.split("\n## ").find(|section| section.starts_with(mount.describe())).expect("section");
    let line = section.lines().find(|line| line.starts_with(&format!("| {table_mm:.0} |"))).expect("row");
    let column = FOOT_MM.iter().position(|foot| *foot == foot_mm).expect("column");
    line.split('|').nth(column + 2).expect("entry").trim().to_owned()
}

#[test]
fn reach_table_is_what_the_layouts_reach() {
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(file(), document()).expect("writes");
    }
    let text = std::fs::read_to_string(file()).expect("config/cells/REACH.md");
    let (foot_mm, table_mm, mount) = CHOSEN;
    for (foot_mm, table_mm, mount) in [
        CHOSEN,
        (foot_mm + 50.0, table_mm, mount),
        (300.0, table_mm, mount),
        (foot_mm, table_mm + 50.0, mount),
        (foot_mm, table_mm, Mount::Back),
    ] {
        let found = entry(foot_mm, table_mm, mount);
        assert_eq!(
            found,
            recorded(&text, foot_mm, table_mm, mount),
            "{mount:?} at {foot_mm} / {table_mm}: see the module's header"
        );
    }
}

#[test]
fn default_cell_is_the_chosen_layout() {
    let (foot_mm, table_mm, mount) = CHOSEN;
    let (preset, chosen) = (Presets.cell("e05-transcan").expect("preset"), layout(foot_mm, table_mm, mount));
    assert_eq!(preset.base_from_table, chosen.base_from_table);
    assert_eq!((preset.mount, preset.obstacles, preset.floor_mm), (chosen.mount, chosen.obstacles, chosen.floor_mm));
    let (found, expected) =
        (preset.flange_from_scanner.pose::<Flange, ScannerFrame>(), chosen.flange_from_scanner.pose::<Flange, ScannerFrame>());
    assert!((found.origin_mm() - expected.origin_mm()).norm() < 1e-6);
    assert!(found.isometry().rotation.angle_to(&expected.isometry().rotation) < 1e-6);
}
