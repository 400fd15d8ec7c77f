//! The material functions on the device: what physics asks of them, and their formulas in f64.

use crate::common;
use std::collections::HashSet;
use std::f64::consts::{FRAC_PI_2, TAU};

use crate::probe::{Bench, BsdfAnswer, SurfaceQuery, Uniform, grey, lanes, scene_of_materials, spherical, vector};
use glam::{DVec3, Vec3};
use raywave::scene::{Material, Surface};
use raywave_studies::oracle::optics;

fn glossy_materials() -> Vec<Material> {
    let glossy =
        |kd: [f32; 3], ks: [f32; 3], exponent| Material { diffuse: kd.into(), specular: ks.into(), exponent, ..grey() };
    vec![
        glossy([1.0, 0.5, 0.0], [0.0; 3], 0.0),
        glossy([0.0; 3], [1.0, 0.5, 0.1], 0.0),
        glossy([0.0; 3], [1.0; 3], 1.0),
        glossy([0.25, 0.5, 0.75], [0.75, 0.5, 0.25], 20.0),
        glossy([0.0; 3], [1.0; 3], 1000.0),
        glossy([0.5; 3], [0.5; 3], 1000.0),
    ]
}

/// A bench whose materials are these.
fn bench_of(materials: Vec<Material>) -> (Bench, Vec<Material>) {
    let scene = scene_of_materials(materials);
    (Bench::new(&common::device(), &scene), scene.materials)
}

#[test]
fn glossy_values_and_densities_are_those_of_the_formula_and_reciprocal() {
    const N: usize = 1 << 14;
    let (bench, materials) = bench_of(glossy_materials());
    let mut random = Uniform::new(1);
    let mut queries = Vec::new();
    for index in 0..materials.len() {
        for i in 0..N {
            let geometric = random.direction();
            let shading =
                if i % 2 == 0 { geometric } else { spherical(geometric, 0.9, TAU * f64::from(random.next::<1>()[0])) };
            let wo = random.direction();
            // Half of the pairs lie in the lobe of even a sharp material.
            let wi = match i % 4 {
                0 | 1 => random.direction(),
                _ => {
                    let [u, v] = random.next::<2>().map(f64::from);
                    let side = if wo.dot(geometric) < 0.0 { -1.0 } else { 1.0 };
                    spherical(optics::mirrored(side * shading, wo), 1.0 - 0.01 * u, TAU * v)
                }
            };
            let query = SurfaceQuery { shading_normal: lanes(shading), ..SurfaceQuery::new(index, geometric, wo, wi) };
            queries.push(query);
            queries.push(SurfaceQuery { wo: query.wi, wi: query.wo, ..query });
        }
    }
    let answers: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
    let mut compared = 0;
    for (pair, answer) in queries.chunks(2).zip(answers.chunks(2)) {
        let [query, _] = pair else { unreachable!() };
        let material = &materials[query.material[0] as usize];
        let (geometric, shading) = (vector(query.geometric_normal), vector(query.shading_normal));
        let (wo, wi) = (vector(query.wo), vector(query.wi));
        let side = if geometric.dot(wo) < 0.0 { -1.0 } else { 1.0 };
        let n = side * shading;
        let there = vector([answer[0].value[0], answer[0].value[1], answer[0].value[2], 0.0]);
        let back = vector([answer[1].value[0], answer[1].value[1], answer[1].value[2], 0.0]);

        // Rounding of a cosine grows with the exponent; near a horizon the sides are a matter of rounding.
        let tolerance = 1e-6 * (10.0 + f64::from(material.exponent));
        let sides = [geometric.dot(wo) * side, geometric.dot(wi) * side, n.dot(wi), n.dot(wo)];
        if sides.iter().any(|s| s.abs() < 1e-4) {
            continue;
        }
        let above = sides[..3].iter().all(|s| *s > 0.0);
        let (value, pdf) = if above {
            (optics::glossy(material, n, wo, wi), optics::scatter_density(material, n, wo, wi))
        } else {
            (DVec3::ZERO, 0.0)
        };
        let off = (there - value).abs();
        assert!(off.cmple(tolerance * value + 1e-6).all(), "{there} is not {value} of {material:?}: {wo} {wi}");
        assert!((f64::from(answer[0].pdf) - pdf).abs() <= tolerance * pdf + 1e-6);

        // f is value over the cosine of where light comes from.
        if above && sides[3] > 0.0 {
            let (f, g) = (there / sides[2], back / sides[3]);
            assert!((f - g).abs().cmple(tolerance * f + 1e-6 / sides[2].min(sides[3])).all(), "{f} there and {g} back");
            compared += 1;
        }
    }
    assert!(compared > N, "{compared} pairs say something of reciprocity");
}

