//! Scenes: TOML, OBJ, MTL and image files read into one validated [`Scene`].
//!
//! An importer turns a file into an `Import`, which no file format shows in (`import`); `assemble`
//! makes the scene of it. This room knows nothing of the GPU, of BVHs or of films: everything here is
//! in world units and, where positions are concerned, `f64`, so that the scale and place of a scene
//! cost no precision before the renderer normalises them.
//!
//! ```
//! use raywave::scene::Scene;
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("triangle.obj");
//! std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")?;
//! let scene = Scene::load(&path)?;
//! assert_eq!(scene.mesh.triangles.len(), 1);
//! assert!(scene.warnings[0].contains("white environment"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod assemble;
mod builder;
mod error;
mod import;
pub mod shapes;
mod sources;
mod text;
mod transform;

use std::path::{Path, PathBuf};

use crate::settings::Settings;
use glam::{DVec3, Vec2, Vec3};

pub use builder::SceneBuilder;
pub use error::{Location, SceneError};
use sources::{Files, Sources};

/// The Cornell box of `scenes/`, part of the program.
const CORNELL_BOX: &[(&str, &[u8])] = &[
    ("cornell-box.toml", include_bytes!("../../scenes/cornell-box.toml")),
    ("cornell-box.obj", include_bytes!("../../scenes/cornell-box.obj")),
    ("cornell-box.mtl", include_bytes!("../../scenes/cornell-box.mtl")),
];

/// Index of a corner that has no normal or no texture coordinate.
pub const NONE: u32 = u32::MAX;

/// A validated scene: every index is in range, every number finite and in its documented range.
#[derive(Debug, Clone)]
pub struct Scene {
    /// File stem of the scene file, for messages and metadata.
    pub name: String,
    /// Where the image is taken from.
    pub camera: Camera,
    /// What the scene asks of a render: what a scene file may say, and defaults.
    pub settings: Settings,
    /// All meshes, transformed to world space and merged. Holds at least one triangle.
    pub mesh: Mesh,
    /// Materials that `Triangle::material` indexes.
    pub materials: Vec<Material>,
    /// Images that `Material::diffuse_map` indexes.
    pub textures: Vec<Texture>,
    /// Light from infinity.
    pub environment: Environment,
    /// BLAKE3 of every file that makes the scene, names and contents, as lower-case hex.
    pub hash: String,
    /// What the user should know but need not act on, one line each, without a trailing newline.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Reads a scene file, `.toml`, or a bare mesh, `.obj`.
    ///
    /// A bare mesh is seen whole, along -z and a little from above, in an image of 512 x 512; where
    /// it has no light of its own it stands in a white environment of radiance 1.
    ///
    /// # Errors
    /// Whatever is wrong with the file or with one that it names, see [`SceneError`].
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        Self::load_from(Files::Disk, path)
    }

    /// The built-in Cornell box, the same scene as `scenes/cornell-box.toml`.
    pub fn cornell_box() -> Self {
        Self::load_from(Files::Embedded(CORNELL_BOX), Path::new("cornell-box.toml"))
            .expect("the files are part of the program and a test loads them")
    }

    fn load_from(files: Files, path: &Path) -> Result<Self, SceneError> {
        let mut sources = Sources::new(files, path);
        let import = import::import(path, &mut sources)?;
        assemble::assemble(import, path, sources)
    }

    /// The lowest and highest corner of the box around all triangles, world units.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.mesh.bounds()
    }

    /// Indices into `mesh.triangles` of those that emit, in ascending order.
    pub fn light_triangles(&self) -> impl Iterator<Item = u32> {
        let triangles = self.mesh.triangles.iter().zip(0..);
        triangles
            .filter(|(triangle, _)| self.materials[triangle.material as usize].is_emitter())
            .map(|(_, index)| index)
    }
}

/// A pinhole or thin-lens camera, in world units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Position of the pinhole or of the lens centre.
    pub eye: DVec3,
    /// Point that the image centre looks at; differs from `eye`.
    pub target: DVec3,
    /// Rough up direction, not zero. Where it is parallel to the view another axis is taken.
    pub up: DVec3,
    /// Vertical field of view in degrees, in (0, 180).
    pub vfov: f64,
    /// Lens radius, world units; 0 is a pinhole.
    pub aperture: f64,
    /// Distance from the eye to the plane in focus, world units, > 0; means nothing for a pinhole.
    pub focus: f64,
}

