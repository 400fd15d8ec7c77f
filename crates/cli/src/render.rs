//! `raywave render`.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use glam::Vec3;
use indicatif::HumanCount;
use serde_json::{Map, Value, json};

use raywave::clocks::{self, ClockState};
use raywave::facts::{self, Facts};
use raywave::film::{FilmMoments, ImageMean, MeanSum};
use raywave::gpu::{Device, DeviceDescription, GpuError, Tools};
use raywave::image::{Image, OutputFormat, WriteOptions, check_output, write_image};
use raywave::render::{
    Defaults, DeviceTrace, Ending, Fault, Kept, PreparedScene, Progress, RenderError, Renderer, Session,
    SessionOptions, Statistics, find_faults, render_together,
};
use raywave::scene::Scene;
use raywave::settings::{MAX_SAMPLES, SETTINGS, Settings};
use raywave::trace::Stages;
use raywave::whole_file;
use raywave_studies::export::plain;
use raywave_studies::lab::{self, AboutFilm, Tuning, tuning};
use raywave_studies::studies::CompiledKernelRow;

use super::film::{Blocks, FilmArguments, FilmOnDisk, check_memory};
use super::picture::PictureArguments;
use super::progress::{ProgressKind, Teller};
use super::tradeoff::duration;
use super::{
    check_text_output, compiled, load_scene, open_device_with, open_devices, output_path, stop_on_interrupt, trace,
    warn_unless, write_text,
};

/// Render a scene to an image
#[derive(Debug, clap::Args)]
pub struct RenderArguments {
    /// Scene (.toml, .gltf, .glb, Mitsuba's .xml) or mesh (.obj, .ply); the built-in Cornell box without
    scene: Option<PathBuf>,
    /// Image to write: .png (sRGB), .exr (linear, with metadata) or .hdr (linear); - is stdout
    #[arg(short, long, value_name = "FILE", value_parser = output_path(), required_unless_present = "film")]
    output: Option<PathBuf>,
    #[command(flatten)]
    film: FilmArguments,
    /// Devices that share the render in place of --device: numbers or parts of names with commas between them, or all
    #[arg(long, value_name = "all|LIST", conflicts_with_all = ["trace", "time", "target_error"])]
    devices: Option<String>,
    /// End after this time of rendering, with --samples as the most
    #[arg(long, value_name = "TIME", value_parser = duration)]
    time: Option<f64>,
    /// End once the image's relMSE, by the difference of two halves of its samples, is down to this, with --samples as the
    /// most
    #[arg(long, value_name = "RELMSE", value_parser = positive)]
    target_error: Option<f64>,
    #[command(flatten)]
    picture: PictureArguments,
    #[command(flatten)]
    encoding: Encoding,
    /// Write what the render cost, as JSON
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    stats: Option<PathBuf>,
    /// Write what host and device did when, in Chrome's trace format, for Perfetto
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    trace: Option<PathBuf>,
    /// Name every Vulkan object and label passes and bounces, even if no layer is known that shows it
    #[arg(long)]
    labels: bool,
    /// Time between two looks at the device's film, which is all that is lost with a device
    /// (5s)
    #[arg(long, value_name = "TIME", value_parser = duration)]
    keep_every: Option<f64>,
    /// Submissions after which the device counts as lost: the first one, the one that is opened then
    #[arg(long, value_name = "SUBMISSIONS", value_delimiter = ',', hide = true)]
    lose_device: Vec<u64>,
    /// How to tell how far the render is, about once a second and at its end
    #[arg(long, value_name = "KIND", default_value = "bar")]
    pub progress: ProgressKind,
    /// No bar, warnings or summary
    #[arg(long, short)]
    quiet: bool,
}

/// How an image is written.
#[derive(Debug, Clone, clap::Args)]
pub struct Encoding {
    /// Format of the image, whatever its name; EXR where it goes to stdout or another stream
    #[arg(long)]
    format: Option<FormatName>,
    /// Exposure of a PNG in stops: radiance is multiplied by 2^STOPS
    #[arg(long, value_name = "STOPS", default_value = "0", value_parser = stops, allow_negative_numbers = true)]
    exposure: f32,
}

