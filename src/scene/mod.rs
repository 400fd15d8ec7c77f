//! Scenes: TOML, Mitsuba's XML, OBJ, PLY, glTF and image files read into one validated [`Scene`].
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
mod export;
mod import;
mod options;
pub mod shapes;
mod sources;
mod text;
mod transform;

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::settings::Settings;
use glam::{Affine2, BVec3, DAffine3, DMat3, DVec3, Vec2, Vec3};
use rayon::prelude::*;

pub use builder::SceneBuilder;
pub use error::{Location, SceneError};
pub use export::{MeshFormat, SceneFiles};
pub use options::LoadOptions;
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
    /// Meshes that are placed once, and small ones, transformed to world space and merged. It and `placed` hold at least one
    /// triangle.
    pub mesh: Mesh,
    /// Meshes that are placed more than once, in the order of the file.
    pub placed: Vec<PlacedMesh>,
    /// Materials that `Triangle::material` indexes.
    pub materials: Vec<Material>,
    /// Images that `Material::textures` indexes.
    pub textures: Vec<Texture>,
    /// Light from infinity.
    pub environment: Environment,
    /// Lights that are no surfaces.
    pub lights: Vec<Light>,
    /// BLAKE3 of every file that makes the scene, names and contents, as lower-case hex.
    pub hash: String,
    /// What the user should know but need not act on, one line each, without a trailing newline.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Reads a scene file, `.toml`, `.gltf`, `.glb` or Mitsuba 3's `.xml`, or a bare mesh, `.obj` or `.ply`.
    ///
    /// A bare mesh is seen whole, along -z and a little from above, in an image of 512 x 512; where
    /// it has no light of its own it stands in a white environment of radiance 1.
    ///
    /// # Errors
    /// Whatever is wrong with the file or with one that it names, see [`SceneError`].
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        Self::load_with(path, &LoadOptions::default())
    }

    /// The same with options.
    ///
    /// # Errors
    /// As [`Scene::load`], and options that do not fit the scene.
    pub fn load_with(path: &Path, options: &LoadOptions) -> Result<Self, SceneError> {
        Self::load_from(Files::Disk, path, options)
    }

    /// The built-in Cornell box, the same scene as `scenes/cornell-box.toml`.
    pub fn cornell_box() -> Self {
        Self::load_from(Files::Embedded(CORNELL_BOX), Path::new("cornell-box.toml"), &LoadOptions::default())
            .expect("the files are part of the program and a test loads them")
    }

    fn load_from(files: Files, path: &Path, options: &LoadOptions) -> Result<Self, SceneError> {
        let mut sources = Sources::new(files, path, options);
        let import = import::import(path, &mut sources)?;
        assemble::assemble(import, path, sources)
    }

    /// The lowest and highest corner of a box around all triangles, world units. It is the smallest but where many placements
    /// turn large meshes.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        self.placed.iter().map(PlacedMesh::bounds).fold(self.mesh.bounds(), around_both)
    }

    /// Triangles of the scene: of a mesh as many times as it is placed.
    pub fn triangle_count(&self) -> u64 {
        self.mesh.triangles.len() as u64 + self.placed.iter().map(PlacedMesh::triangle_count).sum::<u64>()
    }

    /// All meshes, each once.
    pub fn meshes(&self) -> impl Iterator<Item = &Mesh> {
        [&self.mesh].into_iter().chain(self.placed.iter().map(|placed| &placed.mesh))
    }

    /// Meshes in their places: how many triangles each has, and how often it is placed.
    pub fn placed_counts(&self) -> Vec<[u32; 2]> {
        self.placed
            .iter()
            .map(|placed| [placed.mesh.triangles.len(), placed.placements.len()].map(|n| n as u32))
            .collect()
    }

    /// All triangles in world space: first those of `mesh`, then those of `placed`, placement by placement.
    ///
    /// # Panics
    /// When they are more than 32-bit indices reach.
    pub fn flattened(&self) -> Cow<'_, Mesh> {
        if self.placed.is_empty() {
            return Cow::Borrowed(&self.mesh);
        }
        assert!(self.triangle_count() < u64::from(NONE) / 3, "a scene of so many triangles cannot be flattened");
        let mut flat = self.mesh.clone();
        for PlacedMesh { mesh, placements } in &self.placed {
            let first_uv = flat.uvs.len() as u32;
            flat.uvs.extend(&mesh.uvs);
            for placement in placements {
                let (first, first_normal) = (flat.positions.len() as u32, flat.normals.len() as u32);
                flat.add_colours(&mesh.colours);
                flat.positions.extend(mesh.positions.iter().map(|point| placement.map.transform_point3(*point)));
                flat.normals.extend(mesh.normals.iter().map(|normal| placement.normal(*normal)));
                let moved = |index: u32, first: u32| if index == NONE { NONE } else { first + index };
                flat.triangles.extend(mesh.triangles.iter().map(|triangle| {
                    let mut placed = Triangle {
                        positions: triangle.positions.map(|index| moved(index, first)),
                        normals: triangle.normals.map(|index| moved(index, first_normal)),
                        uvs: triangle.uvs.map(|index| moved(index, first_uv)),
                        material: triangle.material,
                    };
                    if placement.is_mirrored {
                        placed.mirror();
                    }
                    placed
                }));
            }
        }
        Cow::Owned(flat)
    }

    /// Whether each material is seen: some triangle has it, or has one of which it is a part.
    pub fn shown_materials(&self) -> Vec<bool> {
        let mut shown = vec![false; self.materials.len()];
        let mut found: Vec<u32> = Vec::new();
        for triangle in
            self.placed.iter().map(|placed| &placed.mesh).chain([&self.mesh]).flat_map(|mesh| &mesh.triangles)
        {
            if !shown[triangle.material as usize] {
                shown[triangle.material as usize] = true;
                found.push(triangle.material);
            }
        }
        while let Some(material) = found.pop() {
            for part in self.materials[material as usize].surface.parts() {
                if !shown[part as usize] {
                    shown[part as usize] = true;
                    found.push(part);
                }
            }
        }
        shown
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
    /// Vertical field of view in degrees, in (0, 180); means nothing where `orthographic`.
    pub vfov: f64,
    /// Height of what an orthographic camera sees, world units, > 0; `None` for perspective.
    pub orthographic: Option<f64>,
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
    /// By position: linear colours, finite and at least 0, that multiply the diffuse reflectance. Positions without are white.
    pub colours: Vec<Vec3>,
    /// Triangles; counter-clockwise seen from their front.
    pub triangles: Vec<Triangle>,
}

