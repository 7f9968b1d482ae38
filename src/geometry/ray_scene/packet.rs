//! Sixteen rays from one point through a [`Tree`] at once, in f32 relative to that point.
//!
//! What depends on the point alone (corners and planes relative to it, normals of the planes through it and an edge) is
//! computed once for all rays; a ray then costs three products a box and four a triangle. The edge test is the volume
//! test with edge × sum of ends, so that two triangles see their common edge with exactly opposite signs and no ray slips
//! between them, and so that its error is 2⁻²¹ of the distance to the point at most, whatever the size of the triangle.
//! All rays of a packet point into one octant: near and far planes of a box are known without asking.

use nalgebra::{Point3, Vector3};

use super::tree::{BLOCK, Block, Child, Node, Target, Tree, WIDTH};
use crate::geometry::simd::Kernel;

/// Rays of a packet.
pub(super) const LANES: usize = 16;
const OCTANTS: usize = 8;
/// Half the spacing of f32 next to one.
const ROUNDING: f32 = f32::EPSILON / 2.0;
/// Boxes grow by this many roundings of the largest coordinate: twice what the tests of a box and of an edge lose.
const PADDING_ROUNDINGS: f32 = 32.0;
/// Directions are at least this long along every axis, so that they have a finite inverse; in 10⁵ mm it shifts a ray by
/// no more than the smallest of roundings.
const LEAST_COMPONENT: f32 = 1e-18;
/// Up to so many rays are bounded by themselves, not by their packet.
const FEW: u32 = 5;
/// End of a lane without a ray: lies before every box and triangle.
const RETIRED: f32 = -1.0;

#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Lanes([f32; LANES]);

impl Lanes {
    /// The result of `of_two` over all lanes, which may not depend on their order.
    #[inline(always)]
    fn over_all(&self, of_two: impl Fn(f32, f32) -> f32) -> f32 {
        let (mut eight, mut four) = ([0.0; 8], [0.0; 4]);
        for lane in 0..8 {
            eight[lane] = of_two(self.0[lane], self.0[lane + 8]);
        }
        for lane in 0..4 {
            four[lane] = of_two(eight[lane], eight[lane + 4]);
        }
        of_two(of_two(four[0], four[2]), of_two(four[1], four[3]))
    }
}

/// What is asked of the rays.
pub(super) trait Query {
    /// Whether a ray is done with its first hit, wherever that is.
    const ANY_HIT: bool;

    /// Ray `ray` meets `triangle` in leaf order at `share` of its direction; without [`Query::ANY_HIT`] the first it meets.
    fn hit(&mut self, ray: usize, triangle: u32, share: f32);
}

/// `origin + t·direction(ray)`, 0 < t < `end`, for each of `rays`, in the frame of the tree.
pub(super) struct Cast<'a, R, D, Q> {
    pub(super) tree: &'a Tree,
    pub(super) origin: Point3<f64>,
    pub(super) rays: &'a [R],
    pub(super) direction: D,
    pub(super) end: f32,
    pub(super) query: Q,
}

impl<R: Copy, D: Fn(&R) -> Vector3<f64>, Q: Query> Kernel for Cast<'_, R, D, Q> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        if self.tree.nodes.is_empty() {
            return;
        }
        let view = View::new(self.tree, &self.origin);
        let mut stack = Vec::with_capacity(128);
        let mut packets = Packets::new(self.rays, self.direction);
        while let Some(rays) = packets.next() {
            view.cast(&rays, self.end, &mut stack, &mut self.query);
        }
    }
}

/// Sorts rays into packets of one octant: at once where neighbours agree, else after waiting for others.
struct Packets<'a, R, D> {
    rays: &'a [R],
    direction: D,
    /// Rays read so far.
    read: usize,
    /// The last ones read, and how many of them are sorted.
    last: Rays,
    sorted: usize,
    waiting: [Rays; OCTANTS],
}

impl<'a, R: Copy, D: Fn(&R) -> Vector3<f64>> Packets<'a, R, D> {
    #[inline(always)]
    fn new(rays: &'a [R], direction: D) -> Self {
        Self { rays, direction, read: 0, last: Rays::EMPTY, sorted: 0, waiting: [const { Rays::EMPTY }; OCTANTS] }
    }

