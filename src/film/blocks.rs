//! Sums of samples by blocks, so that parts of a render add up to the bits of the whole.
//!
//! The samples of a pixel are numbered, and a block is as many of them as `block_samples` says, a power of two, from a
//! multiple of it on. The device adds the samples of a block in their order. The totals of two blocks, or of two runs of
//! blocks, are added where they are the halves of an aligned run: 0 and 1, 2 and 3, then 0 to 1 and 2 to 3, and so on, as
//! pairwise summation does. So every sum has one way to come about, whoever rendered its parts and in which order, and an
//! error that grows by the logarithm of the blocks. What remains at the end, runs of falling length and perhaps a block
//! that is not full, is added from the first to the last.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use rayon::prelude::*;

use super::{FilmMoments, ImageMean, MeanSum};
use crate::image::{DARK, Image};
use crate::layout::FilmPixel;
use crate::parallel;

/// Pixels that a thread takes at once.
const PART: usize = 1 << 14;

/// Sums of a pixel over the samples of whole blocks, in the units of the kernels. 48 bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct PixelSums {
    /// Of radiance.
    pub sum: [f64; 3],
    /// Of squared radiance.
    pub squares: [f64; 3],
}

impl PixelSums {
    /// The sums of a pixel of the device's film.
    pub fn of(pixel: &FilmPixel) -> Self {
        let total = |value: [f32; 4], compensation: [f32; 4]| {
            std::array::from_fn(|channel| f64::from(value[channel]) + f64::from(compensation[channel]))
        };
        Self {
            sum: total(pixel.sum, pixel.sum_compensation),
            squares: total(pixel.squares, pixel.squares_compensation),
        }
    }

    /// Adds the sums of later samples.
    fn add(&mut self, later: &Self) {
        for channel in 0..3 {
            self.sum[channel] += later.sum[channel];
            self.squares[channel] += later.squares[channel];
        }
    }
}

/// Sums of the pixels of some rows, from the left and from the top.
#[derive(Debug, Clone, PartialEq)]
pub enum Sums {
    /// Over whole blocks.
    Whole(Vec<PixelSums>),
    /// Of a block that is not full, as the device holds them: it can go on from there.
    Open(Vec<FilmPixel>),
}

impl Sums {
    /// Pixels: those of the rows, or none where the sums were handed on.
    pub fn pixels(&self) -> usize {
        match self {
            Self::Whole(pixels) => pixels.len(),
            Self::Open(pixels) => pixels.len(),
        }
    }

    fn split_off(&mut self, pixel: usize) -> Self {
        match self {
            Self::Whole(pixels) => Self::Whole(pixels.split_off(pixel.min(pixels.len()))),
            Self::Open(pixels) => Self::Open(pixels.split_off(pixel.min(pixels.len()))),
        }
    }

    fn append(&mut self, below: Self) {
        match (self, below) {
            (Self::Whole(pixels), Self::Whole(below)) => pixels.extend(below),
            (Self::Open(pixels), Self::Open(below)) => pixels.extend(below),
            _ => unreachable!("runs of the same samples are of one kind"),
        }
    }

    fn whole(self) -> Vec<PixelSums> {
        match self {
            Self::Whole(pixels) => pixels,
            Self::Open(pixels) => {
                parallel::map_parts(&pixels, PART, &|_, part| part.iter().map(PixelSums::of).collect::<Vec<_>>())
                    .concat()
            }
        }
    }
}

/// A run of blocks, whose length is a power of two and whose first block is a multiple of that; or the begun part of one
/// block.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Number of the first block.
    pub first: u32,
    /// Blocks, at least 1.
    pub blocks: u32,
    /// Samples of each pixel: those of all blocks, or fewer where the run is one block that is not full.
    pub samples: u32,
    /// Sums of the pixels.
    pub sums: Sums,
}

impl Run {
    fn span(&self) -> (u32, u32, u32) {
        (self.first, self.blocks, self.samples)
    }

    fn end(&self) -> u32 {
        self.first + self.blocks
    }

