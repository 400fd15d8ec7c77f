//! raywave's arithmetic on the device, held to the CPU's: operations to the last bit, whatever the driver makes of
//! what is left to it, and elementary functions to the errors that `elementary.glsl` states.

use std::f64::consts::{PI, TAU};

use crate::common::device;
use crate::common::not_tested::not_tested;
use crate::probe::{Bench, any_scene, hostile, lanes, vector};
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use half::f16;
use rayon::prelude::*;
use raywave::facts;
use raywave::gpu::Device;
use raywave::shaders::{Form, Forms};
use raywave_studies::stats::SplitMix64;

/// Input of the probe `arithmetic`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Query {
    a: [f32; 4],
    b: [f32; 4],
}

/// Its output.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Answer {
    quotient: f32,
    reciprocal: f32,
    root: f32,
    inverse_root: f32,
    quotients: [f32; 3],
    dot_product: f32,
    cross_product: [f32; 3],
    length: f32,
    unit: [f32; 3],
    smaller: f32,
    reflected: [f32; 3],
    larger: f32,
    mixed: [f32; 3],
    half_bits: u32,
    reciprocals: [f32; 3],
    fraction: f32,
    halves: [f32; 2],
    snorms: [f32; 2],
    is_nan: u32,
    is_inf: u32,
    unused: [u32; 2],
}

/// A number that devices may take a number for: a subnormal one is itself, or a zero of its sign. So is one that
/// rounding has just made normal.
fn taken_for(x: f32) -> [f32; 2] {
    [x, if x.abs() <= f32::MIN_POSITIVE { 0.0_f32.copysign(x) } else { x }]
}

fn is_quotient(found: f32, a: f32, b: f32) -> bool {
    let quotients = taken_for(a).into_iter().flat_map(|a| taken_for(b).map(|b| a / b));
    quotients.flat_map(taken_for).any(|quotient| same(found, quotient))
}

fn is_root(found: f32, a: f32) -> bool {
    taken_for(a).iter().any(|a| same(found, a.sqrt()))
}

/// Equal to the last bit; not-a-numbers are alike.
fn same(a: f32, b: f32) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

/// Numbers at which roundings, exponents and signs change.
fn edges() -> Vec<f32> {
    let magnitudes = [
        0,
        1,
        0x0000_1000,
        0x007f_ffff,
        0x0080_0000,
        0x0080_0001,
        0x00ff_ffff,
        0x0100_0000,
        0x3380_0000,
        0x3f7f_ffff,
        0x3f80_0000,
        0x3f80_0001,
        0x3fff_ffff,
        0x4000_0000,
        0x4040_0000,
        0x4b7f_ffff,
        0x4b80_0001,
        0x7e7f_ffff,
        0x7e80_0000,
        0x7f00_0001,
        0x7f7f_ffff,
        0x7f80_0000,
        0x7fc0_0000,
    ];
    magnitudes.iter().flat_map(|bits| [*bits, bits | 1 << 31]).map(f32::from_bits).collect()
}

/// Pairs of edges, of any numbers, and of numbers of everyday size.
fn queries() -> Vec<Query> {
    let edges = edges();
    let mut random = SplitMix64::new(7);
    let mut any = || f32::from_bits(random.next_u64() as u32);
    let mut queries = Vec::new();
    for a in &edges {
        queries.extend(edges.iter().map(|b| Query { a: [*a, *b, 1.0, 0.5], b: [*b, *a, 3.0, 0.25] }));
    }
    let of = |numbers: &mut dyn FnMut() -> f32| Query {
        a: std::array::from_fn(|_| numbers()),
        b: std::array::from_fn(|_| numbers()),
    };
    queries.extend((0..1 << 16).map(|_| of(&mut any)));
    let mut everyday = || f32::from_bits((any().to_bits() & 0x87ff_ffff) | 0x3c00_0000);
    queries.extend((0..1 << 18).map(|_| of(&mut everyday)));
    queries
}

/// By fused multiplication and addition.
const FUSED: Forms = Forms { division: Form::ByFma, reciprocal: Form::ByFma, root: Form::ByFma };

fn answers(device: &Device, forms: Forms, is_hostile: bool, queries: &[Query]) -> Vec<Answer> {
    let mut bench = Bench::new(device, &any_scene());
    bench.forms = Some(forms);
    bench.driver = is_hostile.then(hostile);
    bench.run("arithmetic", queries)
}