    #[inline(always)]
    fn next(&mut self) -> Option<Rays> {
        loop {
            while self.sorted < self.last.count {
                let lane = self.sorted;
                self.sorted += 1;
                // A direction that is not finite has no octant, and no hit.
                let Some(octant) = self.waiting.get_mut(self.last.octant[lane] as usize) else { continue };
                octant.push(&self.last, lane);
                if octant.count == LANES {
                    return Some(octant.take());
                }
            }
            if !self.read_on() {
                return self.waiting.iter_mut().find(|octant| octant.count > 0).map(Rays::take);
            }
            if self.last.share_octant() {
                self.sorted = LANES;
                return Some(self.last);
            }
        }
    }

    /// Reads the next rays; false at their end.
    #[inline(always)]
    fn read_on(&mut self) -> bool {
        let rest = &self.rays[self.read..];
        let Some(&first) = rest.first() else { return false };
        self.last = match rest.first_chunk::<LANES>() {
            Some(full) => Rays::gather(self.read, full, LANES, &self.direction),
            None => {
                let padded = std::array::from_fn(|lane| rest.get(lane).copied().unwrap_or(first));
                Rays::gather(self.read, &padded, rest.len(), &self.direction)
            }
        };
        self.read += self.last.count;
        self.sorted = 0;
        true
    }
}

/// Rays for one packet.
#[derive(Clone, Copy)]
struct Rays {
    count: usize,
    number: [u32; LANES],
    direction: [Lanes; 3],
    /// One bit an axis, set where the direction is negative; [`OCTANTS`] where it is not finite.
    octant: [u32; LANES],
}

impl Rays {
    const EMPTY: Self =
        Self { count: 0, number: [0; LANES], direction: [Lanes([0.0; LANES]); 3], octant: [0; LANES] };

    /// The first `count` of `rays`, numbered from `first`.
    #[inline(always)]
    fn gather<R>(first: usize, rays: &[R; LANES], count: usize, direction: &impl Fn(&R) -> Vector3<f64>) -> Self {
        let mut gathered = Self { count, ..Self::EMPTY };
        for lane in 0..LANES {
            let d = direction(&rays[lane]).map(|d| d as f32);
            gathered.number[lane] = (first + lane) as u32;
            for axis in 0..3 {
                gathered.direction[axis].0[lane] = d[axis];
            }
            let octant = u32::from(d.x < 0.0) | u32::from(d.y < 0.0) << 1 | u32::from(d.z < 0.0) << 2;
            let finite = d.x.abs() + d.y.abs() + d.z.abs() <= f32::MAX;
            gathered.octant[lane] = if finite { octant } else { OCTANTS as u32 };
        }
        gathered
    }

    /// Whether the packet is full and of one octant.
    #[inline(always)]
    fn share_octant(&self) -> bool {
        let first = self.octant[0];
        let differences = self.octant.iter().fold(first >> 3, |differences, &octant| differences | (octant ^ first));
        self.count == LANES && differences == 0
    }

    /// What waits here, which then is empty.
    #[inline(always)]
    fn take(&mut self) -> Self {
        let rays = *self;
        self.count = 0;
        rays
    }

    #[inline(always)]
    fn push(&mut self, from: &Self, lane: usize) {
        self.number[self.count] = from.number[lane];
        self.octant[self.count] = from.octant[lane];
        for axis in 0..3 {
            self.direction[axis].0[self.count] = from.direction[axis].0[lane];
        }
        self.count += 1;
    }
}

/// A child that waits for its visit, and where the packet may first meet it.
#[derive(Clone, Copy)]
struct Waiting {
    near: f32,
    target: Child,
    /// Rays that meet its box, as bits.
    lanes: u32,
}

/// The rays while they are traced.
struct Packet {
    direction: [Lanes; 3],
    inverse: [Lanes; 3],
    /// The least and the greatest of `inverse`.
    inverse_range: [[f32; 2]; 3],
    /// Where the ray ends: its first hit so far; [`RETIRED`] when it needs no more.
    end: Lanes,
    /// The greatest of `end`.
    furthest: f32,
    /// Rows of [`Node::planes`] that the rays meet first, and last.
    near_rows: [usize; 3],
    triangle: [u32; LANES],
}

