//! Microfacets, coats and Disney's materials at the ends of their numbers.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use glam::{DVec2, DVec3, Vec3, dvec3};

use super::Plan;
use super::lab::{Lab, Measured, tell, trial};
use super::stage::{WHITE_SKY, cube, grey, lamp, stage};
use crate::oracle::bsdf::Bsdf;
use crate::studies::Trial;
use raywave::parallel;
use raywave::render::RenderError;
use raywave::scene::{Camera, Material, Principled, SceneBuilder};
use raywave::settings::{Integrator, Settings};

pub const PLANS: &[Plan] = &[
    Plan {
        name: "facets",
        driven: "roughness (alpha) of floors of every kind of microfacets, seen at 45° under a white sky",
        measure: "relative error of the worst floor's mean against the oracle's albedo",
        allowed: 3e-3,
        remark: "metals of both distributions, rough glass, rough plastic, metal-rough under a coat, Disney's body, glass and sheet; the kernels' tables of lost light have 32 x 32 entries",
        reduced: "fewer samples",
        trials: by_roughness,
    },
    Plan {
        name: "facets-grazing",
        driven: "cosine between the view and the normal of the same floors, of roughness 0.3",
        measure: "relative error of the worst floor's mean against the oracle's albedo",
        allowed: 5e-3,
        remark: "",
        reduced: "fewer samples",
        trials: by_cosine,
    },
    Plan {
        name: "facets-aspect",
        driven: "ratio of a white metal's roughness along and across, 0.5 along, under a white sky",
        measure: "relative error of the mean against the oracle's albedo",
        allowed: 3e-3,
        remark: "light that is lost is taken to be that of the mean of both",
        reduced: "fewer samples",
        trials: aspect,
    },
    Plan {
        name: "facets-index",
        driven: "index of refraction of a cube of rough glass, alpha 0.3, under a white sky",
        measure: "relative error of the mean; what enters leaves again",
        allowed: 2e-3,
        remark: "up to 200 bounces",
        reduced: "fewer samples",
        trials: index,
    },
    Plan {
        name: "facets-shape",
        driven: "roughness (alpha) of a white metal that mirrors a lamp as wide as half of the lobe",
        measure: "relative error of the mean",
        allowed: 3e-3,
        remark: "implicit",
        reduced: "fewer samples",
        trials: |lab| shape(lab, Integrator::Implicit, &[0.01, 1e-3, 1e-4, 1e-5, 1e-6]),
    },
    Plan {
        name: "facets-shape-explicit",
        driven: "the same by light sampling",
        measure: "relative error of the mean",
        allowed: 3e-3,
        remark: "",
        reduced: "fewer samples",
        trials: |lab| shape(lab, Integrator::Explicit, &[0.01, 1e-3, 1e-4, 1e-5, 1e-6]),
    },
];

/// Copper, by Mitsuba's table.
const ETA: Vec3 = Vec3::new(0.200, 0.924, 1.102);
const ABSORPTION: Vec3 = Vec3::new(3.912, 2.452, 2.142);

/// A material of each kind.
fn kinds(alpha: f32) -> Vec<Material> {
    let colour = Vec3::new(0.9, 0.5, 0.1);
    let metal = Material::conductor(ETA, ABSORPTION, alpha);
    let glassy = Principled { specular_share: 0.7, sheen: 0.5, ..Principled::default() };
    let leaf = Principled { specular_share: 0.6, flatness: 0.5, diffuse_transmission: 0.4, ..glassy };
    vec![
        Material { is_beckmann: true, compensates: false, ..metal.clone() },
        metal,
        Material::dielectric(1.5).rough(alpha, alpha),
        Material::plastic(colour, 1.5, alpha),
        Material { coat: 0.8, coat_roughness: alpha, ..Material::metal_rough(colour, 0.5, alpha) },
        Material::principled(colour, 1.5, alpha, Principled { sheen: 0.5, ..Principled::default() }),
        Material::principled(colour, 1.5, alpha, glassy),
        Material::principled_thin(colour, 1.5, alpha, leaf),
    ]
}

