//! Files of clouds, made scans of the plan's views in millimetres and in the scanner's frame: unit and frame are checked or
//! found by where the points then lie, views by the numbers in names, clouds put into the left camera's grid, and cleaned. All that is
//! refused or removed is counted under a closed name, with what was tried.

mod clean;
mod frames;
mod holes;
pub(in crate::inspection) mod merged;
mod one_view;
mod organise;
mod swapped;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use crate::cell::{Scanner, closed_list};
use crate::geometry::cloud_io::StoredCloud;
use crate::geometry::{LengthUnit, NearestFace, Part, Plate, PointCloud, Pose};
use crate::inspection::registration::RegistrationOptions;
use crate::inspection::registration::locate::{LocateOptions, NotLocated, PartPlace, PartPose, RefinedAlone, place};
use crate::inspection::{PixelGrid, ViewScan};
use crate::planning::context::{Cancelled, Context};

pub use clean::{CleanOptions, PlateZone, Removed, RemovedBecause};
pub use frames::{FrameAttempt, PlannedCapture, ScanFrame};
use frames::{best_of, try_all};
use merged::merged_images;
pub use one_view::MAX_UNSEEN_SHARE;

closed_list! {
    /// Findings about the files of a scan.
    pub enum IngestCode {
        /// The points lie where the view looks only in another unit than declared, or in none.
        UnitMismatch = "unit_mismatch",
        /// The points lie where the view looks only in another frame than declared, or in none.
        FrameMismatch = "frame_mismatch",
        /// The file does not show what its view sees: it fits another view, or none.
        WrongView = "wrong_view",
        /// The file holds the points of another view's scan.
        SameScan = "same_scan",
        /// The file fits its view, but most of the others do not: they seem to be of another plan.
        OtherPlan = "other_plan",
        /// One cloud of several views: what is found of each view is approximate.
        Merged = "merged",
        /// The points lie where the view looks, but not on the part.
        NoPart = "no_part",
        /// The part lies elsewhere than planned, where it was searched for and found.
        PartElsewhere = "part_elsewhere",
        /// Several poses of the part explain the points, and it may lie elsewhere than planned.
        AmbiguousPose = "ambiguous_pose",
        /// The part lies elsewhere than planned, and looks the same in several poses.
        SymmetricPart = "symmetric_part",
        /// Long triangles that close holes were dropped.
        FilledHoles = "filled_holes",
        /// Most points of the scan have none beside them: it was thinned too far to tell what lies between them.
        SparseCloud = "sparse_cloud",
        /// The scan has its points farther apart than the scanner takes them: surface beside edges and on steep walls is lost.
        ThinnedCloud = "thinned_cloud",
        /// A view of the plan has no file.
        ViewMissing = "view_missing",
        /// The run that took the scans has no scan of some views: their planned poses are taken.
        PlannedPose = "planned_pose",
        /// A file's number is no view of the plan.
        ViewUnknown = "view_unknown",
        /// Two files have the number of one view; the first by its name is taken.
        ViewDouble = "view_double",
    }
}

impl IngestCode {
    /// True where the file is left out.
    #[must_use]
    pub fn is_refusal(self) -> bool {
        match self {
            Self::UnitMismatch
            | Self::FrameMismatch
            | Self::WrongView
            | Self::SameScan
            | Self::OtherPlan
            | Self::NoPart
            | Self::AmbiguousPose
            | Self::SymmetricPart
            | Self::ViewUnknown
            | Self::ViewDouble => true,
            Self::Merged
            | Self::PartElsewhere
            | Self::FilledHoles
            | Self::SparseCloud
            | Self::ThinnedCloud
            | Self::ViewMissing
            | Self::PlannedPose => false,
        }
    }
}

/// One cloud of a file, with what is declared of it.
#[derive(Clone, Debug)]
pub struct ScanFile {
    /// Name of the file, for reports and for the number of its view.
    pub file: String,
    /// The cloud.
    pub cloud: StoredCloud,
    /// Unit, as declared by the user or stated in the file.
    pub unit: Option<LengthUnit>,
    /// Frame, as declared by the user.
    pub frame: Option<ScanFrame>,
    /// Number of its view, as declared by the user.
    pub viewpoint: Option<u32>,
}

