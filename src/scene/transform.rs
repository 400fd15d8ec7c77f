//! The transform that places a mesh in the world.

use glam::{DAffine3, DMat3, DVec3, Vec3};

/// Scale, then a linear map, as a rotation about x, y and z, then translation.
///
/// Corners keep their order, so a scale with a negative product turns a mesh inside out: its
/// front, the side that emits and that refraction takes for the outside, faces the other way.
#[derive(Debug, Clone, Copy)]
pub(super) struct Transform {
    /// No component is zero.
    scale: DVec3,
    linear: DMat3,
    /// What takes normals along with `linear`, to any length.
    of_normals: DMat3,
    translation: DVec3,
}

impl Transform {
    pub const IDENTITY: Self =
        Self { scale: DVec3::ONE, linear: DMat3::IDENTITY, of_normals: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// Any affine map.
    pub fn affine(map: DAffine3) -> Self {
        let DMat3 { x_axis: x, y_axis: y, z_axis: z } = map.matrix3;
        // The inverse transposed, times the determinant: it is there for singular maps too.
        let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
        let of_normals = if map.matrix3.determinant() < 0.0 { -cofactors } else { cofactors };
        Self { scale: DVec3::ONE, linear: map.matrix3, of_normals, translation: map.translation }
    }

    /// `scale` has no zero in it; angles are in degrees.
    pub fn new(scale: DVec3, degrees: DVec3, translation: DVec3) -> Self {
        let [x, y, z] = degrees.to_array().map(f64::to_radians);
        let rotation = DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x);
        Self { scale, linear: rotation, of_normals: rotation, translation }
    }

    /// A point in the world.
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.linear * (point * self.scale) + self.translation
    }

    /// A unit normal in the world, or `None` where the given one is zero or not finite.
    pub fn normal(&self, normal: DVec3) -> Option<Vec3> {
        let normal = self.of_normals * (normal / self.scale);
        // Normalising twice keeps tiny and huge normals, whose squared length leaves the range.
        let normal = (normal / normal.abs().max_element()).normalize();
        normal.is_finite().then(|| normal.as_vec3())
    }
}
