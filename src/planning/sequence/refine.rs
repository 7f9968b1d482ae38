//! Stations between those that were sampled: the table's angle is free, so each stop of a tour is moved along it, the scanner
//! staying where it is on the part and the arm with its IK solution, as long as the moves before and after take less and are
//! free; and the scanner is rolled about its optical axis where whoever knows what it measures permits that. Coordinate
//! descent, stop by stop; the order stays.

use std::f64::consts::{PI, TAU};

use nalgebra::{UnitQuaternion, Vector3};

use super::routes::{Route, Routes};
use crate::cell::Configuration;
use crate::geometry::{Plate, Pose, ScannerFrame, sort_ascending, sort_descending};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::ViewId;
use crate::planning::params::TableMotion;

/// Turns of the table that are tried either way, degrees: beyond, within and below the step of sampling.
const STEPS_DEG: [f64; 8] = [40.0, 20.0, 10.0, 5.0, 2.5, 1.2, 0.6, 0.3];
/// Angles of the table, evenly spread over a turn, to which several stops are brought where it turns alone: those of sampling.
const ANGLES: u32 = 72;
/// Stops that are brought to one angle at most, and choices of those that are checked for collisions, the quickest first.
const MAX_SHARING: usize = 12;
const MAX_CHECKED: usize = 20;
/// Rolls of the scanner that are tried either way, degrees, each once at every stop.
const ROLLS_DEG: [f64; 3] = [15.0, 7.5, 3.75];
/// Passes over all stops at most.
const MAX_SWEEPS: usize = 6;
/// Smallest saving for which a stop is moved, seconds.
const MIN_SAVING_SECS: f64 = 1e-3;

/// Returns true if nothing that stands in the cell hides from a station what a view measures.
pub type InSight<'a> = dyn Fn(ViewId, &Configuration) -> bool + 'a;

/// Knowledge of what views measure: decides where else a view may be taken from.
pub trait StopPermits {
    /// Returns true if a view may be taken with the scanner at this pose on the plate instead, the table at this angle.
    ///
    /// # Errors
    /// [`Cancelled`].
    fn may_roll(
        &mut self,
        view: ViewId,
        plate_from_scanner: &Pose<Plate, ScannerFrame>,
        table_rad: f64,
    ) -> Result<bool, Cancelled>;

    /// Returns true if nothing that stands in the cell hides from a station what a view measures; see [`InSight`].
    fn is_in_sight(&self, view: ViewId, station: &Configuration) -> bool;
}

/// A tour: its stops, and the routes to each of them and home at last.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tour {
    pub(super) stops: Vec<(ViewId, Configuration)>,
    pub(super) paths: Vec<Route>,
}

impl Tour {
    /// The configuration from which the move to a stop begins.
    pub(super) fn before(&self, stop: usize, home: &Configuration) -> Configuration {
        stop.checked_sub(1).map_or(*home, |last| self.stops[last].1)
    }

    pub(super) fn secs(&self) -> f64 {
        self.paths.iter().map(|path| path.secs).sum()
    }

    /// Moves stops along the table's angle, to where views are still in sight.
    pub(super) fn refine(&mut self, routes: &Routes<'_>, in_sight: &InSight<'_>, ctx: &Context<'_>) -> Result<(), Cancelled> {
        for _ in 0..MAX_SWEEPS {
            let mut moved = false;
            for stop in 0..self.stops.len() {
                ctx.check()?;
                moved |= self.move_stop(stop, routes, in_sight);
                // A table that turns alone need not turn between stops at one angle.
                if routes.moves.motion.table == TableMotion::Alone {
                    moved |= self.share_angle(stop, routes, in_sight, ctx)?;
                }
            }
            if !moved {
                break;
            }
        }
        Ok(())
    }

