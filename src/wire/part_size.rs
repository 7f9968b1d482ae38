//! Size of a part beside the scanner's field and the plate: what it would be in each unit of length, in which it would fit, and the
//! warnings on a size that a wrong unit makes. The one place where they are made, for the command line, jobs, plans and reports.

use nalgebra::Vector3;
use serde::Serialize;

use super::warnings::{FieldWarning, WarningCode};
use super::words::fixed;
use crate::cell::{Cell, PoseSpec, Scanner};
use crate::geometry::{Aabb, LengthUnit, Part, Pose, Table};

/// Share of the shorter side of the scanner's field that the longest edge of a part takes at least.
const MIN_OF_FIELD: f64 = 0.05;
/// Longest edge of a part without a plate, in longer sides of the field: beyond that a unit is not suggested.
const MAX_FIELDS: f64 = 20.0;

/// Lengths that a part is held against.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SizeLimits {
    /// Width and height of the field that all devices see at best focus, mm.
    field_mm: [f64; 2],
    /// Diameter of the plate, mm; `None` without a cell.
    plate_mm: Option<f64>,
}

/// Size of a file's part if its coordinates are read in a unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct UnitReading {
    /// The unit.
    #[serde(serialize_with = "as_name")]
    pub unit: LengthUnit,
    /// Edge lengths of the bounding box along the file's axes.
    pub size_mm: [f64; 3],
    /// True if the part suits scanner and plate; absent where none are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fits: Option<bool>,
}

fn as_name<S: serde::Serializer>(unit: &LengthUnit, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(unit.as_str())
}

/// A part's bounding box and the unit that its file was read in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartSize {
    /// Edge lengths along the file's axes, mm.
    pub size_mm: [f64; 3],
    /// Unit of the file's coordinates.
    pub unit: LengthUnit,
}

impl SizeLimits {
    /// Limits of a scanner, and of a cell's plate.
    #[must_use]
    pub fn new(scanner: &Scanner, cell: Option<&Cell>) -> Self {
        let field_mm = scanner.common_field_at(scanner.best_mm).size_mm();
        Self { field_mm, plate_mm: cell.map(|cell| 2.0 * cell.turntable.plate_radius_mm) }
    }

    /// Limits of a scanner's field and the plate's diameter.
    #[must_use]
    pub fn of_lengths(field_mm: [f64; 2], plate_mm: Option<f64>) -> Self {
        Self { field_mm, plate_mm }
    }

    /// Min and max length of the longest edge of a part for it to suit the scanner and the plate.
    #[must_use]
    pub fn edge_mm(&self) -> [f64; 2] {
        let [width_mm, height_mm] = self.field_mm;
        [MIN_OF_FIELD * width_mm.min(height_mm), self.plate_mm.unwrap_or(MAX_FIELDS * width_mm.max(height_mm))]
    }

    fn is_small(&self, size_mm: &[f64; 3]) -> bool {
        let [min_mm, _] = self.edge_mm();
        longest(size_mm) < min_mm
    }

    /// Returns true if a part of these edges along the table's x and y is wider than the plate.
    fn overhangs(&self, [x_mm, y_mm]: [f64; 2]) -> bool {
        self.plate_mm.is_some_and(|plate_mm| x_mm.max(y_mm) > plate_mm)
    }

    /// Returns true if a part suits the scanner and the plate, whichever way it lies.
    fn suits(&self, size_mm: &[f64; 3]) -> bool {
        let [min_mm, max_mm] = self.edge_mm();
        (min_mm..=max_mm).contains(&longest(size_mm))
    }
}

impl PartSize {
    /// Size of a bounding box that was read in a unit.
    #[must_use]
    pub fn new(aabb: &Aabb, unit: LengthUnit) -> Self {
        Self { size_mm: aabb.extent_mm().into(), unit }
    }

