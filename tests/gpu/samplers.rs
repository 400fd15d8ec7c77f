//! Statistical tests of every sampler on the device: chi-square against its density, means
//! against integrals in f64. Seeds are fixed, so a verdict is the same at every run.

use crate::common;
use std::cmp::Ordering;
use std::f64::consts::{PI, TAU};

use crate::meshes::{cuboid, placed};
use crate::probe::{
    Bench, BsdfAnswer, SurfaceQuery, Uniform, any_scene, grey, lanes, scene_of, scene_of_materials, spherical, vector,
};
use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec2, DVec3, Vec3};
use raywave::constants::{ENVIRONMENT_LAT_LONG, NO_TRIANGLE};
use raywave::gpu::Device;
use raywave::scene::{Camera, Environment, EnvironmentMap, Material, Surface};
use raywave::settings::Sampler;
use raywave_studies::oracle::sobol::{scramble, sobol4};
use raywave_studies::oracle::{optics, pcg4d};
use raywave_studies::stats::{Moments, SplitMix64, chi_square, sidak_adjusted, z_test};

/// How seldom a family of tests may fail by chance.
const LEVEL: f64 = 1e-3;

/// p-values that are judged together.
#[derive(Default)]
struct Family(Vec<(f64, String)>);

impl Family {
    /// Do the counts follow their expectation?
    fn counts(&mut self, observed: &[f64], expected: &[f64], name: impl Into<String>) {
        self.0.push((chi_square(observed, expected).p, name.into()));
    }

    /// Do the points fill the unit square evenly, together and along either side alone?
    fn square(&mut self, points: impl Iterator<Item = DVec2> + Clone, name: impl Into<String>) {
        let name = name.into();
        for (columns, rows) in [(16, 16), (64, 1), (1, 64)] {
            let observed = square_counts(points.clone(), columns, rows);
            let even = observed.iter().sum::<f64>() / observed.len() as f64;
            self.counts(&observed, &vec![even; observed.len()], format!("{name} in {columns} x {rows} cells"));
        }
    }

    /// Is the mean of the values as expected?
    fn mean(&mut self, values: impl IntoIterator<Item = f64>, expected: f64, name: impl Into<String>) {
        let moments = values.into_iter().fold(Moments::default(), |mut moments, value| {
            moments.push(value);
            moments
        });
        // A sampler may be exact: then rounding alone is left.
        let error = moments.standard_error() + 2e-6 * expected.abs();
        self.0.push((z_test(moments.mean() - expected, error).p, name.into()));
    }
}

impl Drop for Family {
    fn drop(&mut self) {
        let smallest = self.0.iter().min_by(|a, b| a.0.total_cmp(&b.0));
        if let (Some((p, name)), false) = (smallest, std::thread::panicking()) {
            let p = sidak_adjusted(*p, self.0.len());
            assert!(p > LEVEL, "{name}: p = {p:e}, among {} tests", self.0.len());
        }
    }
}

/// Counts of points of the unit square in equal cells.
fn square_counts(points: impl IntoIterator<Item = DVec2>, columns: usize, rows: usize) -> Vec<f64> {
    let mut counts = vec![0.0; columns * rows];
    for point in points {
        let cell = |x: f64, cells: usize| ((x * cells as f64) as usize).min(cells - 1);
        counts[cell(point.y, rows) * columns + cell(point.x, columns)] += 1.0;
    }
    counts
}

/// Turns of `v` around `axis`, in [0, 1).
fn turn(axis: DVec3, v: DVec3) -> f64 {
    let (x, y) = axis.any_orthonormal_pair();
    (v.dot(y).atan2(v.dot(x)) / TAU).rem_euclid(1.0)
}

// Random numbers

/// A bench whose random numbers are the sampler's.
fn sampling_by(device: &Device, sampler: Sampler) -> Bench {
    let mut bench = Bench::new(device, &any_scene());
    bench.settings.sampler = sampler;
    bench
}

