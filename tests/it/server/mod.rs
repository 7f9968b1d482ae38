//! The real program on a real socket: how it begins and ends, what it survives, what it does not put up with.

mod commands;
mod database;
mod disk;
mod fairness;
mod faults;
mod heavy;
mod hostile;
mod hosts;
mod kill;
mod kills;
mod life;
pub(crate) mod process;
mod rows;
mod run_faults;
mod runs;
mod shortage;
mod summary;