#[test]
fn quotients_and_roots_are_rounded_right_whatever_the_driver_does() {
    let device = device();
    let queries = queries();
    let facts = facts::of(&device).expect("the device can be measured");
    let native = facts.division_exact && facts.reciprocal_exact && facts.root_exact;
    for (forms, is_hostile, is_right) in [
        (Forms::NATIVE, false, native),
        (FUSED, false, facts.fma_fused),
        (FUSED, true, facts.fma_fused),
        (Forms::CAREFUL, false, true),
        (Forms::CAREFUL, true, true),
    ] {
        // Valid kernels they are in any case.
        let found = answers(&device, forms, is_hostile, &queries);
        if !is_right {
            not_tested(&format!("{forms:?}, which the device cannot do"));
            continue;
        }
        for (query, answer) in queries.iter().zip(found) {
            let Query { a, b } = query;
            let told = format!("{a:?} {b:?} by {forms:?}, hostile: {is_hostile}: {answer:?}");
            assert!(is_quotient(answer.quotient, a[0], b[0]), "quotient: {told}");
            assert!(is_quotient(answer.reciprocal, 1.0, b[0]), "reciprocal: {told}");
            assert!(is_root(answer.root, a[0]), "root: {told}");
            assert!(
                taken_for(a[0]).iter().any(|a| is_quotient(answer.inverse_root, 1.0, a.sqrt())),
                "inverse root: {told}"
            );
            for i in 0..3 {
                assert!(is_quotient(answer.quotients[i], a[i], b[i]), "quotient {i}: {told}");
                assert!(is_quotient(answer.reciprocals[i], 1.0, b[i]), "reciprocal {i}: {told}");
            }
        }
    }
}

#[test]
fn a_hostile_driver_shows_in_what_is_left_to_it() {
    let device = device();
    let queries = queries();
    let off = answers(&device, Forms::NATIVE, true, &queries);
    let wrong = queries.iter().zip(&off).filter(|(q, a)| !is_quotient(a.quotient, q.a[0], q.b[0])).count();
    assert!(wrong > queries.len() / 4, "{wrong} quotients of {} are off", queries.len());
    let wrong = queries.iter().zip(&off).filter(|(q, a)| !is_root(a.root, q.a[0])).count();
    assert!(wrong > queries.len() / 8, "{wrong} roots of {} are off", queries.len());
}

/// Numbers of which no product or sum is subnormal or infinite.
fn everyday() -> Vec<Query> {
    let within = |x: &f32| (1e-3..1e3).contains(&x.abs());
    queries().into_iter().filter(|q| q.a.iter().chain(&q.b).all(within)).collect()
}

#[test]
fn products_of_vectors_are_summed_from_the_first_component_on() {
    let device = device();
    let queries = everyday();
    assert!(queries.len() > 1000);
    // Roots and quotients that are right whatever the driver does, so that nothing else is left to it.
    let forms = Forms::CAREFUL;
    for is_hostile in [false, true] {
        for (query, answer) in queries.iter().zip(answers(&device, forms, is_hostile, &queries)) {
            let [a, b] = [query.a, query.b].map(|v| Vec3::new(v[0], v[1], v[2]));
            let dot = |a: Vec3, b: Vec3| a.x * b.x + a.y * b.y + a.z * b.z;
            let t = query.b[3];
            let told = format!("{query:?} {answer:?} hostile: {is_hostile}");
            assert!(same(answer.dot_product, dot(a, b)), "{told}");
            let cross = [a.y * b.z - b.y * a.z, a.z * b.x - b.z * a.x, a.x * b.y - b.x * a.y];
            assert_eq!(answer.cross_product, cross, "{told}");
            assert!(same(answer.length, dot(a, a).sqrt()), "{told}");
            assert_eq!(answer.unit, (a * (1.0 / dot(a, a).sqrt())).to_array(), "{told}");
            assert_eq!(answer.reflected, (a - (2.0 * dot(b, a)) * b).to_array(), "{told}");
            assert_eq!(answer.mixed, (a * (1.0 - t) + b * t).to_array(), "{told}");
            assert!(same(answer.fraction, a.x - a.x.floor()), "{told}");
            assert!(same(answer.smaller, if b.x < a.x { b.x } else { a.x }), "{told}");
            assert!(same(answer.larger, if b.x > a.x { b.x } else { a.x }), "{told}");
        }
    }
}

#[test]
fn kinds_of_numbers_are_told_apart() {
    let device = device();
    let queries: Vec<Query> = edges().into_iter().map(|a| Query { a: [a; 4], b: [1.0; 4] }).collect();
    for (query, answer) in queries.iter().zip(answers(&device, Forms::CAREFUL, false, &queries)) {
        let a = query.a[0];
        assert_eq!((answer.is_nan != 0, answer.is_inf != 0), (a.is_nan(), a.is_infinite()), "{a:?}");
    }
}

