//! The pace of a render: how many paths a batch may have, so that it takes a fraction of a second, by the time that
//! others took. Arithmetic without a device.
//!
//! Desktop drivers kill what runs for seconds, and nobody can stop a launch that is under way. Paths cost what the part
//! of the image costs where they begin, a sky less than the hall under it by a factor of 30. So the pace knows each
//! region of the image apart: by the batches that took it, and before them by samplings, small batches all over the
//! image whose samples are thrown away.

use std::ops::{Range, RangeInclusive};

use super::plan::{SampleRange, Tile};

/// What a region costs: as much a path as some batch.
#[derive(Debug, Clone, Copy)]
struct Cost {
    /// That the batch took.
    seconds: f64,
    /// That the batch had.
    paths: f64,
    /// Whether it was a sampling.
    sampled: bool,
}

/// Seconds a path, by region of the image.
#[derive(Debug, Clone)]
pub struct Pace {
    /// Pixels of a region.
    region: f64,
    /// What each region costs, as far as it is known.
    costs: Vec<Option<Cost>>,
    /// What batches took of what samplings made one expect: small batches take longer for their paths, and how much
    /// shows only beside larger ones.
    sampled_scale: f64,
    /// The least that a batch took, as far as it is known: launches, however few their paths.
    least_seconds: f64,
    /// Paths of the largest batch that was measured; 0 before the first.
    most_paths: u32,
}

impl Pace {
    /// Seconds that a batch is planned to take, but for the first ones, which take less.
    pub const BATCH_SECONDS: f64 = 0.2;
    /// The share of a batch's time that its paths take, at least.
    const PATHS_SHARE: f64 = 1.0 / 8.0;
    /// Paths of a batch, at least, as long as they take no more than `LONG_BATCH_SECONDS`: of fewer, the launches are
    /// what takes time on a busy machine.
    const LEAST_PATHS: f64 = 4096.0;
    const LONG_BATCH_SECONDS: f64 = 0.3;
    /// Parts of the image that have costs of their own.
    const REGIONS: usize = 256;
    /// Paths of the first batch, whatever they cost.
    const FIRST_PATHS: f64 = 1024.0;
    /// How often as many paths a batch may have as the largest one that was measured: what few paths take tells little
    /// of many.
    const GROWTH: u32 = 8;

    /// The pace of an image of that many pixels, of which nothing is known yet.
    pub fn new(pixels: u64) -> Self {
        let regions = Self::REGIONS.min(pixels as usize);
        Self {
            region: pixels as f64 / regions as f64,
            costs: vec![None; regions],
            sampled_scale: 1.0,
            least_seconds: f64::INFINITY,
            most_paths: 0,
        }
    }

    /// Notes how long a batch took.
    pub fn note(&mut self, batch: SampleRange, seconds: f64) {
        let cost = self.cost(batch, seconds, false);
        let first = u64::from(batch.first_pixel);
        let regions = self.regions(first..first + u64::from(batch.pixel_count));
        // What is left of a pass may be so small that launches are all its time.
        let is_rest = batch.paths() < self.most_paths / 64 && seconds < Self::BATCH_SECONDS / 16.0;
        if !is_rest {
            let tells = |cost: &&Cost| cost.sampled && !self.is_launches(cost);
            let sampled: Vec<_> = self.costs[regions.clone()].iter().flatten().filter(tells).collect();
            let expected = sampled.iter().map(|cost| self.a_path(cost)).sum::<f64>() / sampled.len() as f64;
            if sampled.len() == regions.clone().count() {
                // Down only halfway, as logarithms: the batch may have had the cheap part of its regions.
                let off = (self.a_path(&cost) / expected).clamp(1e-3, 1e3);
                self.sampled_scale *= off.max(off.sqrt());
            }
        }
        for region in regions {
            let keeps = |known: &Cost| is_rest && !known.sampled && self.a_path(known) < self.a_path(&cost);
            if !self.costs[region].as_ref().is_some_and(keeps) {
                self.costs[region] = Some(cost);
            }
        }
    }

    /// Notes how long a sampling took, a small batch that stands for the pixels of `place`.
    pub fn note_sampling(&mut self, batch: SampleRange, place: Range<u64>, seconds: f64) {
        let cost = self.cost(batch, seconds, true);
        let regions = self.regions(place);
        self.costs[regions].fill(Some(cost));
    }

    fn cost(&mut self, batch: SampleRange, seconds: f64, sampled: bool) -> Cost {
        self.least_seconds = self.least_seconds.min(seconds);
        self.most_paths = self.most_paths.max(batch.paths());
        Cost { seconds, paths: f64::from(batch.paths()), sampled }
    }

