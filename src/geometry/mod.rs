//! Floor 1, pure maths: frames, meshes and their files, ray queries. No I/O, no clock, no global state.

mod frames;
mod mesh;
mod preview;

pub use frames::{Base, Device, Flange, Part, Plate, Pose, Scanner, Table, table_from_plate};
pub use mesh::{Aabb, FaceGroup, Mesh};
pub use preview::{FaceLists, NOT_DRAWN, Preview, glb, preview};
