//! Drawings of a part on its plate, to scale: from above, with the table's axis, the 0° mark and the robot's side, and from the
//! front, with the side that is up. The part is rendered by a camera far away; its outline, box and offsets are drawn over it.
//! Table frame, millimetres; a drawing has y or z up the page.

use std::f64::consts::{FRAC_PI_3, PI};
use std::fmt::Write;

use nalgebra::Vector3;

use super::ReportSubject;
use super::album::{Album, Picture};
use super::markup::number;
use super::outline::hull;
use crate::geometry::{Aabb, Mesh, Part, Pose, Table};
use crate::rendering::{Camera, Ink};

/// Width and height of the drawing from above, units of the drawing.
const ABOVE: f64 = 560.0;
/// Radius of the plate in it, or of what reaches beyond.
const REACH: f64 = 150.0;
/// Width and height of the drawing from the front.
const FRONT: [f64; 2] = [480.0, 560.0];
/// Size that the part may take in it.
const FRONT_PART: [f64; 2] = [270.0, 380.0];
/// Height of the plate's face in it.
const FRONT_PLATE_Y: f64 = 470.0;
/// Middle of the part in it.
const FRONT_X: f64 = 235.0;
/// Ends of the plate in it where there is no room for all of it.
const FRONT_ENDS: [f64; 2] = [70.0, 400.0];
/// Top of the name of the side that is up in it, over its arrow.
const UP_ARROW_TOP: f64 = 180.0;
/// Distance of dimension lines from what they measure.
const OFF: f64 = 46.0;
/// Pixels of the rendered part a unit.
const PX_PER_UNIT: f64 = 1.5;
/// Margin around the rendered part, units.
const MARGIN: f64 = 4.0;
/// Distance below which two marks of a dimension are one, mm.
const SAME_MARK_MM: f64 = 0.05;
/// Length of the drawn axes of the file.
const AXIS: f64 = 26.0;
/// Height that a number needs.
const ROW: f64 = 20.0;
/// Width that a number needs.
const COLUMN: f64 = 50.0;
/// Height of a title above what is drawn.
const TITLE: f64 = 56.0;
/// Share of the plate's diameter below which a part is drawn from above once more, enlarged: too small to tell which way it faces.
const SMALL: f64 = 0.35;
/// Size of the enlarged part.
const ENLARGED_PART: f64 = 300.0;
/// Size of the drawing of the enlarged part.
const ENLARGED: f64 = 480.0;

/// A part where it lies.
pub(super) struct PlacedPart {
    table_from_part: Pose<Table, Part>,
    /// Box around the part, table frame.
    pub(super) aabb: Aabb,
    /// Outlines of part and fixture from above, mm.
    outline: Vec<[f64; 2]>,
    fixture: Vec<[f64; 2]>,
    plate_radius_mm: Option<f64>,
    /// Distance of the robot's foot from the axis, mm, and the angle of the table at which it stands, radians.
    pub(super) robot: Option<[f64; 2]>,
}

impl PlacedPart {
    /// The part in a pose.
    pub(super) fn new(subject: &ReportSubject<'_>, table_from_part: &Pose<Table, Part>) -> Self {
        let from_above = |mesh: &Mesh| hull(mesh.vertices_mm.iter().map(|p| table_from_part.point(p)).map(|p| [p.x, p.y]));
        let foot = subject.cell.map(|cell| cell.base_from_table.inverse().origin_mm());
        Self {
            table_from_part: *table_from_part,
            aabb: subject.mesh.vertices_mm.iter().fold(Aabb::empty(), |aabb, p| aabb.with(&table_from_part.point(p))),
            outline: from_above(subject.mesh),
            fixture: subject.fixture.map(from_above).unwrap_or_default(),
            plate_radius_mm: subject.cell.map(|cell| cell.turntable.plate_radius_mm),
            // Zero has no sign here: straight behind is 180°, not −180°.
            robot: foot.map(|foot| [foot.x.hypot(foot.y), (foot.y + 0.0).atan2(foot.x)]),
        }
    }

