//! Surfaces at the ends of their numbers, and paths that go on for long.

use glam::{DVec3, dvec3};

use super::Plan;
use super::lab::{Lab, tell, trial};
use super::stage::{WHITE_SKY, cube, glass, gloss, grey, inside_out, lamp, stage};
use crate::studies::Trial;
use raywave::scene::{SceneBuilder, Surface};
use raywave::settings::{Integrator, Settings};

pub const PLANS: &[Plan] = &[
    Plan {
        name: "index",
        driven: "index of refraction of a cube that bends light, under a white sky",
        measure: "share of samples that are not 1",
        allowed: 0.0,
        remark: "up to 10^4 bounces",
        reduced: "96² samples a setting",
        trials: |lab| index(lab, Surface::Refractive),
    },
    Plan {
        name: "index-fresnel",
        driven: "index of refraction of a glass cube under a white sky",
        measure: "share of samples that are not 1",
        allowed: 0.0,
        remark: "up to 10^4 bounces",
        reduced: "96² samples a setting",
        trials: |lab| index(lab, Surface::Dielectric),
    },
    Plan {
        name: "critical-angle",
        driven: "width of the view, degrees, about the critical angle inside a glass cube",
        measure: "share of samples that are not Ni²",
        allowed: 0.0,
        remark: "",
        reduced: "96² samples a setting",
        trials: critical_angle,
    },
    Plan {
        name: "internal-reflections",
        driven: "reflections inside a glass slab before the light gets in at its end",
        measure: "share of samples that are not Ni²",
        allowed: 2e-4,
        remark: "a reflection within the rounding of the edge where the slab ends lets a path slip out, 8e-8 of them each; 96² samples of what is not promised",
        reduced: "96² samples a setting",
        trials: internal_reflections,
    },
    Plan {
        name: "in-glass",
        driven: "what is in glass",
        measure: "share of samples that are not the closed form",
        allowed: 0.0,
        remark: "by both integrators",
        reduced: "96² samples a setting",
        trials: in_glass,
    },
    Plan {
        name: "gloss",
        driven: "Ns of a floor under a white sky",
        measure: "relative error of the mean, (Ns + 1) / (Ns + 2)",
        allowed: 1e-4,
        remark: "implicit; Ns above 10^12 is rendered as 10^12, a lobe of a microradian",
        reduced: "96² x 64 samples a setting",
        trials: gloss_under_sky,
    },
    Plan {
        name: "gloss-shape",
        driven: "Ns of a floor that mirrors a lamp as wide as half of the lobe",
        measure: "relative error of the mean",
        allowed: 3e-3,
        remark: "implicit; beyond, the lamp itself and the directions are rounded",
        reduced: "96² x 64 samples a setting",
        trials: |lab| gloss_shape(lab, Integrator::Implicit, &[1e1, 1e3, 1e6, 1e8], &[1e9, 1e10, 1e11]),
    },
    Plan {
        name: "gloss-explicit",
        driven: "the same by light sampling",
        measure: "relative error of the mean",
        allowed: 3e-3,
        remark: "beyond, the lamp itself and the directions are rounded",
        reduced: "96² x 64 samples a setting",
        trials: |lab| gloss_shape(lab, Integrator::Explicit, &[1e1, 1e3, 1e6, 1e8], &[1e9, 1e10, 1e11]),
    },
    Plan {
        name: "white-room",
        driven: "most bounces in a closed room of Kd 1 with a lamp on a wall",
        measure: "share of samples that are not the lamp's radiance",
        allowed: 0.0,
        remark: "all light of such a room comes from the lamp, here a five-hundredth of its walls: after 10^4 bounces 2e-9 is left",
        reduced: "32² samples a setting",
        trials: white_room,
    },
    Plan {
        name: "albedo",
        driven: "1 - Kd of a room with a lamp, up to 10^4 bounces",
        measure: "relative difference of the means of the same paths here and by the oracle",
        allowed: 1e-5,
        remark: "a path parts from the oracle's after some tens of bounces, since each enlarges what rounding has done",
        reduced: "32² paths a setting",
        trials: albedo,
    },
    Plan {
        name: "roulette",
        driven: "q in the Cornell box, paths unbounded or of 64 bounces",
        measure: "share of paths off the oracle's by more than 1e-3",
        allowed: 2e-3,
        remark: "",
        reduced: "96² paths a setting",
        trials: roulette,
    },
    Plan {
        name: "roulette-bias",
        driven: "q before the last bounce to a white sky",
        measure: "relative error of the mean",
        allowed: 1e-4,
        remark: "random numbers are multiples of 2^-24: 1 - q is met to 6e-8 / (1 - q)",
        reduced: "96² x 256 samples a setting",
        trials: roulette_bias,
    },
];