/// Finding about a file or a view.
#[derive(Clone, Debug, PartialEq)]
pub struct IngestFinding {
    /// Kind of finding.
    pub code: IngestCode,
    /// File and, for E57, the name of the scan in it; none for a view without a file.
    pub file: Option<String>,
    /// Number of the view; of [`IngestCode::ViewUnknown`] and [`IngestCode::Merged`] that of the file, which is not of such a view.
    pub viewpoint: Option<u32>,
    /// File that is taken in place of a second one of its view.
    pub taken_file: Option<String>,
    /// View that the file fits better, or whose scan holds the same points.
    pub fits_viewpoint: Option<u32>,
    /// Units and frames that were tried, and the shares of the points that then lie where they should.
    pub tried: Vec<FrameAttempt>,
    /// Longest triangle that was dropped, mm; of [`IngestCode::SparseCloud`] the distance that most points lie farther apart than, and of
    /// [`IngestCode::ThinnedCloud`] the size of the cells that hold one each.
    pub longest_mm: Option<f64>,
    /// Views that the plan takes, ascending, of a file that is of none of them alone; of [`IngestCode::PlannedPose`] the views without a
    /// scan, and of [`IngestCode::OtherPlan`] those whose files do not fit; else empty.
    pub viewpoints: Vec<u32>,
}

impl IngestFinding {
    fn of(code: IngestCode, file: Option<String>, viewpoint: Option<u32>) -> Self {
        let (tried, viewpoints) = (Vec::new(), Vec::new());
        Self { code, file, viewpoint, taken_file: None, fits_viewpoint: None, tried, longest_mm: None, viewpoints }
    }

    /// Finding about a scan that fits where the files of other views do not.
    fn of_other_plan(taken: TakenScan, misfits: impl IntoIterator<Item = u32>) -> Self {
        let viewpoints = misfits.into_iter().collect::<BTreeSet<u32>>().into_iter().collect();
        Self { viewpoints, ..Self::of(IngestCode::OtherPlan, Some(taken.file), Some(taken.scan.viewpoint)) }
    }

    /// Returns true if the file was left out since it does not lie on the part from its view. What does so in another unit or frame is a
    /// scan of the part.
    fn is_misfit(&self) -> bool {
        let misfits = [IngestCode::WrongView, IngestCode::NoPart, IngestCode::UnitMismatch, IngestCode::FrameMismatch];
        misfits.contains(&self.code) && self.tried.iter().all(|attempt| attempt.on_part < MIN_SHARE)
    }

    /// Names the number of a file that is no view of the plan, and the views that are: of findings that tell them.
    fn with_number(self, number: Option<u32>, world: &IngestWorld<'_>) -> Self {
        if !matches!(self.code, IngestCode::ViewUnknown | IngestCode::Merged) {
            return self;
        }
        let mut viewpoints: Vec<u32> = world.captures.iter().map(|capture| capture.viewpoint).collect();
        viewpoints.sort_unstable();
        Self { viewpoint: number, viewpoints, ..self }
    }
}

/// A scan as taken in.
#[derive(Clone, Debug)]
pub struct TakenScan {
    /// The scan.
    pub scan: ViewScan,
    /// File and, for E57, the name of the scan in it.
    pub file: String,
    /// Unit that its coordinates were taken to be in.
    pub unit: LengthUnit,
    /// Frame that they were taken to be in.
    pub frame: ScanFrame,
    /// Shares of the points in that unit and frame.
    pub fit: FrameAttempt,
    /// Points in the file.
    pub points: usize,
    /// Points that were removed, by reason.
    pub removed: Removed,
    /// True if the view's own points are not known: the cloud is merged of several views.
    pub is_approximate: bool,
}

/// Everything that was taken in.
#[derive(Clone, Debug, Default)]
pub struct Ingested {
    /// Scans, by viewpoint.
    pub scans: Vec<TakenScan>,
    /// Takes the part's coordinates by the planned poses to those of the mesh: other than the identity where the part lies elsewhere.
    pub mesh_from_stated: Pose<Part, Part>,
    /// True if that place is the best of a search over all turns; false if it was refined from the planned one or is the planned one.
    pub is_searched: bool,
    /// Findings, in the order of files, then of views.
    pub findings: Vec<IngestFinding>,
    /// Points of the files that were left out since they lie on the part nowhere, and fit no other view: each counts for no more than the
    /// largest scan that was taken in.
    pub stray_points: usize,
}

impl Ingested {
    /// Says of `viewpoints` that their planned poses are taken, since the run has no scan of them; nothing where there are none.
    pub fn note_planned_poses(&mut self, viewpoints: Vec<u32>) {
        if !viewpoints.is_empty() {
            self.findings.push(IngestFinding { viewpoints, ..IngestFinding::of(IngestCode::PlannedPose, None, None) });
        }
    }
}

