//! Images of a merged cloud in the views of a plan. The cloud does not tell which view took a point, so that each view gets the points that
//! it can have seen where the part lies: not those that lie on a face of the part which is turned away from the camera, or which hides
//! behind another one. The points of all other surfaces would show through between those before them.
//!
//! A point lies on another face than the one that its ray meets if it is twice as near to it. The other side of a sheet explains a dent as
//! well, and what lies on no face behind the part may be missing material: such points are hidden only where points around them lie
//! before them. In a cell, the points of the layer nearest to the camera count. Where the part lies is found by images of all points.
//!
//! The cells are the smallest that the points fill, also where a single view took them. Each keeps the point that is imaged nearest to its
//! middle: the nearest in depth would be one with a large error, or of a rim.
//!
//! Memory: 12 bytes a point beside the cloud, and some 40 bytes a point for each view that is made at a time. Cost: a ray a point and view,
//! and a search for the nearest face a point.

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use super::IngestWorld;
use super::clean::{CleanOptions, PlateCut, Removed, clean};
use super::frames::PlannedCapture;
use super::organise::{CELL_PIXELS, DENSE_SHARE, cell_in, fill, occupied};
use crate::cell::Scanner;
use crate::geometry::{CloudGrid, Hit, Mesh, Part, Plate, PointCloud, Pose, RayScene, SimdLevel, parallel};
use crate::inspection::registration::{RegistrationOptions, register};
use crate::inspection::{PixelGrid, ViewScan};
use crate::planning::context::{Cancelled, Context};

/// Max empty cells between two occupied ones, as a share of the occupied ones: with more, a part of the surface has its points farther
/// apart than the cells. Not from a source.
const MAX_GAPS: f64 = 0.03;
/// Distance from the surface that a ray meets up to which a point is taken to be of it, mm: some times the noise of a scanner.
const OFF_MM: f64 = 0.1;
/// Difference of the heights of points of one layer, mm.
const LAYER_MM: f32 = 0.3;
/// Distance within which a face explains a point, mm.
const REACH_MM: f64 = 1.0;
/// Max thickness of a sheet, mm.
const SHEET_MM: f64 = 5.0;
/// Depth below a plate's face to which points are taken to be of the plate, mm.
const BELOW_PLATE_MM: f64 = 5.0;
/// Largest cosine between the normals of the two sides of a sheet: cos 150°.
const OTHER_SIDE_COS: f64 = -0.866;
/// Points that are judged at a time.
const BLOCK: usize = 4096;
/// Index that stands for no face, or for no cell.
const NONE: u32 = u32::MAX;

/// Image of a merged cloud in one view.
pub(in crate::inspection) struct MergedImage {
    /// Points in the scanner's frame, by cells of the left camera's image.
    pub(in crate::inspection) scanner_cloud: PointCloud,
    /// Points outside of the image.
    pub(in crate::inspection) outside: usize,
}

/// Makes the images of a cloud in the part's frame, in each view of the world.
///
/// # Errors
/// [`Cancelled`].
pub(in crate::inspection) fn merged_images(
    part_mm: &[[f32; 3]],
    world: &IngestWorld<'_>,
    options: &CleanOptions,
    ctx: &Context<'_>,
) -> Result<Vec<MergedImage>, Cancelled> {
    let images = |sight: Option<&Sight<'_>>| -> Result<Vec<MergedImage>, Cancelled> {
        let image = |capture: &PlannedCapture| Ok(Projection::new(part_mm, capture, (world, sight), ctx)?.image());
        world.captures.par_iter().map(image).collect()
    };
    let scan = |(image, capture): (MergedImage, &PlannedCapture)| ViewScan {
        viewpoint: capture.viewpoint,
        part_from_scanner: capture.part_from_scanner,
        scanner_cloud: clean(image.scanner_cloud, capture, world, options, &mut Removed::default()),
    };
    let registered = {
        let scans: Vec<ViewScan> = images(None)?.into_iter().zip(world.captures).map(scan).collect();
        ctx.check()?;
        register(&scans, world.nearest, &[], &RegistrationOptions { moves_views: false, ..RegistrationOptions::default() })
    };
    let is_found = registered.not_found().is_none();
    let mesh_from_stated = if is_found { registered.mesh_from_stated } else { Pose::identity() };
    images(Some(&Sight::new(part_mm, world, options, *mesh_from_stated.isometry(), ctx)?))
}

/// Face or body that explains a point.
#[derive(Clone, Copy)]
enum Explained {
    /// A face within [`REACH_MM`], and its distance, mm.
    Face(u32, f32),
    /// Neither a face nor a plate.
    Nothing,
    /// The plate of a setup, and no face.
    Plate,
}

/// The part where it lies, and what explains each point.
struct Sight<'a> {
    mesh: &'a Mesh,
    scene: RayScene,
    mesh_from_stated: Isometry3<f64>,
    explained: Vec<Explained>,
}

