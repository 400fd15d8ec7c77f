//! Scenes to files: a scene file with its meshes and images beside it.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet, hash_map::Entry};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use glam::{Affine2, DMat3, Vec2, Vec3};

use super::{Environment, Lookup, Material, Mesh, NONE, Parameter, Scene, Surface, Triangle, Wrap};
use crate::constants::MAX_BLENDS;
use crate::image::{Image, ImageError, WriteOptions, image_bytes, srgb};
use crate::settings::Named;
use crate::whole_file;

/// The format of the meshes of a scene that is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshFormat {
    /// One OBJ file, as text.
    Obj,
    /// A PLY file for each material, binary.
    Ply,
}

/// A scene as files that are not written yet.
#[derive(Debug)]
pub struct SceneFiles<'a> {
    scene: &'a Scene,
    /// All of its triangles.
    mesh: Cow<'a, Mesh>,
    path: PathBuf,
    format: MeshFormat,
    /// The materials that triangles have, with their names in the files.
    materials: Vec<(u32, String)>,
    /// The material of each of these that is described: the first part of those that are made of others.
    described: Vec<&'a Material>,
    /// What the scene format does not say, each as words in a list.
    pub lost: Vec<String>,
}

impl<'a> SceneFiles<'a> {
    /// The files of a scene at `path`, a `.toml`, and beside it. Meshes that are placed more than once are flattened.
    ///
    /// # Panics
    /// When the scene has more triangles than 32-bit indices reach.
    pub fn new(scene: &'a Scene, path: &Path, format: MeshFormat) -> Self {
        let mut seen = HashSet::new();
        let mesh = scene.flattened();
        let used: Vec<u32> =
            mesh.triangles.iter().map(|triangle| triangle.material).filter(|material| seen.insert(*material)).collect();
        let mut taken = HashSet::new();
        let mut files = Self {
            scene,
            mesh,
            path: path.to_path_buf(),
            format,
            materials: Vec::new(),
            described: Vec::new(),
            lost: Vec::new(),
        };
        for index in used {
            let material = &scene.materials[index as usize];
            let name = distinct(&plain(&material.name), &mut taken);
            // The materials of PLY files have the names of these.
            let name = if format == MeshFormat::Ply { format!("{}-{name}", files.stem()) } else { name };
            files.materials.push((index, name));
            files.described.push(files.first_part(material));
        }
        files.lost = files.losses();
        files
    }

    /// The path without its extension, to which names of files beside it are added.
    fn stem(&self) -> String {
        self.path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }

    fn beside(&self, name: &str) -> PathBuf {
        self.path.with_file_name(name)
    }

    /// Names of the files of meshes.
    fn meshes(&self) -> Vec<String> {
        match self.format {
            MeshFormat::Obj => vec![format!("{}.obj", self.stem())],
            MeshFormat::Ply => self.materials.iter().map(|(_, name)| format!("{name}.ply")).collect(),
        }
    }

    fn image(&self, texture: u32) -> String {
        format!("{}-image-{texture}.png", self.stem())
    }

    fn sky(&self) -> String {
        format!("{}-sky.exr", self.stem())
    }

    /// Textures that are written.
    fn images(&self) -> Vec<u32> {
        let shown = self.described.iter().filter_map(|material| material.texture(Parameter::Diffuse));
        let mut images: Vec<u32> = shown.collect();
        images.sort_unstable();
        images.dedup();
        images
    }

    /// All files, the scene file last.
    pub fn paths(&self) -> Vec<PathBuf> {
        let mut names = self.meshes();
        names.extend(self.images().into_iter().map(|texture| self.image(texture)));
        names.extend(matches!(self.scene.environment, Environment::LatLong(_)).then(|| self.sky()));
        names.iter().map(|name| self.beside(name)).chain([self.path.clone()]).collect()
    }

