//! Films in files: `docs/film.md` has the format.

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use thiserror::Error;

use super::blocks::{Film, Run, Strip, Sums, block_range};
use crate::image::MAX_PIXELS;
use crate::whole_file;

/// What every film begins with, before the version.
const MAGIC: &str = "raywave film ";
/// The version that is written, and the only one that is read.
const VERSION: &str = "1";
/// Most bytes of the line that says what the film holds.
const MOST_ABOUT_BYTES: u64 = 1 << 24;

/// A film and what is told of the render that it belongs to.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmFile {
    /// The sums.
    pub film: Film,
    /// Settings, scene, device and counters, as the program tells them.
    pub about: Map<String, Value>,
}

/// Why a film was not read or written.
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum FilmError {
    #[error("{}: it cannot be read: {cause}", .path.display())]
    Read { path: PathBuf, cause: io::Error },
    #[error("{}: it cannot be written: {cause}", .path.display())]
    Write { path: PathBuf, cause: io::Error },
    #[error("{}: it is no film of raywave; name a file that `raywave render --film` has written", .path.display())]
    NoFilm { path: PathBuf },
    #[error("{}: it is a film of version {found}, and this raywave reads version {VERSION}", .path.display())]
    Version { path: PathBuf, found: String },
    #[error("{}: it is damaged: {what}; render it again, or take a copy", .path.display())]
    Damaged { path: PathBuf, what: String },
    #[error("{}: another process renders into it; wait for that, or name another film", .path.display())]
    Locked { path: PathBuf },
}

/// The line of JSON.
#[derive(Debug, Serialize, Deserialize)]
struct Header {
    width_pixels: u32,
    height_pixels: u32,
    block_samples: u32,
    radiance_scale: f64,
    about: Map<String, Value>,
    /// NumPy's names of the records of either kind.
    records: Value,
    strips: Vec<StripHeader>,
}

#[derive(Debug, Serialize, Deserialize)]
struct StripHeader {
    first_row: u32,
    rows: u32,
    runs: Vec<RunHeader>,
}

#[derive(Debug, Serialize, Deserialize)]
struct RunHeader {
    first_block: u32,
    blocks: u32,
    samples: u32,
    records: Kind,
    /// From the end of the line of JSON on.
    offset_bytes: u64,
    blake3: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Kind {
    Whole,
    Open,
}

impl Kind {
    fn of(sums: &Sums) -> Self {
        match sums {
            Sums::Whole(_) => Self::Whole,
            Sums::Open(_) => Self::Open,
        }
    }

