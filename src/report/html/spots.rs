//! The missed spots that have a number: the largest of all causes. The list and the pictures share the numbers; a number stands
//! where its spot is seen, or, where no side shows it, on the side that it faces most.

use std::fmt::Write;

use nalgebra::Point3;

use super::ReportInput;
use super::pictures::SIDES;
use crate::geometry::sort_descending;
use crate::planning::ids::SampleId;
use crate::planning::plan::{Cause, MissedSpot, Outcome, Verdict};
use crate::rendering::Seen;

/// Spots that have a number for their size; those with a remedy have one too.
const NUMBERED: usize = 20;
/// Samples of a spot that are looked for in a picture.
const MAX_LOOKS: usize = 2000;
/// Radius of a number's disc, pixels.
const DISC_PX: f64 = 13.0;
/// Distances from its spot at which a number may stand, pixels, nearest first; and directions of them.
const RINGS_PX: [f64; 4] = [30.0, 48.0, 66.0, 84.0];
const DIRECTIONS: u32 = 12;

/// A spot with its number.
pub(super) struct NumberedSpot<'a> {
    /// Number, from 1.
    pub(super) number: usize,
    pub(super) cause: Cause,
    pub(super) spot: &'a MissedSpot,
    /// Samples of the spot, or some of them, spread evenly.
    samples: Vec<SampleId>,
}

/// Place of a number in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Mark {
    number: usize,
    at_px: [f64; 2],
    is_hidden: bool,
}

/// The numbered spots, largest first.
pub(super) fn numbered<'a>(input: &ReportInput<'a>) -> Vec<NumberedSpot<'a>> {
    let outcome = input.outcome;
    let missed = &outcome.plan.missed;
    let mut all: Vec<(Cause, &MissedSpot)> =
        missed.iter().flat_map(|missed| missed.spots.iter().map(move |spot| (missed.cause, spot))).collect();
    // Stable: equal ones stay in the order of their causes.
    sort_descending(&mut all, |spot| spot.1.area_mm2);
    let kept = all.into_iter().enumerate().filter(|(rank, (_, spot))| *rank < NUMBERED || spot.remedy.is_some());
    let mut spots: Vec<NumberedSpot<'_>> =
        kept.zip(1..).map(|((_, (cause, spot)), number)| NumberedSpot { number, cause, spot, samples: Vec::new() }).collect();
    for (sample, verdict) in SampleId::number(&outcome.verdicts) {
        if let Verdict::Missed(cause) = verdict
            && let Some(place) = spot_of(input, &spots, sample, *cause)
        {
            spots[place].samples.push(sample);
        }
    }
    for spot in &mut spots {
        let stride = spot.samples.len().div_ceil(MAX_LOOKS).max(1);
        spot.samples = spot.samples.iter().step_by(stride).copied().collect();
    }
    spots
}

/// Place of the spot that a missed sample belongs to: of those of its cause that touch its face, the one whose centre is nearest,
/// measured by the spot's size.
fn spot_of(input: &ReportInput<'_>, spots: &[NumberedSpot<'_>], sample: SampleId, cause: Cause) -> Option<usize> {
    let surface = &input.outcome.surface;
    let face = input.subject.mesh.source_face[surface.patch_of(sample).face as usize];
    let p = &surface.sample_mm[sample.index()];
    let touches = |spot: &NumberedSpot<'_>| spot.cause == cause && spot.spot.source_faces.binary_search(&face).is_ok();
    let distance = |spot: &MissedSpot| (p - spot.centre_mm).norm_squared() / spot.extent_mm.norm_squared().max(f64::MIN_POSITIVE);
    let touching = spots.iter().enumerate().filter(|(_, spot)| touches(spot));
    touching.min_by(|a, b| distance(a.1.spot).total_cmp(&distance(b.1.spot))).map(|(place, _)| place)
}

/// Drawing over each picture of [`SIDES`]: the numbers of the spots.
pub(super) fn drawings(outcome: &Outcome, spots: &[NumberedSpot<'_>], pictures: &[Seen<'_>]) -> Vec<String> {
    let mut marks: Vec<Vec<Mark>> = vec![Vec::new(); SIDES.len()];
    for spot in spots {
        let seen: Vec<Option<[f64; 2]>> = pictures.iter().map(|picture| seen_at(outcome, spot, picture)).collect();
        if seen.iter().all(Option::is_none) {
            let (side, at_px) = hidden_at(outcome, spot, pictures);
            marks[side].extend(at_px.map(|at_px| Mark { number: spot.number, at_px, is_hidden: true }));
        }
        for (marks, at_px) in marks.iter_mut().zip(seen) {
            marks.extend(at_px.map(|at_px| Mark { number: spot.number, at_px, is_hidden: false }));
        }
    }
    let size_px = |picture: &Seen<'_>| picture.size_px().map(|n| n as f64);
    marks.iter().zip(pictures).map(|(marks, picture)| drawing(marks, size_px(picture))).collect()
}

/// Pixel of the seen sample of a spot that is nearest to its centre; `None` where the picture shows none of it.
fn seen_at(outcome: &Outcome, spot: &NumberedSpot<'_>, picture: &Seen<'_>) -> Option<[f64; 2]> {
    let surface = &outcome.surface;
    let p_mm = |sample: &SampleId| &surface.sample_mm[sample.index()];
    let shown = spot.samples.iter().filter(|sample| picture.shows(p_mm(sample), &surface.patch_of(**sample).normal));
    picture.pixel(p_mm(nearest(shown, p_mm, &spot.spot.centre_mm)?))
}

