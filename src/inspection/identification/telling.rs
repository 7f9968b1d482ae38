//! Pairs of view and sample whose loss tells something of the scanner. A pair that a scanner without weakness would return
//! ([`Return::is_expected`]) may be lost for what the cloud is like: its points lie too far apart, or were taken out of the scan.
//!
//! A pair tells where the model, seen by all devices, is one surface around the sample in the view's own grid: in the eight cells
//! around that of the sample, level with it within half of what a measured point may differ, and on the eight cells at the distance
//! from which normals are taken. Cells are as long as n · z / (f · cos i) on the surface, so that beside edges and on curved surface the
//! test is the stricter the coarser the cloud and the larger the incidence. A loss is then improbable but for a weakness: all that
//! [`crate::inspection::coverage`] asks of the points around the sample holds on the model itself.
//!
//! A cloud that came without the camera's grid does not tell where the scanner looked: its cells tell only where nearly all easy pairs
//! returned. The same holds of a sparse cloud, whatever its grid. A merged cloud tells nothing, since the view of its points is not known.
//!
//! A view that kept its stated pose tells nothing: it is not known to lie where its samples are looked for. A pair tells nothing either
//! where the points around it show that the part differs from the model there, since they lie off it or are of a surface that looks
//! elsewhere; nor beside such a spot, whichever view shows it.
//!
//! Cost: 9 to 17 rays an expected pair from the left camera, and as many shadows, in packets.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};

use super::rates::{EASY_INCIDENCE_DEG, EASY_MIRROR_DEG};
use crate::cell::closed_list;
use crate::geometry::{Part, Pose, ScannerFrame, parallel};
use crate::inspection::coverage::{ComparedViews, ModelPoint, NominalModel, Return, Returns, ScannedView, ViewLookup};
use crate::inspection::ingest::Removed;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::visibility::Optics;

/// Pairs that a thread looks into at a time.
const BLOCK: usize = 512;
/// Share of the tolerances of a measured point within which the model lies around a sample: the rest is for noise and poses. It is our
/// choice.
const SHARE_OF_TOLERANCE: f64 = 0.5;
/// Distance above the plate's zone within which points may have been taken for the plate's, mm: the usual error of poses, twice.
const ZONE_MARGIN_MM: f64 = 0.5;
/// Share of the easy pairs of a cloud without the camera's grid that return where its points fill the cells, and the fewest such pairs
/// that tell it. They are our choice.
const DENSE_RATE: f64 = 0.95;
const MIN_EASY: usize = 50;
/// Share of the expected pairs that do not tell for one reason, from which on the reason is given. It is our choice.
const WITHHELD_SHARE: f64 = 0.5;
/// Size of a cell of the surface that differs from the model with its neighbours, mm, as registration takes them to deviate as one; and
/// fewest samples in it that show it, since noise makes one differ. Both are our choice.
const SPOT_MM: f64 = 5.0;
const MIN_SPOT_SAMPLES: usize = 3;
/// Cosine of the angle from which on a measured surface looks elsewhere than a sample: 45°, as of points that registration pairs.
const ELSEWHERE_COS: f64 = std::f64::consts::FRAC_1_SQRT_2;

closed_list! {
    /// Reason for which scans teach little or nothing of the scanner's limits, or of its noise.
    pub enum Withheld {
        /// The cloud is merged of several views: of none of its points the view is known.
        MergedCloud = "merged_cloud",
        /// Points lie too far apart for most of the surface: a lost sample may lie between them.
        CoarseCloud = "coarse_cloud",
        /// The points of most of the surface were taken out as the scans were cleaned: around plate and fixture, at edges, or as specks.
        FilteredPoints = "filtered_points",
        /// Most of the surface that would tell is in views that kept their stated poses, and may not lie there.
        MisplacedViews = "misplaced_views",
        /// The limit of incidence lies between angles at which nothing was seen: it is not determined well enough to be offered.
        IncidenceGap = "incidence_gap",
        /// The points that tell the noise lie at about one distance from the best focus, or too few elsewhere: its increase with
        /// depth is not determined.
        OneDepth = "one_depth",
    }
}

/// Scans with what was taken out of them.
#[derive(Clone, Copy)]
pub struct TellingInput<'a> {
    /// Plan and scans.
    pub compared: &'a ComparedViews<'a>,
    /// The model as planned.
    pub model: &'a NominalModel<'a>,
    /// Points that were taken out of each scan, in the order of the scans; none of a scan that is not there.
    pub removed: &'a [&'a Removed],
    /// True for each scan whose pose was registered, in the order of the scans; false where the stated pose was kept, and of a scan that
    /// is not there.
    pub is_registered: &'a [bool],
    /// True if the scans are images of one cloud, which another program has merged.
    pub is_merged: bool,
}

