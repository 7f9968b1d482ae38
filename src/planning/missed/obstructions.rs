//! Obstructions: pairs of bodies that keep the cell from viewpoints, for how many, where, how deep, and what would
//! help. A candidate without a station is put down to two that meet at its station nearest to home; one without a path to
//! two that meet on the straight move to it, and where they are deepest in each other there.

use std::collections::BTreeMap;

use crate::cell::collision::{MIN_CLEARANCE_MM, QUERY_SHARE};
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
                if let Some(met) = met_at_home(blocked.scene) {
                    entry.advice = home_advice(met, blocked.scene.asked_clearance_mm());
                }
            }
        }
    }
    let mut found: Vec<_> = found.into_values().collect();
    // Stable: equal ones stay in the order of their names.
    found.sort_by_key(|obstruction| std::cmp::Reverse(obstruction.without_station + obstruction.without_path));
    Ok(found)
}

/// Two bodies that meet at the home of the cell while the part lies as in this scene.
fn met_at_home(scene: &PlanningScene<'_>) -> Option<Contact> {
    scene.collision_scene().check(&scene.cell().home_rad)
}

fn home_advice(bodies: Contact, clearance_mm: f64) -> Advice {
    if bodies.is_with_part() { Advice::MoveHome } else { Advice::FreeHome { bodies, clearance_mm } }
}

fn obstruction(bodies: Contact, ends: &[Configuration; 2], scene: &PlanningScene<'_>) -> Obstruction {
    let (configuration, separation) =
        scene.nearest_on(&bodies, ends).map_or((ends[1], None), |(at, separation)| (at, Some(separation)));
    let advice = advice(&bodies, separation.as_ref(), scene.cell(), scene.asked_clearance_mm());
    Obstruction { bodies, without_station: 0, without_path: 0, configuration, separation, advice }
}

fn advice(bodies: &Contact, separation: Option<&Separation>, cell: &Cell, clearance_mm: f64) -> Advice {
    // Bodies keep the clearance and what the plate may run out by, and queries are exact to a share of the distance. On a segment they may be
    // nearest between the places looked at.
    let kept_mm = |separation: &Separation| (1.0 - QUERY_SHARE) * separation.distance_mm;
    let max_mm = separation.map(|separation| kept_mm(separation) - cell.turntable.runout_displacement_mm());
    if let Some(max_mm) = max_mm.filter(|max_mm| (MIN_CLEARANCE_MM..clearance_mm).contains(max_mm)) {
        return Advice::ReduceClearance(max_mm);
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

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Point3};

    use super::*;
    use crate::cell::{Body, Presets, RunoutHarmonic, Shape, SpecLibrary};

    /// A home at which the arm meets its own scanner was to be moved away from the part.
    #[test]
    fn a_home_at_which_the_part_meets_nothing_is_not_to_be_moved_away_from_it() {
        let met = |b: &str| Contact { a: "link 4".into(), b: b.into() };
        assert_eq!(["part", "fixture"].map(|b| home_advice(met(b), 5.0)), [Advice::MoveHome, Advice::MoveHome]);
        let bodies = met("scanner body");
        assert_eq!(home_advice(bodies.clone(), 5.0), Advice::FreeHome { bodies, clearance_mm: 5.0 });
    }

    /// The whole distance was advised: with a plate that runs out, a clearance with which the two still collide, or a larger one than
    /// the present.
    #[test]
    fn a_smaller_clearance_leaves_what_the_plate_runs_out_by_and_is_below_the_present_one() {
        let mut cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let shape = Shape::Box { size_mm: [20.0, 900.0, 900.0] };
        cell.obstacles.push(Body { name: "guard".to_owned(), owner_from_body: Isometry3::identity(), shape });
        let bodies = Contact { a: "forearm".into(), b: "guard".into() };
        let mut advised = |distance_mm: f64, runout_mm: f64| {
            cell.turntable.runout = vec![RunoutHarmonic { order: 1, cos: [0.0; 5], sin: [0.0, 0.0, runout_mm, 0.0, 0.0] }];
            let separation = Separation { bodies: bodies.clone(), distance_mm, place_in_base_mm: Point3::origin() };
            advice(&bodies, Some(&separation), &cell, 5.0)
        };
        let guard = || Advice::MoveObstacle("guard".to_owned());
        // A clearance of 4 mm may be refused at 4 mm: queries in single precision are as exact as that.
        for (distance_mm, runout_mm) in [(4.0, 0.0), (4.0, 1.0), (5.5, 1.0)] {
            let kept_mm = (1.0 - QUERY_SHARE) * distance_mm - runout_mm;
            assert_eq!(advised(distance_mm, runout_mm), Advice::ReduceClearance(kept_mm));
        }
        assert_eq!(advised(1.5, 1.0), guard(), "less than the smallest clearance is left");
        assert_eq!(advised(5.2, 0.0), guard(), "no smaller one than the present");
    }
}
