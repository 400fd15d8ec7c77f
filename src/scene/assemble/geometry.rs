//! Instances to triangles in the world, and which triangles are worth keeping.

use glam::DVec3;

use super::materials::Materials;
use crate::scene::{
    Mesh, NONE, Triangle,
    error::SceneError,
    import::{self, FARTHEST, Instance},
    sources::Sources,
};

impl Mesh {
    /// Adds the triangles of `imported` that have an area, once for each transform. Returns how many
    /// were left out because they have none. Texture coordinates come along where a material has an image.
    pub(super) fn add_instances<'a>(
        &mut self,
        imported: &import::Mesh,
        instances: impl Iterator<Item = &'a Instance>,
        materials: &mut Materials,
        sources: &mut Sources,
    ) -> Result<usize, SceneError> {
        let material_of = |triangle: &Triangle| {
            let has_uvs = triangle.uvs[0] != NONE;
            materials.index(triangle.material, has_uvs, &imported.location, sources)
        };
        let triangle_materials: Vec<u32> = imported.triangles.iter().map(material_of).collect::<Result<_, _>>()?;

        // Texture coordinates are the same for all instances.
        let first_uv = self.uvs.len();
        if triangle_materials.iter().any(|&material| materials.needs_coordinates(material)) {
            self.uvs.extend(&imported.uvs);
        }
        let mut without_area = 0;
        for Instance { transform, is_mirrored, .. } in instances {
            let first_position = self.positions.len();
            for &point in &imported.positions {
                let point = transform.point(point);
                // Written so that NaN is too far as well.
                if !point.abs().cmple(DVec3::splat(FARTHEST)).all() {
                    let problem = format!("a vertex lands beyond {FARTHEST:e}; scale the mesh down");
                    return Err(imported.location.refuse(problem));
                }
                self.positions.push(point);
            }
            // The new index of each normal, NONE where it is no direction.
            let mut normals = Vec::with_capacity(imported.normals.len());
            for &normal in &imported.normals {
                let normal = transform.normal(normal);
                normals.push(normal.map_or(NONE, |_| self.normals.len() as u32));
                self.normals.extend(normal);
            }
            let triangles = self.triangles.len() + imported.triangles.len();
            let counts = [self.positions.len(), self.normals.len(), self.uvs.len(), triangles];
            if counts.iter().any(|&count| count >= NONE as usize) {
                let problem = "more vertices or triangles than 32-bit indices reach; use smaller meshes";
                return Err(imported.location.refuse(problem));
            }

            for (triangle, &material) in imported.triangles.iter().zip(&triangle_materials) {
                let positions = triangle.positions.map(|index| first_position as u32 + index);
                let [a, b, c] = positions.map(|index| self.positions[index as usize]);
                if is_degenerate(a, b, c) {
                    without_area += 1;
                    continue;
                }
                let mut placed = Triangle { positions, normals: [NONE; 3], uvs: [NONE; 3], material };
                if triangle.normals[0] != NONE {
                    let corners = triangle.normals.map(|index| normals[index as usize]);
                    if !corners.contains(&NONE) {
                        placed.normals = corners;
                    }
                }
                if materials.needs_coordinates(material) && triangle.uvs[0] != NONE {
                    placed.uvs = triangle.uvs.map(|index| first_uv as u32 + index);
                }
                if *is_mirrored {
                    placed.positions.swap(1, 2);
                    placed.normals.swap(1, 2);
                    placed.uvs.swap(1, 2);
                }
                self.triangles.push(placed);
            }
        }
        Ok(without_area)
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
