//! A finished picture and its encoding for a page: PNG, small and the same on every run.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Filter};

use super::quantise::quantise;

/// A picture with a transparent background, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Image {
    /// Width and height, pixels.
    pub(super) size_px: [usize; 2],
    /// Red, green, blue, opacity of each pixel; colours are not premultiplied.
    pub(super) rgba: Vec<[u8; 4]>,
}

impl Image {
    /// Builds a picture from the sums over the samples of each pixel: red, green, blue, and how many of `samples` were hit.
    pub(super) fn from_sums(size_px: [usize; 2], sums: &[[u16; 4]], samples: u16) -> Self {
        let pixel = |[r, g, b, hits]: &[u16; 4]| match hits {
            0 => [0; 4],
            hits => [r / hits, g / hits, b / hits, hits * 255 / samples].map(|channel| channel as u8),
        };
        Self { size_px, rgba: sums.iter().map(pixel).collect() }
    }

    /// Encodes the picture as a PNG file.
    ///
    /// # Errors
    /// None in practice: writing to memory cannot fail.
    pub(super) fn png(&self) -> Result<Vec<u8>, EncodingError> {
        let indexed = quantise(&self.rgba);
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, self.size_px[0] as u32, self.size_px[1] as u32);
        encoder.set_color(ColorType::Indexed);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_palette(indexed.palette.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect::<Vec<u8>>());
        encoder.set_trns(indexed.palette.iter().map(|[.., alpha]| *alpha).collect::<Vec<u8>>());
        encoder.set_compression(Compression::Balanced);
        encoder.set_filter(Filter::NoFilter);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&indexed.indices)?;
        writer.finish()?;
        Ok(bytes)
    }

    /// Encodes the picture as a `data:` URI.
    pub(super) fn data_uri(&self) -> String {
        self.png().map_or_else(|_| String::new(), |png| format!("data:image/png;base64,{}", STANDARD.encode(png)))
    }
}
