//! Images of a merged cloud in the views of a plan. The cloud does not tell which view took a point, so that each view gets the points that
//! it can have seen where the part lies: not those that lie on a face of the part which is turned away from the camera, or which hides
//! behind another one. The points of all other surfaces would show through between those before them.
//!
//! A point lies on another face than the one that its ray meets if it is twice as near to it. The other side of a sheet explains a dent as
//! well: a point there is hidden only where points around it lie before it. Where the part lies is found by images of all points.
//!
//! The cells are the smallest that the points fill, also where a single view took them. Each keeps the point that is imaged nearest to its
//! middle: the nearest in depth would be one with a large error, or of a rim. What lies on no face of the part hides what is behind it.
//!
//! Memory: 24 bytes a point beside the cloud, and some 50 bytes a point for each view that is made at a time. Cost: a ray a point and view,
//! and a search for the nearest face a point.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::organise::{CELL_PIXELS, DENSE_SHARE, cell_in, fill, occupied};
use crate::cell::Scanner;
use crate::geometry::{CloudGrid, Hit, NearestFace, Part, PointCloud, Pose, RayScene, ScannerFrame, SimdLevel};
use crate::inspection::registration::{RegistrationOptions, register};
use crate::inspection::{PixelGrid, ViewScan};
use crate::planning::context::{Cancelled, Context};

/// Max empty cells between two occupied ones, as a share of the occupied ones: with more, a part of the surface has its points farther
/// apart than the cells. Not from a source.
const MAX_GAPS: f64 = 0.03;
/// Distance from the surface that a ray meets up to which a point is taken to be of it, mm: some times the noise of a scanner.
const OFF_MM: f64 = 0.1;
/// Distance within which a face explains a point, mm.
const REACH_MM: f64 = 1.0;
/// Largest cosine between the normals of the two sides of a sheet: cos 150°.
const OTHER_SIDE_COS: f64 = -0.866;
/// Rays that are cast at a time.
const RAYS: usize = 4096;

/// Image of a merged cloud in one view.
pub(in crate::inspection) struct MergedImage {
    /// Points in the scanner's frame, by cells of the left camera's image.
    pub(in crate::inspection) scanner_cloud: PointCloud,
    /// Points outside of the image.
    pub(in crate::inspection) outside: usize,
}

/// Makes the images of a cloud in the part's frame, in each of `views`: numbers of viewpoints and their poses.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::inspection) fn merged_images(
    part_mm: &[[f32; 3]],
    views: &[(u32, Pose<Part, ScannerFrame>)],
    scanner: &Scanner,
    nearest: &NearestFace<'_>,
    ctx: &Context<'_>,
) -> Result<Vec<MergedImage>, Cancelled> {
    let images = |sight: Option<&Sight<'_>>| -> Result<Vec<MergedImage>, Cancelled> {
        let image = |(_, pose): &(u32, Pose<Part, ScannerFrame>)| {
            ctx.check()?;
            Ok(Projection::new(part_mm, pose, scanner, sight).image())
        };
        views.par_iter().map(image).collect()
    };
    let of_all = images(None)?;
    let scan = |(image, (viewpoint, pose)): (MergedImage, &(u32, Pose<Part, ScannerFrame>))| ViewScan {
        viewpoint: *viewpoint,
        part_from_scanner: *pose,
        scanner_cloud: image.scanner_cloud,
    };
    let scans: Vec<ViewScan> = of_all.into_iter().zip(views).map(scan).collect();
    let options = RegistrationOptions { moves_views: false, ..RegistrationOptions::default() };
    let registered = register(&scans, nearest, &[], &options);
    let is_found = registered.not_found().is_none();
    let mesh_from_stated = if is_found { registered.mesh_from_stated } else { Pose::identity() };
    images(Some(&Sight::new(part_mm, nearest, *mesh_from_stated.isometry())))
}

/// The part where it lies, and the faces that explain the points.
struct Sight<'a> {
    nearest: &'a NearestFace<'a>,
    scene: RayScene,
    mesh_from_stated: Isometry3<f64>,
    /// Face within [`REACH_MM`] of each point, and its distance, mm.
    faces: Vec<Option<(u32, f32)>>,
}

/// Point that lies on the other side of the sheet that its ray meets.
struct Doubt {
    /// Unit normal of the side that the ray meets, scanner frame.
    normal: Vector3<f64>,
    /// Distance of the point behind it, mm.
    behind_mm: f64,
}

/// Sight of a point from a view.
enum Seen {
    Yes,
    No,
    Perhaps(Doubt),
}

