//! Polygons to triangles.

use earcut::Earcut;
use glam::{DVec2, DVec3};

use crate::scene::{NONE, Triangle};

/// Cuts polygons into triangles.
#[derive(Default)]
pub(super) struct Polygons {
    outline: Vec<DVec2>,
    earcut: Earcut<f64>,
    ears: Vec<u32>,
}

impl Polygons {
    /// Adds a polygon: as triangles that share its first corner where these cover it, else by clipping ears of its
    /// projection along its normal. Normals and texture coordinates count where all corners of the polygon have them.
    pub fn add(&mut self, corners: &[[u32; 3]], positions: &[DVec3], material: u32, triangles: &mut Vec<Triangle>) {
        let all_have = [0, 1, 2].map(|kind| corners.iter().all(|corner| corner[kind] != NONE));
        let mut push = |places: [usize; 3]| {
            let triangle = places.map(|place| corners[place]);
            let indices = |kind: usize| if all_have[kind] { triangle.map(|corner| corner[kind]) } else { [NONE; 3] };
            triangles.push(Triangle { positions: indices(0), uvs: indices(1), normals: indices(2), material });
        };
        let fan = (2..corners.len()).map(|i| [0, i - 1, i]);
        if corners.len() == 3 {
            return push([0, 1, 2]);
        }
        let twice_area = project(corners.iter().map(|corner| positions[corner[0] as usize]), &mut self.outline);
        let outline = &self.outline;
        let area = |[a, b, c]: [usize; 3]| (outline[b] - outline[a]).perp_dot(outline[c] - outline[a]);
        // What lies on a line is rounded.
        if fan.clone().all(|triangle| area(triangle) >= -1e-9 * twice_area) {
            return fan.for_each(push);
        }
        self.earcut.earcut(outline.iter().map(|point| point.to_array()), &[], &mut self.ears);
        if self.ears.is_empty() {
            return fan.for_each(push);
        }
        for ear in self.ears.chunks_exact(3) {
            let [a, b, c] = [ear[0], ear[1], ear[2]].map(|place| place as usize);
            push(if area([a, b, c]) < 0.0 { [a, c, b] } else { [a, b, c] });
        }
    }
}

/// The outline of a polygon seen along its normal, so that it runs counter-clockwise, and twice its area. (Newell's normal:
/// Sutherland, Sproull and Schumacker 1974)
fn project(corners: impl Iterator<Item = DVec3> + Clone, outline: &mut Vec<DVec2>) -> f64 {
    let first = corners.clone().next().unwrap_or_default();
    let next = corners.clone().skip(1).chain([first]);
    let normal: DVec3 = corners.clone().zip(next).map(|(a, b)| (a - first).cross(b - first)).sum();
    let across = normal.try_normalize().unwrap_or(DVec3::Z).any_orthonormal_pair();
    outline.clear();
    outline.extend(corners.map(|point| DVec2::new((point - first).dot(across.0), (point - first).dot(across.1))));
    normal.length()
}
