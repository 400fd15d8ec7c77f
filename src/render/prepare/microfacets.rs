//! What kernels look up of microfacets instead of integrating it at each vertex: the light that one scattering loses, what
//! a rough coat lets through, and means of reflectances.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::{DVec2, DVec3, Vec3};

use crate::constants::TABLE_SIZE;
use crate::parallel;
use crate::scene::{Material, Surface};

/// Tables in the words of the texture buffer.
///
/// A table has rows of equal steps of the root of a roughness from 0 to 1, in each of them equal steps of the root of a
/// cosine. A word holds a value and its right neighbour as `f32`, so that two words are enough for bilinear interpolation.
/// Behind its rows are as many words of the mean of each, weighted by the cosine, and of the next.
pub(super) struct Tables<'a> {
    words: &'a mut Vec<[u32; 2]>,
    /// Where each begins, by what it is of.
    known: HashMap<Subject, u32>,
}

/// What a table is of. Indices of refraction are by their bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Subject {
    /// Light lost by microfacets that reflect everything.
    Mirrors(Distribution),
    /// Light lost by microfacets of a dielectric, from outside; those from inside come behind it.
    Glass(u32, Distribution),
    /// Light that microfacets of a dielectric let through from outside.
    Coat(u32, Distribution),
}

/// How the normals of microfacets are distributed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Distribution {
    Ggx,
    Beckmann,
}

impl Distribution {
    fn of(material: &Material) -> Self {
        if material.is_beckmann { Self::Beckmann } else { Self::Ggx }
    }

    /// Smith's masking of a direction of that cosine. (Walter et al. 2007)
    fn unmasked(self, cosine: f64, alpha: f64) -> f64 {
        let cosine = cosine.abs();
        let across = alpha * (1.0 - cosine * cosine).max(0.0).sqrt();
        match self {
            Self::Ggx => 2.0 * cosine / (cosine + across.hypot(cosine)),
            Self::Beckmann => match cosine / across.max(1e-12) {
                a if a < 1.6 => (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a),
                _ => 1.0,
            },
        }
    }

    /// A microfacet's normal, and its weight among those that `wo` sees, which has a mean of 1.
    fn normal(self, wo: DVec3, alpha: f64, u: DVec2) -> (DVec3, f64) {
        match self {
            Self::Ggx => (visible_normal(wo, alpha, u), 1.0),
            Self::Beckmann => {
                let slope = alpha * (-(1.0 - u.y).max(1e-300).ln()).sqrt() * DVec2::from_angle(TAU * u.x);
                let m = slope.extend(1.0).normalize();
                (m, self.unmasked(wo.z, alpha) * wo.dot(m).max(0.0) / (wo.z * m.z))
            }
        }
    }
}

impl<'a> Tables<'a> {
    /// Tables that are added to those words.
    pub fn new(words: &'a mut Vec<[u32; 2]>) -> Self {
        Self { words, known: HashMap::new() }
    }

    /// One more than the place of the table that the kernels look up for a material; 0 for none.
    pub fn place(&mut self, material: &Material) -> u32 {
        let index = material.ior.to_bits();
        let distribution = Distribution::of(material);
        let subject = match material.surface {
            _ if !material.is_rough() => return 0,
            Surface::Conductor | Surface::MetalRough if material.compensates => Subject::Mirrors(distribution),
            Surface::Dielectric if material.compensates => Subject::Glass(index, distribution),
            Surface::Plastic { .. } => Subject::Coat(index, distribution),
            _ => return 0,
        };
        if let Some(place) = self.known.get(&subject) {
            return place + 1;
        }
        let place = self.words.len() as u32;
        let eta = f64::from(material.ior);
        match subject {
            Subject::Mirrors(_) => self.add(|cosine, alpha| 1.0 - scattered(cosine, alpha, distribution, |_| 1.0)),
            Subject::Glass(..) => {
                self.add(|cosine, alpha| 1.0 - through_and_back(cosine, alpha, distribution, eta).iter().sum::<f64>());
                self.add(|cosine, alpha| {
                    1.0 - through_and_back(cosine, alpha, distribution, 1.0 / eta).iter().sum::<f64>()
                });
            }
            Subject::Coat(..) => self.add(|cosine, alpha| through_and_back(cosine, alpha, distribution, eta)[0]),
        }
        self.known.insert(subject, place);
        place + 1
    }

