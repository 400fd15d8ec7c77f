//! Only what the scene requires: kernels and buffers for one scene and kernels and buffers for any
//! give the same bits, and what a scene does not need is neither compiled nor bound nor allocated.

use std::collections::{BTreeSet, HashSet};
use std::fs;
use std::path::PathBuf;

use crate::common::not_tested::not_tested;
use crate::common::{device, floor, gallery, is_swiftshader, own_scene, project_file, render_on, tries};
use crate::probe::scene_of_materials;
use glam::Vec3;
use rayon::prelude::*;
use raywave::render::{Defaults, Features, Footprint, Outcome, PreparedScene, feature_costs};
use raywave::scene::{Material, Principled, Scene, Surface};
use raywave::settings::{Integrator, RouletteMode, Sampler, Scheduler, Settings, ShadowRays};

/// Every scene of `scenes/` and a small gallery.
fn all_scenes() -> Vec<Scene> {
    let entries = fs::read_dir(project_file("scenes")).expect("the folder of scenes is readable");
    let paths = entries.map(|entry| entry.expect("its entries are readable").path());
    let is_scene =
        |path: &PathBuf| path.extension().is_some_and(|end| ["toml", "xml", "gltf"].iter().any(|e| end == *e));
    let own = paths.filter(is_scene);
    own.map(|path| Scene::load(&path).expect("own scenes load")).chain([gallery(5000)]).collect()
}

/// Whether the scene has many kinds of surface.
fn has_many_kinds(scene: &Scene) -> bool {
    let shown = scene.materials.iter().zip(scene.shown_materials()).filter(|(_, shown)| *shown);
    shown.map(|(material, _)| std::mem::discriminant(&material.surface)).collect::<HashSet<_>>().len() > 5
}

fn small(scene: &Scene) -> Settings {
    Settings { width: 20, height: 20, samples: 3, in_flight: Some(500), ..scene.settings }
}

#[test]
fn kernels_for_any_scene_give_the_same_bits() {
    let device = device();
    if is_swiftshader(&device) {
        return not_tested("kernels for any scene, which SwiftShader takes minutes and gigabytes to compile");
    }
    let scenes = all_scenes();
    assert!(scenes.len() > 7, "scenes/ and the gallery");
    let renders = |scene: &Scene| {
        let own = small(scene);
        let wavefront = Settings { scheduler: Some(Scheduler::Wavefront), ..own };
        let explicit = Settings { integrator: Integrator::Explicit, ..wavefront };
        let bounce = Settings { scheduler: Some(Scheduler::Bounce), ..explicit };
        let mis = Settings { integrator: Integrator::Mis, ..bounce };
        let throughput = Settings { roulette_mode: RouletteMode::Throughput, roulette_from: 0, ..mis };
        [
            explicit,
            mis,
            Settings { sampler: Sampler::Independent, ..throughput },
            Settings { scheduler: Some(Scheduler::Megakernel), clamp: Some(0.1), ..throughput },
            Settings { integrator: Integrator::Implicit, ..wavefront },
            bounce,
            Settings { shadow_rays: ShadowRays::AtOnce, ..bounce },
            Settings { integrator: Integrator::Implicit, ..bounce },
            Settings { max_bounces: Some(0), roulette: 0.0, ..bounce },
            Settings { scheduler: Some(Scheduler::Megakernel), ..explicit },
            Settings { scheduler: Some(Scheduler::Megakernel), integrator: Integrator::Implicit, ..own },
            Settings { max_bounces: None, roulette: 0.3, ..explicit },
            Settings { max_bounces: Some(0), roulette: 0.0, ..explicit },
            Settings { max_bounces: Some(0), roulette: 0.0, scheduler: Some(Scheduler::Megakernel), ..own },
        ]
    };
    let cases: Vec<_> = scenes.iter().flat_map(|scene| renders(scene).map(|settings| (scene, settings))).collect();
    // Every fourth way, and with the next scene others: what a scene has several have. Kernels for any scene take drivers
    // long.
    let ways = cases.len() / scenes.len();
    let is_tried = |case: usize| {
        // Kernels of scenes that have most of what there is differ little from those for any scene, and take long to build.
        let step = if has_many_kinds(cases[case].0) { 7 } else { 4 };
        (case / ways + case % ways).is_multiple_of(step) && tries(&device, case, 3)
    };
    cases.par_iter().enumerate().filter(|(case, _)| is_tried(*case)).for_each(|(_, (scene, settings))| {
        let [own, any] = [true, false].map(|specialize| {
            let Outcome { film, statistics } = render_on(&device, scene, &Settings { specialize, ..*settings });
            (film.sum, film.sum_of_squares, statistics.bounce_rays, statistics.shadow_rays, statistics.memory_bytes)
        });
        let what = format!("{}, {settings:?}", scene.name);
        assert!(own.0 == any.0 && own.1 == any.1, "{what}: another image");
        assert_eq!((own.2, own.3), (any.2, any.3), "{what}: other rays");
        assert!(own.4 < any.4, "{what}: {} bytes are no fewer than {}", own.4, any.4);
    });
}

