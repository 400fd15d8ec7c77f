//! A path tracer on the CPU, in f64: the oracle of ray counts and of single paths.
//!
//! It is written from the textbook and shares no code with the shaders or with `src/bvh`: every ray is tested against
//! every triangle, in world space. It knows flat triangles of every material, images of their parameters, lights of all
//! kinds, and a sky that is the same everywhere; what it does not know is [`Unsupported`].
//!
//! Of surfaces that MTL describes (diffuse, Phong, mirrors, smooth glass) under area lights it draws the same random numbers
//! as the kernels and uses them for the same decisions in the same order, so each of its paths is one of theirs except for
//! rounding. Of all else its paths are its own: directions are drawn in other ways (`bsdf`), every punctual light and the sky
//! are sampled at each vertex, and only the expectation is that of the kernels.

use std::borrow::Cow;
use std::f64::consts::{FRAC_1_PI, TAU};

use glam::{DVec2, DVec3};

use super::bsdf::{Bsdf, Drawn};
use super::optics;
use super::sobol::sobol4;
use super::texture;
use raywave::scene::{Environment, Falloff, Light, NONE, Parameter, Scene, Surface};
use raywave::settings::{Integrator, RouletteMode, Sampler, Settings};

/// A scene as the path tracer sees it.
pub struct Reference<'a> {
    scene: &'a Scene,
    settings: Settings,
    facets: Vec<Facet>,
    /// By material.
    bsdfs: Vec<Bsdf>,
    /// Of the whole sky.
    sky: DVec3,
    lamps: Vec<Lamp>,
    /// Pdf of a light sample over the area of an emissive triangle, by facet.
    lamp_densities: Vec<f64>,
    /// Surfaces nearer than this to a ray's origin are the one that it leaves, or lie in its plane.
    nearest: f64,
}

