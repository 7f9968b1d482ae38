//! Ways along a cell's roadmap beside the part of one plan. A road is used where the arm clears the part at every table angle, so
//! the table turns meanwhile as it has to. Roads are looked at when a way would use them, each once (R. Bohlin and L. Kavraki,
//! "Path planning using lazy PRM", ICRA 2000).

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use super::moves::{Looks, Moves};
use super::roadmap::Roadmap;
use crate::cell::{CollisionScene, Configuration};

/// Ways on to the roadmap that are looked at for a station, …
const LOOKED_AT: usize = 16;
/// … and as many of them kept as are free.
const RAMPS: usize = 3;

/// A free way from a station on to the roadmap, the table as at the station.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ramp {
    /// The point beside the station that the way goes by, if any.
    retreat: Option<Configuration>,
    place: usize,
    secs: f64,
}

/// A place that is yet to be gone on from, by the time of a way by it. Times are not negative, and such floats order as their
/// bits do.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Waiting {
    whole: u64,
    so_far: u64,
    place: usize,
    /// The road to it; none from a ramp.
    road: Option<usize>,
}

impl Waiting {
    fn new(so_far_secs: f64, ahead_secs: f64, place: usize, road: Option<usize>) -> Self {
        Self { whole: (so_far_secs + ahead_secs).to_bits(), so_far: so_far_secs.to_bits(), place, road }
    }
}

/// A roadmap beside a part.
pub(super) struct Network {
    roadmap: Arc<Roadmap>,
    /// With the part as it is at every table angle.
    scene: CollisionScene,
    is_open: Vec<bool>,
    is_free: Vec<OnceLock<bool>>,
}

impl Network {
    pub(super) fn new(roadmap: Arc<Roadmap>, scene: &CollisionScene) -> Self {
        let scene = scene.at_every_table_angle();
        let is_open = roadmap.places.par_iter().map(|place| scene.check(place).is_none()).collect();
        let is_free = roadmap.roads.iter().map(|_| OnceLock::new()).collect();
        Self { roadmap, scene, is_open, is_free }
    }

    /// Home's own.
    pub(super) fn home() -> Vec<Ramp> {
        vec![Ramp { retreat: None, place: 0, secs: 0.0 }]
    }

    /// The quickest free ways on to the roadmap from a station, straight or by a point that it can be drawn back to.
    pub(super) fn ramps(&self, station: &Configuration, retreats: &[Configuration], moves: &Moves<'_>) -> Vec<Ramp> {
        let from = std::iter::once(None).chain(retreats.iter().copied().map(Some));
        let open = || (0..self.is_open.len()).filter(|place| self.is_open[*place]);
        let mut ramps: Vec<_> = from
            .flat_map(|retreat| {
                open().map(move |place| {
                    let there = self.place(place, station[6]);
                    let secs = match retreat {
                        Some(point) => moves.straight_secs(station, &point) + moves.straight_secs(&point, &there),
                        None => moves.straight_secs(station, &there),
                    };
                    Ramp { retreat, place, secs }
                })
            })
            .collect();
        ramps.sort_by(|a, b| a.secs.total_cmp(&b.secs));
        let mut looks = Looks::new(moves);
        let mut is_free = |ramp: &Ramp| looks.is_free(&ramp.retreat.unwrap_or(*station), &self.place(ramp.place, station[6]));
        ramps.into_iter().take(LOOKED_AT).filter(|ramp| is_free(ramp)).take(RAMPS).collect()
    }

    /// The points of a quick way from one station to another by the roadmap, both left out; the table turns on it from the one's
    /// angle to the other's.
    pub(super) fn way(
        &self,
        (from, first): (&Configuration, &[Ramp]),
        (to, last): (&Configuration, &[Ramp]),
        moves: &Moves<'_>,
    ) -> Option<Vec<Configuration>> {
        let (places, enter, leave) = self.quickest(first, last, moves)?;
        let angles = self.table_angles(&places, [from[6], to[6]], moves);
        let on_roads = places.iter().zip(angles).map(|(place, angle)| self.place(*place, angle));
        let mut way: Vec<_> = enter.retreat.into_iter().chain(on_roads).collect();
        if places.len() == 1 {
            way.push(self.place(places[0], to[6]));
        }
        way.extend(leave.retreat);
        Some(way)
    }

    /// A* over the places; a road is looked at when the way to its end is the next best.
    fn quickest<'r>(&self, first: &'r [Ramp], last: &'r [Ramp], moves: &Moves<'_>) -> Option<(Vec<usize>, &'r Ramp, &'r Ramp)> {
        let secs_between = |a: usize, b: usize| moves.straight_secs(&self.roadmap.places[a], &self.roadmap.places[b]);
        let ahead =
            |place: usize| last.iter().map(|ramp| secs_between(place, ramp.place) + ramp.secs).fold(f64::INFINITY, f64::min);
        let mut before: Vec<Option<Option<usize>>> = vec![None; self.roadmap.places.len()];
        let mut waiting = BinaryHeap::new();
        for ramp in first {
            waiting.push(Reverse(Waiting::new(ramp.secs, ahead(ramp.place), ramp.place, None)));
        }
        while let Some(Reverse(Waiting { so_far, place, road, .. })) = waiting.pop() {
            if before[place].is_some() || road.is_some_and(|road| !self.is_free(road)) {
                continue;
            }
            before[place] = Some(road);
            if let Some(leave) = last.iter().find(|ramp| ramp.place == place) {
                let places = self.traced(place, &before);
                let enter = first.iter().find(|ramp| ramp.place == places[0])?;
                return Some((places, enter, leave));
            }
            for road in &self.roadmap.roads_at[place] {
                let next = self.other_end(*road, place);
                if self.is_open[next] && before[next].is_none() {
                    let secs = f64::from_bits(so_far) + secs_between(place, next);
                    waiting.push(Reverse(Waiting::new(secs, ahead(next), next, Some(*road))));
                }
            }
        }
        None
    }

    /// The places up to one, the first first.
    fn traced(&self, mut place: usize, before: &[Option<Option<usize>>]) -> Vec<usize> {
        let mut places = vec![place];
        while let Some(road) = before[place].flatten() {
            place = self.other_end(road, place);
            places.push(place);
        }
        places.reverse();
        places
    }

    fn other_end(&self, road: usize, place: usize) -> usize {
        let [a, b] = self.roadmap.roads[road];
        if a == place { b } else { a }
    }

    fn is_free(&self, road: usize) -> bool {
        let [a, b] = self.roadmap.roads[road].map(|place| &self.roadmap.places[place]);
        *self.is_free[road].get_or_init(|| self.scene.check_segment(a, b).is_none())
    }

    fn place(&self, place: usize, table_angle_rad: f64) -> Configuration {
        let mut there = self.roadmap.places[place];
        there[6] = table_angle_rad;
        there
    }

    /// The table's angle at each place: it turns as the arm gets on.
    fn table_angles(&self, places: &[usize], [from, to]: [f64; 2], moves: &Moves<'_>) -> Vec<f64> {
        let roads =
            places.windows(2).map(|ends| moves.straight_secs(&self.roadmap.places[ends[0]], &self.roadmap.places[ends[1]]));
        let along: Vec<f64> = std::iter::once(0.0)
            .chain(roads.scan(0.0, |so_far, secs| {
                *so_far += secs;
                Some(*so_far)
            }))
            .collect();
        let whole = along.last().copied().unwrap_or(0.0);
        let angle = |secs: &f64| if whole > 0.0 { from + (to - from) * secs / whole } else { from };
        along.iter().map(angle).collect()
    }
}
