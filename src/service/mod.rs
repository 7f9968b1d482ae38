//! Floor 8, the product without HTTP.

pub mod plan_job;
