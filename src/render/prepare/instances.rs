//! Meshes in their places: by which numbers kernels place them, and what their triangles are where they are flattened.
//!
//! What a kernel computes of a triangle in its place, its corners and its normals, is computed here by the same operations in
//! the same order, so that an image is the same to the last bit whether meshes are flattened or not.

use std::ops::Range;

use glam::{DVec3, Vec2, Vec3};

use super::pack::{decode_normal, pack_colours, pack_coordinates, pack_normals};
use super::space::{Normalisation, normal_or_zero};
use crate::layout::{Instance, Normals};
use crate::scene::{Mesh, PlacedMesh, Placement, Scene};

/// Triangles of a scene in one list, and how they are placed.
pub(super) struct Soup {
    /// Their corners: in normalised space or, of a mesh that is placed, in the mesh's own.
    pub corners: Vec<[Vec3; 3]>,
    /// Their materials.
    pub materials: Vec<u32>,
    /// Ranges of the list and how each is placed. A range may be placed again and again. The world's own triangles are first.
    pub parts: Vec<Part>,
    /// The number in the list of the first triangle of each instance, by the number of the instance: 0 is the world, then
    /// come placements.
    pub firsts: Vec<u32>,
    /// What else they have.
    pub attributes: Attributes,
}

/// What triangles have beside corners and materials, as far as it is wanted.
#[derive(Debug, Clone, Default)]
pub(super) struct Attributes {
    pub normals: Vec<Normals>,
    /// Texture coordinates, three a triangle.
    pub coordinates: Vec<Vec2>,
    /// Colours of vertices, three a triangle.
    pub colours: Vec<[u32; 2]>,
}

impl Attributes {
    fn of(mesh: &Mesh, wanted: Wanted) -> Self {
        Self {
            normals: if wanted.normals { pack_normals(mesh) } else { Vec::new() },
            coordinates: if wanted.coordinates { pack_coordinates(mesh) } else { Vec::new() },
            colours: if wanted.colours { pack_colours(mesh) } else { Vec::new() },
        }
    }

    fn extend(&mut self, others: &Self) {
        self.normals.extend(&others.normals);
        self.coordinates.extend(&others.coordinates);
        self.colours.extend(&others.colours);
    }

    /// Adds those of a mesh in its place.
    fn extend_placed(&mut self, mesh: &Self, instance: &Instance) {
        let normals = mesh.normals.iter().map(|normals| Normals {
            corners: match normals.present {
                0 => normals.corners,
                _ => instance.place_corners(normals.corners, |bits| placed_normal(instance, bits)),
            },
            ..*normals
        });
        self.normals.extend(normals);
        let coordinates = mesh.coordinates.as_chunks::<3>().0.iter();
        self.coordinates.extend(coordinates.flat_map(|corners| instance.place_corners(*corners, |uv| uv)));
        let colours = mesh.colours.as_chunks::<3>().0.iter();
        self.colours.extend(colours.flat_map(|corners| instance.place_corners(*corners, |colour| colour)));
    }
}

/// Triangles of a mesh, and where they are.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub range: Range<usize>,
    pub instances: Vec<Instance>,
}

/// What of a soup is wanted beside corners and materials.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    pub normals: bool,
    pub coordinates: bool,
    pub colours: bool,
}

impl Soup {
    /// Every triangle in normalised space.
    pub(super) fn flattened(scene: &Scene, normalisation: &Normalisation, wanted: Wanted) -> Self {
        let mut soup = Self::of_world(scene, normalisation, wanted);
        for placed in &scene.placed {
            let mesh = OwnMesh::of(placed, wanted);
            for placement in &placed.placements {
                let instance = mesh.instance(placement, normalisation);
                soup.firsts.push(soup.corners.len() as u32);
                soup.materials.extend(mesh.mesh.triangles.iter().map(|triangle| triangle.material));
                let place = |corner: Vec3| Vec3::from(instance.place(corner.to_array()));
                soup.corners.extend(mesh.corners.iter().map(|corners| instance.place_corners(*corners, place)));
                soup.attributes.extend_placed(&mesh.attributes, &instance);
            }
        }
        soup.parts = vec![Part { range: 0..soup.corners.len(), instances: vec![Instance::WORLD] }];
        soup
    }

    /// The triangles of each mesh once.
    pub(super) fn by_meshes(scene: &Scene, normalisation: &Normalisation, wanted: Wanted) -> Self {
        let mut soup = Self::of_world(scene, normalisation, wanted);
        for placed in &scene.placed {
            let mesh = OwnMesh::of(placed, wanted);
            let first = soup.corners.len();
            soup.materials.extend(mesh.mesh.triangles.iter().map(|triangle| triangle.material));
            soup.corners.extend(&mesh.corners);
            soup.attributes.extend(&mesh.attributes);
            let instances = placed.placements.iter().map(|placement| mesh.instance(placement, normalisation));
            soup.firsts.extend(placed.placements.iter().map(|_| first as u32));
            soup.parts.push(Part { range: first..soup.corners.len(), instances: instances.collect() });
        }
        soup
    }

