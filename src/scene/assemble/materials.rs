//! Materials that surfaces show, held to the conservation of energy, and their textures.

use std::{collections::HashMap, mem, sync::Arc};

use glam::Vec3;
use half::f16;

use super::decoded;
use crate::constants::MAX_BLENDS;
use crate::image::{Encoding, Texels};
use crate::scene::{
    Lookup, Material, Parameter, Surface, Texture, Wrap,
    error::{Location, SceneError},
    import::{self, ImageFile, ImageSource, LUMINANCE, Map, OPACITY, Response},
    sources::{OUTSIDE, Sources, Warning},
    text::{excerpt, one_line},
};

/// What each channel gives of luminance (Rec. 709).
const LUMINANCES: Vec3 = Vec3::new(0.212671, 0.715160, 0.072169);

/// The materials of a scene in the making: those that triangles use, in order of first use.
pub(super) struct Materials {
    described: Vec<import::Material>,
    images: Vec<ImageFile>,
    /// Texels of images by index and encoding, every channel finite and at least 0.
    decoded: HashMap<(usize, Encoding), Texels>,
    /// Of each described material, what was made of it without its images and with them.
    known: Vec<[Option<u32>; 2]>,
    /// `None` while its parts are made.
    made: Vec<Option<Material>>,
    /// Texels of textures by what they were made of, and textures by their texels and where they lie.
    texels: HashMap<TexelOrigin, Arc<[[f16; 4]]>>,
    origins: HashMap<Origin, u32>,
    textures: Vec<Texture>,
}

/// What makes texels: an image in an encoding, the channel or all, factors by their bits, and the response.
type TexelOrigin = (usize, Encoding, Option<usize>, [u32; 3], [u32; 2]);
/// What makes a texture: texels, and where they lie, by its bits.
type Origin = (TexelOrigin, [u32; 6], Wrap, bool);

impl Materials {
    pub fn new(described: Vec<import::Material>, images: Vec<ImageFile>) -> Self {
        let known = vec![[None; 2]; described.len()];
        let (decoded, made, texels, origins, textures) = Default::default();
        Self { described, images, decoded, known, made, texels, origins, textures }
    }

    /// Whether a material of the scene, or a part of it, needs texture coordinates.
    pub fn needs_coordinates(&self, material: u32) -> bool {
        let Some(made) = &self.made[material as usize] else { return false };
        let own = made.textures.iter().any(Option::is_some) || made.is_anisotropic();
        own || made.surface.parts().any(|part| self.needs_coordinates(part))
    }

    /// All materials, and the textures that they index.
    pub fn finish(self) -> (Vec<Material>, Vec<Texture>) {
        (self.made.into_iter().flatten().collect(), self.textures)
    }

    /// The index of a described material among those of the scene. It is made at its first use, by
    /// a mesh of `user`; where faces have no texture coordinates, without its images.
    pub fn index(
        &mut self,
        described: u32,
        has_uvs: bool,
        user: &Location,
        sources: &mut Sources,
    ) -> Result<u32, SceneError> {
        let described = described as usize;
        if self.described[described].is_transparent() {
            self.split(described);
        }
        let needs_coordinates = self.reaches_coordinates(described, 0);
        let kind = usize::from(needs_coordinates && has_uvs);
        if let Some(known) = self.known[described][kind] {
            return Ok(known);
        }
        let material = &mut self.described[described];
        for warning in mem::take(&mut material.warnings) {
            sources.note(&warning);
        }
        if let Some(fault) = material.faults.iter().find(|fault| material.shows(fault.key)) {
            return Err(fault.location.refuse(&fault.problem));
        }
        if material.map(Parameter::Diffuse).is_some() && material.optics.only_emits() {
            let location = material.location.clone().unwrap_or_else(|| user.clone());
            let text = "a material with Ke is a light and shows no map_Kd".to_owned();
            sources.note(&Warning { kind: "image on a light", location, text });
        }
        if material.hides_opacity() {
            let location = material.location.clone().unwrap_or_else(|| user.clone());
            let text =
                format!("the opacity of `{}` is not shown: it is glass or a light", excerpt(&material.optics.name));
            sources.note(&Warning { kind: "opacity", location, text });
        }
        if material.visible_maps().next().is_some() && !has_uvs {
            let name = excerpt(&material.optics.name);
            let text = format!("faces of `{name}` lack texture coordinates; they show constants, not images");
            sources.note(&Warning { kind: "no texture coordinates", location: user.clone(), text });
        }
        let maps: Vec<(Parameter, Map)> = material.visible_maps().filter(|_| has_uvs).collect();
        let index = self.made.len() as u32;
        // A blend that is a part of itself ends here.
        self.known[described][kind] = Some(index);
        self.made.push(None);
        let mut made = self.made_of(described, &maps, user, sources)?;
        let mut part = |part: u32| self.index(part, has_uvs, user, sources);
        made.surface = match made.surface {
            Surface::Blend(first, second) => Surface::Blend(part(first)?, part(second)?),
            Surface::Sides { front, back } => Surface::Sides { front: part(front)?, back: part(back)? },
            other => other,
        };
        self.made[index as usize] = Some(made);
        Ok(index)
    }