    /// Adds a table of a function of the cosine and the roughness.
    fn add(&mut self, value: impl Fn(f64, f64) -> f64 + Sync) {
        let size = TABLE_SIZE as usize;
        let at = |step: usize| (step as f64 / (size - 1) as f64).powi(2);
        let rows: Vec<Vec<f64>> = parallel::map(size, &|row| {
            (0..size).map(|column| value(at(column).max(1e-4), at(row).max(1e-6)).max(0.0)).collect()
        });
        let pair = |values: &[f64], place: usize| {
            [values[place], values[(place + 1).min(size - 1)]].map(|value| (value as f32).to_bits())
        };
        for row in &rows {
            self.words.extend((0..size).map(|column| pair(row, column)));
        }
        let means: Vec<f64> = rows.iter().map(|row| mean(|cosine| interpolated(row, cosine))).collect();
        self.words.extend((0..size).map(|row| pair(&means, row)));
    }
}

/// A row at a cosine, as the kernels interpolate it.
fn interpolated(row: &[f64], cosine: f64) -> f64 {
    let at = cosine.sqrt() * (row.len() - 1) as f64;
    let left = (at as usize).min(row.len() - 2);
    row[left] + (row[left + 1] - row[left]) * (at - left as f64)
}

/// Steps in which the mean of a function is taken.
const STEPS: u32 = 1024;

/// The mean of a function of the cosine over directions, weighted by the cosine.
fn mean(value: impl Fn(f64) -> f64) -> f64 {
    // The cosine's square is uniform.
    let at = |step: u32| ((f64::from(step) + 0.5) / f64::from(STEPS)).sqrt();
    (0..STEPS).map(|step| value(at(step))).sum::<f64>() / f64::from(STEPS)
}

/// Reflectance of unpolarised light at a dielectric. `eta` is the index beyond over the index before. (Fresnel 1823)
pub(super) fn reflectance(cosine: f64, eta: f64) -> f64 {
    let squared = (eta - 1.0) * (eta + 1.0) + cosine * cosine;
    if squared <= 0.0 {
        return 1.0;
    }
    let beyond = squared.sqrt() / eta;
    let perpendicular = (cosine - eta * beyond) / (cosine + eta * beyond);
    let parallel = (eta * cosine - beyond) / (eta * cosine + beyond);
    0.5 * (perpendicular * perpendicular + parallel * parallel)
}

/// Reflectance of unpolarised light at a metal of the index eta + i k. (Born and Wolf, Principles of Optics, 14.2)
fn metal_reflectance(cosine: f64, eta: f64, k: f64) -> f64 {
    let cosine2 = cosine * cosine;
    let sine2 = 1.0 - cosine2;
    let difference = eta * eta - k * k - sine2;
    let a2_plus_b2 = (difference * difference + 4.0 * eta * eta * k * k).sqrt();
    let a = (0.5 * (a2_plus_b2 + difference)).max(0.0).sqrt();
    let (plus, minus) = (a2_plus_b2 + cosine2, 2.0 * a * cosine);
    let perpendicular = (plus - minus) / (plus + minus);
    let (plus, minus) = (cosine2 * a2_plus_b2 + sine2 * sine2, minus * sine2);
    perpendicular * (0.5 + 0.5 * (plus - minus) / (plus + minus))
}

/// Share of diffuse light inside a coat that its surface reflects. With microfacets it is the mean over their albedo, as
/// Mitsuba sums it.
pub(super) fn inner_reflectance(material: &Material) -> f32 {
    let eta = 1.0 / f64::from(material.ior);
    let alpha = f64::from(material.roughness.max_element());
    let inner = match material.surface {
        Surface::Plastic { .. } if material.is_rough() => mean_of_samples(|cosine| {
            scattered(cosine, alpha, Distribution::of(material), |cosine| reflectance(cosine, eta))
        }),
        Surface::Plastic { .. } => mean(|cosine| reflectance(cosine, eta)),
        _ => 0.0,
    };
    inner as f32
}

/// The mean of a function of the cosine over directions, weighted by the cosine, from 64 values that count alike, those at
/// both ends too: for what grows towards the horizon it is about 1/64 below the integral. That defines Mitsuba's rough
/// plastic, which would be some percent brighter by the integral.
fn mean_of_samples(value: impl Fn(f64) -> f64) -> f64 {
    const SAMPLES: u32 = 64;
    let at = |sample: u32| (f64::from(sample) / f64::from(SAMPLES - 1)).max(1e-6);
    (0..SAMPLES).map(|sample| 2.0 * at(sample) * value(at(sample))).sum::<f64>() / f64::from(SAMPLES)
}

/// Mean reflectance of a metal's microfacets, weighted by the cosine.
pub(super) fn mean_reflectance(material: &Material) -> Vec3 {
    if material.surface != Surface::Conductor {
        return Vec3::ZERO;
    }
    let channel = |eta: f32, k: f32| mean(|cosine| metal_reflectance(cosine, f64::from(eta), f64::from(k))) as f32;
    let (eta, k) = (material.eta, material.absorption);
    material.specular * Vec3::new(channel(eta.x, k.x), channel(eta.y, k.y), channel(eta.z, k.z))
}

