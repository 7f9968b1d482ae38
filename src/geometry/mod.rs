//! Pure maths: frames, meshes and their files, ray queries. No I/O, no clock, no global state.

mod adjacency;
pub mod cloud_io;
mod convex;
mod counted;
pub mod demo_parts;
mod face_lists;
mod frames;
mod id_table;
mod mesh;
mod mesh_health;
pub mod mesh_io;
mod nearest_face;
mod order;
pub(crate) mod parallel;
mod point_cloud;
mod poll;
mod preview;
mod random_hash;
mod ray_scene;
mod side_by_side;
mod simd;
mod sort;
mod sorted_lists;
mod stable_poses;
mod unit;

pub use adjacency::components_sharing;
pub use convex::{ConvexPolytope, HalfSpace, box_half_spaces, largest_centred_box};
pub use counted::{counted, listed};
pub use face_lists::FaceLists;
pub use frames::{
    Base, Board, Cloud, Device, Flange, Part, Plate, Pose, ScannerFrame, Table, plate_from_placed, table_from_plate,
};
pub use mesh::{Aabb, FaceGroup, Mesh};
pub use mesh_health::{MeshHealth, MeshWarning, assess, each_inner_edge, is_closed, outward_faces};
pub use nearest_face::{NearestFace, NearestPoint, nearest_of_triangle};
pub use order::{ascending, descending, sort_ascending, sort_descending};
pub use point_cloud::{CloudGrid, PointCloud};
pub use poll::{Interrupted, Poll};
pub use preview::{NOT_DRAWN, Preview, glb, preview};
pub(crate) use random_hash::RandomHash;
pub use ray_scene::{Hit, RayScene};
pub use simd::{Kernel, SimdLevel, floor_to_i32, simd_from_fn, simd_max, simd_min};
pub use stable_poses::{LazyStablePoses, StablePose, stable_poses};
pub use unit::{LengthUnit, UnknownUnit};