    fn record_bytes(self) -> u64 {
        match self {
            Self::Whole => 48,
            Self::Open => 64,
        }
    }
}

/// The bytes of sums.
fn bytes(sums: &Sums) -> &[u8] {
    match sums {
        Sums::Whole(pixels) => bytemuck::cast_slice(pixels),
        Sums::Open(pixels) => bytemuck::cast_slice(pixels),
    }
}

/// Writes a film whole or not at all.
///
/// # Errors
/// A file that cannot be written.
///
/// # Panics
/// When sums were taken out of the film.
pub fn write_film(path: &Path, film: &Film, about: &Map<String, Value>) -> Result<(), FilmError> {
    assert!(!film.strips().iter().any(Strip::is_taken), "all of the film is there");
    let mut offset_bytes = 0;
    let mut run_header = |run: &Run| {
        let bytes = bytes(&run.sums);
        let header = RunHeader {
            first_block: run.first,
            blocks: run.blocks,
            samples: run.samples,
            records: Kind::of(&run.sums),
            offset_bytes,
            blake3: blake3::Hasher::new().update_rayon(bytes).finalize().to_hex().to_string(),
        };
        offset_bytes += bytes.len() as u64;
        header
    };
    let strips = film.strips().iter().map(|strip| StripHeader {
        first_row: strip.first_row,
        rows: strip.rows,
        runs: strip.runs.iter().map(&mut run_header).collect(),
    });
    let header = Header {
        strips: strips.collect(),
        width_pixels: film.width,
        height_pixels: film.height,
        block_samples: film.block_samples,
        radiance_scale: film.radiance_scale,
        about: about.clone(),
        records: json!({
            "whole": [["sum", "<f8", [3]], ["squares", "<f8", [3]]],
            "open": [
                ["sum", "<f4", [4]], ["sum_compensation", "<f4", [4]],
                ["squares", "<f4", [4]], ["squares_compensation", "<f4", [4]],
            ],
        }),
    };
    let header = serde_json::to_string(&header).expect("numbers and names become JSON");
    let fill = |file: &mut dyn Write| {
        writeln!(file, "{MAGIC}{VERSION}\n{}\n{header}", blake3::hash(header.as_bytes()).to_hex())?;
        film.strips().iter().flat_map(|strip| &strip.runs).try_for_each(|run| file.write_all(bytes(&run.sums)))
    };
    whole_file::write(path, fill).map_err(|cause| FilmError::Write { path: path.into(), cause })
}

/// Reads a film and checks all of it.
///
/// # Errors
/// A file that cannot be read, is no film or is damaged.
pub fn read_film(path: &Path) -> Result<FilmFile, FilmError> {
    let unreadable = |cause| FilmError::Read { path: path.into(), cause };
    let file = File::open(path).map_err(unreadable)?;
    let length = file.metadata().map_err(unreadable)?.len();
    parse(BufReader::new(file), length).map_err(|error| match error {
        ParseError::Read(cause) => FilmError::Read { path: path.into(), cause },
        ParseError::NoFilm => FilmError::NoFilm { path: path.into() },
        ParseError::Version(found) => FilmError::Version { path: path.into(), found },
        ParseError::Damaged(what) => FilmError::Damaged { path: path.into(), what },
    })
}

enum ParseError {
    Read(io::Error),
    NoFilm,
    Version(String),
    Damaged(String),
}

impl From<io::Error> for ParseError {
    fn from(error: io::Error) -> Self {
        Self::Read(error)
    }
}

fn damaged<T>(what: impl Into<String>) -> Result<T, ParseError> {
    Err(ParseError::Damaged(what.into()))
}

fn parse(mut file: impl BufRead, length: u64) -> Result<FilmFile, ParseError> {
    let mut magic = String::new();
    match file.by_ref().take(64).read_line(&mut magic) {
        Err(error) if error.kind() == io::ErrorKind::InvalidData => return Err(ParseError::NoFilm),
        read => read?,
    };
    let version = magic.strip_prefix(MAGIC).and_then(|rest| rest.strip_suffix('\n')).ok_or(ParseError::NoFilm)?;
    if version != VERSION {
        return Err(ParseError::Version(version.to_owned()));
    }
    let mut line = |most: u64| -> Result<Vec<u8>, ParseError> {
        let mut line = Vec::new();
        file.by_ref().take(most).read_until(b'\n', &mut line)?;
        match line.pop() {
            Some(b'\n') => Ok(line),
            _ => damaged("it ends before what it holds is told"),
        }
    };
    let (checksum, text) = (line(80)?, line(MOST_ABOUT_BYTES)?);
    if blake3::hash(&text).to_hex().as_bytes() != checksum {
        return damaged("what it says of itself does not match its checksum");
    }
    let header: Header = serde_json::from_slice(&text)
        .or_else(|error| damaged(format!("what it says of itself is not understood: {error}")))?;
    let data = length.saturating_sub((magic.len() + checksum.len() + text.len() + 2) as u64);
    let (width, height) = (header.width_pixels, header.height_pixels);
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS {
        return damaged(format!("an image of {width}x{height} is none that is rendered"));
    }
    let has_scale = header.radiance_scale > 0.0 && header.radiance_scale.is_finite();
    if !(header.block_samples.is_power_of_two() && has_scale) {
        return damaged("its blocks or its unit of radiance are none that are rendered");
    }
    let (mut row, mut offset) = (0, 0);
    let mut strips = Vec::new();
    for strip in header.strips {
        if strip.first_row != row || strip.rows == 0 || strip.rows > height - row {
            return damaged("its rows do not follow each other");
        }
        row += strip.rows;
        let count = u64::from(strip.rows) * u64::from(width);
        let (mut runs, mut end) = (Vec::new(), 0);
        for run in strip.runs {
            check_run(&run, end, header.block_samples)?;
            end = run.first_block + run.blocks;
            let bytes = count * run.records.record_bytes();
            if run.offset_bytes != offset || bytes > data - offset {
                return damaged(format!("it should have {} bytes of sums and has {data}", offset + bytes));
            }
            offset += bytes;
            let sums = match run.records {
                Kind::Whole => Sums::Whole(records(&mut file, count, &run.blake3)?),
                Kind::Open => Sums::Open(records(&mut file, count, &run.blake3)?),
            };
            runs.push(Run { first: run.first_block, blocks: run.blocks, samples: run.samples, sums });
        }
        strips.push(Strip { first_row: strip.first_row, rows: strip.rows, runs });
    }
    if row != height {
        return damaged(format!("it has {row} rows of {height}"));
    }
    if offset != data {
        return damaged(format!("it should have {offset} bytes of sums and has {data}"));
    }
    let film = Film::of_strips(width, height, header.block_samples, header.radiance_scale, strips);
    Ok(FilmFile { film, about: header.about })
}

fn check_run(run: &RunHeader, end: u32, block_samples: u32) -> Result<(), ParseError> {
    let (blocks, samples) = (u64::from(run.blocks), u64::from(run.blocks) * u64::from(block_samples));
    let is_aligned = run.blocks.is_power_of_two() && run.first_block.is_multiple_of(run.blocks);
    let is_counted = match run.records {
        Kind::Whole => u64::from(run.samples) == samples,
        Kind::Open => run.blocks == 1 && (1..block_samples).contains(&run.samples),
    };
    let fits = (u64::from(run.first_block) + blocks) * u64::from(block_samples) <= 1 << 32;
    if is_aligned && is_counted && fits && run.first_block >= end {
        return Ok(());
    }
    let range: Range<u32> = run.first_block..run.first_block.saturating_add(run.blocks);
    damaged(format!("{} of {} samples are none that are rendered", block_range(&range), run.samples))
}

fn records<T: Pod + Zeroable>(file: &mut impl Read, count: u64, checksum: &str) -> Result<Vec<T>, ParseError> {
    let mut records = vec![T::zeroed(); count as usize];
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut records);
    file.read_exact(bytes)?;
    if blake3::Hasher::new().update_rayon(bytes).finalize().to_hex().as_str() != checksum {
        return damaged("sums do not match their checksum");
    }
    Ok(records)
}

