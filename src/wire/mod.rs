//! Floor 7, the JSON shapes: snake_case, units in the keys, versioned.

pub mod mesh_health;
