//! Scenes that place meshes more than once.
#![allow(dead_code, reason = "each test file uses its part")]

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3, dvec3};
use raywave::scene::{
    Camera, Environment, Lookup, Material, Mesh, NONE, Parameter, PlacedMesh, Placement, Scene, SceneBuilder, Texture,
    Triangle,
};

/// A closed body of meridians and parallels, faces outwards, with smooth normals and texture coordinates: a ball that is
/// wider to one side, and coloured around it. Its southern half has the second material.
pub fn pear(meridians: u32, parallels: u32, materials: [u32; 2]) -> Mesh {
    let (mut mesh, columns) = (Mesh::default(), meridians + 1);
    for row in 0..=parallels {
        for column in 0..columns {
            let (u, v) = (f64::from(column) / f64::from(meridians), f64::from(row) / f64::from(parallels));
            let ring = if row == 0 || row == parallels { 0.0 } else { (PI * v).sin() };
            // The seam is one point, as the poles are.
            let (sine, cosine) = (TAU * f64::from(column % meridians) / f64::from(meridians)).sin_cos();
            let point = dvec3(ring * cosine, ring * sine, (PI * v).cos());
            mesh.positions.push(point * (1.0 + 0.3 * point.x));
            mesh.normals.push(point.normalize().as_vec3());
            mesh.uvs.push(Vec2::new(u as f32, 1.0 - v as f32));
            mesh.colours.push(Vec3::new(1.0, u as f32, 0.5));
        }
    }
    for row in 0..parallels {
        for column in 0..meridians {
            let [a, d] = [row * columns + column, row * columns + column + 1];
            let [b, c] = [a + columns, d + columns];
            let material = materials[usize::from(2 * row >= parallels)];
            let mut add = |corners| {
                mesh.triangles.push(Triangle { positions: corners, normals: corners, uvs: corners, material })
            };
            if row + 1 < parallels {
                add([a, b, c]);
            }
            if row > 0 {
                add([a, c, d]);
            }
        }
    }
    mesh
}

/// Places a mesh by its axes' scales, a turn in radians about each axis, and a translation.
pub fn placement(scale: DVec3, turn: DVec3, translation: DVec3) -> Placement {
    let turn = DMat3::from_euler(glam::EulerRot::XYZ, turn.x, turn.y, turn.z);
    let map = DAffine3 { matrix3: turn * DMat3::from_diagonal(scale), translation };
    Placement { map, is_mirrored: false }
}

/// What a scene may do with meshes in one: pears on a floor, turned, stretched, mirrored with their fronts kept and turned
/// inside out, with an image, colours of vertices and smooth normals, and lamps that are placed too.
pub fn orchard() -> Scene {
    let camera = Camera::pinhole(dvec3(0.0, 2.5, 5.0), dvec3(0.0, 0.5, 0.0), 50.0);
    let mut textured = Material::diffuse(Vec3::ONE);
    textured.textures[Parameter::Diffuse as usize] = Some(0);
    let mut glossy = Material::diffuse(Vec3::new(0.3, 0.4, 0.2));
    glossy.specular = Vec3::splat(0.4);
    glossy.exponent = 20.0;
    let mut scene = SceneBuilder::new(camera)
        .resolution(48, 32)
        .environment(Environment::Constant(Vec3::splat(0.3)))
        .material(Material::diffuse(Vec3::new(0.7, 0.7, 0.6)))
        .polygon(&[dvec3(-4.0, 0.0, -4.0), dvec3(-4.0, 0.0, 4.0), dvec3(4.0, 0.0, 4.0), dvec3(4.0, 0.0, -4.0)])
        .build();
    scene.materials.extend([textured, glossy, Material::emitter(Vec3::new(8.0, 7.0, 5.0))]);
    let texels = (0..16).map(|i| [i % 4, i / 4, 3, 4].map(|x: u16| half::f16::from_f32(f32::from(x) / 4.0)));
    let texels: Arc<[_]> = texels.collect();
    scene.textures.push(Texture { path: "four".into(), width: 4, height: 4, texels, lookup: Lookup::default() });
    let at = |x: f64, y: f64, z: f64| dvec3(x, y, z);
    let mut kept = placement(dvec3(-0.5, 0.5, 0.5), dvec3(0.4, 1.0, 0.0), at(0.3, 0.7, 1.5));
    kept.is_mirrored = true;
    let pears = vec![
        placement(DVec3::splat(0.6), dvec3(0.3, 0.2, 0.1), at(-1.6, 0.8, 0.0)),
        placement(dvec3(0.2, 0.9, 0.4), dvec3(1.0, -0.7, 2.0), at(0.0, 1.0, -0.5)),
        placement(dvec3(0.5, -0.5, 0.5), dvec3(0.0, 0.5, 2.5), at(1.6, 0.7, 0.2)),
        kept,
        placement(DVec3::splat(0.003), DVec3::ZERO, at(0.0, 0.6, 3.5)),
    ];
    let lamps = vec![
        placement(DVec3::splat(0.2), DVec3::ZERO, at(-0.8, 2.3, 0.4)),
        placement(dvec3(0.4, 0.1, 0.2), dvec3(0.0, 0.3, 0.4), at(1.0, 2.0, 0.6)),
    ];
    scene.placed.push(PlacedMesh { mesh: pear(12, 8, [1, 2]), placements: pears });
    scene.placed.push(PlacedMesh { mesh: without_attributes(pear(7, 5, [3, 3])), placements: lamps });
    scene
}

fn without_attributes(mut mesh: Mesh) -> Mesh {
    for triangle in &mut mesh.triangles {
        (triangle.normals, triangle.uvs) = ([NONE; 3], [NONE; 3]);
    }
    (mesh.normals, mesh.uvs, mesh.colours) = Default::default();
    mesh
}
