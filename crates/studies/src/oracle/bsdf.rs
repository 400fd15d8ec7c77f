//! What surfaces do to light, in `f64`: the value of every BSDF, and directions that are drawn in this room's own ways.
//!
//! Directions are in the frame of the surface: z is the normal on the side of `wo`, x goes where texture coordinate u grows.
//! `is_front` says whether that side is the outside.

use std::f64::consts::{FRAC_1_PI, TAU};
use std::sync::Arc;

use glam::{DVec2, DVec3};

use super::microfacets::{ByCosine, Facets, mean_over_cosine, spread_again};
use super::optics::{self, falls_below, metal_reflectance, mirrored, reflectance};
use super::principled;
use raywave::scene::{Material, SMOOTH, Surface};

/// A material and what is integrated of it beforehand.
#[derive(Debug, Clone)]
pub struct Bsdf {
    /// Its parameters.
    pub material: Material,
    integrals: Arc<Integrals>,
}

/// What is integrated of a material.
#[derive(Debug)]
enum Integrals {
    None,
    /// Light that facets of a mirror lose, and the mean reflectance of a metal.
    Metal {
        lost: ByCosine,
        mean_reflectance: DVec3,
    },
    /// Light that facets of an interface lose outside and inside.
    Glass([ByCosine; 2]),
    /// Light that a coat lets in, and the share of diffuse light inside that it sends back.
    Coat {
        through: Option<ByCosine>,
        inner: f64,
    },
}

/// A direction that was drawn.
#[derive(Debug, Clone, Copy)]
pub struct Drawn {
    /// Unit.
    pub wi: DVec3,
    /// f cos over the pdf.
    pub weight: DVec3,
    /// Whether it was the only direction that it could be.
    pub is_specular: bool,
}

/// A way to draw a direction.
#[derive(Debug, Clone, Copy)]
enum Way {
    /// By the cosine above the horizon.
    Above,
    /// By the cosine below it.
    Below,
    /// Mirrored by a facet.
    Mirrored(Facets),
    /// Refracted by a facet into an index over that before.
    Refracted(Facets, f64),
    /// To where a facet's mirror direction would be below.
    Passed(Facets),
}

impl Way {
    fn draw(self, wo: DVec3, u: DVec2) -> Option<DVec3> {
        let cosine = (1.0 - u.x).sqrt();
        let above = (u.x.sqrt() * DVec2::from_angle(TAU * u.y)).extend(cosine);
        let flipped = DVec3::new(1.0, 1.0, -1.0);
        match self {
            Self::Above => Some(above),
            Self::Below => Some(above * flipped),
            // What a facet sends into the surface is lost.
            Self::Mirrored(facets) => Some(mirrored(facets.draw(u), wo)).filter(|wi| wi.z > 0.0),
            Self::Passed(facets) => Some(mirrored(facets.draw(u), wo)).filter(|wi| wi.z > 0.0).map(|wi| wi * flipped),
            Self::Refracted(facets, eta) => {
                let m = facets.draw(u);
                let cosine = wo.dot(m);
                let beyond = optics::refracted_cosine(cosine, eta).filter(|_| cosine > 0.0)?;
                Some(((cosine / eta - beyond) * m - wo / eta).normalize()).filter(|wi| wi.z < 0.0)
            }
        }
    }

    /// Over solid angle.
    fn pdf(self, wo: DVec3, wi: DVec3) -> f64 {
        let by_facet = |facets: Facets, wi: DVec3| {
            let m = (wo + wi).normalize();
            facets.pdf(m) / (4.0 * wo.dot(m))
        };
        match self {
            Self::Above => wi.z.max(0.0) * FRAC_1_PI,
            Self::Below => (-wi.z).max(0.0) * FRAC_1_PI,
            Self::Mirrored(facets) if wi.z > 0.0 => by_facet(facets, wi),
            Self::Passed(facets) if wi.z < 0.0 => by_facet(facets, DVec3::new(wi.x, wi.y, -wi.z)),
            Self::Refracted(facets, eta) if wi.z < 0.0 => {
                let m = Facets::between(wo, wi, eta);
                let (cos_o, cos_i) = (wo.dot(m), wi.dot(m));
                let jacobian = eta * eta * -cos_i / (cos_o + eta * cos_i).powi(2);
                if cos_o > 0.0 && cos_i < 0.0 { facets.pdf(m) * jacobian } else { 0.0 }
            }
            _ => 0.0,
        }
    }
}

