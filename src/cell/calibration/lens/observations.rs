//! Observations of a board: where its points are imaged by the left camera, the right camera, and, from phase maps, by the
//! projector as an inverse camera. As JSON (`vantage.scanner_observations/1`) and as CSV, a point a line.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector2};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::fault::{LensError, LensFault};
use super::lit_rectangle::LitRectangleSpec;
use crate::cell::closed_list::closed_list;
use crate::cell::{DeviceName, PerDevice};
use crate::geometry::counted;

/// Name and version of the document.
pub const OBSERVATIONS_SCHEMA: &str = "vantage.scanner_observations/1";
/// Most views.
const MAX_VIEWS: usize = 2000;
/// Most points of a board.
const MAX_POINTS: usize = 20_000;
/// Most sightings in all.
const MAX_SIGHTINGS: usize = 4_000_000;
/// Farthest point of a board from its origin, mm.
const MAX_BOARD_MM: f64 = 1e4;
/// Farthest pixel from the first one.
const MAX_PIXEL: f64 = 1e6;

closed_list! {
    /// Point from which pixels count.
    #[derive(Default)]
    pub enum PixelOrigin {
        /// Centre of the first pixel, as OpenCV, Bouguet and Kalibr have it.
        #[default]
        Centre = "centre",
        /// Outer corner of the first pixel, as scanner specifications have it.
        Corner = "corner",
        /// Centre of the first pixel, which is (1, 1), as MATLAB has it.
        CentreOne = "centre_one",
    }
}

/// Observations of a board by a scanner's devices. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ScannerObservationsSpec {
    /// `vantage.scanner_observations/1`.
    pub schema: String,
    /// The board.
    pub board: BoardSpec,
    /// Point from which pixels count. Default `centre`.
    #[serde(default)]
    pub pixel_origin: PixelOrigin,
    /// Image of the left camera.
    pub left: DeviceImageSpec,
    /// Image of the right camera.
    pub right: DeviceImageSpec,
    /// Image of the projector, if its pixels were observed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector: Option<DeviceImageSpec>,
    /// Views, 1 to 2000.
    pub views: Vec<ViewSpec>,
    /// Rectangle that the projector lights, if that is all that is known of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lit_rectangle: Option<LitRectangleSpec>,
    /// Time of the measurements, as it is to be kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub taken_at: Option<String>,
}

/// A board: a lattice of `columns` × `rows` points, row by row, or a list of points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct BoardSpec {
    /// Points along x, 2 to 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<u32>,
    /// Points along y, 2 to 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows: Option<u32>,
    /// Distance between neighbouring points, mm, 0.01 to 1000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub square_mm: Option<f64>,
    /// Points instead of a lattice, mm, 4 to 20000.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub points_mm: Option<Vec<[f64; 3]>>,
}

/// Size of a device's image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct DeviceImageSpec {
    /// Image width, px, 16 to 100000.
    pub width_px: u32,
    /// Image height, px, 16 to 100000.
    pub height_px: u32,
}

/// One pose of the board; a pixel for every point of the board in its order, `null` where it was not found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ViewSpec {
    /// Name of the view.
    pub id: String,
    /// Pixels of the left camera.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left: Vec<Option<[f64; 2]>>,
    /// Pixels of the right camera.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub right: Vec<Option<[f64; 2]>>,
    /// Pixels of the projector, from the phase at the board's points.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub projector: Vec<Option<[f64; 2]>>,
    /// Working distance at which the board was placed, mm, 1 to 10000, where it was: three such views find where working distances
    /// count from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stated_distance_mm: Option<f64>,
}

/// Point of the board in an image; the pixel counts from the outer corner of the first one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceSighting {
    /// Number of the point.
    pub point: u32,
    /// The point, board frame, mm.
    pub board_mm: Point3<f64>,
    /// Pixel at which the point was seen.
    pub pixel: Vector2<f64>,
}

/// One pose of the board.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardView {
    /// Name of the pose.
    pub id: String,
    /// Sightings of each device.
    pub seen: PerDevice<Vec<DeviceSighting>>,
    /// Working distance at which the board was placed, mm.
    pub stated_distance_mm: Option<f64>,
}

/// Observations, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardObservations {
    /// Sizes of the images; `None` for a projector that was not observed.
    pub size_px: PerDevice<Option<[u32; 2]>>,
    /// Views of the board, one for each capture.
    pub views: Vec<BoardView>,
    /// Neighbours on the board at its smallest distance, by their numbers, and that distance, mm.
    pub pitch: Vec<([u32; 2], f64)>,
    /// Time of the measurements.
    pub taken_at: Option<String>,
}

