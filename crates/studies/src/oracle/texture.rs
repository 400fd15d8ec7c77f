//! Images on surfaces.

use glam::{DAffine2, DVec2, DVec3, Vec3};
use raywave::scene::{Material, Parameter, Scene, Texture, Wrap};

/// Where the first texture coordinate grows on a triangle, unit; zero where it does not. Both are given by their changes
/// along two edges.
pub fn growth(edges: [DVec3; 2], uvs: [DVec2; 2]) -> DVec3 {
    let determinant = uvs[0].perp_dot(uvs[1]);
    if determinant == 0.0 {
        return DVec3::ZERO;
    }
    ((uvs[1].y * edges[0] - uvs[0].y * edges[1]) / determinant).normalize_or_zero()
}

/// A material with what its images give at texture coordinates.
pub fn looked_up(scene: &Scene, material: &Material, uv: DVec2) -> Material {
    let mut shown = Material { textures: [None; Parameter::COUNT], ..material.clone() };
    for parameter in Parameter::ALL {
        let Some(index) = material.texture(parameter) else { continue };
        let value = at(&scene.textures[index as usize], uv);
        let number = value.x;
        match parameter {
            Parameter::Diffuse => shown.diffuse = value,
            Parameter::Specular => shown.specular = value,
            Parameter::Roughness => {
                shown.roughness.x = number;
                if material.texture(Parameter::RoughnessAcross).is_none() {
                    shown.roughness.y = number;
                }
            }
            Parameter::RoughnessAcross => shown.roughness.y = number,
            Parameter::Metalness => shown.metalness = number,
            Parameter::Weight => shown.weight = number,
            Parameter::Coat => shown.coat = number,
            Parameter::Anisotropy => shown.principled.anisotropy = number,
            Parameter::Sheen => shown.principled.sheen = number,
            Parameter::SheenTint => shown.principled.sheen_tint = number,
            Parameter::SpecularTint => shown.principled.specular_tint = number,
            Parameter::SpecularShare => shown.principled.specular_share = number,
            Parameter::Flatness => shown.principled.flatness = number,
            Parameter::DiffuseTransmission => shown.principled.diffuse_transmission = number,
            Parameter::Normal | Parameter::Height | Parameter::Emission => {}
        }
    }
    shown
}

/// What an image gives at texture coordinates: texel centres at (i + ½)/n, row 0 at the top, v = 1.
fn at(texture: &Texture, uv: DVec2) -> Vec3 {
    let lookup = texture.lookup;
    let affine =
        DAffine2::from_mat2_translation(lookup.transform.matrix2.as_dmat2(), lookup.transform.translation.as_dvec2());
    let uv = affine.transform_point2(uv);
    let place = DVec2::new(uv.x * f64::from(texture.width), (1.0 - uv.y) * f64::from(texture.height));
    let texel = |x: f64, y: f64| {
        let within = |at: f64, size: u32| {
            let (at, size) = (at as i64, i64::from(size));
            let at = match lookup.wrap {
                Wrap::Repeat => at.rem_euclid(size),
                Wrap::Clamp => at.clamp(0, size - 1),
                Wrap::Mirror => {
                    let at = at.rem_euclid(2 * size);
                    at.min(2 * size - 1 - at)
                }
            };
            at as usize
        };
        let [r, g, b, _] =
            texture.texels[within(y, texture.height) * texture.width as usize + within(x, texture.width)];
        Vec3::new(r.to_f32(), g.to_f32(), b.to_f32())
    };
    if !lookup.is_smooth {
        let corner = place.floor();
        return texel(corner.x, corner.y);
    }
    let (corner, between) = ((place - 0.5).floor(), (place - 0.5) - (place - 0.5).floor());
    let row = |y: f64| texel(corner.x, y).lerp(texel(corner.x + 1.0, y), between.x as f32);
    row(corner.y).lerp(row(corner.y + 1.0), between.y as f32)
}
