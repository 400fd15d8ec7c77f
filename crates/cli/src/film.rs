//! Films on disk, as `render`, `merge` and `image` keep and read them.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, bail, ensure};

use raywave::film::{Film, FilmFile, FilmLock, read_film, write_film};
use raywave::render::{Kept, Statistics};
use raywave::settings::Settings;
use raywave::whole_file;
use raywave_studies::lab::{AboutFilm, Counters, available_memory};

use super::readable_bytes;
use super::render::{Encoding, write_with_record};
use super::tradeoff::duration;

/// The film that a render keeps.
#[derive(Debug, clap::Args)]
pub struct FilmArguments {
    /// Film to keep: all sums, with which the render can go on, or be put together with its other parts
    #[arg(long, value_name = "FILE")]
    pub film: Option<PathBuf>,
    /// Go on from the film if it is there
    #[arg(long, requires = "film")]
    resume: bool,
    /// Time between two saves of the film, at least; all of them take up to a hundredth of the render (60s)
    #[arg(long, value_name = "TIME", value_parser = duration, requires = "film")]
    save_every: Option<f64>,
    /// Render these blocks of samples alone, counted from 0, as a part of the image: 4-7, or 4
    #[arg(long, value_name = "FIRST-LAST", value_parser = block_numbers, requires = "film")]
    pub blocks: Option<Blocks>,
}

/// Numbers of blocks on the command line.
#[derive(Debug, Clone, PartialEq)]
pub struct Blocks(pub Range<u32>);

/// Reads `4-7` or `4`.
fn block_numbers(text: &str) -> Result<Blocks, String> {
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let number = |text: &str| text.trim().parse::<u32>().ok().filter(|number| *number < u32::MAX);
    match (number(first), number(last)) {
        (Some(first), Some(last)) if first <= last => Ok(Blocks(first..last + 1)),
        _ => Err("it is no range of blocks such as 4-7".to_owned()),
    }
}

/// The film that a render goes on with and keeps on disk, which no other process renders into.
pub struct FilmOnDisk {
    path: PathBuf,
    _lock: FilmLock,
    /// What was there, until the render begins.
    found: Option<(Film, AboutFilm)>,
    /// What the samples that were found have cost.
    before: Counters,
    every: Duration,
    saved: Instant,
}

impl FilmOnDisk {
    /// Time between two saves where the user does not say.
    const EVERY: Duration = Duration::from_secs(60);

    /// Locks the film and reads it, if it is there. Settings that leave the samples of a block open take the film's.
    pub fn open(arguments: &FilmArguments, settings: &mut Settings) -> anyhow::Result<Option<Self>> {
        let Some(path) = arguments.film.as_deref() else { return Ok(None) };
        ensure!(!whole_file::is_stream(path), "{}: a film goes to a file", path.display());
        let lock = FilmLock::new(path)?;
        let found = path.try_exists().with_context(|| format!("{}: it cannot be read", path.display()))?;
        let found = if found {
            ensure!(
                arguments.resume,
                "{}: it is there already; add --resume to go on from it, or name another film",
                path.display()
            );
            let (film, about) = read(path)?;
            settings.block_samples = settings.block_samples.or(Some(film.block_samples));
            Some((film, about))
        } else {
            None
        };
        if let Some(Blocks(blocks)) = &arguments.blocks {
            let (size, count) = (settings.block_samples(), settings.samples.div_ceil(settings.block_samples()));
            ensure!(
                blocks.end <= count,
                "--blocks {}-{}: {} samples per pixel are {} of {size}; take blocks from 0 to {}, or smaller ones by --block-samples",
                blocks.start,
                blocks.end - 1,
                settings.samples,
                if count == 1 { "one block".to_owned() } else { format!("{count} blocks") },
                count - 1
            );
        }
        let before = found.as_ref().map_or(Counters::default(), |(_, about)| about.counters.clone());
        let every = arguments.save_every.map_or(Self::EVERY, Duration::from_secs_f64);
        Ok(Some(Self { path: path.into(), _lock: lock, found, before, every, saved: Instant::now() }))
    }