/// Names which part of a key runs.
type Stream = (&'static str, fn(u32) -> [u32; 4]);

/// Keys of a stream.
const KEYS: u32 = 1 << 16;

/// Are the numbers of each stream even, and unrelated to each other and to those of keys some steps away?
fn unrelated(family: &mut Family, run: impl Fn(&[[u32; 4]]) -> Vec<[f32; 4]>, streams: &[Stream], steps: &[[u32; 4]]) {
    let even = vec![f64::from(KEYS) / 1024.0; 1024];
    for (name, key) in streams {
        let keys: Vec<_> = (0..KEYS).map(key).collect();
        let numbers = run(&keys);
        for d in 0..4 {
            let alone = square_counts(numbers.iter().map(|u| DVec2::new(u[d].into(), 0.0)), 1024, 1);
            family.counts(&alone, &even, format!("dimension {d} over {name}"));
            for e in 0..d {
                let counts = pair_counts(&numbers, d, &numbers, e);
                family.counts(&counts, &even, format!("dimensions {d} and {e} over {name}"));
            }
        }
        for step in steps {
            let next: Vec<_> = keys.iter().map(|key| std::array::from_fn(|i| key[i] + step[i])).collect();
            let next = run(&next);
            for d in 0..4 {
                let counts = pair_counts(&numbers, d, &next, d);
                family.counts(&counts, &even, format!("dimension {d} and its neighbour at {step:?} over {name}"));
            }
        }
    }
}

/// Counts of a dimension of some numbers beside one of others, in 32 x 32 cells.
fn pair_counts(a: &[[f32; 4]], d: usize, b: &[[f32; 4]], e: usize) -> Vec<f64> {
    square_counts(a.iter().zip(b).map(|(a, b)| DVec2::new(a[d].into(), b[e].into())), 32, 32)
}

#[test]
fn random_numbers_are_uniform_and_independent_of_their_neighbours() {
    let bench = sampling_by(&common::device(), Sampler::Independent);
    let run = |keys: &[[u32; 4]]| {
        let numbers: Vec<[f32; 4]> = bench.run("random", keys);
        for (key, numbers) in keys.iter().zip(&numbers) {
            assert_eq!(*numbers, pcg4d(*key).map(|x| (x >> 8) as f32 * (-24_f32).exp2()));
        }
        numbers
    };
    let mut family = Family::default();
    // What runs fastest, for a pixel, a sample, a vertex, a seed, and for pixels of a row.
    let streams: [Stream; 6] = [
        ("pixels", |i| [i, 0, 0, 0]),
        ("samples", |i| [77, i, 2, 0]),
        ("blocks", |i| [77, 5, i, 0]),
        ("seeds", |i| [77, 5, 2, i]),
        ("samples of pixels", |i| [i / 64, i % 64, 1, 3]),
        ("blocks of samples", |i| [99, i / 16, i % 16, 1]),
    ];
    // Pixel to the right, pixel below, next sample, next block, same block of the next bounce, next seed.
    let steps = [[1, 0, 0, 0], [512, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 2, 0], [0, 0, 0, 1]];
    unrelated(&mut family, run, &streams, &steps);
}

/// Keys at random, of samples up to the last that a pixel can have.
#[test]
fn sobol_points_are_those_of_the_papers() {
    let mut random = SplitMix64::new(9);
    let keys: Vec<[u32; 4]> = (0..1 << 16)
        .map(|i| {
            let [a, b] = [random.next_u64(), random.next_u64()];
            let sample = if i % 2 == 0 { (a >> 40) as u32 } else { (a >> 40) as u32 % 64 };
            [a as u32, sample, b as u32 % 100, (b >> 32) as u32]
        })
        .collect();
    let numbers: Vec<[f32; 4]> = sampling_by(&common::device(), Sampler::Sobol).run("random", &keys);
    for (key, numbers) in keys.iter().zip(&numbers) {
        assert_eq!(numbers.map(f64::from), sobol4(*key), "{key:?}");
    }
}

/// A scramble is nested: what it does to a bit depends on the bits above it alone, and on every one of them.
#[test]
fn scrambles_are_nested() {
    let mut random = SplitMix64::new(10);
    let mut flips = [[0_u32; 32]; 32];
    const KEYS: u32 = 2000;
    for _ in 0..KEYS {
        let (x, seed) = (random.next_u64() as u32, (random.next_u64() >> 32) as u32);
        for (bit, flips) in flips.iter_mut().enumerate() {
            let changed = (scramble(x, seed) ^ scramble(x ^ 1 << bit, seed)) ^ 1 << bit;
            assert_eq!(changed >> bit, 0, "bit {bit} of {x:x} changes itself or one above it");
            flips.iter_mut().enumerate().for_each(|(other, n)| *n += changed >> other & 1);
        }
    }
    // Of the bits that make a number: each of the eight under the highest turns on each above it about as often
    // as not. Deep bits may depend less on single ones.
    for (bit, flips) in flips.iter().enumerate().skip(24) {
        for (other, flips) in flips.iter().enumerate().take(bit).skip(23) {
            let share = f64::from(*flips) / f64::from(KEYS);
            assert!((0.2..0.8).contains(&share), "bit {other} turns on bit {bit} with {share}");
        }
    }
}

/// Every aligned run of 2^m samples has one point in each elementary interval of area 2^-m, of both pairs:
/// a (0, 2)-sequence in base 2. (Niederreiter 1992, section 4.1)
#[test]
fn sobol_pairs_have_a_point_in_every_elementary_interval() {
    const LOG: u32 = 12;
    let bench = sampling_by(&common::device(), Sampler::Sobol);
    for (pixel, block, seed, first) in
        [(0, 0, 0, 0), (1, 0, 0, 0), (77, 3, 5, 0), (4096, 18, 1, 3 << LOG), (9, 2, 7, (1 << 24) - (1 << LOG))]
    {
        let keys: Vec<_> = (first..first + (1 << LOG)).map(|sample| [pixel, sample, block, seed]).collect();
        let numbers: Vec<[f32; 4]> = bench.run("random", &keys);
        for pair in 0..2 {
            let points: Vec<[u32; 2]> = numbers
                .iter()
                .map(|u| [0, 1].map(|i| (f64::from(u[2 * pair + i]) * f64::from(1 << 24)) as u32))
                .collect();
            for m in 0..=LOG {
                for (run, points) in points.chunks(1 << m).enumerate() {
                    for columns in 0..=m {
                        let mut taken = vec![false; 1 << m];
                        for [x, y] in points {
                            let cell = (x >> (24 - columns)) << (m - columns) | y >> (24 - (m - columns));
                            let again = std::mem::replace(&mut taken[cell as usize], true);
                            assert!(
                                !again,
                                "two points in a cell of 2^-{columns} by 2^-{}, run {run}, pair {pair}",
                                m - columns
                            );
                        }
                    }
                }
            }
        }
    }
}

/// Between pixels, blocks and seeds the numbers of a sample are as those of independent samplers; and over the
/// samples of a pixel the pairs of a vertex, of vertices and of neighbours fill their squares together too.
#[test]
fn sobol_sequences_know_nothing_of_each_other() {
    let bench = sampling_by(&common::device(), Sampler::Sobol);
    let run = |keys: &[[u32; 4]]| -> Vec<[f32; 4]> { bench.run("random", keys) };
    let mut family = Family::default();
    let streams: [Stream; 5] = [
        ("pixels", |i| [i, 0, 0, 0]),
        ("pixels, a later sample", |i| [i, 1_000_003, 4, 2]),
        ("blocks", |i| [77, 5, i, 0]),
        ("seeds", |i| [77, 5, 2, i]),
        ("blocks of pixels", |i| [i / 16, 9, i % 16, 1]),
    ];
    let steps = [[1, 0, 0, 0], [512, 0, 0, 0], [0, 0, 1, 0], [0, 0, 2, 0], [0, 0, 0, 1], [1, 1, 0, 0]];
    unrelated(&mut family, run, &streams, &steps);
    drop(family);

    // Within a pixel sequences are shuffled by a hash that is not perfect: their squares are filled a little more
    // or less evenly than by chance. A quarter more is the most that was seen, over hundreds of keys.
    let unevenness = |a: &[[f32; 4]], d: usize, b: &[[f32; 4]], e: usize| {
        let even = f64::from(KEYS) / 1024.0;
        pair_counts(a, d, b, e).iter().map(|n| (n - even).powi(2) / even).sum::<f64>() / 1023.0
    };
    let mut all = Vec::new();
    for key in [[3, 0, 2, 0], [500, 0, 7, 4], [70_000, 0, 1, 9]] {
        let [own, next, beside] = [[0, 0], [0, 1], [1, 0]].map(|[pixel, block]| {
            let keys: Vec<_> = (0..KEYS).map(|i| [key[0] + pixel, i, key[2] + block, key[3]]).collect();
            run(&keys)
        });
        all.extend([(0, 2), (0, 3), (1, 2), (1, 3)].map(|(d, e)| unevenness(&own, d, &own, e)));
        for other in [&next, &beside] {
            all.extend((0..16).map(|i| unevenness(&own, i / 4, other, i % 4)));
        }
    }
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    assert!((0.8..1.05).contains(&mean), "on the average {mean} of chance");
    assert!(all.iter().all(|x| *x < 1.5), "{all:?}");
}

// Warps

#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Warp {
    axis: [f32; 3],
    exponent: f32,
    u: [f32; 4],
}