/// Strips of floor, one of each material, seen from far away under a white sky; each shows its albedo.
fn strips(materials: Vec<Material>, cosine: f64) -> SceneBuilder {
    let count = materials.len() as f64;
    // Strips run away from the view, and are long enough to fill it. The eye is high enough that all of it is above them.
    let eye = dvec3(0.0, cosine, (1.0 - cosine * cosine).sqrt()) / cosine;
    let camera = Camera { orthographic: Some(1.0), up: -DVec3::Z, ..Camera::pinhole(eye, DVec3::ZERO, 40.0) };
    let camera = if cosine < 0.999 { Camera { up: DVec3::Y, ..camera } } else { camera };
    let far = 1.0 / cosine;
    let place = |i: f64| i / count - 0.5;
    let floor = SceneBuilder::new(camera).environment(WHITE_SKY);
    materials.into_iter().zip(0..).fold(floor, |scene, (material, i)| {
        let (left, right) = (place(f64::from(i)), place(f64::from(i + 1)));
        scene.material(material).polygon(&[
            dvec3(left, 0.0, far),
            dvec3(right, 0.0, far),
            dvec3(right, 0.0, -far),
            dvec3(left, 0.0, -far),
        ])
    })
}

/// Radiance that a surface gives back under a white sky, above and below: the oracle's values, integrated over directions
/// that lie the closer the nearer they are to the horizon or to the normal. For lobes that are wide.
fn integrated(material: &Material, wo: DVec3) -> DVec3 {
    const RINGS: u32 = 512;
    const TURNS: u32 = 1024;
    let bsdf = Bsdf::new(material);
    let ring = |ring: u32| {
        let s = (f64::from(ring) + 0.5) / f64::from(RINGS);
        let z = s * s * (3.0 - 2.0 * s);
        let directions = (0..TURNS).flat_map(|turn| {
            let across = DVec2::from_angle(TAU * (f64::from(turn) + 0.5) / f64::from(TURNS)) * (1.0 - z * z).sqrt();
            [across.extend(z), across.extend(-z)]
        });
        directions.map(|wi| bsdf.value(wo, wi, true)).sum::<DVec3>() * 6.0 * s * (1.0 - s)
    };
    parallel::map(RINGS as usize, &|number| ring(number as u32)).into_iter().sum::<DVec3>() * TAU
        / f64::from(RINGS * TURNS)
}

/// The same by directions that the oracle draws, for lobes of any width.
fn albedo(material: &Material, wo: DVec3, points: u32) -> DVec3 {
    let bsdf = Bsdf::new(material);
    // Points of a lattice of three dimensions. (Roberts 2018, The Unreasonable Effectiveness of Quasirandom Sequences, R3)
    let step = dvec3(0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3);
    let drawn = |i: u32| {
        let u = (f64::from(i) * step + 0.5).fract();
        bsdf.draw(wo, true, u.x, DVec2::new(u.y, u.z)).map_or(DVec3::ZERO, |drawn| drawn.weight)
    };
    parallel::map(points as usize, &|i| drawn(i as u32)).into_iter().sum::<DVec3>() / f64::from(points)
}

/// The worst error of the strips' means.
fn worst_strip(
    lab: &Lab<'_>,
    materials: Vec<Material>,
    cosine: f64,
    exact: impl Fn(&Material, DVec3) -> DVec3,
) -> Result<Measured, RenderError> {
    let count = materials.len();
    let picture = lab.picture(Integrator::Implicit, 1);
    let picture = Settings { samples: lab.by_level(64, 256, 1024), ..picture };
    // In the basis of a floor z goes down the view.
    let (x, y) = crate::oracle::optics::basis(DVec3::Y);
    let eye = dvec3(0.0, cosine, (1.0 - cosine * cosine).sqrt());
    let wo = dvec3(eye.dot(x), eye.dot(y), eye.y);
    let exact: Vec<DVec3> = materials.iter().map(|material| exact(material, wo)).collect();
    let (film, nonfinite) = lab.film(&strips(materials, cosine).build(), &picture)?;
    let mut worst = Measured { value: 0.0, standard_error: 0.0, checked: 0, nonfinite };
    for (strip, exact) in exact.into_iter().enumerate() {
        let (width, samples) = (picture.width as usize, f64::from(picture.samples));
        let pixels = || film.sum.iter().enumerate().filter(|(pixel, _)| pixel % width * count / width == strip);
        let n = pixels().count() as f64;
        let mean = pixels().map(|(_, sum)| *sum / samples).sum::<DVec3>() / n;
        let square = pixels().map(|(_, sum)| (*sum / samples - mean).powf(2.0)).sum::<DVec3>() / (n - 1.0);
        let off = ((mean - exact) / exact).abs().max_element();
        if off > worst.value || off.is_nan() {
            let error = (square / n).map(f64::sqrt) / exact;
            worst = Measured { value: off, standard_error: error.max_element(), ..worst };
        }
        worst.checked += n as u64 * u64::from(picture.samples);
    }
    Ok(worst)
}

