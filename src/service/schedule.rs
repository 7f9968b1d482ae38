//! Schedule of the jobs that run at the same time. A small job runs on a thread of its own, beside other small ones; a large job has all threads of
//! the pool. While a large job runs, or waits for its turn, one small job at a time goes past it: so nobody waits for the end of a job
//! of hours, and no stream of small jobs keeps a large one waiting. A job to which nothing else is queued has all threads, whatever
//! its size. The estimated memory of all that run together stays within the limit of a single job.
//!
//! None of this changes a plan: those are equal on any number of threads.

use std::collections::HashMap;

use super::size::JobSize;
use crate::wire::JobId;

/// Estimated seconds of one core up to which a job is small.
pub(super) const SMALL_CORE_SECS: f64 = 30.0;
/// Small jobs that run beside a large one.
const BESIDE_LARGE: usize = 1;

/// Threads that a job gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Share {
    /// Threads of its own, so many.
    Own(usize),
    /// All threads of the pool, which no other job has then.
    Pool,
}

/// A job that runs.
#[derive(Clone, Copy, Debug)]
struct Seat {
    share: Share,
    /// Size; `None` until somebody needs to know.
    size: Option<JobSize>,
}

/// Jobs that were looked at before another and have to wait.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ahead {
    is_large: bool,
    bytes: f64,
}

/// The jobs that run, and the rules by which others join them.
#[derive(Debug)]
pub(super) struct Schedule {
    threads: usize,
    /// Jobs that run at the same time at most.
    max_jobs: usize,
    max_bytes: f64,
    small_core_secs: f64,
    seats: HashMap<JobId, Seat>,
}

impl Schedule {
    /// Rules for so many threads and jobs at once (0 for as many as threads), and so much memory. A small job has to fit into
    /// `job_secs` on a single thread.
    pub(super) fn new(threads: usize, max_jobs: usize, max_bytes: f64, job_secs: f64) -> Self {
        let max_jobs = if max_jobs == 0 { threads } else { max_jobs };
        let small_core_secs = SMALL_CORE_SECS.min(job_secs / 2.0);
        Self { threads, max_jobs: max_jobs.max(1), max_bytes, small_core_secs, seats: HashMap::new() }
    }

    /// Returns true if several jobs may run at once, for which their sizes have to be known.
    pub(super) fn is_shared(&self) -> bool {
        self.max_jobs > 1
    }

    /// Returns true if no job may join, whatever its size.
    pub(super) fn is_full(&self) -> bool {
        let room = if self.has_large(&Ahead::default()) { BESIDE_LARGE } else { self.max_jobs };
        !self.seats.is_empty() && (!self.is_shared() || self.small_jobs() >= room)
    }

    /// Returns true if the job runs.
    pub(super) fn has(&self, id: JobId) -> bool {
        self.seats.contains_key(&id)
    }

    /// A job that runs and whose size is not known yet.
    pub(super) fn of_unknown_size(&self) -> Option<JobId> {
        let mut unknown: Vec<JobId> = self.seats.iter().filter(|(_, seat)| seat.size.is_none()).map(|(id, _)| *id).collect();
        unknown.sort_unstable();
        unknown.first().copied()
    }

    /// Threads for a job that may start at once, if it may. It is alone if no other job is queued; `ahead` are those before it that
    /// may not.
    pub(super) fn share_for(&self, size: Option<&JobSize>, is_alone: bool, ahead: &Ahead) -> Option<Share> {
        let is_small = size.is_some_and(|size| self.is_small(size));
        let own = Share::Own((self.threads / self.max_jobs).max(1));
        if self.seats.is_empty() {
            return Some(if is_small && !is_alone && self.is_shared() { own } else { Share::Pool });
        }
        let bytes = self.seats.values().map(|seat| seat.size.unwrap_or(JobSize::UNKNOWN).bytes).sum::<f64>();
        let fits = bytes + ahead.bytes + size.unwrap_or(&JobSize::UNKNOWN).bytes <= self.max_bytes;
        if self.is_full() || !fits {
            return None;
        }
        if is_small {
            let room = if self.has_large(ahead) { BESIDE_LARGE } else { self.max_jobs };
            return (self.small_jobs() < room).then_some(own);
        }
        let is_taken = self.seats.values().any(|seat| seat.share == Share::Pool);
        (!is_taken && self.seats.len() <= BESIDE_LARGE).then_some(Share::Pool)
    }