    /// Writes all files, each whole, the scene file last.
    ///
    /// # Errors
    /// A folder that is missing, a full disk: with the file at fault.
    pub fn write(&self) -> Result<(), (PathBuf, io::Error)> {
        let at = |path: &Path| {
            let path = path.to_path_buf();
            move |error| (path, error)
        };
        for (place, name) in self.meshes().iter().enumerate() {
            let path = self.beside(name);
            let written = match self.format {
                MeshFormat::Obj => whole_file::write(&path, |file| self.write_obj(file)),
                MeshFormat::Ply => whole_file::write(&path, |file| self.write_ply(place, file)),
            };
            written.map_err(at(&path))?;
        }
        let write_image = |name: String, image: Image| {
            let path = self.beside(&name);
            let bytes = image_bytes(&path, &image, &WriteOptions::default())
                .map_err(|error: ImageError| io::Error::other(error.problem));
            bytes.and_then(|bytes| whole_file::write(&path, |file| file.write_all(&bytes))).map_err(at(&path))
        };
        for texture in self.images() {
            let of = &self.scene.textures[texture as usize];
            let pixels = of.texels.iter().map(|[r, g, b, _]| Vec3::new(r.to_f32(), g.to_f32(), b.to_f32())).collect();
            write_image(self.image(texture), Image { width: of.width, height: of.height, pixels })?;
        }
        if let Environment::LatLong(map) = &self.scene.environment {
            write_image(self.sky(), Image { width: map.width, height: map.height, pixels: map.radiance.clone() })?;
        }
        whole_file::write(&self.path, |file| self.write_toml(file)).map_err(at(&self.path))
    }

