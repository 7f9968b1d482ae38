//! Packets through the [`Tree`]. Planes are taken relative to the origin once a node; the packet is first held against
//! all children at once, by the least and the greatest of its directions, then ray by ray against those that are left.

use nalgebra::{Point3, Vector3};

use super::gather::{Packets, Rays};
use super::lanes::{LANES, simd_max, simd_min};
use super::origin::Origin;
use super::packet::{NONE, Packet, RETIRED};
use super::tree::{Child, ChildTarget, Node, Tree, WIDTH};
use crate::geometry::simd::Kernel;

/// A query of the rays.
pub(super) trait Query {
    /// Is true if a ray is done with its first hit, wherever that is.
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
        let view = View { tree: self.tree, origin: Origin::new(&self.origin, self.tree.reach) };
        let mut stack = Vec::with_capacity(128);
        let mut packets = Packets::new(self.rays, self.direction);
        while let Some(rays) = packets.next() {
            view.cast(&rays, self.end, &mut stack, &mut self.query);
        }
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

/// The tree as seen from the origin.
struct View<'a> {
    tree: &'a Tree,
    origin: Origin,
}

impl View<'_> {
    #[inline(always)]
    fn cast<Q: Query>(&self, rays: &Rays, end: f32, stack: &mut Vec<Waiting>, query: &mut Q) {
        let mut packet = Packet::new(rays, end);
        stack.clear();
        self.visit_node(&self.tree.nodes[0], &packet, u32::MAX >> (32 - rays.count), stack);
        while let Some(waiting) = stack.pop() {
            let single = waiting.lanes.is_power_of_two();
            let furthest = if single { packet.end.0[waiting.lanes.trailing_zeros() as usize % LANES] } else { packet.furthest };
            if waiting.near > furthest {
                continue;
            }
            match waiting.target.target() {
                ChildTarget::Node(index) => self.visit_node(&self.tree.nodes[index], &packet, waiting.lanes, stack),
                ChildTarget::Block(index) => {
                    let block = &self.tree.blocks[index];
                    if Q::ANY_HIT {
                        packet.meet::<true>(block, &self.origin.parts, waiting.lanes);
                    } else {
                        packet.meet::<false>(block, &self.origin.parts, waiting.lanes);
                    }
                    if packet.furthest == RETIRED {
                        break;
                    }
                }
            }
        }
        for lane in 0..rays.count {
            if packet.triangle[lane] != NONE {
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
            let [lower, upper] =
                [(&node.planes[axis], self.origin.padded[axis][0]), (&node.planes[axis + 3], self.origin.padded[axis][1])];
            let ((near_planes, near_origin), (far_planes, far_origin)) =
                if packet.descend[axis] { (upper, lower) } else { (lower, upper) };
            let (first, [low, high]) = (self.origin.parts[axis][0], range[axis]);
            for child in 0..WIDTH {
                let (n, f) = (near_planes[child] - first - near_origin, far_planes[child] - first - far_origin);
                near[axis][child] = n;
                far[axis][child] = f;
                enter[child] = simd_max(simd_min(n * low, n * high), enter[child]);
                leave[child] = simd_min(simd_max(f * low, f * high), leave[child]);
            }
        }
        let mut met = 0_u32;
        for child in 0..WIDTH {
            met |= u32::from(enter[child] <= leave[child]) << child;
        }
        let bottom = stack.len();
        // A ray alone has had its test; one child alone is as soon visited as held against every ray.
        let settled = lanes.is_power_of_two() || met.is_power_of_two();
        while met != 0 {
            let child = met.trailing_zeros() as usize % WIDTH;
            met &= met - 1;
            let planes = |rows: &[[f32; WIDTH]; 3]| [rows[0][child], rows[1][child], rows[2][child]];
            let lanes = if settled { lanes } else { packet.meets_box(planes(&near), planes(&far)) & lanes };
            if lanes != 0 {
                self.tree.prefetch(node.children[child]);
                insert(stack, bottom, Waiting { near: enter[child], target: node.children[child], lanes });
            }
        }
    }
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
