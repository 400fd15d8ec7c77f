//! The pixels of every scene by every integrator and sampler are the bytes that `digests.toml` has: on every device, by
//! every scheduler and every shape of tree, and whatever a driver makes of what Vulkan leaves to it.
//!
//! Each pixel's numbers are tried with schedulers and trees in turn; with `RAYWAVE_DIGESTS=all` with all of them. With
//! `RAYWAVE_DIGESTS=write` the file is written anew, for a change that is meant to move pixels.

use std::ops::ControlFlow;

use crate::common::not_tested::not_tested;
use crate::common::{assert_silent, device, gallery, is_swiftshader, own_scene, prepare, project_file, tries};
use crate::probe::hostile;
use raywave::bvh::{BvhKind, MAX_LISTED};
use raywave::gpu::Device;
use raywave::render::{Session, SessionOptions};
use raywave::scene::Scene;
use raywave::settings::{Integrator, Numerics, Sampler, Scheduler, Settings};
use raywave::shaders::Forms;
use serde::{Deserialize, Serialize};

const SCENES: [&str; 10] = [
    "cornell-box",
    "cornell-caustic",
    "cornell-glass",
    "cornell-phong",
    "furnace",
    "smooth",
    "textured-sky",
    "gallery",
    "materials",
    "still-life",
];
/// Triangles of the gallery, about.
const GALLERY_TRIANGLES: usize = 5000;
const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const SAMPLES: u32 = 4;
/// Of unbounded scenes too.
const MAX_BOUNCES: u32 = 6;

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Digests {
    digest: Vec<Entry>,
}

/// A render and the digest of its pixels.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Entry {
    scene: String,
    integrator: String,
    sampler: String,
    width: u32,
    height: u32,
    samples: u32,
    max_bounces: u32,
    pixels_blake3: String,
}

fn load(name: &str) -> Scene {
    if name == "gallery" { gallery(GALLERY_TRIANGLES) } else { own_scene(name) }
}

fn render(device: &Device, scene: &Scene, settings: &Settings, options: SessionOptions) -> String {
    let prepared = prepare(device, scene, settings);
    let mut session = Session::with_options(device, &prepared, settings, options).expect("the session starts");
    let outcome = session.render(|_| ControlFlow::Continue(())).expect("the render ends");
    drop(session);
    assert_silent(device);
    outcome.film.mean().digest()
}

/// Every scene with every integrator and sampler.
fn each(mut visit: impl FnMut(&str, &Scene, Settings, Entry)) {
    for name in SCENES {
        let scene = load(name);
        for integrator in [Integrator::Implicit, Integrator::Explicit, Integrator::Mis] {
            for sampler in [Sampler::Independent, Sampler::Sobol] {
                let settings = Settings {
                    width: WIDTH,
                    height: HEIGHT,
                    samples: SAMPLES,
                    max_bounces: Some(MAX_BOUNCES),
                    integrator,
                    sampler,
                    ..scene.settings
                };
                let entry = Entry {
                    scene: name.to_owned(),
                    integrator: format!("{integrator:?}").to_lowercase(),
                    sampler: format!("{sampler:?}").to_lowercase(),
                    width: WIDTH,
                    height: HEIGHT,
                    samples: SAMPLES,
                    max_bounces: MAX_BOUNCES,
                    pixels_blake3: String::new(),
                };
                visit(name, &scene, settings, entry);
            }
        }
    }
}

fn recorded() -> Vec<Entry> {
    let text = std::fs::read_to_string(project_file("tests/digests.toml")).expect("the digests are there");
    toml::from_str::<Digests>(&text).expect("the digests are well formed").digest
}

/// Schedulers and trees that a scene can be rendered by.
fn ways(scene: &Scene) -> Vec<(Scheduler, BvhKind)> {
    let kinds = [BvhKind::List, BvhKind::Bvh2, BvhKind::Bvh4, BvhKind::Cwbvh];
    let fits = |kind: &BvhKind| *kind != BvhKind::List || scene.mesh.triangles.len() <= MAX_LISTED;
    let kinds = kinds.into_iter().filter(fits);
    kinds
        .flat_map(|kind| {
            [Scheduler::Wavefront, Scheduler::Bounce, Scheduler::Megakernel].map(|scheduler| (scheduler, kind))
        })
        .collect()
}

#[test]
fn pixels_are_the_recorded_bytes() {
    let device = device();
    let wish = std::env::var("RAYWAVE_DIGESTS").unwrap_or_default();
    let mut found = Vec::new();
    let mut index = 0;
    each(|_, scene, settings, entry| {
        index += 1;
        if wish.is_empty() && !tries(&device, index, 5) {
            return;
        }
        let ways = ways(scene);
        // Five shares no divisor with the numbers of ways.
        let turn = 5 * index % ways.len();
        let tried = if wish == "all" { &ways[..] } else { &ways[turn..=turn] };
        let of = |(scheduler, bvh): &(Scheduler, BvhKind)| {
            let settings = Settings { scheduler: Some(*scheduler), bvh: Some(*bvh), ..settings };
            render(&device, scene, &settings, SessionOptions::default())
        };
        let digests: Vec<String> = tried.iter().map(of).collect();
        for (way, digest) in tried.iter().zip(&digests) {
            assert_eq!(*digest, digests[0], "{entry:?} by {way:?} and {:?}", tried[0]);
        }
        found.push(Entry { pixels_blake3: digests[0].clone(), ..entry });
    });
    if wish == "write" {
        let text = toml::to_string(&Digests { digest: found }).expect("digests become TOML");
        let head = "# Digests of pixels (`raywave render` tells them as pixels_blake3), the same on every device.\n\
                    # RAYWAVE_DIGESTS=write ./x test digests writes them anew.\n\n";
        std::fs::write(project_file("tests/digests.toml"), format!("{head}{text}")).expect("it can be written");
        return;
    }
    let recorded = recorded();
    assert_eq!(index, recorded.len());
    for found in found {
        assert!(recorded.contains(&found), "of other pixels than recorded: {found:?}");
    }
}

#[test]
fn a_hostile_driver_moves_no_pixel_but_of_native_arithmetic() {
    let device = device();
    if is_swiftshader(&device) {
        not_tested("its compiler takes 20 GB for kernels of which every sum is a call");
        return;
    }
    let recorded = recorded();
    let mut moved = 0;
    let mut tried = 0;
    each(|name, scene, settings, entry| {
        let place = SCENES.iter().position(|scene| *scene == name).expect("it is one of them");
        // One integrator and sampler a scene, in turn.
        let at = recorded
            .iter()
            .position(|r| r.scene == name && r.integrator == entry.integrator && r.sampler == entry.sampler);
        let at = at.expect("it is recorded");
        if at % 6 != place % 6 {
            return;
        }
        tried += 1;
        let hostile = SessionOptions { driver: Some(hostile()), ..SessionOptions::default() };
        let portable = SessionOptions { forms: Some(Forms::CAREFUL), ..hostile };
        assert_eq!(render(&device, scene, &settings, portable), recorded[at].pixels_blake3, "{entry:?}");
        let native = Settings { numerics: Numerics::Native, ..settings };
        moved += u32::from(render(&device, scene, &native, hostile) != recorded[at].pixels_blake3);
    });
    assert!(tried > 0 && moved == tried, "native pixels are the driver's: {moved} of {tried} moved");
}
