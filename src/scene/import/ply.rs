//! PLY (Turk 1994), as text or binary of either byte order, to an indexed mesh.

use std::{collections::HashSet, path::Path, str};

use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::{Import, Material, Mesh, light, polygons::Polygons};
use crate::{
    image::srgb,
    scene::{
        NONE, Triangle,
        error::{Location, SceneError},
        sources::{Sources, Warning},
        text::{decode, excerpt, foreign, name, number},
    },
};

/// Adds the mesh of a file and its material, which has the name of the file without its extension. Returns the index of
/// the mesh.
pub(super) fn add(
    path: &Path,
    named_at: &Location,
    sources: &mut Sources,
    import: &mut Import,
) -> Result<usize, SceneError> {
    let mesh = read_mesh(path, named_at, import.materials.len() as u32, sources)?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let mut described = Material::named(&name(&stem));
    if !mesh.colours.is_empty() {
        described.optics.diffuse = Vec3::ONE;
    }
    import.materials.push(described);
    import.meshes.push(mesh);
    Ok(import.meshes.len() - 1)
}

/// Reads the mesh of a file, all of one material.
pub(super) fn read_mesh(
    path: &Path,
    named_at: &Location,
    material: u32,
    sources: &mut Sources,
) -> Result<Mesh, SceneError> {
    let bytes = sources.require(path, named_at)?;
    let location = Location::file(path);
    if !bytes.starts_with(b"ply") {
        let what = foreign(&bytes).unwrap_or("something else; name a file that begins with `ply`");
        return Err(location.refuse(format!("not a PLY file but {what}")));
    }
    let refuse = |Fault { line, problem }| Location { path: path.to_path_buf(), line }.refuse(problem);
    let (header, body) = read_header(&bytes).map_err(refuse)?;
    header.note_what_is_not_shown(path, sources);

    let mut mesh = Building::new(material);
    let left = match header.encoding {
        Encoding::Ascii => {
            let line = header.lines + 1;
            mesh.read(&header, Ascii { rest: body, line, word: None })
        }
        Encoding::LittleEndian => mesh.read(&header, Binary::<false> { rest: body }),
        Encoding::BigEndian => mesh.read(&header, Binary::<true> { rest: body }),
    }
    .map_err(refuse)?;
    let note = |sources: &mut Sources, kind, text| {
        sources.note(&Warning { kind, location: location.clone(), text });
    };
    if left > 0 {
        note(sources, "PLY remainder", format!("{left} bytes behind the last element are left out"));
    }
    if mesh.short_faces > 0 {
        let text = format!("{} faces of fewer than 3 corners are left out; give 3 or more", mesh.short_faces);
        note(sources, "short faces of PLY", text);
    }
    if mesh.clamped_colours > 0 {
        let text = format!("{} colours of vertices are negative or not finite; they are clamped", mesh.clamped_colours);
        note(sources, "PLY colours", text);
    }
    if mesh.triangles.is_empty() {
        return Err(location.refuse("no faces; export the mesh with its polygons"));
    }
    let Building { positions, normals, uvs, colours, triangles, .. } = mesh;
    Ok(Mesh { location, positions, normals, uvs, colours, triangles })
}

/// What is wrong, and on which line of the header or of a text body.
#[derive(Debug)]
struct Fault {
    line: Option<usize>,
    problem: String,
}

impl Fault {
    fn new(line: impl Into<Option<usize>>, problem: impl Into<String>) -> Self {
        Self { line: line.into(), problem: problem.into() }
    }
}

#[derive(Debug, Clone, Copy)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// The type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The code of full intensity; `None` where colours are linear light.
    fn full_code(self) -> Option<f64> {
        match self {
            Self::F32 | Self::F64 => None,
            Self::U16 => Some(f64::from(u16::MAX)),
            _ => Some(f64::from(u8::MAX)),
        }
    }
}

#[derive(Debug)]
struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    /// How many lines it has.
    lines: usize,
    /// The line of a comment that names an image.
    texture: Option<usize>,
}

