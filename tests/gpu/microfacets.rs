//! Surfaces with microfacets and coats on the device: the formulas in f64, what physics asks, and the pdfs of what is drawn.

use crate::common;
use std::f64::consts::{PI, TAU};

use crate::probe::{Bench, BsdfAnswer, SurfaceQuery, Uniform, scene_of_materials, spherical, vector};
use glam::{DVec2, DVec3, Vec3};
use raywave::scene::{Material, Principled, Surface};
use raywave_studies::oracle::bsdf::Bsdf;
use raywave_studies::oracle::optics;
use raywave_studies::stats::{chi_square, sidak_level};

/// Copper, by Mitsuba's table.
const ETA: Vec3 = Vec3::new(0.200, 0.924, 1.102);
const ABSORPTION: Vec3 = Vec3::new(3.912, 2.452, 2.142);

fn lossy(material: Material) -> Material {
    Material { compensates: false, ..material }
}

fn metals() -> Vec<Material> {
    let metal = |x, y| lossy(Material::conductor(ETA, ABSORPTION, 0.0).rough(x, y));
    vec![metal(1.0, 1.0), metal(0.3, 0.3), metal(0.05, 0.05), metal(0.4, 0.1), metal(0.02, 0.5)]
}

fn rough_glass() -> Vec<Material> {
    let glass = |ior, alpha| Material {
        transmission: Vec3::new(1.0, 0.5, 0.25),
        ..lossy(Material::dielectric(ior).rough(alpha, alpha))
    };
    vec![glass(1.5, 0.5), glass(1.5, 0.1), glass(1.5, 1.0), glass(1.1, 0.3), glass(0.7, 0.4), glass(2.4, 0.2)]
}

fn coats() -> Vec<Material> {
    let colour = Vec3::new(0.9, 0.5, 0.1);
    let plastic = |alpha, nonlinear| Material {
        surface: Surface::Plastic { nonlinear },
        ..Material::plastic(colour, 1.5, alpha)
    };
    let coated = Material { coat: 0.8, coat_roughness: 0.1, ..Material::metal_rough(colour, 0.3, 0.4) };
    vec![
        plastic(0.1, false),
        plastic(0.6, true),
        Material::metal_rough(colour, 0.0, 0.2),
        Material::metal_rough(colour, 1.0, 0.5),
        lossy(Material::metal_rough(colour, 0.5, 0.09)),
        coated,
    ]
}

fn compensated() -> Vec<Material> {
    [metals(), rough_glass()].concat().into_iter().map(|m| Material { compensates: true, ..m }).collect()
}

/// Disney's numbers of a body that shows all that one without an inside has.
pub(crate) fn cloth() -> Principled {
    Principled {
        anisotropy: 0.8,
        sheen: 0.9,
        sheen_tint: 0.6,
        specular_tint: 0.7,
        flatness: 0.4,
        ..Principled::default()
    }
}

/// And of one that light goes through.
pub(crate) fn glassy() -> Principled {
    Principled { specular_share: 0.7, sheen: 0.5, ..Principled::default() }
}

/// Disney's bodies, without an inside and with one, and sheets.
fn principled() -> Vec<Material> {
    let colour = Vec3::new(0.9, 0.5, 0.1);
    let leaf = Principled {
        anisotropy: 0.5,
        sheen: 0.7,
        sheen_tint: 0.3,
        specular_tint: 0.4,
        specular_share: 0.6,
        flatness: 0.5,
        diffuse_transmission: 0.4,
    };
    vec![
        Material::principled(colour, 1.5, 0.16, Principled::default()),
        Material {
            metalness: 0.3,
            coat: 0.8,
            coat_roughness: 0.0802,
            ..Material::principled(colour, 1.5, 0.49, cloth())
        },
        Material {
            metalness: 0.2,
            coat: 0.5,
            coat_roughness: 0.1,
            ..Material::principled(colour, 1.5, 0.36, glassy())
        },
        Material::principled_thin(colour, 1.33, 0.25, leaf),
    ]
}

fn every_material() -> Vec<Material> {
    [metals(), rough_glass(), coats(), compensated(), principled()].concat()
}