impl Mesh {
    /// Adds the colours of positions that are to be added.
    fn add_colours(&mut self, colours: &[Vec3]) {
        if !colours.is_empty() {
            self.colours.resize(self.positions.len(), Vec3::ONE);
            self.colours.extend(colours);
        }
    }

    /// The colour of a position.
    pub fn colour(&self, position: u32) -> Vec3 {
        self.colours.get(position as usize).copied().unwrap_or(Vec3::ONE)
    }

    /// The lowest and highest corner of the box around all triangles; of an empty mesh, infinite
    /// and the wrong way round.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let around = |(low, high): (DVec3, DVec3), triangle: &Triangle| {
            let corners = triangle.positions.map(|corner| self.positions[corner as usize]);
            corners.into_iter().fold((low, high), |(low, high), point| (low.min(point), high.max(point)))
        };
        let (low, high) = self.triangles.par_iter().fold(|| empty, around).reduce(|| empty, around_both);
        // Which of two zeros is least is left to chance.
        (low + DVec3::ZERO, high + DVec3::ZERO)
    }
}

/// The box around two boxes.
fn around_both(a: (DVec3, DVec3), b: (DVec3, DVec3)) -> (DVec3, DVec3) {
    (a.0.min(b.0), a.1.max(b.1))
}

/// A mesh that the scene places more than once.
#[derive(Debug, Clone)]
pub struct PlacedMesh {
    /// The mesh, in its own coordinates.
    pub mesh: Mesh,
    /// Where it is.
    pub placements: Vec<Placement>,
}