#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Warped {
    cosine: [f32; 4],
    cosine_power: [f32; 4],
    disk: [f32; 2],
    triangle: [f32; 2],
}

#[test]
fn warps_follow_their_densities() {
    const N: usize = 1 << 17;
    let device = common::device();
    let bench = Bench::new(&device, &any_scene());
    let mut family = Family::default();
    let mut random = Uniform::new(1);
    let axes = [DVec3::Z, DVec3::NEG_Z, DVec3::new(1.0, 2.0, -3.0), DVec3::new(1e-4, -2e-4, -1.0), DVec3::X];
    for axis in axes.map(|axis| axis.normalize().as_vec3()) {
        for exponent in [0.0, 1.0, 20.0, 1000.0] {
            let queries: Vec<Warp> = (0..N)
                .map(|_| {
                    let [u, v] = random.next();
                    Warp { axis: axis.to_array(), exponent, u: [u, v, 0.0, 0.0] }
                })
                .collect();
            let answers: Vec<Warped> = bench.run("warps", &queries);
            let axis = axis.as_dvec3();
            let mut lobe = |name: &str, exponent: f32, direction: fn(&Warped) -> [f32; 4]| {
                // (n + 1) / (2 pi) cos^n puts cos^(n + 1) and the turn evenly over the square.
                let points = answers.iter().map(|answer| {
                    let v = vector(direction(answer));
                    assert!((v.length() - 1.0).abs() < 1e-6, "{name}: {v} is no unit vector {:e}", v.length() - 1.0);
                    let cosine = axis.dot(v);
                    assert!(cosine > -1e-7, "{name}: {v} is more than a right angle from {axis}");
                    DVec2::new(cosine.clamp(0.0, 1.0).powf(f64::from(exponent) + 1.0), turn(axis, v))
                });
                family.square(points, format!("{name} {exponent} about {axis}"));
            };
            lobe("sample_cosine", 1.0, |answer| answer.cosine);
            lobe("cosine_power_of", exponent, |answer| answer.cosine_power);

            let disk = answers.iter().map(|answer| {
                let p = DVec2::from(answer.disk.map(f64::from));
                assert!(p.length() < 1.0 + 1e-6);
                DVec2::new(p.length_squared(), turn(DVec3::Z, p.extend(0.0)))
            });
            family.square(disk, "sample_disk");

            let triangle: Vec<_> = answers.iter().map(|answer| DVec2::from(answer.triangle.map(f64::from))).collect();
            assert!(triangle.iter().all(|p| p.min_element() >= 0.0 && p.element_sum() <= 1.0 + 1e-6));
            // Half of the square: a cell on its diagonal counts half.
            let area = |cell: usize| match (cell % 16 + cell / 16).cmp(&15) {
                Ordering::Less => 2.0,
                Ordering::Equal => 1.0,
                Ordering::Greater => 0.0,
            };
            let expected: Vec<_> = (0..256).map(|cell| area(cell) * N as f64 / 256.0).collect();
            family.counts(&square_counts(triangle, 16, 16), &expected, "sample_triangle");
        }
    }
}

// Camera

#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct CameraRay {
    origin: [f32; 4],
    direction: [f32; 4],
}

