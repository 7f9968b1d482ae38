//! The planning scene: a cell with the part on its plate, and everything that a plan asks of the two. The input of a plan and
//! its defaults stand here too, since both depend on the presence of a cell.

mod defaults;
pub(super) mod demand;
mod input;
mod placement;

pub(super) use defaults::standing_on;
pub use defaults::{UnknownAxis, UpAxis, resolve, resting, standing, standing_likeliest};
pub use input::PlanInput;
pub(super) use placement::check as check_placement;
pub use placement::{plate, tips_over};

use super::candidates::{Candidate, CandidateSet, Rejection};
use super::context::{Cancelled, Context, PlanError, Refusal, Stage};
use super::ids::ViewId;
use super::params::PlanParams;
use super::sequence::{self, InSight, OrderOptions, Ordered, Roadmaps, StopPermits};
use super::sight::Sight;
use super::stations::{self, Station, StationFailure};
use super::surface::Surface;
use super::visibility::{Row, SampleSet};
use crate::cell::collision::MetOnTable;
use crate::cell::{Cell, CollisionScene, Configuration, Contact, Farthest, Separation};
use crate::geometry::{Part, Pose, ScannerFrame, Table, parallel, plate_from_placed};

/// Largest separation that is measured, mm: as far as a clearance may be asked for.
const MAX_SEPARATION_MM: f64 = 200.0;

/// Stations of every candidate, or why it has none; a [`super::ids::CandidateIndex`] is a place in it.
pub(super) type Reach = Vec<Result<Vec<Station>, StationFailure>>;

/// A cell with the part on its plate.
pub(super) struct PlanningScene<'a> {
    cell: &'a Cell,
    scene: CollisionScene,
    sight: Sight,
    table_from_part: Pose<Table, Part>,
    params: &'a PlanParams,
    roadmaps: Option<&'a Roadmaps>,
}

impl<'a> PlanningScene<'a> {
    /// # Errors
    /// [`PlanError::BadParams`] when part or fixture meets what stands around or below the table, [`PlanError::Cancelled`].
    pub(super) fn new(
        cell: &'a Cell,
        input: &PlanInput<'a>,
        params: &'a PlanParams,
        table_from_part: Pose<Table, Part>,
        ctx: &Context<'_>,
    ) -> Result<Self, PlanError> {
        let clearance_mm = params.motion.clearance_mm;
        let scene = ctx.within(Stage::CollisionScene, || match input.roadmaps {
            Some(roadmaps) => roadmaps.bare_scene(cell, clearance_mm).with_part(input.mesh, input.fixture, &table_from_part),
            None => CollisionScene::new(cell, input.mesh, input.fixture, &table_from_part, clearance_mm),
        });
        Self::placed(cell, scene, input, params, table_from_part, ctx)
    }

    /// The cell with the part lying in another way.
    ///
    /// # Errors
    /// Errors of [`PlanningScene::new`].
    pub(super) fn lying(
        &self,
        input: &PlanInput<'a>,
        table_from_part: Pose<Table, Part>,
        ctx: &Context<'_>,
    ) -> Result<Self, PlanError> {
        let moved = || self.scene.with_part_moved(&self.table_from_part, &table_from_part);
        let scene = ctx.within(Stage::CollisionScene, moved);
        Self::placed(self.cell, scene, input, self.params, table_from_part, ctx)
    }

    fn placed(
        cell: &'a Cell,
        scene: CollisionScene,
        input: &PlanInput<'a>,
        params: &'a PlanParams,
        table_from_part: Pose<Table, Part>,
        ctx: &Context<'_>,
    ) -> Result<Self, PlanError> {
        match scene.placement_contact() {
            Some(contact) => Err(PlanError::param("/part/table_from_part", &Refusal::Collides(contact))),
            None => {
                let sight = Sight::new(cell, &input.mesh.aabb(), &table_from_part, ctx)?;
                Ok(Self { cell, scene, sight, table_from_part, params, roadmaps: input.roadmaps })
            }
        }
    }

    /// Drops candidates that lie inside a standing body at every table angle.
    pub(super) fn drop_inside_obstacles(&self, mut generated: CandidateSet) -> CandidateSet {
        let inside = |candidate: &Candidate| {
            stations::inside_obstacle(&candidate.part_from_scanner, self.cell, &self.scene, &self.table_from_part)
        };
        let (dropped, remaining): (Vec<_>, Vec<_>) = generated.remaining.into_iter().partition(inside);
        generated.rejected.extend(dropped.into_iter().map(|candidate| (candidate, Rejection::InsideObstacle)));
        generated.remaining = remaining;
        generated
    }