    /// Makes of a transparent material a blend of its opaque self and of nothing.
    fn split(&mut self, described: usize) {
        let mut opaque = self.described[described].clone();
        opaque.opacity = 1.0;
        opaque.set_map(Parameter::Weight, None);
        let nothing = Material { surface: Surface::Nothing, ..Material::diffuse(Vec3::ZERO) };
        let nothing = import::Material { optics: nothing, ..import::Material::named("nothing") };
        let first = self.described.len() as u32;
        self.described.extend([opaque, nothing]);
        self.known.extend([[None; 2]; 2]);
        let whole = &mut self.described[described];
        whole.maps.retain(|(parameter, _)| matches!(parameter, Parameter::Weight | Parameter::Emission));
        whole.optics.surface = Surface::Blend(first, first + 1);
        whole.optics.weight = whole.opacity;
        if let Some(map) = whole.map(Parameter::Weight) {
            whole.set_map(Parameter::Weight, Some(Map { factor: map.factor * whole.opacity, ..map }));
        }
        // What it says it says once, and what emits is the whole.
        whole.opacity = 1.0;
        whole.warnings.clear();
        let opaque = &mut self.described[first as usize];
        opaque.optics.emission = Vec3::ZERO;
        opaque.set_map(Parameter::Emission, None);
    }

    /// Whether a described material or a part of it needs texture coordinates. Blends are [`MAX_BLENDS`] deep at most.
    fn reaches_coordinates(&self, described: usize, depth: u32) -> bool {
        let material = &self.described[described];
        let own = material.visible_maps().next().is_some() || material.optics.is_anisotropic();
        own || depth < MAX_BLENDS
            && material.optics.surface.parts().any(|part| self.reaches_coordinates(part as usize, depth + 1))
    }

    /// Whether an image can be read. Where it cannot, a warning is enough: models are often handed on without.
    fn is_there(&self, image: usize, sources: &mut Sources) -> bool {
        let ImageFile { path, location, source } = &self.images[image];
        let is_there = !matches!(source, ImageSource::File) || sources.has(path);
        if !is_there {
            const KIND: &str = "no such image";
            let name = one_line(&path.to_string_lossy());
            let text = if sources.is_outside(path) {
                format!("image `{name}` {OUTSIDE}; the constant is shown")
            } else {
                // Only the first is shown, and a folder is long to read.
                let other = if sources.has_noted(KIND) { None } else { sources.in_another_case(path) };
                let other = other.map_or_else(String::new, |other| format!("; there is `{other}`"));
                format!("there is no image `{name}`; the constant is shown{other}")
            };
            sources.note(&Warning { kind: KIND, location: location.clone(), text });
        }
        is_there
    }