    /// Whether the next run is the other half of the aligned run that this one begins.
    fn is_half_with(&self, next: &Self) -> bool {
        let whole = |run: &Self| matches!(run.sums, Sums::Whole(_));
        let aligned =
            self.blocks == next.blocks && self.end() == next.first && self.first.is_multiple_of(2 * self.blocks);
        aligned && whole(self) && whole(next)
    }
}

/// Rows of the image, one under the other, whose pixels have the same samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Strip {
    /// Number of the first row, from the top.
    pub first_row: u32,
    /// Rows, at least 1.
    pub rows: u32,
    /// What there is of them, by the number of the first block.
    pub runs: Vec<Run>,
}

impl Strip {
    /// The rows, as numbers from the top.
    pub fn range(&self) -> Range<u32> {
        self.first_row..self.first_row + self.rows
    }

    /// Samples of each pixel.
    pub fn samples(&self) -> u64 {
        self.runs.iter().map(|run| u64::from(run.samples)).sum()
    }

    /// Whether the sums were handed on by [`Film::take`], so that only what samples they had is known.
    pub fn is_taken(&self) -> bool {
        self.runs.iter().any(|run| run.sums.pixels() == 0)
    }

    /// Adds a run, and joins what has become an aligned run.
    ///
    /// A block that is not full yields to one that has more of it. Of two full runs that meet one holds all blocks of the
    /// other, for their lengths are powers of two and they are aligned.
    fn insert(&mut self, run: Run, block_samples: u32, overlap: Overlap) -> Result<(), Range<u32>> {
        let full = run.blocks * block_samples == run.samples;
        let run = if full { Run { sums: Sums::Whole(run.sums.whole()), ..run } } else { run };
        let taken = |other: &Run| other.first < run.end() && run.first < other.end();
        if let Some(place) = self.runs.iter().position(taken) {
            let other = &self.runs[place];
            let is_open = |run: &Run| matches!(run.sums, Sums::Open(_));
            match (is_open(&run), is_open(other)) {
                (true, false) => return Ok(()),
                (true, true) if run.samples <= other.samples => return Ok(()),
                (_, true) => {}
                (false, false) if overlap == Overlap::Refused => {
                    return Err(run.first.max(other.first)..run.end().min(other.end()));
                }
                (false, false) if run.blocks <= other.blocks => return Ok(()),
                (false, false) => {}
            }
            self.runs.remove(place);
            return self.insert(run, block_samples, overlap);
        }
        let mut place = self.runs.partition_point(|other| other.first < run.first);
        self.runs.insert(place, run);
        loop {
            // The later half is added to the earlier one, whichever came first.
            place = if place + 1 < self.runs.len() && self.runs[place].is_half_with(&self.runs[place + 1]) {
                place
            } else if place > 0 && self.runs[place - 1].is_half_with(&self.runs[place]) {
                place - 1
            } else {
                return Ok(());
            };
            let later = self.runs.remove(place + 1);
            let run = &mut self.runs[place];
            (run.blocks, run.samples) = (run.blocks + later.blocks, run.samples + later.samples);
            let (Sums::Whole(sums), Sums::Whole(later)) = (&mut run.sums, &later.sums) else {
                unreachable!("both are")
            };
            sums.par_iter_mut().zip(later).with_min_len(PART).for_each(|(sums, later)| sums.add(later));
        }
    }
}

/// The film of an image: what there is of its rows, by blocks of samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Samples of a block, a power of two.
    pub block_samples: u32,
    /// Kernel radiance per unit of the scene's radiance.
    pub radiance_scale: f64,
    /// All rows, from the top.
    strips: Vec<Strip>,
}

/// Samples that a pixel is to have: a part of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Missing {
    /// Number of the block.
    pub block: u32,
    /// Numbers of the first sample that is missing and of the one after the last, among all of the pixel.
    pub from: u32,
    /// As above.
    pub to: u32,
}

/// What becomes of blocks that both of two films have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overlap {
    /// They are an error: some work was done twice.
    Refused,
    /// They are taken from one of the films: a block has the same sums whoever renders it.
    Once,
}

