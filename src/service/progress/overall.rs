//! Share of a whole command that is done, from the stages that begin and their own progress. It never decreases, whatever is
//! repeated: further rounds of candidates, views that are chosen anew, several passes within a stage.

use super::Course;
use crate::planning::context::Stage;

/// Share of the rest of a stage that one pass over its units takes; more passes may follow.
const PASS: f64 = 0.9;
/// Share of the rest before the next expected stage that a repetition takes.
const REPETITION: f64 = 0.5;
/// Share of a stage without progress of its own that is assumed to be done at most.
const MAX_ASSUMED: f64 = 0.9;
/// Time that the first stage is assumed to take, s.
const FIRST_STAGE_SECS: f64 = 1.0;
/// Share and time after which the time left is told.
const MIN_FRACTION: f64 = 0.03;
const MIN_SECS: f64 = 1.0;

/// A stage of the course, from one share of the whole to another.
#[derive(Clone, Copy, Debug)]
struct Leg {
    stage: Stage,
    begin: f64,
    end: f64,
}

/// Share of the whole that is done.
#[derive(Clone, Debug)]
pub struct Overall {
    legs: Vec<Leg>,
    /// Number of legs that began.
    next: usize,
    /// Shares of the whole at which the running stage began and is expected to end.
    from: f64,
    to: f64,
    /// Time at which it began, s.
    began_secs: f64,
    pass: Pass,
    reached: f64,
}

/// Passes over the units of the running stage.
#[derive(Clone, Copy, Debug, Default)]
struct Pass {
    /// Share of the stage that passes before this one took.
    before: f64,
    /// Share of the stage that is done.
    done: f64,
    /// Units of this pass, and the most of them that were done.
    total: usize,
    most: usize,
}

impl Overall {
    /// Nothing of `course` is done yet.
    #[must_use]
    pub fn new(course: &Course) -> Self {
        let whole: f64 = course.legs.iter().map(|(_, cost)| cost).sum();
        let mut end = 0.0;
        let leg = |(stage, cost): &(Stage, f64)| {
            let begin = end;
            end += cost / whole;
            Leg { stage: *stage, begin, end }
        };
        let legs = course.legs.iter().map(leg).collect();
        Self { legs, next: 0, from: 0.0, to: 1.0, began_secs: 0.0, pass: Pass::default(), reached: 0.0 }
    }

    /// A stage begins `secs` after the start.
    pub fn begin(&mut self, stage: Stage, secs: f64) {
        let reached = self.fraction(secs);
        let ahead = self.legs.iter().skip(self.next).position(|leg| leg.stage == stage);
        (self.from, self.to) = match ahead {
            Some(ahead) => {
                let leg = self.legs[self.next + ahead];
                self.next += ahead + 1;
                (leg.begin.max(reached), leg.end.max(reached))
            }
            None => {
                let room = self.legs.get(self.next).map_or(1.0, |leg| leg.end);
                (reached, reached + REPETITION * (room - reached).max(0.0))
            }
        };
        (self.began_secs, self.pass) = (secs, Pass::default());
    }

    /// Counts units of the running stage. Calls may come out of order.
    pub fn progress(&mut self, done: usize, total: usize) {
        self.pass.count(done, total);
    }

    /// Share that is done `secs` after the start.
    pub fn fraction(&mut self, secs: f64) -> f64 {
        let of_stage = if self.pass.total > 0 { self.pass.done } else { self.assumed(secs) };
        self.reached = self.reached.max(self.from + of_stage * (self.to - self.from)).min(1.0);
        self.reached
    }

    /// Share of a stage without progress of its own, by the time that the stages before it lead to expect.
    fn assumed(&self, secs: f64) -> f64 {
        let pace = if self.from > 0.0 { self.began_secs * (self.to - self.from) / self.from } else { 0.0 };
        let expected_secs = if pace > 0.0 { pace } else { FIRST_STAGE_SECS };
        MAX_ASSUMED * (1.0 - (-(secs - self.began_secs).max(0.0) / expected_secs).exp())
    }
}

impl Pass {
    fn count(&mut self, done: usize, total: usize) {
        let is_over = self.most >= self.total;
        if total != self.total || (is_over && 2 * done <= total) {
            *self = Self { before: self.done, done: self.done, total, most: 0 };
        }
        self.most = self.most.max(done.min(total));
        let share = if total == 0 { 0.0 } else { self.most as f64 / total as f64 };
        self.done = self.done.max(self.before + PASS * share * (1.0 - self.before));
    }
}

/// Time left, s, if the rest goes on at the pace so far; `None` while that is too early to tell.
#[must_use]
pub fn secs_left(secs: f64, fraction: f64) -> Option<f64> {
    (secs >= MIN_SECS && fraction >= MIN_FRACTION).then(|| secs * (1.0 - fraction) / fraction)
}
