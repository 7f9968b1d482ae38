//! Set points at a fixed period from a thread of its own: deadlines are absolute, so that no delay adds up, and a deadline that
//! was missed by a whole period is left out rather than made up for. The jitter of the period is kept as a histogram.

use std::io;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy, thread_native_id,
};

/// Width of a bin of the histogram.
const BIN: Duration = Duration::from_micros(10);
/// Bins of the histogram: up to 20 ms; the last holds all beyond.
const BINS: usize = 2000;
/// Sleep ends this long before a deadline; the rest is waited out awake.
const AWAKE: Duration = Duration::from_micros(80);

/// Histogram of how much the time between two set points differs from the period.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Jitter {
    /// Period asked for.
    pub period: Duration,
    bins: Vec<u64>,
    /// Number of periods.
    pub periods: u64,
    /// Number of deadlines left out.
    pub missed: u64,
    /// Largest difference.
    pub max: Duration,
}

impl Jitter {
    /// An empty histogram.
    #[must_use]
    pub fn of(period: Duration) -> Self {
        Self { period, bins: vec![0; BINS], periods: 0, missed: 0, max: Duration::ZERO }
    }

    /// Difference that a share of the periods does not exceed, rounded up to 10 µs; the largest of all beyond 20 ms.
    #[must_use]
    pub fn quantile(&self, share: f64) -> Duration {
        let wanted = (share.clamp(0.0, 1.0) * self.periods as f64).ceil() as u64;
        let mut counted = 0;
        for (bin, count) in self.bins.iter().enumerate() {
            counted += count;
            if counted >= wanted {
                return if bin + 1 == BINS { self.max } else { self.max.min(BIN * (bin as u32 + 1)) };
            }
        }
        self.max
    }

    /// Adds the time between two set points.
    pub fn add(&mut self, between: Duration) {
        let off = between.abs_diff(self.period);
        let bin = (off.as_nanos() / BIN.as_nanos()).min(BINS as u128 - 1) as usize;
        self.bins[bin] += 1;
        self.periods += 1;
        self.max = self.max.max(off);
    }
}

/// A deadline that has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Beat {
    /// Number of the deadline, from 0; those left out are counted.
    pub number: u64,
    /// Time of the deadline since the first.
    pub due: Duration,
}

/// A thread that beats; dropped, it ends with the beat under way.
#[derive(Debug)]
pub struct Streamer {
    thread: Option<JoinHandle<()>>,
    is_over: Arc<AtomicBool>,
    jitter: Arc<Mutex<Jitter>>,
}

impl Streamer {
    /// Calls `beat` at once and then every `period` on a thread of its own until it breaks or the streamer is stopped. It sends one
    /// set point, and never waits for anything else.
    ///
    /// # Errors
    /// The error of the operating system, if it gives no thread.
    pub fn start<F>(name: &str, period: Duration, mut beat: F) -> io::Result<Self>
    where
        F: FnMut(Beat) -> ControlFlow<()> + Send + 'static,
    {
        let (is_over, jitter) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(Jitter::of(period))));
        let (over, seen) = (Arc::clone(&is_over), Arc::clone(&jitter));
        let work = move || {
            raise_priority();
            keep_time(period, &over, &seen, &mut beat);
            over.store(true, Ordering::SeqCst);
        };
        let thread = thread::Builder::new().name(name.to_owned()).spawn(work)?;
        Ok(Self { thread: Some(thread), is_over, jitter })
    }

    /// Cancels the beats to come, without a wait for the one that has begun.
    pub fn cancel(&self) {
        self.is_over.store(true, Ordering::SeqCst);
    }

    /// Ends it: no beat begins after this returns.
    pub fn stop(&mut self) {
        self.cancel();
        if let Some(thread) = self.thread.take() {
            // A beat that panicked has ended too.
            let _ = thread.join();
        }
    }

    /// Returns true if no further beat comes.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.is_over.load(Ordering::SeqCst) || self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Histogram so far.
    #[must_use]
    pub fn jitter(&self) -> Jitter {
        self.jitter.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for Streamer {
    fn drop(&mut self) {
        self.stop();
    }
}

fn keep_time(period: Duration, is_over: &AtomicBool, jitter: &Mutex<Jitter>, beat: &mut dyn FnMut(Beat) -> ControlFlow<()>) {
    let period_ns = (period.as_nanos() as u64).max(1);
    let due = |number: u64| Duration::from_nanos(period_ns.saturating_mul(number));
    let began = Instant::now();
    let (mut number, mut last): (u64, Option<Instant>) = (0, None);
    loop {
        wait_until(began + due(number));
        if is_over.load(Ordering::SeqCst) {
            return;
        }
        let now = Instant::now();
        let missed = ((now - began).as_nanos() as u64 / period_ns).saturating_sub(number);
        number += missed;
        {
            let mut jitter = jitter.lock().unwrap_or_else(PoisonError::into_inner);
            jitter.missed += missed;
            last.iter().for_each(|last| jitter.add(now - *last));
        }
        last = Some(now);
        if beat(Beat { number, due: due(number) }).is_break() {
            return;
        }
        number += 1;
    }
}

/// Raises this thread above those that plan, so that it beats on time: to the real-time class (`SCHED_FIFO`, sched(7)), in which it
/// waits for no other thread. Without the right to that (`CAP_SYS_NICE`, or `LimitRTPRIO` of systemd) by its nice value, and without
/// the right to that too (`LimitNICE`) it stays as it is, above planning threads all the same.
fn raise_priority() {
    const NICE: i32 = -15;
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    if set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Min, fifo).is_err() {
        // Refused without the right: as the line above says.
        let _ = rustix::process::setpriority_process(Some(rustix::thread::gettid()), NICE);
    }
}

fn wait_until(deadline: Instant) {
    let now = Instant::now();
    if deadline > now + AWAKE {
        thread::sleep(deadline - now - AWAKE);
    }
    while Instant::now() < deadline {
        std::hint::spin_loop();
    }
}

#[cfg(test)]
mod tests;
