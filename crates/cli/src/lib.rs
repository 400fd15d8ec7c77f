//! The command line: arguments, resolved settings, progress, warnings. The only room that prints.
//!
//! Data goes to stdout, all else to stderr. Exit codes: 0 done, 1 the device failed, 2 bad input
//! or an output that cannot be written, 128 and the signal's number where a second signal broke it off.

// Everything is said by `messages`.
#![deny(clippy::print_stderr, clippy::print_stdout)]

#[macro_use]
mod messages;

pub mod compare;
mod compiled;
mod convert;
mod devices;
pub mod diff;
mod dump_rays;
mod film;
mod image;
mod info;
mod merge;
pub mod picture;
mod progress;
mod render;
mod replay;
mod selftest;
mod stability;
mod start_up;
mod trace;
pub mod tradeoff;
mod tune;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use anyhow::Context;
use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Parser, Subcommand};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

use messages::print;
use picture::PictureArguments;
use raywave::gpu::{Device, GpuError, Instance, Tools};
use raywave::render::RenderError;
use raywave::scene::{LoadOptions, Scene};
use raywave::whole_file::STDOUT;
use raywave_studies::lab::{Asked, ChildFailed, DeviceRenderer, StartUp, cache_folder};
use raywave_studies::studies::{Provenance, Renderer};

/// A Vulkan compute path tracer that is also a measuring instrument
#[derive(Debug, Parser)]
#[command(name = "raywave", version = raywave::VERSION, arg_required_else_help = true)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Render(render::RenderArguments),
    /// List the Vulkan devices and the one that a render would take
    Devices(devices::DevicesArguments),
    Image(image::ImageArguments),
    Info(info::InfoArguments),
    Merge(merge::MergeArguments),
    Convert(convert::ConvertArguments),
    Diff(diff::DiffArguments),
    Compare(Box<compare::CompareArguments>),
    Tradeoff(Box<tradeoff::TradeoffArguments>),
    StartUp(start_up::StartUpArguments),
    #[command(hide = true)]
    FirstSample(start_up::FirstSampleArguments),
    DumpRays(dump_rays::DumpRaysArguments),
    Replay(replay::ReplayArguments),
    Tune(tune::TuneArguments),
    Stability(stability::StabilityArguments),
    Selftest(selftest::SelftestArguments),
    Gallery(GalleryArguments),
}

/// Write the gallery: a rich scene of many materials and lights
#[derive(Debug, clap::Args)]
struct GalleryArguments {
    /// Folder for gallery.toml and its files; made where it is missing
    folder: PathBuf,
    /// Triangles, about
    #[arg(long, default_value_t = 120_000, value_parser = clap::value_parser!(u32).range(5_000..=100_000_000))]
    triangles: u32,
}

/// Runs the program.
pub fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if !error.use_stderr() => {
            // Help and version are data. There is nobody to tell where stdout is closed.
            let _ = error.print();
            return ExitCode::SUCCESS;
        }
        Err(error) if error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let _ = error.print();
            return ExitCode::from(2);
        }
        Err(error) => {
            tell!("{}", without_usage(&error));
            return ExitCode::from(2);
        }
    };
    let result = match arguments.command {
        Command::Render(arguments) => {
            render::run(&arguments).inspect_err(|error| arguments.progress.tell_failure(error))
        }
        Command::Devices(arguments) => devices::run(&arguments),
        Command::Image(arguments) => image::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Merge(arguments) => merge::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Diff(arguments) => diff::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments, |arguments| {
            renderer(&arguments.picture, arguments.start_ups, arguments.quiet, arguments.clocks.clone())
        }),
        Command::Tradeoff(arguments) => tradeoff::run(&arguments, |arguments| {
            renderer(&arguments.picture, 0, arguments.quiet, arguments.clocks.clone())
        }),
        Command::StartUp(arguments) => start_up::run_command(&arguments),
        Command::FirstSample(arguments) => start_up::first_sample(&arguments),
        Command::DumpRays(arguments) => dump_rays::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Tune(arguments) => tune::run(&arguments),
        Command::Stability(arguments) => stability::run(&arguments),
        Command::Selftest(arguments) => selftest::run(&arguments),
        Command::Gallery(GalleryArguments { folder, triangles }) => {
            raywave_studies::gallery::generate_gallery(&folder, triangles as usize).map_err(Into::into)
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Names of files may hold line breaks.
            tell!("error: {}", format!("{error:#}").replace(char::is_control, " "));
            exit_code(&error)
        }
    }
}

