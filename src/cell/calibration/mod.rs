//! Calibration of the hardware: from raw observations to poses and lenses with their uncertainty.

pub mod lens;
