//! Protocols of controllers as pure functions from bytes to values and back: no input makes them panic or grow without bound.

pub mod egm;
pub mod fanuc_rmi;
pub mod kuka_rsi;
pub mod ur;

#[cfg(test)]
mod mangled;
