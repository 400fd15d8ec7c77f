//! Bodies for scenes that are built in memory.

use glam::{DVec3, dvec3};

/// The faces of a cuboid, counter-clockwise seen from outside, as indices of [`cuboid_corners`].
pub const CUBOID_FACES: [[usize; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// The corners of the box between two opposite ones: bit 0 of an index chooses x, bit 1 y, bit 2 z.
pub fn cuboid_corners(low: DVec3, high: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|corner| {
        let pick = |bit: usize, low: f64, high: f64| if corner >> bit & 1 == 0 { low } else { high };
        dvec3(pick(0, low.x, high.x), pick(1, low.y, high.y), pick(2, low.z, high.z))
    })
}

/// The faces of the box between two opposite corners, their fronts outside.
pub fn cuboid(low: DVec3, high: DVec3) -> [[DVec3; 4]; 6] {
    let corners = cuboid_corners(low, high);
    CUBOID_FACES.map(|face| face.map(|corner| corners[corner]))
}
