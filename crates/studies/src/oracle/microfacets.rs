//! Rough surfaces as many small smooth ones. (Walter et al. 2007, Microfacet Models for Refraction through Rough Surfaces)
//!
//! Vectors are in the frame of a surface whose z axis is the normal on the viewer's side.

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use glam::{DVec2, DVec3};

use super::optics::{reflectance, refracted_cosine};
use raywave::parallel;

/// How the normals of facets are distributed.
#[derive(Debug, Clone, Copy)]
pub struct Facets {
    /// Widths along x and along y.
    pub alpha: DVec2,
    /// By Beckmann's distribution; else by GGX.
    pub is_beckmann: bool,
}

impl Facets {
    /// GGX of a width that is the same in all directions.
    pub fn round(alpha: f64) -> Self {
        Self { alpha: DVec2::splat(alpha), is_beckmann: false }
    }

    /// Slope of a facet, in widths.
    fn slope(self, m: DVec3) -> DVec2 {
        DVec2::new(m.x, m.y) / m.z / self.alpha
    }

    /// Density of facets with a normal above the horizon, over solid angle and projected area. (Eq. 25 and 33, for two widths)
    pub fn density(self, m: DVec3) -> f64 {
        let (square, area) = (self.slope(m).length_squared(), self.alpha.x * self.alpha.y);
        let falloff = if self.is_beckmann { (-square).exp() } else { (1.0 + square).powi(-2) };
        falloff * FRAC_1_PI / (area * m.z.powi(4))
    }

    /// Share of the facets that a direction sees of those that face it: Smith's, by itself on each side. (Eq. 27 and 34)
    pub fn unmasked(self, v: DVec3) -> f64 {
        // Tangent of the angle from the normal, in widths.
        let tangent = DVec2::new(v.x, v.y).length() / v.z.abs()
            * if v.x == 0.0 && v.y == 0.0 { 1.0 } else { (self.alpha * DVec2::new(v.x, v.y).normalize()).length() };
        if !self.is_beckmann {
            return 2.0 / (1.0 + (1.0 + tangent * tangent).sqrt());
        }
        // The rational approximation that belongs to eq. 27.
        let a = 1.0 / tangent;
        if a < 1.6 { (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a) } else { 1.0 }
    }

    /// f cos of facets that reflect everything, without their reflectance. (Eq. 20)
    pub fn mirrored(self, wo: DVec3, wi: DVec3) -> f64 {
        let m = (wo + wi).normalize();
        self.density(m) * self.unmasked(wo) * self.unmasked(wi) / (4.0 * wo.z)
    }

    /// The facet that refracts one direction to the other. `eta` is the index beyond over the index before. (Eq. 16)
    pub fn between(wo: DVec3, wi: DVec3, eta: f64) -> DVec3 {
        let m = (wo + eta * wi).normalize();
        if m.z < 0.0 { -m } else { m }
    }

    /// f cos of facets that transmit everything, as power: radiance is that over the square of `eta`. (Eq. 21)
    pub fn refracted(self, wo: DVec3, wi: DVec3, eta: f64) -> f64 {
        let m = Self::between(wo, wi, eta);
        let (cos_o, cos_i) = (wo.dot(m), wi.dot(m));
        if cos_o <= 0.0 || cos_i >= 0.0 {
            return 0.0;
        }
        let jacobian = eta * eta * -cos_i / (cos_o + eta * cos_i).powi(2);
        self.density(m) * self.unmasked(wo) * self.unmasked(wi) * cos_o / wo.z * jacobian
    }

    /// A facet's normal, with the pdf `density` times its cosine. (Eq. 28, 29, 35 and 36)
    pub fn draw(self, u: DVec2) -> DVec3 {
        let rest = (1.0 - u.x).max(1e-300);
        let radius = if self.is_beckmann { (-rest.ln()).sqrt() } else { (u.x / rest).sqrt() };
        (self.alpha * radius * DVec2::from_angle(TAU * u.y)).extend(1.0).normalize()
    }

    /// Its pdf over the solid angle of the normal.
    pub fn pdf(self, m: DVec3) -> f64 {
        self.density(m) * m.z
    }

    /// Shares of the light from a direction of that cosine which facets of an interface send back and let through, by one
    /// scattering. `reflected` is the reflectance at a facet by the cosine there; `eta` the index beyond, if light passes.
    fn back_and_through(self, cosine: f64, reflected: &dyn Fn(f64) -> f64, eta: Option<f64>) -> (f64, f64) {
        const RADII: u32 = 96;
        const TURNS: u32 = 48;
        let wo = DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
        let (mut back, mut through) = (0.0, 0.0);
        for i in 0..RADII {
            // The steep facets matter to grazing directions: points are the closer the steeper.
            let left = 1.0 - (f64::from(i) + 0.5) / f64::from(RADII);
            for turn in 0..TURNS {
                // Both halves of a turn are alike.
                let m = self.draw(DVec2::new(1.0 - left * left, 0.5 * (f64::from(turn) + 0.5) / f64::from(TURNS)));
                let facing = wo.dot(m);
                if facing <= 0.0 {
                    continue;
                }
                let weight = 2.0 * left * facing * self.unmasked(wo) / (wo.z * m.z);
                let share = reflected(facing);
                let wi = 2.0 * facing * m - wo;
                if wi.z > 0.0 {
                    back += weight * share * self.unmasked(wi);
                }
                let beyond = eta.and_then(|eta| Some((eta, refracted_cosine(facing, eta)?)));
                if let Some((eta, beyond)) = beyond {
                    let wi = (facing / eta - beyond) * m - wo / eta;
                    if wi.z < 0.0 {
                        through += weight * (1.0 - share) * self.unmasked(wi);
                    }
                }
            }
        }
        let points = f64::from(RADII * TURNS);
        (back / points, through / points)
    }
}

