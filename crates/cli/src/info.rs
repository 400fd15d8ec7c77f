//! `raywave info`.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use indicatif::HumanCount;
use serde_json::{Map, Value, json};

use super::film;
use super::picture::PictureArguments;
use super::{compiled, load_scene, print, readable_bytes};
use raywave::bvh::Bvh;
use raywave::facts::{self, Facts};
use raywave::film::Film;
use raywave::gpu::Device;
use raywave::render::{Defaults, FeatureCost, Footprint, PreparedScene, Session, feature_costs};
use raywave::scene::Scene;
use raywave::settings::{self, Instances, Named, SECOND_HALF, SETTINGS, Setting, Settings};
use raywave_studies::export::plain;
use raywave_studies::lab::{self, Counters};

/// Tell what a scene holds, what a render of it needs, and what it leaves out
#[derive(Debug, clap::Args)]
pub struct InfoArguments {
    /// Scene (.toml, .gltf, .glb, Mitsuba's .xml), mesh (.obj, .ply) or film (.film); the built-in Cornell box without
    scene: Option<PathBuf>,
    /// The render that it would be.
    #[command(flatten)]
    picture: PictureArguments,
    /// Build the render's kernels and tell what the driver made of them: registers, memory, code
    #[arg(long)]
    compiled: bool,
    /// JSON instead of lines
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &InfoArguments) -> anyhow::Result<()> {
    if let Some(path) = arguments.scene.as_deref().filter(|path| film::is_film(path)) {
        return tell_of_film(path, arguments.json);
    }
    let scene = load_scene(arguments.scene.as_deref(), &arguments.picture.load.options(), false)?;
    let settings = arguments.picture.settings(&scene)?;
    let device = device(arguments)?;
    let defaults = device.as_ref().map_or(Defaults::GPU, |device| device.defaults);
    let prepared = PreparedScene::for_device(&scene, &settings, &defaults)?;
    let report = Report { scene: &scene, prepared: &prepared, settings, device: device.as_ref(), defaults };
    let compiled = if arguments.compiled {
        let device = match &device {
            Some(known) => known.device.clone(),
            // Says why there is none.
            None => arguments.picture.open_device()?,
        };
        let session = Session::new(&device, &prepared, &settings)?;
        Some((lab::compiled_kernels(&session, device.description())?, device))
    } else {
        None
    };
    if arguments.json {
        let mut json = report.json();
        if let Some((kernels, _)) = &compiled {
            json["compiled_kernels"] = compiled::record(kernels);
        }
        return print(&(serde_json::to_string_pretty(&json)? + "\n"));
    }
    let told = compiled.map_or(String::new(), |(kernels, device)| compiled::lines(&kernels, device.description()));
    print(&(report.lines()? + &told))
}

/// What a film holds, and the render that it belongs to.
fn tell_of_film(path: &Path, as_json: bool) -> anyhow::Result<()> {
    let (film, about) = film::read(path)?;
    let record = about.image_record(&film);
    let error = film.error_by_halves(SECOND_HALF);
    let told = json!({
        "film_samples": film.sample_count(),
        "lacks": film::lacking(&film, &about),
        "relmse_by_halves": error,
        "arithmetic": about.arithmetic,
        "counters": about.counters,
        "settings": record,
    });
    if as_json {
        return print(&(serde_json::to_string_pretty(&told)? + "\n"));
    }
    let mut text = String::new();
    writeln!(text, "film             {}x{}", film.width, film.height)?;
    writeln!(text, "samples          {}, {}", HumanCount(film.sample_count()), film::in_words(&film, &about))?;
    if let Some(error) = error {
        writeln!(text, "relMSE           {error:.2e} by the difference of two halves")?;
    }
    let Counters { camera_rays, bounce_rays, shadow_rays, nonfinite_samples, wall_seconds, .. } = &about.counters;
    let rays = camera_rays + bounce_rays + shadow_rays;
    writeln!(text, "rays             {}", HumanCount(rays))?;
    writeln!(text, "left out         {nonfinite_samples} samples that were not finite")?;
    writeln!(text, "rendered in      {wall_seconds:.2} s")?;
    writeln!(text, "arithmetic       {}\n", about.arithmetic)?;
    let rows: Vec<[String; 2]> = record.iter().map(|(key, value)| [key.clone(), plain(value)]).collect();
    print(&(text + &aligned(&rows)))
}