    /// Drops candidates at which what the flange carries, the scanner's body above all, is closer than the clearance to the
    /// plate, the part or its fixture. The pose alone decides that, wherever arm and table are.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(super) fn drop_where_body_meets(&self, candidates: CandidateSet, ctx: &Context<'_>) -> Result<CandidateSet, Cancelled> {
        let plate_from_part = plate_from_placed(&self.table_from_part);
        let flange_from_scanner = &self.cell.flange_from_scanner;
        let reason = |candidate: &Candidate| {
            ctx.check()?;
            let plate_from_flange = plate_from_part * candidate.part_from_scanner * flange_from_scanner.inverse();
            Ok(self.scene.check_carried(&plate_from_flange).map(|met| match met {
                MetOnTable::Plate => Rejection::BodyMeetsPlate,
                MetOnTable::Attached => Rejection::BodyMeetsPart,
            }))
        };
        let CandidateSet { remaining, generated, mut rejected } = candidates;
        let reasons = parallel::try_map::<_, _, Cancelled>(&remaining, reason)?;
        let mut clear = Vec::with_capacity(remaining.len());
        for (candidate, reason) in remaining.into_iter().zip(reasons) {
            match reason {
                Some(reason) => rejected.push((candidate, reason)),
                None => clear.push(candidate),
            }
        }
        Ok(CandidateSet { remaining: clear, generated, rejected })
    }

    /// Stations of every view.
    pub(super) fn reach(&self, views: &[Pose<Part, ScannerFrame>], ctx: &Context<'_>) -> Result<Reach, Cancelled> {
        stations::solve_as_moved(views, self.cell, &self.scene, &self.table_from_part, self.params.motion.table, ctx)
    }

    /// Cell and part as collisions are looked for.
    pub(super) fn collision_scene(&self) -> &CollisionScene {
        &self.scene
    }

    /// The lines of sight past the obstacles of the cell.
    pub(super) fn sight(&self) -> &Sight {
        &self.sight
    }

    /// Keeps a view's stations where obstacles hide nothing that it measures at any of them. Else replaces them by stations
    /// solved anew at all table angles at which nothing is hidden; where there are none, keeps those at which least is hidden and
    /// takes that out of `row`. Returns what it took out. A view measures what its row says from every station that is kept.
    pub(super) fn keep_in_sight(
        &self,
        surface: &Surface,
        view: &Pose<Part, ScannerFrame>,
        stations: &mut Vec<Station>,
        row: &mut Row,
        ctx: &Context<'_>,
    ) -> Result<Option<SampleSet>, Cancelled> {
        if self.sight.has_no_obstacles() {
            return Ok(None);
        }
        ctx.check()?;
        let hidden_at = |station: &Station| self.sight.hidden(surface, view, row.measured(), station.table_angle_rad, ctx);
        let hidden: Vec<Option<SampleSet>> = stations.iter().map(hidden_at).collect::<Result<_, Cancelled>>()?;
        if hidden.iter().all(Option::is_none) {
            return Ok(None);
        }
        let is_clear = |table_rad: f64| !self.sight.hides(surface, view, row.measured(), table_rad, ctx);
        let tried = (self.params.motion.table, &is_clear as &dyn Fn(f64) -> bool);
        let clear = stations::solve_at(view, self.cell, &self.scene, &self.table_from_part, tried, ctx)?;
        ctx.check()?;
        if !clear.is_empty() {
            *stations = clear;
            return Ok(None);
        }
        // No angle is clear, or one between the 72 alone, at which a station was found before.
        let area_mm2 = |hidden: &SampleSet| hidden.iter().map(|sample| surface.sample_area_mm2(sample)).sum::<f64>();
        let hidden: Vec<SampleSet> = hidden.into_iter().map(Option::unwrap_or_default).collect();
        let Some(least) = hidden.iter().min_by(|a, b| area_mm2(a).total_cmp(&area_mm2(b))).cloned() else { return Ok(None) };
        let is_within = |hidden: &SampleSet| {
            let mut beyond = hidden.clone();
            beyond.remove_all(&least);
            beyond.count() == 0
        };
        let mut keeps = hidden.iter().map(is_within);
        stations.retain(|_| keeps.next().unwrap_or_default());
        *row = row.without(&least);
        Ok((least.count() > 0).then_some(least))
    }

    /// Returns true if obstacles hide nothing that a view measures while the table stands at an angle.
    pub(super) fn is_in_sight(
        &self,
        surface: &Surface,
        view: &Pose<Part, ScannerFrame>,
        row: &Row,
        table_rad: f64,
        ctx: &Context<'_>,
    ) -> bool {
        !self.sight.hides(surface, view, row.measured(), table_rad, ctx)
    }

    /// Returns true if the cell can execute this one view: from a station free of collision and of obstacles between the devices
    /// and the part, to which a path leads.
    pub(super) fn can_execute(&self, view: &Pose<Part, ScannerFrame>, ctx: &Context<'_>) -> Result<bool, Cancelled> {
        let ctx = ctx.silent();
        let reach = self.reach(&[*view], &ctx)?;
        let Some(Ok(stations)) = reach.first() else { return Ok(false) };
        let is_clear = |station: &&Station| self.sight.is_clear(view, station.table_angle_rad);
        let stations: Vec<Station> = stations.iter().filter(is_clear).copied().collect();
        let in_sight = |_: ViewId, station: &Configuration| self.sight.is_clear(view, station.table_rad);
        Ok(!stations.is_empty() && self.order(&[(ViewId(0), &stations)], false, &in_sight, &ctx)?.no_path.is_empty())
    }

    /// Order and paths through `views`; see [`sequence::order_in_sight`].
    pub(super) fn order(
        &self,
        views: &[(ViewId, &[Station])],
        require_all: bool,
        in_sight: &InSight<'_>,
        ctx: &Context<'_>,
    ) -> Result<Ordered, Cancelled> {
        let options = OrderOptions { roadmaps: self.roadmaps, require_all, in_sight };
        sequence::order_in_sight(views, self.cell, &self.scene, self.params, &options, ctx)
    }

    /// Adds the bound to a sequence; see [`sequence::bounded`].
    pub(super) fn bounded(&self, ordered: Ordered, ctx: &Context<'_>) -> Result<Ordered, Cancelled> {
        sequence::bounded(ordered, self.cell, self.params, ctx)
    }

    /// Adds the bound of the moves as they are to a sequence; see [`sequence::bounded_as_moved`].
    pub(super) fn bounded_as_moved(&self, ordered: Ordered, ctx: &Context<'_>) -> Result<Ordered, Cancelled> {
        sequence::bounded_as_moved(ordered, self.cell, self.params, ctx)
    }

    /// Rolls views of a sequence; see [`sequence::roll`].
    pub(super) fn roll(&self, ordered: Ordered, ctx: &Context<'_>, permits: &mut dyn StopPermits) -> Result<Ordered, Cancelled> {
        sequence::roll(ordered, self.cell, &self.scene, self.params, permits, ctx)
    }

    /// The two bodies that keep the cell from a view, and the segment on which they do: the straight way to the first of its
    /// stations, or, where it has none, a single place: the station nearest to home that the arm could take but for
    /// collision. `None` where it takes the view, or could not reach it.
    pub(super) fn where_it_fails(
        &self,
        view: &Pose<Part, ScannerFrame>,
        stations: &[Station],
    ) -> Option<(Contact, [Configuration; 2])> {
        let ends = match stations.first() {
            Some(station) => [self.cell.home_rad, station.configuration()],
            None => [stations::nearest_ik_solution(view, self.cell, &self.scene, &self.table_from_part)?; 2],
        };
        Some((self.scene.check_segment(&ends[0], &ends[1])?, ends))
    }

    /// Configuration on a segment at which two bodies are nearest to or deepest in each other.
    pub(super) fn nearest_on(&self, bodies: &Contact, ends: &[Configuration; 2]) -> Option<(Configuration, Separation)> {
        self.scene.nearest_on(bodies, ends, MAX_SEPARATION_MM)
    }

    /// Largest distance of each pair of bodies, for [`PlanningScene::clearance_mm`].
    pub(super) fn farthest(&self, ctx: &Context<'_>) -> Result<Farthest, Cancelled> {
        self.scene.farthest(self.cell, MAX_SEPARATION_MM, || ctx.check())
    }

    /// Distance of what is nearest to each other at a station, of what is nearer than it has to be; `None` beyond
    /// [`MAX_SEPARATION_MM`].
    pub(super) fn clearance_mm(&self, station: &Station, farthest: &Farthest) -> Option<f64> {
        let nearest = self.scene.nearest(&station.configuration(), farthest, MAX_SEPARATION_MM);
        nearest.map(|separation| separation.distance_mm)
    }

    pub(super) fn cell(&self) -> &Cell {
        self.cell
    }

    /// Clearance that the plan asks for, mm, beside what the plate may run out by.
    pub(super) fn asked_clearance_mm(&self) -> f64 {
        self.params.motion.clearance_mm
    }
}