/// Materials of the widest lobes that there are, and of Beckmann's distribution.
fn widest() -> Vec<Material> {
    let colour = Vec3::new(0.9, 0.5, 0.1);
    let beckmann = |material| Material { is_beckmann: true, ..lossy(material) };
    vec![
        beckmann(Material::conductor(ETA, ABSORPTION, 1.0)),
        beckmann(Material::conductor(ETA, ABSORPTION, 0.2).rough(0.4, 0.2)),
        beckmann(Material::dielectric(1.5).rough(0.4, 0.4)),
        beckmann(Material::plastic(colour, 1.5, 0.2)),
        Material::plastic(colour, 1.5, 1.0),
        Material { coat: 0.8, coat_roughness: 1.0, ..Material::metal_rough(colour, 0.5, 1.0) },
        Material::principled(colour, 1.5, 1.0, glassy()),
        Material::principled_thin(colour, 1.5, 1.0, Principled { diffuse_transmission: 0.4, ..glassy() }),
    ]
}

/// Whether what it transmits is bent, so that radiance scales with the square of the index.
fn refracts(material: &Material) -> bool {
    material.surface == Surface::Dielectric || material.has_inside()
}

/// The most that a surface may give back of what it gets. Disney's model gives back more than all at grazing angles: by its
/// sheen, by the edge of a rough body, and by coats that take nothing from what is below them.
fn most_given_back(material: &Material) -> f64 {
    if material.surface.is_principled() { 1.7 } else { 1.0 }
}

/// A frame whose z axis is the shading normal on the side of `wo`.
fn local(normal: DVec3, wo: DVec3, direction: DVec3) -> DVec3 {
    let n = if normal.dot(wo) < 0.0 { -normal } else { normal };
    let (x, y) = optics::basis(n);
    DVec3::new(direction.dot(x), direction.dot(y), direction.dot(n))
}

/// How far values may be from the oracle's, as a share and by itself: by the rounding of narrow lobes, and by the steps of the
/// tables that kernels look up where the oracle integrates.
fn tolerance(material: &Material) -> (f64, f64) {
    let narrow = 1e-4 / f64::from(material.roughness.min_element()).min(1.0);
    match material.surface {
        surface if surface.is_principled() => (1e-3, 1e-6),
        Surface::Plastic { .. } => (4e-3, 1e-3),
        _ if material.compensates => (4e-3, 1e-3),
        _ => (narrow, 1e-6),
    }
}

#[test]
fn values_are_those_of_the_oracle_and_the_same_both_ways() {
    const N: usize = 1 << 12;
    let materials = [every_material(), widest()].concat();
    let bench = Bench::new(&common::device(), &scene_of_materials(materials.clone()));
    let mut random = Uniform::new(11);
    let mut queries = Vec::new();
    for index in 0..materials.len() {
        for _ in 0..N {
            let (normal, wo, wi) = (random.direction(), random.direction(), random.direction());
            let query = SurfaceQuery::new(index, normal, wo, wi);
            queries.push(query);
            queries.push(SurfaceQuery { wo: query.wi, wi: query.wo, ..query });
        }
    }
    let answers: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
    let bsdfs: Vec<Bsdf> = materials.iter().map(Bsdf::new).collect();
    let mut compared = vec![0; materials.len()];
    for (pair, answer) in queries.chunks(2).zip(answers.chunks(2)) {
        let query = pair[0];
        let index = query.material[0] as usize;
        let material = &materials[index];
        let (normal, wo, wi) = (vector(query.geometric_normal), vector(query.wo), vector(query.wi));
        let is_front = normal.dot(wo) > 0.0;
        let (o, i) = (local(normal, wo, wo), local(normal, wo, wi));
        if o.z < 0.02 || i.z.abs() < 0.02 {
            continue;
        }
        let exact = bsdfs[index].value(o, i, is_front);
        let [there, back] = [0, 1].map(|k: usize| Vec3::from(answer[k].value).as_dvec3());
        let (share, rest) = tolerance(material);
        let off = (there - exact).abs();
        assert!(off.cmple(share * exact + rest).all(), "{there} is not {exact} of {material:?}: {o} {i}");
        compared[index] += usize::from(exact != DVec3::ZERO);
        if material.surface.is_principled() {
            continue;
        }
        // f over the square of the index where the light goes is the same both ways. (Veach 1997, 5.2)
        let transmits = material.surface == Surface::Dielectric;
        let index_at = |front: bool| if transmits && !front { f64::from(material.ior) } else { 1.0 };
        let f = there / i.z.abs() / index_at(is_front).powi(2);
        let g = back / o.z / index_at(normal.dot(wi) > 0.0).powi(2);
        let off = (f - g).abs();
        let rounding = 1e-3 / f64::from(material.roughness.min_element()).min(1.0);
        // Near total reflection what gets through is a difference of roundings.
        assert!(off.cmple(rounding * f + 1e-4).all(), "{f} there, {g} back of {material:?}: {o} {i}");
    }
    assert!(compared.iter().all(|count| *count > N / 50), "values above zero: {compared:?}");
}