/// What a scene has that the path tracer does not know.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the reference path tracer knows no {0}")]
pub struct Unsupported(&'static str);

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
    /// Unit, where texture coordinate u grows; zero where there is none.
    along_u: DVec3,
    uvs: [DVec2; 3],
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
struct Vertex {
    position: DVec3,
    facet: usize,
    /// Of the facet.
    material: usize,
    uv: DVec2,
    /// Back along the path.
    wo: DVec3,
    /// Unit, the last of them the normal towards `wo`.
    axes: [DVec3; 3],
    is_front: bool,
}

impl Vertex {
    fn normal(&self) -> DVec3 {
        self.axes[2]
    }

    fn to_local(&self, v: DVec3) -> DVec3 {
        DVec3::from(self.axes.map(|axis| axis.dot(v)))
    }

    fn to_world(&self, v: DVec3) -> DVec3 {
        v.x * self.axes[0] + v.y * self.axes[1] + v.z * self.axes[2]
    }
}

/// The ways in which the last vertex could have found the light that its ray finds.
#[derive(Clone, Copy)]
struct Strategies {
    /// Pdf of the ray's direction by the BSDF.
    own: f64,
    /// The same by a sample of the sky.
    of_sky: f64,
}

/// A sampled point of a light, as a vertex sees it.
struct LightSample {
    /// That emits.
    facet: Option<usize>,
    direction: DVec3,
    /// Infinite of what is far away.
    distance: f64,
    /// Divided by its pdf.
    radiance: DVec3,
    /// Over solid angle; none of light that no other strategy finds.
    density: Option<f64>,
}

/// Random numbers of the light samples of a vertex.
struct LightNumbers {
    of_lamps: [f64; 4],
    of_sky: [f64; 4],
}

/// Blocks of random numbers that the kernels do not use, for the sky.
const SKY_BLOCKS: u32 = 1 << 16;

impl<'a> Reference<'a> {
    /// A scene, and how to follow paths in it.
    ///
    /// # Errors
    /// What the scene has that there is no code for.
    pub fn new(scene: &'a Scene, settings: &Settings) -> Result<Self, Unsupported> {
        let sky = match scene.environment {
            Environment::Black => DVec3::ZERO,
            Environment::Constant(radiance) => radiance.as_dvec3(),
            Environment::LatLong(_) => return Err(Unsupported("images of skies")),
        };
        let shown = scene.shown_materials();
        let bsdfs: Vec<Bsdf> = scene.materials.iter().map(Bsdf::new).collect();
        for (bsdf, _) in bsdfs.iter().zip(&shown).filter(|(_, shown)| **shown) {
            let has = |parameter| bsdf.material.texture(parameter).is_some();
            if has(Parameter::Normal) || has(Parameter::Height) {
                return Err(Unsupported("images of normals and heights"));
            }
            if has(Parameter::Emission) {
                return Err(Unsupported("images of emission"));
            }
            if (has(Parameter::Roughness) || has(Parameter::RoughnessAcross)) && bsdf.depends_on_roughness() {
                return Err(Unsupported("images of the roughness of coats, or of what makes up for lost light"));
            }
        }
        if scene.camera.orthographic.is_some() && scene.camera.aperture > 0.0 {
            return Err(Unsupported("orthographic camera with a lens"));
        }
        if scene.meshes().any(|mesh| !mesh.colours.is_empty()) {
            return Err(Unsupported("colours of vertices"));
        }
        let mesh = &*scene.flattened();
        if mesh.triangles.iter().any(|triangle| triangle.normals[0] != NONE) {
            return Err(Unsupported("vertex normals"));
        }
        let facets: Vec<Facet> = mesh
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.positions.map(|i| mesh.positions[i as usize]);
                let edges = [b - a, c - a];
                let normal = edges[0].cross(edges[1]).normalize();
                let uvs = triangle.uvs.map(|i| mesh.uvs.get(i as usize).map_or(DVec2::ZERO, |uv| uv.as_dvec2()));
                let along_u = texture::growth(edges, [uvs[1] - uvs[0], uvs[2] - uvs[0]]);
                Facet { corner: a, edges, normal, along_u, uvs, material: triangle.material as usize }
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
        Ok(Self { scene, settings: *settings, facets, bsdfs, sky, lamps, lamp_densities, nearest })
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
        // Those of the ray's direction, if another was possible.
        let mut strategies: Option<Strategies> = None;
        for bounce in 0_u32.. {
            path.casts_shadow_ray.push(false);
            let Some(vertex) = self.trace(&ray) else {
                if sees_emission {
                    let weight = strategies.filter(|_| mis).map_or(1.0, |s| power_heuristic(s.own, s.of_sky));
                    path.radiance += self.clamped(throughput * self.sky * weight, bounce);
                }
                break;
            };
            let whole = &self.scene.materials[vertex.material];
            if whole.is_emitter() && sees_emission && vertex.is_front {
                let weight = match strategies {
                    Some(Strategies { own, .. }) if mis => {
                        let distance2 = vertex.position.distance_squared(ray.origin);
                        let of_lamps = self.lamp_densities[vertex.facet] * distance2 / vertex.normal().dot(vertex.wo);
                        power_heuristic(own, of_lamps)
                    }
                    _ => 1.0,
                };
                path.radiance += self.clamped(throughput * whole.emission.as_dvec3() * weight, bounce);
            }
            if whole.only_emits() || max_bounces == Some(bounce) {
                break;
            }
            let [stop, choice, u, v] = random(2 + 2 * bounce);
            let (bsdf, choice) = self.bsdf_at(&vertex, choice);
            let wo = vertex.to_local(vertex.wo);
            if (explicit || mis) && !bsdf.is_specular() {
                let light = LightNumbers { of_lamps: random(1 + 2 * bounce), of_sky: random(SKY_BLOCKS + bounce) };
                for sample in self.sample_lights(&vertex, &bsdf, light) {
                    let wi = vertex.to_local(sample.direction);
                    let value = bsdf.value(wo, wi, vertex.is_front);
                    let scattered = if value == DVec3::ZERO { 0.0 } else { bsdf.pdf(wo, wi, vertex.is_front) };
                    let weight =
                        sample.density.filter(|_| mis).map_or(1.0, |density| power_heuristic(density, scattered));
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
                if explicit && !bsdf.has_specular() && max_bounces == Some(bounce + 1) {
                    break;
                }
            }
            if !by_throughput && stop < roulette {
                break;
            }
            let Some(drawn) = self.draw(&vertex, &bsdf, choice, DVec2::new(u, v)) else { break };
            throughput *= drawn.weight;
            if !by_throughput {
                throughput /= 1.0 - roulette;
            } else if bounce >= roulette_from {
                // In glass radiance is scaled by 1 / Ni², and will be scaled back.
                let has_inside = bsdf.material.surface.refracts() || bsdf.material.has_inside();
                let into_glass = has_inside && self.facets[vertex.facet].normal.dot(drawn.wi) < 0.0;
                let scale = if into_glass { f64::from(bsdf.material.ior).powi(2) } else { 1.0 };
                let survival = (throughput.max_element() * scale).min(1.0 - roulette);
                if stop >= survival {
                    break;
                }
                throughput /= survival;
            }
            if throughput.max_element() <= 0.0 {
                break;
            }
            ray = Ray { origin: vertex.position, direction: drawn.wi, leaves: Some(vertex.facet) };
            sees_emission = !explicit || drawn.is_specular;
            strategies = (!drawn.is_specular).then(|| {
                let wi = vertex.to_local(drawn.wi);
                Strategies { own: bsdf.pdf(wo, wi, vertex.is_front), of_sky: sky_density(&bsdf, wi) }
            });
        }
        path
    }

    /// The BSDF that light meets at a vertex: that of a side or a part of a blend, with its images looked up, and the number
    /// that chose, uniform again.
    fn bsdf_at(&self, vertex: &Vertex, mut choice: f64) -> (Cow<'_, Bsdf>, f64) {
        let mut index = vertex.material;
        loop {
            let material = &self.scene.materials[index];
            index = match material.surface {
                Surface::Sides { front, back } => (if vertex.is_front { front } else { back }) as usize,
                Surface::Blend(first, second) => {
                    let weight = texture::looked_up(self.scene, material, vertex.uv).weight;
                    let (is_first, left) = optics::falls_below(choice, weight.into());
                    choice = left;
                    (if is_first { first } else { second }) as usize
                }
                _ => break,
            };
        }
        let bsdf = &self.bsdfs[index];
        let bsdf = if bsdf.material.textures.iter().any(Option::is_some) {
            Cow::Owned(bsdf.with(texture::looked_up(self.scene, &bsdf.material, vertex.uv)))
        } else {
            Cow::Borrowed(bsdf)
        };
        (bsdf, choice)
    }

    /// A direction of the world.
    fn draw(&self, vertex: &Vertex, bsdf: &Bsdf, choice: f64, u: DVec2) -> Option<Drawn> {
        let m = &bsdf.material;
        let by_mtl = match m.surface {
            Surface::Glossy | Surface::Mirror | Surface::Refractive => true,
            Surface::Dielectric => !m.is_rough(),
            _ => false,
        };
        if by_mtl {
            let (wi, weight) = optics::scatter(m, vertex.normal(), vertex.wo, vertex.is_front, choice, u);
            return Some(Drawn { wi, weight, is_specular: bsdf.is_specular() });
        }
        let drawn = bsdf.draw(vertex.to_local(vertex.wo), vertex.is_front, choice, u)?;
        Some(Drawn { wi: vertex.to_world(drawn.wi), ..drawn })
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
        if let Some(size) = camera.orthographic {
            let half = 0.5 * size * DVec2::new(f64::from(width) / f64::from(height), 1.0);
            let origin = camera.eye + across * half.x * right + upwards * half.y * up;
            return Ray { origin, direction: forward, leaves: None };
        }
        // All rays to a point in focus meet there, wherever they cross the lens.
        let lens = camera.aperture * lens_u.sqrt() * DVec2::from_angle(TAU * lens_v);
        let shift = lens.x * right + lens.y * up;
        let direction = (camera.focus * direction - shift).normalize();
        Ray { origin: camera.eye + shift, direction, leaves: None }
    }

    /// The nearest surface; of equal distances, the one that the scene lists first.
    fn trace(&self, ray: &Ray) -> Option<Vertex> {
        let hits = self.facets.iter().enumerate().filter(|(i, _)| ray.leaves != Some(*i)).filter_map(|(i, facet)| {
            let distance = facet.distance(ray)?;
            let nearest = if ray.leaves.is_some() { self.nearest } else { 0.0 };
            (distance > nearest).then_some((i, distance))
        });
        let (facet, distance) = hits.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let Facet { corner, edges, normal, along_u, uvs, material } = self.facets[facet];
        let wo = -ray.direction;
        let position = ray.origin + distance * ray.direction;
        let is_front = normal.dot(wo) > 0.0;
        let towards = if is_front { normal } else { -normal };
        let axes = if along_u == DVec3::ZERO {
            let (x, y) = optics::basis(towards);
            [x, y, towards]
        } else {
            [along_u, towards.cross(along_u), towards]
        };
        // Barycentrics by areas.
        let (area, from) = (edges[0].cross(edges[1]), position - corner);
        let (s, t) = (from.cross(edges[1]).dot(area), edges[0].cross(from).dot(area));
        let (s, t) = (s / area.length_squared(), t / area.length_squared());
        let uv = (1.0 - s - t) * uvs[0] + s * uvs[1] + t * uvs[2];
        Some(Vertex { position, facet, material, uv, wo, axes, is_front })
    }

    fn is_blocked(&self, from: &Vertex, to: &LightSample) -> bool {
        let ray = Ray { origin: from.position, direction: to.direction, leaves: Some(from.facet) };
        let between = self.nearest..to.distance - self.nearest;
        self.facets.iter().enumerate().any(|(i, facet)| {
            let is_other = i != from.facet && Some(i) != to.facet;
            is_other && facet.distance(&ray).is_some_and(|distance| between.contains(&distance))
        })
    }

    /// One sample of the lamps, one of the sky, and each light that is no surface.
    fn sample_lights(&self, from: &Vertex, bsdf: &Bsdf, numbers: LightNumbers) -> Vec<LightSample> {
        let sky = (self.sky != DVec3::ZERO).then(|| self.sample_sky(from, bsdf, numbers.of_sky));
        let lights = self.scene.lights.iter().filter_map(|light| arriving(light, from.position));
        self.sample_lamps(from, numbers.of_lamps).into_iter().chain(sky).chain(lights).collect()
    }

    /// A direction by the cosine on the side of `wo`, or on both where light passes the surface.
    fn sample_sky(&self, from: &Vertex, bsdf: &Bsdf, [u, v, side, _]: [f64; 4]) -> LightSample {
        let above = (u.sqrt() * DVec2::from_angle(TAU * v)).extend((1.0 - u).sqrt());
        let is_below = bsdf.passes_widely() && side < 0.5;
        let local = if is_below { DVec3::new(above.x, above.y, -above.z) } else { above };
        let density = sky_density(bsdf, local);
        let (direction, radiance) = (from.to_world(local), self.sky / density.max(1e-12));
        LightSample { facet: None, direction, distance: f64::INFINITY, radiance, density: Some(density) }
    }

    /// A point uniform over an emissive triangle that is chosen mostly by power, unless it faces away. The number that
    /// chose the triangle is remapped and gives the point, except for the last of its 24 bits.
    fn sample_lamps(&self, from: &Vertex, [pick, v, digits, _]: [f64; 4]) -> Option<LightSample> {
        let place = pick * self.lamps.len() as f64;
        let cell = self.lamps.get(place as usize)?;
        let left = (place.fract() + digits * self.lamps.len() as f64 * 2.0_f64.powi(-24)).min(1.0);
        let (own, u) = optics::falls_below(left, cell.threshold);
        let index = if own { cell.facet } else { cell.alias };
        let Facet { corner, edges: [second, third], normal, material, .. } = self.facets[index];
        let s = u.sqrt();
        let point = corner + s * (1.0 - v) * second + s * v * third;
        let distance = point.distance(from.position);
        let direction = (point - from.position) / distance;
        let cosine = -normal.dot(direction);
        let ke = self.scene.materials[material].emission.as_dvec3();
        // From the area measure to solid angle.
        let density = self.lamp_densities[index] * distance * distance / cosine;
        (cosine > 0.0).then_some(LightSample {
            facet: Some(index),
            direction,
            distance,
            radiance: ke / density,
            density: Some(density),
        })
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

/// Pdf of a sample of the sky.
fn sky_density(bsdf: &Bsdf, wi: DVec3) -> f64 {
    let cosine = if bsdf.passes_widely() { 0.5 * wi.z.abs() } else { wi.z.max(0.0) };
    cosine * FRAC_1_PI
}

/// Light that arrives at a point from a light that is no surface, as docs/scene-format.md and Mitsuba define it.
fn arriving(light: &Light, at: DVec3) -> Option<LightSample> {
    let sample =
        |direction, distance, radiance| LightSample { facet: None, direction, distance, radiance, density: None };
    let from = |position: DVec3, intensity: DVec3| {
        let distance = position.distance(at);
        (distance > 0.0).then(|| sample((position - at) / distance, distance, intensity / (distance * distance)))
    };
    match *light {
        Light::Point { position, intensity } => from(position, intensity.as_dvec3()),
        Light::Directional { direction, irradiance } => Some(sample(-direction, f64::INFINITY, irradiance.as_dvec3())),
        Light::Spot { position, direction, intensity, angles, falloff } => {
            let angle = (at - position).angle_between(direction);
            let [full, none] = angles.map(f64::to_radians);
            let share = match falloff {
                Falloff::Angle => ((none - angle) / (none - full)).clamp(0.0, 1.0),
                Falloff::SquaredCosine => {
                    ((angle.cos() - none.cos()) / (full.cos() - none.cos())).clamp(0.0, 1.0).powi(2)
                }
            };
            from(position, share * intensity.as_dvec3())
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec3, dvec3};
    use raywave::scene::{Camera, EnvironmentMap, Material, SceneBuilder};

    #[test]
    fn what_is_not_known_is_told() {
        let camera = Camera::pinhole(dvec3(0.0, 0.0, 3.0), DVec3::ZERO, 40.0);
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let flat = SceneBuilder::new(camera).material(Material::diffuse(Vec3::ONE)).polygon(&corners).build();
        let refused = |scene: &Scene| Reference::new(scene, &scene.settings).err().map(|error| error.to_string());
        assert_eq!(refused(&flat), None);
        let mut bumpy = flat.clone();
        bumpy.materials[0].textures[Parameter::Height as usize] = Some(0);
        assert_eq!(refused(&bumpy).unwrap(), "the reference path tracer knows no images of normals and heights");
        let smooth = SceneBuilder::new(camera).material(Material::diffuse(Vec3::ONE));
        let smooth = smooth.shaded_polygon(&corners, &[Vec3::Z; 3]).build();
        assert_eq!(refused(&smooth).unwrap(), "the reference path tracer knows no vertex normals");
        let map = EnvironmentMap {
            path: std::path::PathBuf::new(),
            width: 1,
            height: 1,
            radiance: vec![Vec3::ONE],
            rotation: glam::DMat3::IDENTITY,
        };
        let sky = Scene { environment: Environment::LatLong(map), ..flat };
        assert!(refused(&sky).unwrap().contains("images of skies"));
    }
}
