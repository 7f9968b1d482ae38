//! Pictures of a page, described before they are drawn: the page is written first, with a mark in place of each picture. A [`Draft`]
//! is such a page with all that its pictures need, so it can be kept and drawn when somebody wants to see it.
//!
//! Pictures from the same camera share what is seen from there, and equal ones are drawn once. Cameras are spread over the rayon
//! pool of the caller. Memory while drawing: the model and its normals, 35 MB at most, a byte a cell and picture, and 25 MB for each
//! thread that draws (`rendering`).

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

use crate::planning::context::{Cancelled, Context};
use crate::rendering::{Camera, DrawnModel, Ink, SampledModel, Seen, Shading};

/// Encloses the number of a picture in a page. Escaped text has no such character.
const MARK: char = '\u{1}';

/// A picture to be drawn.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Picture {
    pub(super) camera: Camera,
    /// Code of the ink of each cell.
    pub(super) inks: Vec<u8>,
    /// True if inks that glow shine through what hides them.
    pub(super) through: bool,
}

/// Pictures of a part, while its page is written.
pub(super) struct Album {
    sampled: SampledModel,
    pictures: Vec<Picture>,
}

/// A page whose pictures are not drawn yet.
#[derive(Clone, Debug, PartialEq)]
pub struct Draft {
    pub(super) page: String,
    pub(super) model: DrawnModel,
    pub(super) pictures: Vec<Picture>,
}

impl Album {
    /// An album of a part.
    pub(super) fn new(sampled: SampledModel) -> Self {
        Self { sampled, pictures: Vec::new() }
    }

    /// Shape of the part.
    pub(super) fn model(&self) -> &DrawnModel {
        &self.sampled.model
    }

    /// Returns true if back faces can be visible.
    pub(super) fn is_open(&self) -> bool {
        self.sampled.model.is_open
    }

    /// Code of the ink of each cell, from that of each surface sample.
    pub(super) fn inks(&self, of_samples: &[u8]) -> Vec<u8> {
        self.sampled.inks(of_samples)
    }

    /// One ink for all cells.
    pub(super) fn plain(&self, ink: Ink) -> Vec<u8> {
        vec![ink.code(); self.sampled.model.cells()]
    }

    /// Adds a picture; the address that stands for it in the page.
    pub(super) fn add(&mut self, picture: Picture) -> String {
        let number = self.pictures.iter().position(|other| *other == picture).unwrap_or(self.pictures.len());
        if number == self.pictures.len() {
            self.pictures.push(picture);
        }
        format!("{MARK}{number}{MARK}")
    }

    /// The page and its pictures.
    pub(super) fn into_draft(self, page: String) -> Draft {
        Draft { page, model: self.sampled.model, pictures: self.pictures }
    }
}

impl Draft {
    /// Draws the pictures into the page.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn draw(&self, ctx: &Context<'_>) -> Result<String, Cancelled> {
        let shading = Shading::new(&self.model);
        let (cameras, done) = (self.by_camera(), AtomicUsize::new(0));
        let drawn = |numbers: &Vec<usize>| {
            ctx.check()?;
            let seen = Seen::new(&self.model, &self.pictures[numbers[0]].camera, ctx.simd_level());
            let uri = |number: &usize| {
                ctx.check()?;
                let picture = &self.pictures[*number];
                let uri = seen.picture(&shading, &picture.inks, picture.through).data_uri();
                ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, self.pictures.len());
                Ok((*number, uri))
            };
            numbers.iter().map(uri).collect::<Result<Vec<_>, Cancelled>>()
        };
        let drawn = cameras.par_iter().map(drawn).collect::<Result<Vec<_>, Cancelled>>()?;
        let mut uris = vec![String::new(); self.pictures.len()];
        drawn.into_iter().flatten().for_each(|(number, uri)| uris[number] = uri);
        Ok(self.with_pictures(&uris))
    }

    /// Numbers of the pictures from each camera.
    fn by_camera(&self) -> Vec<Vec<usize>> {
        let mut cameras: Vec<Vec<usize>> = Vec::new();
        for (number, picture) in self.pictures.iter().enumerate() {
            match cameras.iter_mut().find(|numbers| self.pictures[numbers[0]].camera == picture.camera) {
                Some(numbers) => numbers.push(number),
                None => cameras.push(vec![number]),
            }
        }
        cameras
    }

    fn with_pictures(&self, uris: &[String]) -> String {
        let mut page = String::with_capacity(self.page.len() + uris.iter().map(String::len).sum::<usize>());
        for (place, text) in self.page.split(MARK).enumerate() {
            // Text and numbers alternate.
            let is_number = place % 2 == 1;
            let uri = text.parse().ok().filter(|_| is_number).and_then(|number: usize| uris.get(number));
            page += uri.map_or(text, String::as_str);
        }
        page
    }
}
