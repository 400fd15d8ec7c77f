//! Sizes, capacities, workgroup counts and batches of a render: arithmetic without a device.

use super::settings::{Scheduler, Settings};
use crate::layout;

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
    /// Whether it is software: few threads, small caches.
    pub software: bool,
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

impl SampleRange {
    /// The push constants of a pass whose paths have had `bounce` scattering events.
    pub fn at_bounce(self, bounce: u32) -> layout::Batch {
        let Self { first_pixel, pixel_count, first_sample, sample_count, film_pixel } = self;
        layout::Batch { first_pixel, pixel_count, first_sample, sample_count, bounce, film_pixel }
    }
}

/// Bytes of the widest state record of a path: a queue entry in both halves is 8, state is 16.
const STATE_BYTES: u64 = 16;

impl Plan {
    /// Paths in flight where the user does not say: enough to keep every core busy between two
    /// dispatches, few enough for the caches of a software device.
    const SOFTWARE_PATHS: u32 = 1 << 18;
    /// Those of the megakernel, where a path in flight is its radiance alone, and the launch of so long a kernel costs
    /// lavapipe some milliseconds: with a tree, and with a list, which is faster.
    const SOFTWARE_FOLLOWED_PATHS: u32 = 1 << 20;
    const SOFTWARE_LISTED_PATHS: u32 = 1 << 22;
    const HARDWARE_PATHS: u32 = 1 << 21;
    /// Bytes of the film of a tile, where the image is more than one: enough pixels to keep any
    /// device busy, few enough for the host that reads them.
    const TILE_BYTES: u64 = 1 << 27;
    /// Samples of a pixel in one batch, at most: resolve loops over them, twice where some are not
    /// finite, and lavapipe leaves an invocation's loops after 65 535 rounds without a word.
    const SAMPLES_AT_ONCE: u32 = 1 << 14;
    /// Samples of a pixel in one batch, at least, where so many are asked for: paths that begin in one
    /// pixel see much the same, so the lanes of a subgroup stay together for longer. Few, since a render
    /// that is broken off finishes the samples that it has begun.
    const SAMPLES_SIDE_BY_SIDE: u32 = 4;
    /// Rays of a replay in one launch, at most: enough to keep any device busy, and 56 bytes each.
    const REPLAYED_RAYS: u32 = 1 << 22;

    /// Invocations of the megakernel where the user does not say and the device is software, if so many
    /// paths are in flight: 64 workgroups to share among the cores. The more paths an invocation follows, the
    /// less it matters that the last ones of its subgroup end apart.
    const SOFTWARE_INVOCATIONS: u32 = 1 << 14;
    /// Turns of its loops that an invocation may take: lavapipe leaves them after 65 535.
    const LOOP_TURNS: u32 = 65_535;

    /// Computes the sizes for a scene of those levels, with so many bytes of a traversal stack beyond registers, and
    /// settings that make sense.
    pub fn new(
        settings: &Settings,
        scheduler: Scheduler,
        levels: SceneLevels,
        stack_bytes: u64,
        device: &DeviceLimits,
    ) -> Self {
        let Settings { width, height, .. } = *settings;
        let tile_rows = Self::tile_rows(width, height, device);
        let pixels = u64::from(width) * u64::from(tile_rows);
        let workgroup_size = settings.workgroup_size.unwrap_or(256).min(device.max_workgroup_size);
        let wanted = settings.in_flight.unwrap_or(match (device.software, scheduler, levels.bvh) {
            (true, Scheduler::Megakernel, 0) => Self::SOFTWARE_LISTED_PATHS,
            (true, Scheduler::Megakernel, _) => Self::SOFTWARE_FOLLOWED_PATHS,
            (true, ..) => Self::SOFTWARE_PATHS,
            (false, ..) => Self::HARDWARE_PATHS,
        });
        let useful = pixels * u64::from(settings.samples.min(Self::SAMPLES_AT_ONCE));
        let most = Self::most_invocations(device, workgroup_size, stack_bytes);
        let path_capacity = u64::from(wanted.max(1)).min(most).min(useful) as u32;
        let paths_per_invocation = match (scheduler, settings.paths_per_invocation) {
            (Scheduler::Megakernel, Some(paths)) => paths,
            (Scheduler::Megakernel, None) if device.software => {
                (path_capacity / Self::SOFTWARE_INVOCATIONS).clamp(1, Self::safe_paths_per_invocation(settings, levels))
            }
            _ => 1,
        };
        Self { width, height, tile_rows, path_capacity, workgroup_size, paths_per_invocation }
    }

