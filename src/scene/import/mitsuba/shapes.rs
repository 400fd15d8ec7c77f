//! Shapes as triangles: those of files, those that are made of triangles, and round ones, which are cut into them.

use std::f64::consts::{PI, TAU};

use std::path::PathBuf;

use glam::{DAffine3, DMat3, DVec3, Vec2, dvec3};

use super::{Importer, Placed, bsdfs::Around, serialized, xml::Object};
use crate::scene::{
    NONE, Triangle,
    error::{Location, SceneError},
    import::{Mesh, obj, ply},
};

/// How far triangles are off a round shape at most, relative to its radius.
const CHORD_ERROR: f64 = 1e-4;

/// What gives a mesh its geometry.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) enum Source {
    Rectangle,
    Cube,
    Sphere,
    Disk,
    Cylinder,
    Obj { path: PathBuf, turns_uvs: bool, is_flat: bool },
    Ply { path: PathBuf, turns_uvs: bool, is_flat: bool },
    Serialized { path: PathBuf, index: usize, is_flat: bool },
}

impl Importer<'_, '_, '_> {
    /// The meshes of a shape; none of a group, which is seen where it is placed.
    pub(super) fn shape(&mut self, place: usize, is_in_group: bool) -> Result<Vec<Placed>, SceneError> {
        let document = self.document;
        let object = &document.objects[place];
        match &*object.plugin {
            "shapegroup" if !is_in_group => Ok(Vec::new()),
            "shapegroup" | "instance" | "merge" if is_in_group => {
                let problem = "groups do not nest; place its shapes by themselves";
                Err(object.location.refuse(problem))
            }
            "merge" => self.members(object),
            "instance" => {
                let Some(group) = document.children_of(object, "shape").next() else {
                    return Err(object.location.refuse("an instance of nothing; refer to a shapegroup"));
                };
                if document.objects[group].plugin != "shapegroup" {
                    return Err(object.location.refuse("an instance of a shape; put it into a shapegroup"));
                }
                if !self.groups.contains_key(&group) {
                    let members = self.members(&document.objects[group])?;
                    self.groups.insert(group, members);
                }
                let to_world = object.transform("to_world")?.unwrap_or(DAffine3::IDENTITY);
                let place = |member: &Placed| Placed { to_world: to_world * member.to_world, ..*member };
                Ok(self.groups[&group].iter().map(place).collect())
            }
            _ => Ok(self.placed(object)?.into_iter().collect()),
        }
    }

    fn members(&mut self, object: &Object) -> Result<Vec<Placed>, SceneError> {
        let mut members = Vec::new();
        for place in self.document.children_of(object, "shape") {
            members.extend(self.shape(place, true)?);
        }
        Ok(members)
    }

    /// A shape that is a mesh, in its place.
    fn placed(&mut self, object: &Object) -> Result<Option<Placed>, SceneError> {
        let Some((source, own)) = self.source(object)? else {
            self.unsupported(object);
            return Ok(None);
        };
        let to_world = object.transform("to_world")?.unwrap_or(DAffine3::IDENTITY) * own;
        let mut is_flipped = object.boolean("flip_normals", false)?;
        // A mirrored sphere is seen from within.
        is_flipped ^= source == Source::Sphere && to_world.matrix3.determinant() < 0.0;
        let material = self.material(object)?;
        let mesh = self.mesh(object, source, is_flipped, material)?;
        Ok(Some(Placed { mesh, to_world }))
    }

    /// What a shape is made of, and the transform that its own properties say.
    fn source(&mut self, object: &Object) -> Result<Option<(Source, DAffine3)>, SceneError> {
        let is_flat = |object: &Object| object.boolean("face_normals", false);
        let source = match &*object.plugin {
            "rectangle" => Source::Rectangle,
            "cube" => Source::Cube,
            "disk" => Source::Disk,
            "sphere" => {
                let centre = object.vector("center")?.unwrap_or(DVec3::ZERO);
                let radius = object.float_in("radius", 1.0, f64::MIN_POSITIVE..=1e30, "a radius above 0")?;
                return Ok(Some((
                    Source::Sphere,
                    DAffine3::from_translation(centre) * DAffine3::from_scale(DVec3::splat(radius)),
                )));
            }
            "cylinder" => {
                let from = object.vector("p0")?.unwrap_or(DVec3::ZERO);
                let to = object.vector("p1")?.unwrap_or(DVec3::Z);
                let radius = object.float_in("radius", 1.0, f64::MIN_POSITIVE..=1e30, "a radius above 0")?;
                let Some(axis) = (to - from).try_normalize() else {
                    return Err(object.location.refuse("p0 equals p1; move one of them"));
                };
                let (x, y) = axis.any_orthonormal_pair();
                let matrix3 = DMat3::from_cols(radius * x, radius * y, to - from);
                return Ok(Some((Source::Cylinder, DAffine3 { matrix3, translation: from })));
            }
            "obj" => Source::Obj {
                path: object.file(self.sources)?,
                turns_uvs: object.boolean("flip_tex_coords", true)?,
                is_flat: is_flat(object)?,
            },
            "ply" => Source::Ply {
                path: object.file(self.sources)?,
                turns_uvs: object.boolean("flip_tex_coords", false)?,
                is_flat: is_flat(object)?,
            },
            "serialized" => {
                let index = object.integer("shape_index", 0)?;
                let Ok(index) = usize::try_from(index) else {
                    return Err(object.at("shape_index").refuse("shape_index is below 0; meshes are counted from 0"));
                };
                Source::Serialized { path: object.file(self.sources)?, index, is_flat: is_flat(object)? }
            }
            _ => return Ok(None),
        };
        Ok(Some((source, DAffine3::IDENTITY)))
    }

    /// The material of a shape.
    fn material(&mut self, object: &Object) -> Result<u32, SceneError> {
        let document = self.document;
        let emitter = document.children_of(object, "emitter").next();
        let mut bsdfs = document.children_of(object, "bsdf");
        let material = match (bsdfs.next(), bsdfs.next()) {
            (_, Some(second)) => {
                let problem = "a second BSDF of a shape; keep one";
                return Err(document.objects[second].location.refuse(problem));
            }
            (Some(bsdf), None) => self.bsdf(bsdf, Around::default(), 0)?,
            (None, None) => self.default_bsdf(object, emitter.is_some()),
        };
        for medium in document.children_of(object, "medium") {
            self.unsupported(&document.objects[medium]);
        }
        match emitter {
            Some(emitter) if document.objects[emitter].plugin == "area" => self.emitting(material, emitter),
            Some(emitter) => {
                self.unsupported(&document.objects[emitter]);
                Ok(material)
            }
            None => Ok(material),
        }
    }

    /// The index of a mesh, which is made once.
    fn mesh(&mut self, object: &Object, source: Source, is_flipped: bool, material: u32) -> Result<usize, SceneError> {
        let key = (source, is_flipped, material);
        if let Some(known) = self.meshes.get(&key) {
            return Ok(*known);
        }
        let (mut mesh, was_flipped) = match self.geometries.get(&key.0) {
            Some((alike, was_flipped)) => (self.import.meshes[*alike].clone(), *was_flipped),
            None => (self.load(object, &key.0)?, false),
        };
        if was_flipped != is_flipped {
            flip(&mut mesh);
        }
        mesh.triangles.iter_mut().for_each(|triangle| triangle.material = material);
        let index = self.import.meshes.len();
        self.import.meshes.push(mesh);
        self.geometries.entry(key.0.clone()).or_insert((index, is_flipped));
        self.meshes.insert(key, index);
        Ok(index)
    }

    /// Makes a mesh, of the first material.
    fn load(&mut self, object: &Object, source: &Source) -> Result<Mesh, SceneError> {
        let made = |geometry: Geometry| Ok(geometry.mesh(object.location.clone()));
        match source {
            Source::Rectangle => made(Geometry::rectangle()),
            Source::Cube => made(Geometry::cube()),
            Source::Sphere => made(Geometry::sphere()),
            Source::Disk => made(Geometry::disk()),
            Source::Cylinder => made(Geometry::cylinder()),
            Source::Obj { path, turns_uvs, is_flat } => {
                let mut mesh = obj::read_mesh(path, object.at("filename"), self.sources)?;
                turn_and_shade(&mut mesh, *turns_uvs, *is_flat);
                Ok(mesh)
            }
            Source::Ply { path, turns_uvs, is_flat } => {
                let mut mesh = ply::read_mesh(path, object.at("filename"), 0, self.sources)?;
                // Mitsuba shows them where a texture of a BSDF asks for them, which is not supported.
                mesh.colours.clear();
                turn_and_shade(&mut mesh, *turns_uvs, *is_flat);
                Ok(mesh)
            }
            Source::Serialized { path, index, is_flat } => {
                let bytes = self.sources.require(path, object.at("filename"))?;
                let geometry = serialized::read(&bytes, *index).map_err(|problem| {
                    let problem = format!("mesh {index}: {problem}");
                    Location::file(path).refuse(problem)
                })?;
                let mut mesh = geometry.mesh(Location::file(path));
                shade(&mut mesh, *is_flat);
                Ok(mesh)
            }
        }
    }
}