impl Bsdf {
    /// Integrates what there is to integrate, some thousand directions of each of some hundred cosines.
    pub fn new(material: &Material) -> Self {
        let eta = f64::from(material.ior);
        let facets = facets(material);
        // Of two widths light that facets lose is that of their geometric mean.
        let round = Facets { alpha: DVec2::splat((facets.alpha.x * facets.alpha.y).sqrt()), ..facets };
        let integrals = match material.surface {
            Surface::Conductor | Surface::MetalRough if material.is_rough() && material.compensates => {
                Integrals::Metal {
                    lost: ByCosine::lost_by_mirrors(round),
                    mean_reflectance: if material.surface == Surface::Conductor {
                        mean_of_metal(material)
                    } else {
                        DVec3::ZERO
                    },
                }
            }
            Surface::Dielectric if material.is_rough() && material.compensates => {
                Integrals::Glass([eta, 1.0 / eta].map(|eta| ByCosine::lost_by_glass(round, eta)))
            }
            Surface::Plastic { .. } if material.is_rough() => Integrals::Coat {
                through: Some(ByCosine::let_through(round, eta)),
                inner: ByCosine::sent_back(round, 1.0 / eta).mean_of_mitsuba(),
            },
            Surface::Plastic { .. } => {
                Integrals::Coat { through: None, inner: mean_over_cosine(|cosine| reflectance(cosine, 1.0 / eta)) }
            }
            _ => Integrals::None,
        };
        Self { material: material.clone(), integrals: Arc::new(integrals) }
    }

    /// Whether `material` may take the place of its own: they have all in common that was integrated.
    pub fn with(&self, material: Material) -> Self {
        Self { material, integrals: self.integrals.clone() }
    }

    /// Whether another roughness would need other integrals.
    pub fn depends_on_roughness(&self) -> bool {
        match &*self.integrals {
            Integrals::None => false,
            Integrals::Coat { through, .. } => through.is_some(),
            Integrals::Metal { .. } | Integrals::Glass(_) => true,
        }
    }

    /// Whether all that it scatters goes into one direction for each other one, or two.
    pub fn is_specular(&self) -> bool {
        match self.material.surface {
            Surface::Mirror | Surface::Refractive | Surface::ThinDielectric | Surface::Nothing => true,
            Surface::Dielectric | Surface::Conductor => !self.material.is_rough(),
            _ => false,
        }
    }

    /// Whether some of it does.
    pub fn has_specular(&self) -> bool {
        self.is_specular() || (matches!(self.material.surface, Surface::Plastic { .. }) && !self.material.is_rough())
    }

    /// Whether light passes it into more than one direction.
    pub fn passes_widely(&self) -> bool {
        let is_sheet = self.material.surface == Surface::PrincipledThin;
        let is_rough_glass = self.material.surface == Surface::Dielectric && self.material.is_rough();
        is_sheet || is_rough_glass || self.material.has_inside()
    }

    /// f cos, but of what is specular.
    pub fn value(&self, wo: DVec3, wi: DVec3, is_front: bool) -> DVec3 {
        let m = &self.material;
        let is_above = wi.z > 0.0;
        match m.surface {
            Surface::Glossy => optics::glossy(m, DVec3::Z, wo, wi),
            Surface::Conductor if m.is_rough() && is_above => self.metal(wo, wi),
            Surface::Dielectric if m.is_rough() => self.rough_glass(wo, wi, is_front),
            Surface::Plastic { nonlinear } if is_above => self.plastic(wo, wi, nonlinear),
            Surface::MetalRough if is_above => self.metal_rough(wo, wi),
            Surface::Principled | Surface::PrincipledThin => principled::value(m, wo, wi, is_front),
            _ => DVec3::ZERO,
        }
    }

