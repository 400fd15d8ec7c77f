//! Materials, normals, texture coordinates and images in the layouts of the GPU.

use std::collections::HashMap;

use glam::{DVec3, Vec2, Vec3};
use half::f16;

use super::features::bsdf_of;
use super::lights::brightness;
use super::microfacets::{Tables, inner_reflectance, mean_reflectance};
use super::space::{Normalisation, scaled, strength};
use crate::alias::alias_table;
use crate::constants::*;
use crate::layout::{Material, MaterialDetail, Normals, PunctualLight};
use crate::scene::{self, Falloff, Light, Lookup, Parameter, SMOOTH, Scene, Surface, Wrap};

/// Largest Phong exponent of the kernels. Such a lobe is a millionth of a radian wide, about as wide as the rounding of a
/// direction: a larger exponent would show nothing but that.
const MAX_EXPONENT: f32 = 1e12;

/// The words of a material. `headers` has the places of textures.
pub(super) fn pack_material(material: &scene::Material, headers: &[u32], radiance_scale: f64) -> Material {
    Material {
        kd: material.diffuse.to_array(),
        surface: bsdf_of(material),
        ks: material.specular.to_array(),
        ns: material.exponent.min(MAX_EXPONENT),
        ke: scaled(material.emission, radiance_scale),
        ni: material.ior,
        tf: material.transmission.to_array(),
        map_kd: place_of(material, Parameter::Diffuse, headers),
    }
}

/// One more than the place of the texture that gives the parameter; 0 for none.
fn place_of(material: &scene::Material, parameter: Parameter, headers: &[u32]) -> u32 {
    material.texture(parameter).map_or(0, |texture| headers[texture as usize] + 1)
}

/// What else a material has. `tables` are those of its microfacets.
pub(super) fn pack_detail(material: &scene::Material, headers: &[u32], tables: &mut Tables) -> MaterialDetail {
    let place = |parameter| place_of(material, parameter, headers);
    let parts: Vec<u32> = material.surface.parts().collect();
    let part = |at: usize| parts.get(at).copied().unwrap_or_default();
    let across = if material.texture(Parameter::RoughnessAcross).is_some() {
        Parameter::RoughnessAcross
    } else {
        Parameter::Roughness
    };
    let nonlinear = if material.surface == (Surface::Plastic { nonlinear: true }) { DETAIL_NONLINEAR } else { 0 };
    let beckmann = if material.is_beckmann { DETAIL_BECKMANN } else { 0 };
    let transmits = if material.has_inside() { DETAIL_TRANSMITS } else { 0 };
    let principled = material.principled;
    MaterialDetail {
        eta: material.eta.to_array(),
        alpha_x: material.roughness.x.max(SMOOTH),
        absorption: material.absorption.to_array(),
        alpha_y: material.roughness.y.max(SMOOTH),
        metalness: material.metalness,
        coat: material.coat,
        coat_alpha: material.coat_roughness.max(SMOOTH),
        weight: material.weight,
        map_ks: place(Parameter::Specular),
        map_alpha_x: place(Parameter::Roughness),
        map_alpha_y: place(across),
        map_metalness: place(Parameter::Metalness),
        map_coat: place(Parameter::Coat),
        map_anisotropy: place(Parameter::Anisotropy),
        map_sheen: place(Parameter::Sheen),
        map_sheen_tint: place(Parameter::SheenTint),
        map_specular_tint: place(Parameter::SpecularTint),
        map_specular_share: place(Parameter::SpecularShare),
        map_flatness: place(Parameter::Flatness),
        map_diffuse_transmission: place(Parameter::DiffuseTransmission),
        map_normal: place(Parameter::Normal),
        map_height: place(Parameter::Height),
        map_ke: place(Parameter::Emission),
        map_weight: place(Parameter::Weight),
        first: part(0),
        second: part(1),
        flags: nonlinear | beckmann | transmits,
        inner_reflectance: inner_reflectance(material),
        mean_reflectance: mean_reflectance(material).to_array(),
        table: tables.place(material),
        anisotropy: principled.anisotropy,
        sheen: principled.sheen,
        sheen_tint: principled.sheen_tint,
        specular_tint: principled.specular_tint,
        specular_share: principled.specular_share,
        flatness: principled.flatness,
        diffuse_transmission: principled.diffuse_transmission,
        unused: 0,
    }
}

pub(super) fn pack_normals(mesh: &scene::Mesh) -> Vec<Normals> {
    mesh.triangles
        .iter()
        .map(|triangle| {
            if triangle.normals[0] == scene::NONE {
                return Normals { corners: [0; 3], present: 0 };
            }
            Normals { corners: triangle.normals.map(|i| encode_normal(mesh.normals[i as usize])), present: 1 }
        })
        .collect()
}

/// Octahedral encoding, 16 bits a coordinate. (Cigolle et al. 2014)
fn encode_normal(n: Vec3) -> u32 {
    let n = n / (n.x.abs() + n.y.abs() + n.z.abs());
    let sign = |x: f32| if x >= 0.0 { 1.0 } else { -1.0 };
    let (x, y) = if n.z >= 0.0 { (n.x, n.y) } else { ((1.0 - n.y.abs()) * sign(n.x), (1.0 - n.x.abs()) * sign(n.y)) };
    let snorm = |x: f32| u32::from((x.clamp(-1.0, 1.0) * 32767.0).round() as i16 as u16);
    snorm(x) | snorm(y) << 16
}

