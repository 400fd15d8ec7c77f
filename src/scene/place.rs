//! Meshes placed in the world: transforms, normals, and which triangles are worth keeping.

use glam::{DMat3, DVec3, Vec2, Vec3};

use super::{Mesh, NONE, Triangle, obj::Run};

/// Coordinates beyond this, world units, are refused, so that no area or distance overflows.
pub(super) const FARTHEST: f64 = 1e30;

/// Scale, then rotation about x, y and z, then translation.
///
/// Corners keep their order, so a scale with a negative product turns a mesh inside out: its
/// front, the side that emits and that refraction takes for the outside, faces the other way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Transform {
    /// No component is zero.
    scale: DVec3,
    rotation: DMat3,
    translation: DVec3,
}

impl Transform {
    pub const IDENTITY: Self = Self { scale: DVec3::ONE, rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// `scale` has no zero in it; angles are in degrees.
    pub fn new(scale: DVec3, degrees: DVec3, translation: DVec3) -> Self {
        let [x, y, z] = degrees.to_array().map(f64::to_radians);
        Self {
            scale,
            rotation: DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x),
            translation,
        }
    }

    fn point(&self, point: DVec3) -> DVec3 {
        self.rotation * (point * self.scale) + self.translation
    }

    /// A unit normal, or `None` where the given one is zero or not finite.
    fn normal(&self, normal: DVec3) -> Option<Vec3> {
        let normal = self.rotation * (normal / self.scale);
        // Normalising twice keeps tiny and huge normals, whose squared length leaves the range.
        let normal = (normal / normal.abs().max_element()).normalize();
        normal.is_finite().then(|| normal.as_vec3())
    }
}

/// Why a mesh cannot be placed.
#[derive(Debug)]
pub(super) enum Misplaced {
    /// A vertex lands beyond [`FARTHEST`].
    TooFar,
    /// More of something than 32-bit indices reach.
    TooMany(&'static str),
}

impl Mesh {
    /// Adds the triangles of `run` that have an area and returns how many have none. Texture
    /// coordinates come along only where the material wants them, and then the run has them.
    pub(super) fn place(
        &mut self,
        run: &Run,
        transform: &Transform,
        material: u32,
        wants_uvs: bool,
    ) -> Result<usize, Misplaced> {
        let first_position = self.positions.len();
        for &point in chunks(&run.mesh.positions) {
            let point = transform.point(DVec3::from(point));
            // Written so that what is not a number is too far as well.
            if !point.abs().cmple(DVec3::splat(FARTHEST)).all() {
                return Err(Misplaced::TooFar);
            }
            self.positions.push(point);
        }
        let first_uv = self.uvs.len();
        if wants_uvs {
            let uvs = chunks(&run.mesh.texcoords).iter();
            self.uvs.extend(uvs.map(|&[u, v]| Vec2::new(u as f32, v as f32)));
        }
        // The new index of each normal, NONE where it is no direction.
        let mut normals = Vec::new();
        if run.has_normals {
            for &normal in chunks(&run.mesh.normals) {
                let normal = transform.normal(DVec3::from(normal));
                normals.push(normal.map_or(NONE, |_| self.normals.len() as u32));
                self.normals.extend(normal);
            }
        }
        let counts = [self.positions.len(), self.normals.len(), self.uvs.len()];
        if counts.iter().any(|&count| count >= NONE as usize) {
            return Err(Misplaced::TooMany("vertices"));
        }

        let mut without_area = 0;
        for (index, &corners) in chunks(&run.mesh.indices).iter().enumerate() {
            let of_corners = |indices: &[u32]| [0, 1, 2].map(|k| indices[3 * index + k]);
            let positions = corners.map(|corner| first_position as u32 + corner);
            let [a, b, c] = positions.map(|position| self.positions[position as usize]);
            if is_degenerate(a, b, c) {
                without_area += 1;
                continue;
            }
            let mut triangle = Triangle { positions, normals: [NONE; 3], uvs: [NONE; 3], material };
            if run.has_normals {
                let given = of_corners(&run.mesh.normal_indices);
                let placed = given.map(|normal| normals[normal as usize]);
                if !placed.contains(&NONE) {
                    triangle.normals = placed;
                }
            }
            if wants_uvs {
                triangle.uvs = of_corners(&run.mesh.texcoord_indices).map(|uv| first_uv as u32 + uv);
            }
            self.triangles.push(triangle);
        }
        match self.triangles.len() < NONE as usize {
            true => Ok(without_area),
            false => Err(Misplaced::TooMany("triangles")),
        }
    }
}

fn chunks<T, const N: usize>(flat: &[T]) -> &[[T; N]] {
    flat.as_chunks().0
}

/// Whether three points span no area that a ray could hit or a light could be sampled on. The
/// threshold is what rounding leaves of the cross product of points on a line.
fn is_degenerate(a: DVec3, b: DVec3, c: DVec3) -> bool {
    const ROUNDING: f64 = 1e-14;
    let [ab, ac, bc] = [b - a, c - a, c - b];
    let longest = ab.length_squared().max(ac.length_squared()).max(bc.length_squared());
    ab.cross(ac).length() <= ROUNDING * longest
}