    fn first_part(&self, material: &'a Material) -> &'a Material {
        let mut material = material;
        // One that is a part of itself ends too.
        for _ in 0..=MAX_BLENDS {
            let Some(part) = material.surface.parts().next() else { break };
            material = &self.scene.materials[part as usize];
        }
        material
    }

    fn losses(&self) -> Vec<String> {
        let mut lost = Vec::new();
        let materials = || self.materials.iter().zip(&self.described);
        let names = |is_lost: &dyn Fn(&Material, &Material) -> bool| {
            let lost = materials()
                .filter(|((index, _), described)| is_lost(&self.scene.materials[*index as usize], described));
            lost.map(|((_, name), _)| format!("`{name}`")).collect::<Vec<_>>().join(", ")
        };
        let mut add = |what: &str, is_lost: &dyn Fn(&Material, &Material) -> bool| {
            let names = names(is_lost);
            if !names.is_empty() {
                lost.push(format!("{what} {names}"));
            }
        };
        add("all but the first part of", &|whole, _| whole.surface.parts().next().is_some());
        add("the kind of surface of", &|_, part| {
            let has_word =
                matches!(part.surface, Surface::Glossy | Surface::Mirror | Surface::Refractive | Surface::Dielectric);
            !has_word && !part.only_emits()
        });
        add("the roughness of", &|_, part| part.surface == Surface::Dielectric && part.is_rough());
        add("what reflects of", &|_, part| part.is_emitter() && !part.is_pure_emitter);
        add("images other than the diffuse one of", &|_, part| {
            part.textures
                .iter()
                .enumerate()
                .any(|(parameter, texture)| texture.is_some() && parameter != Parameter::Diffuse as usize)
        });
        let texture = |part: &Material| {
            part.texture(Parameter::Diffuse).map(|texture| self.scene.textures[texture as usize].lookup)
        };
        add("wrapping and filter of images of", &|_, part| {
            texture(part).is_some_and(|lookup| lookup.wrap != Wrap::Repeat || !lookup.is_smooth)
        });
        if !self.scene.lights.is_empty() {
            lost.push(format!("{} lights that are no surfaces", self.scene.lights.len()));
        }
        if self.scene.camera.orthographic.is_some() {
            lost.push("the orthographic camera".to_owned());
        }
        if let Environment::LatLong(map) = &self.scene.environment
            && map.rotation != DMat3::IDENTITY
        {
            lost.push("the rotation of the sky".to_owned());
        }
        lost
    }

    fn write_toml(&self, file: &mut dyn Write) -> io::Result<()> {
        let Scene { camera, settings, environment, .. } = self.scene;
        let text = |text: &str| toml::Value::String(text.to_owned()).to_string();
        writeln!(file, "[camera]\neye = {:?}\ntarget = {:?}", camera.eye.to_array(), camera.target.to_array())?;
        writeln!(file, "up = {:?}\nvfov = {:?}", camera.up.to_array(), camera.vfov)?;
        writeln!(file, "aperture = {:?}\nfocus = {:?}", camera.aperture, camera.focus)?;
        writeln!(file, "\n[film]\nwidth = {}\nheight = {}", settings.width, settings.height)?;
        writeln!(file, "\n[render]\nintegrator = {}", text(settings.integrator.name()))?;
        writeln!(file, "sampler = {}\nsamples = {}", text(settings.sampler.name()), settings.samples)?;
        writeln!(file, "max_bounces = {}", settings.max_bounces.map_or(-1, i64::from))?;
        writeln!(file, "roulette = {:?}", settings.roulette)?;
        for name in self.meshes() {
            writeln!(file, "\n[[mesh]]\nfile = {}", text(&name))?;
        }
        for ((_, name), material) in self.materials.iter().zip(&self.described) {
            writeln!(file, "\n[material.{}]", text(name))?;
            let mut colour = |key: &str, colour: Vec3| writeln!(file, "{key} = {:?}", colour.to_array());
            if material.is_emitter() {
                colour("Ke", material.emission)?;
                continue;
            }
            let illum = match material.surface {
                Surface::Mirror | Surface::Conductor => 3,
                Surface::Refractive => 6,
                Surface::Dielectric | Surface::ThinDielectric => 7,
                _ => 2,
            };
            if material.surface.is_diffuse() {
                colour("Kd", material.diffuse)?;
            }
            // Of others than a Phong lobe and a mirror it has another meaning.
            if matches!(material.surface, Surface::Glossy | Surface::Mirror | Surface::Conductor) {
                colour("Ks", material.specular)?;
            }
            if matches!(illum, 6 | 7) {
                colour("Tf", material.transmission)?;
                writeln!(file, "Ni = {:?}", material.ior)?;
            }
            writeln!(file, "Ns = {:?}\nillum = {illum}", material.exponent)?;
            if let Some(texture) = material.texture(Parameter::Diffuse) {
                writeln!(file, "map_Kd = {}", text(&self.image(texture)))?;
            }
        }
        match environment {
            Environment::Black => Ok(()),
            Environment::Constant(radiance) => writeln!(file, "\n[environment]\nradiance = {:?}", radiance.to_array()),
            Environment::LatLong(_) => writeln!(file, "\n[environment]\nfile = {}", text(&self.sky())),
        }
    }

    /// What takes the texture coordinates of a material to its image, of which the scene format says nothing.
    fn transform(&self, material: &Material) -> Affine2 {
        let texture = material.texture(Parameter::Diffuse).map(|texture| &self.scene.textures[texture as usize]);
        texture.map_or(Lookup::default(), |texture| texture.lookup).transform
    }

    /// The triangles of a material by its place among those that are written.
    fn triangles(&self, place: usize) -> impl Iterator<Item = &Triangle> {
        let index = self.materials[place].0;
        self.mesh.triangles.iter().filter(move |triangle| triangle.material == index)
    }

    fn write_obj(&self, file: &mut dyn Write) -> io::Result<()> {
        let mesh = &self.mesh;
        for (point, index) in mesh.positions.iter().zip(0..) {
            write!(file, "v {} {} {}", point.x, point.y, point.z)?;
            if !mesh.colours.is_empty() {
                let [red, green, blue] =
                    mesh.colour(index).to_array().map(|light| srgb::encode(f64::from(light).clamp(0.0, 1.0)));
                write!(file, " {red} {green} {blue}")?;
            }
            writeln!(file)?;
        }
        for normal in &mesh.normals {
            writeln!(file, "vn {} {} {}", normal.x, normal.y, normal.z)?;
        }
        let mut uvs = 0;
        for (place, (_, name)) in self.materials.iter().enumerate() {
            let transform = self.transform(self.described[place]);
            // Each material has texture coordinates of its own.
            let mut known: HashMap<u32, usize> = HashMap::new();
            writeln!(file, "usemtl {name}")?;
            for triangle in self.triangles(place) {
                for uv in triangle.uvs.into_iter().filter(|uv| *uv != NONE) {
                    if let Entry::Vacant(entry) = known.entry(uv) {
                        uvs += 1;
                        entry.insert(uvs);
                        let uv = transform.transform_point2(mesh.uvs[uv as usize]);
                        writeln!(file, "vt {} {}", uv.x, uv.y)?;
                    }
                }
                write!(file, "f")?;
                for ((position, uv), normal) in triangle.positions.into_iter().zip(triangle.uvs).zip(triangle.normals) {
                    write!(file, " {}", position + 1)?;
                    match (known.get(&uv), normal) {
                        (None, NONE) => {}
                        (Some(uv), NONE) => write!(file, "/{uv}")?,
                        (None, normal) => write!(file, "//{}", normal + 1)?,
                        (Some(uv), normal) => write!(file, "/{uv}/{}", normal + 1)?,
                    }
                }
                writeln!(file)?;
            }
        }
        Ok(())
    }

    fn write_ply(&self, place: usize, file: &mut dyn Write) -> io::Result<()> {
        let mesh = &self.mesh;
        let transform = self.transform(self.described[place]);
        let mut known: HashMap<[u32; 3], u32> = HashMap::new();
        let mut corners: Vec<[u32; 3]> = Vec::new();
        let mut faces: Vec<[u32; 3]> = Vec::new();
        for triangle in self.triangles(place) {
            faces.push([0, 1, 2].map(|corner| {
                let corner = [triangle.positions[corner], triangle.normals[corner], triangle.uvs[corner]];
                *known.entry(corner).or_insert_with(|| {
                    corners.push(corner);
                    corners.len() as u32 - 1
                })
            }));
        }
        let has = |kind: usize| corners.iter().any(|corner| corner[kind] != NONE);
        let (has_normals, has_uvs) = (has(1), has(2));
        write!(file, "ply\nformat binary_little_endian 1.0\nelement vertex {}\n", corners.len())?;
        write!(file, "property double x\nproperty double y\nproperty double z\n")?;
        if has_normals {
            write!(file, "property float nx\nproperty float ny\nproperty float nz\n")?;
        }
        if has_uvs {
            write!(file, "property float s\nproperty float t\n")?;
        }
        let has_colours = !mesh.colours.is_empty();
        if has_colours {
            write!(file, "property float red\nproperty float green\nproperty float blue\n")?;
        }
        write!(file, "element face {}\nproperty list uchar uint vertex_indices\nend_header\n", faces.len())?;
        for [position, normal, uv] in corners {
            for value in mesh.positions[position as usize].to_array() {
                file.write_all(&value.to_le_bytes())?;
            }
            if has_normals {
                // One of no length leaves its triangle flat.
                let normal = if normal == NONE { Vec3::ZERO } else { mesh.normals[normal as usize] };
                normal.to_array().iter().try_for_each(|value| file.write_all(&value.to_le_bytes()))?;
            }
            if has_uvs {
                let uv = if uv == NONE { Vec2::ZERO } else { transform.transform_point2(mesh.uvs[uv as usize]) };
                uv.to_array().iter().try_for_each(|value| file.write_all(&value.to_le_bytes()))?;
            }
            if has_colours {
                let colour = mesh.colour(position).to_array();
                colour.iter().try_for_each(|value| file.write_all(&value.to_le_bytes()))?;
            }
        }
        for face in faces {
            file.write_all(&[3])?;
            face.iter().try_for_each(|index| file.write_all(&index.to_le_bytes()))?;
        }
        Ok(())
    }
}

/// A name that every format takes as it is, and every file system.
fn plain(name: &str) -> String {
    let kept = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '-' };
    let name: String = name.chars().map(kept).collect();
    if name.is_empty() { "material".to_owned() } else { name }
}

/// The name, or one like it where it is taken; small letters count as capital ones, as some file systems take them.
fn distinct(name: &str, taken: &mut HashSet<String>) -> String {
    let mut candidate = name.to_owned();
    let mut number = 2;
    while !taken.insert(candidate.to_lowercase()) {
        candidate = format!("{name}-{number}");
        number += 1;
    }
    candidate
}