/// The device that a render would take, measured where it never was.
struct KnownDevice {
    device: Device,
    facts: Arc<Facts>,
    defaults: Defaults,
}

/// The device that the arguments name, or the best one. There need not be any: a scene can be told of without.
fn device(arguments: &InfoArguments) -> anyhow::Result<Option<KnownDevice>> {
    let device = match arguments.picture.open_device() {
        Ok(device) => device,
        Err(error) if arguments.picture.device().is_some() => return Err(error),
        Err(_) => return Ok(None),
    };
    Ok(Some(KnownDevice { facts: facts::of(&device)?, defaults: Defaults::of(&device)?, device }))
}

impl KnownDevice {
    fn lines(&self) -> anyhow::Result<String> {
        let Facts { texel_ns, storage_ns, launch_seconds, loop_turns, .. } = *self.facts;
        let limit = loop_turns.map_or("none".to_owned(), |turns| format!("{} turns", HumanCount(turns.into())));
        let operations = [
            (self.facts.division_exact, "division"),
            (self.facts.reciprocal_exact, "reciprocal"),
            (self.facts.root_exact, "square root"),
        ];
        let exact: Vec<_> = operations.into_iter().filter(|(is, _)| *is).map(|(_, name)| name).collect();
        let exact = if exact.is_empty() { "none".to_owned() } else { exact.join(", ") };
        let flushed = match (self.facts.flushes_operands, self.facts.flushes_results) {
            (true, true) => "flushed",
            (true, false) => "flushed as operands",
            (false, true) => "flushed as results",
            (false, false) => "kept",
        };
        let mut text = String::new();
        writeln!(text, "\ndevice           {}", self.device.description().name)?;
        writeln!(text, "driver           {}", self.device.description().driver)?;
        writeln!(text, "16-byte fetch    {texel_ns:.2} ns by texel, {storage_ns:.2} ns from a storage buffer")?;
        writeln!(text, "launch           {:.1} us", launch_seconds * 1e6)?;
        writeln!(text, "loop limit       {limit}")?;
        writeln!(text, "exact            {exact}")?;
        writeln!(text, "fma              {}", if self.facts.fma_fused { "fused" } else { "not fused" })?;
        writeln!(text, "denormals        {flushed}")?;
        Ok(text)
    }
}

/// All that is told.
struct Report<'a> {
    scene: &'a Scene,
    prepared: &'a PreparedScene,
    settings: Settings,
    /// Without, all is told as of a GPU.
    device: Option<&'a KnownDevice>,
    defaults: Defaults,
}

