//! Sizes, capacities, workgroup counts and batches of a render: arithmetic without a device.

use super::defaults::Defaults;
use crate::layout;
use crate::settings::{Scheduler, Settings};

/// What a plan must know of a device.
#[derive(Debug, Clone, Copy)]
pub struct DeviceLimits {
    /// Most invocations of a workgroup.
    pub max_workgroup_size: u32,
    /// Most workgroups of a dispatch.
    pub max_workgroups: u32,
    /// Most bytes of a storage buffer.
    pub max_storage_buffer_bytes: u64,
    /// Most bytes of film that it is to hold at once; a larger one is rendered by tiles.
    pub max_film_bytes: u64,
}

/// What kernels take of a scene in loops: levels of its trees.
#[derive(Debug, Clone, Copy, Default)]
pub struct SceneLevels {
    /// Of the BVH; 0 if it is a list.
    pub bvh: u32,
    /// Nodes and triangles of the BVH that a random ray meets, by its SAH; 0 if it is a list.
    pub bvh_tests: u32,
    /// Of the halves that a texel of the environment is found by; 0 without an image.
    pub sky: u32,
    /// Whether the BVH has two: a tree over meshes in their places, and one of each mesh.
    pub two_levels: bool,
}

/// What a plan must know of a scene.
#[derive(Debug, Clone, Copy, Default)]
pub struct SceneDemands {
    /// What kernels take of it in loops.
    pub levels: SceneLevels,
    /// Bytes of the stack of a traversal, beyond registers.
    pub stack_bytes: u64,
    /// Bytes of all records of a path in flight, its stack included.
    pub state_bytes: u64,
}

/// Sizes of a render.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plan {
    /// Width of the image in pixels.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Rows of a tile, the part of the image whose film the device holds at once. All of them where
    /// that fits.
    pub tile_rows: u32,
    /// Path slots: the most paths in flight.
    pub path_capacity: u32,
    /// Invocations of a workgroup.
    pub workgroup_size: u32,
    /// Paths that an invocation follows one after the other: 1 but for the megakernel.
    pub paths_per_invocation: u32,
}

/// A part of the image: whole rows, one under the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tile {
    /// Number of the first row, from the top.
    pub first_row: u32,
    /// Rows, at least 1.
    pub rows: u32,
}

/// Pixels and samples of one batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SampleRange {
    /// First pixel, in rows from the top left.
    pub first_pixel: u32,
    /// Pixels, at least 1.
    pub pixel_count: u32,
    /// Number of the first sample.
    pub first_sample: u32,
    /// Samples of each pixel, at least 1.
    pub sample_count: u32,
    /// Place of the first pixel in its tile.
    pub film_pixel: u32,
}

/// Samples that the pixels of a tile have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Taken {
    /// Samples of every pixel.
    pub samples: u32,
    /// Samples that the pass under way adds to each pixel; 0 between passes.
    pub more: u32,
    /// Pixels, from the tile's first on, that have these too.
    pub pixels: u32,
}

impl Taken {
    /// Adds a batch of a tile of this many pixels.
    pub fn add(&mut self, batch: SampleRange, tile_pixels: u32) {
        self.more = batch.sample_count;
        self.pixels += batch.pixel_count;
        if self.pixels == tile_pixels {
            *self = Self { samples: self.samples + self.more, ..Self::default() };
        }
    }

    /// Whether pixels of one row all have equal samples.
    pub fn is_of_rows(&self, width: u32) -> bool {
        self.pixels.is_multiple_of(width)
    }

    /// The rows of the tile, from the top, by their samples: one run of rows or, within a pass, two.
    pub fn rows(&self, tile: Tile, width: u32) -> impl Iterator<Item = (u32, u32)> + use<> {
        let ahead = self.pixels / width;
        let runs = [(ahead, self.samples + self.more), (tile.rows - ahead, self.samples)];
        runs.into_iter().filter(|(rows, _)| *rows > 0)
    }
}

/// Rows of the image, one under the other, whose pixels have equal samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Band {
    /// Rows, at least 1.
    pub rows: u32,
    /// Samples of each pixel, at least 1.
    pub samples: u32,
}

