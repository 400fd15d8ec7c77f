//! A renderer without a GPU: its times are drawn from distributions that a test knows.
#![allow(dead_code, reason = "each test file uses its part")]

use std::cell::Cell;
use std::error::Error;

use glam::Vec3;
use raywave::clocks::{ClockState, Clocks};
use raywave::image::Image;
use raywave_studies::stats::{SplitMix64, normal_quantile};
use raywave_studies::studies::{
    BounceRow, Clock, CompiledKernelRow, Configuration, Design, ExecutableRow, Factor, FigureRow, KernelRow,
    Measurement, PipelineBuild, Purpose, Rays, Renderer, Rounds, SceneFacts, StageWork, Study, WarmUpRow, WorkCounters,
};

/// What a render is asked for: scene, configuration, purpose, and how many timed ones of this
/// configuration and scene there were before.
pub struct Call<'a> {
    pub scene: &'a str,
    pub configuration: &'a Configuration,
    pub purpose: Purpose,
    pub before: usize,
}

/// A card whose clock goes through a list, over and over, one reading after the other.
pub struct FakeClocks {
    pub megahertz: Vec<u32>,
    pub reasons: Vec<String>,
    pub readings: Cell<usize>,
}

impl Clocks for FakeClocks {
    fn state(&self) -> ClockState {
        let reading = self.readings.replace(self.readings.get() + 1);
        ClockState {
            sm_megahertz: Some(self.megahertz[reading % self.megahertz.len()]),
            memory_megahertz: None,
            power_watts: Some(250.5),
            temperature_celsius: Some(61),
            throttle_reasons: Some(self.reasons.clone()),
        }
    }
}

