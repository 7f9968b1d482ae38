//! The section on how the part lies on the plate: a drawing a setup, with the figures that an operator needs to put it there.

use nalgebra::Vector3;

use super::ReportSubject;
use super::album::Album;
use super::drawing::{self, PlacedPart};
use super::markup::{number, triple};
use crate::cell::PoseSpec;
use crate::geometry::{Part, Pose, Table};
use crate::planning::plan::{Turn, TurnKind};
use crate::wire::words::turn_phrase;

/// An axis of the file within this angle of upright is called upright, degrees.
const UPRIGHT_DEG: f64 = 5.0;
/// Names of the axes of the file.
const AXES: [char; 3] = ['x', 'y', 'z'];

/// Pose of the part in one setup.
pub(super) struct Lay {
    pub(super) table_from_part: Pose<Table, Part>,
    /// Turn into it from the first setup; `None` in the first.
    pub(super) turn: Option<Turn>,
    /// Lie of the part in the first setup in words, where that is not as it is placed.
    pub(super) first_lie: Option<String>,
}

/// The section; empty where there is neither a table nor more than one pose.
pub(super) fn section(subject: &ReportSubject<'_>, lays: &[Lay], album: &mut Album) -> String {
    if subject.cell.is_none() && lays.len() < 2 {
        return String::new();
    }
    let figures: String = lays.iter().zip(1..).map(|(lay, number)| figure(subject, lay, number, lays.len(), album)).collect();
    format!(
        "<section class=\"lays\">\n<h2>How the part lies on the plate</h2>\n<p>Drawn to scale with the table at 0°, in millimetres; a \
         plate too wide for its drawing is cut off at break lines. Offsets are those of the box around the part from the table’s \
         axis; table angles are counter-clockwise, seen from above, from the 0° mark.</p>\n{figures}</section>\n"
    )
}

fn figure(subject: &ReportSubject<'_>, lay: &Lay, setup: usize, setups: usize, album: &mut Album) -> String {
    let placed = PlacedPart::new(subject, &lay.table_from_part);
    let up = up(&lay.table_from_part);
    let title = match (setups, &lay.turn) {
        (1, _) => "The part on the plate".to_owned(),
        (_, None) => format!("Setup {setup}: {}", lay.first_lie.as_deref().unwrap_or("as placed")),
        (_, Some(turn)) => format!("Setup {setup}, from setup 1: {}{}", turn_phrase(turn), leaning(&up, turn)),
    };
    let facts: String =
        facts(subject, lay, &placed).iter().map(|(name, value)| format!("<dt>{name}</dt><dd>{value}</dd>")).collect();
    format!(
        "<figure class=\"lay\" data-setup=\"{setup}\">\n<figcaption><h3>{title}</h3></figcaption>\n<div class=\"panels\">{}{}{}</div>\n\
         <figcaption><dl class=\"details\">{facts}</dl></figcaption>\n</figure>\n",
        drawing::from_above(&placed, album),
        drawing::enlarged(&placed, album),
        drawing::from_front(&placed, &up.short, album)
    )
}

/// The lean of a part after a turn that does not tell it, in a clause; empty where it stands upright.
fn leaning(up: &Up, turn: &Turn) -> String {
    let lean_deg = up.lean_deg.filter(|_| turn.kind != TurnKind::Tilt);
    lean_deg.map_or_else(String::new, |deg| format!("; it leans {}°", number(deg, 1)))
}

/// Direction of the file that points up.
struct Up {
    /// "+z".
    short: String,
    /// Words for it, with how far it leans.
    long: String,
    /// Angle by which it leans, degrees; `None` where it counts as upright.
    lean_deg: Option<f64>,
}

fn up(table_from_part: &Pose<Table, Part>) -> Up {
    let up = table_from_part.inverse().direction(&Vector3::z());
    let axis = (1..3).fold(0, |best, axis| if up[axis].abs() > up[best].abs() + 1e-9 { axis } else { best });
    let short = format!("{}{}", if up[axis] < 0.0 { '−' } else { '+' }, AXES[axis]);
    let lean_deg = Some(up[axis].abs().min(1.0).acos().to_degrees()).filter(|deg| *deg > UPRIGHT_DEG);
    let long = match lean_deg {
        Some(deg) => format!("{short} of the file, leaning by {}°", number(deg, 1)),
        None => format!("{short} of the file"),
    };
    Up { short, long, lean_deg }
}

