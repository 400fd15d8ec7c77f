//! No ray slips through a closed body.

use glam::Vec3;
use rayon::prelude::*;

use super::bench::{Bench, buffers, kernels, state};
use super::{Check, Finding, Verdict};
use crate::oracle::pcg4d;
use crate::stability::stage::{ball, cube, grey, stage};
use raywave::bvh::{self, BvhKind, Hit, Primitive, Ray};
use raywave::constants::{NO_TRIANGLE, WORLD_INSTANCE};
use raywave::layout::{Batch, Triangle};
use raywave::recording::Recording;
use raywave::render::{Plan, PreparedScene, RenderError, scene_buffers};
use raywave::scene::Scene;

pub const CHECKS: &[Check] = &[Check {
    name: "watertight",
    checked: "rays from within closed bodies at their edges and vertices hit them",
    spoils: "light leaks through the edges of triangles",
    run: watertight,
}];

/// Rays at each body.
const RAYS: u32 = 2_500_000;
/// Rays per invocation.
const RUN: u32 = 16;
/// Rays at each body that the CPU traces too.
const TRACED: u32 = 1 << 15;
/// Words ahead of the hits.
const HEAD: usize = 4;

fn watertight(bench: &Bench<'_>) -> Result<Finding, RenderError> {
    let shell =
        |polygons: &[_]| stage(glam::DVec3::ZERO, glam::DVec3::X, 60.0).material(grey(0.0)).polygons(polygons).build();
    let (cube, ball) = (shell(&cube(0.7)), shell(&ball(glam::DVec3::splat(0.9), 24)));
    let bodies = [(&cube, BvhKind::List), (&ball, BvhKind::Bvh2), (&ball, BvhKind::Bvh4), (&ball, BvhKind::Cwbvh)];
    let mut leaks = Leaks::default();
    for (scene, kind) in bodies {
        let prepared = PreparedScene::with_bvh(scene, kind)?;
        let invocations = bench.part_of(RAYS).div_ceil(RUN);
        let words = trace(bench, scene, &prepared, invocations)?;
        leaks.see(kind, &prepared, invocations * RUN, &words);
    }
    Ok(leaks.finding())
}

/// Answers of the kernel `edges`.
fn trace(
    bench: &Bench<'_>,
    scene: &Scene,
    prepared: &PreparedScene,
    invocations: u32,
) -> Result<Vec<u32>, RenderError> {
    let settings = scene.settings;
    let plan = Plan {
        width: invocations,
        height: 1,
        tile_rows: 1,
        path_capacity: invocations,
        workgroup_size: bench.workgroup_size(),
        paths_per_invocation: 1,
    };
    let frame = prepared.frame(&settings, plan.path_capacity);
    let stacks = prepared.needs(&settings).stack_bytes(plan.stacks());
    let own = [
        state(buffers::ANSWERS, 4 * HEAD + 16 * TRACED as usize, None),
        state(buffers::STACK_BLOCKS, stacks as usize, None),
    ];
    let roles = scene_buffers(prepared, &settings, &frame).chain(own).collect();
    let mut executor = bench.open_specialized(&[kernels::EDGES], roles, &prepared.specialization(&settings, &plan))?;
    let batch = Batch {
        first_pixel: prepared.triangles.len() as u32,
        pixel_count: invocations,
        first_sample: TRACED,
        sample_count: RUN,
        bounce: 0,
        film_pixel: 0,
        first_slot: 0,
    };
    let mut work = Recording::default();
    work.dispatch(kernels::EDGES, plan.groups(invocations), &batch);
    Ok(bench.run(&mut executor, kernels::EDGES, &mut work)?)
}

/// The ray of that number: `ray_of` of the kernel, in the same arithmetic.
fn ray_of(number: u32, triangles: &[Triangle]) -> Ray {
    let step = (-24_f32).exp2();
    let unit = |word: u32| (word >> 8) as f32 * step;
    let (a, b) = (pcg4d([number, 0, 0, 0]), pcg4d([number, 1, 0, 0]));
    let triangle = &triangles[a[0] as usize % triangles.len()];
    let [v0, v1, v2] = [triangle.v0, triangle.v1, triangle.v2].map(Vec3::from);
    let towards = |from: Vec3, to: Vec3, along: f32| from + along * (to - from);
    let (origin, target) = (0.2 * (Vec3::new(unit(b[0]), unit(b[1]), unit(b[2])) - 0.5), v0);
    let (origin, target) = match number & 3 {
        0 => (origin, target),
        1 => (origin, towards(v0, v1, unit(a[1]))),
        2 => {
            let at = towards(v1, v2, unit(a[1]));
            (origin, towards(at, v0, unit(a[2])))
        }
        _ => (Vec3::ZERO, if number & 4 == 0 { v0 } else { 0.5 * (v0 + v1) }),
    };
    Ray { origin, direction: target - origin, leaves: Primitive::NONE }
}