#[test]
fn glossy_materials_give_back_no_more_than_they_get() {
    // Even parts of the root of 1 - cosine about the mirror direction, where the lobe is, and of a turn.
    const RINGS: usize = 256;
    const TURNS: usize = 128;
    let (bench, materials) = bench_of(glossy_materials());
    let n = DVec3::new(0.3, -0.5, 0.6).normalize();
    for (index, material) in materials.iter().enumerate() {
        for angle in [0.0_f64, 30.0, 60.0, 80.0, 89.0] {
            let wo = spherical(n, angle.to_radians().cos(), 1.0);
            let axis = optics::mirrored(n, wo);
            let (mut queries, mut solid) = (Vec::new(), Vec::new());
            for ring in 0..RINGS {
                for turn in 0..TURNS {
                    let root = 2_f64.sqrt() * (ring as f64 + 0.5) / RINGS as f64;
                    let wi = spherical(axis, 1.0 - root * root, TAU * (turn as f64 + 0.5) / TURNS as f64);
                    queries.push(SurfaceQuery::new(index, n, wo, wi));
                    solid.push(2.0 * root * 2_f64.sqrt() / RINGS as f64 * TAU / TURNS as f64);
                }
            }
            let answers: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
            let albedo: DVec3 = answers.iter().zip(&solid).map(|(a, s)| Vec3::from(a.value).as_dvec3() * *s).sum();
            assert!(albedo.max_element() < 1.0 + 3e-3, "{material:?} at {angle} degrees gives {albedo}");
        }
    }
}

/// Every surface of [`specular_materials`] from many sides: indices in steps of angle.
fn specular_materials() -> Vec<Material> {
    let one = 1.0_f32;
    let indices = [1.5, 2.4, 1.0003, 0.7, one, one.next_up(), one.next_down(), 1.0 + 1e-4, 1000.0, 0.1];
    let glass =
        |surface| indices.map(|ior| Material { surface, ior, transmission: Vec3::new(1.0, 0.5, 0.25), ..grey() });
    let mut materials = [glass(Surface::Dielectric), glass(Surface::Refractive)].concat();
    materials.push(Material { surface: Surface::Mirror, specular: Vec3::new(1.0, 0.6, 0.3), ..grey() });
    materials
}

/// One question of a specular surface, and what f64 makes of its exact inputs.
struct Case {
    query: SurfaceQuery,
    n: DVec3,
    wo: DVec3,
    cosine: f64,
    eta: f64,
    /// How far the device's eta can be off: it is the material's index itself, or a quotient.
    eta_error: f64,
}

impl Case {
    /// Cosines and indices that the rounding of the inputs cannot tell apart.
    fn roundings(&self) -> [(f64, f64); 5] {
        let (cosine, eta) = (self.cosine, self.eta);
        let shift = |c: f64, e: f64| ((cosine + 2e-7 * c).max(1e-9), eta * (1.0 + self.eta_error * e));
        [(cosine, eta), shift(1.0, 1.0), shift(1.0, -1.0), shift(-1.0, 1.0), shift(-1.0, -1.0)]
    }
}