    /// Returns true if the robot stands neither behind the table nor in front of it: from above, its mark is beside the part.
    fn is_robot_beside(&self) -> bool {
        self.robot.is_none_or(|[_, angle_rad]| angle_rad.sin().abs() <= 0.5)
    }

    /// The rendered part as an image of the drawing, seen from `towards_camera` with `up` up the page; its box's centre at `at`.
    fn image(&self, album: &mut Album, [towards_camera, up]: [Vector3<f64>; 2], scale: f64, at: [f64; 2]) -> String {
        let part_from_table = self.table_from_part.inverse();
        let extent_mm = self.aabb.extent_mm();
        let across_mm = extent_mm.dot(&up.cross(&towards_camera).abs());
        let size_px =
            [across_mm, extent_mm.dot(&up.abs())].map(|mm| ((mm * scale + 2.0 * MARGIN) * PX_PER_UNIT).ceil().max(1.0) as usize);
        let directions = [towards_camera, up].map(|direction| part_from_table.direction(&direction));
        let (centre_mm, radius_mm) = (part_from_table.point(&self.aabb.centre()), 0.5 * extent_mm.norm());
        let camera = Camera::from_afar(&centre_mm, directions, radius_mm, scale * PX_PER_UNIT, size_px);
        let inks = album.plain(Ink::ByOthers);
        let [width, height] = size_px.map(|px| px as f64 / PX_PER_UNIT);
        format!(
            "<image x=\"{:.2}\" y=\"{:.2}\" width=\"{width:.2}\" height=\"{height:.2}\" href=\"{}\"/>",
            at[0] - 0.5 * width,
            at[1] - 0.5 * height,
            album.add(Picture { camera, inks, through: false })
        )
    }

    /// Axes of the file as the page shows them, from their directions across and up it.
    fn axes(&self, [x0, y0]: [f64; 2], across_and_up: impl Fn(&Vector3<f64>) -> [f64; 2]) -> String {
        let (mut svg, mut lowest) = (String::new(), y0);
        for (name, axis) in [("x", Vector3::x()), ("y", Vector3::y()), ("z", Vector3::z())] {
            let [across, up] = across_and_up(&self.table_from_part.direction(&axis));
            let (x, y) = (x0 + AXIS * across, y0 - AXIS * up);
            let (name_x, name_y) = (x0 + (AXIS + 11.0) * across, y0 - (AXIS + 11.0) * up + 4.0);
            lowest = lowest.max(name_y);
            // An axis towards or away from the reader has no length here.
            if across.hypot(up) > 0.2 {
                // Writing to a String cannot fail.
                let _ = write!(svg, "<line class=\"axes\" x1=\"{x0}\" y1=\"{y0}\" x2=\"{x:.1}\" y2=\"{y:.1}\"/>");
                let _ = write!(svg, "<text class=\"small\" x=\"{name_x:.1}\" y=\"{name_y:.1}\">{name}</text>");
            }
        }
        // Below an axis that points down.
        let below = (y0 + 32.0).max(lowest + 15.0);
        let _ = write!(svg, "<text class=\"small\" x=\"{x0}\" y=\"{below:.1}\">axes of the file</text>");
        svg
    }
}