#[test]
fn halves_and_normalised_integers_are_taken_apart_right() {
    let device = device();
    // All halves, and all integers, as the low and the high part of a word.
    let queries: Vec<Query> = (0..=u16::MAX)
        .map(|bits| {
            let word = f32::from_bits(u32::from(bits) | u32::from(bits.wrapping_mul(40_503)) << 16);
            Query { a: [word; 4], b: [1.0; 4] }
        })
        .collect();
    for is_hostile in [false, true] {
        for (query, answer) in queries.iter().zip(answers(&device, Forms::CAREFUL, is_hostile, &queries)) {
            let word = query.a[0].to_bits();
            for (part, bits) in [word as u16, (word >> 16) as u16].into_iter().enumerate() {
                assert!(same(answer.halves[part], f16::from_bits(bits).to_f32()), "half {bits:#x}: {answer:?}");
                let snorm = f32::from(bits as i16).max(-32767.0) / 32767.0;
                assert!(same(answer.snorms[part], snorm), "integer {bits:#x}: {answer:?}");
            }
        }
    }
}

#[test]
fn floats_become_the_nearest_halves() {
    let device = device();
    let mut random = SplitMix64::new(11);
    let near = (0..0x7c00_u16).flat_map(|bits| {
        let [low, high] = [bits, bits + 1].map(|bits| f16::from_bits(bits).to_f32());
        let middle = if high.is_finite() { 0.5 * (low + high) } else { 65520.0 };
        [low, middle, middle.next_down(), middle.next_up()]
    });
    let any = (0..1 << 16).map(|_| f32::from_bits(random.next_u64() as u32));
    let numbers: Vec<f32> = near.chain(any).chain(edges()).collect();
    let queries: Vec<Query> = numbers.iter().map(|x| Query { a: [*x; 4], b: [-*x; 4] }).collect();
    for (x, answer) in numbers.iter().zip(answers(&device, Forms::CAREFUL, false, &queries)) {
        for (number, bits) in [(*x, answer.half_bits as u16), (-*x, (answer.half_bits >> 16) as u16)] {
            let [found, nearest] = [f16::from_bits(bits), f16::from_f32(number)];
            assert!(
                found.to_bits() == nearest.to_bits() || (found.is_nan() && nearest.is_nan()),
                "{number:e}: {found:e}"
            );
        }
    }
}

/// The fused forms of portable.glsl step by step, from a guess that is off by some units in the last place. Few devices
/// at hand can fuse, so this shows that the steps round right; that they are the shader's own, the self-test shows.
mod fused {
    fn off(x: f32, by: i32) -> f32 {
        f32::from_bits(x.to_bits().wrapping_add_signed(by))
    }

    pub fn reciprocal(b: f32, by: i32) -> f32 {
        let guess = off(1.0 / b, by);
        let reciprocal = (-b).mul_add(guess, 1.0).mul_add(guess, guess);
        (-b).mul_add(reciprocal, 1.0).mul_add(reciprocal, reciprocal)
    }

    pub fn quotient(a: f32, b: f32, by: i32) -> f32 {
        let guess = off(1.0 / b, by);
        let reciprocal = (-b).mul_add(guess, 1.0).mul_add(guess, guess);
        let quotient = a * reciprocal;
        (-b).mul_add(quotient, a).mul_add(reciprocal, quotient)
    }

    pub fn root(a: f32, by: i32) -> f32 {
        let guess = off(1.0 / a.sqrt(), by);
        let (root, half) = (a * guess, 0.5 * guess);
        let lacks = (-half).mul_add(root, 0.5);
        let (root, half) = (root.mul_add(lacks, root), half.mul_add(lacks, half));
        (-root).mul_add(root, a).mul_add(half, root)
    }
}

#[test]
fn fused_forms_round_right_from_any_guess() {
    // Every mantissa but the one that is left to integers; of roots, of both kinds of exponents.
    (0..(1_u32 << 23) - 1).into_par_iter().for_each(|mantissa| {
        let x = f32::from_bits(0x3f80_0000 | mantissa);
        for by in [-2, -1, 0, 1, 2] {
            assert_eq!(fused::reciprocal(x, by), 1.0 / x, "1 / {x:e}, {by} off");
            for x in [x, 2.0 * x] {
                assert_eq!(fused::root(x, by), x.sqrt(), "root of {x:e}, {by} off");
            }
        }
    });
    (0..64_u64).into_par_iter().for_each(|seed| {
        let mut random = SplitMix64::new(seed);
        for _ in 0..1 << 16 {
            let bits = random.next_u64();
            let [a, b] = [bits as u32, (bits >> 32) as u32]
                .map(|bits| f32::from_bits(0x3f80_0000 | bits >> 9).min(2.0 - 2.0 * f32::EPSILON));
            for by in [-2, -1, 0, 1, 2] {
                assert_eq!(fused::quotient(a, b, by), a / b, "{a:e} / {b:e}, {by} off");
            }
        }
    });
}

/// Output of the probe `elementary`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Elementary {
    on_circle: [f32; 2],
    exponential: f32,
    logarithm: f32,
    angle: f32,
    unused: [f32; 3],
}

