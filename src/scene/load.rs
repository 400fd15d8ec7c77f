//! Puts a [`Scene`] together from the files that a scene file names.

use std::{
    collections::{HashMap, HashSet},
    path::{Path, PathBuf},
    rc::Rc,
};

use glam::{DVec3, Vec3};

use super::{
    Camera, Environment, EnvironmentMap, Material, Mesh, RenderDefaults, Scene, Texture,
    document::{self, Document, Light, MeshEntry, Override},
    error::{Place, SceneError},
    files::{Files, Fingerprint},
    material::{ImageName, MaterialKeys, portable, read_mtl},
    obj::{self, ObjFile, Run, UNNAMED},
    picture::Picture,
    place::{FARTHEST, Misplaced, Transform},
    text::{excerpt, one_line},
};

/// The Cornell box of `scenes/`, part of the program.
const CORNELL_BOX: &[(&str, &[u8])] = &[
    ("cornell-box.toml", include_bytes!("../../scenes/cornell-box.toml")),
    ("cornell-box.obj", include_bytes!("../../scenes/cornell-box.obj")),
    ("cornell-box.mtl", include_bytes!("../../scenes/cornell-box.mtl")),
];

impl Scene {
    /// Reads a scene file, `.toml`, or a bare mesh, `.obj`.
    ///
    /// A bare mesh is seen whole, along -z and a little from above, in an image of 512 x 512; where
    /// it has no light of its own it stands in a white environment of radiance 1.
    ///
    /// # Errors
    /// Whatever is wrong with the file or with one that it names, see [`SceneError`].
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        Loader::new(Files::Disk, path).load(path)
    }

    /// The built-in Cornell box, the same scene as `scenes/cornell-box.toml`.
    pub fn cornell_box() -> Self {
        let path = Path::new("cornell-box.toml");
        Loader::new(Files::Embedded(CORNELL_BOX), path)
            .load(path)
            .expect("the files are part of the program and a test loads them")
    }
}

/// A scene in the making.
struct Loader<'a> {
    files: Files,
    /// Folder of the scene file; names count relative to it in the hash.
    folder: &'a Path,
    fingerprint: Fingerprint,
    warnings: Vec<String>,
    overrides: Vec<Override>,
    used_overrides: HashSet<usize>,
    /// MTL files by path; `None` where there is none.
    libraries: HashMap<PathBuf, Option<Rc<HashMap<String, MaterialKeys>>>>,
    pictures: Vec<(PathBuf, Picture)>,
    /// What each texture will be: a picture and the factor that the energy rule asks for.
    textures: Vec<(usize, f32)>,
    materials: Vec<Material>,
    mesh: Mesh,
    without_area: usize,
}

impl<'a> Loader<'a> {
    fn new(files: Files, path: &'a Path) -> Self {
        Self {
            files,
            folder: path.parent().unwrap_or(Path::new("")),
            fingerprint: Fingerprint::default(),
            warnings: Vec::new(),
            overrides: Vec::new(),
            used_overrides: HashSet::new(),
            libraries: HashMap::new(),
            pictures: Vec::new(),
            textures: Vec::new(),
            materials: Vec::new(),
            mesh: Mesh::default(),
            without_area: 0,
        }
    }

