//! `raywave merge`.

use std::path::PathBuf;

use anyhow::bail;

use raywave::film::{Film, FilmLock, MergeError, Overlap, block_range, write_film};
use raywave::image::check_output;
use raywave_studies::lab::AboutFilm;

use super::check_text_output;
use super::film::{is_film, lacking, read, tell_of, write_picture};
use super::output_path;
use super::render::Encoding;

/// Put parts of a render together: to the bits that one render of all would have
#[derive(Debug, clap::Args)]
pub struct MergeArguments {
    /// Films of the parts
    #[arg(required = true, value_name = "PART")]
    parts: Vec<PathBuf>,
    /// Image or film to write, by its ending: .png, .exr or .hdr, or .film
    #[arg(short, long, value_name = "FILE", value_parser = output_path())]
    output: PathBuf,
    /// Write what there is, even if blocks are missing
    #[arg(long)]
    partial: bool,
    /// Take blocks that several parts have once: they are the same in all, as where work was done again
    #[arg(long)]
    overlapping: bool,
    #[command(flatten)]
    encoding: Encoding,
    /// No summary
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(arguments: &MergeArguments) -> anyhow::Result<()> {
    let output = &arguments.output;
    let to_film = is_film(output);
    if to_film {
        check_text_output(output)?
    } else {
        check_output(output, arguments.encoding.format())?
    }
    // What another process renders into is not replaced.
    let _lock = if to_film { Some(FilmLock::new(output)?) } else { None };
    let overlap = if arguments.overlapping { Overlap::Once } else { Overlap::Refused };
    let mut whole: Option<(Film, AboutFilm, &PathBuf)> = None;
    for path in &arguments.parts {
        let (part, about) = read(path)?;
        whole = Some(match whole {
            None => (part, about, path),
            Some((mut film, ours, first)) => {
                if let Err(other) = ours.check_same_render(&about) {
                    bail!("{} and {}: they are of different renders: {other}", first.display(), path.display());
                }
                match film.merge(part, overlap) {
                    Ok(()) => {}
                    Err(MergeError::Overlap(blocks)) => bail!(
                        "{}: the parts before it have {} as well; leave one of them out, or add --overlapping to take them once",
                        path.display(),
                        block_range(&blocks)
                    ),
                    Err(MergeError::Differ) => {
                        bail!("{} and {}: {}", first.display(), path.display(), MergeError::Differ)
                    }
                }
                let counters = ours.counters.plus(&about.counters);
                (film, AboutFilm { samples: ours.samples.max(about.samples), counters, ..ours }, first)
            }
        });
    }
    let (film, about, _) = whole.expect("there is a part at least");
    if let Some(lacking) = lacking(&film, &about).filter(|_| !arguments.partial) {
        bail!("the parts lack blocks: render {lacking} and merge again, or add --partial to write what there is");
    }
    if to_film {
        write_film(output, &film, &about.to_map())?;
    } else {
        write_picture(output, &film, &about, &arguments.encoding)?;
    }
    if !arguments.quiet {
        tell_of(output, &film, &about);
    }
    Ok(())
}