/// Triangles whose corners share positions, normals and texture coordinates by index. Texture coordinates are those of
/// Mitsuba, whose images have row 0 at v = 0.
#[derive(Debug, Default)]
pub(super) struct Geometry {
    /// Finite.
    pub positions: Vec<DVec3>,
    /// As many as positions, or none.
    pub normals: Vec<DVec3>,
    /// As many as positions, or none. Finite.
    pub uvs: Vec<Vec2>,
    /// Indices in range.
    pub triangles: Vec<[u32; 3]>,
}

impl Geometry {
    /// A mesh of it, of the first material.
    pub fn mesh(self, location: Location) -> Mesh {
        let has = |list: usize, corners: [u32; 3]| if list > 0 { corners } else { [NONE; 3] };
        let (normals, uvs) = (self.normals.len(), self.uvs.len());
        let triangle = |corners: [u32; 3]| Triangle {
            positions: corners,
            normals: has(normals, corners),
            uvs: has(uvs, corners),
            material: 0,
        };
        Mesh {
            location,
            triangles: self.triangles.into_iter().map(triangle).collect(),
            positions: self.positions,
            normals: self.normals,
            uvs: self.uvs,
            colours: Vec::new(),
        }
    }

    /// Adds a vertex with all that it has.
    fn vertex(&mut self, position: DVec3, normal: DVec3, u: f64, v: f64) {
        self.positions.push(position);
        self.normals.push(normal);
        self.uvs.push(Vec2::new(u as f32, v as f32));
    }

