//! Drivers, one file a protocol.

mod datagrams;
pub mod egm;
pub mod fanuc_rmi;
pub mod kuka_rsi;
mod set_points;
pub mod stream;
mod streamed;
pub mod ur;

pub use streamed::Streamed;