    /// Fresnel's reflectance of a metal at the facets, once, and what they lose again.
    fn metal(&self, wo: DVec3, wi: DVec3) -> DVec3 {
        let m = &self.material;
        let cosine = wo.dot((wo + wi).normalize());
        let once = m.specular.as_dvec3() * of_metal(m, cosine) * facets(m).mirrored(wo, wi);
        once + self.lost_by_metal(wo, wi, |mean| m.specular.as_dvec3() * mean)
    }

    /// Light that facets of a mean reflectance lose at first.
    fn lost_by_metal(&self, wo: DVec3, wi: DVec3, reflectance: impl Fn(DVec3) -> DVec3) -> DVec3 {
        let Integrals::Metal { lost, mean_reflectance } = &*self.integrals else { return DVec3::ZERO };
        let (mean, mean_lost) = (reflectance(*mean_reflectance), lost.mean);
        // Each further reflection loses the same share: a geometric series.
        let series = mean * mean * (1.0 - mean_lost) / (1.0 - mean * mean_lost);
        series * spread_again(lost.at(wo.z), lost.at(wi.z), mean_lost, wi.z)
    }

    /// Reflection and refraction at the facets of an interface, and what they lose.
    fn rough_glass(&self, wo: DVec3, wi: DVec3, is_front: bool) -> DVec3 {
        let m = &self.material;
        let index = f64::from(m.ior);
        let eta = if is_front { index } else { 1.0 / index };
        let is_above = wi.z > 0.0;
        // Radiance scales with the square of the index.
        let tint = if is_above { DVec3::ONE } else { m.transmission.as_dvec3() / (eta * eta) };
        let once = if is_above {
            reflectance(wo.dot((wo + wi).normalize()), eta) * facets(m).mirrored(wo, wi)
        } else {
            let passes = 1.0 - reflectance(wo.dot(Facets::between(wo, wi, eta)).max(0.0), eta);
            passes * facets(m).refracted(wo, wi, eta)
        };
        let again = if let Integrals::Glass(lost) = &*self.integrals {
            let (here, beyond) = if is_front { (&lost[0], &lost[1]) } else { (&lost[1], &lost[0]) };
            // Half of it passes, or as much as keeps both directions of a path alike.
            let (mean, other) = (here.mean, beyond.mean);
            let passes = 0.5 * (eta * eta).min(1.0) * other / mean.max(other);
            let (share, side) = if is_above { (1.0 - passes, here) } else { (passes, beyond) };
            share * spread_again(here.at(wo.z), side.at(wi.z), side.mean, wi.z)
        } else {
            0.0
        };
        tint * (once + again)
    }

    /// A diffuse base under an interface, with all reflections between the two, and what the interface reflects.
    fn plastic(&self, wo: DVec3, wi: DVec3, nonlinear: bool) -> DVec3 {
        let m = &self.material;
        let eta = f64::from(m.ior);
        let Integrals::Coat { through, inner } = &*self.integrals else { return DVec3::ZERO };
        let lets_in = |cosine| through.as_ref().map_or_else(|| 1.0 - reflectance(cosine, eta), |t| t.at(cosine));
        let colour = m.diffuse.as_dvec3();
        let series = colour / (1.0 - *inner * if nonlinear { colour } else { DVec3::ONE });
        let base = series * lets_in(wo.z) * lets_in(wi.z) / (eta * eta) * wi.z * FRAC_1_PI;
        let coat = if m.is_rough() {
            m.specular.as_dvec3() * reflectance(wo.dot((wo + wi).normalize()), eta) * facets(m).mirrored(wo, wi)
        } else {
            DVec3::ZERO
        };
        base + coat
    }