#[test]
fn camera_rays_fill_their_pixels_and_the_lens() {
    const N: u32 = 1 << 14;
    let device = common::device();
    let mut family = Family::default();
    for aperture in [0.0, 0.25] {
        let mut scene = any_scene();
        let eye = DVec3::new(1.0, 2.0, 3.0);
        scene.camera =
            Camera { eye, target: DVec3::ZERO, up: DVec3::Y, vfov: 50.0, orthographic: None, aperture, focus: 2.5 };
        (scene.settings.width, scene.settings.height) = (4, 3);
        let bench = Bench::new(&device, &scene);
        let frame = bench.scene.frame(&bench.settings, 1);
        let [eye, right, up, forward] = [frame.camera_eye, frame.camera_right, frame.camera_up, frame.camera_forward]
            .map(|v| DVec3::from(v.map(f64::from)));
        let focus = f64::from(frame.focus_distance);
        for pixel in [0, 3, 5, 8, 11] {
            let queries: Vec<_> = (0..N).map(|sample| [pixel, sample, 0, 0]).collect();
            let answers: Vec<CameraRay> = bench.run("camera", &queries);
            let mut in_pixel = Vec::new();
            let mut on_lens = Vec::new();
            for ray in &answers {
                let shift = vector(ray.origin) - eye;
                let direction = vector(ray.direction);
                assert!((direction.length() - 1.0).abs() < 1e-6, "{:e}", direction.length() - 1.0);
                // Where the ray meets the plane in focus, from the image's top left to its bottom right.
                let point = shift + direction * (focus / direction.dot(forward));
                let x = 0.5 + 0.5 * point.dot(right) / right.length_squared() / focus;
                let y = 0.5 - 0.5 * point.dot(up) / up.length_squared() / focus;
                let position = DVec2::new(x * 4.0, y * 3.0) - DVec2::new(f64::from(pixel % 4), f64::from(pixel / 4));
                assert!(position.min_element() > -1e-5 && position.max_element() < 1.0 + 1e-5, "{position} in {pixel}");
                in_pixel.push(position);
                assert!(shift.dot(forward).abs() < 1e-6);
                let lens = DVec2::new(shift.dot(right.normalize()), shift.dot(up.normalize()));
                on_lens.push(lens / f64::from(frame.lens_radius.max(f32::MIN_POSITIVE)));
            }
            family.square(in_pixel.iter().copied(), format!("jitter of {pixel}"));
            if aperture == 0.0 {
                assert!(answers.iter().all(|ray| vector(ray.origin) == eye), "a pinhole is a point");
                continue;
            }
            let lens: Vec<_> =
                on_lens.iter().map(|p| DVec2::new(p.length_squared(), turn(DVec3::Z, p.extend(0.0)))).collect();
            assert!(lens.iter().all(|p| p.x < 1.0 + 1e-4));
            family.square(lens.iter().copied(), format!("lens of {pixel}"));
            for (a, b) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let joint = in_pixel.iter().zip(&lens).map(|(p, q)| DVec2::new(p[a], q[b]));
                family.square(joint, format!("jitter {a} and lens {b} of {pixel}"));
            }
        }
    }
}

// Surfaces

fn materials() -> Vec<Material> {
    let glossy =
        |kd: [f32; 3], ks: [f32; 3], exponent| Material { diffuse: kd.into(), specular: ks.into(), exponent, ..grey() };
    vec![
        glossy([0.5, 0.7, 0.2], [0.0; 3], 1.0),
        glossy([0.0; 3], [1.0; 3], 0.0),
        glossy([0.0; 3], [1.0, 0.5, 0.2], 1.0),
        glossy([0.0; 3], [0.9; 3], 20.0),
        glossy([0.3, 0.1, 0.6], [0.3, 0.6, 0.2], 5.0),
        glossy([0.5; 3], [0.5; 3], 1000.0),
    ]
}

/// Cells of the hemisphere over a normal: even in the root of 1 - cosine, which spreads a narrow
/// lobe about the normal, and in the turn.
const RINGS: usize = 16;
const TURNS: usize = 32;

fn hemisphere_cell(normal: DVec3, v: DVec3) -> usize {
    let cell = |x: f64, cells: usize| ((x * cells as f64) as usize).min(cells - 1);
    cell(turn(normal, v), TURNS) * RINGS + cell((1.0 - normal.dot(v)).clamp(0.0, 1.0).sqrt(), RINGS)
}

/// Abscissas in (0, 1) and weights, for what is smooth. (Gauss and Legendre)
fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    let n = count as f64;
    let node = |i: usize| {
        // Newton's method on the Legendre polynomial, from a good guess.
        let mut x = (PI * (i as f64 + 0.75) / (n + 0.5)).cos();
        let mut slope = 0.0;
        for _ in 0..10 {
            let (mut before, mut p) = (1.0, x);
            for k in 2..=count {
                let k = k as f64;
                (before, p) = (p, ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k);
            }
            slope = n * (x * p - before) / (x * x - 1.0);
            x -= p / slope;
        }
        (0.5 + 0.5 * x, 1.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..count).map(node).collect()
}

/// Abscissas in (0, 1) and weights, for what has edges.
fn midpoints(count: usize) -> Vec<(f64, f64)> {
    (0..count).map(|i| ((i as f64 + 0.5) / count as f64, 1.0 / count as f64)).collect()
}

/// Integrals over the cells of the hemisphere, by a rule along both sides of a cell.
fn integrate_cells(normal: DVec3, rule: &[(f64, f64)], f: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
    let cell = |cell: usize| {
        let points = rule.iter().flat_map(|a| rule.iter().map(move |b| (a, b)));
        let parts = points.map(|((x, x_weight), (y, y_weight))| {
            let root = ((cell % RINGS) as f64 + x) / RINGS as f64;
            let phi = TAU * ((cell / RINGS) as f64 + y) / TURNS as f64;
            let angle = 2.0 * root * TAU / (RINGS * TURNS) as f64 * x_weight * y_weight;
            angle * f(spherical(normal, 1.0 - root * root, phi))
        });
        parts.sum()
    };
    (0..RINGS * TURNS).map(cell).collect()
}