/// Pairs of which rates are told.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Telling {
    /// The pairs; expected are those alone whose loss tells something of the scanner.
    pub returns: Returns,
    /// Reasons for which most others do not.
    pub withheld: Vec<Withheld>,
    /// Views that kept their stated poses, and all views; zeros where no pair is judged.
    pub kept_views: [usize; 2],
}

/// Finds the pairs that tell something of the scanner.
///
/// # Errors
/// [`Cancelled`].
pub fn telling(returns: &Returns, input: &TellingInput<'_>, ctx: &Context<'_>) -> Result<Telling, Cancelled> {
    if input.is_merged {
        return Ok(Telling { withheld: vec![Withheld::MergedCloud], ..Telling::default() });
    }
    let compared = input.compared;
    let optics = Optics::new(compared.scanner, compared.params, &compared.surface.requirements);
    let mut told = Returns::default();
    let (mut expected, mut coarse, mut filtered, mut misplaced, mut tell) = (0_usize, 0_usize, 0_usize, 0_usize, 0_usize);
    let is_registered = |place: usize| input.is_registered.get(place).copied().unwrap_or_default();
    let mut judged = verdicts_of(returns, input, &optics, ctx)?;
    spread_deviations(&mut judged, returns, is_registered, &compared.surface.sample_mm);
    for (place, mut verdicts) in judged.into_iter().enumerate() {
        let removed = input.removed.get(place);
        let pairs: Vec<Return> = returns.of_view(place).collect();
        if !is_registered(place) {
            verdicts.iter_mut().filter(|verdict| **verdict == Verdict::Tells).for_each(|verdict| *verdict = Verdict::Misplaced);
        }
        if removed.is_some_and(|removed| removed.is_projected || removed.is_sparse) && !fills_cells(&pairs, &verdicts) {
            verdicts.iter_mut().filter(|verdict| **verdict == Verdict::Tells).for_each(|verdict| *verdict = Verdict::Coarse);
        }
        let count = |wanted: Verdict| verdicts.iter().filter(|verdict| **verdict == wanted).count();
        expected += pairs.iter().filter(|pair| pair.is_expected).count();
        coarse += count(Verdict::Coarse);
        filtered += count(Verdict::Filtered);
        misplaced += count(Verdict::Misplaced);
        tell += count(Verdict::Tells);
        let pair = |(pair, verdict): (&Return, &Verdict)| Return { is_expected: *verdict == Verdict::Tells, ..*pair };
        told.push_view(pairs.iter().zip(&verdicts).map(pair));
    }
    let is_most = |pairs: usize, of: usize| pairs > 0 && pairs as f64 >= WITHHELD_SHARE * of as f64;
    // Of pairs that the cloud rules out a registered pose would make no difference.
    let reasons = [
        (Withheld::CoarseCloud, coarse, expected),
        (Withheld::FilteredPoints, filtered, expected),
        (Withheld::MisplacedViews, misplaced, misplaced + tell),
    ];
    let withheld = reasons.into_iter().filter(|(_, pairs, of)| is_most(*pairs, *of)).map(|(reason, ..)| reason).collect();
    let views = compared.scanned.len();
    let kept = (0..views).filter(|place| !is_registered(*place)).count();
    Ok(Telling { returns: told, withheld, kept_views: [kept, views] })
}

/// Meanings of the pairs of each view, each by itself.
fn verdicts_of(
    returns: &Returns,
    input: &TellingInput<'_>,
    optics: &Optics,
    ctx: &Context<'_>,
) -> Result<Vec<Vec<Verdict>>, Cancelled> {
    let of_view = |(place, scanned): (usize, &ScannedView<'_>)| {
        let removed = input.removed.get(place).copied();
        let pose = scanned.registered.part_from_scanner;
        let view = TellingView { input, removed, pose, lookup: ViewLookup::new(input.compared, optics, scanned) };
        let pairs: Vec<Return> = returns.of_view(place).collect();
        let blocks = parallel::try_map_chunks(&pairs, BLOCK, |block| {
            ctx.check()?;
            Ok::<_, Cancelled>(view.verdicts(block, ctx))
        })?;
        Ok(blocks.concat())
    };
    input.compared.scanned.iter().enumerate().map(of_view).collect()
}