fn specular_cases(material: usize, ni: f32, choice: f32) -> Vec<Case> {
    let mut cases = Vec::new();
    let mut random = Uniform::new(9);
    // From straight down to where a cosine is a few roundings.
    let cosines =
        (0..200).map(|i| (f64::from(i) / 200.0 * FRAC_PI_2).cos()).chain((1..24).map(|i| f64::from(-i).exp2()));
    for cosine in cosines {
        for side in [1.0, -1.0] {
            let normal = vector(lanes(random.direction()));
            let phi = TAU * f64::from(random.next::<1>()[0]);
            let query = SurfaceQuery {
                choice,
                ..SurfaceQuery::new(material, normal, spherical(side * normal, cosine, phi), normal)
            };
            let wo = vector(query.wo);
            let cosine = side * normal.dot(wo) / (normal.length() * wo.length());
            if cosine > 0.0 {
                let eta_error = if side > 0.0 || ni == 1.0 { 0.0 } else { 2e-7 };
                cases.push(Case { query, n: side * normal, wo, cosine, eta: f64::from(ni).powf(side), eta_error });
            }
        }
    }
    cases
}

#[test]
fn specular_directions_obey_snell_and_their_weights_conserve_energy() {
    let (bench, materials) = bench_of(specular_materials());
    for (index, material) in materials.iter().enumerate() {
        // The least choice takes the reflection where there is any, the greatest the refraction.
        for choice in [0.0, 1.0 - (-24_f32).exp2()] {
            let cases = specular_cases(index, material.ior, choice);
            let queries: Vec<_> = cases.iter().map(|case| case.query).collect();
            let answers: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
            for (case, answer) in cases.iter().zip(&answers) {
                let Case { n, wo, cosine, eta, .. } = case;
                let (direction, weight) = (vector(answer.direction), vector(answer.weight));
                let name = format!("{material:?} at cosine {cosine:e}, eta {eta}, choice {choice}: {answer:?}");
                assert!((direction.length() - 1.0).abs() < 1e-6, "{name}: no unit vector");
                if material.surface == Surface::Mirror {
                    assert!((direction - optics::mirrored(*n, *wo)).length() < 1e-6, "{name}");
                    assert_eq!(answer.weight[..3], material.specular.to_array());
                    continue;
                }
                // Near total reflection either side of it is right, and near grazing a range of cosines.
                let beyond = case.roundings().map(|(cosine, eta)| optics::refracted_cosine(cosine, eta));
                let certain = beyond.iter().all(|b| b.is_some() == beyond[0].is_some());
                let exact = beyond[0].unwrap_or(0.0);
                let range = beyond.iter().map(|b| (b.unwrap_or(0.0) - exact).abs()).fold(0.0, f64::max);
                if direction.dot(*n) >= 0.0 {
                    assert!((direction - optics::mirrored(*n, *wo)).length() < 1e-6, "{name}: no mirror direction");
                    assert_eq!(answer.weight[..3], [1.0; 3]);
                    let may = beyond[0].is_none() || (material.surface == Surface::Dielectric && choice < 0.5);
                    assert!(may || !certain, "{name}: reflects");
                } else {
                    assert!(beyond[0].is_some() || !certain, "{name}: refracts under total reflection");
                    let along = wo - cosine * *n;
                    let expected = -along / *eta - exact * *n;
                    assert!((direction - expected).length() < 1e-6 + 2.0 * range, "{name}: not {expected}");
                    let radiance = material.transmission.as_dvec3() / (eta * eta);
                    assert!((weight - radiance).abs().cmple(2e-6 * radiance).all(), "{name}: not {radiance}");
                }
            }
        }
    }
}