/// Knobs of the ingest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IngestOptions {
    /// Cleaning of the clouds.
    pub clean: CleanOptions,
}

/// Size of cells that points without the camera's grid were put into, from which on the cloud is told as thinned, mm: scanners take points
/// some tenths apart. Our choice.
pub const THINNED_CELL_MM: f64 = 1.0;
/// Minimum share of the points that has to lie where the view looks and on the part.
pub const MIN_SHARE: f64 = 0.5;
/// Shares of the points within 0.5 and 5 mm of the part below which a scan is of no view where others fit theirs. Not from a
/// source: scans of other views have less of both, and those of a part that deviates from its mesh more of one of them.
const MISFIT_SHARE: f64 = 0.25;
const MISFIT_NEAR_SHARE: f64 = 0.9;

/// World that the clouds are held against.
pub struct IngestWorld<'a> {
    /// The scanner.
    pub scanner: &'a Scanner,
    /// The part.
    pub nearest: &'a NearestFace<'a>,
    /// Captures of the plan, or of a run.
    pub captures: &'a [PlannedCapture],
    /// Meshes of fixtures, in the frame of the plate.
    pub fixtures: &'a [crate::geometry::Mesh],
}

/// Takes in the clouds of one inspection.
///
/// # Errors
/// [`Cancelled`].
pub fn ingest(
    mut files: Vec<ScanFile>,
    world: &IngestWorld<'_>,
    options: &IngestOptions,
    ctx: &Context<'_>,
) -> Result<Ingested, Cancelled> {
    // The order of files must not matter.
    files.sort_by_cached_key(|file| (label(file), file.viewpoint));
    let clouds = files.len();
    let read = files.into_par_iter().map(|file| {
        ctx.check()?;
        read_file(file, clouds, world, (options, ctx))
    });
    let read: Vec<ReadFile> = read.collect::<Result<_, Cancelled>>()?;
    let points: FilePoints = read.iter().map(|file| ((file.name.clone(), file.viewpoint), file.points)).collect();
    let mut ingested = Ingested::default();
    let (mut astray, mut swapped, mut prints) = (Vec::new(), Vec::new(), Fingerprints::new());
    for file in read {
        let others: &[&[TakenScan]] = match file.fit {
            ViewFit::OnPart => &[&ingested.scans],
            ViewFit::OffPart | ViewFit::OtherView => &[&ingested.scans, &astray, &swapped],
        };
        let of = |viewpoint: u32| others.iter().copied().flatten().find(|other| other.scan.viewpoint == viewpoint);
        if let Some(taken) = file.viewpoint.and_then(of) {
            let taken_file = Some(taken.file.clone());
            let double = IngestFinding::of(IngestCode::ViewDouble, Some(file.name), file.viewpoint);
            ingested.findings.push(IngestFinding { taken_file, ..double });
            continue;
        }
        ingested.findings.extend(file.findings);
        if let (Some(viewpoint), Some(print), [_]) = (file.viewpoint, file.print, &file.scans[..]) {
            prints.insert(viewpoint, print);
        }
        match file.fit {
            ViewFit::OnPart => ingested.scans.extend(file.scans),
            ViewFit::OffPart => astray.extend(file.scans),
            ViewFit::OtherView => swapped.extend(file.scans),
        }
    }
    for scans in [&mut ingested.scans, &mut astray, &mut swapped] {
        scans.sort_by_key(|taken| taken.scan.viewpoint);
    }
    let misfits = ingested.leave_out_misfits(Some(astray.len() + swapped.len()), world, ctx)?;
    swapped.extend(misfits);
    ctx.check()?;
    ingested.place_part(astray, swapped, world);
    ingested.leave_out_misfits(None, world, ctx)?;
    ingested.leave_out_copies(&prints);
    ingested.refuse_other_plan(world);
    ingested.count_strays(&points);
    for capture in world.captures {
        if !ingested.scans.iter().any(|taken| taken.scan.viewpoint == capture.viewpoint) {
            ingested.findings.push(IngestFinding::of(IngestCode::ViewMissing, None, Some(capture.viewpoint)));
        }
    }
    Ok(ingested)
}

/// Fingerprints of files, by the view that each is of.
type Fingerprints = BTreeMap<u32, u64>;
/// Points of files, by name and view: several uploads may have one name.
type FilePoints = BTreeMap<(String, Option<u32>), usize>;

