//! What a file describes, in the terms of no file format: meshes in their own coordinates,
//! materials by their physics, placements, camera and light.
//!
//! There is one importer a format, and each fills an [`Import`]. What all formats have in common
//! is [`assemble`](super::assemble)'s: it decodes images, checks energies, places meshes in the world.

mod document;
mod gltf;
mod mitsuba;
mod mtl;
mod obj;
mod ply;
mod polygons;

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use glam::{DMat3, DVec3, Vec2, Vec3};

use super::{
    self as scene, Camera, Light, Lookup, Parameter, Surface, Triangle,
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
    /// Lights that are no surfaces.
    pub lights: Vec<Light>,
}

/// A mesh in its own coordinates, indexed per corner.
#[derive(Debug, Clone)]
pub(super) struct Mesh {
    /// The file that it is from.
    pub location: Location,
    /// Finite.
    pub positions: Vec<DVec3>,
    /// Of any length. A triangle with one that is zero or not finite is flat.
    pub normals: Vec<DVec3>,
    /// Finite.
    pub uvs: Vec<Vec2>,
    /// By position: linear colours, finite and at least 0, that multiply the diffuse reflectance; empty where it has none.
    pub colours: Vec<Vec3>,
    /// Triangles, of any area; their materials are those of [`Import::materials`].
    pub triangles: Vec<Triangle>,
}

impl Mesh {
    /// Whether the colour at a position multiplies nothing.
    pub fn is_white(&self, position: u32) -> bool {
        self.colours.get(position as usize).is_none_or(|colour| *colour == Vec3::ONE)
    }
}

/// A mesh, by its index in [`Import::meshes`], in its place in the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct Instance {
    pub mesh: usize,
    pub transform: Transform,
    /// Whether the transform mirrors the mesh and its triangles keep their fronts nevertheless, in formats that say so.
    pub is_mirrored: bool,
}

/// A material as it is described: no energy rule is applied, and what the surface does not show may
/// have any value in range.
#[derive(Debug, Clone)]
pub(super) struct Material {
    /// Its name, its surface and its constants, each in the range of its field or above 1 where that is at most 1. A blend's
    /// parts are those of [`Import::materials`]; its textures are not used.
    pub optics: scene::Material,
    /// Where it is defined, or overridden; `None` where it is nowhere.
    pub location: Option<Location>,
    /// What images give on faces with texture coordinates, in place of the constant.
    pub maps: Vec<(Parameter, Map)>,
    /// Keys whose values cannot be used.
    pub faults: Vec<Fault>,
    /// Share of the light that meets the surface and does not go on as if it were not there. `Parameter::Weight` may give it
    /// where the surface is no blend.
    pub opacity: f32,
    /// Whether roughness and metal are described.
    pub is_metal_rough: bool,
    /// Glass that it is to be once its index of refraction is given.
    pub withheld: Option<Surface>,
    /// For a user whose scene uses this material.
    pub warnings: Vec<Warning>,
}

/// In place of a channel of an image, the luminance of its colour.
pub(super) const LUMINANCE: usize = 4;
/// And alpha, of an image where some is below 1, or else the luminance.
pub(super) const OPACITY: usize = 5;

/// What an image gives of a material: its texels times the factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Map {
    /// Index into [`Import::images`].
    pub image: usize,
    pub lookup: Lookup,
    /// Whether the image's codes are linear in the value; else they are sRGB.
    pub is_raw: bool,
    /// The channel that gives a number, 0 to 3, [`LUMINANCE`] or [`OPACITY`]; means nothing of a colour.
    pub channel: usize,
    /// What the texels are multiplied by; of a normal its coordinates, once they are in [-1, 1].
    pub factor: Vec3,
    /// What is made of the product.
    pub response: Response,
}

/// What is made of a texel times its factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Response {
    /// Nothing: it is the value.
    Linear,
    /// Its square, as GGX's alpha of a perceptual roughness.
    Squared,
    /// 1 from that number on and 0 below it, as of an alpha mask.
    Cutoff(f32),
}

impl Response {
    pub fn of(self, value: f32) -> f32 {
        match self {
            Self::Linear => value,
            Self::Squared => value * value,
            Self::Cutoff(least) => f32::from(u8::from(value >= least)),
        }
    }
}

