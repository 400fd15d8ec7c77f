//! What stands where in the gallery: the hall, its columns and plinths, the garden, statues and lamps.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3, dvec2, dvec3};

use super::{
    noise::fractal_noise,
    surfaces::{Seam, Shape, column, hoop, knot, on_sphere, revolved, twist, vase},
};

/// Bounds of the hall, metres. The floor is y = 0, the open side is -x, the visitor looks to -z.
pub const HALL: (DVec3, DVec3) = (dvec3(-5.2, 0.0, -13.0), dvec3(4.6, 5.0, 5.2));

/// Where the columns stand along z, from front to back.
const COLUMNS_Z: [f64; 6] = [2.6, -0.2, -3.0, -5.8, -8.6, -11.4];
const LEFT_COLUMNS_X: f64 = -3.3;
const RIGHT_COLUMNS_X: f64 = 3.1;

/// A sand garden in a basin.
const GARDEN: (DVec3, DVec3) = (dvec3(-1.7, 0.0, -7.6), dvec3(1.7, 0.42, -4.6));

/// Materials and opposite corners of everything with right angles.
pub fn boxes() -> Vec<(&'static str, DVec3, DVec3)> {
    let (low, high) = HALL;
    let mut boxes = vec![
        ("ceiling", dvec3(low.x, high.y, low.z), high + dvec3(0.2, 0.25, 0.0)),
        ("plaster", dvec3(low.x, 0.0, low.z - 0.2), dvec3(high.x, high.y, low.z)),
        ("plaster", dvec3(low.x, 0.0, high.z), dvec3(high.x, high.y, high.z + 0.2)),
        ("plaster", dvec3(high.x, 1.2, low.z), dvec3(high.x + 0.2, high.y, high.z)),
        ("panelling", dvec3(high.x - 0.05, 0.0, low.z), dvec3(high.x + 0.2, 1.2, high.z)),
        // A parapet and a lintel close the open side below and above.
        ("travertine", dvec3(low.x, 0.0, low.z), dvec3(low.x + 0.25, 0.85, high.z)),
        ("travertine", dvec3(low.x - 0.05, 0.85, low.z), dvec3(low.x + 0.3, 0.95, high.z)),
        ("plaster", dvec3(low.x, 4.3, low.z), dvec3(low.x + 0.25, 5.0, high.z)),
        // Pictures on the right and at the back, and a strip of light under the cornice.
        ("canvas_ochre", dvec3(high.x - 0.06, 1.7, -2.4), dvec3(high.x, 3.3, -0.8)),
        ("canvas_green", dvec3(high.x - 0.06, 1.7, -5.2), dvec3(high.x, 3.3, -3.6)),
        ("canvas_blue", dvec3(high.x - 0.06, 1.7, -8.0), dvec3(high.x, 3.3, -6.4)),
        ("canvas_blue", dvec3(-1.5, 1.3, low.z), dvec3(1.3, 3.7, low.z + 0.06)),
        ("tube", dvec3(high.x - 0.12, 3.9, -11.0), dvec3(high.x - 0.05, 3.96, 2.0)),
    ];
    for z in COLUMNS_Z {
        for x in [LEFT_COLUMNS_X, RIGHT_COLUMNS_X] {
            let axis = dvec3(x, 0.0, z);
            boxes.push(("basalt", axis - dvec3(0.5, 0.0, 0.5), axis + dvec3(0.5, 0.16, 0.5)));
            boxes.push(("travertine", axis + dvec3(-0.5, 4.72, -0.5), axis + dvec3(0.5, 5.0, 0.5)));
        }
    }
    for z in [1.0, -3.4, -7.8] {
        boxes.push(("skylight", dvec3(-1.1, 4.95, z - 0.55), dvec3(1.1, 5.0, z + 0.55)));
    }
    for (centre, half, height) in PLINTHS {
        let (x, z) = (centre.x, centre.y);
        let foot = half + 0.06;
        boxes.push(("basalt", dvec3(x - foot, 0.0, z - foot), dvec3(x + foot, 0.1, z + foot)));
        boxes.push(("travertine", dvec3(x - half, 0.1, z - half), dvec3(x + half, height, z + half)));
    }
    let (low, high) = GARDEN;
    let rim = 0.16;
    for (material, from, to) in [
        ("basalt", dvec3(low.x - rim, 0.0, low.z - rim), dvec3(low.x, high.y, high.z + rim)),
        ("basalt", dvec3(high.x, 0.0, low.z - rim), dvec3(high.x + rim, high.y, high.z + rim)),
        ("basalt", dvec3(low.x, 0.0, low.z - rim), dvec3(high.x, high.y, low.z)),
        ("basalt", dvec3(low.x, 0.0, high.z), dvec3(high.x, high.y, high.z + rim)),
    ] {
        boxes.push((material, from, to));
    }
    boxes
}