    /// Size in every unit; with limits also in which it fits.
    #[must_use]
    pub fn readings(&self, limits: Option<&SizeLimits>) -> [UnitReading; 4] {
        LengthUnit::ALL.map(|unit| {
            let size_mm = self.size_mm.map(|edge_mm| edge_mm * unit.mm() / self.unit.mm());
            UnitReading { unit, size_mm, fits: limits.map(|limits| limits.suits(&size_mm)) }
        })
    }

    /// Other units in which the part would suit scanner and plate, in words; `None` if there are none.
    #[must_use]
    pub fn other_units(&self, limits: &SizeLimits) -> Option<String> {
        let readings = self.readings(Some(limits)).into_iter();
        let fitting = readings.filter(|reading| reading.unit != self.unit && reading.fits == Some(true));
        let told: Vec<String> =
            fitting.map(|reading| format!("{} ({})", unit_text(reading.unit), size_text(&reading.size_mm))).collect();
        (!told.is_empty()).then(|| told.join(", or "))
    }

    /// Warnings on a part that is tiny in the scanner's field or larger than the plate; `table_from_part` is the pose that its
    /// user gave. `at` names the part: a pointer, or an option.
    #[must_use]
    pub fn warnings(&self, table_from_part: Option<&PoseSpec>, limits: &SizeLimits, at: &str) -> Vec<FieldWarning> {
        let lies_mm = self.lies_mm(table_from_part);
        let read = format!("is {} as read in {}", size_text(&self.size_mm), unit_text(self.unit));
        let [width, height] = limits.field_mm.map(|edge_mm| fixed(edge_mm, 0));
        let small = limits.is_small(&self.size_mm).then(|| {
            let detail = format!(
                "{read}: its longest edge, {} mm, is less than {:.0} % of the scanner's field ({width} × {height} mm at best focus)",
                length_text(longest(&self.size_mm)),
                100.0 * MIN_OF_FIELD
            );
            let right = "if that is its size, use a scanner with a smaller field".to_owned();
            self.warning(WarningCode::PartSmall, at, detail, limits, right)
        });
        let large = limits.plate_mm.filter(|_| limits.overhangs(lies_mm)).map(|plate_mm| {
            let [x, y] = lies_mm.map(length_text);
            let detail = format!("{read}: it covers {x} × {y} mm, but the plate's diameter is {} mm", length_text(plate_mm));
            let right = "if that is its size, lay it another way (part.table_from_part) or use a larger table".to_owned();
            self.warning(WarningCode::PartLargerThanPlate, at, detail, limits, right)
        });
        small.into_iter().chain(large).collect()
    }

    /// Question that comes before every other, if the unit is probably not that of the file: the part is tiny in the scanner's
    /// field, or is larger than the plate and would fit in another unit. `None` if the size is plausible.
    #[must_use]
    pub fn unit_question(&self, table_from_part: Option<&PoseSpec>, limits: &SizeLimits) -> Option<String> {
        let is_doubtful = limits.is_small(&self.size_mm)
            || limits.overhangs(self.lies_mm(table_from_part)) && self.other_units(limits).is_some();
        let read = || format!("Check the unit: the part is {} as read in {}", size_text(&self.size_mm), unit_text(self.unit));
        is_doubtful.then(read)
    }

    fn warning(&self, code: WarningCode, at: &str, detail: String, limits: &SizeLimits, right: String) -> FieldWarning {
        let remedy = match self.other_units(limits) {
            Some(units) => format!("it would fit if the file is in {units}: give that unit with the mesh; {right}"),
            None => right,
        };
        FieldWarning { code, pointer: at.to_owned(), detail, remedy }
    }