impl Report<'_> {
    fn triangles(&self) -> u64 {
        self.prepared.triangle_count
    }

    /// Vertices of all meshes, each once.
    fn vertices(&self) -> usize {
        self.scene.meshes().map(|mesh| mesh.positions.len()).sum()
    }

    /// Meshes that are placed more than once: triangles of all, how often they are placed in all, and how they lie in memory.
    fn placed(&self) -> Option<(usize, usize, &'static str)> {
        let placed = &self.scene.placed;
        let triangles = placed.iter().map(|placed| placed.mesh.triangles.len()).sum();
        let placements = placed.iter().map(|placed| placed.placements.len()).sum();
        let instances = if self.prepared.bvh.has_two_levels() { Instances::TwoLevel } else { Instances::Flatten };
        (!placed.is_empty()).then_some((triangles, placements, instances.name()))
    }

    /// Of the render with specialization, and without.
    fn footprints(&self) -> [Footprint; 2] {
        [true, false]
            .map(|specialize| Footprint::of(self.prepared, &Settings { specialize, ..self.settings }, &self.defaults))
    }

    /// The settings of a render, with all choices made that they leave open.
    fn settled(&self) -> Settings {
        let Self { prepared, settings, defaults, .. } = self;
        defaults.choose(settings, prepared.bvh.kind, prepared.levels()).settle(settings)
    }

    /// Each setting, its value, and who gave it that.
    fn settings(&self) -> Vec<[String; 3]> {
        let [otherwise, of_scene, asked, settled] =
            [Settings::default(), self.scene.settings, self.settings, self.settled()];
        let row = |setting: &Setting| {
            let [otherwise, of_scene, asked, settled] =
                [otherwise, of_scene, asked, settled].map(|settings| (setting.get)(&settings));
            let by = match () {
                () if settled != asked => "device",
                () if asked != of_scene => "flag",
                () if of_scene != otherwise => "scene",
                () => "default",
            };
            [format!("  {}", setting.flag), settled.to_string(), by.to_owned()]
        };
        SETTINGS.iter().map(row).collect()
    }

    fn lines(&self) -> anyhow::Result<String> {
        let Self { scene, prepared, settings, device, defaults } = self;
        let (low, high) = scene.bounds();
        let triangles = self.triangles();
        let mut text = String::new();
        writeln!(text, "scene            {}", scene.name)?;
        writeln!(text, "hash             {}", scene.hash)?;
        writeln!(text, "triangles        {triangles}")?;
        if let Some((triangles, placements, instances)) = self.placed() {
            let many = HumanCount(placements as u64);
            writeln!(
                text,
                "placed meshes    {}, of {triangles} triangles, {many} times; {instances}",
                scene.placed.len()
            )?;
        }
        writeln!(text, "vertices         {}", self.vertices())?;
        writeln!(text, "materials        {}", scene.materials.len())?;
        writeln!(text, "textures         {}", scene.textures.len())?;
        writeln!(text, "light triangles  {}", prepared.lights.len())?;
        writeln!(text, "environment      {}", environment(scene))?;
        writeln!(text, "bounds           {low} to {high}")?;
        let Bvh { depth, leaf_count, sah_cost, build_time, .. } = &prepared.bvh;
        writeln!(text, "BVH nodes        {}, {}", prepared.bvh.node_count, prepared.bvh.kind.name())?;
        writeln!(
            text,
            "BVH leaves       {leaf_count}, {:.2} triangles each",
            prepared.triangles.len() as f64 / f64::from(*leaf_count)
        )?;
        writeln!(text, "BVH depth        {depth}")?;
        writeln!(text, "BVH SAH cost     {sah_cost:.2}")?;
        let speed = prepared.triangles.len() as f64 / build_time.as_secs_f64() / 1e6;
        writeln!(text, "BVH build        {:.1} ms, {speed:.2} M triangles/s", build_time.as_secs_f64() * 1e3)?;

        let heads = ["setting", "value", "by"].map(str::to_owned);
        text += "\n";
        text += &aligned(&std::iter::once(heads).chain(self.settings()).collect::<Vec<_>>());

        let costs = feature_costs(prepared, settings, defaults);
        let found: Vec<_> = costs.iter().filter(|cost| cost.found).map(|cost| cost.feature).collect();
        writeln!(text, "\nneeds            {}", found.join(", "))?;
        for (found, head) in [(true, "needed"), (false, "left out")] {
            let row = |cost: &FeatureCost| {
                let state = list(&cost.path_bytes, |n| n.to_string());
                [
                    format!("  {}", cost.feature),
                    list(&cost.instructions, |n| HumanCount(n as u64).to_string()),
                    list(&cost.scene_bytes, readable_bytes),
                    state,
                ]
            };
            let heads = [head, "instructions", "scene data", "bytes a path in flight"].map(str::to_owned);
            let rows: Vec<_> = costs.iter().filter(|cost| cost.found == found).map(row).collect();
            text += "\n";
            text += &aligned(&std::iter::once(heads).chain(rows).collect::<Vec<_>>());
        }

        let [own, any] = self.footprints();
        writeln!(text, "\n{:<24} {:>14} {:>14}", own.scheduler.name(), "for this scene", "for any")?;
        let mut row = |name: &str, own: String, any: String| writeln!(text, "{name:<24} {own:>14} {any:>14}");
        let count = |n: usize| HumanCount(n as u64).to_string();
        row("instructions", count(all(&own.instructions)), count(all(&any.instructions)))?;
        for (kernel, instructions) in &any.instructions {
            let own = own.instructions.iter().find(|(name, _)| name == kernel);
            row(&format!("  {kernel}"), own.map_or("–".into(), |(_, n)| count(*n)), count(*instructions))?;
        }
        let per_path = |footprint: &Footprint| format!("{} B", sum(&footprint.path_bytes));
        row("path state, a path", per_path(&own), per_path(&any))?;
        for (buffer, bytes) in &any.path_bytes {
            let own = own.path_bytes.iter().find(|(name, _)| name == buffer);
            row(&format!("  {buffer}"), own.map_or("–".into(), |(_, n)| format!("{n} B")), format!("{bytes} B"))?;
        }
        let memory = |footprint: &Footprint| readable_bytes(sum(&footprint.scene_bytes));
        row("device memory", memory(&own), memory(&any))?;
        let film = Film::most_bytes(settings.width, settings.height, settings.block_samples(), settings.samples);
        row("host, with --film", readable_bytes(film), readable_bytes(film))?;
        let per_triangle = |bytes: u64| format!("{:.1} B", bytes as f64 / triangles as f64);
        row("  a triangle", per_triangle(sum(&own.scene_bytes)), per_triangle(sum(&any.scene_bytes)))?;
        for (buffer, bytes) in &any.scene_bytes {
            let own = own.scene_bytes.iter().find(|(name, _)| name == buffer);
            row(&format!("    {buffer}"), own.map_or("–".into(), |(_, n)| per_triangle(*n)), per_triangle(*bytes))?;
        }
        if let Some(device) = device {
            text += &device.lines()?;
        }
        Ok(text)
    }

    fn json(&self) -> Value {
        let Self { scene, prepared, settings, device, defaults } = self;
        let (low, high) = scene.bounds();
        let Bvh { depth, leaf_count, sah_cost, build_time, .. } = &prepared.bvh;
        let footprint = |footprint: &Footprint| {
            json!({
                "instructions": object(&footprint.instructions),
                "path_state_bytes_per_path": sum(&footprint.path_bytes),
                "path_state_bytes": object(&footprint.path_bytes),
                "scene_bytes_per_triangle": sum(&footprint.scene_bytes) as f64 / self.triangles() as f64,
                "scene_bytes": object(&footprint.scene_bytes),
            })
        };
        let features: Vec<Value> = feature_costs(prepared, settings, defaults)
            .iter()
            .map(|cost| {
                json!({
                    "feature": cost.feature,
                    "needed": cost.found,
                    "instructions": object(&cost.instructions),
                    "scene_bytes": object(&cost.scene_bytes),
                    "path_state_bytes": object(&cost.path_bytes),
                })
            })
            .collect();
        let [own, any] = self.footprints();
        json!({
            "scene": scene.name,
            "scene_hash": scene.hash,
            "triangles": self.triangles(),
            "placed_meshes": scene.placed.len(),
            "placements": self.placed().map_or(0, |(_, placements, _)| placements),
            "vertices": self.vertices(),
            "materials": scene.materials.len(),
            "textures": scene.textures.len(),
            "light_triangles": prepared.lights.len(),
            "environment": environment(scene),
            "bounds": [low.to_array(), high.to_array()],
            "bvh": prepared.bvh.kind.name(),
            "bvh_nodes": prepared.bvh.node_count,
            "bvh_leaves": leaf_count,
            "bvh_depth": depth,
            "bvh_sah_cost": sah_cost,
            "bvh_build_seconds": build_time.as_secs_f64(),
            "scheduler": own.scheduler.name(),
            "settings": settings::record(&self.settled()),
            "features": features,
            "specialized": footprint(&own),
            "unspecialized": footprint(&any),
            "device": device.map(|known| &known.device.description().name),
            "driver": device.map(|known| &known.device.description().driver),
            "device_facts": device.map(|device| &*device.facts),
        })
    }
}

