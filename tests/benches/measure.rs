//! Cost of a run, and fair comparison: contestants take turns within every round, so that what else the machine does hits all of
//! them alike; the median over the rounds counts.

use std::time::{Duration, Instant};

use rayon::{ThreadPool, ThreadPoolBuilder};
use rustix::time::{ClockId, clock_gettime};

/// Seconds that one run took.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Cost {
    /// Seconds by the clock.
    pub(crate) wall_s: f64,
    /// Seconds of all threads of the process that did the work.
    pub(crate) cpu_s: f64,
}

impl Cost {
    /// Cost of each of `parts` equal parts of the work.
    pub(crate) fn over(self, parts: usize) -> Self {
        Self { wall_s: self.wall_s / parts as f64, cpu_s: self.cpu_s / parts as f64 }
    }
}

impl std::ops::Add for Cost {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { wall_s: self.wall_s + other.wall_s, cpu_s: self.cpu_s + other.cpu_s }
    }
}

/// Runs `work`.
pub(crate) fn cost<T>(work: impl FnOnce() -> T) -> (T, Cost) {
    let (wall, cpu) = (Instant::now(), process_cpu());
    let result = work();
    let cost = Cost { wall_s: wall.elapsed().as_secs_f64(), cpu_s: (process_cpu() - cpu).as_secs_f64() };
    (result, cost)
}

fn process_cpu() -> Duration {
    let now = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}

/// Pools of one and of two threads.
pub(crate) struct Pools([ThreadPool; 2]);

impl Pools {
    /// Starts the threads.
    pub(crate) fn new() -> Self {
        Self([1, 2].map(|threads| ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")))
    }

    /// The pool of one or two threads.
    pub(crate) fn of(&self, threads: usize) -> &ThreadPool {
        &self.0[threads - 1]
    }
}

/// One run of one that takes part in a comparison; or why it cannot take part.
pub(crate) type Contestant<'a> = Result<Box<dyn FnMut() -> Cost + 'a>, String>;

/// Lets everyone run once unmeasured, then `rounds` times in turn. Medians of wall and of CPU time, each for itself.
pub(crate) fn race(rounds: usize, contestants: Vec<Contestant<'_>>) -> Vec<Result<Cost, String>> {
    let mut field: Vec<_> = contestants.into_iter().map(|contestant| (contestant, Vec::new())).collect();
    for round in 0..=rounds {
        for (contestant, costs) in &mut field {
            if let Ok(run) = contestant {
                let cost = run();
                costs.extend((round > 0).then_some(cost));
            }
        }
    }
    field.into_iter().map(|(contestant, costs)| contestant.map(|_| median(&costs))).collect()
}

fn median(costs: &[Cost]) -> Cost {
    Cost { wall_s: middle(costs.iter().map(|cost| cost.wall_s)), cpu_s: middle(costs.iter().map(|cost| cost.cpu_s)) }
}

/// The middle value; of an even number, the upper of the two.
fn middle(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<_> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