    /// Gives the job its threads.
    pub(super) fn seat(&mut self, id: JobId, share: Share, size: Option<JobSize>) {
        self.seats.insert(id, Seat { share, size });
    }

    /// Notes the size of a job that runs.
    pub(super) fn note_size(&mut self, id: JobId, size: JobSize) {
        if let Some(seat) = self.seats.get_mut(&id) {
            seat.size = Some(size);
        }
    }

    /// Takes the job's threads back.
    pub(super) fn leave(&mut self, id: JobId) {
        self.seats.remove(&id);
    }

    /// Notes a job that has to wait.
    pub(super) fn pass(&self, size: &JobSize, ahead: &mut Ahead) {
        // The first that waits is sure of its memory; it is enough that the largest of those behind is too.
        *ahead = Ahead { is_large: ahead.is_large || !self.is_small(size), bytes: ahead.bytes.max(size.bytes) };
    }

    fn is_small(&self, size: &JobSize) -> bool {
        size.core_secs <= self.small_core_secs
    }

    /// Returns true if a large job runs, or is ahead.
    fn has_large(&self, ahead: &Ahead) -> bool {
        ahead.is_large || self.seats.values().any(|seat| seat.size.is_none_or(|size| !self.is_small(&size)))
    }

    fn small_jobs(&self) -> usize {
        self.seats.values().filter(|seat| seat.size.is_some_and(|size| self.is_small(&size))).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GIB: f64 = 1_073_741_824.0;
    const SMALL: JobSize = JobSize { core_secs: 5.0, bytes: 0.1 * GIB };
    const LARGE: JobSize = JobSize { core_secs: 500.0, bytes: 2.0 * GIB };

    fn schedule(threads: usize) -> Schedule {
        Schedule::new(threads, 0, 4.0 * GIB, f64::INFINITY)
    }

    /// Starts what may start of the queue, in order; the rest of it.
    fn start(schedule: &mut Schedule, queue: &mut Vec<(JobId, JobSize)>) -> Vec<(JobSize, Share)> {
        let mut started = Vec::new();
        let mut again = true;
        while std::mem::take(&mut again) {
            let mut ahead = Ahead::default();
            for at in 0..queue.len() {
                let (id, size) = queue[at];
                match schedule.share_for(Some(&size), queue.len() == 1, &ahead) {
                    Some(share) => {
                        schedule.seat(id, share, Some(size));
                        queue.remove(at);
                        started.push((size, share));
                        again = true;
                        break;
                    }
                    None => schedule.pass(&size, &mut ahead),
                }
            }
        }
        started
    }

    fn queue(sizes: &[JobSize]) -> Vec<(JobId, JobSize)> {
        sizes.iter().map(|size| (JobId::generate(), *size)).collect()
    }

    #[test]
    fn small_jobs_run_side_by_side_on_a_thread_each() {
        let (mut schedule, mut waiting) = (schedule(4), queue(&[SMALL; 6]));
        assert_eq!(start(&mut schedule, &mut waiting), [(SMALL, Share::Own(1)); 4]);
        assert!(schedule.is_full());
        let first = *schedule.seats.keys().next().expect("a job");
        schedule.leave(first);
        assert_eq!(start(&mut schedule, &mut waiting), [(SMALL, Share::Own(1))]);
        assert_eq!(waiting.len(), 1);
    }

    #[test]
    fn a_job_without_others_has_all_threads_and_a_large_one_always() {
        for size in [SMALL, LARGE] {
            assert_eq!(start(&mut schedule(4), &mut queue(&[size])), [(size, Share::Pool)]);
        }
        let (mut schedule, mut waiting) = (schedule(4), queue(&[LARGE, LARGE]));
        assert_eq!(start(&mut schedule, &mut waiting), [(LARGE, Share::Pool)], "one at a time");
    }

    #[test]
    fn one_small_job_at_a_time_goes_past_a_large_one() {
        let (mut schedule, mut waiting) = (schedule(4), queue(&[LARGE, SMALL, SMALL, LARGE, SMALL]));
        assert_eq!(start(&mut schedule, &mut waiting), [(LARGE, Share::Pool), (SMALL, Share::Own(1))]);
        assert!(schedule.is_full());
    }

    /// Small jobs that arrive all the time never keep a large one waiting for more than those that run already.
    #[test]
    fn a_large_job_starts_once_those_that_run_have_ended() {
        let (mut schedule, mut waiting) = (schedule(4), queue(&[SMALL; 4]));
        start(&mut schedule, &mut waiting);
        let mut running: Vec<JobId> = schedule.seats.keys().copied().collect();
        waiting = queue(&[LARGE]);
        let large = waiting[0].0;
        for ended in 1..=3 {
            waiting.extend(queue(&[SMALL; 3]));
            schedule.leave(running.pop().expect("a small one"));
            let started = start(&mut schedule, &mut waiting);
            assert_eq!(schedule.has(large), ended == 3, "{started:?}");
        }
        assert_eq!(schedule.small_jobs(), 1);
    }

    #[test]
    fn the_memory_of_all_together_stays_within_the_limit() {
        let hungry = JobSize { bytes: 1.5 * GIB, ..SMALL };
        let (mut schedule, mut waiting) = (schedule(8), queue(&[hungry; 4]));
        assert_eq!(start(&mut schedule, &mut waiting).len(), 2);
        // What is left is kept for the one that waits: no smaller ones take it for ever.
        waiting.extend(queue(&[SMALL; 20]));
        assert_eq!(start(&mut schedule, &mut waiting), []);
        let first = *schedule.seats.keys().next().expect("a job");
        schedule.leave(first);
        let started = start(&mut schedule, &mut waiting);
        assert_eq!(started.first(), Some(&(hungry, Share::Own(1))));
        let held: f64 = schedule.seats.values().filter_map(|seat| seat.size).map(|size| size.bytes).sum();
        assert!(held <= 4.0 * GIB, "{held}");
        // One that is beyond the limit by itself starts alone, and is refused by its own plan.
        let giant = JobSize { bytes: 9.0 * GIB, ..LARGE };
        let (mut schedule, mut waiting) = (self::schedule(2), queue(&[giant, SMALL]));
        assert_eq!(start(&mut schedule, &mut waiting), [(giant, Share::Pool)]);
    }

    #[test]
    fn a_job_of_unknown_size_is_as_large_as_any_until_it_is_known() {
        let (mut schedule, id) = (schedule(2), JobId::generate());
        assert_eq!(schedule.share_for(None, true, &Ahead::default()), Some(Share::Pool));
        schedule.seat(id, Share::Pool, None);
        assert_eq!(schedule.of_unknown_size(), Some(id));
        assert_eq!(schedule.share_for(Some(&SMALL), true, &Ahead::default()), None, "its memory is not known");
        schedule.note_size(id, LARGE);
        assert_eq!(schedule.of_unknown_size(), None);
        assert_eq!(schedule.share_for(Some(&SMALL), true, &Ahead::default()), Some(Share::Own(1)));
        assert_eq!(schedule.share_for(Some(&LARGE), true, &Ahead::default()), None);
    }

    #[test]
    fn one_job_at_a_time_where_that_is_set_or_there_is_one_thread() {
        for mut schedule in [Schedule::new(4, 1, GIB, f64::INFINITY), schedule(1)] {
            let mut waiting = queue(&[SMALL; 3]);
            assert_eq!(start(&mut schedule, &mut waiting), [(SMALL, Share::Pool)]);
            assert!(!schedule.is_shared() && schedule.is_full());
        }
        let mut halves = Schedule::new(8, 2, 4.0 * GIB, f64::INFINITY);
        assert_eq!(start(&mut halves, &mut queue(&[SMALL; 3])), [(SMALL, Share::Own(4)); 2]);
    }

    #[test]
    fn a_job_that_a_single_thread_would_not_finish_in_time_is_no_small_one() {
        let schedule = Schedule::new(4, 0, 4.0 * GIB, 8.0);
        assert!(!schedule.is_small(&SMALL) && schedule.is_small(&JobSize { core_secs: 4.0, ..SMALL }));
    }
}