impl Encoding {
    /// The format that is asked for.
    pub fn format(&self) -> Option<OutputFormat> {
        self.format.map(Into::into)
    }
}

fn stops(text: &str) -> Result<f32, String> {
    let stops = text.parse::<f32>().ok().filter(|stops| stops.is_finite());
    stops.ok_or_else(|| "it is no number of stops".to_owned())
}

/// A format of images.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum FormatName {
    /// Linear, with metadata
    Exr,
    /// Linear, RGBE
    Hdr,
    /// sRGB
    Png,
}

impl RenderArguments {
    /// Has time or error end the render, if they are to.
    fn ends_by(&self, settings: &mut Settings) -> anyhow::Result<()> {
        if self.time.is_none() && self.target_error.is_none() {
            return Ok(());
        }
        ensure!(
            self.film.blocks.is_none(),
            "--blocks are a part of the samples, so --time and --target-error cannot end them"
        );
        settings.halves |= self.target_error.is_some();
        if !self.picture.has_samples() {
            settings.samples = MAX_SAMPLES;
        }
        Ok(())
    }
}

fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "it is no number above 0".to_owned())
}

impl From<FormatName> for OutputFormat {
    fn from(name: FormatName) -> Self {
        match name {
            FormatName::Exr => Self::Exr,
            FormatName::Hdr => Self::Hdr,
            FormatName::Png => Self::Png,
        }
    }
}

/// After Ctrl-C, time in which a render may come to equal samples in all pixels before it ends without.
const EVEN_WITHIN: Duration = Duration::from_millis(250);

