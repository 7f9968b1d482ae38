//! Monotone regression: the rates nearest to the observed ones, by weight, that never rise or never fall along an axis (Barlow,
//! Bartholomew, Bremner and Brunk 1972, *Statistical Inference under Order Restrictions*; pool adjacent violators). Cost: O(bins).

/// Counts in one bin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct CountedRate {
    /// Sum of the places of the pairs along the axis.
    pub(super) place_sum: f64,
    /// Pairs.
    pub(super) pairs: f64,
    /// Pairs that returned.
    pub(super) returned: f64,
}

impl CountedRate {
    pub(super) fn add(&mut self, other: &Self) {
        self.place_sum += other.place_sum;
        self.pairs += other.pairs;
        self.returned += other.returned;
    }

    pub(super) fn remove(&mut self, other: &Self) {
        self.place_sum -= other.place_sum;
        self.pairs -= other.pairs;
        self.returned -= other.returned;
    }

    pub(super) fn rate(&self) -> f64 {
        self.returned / self.pairs
    }

    pub(super) fn place(&self) -> f64 {
        self.place_sum / self.pairs
    }
}

/// Points of the regression, ascending by place: the mean place of each bin with the rate of its pool; empty bins are left out.
pub(super) fn falling(bins: &[CountedRate]) -> Vec<[f64; 2]> {
    let bins: Vec<&CountedRate> = bins.iter().filter(|bin| bin.pairs > 0.0).collect();
    let mut pools: Vec<(CountedRate, usize)> = Vec::new();
    for bin in &bins {
        let (mut pool, mut members) = (**bin, 1);
        while let Some((last, earlier)) = pools.pop_if(|(last, _)| last.rate() <= pool.rate()) {
            pool.add(&last);
            members += earlier;
        }
        pools.push((pool, members));
    }
    let rates = pools.iter().flat_map(|(pool, members)| std::iter::repeat_n(pool.rate(), *members));
    bins.iter().zip(rates).map(|(bin, rate)| [bin.place(), rate]).collect()
}

/// [`falling()`], of rates that never fall.
pub(super) fn rising(bins: &[CountedRate]) -> Vec<[f64; 2]> {
    let mirrored: Vec<CountedRate> = bins.iter().rev().map(|bin| CountedRate { place_sum: -bin.place_sum, ..*bin }).collect();
    falling(&mirrored).into_iter().rev().map(|[place, rate]| [-place, rate]).collect()
}

/// Crossing of a rate by straight lines through the points of a regression.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Crossing {
    /// Place of the crossing.
    pub(super) place: f64,
    /// Places of the points on either side, ascending; infinite where no point lies on the other side of the rate.
    pub(super) bracket: [f64; 2],
}

/// Crossing at which straight lines through the points of a falling regression first pass below a rate; `None` where they do not.
pub(super) fn bracketed(points: &[[f64; 2]], rate: f64) -> Option<Crossing> {
    let after = points.iter().position(|[_, of]| *of < rate)?;
    let [to, below] = points[after];
    let Some([from, above]) = after.checked_sub(1).map(|before| points[before]) else {
        return Some(Crossing { place: to, bracket: [f64::NEG_INFINITY, to] });
    };
    Some(Crossing { place: from + (to - from) * (above - rate) / (above - below), bracket: [from, to] })
}

/// Place of the crossing of [`bracketed()`].
pub(super) fn crossing(points: &[[f64; 2]], rate: f64) -> Option<f64> {
    bracketed(points, rate).map(|found| found.place)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bin(place: f64, pairs: f64, returned: f64) -> CountedRate {
        CountedRate { place_sum: place * pairs, pairs, returned }
    }

    #[test]
    fn violators_are_pooled_and_a_rate_is_crossed_between_points() {
        let bins =
            [bin(10.0, 10.0, 10.0), bin(20.0, 10.0, 8.0), bin(30.0, 30.0, 27.0), bin(40.0, 0.0, 0.0), bin(50.0, 10.0, 0.0)];
        let points = falling(&bins);
        assert_eq!(points, [[10.0, 1.0], [20.0, 0.875], [30.0, 0.875], [50.0, 0.0]]);
        let at = crossing(&points, 0.75).expect("crossed");
        assert!((at - (30.0 + 20.0 / 7.0)).abs() < 1e-12, "{at}");
        assert_eq!(crossing(&points[..3], 0.75), None);
        assert_eq!(bracketed(&points, 0.75), Some(Crossing { place: at, bracket: [30.0, 50.0] }));
        assert_eq!(bracketed(&points[3..], 0.75), Some(Crossing { place: 50.0, bracket: [f64::NEG_INFINITY, 50.0] }));
        let up = rising(&[bin(1.0, 4.0, 1.0), bin(2.0, 4.0, 0.0), bin(3.0, 2.0, 2.0)]);
        assert_eq!(up, [[1.0, 0.125], [2.0, 0.125], [3.0, 1.0]]);
    }
}
