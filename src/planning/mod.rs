//! Floor 3, the pipeline: mesh → surface → candidates → stations → visibility → selection → sequence → missed.
//! A stage imports only earlier stages; [`pipeline`] sees all of them.

pub mod candidates;
pub mod context;
pub mod params;
pub mod plan;
pub mod report;
pub mod sequence;
pub mod stations;
pub mod surface;
pub mod visibility;