#[derive(Debug)]
struct Element {
    name: String,
    count: usize,
    line: usize,
    properties: Vec<Property>,
}

#[derive(Debug)]
struct Property {
    name: String,
    line: usize,
    /// The type of its number, or of the numbers of its list.
    scalar: Scalar,
    /// The type of the length of its list, if it is one.
    length: Option<Scalar>,
}

/// Reads the header. Returns what follows it too.
fn read_header(bytes: &[u8]) -> Result<(Header, &[u8]), Fault> {
    // Lines end as the first one does; a body may begin with any byte.
    let end: &[u8] = match bytes.get(3..).unwrap_or_default() {
        [b'\r', b'\n', ..] => b"\r\n",
        [b'\r', ..] => b"\r",
        _ => b"\n",
    };
    let (mut encoding, mut elements, mut texture) = (None, Vec::<Element>::new(), None);
    let mut rest = bytes;
    for line in 1.. {
        let Some(length) = rest.windows(end.len()).position(|window| window == end) else { break };
        let text = decode(&rest[..length]);
        rest = &rest[length + end.len()..];
        let words: Vec<&str> = text.split_whitespace().collect();
        match words[..] {
            ["ply"] if line == 1 => {}
            _ if line == 1 => break,
            [] | ["obj_info", ..] => {}
            ["comment", what, ..] if what.eq_ignore_ascii_case("TextureFile") => texture = Some(line),
            ["comment", ..] => {}
            ["format", format, ..] => {
                encoding = Some(match format {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::LittleEndian,
                    "binary_big_endian" => Encoding::BigEndian,
                    _ => {
                        let problem = format!("no format `{}`; write ascii or binary_little_endian", excerpt(format));
                        return Err(Fault::new(line, problem));
                    }
                });
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| {
                    let problem = format!("`{}` is not a number of elements; give a whole number", excerpt(count));
                    Fault::new(line, problem)
                })?;
                elements.push(Element { name: name.to_owned(), count, line, properties: Vec::new() });
            }
            ["property", ref words @ .., name] => {
                let scalar = |name: &str| {
                    let unknown = || format!("no type `{}`; write float, int, uchar or the like", excerpt(name));
                    Scalar::of(name).ok_or_else(|| Fault::new(line, unknown()))
                };
                let (length, scalar) = match words {
                    ["list", length, of] => (Some(scalar(length)?), scalar(of)?),
                    [of] => (None, scalar(of)?),
                    _ => return Err(Fault::new(line, "a property needs a type and a name; complete the line")),
                };
                let Some(element) = elements.last_mut() else {
                    return Err(Fault::new(line, "a property of no element; put an element above it"));
                };
                element.properties.push(Property { name: name.to_owned(), line, scalar, length });
            }
            ["end_header"] => {
                let Some(encoding) = encoding else {
                    return Err(Fault::new(line, "no format above the end of the header; add `format ascii 1.0`"));
                };
                return Ok((Header { encoding, elements, lines: line, texture }, rest));
            }
            _ => {
                let problem = format!("`{}` is no line of a header; export the file anew", excerpt(text.trim()));
                return Err(Fault::new(line, problem));
            }
        }
    }
    Err(Fault::new(None, "a header without `end_header`; export the file anew"))
}

/// What a property of a vertex is, as a place in its row: position, normal, texture coordinates, colour.
fn place_of(name: &str) -> Option<usize> {
    Some(match name {
        "x" => 0,
        "y" => 1,
        "z" => 2,
        "nx" => 3,
        "ny" => 4,
        "nz" => 5,
        "s" | "u" | "texture_u" | "texture_s" => 6,
        "t" | "v" | "texture_v" | "texture_t" => 7,
        "red" | "r" | "diffuse_red" => 8,
        "green" | "g" | "diffuse_green" => 9,
        "blue" | "b" | "diffuse_blue" => 10,
        _ => return None,
    })
}

/// How many numbers a row of a vertex has.
const PLACES: usize = 11;