impl PixelOrigin {
    /// Pixels from where this counts to the outer corner of the first pixel.
    #[must_use]
    pub fn offset_px(self) -> f64 {
        match self {
            Self::Centre => 0.5,
            Self::Corner => 0.0,
            Self::CentreOne => -0.5,
        }
    }
}

fn range(pointer: impl Into<String>, value: f64, low: f64, high: f64) -> Result<(), LensError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(LensError::new(LensFault::OutOfRange, pointer, format!("is {value}; allowed is {low} to {high}")))
}

impl BoardSpec {
    /// Points of the board.
    ///
    /// # Errors
    /// [`LensError`] for a board that is none.
    pub fn points(&self) -> Result<Vec<Point3<f64>>, LensError> {
        let lattice = (self.columns, self.rows, self.square_mm);
        match (lattice, &self.points_mm) {
            ((Some(columns), Some(rows), Some(square_mm)), None) => {
                range("/board/columns", f64::from(columns), 2.0, 1000.0)?;
                range("/board/rows", f64::from(rows), 2.0, 1000.0)?;
                range("/board/square_mm", square_mm, 0.01, 1000.0)?;
                range("/board", f64::from(columns) * f64::from(rows), 4.0, MAX_POINTS as f64)?;
                let at = |index: u32| f64::from(index) * square_mm;
                Ok((0..rows * columns).map(|index| Point3::new(at(index % columns), at(index / columns), 0.0)).collect())
            }
            ((None, None, None), Some(points)) => {
                range("/board/points_mm", points.len() as f64, 4.0, MAX_POINTS as f64)?;
                for (index, value) in points.iter().enumerate().flat_map(|(index, point)| point.map(|value| (index, value))) {
                    range(format!("/board/points_mm/{index}"), value, -MAX_BOARD_MM, MAX_BOARD_MM)?;
                }
                Ok(points.iter().map(|point| Point3::from(*point)).collect())
            }
            _ => Err(LensError::new(LensFault::MissingField, "/board", "give columns, rows and square_mm, or points_mm")),
        }
    }
}

impl ScannerObservationsSpec {
    /// Checks the document.
    ///
    /// # Errors
    /// [`LensError`] at the first fault.
    pub fn build(&self) -> Result<BoardObservations, LensError> {
        if self.schema != OBSERVATIONS_SCHEMA {
            let detail =
                format!("is {:?}; expected is {OBSERVATIONS_SCHEMA:?}", self.schema.chars().take(60).collect::<String>());
            return Err(LensError::new(LensFault::UnknownFormat, "/schema", detail));
        }
        let points = self.board.points()?;
        let images = PerDevice { left: Some(self.left), right: Some(self.right), projector: self.projector };
        for (device, image) in DeviceName::ALL.iter().zip(images.iter()) {
            let Some(image) = image else { continue };
            range(format!("/{}/width_px", device.as_str()), f64::from(image.width_px), 16.0, 1e5)?;
            range(format!("/{}/height_px", device.as_str()), f64::from(image.height_px), 16.0, 1e5)?;
        }
        range("/views", self.views.len() as f64, 1.0, MAX_VIEWS as f64)?;
        let offset = self.pixel_origin.offset_px();
        let views = self.views.iter().enumerate().map(|(index, view)| view.build(index, &points, offset));
        let views: Vec<BoardView> = views.collect::<Result<_, _>>()?;
        refuse_twins(&views)?;
        if self.projector.is_none() && views.iter().any(|view| !view.seen.projector.is_empty()) {
            let detail = "is missing, but views have pixels of the projector; give its width_px and height_px";
            return Err(LensError::new(LensFault::MissingImageSize, "/projector", detail));
        }
        Ok(BoardObservations {
            size_px: images.map(|image| image.map(|image| [image.width_px, image.height_px])),
            pitch: neighbours(&points),
            views,
            taken_at: self.taken_at.as_ref().map(|at| at.chars().take(100).collect()),
        })
    }
}

