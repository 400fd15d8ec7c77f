//! The renderer that studies measure: sessions on a device, one for each configuration.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::error::Error;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, anyhow};

use super::host::{memory, sign};
use super::kernels::{compiled_kernels, stage};
use super::record::settings_record;
use super::start_up::{Contrast, FirstSample, StartUp};
use super::tuning::Tuning;
use crate::studies::{
    BounceRow, Configuration, KernelRow, Measurement, PipelineBuild, Provenance, Purpose, Rays, Renderer, SceneFacts,
    StageWork, WarmUpRow, WorkCounters,
};
use raywave::bvh::BvhKind;
use raywave::clocks::{self, Clocks};
use raywave::constants::{STAGE_CONNECT, STAGE_EXTEND, STAGE_SHADE, STAGES};
use raywave::gpu::{Device, GpuError};
use raywave::layout::WorkCount;
use raywave::render::{
    Defaults, PrepareError, PreparedScene, RenderError, Session, SessionOptions, Statistics, WarmUp, Warmth,
};
use raywave::scene::{LoadOptions, Scene};
use raywave::settings::{Instances, PathState, Scheduler, Settings, ShadowRays, Sort};

/// The settings of a scene, before a configuration changes them.
pub type SettingsOf = dyn Fn(&Scene) -> anyhow::Result<Settings>;

/// What a study's renders are to be.
pub struct Asked {
    /// How each scene is loaded.
    pub load: LoadOptions,
    /// The settings of each scene.
    pub settings: Box<SettingsOf>,
    /// Whether a tuning stands in for what the settings leave open.
    pub tuned: bool,
    /// How start-up is measured, if it is.
    pub start_up: Option<StartUp>,
    /// Hears what does not keep a study from going on.
    pub warn: Box<dyn FnMut(&str)>,
}

/// Renders scenes on a device by the configurations of a study.
pub struct DeviceRenderer {
    device: Device,
    defaults: Defaults,
    asked: Asked,
    scene: Option<OpenScene>,
    /// Kept between renders of a configuration, so that timed ones find everything built.
    sessions: HashMap<String, Session>,
    /// Bytes of device memory that they may hold together before one of them is closed.
    sessions_bytes: u64,
    /// The key of the one that was made last.
    newest: Option<String>,
    pulse: Pulse,
}

/// When the device was last at work, so that nothing is timed on one that has fallen asleep.
struct Pulse {
    software: bool,
    last: Option<Instant>,
    clocks: Option<Box<dyn Clocks>>,
}

impl Pulse {
    /// A timed render on a steady device, and what the device was like before and after.
    fn time<T>(
        &mut self,
        session: &mut Session,
        settings: &Settings,
        render: impl FnOnce(&mut Session) -> Result<(T, Statistics), RenderError>,
    ) -> Result<(T, Measurement), RenderError> {
        let warm_up = self.steady(session)?;
        let state = |clocks: &Option<Box<dyn Clocks>>| clocks.as_ref().map(|clocks| clocks.state());
        let clocks_before = state(&self.clocks);
        let (image, statistics) = render(session)?;
        let clocks_after = state(&self.clocks);
        self.last = Some(Instant::now());
        let measured = measurement(settings, &statistics);
        Ok((image, Measurement { warm_up, clocks_before, clocks_after, ..measured }))
    }

    /// Renders until the device is steady, unless it has just been at work.
    fn steady(&self, session: &mut Session) -> Result<Option<WarmUpRow>, RenderError> {
        if !WarmUp::is_due(self.software, self.last.map(|last| last.elapsed())) {
            return Ok(None);
        }
        let render = |_| Ok::<_, RenderError>((session.time()?.wall_time.as_secs_f64(), 1.0));
        let Warmth { seconds, steady, .. } = WarmUp::of(self.software).run(render)?;
        Ok(Some(WarmUpRow { seconds, steady }))
    }
}

struct OpenScene {
    scene: Scene,
    /// `None` for the built-in one.
    path: Option<PathBuf>,
    settings: Settings,
    /// What suits the device, and what a tuning found for scenes of the size.
    defaults: Defaults,
    /// By the shape of its BVH and what that does with placed meshes, as far as configurations have asked for it.
    prepared: HashMap<(BvhKind, Instances), PreparedScene>,
}