/// Two films that have a block in common, or that are of other sizes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum MergeError {
    /// Added up, its samples would count twice.
    #[error("both have {}", block_range(.0))]
    Overlap(Range<u32>),
    /// They are not parts of one image.
    #[error("they differ in size, in the samples of a block or in the units of radiance")]
    Differ,
}

/// "block 3" or "blocks 3-7".
pub fn block_range(blocks: &Range<u32>) -> String {
    match blocks.len() {
        1 => format!("block {}", blocks.start),
        _ => format!("blocks {}-{}", blocks.start, blocks.end - 1),
    }
}

impl Film {
    /// A film without samples.
    ///
    /// # Panics
    /// When `block_samples` is no power of two.
    pub fn new(width: u32, height: u32, block_samples: u32, radiance_scale: f64) -> Self {
        assert!(block_samples.is_power_of_two(), "a block of {block_samples} samples cannot be halved");
        let strips = vec![Strip { first_row: 0, rows: height, runs: Vec::new() }];
        Self { width, height, block_samples, radiance_scale, strips }
    }

    /// Most bytes of memory that a film of so many samples of each pixel takes, up to its last block: its runs, two of which
    /// are added at a time, and a block as the device has it.
    pub fn most_bytes(width: u32, height: u32, block_samples: u32, samples: u32) -> u64 {
        let blocks = samples.div_ceil(block_samples);
        let runs = u64::from(blocks.checked_ilog2().unwrap_or(0)) + 1;
        let pixel = runs * size_of::<PixelSums>() as u64 + 2 * size_of::<FilmPixel>() as u64;
        u64::from(width) * u64::from(height) * pixel
    }

    /// A film of these strips, which a file tells.
    pub(super) fn of_strips(
        width: u32,
        height: u32,
        block_samples: u32,
        radiance_scale: f64,
        strips: Vec<Strip>,
    ) -> Self {
        Self { width, height, block_samples, radiance_scale, strips }
    }

    /// All rows, from the top, by what there is of them.
    pub fn strips(&self) -> &[Strip] {
        &self.strips
    }

    /// Samples over all pixels.
    pub fn sample_count(&self) -> u64 {
        self.strips.iter().map(|strip| strip.samples() * u64::from(strip.rows) * u64::from(self.width)).sum()
    }

    /// Most samples that a pixel has.
    pub fn most_samples(&self) -> u64 {
        self.strips.iter().map(Strip::samples).max().unwrap_or(0)
    }

    /// Samples of `wanted` that all pixels have together.
    pub fn samples_of(&self, wanted: &Range<u32>) -> u64 {
        let within = |run: &Run| {
            let first = u64::from(run.first) * u64::from(self.block_samples);
            let end = (first + u64::from(run.samples)).min(wanted.end.into());
            end.saturating_sub(first.max(wanted.start.into()))
        };
        let of =
            |strip: &Strip| strip.runs.iter().map(within).sum::<u64>() * u64::from(strip.rows) * u64::from(self.width);
        self.strips.iter().map(of).sum()
    }

    /// The rows that begin at a row and have the same samples: at most so many, and the others remain for later. `None`
    /// below the last row.
    pub fn rows_from(&mut self, first_row: u32, most: u32) -> Option<Range<u32>> {
        if most == 0 {
            return None;
        }
        self.cut(first_row);
        self.cut(first_row.saturating_add(most));
        self.strips.iter().find(|strip| strip.first_row == first_row).map(Strip::range)
    }

    /// The rows with the same samples that a row is among.
    pub fn strip(&self, row: u32) -> &Strip {
        &self.strips[self.place(row)]
    }

    fn place(&self, row: u32) -> usize {
        self.strips.partition_point(|strip| strip.first_row <= row) - 1
    }

    /// The first samples out of `wanted`, whose first one begins a block, that the rows from `first_row` on lack.
    pub fn missing(&self, first_row: u32, wanted: &Range<u32>) -> Option<Missing> {
        let size = self.block_samples;
        let mut block = wanted.start / size;
        for run in &self.strip(first_row).runs {
            if run.end() <= block {
                continue;
            }
            if run.first > block {
                break;
            }
            let end = run.first * size + run.samples;
            if run.samples < run.blocks * size {
                return (end < wanted.end).then(|| Missing {
                    block,
                    from: end,
                    to: wanted.end.min((block + 1) * size),
                });
            }
            block = run.end();
        }
        let from = block.checked_mul(size).filter(|from| *from < wanted.end)?;
        Some(Missing { block, from, to: from.saturating_add(size).min(wanted.end) })
    }

