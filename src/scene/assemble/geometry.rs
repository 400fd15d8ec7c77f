//! Instances to triangles in the world, and which triangles are worth keeping.

use std::mem;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::materials::Materials;
use crate::scene::{
    Mesh, NONE, PlacedMesh, Placement, Triangle,
    error::{Location, SceneError},
    import::{self, FARTHEST, Instance},
    sources::Sources,
    transform::Transform,
};

/// What triangles of an imported mesh become in the scene.
pub(super) struct Dressing {
    /// Of each described material, without texture coordinates and with them: what was made of it, and whether it needs them.
    made: Vec<[Option<(u32, bool)>; 2]>,
    /// Whether vertices of some triangle have a colour.
    is_coloured: bool,
}

impl Dressing {
    /// Makes the materials of a mesh.
    pub(super) fn of(
        imported: &import::Mesh,
        materials: &mut Materials,
        sources: &mut Sources,
    ) -> Result<Self, SceneError> {
        let mut made: Vec<[Option<(u32, bool)>; 2]> = Vec::new();
        for triangle in &imported.triangles {
            let (described, has_uvs) = (triangle.material as usize, triangle.uvs[0] != NONE);
            made.resize(made.len().max(described + 1), [None; 2]);
            let made = &mut made[described][usize::from(has_uvs)];
            if made.is_none() {
                let material = materials.index(triangle.material, has_uvs, &imported.location, sources)?;
                *made = Some((material, has_uvs && materials.needs_coordinates(material)));
            }
        }

        let is_coloured = |triangle: &Triangle| triangle.positions.iter().any(|index| !imported.is_white(*index));
        Ok(Self { made, is_coloured: imported.triangles.par_iter().any(is_coloured) })
    }

    /// Whether some material needs texture coordinates.
    fn needs_uvs(&self) -> bool {
        self.made.iter().flatten().flatten().any(|(_, needs_uvs)| *needs_uvs)
    }

    /// A triangle with its material, its normals by their new indices, and its other indices moved on.
    fn dressed(&self, triangle: &Triangle, first_position: u32, normals: &[u32], first_uv: u32) -> Triangle {
        let (material, needs_uvs) =
            self.made[triangle.material as usize][usize::from(triangle.uvs[0] != NONE)].unwrap_or_default();
        let positions = triangle.positions.map(|index| first_position + index);
        let mut dressed = Triangle { positions, normals: [NONE; 3], uvs: [NONE; 3], material };
        if triangle.normals[0] != NONE {
            let corners = triangle.normals.map(|index| normals[index as usize]);
            if !corners.contains(&NONE) {
                dressed.normals = corners;
            }
        }
        if needs_uvs {
            dressed.uvs = triangle.uvs.map(|index| first_uv + index);
        }
        dressed
    }
}

impl PlacedMesh {
    /// Triangles beyond those of the first placement from which on a mesh stays placed. Fewer take little memory, and corners
    /// that meet those of other meshes are rounded as these are.
    const FEWEST: usize = 64;

    /// Takes from `instances` the placements of a mesh that is to stay placed; leaves the others, and singular ones, which
    /// rays cannot be taken through.
    pub(super) fn placements(imported: &import::Mesh, instances: &mut Vec<Instance>) -> Vec<Placement> {
        let (placed, rest): (Vec<Instance>, _) = instances.iter().partition(|instance| can_be_inverted(instance));
        if placed.len().saturating_sub(1).saturating_mul(imported.triangles.len()) < Self::FEWEST {
            return Vec::new();
        }
        *instances = rest;
        placed
            .into_iter()
            .map(|Instance { transform, is_mirrored, .. }| Placement { map: transform.map(), is_mirrored })
            .collect()
    }

    /// A mesh that stays placed. Returns how many of the scene's triangles were left out because they have no area.
    pub(super) fn of(
        imported: import::Mesh,
        dressing: &Dressing,
        placements: Vec<Placement>,
    ) -> Result<(Self, usize), SceneError> {
        let import::Mesh { location, positions, normals, uvs, colours, triangles } = imported;
        let colours = if dressing.is_coloured { colours } else { Vec::new() };
        let mut mesh = Mesh { positions, colours, ..Mesh::default() };
        let mut places = Vec::with_capacity(normals.len());
        for normal in normals {
            let unit = Transform::IDENTITY.normal(normal);
            places.push(unit.map_or(NONE, |_| mesh.normals.len() as u32));
            mesh.normals.extend(unit);
        }
        if dressing.needs_uvs() {
            mesh.uvs = uvs;
        }
        let count = triangles.len();
        mesh.triangles = triangles
            .into_par_iter()
            .filter(|triangle| {
                let [a, b, c] = triangle.positions.map(|index| mesh.positions[index as usize]);
                !is_degenerate(a, b, c)
            })
            .map(|triangle| dressing.dressed(&triangle, 0, &places, 0))
            .collect();
        let without_area = (count - mesh.triangles.len()) * placements.len();
        let placed = Self { mesh, placements };
        if !placed.mesh.triangles.is_empty() {
            let (low, high) = placed.bounds();
            let is_near = |point: DVec3| point.abs().cmple(DVec3::splat(FARTHEST)).all();
            if !(is_near(low) && is_near(high)) {
                return Err(too_far(&location));
            }
        }
        Ok((placed, without_area))
    }
}

