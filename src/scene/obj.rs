//! OBJ text to indexed triangles.
//!
//! `tobj` triangulates and indexes. It reads a checked and plain copy of the text that is made
//! here, because by itself it gives no line numbers, takes index 0 for a missing one, gives a
//! corner without a normal the normal of the corner before it, and takes polylines for faces.
//! The copy holds vertices, faces and one object for each [`Run`], and nothing else; indices in
//! it are positive and in range.

use std::{fmt::Write, path::Path};

use super::{
    error::{Place, SceneError},
    text::{excerpt, keyword, name, number, statements},
};

/// The material name of faces before any `usemtl`.
pub(super) const UNNAMED: &str = "default";

/// A mesh file, in its own coordinates.
#[derive(Debug)]
pub(super) struct ObjFile {
    pub libraries: Vec<Library>,
    /// At least one, none of them empty.
    pub runs: Vec<Run>,
}

/// The rest of an `mtllib` line: one file name with blanks in it, or several without.
#[derive(Debug, Clone)]
pub(super) struct Library {
    pub line: usize,
    pub names: String,
}

/// Consecutive faces of one material whose corners are all of one kind.
#[derive(Debug, Default)]
pub(super) struct Run {
    pub material: String,
    /// The line of the `usemtl`, where there is one.
    pub line: Option<usize>,
    pub has_uvs: bool,
    /// Where false, the normals of `mesh` mean nothing; likewise `has_uvs` and its uvs.
    pub has_normals: bool,
    pub mesh: tobj::Mesh,
}

/// A line and what is wrong with it.
type Fault = (usize, String);

/// How many positions, texture coordinates and normals have been read.
type Counts = [usize; 3];

const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// Reads an OBJ file. Errors name the first offending line.
pub(super) fn read(path: &Path, text: &str) -> Result<ObjFile, SceneError> {
    let refuse = |(line, problem)| SceneError::Obj { place: Place::line(path, line), problem };
    let mut plain = String::with_capacity(text.len());
    let counts = copy_vertices(text, &mut plain).map_err(refuse)?;
    if counts.iter().any(|&count| count >= u32::MAX as usize) {
        return Err(SceneError::TooLarge {
            place: Place::file(path),
            problem: "more vertices than 32-bit indices reach; split the mesh".into(),
        });
    }
    let mut file = copy_faces(text, counts, &mut plain).map_err(refuse)?;
    if file.runs.is_empty() {
        return Err(SceneError::Obj {
            place: Place::file(path),
            problem: "no faces; export the mesh with its polygons".into(),
        });
    }

    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut plain.as_bytes(), &options, no_materials).map_err(|error| {
        SceneError::Obj { place: Place::file(path), problem: format!("{error}; export the mesh anew") }
    })?;
    for (run, model) in file.runs.iter_mut().zip(models) {
        run.mesh = model.mesh;
    }
    Ok(file)
}

/// Copies `v`, `vt` and `vn` with the numbers that matter, and counts them.
fn copy_vertices(text: &str, plain: &mut String) -> Result<Counts, Fault> {
    let mut counts = [0; 3];
    for (line, statement) in statements(text) {
        let (key, rest) = keyword(&statement);
        let (kind, needed) = match key {
            "v" => (0, 3),
            "vt" => (1, 2),
            "vn" => (2, 3),
            _ => continue,
        };
        let mut words: Vec<&str> = rest.split_whitespace().take(needed).collect();
        if key == "vt" && words.len() == 1 {
            words.push("0"); // A one-dimensional texture coordinate.
        }
        if words.len() < needed {
            let problem =
                format!("a {} needs {needed} numbers and has {}; complete the line", KINDS[kind], words.len());
            return Err((line, problem));
        }
        plain.push_str(key);
        for word in words {
            let value = number(word).map_err(|e| (line, format!("{e}; correct the {}", KINDS[kind])))?;
            // A normal that is not finite only makes its triangles flat.
            let usable = match key {
                "v" => value.is_finite(),
                "vt" => (value as f32).is_finite(),
                _ => true,
            };
            if !usable {
                let problem = format!("`{}` in a {} is not finite; correct or remove it", excerpt(word), KINDS[kind]);
                return Err((line, problem));
            }
            plain.push(' ');
            plain.push_str(word);
        }
        plain.push('\n');
        counts[kind] += 1;
    }
    Ok(counts)
}