impl PlacedMesh {
    /// Triangles of all placements.
    fn triangle_count(&self) -> u64 {
        self.mesh.triangles.len() as u64 * self.placements.len() as u64
    }

    /// A box around all placements: the smallest where that takes few transforms, else of the corners of the mesh's box.
    fn bounds(&self) -> (DVec3, DVec3) {
        const MOST_TRANSFORMS: usize = 1 << 24;
        let (low, high) = self.mesh.bounds();
        let corners: Vec<DVec3> = match self.mesh.triangles.len().saturating_mul(self.placements.len()) {
            ..MOST_TRANSFORMS => {
                let corners = self.mesh.triangles.iter().flat_map(|triangle| triangle.positions);
                corners.map(|corner| self.mesh.positions[corner as usize]).collect()
            }
            _ => (0..8)
                .map(|corner| DVec3::select(BVec3::new(corner & 1 != 0, corner & 2 != 0, corner & 4 != 0), low, high))
                .collect(),
        };
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let around = |placement: &Placement| {
            let points = corners.iter().map(|corner| placement.map.transform_point3(*corner));
            points.fold(empty, |(low, high), point| (low.min(point), high.max(point)))
        };
        self.placements.par_iter().map(around).reduce(|| empty, around_both)
    }
}

/// Where a mesh is placed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// From the mesh's own coordinates to the world's. It can be inverted.
    pub map: DAffine3,
    /// Whether the second and third corners of its triangles change places, so that a map that mirrors them keeps their
    /// fronts.
    pub is_mirrored: bool,
}

impl Placement {
    /// What takes normals of the mesh to the world, to any length.
    pub fn of_normals(&self) -> DMat3 {
        transform::cofactors(self.map.matrix3)
    }

    /// A unit normal of the mesh in the world.
    fn normal(&self, normal: Vec3) -> Vec3 {
        (self.of_normals() * normal.as_dvec3()).normalize().as_vec3()
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

impl Triangle {
    /// Turns it over: its second and third corners change places.
    fn mirror(&mut self) {
        self.positions.swap(1, 2);
        self.normals.swap(1, 2);
        self.uvs.swap(1, 2);
    }
}

/// Microfacets of a smaller roughness than this are those of a smooth surface: their lobe is as narrow as the rounding of a
/// direction.
pub const SMOOTH: f32 = 1e-6;

/// One material. It conserves energy: `diffuse` + `specular` is at most 1 in every channel of a [`Surface::Glossy`], and
/// no reflectance is above 1, but for what Disney's model adds at grazing angles.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name in the file that defines it.
    pub name: String,
    /// What light does at the surface.
    pub surface: Surface,
    /// Diffuse reflectance, each channel in [0, 1]; the largest that the image holds where there is one. Base colour of
    /// [`Surface::MetalRough`] and of principled surfaces. Zero where `surface` has no diffuse lobe, and for a pure emitter. MTL's Kd.
    pub diffuse: Vec3,
    /// Weight of the Phong lobe, or what multiplies specular reflection, each channel in [0, 1]. Zero where `surface` has
    /// none, and for a pure emitter. MTL's Ks.
    pub specular: Vec3,
    /// Phong exponent, at least 0. MTL's Ns.
    pub exponent: f32,
    /// Index of refraction inside, greater than 0. MTL's Ni.
    pub ior: f32,
    /// Tint of transmitted light, each channel at least 0. MTL's Tf.
    pub transmission: Vec3,
    /// Emitted radiance from the front side, each channel at least 0. MTL's Ke.
    pub emission: Vec3,
    /// Whether what emits does nothing else: light that arrives is lost. MTL's lights are of this kind.
    pub is_pure_emitter: bool,
    /// Widths of the distribution of microfacets (GGX's alpha) along the tangent, where texture coordinate u grows, and
    /// across it; in [0, 1]. Zero along both is smooth.
    pub roughness: Vec2,
    /// Complex index of refraction of a [`Surface::Conductor`]: its real part, each channel at least 0.
    pub eta: Vec3,
    /// Its imaginary part, each channel at least 0.
    pub absorption: Vec3,
    /// Share of metal in [`Surface::MetalRough`] and [`Surface::Principled`], in [0, 1].
    pub metalness: f32,
    /// Share of the clear coat over [`Surface::MetalRough`] and [`Surface::Principled`], in [0, 1].
    pub coat: f32,
    /// Width of the distribution of the coat's microfacets, in [0, 1].
    pub coat_roughness: f32,
    /// What only principled surfaces have.
    pub principled: Principled,
    /// Share of the first material of a [`Surface::Blend`], in [0, 1].
    pub weight: f32,
    /// Whether microfacets are distributed as Beckmann has it, with `roughness` its widths; else by GGX.
    pub is_beckmann: bool,
    /// Whether light that microfacets scatter more than once is made up for (Kulla and Conty 2017); else it is lost.
    pub compensates: bool,
    /// Indices into `Scene::textures` of what gives a parameter in place of its constant, by [`Parameter`]. Every triangle
    /// of a material with any has texture coordinates.
    pub textures: [Option<u32>; Parameter::COUNT],
}

impl Material {
    /// Whether it gives light.
    pub fn is_emitter(&self) -> bool {
        self.emission.max_element() > 0.0
    }