/// How many units in the last place a number is from what it should be.
fn ulps(found: f32, expected: f64) -> f64 {
    let nearest = (expected as f32).abs().max(f32::MIN_POSITIVE);
    let unit = f64::from(nearest.next_up()) - f64::from(nearest);
    (f64::from(found) - expected).abs() / unit
}

fn worst(errors: impl Iterator<Item = f64>) -> f64 {
    errors.fold(0.0, f64::max)
}

#[test]
fn elementary_functions_are_as_good_as_they_say() {
    let device = device();
    let mut random = SplitMix64::new(3);
    let mut between =
        |low: f64, high: f64| low + (high - low) * (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
    let queries: Vec<[f32; 4]> = (0..1 << 20)
        .map(|i| {
            // Of all magnitudes, and of those that paths have.
            let x = if i % 2 == 0 { between(-87.0, 88.0) } else { between(-1.0, 1.0) } as f32;
            let y = if i % 3 == 0 { between(-100.0, 100.0).exp2() } else { between(-2.0, 2.0) } as f32;
            [x, y, 0.0, 0.0]
        })
        .collect();
    let answers: Vec<Elementary> = Bench::new(&device, &any_scene()).run("elementary", &queries);
    let each = || queries.iter().map(|q| (f64::from(q[0]), f64::from(q[1]))).zip(&answers);
    let exponential = worst(each().map(|((x, _), a)| ulps(a.exponential, x.exp())));
    let logarithm = worst(each().filter(|((_, y), _)| *y != 0.0).map(|((_, y), a)| ulps(a.logarithm, y.abs().ln())));
    let angle = worst(each().map(|((x, y), a)| ulps(a.angle, y.atan2(x))));
    let turns = |x: f64| TAU * (x - x.round());
    let circle = worst(each().map(|((x, _), a)| {
        let (sine, cosine) = turns(x).sin_cos();
        (f64::from(a.on_circle[0]) - cosine).abs().max((f64::from(a.on_circle[1]) - sine).abs())
    }));
    let near = each().filter(|((x, _), _)| x.abs() < 0.01);
    let sine = worst(near.map(|((x, _), a)| ulps(a.on_circle[1], turns(x).sin())));
    let told = format!(
        "exponential {exponential:.2}, logarithm {logarithm:.2}, angle {angle:.2}, sine {sine:.2} ulp, circle {circle:e}"
    );
    assert!(exponential < 2.0 && logarithm < 2.0 && angle < 4.0 && sine < 2.0 && circle < 1.2e-7, "{told}");
    // What is stated is not far from what is so.
    assert!(exponential > 0.5 && angle > 0.5, "{told}");
}

#[test]
fn ends_of_elementary_functions() {
    let device = device();
    let queries: [[f32; 4]; 5] = [
        [-1e30, 1.0, 0.0, 0.0],
        [-87.5, 0.0, 0.0, 0.0],
        [100.0, -1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0, 0.0],
    ];
    let answers: Vec<Elementary> = Bench::new(&device, &any_scene()).run("elementary", &queries);
    assert_eq!(answers.iter().map(|a| a.exponential).collect::<Vec<_>>()[..4], [0.0, 0.0, f32::INFINITY, 1.0]);
    assert_eq!(answers[0].logarithm, 0.0);
    assert_eq!(answers[3].angle, 0.0);
    assert_eq!(answers[4].angle, PI as f32);
}

/// Input of the probe `warps`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Turned {
    axis: [f32; 4],
    u: [f32; 4],
}

#[test]
fn walls_along_an_axis_do_not_turn_by_the_last_bit() {
    let device = device();
    let bench = Bench::new(&device, &any_scene());
    let across: Vec<DVec3> =
        (0..32).map(|i| f64::from(i) * TAU / 32.0).map(|t| DVec3::new(t.cos(), t.sin(), 0.0)).collect();
    let axes = [DVec3::X, DVec3::Y, -DVec3::X, -DVec3::Y].into_iter().chain(across);
    let tilts = [0.0, -0.0, 1e-45, -1e-45, 1e-30, -1e-30, 6e-8, -6e-8];
    let queries: Vec<Turned> = axes
        .flat_map(|axis| tilts.map(|z| Turned { axis: lanes(DVec3 { z, ..axis }), u: [0.3, 0.1, 0.0, 0.0] }))
        .collect();
    // Directions by the cosine, about the axis, and two more.
    let answers: Vec<[[f32; 4]; 3]> = bench.run("warps", &queries);
    for (queries, answers) in queries.chunks(tilts.len()).zip(answers.chunks(tilts.len())) {
        for (query, answer) in queries.iter().zip(answers) {
            let apart = (vector(answer[0]) - vector(answers[0][0])).length();
            assert!(apart < 1e-6, "{query:?} turns by {apart:e}");
        }
    }
}