impl Element {
    /// Whether it is a list of corners of a face or of strips.
    fn has_corners(&self) -> bool {
        matches!(&*self.name, "face" | "tristrips")
    }

    /// The place in a row of each property of a vertex.
    fn places(&self) -> Vec<Option<usize>> {
        let mut taken = [false; PLACES];
        let properties = self.properties.iter();
        let place = |property: &Property| {
            let place = place_of(&property.name).filter(|_| property.length.is_none())?;
            (!std::mem::replace(&mut taken[place], true)).then_some(place)
        };
        properties.map(place).collect()
    }

    /// Bytes of a row in a binary body, where it has no lists.
    fn row_size(&self) -> Option<usize> {
        self.properties.iter().map(|property| property.length.is_none().then(|| property.scalar.size())).sum()
    }

    /// The property that lists corners.
    fn corners(&self) -> Option<usize> {
        let is_it = |property: &Property| {
            property.length.is_some() && matches!(&*property.name, "vertex_indices" | "vertex_index")
        };
        self.properties.iter().position(is_it)
    }
}

impl Header {
    fn note_what_is_not_shown(&self, path: &Path, sources: &mut Sources) {
        let mut note = |kind, line, text| {
            sources.note(&Warning { kind, location: Location::line(path, line), text });
        };
        if let Some(line) = self.texture {
            let text = "the image of a comment is not shown; give a map_Kd in a [material] table of a scene file";
            note("image of PLY", line, text.to_owned());
        }
        for element in &self.elements {
            let what = excerpt(&element.name);
            if element.name != "vertex" && !element.has_corners() {
                if element.count > 0 {
                    note("element of PLY", element.line, format!("elements `{what}` are not shown"));
                }
                continue;
            }
            let places = element.places();
            let corners = element.corners();
            for (index, property) in element.properties.iter().enumerate() {
                let is_shown = match element.has_corners() {
                    true => corners == Some(index),
                    false => places[index].is_some(),
                };
                let name = excerpt(&property.name);
                if property.length.is_some() && name == "texcoord" {
                    let text = "texture coordinates of faces are not read; export them with vertices";
                    note("texture coordinates of faces", property.line, text.to_owned());
                } else if !is_shown {
                    note("property of PLY", property.line, format!("the property `{name}` of `{what}` is not shown"));
                }
            }
        }
    }
}

/// Reads a number that bytes begin with; `None` where they are too few.
type ReadNumber = fn(&[u8], Scalar) -> Option<f64>;

/// Takes a row to the corners of a triangle.
type ReadCorners = fn(&[u8]) -> [u32; 3];

/// The numbers of a body, one after the other.
trait Numbers {
    /// How many bytes a number of that type has at least.
    fn least_size(scalar: Scalar) -> usize;
    /// How many bytes are left.
    fn left(&self) -> usize;
    fn next(&mut self, scalar: Scalar) -> Option<f64>;
    /// Why there was no next one.
    fn fault(&self) -> Fault;
    /// The line of the last one, in a text.
    fn line(&self) -> Option<usize>;
    /// The rows of an element, and what reads a number of one, where all are of the size [`Element::row_size`]. Then none of
    /// them is left.
    fn rows(&mut self, _: &Element) -> Option<(&[u8], ReadNumber)> {
        None
    }
    /// The rows of an element, and what takes one to its corners, where they are all as most files have them: a list of three
    /// whole numbers of 32 bits and no more. Then none of them is left. There may be millions.
    fn triangles(&mut self, _: &Element) -> Option<(&[u8], ReadCorners)> {
        None
    }
}

/// Bytes of a row that is a list of three whole numbers of 32 bits.
const TRIANGLE_SIZE: usize = 1 + 3 * 4;

struct Binary<'a, const IS_BIG_ENDIAN: bool> {
    rest: &'a [u8],
}

