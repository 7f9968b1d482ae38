//! Verdicts on the surface, face by face: `coverage.json` (schema `vantage.coverage/1`), `coverage.csv` and
//! `coverage.bin`. Faces are those of the uploaded file; only those of `coverage.bin` are the preview's.
//!
//! | byte of `coverage.bin` | meaning |
//! | --- | --- |
//! | 0, 1, 2, 3 | mostly measured; A, B, C, D is the grade of most of the measured area |
//! | 16 + i | mostly missed; cause `i` of the closed list, counted from 0 and with `exposure` last, is that of most of the missed area |
//! | 255 | mostly not asked for |

use std::borrow::Cow;
use std::cmp::Ordering;

use serde::{Deserialize, Serialize};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use super::csv::Csv;
use super::plan::CoverageDocument;
use super::schema_name::schema_name;
use super::tally::{GroupRun, Tally, of_groups};
use crate::geometry::{Mesh, NOT_DRAWN, Preview};
use crate::planning::plan::{Cause, Grade, Outcome, Verdict};

#[cfg(test)]
mod tests;

/// Schema name in the document.
pub const COVERAGE_SCHEMA: &str = "vantage.coverage/1";
/// First byte that stands for a cause in `coverage.bin`.
const FIRST_CAUSE: u8 = 16;
/// Byte of `coverage.bin` for faces that are not asked for.
const NOT_ASKED: u8 = 255;
/// Share from which on a part of a face counts as all of it: sums over samples are not exact to the last bit.
const WHOLE: f64 = 1.0 - 1e-9;

schema_name!(CoverageSchema, COVERAGE_SCHEMA);

/// Coverage of the part, with counts of its faces (`coverage.json`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CoverageListing {
    /// Schema name, `vantage.coverage/1`.
    #[schema(value_type = CoverageSchema)]
    pub schema: String,
    /// SHA-256 of the bytes of `plan.json`; empty in files of earlier releases.
    #[serde(default)]
    pub plan_sha256: String,
    /// Coverage, as in the plan.
    pub coverage: CoverageDocument,
    /// Number of faces of the uploaded file, by verdict.
    pub faces: FaceCounts,
    /// Meanings of the bytes of `coverage.bin`.
    pub bytes: Vec<ByteMeaning>,
}

/// Number of faces of the uploaded file, by verdict.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FaceCounts {
    /// Faces that have an area.
    pub total: usize,
    /// Faces measured wherever they are asked for.
    pub measured: usize,
    /// Faces measured in part.
    pub partly_measured: usize,
    /// Faces asked for at least in part, and measured nowhere.
    pub missed: usize,
    /// Faces not asked for at all.
    pub not_asked: usize,
}

/// Meaning of one value of a byte of `coverage.bin`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ByteMeaning {
    /// Value of the byte.
    pub byte: u8,
    /// Grade `A` to `D`, cause of a miss, or `not_asked`.
    #[schema(value_type = FaceMeaning)]
    pub meaning: String,
}

/// Meanings of a byte, for the API document.
struct FaceMeaning;

impl PartialSchema for FaceMeaning {
    fn schema() -> RefOr<Schema> {
        ObjectBuilder::new()
            .schema_type(Type::String)
            .description(Some("Grade of a face, cause of a miss, or that the face is not asked for."))
            .enum_values(Some(byte_meanings().into_iter().map(|meaning| meaning.meaning)))
            .into()
    }
}

impl ToSchema for FaceMeaning {}

/// Builds the document of an outcome; `plan_sha256` is the hash of the plan's file.
#[must_use]
pub fn json(outcome: &Outcome, mesh: &Mesh, plan_sha256: &str) -> CoverageListing {
    let count = |run: GroupRun| {
        let mut faces = FaceCounts::default();
        run.groups.iter().for_each(|(_, tally)| faces.count(tally));
        faces
    };
    let faces = of_source_faces(outcome, mesh, count).into_iter().fold(FaceCounts::default(), FaceCounts::and);
    CoverageListing {
        schema: COVERAGE_SCHEMA.to_owned(),
        plan_sha256: plan_sha256.to_owned(),
        coverage: CoverageDocument::from(&outcome.plan.coverage),
        faces,
        bytes: byte_meanings(),
    }
}

impl FaceCounts {
    fn and(self, more: Self) -> Self {
        Self {
            total: self.total + more.total,
            measured: self.measured + more.measured,
            partly_measured: self.partly_measured + more.partly_measured,
            missed: self.missed + more.missed,
            not_asked: self.not_asked + more.not_asked,
        }
    }

    fn count(&mut self, tally: &Tally) {
        let asked_mm2 = tally.area_mm2 - tally.not_asked_mm2;
        self.total += 1;
        match tally.measured_mm2() {
            _ if tally.not_asked_mm2 >= tally.area_mm2 * WHOLE => self.not_asked += 1,
            measured_mm2 if measured_mm2 >= asked_mm2 * WHOLE => self.measured += 1,
            measured_mm2 if measured_mm2 > 0.0 => self.partly_measured += 1,
            _ => self.missed += 1,
        }
    }
}

