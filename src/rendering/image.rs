//! A finished picture and its encoding for a page: PNG, small and the same on every run.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use png::{BitDepth, ColorType, DeflateCompression, Encoder, EncodingError, Filter};

use super::quantise::quantise;

/// Compression of the pictures: below zlib's default of 6, as pictures of few colours compress well at any level.
const LEVEL: DeflateCompression = DeflateCompression::Level(3);

/// A picture with a transparent background, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// Red, green, blue, opacity of each pixel; colours are not premultiplied.
    pub rgba: Vec<[u8; 4]>,
}

impl Image {
    /// Encodes the picture as a PNG file.
    ///
    /// # Errors
    /// Never in practice: writing to memory cannot fail.
    pub fn png(&self) -> Result<Vec<u8>, EncodingError> {
        let indexed = quantise(&self.rgba);
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, self.size_px[0] as u32, self.size_px[1] as u32);
        encoder.set_color(ColorType::Indexed);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_palette(indexed.palette.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect::<Vec<u8>>());
        encoder.set_trns(indexed.palette.iter().map(|[.., alpha]| *alpha).collect::<Vec<u8>>());
        encoder.set_deflate_compression(LEVEL);
        encoder.set_filter(Filter::NoFilter);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&indexed.indices)?;
        writer.finish()?;
        Ok(bytes)
    }

    /// Encodes the picture as a `data:` URI.
    pub fn data_uri(&self) -> String {
        self.png().map_or_else(|_| String::new(), |png| format!("data:image/png;base64,{}", STANDARD.encode(png)))
    }
}