/// A film that this process alone renders into, until it is dropped. Others may read the file.
#[derive(Debug)]
pub struct FilmLock {
    path: PathBuf,
    _file: File,
}

impl FilmLock {
    /// Locks a film, which need not be there: by a file of its own beside it, whose lock the system gives up with the
    /// process.
    ///
    /// # Errors
    /// When another process has it, or its folder cannot be written.
    pub fn new(film: &Path) -> Result<Self, FilmError> {
        let name = film.file_name().unwrap_or_default().to_string_lossy();
        let path = film.with_file_name(format!(".{name}.lock"));
        let unwritable = |cause| FilmError::Write { path: film.into(), cause };
        loop {
            let file = File::options().create(true).truncate(false).write(true).open(&path).map_err(unwritable)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(fs::TryLockError::WouldBlock) => return Err(FilmError::Locked { path: film.into() }),
                Err(fs::TryLockError::Error(cause)) => return Err(unwritable(cause)),
            }
            // The one who had it before may have removed it meanwhile.
            if is_at(&file, &path) {
                return Ok(Self { path, _file: file });
            }
        }
    }
}

impl Drop for FilmLock {
    fn drop(&mut self) {
        // While it is still locked, so that nobody else's is removed. One that stays does no harm.
        let _ = fs::remove_file(&self.path);
    }
}

/// Whether the file of that name is the open one.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |metadata: fs::Metadata| (metadata.dev(), metadata.ino());
    matches!((file.metadata().map(identity), fs::metadata(path).map(identity)), (Ok(open), Ok(named)) if open == named)
}

/// An open file keeps its name.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}
