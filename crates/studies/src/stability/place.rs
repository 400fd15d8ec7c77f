//! Size and place of scenes, of things in them, and of the eye.

use glam::{DVec3, dvec3};

use super::Plan;
use super::lab::{Lab, tell, trial};
use super::stage::{WHITE_SKY, ball, cube, grey, lamp, mapped, moved, stage, stage_with_up};
use crate::studies::Trial;
use raywave::scene::Scene;
use raywave::settings::Integrator;

pub const PLANS: &[Plan] = &[
    Plan {
        name: "scale",
        driven: "size of the Cornell box, times",
        measure: "share of paths off the oracle's by more than 1e-3",
        allowed: 1e-3,
        remark: "positions are normalised in f64 by a power of two",
        reduced: "96² paths a setting",
        trials: scale,
    },
    Plan {
        name: "translation",
        driven: "distance of the Cornell box from the origin, in box sizes",
        measure: "share of paths off those at the origin by more than 1e-3",
        allowed: 1e-3,
        remark: "f64 itself rounds positions by 1e-16 of their distance",
        reduced: "96² paths a setting",
        trials: translation,
    },
    Plan {
        name: "sizes",
        driven: "size of a ball at the scene's centre, in scene sizes",
        measure: "share of samples that see what the oracle does not",
        allowed: 2e-2,
        remark: "at its outline alone",
        reduced: "96² samples a setting",
        trials: sizes,
    },
    Plan {
        name: "sizes-off-centre",
        driven: "the same ball, a quarter of the scene from its centre",
        measure: "share of samples that see what the oracle does not",
        allowed: 2e-2,
        remark: "vertices there are rounded to 3e-8 scene sizes",
        reduced: "96² samples a setting",
        trials: sizes_off_centre,
    },
    Plan {
        name: "gap",
        driven: "distance of the eye, in scene sizes, from plates that are 1e-5 apart",
        measure: "share of samples that see the plate behind",
        allowed: 0.0,
        remark: "",
        reduced: "96² samples a setting",
        trials: gap,
    },
    Plan {
        name: "grazing-view",
        driven: "angle between view and lamp, radians",
        measure: "share of samples that miss it",
        allowed: 0.0,
        remark: "the plane lies askew",
        reduced: "96² samples a setting",
        trials: grazing_view,
    },
    Plan {
        name: "grazing-light",
        driven: "angle at which light meets a floor, radians",
        measure: "relative error of the mean against a narrow lamp's closed form",
        allowed: 1e-3,
        remark: "cosines are rounded by 1e-7: light at an angle a is off by about 1e-7 / a",
        reduced: "96² x 16 samples a setting",
        trials: grazing_light,
    },
    Plan {
        name: "eye-on-surface",
        driven: "place of the eye on a white cube under a white sky",
        measure: "share of samples that are not 1",
        allowed: 0.0,
        remark: "",
        reduced: "96² samples a setting",
        trials: eye_on_surface,
    },
];

fn cornell(lab: &Lab<'_>, settings: Vec<(f64, bool)>, to: impl Fn(f64, DVec3) -> DVec3) -> Vec<Trial> {
    let original = Scene::cornell_box();
    let picture = lab.picture(Integrator::Explicit, 8);
    let run = |(value, required): (f64, bool)| {
        let scene = mapped(&original, |p| to(value, p));
        trial(tell(value), required, lab.against_paths(&scene, &picture, (&original, 1.0), false))
    };
    settings.into_iter().map(run).collect()
}

fn scale(lab: &Lab<'_>) -> Vec<Trial> {
    let small = cornell(lab, lab.ladder(&[1.0, 1e-3, 1e-6, 1e-9], &[1e-30, 1e-100, 1e-150, 1e-160]), |s, p| s * p);
    let large = cornell(lab, lab.ladder(&[1e3, 1e6, 1e9], &[1e30, 1e100, 1e150, 1e160]), |s, p| s * p);
    [small, large].concat()
}

fn translation(lab: &Lab<'_>) -> Vec<Trial> {
    let far = lab.ladder(&[0.0, 1e3, 1e5, 1e7], &[1e9, 1e10, 1e11, 1e12, 1e13]);
    // The box is two units wide.
    cornell(lab, far, |t, p| p + 2.0 * t * dvec3(0.6, -0.64, 0.48))
}

/// A ball of that radius at `centre` between two black floors.
fn ball_between_floors(radius: f64, centre: DVec3) -> Scene {
    let body = moved(ball(DVec3::splat(radius), 12), |p| p + centre);
    stage(centre + 4.0 * radius * dvec3(0.48, 0.6, 0.64), centre, 40.0)
        .material(grey(0.0))
        .square(0.5 * DVec3::Y, -DVec3::Y, 0.5)
        .square(-0.5 * DVec3::Y, DVec3::Y, 0.5)
        .material(lamp(1.0))
        .polygons(&body)
        .build()
}