/// 1 where the device failed, 2 where the user can mend it.
fn exit_code(error: &anyhow::Error) -> ExitCode {
    if let Some(child) = error.downcast_ref::<ChildFailed>() {
        return ExitCode::from(child.code);
    }
    if error.is::<stability::BrokenPromise>() || error.is::<selftest::OffDevice>() {
        return ExitCode::from(1);
    }
    let render = error.downcast_ref::<RenderError>();
    if matches!(render, Some(RenderError::WrongAnswer { .. } | RenderError::Unstable { .. })) {
        return ExitCode::from(1);
    }
    let gpu = error.downcast_ref::<GpuError>().or(match render {
        Some(RenderError::Gpu(gpu)) => Some(gpu),
        _ => None,
    });
    let user = matches!(
        gpu,
        None | Some(
            GpuError::UnknownDevice { .. }
                | GpuError::UnusableDevice { .. }
                | GpuError::BufferTooLarge { .. }
                | GpuError::OutOfMemory { .. }
                | GpuError::NoLabels
        )
    );
    ExitCode::from(if user { 2 } else { 1 })
}

/// What clap has to say about wrong arguments, without usage, in one line.
fn without_usage(error: &clap::Error) -> String {
    let text = error.to_string();
    let said: Vec<_> = text
        .lines()
        .map(str::trim)
        .take_while(|line| !line.starts_with("Usage:") && !line.starts_with("For more information"))
        .filter(|line| !line.is_empty())
        .collect();
    format!("{}; see --help", said.join(" "))
}

/// The renderer of a study on the device that is wanted, and where the study is made.
fn renderer(
    picture: &PictureArguments,
    start_ups: usize,
    quiet: bool,
    clocks: Option<String>,
) -> anyhow::Result<(Box<dyn Renderer>, Provenance)> {
    let start_up = if start_ups > 0 { Some(StartUp::new(picture.device(), start_ups)?) } else { None };
    let of_scene = picture.clone();
    let asked = Asked {
        load: picture.load.options(),
        settings: Box::new(move |scene| of_scene.settings(scene)),
        tuned: picture.tuned(),
        start_up,
        warn: Box::new(warn_unless(quiet)),
    };
    let renderer = DeviceRenderer::new(picture.open_device()?, asked)?;
    let provenance = Provenance { clocks, ..renderer.sign(compare::provenance()) };
    Ok((Box::new(renderer), provenance))
}

/// Writes warnings to stderr unless quiet.
fn warn_unless(quiet: bool) -> impl FnMut(&str) {
    move |warning| {
        if !quiet {
            tell!("warning: {warning}");
        }
    }
}

/// A number of rounds or the like.
fn at_least_one(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&number| number > 0).ok_or_else(|| "it is not a whole number from 1 on".to_owned())
}

/// Arguments that say how a scene is loaded.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct LoadArguments {
    /// Camera of a glTF file to look through, by its name or that of its node; the first without
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Which way is up in a scene without a camera: X, Y, Z, or a vector
    #[arg(long, value_name = "X|Y|Z|x,y,z", value_parser = direction, allow_hyphen_values = true)]
    up: Option<Direction>,
    /// Read files that a scene names outside of its folder too
    #[arg(long)]
    allow_outside: bool,
    /// Leave out what a scene requires and raywave lacks, with a warning, where it is an error without
    #[arg(long)]
    lenient: bool,
}

impl LoadArguments {
    fn options(&self) -> LoadOptions {
        LoadOptions {
            camera: self.camera.clone(),
            up: self.up.map(|Direction(vector)| vector),
            allow_outside: self.allow_outside,
            lenient: self.lenient,
        }
    }

    /// The flags that give these arguments, for a shell.
    fn flags(&self) -> String {
        // No argument has a zero byte in it, the only one that shells cannot be given.
        let quoted = |text: &str| shlex::try_quote(text).unwrap_or_default().into_owned();
        let camera = self.camera.as_ref().map(|camera| format!("--camera={}", quoted(camera)));
        let up = self.up.map(|Direction([x, y, z])| format!("--up={x},{y},{z}"));
        let switch = |flag: &str, is_given: bool| is_given.then(|| flag.to_owned());
        let rest = [switch("--allow-outside", self.allow_outside), switch("--lenient", self.lenient)];
        let words: Vec<String> = [camera, up].into_iter().chain(rest).flatten().collect();
        words.join(" ")
    }
}

/// A direction of any length.
#[derive(Debug, Clone, Copy)]
struct Direction([f64; 3]);

