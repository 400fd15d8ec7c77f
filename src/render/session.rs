//! A render on a device: uploads the scene, runs batch after batch, reads the film.

use std::collections::{BTreeMap, VecDeque};
use std::ops::{ControlFlow, Range};
use std::time::{Duration, Instant};

use bytemuck::Pod;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::buffers::{path_buffers, path_records, scene_buffers};
use super::defaults::{Choices, Defaults, Tuned};
use super::error::RenderError;
use super::kept::Kept;
use super::pace::Pace;
use super::plan::{DeviceLimits, Plan, SampleRange, SceneDemands, Taken, Tile};
use super::prepare::PreparedScene;
use super::schedule::{Schedule, Work};
use super::statistics::{Outcome, Statistics, scattered_rays};
use super::traced::{DeviceTrace, Gathering};
use crate::constants::TRACED_SAMPLES;
use crate::film::{Film, FilmMoments, Missing, PixelSums};
use crate::gpu::{CompiledKernel, Device, Executor, ExecutorDescription, GpuError, Idle};
use crate::image::Image;
use crate::layout::{Control, FilmPixel, RayCount, WorkCount};
use crate::recording::Recording;
use crate::settings::{Fetch, Numerics, Packets, Settings};
use crate::shaders::{Access, Arithmetic, Edition, Forms, Kernel, Library, buffers};

/// How far a render is.
#[derive(Debug, Clone, Copy)]
pub struct Progress<'a> {
    /// Samples done, over all pixels.
    pub samples_done: u64,
    /// Samples to do, over all pixels.
    pub samples_total: u64,
    /// Samples of those done that were taken in the time elapsed; the others were in the film from the start.
    pub samples_taken: u64,
    /// Rays traced in the time elapsed, of all classes, by the latest look at the device's counts.
    pub rays: u64,
    /// Since the first batch.
    pub elapsed: Duration,
    /// relMSE by the last round, of a render that goes by rounds.
    pub error: Option<f64>,
    /// What there is of the image, if the device's film was just read.
    pub looked: Option<&'a Kept>,
}

/// How a render is to end before it is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// When all pixels of the tile under way have equal samples.
    Even,
    /// When all pixels of each row have.
    Now,
}

/// Options of a session besides the settings of its render.
#[derive(Debug, Clone, Copy, Default)]
pub struct SessionOptions {
    /// How kernels reach memory; `None` leaves it to the device.
    pub access: Option<Access>,
    /// Whether kernels count their work, which takes time.
    pub counting: bool,
    /// What portable quotients and roots are made of; `None` is what suits the device.
    pub forms: Option<Forms>,
    /// Functions that stand for the driver's own operations, for tests of what other drivers do.
    pub driver: Option<&'static Library>,
    /// What a tuning chose, for what the settings leave open.
    pub tuned: Option<Tuned>,
    /// Most bytes of film that the device holds at once; `None` is what fits a buffer. The image is
    /// the same.
    pub film_bytes: Option<u64>,
}

/// Bounces that go to the device before the host looks whether paths are left. Paths bounded below this length never
/// make the host wait.
const BOUNCES_AT_ONCE: u32 = 32;

/// Seconds that a pass over all pixels may take where it could be longer: the fewer passes, the less time goes into
/// what is between them; the shorter they are, the sooner pixels have equal samples.
const PASS_SECONDS: f64 = 1.0;

/// Paths of a render below which the pace is not sampled beforehand: they take no second.
const SAMPLED_RENDER: u64 = 1 << 17;
/// Small batches, at most, by which the pace is sampled, and paths of the first one.
const SAMPLINGS: u32 = 32;
const SAMPLED_PATHS: u32 = 256;
/// Multiples of it are spread evenly over [0, 1), however many of them there are.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// Seconds that such a batch must take, at least, to measure paths rather than launches.
const SAMPLING_SECONDS: f64 = 2e-3;
/// How many times the sampled cost a path may have.
const SURPRISE: f64 = 8.0;
/// The share of a render's time that sampling may take.
const SAMPLING_SHARE: f64 = 1.0 / 200.0;

/// Time between two looks at the device's ray counts: each waits for the device.
const COUNT_INTERVAL: Duration = Duration::from_millis(250);

