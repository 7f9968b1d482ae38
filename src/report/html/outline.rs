//! Outline of a part that is projected to a plane: the convex hull of its points, by Andrew's monotone chain ("Another efficient
//! algorithm for convex hulls in two dimensions", Information Processing Letters 9(5), 1979). Cost: O(points).

/// Rows into which points are sorted first; of each, the two at its ends are kept. The hull of what is kept lies less than the
/// height of a row within that of all points.
const ROWS: usize = 512;

/// The hull, counter-clockwise; empty for no points.
pub(super) fn hull(points: impl Iterator<Item = [f64; 2]> + Clone) -> Vec<[f64; 2]> {
    let mut kept = ends_of_rows(points);
    kept.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    kept.dedup();
    if kept.len() < 3 {
        return kept;
    }
    let mut lower = chain(kept.iter());
    let mut upper = chain(kept.iter().rev());
    // The end of each is the beginning of the other.
    lower.pop();
    upper.pop();
    lower.append(&mut upper);
    lower
}

fn chain<'p>(points: impl Iterator<Item = &'p [f64; 2]>) -> Vec<[f64; 2]> {
    let mut chain: Vec<[f64; 2]> = Vec::new();
    for p in points {
        while let [.., a, b] = chain.as_slice()
            && (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) <= 0.0
        {
            chain.pop();
        }
        chain.push(*p);
    }
    chain
}

/// Points at the ends of each row, and the lowest and highest of all.
fn ends_of_rows(points: impl Iterator<Item = [f64; 2]> + Clone) -> Vec<[f64; 2]> {
    let low = points.clone().min_by(|a, b| a[1].total_cmp(&b[1]));
    let high = points.clone().max_by(|a, b| a[1].total_cmp(&b[1]));
    let (Some(low), Some(high)) = (low, high) else { return Vec::new() };
    let height = (high[1] - low[1]).max(f64::MIN_POSITIVE);
    let mut rows: Vec<Option<[[f64; 2]; 2]>> = vec![None; ROWS];
    for p in points {
        let row = (((p[1] - low[1]) / height * ROWS as f64) as usize).min(ROWS - 1);
        let [left, right] = rows[row].get_or_insert([p, p]);
        if p[0] < left[0] {
            *left = p;
        }
        if p[0] > right[0] {
            *right = p;
        }
    }
    rows.into_iter().flatten().flatten().chain([low, high]).collect()
}

#[cfg(test)]
mod tests {
    use super::hull;

    #[test]
    fn a_hull_has_the_corners_alone_counter_clockwise() {
        let grid: Vec<[f64; 2]> = (0..=10).flat_map(|x| (0..=10).map(move |y| [f64::from(x), f64::from(y)])).collect();
        assert_eq!(hull(grid.iter().copied()), [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]);
        assert_eq!(hull(std::iter::empty()), [] as [[f64; 2]; 0]);
        assert_eq!(hull([[1.0, 2.0]; 4].into_iter()), [[1.0, 2.0]]);
    }

    #[test]
    fn a_hull_of_many_points_holds_the_circle_that_they_lie_on() {
        let circle: Vec<[f64; 2]> =
            (0..100_000).map(|i| f64::from(i) * 1e-4).map(|angle| [50.0 * angle.cos(), 50.0 * angle.sin()]).collect();
        let hull = hull(circle.iter().copied());
        let area: f64 =
            (0..hull.len()).map(|i| (hull[i], hull[(i + 1) % hull.len()])).map(|(a, b)| 0.5 * (a[0] * b[1] - a[1] * b[0])).sum();
        let whole = std::f64::consts::PI * 2500.0;
        assert!((0.999..=1.0).contains(&(area / whole)), "{area} of {whole}");
    }
}