    /// All rows where their film fits the device, else as many as a tile has.
    fn tile_rows(width: u32, height: u32, device: &DeviceLimits) -> u32 {
        let row_bytes = u64::from(width) * size_of::<layout::FilmPixel>() as u64;
        if row_bytes * u64::from(height) <= device.max_film_bytes {
            return height;
        }
        (device.max_film_bytes.min(Self::TILE_BYTES) / row_bytes).clamp(1, u64::from(height)) as u32
    }

    /// As many paths as stay within the turns of the loops: each vertex has two rays, and a ray was
    /// seen to take three turns a level at most, where boxes overlap much some for each test that the SAH
    /// expects; and a light sample, which takes one a level of the sky.
    pub(super) fn safe_paths_per_invocation(settings: &Settings, levels: SceneLevels) -> u32 {
        let vertices = settings.max_bounces.map_or(u32::MAX, |bounces| bounces.saturating_add(1));
        let ray = (4 * levels.bvh.max(1)).max(levels.bvh_tests.saturating_mul(3));
        let vertex = ray.saturating_mul(2).saturating_add(levels.sky).saturating_add(settings.shading_cost);
        let turns = vertices.saturating_mul(vertex);
        (Self::LOOP_TURNS / turns).max(1)
    }

    /// Computes the sizes of a replay of `rays` rays, each with `stack_bytes` of traversal stack beyond registers. What
    /// does not fit the device's buffers or one dispatch follows in further launches.
    pub fn of_replay(settings: &Settings, device: &DeviceLimits, rays: u64, stack_bytes: u64) -> Self {
        let workgroup_size = settings.workgroup_size.unwrap_or(256).min(device.max_workgroup_size);
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

    /// The tiles of the image, from the top.
    pub fn tiles(&self) -> impl Iterator<Item = Tile> + use<> {
        let Plan { height, tile_rows, .. } = *self;
        (0..height)
            .step_by(tile_rows as usize)
            .map(move |first_row| Tile { first_row, rows: tile_rows.min(height - first_row) })
    }

    /// The batches that take every pixel of a tile from `samples.start` to `samples.end`: the whole
    /// tile where so many samples fit the path slots, else a part of the pixels at a time.
    pub fn batches(&self, tile: Tile, samples: std::ops::Range<u32>) -> impl Iterator<Item = SampleRange> + use<> {
        let Plan { width, path_capacity, .. } = *self;
        let (tile_pixel, pixels) = (tile.first_row * width, tile.rows * width);
        let end = samples.end;
        let side_by_side = Self::SAMPLES_SIDE_BY_SIDE.min(end - samples.start).min(path_capacity);
        let samples_at_once = (path_capacity / pixels).max(side_by_side);
        let pixels_at_once = (path_capacity / samples_at_once).min(pixels);
        samples.step_by(samples_at_once as usize).flat_map(move |first_sample| {
            (0..pixels).step_by(pixels_at_once as usize).map(move |film_pixel| SampleRange {
                first_pixel: tile_pixel + film_pixel,
                pixel_count: pixels_at_once.min(pixels - film_pixel),
                first_sample,
                sample_count: samples_at_once.min(end - first_sample),
                film_pixel,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Numerics, Offsets, PathState, RouletteMode, ShadowRays, Sort};
    use crate::scene::{Integrator, Sampler};
    use proptest::prelude::*;

    const LEVELS: SceneLevels = SceneLevels { bvh: 8, bvh_tests: 0, sky: 0 };

    const DEVICE: DeviceLimits = DeviceLimits {
        max_workgroup_size: 1024,
        max_workgroups: 65_535,
        max_storage_buffer_bytes: 1 << 27,
        max_film_bytes: 1 << 27,
        software: true,
    };

    fn settings(width: u32, height: u32, samples: u32, in_flight: Option<u32>) -> Settings {
        let integrator = Integrator::Explicit;
        Settings {
            width,
            height,
            samples,
            integrator,
            max_bounces: Some(4),
            roulette: 0.0,
            roulette_mode: RouletteMode::Constant,
            roulette_from: Settings::ROULETTE_FROM,
            sampler: Sampler::Independent,
            clamp: None,
            seed: 0,
            scheduler: None,
            in_flight,
            workgroup_size: None,
            shading_cost: 0,
            material_branches: 1,
            bvh: None,
            sort: Sort::None,
            shadow_rays: ShadowRays::Deferred,
            packets: None,
            paths_per_invocation: None,
            path_state: PathState::F32,
            offsets: Offsets::Robust,
            numerics: Numerics::Portable,
            fast_math: false,
            fetch: None,
            tuned: false,
            specialize: true,
        }
    }

    proptest! {
        #[test]
        fn batches_take_every_sample_once_and_in_order(
            width in 1..40_u32, height in 1..40_u32, samples in 1..20_u32, in_flight in 1..3000_u32, rows in 1..50_u32,
        ) {
            let device = DeviceLimits { max_film_bytes: u64::from(64 * width * rows), ..DEVICE };
            let plan = Plan::new(&settings(width, height, samples, Some(in_flight)), Scheduler::Bounce, LEVELS, 0, &device);
            prop_assert!(plan.film_bytes() <= device.max_film_bytes);
            let mut next = vec![0; plan.pixels() as usize];
            for tile in plan.tiles() {
                for batch in plan.batches(tile, 0..samples) {
                    prop_assert!(batch.pixel_count * batch.sample_count <= plan.path_capacity);
                    prop_assert_eq!(batch.first_pixel - batch.film_pixel, tile.first_row * width);
                    prop_assert!(batch.film_pixel + batch.pixel_count <= tile.rows * width);
                    for pixel in batch.first_pixel..batch.first_pixel + batch.pixel_count {
                        prop_assert_eq!(next[pixel as usize], batch.first_sample);
                        next[pixel as usize] += batch.sample_count;
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
        let plan = Plan::new(&settings(1024, 1024, 1 << 20, Some(u32::MAX)), Scheduler::Bounce, LEVELS, 0, &DEVICE);
        assert_eq!(u64::from(plan.path_capacity), (1 << 27) / STATE_BYTES);
        // A launch of the megakernel may have a stack for each path.
        let endless = Settings { max_bounces: None, ..settings(1024, 1024, 16, None) };
        let plan = Plan::new(&endless, Scheduler::Megakernel, LEVELS, 144, &DEVICE);
        assert!(plan.paths_per_invocation == 1 && 144 * plan.stacks() <= 1 << 27);
        let narrow = DeviceLimits { max_workgroups: 100, ..DEVICE };
        let plan = Plan::new(&settings(1024, 1024, 1, None), Scheduler::Bounce, LEVELS, 0, &narrow);
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
        let plan = Plan::new(&settings(2, 1, 1 << 20, None), Scheduler::Bounce, LEVELS, 0, &DEVICE);
        let tile = plan.tiles().next().unwrap();
        assert!(plan.batches(tile, 0..1 << 20).all(|batch| batch.sample_count <= Plan::SAMPLES_AT_ONCE));
    }

    #[test]
    fn invocations_follow_as_many_paths_as_their_loops_allow() {
        let plan = |max_bounces, levels| {
            let settings = Settings { max_bounces, ..settings(1024, 1024, 16, None) };
            Plan::new(&settings, Scheduler::Megakernel, levels, 0, &DEVICE)
        };
        let deep = SceneLevels { bvh: 40, ..SceneLevels::default() };
        let paths = |max_bounces| plan(max_bounces, deep).paths_per_invocation;
        assert_eq!([Some(8), Some(50), None].map(paths), [22, 4, 1]);
        assert_eq!(plan(Some(50), SceneLevels { sky: 10, ..deep }).paths_per_invocation, 3);
        assert_eq!(plan(Some(8), SceneLevels { bvh_tests: 400, ..deep }).paths_per_invocation, 3);
        let listed = plan(Some(8), SceneLevels::default());
        assert_eq!((listed.path_capacity, listed.paths_per_invocation), (1 << 22, 256));
        // A stack for each invocation, in whole workgroups.
        let deep = plan(Some(8), deep);
        assert_eq!((deep.path_capacity, deep.stacks()), (1 << 20, (1_u64 << 20).div_ceil(22).next_multiple_of(256)));
        // A small image has an invocation for each path.
        let small = Plan::new(&settings(64, 64, 1, None), Scheduler::Megakernel, SceneLevels::default(), 0, &DEVICE);
        assert_eq!(small.paths_per_invocation, 1);
    }

    #[test]
    fn only_a_film_over_the_limit_is_cut_into_tiles() {
        let tile_rows = |width, height, device| {
            Plan::new(&settings(width, height, 1, None), Scheduler::Bounce, LEVELS, 0, device).tile_rows
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