type Model<T> = Box<dyn FnMut(&Call<'_>, &mut SplitMix64) -> T>;

pub struct FakeRenderer {
    pub scene: String,
    /// Wall seconds.
    pub seconds: Model<f64>,
    pub image: Model<Option<Image>>,
    /// A message where it fails.
    pub failure: Model<Option<String>>,
    /// How the device was warmed up before.
    pub warm_up: Model<Option<WarmUpRow>>,
    /// Asked before and after every render, where there are any.
    pub clocks: Option<FakeClocks>,
    pub random: SplitMix64,
    /// Every call so far.
    pub log: Vec<(String, Configuration, Purpose)>,
}

impl FakeRenderer {
    /// A renderer with these times, whose images are all alike.
    pub fn new(seconds: impl FnMut(&Call<'_>, &mut SplitMix64) -> f64 + 'static) -> Self {
        Self {
            scene: String::new(),
            seconds: Box::new(seconds),
            image: Box::new(|_, _| Some(gradient(8, 8))),
            failure: Box::new(|_, _| None),
            warm_up: Box::new(|_, _| None),
            clocks: None,
            random: SplitMix64::new(1),
            log: Vec::new(),
        }
    }
}

impl Renderer for FakeRenderer {
    fn open(&mut self, scene: &str) -> Result<SceneFacts, Box<dyn Error + Send + Sync>> {
        if scene == "missing" {
            return Err("no such file".into());
        }
        self.scene = scene.to_owned();
        Ok(SceneFacts {
            scene: scene.to_owned(),
            scene_hash: "a0".repeat(32),
            width_pixels: 8,
            height_pixels: 8,
            samples_per_pixel: 64,
            triangles: 12_345,
            bvh_nodes: 6_789,
            ..SceneFacts::default()
        })
    }

    fn run(
        &mut self,
        configuration: &Configuration,
        purpose: Purpose,
    ) -> Result<Measurement, Box<dyn Error + Send + Sync>> {
        let same = |entry: &&(String, Configuration, Purpose)| {
            entry.0 == self.scene && entry.1 == *configuration && entry.2 == purpose
        };
        let before = self.log.iter().filter(same).count();
        self.log.push((self.scene.clone(), configuration.clone(), purpose));
        let call = Call { scene: &self.scene, configuration, purpose, before };
        if let Some(message) = (self.failure)(&call, &mut self.random) {
            return Err(message.into());
        }
        let state = |clocks: &Option<FakeClocks>| clocks.as_ref().map(|clocks| clocks.state());
        let clocks_before = state(&self.clocks);
        let wall_seconds = (self.seconds)(&call, &mut self.random);
        Ok(Measurement {
            warm_up: (self.warm_up)(&call, &mut self.random),
            clocks_before,
            clocks_after: state(&self.clocks),
            image: (self.image)(&call, &mut self.random),
            counters: (purpose == Purpose::Counting).then(|| work(configuration)),
            ..cost(configuration, purpose, wall_seconds)
        })
    }
}

/// What a render might have counted: 23.4 nodes and 4.56 triangles a ray.
fn work(configuration: &Configuration) -> WorkCounters {
    let share = if configuration.level("scheduler") == Some("megakernel") { 0.48 } else { 0.71 };
    let stage = |stage: &str, bounce, items: u64, nodes, triangles| {
        let active = if stage == "shade" { items } else { nodes + triangles };
        StageWork {
            bounce,
            stage: stage.to_owned(),
            items,
            nodes_visited: nodes,
            triangles_tested: triangles,
            lane_steps: (active as f64 / share) as u64,
        }
    };
    let bounce = |bounce: u32| {
        let items = 600_000 >> bounce;
        [
            stage("extend", bounce, items, 25 * items, 5 * items),
            stage("shade", bounce, items, 0, 0),
            stage("connect", bounce, items / 3, 186 * (items / 3) / 10, 324 * (items / 3) / 100),
        ]
    };
    WorkCounters { stages: (0..6).flat_map(bounce).collect() }
}

/// What a render of that time might have cost.
fn cost(configuration: &Configuration, purpose: Purpose, wall_seconds: f64) -> Measurement {
    let gpu_seconds = 0.96 * wall_seconds;
    let rays = Rays { camera: 1_048_576, bounce: 2_700_000, shadow: 2_100_000 };
    let mut measurement = Measurement {
        wall_seconds,
        gpu_seconds,
        samples: 1_048_576,
        rays,
        memory_bytes: 190 << 20,
        ..Measurement::default()
    };
    let kernel = |kernel: &str, share: f64, launches| KernelRow {
        kernel: kernel.to_owned(),
        gpu_seconds: share * gpu_seconds,
        launches,
    };
    if configuration.level("scheduler") == Some("megakernel") {
        measurement.kernels = vec![kernel("megakernel", 0.985, 64), kernel("resolve", 0.015, 64)];
    } else {
        measurement.path_state_bytes = 2_400_000_000;
        measurement.kernels = vec![
            kernel("generate", 0.03, 64),
            kernel("extend", 0.46, 576),
            kernel("shade", 0.24, 576),
            kernel("connect", 0.22, 576),
            kernel("prepare_dispatch", 0.02, 576),
            kernel("resolve", 0.03, 64),
        ];
        for bounce in 0..9 {
            let alive = 0.72_f64.powi(bounce as i32);
            for (kernel, share, items) in
                [("extend", 0.46, alive), ("shade", 0.24, 0.94 * alive), ("connect", 0.22, 0.63 * alive)]
            {
                measurement.bounces.push(BounceRow {
                    bounce,
                    kernel: kernel.to_owned(),
                    gpu_seconds: share * gpu_seconds * alive * 0.29,
                    items: (1_048_576.0 * items) as u64,
                });
            }
        }
    }
    if purpose == Purpose::First {
        let build = |row: &KernelRow| PipelineBuild {
            kernel: row.kernel.clone(),
            cold_seconds: Some(0.04),
            cached_seconds: Some(0.002),
        };
        measurement.pipelines = measurement.kernels.iter().map(build).collect();
        measurement.compiled_kernels = measurement.kernels.iter().map(|row| compiled(&row.kernel)).collect();
        measurement.cold_start_up_seconds = Some(0.61);
        measurement.cached_start_up_seconds = Some(0.29);
        let varied = configuration.iter().map(|(factor, level)| (factor.to_owned(), level.into()));
        measurement.settings = varied.chain([("max_bounces".to_owned(), 8.into())]).collect();
    }
    measurement
}

/// What a driver might tell of a kernel: of `shade` two executables, of `resolve` nothing.
fn compiled(kernel: &str) -> CompiledKernelRow {
    let figure = |name: &str, value: serde_json::Value| FigureRow {
        name: name.to_owned(),
        description: format!("the {name}"),
        value,
    };
    let executable = |name: &str, lanes: u32| ExecutableRow {
        name: name.to_owned(),
        subgroup_size_lanes: lanes,
        figures: vec![figure("Register Count", (2 * lanes).into()), figure("Spills <|>", (lanes > 16).into())],
    };
    let executables = match kernel {
        "resolve" => None,
        "shade" => Some(vec![executable("SIMD16", 16), executable("SIMD32", 32)]),
        _ => Some(vec![executable("main", 32)]),
    };
    CompiledKernelRow {
        kernel: kernel.to_owned(),
        spirv_instructions: 1_000 + kernel.len() as u64,
        occupancy_by_registers: executables.as_ref().map(|_| 0.5),
        executables,
    }
}

/// A small image without two equal pixels.
pub fn gradient(width: u32, height: u32) -> Image {
    let pixel = |i: u32| Vec3::new((i % width) as f32 / width as f32, (i / width) as f32 / height as f32, 0.25);
    Image::new(width, height, (0..width * height).map(pixel).collect())
}

/// A normal number.
pub fn normal(random: &mut SplitMix64) -> f64 {
    // The quantile is infinite at 0.
    normal_quantile(random.next_f64().max(1e-12))
}

/// A study of one scene, `--vary` as on the command line.
pub fn study(vary: &[&str], rounds: usize) -> Study {
    let factors = vary.iter().flat_map(|text| Factor::parse_list(text).expect("the test's factors parse")).collect();
    Study {
        design: Design::new(factors, None).expect("the test's design makes sense"),
        scenes: vec!["box".to_owned()],
        rounds: Rounds { min: rounds, max: rounds, until: None },
        clock: Clock::Wall,
        seed: 7,
        counting: true,
    }
}