/// A function of a cosine in [0, 1].
#[derive(Debug, Clone)]
pub struct ByCosine {
    /// At equal steps of the cosine's root.
    values: Vec<f64>,
    /// Its mean over the directions of a hemisphere, weighted by the cosine.
    pub mean: f64,
}

impl ByCosine {
    const STEPS: usize = 128;

    fn of(value: impl Fn(f64) -> f64 + Sync) -> Self {
        let cosine = |i: usize| (i as f64 / Self::STEPS as f64).powi(2);
        let values = parallel::map(Self::STEPS + 1, &|i| value(cosine(i).max(1e-4)));
        let mut function = Self { values, mean: 0.0 };
        function.mean = mean_over_cosine(|cosine| function.at(cosine));
        function
    }

    /// Its value.
    pub fn at(&self, cosine: f64) -> f64 {
        let place = cosine.abs().min(1.0).sqrt() * Self::STEPS as f64;
        let left = (place as usize).min(Self::STEPS - 1);
        self.values[left] + (self.values[left + 1] - self.values[left]) * (place - left as f64)
    }

    /// Its mean as Mitsuba takes it: of 64 equal steps, the first and the last in full.
    pub fn mean_of_mitsuba(&self) -> f64 {
        (0..64).map(|i| f64::from(i) / 63.0).map(|cosine| cosine * self.at(cosine)).sum::<f64>() / 32.0
    }

    /// Light that facets of a mirror lose by one scattering.
    pub fn lost_by_mirrors(facets: Facets) -> Self {
        Self::of(|cosine| 1.0 - facets.back_and_through(cosine, &|_| 1.0, None).0)
    }

    /// Light that facets of an interface lose by one scattering.
    pub fn lost_by_glass(facets: Facets, eta: f64) -> Self {
        Self::of(|cosine| {
            let (back, through) = facets.back_and_through(cosine, &|facing| reflectance(facing, eta), Some(eta));
            1.0 - back - through
        })
    }

    /// Light that facets of an interface let through.
    pub fn let_through(facets: Facets, eta: f64) -> Self {
        Self::of(|cosine| facets.back_and_through(cosine, &|facing| reflectance(facing, eta), Some(eta)).1)
    }

    /// Light that facets of an interface reflect.
    pub fn sent_back(facets: Facets, eta: f64) -> Self {
        Self::of(|cosine| facets.back_and_through(cosine, &|facing| reflectance(facing, eta), None).0)
    }
}

/// The mean of a function of the cosine over the directions of a hemisphere, weighted by the cosine.
pub fn mean_over_cosine(value: impl Fn(f64) -> f64) -> f64 {
    const STEPS: u32 = 4096;
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(STEPS);
    (0..STEPS).map(|i| 2.0 * at(i) * value(at(i))).sum::<f64>() / f64::from(STEPS)
}

/// f cos of light that was lost and leaves diffusely: so much of it as each of both directions loses. (Kulla and Conty 2017,
/// Revisiting Physically Based Shading at Imageworks)
pub fn spread_again(lost_out: f64, lost_in: f64, mean_in: f64, cos_i: f64) -> f64 {
    if mean_in > 0.0 { lost_out * lost_in / (PI * mean_in) * cos_i.abs() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facets_cover_the_plane_that_they_are_on() {
        for is_beckmann in [false, true] {
            for alpha in [0.1, 0.5, 1.0] {
                let facets = Facets { alpha: DVec2::new(alpha, 0.5 * alpha), is_beckmann };
                // The density over projected area, on rings of the tangent: z = 1 / (1 + t^2).
                let (rings, turns) = (4000, 64);
                let mut sum = 0.0;
                for ring in 0..rings {
                    let (u, width) = ((f64::from(ring) + 0.5) / f64::from(rings), 1.0 / f64::from(rings));
                    let tangent = u / (1.0 - u);
                    let z = 1.0 / (1.0 + tangent * tangent).sqrt();
                    let solid = tangent * z.powi(3) * width / (1.0 - u).powi(2) * TAU / f64::from(turns);
                    for turn in 0..turns {
                        let across = DVec2::from_angle(TAU * (f64::from(turn) + 0.5) / f64::from(turns));
                        let m = (across * (1.0 - z * z).sqrt()).extend(z);
                        sum += facets.density(m) * z * solid;
                    }
                }
                assert!((sum - 1.0).abs() < 1e-4, "{sum} of {facets:?}");
            }
        }
    }

    #[test]
    fn light_that_is_lost_is_what_reflection_leaves() {
        for alpha in [0.2, 0.6, 1.0] {
            let lost = ByCosine::lost_by_mirrors(Facets::round(alpha));
            for cosine in [0.9_f64, 0.5, 0.2] {
                let wo = DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
                let (rings, turns) = (400, 400);
                let mut kept = 0.0;
                for place in 0..rings * turns {
                    let z = (f64::from(place / turns) + 0.5) / f64::from(rings);
                    let turn = DVec2::from_angle(TAU * (f64::from(place % turns) + 0.5) / f64::from(turns));
                    let wi = (turn * (1.0 - z * z).sqrt()).extend(z);
                    kept += Facets::round(alpha).mirrored(wo, wi) * TAU / f64::from(rings * turns);
                }
                assert!((1.0 - kept - lost.at(cosine)).abs() < 2e-3, "{kept} kept, {} lost", lost.at(cosine));
            }
        }
        assert!(ByCosine::lost_by_mirrors(Facets::round(0.01)).mean.abs() < 1e-3);
    }
}