pub fn run(arguments: &RenderArguments) -> anyhow::Result<()> {
    let begun = Instant::now();
    check_outputs(arguments)?;
    let stages = if arguments.trace.is_some() { Stages::kept() } else { Stages::default() };
    let tools = Tools { labels: arguments.labels, stages: stages.clone(), ..Tools::default() };
    let loading = stages.begin("load scene");
    let scene = load_scene(arguments.scene.as_deref(), &arguments.picture.load.options(), arguments.quiet)?;
    drop(loading);
    let mut settings = arguments.picture.settings(&scene)?;
    arguments.ends_by(&mut settings)?;
    let mut film = FilmOnDisk::open(&arguments.film, &mut settings)?;
    if film.is_some() || arguments.devices.is_some() {
        check_memory(&settings)?;
    }
    let mut others = match &arguments.devices {
        Some(list) => open_devices(list, tools.clone())?,
        None => Vec::new(),
    };
    let mut device = match others.is_empty() {
        true => open_device_with(arguments.picture.device(), tools.clone())?,
        false => others.remove(0),
    };
    let measuring = stages.begin("measure device");
    let mut defaults = Defaults::of(&device)?;
    drop(measuring);
    if arguments.picture.tuned() {
        let tuning = Tuning::of_scene(device.description(), &scene, &mut warn_unless(arguments.quiet));
        defaults = defaults.with(tuning.chosen());
    }
    let prepared = PreparedScene::in_stages(&scene, &settings, &defaults, &stages)?;
    let options = SessionOptions { tuned: defaults.tuned, ..SessionOptions::default() };
    let of_blocks = |mut session: Session| {
        arguments.film.blocks.iter().for_each(|Blocks(blocks)| session.take_blocks(blocks.clone()));
        session
    };
    let start = |device: &Device| Session::with_options(device, &prepared, &settings, options).map(of_blocks);
    let session = start(&device)?;
    let description = of_all(&device, &others, &settings)?;
    let start_other = |device: &Device| Renderer::new(device)?.session(&scene, &settings).map(of_blocks);
    let mut sessions: Vec<Session> = others.iter().map(start_other).collect::<Result<_, _>>()?;
    if let Some(film) = &film {
        film.check(&AboutFilm::new(&scene, &settings, &description, &session.nothing()))?;
    }
    let compiled = match &arguments.stats {
        Some(_) => {
            let _stage = stages.begin("describe kernels");
            lab::compiled_kernels(&session, device.description())?
        }
        None => Vec::new(),
    };
    let mut losses = arguments.lose_device.iter();
    losses.next().into_iter().for_each(|&submissions| device.lose_after(submissions));

    let interrupted = stop_on_interrupt("writing the samples that are done; Ctrl-C again gives them up")?;
    let mut interrupted_at = None;
    let mut teller = Teller::new(arguments.progress, arguments.quiet, settings.samples);
    let every = arguments.keep_every.map_or(Kept::EVERY, Duration::from_secs_f64);
    let mut kept = match &mut film {
        Some(film) => film.begin(Kept::every(every.min(film.save_every()))),
        None => Kept::every(every),
    };
    let mut warn = warn_unless(arguments.quiet);
    let about = |statistics: &Statistics| AboutFilm::new(&scene, &settings, &description, statistics);
    let mut progress = |progress: &Progress<'_>| {
        teller.show(progress);
        if let (Some(film), Some(kept)) = (&mut film, progress.looked)
            && let Err(error) = film.save_if_due(kept, about)
        {
            warn(&format!("{error:#}; the render goes on without"));
        }
        if !interrupted.load(Ordering::Relaxed)
            && arguments.time.is_none_or(|time| progress.elapsed.as_secs_f64() < time)
        {
            return ControlFlow::Continue(());
        }
        let waited = interrupted_at.get_or_insert_with(Instant::now).elapsed();
        ControlFlow::Break(if waited < EVEN_WITHIN { Ending::Even } else { Ending::Now })
    };
    let keeps_film = arguments.film.film.is_some() || arguments.devices.is_some();
    let by_rounds = arguments.time.is_some() || arguments.target_error.is_some();
    let mut picture = Picture::new(&settings)?;
    let clocks = clocks::of_device(device.description().uuid);
    let state = || clocks.as_ref().map(|clocks| clocks.state());
    let clocks_before = state();
    let mut traces = Vec::new();
    let most_passes = arguments.trace.is_some().then_some(trace::MOST_PASSES);
    let mut error = None;
    let mut go_on = |mut session: Session, kept: &mut Kept| -> anyhow::Result<Statistics> {
        most_passes.map_or(Ok(()), |most| session.keep_trace(most))?;
        let rendered = match () {
            () if !sessions.is_empty() => {
                let all = std::iter::once(session).chain(std::mem::take(&mut sessions)).collect();
                let (ended, statistics) = render_together(all, kept, &mut progress);
                return match ended.into_iter().find_map(Result::err) {
                    None => Ok(statistics),
                    Some(error) => Err(error.into()),
                };
            }
            () if by_rounds => {
                session.go_on_by_rounds(kept, arguments.target_error, &mut progress).map(|(statistics, found)| {
                    error = found;
                    statistics
                })
            }
            () if keeps_film => session.go_on(kept, &mut progress),
            () => session.go_on_by_tiles(kept, &mut progress, |rows| picture.add(rows)),
        };
        traces.extend(session.take_trace());
        Ok(rendered?)
    };
    let mut rendered = go_on(session, &mut kept);
    let lost = rendered.as_ref().err().filter(|error| is_lost_device(error)).map(|error| format!("{error:#}"));
    if let Some(lost) = lost {
        let count = HumanCount(kept.sample_count());
        tell!("warning: {lost}; it is opened anew, and the render goes on from {count} samples");
        let first = arguments.devices.as_ref().map(|_| device.description().name.clone());
        rendered = open_device_with(first.as_deref().or(arguments.picture.device()), tools).and_then(|again| {
            let name = again.description().cache_name();
            ensure!(name == device.description().cache_name(), "{lost}; it did not come back");
            device = again;
            let session = start(&device)?;
            losses.next().into_iter().for_each(|&submissions| device.lose_after(submissions));
            go_on(session, &mut kept)
        });
    }
    let clocks_after = state();
    teller.end(kept.statistics());
    // The image is worth more than what ended it early.
    let (statistics, failure) = match (rendered, kept.statistics()) {
        (Ok(statistics), _) => (statistics, None),
        (Err(error), Some(statistics)) if statistics.rows > 0 => (statistics.clone(), Some(error)),
        (Err(error), _) => return Err(error),
    };
    // A film that cannot be saved costs no image.
    let mut saved = Ok(());
    let (image, mean) = if by_rounds || keeps_film {
        let kept = kept.film().expect("it has rendered");
        if let Some(film) = &mut film {
            saved = film.save(kept, about(&statistics));
        }
        (kept.image(), kept.mean())
    } else {
        kept.end(|rows| picture.add(rows));
        picture.end(&settings)
    };

    // Here too: it is written even if the device fails now.
    let faults = match failure {
        None => find_faults(&device, &prepared, &settings, &statistics).map_err(anyhow::Error::from),
        Some(error) => Err(error),
    };
    let report = Report {
        scene: &scene,
        prepared: &prepared,
        settings: &settings,
        device: &description,
        facts: &*facts::of(&device)?,
        exposure: arguments.encoding.exposure,
        faults: faults.as_deref().unwrap_or_default(),
        digest: image.digest(),
        compiled: &compiled,
        clocks: [clocks_before, clocks_after],
        error,
    };
    let writing = stages.begin("write files");
    write(arguments, &report, &image, &statistics, &mean)?;
    drop(writing);
    if let Some(path) = &arguments.trace {
        trace::write(path, begun, &stages.ended(), &device.description().name, &traces)?;
    }
    if !arguments.quiet {
        summarise(arguments, &report, &statistics);
        warn_of_dropped(&traces);
    }
    saved?;
    faults?;
    Ok(())
}