/// Lets no view tell of samples where points of a view that was registered show that the part differs, nor of those around them: where a
/// feature is missing, a view that looks past it sees nothing.
fn spread_deviations(
    judged: &mut [Vec<Verdict>],
    returns: &Returns,
    is_registered: impl Fn(usize) -> bool,
    sample_mm: &[Point3<f64>],
) {
    let cell_of =
        |sample: SampleId| -> [i64; 3] { sample_mm[sample.index()].coords.map(|value| (value / SPOT_MM).floor() as i64).into() };
    let mut spots: BTreeMap<[i64; 3], BTreeSet<SampleId>> = BTreeMap::new();
    for (view, verdicts) in judged.iter().enumerate().filter(|(view, _)| is_registered(*view)) {
        for (pair, _) in returns.of_view(view).zip(verdicts).filter(|(_, verdict)| **verdict == Verdict::Deviates) {
            spots.entry(cell_of(pair.sample)).or_default().insert(pair.sample);
        }
    }
    let mut around: BTreeSet<[i64; 3]> = BTreeSet::new();
    for ([x, y, z], _) in spots.into_iter().filter(|(_, samples)| samples.len() >= MIN_SPOT_SAMPLES) {
        around.extend((0..27).map(|cell| [x + cell % 3 - 1, y + cell / 3 % 3 - 1, z + cell / 9 - 1]));
    }
    for (view, verdicts) in judged.iter_mut().enumerate() {
        let pairs = returns.of_view(view).zip(verdicts);
        let tell = pairs.filter(|(pair, verdict)| **verdict == Verdict::Tells && around.contains(&cell_of(pair.sample)));
        tell.for_each(|(_, verdict)| *verdict = Verdict::Deviates);
    }
}

/// Returns true if nearly all easy pairs of a view that tell returned.
fn fills_cells(pairs: &[Return], verdicts: &[Verdict]) -> bool {
    let is_easy = |pair: &Return| {
        pair.worst_incidence().1 <= EASY_INCIDENCE_DEG.to_radians() && pair.mirror_rad >= EASY_MIRROR_DEG.to_radians()
    };
    let telling = pairs.iter().zip(verdicts).filter(|(pair, verdict)| **verdict == Verdict::Tells && is_easy(pair));
    let easy: Vec<bool> = telling.map(|(pair, _)| pair.is_returned).collect();
    let returned = easy.iter().filter(|is_returned| **is_returned).count();
    easy.len() >= MIN_EASY && returned as f64 >= DENSE_RATE * easy.len() as f64
}

/// Meaning of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    /// The loss of the sample is the scanner's.
    Tells,
    /// The sample was not expected, or lies at the border of the image.
    Unexpected,
    /// The points may lie on other surface than the sample.
    Coarse,
    /// The points may have been taken out.
    Filtered,
    /// The points around it lie off the model: the part differs there.
    Deviates,
    /// The view may not lie where the sample was looked for.
    Misplaced,
}

/// One scan, ready for its pairs.
struct TellingView<'a> {
    input: &'a TellingInput<'a>,
    removed: Option<&'a Removed>,
    pose: Pose<Part, ScannerFrame>,
    lookup: ViewLookup<'a>,
}