impl<const IS_BIG_ENDIAN: bool> Binary<'_, IS_BIG_ENDIAN> {
    #[inline]
    fn bytes<const SIZE: usize>(&mut self) -> Option<[u8; SIZE]> {
        let (&first, rest) = self.rest.split_first_chunk()?;
        let mut bytes: [u8; SIZE] = first;
        self.rest = rest;
        if IS_BIG_ENDIAN {
            bytes.reverse();
        }
        Some(bytes)
    }
}

impl<const IS_BIG_ENDIAN: bool> Numbers for Binary<'_, IS_BIG_ENDIAN> {
    fn least_size(scalar: Scalar) -> usize {
        scalar.size()
    }

    fn left(&self) -> usize {
        self.rest.len()
    }

    #[inline]
    fn next(&mut self, scalar: Scalar) -> Option<f64> {
        Some(match scalar {
            Scalar::I8 => f64::from(i8::from_le_bytes(self.bytes()?)),
            Scalar::U8 => f64::from(u8::from_le_bytes(self.bytes()?)),
            Scalar::I16 => f64::from(i16::from_le_bytes(self.bytes()?)),
            Scalar::U16 => f64::from(u16::from_le_bytes(self.bytes()?)),
            Scalar::I32 => f64::from(i32::from_le_bytes(self.bytes()?)),
            Scalar::U32 => f64::from(u32::from_le_bytes(self.bytes()?)),
            Scalar::F32 => f64::from(f32::from_le_bytes(self.bytes()?)),
            Scalar::F64 => f64::from_le_bytes(self.bytes()?),
        })
    }

    fn rows(&mut self, element: &Element) -> Option<(&[u8], ReadNumber)> {
        let (rows, rest) = self.rest.split_at_checked(element.count.checked_mul(element.row_size()?)?)?;
        self.rest = rest;
        Some((rows, |bytes, scalar| Binary::<IS_BIG_ENDIAN> { rest: bytes }.next(scalar)))
    }

    fn triangles(&mut self, element: &Element) -> Option<(&[u8], ReadCorners)> {
        let [Property { scalar: Scalar::I32 | Scalar::U32, length: Some(Scalar::U8), .. }] = element.properties[..]
        else {
            return None;
        };
        let (rows, rest) = self.rest.split_at_checked(element.count.checked_mul(TRIANGLE_SIZE)?)?;
        if !rows.par_chunks_exact(TRIANGLE_SIZE).all(|row| row.first() == Some(&3)) {
            return None;
        }
        self.rest = rest;
        Some((rows, |row| {
            let mut corners = Binary::<IS_BIG_ENDIAN> { rest: row.get(1..).unwrap_or_default() };
            [(); 3].map(|()| corners.bytes().map_or(NONE, u32::from_le_bytes))
        }))
    }

    fn fault(&self) -> Fault {
        Fault::new(None, "the file ends early; copy or export it anew")
    }

    fn line(&self) -> Option<usize> {
        None
    }
}

/// Words of a text. Line breaks are as good as blanks: some programs break lists.
struct Ascii<'a> {
    rest: &'a [u8],
    line: usize,
    /// The last one that was found.
    word: Option<&'a [u8]>,
}

impl Numbers for Ascii<'_> {
    fn least_size(_: Scalar) -> usize {
        // A digit and what parts it from the next, which the last number of a file may lack.
        1
    }

    fn left(&self) -> usize {
        let is_over = self.rest.iter().all(u8::is_ascii_whitespace);
        if is_over { 0 } else { self.rest.len() }
    }

    fn next(&mut self, _: Scalar) -> Option<f64> {
        let start = self.rest.iter().position(|byte| {
            self.line += usize::from(*byte == b'\n');
            !byte.is_ascii_whitespace()
        });
        self.word = None;
        let word = &self.rest[start?..];
        let length = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
        let (word, rest) = word.split_at(length);
        self.rest = rest;
        self.word = Some(word);
        let text = str::from_utf8(word).ok()?;
        text.parse().ok().or_else(|| number(text).ok())
    }

    fn fault(&self) -> Fault {
        match self.word {
            Some(word) => {
                let problem = format!("`{}` is not a number; correct it", excerpt(&decode(word)));
                Fault::new(self.line, problem)
            }
            None => Fault::new(None, "the file ends early; copy or export it anew"),
        }
    }

    fn line(&self) -> Option<usize> {
        Some(self.line)
    }
}

