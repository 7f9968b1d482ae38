//! Share of a plan that is done: one definition for the server's jobs and for the bar of the command line.

mod course;
mod overall;
#[cfg(test)]
mod tests;

pub use course::Course;
pub use overall::{Overall, secs_left};
