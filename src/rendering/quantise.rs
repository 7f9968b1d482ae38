//! Reduction of a picture's colours to a palette of 256 by median cut (Heckbert, *Color Image Quantization for Frame Buffer
//! Display*, 1982): a picture of the part then takes a fifth of its bytes. Opacity counts as a fourth channel.
//! Cost: O(pixels + bins log bins).

use std::ops::Range;

/// Colours of a palette.
const PALETTE: usize = 256;
/// Bits kept of red, green and blue while colours are counted.
const BITS: u32 = 5;
/// Bits kept of the opacity, which has five values.
const ALPHA_BITS: u32 = 3;
/// Number of distinct colours that are counted.
const KEYS: usize = 1 << (3 * BITS + ALPHA_BITS);

/// A palette, and the palette index of each pixel.
pub(super) struct Indexed {
    /// Red, green, blue, opacity of each entry.
    pub(super) palette: Vec<[u8; 4]>,
    /// Palette index of each pixel.
    pub(super) indices: Vec<u8>,
}

/// Pixels of nearly the same colour.
struct Bin {
    key: u32,
    pixels: u64,
    sums: [u64; 4],
}

/// A run of bins that share a palette entry.
struct Cut {
    bins: Range<usize>,
    /// Priority for the next cut: the max spread of a channel times the root of its number of pixels; 0 for a single bin.
    priority: u64,
    /// Channel with that spread.
    channel: usize,
}

/// Reduces the picture to at most 256 colours.
pub(super) fn quantise(rgba: &[[u8; 4]]) -> Indexed {
    let mut bins = count(rgba);
    let mut cuts = vec![Cut::new(&bins, 0..bins.len())];
    while cuts.len() < PALETTE {
        // The first on ties, so that the result is deterministic.
        let Some(widest) = (0..cuts.len()).rev().max_by_key(|cut| cuts[*cut].priority).filter(|cut| cuts[*cut].priority > 0)
        else {
            break;
        };
        let Range { start, end } = cuts[widest].bins;
        let middle = start + halve(&mut bins[start..end], cuts[widest].channel);
        cuts[widest] = Cut::new(&bins, start..middle);
        cuts.push(Cut::new(&bins, middle..end));
    }
    let mut entry_of_key = vec![0; KEYS];
    for (entry, cut) in cuts.iter().enumerate() {
        bins[cut.bins.clone()].iter().for_each(|bin| entry_of_key[bin.key as usize] = entry as u8);
    }
    let palette = cuts.iter().map(|cut| mean(&bins[cut.bins.clone()])).collect();
    Indexed { palette, indices: rgba.iter().map(|pixel| entry_of_key[key(*pixel) as usize]).collect() }
}

impl Cut {
    fn new(all: &[Bin], range: Range<usize>) -> Self {
        let bins = &all[range.clone()];
        let weight = bins.iter().map(|bin| bin.pixels).sum::<u64>().isqrt();
        let spread = |channel: usize| {
            let means = bins.iter().map(|bin| bin.mean(channel));
            means.clone().max().unwrap_or(0) - means.min().unwrap_or(0)
        };
        let spreads = [0, 1, 2, 3].map(spread);
        let channel = (0..4).rev().max_by_key(|channel| spreads[*channel]).unwrap_or(0);
        Self { bins: range, priority: weight * spreads[channel], channel }
    }
}

impl Bin {
    fn mean(&self, channel: usize) -> u64 {
        self.sums[channel] / self.pixels
    }
}

fn key([r, g, b, a]: [u8; 4]) -> u32 {
    let rgb = [r, g, b].iter().fold(0, |key, channel| (key << BITS) | (u32::from(*channel) >> (8 - BITS)));
    (rgb << ALPHA_BITS) | (u32::from(a) >> (8 - ALPHA_BITS))
}

/// Colours that occur, in order of first occurrence.
fn count(rgba: &[[u8; 4]]) -> Vec<Bin> {
    let mut bins: Vec<Bin> = Vec::new();
    let mut bin_of_key = vec![u32::MAX; KEYS];
    // Most pixels are like the one before them, above all those beside the part.
    for run in rgba.chunk_by(|a, b| a == b) {
        let (pixel, pixels) = (run[0], run.len() as u64);
        let key = key(pixel);
        let at = &mut bin_of_key[key as usize];
        if *at == u32::MAX {
            *at = bins.len() as u32;
            bins.push(Bin { key, pixels: 0, sums: [0; 4] });
        }
        let bin = &mut bins[*at as usize];
        bin.pixels += pixels;
        (0..4).for_each(|channel| bin.sums[channel] += pixels * u64::from(pixel[channel]));
    }
    bins
}

/// Sorts the bins of a cut along a channel; returns the index that splits its pixels in halves.
fn halve(bins: &mut [Bin], channel: usize) -> usize {
    bins.sort_by_cached_key(|bin| (bin.mean(channel), bin.key));
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