/// Findings over all bodies.
#[derive(Debug, Default)]
struct Leaks {
    rays: u64,
    lost: u64,
    /// The first ray that was lost.
    example: String,
    /// Rays that the CPU traced as well.
    traced: u64,
    /// Hits of another triangle, or elsewhere in it.
    differing: u64,
    /// Hits at the CPU's distance, up to rounding.
    near: u64,
}

impl Leaks {
    fn see(&mut self, kind: BvhKind, prepared: &PreparedScene, rays: u32, words: &[u32]) {
        let (head, hits) = words.split_at(HEAD);
        if self.lost == 0 && head[0] > 0 {
            let Ray { origin, direction, .. } = ray_of(!head[1], &prepared.triangles);
            self.example = format!("{kind:?}, from {origin} along {direction}");
        }
        self.rays += u64::from(rays);
        self.lost += u64::from(head[0]);
        let on_cpu = |number: usize| {
            bvh::trace_closest(&prepared.bvh, &prepared.triangles, &ray_of(number as u32, &prepared.triangles))
        };
        let found = |words: &[u32]| {
            let [u, v, distance] = [words[1], words[2], words[3]].map(f32::from_bits);
            (words[0] != NO_TRIANGLE).then_some(Hit {
                triangle: words[0],
                instance: WORLD_INSTANCE,
                barycentrics: [u, v],
                distance,
            })
        };
        let pairs = hits.par_chunks_exact(4).enumerate().map(|(number, words)| (found(words), on_cpu(number)));
        let [differing, near] = pairs
            .map(|(found, right)| {
                // Rays are at least 0.5 long and end at their target: a hit is at a distance about 1.
                let is_near = found.zip(right).is_some_and(|(a, b)| (a.distance - b.distance).abs() < 1e-5);
                [u64::from(found != right), u64::from(found != right && is_near)]
            })
            .reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        self.traced += hits.len() as u64 / 4;
        self.differing += differing;
        self.near += near;
    }

    fn finding(self) -> Finding {
        let Self { rays, lost, example, traced, differing, near } = self;
        let (verdict, found) = if lost > 0 {
            (Verdict::Off, format!("{lost} find nothing, as of {example}"))
        } else if differing > near {
            (Verdict::Off, format!("{} of {traced} hits are not the CPU's", differing - near))
        } else if differing > 0 {
            (
                Verdict::Property,
                format!("all do; {differing} of {traced} hits are rounded in another way than the CPU's"),
            )
        } else {
            (Verdict::Ok, format!("all do; {traced} hits are the CPU's to the last bit"))
        };
        Finding::new(rays, verdict, found).with("lost", lost).with("traced_on_cpu", traced).with("differing", differing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Answers of a device that traces as the CPU does.
    fn answers(prepared: &PreparedScene) -> Vec<u32> {
        let hit = |number| {
            let ray = ray_of(number, &prepared.triangles);
            let hit = bvh::trace_closest(&prepared.bvh, &prepared.triangles, &ray).expect("the body is closed");
            let Hit { triangle, barycentrics: [u, v], distance, .. } = hit;
            [triangle, u.to_bits(), v.to_bits(), distance.to_bits()]
        };
        [0; HEAD].into_iter().chain((0..TRACED).flat_map(hit)).collect()
    }

    #[test]
    fn leaks_and_other_hits_are_found() {
        let body = stage(glam::DVec3::ZERO, glam::DVec3::X, 60.0).material(grey(0.0)).polygons(cube(0.7)).build();
        let prepared = PreparedScene::with_bvh(&body, BvhKind::Bvh2).expect("a cube fits");
        let judged = |words: &[u32]| {
            let mut leaks = Leaks::default();
            leaks.see(BvhKind::Bvh2, &prepared, RAYS, words);
            leaks.finding()
        };
        let right = answers(&prepared);
        assert_eq!(judged(&right).verdict, Verdict::Ok);
        let spoiled = |at: usize, word: u32| {
            let mut words = right.clone();
            words[at] = word;
            judged(&words)
        };
        let leak = spoiled(0, 1);
        assert!(leak.verdict == Verdict::Off && leak.found.starts_with("1 find nothing"), "{}", leak.found);
        assert_eq!(spoiled(HEAD, NO_TRIANGLE).verdict, Verdict::Off);
        assert_eq!(spoiled(HEAD + 3, 3.0_f32.to_bits()).verdict, Verdict::Off);
        assert_eq!(spoiled(HEAD + 3, right[HEAD + 3] ^ 1).verdict, Verdict::Property);
    }
}
