//! Meshes in their places: what a ray hits is the same whether they are flattened or not, memory grows with meshes, and no
//! ray slips through a closed one.

use std::fs;

use glam::{DVec3, Vec3, dvec3};
use raywave::bvh::{self, BvhKind, Primitive, Ray};
use raywave::render::{PrepareError, PreparedScene, TriangleName};
use raywave::scene::{Camera, Material, PlacedMesh, Scene, SceneBuilder};
use raywave::settings::Instances;
use raywave_studies::stats::SplitMix64;

use crate::instances::{orchard, pear, placement};

fn prepared(scene: &Scene, instances: Instances) -> PreparedScene {
    PreparedScene::with_tree(scene, BvhKind::Bvh2, instances).expect("the scene fits")
}

/// Numbers in [-1, 1).
struct Random(SplitMix64);

impl Random {
    fn next(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * 2.0_f64.powi(-52) - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        dvec3(self.next(), self.next(), self.next())
    }
}

/// Pears of random sizes, from ones like the scene to ones like dust, turned and stretched, some mirrored.
fn heap(random: &mut Random, count: usize) -> Scene {
    let camera = Camera::pinhole(3.0 * DVec3::Z, DVec3::ZERO, 60.0);
    let mut scene = SceneBuilder::new(camera).material(Material::diffuse(Vec3::splat(0.5))).build();
    let mut placements = Vec::new();
    for i in 0..count {
        let size = 10.0_f64.powf(2.5 * random.next() - 2.5);
        let stretch = [0.0, 0.5, 1.5][i % 3];
        let axis = |random: &mut Random| size * 10.0_f64.powf(stretch * (random.next() - 1.0));
        let mut scale = dvec3(axis(random), axis(random), axis(random));
        if i % 4 == 3 {
            scale.y = -scale.y;
        }
        let mut placed = placement(scale, 4.0 * random.vector(), random.vector());
        placed.is_mirrored = i % 8 == 3;
        placements.push(placed);
    }
    scene.placed.push(PlacedMesh { mesh: pear(9, 6, [0, 0]), placements });
    scene
}

/// The nearest hit in the terms of the scene, with all its bits.
type Found = Option<(TriangleName, [u32; 3])>;

fn closest(scene: &PreparedScene, origin: Vec3, direction: Vec3, leaves: Primitive) -> Found {
    let ray = Ray { origin, direction, leaves };
    bvh::trace_closest(&scene.bvh, &scene.triangles, &ray).map(|hit| {
        let primitive = Primitive { triangle: hit.triangle, instance: hit.instance };
        let [u, v] = hit.barycentrics;
        (scene.name_of(primitive), [u, v, hit.distance].map(f32::to_bits))
    })
}

#[test]
fn rays_hit_the_same_whether_meshes_are_flattened_or_not() {
    let mut random = Random(SplitMix64::new(17));
    let (mut hits, mut on_dust) = (0, 0);
    for scene in [heap(&mut random, 12), heap(&mut random, 200), orchard()] {
        let [flat, placed] = [Instances::Flatten, Instances::TwoLevel].map(|instances| prepared(&scene, instances));
        let corners = flat.corners();
        assert_eq!(corners, placed.corners(), "corners are placed by the same operations");
        let (places, own_places) = (flat.places(), placed.places());
        let mut from = Vec3::ZERO;
        for number in 0..60_000 {
            // At corners, edges and faces; from anywhere, from near by, from afar, and from a surface.
            let aimed = (random.0.next_u64() % corners.len() as u64) as usize;
            let [a, b, c] = corners[aimed].map(|corner| Vec3::from(corner).as_dvec3());
            let (u, v) = (0.5 + 0.5 * random.next(), 0.5 + 0.5 * random.next());
            let target = match number % 4 {
                0 => a,
                1 => a.lerp(b, u),
                2 => a.lerp(b, u).lerp(c, v),
                _ => random.vector(),
            };
            let size = (b - a).length();
            let origin = match number / 4 % 4 {
                0 => (1.5 * random.vector()).as_vec3(),
                1 => (target + 10.0 * size * random.vector()).as_vec3(),
                2 => (1000.0 * random.vector()).as_vec3(),
                _ => from,
            };
            let direction = (target - origin.as_dvec3()).as_vec3();
            if direction == Vec3::ZERO {
                continue;
            }
            let found = closest(&flat, origin, direction, Primitive::NONE);
            assert_eq!(closest(&placed, origin, direction, Primitive::NONE), found, "{origin:?} {direction:?}");
            let Some((name, [.., distance])) = found else { continue };
            hits += 1;
            on_dust += usize::from(size < 1e-4);
            from = origin + f32::from_bits(distance) * direction;
            // The ray goes on from there, and a shadow ray comes back.
            let primitive = |scene: &PreparedScene, places: &[u32]| {
                let (number, instance) = scene.number_of(name);
                Primitive { triangle: places[number as usize], instance }
            };
            let [left, own_left] = [primitive(&flat, &places), primitive(&placed, &own_places)];
            let further = closest(&flat, from, direction, left);
            assert_eq!(closest(&placed, from, direction, own_left), further, "{from:?} {direction:?}");
            let back = Ray { origin, direction: from - origin, leaves: Primitive::NONE };
            if back.direction == Vec3::ZERO {
                continue;
            }
            let blocked = [(&flat, left), (&placed, own_left)]
                .map(|(scene, target)| bvh::trace_any(&scene.bvh, &scene.triangles, &back, target, 1.0));
            assert_eq!(blocked[0], blocked[1], "{origin:?} {direction:?}");
        }
    }
    assert!(hits > 100_000 && on_dust > 1000, "{hits} hits, {on_dust} of them on tiny triangles");
}

