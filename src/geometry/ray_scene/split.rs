//! Many boxes into compact parts: halved where the surface area heuristic over bins of their middles finds it cheapest
//! (I. Wald, "On fast construction of SAH-based bounding volume hierarchies", IEEE Symposium on Interactive Ray Tracing 2007),
//! until a part is small. Cost: three passes a halving; halves go side by side.

use parry3d::bounding_volume::{Aabb, BoundingVolume};

/// Boxes of a part at most: about ten milliseconds of building.
pub(super) const PART: usize = 16_384;
/// Bins along the axis.
const BINS: usize = 32;
/// Boxes between two looks at whether to go on.
const BOXES_PER_LOOK: usize = 65_536;

/// Boxes of one bin.
#[derive(Clone, Copy)]
struct Bin {
    around: Aabb,
    count: usize,
}

const EMPTY: Bin = Bin { around: Aabb { mins: parry3d::math::Vector::MAX, maxs: parry3d::math::Vector::MIN }, count: 0 };

/// Numbers of boxes, those of a part together; one part, maybe empty, where they are few.
///
/// # Errors
/// The error of `check`.
pub(super) fn into_parts<E: Send>(
    numbers: Vec<u32>,
    boxes: &[Aabb],
    check: &(impl Fn() -> Result<(), E> + Sync),
) -> Result<Vec<Vec<u32>>, E> {
    if numbers.len() <= PART {
        return Ok(vec![numbers]);
    }
    let (first, second) = halved(numbers, boxes, check)?;
    let (first, second) = rayon::join(|| into_parts(first, boxes, check), || into_parts(second, boxes, check));
    let mut parts = first?;
    parts.extend(second?);
    Ok(parts)
}

fn halved<E: Send>(
    mut numbers: Vec<u32>,
    boxes: &[Aabb],
    check: &(impl Fn() -> Result<(), E> + Sync),
) -> Result<(Vec<u32>, Vec<u32>), E> {
    let middle = |number: u32| boxes[number as usize].center();
    let mut middles = EMPTY.around;
    for some in numbers.chunks(BOXES_PER_LOOK) {
        check()?;
        some.iter().for_each(|number| middles.take_point(middle(*number)));
    }
    let extent = middles.extents();
    let axis = (0..3).max_by(|a, b| extent[*a].total_cmp(&extent[*b])).unwrap_or(0);
    let scale = BINS as f32 / extent[axis];
    let bin_of = |number: u32| (((middle(number)[axis] - middles.mins[axis]) * scale) as usize).min(BINS - 1);
    let mut bins = [EMPTY; BINS];
    for some in numbers.chunks(BOXES_PER_LOOK) {
        check()?;
        for number in some {
            let bin = &mut bins[bin_of(*number)];
            *bin = Bin { around: bin.around.merged(&boxes[*number as usize]), count: bin.count + 1 };
        }
    }
    let Some(cut) = cheapest_cut(&bins) else {
        // All in one bin: any halves are as good.
        let second = numbers.split_off(numbers.len() / 2);
        return Ok((numbers, second));
    };
    let (mut first, mut second) = (Vec::new(), Vec::new());
    for some in numbers.chunks(BOXES_PER_LOOK) {
        check()?;
        some.iter().for_each(|number| if bin_of(*number) < cut { first.push(*number) } else { second.push(*number) });
    }
    Ok((first, second))
}

/// The number of bins before the cut at which surface times count of both sides is least; `None` where one bin holds all.
fn cheapest_cut(bins: &[Bin; BINS]) -> Option<usize> {
    let sides = |order: &mut dyn Iterator<Item = &Bin>| -> Vec<(f32, usize)> {
        let mut so_far = EMPTY;
        let grown = order.map(|bin| {
            so_far = Bin { around: so_far.around.merged(&bin.around), count: so_far.count + bin.count };
            (if so_far.count > 0 { so_far.around.half_area() * so_far.count as f32 } else { 0.0 }, so_far.count)
        });
        grown.collect()
    };
    let (before, after) = (sides(&mut bins.iter()), sides(&mut bins.iter().rev()));
    let cuts = (1..BINS).map(|cut| (before[cut - 1], after[BINS - 1 - cut], cut));
    let cuts = cuts.filter(|(first, second, _)| first.1 > 0 && second.1 > 0);
    cuts.min_by(|a, b| (a.0.0 + a.1.0).total_cmp(&(b.0.0 + b.1.0))).map(|(_, _, cut)| cut)
}
