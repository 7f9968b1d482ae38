//! Integration tests: one module a topic.

mod kinematics;
mod reach_study;
