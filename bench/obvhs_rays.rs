//! Traces a ray dump with obvhs on the CPU: the peer of `bench/traversal`, which builds and drives it.
//!
//!     obvhs_rays RAYS TRIANGLES DISTANCES
//!
//! The files are those of `raywave dump-rays` (docs/ray-dumps.md). Each line on stdin is a round, `FORM THREADS PASSES`:
//! FORM is `cwbvh` or `bvh2`. The answer is a line of JSON: seconds of all passes, rays that hit, rays whose answer is
//! not that of DISTANCES, and rays that are excused: their answer is right once the triangles that they cannot hit are
//! left out, or lies nearer than obvhs looks.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, bail, ensure};
use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::bvh2::{Bvh2, builder::build_bvh2_from_tris};
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use raywave::constants::NO_TRIANGLE;
use raywave::rays::{Metadata, RayClass, RayDump, RayRecord};
use serde_json::json;

/// What is cut off a shadow ray, in lengths of its direction, so that it ends before its lamp: `bench/embree.cpp` tells
/// why neither peer is asked to leave out the triangles that a ray cannot hit.
const SHORTENED: f32 = 1e-5;
/// Answers of one ray agree where distances differ by less than this share.
const TOLERANCE: f32 = 1e-3;
/// obvhs drops boxes of its `cwbvh` that end nearer than this, in lengths of the direction.
const UNSEEN: f32 = 1e-4;
/// Rays that a thread takes at once.
const CHUNK: usize = 1024;

/// A tree with its triangles in the order of its leaves.
struct Tree<Bvh> {
    bvh: Bvh,
    triangles: Vec<RtTriangle>,
    order: Vec<u32>,
}

impl<Bvh> Tree<Bvh> {
    fn new(bvh: Bvh, order: Vec<u32>, triangles: &[Triangle]) -> Self {
        let triangles = order.iter().map(|original| (&triangles[*original as usize]).into()).collect();
        Self { bvh, triangles, order }
    }
}

/// Calls of both kinds of tree have the same names, but no trait.
macro_rules! trace {
    ($tree:expr, $shadow:expr, $ray:expr, $excluded:expr) => {{
        let tree = $tree;
        let intersect = |ray: &Ray, place: usize| match $excluded {
            Some(excluded) if excluded(tree.order[place]) => f32::INFINITY,
            _ => tree.triangles[place].intersect(ray),
        };
        if $shadow {
            let missed = tree.bvh.ray_traverse_miss($ray, intersect);
            RayHit { t: if missed { f32::INFINITY } else { 0.0 }, ..RayHit::none() }
        } else {
            let mut hit = RayHit::none();
            tree.bvh.ray_traverse($ray, &mut hit, intersect);
            hit
        }
    }};
}

#[derive(Clone, Copy)]
enum Form<'a> {
    Cwbvh(&'a Tree<CwBvh>),
    Bvh2(&'a Tree<Bvh2>),
}

/// Nothing is excluded: known when the loop is compiled, so that the timed one has no test.
const NOTHING: Option<fn(u32) -> bool> = None;

impl Form<'_> {
    /// Traces rays with what obvhs does on its own.
    fn trace(self, shadow: bool, rays: &[Ray], answers: &mut [RayHit]) {
        match self {
            Self::Cwbvh(tree) => {
                rays.iter().zip(answers).for_each(|(ray, answer)| *answer = trace!(tree, shadow, *ray, NOTHING));
            }
            Self::Bvh2(tree) => {
                rays.iter().zip(answers).for_each(|(ray, answer)| *answer = trace!(tree, shadow, *ray, NOTHING));
            }
        }
    }

    /// Traces one ray that cannot hit some triangles.
    fn trace_without(self, shadow: bool, ray: &Ray, record: &RayRecord) -> RayHit {
        let excluded = Some(|original| original == record.leaves || original == record.target);
        match self {
            Self::Cwbvh(tree) => trace!(tree, shadow, *ray, excluded),
            Self::Bvh2(tree) => trace!(tree, shadow, *ray, excluded),
        }
    }
}

fn agrees(shadow: bool, answer: &RayHit, expected: f32) -> bool {
    let hit = answer.t.is_finite();
    hit == expected.is_finite() && (!hit || shadow || (answer.t - expected).abs() <= TOLERANCE * expected)
}

