//! `raywave compare`: which combination of settings is faster, by how much, and how sure that is.
//!
//! From arguments to a [`Study`], its progress and its files. What renders is handed in.

use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

use anyhow::bail;
use indicatif::ProgressBar;
use jiff::Timestamp;

use super::picture::PictureArguments;
use super::{at_least_one, output_path, print, stop_on_interrupt};
use raywave_studies::export::{Document, Exports, Format};
use raywave_studies::studies::{
    Clock, Design, Event, Factor, Provenance, Purpose, Renderer, Report, Rounds, Study, StudyError, Verdict,
};

/// Compare settings: times with intervals, ratios to a baseline, where the time goes
///
/// Renders every combination of the varied settings, checks that the images agree, and times them
/// in rounds of random order. Exits with an error where an image is wrong.
#[derive(Debug, Clone, clap::Args)]
pub struct CompareArguments {
    /// Scene files (.toml) or meshes (.obj); the built-in Cornell box without
    #[arg(value_name = "SCENE")]
    pub scenes: Vec<String>,
    /// Settings to vary, each perhaps with levels: scheduler or in-flight=16k,64k,1M (k is 1024, M is 1024²)
    #[arg(long, value_name = "FACTOR[=LEVEL,...]")]
    pub vary: Vec<String>,
    /// What to compare with, in place of the first level of each factor
    #[arg(long, value_name = "FACTOR=LEVEL,...")]
    pub baseline: Option<String>,
    /// Sweep the cost of shading, or the number of material branches, and find where the faster scheduler changes
    #[arg(long, value_name = "FACTOR", num_args = 0..=1, default_missing_value = "shading-cost", value_parser = ["shading-cost", "materials"])]
    pub crossover: Option<String>,
    /// Timed renders of each combination, at least
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = at_least_one)]
    pub rounds: usize,
    /// Go on until every interval is narrower than this share of its value, such as 3%
    #[arg(long, value_name = "SHARE", value_parser = share)]
    pub until: Option<f64>,
    /// Timed renders of each combination, at most, with --until
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = at_least_one, requires = "until")]
    pub max_rounds: usize,
    /// Clock to compare by: wall (the host's, around the render) or gpu (inside command buffers)
    #[arg(long, value_name = "CLOCK", default_value = "wall", value_parser = clock)]
    pub clock: Clock,
    /// Leave out the renders that count nodes, triangles and lanes
    #[arg(long)]
    pub no_counters: bool,
    /// Processes of each combination that are started to their first sample with cold caches, and as
    /// many with warm ones; 0 leaves start-up and compile times unmeasured
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub start_ups: usize,
    /// Seed of the order of the renders
    #[arg(long, value_name = "SEED", default_value_t = 0)]
    pub order_seed: u64,
    /// Clocks and power limits of the device, for the record
    #[arg(long, value_name = "TEXT")]
    pub clocks: Option<String>,
    /// What to render, and on which device.
    #[command(flatten)]
    pub picture: PictureArguments,
    /// Exposure of the images in the page, in stops
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    pub exposure: f32,
    /// Write everything, as JSON; - is stdout, in place of the tables, here as below
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    pub json: Option<PathBuf>,
    /// Write a row for each combination, as CSV
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    pub csv: Option<PathBuf>,
    /// Write tables, as Markdown
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    pub markdown: Option<PathBuf>,
    /// Write a page with tables, plots and images
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    pub html: Option<PathBuf>,
    /// No progress or warnings
    #[arg(long, short)]
    pub quiet: bool,
}

/// The study that the arguments ask for.
///
/// # Errors
/// Factors, levels, a baseline or rounds that make no sense.
pub fn study(arguments: &CompareArguments) -> Result<Study, StudyError> {
    let mut factors = Vec::new();
    for text in &arguments.vary {
        factors.extend(Factor::parse_list(text)?);
    }
    let varies = |factors: &[Factor], name: &str| factors.iter().any(|factor| factor.setting.flag == name);
    if arguments.vary.is_empty() || (arguments.crossover.is_some() && !varies(&factors, "scheduler")) {
        factors.insert(0, Factor::parse("scheduler")?);
    }
    if let Some(cost) = &arguments.crossover {
        let cost = Factor::parse(cost)?;
        if !varies(&factors, cost.setting.flag) {
            factors.push(cost);
        }
    }
    let max = if arguments.until.is_some() { arguments.max_rounds } else { arguments.rounds };
    if arguments.rounds > max {
        return Err(StudyError::RoundsReversed { min: arguments.rounds, max });
    }
    Ok(Study {
        design: Design::new(factors, arguments.baseline.as_deref())?,
        scenes: if arguments.scenes.is_empty() { vec![String::new()] } else { arguments.scenes.clone() },
        rounds: Rounds { min: arguments.rounds, max, until: arguments.until },
        clock: arguments.clock,
        seed: arguments.order_seed,
        counting: !arguments.no_counters,
    })
}

