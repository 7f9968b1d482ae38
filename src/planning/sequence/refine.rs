//! Stations between those that were sampled: the table's angle is free, so each stop of a tour is moved along it, the scanner
//! staying where it is on the part and the arm on its branch, as long as the moves before and after take less and are free.
//! Coordinate descent, stop by stop; the order stays.

use super::ViewId;
use super::routes::{Route, Routes};
use crate::cell::{Configuration, joints_of};
use crate::planning::context::{Cancelled, Context};

/// By how much the table is turned either way, degrees: beyond, within and below the step of sampling.
const STEPS_DEG: [f64; 8] = [40.0, 20.0, 10.0, 5.0, 2.5, 1.2, 0.6, 0.3];
/// Times that every stop is looked at.
const SWEEPS: usize = 6;
/// What a move of a stop has to save, seconds.
const WORTH_SECS: f64 = 1e-3;

/// A tour: its stops, and the ways to each and home at last.
pub(super) struct Tour {
    pub(super) stops: Vec<(ViewId, Configuration)>,
    pub(super) ways: Vec<Route>,
}

impl Tour {
    /// Where the way to a stop begins.
    pub(super) fn before(&self, stop: usize, home: &Configuration) -> Configuration {
        stop.checked_sub(1).map_or(*home, |last| self.stops[last].1)
    }

    pub(super) fn secs(&self) -> f64 {
        self.ways.iter().map(|way| way.secs).sum()
    }

    /// Moves stops along the table's angle.
    pub(super) fn refine(&mut self, routes: &Routes<'_>, ctx: &Context<'_>) -> Result<(), Cancelled> {
        for _ in 0..SWEEPS {
            let mut moved = false;
            for stop in 0..self.stops.len() {
                ctx.check()?;
                moved |= self.move_stop(stop, routes);
            }
            if !moved {
                break;
            }
        }
        Ok(())
    }

    fn move_stop(&mut self, stop: usize, routes: &Routes<'_>) -> bool {
        let home = routes.home();
        let (before, here) = (self.before(stop, home), self.stops[stop].1);
        let after = self.stops.get(stop + 1).map_or(*home, |(_, next)| *next);
        let taken_secs = self.ways[stop].secs + self.ways[stop + 1].secs;
        let moves = &routes.moves;
        let mut quicker: Vec<(f64, Configuration)> = STEPS_DEG
            .iter()
            .flat_map(|step| [*step, -step])
            .filter_map(|step| routes.turned(&here, step.to_radians()))
            .map(|there| (moves.straight_secs(&before, &there) + moves.straight_secs(&there, &after), there))
            .filter(|(secs, _)| *secs < taken_secs - WORTH_SECS)
            .collect();
        quicker.sort_by(|a, b| a.0.total_cmp(&b.0));
        let free = quicker.into_iter().find(|(_, there)| moves.is_free(&before, there) && moves.is_free(there, &after));
        let Some((_, there)) = free else { return false };
        self.stops[stop].1 = there;
        self.ways[stop] = Route { via_rad: Vec::new(), secs: moves.straight_secs(&before, &there) };
        self.ways[stop + 1] = Route { via_rad: Vec::new(), secs: moves.straight_secs(&there, &after) };
        true
    }
}

impl Routes<'_> {
    /// The same view with the table turned further, on the branch of `station`; `None` out of reach.
    fn turned(&self, station: &Configuration, turn_rad: f64) -> Option<Configuration> {
        let cell = self.cell();
        let plate_from_scanner = cell.base_from_plate(station[6]).inverse() * cell.base_from_scanner(&joints_of(station));
        let mut turned = *station;
        turned[6] += turn_rad;
        self.nearest(&(cell.base_from_plate(turned[6]) * plate_from_scanner), &turned)
    }
}
