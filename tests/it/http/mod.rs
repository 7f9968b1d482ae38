//! HTTP through the real router, with a planner that does what a job's label `do` says; what planning itself comes to
//! is tested elsewhere.

pub(crate) mod api;
mod auth;
mod bulk;
mod calibrations;
mod checks;
mod closed_lists;
mod contract;
mod cross_origin;
mod downloads;
mod drafts;
mod events;
mod examples;
mod hosts;
mod inspections;
mod jobs;
mod lists;
mod meshes;
mod prefix;
mod refusals;
mod results;
mod runs;
mod shares;
mod side_by_side;
mod specs;
mod suggestions;
