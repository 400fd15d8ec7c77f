//! `raywave image`.

use std::path::PathBuf;

use raywave::image::check_output;

use super::film::{read, tell_of, write_picture};
use super::output_path;
use super::render::Encoding;

/// Write the image of a film, of one that a render keeps just now too
#[derive(Debug, clap::Args)]
pub struct ImageArguments {
    /// Film
    film: PathBuf,
    /// Image to write: .png (sRGB), .exr (linear, with metadata) or .hdr (linear)
    #[arg(short, long, value_name = "FILE", value_parser = output_path())]
    output: PathBuf,
    #[command(flatten)]
    encoding: Encoding,
    /// No summary
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(arguments: &ImageArguments) -> anyhow::Result<()> {
    let output = &arguments.output;
    check_output(output, arguments.encoding.format())?;
    let (film, about) = read(&arguments.film)?;
    write_picture(output, &film, &about, &arguments.encoding)?;
    if !arguments.quiet {
        tell_of(output, &film, &about);
    }
    Ok(())
}