fn warn_of_dropped(traces: &[DeviceTrace]) {
    let dropped: usize = traces.iter().map(DeviceTrace::dropped_passes).sum();
    if dropped > 0 {
        tell!(
            "warning: the trace has the first {} passes alone; {dropped} more were left out",
            HumanCount(trace::MOST_PASSES as u64)
        );
    }
}

fn is_lost_device(error: &anyhow::Error) -> bool {
    let lost = error.downcast_ref::<RenderError>();
    matches!(lost, Some(RenderError::Gpu(GpuError::DeviceLost { .. })))
}

/// What is told of devices that share a render: the first one's description with the names of all.
fn of_all(first: &Device, others: &[Device], settings: &Settings) -> anyhow::Result<DeviceDescription> {
    let mut all = first.description().clone();
    for other in others.iter().map(Device::description) {
        ensure!(
            lab::is_portable(settings) || other.cache_name() == first.description().cache_name(),
            "{} and {} do not compute the same bits with --numerics native or --fast-math; leave these out, or take one device",
            first.description().name,
            other.name
        );
        all.name += &format!(" + {}", other.name);
    }
    Ok(all)
}

/// Says what cannot be written, before the work begins.
fn check_outputs(arguments: &RenderArguments) -> anyhow::Result<()> {
    let outputs = [
        ("--output", &arguments.output),
        ("--film", &arguments.film.film),
        ("--stats", &arguments.stats),
        ("--trace", &arguments.trace),
    ];
    let mut named: Vec<(&str, &PathBuf)> = Vec::new();
    for (flag, path) in outputs.into_iter().filter_map(|(flag, path)| Some((flag, path.as_ref()?))) {
        match flag {
            "--output" => check_output(path, arguments.encoding.format())?,
            _ => check_text_output(path)?,
        }
        for (other, taken) in &named {
            ensure!(!whole_file::is_same(path, taken)?, "{}: {flag} and {other} name the same file", path.display());
        }
        ensure!(
            !(arguments.progress.is_on_stdout() && whole_file::is_stdout(path)),
            "{flag} and --progress both go to stdout; write to a file, or take --progress bar"
        );
        named.push((flag, path));
    }
    Ok(())
}

/// The image of a render that keeps no film: of a tile that is done it has the mean, a quarter of the sums.
struct Picture {
    pixels: Vec<Vec3>,
    mean: MeanSum,
}

