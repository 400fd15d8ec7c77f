//! Whole images against references that another renderer made (see `tests/references`), every integrator by every sampler
//! and roulette; and rooms of every kind of material against the oracle's path tracer in `f64`.
//!
//! Images are compared by z-tests of the means of 8x8-pixel blocks, each channel, and of the whole
//! image, held together to one level by Šidák's correction. Seeds are fixed, so a test that
//! passes keeps passing until the renderer changes.

use std::fs;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;

use crate::common::project::output_folder;
use crate::common::{assert_silent, device, own_scene, prepare, project_file, render_on, samples_on, tries};
use crate::microfacets::{cloth, glassy};
use glam::{Affine2, DVec3, Vec2, Vec3, dvec3};
use half::f16;
use rayon::prelude::*;
use raywave::gpu::Device;
use raywave::image::{Image, WriteOptions, read_image, write_image};
use raywave::render::Session;
use raywave::scene::{
    Camera, Environment, Falloff, Light, Lookup, Material, Parameter, Principled, Scene, SceneBuilder, Surface,
    Texture, Wrap, shapes,
};
use raywave::settings::Integrator::{self, Explicit, Implicit, Mis};
use raywave::settings::RouletteMode::{self, Constant, Throughput};
use raywave::settings::Sampler::{self, Independent, Sobol};
use raywave::settings::Settings;
use raywave_studies::oracle::Reference;
use raywave_studies::stats::{sidak_level, z_test};

/// Probability that a right image fails.
const LEVEL: f64 = 1e-3;
/// Pixels along the side of a block: enough for its mean to be normal.
const BLOCK: u32 = 8;

/// An image and the variance of each of its pixels.
struct Estimate {
    mean: Image,
    variance: Image,
    /// What the brightest path of one sample adds to a pixel. A block that saw no such path has no
    /// variance to show for it, so one of them is allowed for.
    brightest_path: f64,
}

/// A comparison of two estimates of one image.
struct Verdict {
    smallest_p: f64,
    allowed_p: f64,
    /// z of every block and channel.
    blocks: Vec<DVec3>,
    whole: DVec3,
}

impl Estimate {
    fn reference(name: &str) -> Self {
        let file = |suffix| project_file(&format!("tests/references/{name}{suffix}"));
        let read = |path: PathBuf| read_image(&path).expect("references are readable");
        Self { mean: read(file(".exr")), variance: read(file(".var.exr")), brightest_path: 0.0 }
    }

    fn rendered(device: &Device, scene: &str, settings: impl Fn(Settings) -> Settings) -> Self {
        let scene = own_scene(scene);
        let own = Settings { width: 64, height: 64, seed: 1, sampler: Independent, ..scene.settings };
        let settings = settings(own);
        let survival = (1.0 - settings.roulette).powi(settings.max_bounces.unwrap_or(0) as i32);
        let brightest_path = f64::from(brightest_light(&scene)) / survival / f64::from(settings.samples);
        let (mean, variance) = if settings.sampler == Independent {
            let film = render_on(device, &scene, &settings).film;
            (film.mean(), film.variance_of_mean())
        } else {
            replicated(device, &scene, &settings)
        };
        Self { mean, variance, brightest_path }
    }

    /// Sums of mean and variance over the pixels that `keep` holds for.
    fn sums(&self, keep: impl Fn(u32, u32) -> bool) -> (DVec3, DVec3) {
        let width = self.mean.width;
        let pixels = self.mean.pixels.iter().zip(&self.variance.pixels).zip(0_u32..);
        pixels
            .filter(|(_, i)| keep(i % width, i / width))
            .fold((DVec3::ZERO, DVec3::ZERO), |(mean, variance), ((m, v), _)| {
                (mean + m.as_dvec3(), variance + v.as_dvec3())
            })
    }
}

/// Seeds of an estimate whose samples know of each other.
const SEEDS: u32 = 4;

