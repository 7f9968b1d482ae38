//! Scanner specifications of Vantage: lenses and poses as they stand in them.

use super::super::fault::{LensError, LensFault};
use super::super::model::LensParameters;
use super::{ImportedFile, ImportedLens};
use crate::cell::{DeviceName, ScannerSpec};

pub(super) fn read(text: &str) -> Result<ImportedFile, LensError> {
    let unreadable = |detail: String| LensError::new(LensFault::Unreadable, "", detail);
    let spec: ScannerSpec = toml::from_str(text).map_err(|error| unreadable(error.to_string().replace('\n', " ")))?;
    let scanner = spec.build().map_err(|errors| match errors.into_iter().next() {
        Some(error) if error.pointer.ends_with("/distortion") => LensError::new(LensFault::Folds, error.pointer, error.detail),
        Some(error) => LensError::new(LensFault::OutOfRange, error.pointer, error.detail),
        None => unreadable("cannot be built".to_owned()),
    })?;
    let from_scanner = scanner.devices.as_ref().map(|device| *device.scanner_from_device.inverse().isometry());
    let left_inverse = from_scanner.left.inverse();
    let devices = [(DeviceName::Left, spec.left), (DeviceName::Right, spec.right), (DeviceName::Projector, spec.projector)];
    let lenses = devices.map(|(name, device)| ImportedLens {
        device: Some(name),
        ..ImportedLens::new(LensParameters {
            size_px: [device.width_px, device.height_px],
            fx: device.fx,
            fy: device.fy,
            cx: device.cx,
            cy: device.cy,
            skew: device.skew,
            distortion: device.distortion,
        })
    });
    Ok(ImportedFile {
        lenses: lenses.into(),
        right_from_left: Some(from_scanner.right * left_inverse),
        projector_from_left: Some(from_scanner.projector * left_inverse),
        specification: Some(Box::new(spec)),
        ..ImportedFile::default()
    })
}