    /// Whether what was found is of the render that is about to go on.
    pub fn check(&self, now: &AboutFilm) -> anyhow::Result<()> {
        let Some((film, about)) = &self.found else { return Ok(()) };
        let path = self.path.display();
        if let Err(other) = now.check_same_render(about) {
            bail!("{path}: it is of another render: {other}; render with the film's, or name another film");
        }
        ensure!(
            film.most_samples() <= u64::from(now.samples),
            "{path}: it has {} samples per pixel, more than --samples {}; ask for as many or more",
            film.most_samples(),
            now.samples
        );
        Ok(())
    }

    /// Time between two saves, at least.
    pub fn save_every(&self) -> Duration {
        self.every
    }

    /// Begins with what was found.
    pub fn begin(&mut self, kept: Kept) -> Kept {
        self.saved = Instant::now();
        match self.found.take() {
            Some((film, _)) => kept.with_film(film),
            None => kept,
        }
    }

    /// Saves what was just read off the device, if the last save is long enough ago.
    pub fn save_if_due(&mut self, kept: &Kept, about: impl Fn(&Statistics) -> AboutFilm) -> anyhow::Result<()> {
        match (kept.film(), kept.statistics()) {
            (Some(film), Some(statistics)) if self.saved.elapsed() >= self.every => self.save(film, about(statistics)),
            _ => Ok(()),
        }
    }

    /// Saves the film, with what all of its samples have cost.
    pub fn save(&mut self, film: &Film, about: AboutFilm) -> anyhow::Result<()> {
        let about = AboutFilm { counters: about.counters.plus(&self.before), ..about };
        let written = write_film(&self.path, film, &about.to_map());
        self.saved = Instant::now();
        Ok(written?)
    }
}

/// Refuses a film that does not fit the host's memory, before anything of it is there.
pub fn check_memory(settings: &Settings) -> anyhow::Result<()> {
    let Settings { width, height, samples, .. } = *settings;
    let needed = Film::most_bytes(width, height, settings.block_samples(), samples);
    let Some(available) = available_memory() else { return Ok(()) };
    ensure!(
        needed <= available,
        "a film of {width}x{height} with {samples} samples per pixel takes up to {} of memory, and {} are available; use a \
         smaller --width or --height, or a larger --block-samples",
        readable_bytes(needed),
        readable_bytes(available)
    );
    Ok(())
}

/// Reads a film and what it tells of its render.
pub fn read(path: &Path) -> anyhow::Result<(Film, AboutFilm)> {
    let FilmFile { film, about } = read_film(path)?;
    let about = AboutFilm::of_map(&about)
        .with_context(|| format!("{}: it does not tell of its render as this raywave does", path.display()))?;
    Ok((film, about))
}

/// Writes the image of a film, with what a render of all its samples would tell.
pub fn write_picture(path: &Path, film: &Film, about: &AboutFilm, encoding: &Encoding) -> anyhow::Result<()> {
    let image = film.image();
    write_with_record(path, &image, &image.digest(), about.image_record(film), encoding)
}

/// Sums up what was written of a film.
pub fn tell_of(written: &Path, film: &Film, about: &AboutFilm) {
    tell!("{}: {}x{}, {}", written.display(), film.width, film.height, in_words(film, about));
}

/// Whether a file is a film, by its name.
pub fn is_film(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("film"))
}

/// What a film lacks of the samples that its pixels are to have, as flags that render it; `None` where it lacks nothing.
pub fn lacking(film: &Film, about: &AboutFilm) -> Option<String> {
    let gaps: Vec<_> = about.sample_numbers().iter().flat_map(|samples| film.gaps(samples)).collect();
    let range = |gap: &Range<u32>| match gap.len() {
        1 => format!("--blocks {}", gap.start),
        _ => format!("--blocks {}-{}", gap.start, gap.end - 1),
    };
    (!gaps.is_empty()).then(|| gaps.iter().map(range).collect::<Vec<_>>().join(", "))
}

/// Blocks of a film, and how many it is to have, in words.
pub fn in_words(film: &Film, about: &AboutFilm) -> String {
    let (samples, size) = (about.samples, film.block_samples);
    match lacking(film, about) {
        None => format!("all of {samples} samples per pixel, in blocks of {size}"),
        Some(lacking) => format!("a part of {samples} samples per pixel, in blocks of {size}; it lacks {lacking}"),
    }
}