    /// A metal and a diffuse body under an interface by shares, perhaps under a clear coat.
    fn metal_rough(&self, wo: DVec3, wi: DVec3) -> DVec3 {
        let m = &self.material;
        let (colour, metal) = (m.diffuse.as_dvec3(), f64::from(m.metalness));
        let dielectric = (m.specular.as_dvec3() * normal_reflectance(f64::from(m.ior))).min(DVec3::ONE);
        let at_normal = dielectric.lerp(colour, metal);
        let cosine = wo.dot((wo + wi).normalize());
        let facets = schlick(at_normal, cosine) * facets(m).mirrored(wo, wi)
            + self.lost_by_metal(wo, wi, |_| at_normal + (1.0 - at_normal) / 21.0);
        // What gets in, by the direction, over its mean: as much gets out. (Ashikhmin and Shirley 2000)
        let gets_in = |cosine| 1.0 - schlick(dielectric, cosine);
        let mean = (1.0 - dielectric) * (20.0 / 21.0);
        let body =
            colour * (1.0 - metal) * gets_in(wo.z) * gets_in(wi.z) / mean.max(DVec3::splat(1e-9)) * wi.z * FRAC_1_PI;
        let coat = |cosine| f64::from(m.coat) * schlick(DVec3::splat(0.04), cosine).x;
        let below = (1.0 - coat(wo.z)) * (1.0 - coat(wi.z));
        below * (facets + body) + coat(cosine) * coat_facets(m).mirrored(wo, wi)
    }

    /// Ways to draw directions that are not specular, each with its share.
    fn ways(&self, wo: DVec3, is_front: bool) -> Vec<(f64, Way)> {
        let m = &self.material;
        let index = f64::from(m.ior);
        let eta = if is_front { index } else { 1.0 / index };
        let facets = facets(m);
        // Facets that lean towards `wo` or away from it reflect less or more than the surface as a whole.
        let bounces = reflectance(wo.z, eta).clamp(0.2, 0.8);
        let glass = |facets| {
            let ways = [Way::Mirrored(facets), Way::Refracted(facets, eta), Way::Above, Way::Below];
            [0.9 * bounces, 0.9 * (1.0 - bounces), 0.1 * bounces, 0.1 * (1.0 - bounces)].into_iter().zip(ways).collect()
        };
        match m.surface {
            Surface::Conductor => vec![(0.8, Way::Mirrored(facets)), (0.2, Way::Above)],
            Surface::Dielectric => glass(facets),
            Surface::Plastic { .. } if m.is_rough() => {
                let coat = bounces.max(0.3);
                vec![(coat, Way::Mirrored(facets)), (1.0 - coat, Way::Above)]
            }
            Surface::MetalRough => {
                let coat = if m.coat > 0.0 { 0.2 } else { 0.0 };
                let body = 0.2 + 0.4 * (1.0 - f64::from(m.metalness));
                let shares = [coat, (1.0 - coat) * body, (1.0 - coat) * (1.0 - body)];
                shares.into_iter().zip([Way::Mirrored(coat_facets(m)), Way::Above, Way::Mirrored(facets)]).collect()
            }
            Surface::Principled => {
                let own = principled::facets(f64::from(m.roughness.x).sqrt(), m.principled.anisotropy.into());
                if m.has_inside() && !is_front {
                    return glass(own);
                }
                let coat = if m.coat > 0.0 { 0.1 } else { 0.0 };
                let passes = if m.has_inside() { 0.5 * f64::from(m.principled.specular_share) } else { 0.0 };
                let ways = [
                    Way::Mirrored(Facets::round(principled::coat_width(m))),
                    Way::Refracted(own, eta),
                    Way::Above,
                    Way::Mirrored(own),
                ];
                let rest = 0.5 * (1.0 - coat - passes);
                [coat, passes, rest, rest].into_iter().zip(ways).collect()
            }
            Surface::PrincipledThin => {
                let own = principled::facets(f64::from(m.roughness.x).sqrt(), m.principled.anisotropy.into());
                let through = principled::facets_through(m);
                let ways = [Way::Mirrored(own), Way::Passed(through), Way::Above, Way::Below];
                ways.map(|way| (0.25, way)).to_vec()
            }
            _ => vec![(1.0, Way::Above)],
        }
    }

    /// Pdf over solid angle with which `draw` draws a direction that is not specular.
    pub fn pdf(&self, wo: DVec3, wi: DVec3, is_front: bool) -> f64 {
        let m = &self.material;
        if m.surface == Surface::Glossy {
            return optics::scatter_density(m, DVec3::Z, wo, wi);
        }
        let widely: f64 = self.ways(wo, is_front).into_iter().map(|(share, way)| share * way.pdf(wo, wi)).sum();
        let specular = if self.is_specular() { 1.0 } else { self.coat_probability(wo) };
        (1.0 - specular) * widely
    }