fn balls(lab: &Lab<'_>, sizes: Vec<(f64, bool)>, centre: DVec3) -> Vec<Trial> {
    let picture = lab.picture(Integrator::Implicit, 0);
    let run = |(size, required): (f64, bool)| {
        let scene = ball_between_floors(0.5 * size, centre);
        trial(tell(size), required, lab.against_paths(&scene, &picture, (&scene, 1.0), false))
    };
    sizes.into_iter().map(run).collect()
}

fn sizes(lab: &Lab<'_>) -> Vec<Trial> {
    balls(lab, lab.ladder(&[1e-1, 1e-4, 1e-8], &[1e-12, 1e-16, 1e-20]), DVec3::ZERO)
}

fn sizes_off_centre(lab: &Lab<'_>) -> Vec<Trial> {
    balls(lab, lab.ladder(&[1e-1, 1e-2, 1e-3, 1e-4], &[1e-5, 1e-6, 1e-7, 1e-8]), dvec3(0.25, 0.11, -0.17))
}

fn gap(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = lab.picture(Integrator::Implicit, 0);
    let towards = dvec3(0.48, 0.6, 0.64);
    let run = |(distance, required): (f64, bool)| {
        // The plate in front fills the view and hides a brighter one.
        let vfov = 2.0 * (0.2 / distance).atan().to_degrees();
        let scene = stage(distance * towards, DVec3::ZERO, vfov)
            .material(lamp(1.0))
            .square(5e-6 * towards, towards, 0.35)
            .material(lamp(2.0))
            .square(-5e-6 * towards, towards, 0.35)
            .build();
        trial(tell(distance), required, lab.every_sample(&scene, &picture, 1e-6, |_| 1.0))
    };
    lab.ladder(&[1.0, 1e2, 1e4, 1e6, 1e9], &[1e12, 1e15]).into_iter().map(run).collect()
}

/// Axes of a frame that none of the world's is parallel to.
fn askew() -> [DVec3; 3] {
    let normal = dvec3(0.48, 0.6, 0.64);
    let along = normal.cross(dvec3(0.1, -0.9, 0.3)).normalize();
    [along, normal, along.cross(normal)]
}

fn grazing_view(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = lab.picture(Integrator::Implicit, 0);
    let [along, normal, _] = askew();
    let run = |(angle, required): (f64, bool)| {
        // The middle of the view meets the middle of the plane.
        let eye = -along + angle * normal;
        let scene = stage_with_up(eye, DVec3::ZERO, (0.3 * angle).to_degrees(), normal)
            .material(lamp(1.0))
            .square(DVec3::ZERO, normal, 1.0)
            .build();
        trial(tell(angle), required, lab.every_sample(&scene, &picture, 1e-6, |_| 1.0))
    };
    lab.ladder(&[1e-1, 1e-2, 1e-4, 1e-6], &[1e-7, 1e-8]).into_iter().map(run).collect()
}

fn grazing_light(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = raywave::settings::Settings { samples: 16, ..lab.picture(Integrator::Explicit, 1) };
    let [along, normal, _] = askew();
    let run = |(angle, required): (f64, bool)| {
        // A lamp a thousandth of the angle high, so that it is narrow, seen from a point of the floor.
        // The lamp is in the middle of the scene, where positions have the most digits.
        let to_lamp = angle.cos() * along + angle.sin() * normal;
        let half = 1e-4 * angle;
        // One triangle: of two in a plane, one blocks some rays to the other where the lamp is this small.
        let a = half * to_lamp.any_orthonormal_vector();
        let b = a.cross(to_lamp);
        let scene = stage(normal - to_lamp, -to_lamp, 1e-7)
            .material(grey(1.0))
            .square(-to_lamp, normal, 0.5)
            .square(to_lamp, normal, 0.5)
            .material(lamp((1.0 / (half * half)) as f32))
            .polygon(&[-a - b, a - b, b - a])
            .build();
        let ke = f64::from((1.0 / (half * half)) as f32);
        let exact = ke * 2.0 * half * half * angle.sin() / std::f64::consts::PI;
        trial(tell(angle), required, lab.mean(&scene, &picture, exact))
    };
    lab.ladder(&[1e-1, 1e-2], &[1e-3, 1e-4, 1e-5, 1e-6]).into_iter().map(run).collect()
}

fn eye_on_surface(lab: &Lab<'_>) -> Vec<Trial> {
    let picture = lab.picture(Integrator::Explicit, 1);
    let places = [
        ("face", dvec3(0.5, 0.1, -0.2)),
        ("edge", dvec3(0.5, 0.5, -0.2)),
        ("corner", DVec3::splat(0.5)),
        ("diagonal", dvec3(0.5, 0.2, 0.2)),
    ];
    let run = |((name, eye), required): ((&str, DVec3), bool)| {
        // Along the surface and away from the cube.
        let scene =
            stage(eye, eye + dvec3(1.0, 0.3, 0.2), 60.0).environment(WHITE_SKY).material(grey(1.0)).polygons(cube(0.5));
        trial(name, required, lab.every_sample(&scene.build(), &picture, 1e-5, |_| 1.0))
    };
    lab.ladder(&places, &[]).into_iter().map(run).collect()
}