/// The unit vector that bits stand for, as `decode_normal` of `records.glsl` has it.
pub(super) fn decode_normal(bits: u32) -> Vec3 {
    let snorm = |bits: u32| f32::from((bits as u16).cast_signed().max(-32767)) / 32767.0;
    let (x, y) = (snorm(bits), snorm(bits >> 16));
    let z = 1.0 - x.abs() - y.abs();
    let fold = if 0.0 < -z { -z } else { 0.0 };
    let folded = |x: f32| x + if x >= 0.0 { -fold } else { fold };
    let n = Vec3::new(folded(x), folded(y), z);
    n * (1.0 / ((n.x * n.x + n.y * n.y) + n.z * n.z).sqrt())
}

pub(super) fn pack_coordinates(mesh: &scene::Mesh) -> Vec<Vec2> {
    let corner = |&i: &u32| if i == scene::NONE { Vec2::ZERO } else { mesh.uvs[i as usize] };
    mesh.triangles.iter().flat_map(|triangle| triangle.uvs.iter().map(corner).collect::<Vec<_>>()).collect()
}

/// Colours of the corners of triangles: halves, the fourth of which is 1 where the triangle has some.
pub(super) fn pack_colours(mesh: &scene::Mesh) -> Vec<[u32; 2]> {
    let half = |value: f32| u32::from(f16::from_f32(value.min(f16::MAX.to_f32())).to_bits());
    let corners = |triangle: &scene::Triangle| {
        let colours = triangle.positions.map(|position| mesh.colour(position));
        let present = if colours == [Vec3::ONE; 3] { 0.0 } else { 1.0 };
        colours.map(|Vec3 { x, y, z }| [half(x) | half(y) << 16, half(z) | half(present) << 16])
    };
    mesh.triangles.iter().flat_map(corners).collect()
}

/// All textures that some triangle shows in one buffer, and where each begins.
pub(super) fn pack_textures(scene: &Scene, radiance_scale: f64) -> (Vec<[u32; 2]>, Vec<u32>) {
    let mut shown = vec![false; scene.textures.len()];
    let mut emitted = vec![false; scene.textures.len()];
    for (material, _) in scene.materials.iter().zip(scene.shown_materials()).filter(|(_, shown)| *shown) {
        for texture in material.textures.iter().flatten() {
            shown[*texture as usize] = true;
        }
        if let Some(texture) = material.texture(Parameter::Emission) {
            emitted[texture as usize] = true;
        }
    }
    let mut words: Vec<[u32; 2]> = Vec::new();
    let mut headers = Vec::new();
    // Where texels that were seen before begin.
    let mut known: HashMap<(*const [half::f16; 4], bool), u32> = HashMap::new();
    for (index, texture) in scene.textures.iter().enumerate() {
        headers.push(words.len() as u32);
        if !shown[index] {
            continue;
        }
        let Lookup { transform, wrap, is_smooth } = texture.lookup;
        let wrap = match wrap {
            Wrap::Repeat => 0,
            Wrap::Mirror => LOOKUP_MIRROR,
            Wrap::Clamp => LOOKUP_CLAMP,
        };
        let lookup = wrap | if is_smooth { 0 } else { LOOKUP_NEAREST };
        let own = words.len() as u32 + IMAGE_HEADER_WORDS;
        let start = *known.entry((texture.texels.as_ptr(), emitted[index])).or_insert(own);
        words.push([texture.width, texture.height]);
        words.push([lookup, start]);
        let columns = [transform.matrix2.x_axis, transform.matrix2.y_axis, transform.translation];
        words.extend(columns.map(|column| column.to_array().map(f32::to_bits)));
        if start != own {
            continue;
        }
        if emitted[index] {
            let scaled = |texel: &[half::f16; 4]| texel.map(|x| half::f16::from_f64(x.to_f64() * radiance_scale));
            words.extend(texture.texels.iter().map(|texel| bytemuck::cast::<_, [u32; 2]>(scaled(texel))));
        } else {
            words.extend(bytemuck::cast_slice::<_, [u32; 2]>(&texture.texels));
        }
    }
    (words, headers)
}

/// Lights that are no surfaces, as light samples pick them by their power, and the power of all.
pub(super) fn pack_lights(
    lights: &[Light],
    normalisation: &Normalisation,
    radiance_scale: f64,
) -> (Vec<PunctualLight>, f64) {
    let strengths: Vec<Vec3> = lights.iter().map(|light| strength(light, normalisation)).collect();
    let weights: Vec<f64> = strengths.iter().map(|strength| brightness(*strength)).collect();
    let total: f64 = weights.iter().sum();
    if lights.is_empty() || total == 0.0 {
        return (Vec::new(), 0.0);
    }
    let cells = alias_table(&weights);
    let packed = lights.iter().zip(cells).enumerate().map(|(index, (light, cell))| {
        let probability = weights[index] / total;
        let emission = scaled(strengths[index], radiance_scale / probability);
        let emission = if probability > 0.0 { emission } else { [0.0; 3] };
        let (position, direction, kind, cosines) = match *light {
            Light::Point { position, .. } => (position, DVec3::ZERO, LIGHT_POINT, [0.0; 2]),
            Light::Spot { position, direction, angles, falloff, .. } => match falloff {
                Falloff::Angle => (position, direction, LIGHT_SPOT, angles.map(f64::to_radians)),
                Falloff::SquaredCosine => {
                    let cosines = angles.map(|angle| libm::cos(angle.to_radians()));
                    (position, direction, LIGHT_SPOT_SQUARED, cosines)
                }
            },
            Light::Directional { direction, .. } => (DVec3::ZERO, direction, LIGHT_DIRECTIONAL, [0.0; 2]),
        };
        PunctualLight {
            position: normalisation.point(position).as_vec3().to_array(),
            kind,
            direction: direction.as_vec3().to_array(),
            threshold: cell.threshold,
            emission,
            alias: cell.alias,
            full_from: cosines[0] as f32,
            none_from: cosines[1] as f32,
            unused: [0; 2],
        }
    });
    (packed.collect(), total)
}