/// Carries the study out with a renderer that `open` makes once the arguments are known to make
/// sense, keeps the files up to date, and prints tables to stdout. A scene that is the empty text
/// is the built-in one.
///
/// # Errors
/// Bad arguments, files that cannot be written, a scene or a baseline that does not render, and,
/// once all is written, an image that is wrong.
pub fn run(
    arguments: &CompareArguments,
    open: impl FnOnce(&CompareArguments) -> anyhow::Result<(Box<dyn Renderer>, Provenance)>,
) -> anyhow::Result<()> {
    let study = study(arguments)?;
    let mut exports = Exports::open(files(arguments), arguments.exposure)?;
    let (mut renderer, mut provenance) = open(arguments)?;
    let interrupted =
        stop_on_interrupt("ending after this render; the files keep what there is; Ctrl-C again gives it up")?;
    let progress = Progress::new(arguments.quiet);

    let mut unwritten = None;
    let outcome = study.run(renderer.as_mut(), &mut |event| {
        progress.show(&event);
        if let Event::Updated { report } = event {
            provenance.settings = report.shared_settings();
            if let Err(error) = exports.update(&Document { provenance: &provenance, report }) {
                unwritten = Some(error);
                return ControlFlow::Break(());
            }
        }
        if interrupted.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    progress.bar.finish_and_clear();
    let report = outcome?;
    provenance.settings = report.shared_settings();
    let document = Document { provenance: &provenance, report: &report };
    // A study that was broken off has more to say than it last wrote.
    let written = unwritten.map_or_else(|| exports.write(&document), Err);
    if !exports.take_stdout() {
        print(&document.markdown())?;
    }
    written?;
    judge(&report)
}

/// An error where an image is wrong.
fn judge(report: &Report) -> anyhow::Result<()> {
    for scene in &report.scenes {
        for combination in &scene.combinations {
            if let Verdict::Wrong { reason, .. } = &combination.verdict {
                bail!("{}, {}: wrong image: {reason}", scene.facts.scene, combination.label);
            }
        }
    }
    Ok(())
}

fn files(arguments: &CompareArguments) -> Vec<(Format, PathBuf)> {
    let named = [
        (Format::Json, &arguments.json),
        (Format::Csv, &arguments.csv),
        (Format::Markdown, &arguments.markdown),
        (Format::Html, &arguments.html),
    ];
    named.into_iter().filter_map(|(format, path)| Some((format, path.clone()?))).collect()
}

/// What the record says of this run besides the device: version, command and date. The command is
/// named without its path.
pub fn provenance() -> Provenance {
    let quote = |argument: String| {
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_=,./:%+".contains(c);
        if !argument.is_empty() && argument.chars().all(plain) {
            argument
        } else {
            format!("'{}'", argument.replace('\'', r"'\''"))
        }
    };
    let arguments = std::env::args_os().skip(1).map(|argument| quote(argument.to_string_lossy().into_owned()));
    Provenance {
        raywave_version: raywave::VERSION.to_owned(),
        rustc_version: raywave::RUSTC_VERSION.to_owned(),
        command_line: std::iter::once("raywave".to_owned()).chain(arguments).collect::<Vec<_>>().join(" "),
        date: Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string(),
        ..Provenance::default()
    }
}

fn share(text: &str) -> Result<f64, StudyError> {
    let value = match text.strip_suffix('%') {
        Some(percent) => percent.trim().parse::<f64>().map(|percent| percent / 100.0),
        None => text.parse(),
    };
    value.ok().filter(|share| *share > 0.0 && *share < 1.0).ok_or_else(|| StudyError::BadShare(text.to_owned()))
}

fn clock(text: &str) -> Result<Clock, String> {
    match text {
        "wall" => Ok(Clock::Wall),
        "gpu" => Ok(Clock::Gpu),
        _ => Err("use wall or gpu".to_owned()),
    }
}

/// What is going on, on stderr.
struct Progress {
    bar: ProgressBar,
    quiet: bool,
}

impl Progress {
    fn new(quiet: bool) -> Self {
        let hidden = quiet || !std::io::stderr().is_terminal();
        Self { bar: if hidden { ProgressBar::hidden() } else { ProgressBar::new_spinner() }, quiet }
    }

    fn show(&self, event: &Event<'_>) {
        match event {
            Event::Rendering { scene, label, purpose, round } => {
                let step = match (purpose, round) {
                    (Purpose::First, _) => "first render".to_owned(),
                    (Purpose::Counting, _) => "counting".to_owned(),
                    (Purpose::Timed | Purpose::Seeded(_), round) => {
                        format!("round {}", round.map_or(0, |round| round + 1))
                    }
                };
                self.bar.set_message(format!("{scene}: {step}: {label}"));
                self.bar.tick();
            }
            Event::Judged { scene, label, verdict } if !verdict.counts() && !self.quiet => {
                let said = format!("warning: {scene}, {label}: {}: {}", verdict.word(), verdict.explanation());
                self.bar.suspend(|| tell!("{said}"));
            }
            _ => (),
        }
    }
}