    /// Edges along the table's x and y of the box around the part's box, as the part lies.
    fn lies_mm(&self, table_from_part: Option<&PoseSpec>) -> [f64; 2] {
        let pose: Pose<Table, Part> = table_from_part.copied().unwrap_or_default().pose();
        let edges = [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().zip(self.size_mm);
        let lies = edges.map(|(axis, edge_mm)| pose.direction(&axis).abs() * edge_mm).sum::<Vector3<f64>>();
        [lies.x, lies.y]
    }
}

fn longest(size_mm: &[f64; 3]) -> f64 {
    size_mm.iter().copied().fold(0.0, f64::max)
}

/// Unit of a file's coordinates within a sentence: "in mm", "in inches".
#[must_use]
pub fn unit_text(unit: LengthUnit) -> &'static str {
    match unit {
        LengthUnit::Millimetre | LengthUnit::Centimetre | LengthUnit::Metre => unit.as_str(),
        LengthUnit::Inch => "inches",
    }
}

/// A size for people: three significant digits at least, and no more decimals than it takes.
#[must_use]
pub fn size_text(size_mm: &[f64; 3]) -> String {
    format!("{} mm", size_mm.map(length_text).join(" × "))
}

fn length_text(length_mm: f64) -> String {
    let decimals = match length_mm.abs() {
        nothing if nothing <= 0.0 => 0,
        below if below < 0.1 => 4,
        below if below < 10.0 => 2,
        below if below < 1000.0 => 1,
        _ => 0,
    };
    fixed(length_mm, decimals)
}

#[cfg(test)]
mod tests {
    use super::{PartSize, SizeLimits, unit_text};
    use crate::cell::{PoseSpec, Presets, SpecLibrary};
    use crate::geometry::LengthUnit;
    use crate::wire::warnings::WarningCode;

    /// The demo base, in inches.
    const BASE_IN: [f64; 3] = [4.76, 2.87, 1.46];

    fn in_the_default_cell() -> SizeLimits {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("valid");
        SizeLimits::new(&cell.scanner, Some(&cell))
    }

    fn read_in(unit: LengthUnit, file: [f64; 3]) -> PartSize {
        PartSize { size_mm: file.map(|edge| edge * unit.mm()), unit }
    }

    #[test]
    fn an_inch_part_read_as_mm_is_told_the_unit_that_fits() {
        let limits = in_the_default_cell();
        let warnings = read_in(LengthUnit::Millimetre, BASE_IN).warnings(None, &limits, "/mesh_id");
        let [warning] = &warnings[..] else { panic!("{warnings:?}") };
        assert_eq!((warning.code, warning.pointer.as_str()), (WarningCode::PartSmall, "/mesh_id"));
        assert!(
            warning.detail.contains("is 4.76 × 2.87 × 1.46 mm as read in mm") && warning.detail.contains("5 %"),
            "{warning:?}"
        );
        assert!(warning.remedy.contains("inches (120.9 × 72.9 × 37.1 mm)"), "{warning:?}");
        let question = "Check the unit: the part is 4.76 × 2.87 × 1.46 mm as read in mm";
        assert_eq!(read_in(LengthUnit::Millimetre, BASE_IN).unit_question(None, &limits).as_deref(), Some(question));
        let right = read_in(LengthUnit::Inch, BASE_IN);
        assert_eq!((right.warnings(None, &limits, ""), right.unit_question(None, &limits)), (vec![], None));
    }

    #[test]
    fn a_part_in_millimetres_read_as_metres_is_larger_than_the_plate() {
        let limits = in_the_default_cell();
        let read = read_in(LengthUnit::Metre, [121.0, 73.0, 37.0]);
        let warnings = read.warnings(None, &limits, "--unit");
        let [warning] = &warnings[..] else { panic!("{warnings:?}") };
        assert_eq!((warning.code, warning.pointer.as_str()), (WarningCode::PartLargerThanPlate, "--unit"));
        assert!(warning.detail.contains("121000 × 73000 mm, but the plate's diameter is 500"), "{warning:?}");
        assert!(warning.remedy.contains("mm (121.0 × 73.0 × 37.0 mm)") && !warning.remedy.contains("inch"), "{warning:?}");
        assert!(read.unit_question(None, &limits).is_some());
        // Too large, and so in every other unit.
        let large = read_in(LengthUnit::Millimetre, [560.0, 560.0, 90.0]);
        assert!(!large.warnings(None, &limits, "").is_empty() && large.unit_question(None, &limits).is_none());
        // The other way round: metres read as millimetres.
        let tiny = read_in(LengthUnit::Millimetre, [0.121, 0.073, 0.037]).warnings(None, &limits, "");
        assert!(tiny[0].code == WarningCode::PartSmall && tiny[0].remedy.contains("m (121.0"), "{tiny:?}");
    }