/// Reads an axis or a vector.
fn direction(text: &str) -> Result<Direction, String> {
    let vector = match text {
        "X" | "x" => [1.0, 0.0, 0.0],
        "Y" | "y" => [0.0, 1.0, 0.0],
        "Z" | "z" => [0.0, 0.0, 1.0],
        _ => {
            let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
            let vector = numbers.ok().and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
            vector.ok_or("it is neither X, Y or Z nor three numbers with commas")?
        }
    };
    let is_direction = vector.iter().all(|number: &f64| number.is_finite()) && vector != [0.0; 3];
    if is_direction { Ok(Direction(vector)) } else { Err("it has no direction".to_owned()) }
}

/// The scene of that path, or the built-in Cornell box. Its warnings go to stderr unless quiet.
fn load_scene(path: Option<&Path>, options: &LoadOptions, quiet: bool) -> anyhow::Result<Scene> {
    let scene = match path {
        Some(path) => Scene::load_with(path, options)?,
        None => Scene::cornell_box(),
    };
    let mut warn = warn_unless(quiet);
    scene.warnings.iter().for_each(|warning| warn(warning));
    Ok(scene)
}

/// Opens the device of that number or part of a name, or the best one.
fn open_device(wanted: Option<&str>) -> anyhow::Result<Device> {
    open_device_with(wanted, Tools::default())
}

/// As [`open_device`], with what shall be seen of it.
fn open_device_with(wanted: Option<&str>, tools: Tools) -> anyhow::Result<Device> {
    let instance = Arc::new(Instance::with_tools(tools)?);
    let description = instance.choose(wanted)?;
    Ok(Device::open_with_cache(&instance, description, cache_folder().as_deref())?)
}

/// Opens those devices, or all that can be used.
fn open_devices(list: &str, tools: Tools) -> anyhow::Result<Vec<Device>> {
    let instance = Arc::new(Instance::with_tools(tools)?);
    let descriptions = match list {
        "all" => instance.devices()?.into_iter().filter(|device| device.unusable.is_none()).collect(),
        list => list.split(',').map(|wanted| instance.choose(Some(wanted.trim()))).collect::<Result<Vec<_>, _>>()?,
    };
    for (place, device) in descriptions.iter().enumerate() {
        let again = descriptions[..place].iter().any(|before| before.is_same(device));
        anyhow::ensure!(!again, "--devices {list} names {} twice", device.name);
    }
    // Says why there is none.
    if descriptions.is_empty() {
        instance.choose(None)?;
    }
    let open = |description| Ok(Device::open_with_cache(&instance, description, cache_folder().as_deref())?);
    descriptions.into_iter().map(open).collect()
}

/// A flag that the first Ctrl-C raises, or whoever else asks the program to end, with words on what happens now. The second
/// one ends the program. A process may ask for one after another: the last one counts.
fn stop_on_interrupt(words: &'static str) -> anyhow::Result<Arc<AtomicBool>> {
    static LISTENER: Mutex<Option<(Arc<AtomicBool>, &str)>> = Mutex::new(None);
    let flag = Arc::new(AtomicBool::new(false));
    let listener = || LISTENER.lock().expect("nobody panics here");
    let before = listener().replace((Arc::clone(&flag), words));
    if before.is_none() {
        let mut signals = Signals::new(ending_signals()).context("cannot listen for Ctrl-C")?;
        std::thread::spawn(move || {
            for signal in signals.forever() {
                let Some((raised, words)) = listener().clone() else { continue };
                if raised.swap(true, Ordering::Relaxed) {
                    std::process::exit(128 + signal);
                }
                tell!("\n{words}");
            }
        });
    }
    Ok(flag)
}

/// The signals that ask the program to end. What `nohup` started is not to end with its terminal.
fn ending_signals() -> Vec<i32> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    let is_ignored = |signal: i32| ignored.is_some_and(|mask| mask & (1 << (signal - 1)) != 0);
    [SIGINT, SIGTERM].into_iter().chain((!is_ignored(SIGHUP)).then_some(SIGHUP)).collect()
}

/// Says whether a text file can be written there, before the work begins.
fn check_text_output(path: &Path) -> anyhow::Result<()> {
    raywave::whole_file::check(path).with_context(|| format!("{}: cannot be written", path.display()))
}

/// The path of an output: `-` is the standard output.
fn output_path() -> impl TypedValueParser<Value = PathBuf> {
    PathBufValueParser::new().map(|path| if path.as_os_str() == "-" { PathBuf::from(STDOUT) } else { path })
}

/// Writes a text file whole.
fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    raywave::whole_file::write_text(path, text).with_context(|| format!("{}: cannot be written", path.display()))
}

/// Bytes for people.
fn readable_bytes(bytes: u64) -> String {
    indicatif::BinaryBytes(bytes).to_string()
}