#[test]
fn there_and_back_through_an_interface_radiance_is_the_same() {
    let (bench, materials) = bench_of(specular_materials());
    for (index, material) in materials.iter().enumerate().filter(|(_, m)| m.surface != Surface::Mirror) {
        // Under an index of 1000 all of the half space is a cone of a few roundings.
        if material.ior > 100.0 {
            continue;
        }
        let cases: Vec<_> = specular_cases(index, material.ior, 1.0 - (-24_f32).exp2());
        let there: Vec<BsdfAnswer> = bench.run("bsdf", &cases.iter().map(|case| case.query).collect::<Vec<_>>());
        let crossed: Vec<_> =
            cases.iter().zip(&there).filter(|(case, answer)| vector(answer.direction).dot(case.n) < -1e-3).collect();
        let queries: Vec<_> =
            crossed.iter().map(|(case, answer)| SurfaceQuery { wo: answer.direction, ..case.query }).collect();
        let back: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
        for ((case, there), back) in crossed.iter().zip(&back) {
            let direction = vector(back.direction);
            if direction.dot(case.n) < 0.0 {
                // Back to a grazing direction, which rounding can close.
                assert!(case.cosine < 2e-2, "{material:?} reflects on the way back to cosine {}", case.cosine);
                continue;
            }
            assert!((direction - case.wo).length() < 1e-6 * (1.0 + case.eta.max(1.0 / case.eta).powi(2) / case.cosine));
            for channel in 0..3 {
                let product = there.weight[channel] * back.weight[channel] / material.transmission[channel].powi(2);
                assert!((product - 1.0).abs() < 1e-5, "{material:?}: {product}");
            }
        }
        assert!(!crossed.is_empty(), "{material:?} refracts");
    }
}

#[test]
fn fresnel_is_the_formula_and_the_same_from_both_sides() {
    let (bench, _) = bench_of(vec![grey()]);
    let one = 1.0_f32;
    let mut queries: Vec<[f32; 4]> = Vec::new();
    for eta in [1.5, 2.4, 1.0003, 0.7, one, one.next_up(), one.next_down(), 1000.0, 0.1, 0.001] {
        for i in 1..=2000 {
            // Evenly, and towards grazing.
            for cosine in [i as f32 / 2000.0, (-0.01 * i as f32).exp2()] {
                if let Some(beyond) = optics::refracted_cosine(cosine.into(), eta.into()) {
                    queries.push([cosine, beyond as f32, eta, 0.0]);
                    queries.push([beyond as f32, cosine, 1.0 / eta, 0.0]);
                }
            }
        }
    }
    let answers: Vec<[f32; 4]> = bench.run("fresnel", &queries);
    for (query, answer) in queries.chunks(2).zip(answers.chunks(2)) {
        let [cosine, beyond, eta, _] = query[0].map(f64::from);
        let perpendicular = (cosine - eta * beyond) / (cosine + eta * beyond);
        let parallel = (eta * cosine - beyond) / (eta * cosine + beyond);
        let expected = 0.5 * (perpendicular * perpendicular + parallel * parallel);
        let [there, back] = [answer[0][0], answer[1][0]].map(f64::from);
        assert!((there - expected).abs() < 1e-6, "{:?}: {there} is not {expected}", query[0]);
        assert!((there - back).abs() < 1e-6, "{:?}: {there} there and {back} back", query[0]);
        assert!((0.0..=1.0).contains(&there));
    }
}

#[test]
fn dielectrics_reflect_as_much_as_fresnel_says_at_every_angle() {
    let (bench, materials) = bench_of(specular_materials());
    for (index, material) in materials.iter().enumerate().filter(|(_, m)| m.surface == Surface::Dielectric) {
        let cases = specular_cases(index, material.ior, 0.0);
        // Bisects the choice at which the surface goes from reflection to refraction.
        let mut bounds = vec![(0.0_f32, 1.0_f32); cases.len()];
        for _ in 0..22 {
            let queries: Vec<_> = cases
                .iter()
                .zip(&bounds)
                .map(|(case, (low, high))| SurfaceQuery { choice: 0.5 * (low + high), ..case.query })
                .collect();
            let answers: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
            for ((case, bound), answer) in cases.iter().zip(&mut bounds).zip(&answers) {
                let middle = 0.5 * (bound.0 + bound.1);
                let reflects = vector(answer.direction).dot(case.n) >= 0.0;
                *(if reflects { &mut bound.0 } else { &mut bound.1 }) = middle;
            }
        }
        for (case, (low, _)) in cases.iter().zip(&bounds) {
            let exact = case.roundings().map(|(cosine, eta)| optics::reflectance(cosine, eta));
            let (least, most) = exact.iter().fold((1.0_f64, 0.0_f64), |(least, most), r| (least.min(*r), most.max(*r)));
            let r = f64::from(*low);
            let name = format!("{} at cosine {:e}, eta {}", material.ior, case.cosine, case.eta);
            assert!(r > least - 2e-6 && r < most + 2e-6, "{name}: {r} is not in {least} to {most}");
        }
    }
}

