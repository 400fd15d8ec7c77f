//! `raywave convert`.

use std::path::PathBuf;

use anyhow::ensure;

use super::{LoadArguments, check_text_output, load_scene, warn_unless};
use raywave::bvh::MAX_TRIANGLES;
use raywave::scene::{MeshFormat, SceneFiles};
use raywave::whole_file::is_same;

/// Write a scene as a scene file (.toml), with its meshes and images beside it
///
/// What the scene format does not say, such as rough metals and lights that are no surfaces, is told in one warning.
#[derive(Debug, clap::Args)]
pub struct ConvertArguments {
    /// Scene (.toml, .gltf, .glb) or mesh (.obj, .ply)
    scene: PathBuf,
    /// Scene file to write (.toml); files beside it begin with its name
    output: PathBuf,
    #[command(flatten)]
    load: LoadArguments,
    /// Format of the meshes
    #[arg(long, value_enum, default_value_t = Format::Obj)]
    format: Format,
    /// No warnings
    #[arg(long, short)]
    quiet: bool,
}

/// A format of meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// One file, as text
    Obj,
    /// A file for each material, binary
    Ply,
}

pub fn run(arguments: &ConvertArguments) -> anyhow::Result<()> {
    let ConvertArguments { scene: input, output, .. } = arguments;
    let is_scene_file = output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    ensure!(is_scene_file, "{}: a scene file ends in .toml; name one", output.display());
    check_text_output(output)?;
    let scene = load_scene(Some(input), &arguments.load.options(), arguments.quiet)?;
    let triangles = scene.triangle_count();
    ensure!(
        triangles <= MAX_TRIANGLES as u64,
        "{}: it has {triangles} triangles where meshes are written in each of their places, and {MAX_TRIANGLES} are the \
         most; place them fewer times",
        input.display()
    );
    let format = match arguments.format {
        Format::Obj => MeshFormat::Obj,
        Format::Ply => MeshFormat::Ply,
    };
    let files = SceneFiles::new(&scene, output, format);
    for path in files.paths() {
        ensure!(!is_same(input, &path)?, "{}: it would be overwritten; name another output", input.display());
    }
    if !files.lost.is_empty() {
        warn_unless(arguments.quiet)(&format!(
            "{}: the scene format lacks {}",
            output.display(),
            files.lost.join("; ")
        ));
    }
    files
        .write()
        .map_err(|(path, error)| anyhow::Error::new(error).context(format!("{}: cannot be written", path.display())))
}