/// A mesh in the making.
struct Building {
    material: u32,
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
    uvs: Vec<Vec2>,
    colours: Vec<Vec3>,
    triangles: Vec<Triangle>,
    /// Vertices that are not finite. No face may have one.
    bad_positions: HashSet<u32>,
    /// Vertices whose texture coordinates are not finite: faces are taken not to have them.
    bad_uvs: HashSet<u32>,
    polygons: Polygons,
    short_faces: usize,
    clamped_colours: usize,
}

impl Building {
    fn new(material: u32) -> Self {
        Self {
            material,
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            colours: Vec::new(),
            triangles: Vec::new(),
            bad_positions: HashSet::new(),
            bad_uvs: HashSet::new(),
            polygons: Polygons::default(),
            short_faces: 0,
            clamped_colours: 0,
        }
    }

    /// Reads all elements. Returns how many bytes are left.
    fn read<N: Numbers>(&mut self, header: &Header, mut numbers: N) -> Result<usize, Fault> {
        for element in &header.elements {
            let lengths = element.properties.iter().map(|property| property.length.unwrap_or(property.scalar));
            let least: usize = lengths.map(N::least_size).sum();
            // Before memory is taken for so many.
            if least > 0 && element.count > numbers.left() / least {
                let problem = format!(
                    "{} elements `{}` are more than the file has bytes for; copy or export it anew",
                    element.count,
                    excerpt(&element.name)
                );
                return Err(Fault::new(element.line, problem));
            }
            match &*element.name {
                _ if least == 0 => {}
                "vertex" => self.read_vertices(element, &mut numbers)?,
                _ if element.has_corners() && element.corners().is_some() => self.read_faces(element, &mut numbers)?,
                _ => {
                    for _ in 0..element.count {
                        for property in &element.properties {
                            skip(property, &mut numbers)?;
                        }
                    }
                }
            }
        }
        Ok(numbers.left())
    }