/// A scene on a device, ready to render.
pub struct Session {
    pub(super) executor: Executor,
    pub(super) plan: Plan,
    pub(super) settings: Settings,
    /// Samples of each pixel that renders take, by number. The first of a range begins a block.
    wanted: Vec<Range<u32>>,
    pub(super) schedule: Schedule,
    choices: Choices,
    counting: bool,
    /// Kernel radiance per unit of scene radiance.
    radiance_scale: f64,
    pace: Pace,
    /// Submissions whose time is not known yet, each with the batch that it ends, if it ends one.
    timed: VecDeque<Option<SampleRange>>,
    /// The longest submission so far of the batch under way, in seconds.
    longest: f64,
    /// Batches that the megakernel has traced and no resolve has added to the film yet, as one.
    gathered: Option<SampleRange>,
    /// What is kept for a trace, if anything is.
    tracing: Option<Gathering>,
}

impl Session {
    /// Plans the render, builds its kernels and uploads the scene.
    ///
    /// # Errors
    /// When scene or film are over the device's limits, or the device fails.
    pub fn new(device: &Device, scene: &PreparedScene, settings: &Settings) -> Result<Self, RenderError> {
        Self::with_options(device, scene, settings, SessionOptions::default())
    }

    /// As [`Session::new`], with options.
    ///
    /// # Errors
    /// As [`Session::new`].
    pub fn with_options(
        device: &Device,
        scene: &PreparedScene,
        settings: &Settings,
        options: SessionOptions,
    ) -> Result<Self, RenderError> {
        let limits = limits(device);
        let max_film_bytes = options.film_bytes.unwrap_or(limits.max_film_bytes);
        let defaults = Defaults::of(device)?.with(options.tuned);
        let levels = scene.levels();
        let choices = defaults.choose(settings, scene.bvh.kind, levels);
        let settings = &choices.settle(settings);
        let needs = scene.needs(settings);
        let limits = DeviceLimits { max_film_bytes, ..limits };
        let state_bytes = path_records(settings.sort, &needs).iter().map(|(_, bytes)| bytes).sum();
        let demands = SceneDemands { levels, stack_bytes: needs.stack_bytes(1), state_bytes };
        let plan = Plan::new(settings, choices.scheduler, &demands, &limits, &defaults);
        let schedule = Schedule::new(choices.scheduler, settings, &needs, &plan);
        let executor = open_executor(device, scene, settings, &plan, &schedule.kernels(), options)?;
        Ok(Self {
            executor,
            plan,
            settings: *settings,
            wanted: settings.sample_numbers(settings.samples),
            schedule,
            choices,
            counting: options.counting,
            radiance_scale: scene.radiance_scale,
            pace: Pace::new(plan.pixels()),
            timed: VecDeque::new(),
            longest: 0.0,
            gathered: None,
            tracing: None,
        })
    }

    /// Changes the seed and the sample count of subsequent renders. `scene` is the session's own.
    ///
    /// # Errors
    /// When the device fails.
    pub fn reseed(&mut self, scene: &PreparedScene, seed: u32, samples: u32) -> Result<(), RenderError> {
        self.settings = Settings { seed, samples, ..self.settings };
        self.wanted = self.settings.sample_numbers(samples);
        let frame = scene.frame(&self.settings, self.plan.path_capacity);
        self.executor.run(Recording::default().upload(buffers::FRAME, bytemuck::bytes_of(&frame)))?;
        Ok(())
    }

    /// Has the next renders take these blocks alone.
    ///
    /// # Panics
    /// When the settings' samples have none of them.
    pub fn take_blocks(&mut self, blocks: Range<u32>) {
        let size = self.settings.block_samples();
        let within = |samples: &Range<u32>| {
            samples.start.max(blocks.start.saturating_mul(size))..samples.end.min(blocks.end.saturating_mul(size))
        };
        let numbers = self.settings.sample_numbers(self.settings.samples);
        self.wanted = numbers.iter().map(within).filter(|samples| !samples.is_empty()).collect();
        assert!(!self.wanted.is_empty(), "there is a sample to take");
    }

    /// Has the next renders take the first so many samples of each pixel.
    pub fn take_samples(&mut self, samples: u32) {
        self.wanted = self.settings.sample_numbers(samples);
    }

    /// Bytes of device memory that the session holds.
    pub fn memory_bytes(&self) -> u64 {
        self.executor.memory_bytes()
    }

    /// What the driver made of the kernels, as [`Executor::compiled_kernels`] has it.
    ///
    /// # Errors
    /// When a kernel cannot be built.
    pub fn compiled_kernels(&self) -> Result<Option<Vec<CompiledKernel>>, RenderError> {
        Ok(self.executor.compiled_kernels()?)
    }

    /// Instructions of each kernel's SPIR-V that can run, by name.
    pub fn instructions(&self) -> impl Iterator<Item = (&'static str, usize)> {
        self.executor.instructions()
    }