#[test]
fn glossy_scattering_follows_its_density_and_its_weights_their_integral() {
    const N: usize = 1 << 17;
    let device = common::device();
    let scene = scene_of_materials(materials());
    let bench = Bench::new(&device, &scene);
    let mut family = Family::default();
    let mut random = Uniform::new(2);
    let up = DVec3::new(0.2, -0.3, 0.5).normalize();
    let tilted = spherical(up, 0.9, 1.0);
    let rule = gauss_legendre(16);
    for (index, material) in scene.materials.iter().enumerate() {
        for (angle, shading, side) in
            [(0.0_f64, up, 1.0), (40.0, up, -1.0), (80.0, up, 1.0), (89.5, up, 1.0), (50.0, tilted, 1.0)]
        {
            let wo = spherical(side * up, angle.to_radians().cos(), 2.0);
            let queries: Vec<_> = (0..N)
                .map(|_| {
                    let query = SurfaceQuery::new(index, up, wo, wo);
                    SurfaceQuery { shading_normal: lanes(shading), u: random.next(), ..query }
                })
                .collect();
            let answers: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
            let name = format!("material {index} from {angle} degrees, shading {:.2}", shading.dot(up));

            let n = side * shading;
            let above = |wi: DVec3| f64::from(n.dot(wi) > 0.0 && side * up.dot(wi) > 0.0);
            let density = |wi: DVec3| optics::scatter_density(material, n, wo, wi);
            let masses = |n: DVec3, counted: &dyn Fn(DVec3) -> f64| -> Vec<f64> {
                integrate_cells(n, &rule, |wi| DVec3::X * density(wi) * counted(wi)).iter().map(|v| v.x).collect()
            };
            let everywhere: f64 = [n, -n].iter().flat_map(|n| masses(*n, &|_| 1.0)).sum();
            assert!((everywhere - 1.0).abs() < 3e-3, "{name}: the density adds up to {everywhere}");

            // Directions under the horizon carry nothing and share a cell.
            let mut expected = masses(n, &above);
            expected.push(1.0 - expected.iter().sum::<f64>());
            expected.iter_mut().for_each(|mass| *mass = (*mass * N as f64).max(0.0));
            let mut observed = vec![0.0; expected.len()];
            for answer in &answers {
                let carries = answer.weight[..3].iter().any(|&weight| weight > 0.0);
                let cell = hemisphere_cell(n, vector(answer.direction));
                observed[if carries { cell } else { RINGS * TURNS }] += 1.0;
            }
            family.counts(&observed, &expected, name.clone());

            let albedo: DVec3 =
                integrate_cells(n, &rule, |wi| optics::glossy(material, n, wo, wi) * above(wi)).into_iter().sum();
            for channel in 0..3 {
                let weights = answers.iter().map(|answer| f64::from(answer.weight[channel]));
                family.mean(weights, albedo[channel], format!("albedo of {name}"));
            }
        }
    }
}

#[test]
fn dielectrics_choose_by_fresnel() {
    const N: usize = 1 << 14;
    let device = common::device();
    let mut family = Family::default();
    let mut random = Uniform::new(3);
    let n = DVec3::new(-0.4, 0.1, 0.7).normalize();
    for ni in [1.5, 2.4, 1.0003, 0.7] {
        let mut scene = any_scene();
        scene.materials = vec![Material { surface: Surface::Dielectric, ior: ni, ..grey() }];
        let bench = Bench::new(&device, &scene);
        for (angle, side) in
            [(0.0_f64, 1.0), (30.0, 1.0), (75.0, 1.0), (89.0, 1.0), (20.0, -1.0), (41.0, -1.0), (60.0, -1.0)]
        {
            let cosine = angle.to_radians().cos();
            let wo = spherical(side * n, cosine, 0.5);
            let queries: Vec<_> = (0..N)
                .map(|_| SurfaceQuery { choice: random.next::<1>()[0], ..SurfaceQuery::new(0, n, wo, wo) })
                .collect();
            let answers: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
            let reflected = answers.iter().filter(|a| side * n.dot(vector(a.direction)) > 0.0).count() as f64;
            let r = optics::reflectance(cosine, f64::from(ni).powf(side));
            let expected = [r * N as f64, (1.0 - r) * N as f64];
            family.counts(&[reflected, N as f64 - reflected], &expected, format!("index {ni} at {angle} degrees"));
        }
    }
}

// Lights

#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct LightQuery {
    triangle: u32,
    barycentrics: [f32; 2],
    unused: u32,
    wo: [f32; 4],
    u: [f32; 4],
}

#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct LightAnswer {
    origin: [f32; 4],
    ray: [f32; 4],
    direction: [f32; 4],
    radiance: [f32; 4],
    infinity: [f32; 4],
    light: u32,
    blocked: u32,
    unused: [u32; 2],
}

/// Asks for light at the middle of the scene's first triangle, which lies in the plane z = 0 and
/// looks up.
fn ask_for_light(bench: &Bench, count: usize, random: &mut Uniform) -> (Vec<LightQuery>, Vec<LightAnswer>) {
    let triangle = bench.scene.bvh.order.iter().position(|&original| original == 0).expect("it is there") as u32;
    let queries: Vec<_> = (0..count)
        .map(|_| LightQuery {
            triangle,
            barycentrics: [0.25, 0.25],
            unused: 0,
            wo: lanes(random.direction()),
            u: random.next(),
        })
        .collect();
    let mut answers: Vec<LightAnswer> = bench.run("light", &queries);
    // Kernels know radiance times a power of two.
    let unscaled = |radiance: [f32; 4]| radiance.map(|c| c / bench.scene.radiance_scale as f32);
    for answer in &mut answers {
        (answer.radiance, answer.infinity) = (unscaled(answer.radiance), unscaled(answer.infinity));
    }
    (queries, answers)
}

/// A floor with the middle (0, 0, 0), for [`ask_for_light`].
fn floor() -> [DVec3; 3] {
    [DVec3::ZERO, DVec3::X, DVec3::Y].map(|v| 4.0 * v - DVec3::new(1.0, 1.0, 0.0))
}

