//! The cell's side of a plan: what the pipeline asks of stations and sequence, with the collision scene they share.

use super::candidates::{Candidate, Generated, Rejection};
use super::context::{Cancelled, Context};
use super::error::PlanError;
use super::input::PlanInput;
use super::params::PlanParams;
use super::selection::ViewId;
use super::sequence::{self, Ordered};
use super::stations::{self, Station};
use super::study::Reach;
use crate::cell::{Cell, CollisionScene};
use crate::geometry::{Part, Pose, Scanner as ScannerFrame, Table};

/// A cell with the part on its plate.
pub(super) struct Motion<'a> {
    cell: &'a Cell,
    scene: CollisionScene,
    table_from_part: Pose<Table, Part>,
    params: &'a PlanParams,
}

impl<'a> Motion<'a> {
    /// # Errors
    /// [`PlanError::BadParams`] when part or fixture meets what stands around or below the table.
    pub(super) fn new(
        cell: &'a Cell,
        input: &PlanInput<'_>,
        params: &'a PlanParams,
        table_from_part: Pose<Table, Part>,
    ) -> Result<Self, PlanError> {
        let clearance_mm = params.motion.clearance_mm;
        let scene = CollisionScene::new(cell, input.mesh, input.fixture, &table_from_part, clearance_mm);
        match scene.placement_contact() {
            Some(contact) => {
                let detail = format!("lets {contact} meet; move the part, or what it meets");
                Err(PlanError::param("/part/table_from_part", detail))
            }
            None => Ok(Self { cell, scene, table_from_part, params }),
        }
    }

    /// Drops candidates that lie inside a standing body at every table angle.
    pub(super) fn drop_inside_obstacles(&self, mut generated: Generated) -> Generated {
        let inside = |candidate: &Candidate| {
            stations::inside_obstacle(&candidate.part_from_scanner, self.cell, &self.scene, &self.table_from_part)
        };
        let (dropped, kept): (Vec<_>, Vec<_>) = generated.kept.into_iter().partition(inside);
        generated.rejected.extend(dropped.iter().map(|candidate| (candidate.id, Rejection::InsideObstacle)));
        generated.kept = kept;
        generated
    }

    /// Stations of every view.
    pub(super) fn reach(&self, views: &[Pose<Part, ScannerFrame>], ctx: &Context<'_>) -> Result<Reach, Cancelled> {
        stations::solve(views, self.cell, &self.scene, &self.table_from_part, ctx)
    }

    /// Whether the cell can take this one view: from a station free of collision, to which a path leads.
    pub(super) fn takes(&self, view: &Pose<Part, ScannerFrame>, ctx: &Context<'_>) -> Result<bool, Cancelled> {
        let ctx = ctx.silent();
        let reach = self.reach(&[*view], &ctx)?;
        let Some(Ok(stations)) = reach.first() else { return Ok(false) };
        Ok(self.order(&[(ViewId(0), stations)], false, &ctx)?.no_path.is_empty())
    }

    /// Order and paths through `views`; see [`sequence::order`].
    pub(super) fn order(&self, views: &[(ViewId, &[Station])], insist: bool, ctx: &Context<'_>) -> Result<Ordered, Cancelled> {
        sequence::order(views, self.cell, &self.scene, self.params, insist, ctx)
    }
}
