//! `raywave image`.

use std::path::PathBuf;

use anyhow::ensure;

use raywave::image::check_output;

use super::film::{in_words, read};
use super::render::write_with_record;
use super::tell;

/// Write the image of a film, of one that a render keeps just now too
#[derive(Debug, clap::Args)]
pub struct ImageArguments {
    /// Film
    film: PathBuf,
    /// Image to write: .png (sRGB), .exr (linear, with metadata) or .hdr (linear)
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Exposure of a PNG in stops: radiance is multiplied by 2^STOPS
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, allow_negative_numbers = true)]
    exposure: f32,
    /// No summary
    #[arg(long, short)]
    quiet: bool,
}

pub fn run(arguments: &ImageArguments) -> anyhow::Result<()> {
    let output = &arguments.output;
    check_output(output)?;
    ensure!(arguments.exposure.is_finite(), "--exposure {} is not a number of stops", arguments.exposure);
    let (film, about) = read(&arguments.film)?;
    let image = film.image();
    write_with_record(output, &image, &image.digest(), about.image_record(&film), arguments.exposure)?;
    if !arguments.quiet {
        tell!("{}: {} by {}, {}", output.display(), film.width, film.height, in_words(&film, about.samples));
    }
    Ok(())
}