impl Packet {
    #[inline(always)]
    fn new(rays: &Rays, end: f32) -> Self {
        let octant = rays.octant[0] as usize;
        let mut packet = Self {
            direction: rays.direction,
            inverse: rays.direction,
            inverse_range: [[0.0; 2]; 3],
            end: Lanes([end; LANES]),
            furthest: end,
            near_rows: std::array::from_fn(|axis| axis + 3 * (octant >> axis & 1)),
            triangle: [u32::MAX; LANES],
        };
        for lane in rays.count..LANES {
            packet.end.0[lane] = RETIRED;
            for axis in 0..3 {
                packet.direction[axis].0[lane] = rays.direction[axis].0[0];
            }
        }
        for axis in 0..3 {
            let sign = if octant >> axis & 1 == 0 { 1.0_f32 } else { -1.0 };
            for lane in 0..LANES {
                let length = packet.direction[axis].0[lane].abs();
                packet.inverse[axis].0[lane] = sign / if length > LEAST_COMPONENT { length } else { LEAST_COMPONENT };
            }
            packet.inverse_range[axis] = [packet.inverse[axis].over_all(least), packet.inverse[axis].over_all(greatest)];
        }
        packet
    }

    /// The least and the greatest inverse direction among `lanes`.
    #[inline(always)]
    fn range_of(&self, lanes: u32) -> [[f32; 2]; 3] {
        if lanes.count_ones() > FEW {
            return self.inverse_range;
        }
        let mut range = [[f32::INFINITY, f32::NEG_INFINITY]; 3];
        let mut rest = lanes;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % LANES;
            rest &= rest - 1;
            for axis in 0..3 {
                let inverse = self.inverse[axis].0[lane];
                range[axis] = [least(inverse, range[axis][0]), greatest(inverse, range[axis][1])];
            }
        }
        range
    }

    /// Rays that meet the box, as bits.
    #[inline(always)]
    fn meets_box(&self, near: [f32; 3], far: [f32; 3]) -> u32 {
        let mut lanes = 0;
        for lane in 0..LANES {
            let [x, y, z] = [self.inverse[0].0[lane], self.inverse[1].0[lane], self.inverse[2].0[lane]];
            let enter = greatest(greatest(near[0] * x, near[1] * y), greatest(near[2] * z, 0.0));
            let leave = least(least(far[0] * x, far[1] * y), least(far[2] * z, self.end.0[lane]));
            lanes |= u32::from(enter <= leave) << lane;
        }
        lanes
    }

    /// Takes the hits of one triangle.
    #[inline(always)]
    fn meet_triangle<const ANY_HIT: bool>(&mut self, seen: &Seen, slot: usize, number: u32) {
        let (edges, offset) = (seen.of(slot), seen.offset[slot]);
        let (mut any, mut end) = (0, self.end);
        for lane in 0..LANES {
            let direction = [self.direction[0].0[lane], self.direction[1].0[lane], self.direction[2].0[lane]];
            let [height, slope] = crossing(direction, &edges, offset);
            let hit = (height > 0.0) & (height < self.end.0[lane] * slope);
            any |= u32::from(hit);
            let share = if ANY_HIT { RETIRED } else { height / slope };
            end.0[lane] = if hit { share } else { self.end.0[lane] };
        }
        if any != 0 {
            for lane in 0..LANES {
                let hit = end.0[lane] != self.end.0[lane];
                self.triangle[lane] = if hit { number } else { self.triangle[lane] };
            }
            self.end = end;
            self.furthest = end.over_all(greatest);
        }
    }

    /// [`Packet::meet_triangle`] for one ray and all triangles of a block.
    #[inline(always)]
    fn meet_block<const ANY_HIT: bool>(&mut self, seen: &Seen, lane: usize, first: u32, count: u32) {
        let direction = [self.direction[0].0[lane], self.direction[1].0[lane], self.direction[2].0[lane]];
        let before = self.end.0[lane];
        let mut crossings = [[0.0; 2]; BLOCK];
        let mut any = 0;
        for slot in 0..BLOCK {
            let [height, slope] = crossing(direction, &seen.of(slot), seen.offset[slot]);
            any |= u32::from((height > 0.0) & (height < before * slope));
            crossings[slot] = [height, slope];
        }
        if any == 0 {
            return;
        }
        for (slot, [height, slope]) in crossings.into_iter().take(count as usize).enumerate() {
            if height > 0.0 && height < self.end.0[lane] * slope {
                self.end.0[lane] = if ANY_HIT { RETIRED } else { height / slope };
                self.triangle[lane] = first + slot as u32;
            }
        }
        self.furthest = self.end.over_all(greatest);
    }
}