impl OpenScene {
    /// The scene with the BVH that the settings ask for or else suits the device.
    fn prepare(&mut self, settings: &Settings) -> Result<&PreparedScene, PrepareError> {
        let (kind, instances) = self.defaults.tree(settings, &self.scene);
        match self.prepared.entry((kind, instances)) {
            Entry::Occupied(entry) => Ok(entry.into_mut()),
            Entry::Vacant(entry) => Ok(entry.insert(PreparedScene::with_tree(&self.scene, kind, instances)?)),
        }
    }
}

/// Samples that a session is planned for that renders fewer as well: enough for all paths that a device
/// takes at once, so that no number of samples runs with fewer than it could.
const ROOMY_SAMPLES: u32 = 64;

impl DeviceRenderer {
    /// A renderer of what was asked for, on a device.
    ///
    /// # Errors
    /// A device that fails.
    pub fn new(device: Device, asked: Asked) -> Result<Self, GpuError> {
        let defaults = Defaults::of(&device)?;
        let clocks = clocks::of_device(device.description().uuid);
        let pulse = Pulse { software: device.description().is_software(), last: None, clocks };
        let sessions_bytes = memory(device.description()) / 2;
        Ok(Self { device, defaults, asked, scene: None, sessions: HashMap::new(), sessions_bytes, newest: None, pulse })
    }

    /// Adds what the device is to a record.
    pub fn sign(&self, provenance: Provenance) -> Provenance {
        sign(self.device.description(), provenance)
    }

    fn open_scene(&mut self, path: &str) -> anyhow::Result<SceneFacts> {
        self.sessions.clear();
        let path = (!path.is_empty()).then(|| PathBuf::from(path));
        let scene = match path.as_deref() {
            Some(path) => Scene::load_with(path, &self.asked.load)?,
            None => Scene::cornell_box(),
        };
        scene.warnings.iter().for_each(|warning| (self.asked.warn)(warning));
        let settings = (self.asked.settings)(&scene)?;
        let (name, hash) = (scene.name.clone(), scene.hash.clone());
        let tuning = match self.asked.tuned {
            true => Tuning::of_scene(self.device.description(), &scene, &mut self.asked.warn),
            false => Tuning::default(),
        };
        let defaults = self.defaults.with(tuning.chosen());
        let mut open = OpenScene { path, scene, settings, defaults, prepared: HashMap::new() };
        let prepared = open.prepare(&settings)?;
        let facts = SceneFacts {
            scene: name,
            scene_hash: hash,
            width_pixels: settings.width,
            height_pixels: settings.height,
            samples_per_pixel: settings.samples,
            settings,
            triangles: prepared.triangle_count,
            bvh_nodes: prepared.bvh.node_count as u64,
        };
        self.scene = Some(open);
        Ok(facts)
    }

    fn render(&mut self, configuration: &Configuration, purpose: Purpose) -> anyhow::Result<Measurement> {
        let scene = self.scene.as_mut().context("a scene is opened before it is rendered")?;
        let settings = configuration.of(scene.settings).map_err(|problem| anyhow!(problem))?;
        let options = SessionOptions { tuned: scene.defaults.tuned, ..SessionOptions::default() };
        let key = configuration.to_string();
        match purpose {
            Purpose::First => self.render_first(settings, options, key),
            Purpose::Timed => {
                let session = self.sessions.get_mut(&key).context("a configuration is timed after its first render")?;
                let ((), measured) = self.pulse.time(session, &settings, |session| Ok(((), session.time()?)))?;
                Ok(measured)
            }
            Purpose::Seeded(seed) => {
                self.render_seeded(settings, options, &configuration.without("samples").to_string(), seed)
            }
            Purpose::Counting => {
                let options = SessionOptions { counting: true, ..options };
                let lanes = self.device.description().subgroup_size;
                let mut session = Session::with_options(&self.device, scene.prepare(&settings)?, &settings, options)?;
                let (image, statistics) = session.render_image()?;
                let counters = Some(work_counters(&statistics.work_counts, lanes));
                // Counting kernels are exact: they have another image where the others are not.
                let image = (!settings.fast_math).then_some(image);
                Ok(Measurement { counters, image, ..measurement(&settings, &statistics) })
            }
        }
    }

