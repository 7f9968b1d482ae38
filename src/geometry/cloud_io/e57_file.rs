//! E57 files (ASTM E2807), read with the crate `e57`: each scan a cloud in its own coordinates, with its name and pose, in metres.
//! Points whose `cartesianInvalidState` is not 0 are none. A scan with row and column of each point is organised.
//! Only scans in Cartesian or spherical coordinates without either are refused.
//!
//! A file that ends before the length that its header states is told to be cut off, one with wrong checksums or content to be damaged, and
//! one that uses what the reader lacks to be so. The reader takes pages of 1024 bytes alone.

use std::error::Error as _;
use std::io::{self, BufReader, Read, Seek};

use e57::{E57Reader, PointCloud as Scan, RecordName, RecordValue};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use super::{CloudError, CloudLimits, Collected, StatedPose, StoredCloud};
use crate::geometry::point_cloud::CloudGrid;
use crate::geometry::poll::Poll;

/// Points between two looks at whether to go on.
const POINTS_PER_LOOK: usize = 4096;
/// Bytes of the source that are read at a time.
const BUFFER_BYTES: usize = 1 << 18;
/// Cells of a grid a point, at most: a grid with fewer points in it is not worth its memory.
const MAX_CELLS_PER_POINT: u64 = 64;
/// Bytes of the header, and of a page, at whose end its checksum stands.
const HEADER_BYTES: usize = 48;
const PAGE_BYTES: u64 = 1024;
/// Remedy for a file that is cut off or damaged.
const AGAIN: &str = "copy it from the scanner again, or export it anew";

/// Reads all clouds of a file that begins with `head` and has so many bytes.
pub(super) fn read<S: Read + Seek>(
    source: &mut S,
    (head, present_bytes): (&[u8], u64),
    limits: &CloudLimits,
    poll: &Poll<'_>,
) -> Result<Vec<StoredCloud>, CloudError> {
    let length = FileLength::of(head, present_bytes);
    let fault = |error: e57::Error| length.fault(error, "header".to_owned());
    let mut reader = E57Reader::new(BufReader::with_capacity(BUFFER_BYTES, source)).map_err(fault)?;
    let scans = reader.pointclouds();
    let (mut clouds, mut points) = (Vec::new(), 0_usize);
    for (index, scan) in scans.iter().enumerate() {
        let part =
            || scan.name.as_ref().map_or_else(|| format!("scan {}", index + 1), |name| format!("scan {} ({name:?})", index + 1));
        let left = CloudLimits { max_points: limits.max_points - points };
        let cloud = read_scan(&mut reader, scan, &left, poll, (&part, length))?;
        points += cloud.points.len();
        clouds.push(cloud);
    }
    if clouds.iter().all(|cloud| cloud.points.iter().all(|point| point[0].is_nan())) {
        return Err(CloudError::NoPoints);
    }
    Ok(clouds)
}

/// Length of a file, beside the one that its header states.
#[derive(Clone, Copy)]
struct FileLength {
    present_bytes: u64,
    /// `None` where the header is cut off.
    stated_bytes: Option<u64>,
}

impl FileLength {
    fn of(head: &[u8], present_bytes: u64) -> Self {
        let header = head.get(..HEADER_BYTES);
        let stated_bytes = header.and_then(|header| header[16..24].try_into().ok()).map(u64::from_le_bytes);
        Self { present_bytes, stated_bytes }
    }

    /// Error for one of the reader's in a part of the file.
    fn fault(self, error: e57::Error, part: String) -> CloudError {
        let error = match source_error(error) {
            Ok(of_source) => return CloudError::Io(of_source),
            Err(error) => error,
        };
        if let e57::Error::NotImplemented { desc } = error {
            let detail =
                format!("the file is made in a way of E57 that is not read ({desc}); export it in another one, or as PLY");
            return CloudError::E57 { part, detail };
        }
        let present_bytes = self.present_bytes;
        let detail = match (self.stated_bytes, bad_page(&error)) {
            (None, _) => format!("the file is cut off after {present_bytes} bytes, within its header of {HEADER_BYTES}; {AGAIN}"),
            (Some(stated_bytes), _) if stated_bytes > present_bytes => {
                format!("the file is cut off: its header states {stated_bytes} bytes, and {present_bytes} are there; {AGAIN}")
            }
            (Some(_), Some(page)) => {
                let byte = page.saturating_mul(PAGE_BYTES);
                format!("the file is damaged: the checksum of page {page}, from byte {byte} on, is not that of its data; {AGAIN}")
            }
            (Some(_), None) => format!("the file is damaged, or no E57 file of a kind that is read ({error}); {AGAIN}"),
        };
        CloudError::E57 { part, detail }
    }
}