    /// What there is of a begun block in the rows from `first_row` on, as the device had it; empty where it was not begun.
    pub fn begun(&self, first_row: u32, block: u32) -> &[FilmPixel] {
        let run = self.strip(first_row).runs.iter().find(|run| run.first == block);
        match run.map(|run| &run.sums) {
            Some(Sums::Open(pixels)) => pixels,
            _ => &[],
        }
    }

    /// Puts what the device has of a block in place of the part of it that was there: rows of equal samples of the block,
    /// one under the other from `first_row` on. Rows that have all of the block keep it, since that is the same.
    pub fn put(&mut self, first_row: u32, block: u32, bands: &[(u32, u32)], pixels: Vec<FilmPixel>) {
        let (width, size) = (self.width as usize, self.block_samples);
        let mut row = first_row;
        for &(rows, samples) in bands {
            let end = row + rows;
            self.cut(row);
            self.cut(end);
            for strip in self.strips.iter_mut().filter(|strip| (row..end).contains(&strip.first_row)) {
                strip.runs.retain(|run| run.first != block || matches!(run.sums, Sums::Whole(_)));
                if samples == 0 || strip.runs.iter().any(|run| run.first <= block && block < run.end()) {
                    continue;
                }
                let first = (strip.first_row - first_row) as usize * width;
                let of_strip = first..first + strip.rows as usize * width;
                // There are none where the sums stay on the device.
                let pixels = pixels.get(of_strip).unwrap_or_default().to_vec();
                let run = Run { first: block, blocks: 1, samples, sums: Sums::Open(pixels) };
                strip.insert(run, size, Overlap::Refused).expect("the block is not there");
            }
            row = end;
        }
        self.join_within(first_row..row);
    }

    /// Takes the sums of the rows from `first_row` on out of the film, which keeps what samples they had.
    pub fn take(&mut self, first_row: u32) -> FilmMoments {
        let moments = self.moments(first_row);
        let place = self.place(first_row);
        for run in &mut self.strips[place].runs {
            run.sums = match run.sums {
                Sums::Whole(_) => Sums::Whole(Vec::new()),
                Sums::Open(_) => Sums::Open(Vec::new()),
            };
        }
        moments
    }

    /// The moments of the rows from `first_row` on that have the same samples.
    pub fn moments(&self, first_row: u32) -> FilmMoments {
        let strip = self.strip(first_row);
        let count = strip.rows as usize * self.width as usize;
        let scale = self.radiance_scale;
        let parts: Vec<[Vec<DVec3>; 2]> = parallel::map(count.div_ceil(PART), &|part| {
            let sums = (part * PART..count.min((part + 1) * PART)).map(|pixel| total(&strip.runs, pixel));
            let (sum, squares) = sums
                .map(|total| (DVec3::from_array(total.sum) / scale, DVec3::from_array(total.squares) / (scale * scale)))
                .unzip();
            [sum, squares]
        });
        let mut moments = FilmMoments {
            width: self.width,
            height: strip.rows,
            samples: strip.samples(),
            sum: Vec::with_capacity(count),
            sum_of_squares: Vec::with_capacity(count),
        };
        for [sum, squares] in parts {
            moments.sum.extend(sum);
            moments.sum_of_squares.extend(squares);
        }
        moments
    }

    /// The image: the mean of every pixel, NaN where it has no sample.
    pub fn image(&self) -> Image {
        let pixels = self.strips.iter().flat_map(|strip| self.moments(strip.first_row).mean().pixels);
        Image::new(self.width, self.height, pixels.collect())
    }

    /// The mean of the whole image, over the rows that have samples, and how well it is known.
    pub fn mean(&self) -> ImageMean {
        let mut mean = MeanSum::default();
        let lit = self.strips.iter().filter(|strip| strip.samples() > 0);
        lit.for_each(|strip| mean.add(&self.moments(strip.first_row)));
        mean.mean()
    }