    fn load(self, path: &Path) -> Result<Scene, SceneError> {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("toml") => self.load_document(path),
            Some("obj") => self.load_bare_mesh(path),
            _ => Err(SceneError::File {
                place: Place::file(path),
                problem: "neither .toml nor .obj; name a scene file or a mesh".into(),
            }),
        }
    }

    fn load_document(mut self, path: &Path) -> Result<Scene, SceneError> {
        let bytes = self.read(path, &Place::file(path))?;
        let text = String::from_utf8(bytes).map_err(|error| {
            let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
            SceneError::Toml {
                place: Place::line(path, 1 + valid.iter().filter(|&&b| b == b'\n').count()),
                problem: "not UTF-8 text; save the file as UTF-8".into(),
            }
        })?;
        let Document { camera, width, height, defaults, meshes, overrides, light } = document::read(path, &text)?;
        self.overrides = overrides;
        self.add_meshes(meshes)?;
        let environment = self.environment(light)?;
        self.warn_of_unused_overrides();
        let scene = self.finish(path, camera, environment)?;
        Ok(Scene { width, height, defaults, ..scene })
    }

    fn load_bare_mesh(mut self, path: &Path) -> Result<Scene, SceneError> {
        self.add_meshes(vec![MeshEntry {
            path: path.to_path_buf(),
            place: Place::file(path),
            transform: Transform::IDENTITY,
        }])?;
        let mut environment = Environment::Black;
        if !self.materials.iter().any(Material::is_emitter) {
            environment = Environment::Constant(Vec3::ONE);
            self.warnings
                .push(format!("{}: nothing emits light; lit by a white environment of radiance 1", Place::file(path)));
        }
        let camera = Camera::framing(self.mesh.bounds());
        self.finish(path, camera, environment)
    }

    /// Reads a file into the fingerprint. `named_at` is where the user finds its name.
    fn read(&mut self, path: &Path, named_at: &Place) -> Result<Vec<u8>, SceneError> {
        match self.files.read(path) {
            Ok(bytes) => {
                self.fingerprint.add(self.folder, path, &bytes);
                Ok(bytes)
            }
            Err(error) => {
                let file = one_line(&path.to_string_lossy());
                Err(SceneError::File {
                    place: named_at.clone(),
                    problem: format!("cannot read `{file}` ({error}); check the name"),
                })
            }
        }
    }

    /// Adds all meshes, each file read once however often it is placed.
    fn add_meshes(&mut self, entries: Vec<MeshEntry>) -> Result<(), SceneError> {
        let mut placements: Vec<(PathBuf, Place, Vec<Transform>)> = Vec::new();
        for MeshEntry { path, place, transform } in entries {
            match placements.iter_mut().find(|(other, ..)| *other == path) {
                Some((.., transforms)) => transforms.push(transform),
                None => placements.push((path, place, vec![transform])),
            }
        }
        for (path, place, transforms) in placements {
            let bytes = self.read(&path, &place)?;
            let file = obj::read(&path, &String::from_utf8_lossy(&bytes))?;
            drop(bytes);
            self.add_mesh(&path, file, &transforms)?;
        }
        Ok(())
    }

    fn add_mesh(&mut self, path: &Path, file: ObjFile, transforms: &[Transform]) -> Result<(), SceneError> {
        let mut library = HashMap::new();
        let mut lacks_library = false;
        for entry in &file.libraries {
            let place = Place::line(path, entry.line);
            for mtl in self.library_paths(path, &entry.names) {
                match self.library(&mtl, &place)? {
                    Some(materials) => {
                        library.extend(materials.iter().map(|(name, keys)| (name.clone(), keys.clone())))
                    }
                    None => lacks_library = true,
                }
            }
        }

        // Where an MTL file is missing, one warning is enough for all its materials.
        let warns_of_unknown = !lacks_library;
        let mut known = HashMap::new();
        for run in file.runs {
            let key = (run.material.clone(), run.has_uvs);
            let material = match known.get(&key) {
                Some(&material) => material,
                None => {
                    let keys = self.keys(path, &run, &library, warns_of_unknown);
                    let has_image = keys.image().is_some();
                    let material = self.material(path, &run, keys)?;
                    if !has_image {
                        known.insert((key.0.clone(), !key.1), material);
                    }
                    known.insert(key, material);
                    material
                }
            };
            for transform in transforms {
                self.place(path, &run, transform, material)?;
            }
        }
        Ok(())
    }

    /// The files of an `mtllib` line: one name with blanks where such a file exists, else several.
    fn library_paths(&self, obj: &Path, names: &str) -> Vec<PathBuf> {
        let folder = obj.parent().unwrap_or(Path::new(""));
        let whole = folder.join(portable(names));
        if self.files.has(&whole) {
            return vec![whole];
        }
        let words = names.split_whitespace();
        words.map(|word| folder.join(portable(word))).collect()
    }

    /// Reads an MTL file once. A missing one is worth a warning alone: meshes are often handed on
    /// without.
    fn library(
        &mut self,
        path: &Path,
        named_at: &Place,
    ) -> Result<Option<Rc<HashMap<String, MaterialKeys>>>, SceneError> {
        if let Some(library) = self.libraries.get(path) {
            return Ok(library.clone());
        }
        let library = match self.read(path, named_at) {
            Ok(bytes) => Some(Rc::new(read_mtl(path, &String::from_utf8_lossy(&bytes))?)),
            Err(error) => {
                self.warnings.push(format!("{error}; default materials are taken"));
                None
            }
        };
        self.libraries.insert(path.to_path_buf(), library.clone());
        Ok(library)
    }

    /// The keys of a run's material, overrides applied.
    fn keys(
        &mut self,
        path: &Path,
        run: &Run,
        library: &HashMap<String, MaterialKeys>,
        warns_of_unknown: bool,
    ) -> MaterialKeys {
        let defined = library.get(&run.material).cloned();
        let by_name = |over: &Override| over.name == run.material;
        if let Some(index) = self.overrides.iter().position(by_name) {
            self.used_overrides.insert(index);
            return defined.unwrap_or_default().overridden_by(&self.overrides[index].keys);
        }
        if defined.is_none() && warns_of_unknown && run.material != UNNAMED {
            let place = Place { path: path.to_path_buf(), line: run.line };
            let name = excerpt(&one_line(&run.material));
            self.warnings.push(format!("{place}: no material `{name}` in any MTL file; the default one is taken"));
        }
        defined.unwrap_or_default()
    }

    /// Adds a material and the texture that it shows.
    fn material(&mut self, path: &Path, run: &Run, keys: MaterialKeys) -> Result<u32, SceneError> {
        self.warnings.extend(keys.warnings.iter().cloned());
        let place = Place { path: path.to_path_buf(), line: run.line };
        let name = excerpt(&one_line(&run.material));
        let picture = match keys.image() {
            Some(image) if run.has_uvs => Some(self.picture(image)?),
            Some(_) => {
                self.warnings
                    .push(format!("{place}: faces of `{name}` lack texture coordinates; they show Kd, not map_Kd"));
                None
            }
            None => None,
        };
        let brightest = picture.map(|picture| self.pictures[picture].1.brightest().min(Vec3::ONE));
        let (mut material, scale) = keys.material(&run.material, brightest);
        if scale < 0.9999 {
            self.warnings.push(format!(
                "{}: Kd + Ks of `{name}` reaches {:.3} in a channel; both are scaled down to 1",
                keys.place.as_ref().unwrap_or(&place),
                1.0 / scale
            ));
        }
        material.map_kd = picture.map(|picture| {
            let texture = (picture, scale);
            let known = self.textures.iter().position(|other| *other == texture);
            known.unwrap_or_else(|| {
                self.textures.push(texture);
                self.textures.len() - 1
            }) as u32
        });
        self.materials.push(material);
        Ok(self.materials.len() as u32 - 1)
    }

    /// Decodes an image once; returns its place in `pictures`.
    fn picture(&mut self, image: &ImageName) -> Result<usize, SceneError> {
        let known = self.pictures.iter().position(|(path, _)| *path == image.path);
        if let Some(known) = known {
            return Ok(known);
        }
        let mut picture = self.decode(image)?;
        if picture.brightest().max_element() > 1.0 {
            for pixel in &mut picture.pixels {
                *pixel = pixel.min(Vec3::ONE);
            }
            self.warnings.push(format!(
                "{}: map_Kd is brighter than 1; clamped, as nothing reflects more than it gets",
                image.place
            ));
        }
        self.pictures.push((image.path.clone(), picture));
        Ok(self.pictures.len() - 1)
    }

    fn decode(&mut self, image: &ImageName) -> Result<Picture, SceneError> {
        let refuse = |problem: String| {
            let file = one_line(&image.path.to_string_lossy());
            SceneError::Image { place: image.place.clone(), problem: format!("image `{file}` {}", one_line(&problem)) }
        };
        let bytes = self
            .files
            .read(&image.path)
            .map_err(|error| refuse(format!("cannot be read ({error}); check the name")))?;
        self.fingerprint.add(self.folder, &image.path, &bytes);
        Picture::decode(&image.path, &bytes).map_err(refuse)
    }

    fn environment(&mut self, light: Light) -> Result<Environment, SceneError> {
        let (image, scale) = match light {
            Light::None => return Ok(Environment::Black),
            Light::Constant(radiance) if radiance == Vec3::ZERO => return Ok(Environment::Black),
            Light::Constant(radiance) => return Ok(Environment::Constant(radiance)),
            Light::Image { image, scale } => (image, scale),
        };
        let picture = self.decode(&image)?;
        let radiance: Vec<Vec3> = picture.pixels.iter().map(|&pixel| pixel * scale).collect();
        if radiance.iter().any(|radiance| !radiance.is_finite()) {
            return Err(SceneError::Image {
                place: image.place,
                problem: format!("radiance overflows times scale {scale}; give a smaller scale"),
            });
        }
        if radiance.iter().all(|&radiance| radiance == Vec3::ZERO) {
            self.warnings.push(format!("{}: the environment is black", image.place));
            return Ok(Environment::Black);
        }
        Ok(Environment::LatLong(EnvironmentMap {
            path: image.path,
            width: picture.width,
            height: picture.height,
            radiance,
        }))
    }

    fn place(&mut self, path: &Path, run: &Run, transform: &Transform, material: u32) -> Result<(), SceneError> {
        let wants_uvs = self.materials[material as usize].map_kd.is_some();
        let place = Place::file(path);
        match self.mesh.place(run, transform, material, wants_uvs) {
            Ok(without_area) => self.without_area += without_area,
            Err(Misplaced::TooFar) => {
                return Err(SceneError::Obj {
                    place,
                    problem: format!("a vertex lands beyond {FARTHEST:e}; scale the mesh down"),
                });
            }
            Err(Misplaced::TooMany(what)) => {
                return Err(SceneError::TooLarge {
                    place,
                    problem: format!("more {what} than 32-bit indices reach; use smaller meshes"),
                });
            }
        }
        Ok(())
    }

    fn warn_of_unused_overrides(&mut self) {
        for (index, over) in self.overrides.iter().enumerate() {
            if !self.used_overrides.contains(&index) {
                self.warnings.push(format!(
                    "{}: no mesh uses material `{}`; the table has no effect",
                    over.place,
                    excerpt(&one_line(&over.name))
                ));
            }
        }
    }

    fn finish(mut self, path: &Path, camera: Camera, environment: Environment) -> Result<Scene, SceneError> {
        let place = Place::file(path);
        if self.mesh.triangles.is_empty() {
            return Err(SceneError::Obj { place, problem: "no triangle has an area; check scale and the mesh".into() });
        }
        if self.without_area > 0 {
            let count = self.without_area;
            self.warnings.push(format!("{place}: {count} triangles without area were dropped"));
        }
        let is_dark = matches!(environment, Environment::Black);
        if is_dark && !self.materials.iter().any(Material::is_emitter) {
            self.warnings.push(format!("{place}: nothing emits light; add a material with Ke or an [environment]"));
        }
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        Ok(Scene {
            name: one_line(&name),
            camera,
            width: 512,
            height: 512,
            defaults: RenderDefaults::default(),
            textures: textures(&self.pictures, &self.textures),
            mesh: self.mesh,
            materials: self.materials,
            environment,
            hash: self.fingerprint.finish(),
            warnings: self.warnings,
        })
    }
}

fn textures(pictures: &[(PathBuf, Picture)], wanted: &[(usize, f32)]) -> Vec<Texture> {
    let texture = |&(picture, scale): &(usize, f32)| {
        let (path, picture): &(PathBuf, Picture) = &pictures[picture];
        picture.texture(path.clone(), scale)
    };
    wanted.iter().map(texture).collect()
}

impl Camera {
    /// A camera that sees the whole of a box, along -z and a little from above.
    fn framing((low, high): (DVec3, DVec3)) -> Self {
        const VFOV: f64 = 45.0;
        const MARGIN: f64 = 1.05;
        let centre = 0.5 * (low + high);
        let radius = 0.5 * low.distance(high);
        let distance = MARGIN * radius / libm::sin((0.5 * VFOV).to_radians());
        Self {
            eye: centre + distance * DVec3::new(0.0, 0.25, 1.0).normalize(),
            target: centre,
            up: DVec3::Y,
            vfov: VFOV,
            aperture: 0.0,
            focus: distance,
        }
    }
}