impl Ingested {
    /// Leaves out scans that lie on the part from another view alone, and where others fit their views also those that lie on it
    /// from none: returns them. Before the part is searched for there are so many other scans, `before`, that miss it or fit another
    /// view, and nothing is left out unless half of all scans show that it lies where the poses say.
    fn leave_out_misfits(
        &mut self,
        before: Option<usize>,
        world: &IngestWorld<'_>,
        ctx: &Context<'_>,
    ) -> Result<Vec<TakenScan>, Cancelled> {
        let at = self.mesh_from_stated;
        let alone: Vec<Option<RefinedAlone>> = self.scans.par_iter().map(|taken| swapped::alone(taken, &at, world)).collect();
        let judged = alone.iter().flatten().count();
        let sure = alone.iter().flatten().filter(|alone| alone.is_sure()).count();
        let is_placed = sure > 0 && before.is_none_or(|others| 2 * sure >= judged + others);
        let mut left_out = Vec::new();
        if before.is_some() && !is_placed {
            return Ok(left_out);
        }
        for (taken, alone) in std::mem::take(&mut self.scans).into_iter().zip(alone) {
            let Some(alone) = alone.filter(RefinedAlone::is_off) else {
                self.scans.push(taken);
                continue;
            };
            let fits_viewpoint = swapped::other_view(&taken, &at, world, ctx)?;
            let is_misfit = is_placed && alone.inlier_share < MISFIT_SHARE && taken.fit.on_part < MISFIT_NEAR_SHARE;
            if fits_viewpoint.is_none() && !is_misfit {
                self.scans.push(taken);
                continue;
            }
            let finding = IngestFinding::of(IngestCode::WrongView, Some(taken.file.clone()), Some(taken.scan.viewpoint));
            self.findings.push(IngestFinding { fits_viewpoint, ..finding });
            left_out.push(taken);
        }
        Ok(left_out)
    }

    /// Leaves out all but one of the scans that hold the same points: the one that keeps most of them in its view's image, else
    /// the first.
    fn leave_out_copies(&mut self, prints: &Fingerprints) {
        let mut kept: BTreeMap<u64, (u32, usize)> = BTreeMap::new();
        for taken in self.scans.iter().filter(|taken| !taken.is_approximate) {
            let (viewpoint, points) = (taken.scan.viewpoint, taken.scan.scanner_cloud.finite().count());
            let Some(print) = prints.get(&viewpoint) else { continue };
            let best = kept.entry(*print).or_insert((viewpoint, points));
            if points > best.1 {
                *best = (viewpoint, points);
            }
        }
        for taken in std::mem::take(&mut self.scans) {
            let viewpoint = taken.scan.viewpoint;
            let original = prints.get(&viewpoint).and_then(|print| kept.get(print)).map(|(original, _)| *original);
            match original.filter(|original| *original != viewpoint) {
                Some(original) => {
                    let finding = IngestFinding::of(IngestCode::SameScan, Some(taken.file), Some(viewpoint));
                    self.findings.push(IngestFinding { fits_viewpoint: Some(original), ..finding });
                }
                None => self.scans.push(taken),
            }
        }
    }

    /// Refuses the scans of a setup that fit where more do not: a few that fit by chance would be told as what was measured of the part.
    fn refuse_other_plan(&mut self, world: &IngestWorld<'_>) {
        // Scans that found the part together are of it; a single one finds something in any part.
        if self.mesh_from_stated != Pose::identity() && self.scans.len() > 1 {
            return;
        }
        // Of several setups, the part may have been put down otherwise in one alone.
        let place_of = |viewpoint: Option<u32>| {
            world.captures.iter().find(|capture| Some(capture.viewpoint) == viewpoint).and_then(|capture| capture.part_from_plate)
        };
        let misfits = self.findings.iter().filter(|finding| finding.is_misfit());
        let missed: Vec<_> = misfits.map(|finding| (finding.viewpoint, place_of(finding.viewpoint))).collect();
        let fitted: Vec<Option<Pose<Part, Plate>>> =
            self.scans.iter().map(|taken| place_of(Some(taken.scan.viewpoint))).collect();
        for (taken, place) in std::mem::take(&mut self.scans).into_iter().zip(&fitted) {
            let missed: Vec<Option<u32>> = missed.iter().filter(|(_, other)| other == place).map(|(view, _)| *view).collect();
            if missed.len() <= fitted.iter().filter(|other| *other == place).count() {
                self.scans.push(taken);
                continue;
            }
            self.findings.push(IngestFinding::of_other_plan(taken, missed.into_iter().flatten()));
        }
        if self.scans.is_empty() {
            (self.mesh_from_stated, self.is_searched) = (Pose::identity(), false);
            self.findings.retain(|finding| finding.code != IngestCode::PartElsewhere);
        }
    }