impl<'a> Sight<'a> {
    fn new(
        part_mm: &[[f32; 3]],
        world: &IngestWorld<'a>,
        options: &CleanOptions,
        mesh_from_stated: Isometry3<f64>,
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let mut places: Vec<Pose<Part, Plate>> = Vec::new();
        for place in world.captures.iter().filter_map(|capture| capture.part_from_plate) {
            if !places.contains(&place) {
                places.push(place);
            }
        }
        let cut = |place: &Pose<Part, Plate>| (place.inverse(), PlateCut::new(world.nearest, *place, options.plate_mm));
        let cuts: Vec<_> = places.iter().map(cut).collect();
        let explain = |point: &[f32; 3]| {
            let stated = Point3::from(point.map(f64::from));
            let at = mesh_from_stated * stated;
            if let Some(found) = world.nearest.nearest(&at, REACH_MM) {
                return Explained::Face(found.face, (found.point_mm - at).norm() as f32);
            }
            let is_of_plate = cuts.iter().any(|(plate_from_part, cut)| {
                let in_plate = plate_from_part.point(&stated);
                in_plate.z > -BELOW_PLATE_MM && cut.takes(&in_plate)
            });
            if is_of_plate { Explained::Plate } else { Explained::Nothing }
        };
        let blocks = parallel::try_map_chunks(part_mm, BLOCK, |block| {
            ctx.check()?;
            let of_point = |point: &[f32; 3]| if point[0].is_nan() { Explained::Nothing } else { explain(point) };
            Ok::<_, Cancelled>(block.iter().map(of_point).collect::<Vec<_>>())
        })?;
        let mesh = world.nearest.mesh();
        Ok(Self { mesh, scene: RayScene::new([mesh]), mesh_from_stated, explained: blocks.concat() })
    }

    fn normal(&self, face: u32) -> Vector3<f64> {
        self.mesh.scaled_normal(face as usize).normalize()
    }

    /// Judges a point by the ray to it: false where the view cannot have seen it.
    fn judge(&self, number: usize, ray: &Vector3<f64>, hit: Option<&Hit>, point: &mut Imaged) -> bool {
        let explained = self.explained[number];
        if matches!(explained, Explained::Plate) {
            return false;
        }
        let own = match explained {
            Explained::Face(face, distance_mm) => Some((self.normal(face), f64::from(distance_mm))),
            Explained::Nothing | Explained::Plate => None,
        };
        let is_turned_away = own.is_some_and(|(own, _)| own.dot(ray) >= 0.0);
        let Some(hit) = hit else { return !is_turned_away };
        let met = facing(self.normal(hit.triangle), ray);
        let height_mm = met.dot(ray) * (1.0 - hit.share);
        let Some((own, distance_mm)) = own else {
            // What lies on no face is another body before the part, or material that is missing.
            point.height_mm = height_mm as f32;
            point.doubt = if height_mm < -REACH_MM { hit.triangle } else { NONE };
            return true;
        };
        if (-SHEET_MM..-OFF_MM).contains(&height_mm) && own.dot(&met) <= OTHER_SIDE_COS {
            (point.height_mm, point.doubt) = (height_mm as f32, hit.triangle);
            return distance_mm > OFF_MM;
        }
        let is_of_other = height_mm.abs() > OFF_MM.max(2.0 * distance_mm);
        // The rim of a face before the one that the ray meets is neither before nor behind that.
        point.height_mm = if is_of_other { 0.0 } else { height_mm as f32 };
        !(is_of_other && (height_mm < 0.0 || is_turned_away))
    }
}

/// The normal of a surface that a ray meets, on the side that it comes from.
fn facing(normal: Vector3<f64>, ray: &Vector3<f64>) -> Vector3<f64> {
    if normal.dot(ray) > 0.0 { -normal } else { normal }
}

/// Point of a cloud in a view's image.
#[derive(Clone, Copy)]
struct Imaged {
    scanner_mm: [f32; 3],
    /// Place of its image.
    pixel: [f32; 2],
    /// Height over the surface that its ray meets, mm; where the part's place is not known, the depth with its sign changed.
    height_mm: f32,
    /// Face that its ray meets, if it is hidden where points around it lie before it; else [`NONE`].
    doubt: u32,
}

/// Points that a view can have seen.
struct Projection<'a> {
    scanner: &'a Scanner,
    sight: Option<&'a Sight<'a>>,
    /// Turns directions in the mesh's frame into the scanner's.
    scanner_from_mesh: Isometry3<f64>,
    /// Optical centre, scanner frame.
    eye_mm: Point3<f64>,
    points: Vec<Imaged>,
    outside: usize,
}

