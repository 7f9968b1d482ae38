//! Obstructions: pairs of bodies that keep the cell from viewpoints, for how many, where, how deep, and what would
//! help. A candidate without a station is put down to two that meet at its station nearest to home; one without a path to
//! two that meet on the straight move to it, and where they are deepest in each other there.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::candidates::Candidate;
use super::context::{Cancelled, Context};
use super::planning_scene::PlanningScene;
use super::stations::Station;
use crate::cell::collision::MIN_CLEARANCE_MM;
use crate::cell::{Cell, Configuration, Contact, Separation};

/// Largest separation that is measured, mm: as far as a clearance may be asked for.
pub(super) const MAX_SEPARATION_MM: f64 = 200.0;

/// Two bodies that are in each other's way.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstruction {
    /// The two bodies.
    pub bodies: Contact,
    /// Candidates that have no station for it.
    pub without_station: usize,
    /// Candidates to whose stations no path was found for it.
    pub without_path: usize,
    /// Configuration at which they meet, for one of the candidates, radians.
    pub configuration: Configuration,
    /// Separation of the two there; of overlapping meshes it is not known.
    pub separation: Option<Separation>,
    /// Advice, in words.
    pub help: String,
}

/// A candidate that the cell cannot use.
pub(super) struct BlockedCandidate<'a> {
    /// The scene of its setup.
    pub(super) scene: &'a PlanningScene<'a>,
    pub(super) candidate: &'a Candidate,
    /// Stations to which no path was found; none where nothing but collisions was found.
    pub(super) stations: &'a [Station],
}

/// Finds the obstructions of `blocked`, the one that blocks most candidates first.
pub(super) fn explain(blocked: &[BlockedCandidate<'_>], ctx: &Context<'_>) -> Result<Vec<Obstruction>, Cancelled> {
    let meeting = |blocked: &BlockedCandidate<'_>| {
        ctx.check()?;
        Ok(blocked.scene.where_it_fails(&blocked.candidate.part_from_scanner, blocked.stations))
    };
    let meetings: Vec<Option<(Contact, [Configuration; 2])>> =
        blocked.par_iter().map(meeting).collect::<Result<_, Cancelled>>()?;
    let mut found: BTreeMap<(String, String), Obstruction> = BTreeMap::new();
    for (blocked, meeting) in blocked.iter().zip(meetings) {
        let Some((bodies, ends)) = meeting else { continue };
        let key = (bodies.a.to_string(), bodies.b.to_string());
        let entry = found.entry(key).or_insert_with(|| Obstruction::new(bodies, &ends, blocked.scene));
        match blocked.stations {
            [] => entry.without_station += 1,
            _ => entry.without_path += 1,
        }
    }
    let mut found: Vec<_> = found.into_values().collect();
    // Stable: equal ones stay in the order of their names.
    found.sort_by_key(|obstruction| std::cmp::Reverse(obstruction.without_station + obstruction.without_path));
    Ok(found)
}

impl Obstruction {
    fn new(bodies: Contact, ends: &[Configuration; 2], scene: &PlanningScene<'_>) -> Self {
        let (configuration, separation) =
            scene.nearest_on(&bodies, ends).map_or((ends[1], None), |(at, separation)| (at, Some(separation)));
        let help = help(&bodies, separation.as_ref(), scene.cell());
        Self { bodies, without_station: 0, without_path: 0, configuration, separation, help }
    }
}

fn help(bodies: &Contact, separation: Option<&Separation>, cell: &Cell) -> String {
    if let Some(separation) = separation.filter(|separation| separation.distance_mm >= MIN_CLEARANCE_MM) {
        return format!("free there with motion.clearance_mm = {:.1}", (separation.distance_mm * 10.0).floor() / 10.0);
    }
    let among = |name: &str| *bodies.a == *name || *bodies.b == *name;
    if let Some(obstacle) = cell.obstacles.iter().find(|body| among(&body.name)) {
        return format!("move {}, or the table away from it", obstacle.name);
    }
    if among("fixture") {
        return "hold the part elsewhere, or plan it in several ways of lying (setups)".into();
    }
    let foot = cell.robot.links.iter().find(|link| link.link == 0 && among(&link.name));
    if foot.is_some() && among("part") {
        return "the part meets the robot's foot as the table turns: set the table farther off, or the part nearer to its axis"
            .into();
    }
    if among("part") {
        return "lay the part in another way (setups, part.table_from_part), or look at it from farther off (candidates.standoffs_mm)"
            .into();
    }
    if cell.table_bodies.iter().any(|body| among(&body.name)) || among("turntable plate") || among("floor") {
        return "raise the part above the plate, or the robot's foot; `vantage study reach` tells which foot and table reach most"
            .into();
    }
    let is_of_arm = |name: &str| cell.robot.links.iter().any(|link| *link.name == *name);
    if is_of_arm(&bodies.a) && is_of_arm(&bodies.b) {
        return "the arm folds onto itself there: set its foot nearer to the table or farther off; `vantage study reach` compares"
            .into();
    }
    "mount the scanner otherwise (flange_from_scanner); `vantage study reach` compares mounts".into()
}
