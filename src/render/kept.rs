//! What the host keeps of a render that it may have to end or go on with elsewhere, and the film as the device holds it.

use std::time::{Duration, Instant};

use glam::DVec3;
use rayon::prelude::*;

use super::plan::{Band, Taken, Tile};
use super::statistics::Statistics;
use crate::film::FilmMoments;
use crate::layout::{Control, FilmPixel};

/// Sums of rows of a tile's film, from its top, in the scene's radiance.
pub(super) fn moments<'a>(
    film: &'a [FilmPixel],
    bands: &'a [Band],
    width: u32,
    radiance_scale: f64,
) -> impl Iterator<Item = FilmMoments> + 'a {
    let (scale, mut rest) = (radiance_scale, film);
    bands.iter().map(move |band| {
        let (pixels, below) = rest.split_at((band.rows * width) as usize);
        rest = below;
        FilmMoments {
            width,
            height: band.rows,
            samples: band.samples.into(),
            sum: pixels.par_iter().map(|p| total(p.sum, p.sum_compensation, scale)).collect(),
            sum_of_squares: pixels
                .par_iter()
                .map(|p| total(p.squares, p.squares_compensation, scale * scale))
                .collect(),
        }
    })
}

/// What the host keeps of a render, so that another session can go on from there, or the render end with it, should the
/// device be lost.
#[derive(Debug)]
pub struct Kept {
    /// Time between two looks at the device's film, at least; each takes up to a hundredth of that.
    every: Duration,
    pub(super) at: Instant,
    /// Time that the last look took.
    pub(super) cost: Duration,
    /// First row of the tile under way, and the samples that it has.
    pub(super) first_row: u32,
    pub(super) taken: Taken,
    /// Its film; empty where it has no samples.
    pub(super) film: Vec<FilmPixel>,
    pub(super) control: Control,
    /// Of all tiles, with the bands of those that were handed over; `None` before the first look.
    pub(super) statistics: Option<Statistics>,
    pub(super) width: u32,
    pub(super) radiance_scale: f64,
}

impl Default for Kept {
    fn default() -> Self {
        Self::every(Self::EVERY)
    }
}

impl Kept {
    /// Time between two looks at the film where the user does not say.
    pub const EVERY: Duration = Duration::from_secs(5);

    /// Nothing so far. The film is read once in that time, or less often where a read takes more than a hundredth of it.
    pub fn every(every: Duration) -> Self {
        Self {
            every,
            at: Instant::now(),
            cost: Duration::ZERO,
            first_row: 0,
            taken: Taken::default(),
            film: Vec::new(),
            control: bytemuck::Zeroable::zeroed(),
            statistics: None,
            width: 0,
            radiance_scale: 1.0,
        }
    }

    /// Samples that were kept, over all pixels.
    pub fn sample_count(&self) -> u64 {
        self.statistics.as_ref().map_or(0, |statistics| statistics.sample_count)
    }

    pub(super) fn is_due(&self) -> bool {
        self.at.elapsed() >= self.every.max(100 * self.cost)
    }

    pub(super) fn keep(
        &mut self,
        first_row: u32,
        taken: Taken,
        film: Vec<FilmPixel>,
        control: Control,
        statistics: Statistics,
    ) {
        (self.first_row, self.taken, self.film, self.control) = (first_row, taken, film, control);
        (self.statistics, self.at) = (Some(statistics), Instant::now());
    }

    /// Ends a render with what was kept: hands the rows of the tile under way to `finished`. `None` where nothing was.
    pub fn end(self, finished: impl FnMut(FilmMoments)) -> Option<Statistics> {
        let mut statistics = self.statistics?;
        if !self.film.is_empty() {
            // The tile has as many rows as its film.
            let rows = (self.film.len() / self.width as usize) as u32;
            let bands = self.taken.bands(Tile { first_row: self.first_row, rows }, self.width);
            moments(&self.film, &bands, self.width, self.radiance_scale).for_each(finished);
            statistics.bands.extend(bands);
            statistics.rows = statistics.bands.iter().map(|band| band.rows).sum();
            statistics.samples = statistics.bands.iter().map(|band| band.samples).min().unwrap_or(0);
        }
        (statistics.rows > 0).then_some(statistics)
    }
}

/// A compensated sum, in the scene's units.
pub(super) fn total(value: [f32; 4], compensation: [f32; 4], scale: f64) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|i| (f64::from(value[i]) + f64::from(compensation[i])) / scale))
}