    /// Rolls the scanner about its optical axis at stops where that is quicker and `permits` lets it.
    pub(super) fn roll(
        &mut self,
        routes: &Routes<'_>,
        permits: &mut dyn StopPermits,
        ctx: &Context<'_>,
    ) -> Result<(), Cancelled> {
        for roll_deg in ROLLS_DEG {
            for stop in 0..self.stops.len() {
                ctx.check()?;
                let (view, here) = self.stops[stop];
                let rolled = [roll_deg, -roll_deg].into_iter().filter_map(|roll| routes.rolled(&here, roll.to_radians()));
                if let Some(there) = self.quicker(stop, rolled, routes, &|_| true)
                    && permits.may_roll(view, &routes.plate_from_scanner(&there), there.table_rad)?
                {
                    self.replace(stop, there, routes);
                }
            }
            self.refine(routes, &|view, station| permits.is_in_sight(view, station), ctx)?;
        }
        Ok(())
    }

    fn move_stop(&mut self, stop: usize, routes: &Routes<'_>, in_sight: &InSight<'_>) -> bool {
        let (view, here) = self.stops[stop];
        let steps = STEPS_DEG.iter().flat_map(|step| [*step, -step]);
        let turned = steps.filter_map(|step| routes.turned(&here, step.to_radians()));
        let quicker = self.quicker(stop, turned, routes, &|there| in_sight(view, there));
        if let Some(there) = quicker {
            self.replace(stop, there, routes);
        }
        quicker.is_some()
    }

    /// Brings a stop and some of those after it to one angle of the table, where that is quickest and free.
    fn share_angle(
        &mut self,
        first: usize,
        routes: &Routes<'_>,
        in_sight: &InSight<'_>,
        ctx: &Context<'_>,
    ) -> Result<bool, Cancelled> {
        let here_rad = self.stops[first].1.table_rad;
        let angles_rad = (0..ANGLES).map(|step| TAU * f64::from(step) / f64::from(ANGLES));
        let turns_rad = angles_rad.map(|angle_rad| (angle_rad - here_rad + PI).rem_euclid(TAU) - PI);
        let mut quicker: Vec<(f64, Vec<Configuration>)> = Vec::new();
        for turn_rad in turns_rad {
            ctx.check()?;
            let (mut there, mut before, mut secs, mut taken_secs) =
                (Vec::new(), self.before(first, routes.home()), 0.0, self.paths[first].secs);
            for (stop, (_, at)) in self.stops.iter().enumerate().skip(first).take(MAX_SHARING) {
                let Some(turned) = routes.turned(at, here_rad + turn_rad - at.table_rad) else { break };
                secs += routes.moves.straight_secs(&before, &turned);
                taken_secs += self.paths[stop + 1].secs;
                there.push(turned);
                before = turned;
                let after = self.stops.get(stop + 1).map_or(*routes.home(), |(_, next)| *next);
                let saved_secs = taken_secs - secs - routes.moves.straight_secs(&turned, &after);
                if saved_secs > MIN_SAVING_SECS {
                    quicker.push((saved_secs, there.clone()));
                }
            }
        }
        // Stable: of equal ones the first.
        sort_descending(&mut quicker, |(saved_secs, _)| *saved_secs);
        let is_free = |there: &[Configuration]| {
            let after = self.stops.get(first + there.len()).map_or(*routes.home(), |(_, next)| *next);
            let points: Vec<Configuration> = [&[self.before(first, routes.home())], there, &[after]].concat();
            self.stops[first..].iter().zip(there).all(|((view, _), there)| in_sight(*view, there))
                && points.windows(2).all(|ends| routes.moves.is_free(&ends[0], &ends[1]))
        };
        let free = quicker.into_iter().map(|(_, there)| there).take(MAX_CHECKED).find(|there| is_free(there));
        for (stop, there) in (first..).zip(free.iter().flatten()) {
            self.replace(stop, *there, routes);
        }
        Ok(free.is_some())
    }