impl Picture {
    /// Room for all pixels, so that a large image fails before the work and not after it.
    fn new(settings: &Settings) -> anyhow::Result<Self> {
        let Settings { width, height, .. } = *settings;
        let count = width as usize * height as usize;
        let mut pixels = Vec::new();
        pixels.try_reserve_exact(count).with_context(|| {
            let needed = count * size_of::<Vec3>();
            format!("an image of {width}x{height} needs {needed} bytes of memory; use a smaller --width or --height")
        })?;
        Ok(Self { pixels, mean: MeanSum::default() })
    }

    fn add(&mut self, rows: FilmMoments) {
        self.pixels.extend(rows.mean().pixels);
        self.mean.add(&rows);
    }

    /// Nothing is known of rows that a broken-off render has not come to.
    fn end(mut self, settings: &Settings) -> (Image, ImageMean) {
        self.pixels.resize(settings.width as usize * settings.height as usize, Vec3::NAN);
        (Image::new(settings.width, settings.height, self.pixels), self.mean.mean())
    }
}

/// All that belongs to a result.
struct Report<'a> {
    scene: &'a Scene,
    prepared: &'a PreparedScene,
    settings: &'a Settings,
    device: &'a DeviceDescription,
    facts: &'a Facts,
    /// Of a PNG, in stops.
    exposure: f32,
    /// Samples that were not finite, as many as were traced.
    faults: &'a [Fault],
    /// [`Image::digest`].
    digest: String,
    /// What the compiler made of the kernels; empty where nobody asks.
    compiled: &'a [CompiledKernelRow],
    /// Of the device, before and after, where something tells of them.
    clocks: [Option<ClockState>; 2],
    /// relMSE by the difference of the halves of the samples, if they were taken so.
    error: Option<f64>,
}

impl Report<'_> {
    fn settings(&self, statistics: &Statistics) -> Map<String, Value> {
        lab::record(self.scene, self.settings, self.device, statistics)
    }

    fn statistics(&self, statistics: &Statistics, mean: &ImageMean) -> Value {
        let wall = statistics.wall_time.as_secs_f64();
        let kernels: Map<_, _> = statistics
            .kernels()
            .into_iter()
            .map(|(name, time)| {
                let instructions =
                    self.compiled.iter().find(|kernel| kernel.kernel == name).map(|kernel| kernel.spirv_instructions);
                let told =
                    json!({ "gpu_seconds": time.seconds, "launches": time.launches, "instructions": instructions });
                (name.to_owned(), told)
            })
            .collect();
        json!({
            "settings": self.settings(statistics),
            "pixels_blake3": self.digest,
            "device_facts": self.facts,
            "exposure_stops": self.exposure,
            "samples": statistics.sample_count,
            "samples_per_second": statistics.sample_count as f64 / wall,
            "rays": statistics.rays(),
            "rays_per_second": statistics.rays() as f64 / wall,
            "camera_rays": statistics.camera_rays,
            "bounce_rays": statistics.bounce_rays,
            "shadow_rays": statistics.shadow_rays,
            "nonfinite_samples": statistics.nonfinite_samples,
            "nonfinite_traced": self.faults.iter().map(fault_record).collect::<Vec<_>>(),
            "wall_seconds": wall,
            "gpu_seconds": statistics.gpu_seconds,
            "idle_seconds": statistics.idle.between,
            "relmse_by_halves": self.error,
            "clocks_before": self.clocks[0],
            "clocks_after": self.clocks[1],
            "kernels": kernels,
            "compiled_kernels": compiled::record(self.compiled),
            "triangles": self.prepared.triangle_count,
            "bvh_nodes": self.prepared.bvh.node_count,
            "bvh_build_seconds": self.prepared.bvh.build_time.as_secs_f64(),
            "device_memory_bytes": statistics.memory_bytes,
            "mean_radiance": mean.mean.to_array(),
            "mean_radiance_standard_error": mean.standard_error.to_array().map(|e| e.is_finite().then_some(e)),
        })
    }
}

fn write(
    arguments: &RenderArguments,
    report: &Report<'_>,
    image: &Image,
    statistics: &Statistics,
    mean: &ImageMean,
) -> anyhow::Result<()> {
    if let Some(path) = &arguments.output {
        write_with_record(path, image, &report.digest, report.settings(statistics), &arguments.encoding)?;
    }
    if let Some(path) = &arguments.stats {
        let text =
            serde_json::to_string_pretty(&report.statistics(statistics, mean)).context("statistics become JSON")?;
        write_text(path, &(text + "\n"))?;
    }
    Ok(())
}

