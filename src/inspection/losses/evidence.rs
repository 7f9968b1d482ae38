//! Weaknesses that scans show: whether pairs of view and sample return less often in a zone than elsewhere.

/// Rate in a zone, relative to that elsewhere, up to which the zone is a weakness: the rate at which limits are identified too.
const WEAK: f64 = 0.75;
/// Fewest pairs in the zone; of fewer nothing is known, and the zone is taken for a weakness.
const MIN_PAIRS: usize = 30;

/// Pairs in a zone and elsewhere, of which a point is expected.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Zone {
    /// `[elsewhere, within]`: pairs, and those of them that returned.
    counts: [[usize; 2]; 2],
}

impl Zone {
    /// Counts a pair.
    pub(super) fn count(&mut self, is_within: bool, is_returned: bool) {
        let counts = &mut self.counts[usize::from(is_within)];
        counts[0] += 1;
        counts[1] += usize::from(is_returned);
    }

    /// Returns true if points are lost in the zone for its own sake.
    pub(super) fn is_weak(&self) -> bool {
        let [elsewhere, within] = self.counts;
        let rate = |[pairs, returned]: [usize; 2]| returned as f64 / pairs.max(1) as f64;
        within[0] < MIN_PAIRS || rate(within) <= WEAK * rate(elsewhere)
    }
}
