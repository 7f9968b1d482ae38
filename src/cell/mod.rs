//! Floor 2, the hardware: scanner optics, robot, turntable, kinematics, collision. Specifications (`*Spec`) are the
//! shapes users write, with degrees in `_deg` fields; what is built from them holds radians.

mod field_error;
mod pose_spec;
mod scanner;
mod shape_spec;

pub use field_error::{FieldError, Findings};
pub use pose_spec::PoseSpec;
pub use scanner::{
    BoardPoseSpec, BoardPosesSpec, DepthOfField, DepthSpec, DeviceName, DeviceSpec, Field, Lens, MeasurementVolume,
    OpticalDevice, Scanner, ScannerSpec, hyperfocal_distance_mm,
};
pub use shape_spec::{BodySpec, ShapeSpec};
