//! What a file describes, in the terms of no file format: meshes in their own coordinates,
//! materials by their physics, placements, camera and light.
//!
//! There is one importer a format, and each fills an [`Import`]. What all formats have in common
//! is [`assemble`](super::assemble)'s: it decodes images, checks energies, places meshes in the world.

mod document;
mod mtl;
mod obj;

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec2, Vec3};

use super::{
    Camera, RenderDefaults, Surface, Triangle,
    error::{Location, SceneError},
    sources::Sources,
    transform::Transform,
};

/// Coordinates beyond this, world units, are refused, so that no area or distance overflows.
pub(super) const FARTHEST: f64 = 1e30;

/// What a file and those that it names describe. Indices are in range.
#[derive(Debug, Default)]
pub(super) struct Import {
    pub meshes: Vec<Mesh>,
    /// Meshes need not use all of them.
    pub materials: Vec<Material>,
    pub images: Vec<ImageFile>,
    pub instances: Vec<Instance>,
    /// `None` where the file has meshes and nothing else: then they are seen whole, and lit where
    /// nothing emits light.
    pub camera: Option<Camera>,
    /// Width and height of the image in pixels, at least 1, where the file says.
    pub resolution: Option<[u32; 2]>,
    pub defaults: RenderDefaults,
    pub environment: Environment,
}

/// A mesh in its own coordinates, indexed per corner.
#[derive(Debug)]
pub(super) struct Mesh {
    /// The file that it is from.
    pub location: Location,
    /// Finite.
    pub positions: Vec<DVec3>,
    /// Of any length. A triangle with one that is zero or not finite is flat.
    pub normals: Vec<DVec3>,
    /// Finite.
    pub uvs: Vec<Vec2>,
    /// Triangles, of any area; their materials are those of [`Import::materials`].
    pub triangles: Vec<Triangle>,
}

/// A mesh, by its index in [`Import::meshes`], in its place in the world.
#[derive(Debug)]
pub(super) struct Instance {
    pub mesh: usize,
    pub transform: Transform,
}

/// A material as it is described: no energy rule is applied, and what the surface does not show may
/// have any value in range.
#[derive(Debug, Clone)]
pub(super) struct Material {
    pub name: String,
    /// Where it is defined, or overridden; `None` where it is nowhere.
    pub location: Option<Location>,
    pub surface: Surface,
    /// Diffuse reflectance, each channel at least 0.
    pub diffuse: Vec3,
    /// Weight of the Phong lobe or reflectance of the mirror, each channel at least 0.
    pub specular: Vec3,
    /// Phong exponent, at least 0.
    pub exponent: f32,
    /// Index of refraction inside, greater than 0.
    pub ior: f32,
    /// Tint of transmitted light, each channel at least 0.
    pub transmission: Vec3,
    /// Radiance emitted from the front, each channel at least 0.
    pub emission: Vec3,
    /// Index into [`Import::images`] of what replaces `diffuse` on faces with texture coordinates.
    pub diffuse_image: Option<usize>,
    /// What to tell a user whose scene uses this material.
    pub warnings: Vec<String>,
}

impl Material {
    /// Grey, and nothing else.
    pub fn named(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            location: None,
            surface: Surface::Glossy,
            diffuse: Vec3::splat(0.8),
            specular: Vec3::ZERO,
            exponent: 1.0,
            ior: 1.0,
            transmission: Vec3::ONE,
            emission: Vec3::ZERO,
            diffuse_image: None,
            warnings: Vec::new(),
        }
    }

    /// The image that the surface shows, where it can show one.
    pub fn visible_image(&self) -> Option<usize> {
        self.diffuse_image.filter(|_| self.surface == Surface::Glossy && self.emission == Vec3::ZERO)
    }
}

/// An image file and the line that names it. It is read where a scene shows it.
#[derive(Debug, Clone)]
pub(super) struct ImageFile {
    pub path: PathBuf,
    pub location: Location,
}

/// Light from infinity, as it is described.
#[derive(Debug, Default)]
pub(super) enum Environment {
    #[default]
    Black,
    Constant(Vec3),
    /// A lat-long image times a scale.
    LatLong {
        image: ImageFile,
        scale: f32,
    },
}

impl Import {
    /// The index of an image, which is added where it is new.
    fn image(&mut self, image: &ImageFile) -> usize {
        let known = self.images.iter().position(|other| other.path == image.path);
        known.unwrap_or_else(|| {
            self.images.push(image.clone());
            self.images.len() - 1
        })
    }
}

/// Imports a file by the importer that the extension of its name stands for.
pub(super) fn import(path: &Path, sources: &mut Sources) -> Result<Import, SceneError> {
    let location = Location::file(path);
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    match extension.to_str() {
        Some("toml") => document::import(path, sources),
        Some("obj") => {
            let mut import = Import::default();
            let mesh = obj::Importer::default().add(path, &location, sources, &mut import)?;
            import.instances.push(Instance { mesh, transform: Transform::IDENTITY });
            Ok(import)
        }
        _ => Err(location.refuse("neither .toml nor .obj; name a scene file or a mesh")),
    }
}