/// A dump of whatever scene it names.
fn read_dump(path: &Path) -> anyhow::Result<RayDump> {
    let file = fs::File::open(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let about = BufReader::new(file).split(b'\n').nth(1).context("a dump has two lines")??;
    let metadata: Metadata = serde_json::from_slice(&about)?;
    Ok(RayDump::read(path, &metadata.scene)?)
}

/// The numbers of a `.npy` file that raywave wrote.
fn read_npy(path: &Path) -> anyhow::Result<Vec<f32>> {
    let bytes = fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    ensure!(bytes.starts_with(b"\x93NUMPY\x01\x00"), "{}: this is no .npy file of raywave", path.display());
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let (numbers, _) = bytes[start..].as_chunks();
    Ok(numbers.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
}

fn main() -> anyhow::Result<()> {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    let [rays, triangles, distances] = &arguments[..] else { bail!("arguments are RAYS TRIANGLES DISTANCES") };
    let RayDump { metadata, rays: records } = read_dump(rays.as_ref())?;
    let shadow = metadata.class == RayClass::Shadow;
    let expected = read_npy(distances.as_ref())?;
    ensure!(expected.len() == records.len(), "these are the distances of other rays");
    let corners = read_npy(triangles.as_ref())?;
    let (corners, _) = corners.as_chunks::<9>();
    ensure!(corners.len() == metadata.scene.triangles as usize, "these are the triangles of another scene");
    let [v0, v1, v2] = [0, 3, 6].map(|at| move |c: &[f32; 9]| Vec3A::from_slice(&c[at..]));
    let triangles: Vec<_> = corners.iter().map(|c| Triangle { v0: v0(c), v1: v1(c), v2: v2(c) }).collect();
    // The preset that raywave builds with.
    let params = BvhBuildParams::medium_build();
    let bvh = build_cwbvh_from_tris(&triangles, params, &mut Duration::default());
    let order = bvh.primitive_indices.clone();
    let cwbvh = Tree::new(bvh, order, &triangles);
    let bvh = build_bvh2_from_tris(&triangles, params, &mut Duration::default());
    let order = bvh.primitive_indices.clone();
    let bvh2 = Tree::new(bvh, order, &triangles);

    let limit = |target| if target == NO_TRIANGLE { f32::INFINITY } else { 1.0 - SHORTENED };
    let ray = |r: &RayRecord| Ray::new(r.origin.into(), r.direction.into(), 0.0, limit(r.target));
    let rays: Vec<_> = records.iter().map(ray).collect();
    let mut answers = vec![RayHit::none(); rays.len()];
    let mut pools: HashMap<usize, ThreadPool> = HashMap::new();
    println!("{}", json!({ "version": "0.4", "rays": rays.len() }));

    for line in std::io::stdin().lines() {
        let line = line?;
        let [form, threads, passes] = line.split(' ').collect::<Vec<_>>()[..] else {
            bail!("{line}: a round is FORM THREADS PASSES");
        };
        let form = match form {
            "cwbvh" => Form::Cwbvh(&cwbvh),
            "bvh2" => Form::Bvh2(&bvh2),
            _ => bail!("{form}: a tree is cwbvh or bvh2"),
        };
        let (threads, passes) = (threads.parse()?, passes.parse()?);
        let pool = match pools.entry(threads) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => entry.insert(ThreadPoolBuilder::new().num_threads(threads).build()?),
        };
        let start = Instant::now();
        pool.install(|| {
            for _ in 0..passes {
                rays.par_chunks(CHUNK)
                    .zip(answers.par_chunks_mut(CHUNK))
                    .for_each(|(rays, answers)| form.trace(shadow, rays, answers));
            }
        });
        let seconds = start.elapsed().as_secs_f64();
        let hits = answers.iter().filter(|answer| answer.t.is_finite()).count();
        let (mut wrong, mut excused) = (0, 0);
        for (i, answer) in answers.iter().enumerate() {
            if !agrees(shadow, answer, expected[i]) {
                let again = form.trace_without(shadow, &rays[i], &records[i]);
                let is_unseen = matches!(form, Form::Cwbvh(_)) && !shadow && expected[i] < UNSEEN;
                let is_excused = is_unseen || agrees(shadow, &again, expected[i]);
                *(if is_excused { &mut excused } else { &mut wrong }) += 1;
            }
        }
        println!("{}", json!({ "seconds": seconds, "hits": hits, "wrong": wrong, "excused": excused }));
    }
    Ok(())
}
