//! The hardware: scanner optics, robot, turntable, kinematics, collision. Specifications (`*Spec`) are the
//! shapes users write, with degrees in `_deg` fields; what is built from them holds radians.

mod axis;
mod body;
mod body_meshes;
mod body_surface;
pub mod calibration;
mod closed_list;
mod closest;
pub mod collision;
mod controllers;
mod decode_message;
mod dialect;
mod distances;
mod field_error;
mod field_hiders;
mod field_ranges;
mod halton;
mod home;
pub mod kinematics;
mod layout;
mod library;
mod mounting;
mod pose_spec;
mod provenance;
mod robot;
pub mod runout;
mod scanner;
mod shape_spec;
pub mod time_parameterisation;
mod turntable;
pub mod urdf;

pub use axis::{Axes, Axis, AxisSpec, Configuration, rounded_deg};
pub use body::{Body, LinkBody, Shape};
pub use body_meshes::{MAX_BODIES, MAX_MESH_BODIES, MAX_TRIANGLES};
pub use closed_list::closed_list;
pub use closest::{closest, did_you_mean, with_suggestion};
pub use collision::{CollisionScene, Contact, Farthest, Separation};
pub use controllers::{
    AbbEgmSpec, ArmControllerSpec, CommandTriggerSpec, ControllersSpec, DigitalTriggerSpec, FanucRmiSpec, GatewayFraming,
    HansServoSpec, HansSpec, HttpTriggerSpec, JointThreeOrigin, KukaRsiSpec, MinasA6Spec, ModbusPlcSpec, NoTriggerSpec,
    SerialParity, TableControllerSpec, TriggerSpec, UrControllerSpec, UrMotion, WordOrder, WorkspaceSpec,
};
pub use decode_message::{decimal_comma_advice, expected_value, found_value};
pub use dialect::Dialect;
pub(crate) use dialect::dialect_table;
pub use distances::CellDistances;
pub use field_error::{FieldError, Findings};
pub use field_hiders::{FieldHider, HiddenShare, HiderPlace};
pub use field_ranges::{FieldRange, RangeGroup, Ranged, field_ranges};
pub use kinematics::{Kinematics, KinematicsSpec, OpwSpec, Posture, UrSpec};
pub use layout::{Cell, CellSpec};
pub use library::{Named, NotFound, Presets, SpecKind, SpecLibrary, preset_text};
pub use mounting::HousingFace;
pub use pose_spec::{EulerPoseSpec, PoseInput, PoseSpec, metres_in_mm};
pub use provenance::{CalibrationObjection, CalibrationProvenance, CompensationProvenance, PoseOrigin, UseConditions};
pub use robot::{LinkCapsule, LinkSpec, Robot, RobotSpec};
pub use runout::{RunoutHarmonic, RunoutSpec};
pub use scanner::{
    BoardPoseSpec, BoardPosesSpec, CalibratedScannerSpec, CloudFrame, CloudFrameSpec, DataSheet, DepthBound, DepthBoundSource,
    DepthOfField, DepthSpec, DeviceName, DeviceSpec, Exposure, ExposureFault, ExposureSpec, Field, Finish, LEVELS, Lens,
    LevelRange, Lighting, Material, MeasurementVolume, OpticalDevice, PerDevice, PlanarConstruction, REFERENCE_LEVEL, Scanner,
    ScannerResidualsSpec, ScannerSpec, best_levels, hyperfocal_distance_mm,
};
pub use shape_spec::{BodySpec, LinkBodySpec, ShapeSpec};
pub use turntable::{RotationSpec, Turntable, TurntableSpec};

#[cfg(test)]
mod tests;