/// Distance along `direction` from `origin` to a triangle, and the cosine there. (Moeller and Trumbore 1997)
fn meet(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(ac);
    let inverse = 1.0 / ab.dot(p);
    let u = (origin - a).dot(p) * inverse;
    let q = (origin - a).cross(ab);
    let v = direction.dot(q) * inverse;
    let distance = ac.dot(q) * inverse;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0).then_some(distance)
}

/// Solid angle of a triangle. (Van Oosterom and Strackee 1983)
fn solid_angle(origin: DVec3, corners: [DVec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|v| (v - origin).normalize());
    2.0 * a.dot(b.cross(c)).abs().atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a))
}

#[test]
fn lamps_are_sampled_by_area_and_weighed_by_solid_angle() {
    const N: usize = 1 << 16;
    let lamp = |centre: [f64; 3], u: [f64; 3], v: [f64; 3]| {
        let (centre, u, v) = (DVec3::from(centre), DVec3::from(u), DVec3::from(v));
        [centre - u - v, centre + u - v, centre + v]
    };
    let lamps = [
        lamp([0.0, 0.0, 2.0], [0.0, 0.6, 0.0], [0.5, 0.0, 0.1]),
        lamp([1.5, 0.5, 1.0], [0.0, 0.3, 0.1], [0.1, 0.0, 0.5]),
        lamp([-1.0, 0.8, 0.6], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0]),
        lamp([-1.2, -1.5, 1.2], [0.0, 0.5, 0.0], [0.9, 0.2, 0.0]),
        // Seen from behind, and almost on edge.
        lamp([0.5, -1.2, 1.6], [0.4, 0.0, 0.0], [0.0, 0.6, 0.0]),
        lamp([0.7, 1.6, 0.0], [0.0, 0.0, 0.4], [0.1, 0.8, 0.0]),
    ];
    let mut scene = scene_of(&[&[floor()][..], &lamps[..]].concat());
    let ke = Vec3::new(3.0, 2.0, 1.0);
    scene.materials.push(Material { emission: ke, ..grey() });
    scene.mesh.triangles[1..].iter_mut().for_each(|triangle| triangle.material = 1);
    let device = common::device();
    let bench = Bench::new(&device, &scene);
    let (_, answers) = ask_for_light(&bench, N, &mut Uniform::new(4));

    let corners: Vec<[DVec3; 3]> =
        bench.scene.triangles.iter().map(|t| [t.v0, t.v1, t.v2].map(|v| Vec3::from(v).as_dvec3())).collect();
    let floor = bench.scene.bvh.order.iter().position(|&original| original == 0).expect("it is there");
    let [a, b, c] = corners[floor];
    let origin = a + 0.25 * (b - a) + 0.25 * (c - a);
    let doubled_normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a);
    let areas: Vec<f64> = corners
        .iter()
        .enumerate()
        .map(|(place, corners)| if place == floor { 0.0 } else { 0.5 * doubled_normal(*corners).length() })
        .collect();
    let area: f64 = areas.iter().sum();
    // All are alike bright, so power and area are in one proportion.
    for (place, triangle) in bench.scene.triangles.iter().enumerate() {
        let expected = if place == floor { 0.0 } else { area };
        assert!((f64::from(triangle.light_area) - expected).abs() < 1e-6 * area);
    }
    let mut family = Family::default();

    // Lamps by area, which is what the alias table is for.
    let mut picks = vec![0.0; corners.len()];
    answers.iter().for_each(|answer| picks[answer.light as usize] += 1.0);
    let expected: Vec<_> = areas.iter().map(|a| a / area * N as f64).collect();
    family.counts(&picks, &expected, "picks of lamps");

    // Directions by solid angle: distance squared over area and cosine.
    let sphere = [DVec3::Z, DVec3::NEG_Z];
    let mut observed = vec![0.0; 2 * RINGS * TURNS];
    for answer in &answers {
        let direction = vector(answer.direction);
        let below = usize::from(direction.z < 0.0);
        observed[below * RINGS * TURNS + hemisphere_cell(sphere[below], direction)] += 1.0;
    }
    let density = |direction: DVec3| -> f64 {
        let lamps = corners.iter().zip(&areas).filter(|(_, lamp)| **lamp > 0.0);
        let densities = lamps.filter_map(|(corners, _)| {
            let distance = meet(origin, direction, *corners)?;
            let cosine = doubled_normal(*corners).normalize().dot(direction).abs();
            Some(distance * distance / (area * cosine))
        });
        densities.sum()
    };
    let expected: Vec<f64> = sphere
        .iter()
        .flat_map(|axis| integrate_cells(*axis, &midpoints(64), |direction| DVec3::X * density(direction)))
        .map(|v| v.x)
        .collect();
    let mass: f64 = expected.iter().sum();
    assert!((mass - 1.0).abs() < 1e-2, "the density adds up to {mass}");
    let expected: Vec<f64> = expected.iter().map(|cell| cell / mass * N as f64).collect();
    family.counts(&observed, &expected, "directions to lamps");

    // Each sample is the radiance over that density, and their mean the lit solid angle.
    for answer in &answers {
        let normal = doubled_normal(corners[answer.light as usize]).normalize();
        let to_light = vector(answer.origin) + vector(answer.ray) - origin;
        let cosine = -normal.dot(to_light.normalize());
        let expected = 3.0 * cosine.max(0.0) * area / to_light.length_squared();
        let error = (f64::from(answer.radiance[0]) - expected).abs();
        assert!(error <= 1e-5 * expected + 3e-6 * area / to_light.length_squared(), "{answer:?}: {expected}");
        assert!((vector(answer.direction) - to_light.normalize()).length() < 1e-5);
    }
    let lit: f64 = corners
        .iter()
        .zip(&areas)
        .filter(|(corners, area)| **area > 0.0 && doubled_normal(**corners).dot(origin - corners[0]) > 0.0)
        .map(|(corners, _)| solid_angle(origin, *corners))
        .sum();
    for channel in 0..3 {
        let values = answers.iter().map(|answer| f64::from(answer.radiance[channel]));
        family.mean(values, lit * f64::from(ke[channel]), "light of the lamps");
    }
}

