//! A path tracer on the CPU, in f64: the oracle of ray counts and of single paths.
//!
//! It is written from the textbook and shares no code with the shaders or with `src/bvh`: every ray is tested against
//! every triangle, in world space. It draws the same random numbers as the kernels and uses them for the same decisions
//! in the same order, so each of its paths is one of theirs except for rounding. It knows flat triangles of every
//! material without an environment; no textures, no vertex normals.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::optics;
use super::sobol::sobol4;
use raywave::scene::{Environment, Material, NONE, Scene, Surface};
use raywave::settings::{Integrator, RouletteMode, Sampler, Settings};

/// A scene as the path tracer sees it.
pub struct Reference<'a> {
    scene: &'a Scene,
    settings: Settings,
    facets: Vec<Facet>,
    lamps: Vec<Lamp>,
    /// Pdf of a light sample over the area of an emissive triangle, by facet.
    lamp_densities: Vec<f64>,
    /// Surfaces nearer than this to a ray's origin are the one that it leaves, or lie in its plane.
    nearest: f64,
}

/// One sample of a pixel.
#[derive(Debug, Default)]
pub struct Path {
    /// Radiance that arrives at the pixel.
    pub radiance: DVec3,
    /// One entry a ray, from the camera on: whether a shadow ray was cast from its hit.
    pub casts_shadow_ray: Vec<bool>,
}

struct Facet {
    corner: DVec3,
    edges: [DVec3; 2],
    /// Unit, out of the front side.
    normal: DVec3,
    material: usize,
}

/// A cell of the alias table over the emissive triangles.
struct Lamp {
    facet: usize,
    /// Probability that the cell stands for itself, not for its alias.
    threshold: f64,
    alias: usize,
}

struct Ray {
    origin: DVec3,
    /// Unit.
    direction: DVec3,
    /// The facet that it starts on.
    leaves: Option<usize>,
}

/// Where a ray ends.
struct Vertex<'a> {
    position: DVec3,
    facet: usize,
    material: &'a Material,
    /// Back along the path.
    wo: DVec3,
    /// Unit, towards `wo`.
    normal: DVec3,
    is_front: bool,
}

/// A sampled point on a light, as a vertex sees it.
struct LampSample {
    facet: usize,
    direction: DVec3,
    distance: f64,
    /// Divided by its pdf.
    radiance: DVec3,
    /// Over solid angle.
    density: f64,
}

impl<'a> Reference<'a> {
    /// A scene without environment, textures and vertex normals.
    ///
    /// # Panics
    /// When the scene has something that it does not support.
    pub fn new(scene: &'a Scene, settings: &Settings) -> Self {
        assert!(matches!(scene.environment, Environment::Black), "the reference knows black skies alone");
        assert!(
            scene.materials.iter().all(|m| m.textures.iter().all(Option::is_none)),
            "the reference knows no textures"
        );
        assert!(scene.lights.is_empty(), "the reference knows no lights but surfaces");
        let is_known = |m: &Material| {
            let known = [Surface::Glossy, Surface::Mirror, Surface::Refractive, Surface::Dielectric];
            m.is_pure_emitter && !m.is_rough() && known.contains(&m.surface)
        };
        assert!(scene.materials.iter().all(is_known), "the reference knows no microfacets, coats and blends");
        let mesh = &*scene.flattened();
        let facets: Vec<Facet> = mesh
            .triangles
            .iter()
            .map(|triangle| {
                assert!(triangle.normals[0] == NONE, "the reference knows no vertex normals");
                let [a, b, c] = triangle.positions.map(|i| mesh.positions[i as usize]);
                let edges = [b - a, c - a];
                let normal = edges[0].cross(edges[1]).normalize();
                Facet { corner: a, edges, normal, material: triangle.material as usize }
            })
            .collect();
        let emitters: Vec<usize> =
            (0..facets.len()).filter(|&i| scene.materials[facets[i].material].is_emitter()).collect();
        let areas: Vec<f64> =
            emitters.iter().map(|&i| 0.5 * facets[i].edges[0].cross(facets[i].edges[1]).length()).collect();
        let brightness = |i: &usize| {
            let ke = scene.materials[facets[*i].material].emission.as_dvec3();
            ke.dot(DVec3::new(0.2126, 0.7152, 0.0722)) + 1e-3 * ke.element_sum()
        };
        let brightnesses: Vec<f64> = emitters.iter().map(brightness).collect();
        // Nine of ten samples choose by power, the others by area.
        let area: f64 = areas.iter().sum();
        let power: f64 = areas.iter().zip(&brightnesses).map(|(a, b)| a * b).sum();
        let densities: Vec<f64> = brightnesses.iter().map(|b| 0.9 * b / power + 0.1 / area).collect();
        let weights: Vec<f64> = areas.iter().zip(&densities).map(|(a, d)| a * d).collect();
        let mut lamp_densities = vec![0.0; facets.len()];
        for (&facet, density) in emitters.iter().zip(&densities) {
            lamp_densities[facet] = *density;
        }
        let cells = alias_table(&weights);
        let lamps = emitters
            .iter()
            .zip(cells)
            .map(|(&facet, (threshold, alias))| Lamp { facet, threshold, alias: emitters[alias] })
            .collect();
        let (low, high) = scene.bounds();
        let nearest = 1e-9 * (high - low).max_element();
        Self { scene, settings: *settings, facets, lamps, lamp_densities, nearest }
    }

