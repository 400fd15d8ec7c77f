//! What the host keeps of a render that it may have to end or go on with elsewhere.

use std::ops::Range;
use std::time::{Duration, Instant};

use super::plan::{Band, Taken, Tile};
use super::statistics::Statistics;
use crate::film::{Film, FilmMoments};
use crate::layout::FilmPixel;

/// What the host keeps of a render, so that another session can go on from there, or the render end with it, should the
/// device be lost.
#[derive(Debug)]
pub struct Kept {
    /// Time between two looks at the device's film, at least; each takes up to a hundredth of that.
    every: Duration,
    pub(super) at: Instant,
    /// Time that the last look took.
    pub(super) cost: Duration,
    /// `None` until a session has begun with it.
    film: Option<Film>,
    /// Of all samples in the film; `None` before the first look.
    pub(super) statistics: Option<Statistics>,
}

impl Default for Kept {
    fn default() -> Self {
        Self::every(Self::EVERY)
    }
}

impl Kept {
    /// Time between two looks at the film where the user does not say.
    pub const EVERY: Duration = Duration::from_secs(5);

    /// Nothing so far. The film is read once in that time, or less often where a read, and what the caller does with what
    /// was read, takes more than a hundredth of it.
    pub fn every(every: Duration) -> Self {
        Self { every, at: Instant::now(), cost: Duration::ZERO, film: None, statistics: None }
    }

    /// The film that an earlier render has left, to go on with.
    pub fn with_film(self, film: Film) -> Self {
        Self { film: Some(film), ..self }
    }

    /// What there is of the image; `None` where no render has begun.
    pub fn film(&self) -> Option<&Film> {
        self.film.as_ref()
    }

    /// What it has cost; `None` before the first look at the device's film.
    pub fn statistics(&self) -> Option<&Statistics> {
        self.statistics.as_ref()
    }

    /// Samples that were kept, over all pixels.
    pub fn sample_count(&self) -> u64 {
        self.film.as_ref().map_or(0, Film::sample_count)
    }

    pub(super) fn is_due(&self) -> bool {
        self.at.elapsed() >= self.every.max(100 * self.cost)
    }

    /// The film, which begins as `empty` where there is none.
    pub(super) fn begin(&mut self, empty: impl FnOnce() -> Film) -> &mut Film {
        self.at = Instant::now();
        self.film.get_or_insert_with(empty)
    }

    /// The film of a render that has begun.
    pub(super) fn film_mut(&mut self) -> &mut Film {
        self.film.as_mut().expect("the render has begun")
    }

    /// Takes down what the device has of a block in a tile.
    pub(super) fn put(&mut self, tile: Tile, block: u32, taken: Taken, pixels: Vec<FilmPixel>) {
        let film = self.film_mut();
        let first = block * film.block_samples;
        let bands: Vec<_> =
            taken.rows(tile, film.width).map(|(rows, samples)| (rows, samples.saturating_sub(first))).collect();
        film.put(tile.first_row, block, &bands, pixels);
    }

    pub(super) fn keep(&mut self, statistics: Statistics) {
        self.statistics = Some(Statistics { bands: self.bands(), ..statistics }.told());
        self.at = Instant::now();
    }

    /// The rows that have samples, from the top, by their samples.
    fn bands(&self) -> Vec<Band> {
        let mut bands: Vec<Band> = Vec::new();
        for strip in self.film.iter().flat_map(Film::strips).filter(|strip| strip.samples() > 0) {
            match bands.last_mut() {
                Some(band) if u64::from(band.samples) == strip.samples() => band.rows += strip.rows,
                _ => bands.push(Band { rows: strip.rows, samples: strip.samples() as u32 }),
            }
        }
        bands
    }

    /// Takes the sums of those rows out of the film, where they have samples and are still there.
    pub(super) fn hand_over(&mut self, rows: Range<u32>, finished: &mut impl FnMut(FilmMoments)) {
        let film = self.film_mut();
        let mut row = rows.start;
        while let Some(same) = film.rows_from(row, rows.end.saturating_sub(row)) {
            let strip = film.strip(row);
            if strip.samples() > 0 && !strip.is_taken() {
                finished(film.take(row));
            }
            row = same.end;
        }
    }

    /// Ends a render with what was kept: hands all rows that were not handed over to `finished`. `None` where nothing was
    /// kept.
    pub fn end(mut self, mut finished: impl FnMut(FilmMoments)) -> Option<Statistics> {
        let statistics = self.statistics.take()?;
        let height = self.film.as_ref()?.height;
        self.hand_over(0..height, &mut finished);
        (statistics.rows > 0).then_some(statistics)
    }
}