/// A sky with a sun, a black band, and noise.
fn sky() -> EnvironmentMap {
    let (width, height) = (16, 8);
    let mut random = Uniform::new(5);
    let mut radiance: Vec<Vec3> = (0..width * height).map(|_| Vec3::from(random.next::<3>())).collect();
    radiance[3 * 16 + 12] = Vec3::new(400.0, 300.0, 200.0);
    radiance[5 * 16..7 * 16 + 5].fill(Vec3::ZERO);
    EnvironmentMap { path: "sky".into(), width, height, radiance, rotation: DMat3::IDENTITY }
}

/// Bilinear radiance of the sky, from the format's words: the centre column looks along -z, u
/// grows towards +x, row 0 is +y.
fn sky_radiance(sky: &EnvironmentMap, direction: DVec3) -> DVec3 {
    let (width, height) = (i64::from(sky.width), i64::from(sky.height));
    let u = 0.5 + direction.x.atan2(-direction.z) / TAU;
    let v = direction.y.clamp(-1.0, 1.0).acos() / PI;
    let p = DVec2::new(u * width as f64, v * height as f64) - 0.5;
    let texel = |x: i64, y: i64| {
        let at = y.clamp(0, height - 1) * width + x.rem_euclid(width);
        sky.radiance[at as usize].as_dvec3()
    };
    let (x, y, f) = (p.x.floor() as i64, p.y.floor() as i64, p - p.floor());
    let row = |y: i64| texel(x, y).lerp(texel(x + 1, y), f.x);
    row(y).lerp(row(y + 1), f.y)
}

/// Directions of a grid of `parts` x `parts` in every texel, with its index and their solid angle.
fn sky_grid(sky: &EnvironmentMap, parts: u32) -> impl Iterator<Item = (usize, DVec3, f64)> {
    let (columns, rows, width) = (sky.width * parts, sky.height * parts, sky.width);
    (0..rows).flat_map(move |row| {
        (0..columns).map(move |column| {
            let theta = |row: f64| PI * row / f64::from(rows);
            let phi = TAU * ((f64::from(column) + 0.5) / f64::from(columns) - 0.5);
            let (sine, cosine) = theta(f64::from(row) + 0.5).sin_cos();
            let solid = (theta(row.into()).cos() - theta(f64::from(row) + 1.0).cos()) * TAU / f64::from(columns);
            let direction = DVec3::new(sine * phi.sin(), cosine, -sine * phi.cos());
            ((row / parts * width + column / parts) as usize, direction, solid)
        })
    })
}

#[test]
fn the_sky_is_sampled_by_its_luminance() {
    const N: usize = 1 << 18;
    let sky = sky();
    let mut scene = scene_of(&[floor()]);
    scene.environment = Environment::LatLong(sky.clone());
    let device = common::device();
    let bench = Bench::new(&device, &scene);
    assert_eq!(bench.scene.features.environment, ENVIRONMENT_LAT_LONG);
    let (queries, answers) = ask_for_light(&bench, N, &mut Uniform::new(6));
    let mut family = Family::default();

    // Texels are as probable as they are bright.
    let texels = &bench.scene.environment;
    let mut luminance = vec![0.0; texels.len()];
    for (texel, direction, solid) in sky_grid(&sky, 32) {
        luminance[texel] += solid * sky_radiance(&sky, direction).dot(DVec3::new(0.2126, 0.7152, 0.0722));
    }
    let total: f64 = luminance.iter().sum();
    for (texel, luminance) in texels.iter().zip(&luminance) {
        let (p, share) = (f64::from(texel.probability), luminance / total);
        assert!((p - share).abs() <= 0.1 * share + 1e-4, "a texel of share {share} is picked with {p}");
        assert_eq!(p == 0.0, share == 0.0);
    }

    // Picks follow the probabilities, and lie evenly in solid angle within a texel.
    let mut observed = vec![0.0; texels.len() * 9];
    for answer in &answers {
        let direction = vector(answer.direction);
        assert!((direction.length() - 1.0).abs() < 1e-6, "{:e}", direction.length() - 1.0);
        let x = (0.5 + direction.x.atan2(-direction.z) / TAU) * f64::from(sky.width);
        let y = direction.y.clamp(-1.0, 1.0).acos() / PI * f64::from(sky.height);
        let (column, row) = ((x as usize).min(15), (y as usize).min(7));
        let edge = |row: usize| (PI * row as f64 / f64::from(sky.height)).cos();
        let down = (edge(row) - direction.y) / (edge(row) - edge(row + 1));
        let third = |x: f64| ((3.0 * x) as usize).min(2);
        observed[(row * 16 + column) * 9 + third(down) * 3 + third(x - column as f64)] += 1.0;
    }
    let expected: Vec<_> = texels.iter().flat_map(|texel| [f64::from(texel.probability) * N as f64 / 9.0; 9]).collect();
    family.counts(&observed, &expected, "directions to the sky");

    // Each sample is the sky's radiance over its density.
    for (query, answer) in queries.iter().zip(&answers) {
        let direction = vector(answer.direction);
        let (row, column) = {
            let v = direction.y.clamp(-1.0, 1.0).acos() / PI * f64::from(sky.height);
            let u = (0.5 + direction.x.atan2(-direction.z) / TAU) * f64::from(sky.width);
            (v, u)
        };
        // Drivers' sines may take a direction over the edge of its texel.
        let on_edge = |x: f64| (x - x.round()).abs() < 3e-3;
        if !on_edge(row) && !on_edge(column) {
            let texel = row as usize * 16 + column as usize;
            let edge = |row: f64| (PI * row / f64::from(sky.height)).cos();
            let solid = TAU / f64::from(sky.width) * (edge(row.floor()) - edge(row.floor() + 1.0));
            let expected = sky_radiance(&sky, direction) * solid / f64::from(texels[texel].probability);
            let error = (vector(answer.radiance) - expected).abs();
            // What drivers' sines allow.
            let tolerance = 5e-4 * expected + 1e-2 * solid / f64::from(texels[texel].probability);
            assert!(error.cmple(tolerance).all(), "{answer:?}: {expected}");
            // A path that finds the sky there by its BRDF is weighed against the density of light samples.
            let (own, found) = (answer.origin[3], answer.ray[3]);
            assert!((own / found - 1.0).abs() < 1e-5, "{own} and {found} are one density");
        }
        assert_eq!((answer.light, answer.blocked), (NO_TRIANGLE, 0));
        let seen = sky_radiance(&sky, vector(query.wo));
        let error = (vector(answer.infinity) - seen).abs();
        assert!(error.cmple(1e-4 * seen + 1e-2).all(), "{:?}: {seen}", answer.infinity);
    }
    let light: DVec3 = sky_grid(&sky, 32).map(|(_, direction, solid)| solid * sky_radiance(&sky, direction)).sum();
    for channel in 0..3 {
        let values = answers.iter().map(|answer| f64::from(answer.radiance[channel]));
        family.mean(values, light[channel], "light of the sky");
    }
}