    /// The quickest of `candidates` in place of a stop, if it saves something, the moves before and after are free, and `accept`
    /// lets it.
    fn quicker(
        &self,
        stop: usize,
        candidates: impl Iterator<Item = Configuration>,
        routes: &Routes<'_>,
        accept: &dyn Fn(&Configuration) -> bool,
    ) -> Option<Configuration> {
        let [before, after] = self.neighbours(stop, routes);
        let taken_secs = self.paths[stop].secs + self.paths[stop + 1].secs;
        let moves = &routes.moves;
        let mut quicker: Vec<(f64, Configuration)> = candidates
            .map(|there| (moves.straight_secs(&before, &there) + moves.straight_secs(&there, &after), there))
            .filter(|(secs, _)| *secs < taken_secs - MIN_SAVING_SECS)
            .collect();
        sort_ascending(&mut quicker, |(secs, _)| *secs);
        let is_free = |there: &Configuration| moves.is_free(&before, there) && moves.is_free(there, &after);
        let free = quicker.into_iter().find(|(_, there)| is_free(there) && accept(there));
        free.map(|(_, there)| there)
    }

    /// Puts a stop elsewhere, with straight moves to it and on.
    fn replace(&mut self, stop: usize, there: Configuration, routes: &Routes<'_>) {
        let [before, after] = self.neighbours(stop, routes);
        self.stops[stop].1 = there;
        self.paths[stop] = Route { via_rad: Vec::new(), secs: routes.moves.straight_secs(&before, &there) };
        self.paths[stop + 1] = Route { via_rad: Vec::new(), secs: routes.moves.straight_secs(&there, &after) };
    }

    /// The configurations before and after a stop.
    fn neighbours(&self, stop: usize, routes: &Routes<'_>) -> [Configuration; 2] {
        let home = routes.home();
        [self.before(stop, home), self.stops.get(stop + 1).map_or(*home, |(_, next)| *next)]
    }
}

impl Routes<'_> {
    fn plate_from_scanner(&self, station: &Configuration) -> Pose<Plate, ScannerFrame> {
        let cell = self.cell();
        cell.base_from_plate(station.table_rad).inverse() * cell.base_from_scanner(&station.joints_rad)
    }

    /// Turns the table under the same view, with the IK solution nearest to `station`; `None` out of reach.
    fn turned(&self, station: &Configuration, turn_rad: f64) -> Option<Configuration> {
        let turned = Configuration { table_rad: station.table_rad + turn_rad, ..*station }.with_rounded_table();
        self.nearest(&(self.cell().base_from_plate(turned.table_rad) * self.plate_from_scanner(station)), &turned)
    }

    /// Rolls the scanner about its optical axis at the same table angle, with the IK solution nearest to `station`; `None` out of
    /// reach.
    fn rolled(&self, station: &Configuration, roll_rad: f64) -> Option<Configuration> {
        let about_axis = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll_rad);
        let scanner_from_rolled = Pose::<ScannerFrame, ScannerFrame>::from_parts(Vector3::zeros(), about_axis);
        self.nearest(&(self.cell().base_from_scanner(&station.joints_rad) * scanner_from_rolled), station)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::room;
    use super::{Routes, STEPS_DEG};
    use crate::cell::rounded_deg;
    use crate::planning::params::PlanParams;

    #[test]
    fn the_table_stands_at_one_angle_to_the_bit_whatever_steps_lead_there() {
        let room = room(7, Vec::new());
        let routes = Routes::new(&room.cell, &room.scene, &PlanParams::default().motion);
        let mut turned_stations = 0;
        for station in room.stations.iter().flatten() {
            let here = station.configuration();
            assert_eq!(rounded_deg(here.table_rad).to_radians(), here.table_rad, "{}°", here.table_rad.to_degrees());
            for step_deg in STEPS_DEG.into_iter().flat_map(|step| [step, -step]) {
                let Some(there) = routes.turned(&here, step_deg.to_radians()) else { continue };
                let angle_deg = rounded_deg(here.table_rad) + step_deg;
                assert_eq!(there.table_rad, rounded_deg(angle_deg.to_radians()).to_radians(), "{angle_deg}°");
                turned_stations += 1;
            }
        }
        assert!(turned_stations > 100, "{turned_stations}");
    }
}
