//! The gallery: a scene of our own, made rather than drawn, for any number of triangles.
//!
//! A hall with a colonnade open to an evening sky, statues of most kinds of surface on plinths, and
//! lamps of several sizes and colours. The same count gives the same files.
//!
//! This room is content: it writes files as any other program could, and knows of scenes only their
//! formats.

mod hall;
mod images;
mod mesh;
mod noise;
mod surfaces;

use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
};

use raywave::image::{Image, WriteOptions, image_bytes};
use raywave::whole_file;

const SCENE: &str = include_str!("gallery.toml");
const MATERIALS: &str = include_str!("gallery.mtl");

/// A file of the gallery that cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot be written ({cause}); check the folder and the space left", path.display())]
pub struct GalleryError {
    /// The file or folder.
    pub path: PathBuf,
    /// What stands in the way.
    pub cause: io::Error,
}

/// Writes `gallery.toml` and the files it names into `dir`, which is made where it is missing.
/// Each file appears whole or not at all; the scene file comes last.
///
/// The mesh has about `triangles` triangles: within 2 % from 50 000 on, and never fewer
/// than the few thousand that its shapes need.
///
/// # Errors
/// Where a file cannot be written.
pub fn generate_gallery(dir: &Path, triangles: usize) -> Result<(), GalleryError> {
    let refuse = |path: &Path, cause: io::Error| GalleryError { path: path.to_path_buf(), cause };
    fs::create_dir_all(dir).map_err(|cause| refuse(dir, cause))?;
    let write = |name: &str, fill: &dyn Fn(&mut dyn Write) -> io::Result<()>| {
        let path = dir.join(name);
        whole_file::write(&path, fill).map_err(|cause| refuse(&path, cause))
    };
    let encoded = |name: &str, image: &Image| {
        image_bytes(Path::new(name), image, &WriteOptions::default()).map_err(io::Error::other)
    };
    write("gallery.mtl", &|out| out.write_all(MATERIALS.as_bytes()))?;
    write("gallery.png", &|out| out.write_all(&encoded("gallery.png", &images::tiles())?))?;
    write("gallery.exr", &|out| out.write_all(&encoded("gallery.exr", &images::evening_sky())?))?;
    write("gallery.obj", &|out| mesh::write(out, triangles))?;
    write("gallery.toml", &|out| out.write_all(SCENE.as_bytes()))
}