/// The plate from above.
pub(super) fn from_above(placed: &PlacedPart, album: &mut Album) -> String {
    let middle = 0.5 * ABOVE;
    let corners = [placed.aabb.min, placed.aabb.max].map(|p| p.x.abs().max(p.y.abs()));
    let part_mm = placed.outline.iter().map(|[x, y]| x.hypot(*y)).fold(corners[0].max(corners[1]), f64::max);
    let scale = REACH / placed.plate_radius_mm.unwrap_or(0.0).max(part_mm).max(f64::MIN_POSITIVE);
    let at = |x_mm: f64, y_mm: f64| [middle + scale * x_mm, middle - scale * y_mm];
    let centre_mm = placed.aabb.centre();
    // Over the plate stands its 90°, if not the robot's mark or the lengths along x.
    let top = if placed.is_robot_beside() { middle - REACH - 20.0 - TITLE } else { 0.0 };
    let mut svg = format!(
        "<svg class=\"drawing\" viewBox=\"0 {top} {ABOVE} {}\" role=\"img\" aria-label=\"The part on the plate from above, with \
         its offsets from the table’s axis\">\n",
        ABOVE - top
    );
    // Writing to a String cannot fail.
    if let Some(radius_mm) = placed.plate_radius_mm {
        let _ = writeln!(svg, "<circle class=\"plate\" cx=\"{middle}\" cy=\"{middle}\" r=\"{:.1}\"/>", scale * radius_mm);
    }
    svg += &placed.image(album, [Vector3::z(), Vector3::y()], scale, at(centre_mm.x, centre_mm.y));
    for (class, points) in [("outline", &placed.outline), ("fixture", &placed.fixture)] {
        let points: Vec<String> = points.iter().map(|[x, y]| at(*x, *y)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        if !points.is_empty() {
            let _ = writeln!(svg, "<polygon class=\"{class}\" points=\"{}\"/>", points.join(" "));
        }
    }
    svg += &offsets(placed, &at);
    svg += &table_marks(placed, scale);
    svg += &placed.axes([52.0, ABOVE - 62.0], |direction| [direction.x, direction.y]);
    let _ = writeln!(svg, "<text class=\"title\" x=\"14\" y=\"{}\">From above, table at 0°</text>", top + 24.0);
    svg + "</svg>\n"
}

/// A part that is small on its plate, from above and as large as there is room, with the sides of 0° and of the robot; empty for
/// others.
pub(super) fn enlarged(placed: &PlacedPart, album: &mut Album) -> String {
    let Some(scale) = enlarged_scale(placed) else { return String::new() };
    let middle = 0.5 * ENLARGED;
    let centre_mm = placed.aabb.centre();
    let at = |x_mm: f64, y_mm: f64| [middle + scale * (x_mm - centre_mm.x), middle - scale * (y_mm - centre_mm.y)];
    let times = placed.plate_radius_mm.map_or(1.0, |radius_mm| scale * radius_mm / REACH);
    let part_top = middle - 0.5 * scale * placed.aabb.extent_mm().y;
    let top = if placed.is_robot_beside() { (part_top - TITLE).floor().max(0.0) } else { 0.0 };
    let mut svg = format!(
        "<svg class=\"drawing\" viewBox=\"0 {top} {ENLARGED} {}\" role=\"img\" aria-label=\"The part from above, enlarged\">\n",
        ENLARGED - top
    );
    svg += &placed.image(album, [Vector3::z(), Vector3::y()], scale, [middle, middle]);
    let points: Vec<String> = placed.outline.iter().map(|[x, y]| at(*x, *y)).map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
    // Writing to a String cannot fail.
    let _ = writeln!(svg, "<polygon class=\"outline\" points=\"{}\"/>", points.join(" "));
    let sides = [("0°", Some(0.0)), ("robot", placed.robot.map(|[_, angle_rad]| angle_rad))];
    for (name, angle_rad) in sides.into_iter().filter_map(|(name, angle_rad)| Some((name, angle_rad?))) {
        svg += &side(name, angle_rad, middle);
    }
    let [x, y] = at(0.0, 0.0);
    if [x, y].iter().all(|place| (9.0..=ENLARGED - 9.0).contains(place)) {
        let _ = writeln!(svg, "<path class=\"axis\" d=\"M{:.1} {y:.1}h18M{x:.1} {:.1}v18\"/>", x - 9.0, y - 9.0);
    }
    svg += &placed.axes([52.0, ENLARGED - 62.0], |direction| [direction.x, direction.y]);
    let title = format!("From above, enlarged {} times", number(times, usize::from(times < 10.0)));
    let _ = writeln!(svg, "<text class=\"title\" x=\"14\" y=\"{}\">{title}</text>", top + 24.0);
    svg + "</svg>\n"
}

/// Units of the enlarged drawing for a millimetre of a part that is small on its plate.
fn enlarged_scale(placed: &PlacedPart) -> Option<f64> {
    let extent_mm = placed.aabb.extent_mm();
    let across_mm = extent_mm.x.max(extent_mm.y).max(f64::MIN_POSITIVE);
    let is_small = across_mm < SMALL * 2.0 * placed.plate_radius_mm?;
    is_small.then_some(ENLARGED_PART / across_mm)
}

/// Arrow and name of a side, at an angle of the table, outside the enlarged part.
fn side(name: &str, angle_rad: f64, middle: f64) -> String {
    let (sin, cos) = angle_rad.sin_cos();
    let at = |radius: f64, aside: f64| (middle + radius * cos - aside * sin, middle - radius * sin - aside * cos);
    let from = 0.5 * ENLARGED_PART + 12.0;
    let corners = [at(from, -6.0), at(from + 14.0, 0.0), at(from, 6.0)].map(|(x, y)| format!("{x:.1},{y:.1}"));
    let (x, y) = at(from + 22.0 + 24.0 * cos.abs(), 0.0);
    format!(
        "<polygon class=\"robot\" points=\"{}\"/><text class=\"mark\" x=\"{x:.1}\" y=\"{:.1}\">{name}</text>\n",
        corners.join(" "),
        y + 5.0
    )
}

/// The table's axis, its 0° and 90°, and the robot's side.
fn table_marks(placed: &PlacedPart, scale: f64) -> String {
    let middle = 0.5 * ABOVE;
    let rim = placed.plate_radius_mm.map_or(REACH, |radius_mm| scale * radius_mm);
    let mut svg = String::new();
    // Writing to a String cannot fail.
    let (low, high) = (middle - 9.0, middle + 9.0);
    let _ = writeln!(svg, "<path class=\"axis\" d=\"M{low} {middle}H{high}M{middle} {low}V{high}\"/>");
    let _ = writeln!(svg, "<circle class=\"axis\" cx=\"{middle}\" cy=\"{middle}\" r=\"4\"/>");
    if placed.plate_radius_mm.is_some() {
        let (x, label_x) = (middle + rim, middle + rim + 13.0);
        let _ = writeln!(svg, "<path class=\"mark\" d=\"M{x:.1} {middle}l12 -6v12z\"/>");
        // Above its mark: the dimensions of y are beside it.
        let _ = writeln!(svg, "<text class=\"mark\" x=\"{label_x:.1}\" y=\"{:.1}\">0°</text>", middle - 12.0);
        let _ = writeln!(svg, "<text class=\"small\" x=\"{middle}\" y=\"{:.1}\">90°</text>", middle - rim - 6.0);
    }
    if let Some([distance_mm, angle_rad]) = placed.robot {
        let along = |radius: f64, aside: f64| {
            let (sin, cos) = angle_rad.sin_cos();
            format!("{:.1},{:.1}", middle + radius * cos - aside * sin, middle - radius * sin - aside * cos)
        };
        let from = REACH + 36.0;
        let arrow = [
            along(from, -4.0),
            along(from + 14.0, -4.0),
            along(from + 14.0, -10.0),
            along(from + 28.0, 0.0),
            along(from + 14.0, 10.0),
            along(from + 14.0, 4.0),
            along(from, 4.0),
        ];
        let _ = writeln!(svg, "<polygon class=\"robot\" points=\"{}\"/>", arrow.join(" "));
        let (sin, cos) = angle_rad.sin_cos();
        // A word is wider than it is high.
        let label = from + 44.0 + 18.0 * cos.abs();
        let (x, y) = (middle + label * cos, middle - label * sin);
        let _ = writeln!(svg, "<text class=\"robot\" x=\"{x:.1}\" y=\"{y:.1}\">robot</text>");
        let _ = writeln!(svg, "<text class=\"small\" x=\"{x:.1}\" y=\"{:.1}\">{} mm</text>", y + 16.0, number(distance_mm, 0));
    }
    svg
}

/// Box around the part, and its offsets from the axis along x and y, on the sides away from the robot.
fn offsets(placed: &PlacedPart, at: &impl Fn(f64, f64) -> [f64; 2]) -> String {
    let (min, max) = (placed.aabb.min, placed.aabb.max);
    let ([left, bottom], [right, top]) = (at(min.x, min.y), at(max.x, max.y));
    let is_robot_near = |angle_rad: f64| {
        let off = |[_, robot_rad]: [f64; 2]| ((robot_rad - angle_rad + PI).rem_euclid(2.0 * PI) - PI).abs();
        placed.robot.is_some_and(|robot| off(robot) < FRAC_PI_3)
    };
    let mut svg = format!(
        "<rect class=\"box\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>\n",
        right - left,
        bottom - top
    );
    let below = !is_robot_near(-0.5 * PI);
    let (from, line) = if below { (bottom, 0.5 * ABOVE + REACH + OFF) } else { (top, 0.5 * ABOVE - REACH - OFF) };
    let across = Dimension { line, from, out: if below { 1.0 } else { -1.0 } };
    svg += &across.horizontal([min.x, max.x], |x_mm| at(x_mm, 0.0)[0]);
    let beside = !is_robot_near(0.0);
    let (from, line) = if beside { (right, 0.5 * ABOVE + REACH + OFF) } else { (left, 0.5 * ABOVE - REACH - OFF) };
    let up = Dimension { line, from, out: if beside { 1.0 } else { -1.0 } };
    svg + &up.vertical([min.y, max.y], |y_mm| at(0.0, y_mm)[1])
}

/// The part from the front, and the side of it that is up.
pub(super) fn from_front(placed: &PlacedPart, up: &str, album: &mut Album) -> String {
    let [width, height] = FRONT;
    let (min, max) = (placed.aabb.min, placed.aabb.max);
    let wide_mm = (max.x - min.x).max(f64::MIN_POSITIVE);
    let (low_mm, high_mm) = (min.z.min(0.0), max.z);
    let scale = (FRONT_PART[0] / wide_mm).min(FRONT_PART[1] / (high_mm - low_mm).max(f64::MIN_POSITIVE));
    let at = |x_mm: f64, z_mm: f64| [FRONT_X + scale * (x_mm - 0.5 * (min.x + max.x)), FRONT_PLATE_Y - scale * z_mm];
    let top = (UP_ARROW_TOP.min(at(0.0, high_mm)[1] - 26.0) - TITLE).floor().max(0.0);
    let mut svg = format!(
        "<svg class=\"drawing\" viewBox=\"0 {top} {width} {}\" role=\"img\" aria-label=\"The part on the plate from the front, \
         {up} of the file up\">\n",
        height - top
    );
    svg += &ground(placed.plate_radius_mm.map_or(FRONT_ENDS, |radius_mm| [-radius_mm, radius_mm].map(|x_mm| at(x_mm, 0.0)[0])));
    svg += &placed.image(album, [-Vector3::y(), Vector3::z()], scale, at(0.5 * (min.x + max.x), 0.5 * (min.z + max.z)));
    let [axis_x, part_top] = at(0.0, high_mm);
    // Writing to a String cannot fail.
    if (FRONT_ENDS[0]..=FRONT_ENDS[1]).contains(&axis_x) {
        let _ = writeln!(svg, "<path class=\"axis\" d=\"M{axis_x:.1} {:.1}V{:.1}\"/>", part_top - 26.0, FRONT_PLATE_Y + 26.0);
        let _ = writeln!(svg, "<text class=\"small\" x=\"{axis_x:.1}\" y=\"{:.1}\">table’s axis</text>", FRONT_PLATE_Y + 40.0);
    }
    let heights = Dimension { line: 418.0, from: at(max.x, 0.0)[0], out: 1.0 };
    svg += &heights.vertical([min.z, max.z], |z_mm| at(0.0, z_mm)[1]);
    let arrow = "M34 330v-90h-12l20 -30l20 30h-12v90z";
    let _ = writeln!(svg, "<path class=\"up\" d=\"{arrow}\"/><text class=\"up\" x=\"42\" y=\"198\">{up}</text>");
    let _ = writeln!(svg, "<text class=\"small\" x=\"42\" y=\"350\">this side up</text>");
    svg += &placed.axes([52.0, height - 62.0], |direction| [direction.x, direction.z]);
    let _ = writeln!(svg, "<text class=\"title\" x=\"14\" y=\"{}\">From the front (−90° of the table)</text>", top + 24.0);
    svg + "</svg>\n"
}

/// The plate from the front between its two ends: whole where there is room, else cut off at break lines, with a word on that.
fn ground(ends: [f64; 2]) -> String {
    let [first, last] = FRONT_ENDS;
    let [left, right] = ends.map(|end| end.clamp(first, last));
    let mut svg = format!("<path class=\"ground\" d=\"M{left:.1} {FRONT_PLATE_Y}H{right:.1}v10H{left:.1}z\"/>\n");
    let cuts = [(ends[0] < first, left), (ends[1] > last, right)].into_iter().filter_map(|(is_cut, x)| is_cut.then_some(x));
    let lines: String =
        cuts.map(|x| format!("<path class=\"break\" d=\"M{x:.1} {}v8l-6 5l12 8l-6 5v8\"/>\n", FRONT_PLATE_Y - 12.0)).collect();
    if !lines.is_empty() {
        svg += &lines;
        // Writing to a String cannot fail.
        let _ = writeln!(
            svg,
            "<text class=\"small end\" x=\"{last:.1}\" y=\"{:.1}\">plate drawn shortened</text>",
            FRONT_PLATE_Y + 60.0
        );
    }
    svg
}

/// A dimension line, beside what it measures.
struct Dimension {
    /// Place of the line across its direction.
    line: f64,
    /// Place from which its extension lines come.
    from: f64,
    /// Side of the line on which the numbers stand: 1 for right or below, −1 for left or above.
    out: f64,
}

impl Dimension {
    /// Lengths between the two ends and the axis at 0, along x.
    fn horizontal(&self, ends_mm: [f64; 2], x: impl Fn(f64) -> f64) -> String {
        let (line, from, mut svg) = (self.line, self.from, String::new());
        let ticks = ticks(ends_mm);
        for tick_mm in &ticks {
            let x = x(*tick_mm);
            // Writing to a String cannot fail.
            let _ = writeln!(svg, "<path class=\"extension\" d=\"M{x:.1} {from:.1}V{:.1}\"/>", line + 5.0 * self.out);
            let _ = writeln!(svg, "<path class=\"dimension\" d=\"M{:.1} {:.1}l8 -8\"/>", x - 4.0, line + 4.0);
        }
        for (place, pair) in ticks.windows(2).enumerate() {
            let [a, b] = [x(pair[0]), x(pair[1])];
            // Numbers over short lengths stand in two rows.
            let row = if (b - a).abs() < COLUMN && place % 2 == 1 { 34.0 } else { 18.0 };
            let y = line + self.out * row + if self.out > 0.0 { 0.0 } else { 10.0 };
            let _ = writeln!(svg, "<path class=\"dimension\" d=\"M{a:.1} {line:.1}H{b:.1}\"/>");
            let middle = 0.5 * (a + b);
            let _ =
                writeln!(svg, "<text class=\"dimension\" x=\"{middle:.1}\" y=\"{y:.1}\">{}</text>", number(pair[1] - pair[0], 1));
        }
        svg
    }

    /// Lengths between the two ends and the axis at 0, along y or z, up the page.
    fn vertical(&self, ends_mm: [f64; 2], y: impl Fn(f64) -> f64) -> String {
        let (line, from, mut svg) = (self.line, self.from, String::new());
        let ticks = ticks(ends_mm);
        for tick_mm in &ticks {
            let y = y(*tick_mm);
            // Writing to a String cannot fail.
            let _ = writeln!(svg, "<path class=\"extension\" d=\"M{from:.1} {y:.1}H{:.1}\"/>", line + 5.0 * self.out);
            let _ = writeln!(svg, "<path class=\"dimension\" d=\"M{:.1} {:.1}l8 -8\"/>", line - 4.0, y + 4.0);
        }
        let side = if self.out > 0.0 { "start" } else { "end" };
        for (place, pair) in ticks.windows(2).enumerate() {
            let [a, b] = [y(pair[0]), y(pair[1])];
            // Numbers over short lengths stand in two columns.
            let column = if (b - a).abs() < ROW && place % 2 == 1 { 8.0 + COLUMN } else { 8.0 };
            let _ = writeln!(svg, "<path class=\"dimension\" d=\"M{line:.1} {a:.1}V{b:.1}\"/>");
            let _ = writeln!(
                svg,
                "<text class=\"dimension {side}\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                line + column * self.out,
                0.5 * (a + b) + 5.0,
                number(pair[1] - pair[0], 1)
            );
        }
        svg
    }
}

/// The two ends and the axis in ascending order, each once.
fn ticks([low_mm, high_mm]: [f64; 2]) -> Vec<f64> {
    let mut ticks = vec![low_mm, 0.0, high_mm];
    ticks.sort_by(f64::total_cmp);
    ticks.dedup_by(|b, a| *b - *a < SAME_MARK_MM);
    ticks
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::{PlacedPart, ticks};
    use crate::geometry::Pose;
    use crate::report::html::ReportSubject;
    use crate::testing::{box_mesh, nominal_scanner};
    use crate::wire::echo::Echo;

    #[test]
    fn the_name_of_the_axes_is_below_an_axis_that_points_down() {
        let (mesh, scanner, echo) = (box_mesh([0.0; 3], [60.0, 40.0, 30.0]), nominal_scanner(), Echo::default());
        let subject = ReportSubject {
            mesh: &mesh,
            fixture: None,
            part_sha256: "",
            part_name: "block",
            scanner: &scanner,
            cell: None,
            echo: &echo,
            date: None,
            size_warnings: &[],
        };
        for turned_deg in [0.0, 160.0, 180.0] {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), f64::to_radians(turned_deg));
            let placed = PlacedPart::new(&subject, &Pose::from_parts(Vector3::zeros(), turn));
            let svg = placed.axes([52.0, 300.0], |direction| [direction.x, direction.z]);
            let heights: Vec<f64> =
                svg.split(" y=\"").skip(1).filter_map(|piece| piece.split('"').next()?.parse().ok()).collect();
            let (name, axes) = heights.split_last().expect("texts");
            assert!(axes.iter().all(|axis| axis + 12.0 <= *name), "{turned_deg}°: {name} under {axes:?}");
        }
    }

    #[test]
    fn numbers_of_short_lengths_stand_beside_each_other() {
        let up = super::Dimension { line: 400.0, from: 300.0, out: 1.0 };
        let columns = |scale: f64| {
            let svg = up.vertical([-3.4, 3.4], |y_mm| 280.0 - scale * y_mm);
            let texts = svg.split("<text").skip(1).filter_map(|text| text.split("x=\"").nth(1)?.split('"').next()?.parse().ok());
            texts.collect::<Vec<f64>>()
        };
        assert_eq!(columns(10.0), [408.0, 408.0], "there is room for one above the other");
        assert_eq!(columns(0.6), [408.0, 408.0 + super::COLUMN]);
    }

    #[test]
    fn a_part_that_is_small_on_its_plate_is_drawn_enlarged_too() {
        let (mesh, scanner, echo) = (box_mesh([0.0; 3], [60.0, 40.0, 30.0]), nominal_scanner(), Echo::default());
        let subject = ReportSubject {
            mesh: &mesh,
            fixture: None,
            part_sha256: "",
            part_name: "block",
            scanner: &scanner,
            cell: None,
            echo: &echo,
            date: None,
            size_warnings: &[],
        };
        let mut placed = PlacedPart::new(&subject, &Pose::identity());
        assert_eq!(super::enlarged_scale(&placed), None, "no plate to be small on");
        placed.plate_radius_mm = Some(80.0);
        assert_eq!(super::enlarged_scale(&placed), None, "60 mm of 160 mm are large enough");
        placed.plate_radius_mm = Some(250.0);
        assert_eq!(super::enlarged_scale(&placed), Some(5.0), "300 units for 60 mm");
    }

    #[test]
    fn only_a_robot_behind_or_in_front_needs_room_above_the_part() {
        let (mesh, scanner, echo) = (box_mesh([0.0; 3], [60.0, 40.0, 30.0]), nominal_scanner(), Echo::default());
        let subject = ReportSubject {
            mesh: &mesh,
            fixture: None,
            part_sha256: "",
            part_name: "block",
            scanner: &scanner,
            cell: None,
            echo: &echo,
            date: None,
            size_warnings: &[],
        };
        let mut placed = PlacedPart::new(&subject, &Pose::identity());
        for (angle_deg, is_beside) in [(180.0, true), (-20.0, true), (90.0, false), (-90.0, false)] {
            placed.robot = Some([400.0, f64::to_radians(angle_deg)]);
            assert_eq!(placed.is_robot_beside(), is_beside, "{angle_deg}°");
        }
    }

    #[test]
    fn sides_are_named_outside_the_enlarged_part() {
        let names = [("0°", 0.0), ("robot", std::f64::consts::PI)].map(|(name, rad)| super::side(name, rad, 240.0));
        assert!(names[0].contains("points=\"402.0,246.0 416.0,240.0 402.0,234.0\""), "{names:?}");
        assert!(names[1].contains("x=\"32.0\"") && names[1].ends_with(">robot</text>\n"), "{names:?}");
    }

    #[test]
    fn a_plate_that_has_no_room_is_cut_off_at_break_lines_and_says_so() {
        let whole = super::ground([100.0, 370.0]);
        assert!(whole.contains("M100.0 470H370.0") && !whole.contains("break") && !whole.contains("shortened"), "{whole}");
        for (ends, drawn, breaks) in [([-300.0, 800.0], "M70.0 470H400.0", 2), ([90.0, 500.0], "M90.0 470H400.0", 1)] {
            let cut = super::ground(ends);
            assert!(cut.contains(drawn) && cut.contains(">plate drawn shortened</text>"), "{cut}");
            assert_eq!(cut.matches("class=\"break\"").count(), breaks, "{cut}");
        }
    }

    #[test]
    fn lengths_are_told_between_the_ends_and_the_axis_in_any_order() {
        assert_eq!(ticks([-60.5, 60.5]), [-60.5, 0.0, 60.5]);
        assert_eq!(ticks([12.0, 40.0]), [0.0, 12.0, 40.0], "beside the axis");
        assert_eq!(ticks([-40.0, -12.0]), [-40.0, -12.0, 0.0]);
        assert_eq!(ticks([0.01, 37.2]).len(), 2, "what stands on the plate has one height");
    }
}