    /// Whether it gives light and does nothing else.
    pub fn only_emits(&self) -> bool {
        self.is_emitter() && self.is_pure_emitter
    }

    /// The index into `Scene::textures` of what gives that parameter.
    pub fn texture(&self, parameter: Parameter) -> Option<u32> {
        self.textures[parameter as usize]
    }

    /// Whether it has microfacets. Those of a smaller roughness than [`SMOOTH`] count as smooth.
    pub fn is_rough(&self) -> bool {
        let textured = [Parameter::Roughness, Parameter::RoughnessAcross].iter().any(|p| self.texture(*p).is_some());
        self.surface.may_be_rough() && (textured || self.roughness.max_element() >= SMOOTH)
    }

    /// Whether the direction of its texture coordinates makes a difference to how it scatters.
    pub fn is_anisotropic(&self) -> bool {
        let apart = self.texture(Parameter::RoughnessAcross).is_some() || self.roughness.x != self.roughness.y;
        let stretched = self.principled.anisotropy > 0.0 || self.texture(Parameter::Anisotropy).is_some();
        (self.is_rough() && apart) || (self.surface.is_principled() && stretched)
    }

    /// Whether it is a [`Surface::Principled`] that light gets into.
    pub fn has_inside(&self) -> bool {
        let shares = self.principled.specular_share > 0.0 || self.texture(Parameter::SpecularShare).is_some();
        self.surface == Surface::Principled && shares
    }

    /// Whether an image turns its shading normals.
    pub fn turns_normals(&self) -> bool {
        self.texture(Parameter::Normal).is_some() || self.texture(Parameter::Height).is_some()
    }

