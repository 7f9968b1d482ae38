//! Paths along a cell's roadmap beside the part of one plan. An edge is used where the arm clears the part at every table angle,
//! so that the table can turn meanwhile. Edges are checked when a path would use them, each once (R. Bohlin and L. Kavraki, "Path
//! planning using lazy PRM", ICRA 2000).

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::{Arc, OnceLock};

use super::moves::{Moves, SegmentCache};
use super::roadmap::Roadmap;
use crate::cell::{CollisionScene, Configuration};
use crate::geometry::{parallel, sort_ascending};

/// Connections of a station to the roadmap that are checked at most.
const MAX_CHECKED: usize = 16;
/// Free connections of a station that are kept at most.
const MAX_CONNECTIONS: usize = 3;

/// A free path from a station to a vertex of the roadmap, the table as at the station.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct RoadmapWay {
    /// The point beside the station that the path goes by, if any.
    retreat: Option<Configuration>,
    vertex: usize,
    secs: f64,
}

/// A vertex that A* has yet to expand, ordered by the estimated time of a path through it. Times are not negative, and such
/// floats order as their bits do.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct OpenNode {
    estimate: u64,
    cost: u64,
    vertex: usize,
    /// The edge to it; none from a connection.
    edge: Option<usize>,
}

impl OpenNode {
    fn new(so_far_secs: f64, ahead_secs: f64, vertex: usize, edge: Option<usize>) -> Self {
        Self { estimate: (so_far_secs + ahead_secs).to_bits(), cost: so_far_secs.to_bits(), vertex, edge }
    }
}

/// A roadmap beside a part.
pub(super) struct Network {
    roadmap: Arc<Roadmap>,
    /// The cell with the part as it is at every table angle.
    scene: CollisionScene,
    is_open: Vec<bool>,
    is_free: Vec<OnceLock<bool>>,
}

impl Network {
    pub(super) fn new(roadmap: Arc<Roadmap>, scene: &CollisionScene) -> Self {
        let scene = scene.at_every_table_angle();
        let is_open = parallel::map(&roadmap.vertices, |vertex| scene.check(vertex).is_none());
        let is_free = roadmap.edges.iter().map(|_| OnceLock::new()).collect();
        Self { roadmap, scene, is_open, is_free }
    }

    /// Way of home, which is a vertex itself.
    pub(super) fn home() -> Vec<RoadmapWay> {
        vec![RoadmapWay { retreat: None, vertex: 0, secs: 0.0 }]
    }

    /// The quickest free connections of a station, straight or through one of its retreats.
    pub(super) fn connections(&self, station: &Configuration, retreats: &[Configuration], moves: &Moves<'_>) -> Vec<RoadmapWay> {
        let from = std::iter::once(None).chain(retreats.iter().copied().map(Some));
        let open = || (0..self.is_open.len()).filter(|vertex| self.is_open[*vertex]);
        let mut connections: Vec<_> = from
            .flat_map(|retreat| {
                open().map(move |vertex| {
                    let there = self.vertex(vertex, station.table_rad);
                    let secs = match retreat {
                        Some(point) => moves.straight_secs(station, &point) + moves.straight_secs(&point, &there),
                        None => moves.straight_secs(station, &there),
                    };
                    RoadmapWay { retreat, vertex, secs }
                })
            })
            .collect();
        sort_ascending(&mut connections, |connection| connection.secs);
        let mut segments = SegmentCache::new(moves);
        let mut is_free = |connection: &RoadmapWay| {
            segments.is_free(&connection.retreat.unwrap_or(*station), &self.vertex(connection.vertex, station.table_rad))
        };
        connections.into_iter().take(MAX_CHECKED).filter(|connection| is_free(connection)).take(MAX_CONNECTIONS).collect()
    }

