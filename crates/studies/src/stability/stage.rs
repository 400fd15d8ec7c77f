//! Small scenes, built in memory, and the bodies that they are built of.

use glam::{DVec3, Vec3, dvec3};

use raywave::scene::{Camera, Environment, Material, Scene, SceneBuilder, Surface, shapes};

/// A sky of radiance 1.
pub const WHITE_SKY: Environment = Environment::Constant(Vec3::ONE);

/// A scene of which there is nothing yet, seen from `eye`.
pub fn stage(eye: DVec3, target: DVec3, vfov: f64) -> SceneBuilder {
    SceneBuilder::new(Camera::pinhole(eye, target, vfov))
}

/// The same with another up direction.
pub fn stage_with_up(eye: DVec3, target: DVec3, vfov: f64, up: DVec3) -> SceneBuilder {
    SceneBuilder::new(Camera { up, ..Camera::pinhole(eye, target, vfov) })
}

/// A diffuse surface.
pub fn grey(reflectance: f32) -> Material {
    Material::diffuse(Vec3::splat(reflectance))
}

/// An emitter.
pub fn lamp(radiance: f32) -> Material {
    Material::emitter(Vec3::splat(radiance))
}

/// A Phong lobe that loses nothing.
pub fn gloss(exponent: f32) -> Material {
    Material::phong(Vec3::ZERO, Vec3::ONE, exponent)
}

/// A surface that transmits light.
pub fn glass(surface: Surface, ior: f32) -> Material {
    Material { surface, ..Material::dielectric(ior) }
}

/// A box with its fronts outwards.
pub fn cuboid(low: DVec3, high: DVec3) -> Vec<Vec<DVec3>> {
    shapes::cuboid(low, high).map(Vec::from).to_vec()
}

/// A cube about the origin.
pub fn cube(half: f64) -> Vec<Vec<DVec3>> {
    cuboid(DVec3::splat(-half), DVec3::splat(half))
}

/// An ellipsoid about the origin of `rows` bands, twice as many around, its fronts outwards.
pub fn ball(radii: DVec3, rows: u32) -> Vec<Vec<DVec3>> {
    let point = |row: u32, column: u32| {
        let (sin_row, cos_row) = (std::f64::consts::PI * f64::from(row) / f64::from(rows)).sin_cos();
        let (sin, cos) = (std::f64::consts::PI * f64::from(column % (2 * rows)) / f64::from(rows)).sin_cos();
        // The poles are one point whatever the meridian.
        let sin_row = if row.is_multiple_of(rows) { 0.0 } else { sin_row };
        radii * dvec3(sin_row * sin, cos_row, sin_row * cos)
    };
    let bands = (0..rows).flat_map(|row| (0..2 * rows).map(move |column| (row, column)));
    bands
        .map(|(row, column)| match row {
            0 => vec![point(0, 0), point(1, column), point(1, column + 1)],
            _ if row + 1 == rows => vec![point(row, column), point(rows, 0), point(row, column + 1)],
            _ => vec![point(row, column), point(row + 1, column), point(row + 1, column + 1), point(row, column + 1)],
        })
        .collect()
}

/// A rod along z of half length 0.5 whose cross-section is a square of half side 0.5, one edge of which is rounded by
/// `facets` faces of that width each: slivers. Its fronts are outwards.
pub fn bevelled_rod(facets: u32, width: f64) -> Vec<Vec<DVec3>> {
    // An arc of a quarter turn, tangent to both sides.
    let radius = width * f64::from(facets) / std::f64::consts::FRAC_PI_2;
    let arc = (0..=facets).map(|i| {
        let angle = std::f64::consts::FRAC_PI_2 * f64::from(i) / f64::from(facets);
        dvec3(0.5 - radius + radius * angle.cos(), 0.5 - radius + radius * angle.sin(), 0.0)
    });
    let rest = [dvec3(-0.5, 0.5, 0.0), dvec3(-0.5, -0.5, 0.0), dvec3(0.5, -0.5, 0.0)];
    let outline: Vec<DVec3> = arc.chain(rest).collect();
    let (back, front) = (-0.5 * DVec3::Z, 0.5 * DVec3::Z);
    let sides = (0..outline.len()).map(|i| {
        let (a, b) = (outline[i], outline[(i + 1) % outline.len()]);
        vec![a + back, b + back, b + front, a + front]
    });
    let cap: Vec<DVec3> = outline.iter().map(|p| *p + front).collect();
    let base: Vec<DVec3> = outline.iter().rev().map(|p| *p + back).collect();
    sides.chain([cap, base]).collect()
}

/// The same faces seen from their backs.
pub fn inside_out(mut polygons: Vec<Vec<DVec3>>) -> Vec<Vec<DVec3>> {
    polygons.iter_mut().for_each(|corners| corners.reverse());
    polygons
}

/// The same faces, each point moved by `to`.
pub fn moved(mut polygons: Vec<Vec<DVec3>>, to: impl Fn(DVec3) -> DVec3) -> Vec<Vec<DVec3>> {
    polygons.iter_mut().flatten().for_each(|p| *p = to(*p));
    polygons
}

/// A scene with every position mapped by `to`, which keeps shapes similar.
pub fn mapped(scene: &Scene, to: impl Fn(DVec3) -> DVec3) -> Scene {
    let mut scene = scene.clone();
    scene.mesh.positions.iter_mut().for_each(|p| *p = to(*p));
    (scene.camera.eye, scene.camera.target) = (to(scene.camera.eye), to(scene.camera.target));
    scene
}