    /// The first render of a configuration: from nothing to an image.
    fn render_first(
        &mut self,
        settings: Settings,
        options: SessionOptions,
        key: String,
    ) -> anyhow::Result<Measurement> {
        let scene = self.scene.as_mut().context("a scene is opened before it is rendered")?;
        let prepared = scene.prepare(&settings)?;
        let mut session = Session::with_options(&self.device, prepared, &settings, options)?;
        let (image, statistics) = session.render_image()?;
        let mut measured = measurement(&settings, &statistics);
        measured.settings = settings_record(&settings, &statistics);
        measured.image = Some(image);
        measured.compiled_kernels = compiled_kernels(&session, self.device.description())?;
        self.sessions.insert(key, session);
        self.start_up(&settings, &mut measured);
        Ok(measured)
    }

    /// A render by the random numbers of a seed, with the session that all numbers of samples share.
    fn render_seeded(
        &mut self,
        settings: Settings,
        options: SessionOptions,
        key: &str,
        seed: u32,
    ) -> anyhow::Result<Measurement> {
        let scene = self.scene.as_mut().context("a scene is opened before it is rendered")?;
        let prepared = scene.prepare(&settings)?;
        if !self.sessions.contains_key(key) {
            let held: u64 = self.sessions.values().map(Session::memory_bytes).sum();
            if held > self.sessions_bytes {
                // The newest: rounds go over all of them, so the others come before it again.
                self.newest.take().and_then(|newest| self.sessions.remove(&newest));
            }
            let roomy = Settings { samples: settings.samples.max(ROOMY_SAMPLES), ..settings };
            let session = Session::with_options(&self.device, prepared, &roomy, options)?;
            self.sessions.insert(key.to_owned(), session);
            self.newest = Some(key.to_owned());
        }
        let session = self.sessions.get_mut(key).context("the session is open")?;
        session.reseed(prepared, seed, settings.samples)?;
        let (image, measured) = self.pulse.time(session, &settings, Session::render_image)?;
        Ok(Measurement { image: Some(image), ..measured })
    }

    /// Measures start-up in processes of its own. Without it a comparison is still worth its while.
    fn start_up(&mut self, settings: &Settings, measured: &mut Measurement) {
        let Some(start_up) = &self.asked.start_up else { return };
        let Some(scene) = &self.scene else { return };
        let first = FirstSample { settings: *settings, tuned: scene.defaults.tuned, load: self.asked.load.clone() };
        match start_up.measure(scene.path.as_deref(), &first) {
            Ok(start_ups) => {
                let Contrast { cold, cached } = start_ups.seconds();
                measured.cold_start_up_seconds = Some(cold.value);
                measured.cached_start_up_seconds = Some(cached.value);
                let build = |(kernel, Contrast { cold, cached })| PipelineBuild {
                    kernel,
                    cold_seconds: Some(cold.value),
                    cached_seconds: Some(cached.value),
                };
                measured.pipelines = start_ups.pipelines().into_iter().map(build).collect();
            }
            Err(error) => {
                // What failed once would fail again.
                self.asked.start_up = None;
                (self.asked.warn)(&format!("start-up and compile times are not measured: {error:#}"));
            }
        }
    }
}

impl Renderer for DeviceRenderer {
    fn open(&mut self, scene: &str) -> Result<SceneFacts, Box<dyn Error + Send + Sync>> {
        self.open_scene(scene).map_err(|error| format!("{error:#}").into())
    }

    fn run(
        &mut self,
        configuration: &Configuration,
        purpose: Purpose,
    ) -> Result<Measurement, Box<dyn Error + Send + Sync>> {
        self.render(configuration, purpose).map_err(|error| format!("{error:#}").into())
    }
}

/// What a render cost, as a study records it.
fn measurement(settings: &Settings, statistics: &Statistics) -> Measurement {
    let kernels = statistics.kernels();
    let mut rows: Vec<_> = kernels
        .iter()
        .map(|(kernel, time)| KernelRow {
            kernel: (*kernel).to_owned(),
            gpu_seconds: time.seconds,
            launches: time.launches,
        })
        .collect();
    rows.sort_by_key(|row| stage(&row.kernel));
    Measurement {
        wall_seconds: statistics.wall_time.as_secs_f64(),
        gpu_seconds: statistics.gpu_seconds,
        idle_seconds: statistics.idle.between,
        idle_before_seconds: statistics.idle.before,
        samples: statistics.sample_count,
        nonfinite_samples: statistics.nonfinite_samples.into(),
        rays: Rays { camera: statistics.camera_rays, bounce: statistics.bounce_rays, shadow: statistics.shadow_rays },
        kernels: rows,
        bounces: bounce_rows(statistics),
        memory_bytes: statistics.memory_bytes,
        path_state_bytes: path_state_bytes(settings, statistics),
        ..Measurement::default()
    }
}