impl ViewSpec {
    fn build(&self, index: usize, points: &[Point3<f64>], offset: f64) -> Result<BoardView, LensError> {
        let pointer = format!("/views/{index}");
        if let Some(distance_mm) = self.stated_distance_mm {
            range(format!("{pointer}/stated_distance_mm"), distance_mm, 1.0, 1e4)?;
        }
        let sightings = |device: DeviceName, pixels: &[Option<[f64; 2]>]| -> Result<Vec<DeviceSighting>, LensError> {
            let pointer = format!("{pointer}/{}", device.as_str());
            if !pixels.is_empty() && pixels.len() != points.len() {
                let detail = format!(
                    "has {}; the board has {} points: null for those not found",
                    counted(pixels.len(), "pixel"),
                    points.len()
                );
                return Err(LensError::new(LensFault::WrongShape, pointer, detail));
            }
            let found =
                pixels.iter().zip(points).zip(0..).filter_map(|((pixel, point), number)| Some((number, *point, (*pixel)?)));
            found
                .map(|(point, board_mm, [u, v])| {
                    range(format!("{pointer}/{point}/0"), u, -MAX_PIXEL, MAX_PIXEL)?;
                    range(format!("{pointer}/{point}/1"), v, -MAX_PIXEL, MAX_PIXEL)?;
                    Ok(DeviceSighting { point, board_mm, pixel: Vector2::new(u + offset, v + offset) })
                })
                .collect()
        };
        Ok(BoardView {
            id: self.id.chars().take(100).collect(),
            seen: PerDevice {
                left: sightings(DeviceName::Left, &self.left)?,
                right: sightings(DeviceName::Right, &self.right)?,
                projector: sightings(DeviceName::Projector, &self.projector)?,
            },
            stated_distance_mm: self.stated_distance_mm,
        })
    }
}

/// Refuses a view that has the very pixels of an earlier one: counted twice, it would make the uncertainty smaller than it is.
fn refuse_twins(views: &[BoardView]) -> Result<(), LensError> {
    let is_empty = |view: &BoardView| view.seen.iter().all(|seen| seen.is_empty());
    for (index, view) in views.iter().enumerate().filter(|(_, view)| !is_empty(view)) {
        if let Some(first) = views[..index].iter().position(|other| other.seen == view.seen) {
            let detail = format!(
                "{:?} has exactly the pixels of view {:?} (/views/{first}): noise makes views differ; leave one of them out",
                view.id, views[first].id
            );
            return Err(LensError::new(LensFault::Inconsistent, format!("/views/{index}"), detail));
        }
    }
    Ok(())
}

/// Refuses lines of a CSV that are given twice: the same point at the same pixel.
fn refuse_repeats(views: &[BoardView]) -> Result<(), LensError> {
    for view in views {
        for (device, seen) in DeviceName::ALL.iter().zip(view.seen.iter()) {
            let mut keys: Vec<(u32, [u64; 2])> =
                seen.iter().map(|each| (each.point, [each.pixel.x.to_bits(), each.pixel.y.to_bits()])).collect();
            keys.sort_unstable();
            if let Some(twice) = keys.windows(2).find(|two| two[0] == two[1]) {
                let at = seen.iter().find(|each| each.point == twice[0].0).map_or_else(Point3::origin, |each| each.board_mm);
                let detail = format!(
                    "has the point {}, {}, {} mm twice at the same pixel of the {} device; leave one of the lines out",
                    at.x,
                    at.y,
                    at.z,
                    device.as_str()
                );
                return Err(LensError::new(LensFault::Inconsistent, format!("view {:?}", view.id), detail));
            }
        }
    }
    Ok(())
}

/// Pairs of points whose distance is the smallest on the board, to 1 part in 1000. Boards of more than 2000 points are compared
/// along their order alone.
fn neighbours(points: &[Point3<f64>]) -> Vec<([u32; 2], f64)> {
    const ALL_PAIRS: usize = 2000;
    let reach = if points.len() <= ALL_PAIRS { points.len() } else { 2 };
    let pairs = |points: &[Point3<f64>]| -> Vec<([u32; 2], f64)> {
        let from = |first: usize| {
            let seconds = (first + 1..points.len().min(first + reach)).map(move |second| (first, second));
            seconds.map(|(a, b)| ([a as u32, b as u32], (points[a] - points[b]).norm())).collect::<Vec<_>>()
        };
        (0..points.len()).flat_map(from).collect()
    };
    let all = pairs(points);
    let smallest = all.iter().map(|(_, distance)| *distance).filter(|distance| *distance > 0.0).fold(f64::INFINITY, f64::min);
    all.into_iter().filter(|(_, distance)| (distance - smallest).abs() <= 1e-3 * smallest).collect()
}

/// Header of the CSV.
const CSV_HEADER: &str = "view,device,x_mm,y_mm,z_mm,u_px,v_px";

