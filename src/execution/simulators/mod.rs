//! Controllers to rehearse against, on real sockets.

pub mod egm;
pub mod fanuc_rmi;
pub mod kuka_rsi;
pub mod ur;