    /// Two triangles of a quadrilateral.
    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangles.extend([[a, b, c], [a, c, d]]);
    }

    /// The square from -1 to 1 in x and y, its front towards z.
    pub fn rectangle() -> Self {
        let mut shape = Self::default();
        for (u, v) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            shape.vertex(dvec3(2.0 * u - 1.0, 2.0 * v - 1.0, 0.0), DVec3::Z, u, v);
        }
        shape.triangles.extend([[1, 2, 0], [1, 3, 2]]);
        shape
    }

    /// The cube from -1 to 1, each side with all texture coordinates.
    pub fn cube() -> Self {
        // Bits of a corner choose x, y and z.
        const SIDES: [(DVec3, [u8; 4]); 6] = [
            (DVec3::NEG_Y, [1, 5, 4, 0]),
            (DVec3::Y, [3, 2, 6, 7]),
            (DVec3::X, [1, 3, 7, 5]),
            (DVec3::Z, [5, 7, 6, 4]),
            (DVec3::NEG_X, [4, 6, 2, 0]),
            (DVec3::NEG_Z, [3, 1, 0, 2]),
        ];
        let mut shape = Self::default();
        for (first, (normal, corners)) in (0..).step_by(4).zip(SIDES) {
            for (corner, (u, v)) in corners.into_iter().zip([(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)]) {
                let sign = |bit: u8| f64::from(corner >> bit & 1) * 2.0 - 1.0;
                shape.vertex(dvec3(sign(0), sign(1), sign(2)), normal, u, v);
            }
            shape.triangles.extend([[first, first + 1, first + 2], [first + 3, first, first + 2]]);
        }
        shape
    }

    /// The unit sphere: u goes around z from x, v from the pole at z to the other.
    pub fn sphere() -> Self {
        // Both angles of a facet add to its distance from the sphere, a² / 2 each for half of the angle a.
        let around = (PI / CHORD_ERROR.sqrt()).ceil() as u32;
        let down = around.div_ceil(2);
        let mut shape = Self::default();
        for row in 0..=down {
            let v = f64::from(row) / f64::from(down);
            // Of the triangles at a pole each has a corner of its own there, between its two others.
            let is_pole = row == 0 || row == down;
            for column in 0..=around {
                let u = (f64::from(column) + if is_pole { 0.5 } else { 0.0 }) / f64::from(around);
                let (sin_theta, cos_theta) =
                    if is_pole { (0.0, 1.0 - 2.0 * v) } else { (libm::sin(PI * v), libm::cos(PI * v)) };
                let direction = dvec3(sin_theta * libm::cos(TAU * u), sin_theta * libm::sin(TAU * u), cos_theta);
                shape.vertex(direction, direction, u, v);
            }
        }
        let at = |row: u32, column: u32| row * (around + 1) + column;
        for row in 0..down {
            for column in 0..around {
                let [a, b] = [at(row, column), at(row + 1, column)];
                match row {
                    0 => shape.triangles.push([a, b, b + 1]),
                    _ if row == down - 1 => shape.triangles.push([a, b, a + 1]),
                    _ => shape.quad([a, b, b + 1, a + 1]),
                }
            }
        }
        shape
    }

    /// The unit disk, its front towards z: u goes outwards and v around, from x.
    pub fn disk() -> Self {
        let around = segments();
        let mut shape = Self::default();
        for column in 0..=around {
            let v = f64::from(column) / f64::from(around);
            let middle = (f64::from(column) + 0.5) / f64::from(around);
            shape.vertex(dvec3(libm::cos(TAU * v), libm::sin(TAU * v), 0.0), DVec3::Z, 1.0, v);
            shape.vertex(DVec3::ZERO, DVec3::Z, 0.0, middle);
        }
        shape.triangles.extend((0..around).map(|column| [2 * column + 1, 2 * column, 2 * column + 2]));
        shape
    }

    /// The side of the unit cylinder from z = 0 to 1: u goes around from x, v along z.
    pub fn cylinder() -> Self {
        let around = segments();
        let mut shape = Self::default();
        for column in 0..=around {
            let u = f64::from(column) / f64::from(around);
            let out = dvec3(libm::cos(TAU * u), libm::sin(TAU * u), 0.0);
            shape.vertex(out, out, u, 0.0);
            shape.vertex(out + DVec3::Z, out, u, 1.0);
        }
        for a in (0..2 * around).step_by(2) {
            shape.quad([a, a + 2, a + 3, a + 1]);
        }
        shape
    }
}

