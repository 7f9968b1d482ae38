//! The real program on a real socket: how it begins and ends, what it survives, what it does not put up with.

mod commands;
mod hostile;
mod kill;
mod life;
mod oracle_browser;
mod oracle_schemathesis;
pub(crate) mod process;