#[test]
fn no_ray_slips_through_a_closed_mesh_in_its_place() {
    let mut random = Random(SplitMix64::new(3));
    for size in [1.0, 1e-2, 1e-4] {
        let camera = Camera::pinhole(3.0 * DVec3::Z, DVec3::ZERO, 60.0);
        let mut scene = SceneBuilder::new(camera).material(Material::diffuse(Vec3::splat(0.5))).build();
        // The others make the scene large.
        let turn = 3.0 * random.vector();
        let placements = vec![
            placement(size * dvec3(1.0, 0.4, -0.7), turn, 0.3 * random.vector()),
            placement(DVec3::splat(1e-3), DVec3::ZERO, DVec3::splat(2.0)),
            placement(DVec3::splat(1e-3), DVec3::ZERO, DVec3::splat(-2.0)),
        ];
        scene.placed.push(PlacedMesh { mesh: pear(16, 11, [0, 0]), placements });
        let scene = prepared(&scene, Instances::TwoLevel);
        let corners = scene.corners();
        let body = &corners[..corners.len() / 3];
        let count = 3.0 * body.len() as f64;
        let middle =
            body.iter().flatten().fold(DVec3::ZERO, |sum, corner| sum + Vec3::from(*corner).as_dvec3() / count);
        for number in 0..50_000 {
            let triangle = body[(random.0.next_u64() % body.len() as u64) as usize].map(|c| Vec3::from(c).as_dvec3());
            let along = if number % 3 == 0 { 0.0 } else { 0.5 + 0.5 * random.next() };
            let target = triangle[number % 3].lerp(triangle[(number + 1) % 3], along);
            let inside = (middle + 0.05 * size * random.vector() * scene.normalisation.scale).as_vec3();
            let direction = (target - inside.as_dvec3()).as_vec3();
            let found = closest(&scene, inside, direction, Primitive::NONE);
            assert!(found.is_some_and(|(name, _)| name.instance == 1), "{number}: {inside:?} {direction:?} {found:?}");
        }
    }
}

#[test]
fn memory_grows_with_meshes_and_not_with_placements() {
    let mut random = Random(SplitMix64::new(1));
    let bytes = |scene: &PreparedScene| scene.buffers(true).iter().map(|buffer| buffer.size).sum::<u64>();
    let [few, many] = [10, 1010].map(|count| {
        let scene = heap(&mut random, count);
        assert_eq!(scene.triangle_count(), 90 * count as u64);
        let [flat, placed] = [Instances::Flatten, Instances::TwoLevel].map(|instances| prepared(&scene, instances));
        assert_eq!((flat.triangles.len(), placed.triangles.len()), (90 * count, 90));
        [bytes(&flat), bytes(&placed)]
    });
    // An instance of 160 bytes, and a node of 64.
    let of_placement = (many[1] - few[1]) / 1000;
    assert!((224..=225).contains(&of_placement), "{of_placement} bytes a placement");
    assert!((many[0] - few[0]) / 1000 > 90 * 48);
}

#[test]
fn instances_alike_do_not_slow_the_build() {
    let mut scene = heap(&mut Random(SplitMix64::new(2)), 1);
    scene.placed[0].placements = vec![scene.placed[0].placements[0]; 20_000];
    let placed = prepared(&scene, Instances::TwoLevel);
    assert!(placed.bvh.depth < 40, "{} levels", placed.bvh.depth);
    // Of triangles in one place, the first placement's are hit.
    let [a, b, c] = placed.corners()[40].map(Vec3::from);
    let found = closest(&placed, Vec3::ZERO, (a + b + c) / 3.0, Primitive::NONE);
    assert!(found.is_none_or(|(name, _)| name.instance == 1));
}

/// A disc of 40 triangles, as an OBJ file.
fn disc() -> String {
    let corners = (0..42).map(|i| std::f64::consts::TAU * f64::from(i) / 42.0);
    let vertices: String = corners.map(|angle| format!("v {} {} 0\n", angle.cos(), angle.sin())).collect();
    let polygon: String = (1..=42).map(|i| format!(" {i}")).collect();
    format!("{vertices}f{polygon}\n")
}