#[test]
fn principled_values_are_those_of_mitsuba() {
    /// The material, both directions by cosine and angle, and what Mitsuba 3.9.1 evaluates.
    const KNOWN: &[(usize, [f64; 4], [f32; 3])] = &[
        (0, [0.9, 0.3, 0.8, 2.9], [2.563016e-01, 1.544392e-01, 5.25767e-2]),
        (0, [0.3, 0.3, 0.4, 3.2], [1.699591e-01, 1.238298e-01, 7.770056e-02]),
        (0, [0.2, 0.5, 0.95, 1.0], [2.807963e-01, 1.565332e-01, 3.227003e-02]),
        (1, [0.9, 0.3, 0.8, 2.9], [2.081444e-01, 1.20708e-1, 3.32717e-2]),
        (1, [0.3, 0.3, 0.4, 3.2], [1.574245e-01, 9.741142e-02, 3.739839e-02]),
        (1, [0.2, 0.5, 0.95, 1.0], [2.269209e-01, 1.265649e-01, 2.620904e-02]),
        (2, [0.9, 0.3, 0.8, 2.9], [1.552153e-01, 9.550502e-02, 3.579475e-02]),
        (2, [0.3, 0.3, 0.4, 3.2], [2.035261e-01, 1.547474e-01, 1.059687e-01]),
        (2, [0.7, 0.0, -0.6, 2.5], [1.452884e-02, 1.082916e-02, 4.842946e-03]),
        (2, [-0.8, 1.0, 0.5, 4.4], [7.834525e-01, 5.83951e-1, 2.611508e-01]),
        (2, [-0.5, 0.2, -0.6, 2.0], [1.244983e-02, 1.244983e-02, 1.244983e-02]),
        (2, [0.2, 0.5, 0.95, 1.0], [9.360295e-02, 5.3595e-2, 1.358703e-02]),
        (3, [0.9, 0.3, 0.8, 2.9], [5.455653e-02, 3.181067e-02, 9.064808e-03]),
        (3, [0.3, 0.3, 0.4, 3.2], [5.791034e-02, 4.08099e-2, 2.370945e-02]),
        (3, [0.7, 0.0, -0.6, 2.5], [3.277981e-02, 1.8211e-2, 3.642201e-03]),
        (3, [-0.8, 1.0, 0.5, 4.4], [4.228724e-02, 2.349291e-02, 4.698582e-03]),
        (3, [-0.5, 0.2, -0.6, 2.0], [4.419737e-02, 2.464779e-02, 5.098212e-03]),
        (3, [0.2, 0.5, 0.95, 1.0], [6.834659e-02, 3.81647e-2, 7.98281e-3]),
    ];
    let bench = Bench::new(&common::device(), &scene_of_materials(principled()));
    let query = |(index, [z_o, angle_o, z_i, angle_i], _): &(usize, [f64; 4], [f32; 3])| {
        SurfaceQuery::new(*index, DVec3::Z, spherical_about_z(*z_o, *angle_o), spherical_about_z(*z_i, *angle_i))
    };
    let queries: Vec<SurfaceQuery> = KNOWN.iter().map(query).collect();
    for ((index, directions, known), answer) in KNOWN.iter().zip(bench.run::<_, BsdfAnswer>("bsdf", &queries)) {
        let (value, known) = (Vec3::from(answer.value), Vec3::from(*known));
        let off = (value - known).abs();
        assert!(off.cmple(2e-4 * known + 1e-6).all(), "{value} is not {known} of {index} at {directions:?}");
    }
}