fn index(lab: &Lab<'_>, surface: Surface) -> Vec<Trial> {
    let picture = lab.picture(Integrator::Implicit, 10_000);
    let run = |(ni, required): (f64, bool)| {
        let stage = stage(dvec3(1.1, 1.3, 2.6), DVec3::ZERO, 30.0).environment(WHITE_SKY);
        let scene = stage.material(glass(surface, ni as f32)).polygons(cube(0.5)).build();
        trial(tell(ni), required, lab.every_sample(&scene, &picture, 1e-3, |_| 1.0))
    };
    let promised = [1.0, 1.0 + 1.2e-7, 1.0 - 1.2e-7, 1.5, 0.1, 1e3];
    lab.ladder(&promised, &[1e-3, 1e-6, 1e-9, 1e6, 1e9, 1e12]).into_iter().map(run).collect()
}

/// Of an index below sqrt(1.5) light finds its way out of a cube whatever its direction.
const NI: f64 = 1.2;

fn critical_angle(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = lab.picture(Integrator::Implicit, 1000);
    let run = |(vfov, required): (f64, bool)| {
        let sine = 1.0 / f64::from(NI as f32);
        let towards = dvec3(sine, 0.0, -(1.0 - sine * sine).sqrt());
        let scene = stage(DVec3::ZERO, towards, vfov)
            .environment(WHITE_SKY)
            .material(glass(Surface::Dielectric, NI as f32))
            .polygons(cube(0.5))
            .build();
        trial(tell(vfov), required, lab.every_sample(&scene, &picture, 1e-5, |_| f64::from(NI as f32).powi(2)))
    };
    lab.ladder(&[60.0, 1.0, 1e-3, 1e-6], &[1e-9]).into_iter().map(run).collect()
}

fn internal_reflections(lab: &Lab<'_>) -> Vec<Trial> {
    let run = |(count, required): (u32, bool)| {
        // Steep enough to be reflected by the sides, flat enough to leave by the end.
        let slope = 30_f64.to_radians().tan();
        let half = 0.5 * slope / f64::from(count);
        let stage = stage(DVec3::ZERO, dvec3(slope, 0.0, 1.0), 1.0).environment(WHITE_SKY);
        let scene = stage
            .material(glass(Surface::Refractive, 1.5))
            .polygons(super::stage::cuboid(dvec3(-half, -2.0, -1.0), dvec3(half, 2.0, 1.0)));
        // Few of the paths that are thousands of rays long.
        let side = if required { lab.side() } else { lab.side().min(96) };
        let picture = Settings { width: side, height: side, ..lab.picture(Integrator::Implicit, 2 * count + 10) };
        trial(count, required, lab.every_sample(&scene.build(), &picture, 1e-3, |_| 2.25))
    };
    lab.ladder(&[10, 100, 1000], &[3000, 10_000]).into_iter().map(run).collect()
}

