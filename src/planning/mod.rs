#![doc = include_str!("../METHOD.md")]

mod adjust;
mod advice;
pub mod candidates;
pub mod certificate;
pub mod context;
mod estimate;
pub mod ids;
pub mod method;
mod missed;
mod outcome;
pub mod params;
mod pipeline;
pub mod plan;
mod problem;
mod random;
mod realism;
pub mod registration;
mod scene;
pub mod selection;
pub mod sequence;
mod setups;
mod sight;
mod sky;
pub mod stations;
pub mod studies;
pub mod surface;
mod tally;
pub mod verdict;
pub mod visibility;

pub use context::{Allowance, PlanError};
pub use estimate::Estimate;
pub use pipeline::{Tabulated, plan, tabulate};
pub use scene::{PlanInput, UpAxis, resting, standing};