    /// "as read in inch" was told of a part in inches.
    #[test]
    fn a_unit_is_told_in_a_sentence_as_people_write_it() {
        assert_eq!(LengthUnit::ALL.map(unit_text), ["mm", "cm", "m", "inches"]);
        let huge = read_in(LengthUnit::Inch, [121.0, 73.0, 37.0]);
        let limits = in_the_default_cell();
        let read = "3073 × 1854 × 939.8 mm as read in inches";
        let warnings = huge.warnings(None, &limits, "/mesh_id");
        assert!(warnings[0].detail.starts_with(&format!("is {read}: it covers")), "{warnings:?}");
        assert_eq!(huge.unit_question(None, &limits), Some(format!("Check the unit: the part is {read}")));
        let other = huge.other_units(&limits);
        assert!(other.as_ref().is_some_and(|units| units.starts_with("mm (121.0") && !units.contains("inch")), "{other:?}");
    }

    #[test]
    fn the_pose_that_is_given_decides_what_lies_on_the_plate() {
        let limits = SizeLimits::of_lengths([300.0, 200.0], Some(500.0));
        let mast = PartSize { size_mm: [40.0, 40.0, 600.0], unit: LengthUnit::Millimetre };
        assert_eq!(mast.warnings(None, &limits, ""), [], "it stands");
        let lying: PoseSpec = serde_json::from_str(r#"{"translation_mm": [0, 0, 20], "rpy_deg": [90, 0, 0]}"#).expect("a pose");
        assert_eq!(mast.warnings(Some(&lying), &limits, "")[0].code, WarningCode::PartLargerThanPlate);
        assert_eq!(mast.warnings(Some(&lying), &SizeLimits::of_lengths([300.0, 200.0], None), ""), [], "there is no plate");
    }

    /// The dashboard had limits of its own, by which a part fitted that was then warned of.
    #[test]
    fn the_lengths_that_suit_are_those_of_readings_and_of_the_warning_on_a_small_part() {
        for limits in [in_the_default_cell(), SizeLimits::of_lengths([300.0, 200.0], None)] {
            let [min_mm, max_mm] = limits.edge_mm();
            assert!(min_mm > 0.0 && min_mm < max_mm, "{limits:?}");
            for (edge_mm, suits) in [(min_mm.next_down(), false), (min_mm, true), (max_mm, true), (max_mm.next_up(), false)] {
                let bar = PartSize { size_mm: [1.0, edge_mm, 1.0], unit: LengthUnit::Millimetre };
                assert_eq!(bar.readings(Some(&limits))[0].fits, Some(suits), "{edge_mm}, {limits:?}");
                let is_small = bar.warnings(None, &limits, "").iter().any(|warning| warning.code == WarningCode::PartSmall);
                assert_eq!(is_small, edge_mm < min_mm, "{edge_mm}, {limits:?}");
            }
        }
    }

    #[test]
    fn readings_are_the_same_file_in_four_units() {
        let read = read_in(LengthUnit::Inch, [1.0, 2.0, 3.0]);
        let readings = read.readings(None);
        assert_eq!(readings.map(|reading| reading.unit), LengthUnit::ALL);
        for reading in readings {
            let expected = [1.0, 2.0, 3.0].map(|edge: f64| edge * reading.unit.mm());
            assert!(reading.size_mm.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{reading:?}");
            assert_eq!(reading.fits, None);
        }
        let fits = read.readings(Some(&in_the_default_cell())).map(|reading| reading.fits == Some(true));
        assert_eq!(fits, [false, true, false, true]);
    }
}
