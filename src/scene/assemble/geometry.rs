//! Instances to triangles in the world, and which triangles are worth keeping.

use std::mem;

use glam::DVec3;
use rayon::prelude::*;

use super::materials::Materials;
use crate::scene::{
    Mesh, NONE, Triangle,
    error::SceneError,
    import::{self, FARTHEST, Instance},
    sources::{Sources, Warning},
};

impl Mesh {
    /// Adds the triangles of `imported` that have an area, once for each transform. Returns how many
    /// were left out because they have none. Texture coordinates come along where a material has an image.
    pub(super) fn add_instances(
        &mut self,
        mut imported: import::Mesh,
        instances: &[Instance],
        materials: &mut Materials,
        sources: &mut Sources,
    ) -> Result<usize, SceneError> {
        // Of each described material, without texture coordinates and with them: what was made of it, and whether it needs them.
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
        if imported.triangles.par_iter().any(is_coloured) {
            let text = "colours of vertices are not shown; give the material an image".to_owned();
            sources.note(&Warning { kind: "vertex colours", location: imported.location.clone(), text });
        }

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
        if made.iter().flatten().flatten().any(|(_, needs_uvs)| *needs_uvs) {
            self.uvs.extend(&imported.uvs);
        }
        let mut without_area = 0;
        let mut rest = instances;
        while let [Instance { transform, is_mirrored, .. }, others @ ..] = rest {
            rest = others;
            // The last instance has the vertices and triangles themselves: of large meshes there is mostly one.
            let is_last = rest.is_empty();
            let first_position = self.positions.len();
            let mut points = if is_last { mem::take(&mut imported.positions) } else { imported.positions.clone() };
            points.par_iter_mut().for_each(|point| *point = transform.point(*point));
            // Written so that NaN is too far as well.
            let is_near = |point: &DVec3| point.abs().cmple(DVec3::splat(FARTHEST)).all();
            if !points.par_iter().all(is_near) {
                let problem = format!("a vertex lands beyond {FARTHEST:e}; scale the mesh down");
                return Err(imported.location.refuse(problem));
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
            let place = |triangle: &Triangle| {
                let (material, needs_uvs) =
                    made[triangle.material as usize][usize::from(triangle.uvs[0] != NONE)].unwrap_or_default();
                let positions = triangle.positions.map(|index| first_position as u32 + index);
                let mut placed = Triangle { positions, normals: [NONE; 3], uvs: [NONE; 3], material };
                if triangle.normals[0] != NONE {
                    let corners = triangle.normals.map(|index| normals[index as usize]);
                    if !corners.contains(&NONE) {
                        placed.normals = corners;
                    }
                }
                if needs_uvs {
                    placed.uvs = triangle.uvs.map(|index| first_uv as u32 + index);
                }
                if *is_mirrored {
                    placed.positions.swap(1, 2);
                    placed.normals.swap(1, 2);
                    placed.uvs.swap(1, 2);
                }
                placed
            };
            let mut triangles = if is_last { mem::take(&mut imported.triangles) } else { imported.triangles.clone() };
            let place = |triangle: &mut Triangle| {
                let has_area = has_area(triangle);
                *triangle = place(triangle);
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
