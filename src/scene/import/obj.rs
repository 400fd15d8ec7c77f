//! OBJ: text to an indexed mesh, with the materials of its MTL libraries.

use std::{
    collections::{HashMap, HashSet},
    path::{Path, PathBuf},
    rc::Rc,
};

use glam::{DVec3, Vec2, Vec3};

use super::{
    Import, Material, Mesh,
    mtl::{self, Library},
    polygons::Polygons,
};
use crate::image::srgb;
use crate::parallel;
use crate::scene::{
    NONE, Triangle,
    error::{Location, SceneError},
    sources::{Sources, Warning},
    text::{Part, decode, excerpt, file_name, foreign, keyword, name, number, words},
};

/// The material name of faces before any `usemtl`.
const UNNAMED: &str = "default";

/// Bytes of a part of a file. Parts are read in parallel.
const PART_SIZE: usize = 1 << 20;

/// How many parts are read before what they say is put together: few, so that memory is used again, and enough for all threads
/// to end at about the same time.
fn wave() -> usize {
    8 * rayon::current_num_threads()
}

/// Imports OBJ files of one scene, which may share MTL libraries.
#[derive(Debug, Default)]
pub(super) struct Importer {
    /// By path; `None` where there is no such file.
    libraries: HashMap<PathBuf, Option<Rc<Library>>>,
}

impl Importer {
    /// Adds the mesh of a file and the materials that its faces use. Returns the index of the mesh.
    pub fn add(
        &mut self,
        path: &Path,
        named_at: &Location,
        sources: &mut Sources,
        import: &mut Import,
    ) -> Result<usize, SceneError> {
        let (mesh, faces) = read(path, named_at, import.materials.len(), sources)?;
        self.add_materials(path, &faces, sources, import)?;
        import.meshes.push(mesh);
        Ok(import.meshes.len() - 1)
    }

    fn add_materials(
        &mut self,
        path: &Path,
        faces: &Faces,
        sources: &mut Sources,
        import: &mut Import,
    ) -> Result<(), SceneError> {
        let mut libraries = Vec::new();
        let mut lacks_library = false;
        for (line, names) in &faces.libraries {
            let named_at = Location::line(path, *line);
            for mtl in library_paths(path, names, sources) {
                match self.library(&mtl, &named_at, sources)? {
                    Some(library) => libraries.push(library),
                    None => lacks_library = true,
                }
            }
        }
        for (name, line) in &faces.materials {
            let mut material = Material::named(name);
            // Of two libraries that define a name the later one counts.
            match libraries.iter().rev().find_map(|library| library.get(name)) {
                Some(definition) => definition.apply(&mut material, &mut import.images),
                // Where an MTL file is missing, one warning is enough for all its materials.
                None if !lacks_library && name != UNNAMED && !name.is_empty() => {
                    let location = Location { path: path.to_path_buf(), line: *line };
                    let text = format!("no material `{}` in any MTL file; the default one is taken", excerpt(name));
                    material.warnings.push(Warning { kind: "no such material", location, text });
                }
                None => {}
            }
            import.materials.push(material);
        }
        Ok(())
    }

    /// Reads an MTL file once. Where it is missing a warning is enough: meshes are often handed on
    /// without.
    fn library(
        &mut self,
        path: &Path,
        named_at: &Location,
        sources: &mut Sources,
    ) -> Result<Option<Rc<Library>>, SceneError> {
        if let Some(library) = self.libraries.get(path) {
            return Ok(library.clone());
        }
        let library = match sources.require(path, named_at) {
            Ok(bytes) => match foreign(&bytes) {
                None => Some(Rc::new(mtl::read(path, &decode(&bytes), sources))),
                Some(what) => {
                    let location = Location::file(path);
                    sources.warn(format!("{location}: not an MTL file but {what}; default materials are taken"));
                    None
                }
            },
            Err(error) => {
                sources.warn(format!("{error}; default materials are taken"));
                None
            }
        };
        self.libraries.insert(path.to_path_buf(), library.clone());
        Ok(library)
    }
}

/// Reads the mesh of a file without its materials: all its triangles are of the first.
pub(super) fn read_mesh(path: &Path, named_at: &Location, sources: &mut Sources) -> Result<Mesh, SceneError> {
    let (mut mesh, _) = read(path, named_at, 0, sources)?;
    mesh.triangles.iter_mut().for_each(|triangle| triangle.material = 0);
    Ok(mesh)
}