/// Mean and its variance of renders that differ by their seeds and share the samples: those of one Sobol
/// sequence are no measure of each other's error.
fn replicated(device: &Device, scene: &Scene, settings: &Settings) -> (Image, Image) {
    let prepared = prepare(device, scene, settings);
    let mut session = Session::new(device, &prepared, settings).expect("the session starts");
    let mut render = |seed| {
        session.reseed(&prepared, seed, settings.samples / SEEDS).expect("the device goes on");
        let outcome = session.render(|_| ControlFlow::Continue(())).expect("the render ends");
        assert_eq!(outcome.statistics.nonfinite_samples, 0, "NaN or infinite samples");
        outcome.film.mean()
    };
    let renders: Vec<Image> = (0..SEEDS).map(&mut render).collect();
    assert_silent(device);
    let over_seeds = |of: &dyn Fn(Vec<DVec3>) -> DVec3| {
        let pixel = |i: usize| of(renders.iter().map(|image| image.pixels[i].as_dvec3()).collect()).as_vec3();
        Image::new(settings.width, settings.height, (0..renders[0].pixels.len()).map(pixel).collect())
    };
    let seeds = f64::from(SEEDS);
    let mean = |values: &[DVec3]| values.iter().sum::<DVec3>() / seeds;
    let variance = |values: Vec<DVec3>| {
        let mean = mean(&values);
        values.iter().map(|value| (value - mean).powf(2.0)).sum::<DVec3>() / (seeds - 1.0) / seeds
    };
    (over_seeds(&|values| mean(&values)), over_seeds(&variance))
}

/// Largest radiance that a light of the scene gives, in any channel.
fn brightest_light(scene: &Scene) -> f32 {
    let lamps = scene.materials.iter().map(|material| material.emission.max_element());
    let sky = match &scene.environment {
        Environment::Black => 0.0,
        Environment::Constant(radiance) => radiance.max_element(),
        Environment::LatLong(map) => map.radiance.iter().map(|r| r.max_element()).fold(0.0, f32::max),
    };
    lamps.fold(sky, f32::max)
}

fn compare(a: &Estimate, b: &Estimate) -> Verdict {
    let z = |keep: &dyn Fn(u32, u32) -> bool| {
        let ((mean_a, variance_a), (mean_b, variance_b)) = (a.sums(keep), b.sums(keep));
        let deviation = mean_a - mean_b;
        // Pixels that both renderers find constant agree to rounding, not to the bit.
        let rounding = 1e-6 * (mean_a.abs() + mean_b.abs());
        let unseen = DVec3::splat(a.brightest_path.max(b.brightest_path));
        let error = (variance_a + variance_b + rounding * rounding + unseen * unseen).map(f64::sqrt);
        DVec3::from_array(std::array::from_fn(|c| z_test(deviation[c], error[c]).z))
    };
    let (columns, rows) = (a.mean.width / BLOCK, a.mean.height / BLOCK);
    let blocks: Vec<DVec3> =
        (0..columns * rows).map(|i| z(&|x, y| x / BLOCK == i % columns && y / BLOCK == i / columns)).collect();
    let whole = z(&|_, _| true);
    let all: Vec<f64> = blocks.iter().chain([&whole]).flat_map(|z| z.to_array()).collect();
    let smallest_p = all.iter().map(|&z| z_test(z, 1.0).p).fold(1.0, f64::min);
    Verdict { smallest_p, allowed_p: sidak_level(LEVEL, all.len()), blocks, whole }
}

/// Fails with both images, the z-scores of the blocks and the p-value, which it leaves in files.
fn assert_agree(case: &str, ours: &Estimate, reference: &Estimate) {
    let verdict = compare(ours, reference);
    if verdict.smallest_p >= verdict.allowed_p {
        return;
    }
    let folder = output_folder().join(case);
    fs::create_dir_all(&folder).expect("the target folder can be written");
    for (name, image) in [("rendered.exr", &ours.mean), ("reference.exr", &reference.mean)] {
        write_image(&folder.join(name), image, &WriteOptions::default()).expect("images can be written");
    }
    let scores: Vec<String> = verdict.blocks.iter().map(|z| format!("{:.2} {:.2} {:.2}", z.x, z.y, z.z)).collect();
    fs::write(folder.join("block-z.txt"), scores.join("\n")).expect("texts can be written");
    panic!(
        "{case} differs: the smallest p is {:.2e} where {:.2e} is allowed; the whole image has z {:.2}; see {}",
        verdict.smallest_p,
        verdict.allowed_p,
        verdict.whole,
        folder.display()
    );
}

