//! A draft of a page as bytes, in which it is kept until its pictures are wanted: little-endian, numbers of corners as differences, so
//! that it compresses well. Whoever reads it needs neither the part's mesh nor the plan, and gets the same pictures. About 20 bytes a
//! triangle and a byte for each cell of each picture, before compression.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::album::{Draft, Picture};
use crate::geometry::Pose;
use crate::rendering::{Camera, DrawnModel, Ink};

/// First bytes of a draft; its last number rises with every change of what follows.
const HEAD: &[u8] = b"vantage report draft 1\n";
/// Max width and height of a picture, pixels.
const MAX_SIZE_PX: u32 = 8192;

/// Bytes that are no draft of this version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the draft of the report cannot be read by this version")]
pub struct NoDraft;

impl Draft {
    /// Writes the draft.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let DrawnModel { vertices_mm, faces, rows, is_open, .. } = &self.model;
        let mut bytes = HEAD.to_vec();
        bytes.push(u8::from(*is_open));
        put_count(&mut bytes, self.page.len());
        bytes.extend(self.page.as_bytes());
        put_count(&mut bytes, vertices_mm.len());
        // Coordinate by coordinate: neighbours are alike.
        (0..3).for_each(|axis| bytes.extend(vertices_mm.iter().flat_map(|p| p[axis].to_le_bytes())));
        put_count(&mut bytes, faces.len());
        let mut last = 0;
        for corner in faces.iter().flatten() {
            let step = i64::from(*corner) - last;
            put_number(&mut bytes, ((step << 1) ^ (step >> 63)) as u64);
            last = i64::from(*corner);
        }
        rows.iter().for_each(|rows| put_number(&mut bytes, u64::from(*rows)));
        put_count(&mut bytes, self.pictures.len());
        for picture in &self.pictures {
            put_camera(&mut bytes, &picture.camera);
            bytes.push(u8::from(picture.through));
            bytes.extend(&picture.inks);
        }
        bytes
    }

    /// Reads a draft.
    ///
    /// # Errors
    /// [`NoDraft`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, NoDraft> {
        let mut rest = Rest(bytes.strip_prefix(HEAD).ok_or(NoDraft)?);
        let is_open = rest.flag()?;
        let length = rest.count(1)?;
        let page = String::from_utf8(rest.take(length)?.to_vec()).map_err(|_| NoDraft)?;
        let vertices = rest.count(12)?;
        let mut vertices_mm = vec![[0.0; 3]; vertices];
        for axis in 0..3 {
            for vertex in &mut vertices_mm {
                vertex[axis] = f32::from_le_bytes(rest.array()?);
            }
        }
        let count = rest.count(3)?;
        let mut last = 0i64;
        let mut corner = || -> Result<u32, NoDraft> {
            let step = rest.number()?;
            last = last.checked_add((step >> 1) as i64 ^ -((step & 1) as i64)).ok_or(NoDraft)?;
            u32::try_from(last).map_err(|_| NoDraft)
        };
        let faces = (0..count).map(|_| Ok([corner()?, corner()?, corner()?])).collect::<Result<Vec<_>, NoDraft>>()?;
        let rows = (0..count).map(|_| u16::try_from(rest.number()?).map_err(|_| NoDraft)).collect::<Result<Vec<_>, _>>()?;
        let model = DrawnModel::new(vertices_mm, faces, rows, is_open).ok_or(NoDraft)?;
        let count = rest.count(model.cells().max(1))?;
        let pictures = (0..count).map(|_| picture(&mut rest, model.cells())).collect::<Result<Vec<_>, _>>()?;
        if rest.0.is_empty() { Ok(Self { page, model, pictures }) } else { Err(NoDraft) }
    }
}

fn picture(rest: &mut Rest<'_>, cells: usize) -> Result<Picture, NoDraft> {
    let camera = camera(rest)?;
    let through = rest.flag()?;
    let inks = rest.take(cells)?.to_vec();
    let are_known = inks.iter().all(|code| usize::from(*code) < Ink::ALL.len());
    if are_known { Ok(Picture { camera, inks, through }) } else { Err(NoDraft) }
}

fn put_camera(bytes: &mut Vec<u8>, camera: &Camera) {
    let isometry = camera.camera_from_part.isometry();
    let (at, turn) = (isometry.translation.vector, isometry.rotation.coords);
    let numbers = [at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w, camera.focal_px, camera.centre_px[0], camera.centre_px[1]];
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    bytes.extend(camera.size_px.iter().flat_map(|px| (*px as u32).to_le_bytes()));
}

fn camera(rest: &mut Rest<'_>) -> Result<Camera, NoDraft> {
    let mut numbers = [0.0; 10];
    for number in &mut numbers {
        *number = f64::from_le_bytes(rest.array()?);
    }
    let [x, y, z, i, j, k, w, focal_px, left, top] = numbers;
    let size_px = [u32::from_le_bytes(rest.array()?), u32::from_le_bytes(rest.array()?)];
    if !size_px.iter().all(|px| (1..=MAX_SIZE_PX).contains(px)) || !numbers.iter().all(|number| number.is_finite()) {
        return Err(NoDraft);
    }
    // As it was written: normalised once more, it would be another one.
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    let camera_from_part = Pose::claim(Isometry3::from_parts(Translation3::new(x, y, z), rotation));
    Ok(Camera { camera_from_part, size_px: size_px.map(|px| px as usize), focal_px, centre_px: [left, top] })
}

fn put_count(bytes: &mut Vec<u8>, count: usize) {
    bytes.extend((count as u64).to_le_bytes());
}

/// Seven bits a byte, the lowest first; the highest bit of a byte is set if another one follows.
fn put_number(bytes: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

/// Bytes not read yet.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], NoDraft> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or(NoDraft)?;
        self.0 = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], NoDraft> {
        self.take(N)?.try_into().map_err(|_| NoDraft)
    }

    fn flag(&mut self) -> Result<bool, NoDraft> {
        match self.array()? {
            [0] => Ok(false),
            [1] => Ok(true),
            [_] => Err(NoDraft),
        }
    }

    /// Number of things of at least so many bytes each; no more than the rest has room for.
    fn count(&mut self, bytes_each: usize) -> Result<usize, NoDraft> {
        let count = usize::try_from(u64::from_le_bytes(self.array()?)).map_err(|_| NoDraft)?;
        let bytes = count.checked_mul(bytes_each).ok_or(NoDraft)?;
        if bytes <= self.0.len() { Ok(count) } else { Err(NoDraft) }
    }

    fn number(&mut self) -> Result<u64, NoDraft> {
        let mut number = 0;
        for shift in (0..63).step_by(7) {
            let [byte] = self.array()?;
            number |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(number);
            }
        }
        Err(NoDraft)
    }
}