    /// Whether an image gives a parameter other than the diffuse reflectance and the normal.
    pub fn has_detail_textures(&self) -> bool {
        let others = [Parameter::Diffuse, Parameter::Normal, Parameter::Height];
        Parameter::ALL.iter().any(|parameter| !others.contains(parameter) && self.texture(*parameter).is_some())
    }
}

/// Parameters of Disney's BSDF, each in [0, 1]. (Burley 2012, Physically Based Shading at Disney; 2015, Extending the Disney
/// BRDF to a BSDF with Integrated Subsurface Scattering)
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Principled {
    /// How far apart the widths of microfacets are: those of a roughness r are r² / a and r² a, where a² is 1 less nine
    /// tenths of this.
    pub anisotropy: f32,
    /// Weight of the sheen, a reflection at grazing angles.
    pub sheen: f32,
    /// How far the base colour tints the sheen.
    pub sheen_tint: f32,
    /// How far the base colour tints what a dielectric reflects.
    pub specular_tint: f32,
    /// Share of what is specular, reflected and transmitted, in place of the diffuse body. Mitsuba's `spec_trans`.
    pub specular_share: f32,
    /// Share of diffuse light that seems to come from below the surface.
    pub flatness: f32,
    /// Share of diffuse light that a sheet transmits; means nothing of a body. Half of Mitsuba's `diff_trans`.
    pub diffuse_transmission: f32,
}

/// What light does at a surface. Where it is rough, `Material::roughness` says so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surface {
    /// Diffuse reflection (Lambert) plus a glossy lobe (Phong).
    Glossy,
    /// Specular reflection, the same at every angle.
    Mirror,
    /// Specular transmission by Snell's law; reflects only under total internal reflection.
    Refractive,
    /// An interface between dielectrics: reflection and transmission, weighted by the Fresnel equations.
    Dielectric,
    /// A plate of a dielectric, so thin that light goes straight through it, with all reflections inside.
    ThinDielectric,
    /// A metal, by its complex index of refraction.
    Conductor,
    /// A dielectric coat over a diffuse base; what reflection inside the coat colours is left out where not `nonlinear`.
    Plastic {
        /// Whether colours shift by light that is reflected inside the coat.
        nonlinear: bool,
    },
    /// glTF's mixture of a metal and of a diffuse body under a dielectric interface, perhaps under a clear coat.
    MetalRough,
    /// Disney's BSDF of a body, as Mitsuba's `principled` defines it: diffuse, sheen, microfacets and a clear coat, and
    /// refraction by a share. Both widths in `Material::roughness` are the square of its roughness; light that microfacets
    /// scatter more than once is lost. What light from behind meets is the same unless light gets into it. At grazing angles
    /// the model may give back more than it gets.
    Principled,
    /// Disney's BSDF of a thin sheet, as Mitsuba's `principledthin` defines it, alike on both sides.
    PrincipledThin,
    /// No surface at all: light goes on as it came.
    Nothing,
    /// One of two materials by chance, with the probability `Material::weight` for the first. Both are indices into
    /// `Scene::materials`.
    Blend(u32, u32),
    /// One material for each side. Both are indices into `Scene::materials`.
    Sides {
        /// What light from the front meets.
        front: u32,
        /// What light from the back meets.
        back: u32,
    },
}

impl Surface {
    /// Whether a diffuse reflectance means something of it.
    pub fn is_diffuse(self) -> bool {
        matches!(self, Self::Glossy | Self::Plastic { .. } | Self::MetalRough) || self.is_principled()
    }

    /// Whether it is Disney's BSDF.
    pub fn is_principled(self) -> bool {
        matches!(self, Self::Principled | Self::PrincipledThin)
    }

    /// Whether a specular reflectance does: the weight of a lobe or of a mirror.
    pub fn is_reflector(self) -> bool {
        matches!(self, Self::Glossy | Self::Mirror | Self::Conductor | Self::Plastic { .. } | Self::MetalRough)
    }

    /// Whether light gets inside it, so that a tint of what is transmitted means something.
    pub fn refracts(self) -> bool {
        matches!(self, Self::Refractive | Self::Dielectric)
    }

    /// Whether an index of refraction means something of it.
    pub fn has_index(self) -> bool {
        let others = matches!(self, Self::ThinDielectric | Self::Plastic { .. } | Self::MetalRough);
        self.refracts() || others || self.is_principled()
    }

    /// Whether it may have microfacets.
    pub fn may_be_rough(self) -> bool {
        let others = matches!(self, Self::Dielectric | Self::Conductor | Self::Plastic { .. } | Self::MetalRough);
        others || self.is_principled()
    }

    /// The materials that it is made of.
    pub fn parts(self) -> impl Iterator<Item = u32> {
        let parts = match self {
            Self::Blend(first, second) => Some([first, second]),
            Self::Sides { front, back } => Some([front, back]),
            _ => None,
        };
        parts.into_iter().flatten()
    }
}