/// Axis of the file that lies flattest of x and y, and the angle of the table that it points to, degrees.
fn heading(table_from_part: &Pose<Table, Part>) -> (char, f64) {
    let [x, y] = [Vector3::x(), Vector3::y()].map(|axis| table_from_part.direction(&axis));
    let (name, flat) = if x.xy().norm() + 1e-9 >= y.xy().norm() { ('x', x) } else { ('y', y) };
    (name, flat.y.atan2(flat.x).to_degrees())
}

fn facts(subject: &ReportSubject<'_>, lay: &Lay, placed: &PlacedPart) -> Vec<(&'static str, String)> {
    let aabb = &placed.aabb;
    let span = |axis: usize| format!("{} {} to {}", AXES[axis], number(aabb.min[axis], 1), number(aabb.max[axis], 1));
    let pose = PoseSpec::from(&lay.table_from_part);
    let [qx, qy, qz, qw] = pose.quaternion_xyzw.map(|value| number(value, 5));
    let (axis, heading_deg) = heading(&lay.table_from_part);
    let mut facts = vec![
        ("Up", up(&lay.table_from_part).long),
        ("Box on the table", format!("{} mm", [0, 1, 2].map(span).join(", "))),
        ("Turned", format!("{axis} of the file points to {}° of the table", number(heading_deg, 1))),
        (
            "Pose (<code>table_from_part</code>)",
            format!("{} mm, quaternion x y z w ({qx}, {qy}, {qz}, {qw})", triple(pose.translation_mm, 3)),
        ),
    ];
    if let Some(cell) = subject.cell {
        facts.push(("Plate", format!("Ø {} mm", number(2.0 * cell.turntable.plate_radius_mm, 1))));
    }
    if let Some([distance_mm, angle_rad]) = placed.robot {
        let angle = number(angle_rad.to_degrees(), 1);
        facts.push(("Robot’s foot", format!("{} mm from the axis, at {angle}° of the table", number(distance_mm, 0))));
    }
    facts
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;
    use crate::planning::plan::PartSide;

    fn turned(axis: nalgebra::Unit<Vector3<f64>>, deg: f64) -> Pose<Table, Part> {
        Pose::from_parts(Vector3::zeros(), UnitQuaternion::from_axis_angle(&axis, deg.to_radians()))
    }

    #[test]
    fn the_side_up_is_named_by_the_file_s_axis() {
        assert_eq!(up(&turned(Vector3::x_axis(), 0.0)).long, "+z of the file");
        assert_eq!(up(&turned(Vector3::x_axis(), 180.0)).short, "−z");
        // A quarter turn about x brings +y up.
        assert_eq!(up(&turned(Vector3::x_axis(), 90.0)).short, "+y");
        assert_eq!(up(&turned(Vector3::y_axis(), 30.0)).long, "+z of the file, leaning by 30.0°");
    }

    #[test]
    fn a_heading_names_a_lean_that_its_turn_does_not_tell() {
        let told = |kind: TurnKind, deg: f64| {
            let turn = Turn { kind, side: PartSide::Right, angle_rad: deg.to_radians() };
            leaning(&up(&turned(Vector3::y_axis(), deg)), &turn)
        };
        assert_eq!(told(TurnKind::UpsideDown, 163.7), "; it leans 16.3°");
        assert_eq!((told(TurnKind::UpsideDown, 180.0), told(TurnKind::Tilt, 30.0)), (String::new(), String::new()));
    }

    #[test]
    fn the_heading_is_that_of_an_axis_that_lies_flat() {
        let (axis, deg) = heading(&turned(Vector3::z_axis(), 40.0));
        assert!(axis == 'x' && (deg - 40.0).abs() < 1e-9, "{axis} {deg}");
        // x stands upright: y tells.
        let (axis, deg) = heading(&turned(Vector3::y_axis(), 90.0));
        assert!(axis == 'y' && (deg - 90.0).abs() < 1e-9, "{axis} {deg}");
    }
}
