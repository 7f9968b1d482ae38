//! Controllers to rehearse against, on real sockets.