/// Renders one case by independent samples and a constant roulette and compares it with its reference.
fn check(reference: &str, scene: &str, bounces: u32, integrator: Integrator, samples: u32, roulette: f64) {
    check_way(&device(), reference, scene, bounces, (integrator, Independent, Constant), samples, roulette);
}

/// Renders one case and compares it with its reference.
fn check_way(
    device: &Device,
    reference: &str,
    scene: &str,
    bounces: u32,
    (integrator, sampler, roulette_mode): (Integrator, Sampler, RouletteMode),
    samples: u32,
    roulette: f64,
) {
    let ours = Estimate::rendered(device, scene, |settings| Settings {
        integrator,
        sampler,
        samples: samples_on(device, samples),
        max_bounces: Some(bounces),
        roulette,
        roulette_mode,
        roulette_from: 1,
        ..settings
    });
    let case = format!("{reference}-{integrator:?}-{sampler:?}-{roulette_mode:?}-q{roulette}").to_lowercase();
    assert_agree(&case, &ours, &Estimate::reference(reference));
}

#[test]
fn box_emitters_alone() {
    for integrator in [Implicit, Explicit] {
        check("box-n0", "cornell-box", 0, integrator, 256, 0.0);
    }
}

#[test]
fn box_direct_light() {
    check("box-n1", "cornell-box", 1, Implicit, 2048, 0.0);
    check("box-n1", "cornell-box", 1, Explicit, 512, 0.0);
}

#[test]
fn box_four_bounces() {
    check("box-n4", "cornell-box", 4, Implicit, 2048, 0.0);
    check("box-n4", "cornell-box", 4, Explicit, 512, 0.0);
}

#[test]
fn box_with_roulette() {
    for roulette in [0.2, 0.8] {
        check("box-n4", "cornell-box", 4, Implicit, 4096, roulette);
        check("box-n4", "cornell-box", 4, Explicit, 1024, roulette);
    }
}

/// Every integrator by every sampler and roulette that the tests above leave out.
#[test]
fn box_by_every_way() {
    let device = device();
    let mut cases = 0..;
    for integrator in [Implicit, Explicit, Mis] {
        let samples = if integrator == Implicit { 2048 } else { 512 };
        for sampler in [Independent, Sobol] {
            for (mode, roulette) in [(Constant, 0.0), (Constant, 0.3), (Throughput, 0.0), (Throughput, 0.2)] {
                let is_tried = cases.next().is_some_and(|case| tries(&device, case, 7));
                if is_tried && (sampler == Sobol || mode == Throughput || integrator == Mis) {
                    check_way(&device, "box-n4", "cornell-box", 4, (integrator, sampler, mode), samples, roulette);
                }
            }
        }
    }
}

/// MIS and the roulette by throughput where there is glass, gloss, a sky, or lamps beside a sky.
#[test]
fn other_scenes_by_mis_and_throughput() {
    let device = device();
    let mut cases = 0..;
    for (reference, scene, bounces, samples) in [
        ("box-n0", "cornell-box", 0, 256),
        ("box-n1", "cornell-box", 1, 512),
        ("caustic-n4", "cornell-caustic", 4, 1024),
        ("glass-n8", "cornell-glass", 8, 512),
        ("phong-n4", "cornell-phong", 4, 512),
        ("sky-n4-centred", "textured-sky", 4, 512),
        ("smooth-n3", "smooth", 3, 512),
    ] {
        for (way, roulette) in
            [((Mis, Independent, Constant), 0.0), ((Mis, Sobol, Throughput), 0.1), ((Explicit, Sobol, Throughput), 0.0)]
        {
            if cases.next().is_some_and(|case| tries(&device, case, 4)) {
                check_way(&device, reference, scene, bounces, way, samples, roulette);
            }
        }
    }
}

#[test]
fn caustic() {
    check("caustic-n4", "cornell-caustic", 4, Implicit, 2048, 0.0);
    check("caustic-n4", "cornell-caustic", 4, Explicit, 1024, 0.0);
}