    /// Counts the points of files that were left out and lie nowhere. Those that fit another view are scans of the part.
    fn count_strays(&mut self, points: &FilePoints) {
        let largest = self.scans.iter().map(|taken| taken.scan.scanner_cloud.finite().count()).max().unwrap_or_default();
        let strays = self.findings.iter().filter(|finding| finding.is_misfit() && finding.fits_viewpoint.is_none());
        let of_file = |finding: &IngestFinding| points.get(&(finding.file.clone()?, finding.viewpoint));
        self.stray_points = strays.filter_map(of_file).map(|points| largest.min(*points)).sum();
    }

    /// Returns true if less than half of all points lie on the part at a place that the taken scans told without those that are astray.
    fn is_outvoted(&self, astray: &[TakenScan], found: &PartPose, world: &IngestWorld<'_>) -> bool {
        let points = |taken: &TakenScan| taken.scan.scanner_cloud.finite().count();
        let misses = |taken: &&TakenScan| {
            let mesh_from_scanner = found.mesh_from_stated * taken.scan.part_from_scanner;
            frames::share_on_part(&taken.scan.scanner_cloud, &mesh_from_scanner, world) < MIN_SHARE
        };
        let own = self.scans.iter().map(points).sum::<usize>() as f64;
        let missing = astray.iter().filter(misses).map(points).sum::<usize>() as f64;
        found.inlier_share * own < MIN_SHARE * (own + missing)
    }

    /// Finds the part where it lies elsewhere than planned: by all scans together, and where that comes to nothing, by those that lie
    /// on it as planned. `astray` are the others. Where these tell against the place, no place of the part is known: all are left out, since
    /// scans judged at the planned place would be told as a part that deviates. Several setups have a place of the part each, and none is
    /// searched for.
    ///
    /// `swapped` are scans that lie on the part from another view, as those of a turned part may too. They do not tell where it is. Once it
    /// was found, both are looked at again, and those that lie on it there are taken.
    fn place_part(&mut self, astray: Vec<TakenScan>, swapped: Vec<TakenScan>, world: &IngestWorld<'_>) {
        let is_one_setup = world.captures.iter().all(|capture| capture.part_from_plate == world.captures[0].part_from_plate);
        let is_merged = self.scans.iter().any(|taken| taken.is_approximate);
        if !is_one_setup || is_merged || (self.scans.is_empty() && astray.is_empty()) {
            return;
        }
        let place = |scans: &[&TakenScan]| {
            let scans: Vec<&ViewScan> = scans.iter().map(|taken| &taken.scan).collect();
            place(&scans, world.nearest, &LocateOptions::default())
        };
        let all: Vec<&TakenScan> = self.scans.iter().chain(&astray).collect();
        let mut placement = place(&all);
        let takes_all = matches!(placement, PartPlace::Elsewhere(_)) || self.scans.is_empty();
        if !takes_all && !astray.is_empty() {
            placement = place(&self.scans.iter().collect::<Vec<_>>());
        }
        match placement {
            PartPlace::Elsewhere(found) if !takes_all && self.is_outvoted(&astray, &found, world) => {
                for taken in self.scans.drain(..) {
                    let misfits = astray.iter().map(|other| other.scan.viewpoint);
                    self.findings.push(IngestFinding::of_other_plan(taken, misfits));
                }
            }
            PartPlace::Elsewhere(found) => {
                for taken in astray.into_iter().chain(swapped) {
                    self.take_again(taken, &found.mesh_from_stated, world);
                }
                self.scans.sort_by_key(|taken| taken.scan.viewpoint);
                (self.mesh_from_stated, self.is_searched) = (found.mesh_from_stated, found.is_searched);
                self.findings.push(IngestFinding::of(IngestCode::PartElsewhere, None, None));
            }
            PartPlace::Unknown(found) if found.refused == Some(NotLocated::AmbiguousPose) => {
                let code = if found.is_symmetric { IngestCode::SymmetricPart } else { IngestCode::AmbiguousPose };
                self.findings.retain(|finding| finding.code != IngestCode::NoPart);
                for taken in self.scans.drain(..).chain(astray) {
                    self.findings.push(IngestFinding::of(code, Some(taken.file), Some(taken.scan.viewpoint)));
                }
            }
            PartPlace::AsStated | PartPlace::Unknown(_) => {}
        }
    }