    /// relMSE of the image by the difference of two halves of its samples, of which the second begins at a number: the
    /// mean over pixels and channels of (a - b)² / 4 over n² + 0.01, where a and b are the means of the halves and n that of
    /// both or, if that is less, that of the pixels around. The halves are independent, so that the square is on average what the mean of both is off by,
    /// whatever the sampler. The pixel's own mean would be no measure of it: a stray bright sample would excuse itself.
    /// `None` where a pixel has no sample in one of them, or more in one than in the other.
    pub fn error_by_halves(&self, second: u32) -> Option<f64> {
        let second = second / self.block_samples;
        let mut pixels: Vec<(DVec3, DVec3)> = Vec::with_capacity(self.width as usize * self.height as usize);
        for strip in &self.strips {
            let (first, last) = strip.runs.split_at(strip.runs.partition_point(|run| run.first < second));
            let samples = |runs: &[Run]| runs.iter().map(|run| run.samples).sum::<u32>();
            if samples(first) == 0 || samples(first) != samples(last) {
                return None;
            }
            let scale = self.radiance_scale * f64::from(samples(first));
            let mean = |runs: &[Run], pixel| DVec3::from_array(total(runs, pixel).sum) / scale;
            let of_pixel = |pixel| {
                let (a, b) = (mean(first, pixel), mean(last, pixel));
                (0.5 * (a + b), 0.25 * (a - b) * (a - b))
            };
            let count = strip.rows as usize * self.width as usize;
            let parts = parallel::map(count.div_ceil(PART), &|part| {
                (part * PART..count.min((part + 1) * PART)).map(of_pixel).collect::<Vec<_>>()
            });
            pixels.extend(parts.into_iter().flatten());
        }
        let (width, height) = (self.width as usize, self.height as usize);
        let of_row = |y: usize| {
            let of_pixel = |x: usize| {
                let (mut around, mut count) = (DVec3::ZERO, 0.0);
                for y in y.saturating_sub(1)..height.min(y + 2) {
                    for x in x.saturating_sub(1)..width.min(x + 2) {
                        around += pixels[y * width + x].0;
                        count += 1.0;
                    }
                }
                let (own, squared) = pixels[y * width + x];
                let around = if count > 1.0 { (around - own) / (count - 1.0) } else { own };
                let mean = own.min(around);
                (squared / (mean * mean + DARK)).element_sum()
            };
            (0..width).map(of_pixel).sum::<f64>()
        };
        let rows = parallel::map(height, &of_row);
        Some(rows.iter().sum::<f64>() / (3 * width * height) as f64)
    }

    /// Adds the samples of another part of the same render.
    ///
    /// # Errors
    /// Where both have a block and that is refused, or they are no parts of one image. The film is then of no use.
    pub fn merge(&mut self, part: Self, overlap: Overlap) -> Result<(), MergeError> {
        let shape = |film: &Self| (film.width, film.height, film.block_samples, film.radiance_scale.to_bits());
        if shape(self) != shape(&part) {
            return Err(MergeError::Differ);
        }
        let mut part = part;
        let rows: Vec<u32> = self.strips.iter().chain(&part.strips).map(|strip| strip.first_row).collect();
        for row in rows {
            self.cut(row);
            part.cut(row);
        }
        let size = self.block_samples;
        for (strip, other) in self.strips.iter_mut().zip(part.strips) {
            for run in other.runs {
                strip.insert(run, size, overlap).map_err(MergeError::Overlap)?;
            }
        }
        self.join();
        Ok(())
    }

