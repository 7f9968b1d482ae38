//! Obstructions: pairs of bodies that keep the cell from viewpoints, for how many, where, how deep, and what would
//! help. A candidate without a station is put down to two that meet at its station nearest to home; one without a path to
//! two that meet on the straight move to it, and where they are deepest in each other there.

use std::collections::BTreeMap;

use crate::cell::collision::MIN_CLEARANCE_MM;
use crate::cell::{Cell, Configuration, Contact, Separation};
use crate::geometry::parallel;
use crate::planning::candidates::Candidate;
use crate::planning::context::{Cancelled, Context};
use crate::planning::plan::{Advice, Obstruction};
use crate::planning::scene::PlanningScene;
use crate::planning::stations::Station;

/// A candidate that the cell cannot use.
pub(in crate::planning) struct BlockedCandidate<'a> {
    /// The scene of its setup.
    pub(in crate::planning) scene: &'a PlanningScene<'a>,
    pub(in crate::planning) candidate: &'a Candidate,
    /// Stations to which no path was found; none where nothing but collisions was found.
    pub(in crate::planning) stations: &'a [Station],
}

/// Finds the obstructions of `blocked`, the one that blocks most candidates first.
pub(in crate::planning) fn explain(blocked: &[BlockedCandidate<'_>], ctx: &Context<'_>) -> Result<Vec<Obstruction>, Cancelled> {
    let meeting = |blocked: &BlockedCandidate<'_>| {
        ctx.check()?;
        Ok(blocked.scene.where_it_fails(&blocked.candidate.part_from_scanner, blocked.stations))
    };
    let meetings: Vec<Option<(Contact, [Configuration; 2])>> = parallel::try_map::<_, _, Cancelled>(blocked, meeting)?;
    let mut found: BTreeMap<(String, String), Obstruction> = BTreeMap::new();
    for (blocked, meeting) in blocked.iter().zip(meetings) {
        let Some((bodies, ends)) = meeting else { continue };
        let key = (bodies.a.to_string(), bodies.b.to_string());
        let entry = found.entry(key).or_insert_with(|| obstruction(bodies, &ends, blocked.scene));
        match blocked.stations {
            [] => entry.without_station += 1,
            _ => {
                entry.without_path += 1;
                // No path leads from there, whatever else is in the way.
                if is_home_blocked(blocked.scene) {
                    entry.advice = Advice::MoveHome;
                }
            }
        }
    }
    let mut found: Vec<_> = found.into_values().collect();
    // Stable: equal ones stay in the order of their names.
    found.sort_by_key(|obstruction| std::cmp::Reverse(obstruction.without_station + obstruction.without_path));
    Ok(found)
}

/// Returns true if two bodies meet at the home of the cell while the part lies as in this scene.
fn is_home_blocked(scene: &PlanningScene<'_>) -> bool {
    scene.collision_scene().check(&scene.cell().home_rad).is_some()
}

fn obstruction(bodies: Contact, ends: &[Configuration; 2], scene: &PlanningScene<'_>) -> Obstruction {
    let (configuration, separation) =
        scene.nearest_on(&bodies, ends).map_or((ends[1], None), |(at, separation)| (at, Some(separation)));
    let advice = advice(&bodies, separation.as_ref(), scene.cell());
    Obstruction { bodies, without_station: 0, without_path: 0, configuration, separation, advice }
}

fn advice(bodies: &Contact, separation: Option<&Separation>, cell: &Cell) -> Advice {
    if let Some(separation) = separation.filter(|separation| separation.distance_mm >= MIN_CLEARANCE_MM) {
        return Advice::ReduceClearance(separation.distance_mm);
    }
    let among = |name: &str| *bodies.a == *name || *bodies.b == *name;
    if let Some(obstacle) = cell.obstacles.iter().find(|body| among(&body.name)) {
        return Advice::MoveObstacle(obstacle.name.to_string());
    }
    if among("fixture") {
        return Advice::MoveFixture;
    }
    let foot = cell.robot.links.iter().find(|link| link.link == 0 && among(&link.name));
    if foot.is_some() && among("part") {
        return Advice::MoveTable;
    }
    if among("part") {
        return Advice::TurnPart;
    }
    if cell.table_bodies.iter().any(|body| among(&body.name)) || among("turntable plate") || among("floor") {
        return Advice::RaisePart;
    }
    let is_of_arm = |name: &str| cell.robot.links.iter().any(|link| *link.name == *name);
    if is_of_arm(&bodies.a) && is_of_arm(&bodies.b) { Advice::MoveFoot } else { Advice::MountScanner }
}
