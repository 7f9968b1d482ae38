//! Instructions of the hot kernels, counted by valgrind's callgrind: the same on every run to about one in a million, so
//! that a change of a few per cent shows where times do not. valgrind knows no AVX-512, so AVX2 is the widest level.
//!
//! Each kernel runs in a process of its own, once and twice; the difference is one run without what prepares it.

use std::hint::black_box;
use std::process::Command;

use nalgebra::{Point3, Vector3};
use vantage::cell::Scanner;
use vantage::geometry::{Mesh, RayScene, SimdLevel};

use crate::meshes::lobed;
use crate::rig::{eyes, scanner, views};

/// Triangles of the part.
const TRIANGLES: usize = 70_000;

/// A kernel's name and what one run of it does.
pub(crate) type Kernel = (&'static str, fn(&Scene, SimdLevel));

/// What kernels run on.
pub(crate) struct Scene {
    scanner: Scanner,
    mesh: Mesh,
    rays: RayScene,
}