impl Map {
    /// A colour image in sRGB, as it lies.
    pub fn colour(image: usize) -> Self {
        Self {
            image,
            lookup: Lookup::default(),
            is_raw: false,
            channel: 0,
            factor: Vec3::ONE,
            response: Response::Linear,
        }
    }
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
        let optics = scene::Material { name: name.to_owned(), ..scene::Material::diffuse(Vec3::splat(0.8)) };
        let (maps, faults, warnings) = Default::default();
        Self { optics, location: None, maps, faults, opacity: 1.0, is_metal_rough: false, withheld: None, warnings }
    }

    /// Makes of an opaque surface that is described by roughness and metal one that has them, and of an image of emission a
    /// light that scatters where it does not shine.
    fn finish(&mut self) {
        if self.is_metal_rough && matches!(self.optics.surface, Surface::Glossy | Surface::Mirror) {
            self.optics.surface = Surface::MetalRough;
            self.optics.specular = Vec3::ONE;
            self.optics.ior = if self.optics.ior > 1.0 { self.optics.ior } else { 1.5 };
        }
        if let Some(map) = self.map(Parameter::Emission) {
            self.optics.is_pure_emitter = false;
            let factor = if self.optics.is_emitter() { self.optics.emission } else { Vec3::ONE };
            self.set_map(Parameter::Emission, Some(Map { factor, ..map }));
        }
    }

    /// Whether light goes through it as if it were not there, in part.
    pub fn is_transparent(&self) -> bool {
        self.has_opacity() && !self.hides_opacity()
    }

    /// Whether it has an opacity that it does not show: glass and lights do not go by it.
    pub fn hides_opacity(&self) -> bool {
        self.has_opacity() && (self.optics.surface.refracts() || self.optics.only_emits())
    }

    /// The weight of a blend is none.
    fn has_opacity(&self) -> bool {
        let surface = self.optics.surface;
        let is_whole = surface.parts().next().is_none() && surface != Surface::Nothing;
        is_whole && (self.opacity < 1.0 || self.map(Parameter::Weight).is_some())
    }

    /// What an image gives of that parameter.
    pub fn map(&self, parameter: Parameter) -> Option<Map> {
        self.maps.iter().find(|(given, _)| *given == parameter).map(|(_, map)| *map)
    }

    /// Gives a parameter by an image, or no longer.
    pub fn set_map(&mut self, parameter: Parameter, map: Option<Map>) {
        self.maps.retain(|(given, _)| *given != parameter);
        self.maps.extend(map.map(|map| (parameter, map)));
    }

    /// What images give that the surface shows.
    pub fn visible_maps(&self) -> impl Iterator<Item = (Parameter, Map)> {
        self.maps.iter().copied().filter(|(parameter, _)| self.shows_parameter(*parameter))
    }

    fn shows_parameter(&self, parameter: Parameter) -> bool {
        let surface = self.optics.surface;
        let scatters = !self.optics.only_emits();
        match parameter {
            Parameter::Diffuse => scatters && surface.is_diffuse(),
            Parameter::Specular => scatters && surface.is_reflector(),
            Parameter::Roughness | Parameter::RoughnessAcross => scatters && surface.may_be_rough(),
            Parameter::Metalness => scatters && matches!(surface, Surface::MetalRough | Surface::Principled),
            Parameter::Coat => scatters && surface == Surface::Principled,
            Parameter::DiffuseTransmission => scatters && surface == Surface::PrincipledThin,
            Parameter::Anisotropy
            | Parameter::Sheen
            | Parameter::SheenTint
            | Parameter::SpecularTint
            | Parameter::SpecularShare
            | Parameter::Flatness => scatters && surface.is_principled(),
            Parameter::Weight => matches!(surface, Surface::Blend(..)),
            Parameter::Normal | Parameter::Height => scatters,
            Parameter::Emission => true,
        }
    }

    /// Whether some light gets to the other side.
    pub fn transmits(&self) -> bool {
        let optics = &self.optics;
        let glass =
            matches!(optics.surface, Surface::ThinDielectric | Surface::PrincipledThin) || optics.surface.refracts();
        let shares = optics.principled.specular_share > 0.0 || self.map(Parameter::SpecularShare).is_some();
        glass || (optics.surface == Surface::Principled && shares)
    }

    /// Whether the value of an MTL key makes a difference to the surface.
    pub fn shows(&self, key: &str) -> bool {
        let optics = &self.optics;
        let scatters = !optics.only_emits();
        match key {
            "Kd" => self.shows_parameter(Parameter::Diffuse),
            "Ks" => self.shows_parameter(Parameter::Specular),
            "Ns" => scatters && optics.surface == Surface::Glossy && optics.specular != Vec3::ZERO,
            "Ni" => scatters && optics.surface.has_index(),
            "Tf" => scatters && optics.surface.refracts(),
            _ => true,
        }
    }
}

/// An image and the line that names it. It is read where a scene shows it.
#[derive(Debug, Clone)]
pub(super) struct ImageFile {
    /// Its file, or a name for people where it is none.
    pub path: PathBuf,
    pub location: Location,
    pub source: ImageSource,
}

/// Where the bytes of an image are.
#[derive(Debug, Clone)]
pub(super) enum ImageSource {
    /// In the file that `ImageFile::path` names.
    File,
    /// The bytes of a picture in any format, which another file holds.
    Bytes(Arc<[u8]>),
    /// The texels themselves, linear: columns, then rows of these from the top.
    Texels { width: u32, texels: Vec<[f32; 4]> },
}

impl ImageFile {
    pub fn file(path: PathBuf, location: Location) -> Self {
        Self { path, location, source: ImageSource::File }
    }
}

/// Light from infinity, as it is described.
#[derive(Debug, Default)]
pub(super) enum Environment {
    #[default]
    Black,
    Constant(Vec3),
    /// A lat-long image times a scale, turned by a rotation.
    LatLong {
        image: ImageFile,
        scale: f32,
        rotation: DMat3,
        /// Whether the centres of the first and of the last row lie on the poles; else their outer edges do.
        has_rows_at_poles: bool,
    },
}