#[test]
fn a_constant_sky_is_sampled_by_the_cosine_and_shares_with_lamps() {
    const N: usize = 1 << 16;
    let device = common::device();
    let mut random = Uniform::new(7);
    let mut scene = scene_of(&[floor()]);
    scene.environment = Environment::Constant(Vec3::new(1.0, 2.0, 3.0));
    let bench = Bench::new(&device, &scene);
    let (queries, answers) = ask_for_light(&bench, N, &mut random);
    let mut family = Family::default();
    let points = queries.iter().zip(&answers).map(|(query, answer)| {
        let n = DVec3::Z * f64::from(query.wo[2].signum());
        let direction = vector(answer.direction);
        let cosine = n.dot(direction);
        let expected = 2.0 * PI / cosine;
        assert!((f64::from(answer.radiance[1]) / expected - 1.0).abs() < 1e-4 || cosine < 1e-3);
        assert_eq!((answer.light, answer.blocked), (NO_TRIANGLE, 0));
        DVec2::new(cosine * cosine, turn(n, direction))
    });
    family.square(points, "directions to the constant sky");

    scene.mesh.positions.extend([DVec3::new(0.0, 0.0, 1.0), DVec3::new(0.0, 0.5, 1.0), DVec3::new(0.5, 0.0, 1.0)]);
    scene.mesh.triangles.push(raywave::scene::Triangle {
        positions: [3, 4, 5],
        material: 1,
        ..scene.mesh.triangles[0]
    });
    scene.materials.push(Material { emission: Vec3::ONE, ..grey() });
    let bench = Bench::new(&device, &scene);
    let (_, answers) = ask_for_light(&bench, N, &mut random);
    let far = answers.iter().filter(|answer| answer.light == NO_TRIANGLE).count() as f64;
    let sky_share = f64::from(bench.scene.frame(&bench.settings, 1).sky_probability);
    assert!((0.1..=0.9).contains(&sky_share));
    family.counts(&[far, N as f64 - far], &[sky_share * N as f64, (1.0 - sky_share) * N as f64], "sky or lamp");
    // Both count for what they stand for. All light: the sky's as a cosine density's 1/cos diverges, so the lamp's.
    let lamp = bench.scene.triangles.iter().find(|t| t.material == 1).expect("it is there");
    let floor = bench.scene.triangles.iter().find(|t| t.material == 0).expect("it is there");
    let [a, b, c] = [floor.v0, floor.v1, floor.v2].map(|v| Vec3::from(v).as_dvec3());
    let origin = 0.5 * a + 0.25 * b + 0.25 * c;
    let lit = solid_angle(origin, [lamp.v0, lamp.v1, lamp.v2].map(|v| Vec3::from(v).as_dvec3()));
    let of_lamp = |answer: &LightAnswer| if answer.light == NO_TRIANGLE { 0.0 } else { f64::from(answer.radiance[0]) };
    family.mean(answers.iter().map(of_lamp), lit, "light of the lamp beside the sky");
}

#[test]
fn in_a_convex_room_nothing_hides_the_lamp() {
    let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.3, 0.5, 0.7);
    let room = placed(&cuboid(DVec3::NEG_ONE, DVec3::ONE), turn, 3.0, DVec3::new(40.0, -20.0, 10.0));
    let inwards: Vec<_> = room.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
    let mut scene = scene_of(&inwards);
    scene.materials.push(Material { emission: Vec3::ONE, ..grey() });
    scene.mesh.triangles[10..].iter_mut().for_each(|ceiling| ceiling.material = 1);
    let bench = Bench::new(&common::device(), &scene);
    let mut random = Uniform::new(8);
    let queries: Vec<_> = (0..1 << 18)
        .map(|i| {
            let [u, v] = random.next::<2>().map(|x| 0.01 + 0.98 * x);
            let barycentrics = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
            LightQuery { triangle: i % 12, barycentrics, unused: 0, wo: lanes(DVec3::Z), u: random.next() }
        })
        .collect();
    let answers: Vec<LightAnswer> = bench.run("light", &queries);
    let lit = answers.iter().filter(|answer| answer.radiance[0] > 0.0);
    assert!(lit.clone().count() > queries.len() / 2);
    assert_eq!(lit.filter(|answer| answer.blocked != 0).count(), 0, "shadow rays are blocked");
}
