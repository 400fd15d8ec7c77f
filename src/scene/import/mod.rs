//! What a file describes, in the terms of no file format: meshes in their own coordinates,
//! materials by their physics, placements, camera and light.
//!
//! There is one importer a format, and each fills an [`Import`]. What all formats have in common
//! is [`assemble`](super::assemble)'s: it decodes images, checks energies, places meshes in the world.

mod document;
mod mtl;
mod obj;

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

use glam::{DVec3, Vec2, Vec3};

use super::{
    Camera, Surface, Triangle,
    error::{Location, SceneError},
    sources::{Sources, Warning},
    transform::Transform,
};
use crate::settings::Settings;

/// Coordinates beyond this, world units, are refused, so that no area or distance overflows.
pub(super) const FARTHEST: f64 = 1e30;

/// What a file and those that it names describe. Indices are in range.
#[derive(Debug, Default)]
pub(super) struct Import {
    pub meshes: Vec<Mesh>,
    /// Meshes need not use all of them.
    pub materials: Vec<Material>,
    pub images: Images,
    pub instances: Vec<Instance>,
    /// `None` where the file has meshes and nothing else: then they are seen whole, and lit where
    /// nothing emits light.
    pub camera: Option<Camera>,
    /// What the file asks of a render, and defaults.
    pub settings: Settings,
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
    /// Index among the files of [`Import::images`] of what replaces `diffuse` on faces with texture coordinates.
    pub diffuse_image: Option<usize>,
    /// Where that image lies on the surface.
    pub image_place: Place,
    /// Keys whose values cannot be used.
    pub faults: Vec<Fault>,
    /// Glass that it is to be once its index of refraction is given.
    pub withheld: Option<Surface>,
    /// For a user whose scene uses this material.
    pub warnings: Vec<Warning>,
}

/// What is wrong with the value of a key, of account where a surface shows that key.
#[derive(Debug, Clone)]
pub(super) struct Fault {
    pub key: &'static str,
    pub location: Location,
    pub problem: String,
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
            image_place: Place::default(),
            faults: Vec::new(),
            withheld: None,
            warnings: Vec::new(),
        }
    }

    /// The image that the surface shows, where it can show one.
    pub fn visible_image(&self) -> Option<usize> {
        self.diffuse_image.filter(|_| self.shows("Kd"))
    }

    /// Whether the value of a key makes a difference to the surface.
    pub fn shows(&self, key: &str) -> bool {
        let emits = self.emission != Vec3::ZERO;
        match key {
            "Kd" => self.surface.is_diffuse() && !emits,
            "Ks" => self.surface.is_reflector() && !emits,
            "Ns" => self.surface == Surface::Glossy && self.specular != Vec3::ZERO && !emits,
            "Ni" | "Tf" => self.surface.refracts() && !emits,
            _ => true,
        }
    }
}

/// An image file and the line that names it. It is read where a scene shows it.
#[derive(Debug, Clone)]
pub(super) struct ImageFile {
    pub path: PathBuf,
    pub location: Location,
}

/// The image files that materials name, each once.
#[derive(Debug, Default)]
pub(super) struct Images {
    pub files: Vec<ImageFile>,
    indices: HashMap<PathBuf, usize>,
}

impl Images {
    /// The index of an image, which is added where it is new.
    fn index_of(&mut self, image: &ImageFile) -> usize {
        let index = *self.indices.entry(image.path.clone()).or_insert(self.files.len());
        if index == self.files.len() {
            self.files.push(image.clone());
        }
        index
    }
}

/// Where an image lies on a surface: at texture coordinates times the scale, and then moved by the offset. Both are finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    pub scale: Vec2,
    pub offset: Vec2,
}

impl Default for Place {
    fn default() -> Self {
        Self { scale: Vec2::ONE, offset: Vec2::ZERO }
    }
}

impl Place {
    pub fn is_finite(&self) -> bool {
        self.scale.is_finite() && self.offset.is_finite()
    }

    /// The texture coordinates of the image at those of the surface.
    pub fn of(&self, uv: Vec2) -> Vec2 {
        uv * self.scale + self.offset
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::sources::Files;

    const SCENE: &[u8] = b"[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nvfov = 40\n\
        [[mesh]]\nfile = \"m.obj\"\ntranslate = [7, 0, 0]\n[[mesh]]\nfile = \"m.obj\"\nscale = 2\n\
        [material.b]\nNs = 9\n";
    const MESH: &[u8] = b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 2\n\
        usemtl a\nf 1//1 2//1 3//1 4//1\nusemtl b\nf 1 3 4\n";
    const MATERIALS: &[u8] = b"newmtl a\nillum 7\nNi 1.5\nTf 0.5\nnewmtl b\nKd 0.1\nKs 0.2\nmap_Kd t.png\nnewmtl c\n";
    const FILES: &[(&str, &[u8])] = &[("s.toml", SCENE), ("m.obj", MESH), ("m.mtl", MATERIALS)];

    fn imported(name: &str) -> Import {
        let path = Path::new(name);
        import(path, &mut Sources::new(Files::Embedded(FILES), path)).expect("the files are well formed")
    }

    #[test]
    fn placements_stay_placements() {
        let import = imported("s.toml");
        let [mesh] = &import.meshes[..] else { panic!("a mesh is read once") };
        assert_eq!(mesh.positions[2], DVec3::new(1.0, 1.0, 0.0));
        assert_eq!(mesh.normals, [2.0 * DVec3::Z]);
        assert_eq!(mesh.triangles.len(), 3);
        let placed: Vec<_> = import.instances.iter().map(|i| (i.mesh, i.transform.point(DVec3::X))).collect();
        assert_eq!(placed, [(0, 8.0 * DVec3::X), (0, 2.0 * DVec3::X)]);
        let bare = imported("m.obj");
        assert!(bare.camera.is_none() && bare.settings == Settings::default());
        assert_eq!(bare.instances[0].transform.point(DVec3::X), DVec3::X);
    }

    #[test]
    fn materials_are_described_by_their_physics() {
        let import = imported("s.toml");
        let [glass, glossy] = &import.materials[..] else { panic!("those that faces use") };
        assert_eq!((glass.surface, glass.ior, glass.transmission), (Surface::Dielectric, 1.5, Vec3::splat(0.5)));
        assert_eq!((glossy.diffuse, glossy.specular, glossy.exponent), (Vec3::splat(0.1), Vec3::splat(0.2), 9.0));
        // The image is named and not read: nothing says yet that a surface shows it.
        assert_eq!(glossy.diffuse_image, Some(0));
        assert_eq!(import.images.files[0].path, Path::new("t.png"));
        assert_eq!(imported("m.obj").materials[1].exponent, 1.0);
    }
}
