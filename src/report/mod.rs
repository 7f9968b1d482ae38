//! Pages, pictures, charts and text about a plan, made for people. Nothing here decides anything.

pub mod html;
pub mod sketch;
pub mod study;
pub mod text;
