//! Working depth: the practical slab square to the scanner's z and, where the specification gives them, the slabs in which the
//! devices are in focus, each square to its own optical axis. A point is in depth if it lies in all of them.
//!
//! A device's slab is given by its ends, or follows from f-number, circle of confusion and distance in focus (Wang,
//! *Quality-Based Path Planning*, section 3.1.1.2; [`super::DepthOfField`]) with the focal length f = √(fx fy) · pixel pitch.

use nalgebra::{Point3, Vector3};

use super::{DepthOfField, DeviceName, DeviceSpec, OpticalDevice, Scanner};
use crate::cell::closed_list::closed_list;
use crate::cell::field_error::Findings;
use crate::geometry::HalfSpace;

closed_list! {
    /// Limit of the working depth.
    pub enum DepthBoundSource {
        /// Practical working depth of the specification, `depth_mm`.
        Practical = "practical",
        /// Depth of field of the left camera.
        Left = "left",
        /// Depth of field of the right camera.
        Right = "right",
        /// Depth of field of the projector.
        Projector = "projector",
    }
}

/// Range of depths that one limit leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthBound {
    /// The limit.
    pub source: DepthBoundSource,
    /// Ends on the scanner's z axis, mm; the far one may be infinite.
    pub on_axis_mm: [f64; 2],
    /// Ends of the depths at which every point of the common field at best focus is within the limit, mm; the near end is beyond
    /// the far one if there is no such depth.
    pub over_field_mm: [f64; 2],
}

impl DeviceSpec {
    /// Records what is wrong with the fields of depth of field, below `pointer`.
    pub(super) fn check_focus(&self, pointer: &str, findings: &mut Findings) {
        Self::F_NUMBER.check(pointer, &self.f_number, findings);
        Self::CIRCLE_OF_CONFUSION_UM.check(pointer, &self.circle_of_confusion_um, findings);
        Self::FOCUS_MM.check(pointer, &self.focus_mm, findings);
        Self::IN_FOCUS_MM.check(pointer, &self.in_focus_mm, findings);
        if let Some([near, far]) = self.in_focus_mm {
            findings
                .require(near < far, format!("{pointer}/in_focus_mm"), || format!("near {near}, far {far}: must be near < far"));
        }
        let by_lens = self.f_number.is_some() || self.circle_of_confusion_um.is_some() || self.focus_mm.is_some();
        findings.require(!(by_lens && self.in_focus_mm.is_some()), format!("{pointer}/in_focus_mm"), || {
            "is given beside f_number, circle_of_confusion_um or focus_mm; give one of the two".into()
        });
        for (name, is_given) in [
            ("f_number", self.f_number.is_some()),
            ("circle_of_confusion_um", self.circle_of_confusion_um.is_some()),
            ("pixel_pitch_um", self.pixel_pitch_um.is_some()),
        ] {
            findings.require(!by_lens || is_given, format!("{pointer}/{name}"), || {
                "is missing; depth of field needs f_number, circle_of_confusion_um and pixel_pitch_um together".into()
            });
        }
    }

    /// Ends of the range in focus along the optical axis, of a device at whose depth `best_mm` best focus lies; both infinite if
    /// the specification gives none.
    pub(super) fn in_focus_mm(&self, best_mm: f64) -> [f64; 2] {
        if let Some(ends_mm) = self.in_focus_mm {
            return ends_mm;
        }
        let (Some(f_number), Some(circle_um), Some(pitch_um)) = (self.f_number, self.circle_of_confusion_um, self.pixel_pitch_um)
        else {
            return [f64::NEG_INFINITY, f64::INFINITY];
        };
        let focus_mm = self.focus_mm.unwrap_or(best_mm);
        let focal_mm = (self.fx * self.fy).sqrt() * pitch_um / 1000.0;
        let DepthOfField { front_mm, rear_mm } = DepthOfField::at(focus_mm, focal_mm, circle_um / 1000.0 * f_number);
        [focus_mm - front_mm, focus_mm + rear_mm]
    }
}