/// Error of the source, such as a disk that does not give back what it holds; else the reader's error, which may stand on one of its own.
fn source_error(error: e57::Error) -> Result<io::Error, e57::Error> {
    use io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
    let cause = error.source().and_then(|cause| cause.downcast_ref::<io::Error>());
    if cause.is_none_or(|cause| matches!(cause.kind(), InvalidData | InvalidInput | UnexpectedEof)) {
        return Err(error);
    }
    let e57::Error::Read { desc, source: Some(cause) } = error else { return Err(error) };
    cause.downcast::<io::Error>().map(|cause| *cause).map_err(|cause| e57::Error::Read { desc, source: Some(cause) })
}

/// Page whose checksum is wrong, with which the reader's message ends.
fn bad_page(error: &e57::Error) -> Option<u64> {
    let message = error.source()?.to_string();
    let (_, page) = message.strip_prefix("Detected invalid checksum")?.rsplit_once(' ')?;
    page.parse().ok()
}

/// Places of what is wanted among the values of a record.
struct Layout {
    place: [usize; 3],
    is_spherical: bool,
    invalid: Option<usize>,
    row_column: Option<[usize; 2]>,
}

impl Layout {
    fn of(scan: &Scan) -> Option<Self> {
        let at = |name: RecordName| scan.prototype.iter().position(|record| record.name == name);
        let three = |names: [RecordName; 3]| {
            let [a, b, c] = names.map(at);
            Some([a?, b?, c?])
        };
        let plain = three([RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ]);
        let is_spherical = plain.is_none();
        let spherical = || three([RecordName::SphericalRange, RecordName::SphericalAzimuth, RecordName::SphericalElevation]);
        let state = if is_spherical { RecordName::SphericalInvalidState } else { RecordName::CartesianInvalidState };
        let row_column = at(RecordName::RowIndex).zip(at(RecordName::ColumnIndex)).map(<[usize; 2]>::from);
        Some(Self { place: plain.or_else(spherical)?, is_spherical, invalid: at(state), row_column })
    }

    /// The point of a record, if it has one.
    fn point(&self, scan: &Scan, values: &[RecordValue]) -> e57::Result<[f32; 3]> {
        let value = |place: usize| values[place].to_f64(&scan.prototype[place].data_type);
        if let Some(place) = self.invalid
            && value(place)? != 0.0
        {
            return Ok([f32::NAN; 3]);
        }
        let [a, b, c] = [value(self.place[0])?, value(self.place[1])?, value(self.place[2])?];
        let xyz = if self.is_spherical { [a * c.cos() * b.cos(), a * c.cos() * b.sin(), a * c.sin()] } else { [a, b, c] };
        Ok(xyz.map(|value| value as f32))
    }
}

fn read_scan<S: Read + Seek>(
    reader: &mut E57Reader<S>,
    scan: &Scan,
    limits: &CloudLimits,
    poll: &Poll<'_>,
    (part, length): (&dyn Fn() -> String, FileLength),
) -> Result<StoredCloud, CloudError> {
    let fault = |error: e57::Error| length.fault(error, part());
    let say = |detail: &str| CloudError::E57 { part: part(), detail: detail.into() };
    let layout = Layout::of(scan).ok_or_else(|| say("has neither cartesianX, Y, Z nor spherical coordinates"))?;
    if scan.records > limits.max_points as u64 {
        return Err(CloudError::TooManyPoints { limit: limits.max_points });
    }
    // The number of records is a mere statement: room grows with those that are there.
    let mut collected = Collected::new(0, layout.row_column.is_some(), limits)?;
    let mut cells: Vec<[u32; 2]> = Vec::new();
    for (index, values) in reader.pointcloud_raw(scan).map_err(fault)?.enumerate() {
        if index.is_multiple_of(POINTS_PER_LOOK) {
            poll.check()?;
        }
        let values = values.map_err(fault)?;
        collected.push(layout.point(scan, &values).map_err(fault)?)?;
        if let Some(places) = layout.row_column {
            let [row, column] = places.map(|place| values[place].to_i64(&scan.prototype[place].data_type));
            let [row, column] = [row.map_err(fault)?, column.map_err(fault)?].map(|number| u32::try_from(number).ok());
            let (row, column) = row.zip(column).ok_or_else(|| say("has a rowIndex or columnIndex outside 0 … 4294967295"))?;
            cells.push([row, column]);
        }
    }
    let mut cloud = organised(collected, &cells, limits)?;
    cloud.name.clone_from(&scan.name);
    cloud.stated_pose = stated_pose(scan).map(StatedPose::FileFromCloud);
    Ok(cloud)
}