/// Whether a ray can be taken to the mesh's own coordinates with some digits left.
fn can_be_inverted(instance: &Instance) -> bool {
    const WORST_CONDITION: f64 = 1e6;
    let map = instance.transform.map().matrix3;
    let norm = |map: DMat3| map.to_cols_array().iter().map(|entry| entry * entry).sum::<f64>().sqrt();
    // NaN cannot.
    norm(map) * norm(map.inverse()) <= WORST_CONDITION
}

fn too_far(location: &Location) -> SceneError {
    location.refuse(format!("a vertex lands beyond {FARTHEST:e}; scale the mesh down"))
}

impl Mesh {
    /// Adds the triangles of `imported` that have an area, once for each transform. Returns how many
    /// were left out because they have none. Texture coordinates come along where a material has an image.
    pub(super) fn add_instances(
        &mut self,
        mut imported: import::Mesh,
        dressing: &Dressing,
        instances: &[Instance],
    ) -> Result<usize, SceneError> {
        // Before memory is taken for so many.
        let with = |known: usize, own: usize| own.checked_mul(instances.len()).and_then(|own| own.checked_add(known));
        let counts = [
            with(self.positions.len(), imported.positions.len()),
            with(self.normals.len(), imported.normals.len()),
            with(self.triangles.len(), imported.triangles.len()),
            self.uvs.len().checked_add(imported.uvs.len()),
        ];
        if counts.iter().any(|count| count.is_none_or(|count| count >= NONE as usize)) {
            let problem = "more vertices or triangles than 32-bit indices reach; use smaller meshes";
            return Err(imported.location.refuse(problem));
        }

        // Texture coordinates are the same for all instances.
        let first_uv = self.uvs.len();
        if dressing.needs_uvs() {
            self.uvs.extend(&imported.uvs);
        }
        let mut without_area = 0;
        let mut rest = instances;
        while let [Instance { transform, is_mirrored, .. }, others @ ..] = rest {
            rest = others;
            // The last instance has the vertices and triangles themselves: of large meshes there is mostly one.
            let is_last = rest.is_empty();
            let first_position = self.positions.len();
            if dressing.is_coloured {
                self.add_colours(&imported.colours);
            }
            let mut points = if is_last { mem::take(&mut imported.positions) } else { imported.positions.clone() };
            points.par_iter_mut().for_each(|point| *point = transform.point(*point));
            // Written so that NaN is too far as well.
            let is_near = |point: &DVec3| point.abs().cmple(DVec3::splat(FARTHEST)).all();
            if !points.par_iter().all(is_near) {
                return Err(too_far(&imported.location));
            }
            // The new index of each normal, NONE where it is no direction.
            let mut normals = Vec::with_capacity(imported.normals.len());
            for &normal in &imported.normals {
                let normal = transform.normal(normal);
                normals.push(normal.map_or(NONE, |_| self.normals.len() as u32));
                self.normals.extend(normal);
            }
            let has_area = |triangle: &Triangle| {
                let [a, b, c] = triangle.positions.map(|index| points[index as usize]);
                !is_degenerate(a, b, c)
            };
            let mut triangles = if is_last { mem::take(&mut imported.triangles) } else { imported.triangles.clone() };
            let place = |triangle: &mut Triangle| {
                let has_area = has_area(triangle);
                *triangle = dressing.dressed(triangle, first_position as u32, &normals, first_uv as u32);
                if *is_mirrored {
                    triangle.mirror();
                }
                // Marks what goes.
                triangle.material = if has_area { triangle.material } else { NONE };
                usize::from(!has_area)
            };
            let count: usize = triangles.par_iter_mut().map(place).sum();
            if count > 0 {
                triangles.retain(|triangle| triangle.material != NONE);
            }
            without_area += count;
            append(&mut self.positions, points);
            append(&mut self.triangles, triangles);
        }
        Ok(without_area)
    }
}

/// Adds to a list what a large one need not be copied for.
fn append<T>(list: &mut Vec<T>, mut more: Vec<T>) {
    match list.is_empty() {
        true => *list = more,
        false => list.append(&mut more),
    }
}

/// Whether three points span no area that a ray could hit or a light could be sampled on. The
/// threshold is what rounding leaves of the cross product of points on a line.
fn is_degenerate(a: DVec3, b: DVec3, c: DVec3) -> bool {
    const ROUNDING: f64 = 1e-14;
    let [ab, ac, bc] = [b - a, c - a, c - b];
    let longest = ab.length_squared().max(ac.length_squared()).max(bc.length_squared());
    ab.cross(ac).length() <= ROUNDING * longest
}