    /// The points of a quick path from one station to another along the roadmap, without the two; the table turns on it from
    /// the one's angle to the other's.
    pub(super) fn path(
        &self,
        (from, first): (&Configuration, &[RoadmapWay]),
        (to, last): (&Configuration, &[RoadmapWay]),
        moves: &Moves<'_>,
    ) -> Option<Vec<Configuration>> {
        let (vertices, enter, leave) = self.shortest_path(first, last, moves)?;
        let angles = self.table_angles(&vertices, [from.table_rad, to.table_rad], moves);
        let on_edges = vertices.iter().zip(angles).map(|(vertex, angle)| self.vertex(*vertex, angle));
        let mut path: Vec<_> = enter.retreat.into_iter().chain(on_edges).collect();
        if vertices.len() == 1 {
            path.push(self.vertex(vertices[0], to.table_rad));
        }
        path.extend(leave.retreat);
        Some(path)
    }

    /// A* over the vertices; an edge is checked when the path to its end is the next best.
    fn shortest_path<'r>(
        &self,
        first: &'r [RoadmapWay],
        last: &'r [RoadmapWay],
        moves: &Moves<'_>,
    ) -> Option<(Vec<usize>, &'r RoadmapWay, &'r RoadmapWay)> {
        let secs_between = |a: usize, b: usize| moves.straight_secs(&self.roadmap.vertices[a], &self.roadmap.vertices[b]);
        let ahead = |vertex: usize| {
            last.iter().map(|connection| secs_between(vertex, connection.vertex) + connection.secs).fold(f64::INFINITY, f64::min)
        };
        let mut before: Vec<Option<Option<usize>>> = vec![None; self.roadmap.vertices.len()];
        let mut open = BinaryHeap::new();
        for connection in first {
            open.push(Reverse(OpenNode::new(connection.secs, ahead(connection.vertex), connection.vertex, None)));
        }
        while let Some(Reverse(OpenNode { cost, vertex, edge, .. })) = open.pop() {
            if before[vertex].is_some() || edge.is_some_and(|edge| !self.is_free(edge)) {
                continue;
            }
            before[vertex] = Some(edge);
            if let Some(leave) = last.iter().find(|connection| connection.vertex == vertex) {
                let vertices = self.path_to(vertex, &before);
                let enter = first.iter().find(|connection| connection.vertex == vertices[0])?;
                return Some((vertices, enter, leave));
            }
            for edge in &self.roadmap.edges_at[vertex] {
                let next = self.other_end(*edge, vertex);
                if self.is_open[next] && before[next].is_none() {
                    let secs = f64::from_bits(cost) + secs_between(vertex, next);
                    open.push(Reverse(OpenNode::new(secs, ahead(next), next, Some(*edge))));
                }
            }
        }
        None
    }

    /// The vertices from the first to `vertex`.
    fn path_to(&self, mut vertex: usize, before: &[Option<Option<usize>>]) -> Vec<usize> {
        let mut vertices = vec![vertex];
        while let Some(edge) = before[vertex].flatten() {
            vertex = self.other_end(edge, vertex);
            vertices.push(vertex);
        }
        vertices.reverse();
        vertices
    }

    fn other_end(&self, edge: usize, vertex: usize) -> usize {
        let [a, b] = self.roadmap.edges[edge];
        if a == vertex { b } else { a }
    }

    fn is_free(&self, edge: usize) -> bool {
        let [a, b] = self.roadmap.edges[edge].map(|vertex| &self.roadmap.vertices[vertex]);
        *self.is_free[edge].get_or_init(|| self.scene.check_segment(a, b).is_none())
    }

    fn vertex(&self, vertex: usize, table_rad: f64) -> Configuration {
        Configuration { table_rad, ..self.roadmap.vertices[vertex] }
    }

    /// The table's angle at each vertex: it turns as the arm advances.
    fn table_angles(&self, vertices: &[usize], [from, to]: [f64; 2], moves: &Moves<'_>) -> Vec<f64> {
        let edges =
            vertices.windows(2).map(|ends| moves.straight_secs(&self.roadmap.vertices[ends[0]], &self.roadmap.vertices[ends[1]]));
        let along: Vec<f64> = std::iter::once(0.0)
            .chain(edges.scan(0.0, |cost, secs| {
                *cost += secs;
                Some(*cost)
            }))
            .collect();
        let whole = along.last().copied().unwrap_or(0.0);
        let angle = |secs: &f64| {
            if whole <= 0.0 {
                from
            } else if *secs >= whole {
                // To the bit: the table stands still from there on.
                to
            } else {
                from + (to - from) * secs / whole
            }
        };
        along.iter().map(angle).collect()
    }
}