/// Cells of a map of the sphere: rings of the cosine about the normal, and turns.
const RINGS: usize = 24;
const TURNS: usize = 32;

fn cell_of(direction: DVec3) -> usize {
    let ring = (0.5 * (direction.z + 1.0) * RINGS as f64) as usize;
    let turn = (direction.y.atan2(direction.x) / TAU + 0.5) * TURNS as f64;
    ring.min(RINGS - 1) * TURNS + (turn as usize).min(TURNS - 1)
}

#[test]
fn directions_are_drawn_with_the_pdf_that_is_told() {
    const DRAWN: usize = 1 << 15;
    let materials = every_material();
    let bench = Bench::new(&common::device(), &scene_of_materials(materials.clone()));
    let views = [0.95_f64, 0.3, -0.7];
    let level = sidak_level(1e-4, materials.len() * views.len());
    let mut random = Uniform::new(12);
    for (index, material) in materials.iter().enumerate() {
        // Narrower lobes have too few cells; the roughness of others is much the same code.
        if material.roughness.min_element() < 0.09 {
            continue;
        }
        // Points of a cell along each axis, at which its pdf is looked up.
        let points = if material.roughness.min_element() < 0.19 { 24 } else { 12 };
        for cosine in views {
            let wo = spherical(DVec3::Z, cosine, 0.7);
            let draws: Vec<SurfaceQuery> = (0..DRAWN)
                .map(|_| {
                    let ([choice], u) = (random.next(), random.next());
                    SurfaceQuery { choice, u, ..SurfaceQuery::new(index, DVec3::Z, wo, wo) }
                })
                .collect();
            let mut observed = vec![0.0; RINGS * TURNS];
            let mut lost = 0.0;
            for answer in bench.run::<_, BsdfAnswer>("bsdf", &draws) {
                let weight = answer.weight[..3].iter().any(|channel| *channel > 0.0);
                if weight { observed[cell_of(vector(answer.direction))] += 1.0 } else { lost += 1.0 }
            }
            let mut places = Vec::new();
            for cell in 0..RINGS * TURNS {
                let (ring, turn) = (cell / TURNS, cell % TURNS);
                for point in 0..points * points {
                    let (x, y) = ((point / points) as f64 + 0.5, (point % points) as f64 + 0.5);
                    let z = 2.0 * (ring as f64 + x / points as f64) / RINGS as f64 - 1.0;
                    let angle = TAU * ((turn as f64 + y / points as f64) / TURNS as f64 - 0.5);
                    places.push(SurfaceQuery::new(index, DVec3::Z, wo, spherical_about_z(z, angle)));
                }
            }
            let answers: Vec<BsdfAnswer> = bench.run("bsdf", &places);
            let solid = 4.0 * PI / (RINGS * TURNS * points * points) as f64;
            let mut expected: Vec<f64> = answers
                .chunks(points * points)
                .map(|cell| cell.iter().map(|a| f64::from(a.pdf)).sum::<f64>() * solid * DRAWN as f64)
                .collect();
            let kept: f64 = expected.iter().sum();
            assert!(kept < 1.02 * DRAWN as f64, "{kept} of {DRAWN} by the pdf of {material:?} at {cosine}");
            observed.push(lost);
            expected.push((DRAWN as f64 - kept).max(0.0));
            let test = chi_square(&observed, &expected);
            assert!(test.p > level, "p {} of {material:?} at cosine {cosine}", test.p);
        }
    }
}

fn spherical_about_z(z: f64, angle: f64) -> DVec3 {
    let across = DVec2::from_angle(angle) * (1.0 - z * z).max(0.0).sqrt();
    across.extend(z)
}