    /// Seconds a path. What launches take is no cost of paths, and the shortest batch tells it; but that one may have
    /// been short of paths alone.
    fn a_path(&self, cost: &Cost) -> f64 {
        let seconds = (cost.seconds - self.launches()).max(Self::PATHS_SHARE * cost.seconds) / cost.paths;
        if cost.sampled && !self.is_launches(cost) { seconds * self.sampled_scale } else { seconds }
    }

    /// Whether launches took nearly all the time, so that of paths no more is known than what they do not exceed.
    fn is_launches(&self, cost: &Cost) -> bool {
        cost.seconds - self.launches() < Self::PATHS_SHARE * cost.seconds
    }

    /// Seconds that launches take of a batch.
    fn launches(&self) -> f64 {
        self.least_seconds.min(Self::BATCH_SECONDS / 16.0)
    }

    /// The regions that those pixels lie in.
    fn regions(&self, pixels: Range<u64>) -> RangeInclusive<usize> {
        let region = |pixel: u64| ((pixel as f64 / self.region) as usize).min(self.costs.len() - 1);
        region(pixels.start)..=region(pixels.end - 1)
    }

    /// What is expected of a region where something is known of it.
    fn expected(&self) -> impl Iterator<Item = f64> {
        self.costs.iter().flatten().map(|cost| self.a_path(cost))
    }

    /// Seconds a path in the most expensive region that is known; 0 where none is.
    pub fn most_expensive(&self) -> f64 {
        self.expected().fold(0.0, f64::max)
    }

    /// Mean of the seconds a path in the regions that are known; 0 where none is.
    pub fn mean(&self) -> f64 {
        let (sum, count) = self.expected().fold((0.0, 0), |(sum, count), seconds| (sum + seconds, count + 1));
        sum / f64::from(count.max(1))
    }

    /// Paths of a batch that takes `samples` of each pixel from place `film_pixel` of a tile on, and after its last
    /// pixel of the first ones again.
    pub fn paths(&self, tile: Tile, width: u32, film_pixel: u32, samples: u32) -> u32 {
        let within = |seconds| self.paths_within(tile, width, film_pixel, samples, seconds);
        within(Self::BATCH_SECONDS).max(within(Self::LONG_BATCH_SECONDS).min(Self::LEAST_PATHS)) as u32
    }

    /// As [`Self::paths`], for a batch of up to `most_seconds`.
    pub fn paths_within(&self, tile: Tile, width: u32, film_pixel: u32, samples: u32, most_seconds: f64) -> f64 {
        let most = match self.most_paths {
            0 => return Self::FIRST_PATHS,
            paths => f64::from(paths) * f64::from(Self::GROWTH),
        };
        let unknown = self.most_expensive();
        let tile_start = f64::from(tile.first_row) * f64::from(width);
        let tile_end = tile_start + f64::from(tile.rows) * f64::from(width);
        let (mut paths, mut seconds) = (0.0, 0.0);
        let mut pixel = tile_start + f64::from(film_pixel);
        while paths < most {
            let region = ((pixel / self.region) as usize).min(self.costs.len() - 1);
            let end = ((region + 1) as f64 * self.region).min(tile_end).max(pixel + 1.0);
            let cost = self.costs[region].as_ref().map_or(unknown, |cost| self.a_path(cost));
            let more = (end - pixel) * f64::from(samples);
            if seconds + more * cost > most_seconds {
                paths += (most_seconds - seconds) / cost;
                break;
            }
            (paths, seconds) = (paths + more, seconds + more * cost);
            pixel = if end >= tile_end { tile_start } else { end };
        }
        paths.min(most)
    }

