//! The transform that places a mesh in the world.

use glam::{DAffine3, DMat3, DVec3, Vec3};

/// What takes normals along with a linear map, to any length: its inverse transposed, times the size of its determinant. It
/// is there for singular maps too.
pub(super) fn cofactors(map: DMat3) -> DMat3 {
    let DMat3 { x_axis: x, y_axis: y, z_axis: z } = map;
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    if map.determinant() < 0.0 { -cofactors } else { cofactors }
}

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
        let of_normals = cofactors(map.matrix3);
        Self { scale: DVec3::ONE, linear: map.matrix3, of_normals, translation: map.translation }
    }

    /// This one after another.
    pub fn after(&self, inner: &Self) -> Self {
        let is_identity =
            inner.scale == DVec3::ONE && inner.linear == DMat3::IDENTITY && inner.translation == DVec3::ZERO;
        // What is not moved twice is not rounded twice.
        if is_identity { *self } else { Self::affine(self.map() * inner.map()) }
    }

    /// The same as one map.
    pub fn map(&self) -> DAffine3 {
        DAffine3 { matrix3: self.linear * DMat3::from_diagonal(self.scale), translation: self.translation }
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