/// Rows of left-aligned columns.
fn aligned<const N: usize>(rows: &[[String; N]]) -> String {
    let widths: [usize; N] =
        std::array::from_fn(|column| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0));
    rows.iter().fold(String::new(), |text, row| {
        let cells =
            row.iter().zip(widths).fold(String::new(), |line, (cell, width)| line + &format!("{cell:<width$}  "));
        text + cells.trim_end() + "\n"
    })
}

fn sum(bytes: &[(&'static str, u64)]) -> u64 {
    bytes.iter().map(|(_, bytes)| bytes).sum()
}

fn all(instructions: &[(&'static str, usize)]) -> usize {
    instructions.iter().map(|(_, number)| number).sum()
}

fn list<N: Copy>(numbers: &[(&'static str, N)], text: impl Fn(N) -> String) -> String {
    numbers.iter().map(|(name, number)| format!("{name} {}", text(*number))).collect::<Vec<_>>().join(", ")
}

fn object<N: Copy + Into<Value>>(numbers: &[(&'static str, N)]) -> Map<String, Value> {
    numbers.iter().map(|(name, number)| ((*name).to_owned(), (*number).into())).collect()
}

fn environment(scene: &Scene) -> String {
    use raywave::scene::Environment::*;
    match &scene.environment {
        Black => "none".to_owned(),
        Constant(radiance) => format!("constant {radiance}"),
        LatLong(map) => format!("{} ({}x{})", map.path.display(), map.width, map.height),
    }
}
