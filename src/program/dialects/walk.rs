//! A program as the flat list of what a controller does, one thing after another.

use crate::cell::{Axes, Configuration};
use crate::planning::plan::ViewId;
use crate::program::{Program, Step};

/// One thing that a controller does.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Action {
    /// A move to a view begins, or home.
    Toward(Option<ViewId>),
    /// Moves straight in joint space, from rest to rest.
    Go(Stretch),
    /// Stands still.
    Settle(f64),
    /// Captures.
    Scan {
        /// The view.
        view: ViewId,
        /// Projector brightness level.
        brightness: u8,
    },
}

/// A straight, synchronised move in joint space.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stretch {
    /// Number of the point it leads to, from 1; home, where the program begins, is 0.
    pub point: usize,
    /// Configuration where it begins.
    pub from_rad: Configuration,
    /// Configuration where it ends.
    pub to_rad: Configuration,
    /// Share of rated speeds and accelerations.
    pub speed_fraction: f64,
}

/// Speed and acceleration of the axis that moves furthest.
pub(super) struct Lead {
    pub rad_per_s: f64,
    pub rad_per_s2: f64,
}

impl Stretch {
    /// Returns true if the table turns.
    pub(super) fn moves_table(&self) -> bool {
        self.from_rad.turns_table(&self.to_rad)
    }

    /// Time from rest to rest.
    pub(super) fn secs(&self, axes: &Axes) -> f64 {
        axes.move_secs(&self.from_rad, &self.to_rad, self.speed_fraction)
    }

    /// Speed and acceleration for a controller that is given those of one axis: no axis then exceeds its share.
    pub(super) fn lead(&self, axes: &Axes) -> Lead {
        let travels = self.from_rad.travel_rad(&self.to_rad).map(f64::abs);
        let longest = travels.into_iter().fold(0.0, f64::max);
        let (mut rad_per_s, mut rad_per_s2) = (f64::INFINITY, f64::INFINITY);
        for (axis, travel) in axes.0.iter().zip(travels).filter(|(_, travel)| *travel > 0.0) {
            let scale = self.speed_fraction * longest / travel;
            rad_per_s = rad_per_s.min(axis.max_speed_rad_per_s * scale);
            rad_per_s2 = rad_per_s2.min(axis.max_acceleration_rad_per_s2 * scale);
        }
        Lead { rad_per_s, rad_per_s2 }
    }
}

/// Everything in order. Stretches on which nothing moves are left out.
pub(super) fn actions(program: &Program) -> Vec<Action> {
    let mut actions = Vec::new();
    let (mut here, mut point) = (program.home_rad, 0);
    for (index, step) in program.steps.iter().enumerate() {
        match step {
            Step::Move(step) => {
                actions.push(Action::Toward(next_view(&program.steps[index..])));
                for to in step.via_rad.iter().chain([&step.target_rad]) {
                    if *to != here {
                        point += 1;
                        let stretch = Stretch { point, from_rad: here, to_rad: *to, speed_fraction: step.speed_fraction };
                        actions.push(Action::Go(stretch));
                        here = *to;
                    }
                }
            }
            Step::Settle { secs } => actions.push(Action::Settle(*secs)),
            Step::Scan { view, brightness, .. } => actions.push(Action::Scan { view: *view, brightness: *brightness }),
        }
    }
    actions
}

/// The view that is scanned before the move after this one.
fn next_view(steps: &[Step]) -> Option<ViewId> {
    let until_next_move = steps.iter().skip(1).take_while(|step| !matches!(step, Step::Move(_)));
    until_next_move.into_iter().find_map(|step| if let Step::Scan { view, .. } = step { Some(*view) } else { None })
}

/// Every point that the program goes to, home first.
pub(super) fn points(program: &Program, actions: &[Action]) -> Vec<Configuration> {
    let gone = actions.iter().filter_map(|action| if let Action::Go(stretch) = action { Some(stretch.to_rad) } else { None });
    std::iter::once(program.home_rad).chain(gone).collect()
}

/// Comment on a move.
pub(super) fn toward(view: Option<ViewId>) -> String {
    view.map_or_else(|| "home".to_owned(), |view| format!("to viewpoint {}", view.0))
}

/// Comment on a scan.
pub(super) fn scanning(view: ViewId, brightness: u8) -> String {
    format!("scan viewpoint {}, brightness {brightness}", view.0)
}