/// The images that materials name.
#[derive(Debug, Default)]
pub(super) struct Images {
    pub files: Vec<ImageFile>,
    /// Of those that are files of their own, each once.
    indices: HashMap<PathBuf, usize>,
}

impl Images {
    /// The index of an image, which is added where it is new.
    fn index_of(&mut self, image: &ImageFile) -> usize {
        let ImageSource::File = image.source else { return self.add(image.clone()) };
        let index = *self.indices.entry(image.path.clone()).or_insert(self.files.len());
        if index == self.files.len() {
            self.files.push(image.clone());
        }
        index
    }

    /// Adds an image that no other is.
    fn add(&mut self, image: ImageFile) -> usize {
        self.files.push(image);
        self.files.len() - 1
    }
}

/// A channel of a colour as near to it as one can be: at least 0, and finite.
fn light(channel: f32) -> f32 {
    if channel.is_nan() { 0.0 } else { channel.clamp(0.0, f32::MAX) }
}

/// Importers of the files of one scene that hold meshes and perhaps more.
#[derive(Debug, Default)]
struct MeshFiles {
    obj: obj::Importer,
    /// What is in each file.
    known: HashMap<PathBuf, Vec<Instance>>,
}

impl MeshFiles {
    /// Adds the meshes of a file, once however often it is asked for, and what they need. Returns where they are in it.
    fn add(
        &mut self,
        path: &Path,
        named_at: &Location,
        sources: &mut Sources,
        import: &mut Import,
    ) -> Result<&[Instance], SceneError> {
        if !self.known.contains_key(path) {
            let whole = |mesh| vec![Instance { mesh, transform: Transform::IDENTITY, is_mirrored: false }];
            let instances = match extension(path).as_str() {
                "ply" => whole(ply::add(path, named_at, sources, import)?),
                "gltf" | "glb" => {
                    let contents = gltf::read(path, named_at, sources, import)?;
                    contents.note_rest(path, sources);
                    contents.instances
                }
                _ => whole(self.obj.add(path, named_at, sources, import)?),
            };
            self.known.insert(path.to_path_buf(), instances);
        }
        Ok(&self.known[path])
    }
}

/// The extension of a file's name in small letters.
fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// Imports a file by the importer that the extension of its name stands for.
pub(super) fn import(path: &Path, sources: &mut Sources) -> Result<Import, SceneError> {
    let location = Location::file(path);
    let extension = extension(path);
    if sources.options.camera.is_some() && !["gltf", "glb"].contains(&&*extension) {
        return Err(location.refuse("its cameras have no names; leave out --camera"));
    }
    match &*extension {
        "toml" => document::import(path, sources),
        "xml" => mitsuba::import(path, sources),
        "gltf" | "glb" => gltf::import(path, sources),
        "obj" | "ply" => {
            let mut import = Import::default();
            let instances = MeshFiles::default().add(path, &location, sources, &mut import)?.to_vec();
            Ok(Import { instances, ..import })
        }
        _ => Err(location.refuse("neither .toml, .xml, .gltf, .glb, .obj nor .ply; name a scene file or a mesh")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{LoadOptions, sources::Files};

    const SCENE: &[u8] = b"[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nvfov = 40\n\
        [[mesh]]\nfile = \"m.obj\"\ntranslate = [7, 0, 0]\n[[mesh]]\nfile = \"m.obj\"\nscale = 2\n\
        [material.b]\nNs = 9\n";
    const MESH: &[u8] = b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 2\n\
        usemtl a\nf 1//1 2//1 3//1 4//1\nusemtl b\nf 1 3 4\n";
    const MATERIALS: &[u8] = b"newmtl a\nillum 7\nNi 1.5\nTf 0.5\nnewmtl b\nKd 0.1\nKs 0.2\nmap_Kd t.png\nnewmtl c\n";
    const FILES: &[(&str, &[u8])] = &[("s.toml", SCENE), ("m.obj", MESH), ("m.mtl", MATERIALS)];

    fn imported(name: &str) -> Import {
        let path = Path::new(name);
        import(path, &mut Sources::new(Files::Embedded(FILES), path, &LoadOptions::default()))
            .expect("the files are well formed")
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
        let (glass, glossy) = (&glass.optics, glossy);
        assert_eq!((glass.surface, glass.ior, glass.transmission), (Surface::Dielectric, 1.5, Vec3::splat(0.5)));
        let optics = &glossy.optics;
        assert_eq!((optics.diffuse, optics.specular, optics.exponent), (Vec3::splat(0.1), Vec3::splat(0.2), 9.0));
        // The image is named and not read: nothing says yet that a surface shows it.
        assert_eq!(glossy.map(Parameter::Diffuse), Some(Map::colour(0)));
        assert_eq!(import.images.files[0].path, Path::new("t.png"));
        assert_eq!(imported("m.obj").materials[1].optics.exponent, 1.0);
    }
}