#[test]
fn glass() {
    check("glass-n8", "cornell-glass", 8, Implicit, 1024, 0.0);
    check("glass-n8", "cornell-glass", 8, Explicit, 512, 0.0);
}

#[test]
fn phong() {
    check("phong-n4", "cornell-phong", 4, Implicit, 1024, 0.0);
    check("phong-n4", "cornell-phong", 4, Explicit, 512, 0.0);
}

#[test]
fn textured_sky() {
    check("sky-n4-centred", "textured-sky", 4, Implicit, 512, 0.0);
    check("sky-n4-centred", "textured-sky", 4, Explicit, 512, 0.0);
}

#[test]
fn vertex_normals() {
    check("smooth-n3", "smooth", 3, Implicit, 1024, 0.0);
    check("smooth-n3", "smooth", 3, Explicit, 512, 0.0);
}

/// The comparison itself: equal estimates pass, and a bias of two percent does not.
#[test]
fn the_comparison_sees_a_small_bias() {
    let explicit = |settings| Settings { samples: 256, max_bounces: Some(1), ..settings };
    let mut ours = Estimate::rendered(&device(), "cornell-box", explicit);
    let reference = Estimate::reference("box-n1");
    let verdict = compare(&ours, &reference);
    assert!(verdict.smallest_p >= verdict.allowed_p);
    ours.mean.pixels.iter_mut().for_each(|pixel| *pixel *= 1.02);
    let verdict = compare(&ours, &reference);
    assert!(verdict.smallest_p < verdict.allowed_p);
}

/// Copper, by Mitsuba's table.
fn copper(alpha: f32) -> Material {
    Material::conductor(Vec3::new(0.200, 0.924, 1.102), Vec3::new(3.912, 2.452, 2.142), alpha)
}

const ORANGE: Vec3 = Vec3::new(0.9, 0.5, 0.1);

fn lossy(material: Material) -> Material {
    Material { compensates: false, ..material }
}

/// Metals, glass, plastics and mixtures of metal.
fn metals_and_coats() -> Vec<Material> {
    let tinted = |material| Material { transmission: Vec3::new(0.9, 0.7, 0.5), ..material };
    let beckmann = |material| Material { is_beckmann: true, ..lossy(material) };
    let nonlinear = |material| Material { surface: Surface::Plastic { nonlinear: true }, ..material };
    vec![
        copper(0.0),
        copper(0.2),
        copper(0.8),
        lossy(copper(0.3)).rough(0.6, 0.1),
        beckmann(copper(0.25)),
        tinted(Material::dielectric(1.5).rough(0.2, 0.2)),
        tinted(Material::dielectric(1.8).rough(0.7, 0.7)),
        beckmann(Material::dielectric(1.5).rough(0.15, 0.15)),
        Material { surface: Surface::ThinDielectric, ..tinted(Material::dielectric(1.7)) },
        Material::plastic(ORANGE, 1.5, 0.0),
        Material::plastic(ORANGE, 1.5, 0.15),
        nonlinear(Material { is_beckmann: true, ..Material::plastic(ORANGE, 1.7, 0.3) }),
        Material::metal_rough(ORANGE, 0.0, 0.25),
        Material::metal_rough(ORANGE, 0.6, 0.7),
        Material { coat: 0.9, coat_roughness: 0.1, ..Material::metal_rough(ORANGE, 0.3, 0.3) },
        Material { emission: Vec3::new(0.1, 0.3, 0.6), is_pure_emitter: false, ..Material::diffuse(Vec3::splat(0.5)) },
    ]
}

