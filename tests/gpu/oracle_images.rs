//! Whole images against references that another renderer made (see `tests/references`): every integrator
//! by every sampler and roulette.
//!
//! Images are compared by z-tests of the means of 8x8-pixel blocks, each channel, and of the whole
//! image, held together to one level by Šidák's correction. Seeds are fixed, so a test that
//! passes keeps passing until the renderer changes.

use std::fs;
use std::ops::ControlFlow;
use std::path::PathBuf;

use crate::common::project::output_folder;
use crate::common::{assert_silent, device, own_scene, prepare, project_file, render_on, samples_on, tries};
use glam::DVec3;
use raywave::gpu::Device;
use raywave::image::{Image, WriteOptions, read_image, write_image};
use raywave::render::Session;
use raywave::scene::{Environment, Scene};
use raywave::settings::Integrator::{self, Explicit, Implicit, Mis};
use raywave::settings::RouletteMode::{self, Constant, Throughput};
use raywave::settings::Sampler::{self, Independent, Sobol};
use raywave::settings::Settings;
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
