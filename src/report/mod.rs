//! Pages, pictures, charts and text about a plan, made for people. Nothing here decides anything.

pub mod calibration;
pub mod html;
mod inspection_text;
mod no_plan_text;
pub mod scanner_calibration;
pub mod sketch;
pub mod study;
pub mod text;

pub use inspection_text::inspection_text;
pub use no_plan_text::no_plan_text;