    /// The triangles of the world itself.
    fn of_world(scene: &Scene, normalisation: &Normalisation, wanted: Wanted) -> Self {
        let mesh = &scene.mesh;
        // As kernels place what is in the world.
        let placed =
            |point: Vec3| if scene.placed.is_empty() { point } else { Instance::WORLD.place(point.into()).into() };
        let point = |p: &DVec3| placed(normal_or_zero(normalisation.point(*p).as_vec3()));
        let points: Vec<Vec3> = mesh.positions.iter().map(point).collect();
        let corners: Vec<[Vec3; 3]> = mesh.triangles.iter().map(|t| t.positions.map(|i| points[i as usize])).collect();
        Self {
            parts: vec![Part { range: 0..corners.len(), instances: vec![Instance::WORLD] }],
            firsts: vec![0],
            materials: mesh.triangles.iter().map(|triangle| triangle.material).collect(),
            attributes: Attributes::of(mesh, wanted),
            corners,
        }
    }

    /// The triangles that may touch a box about `point`, in normalised space and in the scene's order: all but those of
    /// meshes that are placed elsewhere.
    pub(super) fn near(&self, point: DVec3) -> impl Iterator<Item = [Vec3; 3]> {
        /// More than any rounding moves a mesh.
        const MARGIN: f64 = 1e-4;
        let is_near = move |instance: &&Instance| {
            let radius = |i: usize| {
                [instance.x_axis[i], instance.y_axis[i], instance.z_axis[i]]
                    .iter()
                    .map(|x| f64::from(x.abs()))
                    .sum::<f64>()
            };
            let near = |i: usize| {
                (point[i] - f64::from(instance.translation[i])).abs()
                    <= radius(i) + MARGIN * (1.0 + point.abs().max_element())
            };
            **instance == Instance::WORLD || (0..3).all(near)
        };
        self.parts.iter().flat_map(move |part| {
            part.instances.iter().filter(is_near).flat_map(move |instance| {
                let place = |corner: Vec3| Vec3::from(instance.place(corner.to_array()));
                self.corners[part.range.clone()].iter().map(move |corners| instance.place_corners(*corners, place))
            })
        })
    }
}

/// A mesh that is placed, in a space of its own in which it fits [-1, 1]³.
struct OwnMesh<'a> {
    mesh: &'a Mesh,
    /// Middle of its bounds, and lengths of this space of a unit of its coordinates, a power of two.
    centre: DVec3,
    scale: f64,
    corners: Vec<[Vec3; 3]>,
    attributes: Attributes,
}

impl<'a> OwnMesh<'a> {
    fn of(placed: &'a PlacedMesh, wanted: Wanted) -> Self {
        let mesh = &placed.mesh;
        let Normalisation { centre, scale } = Normalisation::of_bounds(mesh.bounds());
        let points: Vec<Vec3> =
            mesh.positions.iter().map(|p| without_dust(((*p - centre) * scale).as_vec3(), DUST)).collect();
        Self {
            mesh,
            centre,
            scale,
            corners: mesh.triangles.iter().map(|t| t.positions.map(|i| points[i as usize])).collect(),
            attributes: Attributes::of(mesh, wanted),
        }
    }

    /// The mesh in its place.
    fn instance(&self, placement: &Placement, normalisation: &Normalisation) -> Instance {
        let map = placement.map.matrix3 * (normalisation.scale / self.scale);
        let axis = |axis: DVec3| without_dust(axis.as_vec3(), DUST).to_array();
        let translation = normalisation.point(placement.map.transform_point3(self.centre)).as_vec3();
        let of_normals = placement.of_normals();
        let largest = of_normals.to_cols_array().iter().fold(0.0_f64, |most, entry| most.max(entry.abs()));
        let column = |column: DVec3| without_dust((column / largest).as_vec3(), DUST).extend(0.0).to_array();
        Instance {
            x_axis: axis(map.x_axis),
            y_axis: axis(map.y_axis),
            z_axis: axis(map.z_axis),
            is_mirrored: u32::from(placement.is_mirrored),
            translation: without_dust(translation, DUST * DUST).to_array(),
            of_normals: [of_normals.x_axis, of_normals.y_axis, of_normals.z_axis].map(column),
            ..Instance::WORLD
        }
    }
}

/// What is smaller counts as zero, so that no product of two such numbers, and no difference of such products, is subnormal:
/// devices differ in what these are. Nobody sees a trillionth of a mesh.
const DUST: f32 = 1.0 / (1_u64 << 40) as f32;

fn without_dust(v: Vec3, least: f32) -> Vec3 {
    Vec3::from_array(v.to_array().map(|x| if x.abs() < least { 0.0 } else { x }))
}

/// A normal of a mesh in normalised space, both encoded. As in `records.glsl`.
fn placed_normal(instance: &Instance, bits: u32) -> u32 {
    let n = decode_normal(bits);
    let [x, y, z] = instance.of_normals.map(|[x, y, z, _]| Vec3::new(x, y, z));
    let n = x * n.x + y * n.y + z * n.z;
    let n = n / (n.x.abs() + n.y.abs() + n.z.abs());
    let away = |x: f32, y: f32| if x >= 0.0 { 1.0 - y.abs() } else { y.abs() - 1.0 };
    let (x, y) = if n.z >= 0.0 { (n.x, n.y) } else { (away(n.x, n.y), away(n.y, n.x)) };
    let snorm = |x: f32| (x.clamp(-1.0, 1.0) * 32767.0 + 0.5).floor() as i32 as u32 & 0xffff;
    snorm(x) | snorm(y) << 16
}