fn in_glass(lab: &Lab<'_>) -> Vec<Trial> {
    let body = |stage: SceneBuilder, surface| stage.material(glass(surface, NI as f32)).polygons(cube(0.5));
    let squared = f64::from(NI as f32).powi(2);
    let ball = super::stage::ball(DVec3::splat(0.4), 8);
    let within = || stage(dvec3(0.02, 0.01, 0.03), DVec3::X, 40.0);
    let outside = || stage(dvec3(0.0, 0.0, 3.0), DVec3::ZERO, 5.0);
    let shell = || inside_out(super::stage::ball(DVec3::splat(0.45), 8));
    let mut settings = Vec::new();
    for integrator in [Integrator::Implicit, Integrator::Explicit] {
        let by = format!("{integrator:?}").to_lowercase();
        settings.push((
            format!("camera, {by}"),
            integrator,
            body(within().environment(WHITE_SKY), Surface::Refractive),
            squared,
        ));
        let lit = body(outside(), Surface::Refractive).material(lamp(3.0)).polygons(&ball);
        settings.push((format!("lamp, {by}"), integrator, lit, 3.0 / squared));
        let both = body(within(), Surface::Refractive).material(lamp(3.0)).polygons(shell());
        settings.push((format!("camera and lamp, {by}"), integrator, both, 3.0));
    }
    let run = |(name, integrator, stage, expected): (String, Integrator, SceneBuilder, f64)| {
        let picture = lab.picture(integrator, 100);
        trial(name, true, lab.every_sample(&stage.build(), &picture, 1e-5, |_| expected))
    };
    settings.into_iter().map(run).collect()
}

fn gloss_under_sky(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = Settings { samples: lab.by_level(16, 64, 256), ..lab.picture(Integrator::Implicit, 1) };
    let run = |(ns, required): (f64, bool)| {
        let scene = stage(2.0 * DVec3::Y, DVec3::ZERO, 0.1)
            .environment(WHITE_SKY)
            .material(gloss(ns as f32))
            .square(DVec3::ZERO, DVec3::Y, 1.0)
            .build();
        trial(tell(ns), required, lab.mean(&scene, &picture, (ns + 1.0) / (ns + 2.0)))
    };
    lab.ladder(&[0.0, 1.0, 1e3, 1e6, 1e21], &[3e38]).into_iter().map(run).collect()
}

fn gloss_shape(lab: &Lab<'_>, integrator: Integrator, promised: &[f64], beyond: &[f64]) -> Vec<Trial> {
    let samples = lab.by_level(64, 64, 256);
    let picture = Settings { samples, ..lab.picture(integrator, 1) };
    let run = |(ns, required): (f64, bool)| {
        // Half of the lobe's directions lie within this angle of its axis: cos^(Ns + 1) = 1/2.
        let chord = (-2.0 * (0.5_f64.ln() / (ns + 1.0)).exp_m1()).sqrt();
        let angle = 2.0 * (0.5 * chord).asin();
        // A polygon as large as the disc that the cone of that angle cuts out of the plane across its axis.
        const SIDES: u32 = 64;
        let turn = std::f64::consts::TAU / f64::from(SIDES);
        let radius = angle.tan() * (turn / turn.sin()).sqrt();
        let mirrored = dvec3(0.6, 0.8, 0.0);
        let (u, v) = (dvec3(0.8, -0.6, 0.0), DVec3::Z);
        let corner = |i: u32| {
            let (sin, cos) = (turn * f64::from(i)).sin_cos();
            mirrored + radius * (cos * u + sin * v)
        };
        let disc: Vec<DVec3> = (0..SIDES).map(corner).collect();
        let front = (disc[1] - disc[0]).cross(disc[2] - disc[0]).dot(mirrored) < 0.0;
        let disc = if front { disc } else { disc.into_iter().rev().collect() };
        // The middle of the scene lies in the lamp, where positions have the most digits.
        let scene = stage(dvec3(-0.6, 0.8, 0.0), DVec3::ZERO, 1e-9)
            .material(gloss(ns as f32))
            .square(DVec3::ZERO, DVec3::Y, 0.1)
            .material(grey(0.0))
            .square(2.0 * mirrored, -DVec3::Y, 0.1)
            .material(lamp(1.0))
            .polygon(&disc)
            .build();
        // f cos / pdf is the cosine of the direction: near the axis's own, 0.8, for narrow lobes.
        let exact = expected_cosine(ns, angle);
        trial(tell(ns), required, lab.mean(&scene, &picture, exact))
    };
    lab.ladder(promised, beyond).into_iter().map(run).collect()
}

