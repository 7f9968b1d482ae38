//! Floor 1, pure maths: frames, meshes and their files, ray queries. No I/O, no clock, no global state.

mod adjacency;
mod frames;
mod mesh;
mod ray_scene;

pub use adjacency::connected_components;
pub use frames::{Base, Device, Flange, Part, Plate, Pose, Scanner, Table, table_from_plate};
pub use mesh::{Aabb, FaceGroup, Mesh};
pub use ray_scene::RayScene;
