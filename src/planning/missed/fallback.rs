//! The remedy of a spot where none works: the cheapest that measures at least half of it.

use crate::planning::plan::Remedy;

/// The cheapest remedy so far that measures at least half of a spot, but too little to work.
#[derive(Default)]
pub(super) struct Fallback(Option<Remedy>);

impl Fallback {
    /// Share of a spot that a remedy measures at least.
    pub(super) const MIN_SHARE: f64 = 0.5;

    /// Share of the spot that views have to measure to be of use: once there is a fallback, nothing but a remedy that works is.
    pub(super) fn wanted_share(&self) -> f64 {
        if self.0.is_some() { Remedy::WORKS_FROM } else { Self::MIN_SHARE }
    }

    /// Returns a remedy that works; keeps another one if it is the first.
    pub(super) fn unless_works(&mut self, remedy: Option<Remedy>) -> Option<Remedy> {
        let remedy = remedy?;
        if remedy.works() {
            return Some(remedy);
        }
        self.0.get_or_insert(remedy);
        None
    }

    /// The fallback; the finding that there is none, if so. `tried` views were tried in all.
    pub(super) fn into_remedy(self, tried: usize) -> Remedy {
        Remedy { tried, ..self.0.unwrap_or_else(|| Remedy::none(tried)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::plan::RemedyKind;

    fn measuring(kind: RemedyKind, of_spot: f64) -> Option<Remedy> {
        Some(Remedy { kind, of_spot, ..Remedy::none(7) })
    }

    #[test]
    fn a_costlier_remedy_that_works_comes_before_a_cheaper_one_that_measures_half() {
        let mut fallback = Fallback::default();
        assert_eq!(fallback.wanted_share(), 0.5);
        assert_eq!(fallback.unless_works(measuring(RemedyKind::Roll, 0.6)), None);
        assert_eq!(fallback.wanted_share(), 0.9);
        let tilt = measuring(RemedyKind::Tilt, 0.9);
        assert_eq!(fallback.unless_works(tilt.clone()), tilt);
    }

    #[test]
    fn where_nothing_works_the_cheapest_that_measures_half_is_left() {
        let mut fallback = Fallback::default();
        for (kind, of_spot) in [(RemedyKind::Roll, 0.6), (RemedyKind::Tilt, 0.89)] {
            assert_eq!(fallback.unless_works(measuring(kind, of_spot)), None);
        }
        assert_eq!(fallback.unless_works(None), None);
        let left = fallback.into_remedy(30);
        assert_eq!((left.kind, left.of_spot, left.tried, left.works()), (RemedyKind::Roll, 0.6, 30, false));
        assert_eq!(Fallback::default().into_remedy(30), Remedy::none(30));
    }
}