impl<'a> Sight<'a> {
    fn new(part_mm: &[[f32; 3]], nearest: &'a NearestFace<'a>, mesh_from_stated: Isometry3<f64>) -> Self {
        let face_of = |point: &[f32; 3]| {
            let point = mesh_from_stated * Point3::from(point.map(f64::from));
            let found = nearest.nearest(&point, REACH_MM)?;
            Some((found.face, (found.point_mm - point).norm() as f32))
        };
        let finite = |point: &[f32; 3]| (!point[0].is_nan()).then(|| face_of(point)).flatten();
        let faces = part_mm.par_iter().map(finite).collect();
        Self { nearest, scene: RayScene::new([nearest.mesh()]), mesh_from_stated, faces }
    }

    /// Finds which of the points, by their numbers, a view can have seen.
    fn of(
        &self,
        part_mm: &[[f32; 3]],
        numbers: &[usize],
        part_from_scanner: &Pose<Part, ScannerFrame>,
        eye: &Point3<f64>,
    ) -> Vec<Seen> {
        let eye = self.mesh_from_stated * part_from_scanner.point(eye);
        let scanner_from_mesh = (self.mesh_from_stated * part_from_scanner.isometry()).inverse();
        let mut seen = Vec::with_capacity(numbers.len());
        let mut hits: Vec<Option<Hit>> = Vec::new();
        for numbers in numbers.chunks(RAYS) {
            let ray = |number: &usize| self.mesh_from_stated * Point3::from(part_mm[*number].map(f64::from)) - eye;
            let rays: Vec<Vector3<f64>> = numbers.iter().map(ray).collect();
            self.scene.first_hits_from(SimdLevel::widest(), &eye, &rays, &mut hits);
            let points = numbers.iter().zip(&rays).zip(&hits);
            seen.extend(points.map(|((number, ray), hit)| self.judge(*number, ray, hit.as_ref(), &scanner_from_mesh)));
        }
        seen
    }

    fn judge(&self, number: usize, ray: &Vector3<f64>, hit: Option<&Hit>, scanner_from_mesh: &Isometry3<f64>) -> Seen {
        // What lies on no face of the part is another body, or material where none should be.
        let Some((face, distance_mm)) = self.faces[number] else { return Seen::Yes };
        let normal_of = |face: u32| self.nearest.mesh().scaled_normal(face as usize).normalize();
        let own = normal_of(face);
        let is_turned_away = own.dot(ray) >= 0.0;
        let Some(hit) = hit else { return if is_turned_away { Seen::No } else { Seen::Yes } };
        let met = normal_of(hit.triangle);
        let met = if met.dot(ray) > 0.0 { -met } else { met };
        let away_mm = met.dot(ray) * (1.0 - hit.share);
        let is_of_other = away_mm.abs() > OFF_MM.max(2.0 * f64::from(distance_mm));
        let is_hidden = is_of_other && (away_mm < 0.0 || is_turned_away);
        if !is_hidden {
            Seen::Yes
        } else if away_mm < 0.0 && own.dot(&met) <= OTHER_SIDE_COS {
            Seen::Perhaps(Doubt { normal: scanner_from_mesh * met, behind_mm: -away_mm })
        } else {
            Seen::No
        }
    }
}

/// Point of a cloud in a view's image.
struct Imaged {
    scanner_mm: [f32; 3],
    /// Place of its image, and depth along the camera's axis, mm.
    pixel: [f32; 2],
    depth_mm: f32,
    /// True if the point lies on no face of the part, or it is not known.
    is_foreign: bool,
}

/// Points that a view can have seen.
struct Projection<'a> {
    scanner: &'a Scanner,
    points: Vec<Imaged>,
    /// By their places in `points`.
    doubts: BTreeMap<usize, Doubt>,
    outside: usize,
}

impl<'a> Projection<'a> {
    fn new(part_mm: &[[f32; 3]], pose: &Pose<Part, ScannerFrame>, scanner: &'a Scanner, sight: Option<&Sight<'_>>) -> Self {
        let (image, scanner_from_part) = (PixelGrid::new(scanner, 1), pose.inverse());
        let imaged = |(number, point): (usize, &[f32; 3])| {
            let own = scanner_from_part.point(&Point3::from(point.map(f64::from)));
            let (pixel, depth_mm) = image.image_of(&own)?;
            let point = Imaged {
                scanner_mm: own.coords.map(|mm| mm as f32).into(),
                pixel: pixel.map(|place| place as f32),
                depth_mm: depth_mm as f32,
                is_foreign: sight.is_none_or(|sight| sight.faces[number].is_none()),
            };
            Some((number, point))
        };
        let there = || part_mm.iter().enumerate().filter(|(_, point)| !point[0].is_nan());
        let (numbers, mut points): (Vec<usize>, Vec<Imaged>) = there().filter_map(imaged).unzip();
        let outside = there().count() - points.len();
        let mut doubts = BTreeMap::new();
        if let Some(sight) = sight {
            let seen = sight.of(part_mm, &numbers, pose, &image.centre_mm());
            let mut kept = Vec::with_capacity(points.len());
            for (point, seen) in points.into_iter().zip(seen) {
                match seen {
                    Seen::No => continue,
                    Seen::Yes => {}
                    Seen::Perhaps(doubt) => {
                        doubts.insert(kept.len(), doubt);
                    }
                }
                kept.push(point);
            }
            points = kept;
        }
        Self { scanner, points, doubts, outside }
    }