fn loaded(name: &str, text: &str) -> Scene {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join("disc.obj"), disc()).expect("a temporary file");
    fs::write(folder.path().join(name), text).expect("a temporary file");
    Scene::load(&folder.path().join(name)).expect("the scene loads")
}

#[test]
fn files_that_place_a_mesh_again_and_again_keep_it_once() {
    let camera = "[camera]\neye = [0, 0, 9]\ntarget = [0, 0, 0]\nvfov = 40\n";
    let mesh = |more: &str| format!("[[mesh]]\nfile = \"disc.obj\"\n{more}\n");
    let placements = ["translate = [1, 0, 0]", "scale = [-2, 1, 1]", "rotate = [0, 90, 0]"].map(mesh);
    let toml = |count: usize| loaded("s.toml", &format!("{camera}{}", placements[..count].concat()));
    // Two placements have 40 triangles more than one, which are soon flattened.
    let two = toml(2);
    assert_eq!((two.mesh.triangles.len(), two.placed.len()), (80, 0));
    let three = toml(3);
    assert_eq!((three.mesh.triangles.len(), three.placed_counts()), (0, vec![[40, 3]]));
    assert!(
        three.placed[0].placements.iter().all(|placement| !placement.is_mirrored),
        "a mesh may be turned inside out"
    );
    let (low, high) = three.bounds();
    assert!((low - dvec3(-2.0, -1.0, -1.0)).length() < 0.01 && (high - dvec3(2.0, 1.0, 1.0)).length() < 0.01);
    let flat = three.flattened();
    assert_eq!(flat.triangles.len(), 120);
    let corner = |triangle: usize| flat.positions[flat.triangles[triangle].positions[0] as usize];
    assert!((corner(0) - 2.0 * DVec3::X).length() < 1e-9 && (corner(40) + 2.0 * DVec3::X).length() < 1e-9);
    assert!((corner(80) + DVec3::Z).length() < 1e-9);

    // Groups of Mitsuba, one of whose placements flattens the disc to a line: it has no inverse, and no triangles.
    let instance =
        |to: &str| format!("<shape type='instance'><ref id='g'/><transform name='to_world'>{to}</transform></shape>");
    let instances = ["<translate x='3'/>", "<scale x='-1'/>", "<scale value='2'/>", "<scale x='0'/>"].map(instance);
    let group =
        "<shape type='shapegroup' id='g'><shape type='obj'><string name='filename' value='disc.obj'/></shape></shape>";
    let scene = loaded("s.xml", &format!("<scene version='3.0.0'>{group}{}</scene>", instances.concat()));
    assert_eq!((scene.mesh.triangles.len(), scene.placed_counts()), (0, vec![[40, 3]]));
    let mirrored = scene.placed[0].placements.iter().map(|placement| placement.is_mirrored);
    assert_eq!(mirrored.collect::<Vec<_>>(), [false, true, false]);
    assert!(scene.warnings.iter().any(|warning| warning.contains("40 triangles without area")), "{:?}", scene.warnings);
}

#[test]
fn placements_out_of_reach_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join("disc.obj"), disc()).expect("a temporary file");
    let mesh = "[[mesh]]\nfile = \"disc.obj\"\ntranslate = [9e29, 0, 0]\nscale = 2e29\n".repeat(3);
    let toml = format!("[camera]\neye = [0, 0, 9]\ntarget = [0, 0, 0]\nvfov = 40\n{mesh}");
    fs::write(folder.path().join("s.toml"), toml).expect("a temporary file");
    let error = Scene::load(&folder.path().join("s.toml")).expect_err("it is too far").to_string();
    assert!(error.ends_with("disc.obj: a vertex lands beyond 1e30; scale the mesh down"), "{error}");
}

#[test]
fn two_levels_are_of_the_binary_tree_alone() {
    let scene = orchard();
    for (kind, name) in [(BvhKind::List, "list"), (BvhKind::Bvh4, "bvh4"), (BvhKind::Cwbvh, "cwbvh")] {
        let refused = PreparedScene::with_tree(&scene, kind, Instances::TwoLevel).err();
        assert_eq!(refused, Some(PrepareError::TwoLevels(name)));
    }
    // Where nothing is placed twice there is nothing to keep apart.
    let plain = Scene::cornell_box();
    let tree = PreparedScene::with_tree(&plain, BvhKind::Cwbvh, Instances::TwoLevel).expect("it fits");
    assert!(!tree.bvh.has_two_levels());
}

#[test]
fn what_memory_cannot_hold_flattened_is_refused_with_the_way_out() {
    let mut scene = heap(&mut Random(SplitMix64::new(2)), 1);
    scene.placed[0].placements = vec![scene.placed[0].placements[0]; 2_000_000];
    let refused = PreparedScene::with_bvh(&scene, BvhKind::Bvh2).expect_err("180 million triangles are too many");
    assert!(refused.to_string().contains("180000000 triangles once its meshes are flattened"), "{refused}");
    assert!(refused.to_string().contains("--instances two-level"), "{refused}");
}
