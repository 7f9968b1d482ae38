//! A picture's colours brought down to a palette of 256, by median cut (Heckbert, *Color Image Quantization for Frame
//! Buffer Display*, 1982): a picture of the part then takes a fifth of its bytes. Opacity counts as a fourth channel.
//! Cost: O(pixels + bins log bins).

use std::ops::Range;

/// Colours of a palette.
const PALETTE: usize = 256;
/// Bits kept of red, green and blue while colours are counted.
const BITS: u32 = 5;
/// Bits kept of the opacity, which has five values.
const ALPHA_BITS: u32 = 3;

/// A palette, and for each pixel its entry.
pub(super) struct Indexed {
    /// Red, green, blue, opacity.
    pub(super) palette: Vec<[u8; 4]>,
    /// One a pixel.
    pub(super) indices: Vec<u8>,
}

/// Pixels of nearly the same colour.
#[derive(Clone, Default)]
struct Bin {
    key: u32,
    pixels: u64,
    sums: [u64; 4],
}

impl Bin {
    fn mean(&self, channel: usize) -> u64 {
        self.sums[channel] / self.pixels
    }
}

/// The picture with at most 256 colours.
pub(super) fn quantise(rgba: &[[u8; 4]]) -> Indexed {
    let mut bins = count(rgba);
    let mut boxes: Vec<Range<usize>> = std::iter::once(0..bins.len()).collect();
    while boxes.len() < PALETTE {
        let Some((widest, channel)) = widest(&bins, &boxes) else { break };
        let cut = boxes[widest].clone();
        let middle = cut.start + halve(&mut bins[cut.clone()], channel);
        boxes[widest] = cut.start..middle;
        boxes.push(middle..cut.end);
    }
    let mut entry_of_key = vec![0; 1 << (3 * BITS + ALPHA_BITS)];
    for (entry, range) in boxes.iter().enumerate() {
        bins[range.clone()].iter().for_each(|bin| entry_of_key[bin.key as usize] = entry as u8);
    }
    Indexed {
        palette: boxes.iter().map(|range| mean(&bins[range.clone()])).collect(),
        indices: rgba.iter().map(|pixel| entry_of_key[key(*pixel) as usize]).collect(),
    }
}

fn key([r, g, b, a]: [u8; 4]) -> u32 {
    let rgb = [r, g, b].iter().fold(0, |key, channel| (key << BITS) | (u32::from(*channel) >> (8 - BITS)));
    (rgb << ALPHA_BITS) | (u32::from(a) >> (8 - ALPHA_BITS))
}

/// The bins that have pixels, by key.
fn count(rgba: &[[u8; 4]]) -> Vec<Bin> {
    let mut bins = vec![Bin::default(); 1 << (3 * BITS + ALPHA_BITS)];
    for pixel in rgba {
        let key = key(*pixel);
        let bin = &mut bins[key as usize];
        bin.key = key;
        bin.pixels += 1;
        (0..4).for_each(|channel| bin.sums[channel] += u64::from(pixel[channel]));
    }
    bins.retain(|bin| bin.pixels > 0);
    bins
}

/// The box with the largest spread of any channel, weighted by the root of its pixels, and that channel; the first of
/// equals.
fn widest(bins: &[Bin], boxes: &[Range<usize>]) -> Option<(usize, usize)> {
    let mut best = (0, None);
    for (number, range) in boxes.iter().enumerate().filter(|(_, range)| range.len() > 1) {
        let weight = bins[range.clone()].iter().map(|bin| bin.pixels).sum::<u64>().isqrt();
        for channel in 0..4 {
            let worth = weight * spread(&bins[range.clone()], channel);
            if worth > best.0 {
                best = (worth, Some((number, channel)));
            }
        }
    }
    best.1
}

fn spread(bins: &[Bin], channel: usize) -> u64 {
    let means = bins.iter().map(|bin| bin.mean(channel));
    means.clone().max().unwrap_or(0) - means.min().unwrap_or(0)
}

/// Sorts a box along a channel and says where half of its pixels are on each side.
fn halve(bins: &mut [Bin], channel: usize) -> usize {
    bins.sort_by_key(|bin| (bin.mean(channel), bin.key));
    let half = bins.iter().map(|bin| bin.pixels).sum::<u64>() / 2;
    let mut before = 0;
    let middle = bins.iter().position(|bin| {
        before += bin.pixels;
        before > half
    });
    middle.unwrap_or(0).clamp(1, bins.len() - 1)
}

fn mean(bins: &[Bin]) -> [u8; 4] {
    let pixels: u64 = bins.iter().map(|bin| bin.pixels).sum();
    [0, 1, 2, 3].map(|channel| (bins.iter().map(|bin| bin.sums[channel]).sum::<u64>() / pixels.max(1)) as u8)
}
