//! The transform that places a mesh in the world.

use glam::{DMat3, DVec3, Vec3};

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

    /// A point in the world.
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.rotation * (point * self.scale) + self.translation
    }

    /// A unit normal in the world, or `None` where the given one is zero or not finite.
    pub fn normal(&self, normal: DVec3) -> Option<Vec3> {
        let normal = self.rotation * (normal / self.scale);
        // Normalising twice keeps tiny and huge normals, whose squared length leaves the range.
        let normal = (normal / normal.abs().max_element()).normalize();
        normal.is_finite().then(|| normal.as_vec3())
    }
}