    /// Invocations of a workgroup.
    pub fn workgroup_size(&self) -> u32 {
        self.plan.workgroup_size
    }

    /// Time until all kernels were built.
    pub fn pipelines_time(&self) -> Duration {
        self.executor.pipelines_time()
    }

    /// Time that the driver took to build each kernel, by name. Kernels are built side by side, so that these may add
    /// up to more than the time of all.
    pub fn pipeline_times(&self) -> impl Iterator<Item = (&'static str, Duration)> {
        self.executor.pipeline_times()
    }

    /// Keeps what the device does in the next render, for a trace: up to `most_passes` passes.
    ///
    /// # Errors
    /// When the device fails.
    pub fn keep_trace(&mut self, most_passes: usize) -> Result<(), RenderError> {
        self.executor.keep_trace(buffers::RAY_COUNTS, most_passes)?;
        self.tracing = Some(Gathering::new(self.schedule.has_queues()));
        Ok(())
    }

    /// Ends what [`Session::keep_trace`] began and returns the trace; `None` where it was not called.
    pub fn take_trace(&mut self) -> Option<DeviceTrace> {
        self.gather_trace();
        let batches = self.tracing.take()?.batches();
        Some(DeviceTrace { alignment: self.executor.alignment()?, batches })
    }

    fn gather_trace(&mut self) {
        if let Some(tracing) = &mut self.tracing {
            tracing.add(self.executor.take_traced());
        }
    }