    /// The blocks of samples of these numbers, whose first begins one, that some rows lack or have a part of alone, as
    /// ranges.
    pub fn gaps(&self, samples: &Range<u32>) -> Vec<Range<u32>> {
        let size = self.block_samples;
        let blocks = samples.start / size..samples.end.div_ceil(size);
        let mut gaps: Vec<Range<u32>> = Vec::new();
        for strip in &self.strips {
            let is_whole =
                |run: &&Run| run.samples >= (run.blocks * size).min(samples.end.saturating_sub(run.first * size));
            let mut next = blocks.start;
            for run in strip.runs.iter().filter(is_whole).filter(|run| run.end() > blocks.start) {
                gaps.push(next..run.first.min(blocks.end));
                next = run.end();
            }
            gaps.push(next..blocks.end);
        }
        gaps.retain(|gap| !gap.is_empty());
        gaps.sort_unstable_by_key(|gap| (gap.start, gap.end));
        gaps.dedup_by(|later, earlier| {
            let meets = later.start <= earlier.end;
            if meets {
                earlier.end = earlier.end.max(later.end);
            }
            meets
        });
        gaps
    }

    /// Makes a strip begin at a row.
    fn cut(&mut self, row: u32) {
        let place = self.strips.partition_point(|strip| strip.first_row < row);
        let Some(above) = place.checked_sub(1).map(|above| &mut self.strips[above]) else { return };
        if row >= above.first_row + above.rows {
            return;
        }
        let rows = row - above.first_row;
        let pixel = rows as usize * self.width as usize;
        let below = |run: &mut Run| {
            let (first, blocks, samples) = run.span();
            Run { first, blocks, samples, sums: run.sums.split_off(pixel) }
        };
        let runs = above.runs.iter_mut().map(below).collect();
        let strip = Strip { first_row: row, rows: above.rows - rows, runs };
        above.rows = rows;
        self.strips.insert(place, strip);
    }

    /// Joins rows that have the same samples.
    pub fn join(&mut self) {
        self.join_within(0..self.height);
    }

    /// Joins those rows that have the same samples.
    fn join_within(&mut self, rows: Range<u32>) {
        let mut joined: Vec<Strip> = Vec::with_capacity(self.strips.len());
        for strip in std::mem::take(&mut self.strips) {
            match joined.last_mut() {
                Some(above)
                    if rows.contains(&above.first_row) && rows.contains(&strip.first_row) && is_same(above, &strip) =>
                {
                    above.rows += strip.rows;
                    for (run, below) in above.runs.iter_mut().zip(strip.runs) {
                        run.sums.append(below.sums);
                    }
                }
                _ => joined.push(strip),
            }
        }
        self.strips = joined;
    }
}

/// Whether rows have the same samples, and the sums of either are here or are not.
fn is_same(above: &Strip, below: &Strip) -> bool {
    let spans = |strip: &Strip| strip.runs.iter().map(Run::span).collect::<Vec<_>>();
    spans(above) == spans(below) && above.is_taken() == below.is_taken()
}

