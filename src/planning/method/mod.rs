//! The method in formulas, a section a module. The modules hold no code: rustdoc checks links to items, and to modules, but
//! not to headings, so a section that code refers to is a module. The overview with all symbols is
//! [`crate::planning`].

#[doc = include_str!("frames.md")]
pub mod frames {}
#[doc = include_str!("scanner.md")]
pub mod scanner {}
#[doc = include_str!("sampling.md")]
pub mod sampling {}
#[doc = include_str!("candidates.md")]
pub mod candidates {}
#[doc = include_str!("visibility.md")]
pub mod visibility {}
#[doc = include_str!("quality.md")]
pub mod quality {}
#[doc = include_str!("coverage.md")]
pub mod coverage {}
#[doc = include_str!("causes.md")]
pub mod causes {}
#[doc = include_str!("selection.md")]
pub mod selection {}
#[doc = include_str!("stations.md")]
pub mod stations {}
#[doc = include_str!("sequence.md")]
pub mod sequence {}
#[doc = include_str!("setups.md")]
pub mod setups {}
#[doc = include_str!("robustness.md")]
pub mod robustness {}
#[doc = include_str!("realism.md")]
pub mod realism {}