/// Disney's materials, and materials that are made of others: those of the first places are parts of the last.
fn disney_and_mixtures() -> Vec<Material> {
    let textured = |material: Material, images: &[(Parameter, u32)]| {
        let mut textures = [None; Parameter::COUNT];
        images.iter().for_each(|(parameter, image)| textures[*parameter as usize] = Some(*image));
        Material { textures, ..material }
    };
    let leaf = Principled {
        anisotropy: 0.5,
        sheen: 0.7,
        specular_share: 0.6,
        flatness: 0.5,
        diffuse_transmission: 0.4,
        ..Default::default()
    };
    let coated = |material| Material { metalness: 0.3, coat: 0.8, coat_roughness: 0.08, ..material };
    let made_of = |surface| Material { surface, ..Material::diffuse(Vec3::ZERO) };
    vec![
        Material::principled(ORANGE, 1.5, 0.16, Principled::default()),
        coated(Material::principled(ORANGE, 1.5, 0.49, cloth())),
        Material::principled(ORANGE, 1.4, 0.36, glassy()),
        Material::principled_thin(ORANGE, 1.33, 0.25, leaf),
        textured(Material::diffuse(Vec3::ONE), &[(Parameter::Diffuse, 0)]),
        textured(lossy(copper(0.3)), &[(Parameter::Roughness, 1)]),
        textured(Material::metal_rough(ORANGE, 0.5, 0.3), &[(Parameter::Metalness, 2)]),
        Material::dielectric(1.5),
        Material::mirror(Vec3::splat(0.9)),
        made_of(Surface::Nothing),
        Material { weight: 0.3, ..made_of(Surface::Blend(1, 4)) },
        Material { weight: 0.6, ..made_of(Surface::Blend(0, 9)) },
        textured(made_of(Surface::Blend(9, 4)), &[(Parameter::Weight, 1)]),
        made_of(Surface::Sides { front: 5, back: 4 }),
        Material { weight: 0.5, ..made_of(Surface::Blend(13, 8)) },
        Material::phong(ORANGE * 0.4, Vec3::splat(0.5), 30.0),
    ]
}

/// Sixteen boxes on a floor, each of another material, with texture coordinates from 0 to 1 on every face. The materials have
/// the first places in the scene.
fn boxes(camera: Camera, materials: Vec<Material>) -> SceneBuilder {
    let bare = SceneBuilder::new(camera).resolution(48, 32);
    let all = materials.into_iter().fold(bare, SceneBuilder::material);
    let room = all.material(Material::diffuse(Vec3::new(0.6, 0.5, 0.4)));
    let floor =
        room.polygon(&[dvec3(-3.0, 0.0, 3.0), dvec3(3.0, 0.0, 3.0), dvec3(3.0, 0.0, -3.0), dvec3(-3.0, 0.0, -3.0)]);
    (0..16).fold(floor, |scene, place| {
        let corner = dvec3(f64::from(place % 4) * 1.4 - 2.6, 0.05, f64::from(place / 4) * 1.4 - 2.6);
        scene.polygons(shapes::cuboid(corner, corner + dvec3(1.0, 0.4 + 0.2 * f64::from(place % 3), 1.0)))
    })
}

/// Ends such a scene: gives each box its material, and faces their texture coordinates.
fn with_materials_of_boxes(scene: SceneBuilder) -> Scene {
    let mut scene = scene.build();
    let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    scene.mesh.uvs = (0..scene.mesh.positions.len()).map(|i| corners[i % 4]).collect();
    for (i, triangle) in scene.mesh.triangles.iter_mut().enumerate() {
        triangle.uvs = triangle.positions;
        // Two triangles of the floor, then twelve of each box.
        if (2..2 + 16 * 12).contains(&i) {
            triangle.material = (i as u32 - 2) / 12;
        }
    }
    scene
}

fn image(lookup: Lookup, texel: impl Fn(u32) -> Vec3) -> Texture {
    let texels: Vec<[f16; 4]> = (0..12).map(|i| texel(i).extend(1.0).to_array().map(f16::from_f32)).collect();
    Texture { path: PathBuf::new(), width: 4, height: 3, texels: Arc::from(texels), lookup }
}