/// How many chords go around a circle.
fn segments() -> u32 {
    (PI / libm::acos(1.0 - CHORD_ERROR)).ceil() as u32
}

/// Turns a mesh inside out.
fn flip(mesh: &mut Mesh) {
    for triangle in &mut mesh.triangles {
        triangle.positions.swap(1, 2);
        triangle.normals.swap(1, 2);
        triangle.uvs.swap(1, 2);
    }
    mesh.normals.iter_mut().for_each(|normal| *normal = -*normal);
}

/// Turns texture coordinates over if so asked, and makes a mesh flat or smooth.
fn turn_and_shade(mesh: &mut Mesh, turns_uvs: bool, is_flat: bool) {
    if turns_uvs {
        mesh.uvs.iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
    }
    shade(mesh, is_flat);
}

/// Makes a mesh flat, or smooth where it has no normals: Mitsuba then takes the mean of the faces around each position,
/// weighted by their angles there (Thürmer and Wüthrich 1998).
fn shade(mesh: &mut Mesh, is_flat: bool) {
    if is_flat {
        mesh.normals.clear();
        mesh.triangles.iter_mut().for_each(|triangle| triangle.normals = [NONE; 3]);
    } else if mesh.normals.is_empty() {
        let mut normals = vec![DVec3::ZERO; mesh.positions.len()];
        for triangle in &mut mesh.triangles {
            let corners = triangle.positions.map(|index| mesh.positions[index as usize]);
            let [a, b, c] = corners;
            let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
            for corner in 0..3 {
                let sides = [1, 2].map(|other| (corners[(corner + other) % 3] - corners[corner]).normalize());
                let angle = libm::acos(sides[0].dot(sides[1]).clamp(-1.0, 1.0));
                normals[triangle.positions[corner] as usize] += normal * angle;
            }
            triangle.normals = triangle.positions;
        }
        mesh.normals = normals;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shapes() -> [(&'static str, Geometry, f64); 5] {
        [
            ("rectangle", Geometry::rectangle(), 4.0),
            ("cube", Geometry::cube(), 24.0),
            ("sphere", Geometry::sphere(), 4.0 * PI),
            ("disk", Geometry::disk(), PI),
            ("cylinder", Geometry::cylinder(), TAU),
        ]
    }

    #[test]
    fn areas_fronts_and_normals_are_right() {
        for (name, shape, area) in shapes() {
            let mut sum = 0.0;
            for corners in &shape.triangles {
                let [a, b, c] = corners.map(|corner| shape.positions[corner as usize]);
                let normal = (b - a).cross(c - a);
                sum += normal.length() / 2.0;
                for corner in corners {
                    let smooth = shape.normals[*corner as usize];
                    assert!((smooth.length() - 1.0).abs() < 1e-12, "{name}");
                    assert!(normal.normalize().dot(smooth) > 0.99, "{name}: {normal} {smooth}");
                }
            }
            assert!((sum / area - 1.0).abs() < 2e-4, "{name}: {sum} {area}");
            assert!(shape.uvs.iter().all(|uv| uv.cmpge(Vec2::ZERO).all() && uv.x <= 1.01 && uv.y <= 1.01), "{name}");
        }
    }

    #[test]
    fn round_shapes_are_as_near_as_is_said() {
        for (name, shape, _) in &shapes()[2..] {
            for corners in &shape.triangles {
                let points = corners.map(|corner| shape.positions[corner as usize]);
                let radius = |point: DVec3| if *name == "sphere" { point.length() } else { point.truncate().length() };
                let is_rim = |point: &DVec3| (radius(*point) - 1.0).abs() < 1e-9;
                let on_rim: Vec<DVec3> = points.into_iter().filter(is_rim).collect();
                let middle = on_rim.iter().sum::<DVec3>() / on_rim.len() as f64;
                assert!(radius(middle) > 1.0 - 1.01 * CHORD_ERROR, "{name}: {}", radius(middle));
            }
        }
    }

    #[test]
    fn meshes_without_normals_become_smooth() {
        let mut mesh = Geometry { normals: Vec::new(), ..Geometry::cube() }.mesh(Location::file("m".as_ref()));
        shade(&mut mesh, false);
        assert!(mesh.normals[0].normalize().abs_diff_eq(DVec3::NEG_Y, 1e-12));
        assert_eq!(mesh.triangles[0].normals, mesh.triangles[0].positions);
        shade(&mut mesh, true);
        assert!(mesh.normals.is_empty() && mesh.triangles[0].normals == [NONE; 3]);
    }
}