/// Reads a file. Materials are counted from `first_material`.
fn read(
    path: &Path,
    named_at: &Location,
    first_material: usize,
    sources: &mut Sources,
) -> Result<(Mesh, Faces), SceneError> {
    let bytes = sources.require(path, named_at)?;
    let refuse = |(line, problem)| Location::line(path, line).refuse(problem);
    let location = Location::file(path);
    if let Some(what) = foreign(&bytes) {
        return Err(location.refuse(format!("not an OBJ file but {what}")));
    }
    let text = decode(&bytes);
    let parts = Part::split(&text, PART_SIZE);
    let (vertices, above) = read_vertices(&parts, path, sources).map_err(refuse)?;
    if vertices.counts().iter().any(|&count| count >= NONE as usize) {
        return Err(location.refuse("more vertices than 32-bit indices reach; split the mesh"));
    }
    let mut faces = read_faces(&parts, &above, &vertices, first_material, path, sources).map_err(refuse)?;
    let triangles = std::mem::take(&mut faces.triangles);
    if triangles.is_empty() {
        return Err(location.refuse("no faces; export the mesh with its polygons"));
    }
    let Vertices { positions, uvs, normals, mut colours, .. } = vertices;
    if !colours.is_empty() {
        colours.resize(positions.len(), Vec3::ONE);
    }
    Ok((Mesh { location, positions, normals, uvs, colours, triangles }, faces))
}

/// The files of an `mtllib` line: one name with blanks where such a file exists, else several.
fn library_paths(obj: &Path, names: &str, sources: &Sources) -> Vec<PathBuf> {
    let folder = obj.parent().unwrap_or(Path::new(""));
    let whole = folder.join(file_name(names));
    if sources.has(&whole) {
        return vec![whole];
    }
    names.split_whitespace().map(|word| folder.join(file_name(word))).collect()
}