/// Light that the oracle finds, by as many samples of each pixel.
fn traced(scene: &Scene, settings: &Settings, samples: u32) -> Estimate {
    let settings = Settings { seed: 77, sampler: Independent, ..*settings };
    let reference = Reference::new(scene, &settings).expect("the oracle knows the scene");
    let pixel = |pixel: u32| {
        let radiances = (0..samples).map(|sample| reference.path(pixel, sample).radiance);
        let (sum, squares) = radiances.fold((DVec3::ZERO, DVec3::ZERO), |(sum, squares), r| (sum + r, squares + r * r));
        let (n, mean) = (f64::from(samples), sum / f64::from(samples));
        (mean.as_vec3(), ((squares / n - mean * mean) / (n - 1.0)).as_vec3())
    };
    let pixels: Vec<_> = (0..settings.width * settings.height).into_par_iter().map(pixel).collect();
    let (mean, variance) = pixels.into_iter().unzip();
    let image = |pixels| Image::new(settings.width, settings.height, pixels);
    let brightest_path = f64::from(brightest_light(scene)) / f64::from(samples);
    Estimate { mean: image(mean), variance: image(variance), brightest_path }
}

/// Renders a scene here and by the oracle.
fn check_by_oracle(case: &str, scene: &Scene, integrator: Integrator, samples: [u32; 2]) {
    let device = device();
    let settings = Settings {
        integrator,
        sampler: Independent,
        samples: samples_on(&device, samples[0]),
        max_bounces: Some(4),
        ..scene.settings
    };
    let film = render_on(&device, scene, &settings).film;
    let brightest_path = f64::from(brightest_light(scene)) / f64::from(settings.samples);
    let ours = Estimate { mean: film.mean(), variance: film.variance_of_mean(), brightest_path };
    assert_agree(&format!("{case}-{integrator:?}").to_lowercase(), &ours, &traced(scene, &settings, samples[1]));
}

#[test]
fn metals_glass_and_coats_under_a_lamp_and_a_spot() {
    let camera = Camera::pinhole(dvec3(0.5, 6.0, 5.5), dvec3(0.0, 0.1, 0.3), 48.0);
    let scene = boxes(camera, metals_and_coats())
        .material(Material::emitter(Vec3::new(7.0, 6.0, 5.0)))
        .polygon(&[dvec3(-1.0, 4.0, -1.0), dvec3(1.0, 4.0, -1.0), dvec3(1.0, 4.0, 1.0), dvec3(-1.0, 4.0, 1.0)])
        .light(Light::Spot {
            position: dvec3(3.0, 5.0, 2.0),
            direction: dvec3(-3.0, -5.0, -2.0).normalize(),
            intensity: Vec3::new(20.0, 30.0, 40.0),
            angles: [15.0, 30.0],
            falloff: Falloff::Angle,
        });
    let scene = with_materials_of_boxes(scene);
    check_by_oracle("metals", &scene, Mis, [512, 96]);
    check_by_oracle("metals", &scene, Implicit, [1024, 96]);
}

#[test]
fn disneys_materials_and_mixtures_under_a_sky_seen_from_far() {
    let camera =
        Camera { orthographic: Some(6.4), ..Camera::pinhole(dvec3(1.5, 5.0, 5.0), dvec3(0.0, 0.2, 0.1), 40.0) };
    let scene = boxes(camera, disney_and_mixtures())
        .environment(Environment::Constant(Vec3::new(0.3, 0.4, 0.6)))
        .light(Light::Directional {
            direction: dvec3(-0.3, -1.0, -0.4).normalize(),
            irradiance: Vec3::new(1.2, 1.0, 0.7),
        })
        .light(Light::Point { position: dvec3(-2.0, 3.0, 2.0), intensity: Vec3::new(3.0, 2.0, 2.0) });
    let mut scene = with_materials_of_boxes(scene);
    let turned = Affine2::from_scale_angle_translation(Vec2::new(1.7, 2.3), 0.4, Vec2::new(0.3, -0.8));
    scene.textures = vec![
        image(Lookup::default(), |i| Vec3::new(0.2, 0.5, 0.8) + 0.05 * Vec3::new(1.0, -1.0, 0.3) * i as f32),
        image(Lookup { transform: turned, wrap: Wrap::Clamp, is_smooth: true }, |i| Vec3::splat(0.08 * (1 + i) as f32)),
        image(Lookup { transform: turned, wrap: Wrap::Mirror, is_smooth: false }, |i| {
            Vec3::splat(((5 * i) % 12) as f32 / 12.0)
        }),
    ];
    check_by_oracle("disney", &scene, Mis, [512, 96]);
    check_by_oracle("disney", &scene, Explicit, [512, 96]);
}