    /// Follows one sample of a pixel, which counts in rows from the top left.
    pub fn path(&self, pixel: u32, sample: u32) -> Path {
        let Settings { integrator, max_bounces, roulette, roulette_mode, roulette_from, sampler, seed, .. } =
            self.settings;
        let explicit = integrator == Integrator::Explicit;
        let mis = integrator == Integrator::Mis;
        let by_throughput = roulette_mode == RouletteMode::Throughput;
        // Camera, light and scattering of each bounce have four numbers each.
        let random = |block| match sampler {
            Sampler::Independent => random4([pixel, sample, block, seed]),
            Sampler::Sobol => sobol4([pixel, sample, block, seed]),
        };
        let mut path = Path::default();
        let mut ray = self.camera_ray(pixel, random(0));
        let mut throughput = DVec3::ONE;
        let mut sees_emission = true;
        // Pdf of the ray's direction, if another was possible.
        let mut density = None;
        for bounce in 0_u32.. {
            path.casts_shadow_ray.push(false);
            let Some(vertex) = self.trace(&ray) else { break };
            if vertex.material.is_emitter() {
                if sees_emission && vertex.is_front {
                    let weight = match density {
                        Some(own) if mis => {
                            let distance2 = vertex.position.distance_squared(ray.origin);
                            let of_lamps = self.lamp_densities[vertex.facet] * distance2 / vertex.normal.dot(vertex.wo);
                            power_heuristic(own, of_lamps)
                        }
                        _ => 1.0,
                    };
                    path.radiance += self.clamped(throughput * vertex.material.emission.as_dvec3() * weight, bounce);
                }
                break;
            }
            if max_bounces == Some(bounce) {
                break;
            }
            let specular = optics::is_specular(vertex.material);
            if (explicit || mis) && !specular {
                if let Some(sample) = self.sample_lamps(&vertex, random(1 + 2 * bounce)) {
                    let (value, scattered) =
                        optics::evaluate(vertex.material, vertex.normal, vertex.wo, sample.direction);
                    let above = if value == DVec3::ZERO { 0.0 } else { scattered };
                    let weight = if mis { power_heuristic(sample.density, above) } else { 1.0 };
                    let radiance = self.clamped(throughput * value * sample.radiance * weight, bounce + 1);
                    // A shadow ray that carries no light is not traced.
                    if radiance != DVec3::ZERO {
                        path.casts_shadow_ray[bounce as usize] = true;
                        if !self.is_blocked(&vertex, &sample) {
                            path.radiance += radiance;
                        }
                    }
                }
                // Without MIS weights another bounce could find only light that was sampled already.
                if explicit && max_bounces == Some(bounce + 1) {
                    break;
                }
            }
            let [stop, choice, u, v] = random(2 + 2 * bounce);
            if !by_throughput && stop < roulette {
                break;
            }
            let Vertex { material, normal, wo, is_front, .. } = vertex;
            let (direction, weight) = optics::scatter(material, normal, wo, is_front, choice, DVec2::new(u, v));
            throughput *= weight;
            if !by_throughput {
                throughput /= 1.0 - roulette;
            } else if bounce >= roulette_from {
                // In glass radiance is scaled by 1 / Ni², and will be scaled back.
                let into_glass = material.surface.refracts() && self.facets[vertex.facet].normal.dot(direction) < 0.0;
                let scale = if into_glass { f64::from(vertex.material.ior).powi(2) } else { 1.0 };
                let survival = (throughput.max_element() * scale).min(1.0 - roulette);
                if stop >= survival {
                    break;
                }
                throughput /= survival;
            }
            if throughput.max_element() <= 0.0 {
                break;
            }
            ray = Ray { origin: vertex.position, direction, leaves: Some(vertex.facet) };
            sees_emission = !explicit || specular;
            density = (!specular).then(|| optics::evaluate(material, normal, wo, direction).1);
        }
        path
    }