/// The mean of a function of two values over the unit square, by points that lie the closer the nearer the second coordinate
/// is to 1: there visible normals are steep. (Roberts 2018, The Unreasonable Effectiveness of Quasirandom Sequences, R2)
fn mean_over_square(value: impl Fn(DVec2) -> [f64; 2]) -> [f64; 2] {
    const POINTS: u32 = 2048;
    const STEP: DVec2 = DVec2::new(0.754_877_666_246_693, 0.569_840_290_998_053);
    let weighted = (0..POINTS).map(|i| {
        let DVec2 { x, y } = (f64::from(i) * STEP + 0.5).fract();
        value(DVec2::new(x, 1.0 - y * y)).map(|value| 2.0 * y * value)
    });
    weighted.fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]).map(|sum| sum / f64::from(POINTS))
}

/// A microfacet's normal as a direction sees them. (Dupuy and Benyoub 2023, Sampling Visible GGX Normals with Spherical Caps)
fn visible_normal(wo: DVec3, alpha: f64, u: DVec2) -> DVec3 {
    let stretched = DVec3::new(wo.x * alpha, wo.y * alpha, wo.z).normalize();
    let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    let across = DVec2::from_angle(TAU * u.x) * (1.0 - z * z).max(0.0).sqrt();
    let h = across.extend(z) + stretched;
    DVec3::new(h.x * alpha, h.y * alpha, h.z.max(1e-12)).normalize()
}

fn direction_at(cosine: f64) -> DVec3 {
    DVec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), 0.0, cosine)
}

/// Albedo of microfacets of a reflectance, by one scattering.
fn scattered(cosine: f64, alpha: f64, distribution: Distribution, reflectance: impl Fn(f64) -> f64) -> f64 {
    let wo = direction_at(cosine);
    mean_over_square(|u| {
        let (m, weight) = distribution.normal(wo, alpha, u);
        let on_facet = wo.dot(m).max(0.0);
        let wi = 2.0 * on_facet * m - wo;
        let seen = if wi.z > 0.0 { distribution.unmasked(wi.z, alpha) } else { 0.0 };
        [weight * reflectance(on_facet) * seen, 0.0]
    })[0]
}

/// Shares of light that microfacets of a dielectric let through and reflect, by one scattering.
fn through_and_back(cosine: f64, alpha: f64, distribution: Distribution, eta: f64) -> [f64; 2] {
    let wo = direction_at(cosine);
    mean_over_square(|u| {
        let (m, weight) = distribution.normal(wo, alpha, u);
        let on_facet = wo.dot(m).max(0.0);
        let reflected = 2.0 * on_facet * m - wo;
        let share = reflectance(on_facet, eta);
        let back = if reflected.z > 0.0 { share * distribution.unmasked(reflected.z, alpha) } else { 0.0 };
        let squared = (eta - 1.0) * (eta + 1.0) + on_facet * on_facet;
        let beyond = squared.max(0.0).sqrt() / eta;
        let refracted = (on_facet / eta - beyond) * m - wo / eta;
        let through = if squared > 0.0 && refracted.z < 0.0 {
            (1.0 - share) * distribution.unmasked(refracted.z, alpha)
        } else {
            0.0
        };
        [weight * through, weight * back]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What `roughplastic` of Mitsuba 3.9.1 has, from values of two of its nonlinear BSDFs.
    #[test]
    fn light_inside_a_rough_coat_is_mitsubas() {
        let of_mitsuba = [
            (1.49, 0.05, true, 0.5799),
            (1.49, 0.1, true, 0.5749),
            (1.49, 0.1, false, 0.5458),
            (1.49, 0.3, true, 0.5237),
            (1.49, 0.3, false, 0.4090),
            (1.9, 0.1, true, 0.7476),
            (1.9, 0.6, true, 0.5766),
            (1.9, 0.6, false, 0.3775),
        ];
        for (ior, alpha, is_beckmann, expected) in of_mitsuba {
            let surface = Surface::Plastic { nonlinear: false };
            let roughness = glam::Vec2::splat(alpha);
            let plastic = Material { surface, ior, roughness, is_beckmann, ..Material::diffuse(Vec3::ONE) };
            let inner = inner_reflectance(&plastic);
            assert!((inner - expected).abs() < 1e-3, "{ior}, {alpha}, {is_beckmann}: {inner}, not {expected}");
        }
    }
}
