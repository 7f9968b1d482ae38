//! Shorter cycles of the same plan: views exchanged for others that lie better on the way, and rolled about their axes.

mod exchange;
mod rolls;

pub(super) use exchange::exchange_views;
pub(super) use rolls::roll_views;