/// Mean weight of directions that are drawn, as energy, and its standard error.
fn albedo(bench: &Bench, index: usize, material: &Material, cosine: f64, draws: usize, seed: u64) -> (f64, f64) {
    let wo = spherical(DVec3::Z, cosine, 0.7);
    let mut random = Uniform::new(seed);
    let queries: Vec<SurfaceQuery> = (0..draws)
        .map(|_| {
            let ([choice], u) = (random.next(), random.next());
            SurfaceQuery { choice, u, ..SurfaceQuery::new(index, DVec3::Z, wo, wo) }
        })
        .collect();
    let answers: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
    let index_at = |z: f64| if z < 0.0 { f64::from(material.ior) } else { 1.0 };
    let transmits = refracts(material);
    let energies = answers.iter().map(|answer| {
        let z = vector(answer.direction).z;
        // Radiance over the square of the index is what is kept.
        let scale = if transmits { (index_at(z) / index_at(cosine)).powi(2) } else { 1.0 };
        f64::from(answer.weight[0]) * scale
    });
    let (sum, squares) = energies.fold((0.0, 0.0), |(sum, squares), e| (sum + e, squares + e * e));
    let mean = sum / draws as f64;
    (mean, ((squares / draws as f64 - mean * mean).max(0.0) / draws as f64).sqrt())
}

#[test]
fn white_surfaces_that_make_up_for_lost_light_lose_none() {
    let alphas = [0.02_f32, 0.1, 0.3, 0.6, 1.0];
    // Without a real part a metal reflects everything.
    let mirrors = alphas.map(|alpha| Material::conductor(Vec3::ZERO, Vec3::ONE, alpha));
    let white = alphas.map(|alpha| Material::metal_rough(Vec3::ONE, 1.0, alpha));
    let glass = [1.5_f32, 1.1, 2.4]
        .into_iter()
        .flat_map(|ior| alphas.map(|alpha| Material::dielectric(ior).rough(alpha, alpha)));
    let materials: Vec<Material> = mirrors.into_iter().chain(white).chain(glass).collect();
    let bench = Bench::new(&common::device(), &scene_of_materials(materials.clone()));
    for (index, material) in materials.iter().enumerate() {
        for cosine in [1.0, 0.9, 0.5, 0.2, 0.05] {
            for side in [1.0, -1.0] {
                if side < 0.0 && material.surface != Surface::Dielectric {
                    continue;
                }
                let (mean, error) = albedo(&bench, index, material, side * cosine, 1 << 16, 13);
                let off = (mean - 1.0).abs();
                assert!(off < 1e-3 + 4.0 * error, "{mean} ± {error} of {material:?} at cosine {}", side * cosine);
            }
        }
    }
}

#[test]
fn no_surface_gives_back_more_than_it_gets() {
    let white =
        |material: Material| Material { diffuse: material.diffuse.signum(), transmission: Vec3::ONE, ..material };
    let materials: Vec<Material> = every_material().into_iter().map(white).collect();
    let bench = Bench::new(&common::device(), &scene_of_materials(materials.clone()));
    for (index, material) in materials.iter().enumerate() {
        for cosine in [1.0, 0.5, 0.1, -0.6] {
            let (mean, error) = albedo(&bench, index, material, cosine, 1 << 13, 14);
            let most = most_given_back(material);
            assert!(mean < most + 2e-3 + 5.0 * error, "{mean} ± {error} of {material:?} at cosine {cosine}");
        }
    }
}

/// Materials at the ends of their ranges.
fn extremes() -> Vec<Material> {
    let alphas = [1e-6_f32, 1e-5, 1e-4, 1e-3, 0.5, 1.0];
    let metals = alphas.map(|alpha| Material::conductor(ETA, ABSORPTION, alpha));
    let stretched = Material::conductor(ETA, ABSORPTION, 0.0).rough(1.0, 1e-3);
    let near_one = [1.0 - 1e-7_f32, 1.0, 1.0 + 1.2e-7, 1.0 + 1e-4, 1e3, 1e-3];
    let glass = near_one.into_iter().flat_map(|ior| alphas.map(|alpha| Material::dielectric(ior).rough(alpha, alpha)));
    let plastics = [1e-6_f32, 1e-3, 1.0].map(|alpha| Material::plastic(Vec3::splat(0.9), 1.5, alpha));
    let mixtures = [1e-6_f32, 1.0].map(|alpha| Material::metal_rough(Vec3::splat(0.9), 0.5, alpha));
    let all = Principled {
        anisotropy: 1.0,
        sheen: 1.0,
        sheen_tint: 1.0,
        specular_tint: 1.0,
        specular_share: 1.0,
        flatness: 1.0,
        diffuse_transmission: 1.0,
    };
    let some = Principled { specular_share: 0.5, diffuse_transmission: 0.5, ..all };
    let none = Principled::default();
    let disney = [none, some, all].into_iter().flat_map(|principled| {
        [0.0_f32, 1.0].into_iter().flat_map(move |alpha| {
            [1.0_f32, 1.001, 1.5].into_iter().flat_map(move |ior| {
                let body = Material::principled(Vec3::splat(0.9), ior, alpha, principled);
                let coated = Material { coat: 1.0, coat_roughness: 0.001, metalness: 0.5, ..body.clone() };
                [body, coated, Material::principled_thin(Vec3::splat(0.9), ior, alpha, principled)]
            })
        })
    });
    let black = Material::principled(Vec3::ZERO, 1.5, 0.0, none);
    let others = plastics.into_iter().chain(mixtures).chain(disney).chain([black]);
    metals.into_iter().chain([stretched]).chain(glass).chain(others).collect()
}