impl SampleRange {
    /// This batch and the one that follows it, as one; `None` where they have not their samples in common.
    pub fn with(self, next: Self) -> Option<Self> {
        let follows = next.film_pixel == self.film_pixel + self.pixel_count
            && (next.first_sample, next.sample_count) == (self.first_sample, self.sample_count);
        follows.then_some(Self { pixel_count: self.pixel_count + next.pixel_count, ..self })
    }

    /// Paths of the batch.
    pub fn paths(self) -> u32 {
        self.pixel_count * self.sample_count
    }

    /// The push constants of a pass whose paths have had `bounce` scattering events.
    pub fn at_bounce(self, bounce: u32) -> layout::Batch {
        let Self { first_pixel, pixel_count, first_sample, sample_count, film_pixel } = self;
        layout::Batch { first_pixel, pixel_count, first_sample, sample_count, bounce, film_pixel, first_slot: 0 }
    }
}

/// Bytes of the widest state record of a path: a queue entry in both halves is 8, state is 16.
const STATE_BYTES: u64 = 16;

impl Plan {
    /// Bytes of the film of a tile, where the image is more than one: enough pixels to keep any
    /// device busy, few enough for the host that reads them.
    const TILE_BYTES: u64 = 1 << 27;
    /// Samples of a pixel in one batch, at most: resolve loops over them, twice where some are not
    /// finite, and lavapipe leaves an invocation's loops after 65 535 rounds without a word.
    const SAMPLES_AT_ONCE: u32 = 1 << 14;
    /// Samples of a pixel in one batch, at least, where that many are asked for: paths that begin in one
    /// pixel see much the same, so the lanes of a subgroup stay together for longer. Few, since a render
    /// that is broken off finishes the samples that it has begun.
    const SAMPLES_SIDE_BY_SIDE: u32 = 4;
    /// Rays of a replay in one launch, at most: enough to keep any device busy, and 56 bytes each.
    const REPLAYED_RAYS: u32 = 1 << 22;

    /// Invocations of the megakernel in a launch of fewer paths than are in flight: this number or a multiple of it, since
    /// few workgroups must be shared evenly among cores.
    const SHARED_INVOCATIONS: u32 = 1 << 10;

    /// Computes the sizes for a scene of such demands and settings that make sense.
    pub fn new(
        settings: &Settings,
        scheduler: Scheduler,
        scene: &SceneDemands,
        device: &DeviceLimits,
        defaults: &Defaults,
    ) -> Self {
        let SceneDemands { levels, stack_bytes, state_bytes } = *scene;
        let Settings { width, height, .. } = *settings;
        let tile_rows = Self::tile_rows(width, height, device);
        let pixels = u64::from(width) * u64::from(tile_rows);
        let workgroup_size = Self::workgroup_size(settings, device);
        let wanted = settings.in_flight.unwrap_or_else(|| defaults.paths_in_flight(scheduler, levels, state_bytes));
        let useful = pixels * u64::from(settings.samples.min(Self::SAMPLES_AT_ONCE));
        let most = Self::most_invocations(device, workgroup_size, stack_bytes);
        let path_capacity = u64::from(wanted.max(1)).min(most).min(useful) as u32;
        let paths_per_invocation = match (scheduler, settings.paths_per_invocation) {
            (Scheduler::Megakernel, Some(paths)) => paths,
            (Scheduler::Megakernel, None) => defaults.paths_per_invocation(settings, levels, path_capacity),
            _ => 1,
        };
        Self { width, height, tile_rows, path_capacity, workgroup_size, paths_per_invocation }
    }

    fn workgroup_size(settings: &Settings, device: &DeviceLimits) -> u32 {
        settings.workgroup_size.unwrap_or(Defaults::WORKGROUP).min(device.max_workgroup_size)
    }

    /// All rows where their film fits the device, else as many as a tile has.
    fn tile_rows(width: u32, height: u32, device: &DeviceLimits) -> u32 {
        let row_bytes = u64::from(width) * size_of::<layout::FilmPixel>() as u64;
        if row_bytes * u64::from(height) <= device.max_film_bytes {
            return height;
        }
        (device.max_film_bytes.min(Self::TILE_BYTES) / row_bytes).clamp(1, u64::from(height)) as u32
    }

