//! Materials, normals, texture coordinates and images in the layouts of the GPU.

use std::collections::HashSet;

use glam::{Vec2, Vec3};

use super::features::{bsdf_of, used_materials};
use super::space::scaled;
use crate::constants::*;
use crate::layout::{Material, Normals};
use crate::scene::{self, Scene};

/// Largest Phong exponent of the kernels. Such a lobe is a millionth of a radian wide, about as wide as the rounding of a
/// direction: a larger exponent would show nothing but that.
const MAX_EXPONENT: f32 = 1e12;

pub(super) fn pack_material(material: &scene::Material, headers: &[u32], radiance_scale: f64) -> Material {
    Material {
        kd: material.diffuse.to_array(),
        surface: if material.is_emitter() { SURFACE_EMITTER } else { bsdf_of(material.surface) },
        ks: material.specular.to_array(),
        ns: material.exponent.min(MAX_EXPONENT),
        ke: scaled(material.emission, radiance_scale),
        ni: material.ior,
        tf: material.transmission.to_array(),
        map_kd: material.diffuse_map.map_or(0, |texture| headers[texture as usize] + 1),
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

pub(super) fn pack_coordinates(mesh: &scene::Mesh) -> Vec<Vec2> {
    let corner = |&i: &u32| if i == scene::NONE { Vec2::ZERO } else { mesh.uvs[i as usize] };
    mesh.triangles.iter().flat_map(|triangle| triangle.uvs.iter().map(corner).collect::<Vec<_>>()).collect()
}

/// All images that some triangle shows in one buffer, and where each begins.
pub(super) fn pack_textures(scene: &Scene) -> (Vec<[u32; 2]>, Vec<u32>) {
    let shown: HashSet<u32> = (scene.materials.iter().zip(used_materials(scene)))
        .filter_map(|(material, used)| material.diffuse_map.filter(|_| used))
        .collect();
    let mut words = Vec::new();
    let mut headers = Vec::new();
    for (texture, number) in scene.textures.iter().zip(0..) {
        headers.push(words.len() as u32);
        if shown.contains(&number) {
            words.push([texture.width, texture.height]);
            words.extend(bytemuck::cast_slice::<_, [u32; 2]>(&texture.texels));
        }
    }
    (words, headers)
}
