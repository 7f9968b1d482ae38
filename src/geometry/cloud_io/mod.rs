//! Readers and writers of point clouds: PLY (ASCII, binary in both byte orders, with or without faces), PCD (ASCII, binary,
//! compressed), text in columns (XYZ, ASC, PTS, CSV), E57, and meshes as STL or OBJ, told apart by their content. Coordinates come
//! out in the file's own unit and frame: only what the scans are held against can tell which those are.
//!
//! Files are streamed: 12 bytes a point are held, a few megabytes of the file beside them, and for meshes 12 bytes a face (STL and
//! OBJ as [`super::mesh_io`] holds them). No allocation relies on a count that the bytes at hand do not bear out. Every error names
//! line or byte, and what was expected there. Cost: linear in the size of the file.

mod e57_file;
mod error;
mod lzf;
mod pcd;
mod pcd_header;
mod ply;
mod ply_body;
mod stream;
#[cfg(test)]
mod tests;
mod text_columns;
mod write;

use std::io::{Cursor, Read, Seek, SeekFrom};

use nalgebra::Isometry3;

use super::mesh_io::{self, MeshFormat};
use super::point_cloud::{CloudGrid, PointCloud};
use super::poll::Poll;
use super::unit::LengthUnit;

pub use error::CloudError;
use stream::CloudStream;
pub use write::{write_pcd, write_ply};

/// Formats of clouds that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CloudFormat {
    /// PLY, any encoding.
    Ply,
    /// PCD, any encoding.
    Pcd,
    /// ASTM E2807.
    E57,
    /// Text, a point a line.
    Text,
    /// STL.
    Stl,
    /// Wavefront OBJ.
    Obj,
}

impl CloudFormat {
    /// Name in answers and reports.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Pcd => "pcd",
            Self::E57 => "e57",
            Self::Text => "xyz",
            Self::Stl => "stl",
            Self::Obj => "obj",
        }
    }
}

/// Limits on the size of a cloud file.
#[derive(Clone, Copy, Debug)]
pub struct CloudLimits {
    /// Max points of a file, cells without a point included; the max number of triangles is twice this.
    pub max_points: usize,
}

impl Default for CloudLimits {
    /// 50 million points, 600 MB: every shot of a scanner with 12 megapixels is below a quarter of it.
    fn default() -> Self {
        Self { max_points: 50_000_000 }
    }
}

/// Pose that a file states for a cloud, in the file's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StatedPose {
    /// Takes the cloud's coordinates to those of the whole file: E57's `pose`.
    FileFromCloud(Isometry3<f64>),
    /// Pose of the sensor in the cloud's coordinates: PCD's `VIEWPOINT`.
    CloudFromSensor(Isometry3<f64>),
}

/// One cloud of a file, in the file's unit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredCloud {
    /// Name in the file, of formats that have one.
    pub name: Option<String>,
    /// Coordinates. A cell of an organised cloud without a point holds NaN; other clouds hold no NaN.
    pub points: Vec<[f32; 3]>,
    /// `Some` where the cloud is organised.
    pub grid: Option<CloudGrid>,
    /// Triangles between the points, of a mesh.
    pub faces: Vec<[u32; 3]>,
    /// Pose in the file, other than the identity.
    pub stated_pose: Option<StatedPose>,
    /// Records without a finite point that were left out; of an organised cloud they are cells.
    pub not_finite: u64,
}

impl StoredCloud {
    /// Points in millimetres.
    #[must_use]
    pub fn into_millimetres(self, unit: LengthUnit) -> PointCloud {
        let Self { mut points, grid, .. } = self;
        if unit != LengthUnit::Millimetre {
            let millimetres = |value: f32| (f64::from(value) * unit.mm()) as f32;
            points.iter_mut().for_each(|point| *point = point.map(millimetres));
        }
        PointCloud { points_mm: points, grid }
    }
}

/// A file of clouds that was read.
#[derive(Clone, Debug)]
pub struct CloudFile {
    /// Format of the file.
    pub format: CloudFormat,
    /// Unit of its coordinates, where the format or a header states it.
    pub unit: Option<LengthUnit>,
    /// Clouds in the file, at least one; only E57 files have more.
    pub clouds: Vec<StoredCloud>,
}

/// Bytes of a file that are looked at to find its format.
const HEAD_BYTES: usize = 1 << 16;

/// Reads a file of clouds from memory.
///
/// # Errors
/// [`CloudError`].
pub fn read(bytes: &[u8], limits: &CloudLimits) -> Result<CloudFile, CloudError> {
    read_from(&mut Cursor::new(bytes), limits, &Poll::never())
}