/// What a part of a file says that is left out: of each kind the first, and how many there are.
#[derive(Debug, Default)]
struct Notes(Vec<(&'static str, usize, String, usize)>);

impl Notes {
    fn note(&mut self, kind: &'static str, line: usize, text: impl Into<String>) {
        match self.0.iter_mut().find(|(known, ..)| *known == kind) {
            Some((.., count)) => *count += 1,
            None => self.0.push((kind, line, text.into(), 1)),
        }
    }

    fn tell(self, path: &Path, sources: &mut Sources) {
        for (kind, line, text, count) in self.0 {
            sources.note_first(&Warning { kind, location: Location::line(path, line), text }, count);
        }
    }
}

/// A line and what is wrong with it.
type Fault = (usize, String);

/// How many positions, texture coordinates and normals there are.
type Counts = [usize; 3];

const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// What `v`, `vt` and `vn` list.
#[derive(Debug, Default)]
struct Vertices {
    positions: Vec<DVec3>,
    uvs: Vec<Vec2>,
    normals: Vec<DVec3>,
    /// Linear colours of positions, up to the last one that has some; the others are white.
    colours: Vec<Vec3>,
    /// Places of positions that are not finite, with their lines and what stands there. No face may have one.
    bad_positions: HashMap<u32, Fault>,
    /// Places of texture coordinates, and of normals, that are not finite: faces are taken not to have them.
    bad: [HashSet<u32>; 2],
}

impl Vertices {
    fn counts(&self) -> Counts {
        [self.positions.len(), self.uvs.len(), self.normals.len()]
    }

    /// Adds those that stand below.
    fn append(&mut self, mut below: Self) {
        let [positions, others @ ..] = self.counts();
        let bad_positions = below.bad_positions.into_iter();
        self.bad_positions.extend(bad_positions.map(|(place, fault)| (positions as u32 + place, fault)));
        for (kind, above) in others.into_iter().enumerate() {
            self.bad[kind].extend(below.bad[kind].iter().map(|place| above as u32 + place));
        }
        if !below.colours.is_empty() {
            self.colours.resize(positions, Vec3::ONE);
            self.colours.append(&mut below.colours);
        }
        self.positions.append(&mut below.positions);
        self.uvs.append(&mut below.uvs);
        self.normals.append(&mut below.normals);
    }
}

/// The name of a `usemtl`, and its line.
type UseMaterial = (String, Option<usize>);

/// What counts of all that stands above a part of a file.
#[derive(Debug, Clone)]
struct Above {
    counts: Counts,
    usemtl: UseMaterial,
}

/// Reads all vertices, since faces may point ahead. Returns what stands above each part too.
fn read_vertices(parts: &[Part], path: &Path, sources: &mut Sources) -> Result<(Vertices, Vec<Above>), Fault> {
    let mut vertices = Vertices::default();
    let mut usemtl = (UNNAMED.to_owned(), None);
    let mut above = Vec::with_capacity(parts.len());
    for wave in parts.chunks(wave()) {
        let read = parallel::map(wave.len(), &|part| read_vertices_of(wave[part]));
        for read in read {
            let (own, last_usemtl, notes) = read?;
            above.push(Above { counts: vertices.counts(), usemtl: usemtl.clone() });
            vertices.append(own);
            usemtl = last_usemtl.unwrap_or(usemtl);
            notes.tell(path, sources);
        }
    }
    Ok((vertices, above))
}

/// Reads the vertices of a part, and its last `usemtl`.
fn read_vertices_of(part: Part) -> Result<(Vertices, Option<UseMaterial>, Notes), Fault> {
    let mut vertices = Vertices::default();
    let mut usemtl = None;
    let mut notes = Notes::default();
    for (line, statement) in part.statements() {
        let (key, rest) = keyword(&statement);
        let (kind, needed) = match key {
            "v" => (0, 3),
            "vt" => (1, 2),
            "vn" => (2, 3),
            "usemtl" => {
                usemtl = Some((name(rest), Some(line)));
                continue;
            }
            _ => continue,
        };
        let mut numbers = [0.0; 3];
        let mut found = 0;
        let mut words = words(rest);
        for (slot, word) in numbers[..needed].iter_mut().zip(words.by_ref()) {
            *slot = number(word).map_err(|e| (line, format!("{e}; correct the {}", KINDS[kind])))?;
            if kind == 0 && !slot.is_finite() {
                let problem = format!("`{}` in a vertex is not finite; correct or remove it", excerpt(word));
                vertices.bad_positions.insert(vertices.positions.len() as u32, (line, problem));
            }
            found += 1;
        }
        let is_one_dimensional = kind == 1 && found == 1;
        if found < needed && !is_one_dimensional {
            let problem = format!("a {} needs {needed} numbers and has {found}; complete the line", KINDS[kind]);
            return Err((line, problem));
        }
        if kind == 0 {
            let mut signals = [f64::NAN; 3];
            let found = signals
                .iter_mut()
                .zip(words.by_ref())
                .map(|(slot, word)| *slot = number(word).unwrap_or(f64::NAN))
                .count();
            // A fourth number would be a weight in front of them.
            let has_colour = found == 3 && words.next().is_none();
            if has_colour && !signals.iter().all(|signal| (0.0..=1.0).contains(signal)) {
                notes.note("vertex colours", line, "colours of vertices are clamped to [0, 1]");
            }
            if has_colour {
                let linear = |signal: f64| srgb::decode(signal.clamp(0.0, 1.0).max(0.0)) as f32;
                vertices.colours.resize(vertices.positions.len(), Vec3::ONE);
                vertices.colours.push(Vec3::from(signals.map(linear)));
            }
        }
        let [x, y, z] = numbers;
        match kind {
            // What is not finite has a finite stand-in, so that bounds and transforms may take all.
            0 if DVec3::from(numbers).is_finite() => vertices.positions.push(DVec3::new(x, y, z)),
            0 => vertices.positions.push(DVec3::ZERO),
            1 => {
                let uv = Vec2::new(x as f32, y as f32);
                if !uv.is_finite() {
                    vertices.bad[0].insert(vertices.uvs.len() as u32);
                }
                vertices.uvs.push(if uv.is_finite() { uv } else { Vec2::ZERO });
            }
            _ => {
                let normal = DVec3::new(x, y, z);
                if !normal.is_finite() {
                    vertices.bad[1].insert(vertices.normals.len() as u32);
                }
                vertices.normals.push(if normal.is_finite() { normal } else { DVec3::ZERO });
            }
        }
    }
    Ok((vertices, usemtl, notes))
}

/// What all but the vertices say.
#[derive(Debug, Default)]
struct Faces {
    /// The lines of `mtllib` and what stands on them: one file name with blanks in it, or several
    /// without.
    libraries: Vec<(usize, String)>,
    /// The materials that faces use, in order of first use, with the line of the `usemtl`.
    materials: Vec<UseMaterial>,
    triangles: Vec<Triangle>,
}

/// Reads faces as triangles. Indices may point ahead: `vertices` are those of the whole file. Materials are counted from
/// `first_material`.
fn read_faces(
    parts: &[Part],
    above: &[Above],
    vertices: &Vertices,
    first_material: usize,
    path: &Path,
    sources: &mut Sources,
) -> Result<Faces, Fault> {
    let mut faces = Faces::default();
    let mut indices: HashMap<String, u32> = HashMap::new();
    for (wave, above) in parts.chunks(wave()).zip(above.chunks(wave())) {
        let read = parallel::map(wave.len(), &|part| read_faces_of(wave[part], above[part].clone(), vertices));
        for read in read {
            let (own, notes) = read?;
            faces.libraries.extend(own.libraries);
            let index = |usemtl: UseMaterial| {
                *indices.entry(usemtl.0.clone()).or_insert_with(|| {
                    faces.materials.push(usemtl);
                    (first_material + faces.materials.len() - 1) as u32
                })
            };
            let materials: Vec<u32> = own.materials.into_iter().map(index).collect();
            let triangles = own.triangles.into_iter();
            faces.triangles.extend(triangles.map(|triangle| {
                let material = materials[triangle.material as usize];
                Triangle { material, ..triangle }
            }));
            notes.tell(path, sources);
        }
    }
    Ok(faces)
}

/// Reads the faces of a part. Its materials are counted from 0.
fn read_faces_of(part: Part, above: Above, vertices: &Vertices) -> Result<(Faces, Notes), Fault> {
    let mut faces = Faces::default();
    let mut notes = Notes::default();
    let mut material_indices: HashMap<String, u32> = HashMap::new();
    // The index of the material of `usemtl`, once a face uses it.
    let mut current_material = None;
    let totals = vertices.counts();
    let Above { counts: mut so_far, mut usemtl } = above;
    let mut corners: Vec<[u32; 3]> = Vec::new();
    let mut polygons = Polygons::default();
    for (line, statement) in part.statements() {
        let (key, rest) = keyword(&statement);
        match key {
            "v" => so_far[0] += 1,
            "vt" => so_far[1] += 1,
            "vn" => so_far[2] += 1,
            "mtllib" if rest.is_empty() => {
                notes.note("bare mtllib", line, "mtllib names no file");
            }
            "mtllib" => faces.libraries.push((line, rest.to_owned())),
            "usemtl" => {
                if rest.is_empty() {
                    notes.note("bare usemtl", line, "usemtl names no material; the default one is taken");
                }
                usemtl = (name(rest), Some(line));
                current_material = None;
            }
            "f" => {
                corners.clear();
                for word in words(rest) {
                    let mut indices = corner(word, so_far, totals, |problem| {
                        notes.note("index out of range", line, problem);
                    })
                    .map_err(|problem| (line, problem))?;
                    if let Some((line, problem)) = vertices.bad_positions.get(&indices[0]) {
                        return Err((*line, problem.clone()));
                    }
                    for (kind, bad) in (1..).zip(&vertices.bad) {
                        if bad.contains(&indices[kind]) {
                            let what = KINDS[kind];
                            notes.note(
                                what,
                                line,
                                format!("a {what} that is not finite; the face is taken to have none"),
                            );
                            indices[kind] = NONE;
                        }
                    }
                    corners.push(indices);
                }
                if corners.len() < 3 {
                    let text = format!("a face with {} corners is left out; give 3 or more", corners.len());
                    notes.note("short face", line, text);
                    continue;
                }
                let material = *current_material.get_or_insert_with(|| {
                    *material_indices.entry(usemtl.0.clone()).or_insert_with(|| {
                        faces.materials.push(usemtl.clone());
                        faces.materials.len() as u32 - 1
                    })
                });
                polygons.add(&corners, &vertices.positions, material, &mut faces.triangles);
            }
            _ => {}
        }
    }
    Ok((faces, notes))
}

/// One corner `v`, `v/vt`, `v//vn` or `v/vt/vn`, as indices counted from 0; [`NONE`] where there is none. A texture
/// coordinate or normal that there is not counts as none, and is told to `note`.
fn corner(word: &str, so_far: Counts, totals: Counts, mut note: impl FnMut(String)) -> Result<[u32; 3], String> {
    let mut indices = [NONE; 3];
    for (kind, field) in word.split('/').enumerate() {
        if kind >= 3 {
            let word = excerpt(word);
            return Err(format!("`{word}` has too many slashes; write v/vt/vn"));
        }
        if field.is_empty() {
            continue;
        }
        let what = KINDS[kind];
        let index: i64 = field.parse().map_err(|_| {
            let field = excerpt(field);
            format!("`{field}` is not a {what} index; give a whole number")
        })?;
        let found = match index {
            0 => Err(format!("{what} index 0; OBJ counts from 1")),
            1.. if index as u64 <= totals[kind] as u64 => Ok((index - 1) as u32),
            1.. => Err(format!("{what} index {index} is out of range; the file has {}", totals[kind])),
            _ => match (so_far[kind] as u64).checked_sub(index.unsigned_abs()) {
                Some(place) => Ok(place as u32),
                None => Err(format!("{what} index {index} is out of range; only {} stand above it", so_far[kind])),
            },
        };
        match found {
            Ok(index) => indices[kind] = index,
            Err(problem) if kind == 0 => return Err(problem),
            Err(problem) => note(format!("{problem}; the face is taken to have no {what}s")),
        }
    }
    match indices[0] {
        NONE => Err(format!("corner `{}` has no vertex; give its index", excerpt(word))),
        _ => Ok(indices),
    }
}