    /// Computes the sizes of a replay of `rays` rays, each with `stack_bytes` of traversal stack beyond registers. What
    /// does not fit the device's buffers or one dispatch follows in further launches.
    pub fn of_replay(settings: &Settings, device: &DeviceLimits, rays: u64, stack_bytes: u64) -> Self {
        let workgroup_size = Self::workgroup_size(settings, device);
        let most = Self::most_invocations(device, workgroup_size, stack_bytes);
        let wanted = u64::from(settings.in_flight.unwrap_or(Self::REPLAYED_RAYS));
        let path_capacity = wanted.min(most).min(rays).max(1) as u32;
        // There is no film.
        Self { width: 0, height: 0, tile_rows: 0, path_capacity, workgroup_size, paths_per_invocation: 1 }
    }

    /// Most invocations of a launch whose state and stacks fit the device's buffers: whole workgroups, since each of
    /// their invocations has a stack.
    fn most_invocations(device: &DeviceLimits, workgroup_size: u32, stack_bytes: u64) -> u64 {
        let by_buffer = device.max_storage_buffer_bytes / STATE_BYTES.max(stack_bytes);
        u64::from(workgroup_size) * u64::from(device.max_workgroups).min(by_buffer / u64::from(workgroup_size))
    }

    /// Traversal stacks in use at once, at most: one for each invocation of a launch.
    pub fn stacks(&self) -> u64 {
        let invocations = self.path_capacity.div_ceil(self.paths_per_invocation);
        u64::from(self.groups(invocations)) * u64::from(self.workgroup_size)
    }

    /// Workgroups that cover `items` invocations.
    pub fn groups(&self, items: u32) -> u32 {
        items.div_ceil(self.workgroup_size)
    }