    /// Probability of drawing what a smooth coat reflects.
    fn coat_probability(&self, wo: DVec3) -> f64 {
        if !self.has_specular() {
            return 0.0;
        }
        reflectance(wo.z, f64::from(self.material.ior)).clamp(0.2, 0.8)
    }

    /// Draws a direction, or none.
    pub fn draw(&self, wo: DVec3, is_front: bool, choice: f64, u: DVec2) -> Option<Drawn> {
        let m = &self.material;
        let mirror = DVec3::new(-wo.x, -wo.y, wo.z);
        let specular = |wi, weight| Some(Drawn { wi, weight, is_specular: true });
        match m.surface {
            Surface::Nothing => return specular(-wo, DVec3::ONE),
            Surface::Conductor if !m.is_rough() => return specular(mirror, m.specular.as_dvec3() * of_metal(m, wo.z)),
            Surface::ThinDielectric => {
                // All that is reflected inside too, a geometric series.
                let once = reflectance(wo.z, f64::from(m.ior));
                let reflected = once + (1.0 - once) * once / (1.0 + once);
                let reflects = choice < reflected;
                return if reflects { specular(mirror, DVec3::ONE) } else { specular(-wo, m.transmission.as_dvec3()) };
            }
            _ => {}
        }
        let coat = self.coat_probability(wo);
        let (by_coat, mut choice) = falls_below(choice, coat);
        if by_coat {
            let reflected = m.specular.as_dvec3() * reflectance(wo.z, f64::from(m.ior));
            return specular(mirror, reflected / coat);
        }
        for (share, way) in self.ways(wo, is_front) {
            if choice < share {
                let wi = way.draw(wo, u)?;
                let pdf = self.pdf(wo, wi, is_front);
                let value = self.value(wo, wi, is_front);
                return (pdf > 0.0).then(|| Drawn { wi, weight: value / pdf, is_specular: false });
            }
            choice -= share;
        }
        None
    }
}

/// The facets of a surface, never smoother than kernels tell from smooth.
fn facets(m: &Material) -> Facets {
    Facets { alpha: m.roughness.as_dvec2().max(DVec2::splat(SMOOTH.into())), is_beckmann: m.is_beckmann }
}

/// The facets of a clear coat.
fn coat_facets(m: &Material) -> Facets {
    Facets { alpha: DVec2::splat(m.coat_roughness.max(SMOOTH).into()), is_beckmann: m.is_beckmann }
}

fn of_metal(m: &Material, cosine: f64) -> DVec3 {
    let (eta, k) = (m.eta.as_dvec3().to_array(), m.absorption.as_dvec3().to_array());
    DVec3::from([0, 1, 2].map(|i| metal_reflectance(cosine, eta[i], k[i])))
}

fn mean_of_metal(m: &Material) -> DVec3 {
    let (eta, k) = (m.eta.as_dvec3().to_array(), m.absorption.as_dvec3().to_array());
    DVec3::from([0, 1, 2].map(|i| mean_over_cosine(|cosine| metal_reflectance(cosine, eta[i], k[i]))))
}

/// Reflectance at normal incidence.
fn normal_reflectance(eta: f64) -> f64 {
    ((eta - 1.0) / (eta + 1.0)).powi(2)
}

