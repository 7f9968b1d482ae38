//! Files that end before the view does: beyond one side of the box around a scan's points lie many samples that face all devices
//! well, and none has a point.

use crate::inspection::coverage::Return;

/// Incidence up to which a sample has no reason of its own not to return, radians (50°): thesis §3.2.1.3 has noise begin at 35°.
const FAIR_RAD: f64 = 50.0 * std::f64::consts::PI / 180.0;
/// Fewest fair samples beyond a side that make a cut, and their share of all fair ones.
const MIN_SAMPLES: usize = 20;
const MIN_SHARE: f64 = 0.01;
/// Cells by which a sample lies outside.
const SLACK_CELLS: f64 = 2.0;

/// Sides at which a file ends: columns from and to, rows from and to, in cells. Sides that are not cut lie at infinity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FileBounds([[f64; 2]; 2]);

impl FileBounds {
    /// Finds the cut sides of a scan from its planned samples, each with its place in cells.
    pub(super) fn find(returns: &[(Return, [f64; 2])]) -> Self {
        let mut bounds = [[f64::NEG_INFINITY, f64::INFINITY]; 2];
        let fair = |pair: &&(Return, [f64; 2])| pair.0.is_expected && pair.0.worst_incidence().1 <= FAIR_RAD;
        let fair: Vec<&(Return, [f64; 2])> = returns.iter().filter(fair).collect();
        let needed = MIN_SAMPLES.max((MIN_SHARE * fair.len() as f64) as usize);
        for (axis, bounds) in bounds.iter_mut().enumerate() {
            let of_returned = || returns.iter().filter(|(pair, _)| pair.is_returned).map(|(_, place)| place[axis]);
            let [first, last] = [of_returned().fold(f64::INFINITY, f64::min), of_returned().fold(f64::NEG_INFINITY, f64::max)];
            if first > last {
                continue;
            }
            let beyond = |is_beyond: &dyn Fn(f64) -> bool| fair.iter().filter(|(_, place)| is_beyond(place[axis])).count();
            if beyond(&|place| place < first - SLACK_CELLS) >= needed {
                bounds[0] = first;
            }
            if beyond(&|place| place > last + SLACK_CELLS) >= needed {
                bounds[1] = last;
            }
        }
        Self(bounds)
    }

    /// Returns true if a place, in cells, lies outside.
    pub(super) fn leaves_out(&self, place: [f64; 2]) -> bool {
        self.0.iter().zip(place).any(|([first, last], place)| place < *first || place > *last)
    }
}