/// The sums of a pixel over some runs, from the first to the last.
fn total(runs: &[Run], pixel: usize) -> PixelSums {
    let sums = runs.iter().map(|run| match &run.sums {
        Sums::Whole(pixels) => pixels[pixel],
        Sums::Open(pixels) => PixelSums::of(&pixels[pixel]),
    });
    let add = |mut sums: PixelSums, later: PixelSums| {
        sums.add(&later);
        sums
    };
    sums.reduce(add).unwrap_or(PixelSums::zeroed())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const WIDTH: u32 = 3;
    const HEIGHT: u32 = 5;

    /// What a device would have of a block's first samples in some rows: numbers whose sum depends on its order.
    fn device(rows: &Range<u32>, block: u32, samples: u32) -> Vec<FilmPixel> {
        let pixel = |pixel: u32| {
            let value = (((pixel * 31 + block * 17 + samples) % 23) as f32 + 0.1).exp2() * 1e-3;
            let lanes = |scale: f32| [value * scale, value * scale * 3.7, value * scale / 9.1, 0.0];
            FilmPixel {
                sum: lanes(1.0),
                sum_compensation: lanes(1e-9),
                squares: lanes(value),
                squares_compensation: lanes(1e-8),
            }
        };
        (rows.start * WIDTH..rows.end * WIDTH).map(|place| pixel(place % 7)).collect()
    }

    /// The film of all blocks, taken in order.
    fn whole(samples: u32, size: u32) -> Film {
        let mut film = Film::new(WIDTH, HEIGHT, size, 0.5);
        while let Some(Missing { block, from, to }) = film.missing(0, &(0..samples)) {
            let taken = to - block * size;
            assert_eq!(from, block * size);
            film.put(0, block, &[(HEIGHT, taken)], device(&(0..HEIGHT), block, taken));
        }
        film
    }

    proptest! {
        #[test]
        fn any_parts_in_any_order_add_up_to_the_same_bits(
            samples in 1..200_u32, log_size in 0..5_u32,
            owners in prop::collection::vec(0..4_usize, 200), order in Just([0, 1, 2, 3]).prop_shuffle(),
            rows in prop::collection::vec(1..4_u32, 5), saved in 0..200_u32,
        ) {
            let size = 1 << log_size;
            let blocks = samples.div_ceil(size);
            let mut parts = vec![Film::new(WIDTH, HEIGHT, size, 0.5); 4];
            for block in 0..blocks {
                let part = &mut parts[owners[block as usize]];
                let most = size.min(samples - block * size);
                // In strips, of which some were looked at before they were full.
                let mut row = 0;
                for rows in rows.iter().copied().cycle() {
                    let rows = row..HEIGHT.min(row + rows);
                    if rows.is_empty() {
                        break;
                    }
                    let some = saved % most;
                    let ahead = rows.len() as u32 / 2;
                    let looks = [[(ahead, most), (rows.len() as u32 - ahead, some)], [(0, 0), (rows.len() as u32, most)]];
                    for bands in looks {
                        let mut pixels = Vec::new();
                        let mut first = rows.start;
                        for (count, taken) in bands {
                            pixels.extend(device(&(first..first + count), block, taken));
                            first += count;
                        }
                        part.put(rows.start, block, &bands, pixels);
                    }
                    row = rows.end;
                }
                part.join();
            }
            let mut merged = Film::new(WIDTH, HEIGHT, size, 0.5);
            for number in order {
                merged.merge(parts[number].clone(), Overlap::Refused).expect("each block has one owner");
            }
            let whole = whole(samples, size);
            prop_assert!(merged.gaps(&(0..samples)).is_empty());
            prop_assert_eq!(merged.samples_of(&(0..samples)), u64::from(samples * WIDTH * HEIGHT));
            prop_assert_eq!(&merged, &whole);
            // A part twice is refused, and once with the other rule.
            if parts[0].sample_count() > 0 && parts[0].strips()[0].runs.iter().any(|run| run.samples == run.blocks * size) {
                prop_assert!(merged.clone().merge(parts[0].clone(), Overlap::Refused).is_err());
            }
            merged.merge(parts[0].clone(), Overlap::Once).expect("it counts once");
            prop_assert_eq!(merged, whole);
        }

        #[test]
        fn gaps_are_the_blocks_that_nobody_has(samples in 1..200_u32, has in prop::collection::vec(any::<bool>(), 200)) {
            let size = 8;
            let mut film = Film::new(WIDTH, HEIGHT, size, 1.0);
            let blocks = samples.div_ceil(size);
            for block in (0..blocks).filter(|block| has[*block as usize]) {
                let taken = size.min(samples - block * size);
                film.put(0, block, &[(HEIGHT, taken)], device(&(0..HEIGHT), block, taken));
            }
            let gaps = film.gaps(&(0..samples));
            for block in 0..blocks {
                let is_gap = gaps.iter().any(|gap| gap.contains(&block));
                prop_assert_eq!(is_gap, !has[block as usize], "block {} of {:?}", block, gaps);
            }
        }
    }

    #[test]
    fn a_long_sum_keeps_its_digits() {
        // So many that a running sum in f32 would stop to grow.
        const BLOCKS: u32 = 1 << 14;
        let mut film = Film::new(1, 1, 1 << 10, 1.0);
        let value = 0.1_f32 * 1024.0;
        for block in 0..BLOCKS {
            let pixel = FilmPixel { sum: [value; 4], ..FilmPixel::zeroed() };
            film.put(0, block, &[(1, 1 << 10)], vec![pixel]);
        }
        let moments = film.moments(0);
        assert_eq!((moments.samples, film.strips()[0].runs.len()), (1 << 24, 1));
        assert_eq!(moments.sum[0].x, f64::from(value) * f64::from(BLOCKS));
    }
}
