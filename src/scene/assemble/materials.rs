//! Materials that surfaces show, held to the conservation of energy, and their textures.

use std::{collections::HashMap, mem, path::Path};

use glam::Vec3;
use half::f16;

use super::decoded;
use crate::image::Image;
use crate::scene::{
    Material, Texture,
    error::{Location, SceneError},
    import::{self, ImageFile, Place},
    sources::{Sources, Warning},
    text::{excerpt, one_line},
};

/// The materials of a scene in the making: those that triangles use, in order of first use.
pub(super) struct Materials {
    described: Vec<import::Material>,
    images: Vec<ImageFile>,
    /// Decoded images by their index: reflectance, at most 1.
    reflectances: HashMap<usize, Image>,
    /// Of each described material, what was made of it without its image and with it.
    known: Vec<[Option<u32>; 2]>,
    made: Vec<Material>,
    /// Where the image of each lies on its surfaces.
    places: Vec<Place>,
    /// The texture of an image times the factor that the energy rule asks for, by its bits.
    known_textures: HashMap<(usize, u32), u32>,
    textures: Vec<Texture>,
}

impl Materials {
    pub fn new(described: Vec<import::Material>, images: Vec<ImageFile>) -> Self {
        let known = vec![[None; 2]; described.len()];
        let (reflectances, made, places, known_textures, textures) = Default::default();
        Self { described, images, reflectances, known, made, places, known_textures, textures }
    }

    /// What was made so far.
    pub fn made(&self) -> &[Material] {
        &self.made
    }

    /// Where the image of a material of the scene lies on its surfaces.
    pub fn place(&self, material: u32) -> Place {
        self.places[material as usize]
    }

    /// All materials, and the textures that they index.
    pub fn finish(self) -> (Vec<Material>, Vec<Texture>) {
        (self.made, self.textures)
    }

    /// The index of a described material among those of the scene. It is made at its first use, by
    /// a mesh of `user`; where faces have no texture coordinates, without its image.
    pub fn index(
        &mut self,
        described: u32,
        has_uvs: bool,
        user: &Location,
        sources: &mut Sources,
    ) -> Result<u32, SceneError> {
        let described = described as usize;
        let image = self.described[described].visible_image();
        let kind = usize::from(image.is_some() && has_uvs);
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
        if material.diffuse_image.is_some() && material.emission != Vec3::ZERO {
            let location = material.location.clone().unwrap_or_else(|| user.clone());
            let text = "a material with Ke is a light and shows no map_Kd".to_owned();
            sources.note(&Warning { kind: "image on a light", location, text });
        }
        if image.is_some() && !has_uvs {
            let name = excerpt(&material.name);
            let text = format!("faces of `{name}` lack texture coordinates; they show Kd, not map_Kd");
            sources.note(&Warning { kind: "no texture coordinates", location: user.clone(), text });
        }
        let place = material.image_place;
        let shown = image.filter(|_| has_uvs).filter(|image| self.is_there(*image, sources));
        let material = self.made_of(described, shown, user, sources)?;
        self.made.push(material);
        self.places.push(place);
        let index = self.made.len() as u32 - 1;
        self.known[described][kind] = Some(index);
        Ok(index)
    }

    /// Whether an image can be read. Where it cannot, a warning is enough: models are often handed on without.
    fn is_there(&self, image: usize, sources: &mut Sources) -> bool {
        let ImageFile { path, location } = &self.images[image];
        let is_there = sources.has(path);
        if !is_there {
            const KIND: &str = "no such image";
            let name = one_line(&path.to_string_lossy());
            // Only the first is shown, and a folder is long to read.
            let other = if sources.has_noted(KIND) { None } else { sources.in_another_case(path) };
            let other = other.map_or_else(String::new, |other| format!("; there is `{other}`"));
            let text = format!("there is no image `{name}`; Kd is shown{other}");
            sources.note(&Warning { kind: KIND, location: location.clone(), text });
        }
        is_there
    }

    /// A described material that shows the image `shown`.
    fn made_of(
        &mut self,
        described: usize,
        shown: Option<usize>,
        user: &Location,
        sources: &mut Sources,
    ) -> Result<Material, SceneError> {
        if let Some(image) = shown {
            self.decode(image, sources)?;
        }
        let import::Material { name, location, surface, diffuse, specular, emission, .. } = &self.described[described];
        // The energy rule holds for the largest value that an image has in each channel.
        let diffuse = shown.map_or(*diffuse, |image| self.reflectances[&image].brightest());
        let emits = *emission != Vec3::ZERO;
        let diffuse = if surface.is_diffuse() && !emits { diffuse } else { Vec3::ZERO };
        let specular = if surface.is_reflector() && !emits { *specular } else { Vec3::ZERO };
        let largest = (diffuse + specular).max_element();
        let scale = 1.0 / largest.max(1.0);
        if scale < 0.9999 {
            let text = format!(
                "Kd + Ks of `{}` reaches {:.3} in a channel; both are scaled down to 1",
                excerpt(name),
                1.0 / scale
            );
            sources.note(&Warning { kind: "energy", location: location.as_ref().unwrap_or(user).clone(), text });
        }
        let material = &self.described[described];
        Ok(Material {
            name: material.name.clone(),
            surface: material.surface,
            diffuse: diffuse * scale,
            specular: specular * scale,
            exponent: material.exponent,
            ior: material.ior,
            transmission: material.transmission,
            emission: material.emission,
            diffuse_map: shown.map(|image| self.texture(image, scale)),
        })
    }

    /// The index of the texture of a decoded image times `scale`.
    fn texture(&mut self, image: usize, scale: f32) -> u32 {
        *self.known_textures.entry((image, scale.to_bits())).or_insert_with(|| {
            self.textures.push(Texture::of(&self.images[image].path, &self.reflectances[&image], scale));
            self.textures.len() as u32 - 1
        })
    }

    /// Decodes an image once.
    fn decode(&mut self, index: usize, sources: &mut Sources) -> Result<(), SceneError> {
        if self.reflectances.contains_key(&index) {
            return Ok(());
        }
        let file = &self.images[index];
        let mut image = decoded(file, sources)?;
        if image.brightest().max_element() > 1.0 {
            for pixel in &mut image.pixels {
                *pixel = pixel.min(Vec3::ONE);
            }
            let text = "map_Kd is brighter than 1; clamped, as nothing reflects more than it gets".to_owned();
            sources.note(&Warning { kind: "bright image", location: file.location.clone(), text });
        }
        self.reflectances.insert(index, image);
        Ok(())
    }
}

impl Texture {
    /// A texture of the pixels of `image` times `scale`.
    fn of(path: &Path, image: &Image, scale: f32) -> Self {
        let texel = |pixel: &Vec3| {
            let [r, g, b] = (*pixel * scale).to_array().map(f16::from_f32);
            [r, g, b, f16::ONE]
        };
        let texels = image.pixels.iter().map(texel).collect();
        Self { path: path.to_path_buf(), width: image.width, height: image.height, texels }
    }
}