impl TellingView<'_> {
    fn verdicts(&self, pairs: &[Return], ctx: &Context<'_>) -> Vec<Verdict> {
        let around: Vec<Result<Vec<usize>, Verdict>> = pairs.iter().map(|pair| self.around(pair)).collect();
        let asked: Vec<usize> = around.iter().flatten().flatten().copied().collect();
        let mut points = self.input.model.at_cells(&self.pose, self.lookup.cloud.grid(), &asked, ctx).into_iter();
        let mut verdicts = Vec::with_capacity(pairs.len());
        for (pair, around) in pairs.iter().zip(around) {
            verdicts.push(match around {
                Ok(cells) => {
                    let points: Vec<Option<ModelPoint>> = points.by_ref().take(cells.len()).collect();
                    self.verdict(pair.sample, &cells, &points)
                }
                Err(verdict) => verdict,
            });
        }
        verdicts
    }

    /// Cells on which the model has to be the sample's surface: that of the sample first, then the eight around it, then those at the
    /// distance of its neighbours.
    fn around(&self, pair: &Return) -> Result<Vec<usize>, Verdict> {
        if !pair.is_expected {
            return Err(Verdict::Unexpected);
        }
        let seen = self.lookup.sample(pair.sample).ok_or(Verdict::Unexpected)?;
        if self.is_in_zone(&seen.scanner_mm) {
            return Err(Verdict::Filtered);
        }
        let grid = self.lookup.cloud.grid();
        let full_mm = grid.step_px * seen.precision.spacing_mm;
        let asked_mm = self.input.compared.surface.requirements.of(pair.sample).spacing_max_mm;
        if asked_mm.is_some_and(|asked_mm| full_mm > asked_mm) {
            return Err(Verdict::Coarse);
        }
        let [column, row] = grid.cell_of(&seen.scanner_mm).ok_or(Verdict::Unexpected)?;
        // From there normals of measured points are taken.
        let reach = self.lookup.reach(&seen);
        let far = RING.into_iter().filter(|_| reach > 1).map(|[right, down]| [right * reach, down * reach]);
        let mut cells = vec![grid.number([column, row])];
        for [right, down] in RING.into_iter().chain(far) {
            let column = column.checked_add_signed(right).filter(|column| *column < grid.size.columns);
            let row = row.checked_add_signed(down).filter(|row| *row < grid.size.rows);
            let (column, row) = column.zip(row).ok_or(Verdict::Unexpected)?;
            cells.push(grid.number([column, row]));
        }
        if cells.iter().any(|cell| self.is_removed(*cell)) { Err(Verdict::Filtered) } else { Ok(cells) }
    }

    fn is_in_zone(&self, scanner_mm: &Point3<f64>) -> bool {
        let plate = self.removed.and_then(|removed| removed.plate);
        plate.is_some_and(|plate| plate.holds(scanner_mm, ZONE_MARGIN_MM))
    }

    fn is_removed(&self, cell: usize) -> bool {
        let holds = |cells: &[u32]| cells.binary_search(&(cell as u32)).is_ok();
        self.removed.is_some_and(|removed| holds(&removed.cells) || holds(&removed.fixture_cells))
    }

    fn verdict(&self, sample: SampleId, cells: &[usize], points: &[Option<ModelPoint>]) -> Verdict {
        let (surface, compare) = (self.input.compared.surface, self.input.compared.compare);
        let (sample_mm, normal) = (&surface.sample_mm[sample.index()], &surface.patch_of(sample).normal);
        let level_cos = (SHARE_OF_TOLERANCE * compare.normal_deg).to_radians().cos();
        let off_max_mm = SHARE_OF_TOLERANCE * compare.tolerance_mm;
        let is_of_surface = |(place, point): (usize, &Option<ModelPoint>)| {
            point.is_some_and(|point| {
                let off_mm = (point.point_mm - sample_mm).dot(normal).abs();
                let is_level = point.normal.dot(normal) >= level_cos;
                point.is_seen && is_level && (place > RING.len() || off_mm <= off_max_mm)
            })
        };
        if !points.iter().enumerate().all(is_of_surface) {
            return Verdict::Coarse;
        }
        let in_zone = |point: &ModelPoint| self.is_in_zone(&(self.lookup.scanner_from_part * point.point_mm));
        if points.iter().flatten().any(in_zone) {
            Verdict::Filtered
        } else if self.deviates(sample, cells, points) {
            Verdict::Deviates
        } else {
            Verdict::Tells
        }
    }

    /// Returns true if the points in the cell of a sample and around it lie off the model by more than a measured point may, on average,
    /// since noise is on either side of it; or if they are of a surface that looks elsewhere, as at the foot of a wall that is missing.
    fn deviates(&self, sample: SampleId, cells: &[usize], model: &[Option<ModelPoint>]) -> bool {
        let Some(seen) = self.lookup.sample(sample) else { return false };
        let columns = self.lookup.cloud.grid().size.columns;
        let point_mm = |cell: usize| self.lookup.cloud.point([cell % columns, cell / columns]);
        let off_mm = |(cell, model): (&usize, &Option<ModelPoint>)| {
            Some((point_mm(*cell)? - self.lookup.scanner_from_part * model.as_ref()?.point_mm).dot(&seen.normal))
        };
        let off_mm: Vec<f64> = cells.iter().zip(model).take(1 + RING.len()).filter_map(off_mm).collect();
        if !off_mm.is_empty() && off_mm.iter().sum::<f64>().abs() > seen.tolerance_mm * off_mm.len() as f64 {
            return true;
        }
        // Normals of measured points are taken from the last ring.
        let ring = &cells[cells.len() - RING.len()..];
        looks_elsewhere(point_mm(cells[0]), CROSS.map(|place| point_mm(ring[place])), &seen.normal)
    }
}

