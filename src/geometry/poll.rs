//! Asks the caller now and then whether to go on: often enough to be heard within a few milliseconds, seldom enough to
//! cost nothing. Geometry reads no clock, so work is counted instead.

use std::cell::Cell;

/// Work between two looks; a unit is about a nanosecond.
const UNITS_PER_LOOK: usize = 2_000_000;
/// Bytes that are searched at a time.
const WINDOW: usize = 64 * 1024;

/// The work was given up because the caller no longer wants it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("given up before its end")]
pub struct Interrupted;

/// Asked by long work whether to go on. Once told to stop it stays stopped.
pub struct Poll<'a> {
    stop: &'a dyn Fn() -> bool,
    left: Cell<usize>,
    stopped: Cell<bool>,
}

impl<'a> Poll<'a> {
    /// Work that is given up once `stop` says so; it is asked every few milliseconds.
    #[must_use]
    pub fn new(stop: &'a dyn Fn() -> bool) -> Self {
        Self { stop, left: Cell::new(0), stopped: Cell::new(false) }
    }

    /// Asks at once.
    ///
    /// # Errors
    /// [`Interrupted`].
    pub fn check(&self) -> Result<(), Interrupted> {
        self.left.set(UNITS_PER_LOOK);
        self.stopped.set(self.stopped.get() || (self.stop)());
        if self.stopped.get() { Err(Interrupted) } else { Ok(()) }
    }

    /// Counts work of so many units, about a nanosecond each, and asks once enough has come together.
    ///
    /// # Errors
    /// [`Interrupted`].
    #[inline]
    pub(super) fn spend(&self, units: usize) -> Result<(), Interrupted> {
        match self.left.get().checked_sub(units) {
            Some(left) => {
                self.left.set(left);
                Ok(())
            }
            None => self.check(),
        }
    }

    /// Place of the first byte that `wanted` accepts; `None` where there is none, and once told to stop.
    pub(super) fn position(&self, bytes: &[u8], wanted: impl Fn(&u8) -> bool) -> Option<usize> {
        for (index, window) in bytes.chunks(WINDOW).enumerate() {
            if let Some(at) = window.iter().position(&wanted) {
                return Some(index * WINDOW + at);
            }
            self.spend(window.len()).ok()?;
        }
        None
    }

    /// Returns true if one of `bytes` is `wanted`; false once told to stop.
    pub(super) fn holds(&self, bytes: &[u8], wanted: u8) -> bool {
        let goes_on = || !self.stopped.get() && self.spend(WINDOW / 8).is_ok();
        bytes.chunks(WINDOW).any(|window| goes_on() && window.contains(&wanted))
    }
}

impl Poll<'static> {
    /// Work that nobody gives up.
    #[must_use]
    pub fn never() -> Self {
        Self::new(&|| false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_asks_every_few_million_units_and_stays_stopped() {
        let (asked, stop) = (Cell::new(0), Cell::new(false));
        let ask = || {
            asked.set(asked.get() + 1);
            stop.get()
        };
        let poll = Poll::new(&ask);
        for _ in 0..1000 {
            poll.spend(UNITS_PER_LOOK / 100).expect("nobody says stop");
        }
        assert!((9..=11).contains(&asked.get()), "{}", asked.get());
        stop.set(true);
        assert_eq!(poll.check(), Err(Interrupted));
        stop.set(false);
        assert_eq!(poll.check(), Err(Interrupted));
    }

    #[test]
    fn it_finds_bytes_beyond_a_window_and_nothing_once_stopped() {
        let mut bytes = vec![b' '; 3 * WINDOW];
        bytes[2 * WINDOW + 7] = b'x';
        assert_eq!(Poll::never().position(&bytes, |b| *b == b'x'), Some(2 * WINDOW + 7));
        assert_eq!(Poll::never().position(&bytes, |b| *b == b'y'), None);
        assert_eq!(Poll::new(&|| true).position(&bytes, |b| *b == b'x'), None);
        assert!(Poll::never().holds(&bytes, b'x') && !Poll::never().holds(&bytes, b'y'));
        let stopped = Poll::new(&|| true);
        assert!(stopped.check().is_err() && !stopped.holds(&bytes, b'x'));
    }
}
