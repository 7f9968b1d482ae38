use std::num::NonZero;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::thread::{available_parallelism, sleep, spawn};
use std::time::{Duration, Instant};

use super::{Jitter, Streamer};

const PERIOD: Duration = Duration::from_millis(2);

#[test]
fn beats_come_at_absolute_deadlines_and_end_where_they_are_told() {
    let (sent, received) = channel();
    let begun = Instant::now();
    let mut streamer = Streamer::start("test", PERIOD, move |beat| {
        let _ = sent.send(beat);
        ControlFlow::Continue(())
    })
    .expect("starts");
    sleep(Duration::from_millis(200));
    streamer.stop();
    let lasted = begun.elapsed();
    assert!(streamer.is_over());
    let beats: Vec<_> = received.iter().collect();
    let jitter = streamer.jitter();
    assert_eq!(jitter.periods as usize + 1, beats.len());
    assert!(beats.windows(2).all(|pair| pair[0].number < pair[1].number));
    assert!(beats.iter().all(|beat| beat.due == PERIOD * beat.number as u32));
    // However busy the machine: what did not beat was left out, and nothing was made up for.
    assert_eq!(beats.last().expect("beats").number as usize + 1, beats.len() + jitter.missed as usize);
    let last = beats.last().expect("beats");
    assert!(last.due <= lasted && last.due + Duration::from_millis(100) >= Duration::from_millis(200), "{last:?} of {lasted:?}");
}

#[test]
fn a_beat_that_breaks_is_the_last_and_a_slow_one_leaves_deadlines_out() {
    let mut beats = 0;
    let streamer = Streamer::start("test", PERIOD, move |_| {
        beats += 1;
        sleep(if beats == 2 { PERIOD * 5 } else { Duration::ZERO });
        if beats == 5 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })
    .expect("starts");
    while !streamer.is_over() {
        sleep(PERIOD);
    }
    let jitter = streamer.jitter();
    assert_eq!(jitter.periods, 4);
    assert!(jitter.missed >= 4, "{}", jitter.missed);
    assert!(jitter.max >= PERIOD * 3);
}

#[test]
fn quantiles_are_those_of_what_was_added() {
    let mut jitter = Jitter::of(PERIOD);
    assert_eq!(jitter.quantile(0.999), Duration::ZERO);
    for number in 0..1000 {
        jitter.add(PERIOD + Duration::from_micros(if number < 990 { 15 } else { 500 }));
    }
    jitter.add(PERIOD * 100);
    assert_eq!(jitter.quantile(0.5), Duration::from_micros(20));
    assert_eq!(jitter.quantile(0.99), Duration::from_micros(510));
    assert_eq!(jitter.quantile(1.0), PERIOD * 99);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn jitter_while_all_cores_are_busy_is_measured() {
    let is_over = Arc::new(AtomicBool::new(false));
    let busy = (0..available_parallelism().map_or(1, NonZero::get)).map(|_| {
        let is_over = Arc::clone(&is_over);
        spawn(move || while !is_over.load(Ordering::Relaxed) {})
    });
    let busy: Vec<_> = busy.collect();
    for period in [Duration::from_millis(4), Duration::from_millis(20)] {
        let streamer = Streamer::start("test", period, |_| ControlFlow::Continue(())).expect("starts");
        sleep(Duration::from_millis(1500));
        let jitter = streamer.jitter();
        let [half, most, nearly_all] = [0.5, 0.99, 0.999].map(|share| jitter.quantile(share));
        println!(
            "{period:?}, all cores busy: p50 {half:?}, p99 {most:?}, p99.9 {nearly_all:?}, {} of {} left out",
            jitter.missed, jitter.periods
        );
        // Times are this machine's; that every period is counted is not.
        assert!(jitter.periods > 0 && half <= most && most <= nearly_all && nearly_all <= jitter.max);
    }
    is_over.store(true, Ordering::Relaxed);
    busy.into_iter().for_each(|thread| thread.join().expect("ends"));
}