/// Bits of flags, as `bsdf/contract.glsl` has them: components, then the side.
const COMPONENTS: u32 = 7;
const SPECULAR: u32 = 4;
const REFLECT: u32 = 8;
const SIDES: u32 = 24;

#[test]
fn every_bsdf_answers_what_the_contract_says() {
    const N: usize = 1 << 12;
    // All kinds in one scene, so that the kernel has to find which one a material is.
    let (bench, materials) = bench_of([glossy_materials(), specular_materials()].concat());
    let mut random = Uniform::new(7);
    let mut queries = Vec::new();
    for index in 0..materials.len() {
        for _ in 0..N {
            let ([choice], u) = (random.next(), random.next());
            let (normal, wo, wi) = (random.direction(), random.direction(), random.direction());
            queries.push(SurfaceQuery { choice, u, ..SurfaceQuery::new(index, normal, wo, wi) });
        }
    }
    let answers: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
    let sampled = |(query, answer): (&SurfaceQuery, &BsdfAnswer)| {
        let [x, y, z, _] = answer.direction;
        SurfaceQuery { wi: [x, y, z, 0.0], ..*query }
    };
    let there: Vec<BsdfAnswer> = bench.run("bsdf", &queries.iter().zip(&answers).map(sampled).collect::<Vec<_>>());
    let mut seen = HashSet::new();
    for ((query, answer), there) in queries.iter().zip(&answers).zip(&there) {
        let material = &materials[query.material[0] as usize];
        let BsdfAnswer { value, pdf, direction, weight, flags: [all, drawn], .. } = *answer;
        let (sampled_pdf, eta) = (direction[3], weight[3]);
        let name = format!("{material:?}: {query:?} gives {answer:?}");
        seen.insert(drawn);
        assert!(drawn & !all == 0, "a component that the BSDF does not have: {name}");
        assert_eq!((drawn & COMPONENTS).count_ones(), 1, "{name}");
        assert_eq!((drawn & SIDES).count_ones(), 1, "{name}");

        let normal = vector(query.geometric_normal);
        let [side_of_wo, side_of_wi] = [query.wo, direction].map(|direction| vector(direction).dot(normal));
        let takes_light = weight[..3].iter().any(|channel| *channel > 0.0);
        if takes_light && side_of_wi.abs() > 1e-5 {
            assert_eq!(drawn & REFLECT != 0, side_of_wo * side_of_wi > 0.0, "the side: {name}");
            let transmits = all & SIDES & !REFLECT != 0;
            assert_eq!(eta, if transmits && side_of_wi < 0.0 { material.ior } else { 1.0 }, "eta: {name}");
        }
        if all & SPECULAR != 0 {
            assert_eq!((value, pdf, sampled_pdf), ([0.0; 3], 0.0, f32::MAX), "one direction: {name}");
            continue;
        }
        assert_eq!(sampled_pdf, there.pdf.max(1e-20), "the pdf of the direction that was drawn: {name}");
        for (weight, exact) in weight.iter().zip(there.value) {
            let (f_cos, exact) = (f64::from(*weight) * f64::from(sampled_pdf), f64::from(exact));
            assert!((f_cos - exact).abs() <= 1e-5 * exact + 1e-12, "{f_cos} is not {exact}: {name}");
        }
    }
    assert_eq!(seen.len(), 4, "diffuse and glossy reflection, specular reflection and transmission");
}
