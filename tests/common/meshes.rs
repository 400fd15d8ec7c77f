//! Triangles for traversal: closed bodies, soups, and what breaks builders.
#![allow(dead_code, reason = "each test file uses its part")]

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3};
use raywave::scene::shapes;

use crate::probe::Uniform;

pub type Mesh = Vec<[DVec3; 3]>;

/// A box with its faces outwards.
pub fn cuboid(low: DVec3, high: DVec3) -> Mesh {
    shapes::cuboid(low, high).iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
}

/// A unit ball of meridians and parallels, faces outwards; slivers at its poles.
pub fn ball(meridians: usize, parallels: usize) -> Mesh {
    let point = |column: usize, row: usize| {
        let phi = TAU * (column % meridians) as f64 / meridians as f64;
        let theta = PI * row as f64 / parallels as f64;
        // The poles are one point whatever the meridian.
        let sine = if row == 0 || row == parallels { 0.0 } else { theta.sin() };
        DVec3::new(sine * phi.cos(), sine * phi.sin(), theta.cos())
    };
    let mut mesh = Mesh::new();
    for row in 0..parallels {
        for column in 0..meridians {
            let [a, b] = [point(column, row), point(column, row + 1)];
            let [c, d] = [point(column + 1, row + 1), point(column + 1, row)];
            if row + 1 < parallels {
                mesh.push([a, b, c]);
            }
            if row > 0 {
                mesh.push([a, c, d]);
            }
        }
    }
    mesh
}

/// The mesh turned, shrunk or stretched, and moved.
pub fn placed(mesh: &Mesh, turn: DMat3, scale: f64, at: DVec3) -> Mesh {
    mesh.iter().map(|triangle| triangle.map(|v| turn * v * scale + at)).collect()
}

/// Triangles at random, of edges up to `size`; those of `thinness` below 1 are slivers.
pub fn soup(count: usize, size: f64, thinness: f64, random: &mut Uniform) -> Mesh {
    (0..count)
        .map(|_| {
            let [x, y, z, s] = random.next::<4>().map(f64::from);
            let centre = 2.0 * DVec3::new(x, y, z) - 1.0;
            let along = size * s * random.direction();
            [centre, centre + along, centre + 0.5 * along + thinness * size * s * random.direction()]
        })
        .collect()
}