/// An approximation by the reflectance at normal incidence. (Schlick 1994)
fn schlick(at_normal: DVec3, cosine: f64) -> DVec3 {
    at_normal + (1.0 - at_normal) * (1.0 - cosine).powi(5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use raywave::scene::Principled;

    fn kinds() -> Vec<Material> {
        let colour = Vec3::new(0.9, 0.5, 0.1);
        let metal = Material::conductor(Vec3::new(0.2, 0.9, 1.1), Vec3::new(3.9, 2.5, 2.1), 0.4);
        let sheet =
            Principled { specular_share: 0.6, flatness: 0.5, diffuse_transmission: 0.4, ..Principled::default() };
        let mixture = Material::metal_rough(colour, 0.4, 0.5);
        vec![
            Material { is_beckmann: true, compensates: false, ..metal.clone() },
            metal.clone().rough(0.6, 0.2),
            metal,
            Material::dielectric(1.5).rough(0.3, 0.3),
            Material::dielectric(1.8).rough(0.7, 0.7),
            Material { is_beckmann: true, compensates: false, ..Material::dielectric(0.8).rough(0.4, 0.4) },
            Material::plastic(colour, 1.5, 0.3),
            Material { surface: Surface::Plastic { nonlinear: true }, ..Material::plastic(colour, 1.5, 0.6) },
            Material { coat: 0.8, coat_roughness: 0.3, ..mixture.clone() },
            mixture,
            Material {
                coat: 0.5,
                coat_roughness: 0.3,
                ..Material::principled(colour, 1.5, 0.3, Principled { sheen: 0.5, ..Principled::default() })
            },
            Material::principled(colour, 1.5, 0.3, sheet),
            Material::principled_thin(colour, 1.5, 0.3, sheet),
        ]
    }

    /// Mean of f cos over pdf over drawn directions, and of anything of the direction.
    fn mean_of_drawn(bsdf: &Bsdf, wo: DVec3, is_front: bool, of: impl Fn(&Drawn) -> DVec3) -> DVec3 {
        const DRAWN: u32 = 1 << 17;
        let step = DVec3::new(0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3);
        let points = (0..DRAWN).map(|i| (f64::from(i) * step + 0.5).fract());
        let drawn = points.filter_map(|u| bsdf.draw(wo, is_front, u.x, DVec2::new(u.y, u.z)));
        drawn.map(|drawn| of(&drawn)).sum::<DVec3>() / f64::from(DRAWN)
    }

    #[test]
    fn directions_that_are_drawn_are_worth_the_integral() {
        for material in kinds() {
            let bsdf = Bsdf::new(&material);
            for (cosine, is_front) in [(0.9_f64, true), (0.4, true), (0.6, false)] {
                let wo = DVec3::new(0.8, 0.6, 0.0) * (1.0 - cosine * cosine).sqrt() + cosine * DVec3::Z;
                let (rings, turns) = (500, 500);
                let mut integral = [DVec3::ZERO; 2];
                for place in 0..rings * turns {
                    let z = 2.0 * (f64::from(place / turns) + 0.5) / f64::from(rings) - 1.0;
                    let turn = DVec2::from_angle(TAU * (f64::from(place % turns) + 0.5) / f64::from(turns));
                    let wi = (turn * (1.0 - z * z).sqrt()).extend(z);
                    let value = bsdf.value(wo, wi, is_front) * 2.0 * TAU / f64::from(rings * turns);
                    integral[usize::from(z < 0.0)] += value;
                }
                for (below, integral) in integral.into_iter().enumerate() {
                    let is_there = |drawn: &Drawn| usize::from(drawn.wi.z < 0.0) == below;
                    let of = |drawn: &Drawn| if is_there(drawn) { drawn.weight } else { DVec3::ZERO };
                    let mean = mean_of_drawn(&bsdf, wo, is_front, of);
                    let off = (mean - integral).abs().max_element();
                    assert!(
                        off < 8e-3,
                        "{mean} drawn of {integral}, below {below}, of {material:?} at {cosine} {is_front}"
                    );
                }
            }
        }
    }

    #[test]
    fn what_makes_up_for_lost_light_loses_none() {
        let metal = |alpha| Material::conductor(Vec3::ZERO, Vec3::ONE, alpha);
        let glass = |ior, alpha| Material::dielectric(ior).rough(alpha, alpha);
        for material in [metal(0.2), metal(1.0), glass(1.5, 0.5), glass(1.8, 0.7), glass(0.8, 0.3)] {
            let bsdf = Bsdf::new(&material);
            for (cosine, is_front) in [(0.9_f64, true), (0.3, true), (0.6, false)] {
                let wo = DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
                let index = if is_front { f64::from(material.ior) } else { 1.0 / f64::from(material.ior) };
                // Power, not radiance.
                let of = |drawn: &Drawn| drawn.weight * if drawn.wi.z < 0.0 { index * index } else { 1.0 };
                let mean = mean_of_drawn(&bsdf, wo, is_front, of).x;
                assert!((mean - 1.0).abs() < 8e-3, "{mean} of {material:?} at {cosine} {is_front}");
            }
        }
    }
}