    /// Through a uniform point of the pixel and of the lens.
    fn camera_ray(&self, pixel: u32, [x, y, lens_u, lens_v]: [f64; 4]) -> Ray {
        let (camera, width, height) = (&self.scene.camera, self.settings.width, self.settings.height);
        let forward = (camera.target - camera.eye).normalize();
        let right = forward.cross(camera.up).normalize();
        let up = right.cross(forward);
        let half_height = (0.5 * camera.vfov.to_radians()).tan();
        let half_width = half_height * f64::from(width) / f64::from(height);
        let across = 2.0 * (f64::from(pixel % width) + x) / f64::from(width) - 1.0;
        let upwards = 1.0 - 2.0 * (f64::from(pixel / width) + y) / f64::from(height);
        let direction = forward + across * half_width * right + upwards * half_height * up;
        // All rays to a point in focus meet there, wherever they cross the lens.
        let lens = camera.aperture * lens_u.sqrt() * DVec2::from_angle(TAU * lens_v);
        let shift = lens.x * right + lens.y * up;
        let direction = (camera.focus * direction - shift).normalize();
        Ray { origin: camera.eye + shift, direction, leaves: None }
    }

    /// The nearest surface; of equal distances, the one that the scene lists first.
    fn trace(&self, ray: &Ray) -> Option<Vertex<'_>> {
        let hits = self.facets.iter().enumerate().filter(|(i, _)| ray.leaves != Some(*i)).filter_map(|(i, facet)| {
            let distance = facet.distance(ray)?;
            let nearest = if ray.leaves.is_some() { self.nearest } else { 0.0 };
            (distance > nearest).then_some((i, distance))
        });
        let (facet, distance) = hits.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let Facet { normal, material, .. } = self.facets[facet];
        let wo = -ray.direction;
        let is_front = normal.dot(wo) > 0.0;
        Some(Vertex {
            position: ray.origin + distance * ray.direction,
            facet,
            material: &self.scene.materials[material],
            wo,
            normal: if is_front { normal } else { -normal },
            is_front,
        })
    }

    fn is_blocked(&self, from: &Vertex<'_>, to: &LampSample) -> bool {
        let ray = Ray { origin: from.position, direction: to.direction, leaves: Some(from.facet) };
        let between = self.nearest..to.distance - self.nearest;
        self.facets.iter().enumerate().any(|(i, facet)| {
            let is_other = i != from.facet && i != to.facet;
            is_other && facet.distance(&ray).is_some_and(|distance| between.contains(&distance))
        })
    }

    /// A point uniform over an emissive triangle that is chosen mostly by power, unless it faces away. The number that
    /// chose the triangle is remapped and gives the point, except for the last of its 24 bits.
    fn sample_lamps(&self, from: &Vertex<'_>, [pick, v, digits, _]: [f64; 4]) -> Option<LampSample> {
        let place = pick * self.lamps.len() as f64;
        let cell = self.lamps.get(place as usize)?;
        let left = (place.fract() + digits * self.lamps.len() as f64 * 2.0_f64.powi(-24)).min(1.0);
        let (own, u) = optics::falls_below(left, cell.threshold);
        let index = if own { cell.facet } else { cell.alias };
        let Facet { corner, edges: [second, third], normal, material } = self.facets[index];
        let s = u.sqrt();
        let point = corner + s * (1.0 - v) * second + s * v * third;
        let distance = point.distance(from.position);
        let direction = (point - from.position) / distance;
        let cosine = -normal.dot(direction);
        let ke = self.scene.materials[material].emission.as_dvec3();
        // From the area measure to solid angle.
        let density = self.lamp_densities[index] * distance * distance / cosine;
        (cosine > 0.0).then_some(LampSample { facet: index, direction, distance, radiance: ke / density, density })
    }

    /// Light after that many bounces, clamped if it is indirect.
    fn clamped(&self, light: DVec3, bounces: u32) -> DVec3 {
        match self.settings.clamp {
            Some(clamp) if bounces > 1 => light * (clamp / light.max_element()).min(1.0),
            _ => light,
        }
    }
}