    fn image(&self) -> MergedImage {
        let grid = self.grid();
        let cells: Vec<Option<usize>> = self.points.iter().map(|point| cell_in(&grid, point.pixel)).collect();
        let mut foreign_mm = vec![f32::INFINITY; grid.cells()];
        for (point, cell) in self.points.iter().zip(&cells).filter(|(point, _)| point.is_foreign) {
            if let Some(cell) = cell {
                foreign_mm[*cell] = foreign_mm[*cell].min(point.depth_mm);
            }
        }
        // The point of each cell, and how far from its middle it is imaged.
        let mut chosen: Vec<Option<(usize, f64)>> = vec![None; grid.cells()];
        for (place, (point, cell)) in self.points.iter().zip(&cells).enumerate() {
            let Some(cell) = *cell else { continue };
            let behind_mm = f64::from(point.depth_mm - foreign_mm[cell]);
            // A point that the view has surely seen goes before any other.
            let away = off_middle(&grid, point) + f64::from(u8::from(self.doubts.contains_key(&place)));
            if behind_mm <= grid.cell_mm(f64::from(point.depth_mm)) && chosen[cell].is_none_or(|(_, nearest)| away < nearest) {
                chosen[cell] = Some((place, away));
            }
        }
        let is_hidden = |cell: &usize| chosen[*cell].is_some_and(|(place, _)| self.is_hidden(place, *cell, &chosen, grid.size));
        let hidden: Vec<usize> = (0..chosen.len()).filter(is_hidden).collect();
        hidden.iter().for_each(|cell| chosen[*cell] = None);
        let point_of = |chosen: Option<(usize, f64)>| chosen.map_or([f32::NAN; 3], |(place, _)| self.points[place].scanner_mm);
        let points_mm = chosen.into_iter().map(point_of).collect();
        MergedImage { scanner_cloud: PointCloud { points_mm, grid: Some(grid.size) }, outside: self.outside }
    }

    /// Returns true if a point on the other side of a sheet lies behind points around it.
    fn is_hidden(&self, place: usize, cell: usize, chosen: &[Option<(usize, f64)>], size: CloudGrid) -> bool {
        let Some(doubt) = self.doubts.get(&place) else { return false };
        let at = |place: usize| Point3::from(self.points[place].scanner_mm.map(f64::from));
        let own = at(place);
        let (column, row) = (cell % size.columns, cell / size.columns);
        let around = |middle: usize, count: usize| middle.saturating_sub(1)..(middle + 2).min(count);
        let mut beside =
            around(row, size.rows).flat_map(|row| around(column, size.columns).map(move |column| row * size.columns + column));
        beside.any(|cell| chosen[cell].is_some_and(|(other, _)| doubt.normal.dot(&(at(other) - own)) > 0.5 * doubt.behind_mm))
    }

    /// The grid of the smallest cells that the points fill; of the largest where they fill none.
    fn grid(&self) -> PixelGrid {
        let mut grids = CELL_PIXELS.into_iter().map(|step_px| PixelGrid::new(self.scanner, step_px));
        let largest = PixelGrid::new(self.scanner, CELL_PIXELS[CELL_PIXELS.len() - 1]);
        grids.find(|grid| self.fills(grid)).unwrap_or(largest)
    }

    /// Returns true if points fill the cells of a grid, also where a single view took them.
    fn fills(&self, grid: &PixelGrid) -> bool {
        let is_occupied = occupied(self.points.iter().map(|point| point.pixel), grid);
        let count = is_occupied.iter().filter(|is_occupied| **is_occupied).count();
        fill(&is_occupied, grid) >= DENSE_SHARE && gaps(&is_occupied, grid.size) as f64 <= MAX_GAPS * count as f64
    }
}

/// Number of empty cells with occupied ones to the left and the right, or above and below.
fn gaps(is_occupied: &[bool], CloudGrid { columns, rows }: CloudGrid) -> usize {
    let is_gap = |cell: usize| {
        let (column, row) = (cell % columns, cell / columns);
        let in_row = column > 0 && column + 1 < columns && is_occupied[cell - 1] && is_occupied[cell + 1];
        let in_column = row > 0 && row + 1 < rows && is_occupied[cell - columns] && is_occupied[cell + columns];
        !is_occupied[cell] && (in_row || in_column)
    };
    (0..is_occupied.len()).filter(|cell| is_gap(*cell)).count()
}

/// Distance of a point's image from the middle of its cell, cells.
fn off_middle(grid: &PixelGrid, point: &Imaged) -> f64 {
    let [right, down] = point.pixel.map(|position| (f64::from(position) / grid.step_px).fract() - 0.5);
    right.hypot(down)
}