    /// Pixels of the image.
    pub fn pixels(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// Bytes of the film of a tile.
    pub fn film_bytes(&self) -> u64 {
        u64::from(self.width) * u64::from(self.tile_rows) * size_of::<layout::FilmPixel>() as u64
    }

    /// The tiles of the image from that row on, which is the first of one.
    pub fn tiles(&self, first_row: u32) -> impl Iterator<Item = Tile> + use<> {
        let Plan { height, tile_rows, .. } = *self;
        (first_row..height)
            .step_by(tile_rows as usize)
            .map(move |first_row| Tile { first_row, rows: tile_rows.min(height - first_row) })
    }

    /// The batch that follows in a tile that is to have `samples`: of about `paths` paths, at most
    /// [`Self::path_capacity`]. A pass, of about `pass_paths`, takes equal samples of every pixel: in one batch where the
    /// paths suffice, else of as many rows as they do for, or of a part of one.
    pub fn next_batch(
        &self,
        tile: Tile,
        taken: Taken,
        samples: u32,
        paths: u32,
        pass_paths: u32,
    ) -> Option<SampleRange> {
        let (first_sample, pixels) = (taken.samples, tile.rows * self.width);
        if first_sample == samples {
            return None;
        }
        let paths = paths.clamp(1, self.path_capacity);
        let sample_count = if taken.pixels > 0 {
            taken.more
        } else {
            let most = (pass_paths.min(self.path_capacity) / pixels).min(Self::SAMPLES_AT_ONCE);
            most.max(self.samples_side_by_side()).min(samples - first_sample)
        };
        let film_pixel = taken.pixels;
        let mut end = (film_pixel + (paths / sample_count).max(1)).min(pixels);
        // A batch of a row and more ends where a row does.
        if end - end % self.width > film_pixel {
            end -= end % self.width;
        }
        Some(SampleRange {
            first_pixel: tile.first_row * self.width + film_pixel,
            pixel_count: end - film_pixel,
            first_sample,
            sample_count,
            film_pixel,
        })
    }

    /// Samples of a pixel in one batch, at least, if that many are to be taken.
    pub fn samples_side_by_side(&self) -> u32 {
        Self::SAMPLES_SIDE_BY_SIDE.min(self.path_capacity)
    }

    /// Invocations of the megakernel that follow this many paths: fewer paths each than the plan has it where the cores
    /// could not share the invocations evenly.
    pub fn invocations(&self, paths: u32) -> u32 {
        let invocations = paths.div_ceil(self.paths_per_invocation).next_multiple_of(Self::SHARED_INVOCATIONS);
        invocations.min(paths).min(self.stacks() as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Sampler;
    use proptest::prelude::*;

    const SCENE: SceneDemands = SceneDemands {
        levels: SceneLevels { bvh: 8, bvh_tests: 0, sky: 0, two_levels: false },
        stack_bytes: 0,
        state_bytes: 0,
    };

    const DEVICE: DeviceLimits = DeviceLimits {
        max_workgroup_size: 1024,
        max_workgroups: 65_535,
        max_storage_buffer_bytes: 1 << 27,
        max_film_bytes: 1 << 27,
    };

    const SOFTWARE: Defaults = Defaults::LIMITED_SOFTWARE;

    fn plan_of(settings: &Settings, scheduler: Scheduler, scene: &SceneDemands, device: &DeviceLimits) -> Plan {
        Plan::new(settings, scheduler, scene, device, &SOFTWARE)
    }

    fn settings(width: u32, height: u32, samples: u32, in_flight: Option<u32>) -> Settings {
        Settings {
            width,
            height,
            samples,
            max_bounces: Some(4),
            sampler: Sampler::Independent,
            in_flight,
            ..Settings::default()
        }
    }

    proptest! {
        #[test]
        fn batches_take_every_sample_once_and_in_order(
            width in 1..40_u32, height in 1..40_u32, samples in 1..20_u32, in_flight in 1..3000_u32, rows in 1..50_u32,
            paces in prop::collection::vec(0..4000_u32, 1..9),
        ) {
            let device = DeviceLimits { max_film_bytes: u64::from(64 * width * rows), ..DEVICE };
            let plan = plan_of(&settings(width, height, samples, Some(in_flight)), Scheduler::Bounce, &SCENE, &device);
            prop_assert!(plan.film_bytes() <= device.max_film_bytes);
            let mut next = vec![0; plan.pixels() as usize];
            let mut paces = paces.into_iter().cycle();
            for tile in plan.tiles(0) {
                let mut taken = Taken::default();
                while let Some(batch) = plan.next_batch(tile, taken, samples, paces.next().unwrap(), paces.next().unwrap()) {
                    prop_assert!(batch.paths() <= plan.path_capacity && batch.pixel_count > 0 && batch.sample_count > 0);
                    prop_assert!(batch.pixel_count < width || batch.pixel_count % width == 0 || batch.film_pixel % width > 0);
                    prop_assert_eq!(batch.first_pixel - batch.film_pixel, tile.first_row * width);
                    prop_assert!(batch.film_pixel + batch.pixel_count <= tile.rows * width);
                    for pixel in batch.first_pixel..batch.first_pixel + batch.pixel_count {
                        prop_assert_eq!(next[pixel as usize], batch.first_sample);
                        next[pixel as usize] += batch.sample_count;
                    }
                    taken.add(batch, tile.rows * width);
                    if taken.is_of_rows(width) {
                        let rows = taken.rows(tile, width);
                        let told = rows.flat_map(|(rows, samples)| vec![samples; (rows * width) as usize]);
                        let first = (tile.first_row * width) as usize;
                        let has = next[first..].iter().take((tile.rows * width) as usize);
                        prop_assert!(told.eq(has.copied()));
                    }
                }
                // A tile is finished before the next one begins.
                prop_assert!(next[..((tile.first_row + tile.rows) * width) as usize].iter().all(|&n| n == samples));
            }
            prop_assert!(next.iter().all(|&n| n == samples));
        }
    }

    #[test]
    fn capacity_respects_the_device() {
        let plan = plan_of(&settings(1024, 1024, 1 << 20, Some(u32::MAX)), Scheduler::Bounce, &SCENE, &DEVICE);
        assert_eq!(u64::from(plan.path_capacity), (1 << 27) / STATE_BYTES);
        // A launch of the megakernel may have a stack for each path.
        let endless = Settings { max_bounces: None, ..settings(1024, 1024, 16, None) };
        let plan = plan_of(&endless, Scheduler::Megakernel, &SceneDemands { stack_bytes: 144, ..SCENE }, &DEVICE);
        assert!(plan.paths_per_invocation == 1 && 144 * plan.stacks() <= 1 << 27);
        let narrow = DeviceLimits { max_workgroups: 100, ..DEVICE };
        let plan = plan_of(&settings(1024, 1024, 1, None), Scheduler::Bounce, &SCENE, &narrow);
        assert_eq!(plan.path_capacity, 100 * 256);
    }

    #[test]
    fn a_replay_fits_dispatch_and_buffers() {
        let capacity = |in_flight, device, rays, stack_bytes| {
            Plan::of_replay(&settings(1, 1, 1, in_flight), device, rays, stack_bytes).path_capacity
        };
        assert_eq!(capacity(None, &DEVICE, 1000, 0), 1000);
        assert_eq!(capacity(Some(64), &DEVICE, 1000, 0), 64);
        assert_eq!(capacity(None, &DEVICE, u64::MAX, 0), Plan::REPLAYED_RAYS);
        assert_eq!(capacity(Some(u32::MAX), &DEVICE, u64::MAX, 0), (1 << 27) / STATE_BYTES as u32);
        assert_eq!(capacity(None, &DEVICE, u64::MAX, 96), (1 << 27) / 96 / 256 * 256);
        let narrow = DeviceLimits { max_workgroups: 100, ..DEVICE };
        assert_eq!(capacity(None, &narrow, u64::MAX, 96), 100 * 256);
    }

    #[test]
    fn few_pixels_do_not_make_long_loops() {
        let plan = plan_of(&settings(2, 1, 1 << 20, None), Scheduler::Bounce, &SCENE, &DEVICE);
        let tile = plan.tiles(0).next().unwrap();
        let mut taken = Taken::default();
        while let Some(batch) = plan.next_batch(tile, taken, 1 << 20, u32::MAX, u32::MAX) {
            assert!(batch.sample_count <= Plan::SAMPLES_AT_ONCE);
            taken.add(batch, 2);
        }
        assert_eq!(taken.samples, 1 << 20);
    }

    #[test]
    fn invocations_have_stacks_in_whole_workgroups() {
        let settings = Settings { max_bounces: Some(8), ..settings(1024, 1024, 16, None) };
        let deep = SceneDemands { levels: SceneLevels { bvh: 40, ..SceneLevels::default() }, ..SCENE };
        let plan = plan_of(&settings, Scheduler::Megakernel, &deep, &DEVICE);
        assert_eq!((plan.path_capacity, plan.paths_per_invocation), (1 << 20, 22));
        assert_eq!(plan.stacks(), (1_u64 << 20).div_ceil(22).next_multiple_of(256));
        let listed = SceneDemands::default();
        let plan = plan_of(&settings, Scheduler::Megakernel, &listed, &DEVICE);
        assert_eq!((plan.path_capacity, plan.paths_per_invocation), (1 << 22, 256));
    }

    #[test]
    fn a_small_launch_has_invocations_to_share() {
        let listed = Settings { max_bounces: Some(8), ..settings(1024, 1024, 16, None) };
        let plan = plan_of(&listed, Scheduler::Megakernel, &SceneDemands::default(), &DEVICE);
        assert_eq!(
            [1 << 22, 1 << 16, 1 << 12, 100].map(|paths| plan.invocations(paths)),
            [1 << 14, 1 << 10, 1 << 10, 100]
        );
        // Each has a stack, however few there are.
        let few = Settings { paths_per_invocation: Some(64), ..settings(64, 64, 1, None) };
        let plan = plan_of(&few, Scheduler::Megakernel, &SCENE, &DEVICE);
        for paths in 1..=4096 {
            let invocations = u64::from(plan.invocations(paths));
            assert!(invocations <= plan.stacks() && invocations * 64 >= u64::from(paths));
        }
    }

    #[test]
    fn only_a_film_over_the_limit_is_cut_into_tiles() {
        let tile_rows = |width, height, device| {
            plan_of(&settings(width, height, 1, None), Scheduler::Bounce, &SCENE, device).tile_rows
        };
        assert_eq!(tile_rows(2048, 1024, &DEVICE), 1024);
        assert_eq!(tile_rows(2048, 1025, &DEVICE), 1024);
        assert_eq!(tile_rows(16_384, 16_384, &DEVICE), 128);
        // A device that could hold more is not given more than the host cares to read at once.
        let wide = DeviceLimits { max_film_bytes: 1 << 32, ..DEVICE };
        assert_eq!(tile_rows(8192, 8192, &wide), 8192);
        assert_eq!(tile_rows(16_384, 16_384, &wide), 128);
    }
}
