#![doc = include_str!("../METHOD.md")]

mod adjust;
mod advice;
pub mod candidates;
pub mod certificate;
pub mod context;
pub mod ids;
pub mod method;
pub mod missed;
mod outcome;
pub mod params;
mod pipeline;
pub mod plan;
mod problem;
pub mod random;
mod realism;
mod scene;
pub mod selection;
pub mod sequence;
mod setups;
mod sight;
pub mod stations;
pub mod studies;
pub mod surface;
pub mod verdict;
pub mod visibility;

pub use context::{Allowance, PlanError};
pub use pipeline::{Tabulated, plan, plan_further, tabulate};
pub use problem::estimate::Estimate;
pub use realism::ConcaveZone;
pub use scene::demand::{Demand, DemandStop, FurtherViews};
pub use scene::{PlanInput, UnknownAxis, UpAxis, plate, resolve, resting, standing, standing_likeliest, tips_over};
pub use visibility::SightLine;
