//! OBJ: text to an indexed mesh, with the materials of its MTL libraries.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
    rc::Rc,
};

use glam::{DVec3, Vec2};

use super::{
    Import, Material, Mesh,
    mtl::{self, Library, portable},
};
use crate::scene::{
    NONE, Triangle,
    error::{Location, SceneError},
    sources::Sources,
    text::{excerpt, keyword, name, number, one_line, statements},
};

/// The material name of faces before any `usemtl`.
const UNNAMED: &str = "default";

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
        let bytes = sources.require(path, named_at)?;
        let text = String::from_utf8_lossy(&bytes);
        let refuse = |(line, problem)| Location::line(path, line).refuse(problem);
        let location = Location::file(path);
        let vertices = read_vertices(&text).map_err(refuse)?;
        if vertices.counts().iter().any(|&count| count >= NONE as usize) {
            return Err(location.refuse("more vertices than 32-bit indices reach; split the mesh"));
        }
        let faces = read_faces(&text, vertices.counts(), import.materials.len()).map_err(refuse)?;
        if faces.triangles.is_empty() {
            return Err(location.refuse("no faces; export the mesh with its polygons"));
        }
        self.add_materials(path, &faces, sources, import)?;
        let Vertices { positions, uvs, normals } = vertices;
        import.meshes.push(Mesh { location, positions, normals, uvs, triangles: faces.triangles });
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
                None if !lacks_library && name != UNNAMED => {
                    let location = Location { path: path.to_path_buf(), line: *line };
                    let name = excerpt(&one_line(name));
                    material
                        .warnings
                        .push(format!("{location}: no material `{name}` in any MTL file; the default one is taken"));
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
            Ok(bytes) => Some(Rc::new(mtl::read(path, &String::from_utf8_lossy(&bytes))?)),
            Err(error) => {
                sources.warn(format!("{error}; default materials are taken"));
                None
            }
        };
        self.libraries.insert(path.to_path_buf(), library.clone());
        Ok(library)
    }
}

/// The files of an `mtllib` line: one name with blanks where such a file exists, else several.
fn library_paths(obj: &Path, names: &str, sources: &Sources) -> Vec<PathBuf> {
    let folder = obj.parent().unwrap_or(Path::new(""));
    let whole = folder.join(portable(names));
    if sources.has(&whole) {
        return vec![whole];
    }
    names.split_whitespace().map(|word| folder.join(portable(word))).collect()
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
}

impl Vertices {
    fn counts(&self) -> Counts {
        [self.positions.len(), self.uvs.len(), self.normals.len()]
    }
}

/// Reads all vertices, since faces may point ahead.
fn read_vertices(text: &str) -> Result<Vertices, Fault> {
    let mut vertices = Vertices::default();
    for (line, statement) in statements(text) {
        let (key, rest) = keyword(&statement);
        let (kind, needed) = match key {
            "v" => (0, 3),
            "vt" => (1, 2),
            "vn" => (2, 3),
            _ => continue,
        };
        let mut numbers = [0.0; 3];
        let mut found = 0;
        for (slot, word) in numbers[..needed].iter_mut().zip(rest.split_whitespace()) {
            *slot = number(word).map_err(|e| (line, format!("{e}; correct the {}", KINDS[kind])))?;
            // A normal that is not finite only makes its triangles flat.
            let usable = match kind {
                0 => slot.is_finite(),
                1 => (*slot as f32).is_finite(),
                _ => true,
            };
            if !usable {
                let problem = format!("`{}` in a {} is not finite; correct or remove it", excerpt(word), KINDS[kind]);
                return Err((line, problem));
            }
            found += 1;
        }
        let is_one_dimensional = kind == 1 && found == 1;
        if found < needed && !is_one_dimensional {
            let problem = format!("a {} needs {needed} numbers and has {found}; complete the line", KINDS[kind]);
            return Err((line, problem));
        }
        let [x, y, z] = numbers;
        match kind {
            0 => vertices.positions.push(DVec3::new(x, y, z)),
            1 => vertices.uvs.push(Vec2::new(x as f32, y as f32)),
            _ => vertices.normals.push(DVec3::new(x, y, z)),
        }
    }
    Ok(vertices)
}

