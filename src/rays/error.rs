//! What can be wrong with a ray dump.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use super::RayScene;

/// Why rays could not be read or written. Every message is one line and says where the error is.
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum RaysError {
    #[error("{}: cannot read the rays ({cause}); check the path", path.display())]
    Read { path: PathBuf, cause: io::Error },
    #[error("{}: cannot be written: {cause}", path.display())]
    Write { path: PathBuf, cause: io::Error },
    #[error("{}: byte {byte}: {fault}", path.display())]
    Malformed { path: PathBuf, byte: u64, fault: Fault },
}

/// What is wrong with the contents of a file.
#[derive(Debug, Clone, PartialEq, Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum Fault {
    #[error("this is no ray dump, which begins with `raywave rays`; name a file that `raywave dump-rays` wrote")]
    Magic,
    #[error("the dump has version {0} of the format and this raywave reads versions 1 and 2; dump the rays anew")]
    Version(String),
    #[error("the file ends within the metadata; dump the rays anew")]
    MetadataCut,
    #[error("the line of metadata does not end within {0} bytes; dump the rays anew")]
    MetadataTooLong(u64),
    #[error("the metadata cannot be read: {0}; dump the rays anew")]
    Metadata(String),
    #[error("the records are laid out in another way than this raywave reads; dump the rays anew")]
    Layout,
    #[error(
        "the rays are of scene {} with hash {} and this is {} with hash {}; name the scene that they were dumped from, or dump them anew",
        dumped.scene, dumped.scene_hash, named.scene, named.scene_hash
    )]
    Scene { dumped: Box<RayScene>, named: Box<RayScene> },
    #[error("the dump of raywave {0} lays its scene into another space than this raywave does; dump the rays anew")]
    Space(String),
    #[error("the dump says that it holds {0} rays; it must be at least 1 and fit memory")]
    Count(u64),
    #[error("the file ends after {whole} of {rays} rays; dump them anew")]
    Cut { whole: u64, rays: u64 },
    #[error("the file goes on after the last of {rays} rays; dump them anew")]
    TooLong { rays: u64 },
    #[error("ray {ray}: {fault}")]
    Ray { ray: u64, fault: Box<Fault> },
    #[error("{field} holds {value}, which is not finite")]
    NotFinite { field: &'static str, value: f32 },
    #[error("direction is zero")]
    NoDirection,
    #[error("{field} is triangle {triangle} and its instance has {triangles}")]
    NoSuchTriangleOfInstance { field: &'static str, triangle: u32, triangles: u32 },
    #[error("{field} is triangle {triangle} and the scene has {triangles}")]
    NoSuchTriangle { field: &'static str, triangle: u32, triangles: u32 },
    #[error("{field} is of instance {instance} and the scene has {instances}")]
    NoSuchInstance { field: &'static str, instance: u32, instances: u64 },
    #[error("target is a triangle, which only shadow rays have")]
    Target,
}