/// Writes an image with the record of its render in its metadata.
pub fn write_with_record(
    path: &Path,
    image: &Image,
    digest: &str,
    mut record: Map<String, Value>,
    encoding: &Encoding,
) -> anyhow::Result<()> {
    record.insert("pixels_blake3".to_owned(), digest.into());
    let metadata: Vec<(String, String)> =
        record.into_iter().map(|(key, value)| (format!("raywave.{key}"), plain(&value))).collect();
    let options = WriteOptions { exposure: encoding.exposure, metadata: &metadata, format: encoding.format() };
    Ok(write_image(path, image, &options)?)
}

fn fault_record(fault: &Fault) -> Value {
    let Fault { x, y, sample, bounce } = *fault;
    json!({ "x_pixels": x, "y_pixels": y, "sample": sample, "bounce": bounce })
}

/// Digits of the pixels' digest that a summary shows; the whole stands in metadata and statistics.
const NAMED_DIGITS: usize = 16;

/// Most samples that a summary names.
const NAMED_FAULTS: usize = 4;

fn warn_of_faults(count: u32, faults: &[Fault]) {
    let name = |fault: &Fault| {
        let Fault { x, y, sample, .. } = fault;
        let bounce =
            fault.bounce.map_or("no bounce when followed again".to_owned(), |bounce| format!("bounce {bounce}"));
        format!("pixel ({x}, {y}) sample {sample} at {bounce}")
    };
    let named: Vec<String> = faults.iter().take(NAMED_FAULTS).map(name).collect();
    let more = if count as usize > named.len() { ", ..." } else { "" };
    tell!(
        "warning: {count} samples were NaN or infinite and are left out, so their pixels are too dark: {}{more}; look for extreme \
         numbers in the materials",
        named.join(", ")
    );
}

fn summarise(arguments: &RenderArguments, report: &Report<'_>, statistics: &Statistics) {
    let settings = report.settings;
    let seconds = statistics.wall_time.as_secs_f64();
    let mut part = String::new();
    let is_ended_by = arguments.time.is_some() || arguments.target_error.is_some();
    if statistics.samples < settings.samples && !is_ended_by {
        part += &format!(", of {} asked for", settings.samples);
    }
    if statistics.rows < settings.height {
        part += &format!(", in rows 1 to {} alone", statistics.rows);
    }
    if statistics.bands.len() > 1 {
        part += &format!(" (rows x samples from the top: {})", lab::samples_by_rows(statistics));
    }
    let tuned = if statistics.choices.tuned {
        format!("; tuned: {}", tuning::in_words(&statistics.choices))
    } else {
        String::new()
    };
    let speeds = match statistics.sample_count {
        0 => "nothing was left to render".to_owned(),
        samples => format!(
            "{seconds:.2} s, {:.2} M samples/s, {:.2} M rays/s",
            samples as f64 / seconds / 1e6,
            statistics.rays() as f64 / seconds / 1e6
        ),
    };
    tell!(
        "{}: {}x{}, {} samples per pixel{part}, {speeds}, pixels {}{tuned}",
        arguments.output.as_ref().or(arguments.film.film.as_ref()).expect("one of them is named").display(),
        settings.width,
        settings.height,
        statistics.samples,
        &report.digest[..NAMED_DIGITS],
    );
    if let (Some(target), Some(error)) = (arguments.target_error, report.error) {
        let more = if error <= target { "" } else { "; more --samples, or more --time, bring it down" };
        tell!("relMSE {error:.2e} by the difference of two halves, of {target:.2e} asked for{more}");
    }
    for bias in SETTINGS.iter().filter_map(|setting| (setting.bias)(settings)) {
        tell!("warning: the image is biased: {bias}");
    }
    if statistics.nonfinite_samples > 0 {
        warn_of_faults(statistics.nonfinite_samples, report.faults);
    }
}
