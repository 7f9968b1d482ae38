#![doc = include_str!("../METHOD.md")]

pub mod candidates;
mod cause;
pub mod context;
mod error;
pub mod estimate;
pub mod grade;
mod input;
pub mod method;
mod min_time;
mod missed;
pub mod obstructions;
pub mod params;
mod pipeline;
mod placement;
pub mod plan;
mod planning_scene;
mod random;
pub mod recheck;
pub mod report;
pub mod requirements;
mod robust;
mod rolls;
mod rounds;
pub mod selection;
pub mod sequence;
mod setups;
pub mod stations;
pub mod studies;
pub mod surface;
mod view_planning_problem;
pub mod visibility;

pub use error::PlanError;
pub use estimate::{Allowance, Estimate};
pub use input::PlanInput;
pub use pipeline::{Tabulated, plan, resting, tabulate};
