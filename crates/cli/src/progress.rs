//! How a render tells how far it is: to people, to OpenJD's runners, to programs.

use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

use indicatif::{HumanCount, HumanDuration, ProgressBar, ProgressStyle};
use serde_json::json;

use raywave::render::{Progress, Statistics};

/// What progress looks like.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum ProgressKind {
    /// A bar on stderr, if that is a terminal
    #[default]
    Bar,
    /// Lines of Open Job Description on stdout: openjd_progress, openjd_status, openjd_fail
    Openjd,
    /// An object a line on stdout: samples_done, samples_total, elapsed_seconds, eta_seconds, samples_per_second, rays_per_second, rel_mse
    Json,
}

impl ProgressKind {
    /// Whether it is printed to stdout, where an image would be in its way.
    pub fn is_on_stdout(self) -> bool {
        self != Self::Bar
    }

    /// Tells whoever started the program why it failed.
    pub fn tell_failure(self, error: &anyhow::Error) {
        if self == Self::Openjd {
            line(&format!("openjd_fail: {}", format!("{error:#}").replace(char::is_control, " ")));
        }
    }
}

/// Tells of one render.
pub enum Teller {
    /// Nobody asks, or a person.
    Bar(ProgressBar),
    /// A program asks.
    Lines { kind: ProgressKind, last: Option<Figures>, told: Option<Instant> },
}

impl Teller {
    /// Time between two lines, at least.
    const EVERY: Duration = Duration::from_secs(1);

    /// Tells in that way of a render of so many samples per pixel. Who asks for lines gets them from a quiet render too.
    pub fn new(kind: ProgressKind, quiet: bool, samples: u32) -> Self {
        match kind {
            ProgressKind::Bar => Self::Bar(bar(quiet, samples)),
            kind => Self::Lines { kind, last: None, told: None },
        }
    }

    /// Tells how far the render is, unless that was told just now.
    pub fn show(&mut self, progress: &Progress) {
        let figures = Figures::of(progress);
        match self {
            Self::Bar(bar) => figures.show(bar),
            Self::Lines { kind, last, told } => {
                *last = Some(figures);
                if told.is_none_or(|told| told.elapsed() >= Self::EVERY) {
                    line(&figures.line(*kind));
                    *told = Some(Instant::now());
                }
            }
        }
    }

    /// Tells how far the render came, by what it cost.
    pub fn end(&mut self, statistics: Option<&Statistics>) {
        match self {
            Self::Bar(bar) => bar.finish_and_clear(),
            Self::Lines { kind, last, .. } => {
                let Some(last) = last else { return };
                line(&statistics.map_or(*last, |statistics| last.by(statistics)).line(*kind));
            }
        }
    }
}

fn bar(quiet: bool, samples: u32) -> ProgressBar {
    if quiet || !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{wide_bar} {percent}% of {msg}, {eta} left")
        .expect("the template is well formed");
    ProgressBar::new(1).with_style(style).with_message(format!("{samples} samples"))
}

/// How far a render is, and how fast.
#[derive(Debug, Clone, Copy)]
pub struct Figures {
    done: u64,
    total: u64,
    elapsed: Duration,
    /// Samples and rays a second.
    samples: f64,
    rays: f64,
    /// relMSE, if the render goes by it.
    error: Option<f64>,
}

impl Figures {
    fn of(progress: &Progress) -> Self {
        let seconds = progress.elapsed.as_secs_f64().max(1e-9);
        Self {
            done: progress.samples_done,
            total: progress.samples_total,
            elapsed: progress.elapsed,
            samples: progress.samples_taken as f64 / seconds,
            rays: progress.rays as f64 / seconds,
            error: progress.error,
        }
    }

    /// At the end all rays are counted.
    fn by(self, statistics: &Statistics) -> Self {
        let seconds = statistics.wall_time.as_secs_f64().max(1e-9);
        Self {
            elapsed: statistics.wall_time,
            samples: statistics.sample_count as f64 / seconds,
            rays: statistics.rays() as f64 / seconds,
            ..self
        }
    }

    /// Seconds that the rest takes at that speed, if there is one.
    fn seconds_left(&self) -> Option<f64> {
        match self.total.saturating_sub(self.done) {
            0 => Some(0.0),
            left => (self.samples > 0.0).then(|| left as f64 / self.samples),
        }
    }

    fn show(&self, bar: &ProgressBar) {
        if bar.is_hidden() {
            return;
        }
        bar.set_length(self.total);
        bar.set_position(self.done);
        bar.set_message(self.in_words());
    }

    fn in_words(&self) -> String {
        let count = HumanCount(self.total);
        if self.samples == 0.0 {
            return format!("{count} samples");
        }
        let error = self.error.map_or(String::new(), |error| format!(", relMSE {error:.1e}"));
        format!("{count} samples, {:.2} M samples/s, {:.2} M rays/s{error}", self.samples / 1e6, self.rays / 1e6)
    }

    /// The line, or lines, that tell of it.
    fn line(&self, kind: ProgressKind) -> String {
        if kind == ProgressKind::Json {
            let told = json!({
                "samples_done": self.done,
                "samples_total": self.total,
                "elapsed_seconds": self.elapsed.as_secs_f64(),
                "eta_seconds": self.seconds_left(),
                "samples_per_second": self.samples,
                "rays_per_second": self.rays,
                "relmse_by_halves": self.error,
            });
            return told.to_string();
        }
        // Downwards, for 100 means that all is done.
        let percent = (1000.0 * self.done as f64 / self.total.max(1) as f64).floor() / 10.0;
        let left = self.seconds_left().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        let left = left.map_or(String::new(), |left| format!(", {} left", HumanDuration(left)));
        format!("openjd_progress: {percent:.1}\nopenjd_status: {}{left}", self.in_words())
    }
}

/// Prints a line at once. Nobody may be listening any more, and no work is given up for that.
fn line(text: &str) {
    let mut stdout = io::stdout().lock();
    let _ = stdout.write_all(format!("{text}\n").as_bytes()).and_then(|()| stdout.flush());
}