/// Buffers that a render of the scene binds.
fn bound(scene: &Scene, settings: &Settings) -> BTreeSet<&'static str> {
    let prepared = PreparedScene::new(scene).expect("the scene fits");
    let Footprint { scene_bytes, path_bytes, .. } = Footprint::of(&prepared, settings, &Defaults::GPU);
    scene_bytes.iter().chain(&path_bytes).map(|(name, _)| *name).collect()
}

#[test]
fn what_a_scene_does_not_need_is_not_bound() {
    let scene = own_scene("cornell-box");
    let explicit = Settings { scheduler: Some(Scheduler::Wavefront), ..small(&scene) };
    let always = ["nodes", "triangles", "materials", "ray_queue", "ray_origins", "ray_directions", "radiances", "hits"];
    let lights = ["lights", "shadow_origins", "shadow_directions", "shadow_radiances"];
    let of = |parts: &[&[&'static str]]| parts.concat().into_iter().collect::<BTreeSet<_>>();
    assert_eq!(bound(&scene, &explicit), of(&[&always, &["throughputs"], &lights]));
    let implicit = Settings { integrator: Integrator::Implicit, ..explicit };
    assert_eq!(bound(&scene, &implicit), of(&[&always, &["throughputs"]]));
    let unlit = Settings { max_bounces: Some(0), ..explicit };
    assert_eq!(bound(&scene, &unlit), of(&[&always]));
    let bounce = Settings { scheduler: Some(Scheduler::Bounce), ..explicit };
    let mut expected = of(&[&always, &["throughputs"], &lights]);
    expected.remove("hits");
    assert_eq!(bound(&scene, &bounce), expected);
    // No shadow ray waits: they are traced at once, or there are none.
    lights[1..].iter().for_each(|name| assert!(expected.remove(name)));
    assert_eq!(bound(&scene, &Settings { shadow_rays: ShadowRays::AtOnce, ..bounce }), expected);
    expected.remove("lights");
    assert_eq!(bound(&scene, &Settings { integrator: Integrator::Implicit, ..bounce }), expected);
    expected.remove("throughputs");
    assert_eq!(bound(&scene, &Settings { max_bounces: Some(0), ..bounce }), expected);

    let any = Settings { specialize: false, ..explicit };
    let details = ["material_details", "punctual_lights"];
    let data = ["normals", "texture_coordinates", "vertex_colours", "textures", "environment", "environment_splits"];
    assert_eq!(bound(&scene, &any), of(&[&always, &["throughputs", "stack_blocks"], &lights, &details, &data]));

    let sky = own_scene("textured-sky");
    let prepared = PreparedScene::new(&sky).expect("the scene fits");
    assert!(prepared.features.textures && !prepared.features.lights, "what the scene is for");
    let names = bound(&sky, &Settings { integrator: Integrator::Explicit, ..small(&sky) });
    assert!(names.is_superset(&of(&[&["textures", "texture_coordinates", "environment", "environment_splits"]])));
    assert!(!names.contains("lights"));
}

#[test]
fn memory_that_is_told_is_that_of_the_buffers_that_are_bound() {
    let device = device();
    let scene = own_scene("cornell-box");
    let prepared = PreparedScene::new(&scene).expect("the scene fits");
    let explicit =
        Settings { integrator: Integrator::Explicit, scheduler: Some(Scheduler::Wavefront), ..small(&scene) };
    let implicit = Settings { integrator: Integrator::Implicit, ..explicit };
    let [with, without] =
        [explicit, implicit].map(|settings| render_on(&device, &scene, &settings).statistics.memory_bytes);
    let lights = size_of_val(prepared.lights.as_slice()) as u64;
    // Of each path a shadow ray of three records.
    assert_eq!(with - without, 48 * 500 + lights);
}

#[test]
fn materials_that_no_triangle_has_do_not_count() {
    let floor_material = "newmtl floor\nKd 0.5 0.5 0.5\n";
    let plain = PreparedScene::new(&floor(floor_material)).expect("the scene fits").features;
    let others =
        "newmtl lamp\nKe 1 1 1\nnewmtl glass\nillum 7\nNi 1.5\nnewmtl shiny\nillum 2\nKd 0 0 0\nKs 1 1 1\nNs 9\n";
    let features = PreparedScene::new(&floor(&format!("{floor_material}{others}"))).expect("the scene fits").features;
    assert_eq!(features, plain);
    assert!(features.phong && !features.lights && !features.phong_lobes && !features.dielectric);
    let used = PreparedScene::new(&floor("newmtl floor\nillum 7\nNi 1.5\n")).expect("the scene fits").features;
    assert!(used.dielectric && !used.phong);
}

#[test]
fn a_scene_of_one_kind_of_material_has_code_for_no_other() {
    let metal = |alpha| Material::conductor(Vec3::ZERO, Vec3::ONE, alpha);
    let lossy = |material| Material { compensates: false, ..material };
    let colour = Vec3::splat(0.5);
    let coated = Material { coat: 1.0, coat_roughness: 0.1, ..Material::metal_rough(colour, 0.5, 0.3) };
    let kinds: [(Material, &[&str]); 15] = [
        (Material::diffuse(colour), &["diffuse surfaces"]),
        (Material::mirror(colour), &["mirrors"]),
        (Material::dielectric(1.5), &["Fresnel glass"]),
        (metal(0.0), &["smooth metals"]),
        (lossy(metal(0.3)), &["rough metals"]),
        (metal(0.3), &["rough metals", "multiple scattering"]),
        (lossy(metal(0.3)).rough(0.1, 0.5), &["rough metals", "anisotropy"]),
        (Material { is_beckmann: true, ..lossy(metal(0.3)) }, &["rough metals", "Beckmann facets"]),
        (lossy(Material::dielectric(1.5).rough(0.3, 0.3)), &["rough glass"]),
        (Material { surface: Surface::ThinDielectric, ..Material::dielectric(1.5) }, &["thin glass"]),
        (lossy(Material::plastic(colour, 1.5, 0.0)), &["plastics"]),
        (lossy(Material::plastic(colour, 1.5, 0.3)), &["rough plastics"]),
        (lossy(coated), &["metal-rough", "clear coats"]),
        (Material::principled(colour, 1.5, 0.3, Principled::default()), &["principled bodies"]),
        (Material::principled_thin(colour, 1.5, 0.3, Principled::default()), &["principled sheets"]),
    ];
    for (material, expected) in kinds {
        let scene = scene_of_materials(vec![material]);
        let prepared = PreparedScene::new(&scene).expect("the scene fits");
        let found = Features::FLAGS.iter().filter(|flag| (flag.get)(&prepared.features)).map(|flag| flag.title);
        assert_eq!(found.collect::<Vec<_>>(), expected);
        // Kernels for any scene have the code of all others beside.
        let settings = Settings { scheduler: Some(Scheduler::Wavefront), ..small(&scene) };
        let [own, any] = [true, false].map(|specialize| {
            let footprint = Footprint::of(&prepared, &Settings { specialize, ..settings }, &Defaults::GPU);
            footprint.instructions.iter().find(|(name, _)| *name == "shade").expect("surfaces are shaded").1
        });
        assert!(4 * own < any, "{own} of {any} instructions for {expected:?}");
    }
}

#[test]
fn surfaces_that_answer_to_one_direction_cast_no_shadow_rays() {
    let device = device();
    let scene = floor("newmtl floor\nillum 3\nKs 0.8 0.8 0.8\n");
    let settings = Settings { integrator: Integrator::Explicit, ..small(&scene) };
    let prepared = PreparedScene::new(&scene).expect("the scene fits");
    assert!(prepared.features.mirror && !prepared.needs(&settings).shadows);
    let outcome = render_on(&device, &scene, &settings);
    assert_eq!(outcome.statistics.shadow_rays, 0);
    // A mirror of 0.8 under a sky of 1.
    let mean = outcome.film.mean();
    assert!(mean.pixels.iter().any(|pixel| (pixel.x - 0.8).abs() < 1e-5));
    assert!(!outcome.statistics.passes.keys().any(|(kernel, _)| *kernel == "connect"));
}

#[test]
fn features_cost_what_they_add() {
    let scene = own_scene("cornell-box");
    let prepared = PreparedScene::new(&scene).expect("the scene fits");
    let settings = Settings { scheduler: Some(Scheduler::Wavefront), ..small(&scene) };
    let costs = feature_costs(&prepared, &settings, &Defaults::GPU);
    let cost = |name: &str| costs.iter().find(|cost| cost.feature == name).expect("the feature is listed");
    let [own, any] =
        [true, false].map(|specialize| Footprint::of(&prepared, &Settings { specialize, ..settings }, &Defaults::GPU));
    let all = |footprint: &Footprint| footprint.instructions.iter().map(|(_, n)| n).sum::<usize>();
    assert!(all(&own) < all(&any));

    let textures = cost("textures");
    assert!(!textures.found);
    let triangles = prepared.triangles.len() as u64;
    assert_eq!(textures.scene_bytes, [("texture_coordinates", 24 * triangles), ("textures", 8)]);
    assert_eq!(textures.instructions.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["shade"]);

    let samples = cost("light samples");
    assert!(samples.found);
    let connect = own.instructions.iter().find(|(name, _)| *name == "connect").expect("lamps cast shadows").1;
    assert!(samples.instructions.contains(&("connect", connect)));
    assert_eq!(samples.path_bytes.iter().map(|(_, bytes)| bytes).sum::<u64>(), 48);
    // What shades another feature costs nothing without it.
    let shades = [
        "clear coats",
        "anisotropy",
        "Beckmann facets",
        "multiple scattering",
        "placed textures",
        "turned environment",
    ];
    for cost in &costs {
        let may_cost_nothing = cost.found || cost.feature == "scattering" || shades.contains(&cost.feature);
        assert!(may_cost_nothing || !cost.instructions.is_empty(), "{cost:?} costs nothing");
    }
}