/// What a kernel does, whether by single rays or by packets.
fn stage_of(kernel: &str) -> &str {
    kernel.trim_end_matches("_packets")
}

/// Time and items of each bounce's kernels; the megakernel has none.
fn bounce_rows(statistics: &Statistics) -> Vec<BounceRow> {
    let staged = |kernel: &str| ["extend", "shade", "connect", "bounce"].contains(&stage_of(kernel));
    let mut rows: Vec<_> = statistics
        .passes
        .iter()
        .filter(|((kernel, _), _)| staged(kernel))
        .map(|((kernel, bounce), time)| BounceRow {
            bounce: *bounce,
            kernel: stage_of(kernel).to_owned(),
            gpu_seconds: time.seconds,
            items: statistics.ray_counts.get(*bounce as usize).map_or(0, |count| match (stage_of(kernel), *bounce) {
                ("connect", _) => count.shadow_rays(),
                (_, 0) => statistics.camera_rays,
                _ => count.rays(),
            }),
        })
        .collect();
    rows.sort_by_key(|row| row.bounce);
    rows
}

/// Work by stage and bounce, and in all, with subgroups of that many lanes.
fn work_counters(counts: &[WorkCount], lanes: u32) -> WorkCounters {
    let names = [(STAGE_EXTEND, "extend"), (STAGE_SHADE, "shade"), (STAGE_CONNECT, "connect")];
    let stages = (counts.chunks_exact(STAGES as usize).zip(0..)).flat_map(|(bounce_counts, bounce)| {
        names.map(|(stage, name)| {
            let count = bounce_counts[stage as usize];
            StageWork {
                bounce,
                stage: name.to_owned(),
                items: count.items(),
                nodes_visited: count.nodes(),
                triangles_tested: count.triangles(),
                lane_steps: count.steps() * u64::from(lanes),
            }
        })
    });
    WorkCounters { stages: stages.filter(|work| work.items > 0).collect() }
}

/// Bytes of path state that the kernels read and write, from the records of `bindings_path.glsl`
/// and the items of the queues.
fn path_state_bytes(settings: &Settings, statistics: &Statistics) -> u64 {
    let samples = statistics.sample_count;
    let rays = samples + statistics.bounce_rays;
    // Paths that never scatter keep no throughput, and with halves it lies beside the direction.
    let unscattered = settings.specialize && settings.max_bounces == Some(0);
    let throughput = if unscattered || settings.path_state == PathState::F16 { 0 } else { 16 };
    // Generate writes origin, direction, throughput, radiance and a queue entry.
    let generated = (3 * 16 + throughput + 4) * samples;
    // At most all shadow rays reach the light, and then read and write a radiance.
    let gathered = 2 * 16 * statistics.shadow_rays;
    // Connect reads three records of a shadow ray, which shade or bounce writes.
    let shadows = 2 * 3 * 16 * statistics.shadow_rays + gathered;
    // The radiance that resolve reads.
    let resolved = 16 * samples;
    match statistics.choices.scheduler {
        Scheduler::Megakernel => 16 * samples + resolved,
        Scheduler::Bounce => {
            // Bounce reads a queue entry, origin, direction and throughput, and writes them of what
            // goes on.
            let paths = (2 * 16 + throughput + 4) * (rays + statistics.bounce_rays);
            generated + paths + if settings.shadow_rays == ShadowRays::Deferred { shadows } else { gathered } + resolved
        }
        Scheduler::Wavefront => {
            // Extend reads a queue entry, origin and direction and writes a hit; shade reads a
            // queue entry, direction, throughput and hit.
            let traced = (4 + 3 * 16 + 4 + 2 * 16 + throughput) * rays;
            // Shade writes origin, direction, throughput and a queue entry of what goes on.
            let continued = (3 * 16 + 4) * statistics.bounce_rays;
            // A sort reads queue entry and hit twice, and writes and reads the sorted queue.
            let sorted = if settings.sort == Sort::None { 0 } else { 2 * (4 + 16) + 4 + 4 } * rays;
            generated + traced + sorted + continued + shadows + resolved
        }
    }
}
