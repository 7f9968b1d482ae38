//! Execution of a checked program on real controllers, or on a kinematic twin of them. It streams and decides nothing: targets,
//! order and speeds are the program's. Not safety-rated in any way: no stop that passes through here is an emergency stop.

pub mod audit;
pub mod device;
pub mod drivers;
pub mod located;
pub mod profile;
pub mod protocol;
pub mod record;
pub mod session;
pub mod simulators;
pub mod twin;

#[cfg(test)]
mod tests;
