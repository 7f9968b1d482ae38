//! HTTP through the real router, with a planner that does what a job's label `do` says; what planning itself comes to
//! is tested elsewhere.

pub(crate) mod api;
mod auth;
mod checks;
mod contract;
mod events;
mod hosts;
mod jobs;
mod meshes;
mod refusals;
mod results;
mod shares;
mod specs;
mod suggestions;