    /// As [`Session::render_tiles`], with the tiles put together. Of a render that is broken off, the film has the rows
    /// from the top that have equal samples.
    ///
    /// # Errors
    /// When the device fails.
    pub fn render(
        &mut self,
        progress: impl FnMut(&Progress<'_>) -> ControlFlow<Ending>,
    ) -> Result<Outcome, RenderError> {
        let mut film: Option<FilmMoments> = None;
        let statistics = self.render_tiles(progress, |rows| match &mut film {
            None => film = Some(rows),
            Some(film) if film.samples == rows.samples => film.append(rows),
            Some(_) => {}
        })?;
        Ok(Outcome { film: film.expect("a render has a row"), statistics })
    }

    /// As [`Session::render`], but only the image: the mean of every pixel, without variances.
    ///
    /// # Errors
    /// When the device fails.
    pub fn render_image(&mut self) -> Result<(Image, Statistics), RenderError> {
        let mut pixels = Vec::with_capacity(self.plan.pixels() as usize);
        let mut kept = Kept::every(Duration::MAX);
        let one_block = self.settings.samples <= self.settings.block_samples() && self.wanted.len() == 1;
        let reads = if one_block { Reads::Nothing } else { Reads::Film };
        let statistics = self.run(&mut kept, reads, whole, |session, kept, tile| {
            if one_block {
                return session.mean(tile, &mut pixels);
            }
            pixels.extend(kept.film_mut().take(tile.first_row).mean().pixels);
            Ok(())
        })?;
        Ok((Image::new(self.plan.width, statistics.rows, pixels), statistics))
    }

    /// As [`Session::render`], but only the cost: the film stays on the device.
    ///
    /// # Errors
    /// When the device fails.
    pub fn time(&mut self) -> Result<Statistics, RenderError> {
        self.run(&mut Kept::every(Duration::MAX), Reads::Nothing, whole, |_, _, _| Ok(()))
    }

    /// Renders all samples of one tile after the other, from the top, and hands each to `finished`. `progress` is that of
    /// [`Session::go_on`]; of a render that it breaks off, the rows are handed over by their samples, and those that have
    /// none are not.
    ///
    /// # Errors
    /// When the device fails.
    pub fn render_tiles(
        &mut self,
        progress: impl FnMut(&Progress<'_>) -> ControlFlow<Ending>,
        finished: impl FnMut(FilmMoments),
    ) -> Result<Statistics, RenderError> {
        self.go_on_by_tiles(&mut Kept::default(), progress, finished)
    }

    /// As [`Session::go_on`], but hands the rows that are done to `finished`, which `kept` then knows by their number alone.
    ///
    /// # Errors
    /// When the device fails.
    pub fn go_on_by_tiles(
        &mut self,
        kept: &mut Kept,
        progress: impl FnMut(&Progress<'_>) -> ControlFlow<Ending>,
        mut finished: impl FnMut(FilmMoments),
    ) -> Result<Statistics, RenderError> {
        self.run(kept, Reads::Film, progress, |_, kept, tile| {
            kept.hand_over(tile.first_row..tile.first_row + tile.rows, &mut finished);
            Ok(())
        })
    }

    /// Renders the samples that the film in `kept` lacks, which another session of the same scene and settings may have
    /// begun, and puts them there.
    ///
    /// `progress` is called after each batch, and after each sampling before the first one, some fractions of a second
    /// apart. When it breaks, the render ends as it says, with the samples that it has. There is a batch at least, unless
    /// no sample is lacking.
    ///
    /// # Errors
    /// When the device fails.
    pub fn go_on(
        &mut self,
        kept: &mut Kept,
        progress: impl FnMut(&Progress<'_>) -> ControlFlow<Ending>,
    ) -> Result<Statistics, RenderError> {
        self.run(kept, Reads::Film, progress, |_, _, _| Ok(()))
    }

    /// Renders as [`Session::go_on`] says, and calls `finished` once a tile is done, or as far as it comes.
    fn run(
        &mut self,
        kept: &mut Kept,
        reads: Reads,
        mut progress: impl FnMut(&Progress<'_>) -> ControlFlow<Ending>,
        mut finished: impl FnMut(&mut Self, &mut Kept, Tile) -> Result<(), GpuError>,
    ) -> Result<Statistics, RenderError> {
        let wanted = self.wanted.clone();
        let film = kept.begin(|| self.empty_film());
        let done = wanted.iter().map(|samples| film.samples_of(samples)).sum();
        let total =
            self.plan.pixels() * wanted.iter().map(|samples| u64::from(samples.end - samples.start)).sum::<u64>();
        let before = kept.statistics.clone().unwrap_or_else(|| self.nothing());
        let mut under_way = UnderWay::new(before, done, total);
        self.sample_pace(|| progress(&under_way.progress(None)).is_continue())?;
        self.clear()?;
        self.gather_trace();
        if let Some(tracing) = &mut self.tracing {
            tracing.begin_render();
        }
        let (mut row, mut ending) = (0, None);
        while let Some(rows) = kept.film_mut().rows_from(row, self.plan.tile_rows).filter(|_| ending.is_none()) {
            let tile = Tile { first_row: rows.start, rows: rows.end - rows.start };
            let missing =
                |kept: &mut Kept| wanted.iter().find_map(|samples| kept.film_mut().missing(rows.start, samples));
            while let Some(missing) = missing(kept).filter(|_| ending.is_none()) {
                ending = self.render_block(kept, &mut under_way, tile, missing, reads, &mut progress)?;
            }
            finished(self, kept, tile)?;
            row = rows.end;
        }
        kept.film_mut().join();
        // Where there was nothing left to render, the film is told of as it was.
        let statistics = kept.statistics.clone().unwrap_or_else(|| self.nothing());
        kept.keep(statistics.clone());
        Ok(kept.statistics.clone().unwrap_or(statistics))
    }

    /// Renders what a tile lacks of a block.
    fn render_block(
        &mut self,
        kept: &mut Kept,
        under_way: &mut UnderWay,
        tile: Tile,
        Missing { block, from, to }: Missing,
        reads: Reads,
        progress: &mut impl FnMut(&Progress<'_>) -> ControlFlow<Ending>,
    ) -> Result<Option<Ending>, RenderError> {
        let mut recording = Recording::default();
        match kept.film_mut().begun(tile.first_row, block) {
            [] => recording.clear(buffers::FILM),
            begun => recording.upload(buffers::FILM, bytemuck::cast_slice(&begun[..self.pixels_of(tile)])),
        };
        self.executor.run(&recording)?;
        let mut taken = Taken { samples: from, ..Taken::default() };
        let mut ending = None;
        while let Some(batch) = self.next_batch(tile, taken, to)? {
            let work = self.place(batch)?;
            self.render_batch(work)?;
            self.learn();
            taken.add(batch, tile.rows * self.plan.width);
            under_way.add(batch);
            if under_way.counted.elapsed() > COUNT_INTERVAL {
                let waiting = self.gathered.map_or(0, |batch| batch.paths().into());
                under_way.count(&self.counts()?.rays, waiting);
            }
            let begun = Instant::now();
            let of_rows = taken.is_of_rows(self.plan.width);
            let looks = of_rows && reads == Reads::Film && kept.is_due();
            if looks {
                self.look(kept, under_way, tile, block, taken, reads)?;
            }
            ending = progress(&under_way.progress(looks.then_some(&*kept))).break_value();
            if looks {
                (kept.at, kept.cost) = (Instant::now(), begun.elapsed());
            }
            if ending == Some(Ending::Even) && taken.pixels == 0 || ending == Some(Ending::Now) && of_rows {
                break;
            }
        }
        self.look(kept, under_way, tile, block, taken, reads)?;
        Ok(ending)
    }

    /// Takes down what the device has of a block in a tile, and what the render has cost.
    fn look(
        &mut self,
        kept: &mut Kept,
        under_way: &UnderWay,
        tile: Tile,
        block: u32,
        taken: Taken,
        reads: Reads,
    ) -> Result<(), RenderError> {
        self.resolve()?;
        self.executor.wait()?;
        let wall_time = under_way.start.elapsed();
        let pixels = match reads {
            Reads::Film => self.film(tile)?,
            Reads::Nothing => Vec::new(),
        };
        let counts = self.counts()?;
        kept.put(tile, block, taken, pixels);
        kept.keep(self.statistics(counts, under_way, wall_time)?);
        Ok(())
    }

    /// The film of an image of which there is nothing.
    fn empty_film(&self) -> Film {
        Film::new(self.plan.width, self.plan.height, self.settings.block_samples(), self.radiance_scale)
    }

    fn pixels_of(&self, tile: Tile) -> usize {
        tile.rows as usize * self.plan.width as usize
    }

    /// Zeroes all counts and empties the queues.
    pub(super) fn clear(&mut self) -> Result<(), GpuError> {
        self.executor.wait()?;
        let _stage = self.executor.stages().begin("clear");
        let mut recording = Recording::default();
        recording.clear(buffers::RAY_COUNTS);
        if self.counting {
            recording.clear(buffers::WORK_COUNTS);
        }
        self.executor.run(recording.upload(buffers::CONTROL, bytemuck::bytes_of(&empty_queues())))?;
        self.executor.forget_times();
        self.executor.take_submission_seconds();
        self.timed.clear();
        self.gathered = None;
        Ok(())
    }

    /// Samples the cost of paths all over the image, by small batches whose samples are thrown away, before the first
    /// render of a session. Stops when no batch can take long, when more sampling costs more than it is worth, or when
    /// `goes_on` says that the render is to end.
    fn sample_pace(&mut self, mut goes_on: impl FnMut() -> bool) -> Result<(), GpuError> {
        let pixels = self.plan.pixels();
        let paths = pixels * u64::from(self.settings.samples);
        if self.pace.mean() > 0.0 || paths < SAMPLED_RENDER {
            return Ok(());
        }
        self.executor.run(Recording::default().upload(buffers::CONTROL, bytemuck::bytes_of(&empty_queues())))?;
        let sample_count = self.plan.samples_side_by_side().min(self.settings.samples);
        let (mut size, mut spent) = (SAMPLED_PATHS.min(self.plan.path_capacity), 0.0);
        for sampling in 0..SAMPLINGS {
            // The first ones are spread as evenly as all of them.
            let place = u64::from(sampling.reverse_bits() >> (32 - SAMPLINGS.ilog2()));
            let place = pixels * place / u64::from(SAMPLINGS)..pixels * (place + 1) / u64::from(SAMPLINGS);
            let pixel_count = (size / sample_count).min((place.end - place.start) as u32);
            // Each in another column, for the columns of an image may differ as its rows do.
            let aside = (f64::from(sampling) * GOLDEN).fract();
            let spare = place.end - place.start - u64::from(pixel_count);
            let first_pixel = (place.start + (aside * spare as f64) as u64) as u32;
            let batch = SampleRange { first_pixel, pixel_count, first_sample: 0, sample_count, film_pixel: 0 };
            self.render_batch(Work { batch, first_slot: 0, resolves: false })?;
            self.executor.wait()?;
            let seconds = self.executor.take_submission_seconds().into_iter().fold(0.0, f64::max);
            self.timed.clear();
            self.pace.note_sampling(batch, place, seconds);
            spent += seconds;
            let longest = self.pace.most_expensive() * f64::from(self.plan.path_capacity) * SURPRISE;
            let is_sure = longest < Pace::BATCH_SECONDS;
            if is_sure || spent > self.pace.mean() * paths as f64 * SAMPLING_SHARE || !goes_on() {
                break;
            }
            if seconds < SAMPLING_SECONDS {
                size = (8 * size).min(self.plan.path_capacity);
            }
        }
        Ok(())
    }

    /// The batch that follows in a tile that is to have the samples below `end`, of as many paths as the pace allows.
    fn next_batch(&mut self, tile: Tile, taken: Taken, end: u32) -> Result<Option<SampleRange>, GpuError> {
        let samples = if taken.pixels > 0 { taken.more } else { self.plan.samples_side_by_side() };
        let width = self.plan.width;
        let mut paths = self.pace.paths(tile, width, taken.pixels, samples);
        if paths < self.plan.path_capacity && self.pace.is_growing(paths) {
            // What is under way tells whether it may be more.
            self.executor.wait()?;
            self.learn();
            paths = self.pace.paths(tile, width, taken.pixels, samples);
        }
        let pass_paths = self.pace.paths_within(tile, width, taken.pixels, samples, PASS_SECONDS) as u32;
        Ok(self.plan.next_batch(tile, taken, end, paths, pass_paths))
    }

    /// Reports the batches that have ended to the pace.
    fn learn(&mut self) {
        for seconds in self.executor.take_submission_seconds() {
            self.longest = self.longest.max(seconds);
            if let Some(batch) = self.timed.pop_front().flatten() {
                self.pace.note(batch, std::mem::take(&mut self.longest));
            }
        }
    }

    /// Submits a recording; the last of a batch names the batch.
    fn submit(&mut self, recording: &Recording, ends: Option<SampleRange>) -> Result<(), GpuError> {
        self.executor.submit(recording)?;
        self.expect(ends);
        Ok(())
    }

    /// Expects the times of a recording that was just started.
    fn expect(&mut self, ends: Option<SampleRange>) {
        self.timed.push_back(ends);
        if let Some(tracing) = &mut self.tracing {
            tracing.expect(ends.is_some() || !self.schedule.has_queues());
        }
        self.gather_trace();
    }

    /// Runs the part of a frame that is recorded so far, empties the recording and looks at the queues: their counts, and
    /// what the recording's own downloads found.
    pub(super) fn run_part(&mut self, frame: &mut Recording) -> Result<(Control, Vec<Vec<u8>>), GpuError> {
        frame.download(buffers::CONTROL);
        let mut found = self.executor.run(&std::mem::take(frame))?;
        self.expect(None);
        let control = found.pop().expect("it was the last download");
        Ok((bytemuck::pod_read_unaligned(&control), found))
    }

    /// Reads the first `count` records of a buffer, after everything that was submitted.
    pub(super) fn read<A: Pod>(&mut self, buffer: &'static str, count: u32) -> Result<Vec<A>, GpuError> {
        let mut recording = Recording::default();
        recording.download_first(buffer, u64::from(count) * size_of::<A>() as u64);
        let mut records = Vec::with_capacity(count as usize);
        self.executor.run_seen(&recording, |_, _, part| records.extend_from_slice(bytemuck::cast_slice(part)))?;
        Ok(records)
    }

    /// Where in the path slots a batch goes, and whether it is resolved at once.
    ///
    /// Batches of the megakernel share the slots, and one resolve, as long as they fit: between two other kernels lavapipe
    /// forgets so long a kernel.
    fn place(&mut self, batch: SampleRange) -> Result<Work, GpuError> {
        if self.schedule.has_queues() {
            return Ok(Work { batch, first_slot: 0, resolves: true });
        }
        let fits = |all: &SampleRange| all.paths() <= self.plan.path_capacity;
        let gathered = match self.gathered.and_then(|before| before.with(batch)).filter(fits) {
            Some(gathered) => gathered,
            None => {
                self.resolve()?;
                batch
            }
        };
        self.gathered = Some(gathered);
        Ok(Work { batch, first_slot: gathered.paths() - batch.paths(), resolves: false })
    }

    /// Runs the frame of a batch. Where its last bounces were not waited for, they may still be under way.
    fn render_batch(&mut self, work: Work) -> Result<(), GpuError> {
        let schedule = self.schedule;
        let mut frame = Recording::default();
        schedule.record(&mut frame, work, |frame, bounce| {
            if bounce == 0 || !bounce.is_multiple_of(BOUNCES_AT_ONCE) || bounce == schedule.vertices() {
                return Ok(true);
            }
            Ok(self.run_part(frame)?.0.current_rays > 0)
        })?;
        self.submit(&frame, Some(work.batch))
    }

    /// Adds what the megakernel has gathered to the film.
    fn resolve(&mut self) -> Result<(), GpuError> {
        let Some(samples) = self.gathered.take() else { return Ok(()) };
        let mut recording = Recording::default();
        self.schedule.resolve(&mut recording, samples);
        self.submit(&recording, None)
    }

    /// Reads what the device has counted, after everything that was submitted.
    fn counts(&mut self) -> Result<Counts, GpuError> {
        let mut recording = Recording::default();
        recording.download(buffers::CONTROL).download(buffers::RAY_COUNTS);
        if self.counting {
            recording.download(buffers::WORK_COUNTS);
        }
        self.executor.wait()?;
        let _stage = self.executor.stages().begin("read counts");
        let found = self.executor.run(&recording)?;
        Ok(Counts {
            control: bytemuck::pod_read_unaligned(&found[0]),
            rays: bytemuck::pod_collect_to_vec(&found[1]),
            work: found.get(2).map_or(Vec::new(), |work| bytemuck::pod_collect_to_vec(work)),
        })
    }

    /// Reads the film of the tile under way.
    fn film(&mut self, tile: Tile) -> Result<Vec<FilmPixel>, GpuError> {
        let mut film = Vec::new();
        self.visit_film(tile, |pixels| film.extend_from_slice(pixels))?;
        Ok(film)
    }

    /// Reads the mean of every pixel of a tile that has all samples in one block, as [`FilmMoments::mean`] has it.
    fn mean(&mut self, tile: Tile, means: &mut Vec<Vec3>) -> Result<(), GpuError> {
        let (scale, samples) = (self.radiance_scale, f64::from(self.settings.samples));
        let mean = |pixel: &FilmPixel| (DVec3::from_array(PixelSums::of(pixel).sum) / scale / samples).as_vec3();
        self.visit_film(tile, |pixels| means.par_extend(pixels.par_iter().map(mean)))
    }

    /// Reads the pixels of the tile under way and shows them in parts, from the top.
    fn visit_film(&mut self, tile: Tile, mut show: impl FnMut(&[FilmPixel])) -> Result<(), GpuError> {
        self.resolve()?;
        self.executor.wait()?;
        let _stage = self.executor.stages().begin("read film");
        let mut recording = Recording::default();
        self.schedule.read(&mut recording, tile);
        self.executor.run_seen(&recording, |_, _, part| show(bytemuck::cast_slice(part)))
    }

    /// What a render has cost before it begins, with the choices that it will take.
    pub fn nothing(&self) -> Statistics {
        Statistics {
            samples: 0,
            rows: 0,
            bands: Vec::new(),
            tile_rows: self.plan.tile_rows,
            sample_count: 0,
            camera_rays: 0,
            bounce_rays: 0,
            shadow_rays: 0,
            nonfinite_samples: 0,
            nonfinite_traced: Vec::new(),
            wall_time: Duration::ZERO,
            gpu_seconds: 0.0,
            idle: Idle::default(),
            passes: BTreeMap::new(),
            ray_counts: Vec::new(),
            memory_bytes: self.executor.memory_bytes(),
            choices: Choices {
                fetch: if self.executor.access().texel_fetch { Fetch::Texel } else { Fetch::Storage },
                workgroup_size: self.plan.workgroup_size,
                ..self.choices
            },
            paths_in_flight: self.plan.path_capacity,
            paths_per_invocation: self.plan.paths_per_invocation,
            work_counts: Vec::new(),
        }
    }

    /// What a render has cost so far, with what it had cost before in another session. No batch is under way.
    fn statistics(
        &mut self,
        Counts { control, rays, work }: Counts,
        UnderWay { before, taken, .. }: &UnderWay,
        wall_time: Duration,
    ) -> Result<Statistics, RenderError> {
        if control.cut_loops != 0 {
            return Err(RenderError::CutLoops);
        }
        let mut nonfinite_traced = control.traced_samples.to_vec();
        nonfinite_traced.truncate(control.nonfinite_samples as usize);
        nonfinite_traced.extend(&before.nonfinite_traced);
        nonfinite_traced.sort_unstable();
        nonfinite_traced.truncate(TRACED_SAMPLES as usize);
        let rays = sums(rays, &before.ray_counts, RayCount::plus);
        let work = sums(work, &before.work_counts, WorkCount::plus);
        let (bounce_rays, shadow_rays) = scattered_rays(&rays);
        let mut passes = before.passes.clone();
        for (pass, time) in self.executor.kernel_times() {
            let total = passes.entry(*pass).or_default();
            total.seconds += time.seconds;
            total.launches += time.launches;
        }
        let sample_count = before.sample_count + taken;
        Ok(Statistics {
            sample_count,
            camera_rays: sample_count,
            bounce_rays,
            shadow_rays,
            nonfinite_samples: before.nonfinite_samples + control.nonfinite_samples,
            nonfinite_traced,
            wall_time: before.wall_time + wall_time,
            gpu_seconds: before.gpu_seconds + self.executor.device_seconds(),
            idle: self.executor.idle(),
            passes,
            ray_counts: rays,
            work_counts: work,
            ..self.nothing()
        })
    }
}

/// Counts that go on from those of an earlier session, if there was one.
fn sums<T>(mut counts: Vec<T>, before: &[T], plus: impl Fn(&T, &T) -> T) -> Vec<T> {
    counts.iter_mut().zip(before).for_each(|(count, before)| *count = plus(count, before));
    counts
}

/// What a render reads of the device's film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reads {
    /// All of it.
    Film,
    /// Nothing, since it is timed, or read by other means.
    Nothing,
}

/// Goes on to the end.
fn whole(_: &Progress<'_>) -> ControlFlow<Ending> {
    ControlFlow::Continue(())
}

/// How far a render is.
struct UnderWay {
    start: Instant,
    /// What it had cost in another session.
    before: Statistics,
    /// Samples that this session took, those that the film has of the ones wanted, and all of the latter.
    taken: u64,
    done: u64,
    total: u64,
    rays_per_sample: f64,
    /// When the device's counts were last looked at.
    counted: Instant,
}

impl UnderWay {
    fn new(before: Statistics, done: u64, total: u64) -> Self {
        let start = Instant::now();
        Self { start, before, taken: 0, done, total, rays_per_sample: 1.0, counted: start }
    }

    fn add(&mut self, batch: SampleRange) {
        self.taken += u64::from(batch.paths());
        self.done += u64::from(batch.paths());
    }

    /// Heeds what the device has counted; `waiting` samples are not in it.
    fn count(&mut self, counts: &[RayCount], waiting: u64) {
        let (bounce_rays, shadow_rays) = scattered_rays(counts);
        let known = self.taken - waiting;
        self.rays_per_sample = 1.0 + (bounce_rays + shadow_rays) as f64 / known.max(1) as f64;
        self.counted = Instant::now();
    }

    fn progress<'a>(&self, looked: Option<&'a Kept>) -> Progress<'a> {
        let taken = self.before.sample_count + self.taken;
        Progress {
            samples_done: self.done,
            samples_total: self.total,
            samples_taken: taken,
            rays: (taken as f64 * self.rays_per_sample) as u64,
            elapsed: self.before.wall_time + self.start.elapsed(),
            error: None,
            looked,
        }
    }
}

/// What the device has counted.
struct Counts {
    control: Control,
    /// By bounce.
    rays: Vec<RayCount>,
    /// By bounce and stage, where kernels count; else empty.
    work: Vec<WorkCount>,
}

/// Nothing is queued or counted. Launches that the device sizes have one workgroup in height and depth, which no kernel
/// writes.
fn empty_queues() -> Control {
    Control { ray_groups: [0, 1, 1], shadow_groups: [0, 1, 1], ..bytemuck::Zeroable::zeroed() }
}

/// What a plan must know of a device.
pub(super) fn limits(device: &Device) -> DeviceLimits {
    let description = device.description();
    DeviceLimits {
        max_workgroup_size: description.max_workgroup_size,
        max_workgroups: description.max_workgroups,
        max_storage_buffer_bytes: description.max_storage_buffer_bytes,
        max_film_bytes: description.max_storage_buffer_bytes,
    }
}

/// Builds those kernels, with the buffers that they bind.
pub(super) fn open_executor(
    device: &Device,
    scene: &PreparedScene,
    settings: &Settings,
    plan: &Plan,
    kernels: &[&'static Kernel],
    options: SessionOptions,
) -> Result<Executor, RenderError> {
    if settings.packets.unwrap_or_default() != Packets::default() && !device.description().packets() {
        return Err(RenderError::NoPackets);
    }
    let edition = if options.counting { Edition::Counting } else { Edition::Plain };
    let defaults = Defaults::of(device)?;
    let arithmetic = match settings.numerics {
        // Kernels that count have no use for speed.
        _ if settings.fast_math && !options.counting => Arithmetic::Contracted,
        Numerics::Native => Arithmetic::Native,
        Numerics::Portable => Arithmetic::Portable(options.forms.unwrap_or(defaults.forms)),
    };
    let frame = scene.frame(settings, plan.path_capacity);
    let executor = Executor::new(
        device,
        ExecutorDescription {
            kernels,
            specialization: &scene.specialization(settings, plan),
            buffers: scene_buffers(scene, settings, &frame)
                .chain(path_buffers(plan, settings.sort, &scene.needs(settings)))
                .collect(),
            access: options.access.unwrap_or_else(|| defaults.access(settings)),
            edition,
            arithmetic,
            driver: options.driver,
        },
    )?;
    Ok(executor)
}