/// Centre (x, z), half width and height of each plinth.
const PLINTHS: [(DVec2, f64, f64); 10] = [
    (dvec2(1.45, -0.2), 0.34, 0.80),
    (dvec2(-1.35, 0.0), 0.36, 0.80),
    (dvec2(-0.95, -2.4), 0.32, 0.55),
    (dvec2(2.05, -3.0), 0.34, 0.90),
    (dvec2(-2.05, -3.0), 0.32, 1.05),
    (dvec2(2.25, -5.0), 0.30, 0.90),
    (dvec2(-2.35, -6.4), 0.34, 0.90),
    (dvec2(2.05, -8.6), 0.36, 0.85),
    (dvec2(-1.75, -9.6), 0.40, 0.75),
    (dvec2(0.35, -10.2), 0.55, 0.45),
];

/// A point on top of a plinth, `height` above it.
fn above(plinth: usize, height: f64) -> DVec3 {
    let (centre, _, top) = PLINTHS[plinth];
    dvec3(centre.x, top + height, centre.y)
}

/// Everything that is curved.
pub fn shapes() -> Vec<Shape> {
    use Seam::{Open, Poles, Torus, Tube};

    let ball = Shape::ball;
    let blob = Shape::blob;
    let vase_on = |plinth, height| move |u, v| vase(above(plinth, 0.0), height, u, v);
    let mut shapes = vec![
        ball("glass", 3.0, above(0, 0.36), 0.36),
        Shape::new("gold", Torus, 9.0, 0.1, |u, v| knot(above(1, 0.60), 0.38, v, u)),
        blob("jade", 6.0, (above(2, 0.34), 0.36), (0.45, 1.5)),
        Shape::new("lacquer", Poles, 5.0, 1.0, |u, v| twist(above(3, 0.0), u, v)),
        Shape::new("porcelain", Tube, 5.0, 1.2, vase_on(4, 0.95)),
        ball("crystal", 3.0, above(5, 0.30), 0.30),
        blob("copper", 6.0, (above(6, 0.38), 0.38), (0.4, 1.5)),
        Shape::new("cobalt", Tube, 4.0, 1.2, vase_on(7, 1.15)),
        Shape::new("brass", Torus, 5.0, 0.15, |u, v| hoop(above(8, 0.52), v, u)),
        ball("amber", 2.0, above(8, 0.52), 0.24),
        ball("silver", 4.0, above(9, 0.85), 0.85),
        ball("pearl", 2.0, dvec3(0.45, 0.26, 0.35), 0.26),
        ball("bottle_glass", 2.0, dvec3(-0.15, 0.19, 0.75), 0.19),
        ball("silver", 1.5, dvec3(0.55, 0.58, -5.5), 0.34),
        Shape::new("sand", Open, 22.0, 1.0, sand),
        Shape::new("velvet", Open, 5.0, 4.0, curtain),
    ];
    for (centre, radius) in ROCKS {
        let point = move |u, v| rock(centre, radius, u, v);
        shapes.push(Shape::new("rock", Poles, 1.2, 2.0, point).faceted());
    }
    for (index, z) in COLUMNS_Z.into_iter().enumerate() {
        // Columns far from the camera take fewer triangles.
        let weight = 5.0 / (1.0 + 0.4 * index as f64);
        for (x, material) in [(LEFT_COLUMNS_X, "marble"), (RIGHT_COLUMNS_X, "sandstone")] {
            let point = move |u, v| column(dvec3(x, 0.16, z), u, v);
            shapes.push(Shape::new(material, Tube, weight, 2.0, point));
        }
    }
    for (material, centre, radius) in [
        ("lamp_warm", dvec3(-1.05, 3.35, -1.6), 0.17),
        ("lamp_cool", dvec3(1.15, 3.65, -4.2), 0.15),
        ("lamp_rose", dvec3(-1.35, 3.45, -7.2), 0.16),
        ("lamp_warm", dvec3(1.1, 3.3, -9.3), 0.18),
    ] {
        let rod = move |u, v| {
            let top = HALL.1.y;
            let hook = centre + dvec3(0.0, radius, 0.0);
            revolved(hook, 0.012, (top - hook.y) * v, u)
        };
        shapes.push(ball(material, 0.4, centre, radius));
        shapes.push(Shape::new("iron", Tube, 0.1, 0.2, rod));
    }
    for z in [1.2, -1.6, -4.4, -7.2, -10.0] {
        let centre = dvec3(-5.05, 1.02, z);
        shapes.push(ball("ember", 0.2, centre, 0.06));
        shapes.push(Shape::ring("iron", 0.4, centre, 0.11, 0.03));
    }
    shapes
}