/// Reads the CSV `view,device,x_mm,y_mm,z_mm,u_px,v_px`, a point a line; pixels count from the centre of the first one. Tabs
/// separate as commas do.
///
/// # Errors
/// [`LensError`] with the line.
pub fn read_csv(text: &str, size_px: PerDevice<Option<[u32; 2]>>) -> Result<BoardObservations, LensError> {
    let mut lines = text.trim_start_matches('\u{feff}').lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let header = lines.next().map(|(_, line)| line.replace(' ', "").replace('\t', ",")).unwrap_or_default();
    if header != CSV_HEADER {
        let detail = format!("begins with {:?}; expected is {CSV_HEADER}", header.chars().take(80).collect::<String>());
        return Err(LensError::new(LensFault::Unreadable, "line 1", detail));
    }
    let mut table = CsvTable::default();
    for (number, line) in lines.take(MAX_SIGHTINGS) {
        table.add(&format!("line {}", number + 1), line)?;
    }
    if table.views.is_empty() {
        return Err(LensError::new(LensFault::TooFew, "", "has no observations"));
    }
    refuse_repeats(&table.views)?;
    refuse_twins(&table.views)?;
    let observed_projector = table.views.iter().any(|view| !view.seen.projector.is_empty());
    for (device, size) in DeviceName::ALL.iter().zip(size_px.iter()) {
        if size.is_none() && (*device != DeviceName::Projector || observed_projector) {
            let detail =
                "a CSV does not give the size of the image; give it by --image-size, of the projector by --projector-size";
            return Err(LensError::new(LensFault::MissingImageSize, device.as_str(), detail));
        }
    }
    let size_px = PerDevice { projector: size_px.projector.filter(|_| observed_projector), ..size_px };
    Ok(BoardObservations { size_px, pitch: neighbours(&table.points), views: table.views, taken_at: None })
}

/// Views and points of a CSV, as far as it is read.
#[derive(Default)]
struct CsvTable {
    views: Vec<BoardView>,
    places: BTreeMap<String, usize>,
    points: Vec<Point3<f64>>,
    numbers: BTreeMap<[u64; 3], u32>,
}

impl CsvTable {
    fn add(&mut self, at: &str, line: &str) -> Result<(), LensError> {
        let fields: Vec<&str> = line.split([',', '\t']).map(str::trim).collect();
        let [id, device, numbers @ ..] = fields.as_slice() else {
            return Err(LensError::new(LensFault::WrongShape, at, "has less than two columns"));
        };
        let numbers: Option<Vec<f64>> = numbers.iter().map(|text| text.parse().ok()).collect();
        let Some([x, y, z, u, v]) = numbers.as_deref() else {
            return Err(LensError::new(LensFault::WrongShape, at, format!("needs {CSV_HEADER}")));
        };
        for value in [x, y, z] {
            range(at, *value, -MAX_BOARD_MM, MAX_BOARD_MM)?;
        }
        for value in [u, v] {
            range(at, *value, -MAX_PIXEL, MAX_PIXEL)?;
        }
        let next = self.points.len() as u32;
        let point = *self.numbers.entry([x, y, z].map(|value| (value + 0.0).to_bits())).or_insert(next);
        if point == next {
            range(at, f64::from(next), 0.0, MAX_POINTS as f64 - 1.0)?;
            self.points.push(Point3::new(*x, *y, *z));
        }
        let place = match self.places.get(*id) {
            Some(place) => *place,
            None => {
                range(at, self.views.len() as f64, 0.0, MAX_VIEWS as f64 - 1.0)?;
                let seen = PerDevice { left: Vec::new(), right: Vec::new(), projector: Vec::new() };
                self.views.push(BoardView { id: id.chars().take(100).collect(), seen, stated_distance_mm: None });
                self.places.insert((*id).to_owned(), self.views.len() - 1);
                self.views.len() - 1
            }
        };
        let seen = &mut self.views[place].seen;
        let list = match *device {
            "left" => &mut seen.left,
            "right" => &mut seen.right,
            "projector" => &mut seen.projector,
            other => {
                let detail = format!("has the device {other:?}; allowed are left, right and projector");
                return Err(LensError::new(LensFault::OutOfRange, at, detail));
            }
        };
        let offset = PixelOrigin::Centre.offset_px();
        list.push(DeviceSighting { point, board_mm: Point3::new(*x, *y, *z), pixel: Vector2::new(u + offset, v + offset) });
        Ok(())
    }
}