/// The tree as seen from the origin.
struct View<'a> {
    tree: &'a Tree,
    /// The origin in two f32 parts, axis by axis.
    origin: [[f32; 2]; 3],
    /// The second part for lower planes and for upper ones, with the padding in it.
    padded: [[f32; 2]; 3],
}

/// The triangles of a block as seen from the origin.
struct Seen {
    /// Normals of the planes through the origin and an edge, three a triangle, then the triangle's own normal.
    normals: [[[f32; BLOCK]; 3]; 4],
    /// Of the triangle's plane from the origin, times the length of its normal.
    offset: [f32; BLOCK],
}

impl Seen {
    #[inline(always)]
    fn of(&self, slot: usize) -> [[f32; 3]; 4] {
        std::array::from_fn(|edge| std::array::from_fn(|axis| self.normals[edge][axis][slot]))
    }
}

impl<'a> View<'a> {
    #[inline(always)]
    fn new(tree: &'a Tree, origin: &Point3<f64>) -> Self {
        let origin: [[f32; 2]; 3] = std::array::from_fn(|axis| {
            let first = origin[axis] as f32;
            [first, (origin[axis] - f64::from(first)) as f32]
        });
        let reach = (0..3).fold(0.0, |reach, axis| greatest(reach, tree.reach + origin[axis][0].abs()));
        let padding = reach * PADDING_ROUNDINGS * ROUNDING;
        let padded = origin.map(|[_, second]| [second + padding, second - padding]);
        Self { tree, origin, padded }
    }

    #[inline(always)]
    fn cast<Q: Query>(&self, rays: &Rays, end: f32, stack: &mut Vec<Waiting>, query: &mut Q) {
        let mut packet = Packet::new(rays, end);
        stack.clear();
        self.visit_node(&self.tree.nodes[0], &packet, u32::MAX >> (32 - rays.count), stack);
        while let Some(waiting) = stack.pop() {
            let single = waiting.lanes.is_power_of_two();
            let furthest =
                if single { packet.end.0[waiting.lanes.trailing_zeros() as usize % LANES] } else { packet.furthest };
            if waiting.near > furthest {
                continue;
            }
            match waiting.target.target() {
                Target::Node(index) => self.visit_node(&self.tree.nodes[index], &packet, waiting.lanes, stack),
                Target::Block(index) => {
                    self.visit_block::<Q>(&self.tree.blocks[index], &mut packet, waiting.lanes);
                    if packet.furthest == RETIRED {
                        break;
                    }
                }
            }
        }
        for lane in 0..rays.count {
            if packet.triangle[lane] != u32::MAX {
                query.hit(rays.number[lane] as usize, packet.triangle[lane], packet.end.0[lane]);
            }
        }
    }