impl<'a> Projection<'a> {
    fn new(
        part_mm: &[[f32; 3]],
        capture: &PlannedCapture,
        (world, sight): (&'a IngestWorld<'a>, Option<&'a Sight<'a>>),
        ctx: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let image = PixelGrid::new(world.scanner, 1);
        let scanner_from_part = capture.part_from_scanner.inverse();
        let mesh_from_stated = sight.map_or_else(Isometry3::identity, |sight| sight.mesh_from_stated);
        let scanner_from_mesh = (mesh_from_stated * capture.part_from_scanner.isometry()).inverse();
        let eye_mm = image.centre_mm();
        let mut projection = Self { scanner: world.scanner, sight, scanner_from_mesh, eye_mm, points: Vec::new(), outside: 0 };
        for (number, block) in part_mm.chunks(BLOCK).enumerate() {
            ctx.check()?;
            let mut points = Vec::with_capacity(block.len());
            for (place, point) in block.iter().enumerate().filter(|(_, point)| !point[0].is_nan()) {
                let own = scanner_from_part.point(&Point3::from(point.map(f64::from)));
                let Some((pixel, depth_mm)) = image.image_of(&own) else {
                    projection.outside += 1;
                    continue;
                };
                let scanner_mm = own.coords.map(|mm| mm as f32).into();
                let (pixel, height_mm) = (pixel.map(|place| place as f32), -depth_mm as f32);
                points.push((number * BLOCK + place, Imaged { scanner_mm, pixel, height_mm, doubt: NONE }));
            }
            projection.add(points);
        }
        Ok(projection)
    }

    /// Adds those of some points, with their numbers, that the view can have seen.
    fn add(&mut self, mut points: Vec<(usize, Imaged)>) {
        if let Some(sight) = self.sight {
            let mesh_from_scanner = self.scanner_from_mesh.inverse();
            let ray =
                |(_, point): &(usize, Imaged)| mesh_from_scanner * (Point3::from(point.scanner_mm.map(f64::from)) - self.eye_mm);
            let rays: Vec<Vector3<f64>> = points.iter().map(ray).collect();
            let mut hits: Vec<Option<Hit>> = Vec::new();
            sight.scene.first_hits_from(SimdLevel::widest(), &(mesh_from_scanner * self.eye_mm), &rays, &mut hits);
            let mut judged = rays.iter().zip(&hits);
            points.retain_mut(|(number, point)| {
                judged.next().is_some_and(|(ray, hit)| sight.judge(*number, ray, hit.as_ref(), point))
            });
        }
        self.points.extend(points.into_iter().map(|(_, point)| point));
    }

    fn image(&self) -> MergedImage {
        let grid = self.grid();
        let cells: Vec<u32> =
            self.points.iter().map(|point| cell_in(&grid, point.pixel).map_or(NONE, |cell| cell as u32)).collect();
        let imaged =
            || self.points.iter().zip(&cells).filter(|(_, cell)| **cell != NONE).map(|(point, cell)| (point, *cell as usize));
        let mut highest_mm = vec![f32::NEG_INFINITY; grid.cells()];
        imaged().for_each(|(point, cell)| highest_mm[cell] = highest_mm[cell].max(point.height_mm));
        // The point of each cell, and how far from its middle it is imaged, after all that are surely seen.
        let mut chosen: Vec<Option<(&Imaged, f64)>> = vec![None; grid.cells()];
        for (point, cell) in imaged().filter(|(point, cell)| point.height_mm >= highest_mm[*cell] - LAYER_MM) {
            let away = off_middle(&grid, point) + f64::from(u8::from(point.doubt != NONE));
            if chosen[cell].is_none_or(|(_, nearest)| away < nearest) {
                chosen[cell] = Some((point, away));
            }
        }
        let is_hidden = |cell: &usize| chosen[*cell].is_some_and(|(point, _)| self.is_hidden(point, *cell, &chosen, grid.size));
        let hidden: Vec<usize> = (0..chosen.len()).filter(is_hidden).collect();
        hidden.iter().for_each(|cell| chosen[*cell] = None);
        let points_mm = chosen.into_iter().map(|chosen| chosen.map_or([f32::NAN; 3], |(point, _)| point.scanner_mm)).collect();
        MergedImage { scanner_cloud: PointCloud { points_mm, grid: Some(grid.size) }, outside: self.outside }
    }

    /// Returns true if a doubtful point lies behind points around it.
    fn is_hidden(&self, point: &Imaged, cell: usize, chosen: &[Option<(&Imaged, f64)>], size: CloudGrid) -> bool {
        let Some(sight) = self.sight.filter(|_| point.doubt != NONE) else { return false };
        let at = |point: &Imaged| Point3::from(point.scanner_mm.map(f64::from));
        let own = at(point);
        let normal = facing(self.scanner_from_mesh * sight.normal(point.doubt), &(own - self.eye_mm));
        let behind_mm = -f64::from(point.height_mm);
        let (column, row) = (cell % size.columns, cell / size.columns);
        let around = |middle: usize, count: usize| middle.saturating_sub(1)..(middle + 2).min(count);
        let mut beside =
            around(row, size.rows).flat_map(|row| around(column, size.columns).map(move |column| row * size.columns + column));
        beside.any(|cell| chosen[cell].is_some_and(|(other, _)| normal.dot(&(at(other) - own)) > 0.5 * behind_mm))
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