/// The integral over the cone of that angle of the lobe's density times the cosine at the floor, 0.8 on the axis: the
/// mean cosine over a turn is 0.8 cos of the angle from the axis.
fn expected_cosine(ns: f64, angle: f64) -> f64 {
    0.8 * (ns + 1.0) / (ns + 2.0) * -((ns + 2.0) * angle.cos().ln()).exp_m1()
}

/// A closed room whose ceiling holds a lamp of that share of all walls.
fn room(kd: f32, share: f64) -> SceneBuilder {
    let half = 0.5 * (6.0 * share).sqrt();
    let places = [-0.5, -half, half, 0.5];
    // Nine fields, so that corners meet corners alone; the middle one is the lamp.
    let field = |i: usize, j: usize| -> Vec<DVec3> {
        let corner = |i: usize, j: usize| dvec3(places[i], 0.5, places[j]);
        vec![corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]
    };
    let around: Vec<_> = (0..9).filter(|n| *n != 4).map(|n| field(n / 3, n % 3)).collect();
    let walls: Vec<_> = inside_out(cube(0.5)).into_iter().filter(|wall| wall.iter().any(|p| p.y < 0.0)).collect();
    stage(dvec3(0.1, -0.1, 0.3), dvec3(0.0, -0.4, -0.2), 60.0)
        .material(grey(kd))
        .polygons(&walls)
        .polygons(&around)
        .material(lamp(1.0))
        .polygon(&field(1, 1))
}

/// A picture of few paths, which are long.
fn long_paths(lab: &Lab<'_>, bounces: u32) -> Settings {
    let side = lab.by_level(16, 32, 128);
    Settings { width: side, height: side, ..lab.picture(Integrator::Implicit, bounces) }
}

fn white_room(lab: &Lab<'_>) -> Vec<Trial> {
    let run = |(bounces, required): (u32, bool)| {
        let picture = long_paths(lab, bounces);
        trial(bounces, required, lab.every_sample(&room(1.0, 2e-3).build(), &picture, 1e-6, |_| 1.0))
    };
    lab.ladder(&[10_000], &[]).into_iter().map(run).collect()
}

fn albedo(lab: &Lab<'_>) -> Vec<Trial> {
    let run = |(loss, required): (f64, bool)| {
        let scene = room((1.0 - loss) as f32, 2e-2).build();
        trial(tell(loss), required, lab.mean_of_paths(&scene, &long_paths(lab, 10_000)))
    };
    lab.ladder(&[0.5, 1e-3, 1e-6], &[]).into_iter().map(run).collect()
}

fn roulette(lab: &Lab<'_>) -> Vec<Trial> {
    let scene = raywave::scene::Scene::cornell_box();
    let run = |(q, required): (f64, bool)| {
        let max_bounces = (q == 0.0).then_some(64);
        let picture = Settings { roulette: q, max_bounces, ..lab.picture(Integrator::Explicit, 0) };
        let setting = tell(q);
        trial(setting, required, lab.against_paths(&scene, &picture, (&scene, 1.0), false))
    };
    lab.ladder(&[0.0, 0.5, 0.9, 0.999], &[0.999_999]).into_iter().map(run).collect()
}

fn roulette_bias(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = Settings { samples: lab.by_level(64, 256, 1024), ..lab.picture(Integrator::Implicit, 1) };
    let run = |(q, required): (f64, bool)| {
        let scene = stage(2.0 * DVec3::Y, DVec3::ZERO, 20.0).environment(WHITE_SKY).material(grey(0.5));
        let scene = scene.square(DVec3::ZERO, DVec3::Y, 1.0).build();
        trial(tell(q), required, lab.mean(&scene, &Settings { roulette: q, ..picture }, 0.5))
    };
    lab.ladder(&[0.0, 0.5, 0.9, 0.999], &[0.999_999]).into_iter().map(run).collect()
}