/// Reads a file of clouds from a source until `poll` says to stop.
///
/// # Errors
/// [`CloudError`].
pub fn read_from<S: Read + Seek>(source: &mut S, limits: &CloudLimits, poll: &Poll<'_>) -> Result<CloudFile, CloudError> {
    let length_bytes = source.seek(SeekFrom::End(0))?;
    source.seek(SeekFrom::Start(0))?;
    let mut head = Vec::new();
    Read::take(&mut *source, HEAD_BYTES as u64).read_to_end(&mut head)?;
    source.seek(SeekFrom::Start(0))?;
    let format = detect(&head, length_bytes, poll)?;
    if format == CloudFormat::E57 {
        let clouds = e57_file::read(source, (&head, length_bytes), limits, poll)?;
        return Ok(CloudFile { format, unit: Some(LengthUnit::Metre), clouds });
    }
    let (unit, cloud) = match format {
        CloudFormat::Ply => (None, ply::read(&mut CloudStream::new(source, length_bytes, poll), limits)?),
        CloudFormat::Pcd => (None, pcd::read(&mut CloudStream::new(source, length_bytes, poll), limits)?),
        CloudFormat::Text => text_columns::read(&mut CloudStream::new(source, length_bytes, poll), limits)?,
        CloudFormat::Stl | CloudFormat::Obj | CloudFormat::E57 => (None, read_mesh(source, length_bytes, limits, poll)?),
    };
    if cloud.points.iter().all(|point| point[0].is_nan()) {
        return Err(CloudError::NoPoints);
    }
    Ok(CloudFile { format, unit, clouds: vec![cloud] })
}

/// Finds the format from the first bytes.
fn detect(head: &[u8], length_bytes: u64, poll: &Poll<'_>) -> Result<CloudFormat, CloudError> {
    if head.is_empty() {
        return Err(CloudError::Content(mesh_io::MeshError::EmptyFile));
    }
    if head.starts_with(b"ASTM-E57") {
        return Ok(CloudFormat::E57);
    }
    if pcd_header::is_pcd(head, poll) {
        return Ok(CloudFormat::Pcd);
    }
    // A head that is no whole file has the length of no binary STL file; that of the whole file may.
    if mesh_io::is_binary_stl(head, length_bytes) {
        return Ok(CloudFormat::Stl);
    }
    if head.starts_with(b"ply") {
        return Ok(CloudFormat::Ply);
    }
    if text_columns::is_columns(head, poll) {
        return Ok(CloudFormat::Text);
    }
    match mesh_io::detect_format(head) {
        Ok(MeshFormat::StlBinary | MeshFormat::StlAscii) => Ok(CloudFormat::Stl),
        Ok(MeshFormat::Obj) => Ok(CloudFormat::Obj),
        Ok(MeshFormat::Ply) => Ok(CloudFormat::Ply),
        Err(_) => Err(CloudError::UnknownFormat),
    }
}

/// Vertices and faces of a mesh that a scanner's program made.
fn read_mesh<S: Read>(
    source: &mut S,
    length_bytes: u64,
    limits: &CloudLimits,
    poll: &Poll<'_>,
) -> Result<StoredCloud, CloudError> {
    let max_triangles = limits.max_points.saturating_mul(2);
    // The millimetre leaves the numbers as they are.
    let unit = Some(LengthUnit::Millimetre);
    let mesh = mesh_io::read_from(source, length_bytes, unit, &mesh_io::Limits { max_triangles }, poll)?.mesh;
    if mesh.vertices_mm.len() > limits.max_points {
        return Err(CloudError::TooManyPoints { limit: limits.max_points });
    }
    let points = mesh.vertices_mm.iter().map(|vertex| [vertex.x as f32, vertex.y as f32, vertex.z as f32]).collect();
    Ok(StoredCloud { points, faces: mesh.faces, ..StoredCloud::default() })
}

/// Points that a reader collects.
struct Collected {
    points: Vec<[f32; 3]>,
    /// True if records without a point are cells that are kept.
    keeps_cells: bool,
    not_finite: u64,
    limit: usize,
}

impl Collected {
    /// Room for so many records, which the bytes of the file bear out.
    fn new(records: u64, keeps_cells: bool, limits: &CloudLimits) -> Result<Self, CloudError> {
        let limit = limits.max_points;
        let records = usize::try_from(records).ok().filter(|records| *records <= limit);
        let records = records.ok_or(CloudError::TooManyPoints { limit })?;
        Ok(Self { points: Vec::with_capacity(records), keeps_cells, not_finite: 0, limit })
    }

    /// Adds a record.
    #[inline]
    fn push(&mut self, point: [f32; 3]) -> Result<(), CloudError> {
        let is_there = point.iter().all(|value| value.is_finite());
        self.not_finite += u64::from(!is_there);
        if is_there || self.keeps_cells {
            if self.points.len() >= self.limit {
                return Err(CloudError::TooManyPoints { limit: self.limit });
            }
            self.points.push(if is_there { point } else { [f32::NAN; 3] });
        }
        Ok(())
    }

    fn into_cloud(self, grid: Option<CloudGrid>) -> StoredCloud {
        StoredCloud { points: self.points, grid, not_finite: self.not_finite, ..StoredCloud::default() }
    }
}