impl OpticalDevice {
    /// Returns true if the device's depth of field limits the working depth.
    #[must_use]
    pub fn has_focus_limit(&self) -> bool {
        let [near_mm, far_mm] = self.in_focus_mm;
        near_mm.is_finite() || far_mm.is_finite()
    }

    /// Half-spaces within which the device is in focus, scanner frame; none where it has no limit.
    pub(super) fn focus_slab(&self) -> Vec<HalfSpace> {
        let axis = self.scanner_from_device.direction(&Vector3::z());
        let along = axis.dot(&self.scanner_from_device.origin_mm().coords);
        let [near_mm, far_mm] = self.in_focus_mm;
        let near = near_mm.is_finite().then(|| HalfSpace { normal: -axis, offset_mm: -(near_mm + along) });
        let far = far_mm.is_finite().then_some(HalfSpace { normal: axis, offset_mm: far_mm + along });
        near.into_iter().chain(far).collect()
    }

    /// Ends of the depths z at which every point (x, y, z) with the given x and y is in focus.
    fn depths_in_focus(&self, across_mm: &[[f64; 2]]) -> [f64; 2] {
        let device_from_scanner = self.scanner_from_device.inverse();
        let rate = device_from_scanner.direction(&Vector3::z()).z;
        let [near_mm, far_mm] = self.in_focus_mm;
        across_mm.iter().fold([0.0, f64::INFINITY], |[low, high], [x, y]| {
            let at = device_from_scanner.point(&Point3::new(*x, *y, 0.0)).z;
            [f64::max(low, (near_mm - at) / rate), f64::min(high, (far_mm - at) / rate)]
        })
    }
}

impl Scanner {
    /// Working depth on the scanner's z axis, mm: the practical one and the depths of field of the devices together. Best focus
    /// lies in it.
    #[must_use]
    pub fn working_depth_mm(&self) -> [f64; 2] {
        let limited = self.devices.iter().filter(|device| device.has_focus_limit());
        let on_axis = limited.map(|device| device.depths_in_focus(&[[0.0, 0.0]]));
        on_axis.fold([self.near_mm, self.far_mm], |[near, far], [low, high]| [near.max(low), far.min(high)])
    }

    /// Returns true if a point is in the working depth: the practical one, and in focus for every device.
    #[must_use]
    pub fn is_in_depth(&self, in_scanner_mm: &Point3<f64>) -> bool {
        let is_in_focus = |device: &OpticalDevice| {
            let [near_mm, far_mm] = device.in_focus_mm;
            (near_mm..=far_mm).contains(&device.scanner_from_device.inverse().point(in_scanner_mm).z)
        };
        (self.near_mm..=self.far_mm).contains(&in_scanner_mm.z) && self.devices.iter().all(is_in_focus)
    }

    /// Limits of the working depth: the practical one, then those of devices that have one.
    #[must_use]
    pub fn depth_bounds(&self) -> Vec<DepthBound> {
        let practical = [self.near_mm, self.far_mm];
        let practical = DepthBound { source: DepthBoundSource::Practical, on_axis_mm: practical, over_field_mm: practical };
        let field = self.common_field_at(self.best_mm);
        let corners: Vec<[f64; 2]> = field.x_mm.into_iter().flat_map(|x| field.y_mm.map(|y| [x, y])).collect();
        let limited = self.devices.iter().filter(|device| device.has_focus_limit()).map(|device| DepthBound {
            source: match device.name {
                DeviceName::Left => DepthBoundSource::Left,
                DeviceName::Right => DepthBoundSource::Right,
                DeviceName::Projector => DepthBoundSource::Projector,
            },
            on_axis_mm: device.depths_in_focus(&[[0.0, 0.0]]),
            over_field_mm: device.depths_in_focus(&corners),
        });
        std::iter::once(practical).chain(limited).collect()
    }
}