    /// Takes a scan that seemed to miss the part or to be of another view, if it lies on the part where that was found.
    fn take_again(&mut self, taken: TakenScan, mesh_from_stated: &Pose<Part, Part>, world: &IngestWorld<'_>) {
        let mesh_from_scanner = *mesh_from_stated * taken.scan.part_from_scanner;
        let viewpoint = taken.scan.viewpoint;
        let is_known = self.scans.iter().any(|other| other.scan.viewpoint == viewpoint);
        if !is_known && frames::share_on_part(&taken.scan.scanner_cloud, &mesh_from_scanner, world) >= MIN_SHARE {
            let is_of = |finding: &IngestFinding| {
                [IngestCode::NoPart, IngestCode::WrongView].contains(&finding.code)
                    && finding.viewpoint == Some(viewpoint)
                    && finding.file.as_ref() == Some(&taken.file)
            };
            self.findings.retain(|finding| !is_of(finding));
            self.scans.push(taken);
        }
    }
}

/// A file as it was read: its scans, and what was found about it.
struct ReadFile {
    name: String,
    /// Number of the view that the file is of, if it is of one.
    viewpoint: Option<u32>,
    scans: Vec<TakenScan>,
    findings: Vec<IngestFinding>,
    fit: ViewFit,
    /// Points of its first scan, as cleaned; of a file of which none was made, those that it holds.
    points: usize,
    /// Fingerprint of its points, unless they are few.
    print: Option<u64>,
}

/// Place of a file's points, seen from the view that it is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ViewFit {
    /// The points lie on the part.
    OnPart,
    /// Inside the view's volume, and not on the part.
    OffPart,
    /// Inside the view's volume, and on the part from another view alone.
    OtherView,
}

