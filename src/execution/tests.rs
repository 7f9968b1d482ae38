//! Rehearsals of whole runs: a planned part on twins and on the real drivers over a simulated network, the table of faults, and
//! runs with operations and networks of chance.

mod documented_faults;
pub(in crate::execution) mod fault_table;
mod network_simulation;
pub(crate) mod rehearsal;
mod rough_cell;
pub(in crate::execution) mod simulated_network;
