//! Warnings about a mesh that a user should know of before planning on it, and what to do about each.

use std::fmt;

use super::MeshHealth;
use crate::geometry::counted;

/// Parts smaller or larger than this have most likely been given the wrong unit.
const USUAL_DIAGONAL_MM: std::ops::RangeInclusive<f64> = 1.0..=20_000.0;

/// One thing to know about a mesh. `Display` says what, [`remedy`](Self::remedy) what to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MeshWarning {
    /// The size is not that of a part to scan.
    Size {
        /// Diagonal of the bounding box.
        diagonal_mm: f64,
    },
    /// Holes.
    Open {
        /// Edges of one triangle.
        edges: usize,
    },
    /// Edges of more than two triangles.
    NonManifold {
        /// Number of such edges.
        edges: usize,
    },
    /// Neighbours wound against each other.
    Inconsistent {
        /// Edges between them.
        edges: usize,
    },
    /// Closed bodies that run into each other.
    Overlap {
        /// Number of pairs that were found.
        pairs: usize,
        /// True if a volume is stated, which counts what they have in common more than once.
        is_in_volume: bool,
    },
    /// Closed bodies within the material of others.
    Nested {
        /// Number that was found.
        bodies: usize,
        /// True if a volume is stated, which counts them and what is around them.
        is_in_volume: bool,
    },
    /// Polygons whose triangles lie upon each other.
    Uncut {
        /// Number of such polygons.
        polygons: usize,
    },
    /// Triangles dropped.
    Degenerate {
        /// Number of such triangles.
        triangles: usize,
    },
    /// Triangles there twice.
    Duplicate {
        /// Number beyond the first.
        triangles: usize,
    },
    /// Bodies turned.
    Flipped {
        /// Number of such bodies.
        bodies: usize,
    },
    /// Negative bodies left alone.
    Unresolved {
        /// Number of such bodies.
        bodies: usize,
    },
}

impl MeshHealth {
    /// Everything worth knowing, the gravest first.
    #[must_use]
    pub fn warnings(&self) -> Vec<MeshWarning> {
        use MeshWarning as W;
        let diagonal_mm = self.diagonal_mm();
        [
            (!USUAL_DIAGONAL_MM.contains(&diagonal_mm)).then_some(W::Size { diagonal_mm }),
            some(self.inconsistent_edges, |edges| W::Inconsistent { edges }),
            some(self.uncut_polygons, |polygons| W::Uncut { polygons }),
            some(self.unresolved_bodies, |bodies| W::Unresolved { bodies }),
            some(self.flipped_bodies, |bodies| W::Flipped { bodies }),
            some(self.boundary_edges, |edges| W::Open { edges }),
            some(self.non_manifold_edges, |edges| W::NonManifold { edges }),
            some(self.overlapping_pairs, |pairs| W::Overlap { pairs, is_in_volume: self.volume_counts_overlaps }),
            some(self.nested_bodies, |bodies| W::Nested { bodies, is_in_volume: self.volume_counts_overlaps }),
            some(self.duplicate_triangles, |triangles| W::Duplicate { triangles }),
            some(self.degenerate_triangles, |triangles| W::Degenerate { triangles }),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

fn some(count: usize, warning: impl FnOnce(usize) -> MeshWarning) -> Option<MeshWarning> {
    (count > 0).then(|| warning(count))
}

impl MeshWarning {
    /// Advice on what to do about it.
    #[must_use]
    pub fn remedy(self) -> &'static str {
        match self {
            Self::Size { .. } => "check the unit of the file (mm, cm, m or inch)",
            Self::Open { .. } => {
                "only the side that the triangles face is planned for; close the surface if it should be a solid"
            }
            Self::NonManifold { .. } => "look for walls without thickness and bodies that touch along an edge",
            Self::Inconsistent { .. } => {
                "triangles that face the wrong way cannot be seen by any view; unify the normals in the CAD system"
            }
            Self::Overlap { .. } => {
                "no view shows surface inside another body, but it counts as surface to scan; unite the bodies in the CAD system"
            }
            Self::Nested { .. } => {
                "no view shows surface inside another body, but it counts as surface to scan: remove inner parts, and turn the \
                 normals of cavities inwards"
            }
            Self::Uncut { .. } => "the surface is false there; export the mesh as triangles",
            Self::Degenerate { .. } => "nothing to do: without area there is nothing to scan",
            Self::Duplicate { .. } => "repeated area counts more than once; remove the copies for exact coverage figures",
            Self::Flipped { .. } => "nothing to do for solid bodies; export again with outward normals to be sure",
            Self::Unresolved { .. } => "bodies may be inside out; export fewer nested bodies",
        }
    }
}

impl fmt::Display for MeshWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size { diagonal_mm } => {
                write!(f, "the diagonal is {diagonal_mm:.3} mm; parts to scan have 1 mm to 20 m")
            }
            Self::Open { edges } => write!(f, "the surface is open along {}", counted(*edges, "edge")),
            Self::NonManifold { edges: 1 } => write!(f, "1 edge belongs to more than two triangles"),
            Self::NonManifold { edges } => write!(f, "{edges} edges belong to more than two triangles"),
            Self::Inconsistent { edges } => write!(f, "the winding of neighbours disagrees at {}", counted(*edges, "edge")),
            Self::Overlap { pairs, is_in_volume } => {
                match pairs {
                    1 => write!(f, "two closed bodies, and perhaps more, run into each other")?,
                    pairs => write!(f, "at least {pairs} pairs of closed bodies run into each other")?,
                }
                if *is_in_volume {
                    write!(f, "; the volume is a sum over bodies and counts what they have in common more than once")?;
                }
                Ok(())
            }
            Self::Nested { bodies, is_in_volume } => nested(f, *bodies, *is_in_volume),
            Self::Uncut { polygons: 1 } => {
                write!(f, "1 polygon crosses or folds over itself, or is too large to be cut into triangles")
            }
            Self::Uncut { polygons } => {
                write!(f, "{polygons} polygons cross or fold over themselves, or are too large to be cut into triangles")
            }
            Self::Degenerate { triangles: 1 } => write!(f, "1 degenerate triangle was dropped"),
            Self::Degenerate { triangles } => write!(f, "{triangles} degenerate triangles were dropped"),
            Self::Duplicate { triangles: 1 } => write!(f, "1 triangle repeats another"),
            Self::Duplicate { triangles } => write!(f, "{triangles} triangles repeat others"),
            Self::Flipped { bodies: 1 } => write!(f, "1 closed body was inside out and has been turned"),
            Self::Flipped { bodies } => write!(f, "{bodies} closed bodies were inside out and have been turned"),
            Self::Unresolved { bodies: 1 } => {
                write!(f, "1 closed body has negative volume, and the nesting is too deep to judge it")
            }
            Self::Unresolved { bodies } => {
                write!(f, "{bodies} closed bodies have negative volume, and the nesting is too deep to judge them")
            }
        }
    }
}

fn nested(f: &mut fmt::Formatter<'_>, bodies: usize, is_in_volume: bool) -> fmt::Result {
    let (told, these) = match bodies {
        1 => ("1 closed body lies wholly inside another".to_owned(), "it"),
        bodies => (format!("{bodies} closed bodies lie wholly inside others"), "these"),
    };
    write!(f, "at least {told}, with normals that point outwards")?;
    if is_in_volume {
        write!(f, "; the volume is a sum over bodies and counts {these} twice")?;
    }
    Ok(())
}