    fn read_vertices<N: Numbers>(&mut self, element: &Element, numbers: &mut N) -> Result<(), Fault> {
        if !self.positions.is_empty() {
            return Err(Fault::new(element.line, "vertices a second time; export one mesh a file"));
        }
        if element.count >= NONE as usize {
            return Err(Fault::new(element.line, "more vertices than 32-bit indices reach; split the mesh"));
        }
        let places = element.places();
        let property_of = |place: usize| places.iter().position(|other| *other == Some(place));
        if (0..3).any(|place| property_of(place).is_none()) {
            return Err(Fault::new(element.line, "vertices need x, y and z; export them"));
        }
        let has = |mut wanted: std::ops::Range<usize>| wanted.all(|place| property_of(place).is_some());
        let (has_normals, has_uvs, has_colours) = (has(3..6), has(6..8), has(8..11));
        let full_code = property_of(8).and_then(|property| element.properties[property].scalar.full_code());
        let codes: Vec<f32> = (0..256).map(|code| srgb::decode(f64::from(code) / 255.0) as f32).collect();

        let linear = |value: f64| match full_code {
            None => value as f32,
            // Of a whole number of 8 bits.
            Some(255.0) => codes[value as u8 as usize],
            Some(full) => srgb::decode(value / full) as f32,
        };
        let position = |[x, y, z]: [f64; 3]| DVec3::new(x, y, z);
        let uv = |[u, v]: [f64; 2]| Vec2::new(u as f32, v as f32);
        let colour = |rgb: [f64; 3]| Vec3::from(rgb.map(linear));

        if let Some((rows, number)) = numbers.rows(element) {
            let mut fields = [(0, Scalar::U8); PLACES];
            let mut offset = 0;
            for (property, place) in element.properties.iter().zip(&places) {
                if let Some(place) = place {
                    fields[*place] = (offset, property.scalar);
                }
                offset += property.scalar.size();
            }
            let rows = rows.par_chunks_exact(offset);
            // What does not lie in a row is asked for of none.
            let at = |row: &[u8], place: usize| {
                let (offset, scalar) = fields[place];
                row.get(offset..).and_then(|bytes| number(bytes, scalar)).unwrap_or_default()
            };
            let three = |row: &[u8], first: usize| [0, 1, 2].map(|next| at(row, first + next));
            self.positions = rows.clone().map(|row| position(three(row, 0))).collect();
            if has_normals {
                self.normals = rows.clone().map(|row| position(three(row, 3))).collect();
            }
            if has_uvs {
                self.uvs = rows.clone().map(|row| uv([at(row, 6), at(row, 7)])).collect();
            }
            if has_colours {
                self.colours = rows.map(|row| colour(three(row, 8))).collect();
            }
        } else {
            self.positions.reserve_exact(element.count);
            let mut row = [0.0; PLACES];
            for _ in 0..element.count {
                for (property, place) in element.properties.iter().zip(&places) {
                    match place {
                        Some(place) => row[*place] = numbers.next(property.scalar).ok_or_else(|| numbers.fault())?,
                        None => skip(property, numbers)?,
                    }
                }
                let [x, y, z, nx, ny, nz, u, v, red, green, blue] = row;
                self.positions.push(position([x, y, z]));
                self.normals.extend(has_normals.then(|| position([nx, ny, nz])));
                self.uvs.extend(has_uvs.then(|| uv([u, v])));
                self.colours.extend(has_colours.then(|| colour([red, green, blue])));
            }
        }

        // What is not finite has a finite stand-in, so that bounds and transforms may take all.
        self.bad_positions = stand_in(&mut self.positions, |position| position.is_finite());
        self.bad_uvs = stand_in(&mut self.uvs, |uv| uv.is_finite());
        let clamp = |colour: &mut Vec3| {
            let is_good = colour.is_finite() && colour.min_element() >= 0.0;
            *colour = Vec3::from(colour.to_array().map(light));
            usize::from(!is_good)
        };
        self.clamped_colours = self.colours.par_iter_mut().map(clamp).sum();
        Ok(())
    }

    fn read_faces<N: Numbers>(&mut self, element: &Element, numbers: &mut N) -> Result<(), Fault> {
        if self.positions.is_empty() && element.count > 0 {
            return Err(Fault::new(element.line, "faces stand above all vertices; export the file anew"));
        }
        let list = element.corners();
        if element.name == "face"
            && let Some((rows, corners)) = numbers.triangles(element)
        {
            let rows = rows.par_chunks_exact(TRIANGLE_SIZE).map(corners);
            let is_signed = element.properties.iter().any(|property| property.scalar == Scalar::I32);
            let fault = |corner: u32| {
                let number = if is_signed { f64::from(corner.cast_signed()) } else { f64::from(corner) };
                self.corner(number).err()
            };
            if let Some(problem) = rows.clone().find_map_first(|corners| corners.into_iter().find_map(fault)) {
                return Err(Fault::new(None, problem));
            }
            let triangle = |corners: [u32; 3]| {
                let [a, b, c] = corners.map(|corner| self.indices(corner));
                let all = |kind: usize| {
                    let indices = [a[kind], b[kind], c[kind]];
                    if indices.contains(&NONE) { [NONE; 3] } else { indices }
                };
                Triangle { positions: all(0), uvs: all(1), normals: all(2), material: self.material }
            };
            let mut triangles: Vec<Triangle> = rows.map(triangle).collect();
            match self.triangles.is_empty() {
                true => self.triangles = triangles,
                false => self.triangles.append(&mut triangles),
            }
            return Ok(());
        }
        let are_strips = element.name == "tristrips";
        self.triangles.reserve(if are_strips { 0 } else { element.count });
        let mut corners = Vec::new();
        for _ in 0..element.count {
            for (index, property) in element.properties.iter().enumerate() {
                if list != Some(index) {
                    skip(property, numbers)?;
                    continue;
                }
                let length = length_of(property, numbers)?;
                corners.clear();
                for _ in 0..length {
                    let corner = numbers.next(property.scalar).ok_or_else(|| numbers.fault())?;
                    if are_strips && [-1.0, f64::from(u32::MAX)].contains(&corner) {
                        self.add_strip(&corners);
                        corners.clear();
                        continue;
                    }
                    corners.push(self.corner(corner).map_err(|problem| Fault::new(numbers.line(), problem))?);
                }
                match are_strips {
                    true => self.add_strip(&corners),
                    false => self.add_face(&corners),
                }
            }
        }
        Ok(())
    }