/// Side that a hidden spot faces most, and its pixel there.
fn hidden_at(outcome: &Outcome, spot: &NumberedSpot<'_>, pictures: &[Seen<'_>]) -> (usize, Option<[f64; 2]>) {
    let surface = &outcome.surface;
    let p_mm = |sample: &SampleId| &surface.sample_mm[sample.index()];
    let Some(sample) = nearest(spot.samples.iter(), p_mm, &spot.spot.centre_mm) else {
        return (0, pictures.first().and_then(|picture| picture.pixel(&spot.spot.centre_mm)));
    };
    let facing = |picture: &Seen<'_>| picture.facing(p_mm(sample), &surface.patch_of(*sample).normal);
    let side =
        (1..pictures.len()).fold(0, |best, side| if facing(&pictures[side]) > facing(&pictures[best]) { side } else { best });
    (side, pictures[side].pixel(p_mm(sample)))
}

fn nearest<'s>(
    samples: impl Iterator<Item = &'s SampleId>,
    p_mm: impl Fn(&SampleId) -> &'s Point3<f64>,
    to_mm: &Point3<f64>,
) -> Option<&'s SampleId> {
    let distance = |sample: &SampleId| (p_mm(sample) - to_mm).norm_squared();
    samples.min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

/// Discs with the numbers, none over another, each with a line to its spot where it had to give way.
fn drawing(marks: &[Mark], size_px: [f64; 2]) -> String {
    let (mut svg, mut placed) = (String::new(), Vec::new());
    for mark in marks {
        let [x, y] = disc_at(mark.at_px, &placed, size_px);
        placed.push([x, y]);
        let [spot_x, spot_y] = mark.at_px;
        let class = if mark.is_hidden { "spot hidden" } else { "spot" };
        // Writing to a String cannot fail.
        let _ = write!(svg, "<g class=\"{class}\" data-spot=\"{}\">", mark.number);
        let _ = write!(svg, "<line x1=\"{spot_x:.1}\" y1=\"{spot_y:.1}\" x2=\"{x:.1}\" y2=\"{y:.1}\"/>");
        let _ = write!(svg, "<circle class=\"place\" cx=\"{spot_x:.1}\" cy=\"{spot_y:.1}\" r=\"3\"/>");
        let _ = write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{DISC_PX}\"/>");
        let _ = write!(svg, "<text x=\"{x:.1}\" y=\"{:.1}\">{}</text></g>", y + 5.5, mark.number);
    }
    svg
}

/// Centre of a number's disc: beside its spot, in the picture and clear of those that are `placed`, as near as it can be.
fn disc_at([x, y]: [f64; 2], placed: &[[f64; 2]], [width, height]: [f64; 2]) -> [f64; 2] {
    let place = |(ring_px, direction): (f64, u32)| {
        let angle = std::f64::consts::TAU * f64::from(direction) / f64::from(DIRECTIONS) - std::f64::consts::FRAC_PI_4;
        [x + ring_px * angle.cos(), y + ring_px * angle.sin()]
    };
    let is_free = |[x, y]: &[f64; 2]| {
        let inside = *x >= DISC_PX && *y >= DISC_PX && *x <= width - DISC_PX && *y <= height - DISC_PX;
        inside && placed.iter().all(|other| (other[0] - x).hypot(other[1] - y) >= 2.0 * DISC_PX + 1.0)
    };
    let places = RINGS_PX.into_iter().flat_map(|ring_px| (0..DIRECTIONS).map(move |direction| (ring_px, direction)));
    places.map(place).find(is_free).unwrap_or([x.clamp(DISC_PX, width - DISC_PX), y.clamp(DISC_PX, height - DISC_PX)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_beside_their_spots_in_the_picture_and_clear_of_each_other() {
        let size_px = [640.0, 480.0];
        let mut placed: Vec<[f64; 2]> = Vec::new();
        for at_px in [[320.0, 240.0]; 12].into_iter().chain([[2.0, 2.0], [638.0, 470.0]]) {
            let [x, y] = disc_at(at_px, &placed, size_px);
            assert!(x >= DISC_PX && y >= DISC_PX && x <= 640.0 - DISC_PX && y <= 480.0 - DISC_PX, "{x} {y}");
            assert!((x - at_px[0]).hypot(y - at_px[1]) <= RINGS_PX[3] + 1e-9, "far from its spot: {x} {y}");
            assert!(placed.iter().all(|other| (other[0] - x).hypot(other[1] - y) > 2.0 * DISC_PX), "over another: {x} {y}");
            placed.push([x, y]);
        }
    }

    #[test]
    fn a_hidden_spot_is_drawn_as_one() {
        let marks =
            [Mark { number: 3, at_px: [100.0, 90.0], is_hidden: false }, Mark { number: 7, at_px: [9.0, 9.0], is_hidden: true }];
        let svg = drawing(&marks, [640.0, 480.0]);
        assert!(svg.contains("<g class=\"spot\" data-spot=\"3\">") && svg.contains(">3</text>"), "{svg}");
        assert!(svg.contains("<g class=\"spot hidden\" data-spot=\"7\">") && svg.contains(">7</text>"), "{svg}");
    }
}