    /// Leaves the children that a ray meets on the stack, the nearest on top.
    #[inline(always)]
    fn visit_node(&self, node: &Node, packet: &Packet, lanes: u32, stack: &mut Vec<Waiting>) {
        let range = packet.range_of(lanes);
        let mut near = [[0.0; WIDTH]; 3];
        let mut far = [[0.0; WIDTH]; 3];
        let mut enter = [0.0_f32; WIDTH];
        let mut leave = [packet.furthest; WIDTH];
        for axis in 0..3 {
            let row = packet.near_rows[axis];
            let upper = row / 3;
            let (first, [near_second, far_second]) =
                (self.origin[axis][0], [self.padded[axis][upper], self.padded[axis][1 - upper]]);
            let (near_planes, far_planes) = (&node.planes[row], &node.planes[axis + 3 - 3 * upper]);
            let [low, high] = range[axis];
            for child in 0..WIDTH {
                let (n, f) = (near_planes[child] - first - near_second, far_planes[child] - first - far_second);
                near[axis][child] = n;
                far[axis][child] = f;
                enter[child] = greatest(least(n * low, n * high), enter[child]);
                leave[child] = least(greatest(f * low, f * high), leave[child]);
            }
        }
        let mut met = 0_u32;
        for child in 0..WIDTH {
            met |= u32::from(enter[child] <= leave[child]) << child;
        }
        let bottom = stack.len();
        let exact = lanes.is_power_of_two() || met.is_power_of_two();
        while met != 0 {
            let child = met.trailing_zeros() as usize % WIDTH;
            met &= met - 1;
            let planes = |rows: &[[f32; WIDTH]; 3]| [rows[0][child], rows[1][child], rows[2][child]];
            let lanes =
                if exact { lanes } else { packet.meets_box(planes(&near), planes(&far)) & lanes };
            if lanes != 0 {
                insert(stack, bottom, Waiting { near: enter[child], target: node.children[child], lanes });
            }
        }
    }

    #[inline(always)]
    fn visit_block<Q: Query>(&self, block: &Block, packet: &mut Packet, lanes: u32) {
        let seen = self.seen(block);
        if lanes.count_ones() <= FEW {
            let mut rest = lanes;
            while rest != 0 {
                let lane = rest.trailing_zeros() as usize % LANES;
                rest &= rest - 1;
                if Q::ANY_HIT {
                    packet.meet_block::<true>(&seen, lane, block.first, block.count);
                } else {
                    packet.meet_block::<false>(&seen, lane, block.first, block.count);
                }
            }
            return;
        }
        for slot in 0..block.count.min(BLOCK as u32) {
            if Q::ANY_HIT {
                packet.meet_triangle::<true>(&seen, slot as usize, block.first + slot);
            } else {
                packet.meet_triangle::<false>(&seen, slot as usize, block.first + slot);
            }
        }
    }

    #[inline(always)]
    fn seen(&self, block: &Block) -> Seen {
        let mut seen = Seen { normals: [[[0.0; BLOCK]; 3]; 4], offset: [0.0; BLOCK] };
        for slot in 0..BLOCK {
            let corner = |corner: usize| -> [f32; 3] {
                std::array::from_fn(|axis| block.corners[corner][axis][slot] - self.origin[axis][0] - self.origin[axis][1])
            };
            let [a, b, c] = [corner(0), corner(1), corner(2)];
            let [ab, bc, ca] = [minus(b, a), minus(c, b), minus(a, c)];
            let normals = [cross(bc, plus(c, b)), cross(ca, plus(a, c)), cross(ab, plus(b, a)), cross(ab, ca)];
            for (edge, normal) in normals.into_iter().enumerate() {
                for axis in 0..3 {
                    seen.normals[edge][axis][slot] = normal[axis];
                }
            }
            seen.offset[slot] = dot(a, normals[3]);
        }
        seen
    }
}

/// How high the origin stands over a triangle and how fast the ray comes down to it, so that it hits at their ratio;
/// the height is negative when the ray misses.
#[inline(always)]
fn crossing(direction: [f32; 3], [u, v, w, normal]: &[[f32; 3]; 4], offset: f32) -> [f32; 2] {
    let (u, v, w) = (dot(direction, *u), dot(direction, *v), dot(direction, *w));
    let inside = (least(least(u, v), w) >= 0.0) | (greatest(greatest(u, v), w) <= 0.0);
    let towards = dot(direction, *normal);
    let height = f32::from_bits(offset.to_bits() ^ (towards.to_bits() & 0x8000_0000));
    [if inside { height } else { -1.0 }, towards.abs()]
}

/// Keeps `stack[bottom..]` sorted, the nearest last.
#[inline(always)]
fn insert(stack: &mut Vec<Waiting>, bottom: usize, waiting: Waiting) {
    stack.push(waiting);
    let mut place = stack.len() - 1;
    while place > bottom && stack[place - 1].near < stack[place].near {
        stack.swap(place - 1, place);
        place -= 1;
    }
}

/// The machine's minimum: unlike `f32::min` it has no rule for NaN, of which there are none here.
#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greatest(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn plus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline(always)]
fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