/// Returns true if the measured surface around a sample looks elsewhere than the sample: all triangles of its point with two of the four
/// neighbours around it do.
fn looks_elsewhere(centre_mm: Option<Point3<f64>>, around_mm: [Option<Point3<f64>>; CROSS.len()], normal: &Vector3<f64>) -> bool {
    let triangle = |place: usize| {
        let (centre_mm, next) = (centre_mm?, (place + 1) % CROSS.len());
        (around_mm[place]? - centre_mm).cross(&(around_mm[next]? - centre_mm)).try_normalize(0.0)
    };
    let mut triangles = (0..CROSS.len()).filter_map(triangle).peekable();
    triangles.peek().is_some() && triangles.all(|triangle| triangle.dot(normal).abs() < ELSEWHERE_COS)
}

/// Offsets along row and column of the eight cells around a cell.
const RING: [[isize; 2]; 8] = [[-1, -1], [0, -1], [1, -1], [-1, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];
/// Places in [`RING`] of the cells to the right, below, to the left and above.
const CROSS: [usize; 4] = [4, 6, 3, 1];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::PerDevice;

    /// At the foot of a key that is missing, points lie near its wall, and were held for returns that the scanner lost.
    #[test]
    fn a_surface_looks_elsewhere_where_all_that_was_measured_around_a_point_does() {
        let (level, wall) = (Vector3::z(), Vector3::x());
        let on = |x_mm: f64, y_mm: f64, z_mm: f64| Some(Point3::new(x_mm, y_mm, z_mm));
        let around_mm = [on(1.0, 0.0, 0.1), on(0.0, 1.0, 0.0), on(-1.0, 0.0, 0.0), on(0.0, -1.0, 0.1)];
        assert!(looks_elsewhere(on(0.0, 0.0, 0.0), around_mm, &wall));
        assert!(!looks_elsewhere(on(0.0, 0.0, 0.0), around_mm, &level));
        let beside_edge_mm = [on(0.0, 0.0, -1.0), on(0.0, 1.0, 0.0), on(-1.0, 0.0, 0.0), on(0.0, -1.0, 0.0)];
        assert!(!looks_elsewhere(on(0.0, 0.0, 0.0), beside_edge_mm, &wall), "some of it looks as the wall");
        assert!(
            !looks_elsewhere(None, around_mm, &wall) && !looks_elsewhere(on(0.0, 0.0, 0.0), [None; 4], &wall),
            "nothing is known"
        );
    }

    /// The top of a key that was missing had no points in views that looked past it: a limit of the cameras was offered that is none.
    #[test]
    fn samples_beside_a_spot_at_which_the_part_differs_in_a_registered_view_tell_nothing_in_any() {
        // Three on a wall, one on the top beside it, one far away.
        let sample_mm =
            [[20.0, 3.0, 1.0], [20.0, 3.0, 2.0], [20.0, 3.0, 3.0], [23.0, 0.0, 2.0], [-20.0, 0.0, 2.0]].map(Point3::from);
        let pair = |view: usize, sample: usize| Return {
            view,
            sample: SampleId::at(sample),
            is_returned: false,
            is_expected: true,
            incidence_rad: PerDevice { left: 1.0, right: 1.0, projector: 1.0 },
            mirror_rad: 1.0,
            depth_mm: 480.0,
        };
        let mut returns = Returns::default();
        for view in 0..2 {
            returns.push_view((0..sample_mm.len()).map(|sample| pair(view, sample)));
        }
        let (off, tells) = (Verdict::Deviates, Verdict::Tells);
        let told = |first: [Verdict; 5], is_registered: bool| {
            let mut judged = [first.to_vec(), vec![tells; sample_mm.len()]];
            spread_deviations(&mut judged, &returns, |view| view == 1 || is_registered, &sample_mm);
            judged
        };
        let [first, second] = told([off, off, off, Verdict::Filtered, tells], true);
        assert_eq!(first, [off, off, off, Verdict::Filtered, tells], "only those that tell are taken back");
        assert_eq!(second, [off, off, off, off, tells]);
        assert_eq!(told([off, off, off, tells, tells], false)[1], [tells; 5], "that view may lie elsewhere");
        assert_eq!(told([off, tells, tells, tells, tells], true)[1], [tells; 5], "noise makes one differ");
    }
}
