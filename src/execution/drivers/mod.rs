//! Drivers, one file a protocol.

mod datagrams;
pub mod egm;
pub mod fanuc_rmi;
pub mod kuka_rsi;
pub(crate) mod set_points;
pub mod stream;
mod streamed;
pub mod ur;

pub use streamed::Streamed;

#[cfg(test)]
mod there_and_back;