    /// The index of a corner: position, texture coordinates and normal have the same.
    #[inline]
    fn corner(&self, index: f64) -> Result<u32, String> {
        let count = self.positions.len();
        let Some(index) = whole(index).filter(|index| (*index as usize) < count) else {
            return Err(format!("vertex index {index} is out of range; the file has {count}, counted from 0"));
        };
        if !self.bad_positions.is_empty() && self.bad_positions.contains(&index) {
            return Err(format!("vertex {index}, counted from 0, is not finite; correct or remove it"));
        }
        Ok(index)
    }

    /// The indices of a corner into positions, texture coordinates and normals.
    #[inline]
    fn indices(&self, corner: u32) -> [u32; 3] {
        let has_uv = !self.uvs.is_empty() && (self.bad_uvs.is_empty() || !self.bad_uvs.contains(&corner));
        [corner, if has_uv { corner } else { NONE }, if self.normals.is_empty() { NONE } else { corner }]
    }

    #[inline]
    fn add_face(&mut self, corners: &[u32]) {
        if corners.len() < 3 {
            self.short_faces += 1;
            return;
        }
        let indices = |corner: &u32| self.indices(*corner);
        if let [a, b, c] = corners {
            let triangle = [a, b, c].map(indices);
            self.polygons.add(&triangle, &self.positions, self.material, &mut self.triangles);
        } else {
            let polygon: Vec<[u32; 3]> = corners.iter().map(indices).collect();
            self.polygons.add(&polygon, &self.positions, self.material, &mut self.triangles);
        }
    }

    /// Adds a strip, of which every other triangle runs the other way round.
    fn add_strip(&mut self, corners: &[u32]) {
        for (index, triangle) in corners.windows(3).enumerate() {
            let [a, b, c] = [triangle[0], triangle[1], triangle[2]];
            self.add_face(&if index % 2 == 0 { [a, b, c] } else { [b, a, c] });
        }
    }
}

/// Puts 0 in place of what is not finite. Returns where that was.
fn stand_in<T: Default + Send>(values: &mut [T], is_finite: impl Fn(&T) -> bool + Sync) -> HashSet<u32> {
    let bad = values.par_iter_mut().enumerate().filter(|(_, value)| !is_finite(value));
    bad.map(|(index, value)| {
        *value = T::default();
        index as u32
    })
    .collect()
}

#[inline]
fn skip<N: Numbers>(property: &Property, numbers: &mut N) -> Result<(), Fault> {
    let count = if property.length.is_some() { length_of(property, numbers)? } else { 1 };
    for _ in 0..count {
        numbers.next(property.scalar).ok_or_else(|| numbers.fault())?;
    }
    Ok(())
}

/// The length of a list that begins here.
#[inline]
fn length_of<N: Numbers>(property: &Property, numbers: &mut N) -> Result<usize, Fault> {
    let length = numbers.next(property.length.unwrap_or(Scalar::U8)).ok_or_else(|| numbers.fault())?;
    match whole(length) {
        // What is too long ends with the file.
        Some(length) => Ok(length as usize),
        None => Err(Fault::new(numbers.line(), format!("a list of {length} numbers; give a whole number"))),
    }
}

/// A whole number of 32 bits, where it is one.
#[inline]
fn whole(number: f64) -> Option<u32> {
    // A cast saturates.
    let whole = number as u32;
    (f64::from(whole) == number).then_some(whole)
}