fn read_file(
    file: ScanFile,
    clouds: usize,
    world: &IngestWorld<'_>,
    (options, ctx): (&IngestOptions, &Context<'_>),
) -> Result<ReadFile, Cancelled> {
    let number = file.viewpoint.or_else(|| number_of(file.cloud.name.as_deref().unwrap_or(&file.file)));
    let capture = number.and_then(|number| world.captures.iter().find(|capture| capture.viewpoint == number));
    let is_alone = clouds == 1 && file.viewpoint.is_none();
    let is_of_several = match capture {
        Some(named) if is_alone && world.captures.len() > 1 => one_view::is_of_several(&file, named, world, ctx)?,
        Some(_) | None => false,
    };
    // The only file is of the only view, whatever its name, unless it is declared to be of another one.
    let is_only = world.captures.len() == 1 && is_alone;
    let capture = capture.filter(|_| !is_of_several).or_else(|| world.captures.first().filter(|_| is_only));
    let viewpoint = capture.map(|capture| capture.viewpoint);
    let print = swapped::fingerprint(&file.cloud);
    let points = file.cloud.points.iter().filter(|point| !point[0].is_nan()).count();
    let (name, fit) = (label(&file), ViewFit::OnPart);
    let mut read = ReadFile { name, viewpoint, scans: Vec::new(), findings: Vec::new(), fit, points, print };
    match capture {
        Some(capture) => take_view(file, capture, world, options, &mut read),
        None if is_alone => take_merged(file, number, world, (options, ctx), &mut read)?,
        None => {
            let finding = IngestFinding::of(IngestCode::ViewUnknown, Some(read.name.clone()), None);
            read.findings.push(finding.with_number(number, world));
        }
    }
    if let Some(taken) = read.scans.first() {
        read.points = taken.scan.scanner_cloud.finite().count();
    }
    Ok(read)
}

/// Name of a file with that of the scan in it.
fn label(file: &ScanFile) -> String {
    file.cloud.name.as_ref().map_or_else(|| file.file.clone(), |name| format!("{}:{name}", file.file))
}

/// Last whole number of a name without its ending: `view_03.ply` is 3.
fn number_of(name: &str) -> Option<u32> {
    let name = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let stem = name.rsplit_once('.').map_or(name, |(stem, ending)| if ending.len() <= 4 { stem } else { name });
    let digits = stem.rsplit(|c: char| !c.is_ascii_digit()).find(|digits| !digits.is_empty())?;
    digits.parse().ok()
}

fn take_view(file: ScanFile, capture: &PlannedCapture, world: &IngestWorld<'_>, options: &IngestOptions, into: &mut ReadFile) {
    let name = label(&file);
    let tried = try_all(&file.cloud, file.unit, capture, world);
    let declared = |attempt: &&FrameAttempt| {
        file.unit.is_none_or(|unit| unit == attempt.unit) && file.frame.is_none_or(|frame| frame == attempt.frame)
    };
    let on_part = best_of(tried.iter().filter(declared)).filter(|best| best.on_part >= MIN_SHARE);
    // In the part's own frame nothing lies elsewhere.
    let seen = tried.iter().filter(declared).filter(|attempt| attempt.frame != ScanFrame::Part);
    let seen = seen.fold(None, |best: Option<FrameAttempt>, attempt| {
        best.filter(|best| best.in_frusta >= attempt.in_frusta).or(Some(*attempt))
    });
    let (best, fit) = match (on_part, seen.filter(|seen| seen.in_frusta >= MIN_SHARE)) {
        (Some(best), _) => (best, ViewFit::OnPart),
        (None, seen) => {
            let (code, fits_viewpoint) = diagnosis(&file, capture, world, &tried);
            let finding = IngestFinding::of(code, Some(name.clone()), Some(capture.viewpoint));
            into.findings.push(IngestFinding { fits_viewpoint, tried, ..finding });
            let fit = if code == IngestCode::WrongView { ViewFit::OtherView } else { ViewFit::OffPart };
            let is_placed = [IngestCode::NoPart, IngestCode::WrongView].contains(&code);
            let Some(seen) = seen.filter(|_| is_placed) else { return };
            (seen, fit)
        }
    };
    let (cloud, mut removed, longest_mm) = prepared(file, &best, capture);
    if let Some(longest_mm) = longest_mm {
        let finding = IngestFinding::of(IngestCode::FilledHoles, Some(name.clone()), Some(capture.viewpoint));
        into.findings.push(IngestFinding { longest_mm: Some(longest_mm), ..finding });
    }
    let points = cloud.finite().count() + removed.total();
    let grid = cloud.grid.and_then(|size| PixelGrid::of_size(world.scanner, size));
    let fits = grid.is_some_and(|grid| organise::is_in_cells(&cloud, &grid));
    let cloud = if fits { cloud } else { organise::project(&cloud.points_mm, world.scanner, &mut removed) };
    let scanner_cloud = clean::clean(cloud, capture, world, &options.clean, &mut removed);
    let cell_mm = cell_mm(&scanner_cloud, world.scanner);
    if let Some(code) = thinned_code(&removed, cell_mm) {
        let finding = IngestFinding::of(code, Some(name.clone()), Some(capture.viewpoint));
        into.findings.push(IngestFinding { longest_mm: cell_mm, ..finding });
    }
    let scan = ViewScan { viewpoint: capture.viewpoint, part_from_scanner: capture.part_from_scanner, scanner_cloud };
    let (unit, frame) = (best.unit, best.frame);
    into.scans.push(TakenScan { scan, file: name, unit, frame, fit: best, points, removed, is_approximate: false });
    into.fit = fit;
}

/// Code of a scan whose points lie too far apart, by what its cleaning found and the size of its cells.
fn thinned_code(removed: &Removed, cell_mm: Option<f64>) -> Option<IngestCode> {
    let is_thinned = removed.is_projected && cell_mm.is_some_and(|cell_mm| cell_mm >= THINNED_CELL_MM);
    match (removed.is_sparse, is_thinned) {
        (true, _) => Some(IngestCode::SparseCloud),
        (false, true) => Some(IngestCode::ThinnedCloud),
        (false, false) => None,
    }
}

/// Length of a cell of an organised cloud on a surface at the mean depth of its points, mm.
fn cell_mm(cloud: &PointCloud, scanner: &Scanner) -> Option<f64> {
    let grid = PixelGrid::of_size(scanner, cloud.grid?)?;
    let depths_mm: Vec<f64> = cloud.finite().map(|(_, point)| point.z).collect();
    Some(grid.cell_mm(depths_mm.iter().sum::<f64>() / depths_mm.len().max(1) as f64))
}

/// Points in millimetres and in the scanner's frame, without those that only close holes; the longest triangle that did.
fn prepared(file: ScanFile, best: &FrameAttempt, capture: &PlannedCapture) -> (PointCloud, Removed, Option<f64>) {
    let ScanFile { mut cloud, .. } = file;
    let mut removed = Removed::default();
    let longest = holes::drop_filled(&mut cloud, &mut removed);
    let longest_mm = longest.map(|longest| longest * best.unit.mm());
    let mut cloud = cloud.into_millimetres(best.unit);
    if let Some(scanner_from_frame) = capture.scanner_from(best.frame) {
        frames::transform(&mut cloud.points_mm, &scanner_from_frame);
    }
    (cloud, removed, longest_mm)
}

/// Reason for which a file fits its view in no declared way.
fn diagnosis(
    file: &ScanFile,
    capture: &PlannedCapture,
    world: &IngestWorld<'_>,
    tried: &[FrameAttempt],
) -> (IngestCode, Option<u32>) {
    if let Some(best) = best_of(tried.iter()).filter(|best| best.on_part >= MIN_SHARE) {
        let other_unit = file.unit.is_some_and(|unit| unit != best.unit);
        return (if other_unit { IngestCode::UnitMismatch } else { IngestCode::FrameMismatch }, None);
    }
    let others = world.captures.iter().filter(|other| other.viewpoint != capture.viewpoint);
    let fits = others.filter_map(|other| {
        let tried = try_all(&file.cloud, file.unit, other, world);
        best_of(tried.iter()).filter(|best| best.on_part >= MIN_SHARE).map(|best| (best.on_part, other.viewpoint))
    });
    if let Some((_, viewpoint)) =
        fits.fold(None, |best: Option<(f64, u32)>, fit| best.filter(|best| best.0 >= fit.0).or(Some(fit)))
    {
        return (IngestCode::WrongView, Some(viewpoint));
    }
    if tried.iter().any(|attempt| attempt.in_frusta >= MIN_SHARE) {
        (IngestCode::NoPart, None)
    } else if file.unit.is_some() {
        (IngestCode::UnitMismatch, None)
    } else {
        (IngestCode::FrameMismatch, None)
    }
}

/// A cloud of all views, put into the image of each. A number in its name may be that of the part, be it also one of a view.
fn take_merged(
    file: ScanFile,
    number: Option<u32>,
    world: &IngestWorld<'_>,
    (options, ctx): (&IngestOptions, &Context<'_>),
    into: &mut ReadFile,
) -> Result<(), Cancelled> {
    let name = label(&file);
    let Some(first) = world.captures.first() else { return Ok(()) };
    let tried = frames::try_merged(&file.cloud, file.unit, first, world);
    let declared = |attempt: &&FrameAttempt| {
        file.unit.is_none_or(|unit| unit == attempt.unit) && file.frame.is_none_or(|frame| frame == attempt.frame)
    };
    let Some(best) = best_of(tried.iter().filter(declared)).filter(|best| best.on_part >= MIN_SHARE) else {
        let fits = best_of(tried.iter()).filter(|best| best.on_part >= MIN_SHARE);
        let code = match fits {
            Some(fit) if file.unit.is_some_and(|unit| unit != fit.unit) => IngestCode::UnitMismatch,
            Some(_) => IngestCode::FrameMismatch,
            None if number.is_some() => IngestCode::ViewUnknown,
            None => IngestCode::NoPart,
        };
        let finding = IngestFinding::of(code, Some(name), None).with_number(number, world);
        into.findings.push(IngestFinding { tried, ..finding });
        return Ok(());
    };
    let (mut cloud, removed, longest_mm) = prepared(file, &best, first);
    let points = cloud.finite().count() + removed.total();
    frames::transform(&mut cloud.points_mm, first.part_from_scanner.isometry());
    let images = merged_images(&cloud.points_mm, world, &options.clean, ctx)?;
    for (capture, image) in world.captures.iter().zip(images) {
        let mut own = Removed { is_projected: true, ..removed.clone() };
        own.count(RemovedBecause::OutsideImage, image.outside);
        let scanner_cloud = clean::clean(image.scanner_cloud, capture, world, &options.clean, &mut own);
        let scan = ViewScan { viewpoint: capture.viewpoint, part_from_scanner: capture.part_from_scanner, scanner_cloud };
        let (unit, frame, file) = (best.unit, best.frame, name.clone());
        into.scans.push(TakenScan { scan, file, unit, frame, fit: best, points, removed: own, is_approximate: true });
    }
    // A speck lies near the part wherever it is put, and holds no view in place.
    let min_points = RegistrationOptions::default().min_points;
    let is_speck = into.scans.iter().all(|taken| taken.scan.scanner_cloud.finite().count() < min_points);
    let code = if is_speck { IngestCode::NoPart } else { IngestCode::Merged };
    let finding = IngestFinding::of(code, Some(name.clone()), None).with_number(number, world);
    into.findings.push(IngestFinding { tried, ..finding });
    if is_speck {
        into.scans.clear();
    } else if longest_mm.is_some() {
        into.findings.push(IngestFinding { longest_mm, ..IngestFinding::of(IngestCode::FilledHoles, Some(name), None) });
    }
    Ok(())
}