#[test]
fn the_ends_of_all_ranges_give_numbers_and_no_more_light_than_there_is() {
    const N: usize = 1 << 10;
    let materials = extremes();
    let bench = Bench::new(&common::device(), &scene_of_materials(materials.clone()));
    let mut random = Uniform::new(15);
    let mut queries = Vec::new();
    for index in 0..materials.len() {
        for i in 0..N {
            // Half of them graze.
            let height = f64::from(random.next::<1>()[0]) * if i % 2 == 0 { 1.0 } else { 1e-5 };
            let side = if i % 4 < 2 { 1.0 } else { -1.0 };
            let wo = spherical_about_z(side * height.max(1e-7), TAU * f64::from(random.next::<1>()[0]));
            let ([choice], u) = (random.next(), random.next());
            queries.push(SurfaceQuery { choice, u, ..SurfaceQuery::new(index, DVec3::Z, wo, random.direction()) });
        }
    }
    let answers: Vec<BsdfAnswer> = bench.run("bsdf", &queries);
    for (query, answer) in queries.iter().zip(&answers) {
        let material = &materials[query.material[0] as usize];
        let name = || format!("{material:?} at {}: {answer:?}", vector(query.wo));
        let numbers = [answer.value.as_slice(), &[answer.pdf], &answer.direction, &answer.weight].concat();
        assert!(numbers.iter().all(|x| x.is_finite()), "{}", name());
        assert!(numbers[..4].iter().all(|x| *x >= 0.0) && answer.direction[3] > 0.0, "{}", name());
        assert!((vector(answer.direction).length() - 1.0).abs() < 1e-5, "{}", name());
        let scale = if refracts(material) { material.ior.max(1.0 / material.ior).powi(2) } else { 1.0 };
        // What masks and shadows is at most 1, and lost light is drawn about as it is lost. A sheen is drawn as diffuse.
        let most = if material.surface.is_principled() { 32.0 } else { 8.0 };
        assert!(answer.weight[..3].iter().all(|weight| *weight <= most * scale), "{}", name());
    }
    for (index, material) in materials.iter().enumerate() {
        for cosine in [1.0, 0.3, -0.8] {
            let (mean, error) = albedo(&bench, index, material, cosine, 1 << 12, 16);
            let most = most_given_back(material);
            assert!(mean < most + 3e-3 + 5.0 * error, "{mean} ± {error} of {material:?} at {cosine}");
        }
    }
}

#[test]
fn a_smooth_metal_reflects_by_its_index() {
    let materials: Vec<Material> = vec![Material::conductor(ETA, ABSORPTION, 0.0)];
    let bench = Bench::new(&common::device(), &scene_of_materials(materials));
    let queries: Vec<SurfaceQuery> = (0..200)
        .map(|i| SurfaceQuery::new(0, DVec3::Z, spherical_about_z((f64::from(i) + 0.5) / 200.0, 0.3), DVec3::Z))
        .collect();
    for (query, answer) in queries.iter().zip(bench.run::<_, BsdfAnswer>("bsdf", &queries)) {
        for channel in 0..3 {
            let exact = optics::metal_reflectance(vector(query.wo).z, ETA[channel].into(), ABSORPTION[channel].into());
            assert!((f64::from(answer.weight[channel]) - exact).abs() < 2e-6, "{exact} is not {answer:?}");
        }
    }
}