/// Points by which the albedo of lobes of any width is known to a thousandth.
const POINTS: u32 = 1 << 19;

fn by_roughness(lab: &Lab<'_>) -> Vec<Trial> {
    let run = |(alpha, required): (f64, bool)| {
        let exact = |material: &Material, wo| albedo(material, wo, POINTS);
        trial(tell(alpha), required, worst_strip(lab, kinds(alpha as f32), FRAC_1_SQRT_2, exact))
    };
    lab.ladder(&[1.0, 0.1, 0.01, 1e-3, 1e-4, 1e-6], &[]).into_iter().map(run).collect()
}

fn by_cosine(lab: &Lab<'_>) -> Vec<Trial> {
    let run = |(cosine, required): (f64, bool)| {
        trial(tell(cosine), required, worst_strip(lab, kinds(0.3), cosine, integrated))
    };
    lab.ladder(&[1.0, 0.1, 0.01, 1e-3], &[1e-4]).into_iter().map(run).collect()
}

fn white_metal(along: f32, across: f32) -> Material {
    Material::conductor(Vec3::ZERO, Vec3::ONE, 0.0).rough(along, across)
}

fn aspect(lab: &Lab<'_>) -> Vec<Trial> {
    let run = |(aspect, required): (f64, bool)| {
        let metal = white_metal(0.5, (0.5 / aspect) as f32);
        trial(
            tell(aspect),
            required,
            worst_strip(lab, vec![metal], FRAC_1_SQRT_2, |material, wo| albedo(material, wo, POINTS)),
        )
    };
    lab.ladder(&[1.0, 10.0, 100.0, 1000.0], &[1e5]).into_iter().map(run).collect()
}

fn index(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = Settings { samples: lab.by_level(16, 64, 256), ..lab.picture(Integrator::Implicit, 200) };
    let run = |(ni, required): (f64, bool)| {
        let stage = stage(dvec3(1.1, 1.3, 2.6), DVec3::ZERO, 15.0).environment(WHITE_SKY);
        let glass = Material::dielectric(ni as f32).rough(0.3, 0.3);
        let scene = stage.material(glass).polygons(cube(0.5)).build();
        trial(tell(ni), required, lab.mean(&scene, &picture, 1.0))
    };
    lab.ladder(&[1.0, 1.5, 0.7, 1.0 - 1.2e-7, 1.0 + 1.2e-7], &[2.5]).into_iter().map(run).collect()
}

fn shape(lab: &Lab<'_>, integrator: Integrator, promised: &[f64]) -> Vec<Trial> {
    let picture = Settings { samples: lab.by_level(64, 64, 256), ..lab.picture(integrator, 1) };
    let run = |(alpha, required): (f64, bool)| {
        // Half of the facets are steeper than alpha. Seen from above they mirror beyond twice that angle.
        const SIDES: u32 = 64;
        let turn = TAU / f64::from(SIDES);
        let radius = (2.0 * f64::from(alpha as f32).atan()).tan() * (turn / turn.sin()).sqrt();
        let corner = |i: u32| {
            let (sin, cos) = (turn * f64::from(i)).sin_cos();
            dvec3(radius * cos, 1.0, radius * sin)
        };
        // The middle of the scene lies in the lamp, where positions have the most digits.
        let scene = stage(0.5 * DVec3::Y, DVec3::ZERO, 1e-9)
            .material(white_metal(alpha as f32, alpha as f32))
            .square(DVec3::ZERO, DVec3::Y, 0.1)
            .material(grey(0.0))
            .square(2.0 * DVec3::Y, -DVec3::Y, 0.1)
            .material(lamp(1.0))
            .polygon(&(0..SIDES).map(corner).collect::<Vec<DVec3>>())
            .build();
        trial(tell(alpha), required, lab.mean(&scene, &picture, 0.5))
    };
    lab.ladder(promised, &[]).into_iter().map(run).collect()
}