impl Facet {
    /// Distance to the intersection. (Möller and Trumbore 1997)
    fn distance(&self, ray: &Ray) -> Option<f64> {
        let [e1, e2] = self.edges;
        let p = ray.direction.cross(e2);
        let inverse = 1.0 / e1.dot(p);
        let to_origin = ray.origin - self.corner;
        let q = to_origin.cross(e1);
        let (u, v) = (to_origin.dot(p) * inverse, ray.direction.dot(q) * inverse);
        // A ray in the plane has no inverse, and NaN is never inside.
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| e2.dot(q) * inverse)
    }
}

/// Power heuristic: MIS weight of a sample with pdf `own` against the other strategy's. (Veach 1997, section 9.2)
fn power_heuristic(own: f64, other: f64) -> f64 {
    own * own / (own * own + other * other)
}

/// Four numbers in [0, 1), multiples of 2^-24, of pixel, sample, block and seed.
fn random4(key: [u32; 4]) -> [f64; 4] {
    pcg4d(key).map(|bits| f64::from(bits >> 8) * (-24_f64).exp2())
}

/// The hash of four words. (Jarzynski and Olano 2020, Hash Functions for GPU Rendering)
pub fn pcg4d(mut v: [u32; 4]) -> [u32; 4] {
    let mix = |v: &mut [u32; 4]| {
        for (to, a, b) in [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)] {
            v[to] = v[to].wrapping_add(v[a].wrapping_mul(v[b]));
        }
    };
    v = v.map(|x| x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    mix(&mut v);
    v = v.map(|x| x ^ x >> 16);
    mix(&mut v);
    v
}

/// Threshold and alias of each weight. (Vose 1991) Many tables represent the same weights: this one fills the last poor
/// cell from the last rich one.
fn alias_table(weights: &[f64]) -> Vec<(f64, usize)> {
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    let mut left: Vec<f64> = weights.iter().map(|weight| weight / mean).collect();
    let mut cells: Vec<_> = (0..weights.len()).map(|i| (1.0, i)).collect();
    let (mut rich, mut poor): (Vec<_>, Vec<_>) = (0..weights.len()).partition(|&i| left[i] >= 1.0);
    while !rich.is_empty() && !poor.is_empty() {
        let (from, to) = (rich[rich.len() - 1], poor.remove(poor.len() - 1));
        cells[to] = (left[to], from);
        left[from] -= 1.0 - left[to];
        if left[from] < 1.0 {
            poor.push(from);
            rich.retain(|&i| i != from);
        }
    }
    cells
}