/// What an image can give of a material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Parameter {
    /// `Material::diffuse`.
    Diffuse,
    /// `Material::specular`.
    Specular,
    /// `Material::roughness` along the tangent, or both along it and across it where `RoughnessAcross` has no image.
    Roughness,
    /// `Material::roughness` across the tangent.
    RoughnessAcross,
    /// `Material::metalness`.
    Metalness,
    /// `Material::weight`.
    Weight,
    /// The shading normal in tangent space, each coordinate from [-1, 1] to [0, 1].
    Normal,
    /// Height over the surface, in world units, by which the shading normal turns.
    Height,
    /// `Material::emission`.
    Emission,
    /// `Material::coat`, of a principled surface.
    Coat,
    /// `Principled::anisotropy`.
    Anisotropy,
    /// `Principled::sheen`.
    Sheen,
    /// `Principled::sheen_tint`.
    SheenTint,
    /// `Principled::specular_tint`.
    SpecularTint,
    /// `Principled::specular_share`.
    SpecularShare,
    /// `Principled::flatness`.
    Flatness,
    /// `Principled::diffuse_transmission`.
    DiffuseTransmission,
}

impl Parameter {
    /// How many there are.
    pub const COUNT: usize = 17;

    /// Every one, in the order of `Material::textures`.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Diffuse,
        Self::Specular,
        Self::Roughness,
        Self::RoughnessAcross,
        Self::Metalness,
        Self::Weight,
        Self::Normal,
        Self::Height,
        Self::Emission,
        Self::Coat,
        Self::Anisotropy,
        Self::Sheen,
        Self::SheenTint,
        Self::SpecularTint,
        Self::SpecularShare,
        Self::Flatness,
        Self::DiffuseTransmission,
    ];

    /// Whether it is one number, which an image has in its first channel.
    pub fn is_scalar(self) -> bool {
        !matches!(self, Self::Diffuse | Self::Specular | Self::Normal | Self::Emission)
    }
}

/// An image as surfaces show it.
#[derive(Debug, Clone)]
pub struct Texture {
    /// Where it was read from.
    pub path: PathBuf,
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// Values of the parameter that it gives, the energy rule applied: linear RGB, or a number in all three, plus one unused
    /// channel; row 0 at the top (v = 1), `width * height` entries. Textures of the same texels share them.
    pub texels: Arc<[[half::f16; 4]]>,
    /// How it lies on the surface.
    pub lookup: Lookup,
}

/// How the texels of an image are found for texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lookup {
    /// Takes the surface's texture coordinates to the image's. Finite.
    pub transform: Affine2,
    /// What lies beyond the image.
    pub wrap: Wrap,
    /// Whether the four nearest texels are mixed (bilinear), or the nearest one is taken.
    pub is_smooth: bool,
}

impl Default for Lookup {
    fn default() -> Self {
        Self { transform: Affine2::IDENTITY, wrap: Wrap::Repeat, is_smooth: true }
    }
}

/// What lies beyond an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The image again.
    Repeat,
    /// The image mirrored, and again.
    Mirror,
    /// Its edge.
    Clamp,
}

/// Light from a point or a direction, which no ray of a path can find by chance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Light {
    /// From a point, equally into all directions.
    Point {
        /// World units.
        position: DVec3,
        /// Power per solid angle, each channel at least 0.
        intensity: Vec3,
    },
    /// From a point into a cone.
    Spot {
        /// World units.
        position: DVec3,
        /// Axis of the cone, unit.
        direction: DVec3,
        /// Power per solid angle along the axis, each channel at least 0.
        intensity: Vec3,
        /// Angles from the axis, in degrees: up to the first the intensity is whole, from the second on it is 0.
        angles: [f64; 2],
        /// How it falls off in between.
        falloff: Falloff,
    },
    /// From far away.
    Directional {
        /// Where the light goes, unit.
        direction: DVec3,
        /// On a plane across it, each channel at least 0.
        irradiance: Vec3,
    },
}

/// How the intensity of a spot falls off between its two angles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Falloff {
    /// Linear in the angle (Mitsuba's).
    Angle,
    /// The square of what is linear in the cosine (glTF's).
    SquaredCosine,
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
    /// Takes directions of the image to those of the world; a rotation, perhaps with a mirror.
    pub rotation: DMat3,
}