/// What all but the vertices say.
#[derive(Debug, Default)]
struct Faces {
    /// The lines of `mtllib` and what stands on them: one file name with blanks in it, or several
    /// without.
    libraries: Vec<(usize, String)>,
    /// The materials that faces use, in order of first use, with the line of the `usemtl`.
    materials: Vec<(String, Option<usize>)>,
    triangles: Vec<Triangle>,
}

/// Reads faces as fans of triangles. Indices may point ahead: `totals` is what the whole file
/// holds. Materials are counted from `first_material`.
fn read_faces(text: &str, totals: Counts, first_material: usize) -> Result<Faces, Fault> {
    let mut faces = Faces::default();
    let mut material_indices: HashMap<String, u32> = HashMap::new();
    let mut usemtl = (UNNAMED.to_owned(), None);
    // The index of the material of `usemtl`, once a face uses it.
    let mut current_material = None;
    let mut so_far = [0; 3];
    let mut corners: Vec<[u32; 3]> = Vec::new();
    for (line, statement) in statements(text) {
        let (key, rest) = keyword(&statement);
        match key {
            "v" => so_far[0] += 1,
            "vt" => so_far[1] += 1,
            "vn" => so_far[2] += 1,
            "mtllib" if rest.is_empty() => {
                return Err((line, "mtllib names no file; give one or remove the line".into()));
            }
            "mtllib" => faces.libraries.push((line, rest.to_owned())),
            "usemtl" if rest.is_empty() => {
                return Err((line, "usemtl names no material; give one".into()));
            }
            "usemtl" => {
                usemtl = (name(rest), Some(line));
                current_material = None;
            }
            "f" => {
                corners.clear();
                for word in rest.split_whitespace() {
                    corners.push(corner(word, so_far, totals).map_err(|problem| (line, problem))?);
                }
                if corners.len() < 3 {
                    let problem = format!("a face with {} corners; give 3 or more", corners.len());
                    return Err((line, problem));
                }
                let material = *current_material.get_or_insert_with(|| {
                    *material_indices.entry(usemtl.0.clone()).or_insert_with(|| {
                        faces.materials.push(usemtl.clone());
                        (first_material + faces.materials.len() - 1) as u32
                    })
                });
                add_fan(&corners, material, &mut faces.triangles);
            }
            _ => {}
        }
    }
    Ok(faces)
}

/// One corner `v`, `v/vt`, `v//vn` or `v/vt/vn`, as indices counted from 0; [`NONE`] where there is
/// none.
fn corner(word: &str, so_far: Counts, totals: Counts) -> Result<[u32; 3], String> {
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
        indices[kind] = match index {
            0 => return Err(format!("{what} index 0; OBJ counts from 1")),
            1.. if index as u64 <= totals[kind] as u64 => (index - 1) as u32,
            1.. => {
                let total = totals[kind];
                return Err(format!("{what} index {index} is out of range; the file has {total}"));
            }
            _ => {
                let above = so_far[kind];
                let back = index.unsigned_abs();
                if back > above as u64 {
                    return Err(format!("{what} index {index} is out of range; only {above} stand above it"));
                }
                (above as u64 - back) as u32
            }
        };
    }
    match indices[0] {
        NONE => Err(format!("corner `{}` has no vertex; give its index", excerpt(word))),
        _ => Ok(indices),
    }
}

/// Adds a polygon as triangles that share its first corner. Normals and texture coordinates count
/// where all corners of the polygon have them.
fn add_fan(corners: &[[u32; 3]], material: u32, triangles: &mut Vec<Triangle>) {
    let all_have = [0, 1, 2].map(|kind| corners.iter().all(|corner| corner[kind] != NONE));
    for i in 2..corners.len() {
        let fan = [corners[0], corners[i - 1], corners[i]];
        let indices = |kind: usize| if all_have[kind] { fan.map(|corner| corner[kind]) } else { [NONE; 3] };
        triangles.push(Triangle { positions: indices(0), uvs: indices(1), normals: indices(2), material });
    }
}