/// Triangles of the whole scene, in world space, indexed per corner.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Vertex positions, world units.
    pub positions: Vec<DVec3>,
    /// Unit shading normals; empty when no file has any.
    pub normals: Vec<Vec3>,
    /// Texture coordinates; empty when no material in use has an image.
    pub uvs: Vec<Vec2>,
    /// Triangles; counter-clockwise seen from their front.
    pub triangles: Vec<Triangle>,
}

impl Mesh {
    /// The lowest and highest corner of the box around all triangles; of an empty mesh, infinite
    /// and the wrong way round.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let corners = self.triangles.iter().flat_map(|triangle| triangle.positions);
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        corners.fold(empty, |(low, high), corner| {
            let point = self.positions[corner as usize];
            (low.min(point), high.max(point))
        })
    }
}

/// Three corners and a material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Triangle {
    /// Indices into `Mesh::positions`.
    pub positions: [u32; 3],
    /// Indices into `Mesh::normals`, all three or all [`NONE`].
    pub normals: [u32; 3],
    /// Indices into `Mesh::uvs`, all three or all [`NONE`].
    pub uvs: [u32; 3],
    /// Index into `Scene::materials`.
    pub material: u32,
}

/// One material. It conserves energy: `diffuse` + `specular` is at most 1 in every channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name in the file that defines it.
    pub name: String,
    /// What light does at the surface.
    pub surface: Surface,
    /// Diffuse reflectance, each channel in [0, 1]; the largest that the image holds where there
    /// is one. Zero where `surface` has no diffuse lobe, and for an emitter. MTL's Kd.
    pub diffuse: Vec3,
    /// Weight of the Phong lobe or reflectance of the mirror, each channel in [0, 1]. Zero where
    /// `surface` has neither, and for an emitter. MTL's Ks.
    pub specular: Vec3,
    /// Phong exponent, at least 0. MTL's Ns.
    pub exponent: f32,
    /// Index of refraction inside, greater than 0. MTL's Ni.
    pub ior: f32,
    /// Tint of transmitted light, each channel at least 0. MTL's Tf.
    pub transmission: Vec3,
    /// Emitted radiance from the front side, each channel at least 0. Any channel above 0 makes
    /// the material a pure emitter. MTL's Ke.
    pub emission: Vec3,
    /// Index into `Scene::textures` of the image that replaces `diffuse`. Every triangle of such a
    /// material has texture coordinates, and the material is [`Surface::Glossy`] and no emitter.
    pub diffuse_map: Option<u32>,
}

impl Material {
    /// A pure emitter: it gives light and does not reflect.
    pub fn is_emitter(&self) -> bool {
        self.emission.max_element() > 0.0
    }
}

/// What light does at a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// Diffuse reflection (Lambert) plus a glossy lobe (Phong).
    Glossy,
    /// Specular reflection, the same at every angle.
    Mirror,
    /// Specular transmission by Snell's law; reflects only under total internal reflection.
    Refractive,
    /// A smooth interface between dielectrics: specular reflection and transmission, weighted by
    /// the Fresnel equations.
    Dielectric,
}

impl Surface {
    /// Whether a diffuse reflectance means something of it.
    pub fn is_diffuse(self) -> bool {
        matches!(self, Self::Glossy)
    }

    /// Whether a specular reflectance does: the weight of a lobe or of a mirror.
    pub fn is_reflector(self) -> bool {
        matches!(self, Self::Glossy | Self::Mirror)
    }

    /// Whether an index of refraction does, and a tint of what is transmitted.
    pub fn refracts(self) -> bool {
        matches!(self, Self::Refractive | Self::Dielectric)
    }
}

/// A diffuse reflectance image, bilinear and repeated by its user.
#[derive(Debug, Clone)]
pub struct Texture {
    /// Where it was read from.
    pub path: PathBuf,
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// Reflectance in [0, 1], the energy rule applied: linear RGB plus one unused channel, row 0 at
    /// the top (v = 1), `width * height` entries.
    pub texels: Vec<[half::f16; 4]>,
}

/// Light that arrives from infinity.
#[derive(Debug, Clone)]
pub enum Environment {
    /// No light.
    Black,
    /// The same radiance, not all zero, from everywhere.
    Constant(Vec3),
    /// A lat-long image.
    LatLong(EnvironmentMap),
}

/// A lat-long image: +y up, row 0 at the top, the centre column looks along -z, u grows towards +x.
#[derive(Debug, Clone)]
pub struct EnvironmentMap {
    /// Where it was read from.
    pub path: PathBuf,
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// Linear radiance, already multiplied by the scene's `scale`, `width * height` entries.
    pub radiance: Vec<Vec3>,
}