    /// Whether a batch of that many paths is small only because no larger one has been measured.
    pub fn is_growing(&self, paths: u32) -> bool {
        paths >= self.most_paths.saturating_mul(Self::GROWTH)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: u32 = 1000;
    const TILE: Tile = Tile { first_row: 0, rows: 1000 };

    fn batch(first_pixel: u32, pixel_count: u32, sample_count: u32) -> SampleRange {
        SampleRange { first_pixel, pixel_count, first_sample: 0, sample_count, film_pixel: first_pixel }
    }

    #[test]
    fn batches_grow_to_a_fraction_of_a_second() {
        let mut pace = Pace::new(1_000_000);
        // A launch takes a millisecond, a path two microseconds.
        let seconds = |paths: u32| 1e-3 + 2e-6 * f64::from(paths);
        let mut sizes = Vec::new();
        for _ in 0..9 {
            let paths = pace.paths(TILE, WIDTH, 0, 1);
            sizes.push(paths);
            assert_eq!(pace.is_growing(paths), sizes.len() <= 3, "{sizes:?}");
            pace.note(batch(0, paths, 1), seconds(paths));
        }
        assert_eq!(sizes[..3], [1024, 8192, 65_536]);
        assert!(sizes[3..].iter().all(|&paths| (80_000..130_000).contains(&paths)), "{sizes:?}");
    }

    #[test]
    fn the_first_batch_of_a_slow_scene_is_followed_by_no_longer_one() {
        for path in [1e-6, 1e-5, 1e-4, 1e-3, 1e-2] {
            let mut pace = Pace::new(1_000_000);
            for round in 0..9 {
                let paths = pace.paths(TILE, WIDTH, 0, 1);
                let seconds = 1e-3 + path * f64::from(paths.max(1));
                assert!(round == 0 || seconds < 1.2 * Pace::LONG_BATCH_SECONDS, "{paths} paths of {path} s");
                pace.note(batch(0, paths.max(1), 1), seconds);
            }
        }
    }

    #[test]
    fn expensive_regions_have_smaller_batches_than_cheap_ones() {
        let mut pace = Pace::new(1_000_000);
        pace.note(batch(0, 1, 1), 1e-9);
        pace.note(batch(0, 500_000, 1), 0.05);
        pace.note(batch(500_000, 500_000, 1), 5.0);
        let paths = |pace: &Pace, row: u32| pace.paths(TILE, WIDTH, WIDTH * row, 4);
        // Ten and one thousandth of a millisecond a path; a batch that begins in the one may end in the other.
        assert!((1_990_000..=2_020_000).contains(&paths(&pace, 0)), "{}", paths(&pace, 0));
        assert!((19_000..=20_000).contains(&paths(&pace, 500)), "{}", paths(&pace, 500));
        assert!((19_000..=24_100).contains(&paths(&pace, 499)), "{}", paths(&pace, 499));
        // After the last pixel of a tile come those of its first samples.
        let upper = Tile { first_row: 0, rows: 100 };
        assert!(pace.paths(upper, WIDTH, 0, 4) > 1_990_000);
        // The rest of a pass, short as it is, does not make a region expensive.
        pace.note(batch(0, 100, 1), 1e-2);
        assert!((1_990_000..=2_020_000).contains(&paths(&pace, 0)), "{}", paths(&pace, 0));
        // A new measurement replaces the old one of its regions only.
        pace.note(batch(500_000, 100_000, 1), 0.01);
        assert!(paths(&pace, 500) > 400_000 && paths(&pace, 650) < 20_001);
    }

    #[test]
    fn what_is_not_known_costs_as_much_as_the_most_expensive() {
        let mut pace = Pace::new(1_000_000);
        pace.note(batch(0, 1, 1), 1e-9);
        pace.note_sampling(batch(0, 1000, 1), 0..250_000, 1e-3);
        pace.note_sampling(batch(250_000, 100_000, 1), 250_000..500_000, 1.0);
        assert!((pace.most_expensive() - 1e-5).abs() < 1e-8 && (pace.mean() - 5.5e-6).abs() < 1e-7);
        assert_eq!(pace.paths(TILE, WIDTH, 600_000, 1), 20_000);
        assert!(pace.paths(TILE, WIDTH, 0, 1) > 190_000);
    }

    #[test]
    fn batches_correct_the_estimates_of_small_ones() {
        let mut pace = Pace::new(1_000_000);
        // A launch takes ten milliseconds, a path one microsecond or ten.
        let path = |pixel: u32| if pixel < 500_000 { 1e-6 } else { 1e-5 };
        let seconds = |pixel: u32, paths: u32| 1e-2 + path(pixel) * f64::from(paths);
        for place in 0..64 {
            let first = place * 15_625;
            let place = u64::from(first)..u64::from(first + 15_625);
            pace.note_sampling(batch(first, 64, 4), place, seconds(first, 256));
        }
        let (mut pixel, mut longest, mut batches) = (0, 0.0_f64, 0);
        while pixel < 1_000_000 {
            let pixels = (pace.paths(TILE, WIDTH, pixel, 4) / 4).clamp(1, 1_000_000 - pixel);
            let took = seconds(pixel, 4 * pixels);
            pace.note(batch(pixel, pixels, 4), took);
            (pixel, longest, batches) = (pixel + pixels, longest.max(took), batches + 1);
        }
        assert!(longest < 0.7 && batches < 200, "{batches} batches, the longest of {longest} s");
    }
}