/// The sand of the garden, facing up.
fn sand(u: f64, v: f64) -> DVec3 {
    let (low, high) = GARDEN;
    let at = dvec2(low.x + (high.x - low.x) * v, low.z + (high.z - low.z) * u);
    dvec3(at.x, 0.26 + sand_height(at), at.y)
}

/// A rock that rests in the sand, flat underneath.
fn rock(centre: DVec2, radius: f64, u: f64, v: f64) -> DVec3 {
    let direction = on_sphere(u, v);
    let bulge = 1.0 + 0.42 * fractal_noise(1.7 * direction + 9.0 * centre.extend(radius));
    let squash = dvec3(1.0, if direction.y < 0.0 { 0.2 } else { 0.85 }, 1.0);
    dvec3(centre.x, 0.27, centre.y) + radius * bulge * direction * squash
}

/// A curtain before the back wall, in folds that deepen towards the floor.
fn curtain(u: f64, v: f64) -> DVec3 {
    let fold = 0.15 * (TAU * 7.0 * u + 1.5 * (5.0 * u).sin()).sin() * (1.0 - 0.55 * v);
    let sway = 0.08 * fractal_noise(dvec3(6.0 * u, 2.0 * v, 0.5));
    dvec3(1.75 + 2.6 * u, 0.02 + 4.18 * v, -12.55 + fold + sway)
}

/// Centre (x, z) and radius of the rocks in the garden.
const ROCKS: [(DVec2, f64); 5] = [
    (dvec2(-0.95, -5.35), 0.42),
    (dvec2(-0.35, -5.05), 0.20),
    (dvec2(0.15, -6.75), 0.50),
    (dvec2(-1.15, -6.95), 0.26),
    (dvec2(1.25, -6.55), 0.22),
];

/// Raked sand: straight waves along the basin that give way to rings around each rock.
fn sand_height(at: DVec2) -> f64 {
    const WAVELENGTH: f64 = 0.2;
    const REACH: f64 = 0.5;
    let wave = |distance: f64| (TAU * distance / WAVELENGTH).sin();
    let mut straight = 1.0;
    let mut height = 0.0;
    for (centre, radius) in ROCKS {
        let distance = centre.distance(at) - radius;
        let near = 1.0 - (distance / REACH).clamp(0.0, 1.0);
        let share = straight * near * near * (3.0 - 2.0 * near);
        straight -= share;
        height += share * wave(distance);
    }
    let grain = fractal_noise(dvec3(5.0 * at.x, 0.0, 5.0 * at.y));
    0.024 * (height + straight * wave(at.x)) + 0.005 * grain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_face_outwards() {
        const N: usize = 60;
        for shape in shapes().iter().filter(|shape| shape.seam != Seam::Open) {
            let point = |i: usize, j: usize| (shape.point)(i as f64 / N as f64, j as f64 / N as f64);
            let inside = (0..N).map(|j| point(0, j) + point(N / 2, j)).sum::<DVec3>() / 120.0;
            let volume = |i: usize, j: usize| {
                let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| point(i, j) - inside);
                a.dot(b.cross(c)) + a.dot(c.cross(d))
            };
            let cells = (0..N).flat_map(|i| (0..N).map(move |j| (i, j)));
            let volume: f64 = cells.map(|(i, j)| volume(i, j)).sum();
            assert!(volume > 0.0, "{} is inside out", shape.material);
        }
    }

    #[test]
    fn sheets_face_the_hall() {
        let normal = |point: fn(f64, f64) -> DVec3| {
            let [du, dv] = [point(0.9, 0.1), point(0.1, 0.9)].map(|end| end - point(0.1, 0.1));
            du.cross(dv)
        };
        assert!(normal(sand).y > 0.0);
        assert!(normal(curtain).z > 0.0);
    }
}