    /// A described material that shows these images. Its parts are still those that are described.
    fn made_of(
        &mut self,
        described: usize,
        maps: &[(Parameter, Map)],
        user: &Location,
        sources: &mut Sources,
    ) -> Result<Material, SceneError> {
        let mut shown = Vec::new();
        for (parameter, map) in maps {
            if self.is_there(map.image, sources) {
                self.decode(map.image, encoding(map), sources)?;
                shown.push((*parameter, *map));
            }
        }
        let import::Material { optics, location, .. } = &self.described[described];
        let mut made = optics.clone();
        let scatters = !made.only_emits();
        if let Some((_, map)) = shown.iter().find(|(parameter, _)| *parameter == Parameter::Diffuse) {
            let texels = &self.decoded[&(map.image, encoding(map))].rgba;
            let brightest =
                texels.iter().fold(Vec3::ZERO, |most, texel| most.max(Vec3::from_slice(texel))) * map.factor;
            if brightest.max_element() > 1.0 {
                let location = self.images[map.image].location.clone();
                let text = "map_Kd is brighter than 1; clamped, as nothing reflects more than it gets".to_owned();
                sources.note(&Warning { kind: "bright image", location, text });
            }
            // The energy rule holds for the largest value that an image has in each channel.
            made.diffuse = brightest.min(Vec3::ONE);
        }
        if let Some((_, map)) = shown.iter().find(|(parameter, _)| *parameter == Parameter::Emission) {
            // Light is sampled by what the whole image emits.
            let texels = &self.decoded[&(map.image, encoding(map))].rgba;
            let sum = texels.iter().fold(Vec3::ZERO, |sum, texel| sum + Vec3::from_slice(texel));
            made.emission = sum / texels.len() as f32 * map.factor;
        }
        made.diffuse = if made.surface.is_diffuse() && scatters { made.diffuse } else { Vec3::ZERO };
        made.specular = if made.surface.is_reflector() && scatters { made.specular } else { Vec3::ZERO };
        // A Phong BRDF adds its two parts; of all others each is a share of its own.
        let largest = match made.surface {
            Surface::Glossy => (made.diffuse + made.specular).max_element(),
            _ => made.diffuse.max(made.specular).max_element(),
        };
        let scale = 1.0 / largest.max(1.0);
        if scale < 0.9999 {
            let text = format!(
                "Kd + Ks of `{}` reaches {:.3} in a channel; both are scaled down to 1",
                excerpt(&made.name),
                1.0 / scale
            );
            sources.note(&Warning { kind: "energy", location: location.as_ref().unwrap_or(user).clone(), text });
        }
        made.diffuse *= scale;
        made.specular *= scale;
        for (parameter, map) in shown {
            let scale = if parameter == Parameter::Diffuse { scale } else { 1.0 };
            made.textures[parameter as usize] = Some(self.texture(parameter, &map, scale));
        }
        Ok(made)
    }

    /// The index of the texture that gives a parameter by a decoded image, times `scale`.
    fn texture(&mut self, parameter: Parameter, map: &Map, scale: f32) -> u32 {
        let factor = map.factor * scale;
        let channel = parameter.is_scalar().then_some(map.channel);
        let response = match map.response {
            Response::Linear => [0, 0],
            Response::Squared => [1, 0],
            Response::Cutoff(least) => [2, least.to_bits()],
        };
        let made_of: TexelOrigin = (map.image, encoding(map), channel, factor.to_array().map(f32::to_bits), response);
        let Lookup { transform, wrap, is_smooth } = map.lookup;
        let origin = (made_of, transform.to_cols_array().map(f32::to_bits), wrap, is_smooth);
        if let Some(known) = self.origins.get(&origin) {
            return *known;
        }
        let Texels { width, height, rgba } = &self.decoded[&(map.image, encoding(map))];
        // Nothing reflects more than it gets.
        let most = if parameter == Parameter::Emission || parameter == Parameter::Height { f32::MAX } else { 1.0 };
        let has_alpha = channel == Some(OPACITY) && rgba.iter().any(|[.., alpha]| *alpha < 1.0);
        let texel = |rgba: &[f32; 4]| {
            let colour = match channel {
                Some(OPACITY) if has_alpha => Vec3::splat(rgba[3]),
                Some(LUMINANCE | OPACITY) => Vec3::splat(Vec3::from_slice(rgba).dot(LUMINANCES)),
                Some(channel) => Vec3::splat(rgba[channel]),
                None => Vec3::from_slice(rgba),
            };
            // The coordinates of a normal lie in [-1, 1].
            let product = match parameter {
                Parameter::Normal => 0.5 + 0.5 * (2.0 * colour - 1.0) * map.factor,
                _ => colour * map.factor,
            };
            let values = product.to_array().map(|value| map.response.of(value).min(most));
            let [r, mut g, b] = values.map(|value| f16::from_f32(value * scale));
            if parameter == Parameter::Height {
                // Slopes are of small differences: what rounding took from the first channel is in the second.
                g = f16::from_f32(values[0] * scale - r.to_f32());
            }
            [r, g, b, f16::ONE]
        };
        let texels = self.texels.entry(made_of).or_insert_with(|| rgba.iter().map(texel).collect()).clone();
        let path = self.images[map.image].path.clone();
        self.textures.push(Texture { path, width: *width, height: *height, texels, lookup: map.lookup });
        let index = self.textures.len() as u32 - 1;
        self.origins.insert(origin, index);
        index
    }

    /// Decodes an image once.
    fn decode(&mut self, index: usize, encoding: Encoding, sources: &mut Sources) -> Result<(), SceneError> {
        if !self.decoded.contains_key(&(index, encoding)) {
            let texels = decoded(&self.images[index], encoding, sources)?;
            self.decoded.insert((index, encoding), texels);
        }
        Ok(())
    }
}

/// How the codes of an image mean the values that it gives.
fn encoding(map: &Map) -> Encoding {
    if map.is_raw { Encoding::Raw } else { Encoding::Srgb }
}