/// The table, one row per face of the uploaded file from face 0 on without gaps: number, area, measured share of that area,
/// `best_grade`, cause of most of the missed area (`not_asked` where nothing of it is asked for). `best_grade` is the grade of most of
/// the measured area, the better one on ties, where each sample has the grade of its best chosen view
/// ([`crate::planning::method::quality`]); it is not the best grade found anywhere on the face.
/// Cells without a value are empty; a face that was dropped as degenerate has area 0 and no values. With
/// `visibility.pixel_set` there is the number of chosen views that hit the face with a pixel of each device. The last column names
/// the plan, in the first row alone.
#[must_use]
pub fn csv(outcome: &Outcome, mesh: &Mesh, plan_sha256: &str) -> String {
    let pixel_views = outcome.pixel_views.as_ref().map(|views| max_by_source_face(views, mesh));
    let mut columns = vec!["face", "area_mm2", "measured_fraction", "best_grade", "reason"];
    columns.extend(pixel_views.is_some().then_some("pixel_views"));
    columns.push("plan_sha256");
    let mut csv = Csv::new(&columns);
    let views_of = |face: u32| pixel_views.as_ref().map(|views| views[face as usize]);
    let rows = |run: GroupRun| {
        let (mut csv, mut next) = (Csv::rows(), run.begin);
        for (face, tally) in run.groups {
            (next..face).for_each(|face| face_row(&mut csv, face, &Tally::default(), views_of(face), plan_sha256));
            face_row(&mut csv, face, &tally, views_of(face), plan_sha256);
            next = face + 1;
        }
        csv.finish()
    };
    csv.add_all_rows(of_source_faces(outcome, mesh, rows));
    csv.finish()
}

/// Max of the triangles' values for each face of the file.
fn max_by_source_face(of_triangles: &[u32], mesh: &Mesh) -> Vec<u32> {
    let mut max = vec![0; mesh.source_face.iter().max().map_or(0, |last| *last as usize + 1)];
    for (face, value) in mesh.source_face.iter().zip(of_triangles) {
        let max: &mut u32 = &mut max[*face as usize];
        *max = (*max).max(*value);
    }
    max
}

fn face_row(csv: &mut Csv, face: u32, tally: &Tally, pixel_views: Option<u32>, plan_sha256: &str) {
    csv.number(face);
    csv.number(tally.area_mm2);
    csv.optional((tally.area_mm2 > 0.0).then(|| six_decimals(tally.measured_mm2() / tally.area_mm2)));
    csv.text(tally.grade().map_or("", grade_name));
    let not_asked = tally.area_mm2 > 0.0 && tally.not_asked_mm2 >= tally.area_mm2 * WHOLE;
    csv.text(if not_asked { "not_asked" } else { tally.cause().map_or("", Cause::as_str) });
    pixel_views.into_iter().for_each(|views| csv.number(views));
    // Once: a hundred thousand rows would carry 6.5 MB of it.
    csv.text(if face == 0 { plan_sha256 } else { "" });
    csv.end_row();
}

/// A share with six decimals. Most faces are measured whole or not at all, and the formatter is slowest on whole numbers.
fn six_decimals(share: f64) -> Cow<'static, str> {
    match share.total_cmp(&1.0) {
        Ordering::Equal => Cow::Borrowed("1.000000"),
        Ordering::Less | Ordering::Greater if share > 0.0 => Cow::Owned(format!("{share:.6}")),
        Ordering::Less | Ordering::Greater => Cow::Borrowed("0.000000"),
    }
}

/// `coverage.bin`: one byte per face of `preview`, which must be a preview of the planned mesh.
#[must_use]
pub fn bin(outcome: &Outcome, preview: &Preview) -> Vec<u8> {
    let mut bytes = vec![NOT_ASKED; preview.faces.len()];
    let of_run = |run: GroupRun| -> Vec<(u32, u8)> {
        let drawn = run.groups.into_iter().filter(|(face, _)| *face != NOT_DRAWN);
        drawn.map(|(face, tally)| (face, byte(tally.majority()))).collect()
    };
    let drawn = of_groups(outcome, |patch| preview.face_of_triangle[patch.face as usize], of_run);
    drawn.into_iter().flatten().for_each(|(face, byte)| bytes[face as usize] = byte);
    bytes
}

/// Results of `work` for the tallies of the file's faces.
fn of_source_faces<R: Send>(outcome: &Outcome, mesh: &Mesh, work: impl Fn(GroupRun) -> R + Sync) -> Vec<R> {
    of_groups(outcome, |patch| mesh.source_face[patch.face as usize], work)
}

fn byte(verdict: Verdict) -> u8 {
    match verdict {
        Verdict::Measured(grade) => grade as u8,
        Verdict::Missed(cause) => FIRST_CAUSE + code(cause),
        Verdict::NotAsked => NOT_ASKED,
    }
}

/// Number of a cause in a file: fixed, since files are kept. Causes that came later follow the others, whatever their place in the order.
fn code(cause: Cause) -> u8 {
    let (place, later) = (cause as u8, Cause::Exposure as u8);
    match place.cmp(&later) {
        Ordering::Less => place,
        Ordering::Equal => Cause::ALL.len() as u8 - 1,
        Ordering::Greater => place - 1,
    }
}

fn byte_meanings() -> Vec<ByteMeaning> {
    let grades = [Grade::A, Grade::B, Grade::C, Grade::D].map(|grade| (Verdict::Measured(grade), grade_name(grade)));
    let causes = Cause::ALL.map(|cause| (Verdict::Missed(cause), cause.as_str()));
    let all = grades.into_iter().chain(causes).chain([(Verdict::NotAsked, "not_asked")]);
    let mut meanings: Vec<ByteMeaning> =
        all.map(|(verdict, meaning)| ByteMeaning { byte: byte(verdict), meaning: meaning.to_owned() }).collect();
    meanings.sort_by_key(|meaning| meaning.byte);
    meanings
}

/// Name of a grade, `A` to `D`.
pub(crate) fn grade_name(grade: Grade) -> &'static str {
    match grade {
        Grade::A => "A",
        Grade::B => "B",
        Grade::C => "C",
        Grade::D => "D",
    }
}