/// Copies faces, and opens a new object where the material or the kind of corner changes. Indices
/// may point ahead: `totals` is what the whole file holds.
fn copy_faces(text: &str, totals: Counts, plain: &mut String) -> Result<ObjFile, Fault> {
    let mut file = ObjFile { libraries: Vec::new(), runs: Vec::new() };
    let mut material = (UNNAMED.to_owned(), None);
    let mut so_far = [0; 3];
    let mut corners: Vec<[Option<usize>; 3]> = Vec::new();
    for (line, statement) in statements(text) {
        let (key, rest) = keyword(&statement);
        match key {
            "v" => so_far[0] += 1,
            "vt" => so_far[1] += 1,
            "vn" => so_far[2] += 1,
            "mtllib" if rest.is_empty() => {
                return Err((line, "mtllib names no file; give one or remove the line".into()));
            }
            "mtllib" => file.libraries.push(Library { line, names: rest.to_owned() }),
            "usemtl" if rest.is_empty() => {
                return Err((line, "usemtl names no material; give one".into()));
            }
            "usemtl" => material = (name(rest), Some(line)),
            "f" => {
                corners.clear();
                for word in rest.split_whitespace() {
                    corners.push(corner(word, so_far, totals).map_err(|e| (line, e))?);
                }
                if corners.len() < 3 {
                    let problem = format!("a face with {} corners; give 3 or more", corners.len());
                    return Err((line, problem));
                }
                let has_uvs = corners.iter().all(|corner| corner[1].is_some());
                let has_normals = corners.iter().all(|corner| corner[2].is_some());
                let continues = file.runs.last().is_some_and(|run| {
                    run.material == material.0 && run.has_uvs == has_uvs && run.has_normals == has_normals
                });
                if !continues {
                    plain.push_str("o\n");
                    file.runs.push(Run {
                        material: material.0.clone(),
                        line: material.1,
                        has_uvs,
                        has_normals,
                        mesh: tobj::Mesh::default(),
                    });
                }
                copy_face(&corners, has_uvs, has_normals, plain);
            }
            _ => {}
        }
    }
    Ok(file)
}

/// One corner `v`, `v/vt`, `v//vn` or `v/vt/vn` as indices counted from 1.
fn corner(word: &str, so_far: Counts, totals: Counts) -> Result<[Option<usize>; 3], String> {
    let mut indices = [None; 3];
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
        indices[kind] = Some(match index {
            0 => return Err(format!("{what} index 0; OBJ counts from 1")),
            1.. if index as u64 <= totals[kind] as u64 => index as usize,
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
                above + 1 - back as usize
            }
        });
    }
    match indices[0] {
        Some(_) => Ok(indices),
        None => Err(format!("corner `{}` has no vertex; give its index", excerpt(word))),
    }
}

fn copy_face(corners: &[[Option<usize>; 3]], has_uvs: bool, has_normals: bool, plain: &mut String) {
    const INFALLIBLE: &str = "writing to a string does not fail";
    plain.push('f');
    for [v, vt, vn] in corners {
        write!(plain, " {}", v.unwrap_or_default()).expect(INFALLIBLE);
        if let (true, Some(vt)) = (has_uvs, vt) {
            write!(plain, "/{vt}").expect(INFALLIBLE);
        }
        if let (true, Some(vn)) = (has_normals, vn) {
            let slashes = if has_uvs { "/" } else { "//" };
            write!(plain, "{slashes}{vn}").expect(INFALLIBLE);
        }
    }
    plain.push('\n');
}