/// Puts the points into their cells, where rows and columns tell those apart.
fn organised(collected: Collected, cells: &[[u32; 2]], limits: &CloudLimits) -> Result<StoredCloud, CloudError> {
    let not_finite = collected.not_finite;
    let mut cloud = collected.into_cloud(None);
    let begin = [0, 1].map(|axis| cells.iter().map(|cell| cell[axis]).min().unwrap_or(0));
    let end = [0, 1].map(|axis| cells.iter().map(|cell| u64::from(cell[axis]) + 1).max().unwrap_or(0));
    // Cells count from 0, so that they stay where the camera has them; but far-off first numbers are another start.
    let begin = begin.map(|first| if u64::from(first) > 100_000 { first } else { 0 });
    let [rows, columns] = [0, 1].map(|axis| end[axis] - u64::from(begin[axis]).min(end[axis]));
    let size = rows.saturating_mul(columns);
    let fits = rows > 1 && columns > 1 && size <= (cells.len() as u64).saturating_mul(MAX_CELLS_PER_POINT);
    let grid = CloudGrid { columns: columns as usize, rows: rows as usize };
    let placed = if fits && size <= limits.max_points as u64 { in_cells(&cloud.points, cells, begin, grid) } else { None };
    let Some(points) = placed else {
        cloud.points.retain(|point| !point[0].is_nan());
        return Ok(cloud);
    };
    Ok(StoredCloud { points, grid: Some(grid), not_finite, ..StoredCloud::default() })
}

/// The points in their cells; `None` where two have the same, such as several returns of one pulse.
fn in_cells(points: &[[f32; 3]], cells: &[[u32; 2]], begin: [u32; 2], grid: CloudGrid) -> Option<Vec<[f32; 3]>> {
    let mut placed = vec![[f32::NAN; 3]; grid.rows * grid.columns];
    for (cell, point) in cells.iter().zip(points).filter(|(_, point)| !point[0].is_nan()) {
        let place = &mut placed[(cell[0] - begin[0]) as usize * grid.columns + (cell[1] - begin[1]) as usize];
        if !place[0].is_nan() {
            return None;
        }
        *place = *point;
    }
    Some(placed)
}

/// Pose of a scan in the file, if it states one other than the identity.
fn stated_pose(scan: &Scan) -> Option<Isometry3<f64>> {
    let stated = scan.transform.as_ref()?;
    let (q, t) = (&stated.rotation, &stated.translation);
    let quaternion = Quaternion::new(q.w, q.x, q.y, q.z);
    let is_good = (0.9..1.1).contains(&quaternion.norm()) && [t.x, t.y, t.z].iter().all(|value| value.is_finite());
    let pose = Isometry3::from_parts(Translation3::new(t.x, t.y, t.z), UnitQuaternion::from_quaternion(quaternion));
    (is_good && pose != Isometry3::identity()).then_some(pose)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_one_cell_are_told_apart() {
        let (points, grid) = ([[0.0_f32; 3], [1.0; 3], [f32::NAN; 3]], CloudGrid { columns: 2, rows: 2 });
        let placed = in_cells(&points, &[[5, 0], [6, 1], [5, 0]], [5, 0], grid).expect("the third cell has no point");
        assert!(placed[0] == points[0] && placed[3] == points[1] && placed[1][0].is_nan());
        assert_eq!(in_cells(&points, &[[5, 0], [5, 0], [6, 1]], [5, 0], grid), None);
    }

    /// A file that is whole was once to be copied again.
    #[test]
    fn what_the_reader_lacks_is_no_damage_of_the_file() {
        let length = FileLength::of(&[0; HEADER_BYTES], 1024);
        let told = length.fault(e57::Error::NotImplemented { desc: "ZIP".into() }, "scan 1".into()).to_string();
        assert!(told.contains("scan 1") && told.contains("not read (ZIP); export it in another one"), "{told}");
        assert!(!told.contains("damaged") && !told.contains("copy"), "{told}");
    }

    /// An error of the disk was once told as one of the file, which was then refused for good.
    #[test]
    fn an_error_of_the_source_is_none_of_the_file() {
        let length = FileLength::of(&[0; HEADER_BYTES], 1024);
        let told = |kind: io::ErrorKind| {
            let cause = io::Error::new(kind, "why");
            length.fault(e57::Error::Read { desc: "what".into(), source: Some(Box::new(cause)) }, "header".into())
        };
        let CloudError::Io(error) = told(io::ErrorKind::StorageFull) else { panic!("another error") };
        assert_eq!((error.kind(), error.to_string().as_str()), (io::ErrorKind::StorageFull, "why"));
        assert!(matches!(told(io::ErrorKind::UnexpectedEof), CloudError::E57 { .. }));
    }
}
