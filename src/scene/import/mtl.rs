//! MTL: the keys of its materials, and what they say of the physics of a surface. The tables
//! `[material.NAME]` of scene files have the same keys.

use std::{collections::HashMap, path::Path};

use glam::{Affine2, Mat3, Vec2, Vec3};

use super::{Fault, ImageFile, Images, LUMINANCE, Map, Material, OPACITY, Response};
use crate::scene::{
    Lookup, Parameter, Surface, Wrap,
    error::Location,
    sources::{Sources, Warning},
    text::{excerpt, file_name, keyword, name, number, statements},
};

/// The keys of colours and numbers.
const KEYS: [&str; 11] = ["Kd", "Ks", "Ke", "Tf", "Ns", "Ni", "illum", "Pr", "Pm", "Pc", "Pcr"];
const KEYS_OF_COLOURS: [&str; 4] = ["Kd", "Ks", "Ke", "Tf"];

/// A key of an image and what that gives.
#[derive(Debug)]
struct ImageKey {
    key: &'static str,
    parameter: Parameter,
    is_raw: bool,
    response: Response,
}

/// The images that are shown.
const IMAGES: [ImageKey; 6] = [
    ImageKey { key: "map_Kd", parameter: Parameter::Diffuse, is_raw: false, response: Response::Linear },
    ImageKey { key: "map_Ke", parameter: Parameter::Emission, is_raw: false, response: Response::Linear },
    ImageKey { key: "map_d", parameter: Parameter::Weight, is_raw: true, response: Response::Linear },
    ImageKey { key: "map_Pr", parameter: Parameter::Roughness, is_raw: true, response: Response::Squared },
    ImageKey { key: "map_Pm", parameter: Parameter::Metalness, is_raw: true, response: Response::Linear },
    ImageKey { key: "norm", parameter: Parameter::Normal, is_raw: true, response: Response::Linear },
];

/// The materials of an MTL file by name.
pub(super) type Library = HashMap<String, Definition>;

/// What is said of one material.
#[derive(Debug, Clone)]
pub(super) struct Definition {
    pub location: Location,
    /// In the order in which they are laid over a material.
    properties: Vec<Property>,
    /// For a user whose scene uses this material.
    warnings: Vec<Warning>,
    /// The number of the last `illum`.
    illum: f32,
    /// Opacity, if a file says it.
    opacity: Option<f64>,
    /// `Ka`, if a file says it.
    ambient: Option<f32>,
}

/// A property of a material and its value.
#[derive(Debug, Clone)]
enum Property {
    Surface(Surface),
    Diffuse(Vec3),
    Specular(Vec3),
    Exponent(f32),
    Ior(f32),
    Transmission(Vec3),
    Emission(Vec3),
    /// As people perceive it: the square root of GGX's alpha.
    Roughness(f32),
    Metalness(f32),
    Coat(f32),
    CoatRoughness(f32),
    Opacity(f32),
    /// `None` takes the image away that another file gave.
    Image(&'static ImageKey, Option<(ImageFile, Lookup)>),
    /// A key whose value cannot be used.
    Unusable(Fault),
    /// Glass that the file asks for and does not describe: the surface is opaque until an index is given.
    Withheld(Surface),
}

impl Property {
    /// The key that gives it.
    fn key(&self) -> &'static str {
        match self {
            Self::Surface(_) | Self::Withheld(_) => "illum",
            Self::Diffuse(_) => "Kd",
            Self::Specular(_) => "Ks",
            Self::Exponent(_) => "Ns",
            Self::Ior(_) => "Ni",
            Self::Transmission(_) => "Tf",
            Self::Emission(_) => "Ke",
            Self::Roughness(_) => "Pr",
            Self::Metalness(_) => "Pm",
            Self::Coat(_) => "Pc",
            Self::CoatRoughness(_) => "Pcr",
            Self::Opacity(_) => "d",
            Self::Image(image, _) => image.key,
            Self::Unusable(fault) => fault.key,
        }
    }
}

impl Definition {
    /// Nothing yet of a material that is named at `location`.
    pub fn at(location: Location) -> Self {
        let (properties, warnings) = Default::default();
        Self { location, properties, warnings, illum: 2.0, opacity: None, ambient: None }
    }

    /// Adds what a numeric key says, which stands at `location`. The error says what is wrong and
    /// what to do where the numbers cannot be used.
    pub fn set(&mut self, key: &str, values: &[f64], location: &Location) -> Result<(), String> {
        let property = match key {
            "Kd" => Property::Diffuse(colour(key, values)?),
            "Ks" => Property::Specular(colour(key, values)?),
            "Ke" => Property::Emission(colour(key, values)?),
            "Tf" => Property::Transmission(colour(key, values)?),
            "Ns" => match scalar(key, values)? {
                ns if ns >= 0.0 => Property::Exponent(ns),
                ns => return Err(format!("Ns is {ns}; a Phong exponent is 0 or more")),
            },
            "Ni" => match scalar(key, values)? {
                ni if ni > 0.0 => Property::Ior(ni),
                ni => return Err(format!("Ni is {ni}; an index of refraction is above 0")),
            },
            "Pr" => Property::Roughness(share(key, values)?),
            "Pm" => Property::Metalness(share(key, values)?),
            "Pc" => Property::Coat(share(key, values)?),
            "Pcr" => Property::CoatRoughness(share(key, values)?),
            "d" => Property::Opacity(share(key, values)?),
            "illum" => {
                let illum = scalar(key, values)?;
                if illum.fract() != 0.0 {
                    return Err(format!("illum is {illum}; give a whole number, 0 to 9"));
                }
                let surface = surface_of(illum);
                if surface.is_none() {
                    self.warn("illum", location, format!("illum {illum} has no meaning here; 2 is taken"));
                }
                self.illum = illum;
                Property::Surface(surface.unwrap_or(Surface::Glossy))
            }
            _ => return Err(format!("`{key}` is not a material key")),
        };
        self.properties.push(property);
        Ok(())
    }

    /// Gives the material a diffuse image, or takes one away.
    pub fn set_diffuse_image(&mut self, image: Option<ImageFile>) {
        self.properties.push(Property::Image(&IMAGES[0], image.map(|image| (image, Lookup::default()))));
    }

    fn warn(&mut self, kind: &'static str, location: &Location, text: impl Into<String>) {
        self.warnings.push(Warning { kind, location: location.clone(), text: text.into() });
    }

    /// The value of the last property of that key.
    fn last(&self, key: &str) -> Option<&Property> {
        self.properties.iter().rev().find(|property| property.key() == key)
    }

    /// Keeps a surface opaque that `illum` would make glass while nothing else says that it is: many programs write 4, 6, 7
    /// or 9 for every material. Glass has an index of refraction other than 1, and no `d 1` beside `illum 4`.
    fn doubt_glass(&mut self) {
        let surface = match self.last("illum") {
            Some(Property::Surface(surface)) if surface.refracts() => *surface,
            _ => return,
        };
        let why = match self.last("Ni") {
            None => "no Ni",
            Some(Property::Ior(1.0)) => "Ni 1",
            _ if self.illum == 4.0 && self.opacity.is_some_and(|opacity| opacity >= 1.0) => "d 1",
            _ => return,
        };
        let text = format!(
            "illum {} with {why} is taken to be opaque; for glass give illum and Ni in a [material] table of a scene file",
            self.illum
        );
        self.warn("glass in doubt", &self.location.clone(), text);
        self.properties.push(Property::Withheld(surface));
    }

    /// Blender writes its metals as `illum 3` with the base colour as Kd, the share of metal as Ka, and a roughness as Ns; it
    /// always writes an index and an opacity too, which no mirror needs.
    fn recognise_blenders_metal(&mut self) {
        let is_described = ["Kd", "Ns", "Ni"].iter().all(|key| self.last(key).is_some()) && self.opacity.is_some();
        let says_more = self.last("Pr").or(self.last("Pm")).is_some();
        let (Some(Property::Exponent(exponent)), Some(ambient)) = (self.last("Ns"), self.ambient) else { return };
        if self.illum == 3.0 && is_described && !says_more {
            let roughness = 1.0 - (exponent / 1000.0).clamp(0.0, 1.0).sqrt();
            let metalness = if ambient > 0.0 { ambient.min(1.0) } else { 1.0 };
            self.properties.extend([Property::Roughness(roughness), Property::Metalness(metalness)]);
        }
    }

    fn warn_of_image(&mut self, key: &str, location: &Location) {
        let text = format!("`{}` is ignored: images of that key are not shown", excerpt(key));
        self.warn("image of another key", location, text);
    }

    /// Lays what is said over a material, whose image is then one of `images`.
    pub fn apply(&self, material: &mut Material, images: &mut Images) {
        if material.location.is_none() {
            // It warned of nothing but its lack of a definition.
            material.warnings.clear();
        }
        material.location = Some(self.location.clone());
        material.warnings.extend_from_slice(&self.warnings);
        for property in &self.properties {
            material.faults.retain(|fault| fault.key != property.key());
            let optics = &mut material.optics;
            match property {
                Property::Surface(surface) => {
                    optics.surface = *surface;
                    material.withheld = None;
                }
                Property::Diffuse(reflectance) => optics.diffuse = *reflectance,
                Property::Specular(reflectance) => optics.specular = *reflectance,
                Property::Exponent(exponent) => optics.exponent = *exponent,
                Property::Ior(ior) => {
                    optics.ior = *ior;
                    // Now it is described.
                    optics.surface = material.withheld.take().unwrap_or(optics.surface);
                }
                Property::Transmission(tint) => optics.transmission = *tint,
                Property::Emission(radiance) => optics.emission = *radiance,
                Property::Roughness(roughness) => optics.roughness = Vec2::splat(roughness * roughness),
                Property::Metalness(metalness) => optics.metalness = *metalness,
                Property::Coat(coat) => optics.coat = *coat,
                Property::CoatRoughness(roughness) => optics.coat_roughness = roughness * roughness,
                Property::Opacity(opacity) => material.opacity = *opacity,
                Property::Image(key, image) => {
                    let ImageKey { parameter, is_raw, response, .. } = **key;
                    let map = image.as_ref().map(|(image, lookup)| {
                        let colour = Map::colour(images.index_of(image));
                        let channel = match parameter {
                            Parameter::Weight => OPACITY,
                            scalar if scalar.is_scalar() => LUMINANCE,
                            _ => colour.channel,
                        };
                        Map { lookup: *lookup, is_raw, response, channel, ..colour }
                    });
                    material.set_map(parameter, map);
                }
                Property::Unusable(fault) => material.faults.push(fault.clone()),
                Property::Withheld(surface) => {
                    optics.surface = Surface::Glossy;
                    material.withheld = Some(*surface);
                }
            }
        }
        // Roughness and metal describe a surface that no `illum` does, unless it is glass or a later table has the last word.
        let describes = ["Pr", "Pm", "map_Pr", "map_Pm"].iter().any(|key| self.last(key).is_some());
        material.is_metal_rough = describes || material.is_metal_rough && self.last("illum").is_none();
        material.finish();
    }
}

/// The surface that `illum` stands for, where it stands for one.
fn surface_of(illum: f32) -> Option<Surface> {
    match illum {
        0.0 | 1.0 | 2.0 => Some(Surface::Glossy),
        3.0 | 5.0 => Some(Surface::Mirror),
        6.0 => Some(Surface::Refractive),
        4.0 | 7.0 | 9.0 => Some(Surface::Dielectric),
        _ => None,
    }
}

fn colour(key: &str, values: &[f64]) -> Result<Vec3, String> {
    let rgb = match *values {
        [grey] => [grey; 3],
        [r, g, b] => [r, g, b],
        _ => {
            let n = values.len();
            return Err(format!("{key} has {n} numbers; give one, or red, green and blue"));
        }
    };
    let colour = Vec3::from(rgb.map(|x| x as f32));
    if !colour.is_finite() {
        return Err(format!("{key} is not finite; give numbers of 0 or more"));
    }
    if colour.min_element() < 0.0 {
        return Err(format!("{key} is negative; give numbers of 0 or more"));
    }
    Ok(colour)
}

fn scalar(key: &str, values: &[f64]) -> Result<f32, String> {
    match *values {
        [value] if (value as f32).is_finite() => Ok(value as f32),
        [_] => Err(format!("{key} is not finite; give a plain number")),
        _ => Err(format!("{key} has {} numbers; give one", values.len())),
    }
}

fn share(key: &str, values: &[f64]) -> Result<f32, String> {
    match scalar(key, values)? {
        share if (0.0..=1.0).contains(&share) => Ok(share),
        share => Err(format!("{key} is {share}; give a number from 0 to 1")),
    }
}

/// Reads an MTL file. A name that comes twice continues the first. What it says wrongly or for nothing stops no scene:
/// the user of a material is told.
pub(super) fn read(path: &Path, text: &str, sources: &mut Sources<'_>) -> Library {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut materials = Library::new();
    let mut current: Option<&mut Definition> = None;
    for (line, statement) in statements(text) {
        let location = Location::line(path, line);
        let (key, rest) = keyword(&statement);
        if key == "newmtl" {
            if rest.is_empty() {
                let text = "newmtl has no name".to_owned();
                sources.note(&Warning { kind: "bare newmtl", location: location.clone(), text });
            }
            current = Some(materials.entry(name(rest)).or_insert_with(|| Definition::at(location)));
            continue;
        }
        let Some(material) = current.as_mut() else {
            if KEYS.contains(&key) || IMAGES.iter().any(|image| image.key == key) {
                let text = format!("{key} belongs to no material; put newmtl above it");
                sources.note(&Warning { kind: "key of no material", location, text });
            }
            continue;
        };
        if let Some(key) = KEYS.into_iter().find(|known| *known == key) {
            material.read(key, rest, &location);
            continue;
        }
        match key {
            _ if IMAGES.iter().any(|image| image.key == key) => {
                let image = IMAGES.iter().find(|image| image.key == key);
                image.iter().for_each(|image| material.read_image(image, rest, folder, &location));
            }
            "Ka" => material.ambient = keyword(rest).0.parse().ok(),
            "d" | "Tr" => {
                // Perhaps behind `-halo`.
                let value = rest.split_whitespace().next_back().and_then(|word| number(word).ok());
                let Some(value) = value.filter(|value| value.is_finite()) else { continue };
                let opacity = if key == "d" { value } else { 1.0 - value };
                material.opacity = Some(opacity);
                material.properties.push(Property::Opacity(opacity.clamp(0.0, 1.0) as f32));
            }
            _ if key.starts_with("map_") || ["bump", "disp", "decal", "refl"].contains(&key) => {
                material.warn_of_image(key, &location);
            }
            _ => {}
        }
    }
    for material in materials.values_mut() {
        material.doubt_glass();
        material.recognise_blenders_metal();
    }
    materials
}

impl Definition {
    /// Reads what an MTL file says of a key.
    fn read(&mut self, key: &'static str, text: &str, location: &Location) {
        let values = match KEYS_OF_COLOURS.contains(&key) {
            true => self.read_colour(key, text, location),
            false => self.read_numbers(key, text, location, 1).map(Some),
        };
        let problem = match values {
            Ok(Some(values)) => match self.set(key, &values, location) {
                Ok(()) => return,
                Err(problem) => problem,
            },
            Ok(None) => return,
            Err(problem) => problem,
        };
        self.properties.push(Property::Unusable(Fault { key, location: location.clone(), problem }));
    }

    /// Numbers; of more than `most` the first ones.
    fn read_numbers(&mut self, key: &str, text: &str, location: &Location, most: usize) -> Result<Vec<f64>, String> {
        let values: Result<Vec<f64>, String> = text.split_whitespace().map(number).collect();
        let mut values = values.map_err(|error| format!("{key}: {error}; give plain numbers"))?;
        if values.len() > most {
            let text = format!("{key} has {} numbers, of which {most} count", values.len());
            self.warn("too many numbers", location, text);
            values.truncate(most);
        }
        Ok(values)
    }

    /// A colour in any of the ways of MTL: red, green and blue, of which the last may be left out; CIE XYZ; or the name of a
    /// file of a spectrum, which is left out.
    fn read_colour(&mut self, key: &str, text: &str, location: &Location) -> Result<Option<Vec<f64>>, String> {
        match keyword(text) {
            ("spectral", _) => {
                self.warn("spectrum", location, format!("{key}: spectra are not read; the colour stays as it was"));
                Ok(None)
            }
            ("xyz", rest) => {
                let values = self.read_numbers(key, rest, location, 3)?;
                // Those that are left out are as the first.
                let at = |place: usize| values.get(place).or(values.first()).map_or(f32::NAN, |value| *value as f32);
                let rgb = XYZ_TO_RGB * Vec3::from(std::array::from_fn(at));
                Ok(Some(rgb.max(Vec3::ZERO).to_array().map(f64::from).to_vec()))
            }
            _ => {
                let mut values = self.read_numbers(key, text, location, 3)?;
                if let [_, green] = values[..] {
                    self.warn("two numbers", location, format!("{key} has two numbers; blue is taken to be as green"));
                    values.push(green);
                }
                Ok(Some(values))
            }
        }
    }

    /// Reads what a key of an image says: options, and the name of a file, which may have blanks in it.
    fn read_image(&mut self, image: &'static ImageKey, text: &str, folder: &Path, location: &Location) {
        let key = image.key;
        let mut rest = text;
        let (mut scale, mut offset, mut wrap) = (Vec2::ONE, Vec2::ZERO, Wrap::Repeat);
        while let Some((option, least, most)) = OPTIONS.into_iter().find(|(option, ..)| keyword(rest).0 == *option) {
            rest = keyword(rest).1;
            if option == "-clamp" {
                let (word, after) = keyword(rest);
                wrap = if word == "on" { Wrap::Clamp } else { Wrap::Repeat };
                rest = after;
                continue;
            }
            let mut values = Vec::new();
            for _ in 0..most {
                let (word, after) = keyword(rest);
                let value = number(word);
                // What may be left out ends at the first word that is no number.
                if after.is_empty() || (values.len() >= least && value.is_err()) {
                    break;
                }
                values.push(value.unwrap_or(f64::NAN) as f32);
                rest = after;
            }
            // Those that are left out are as before.
            let at = |place: usize, otherwise: f32| values.get(place).copied().unwrap_or(otherwise);
            match option {
                "-s" => scale = Vec2::new(at(0, 1.0), at(1, 1.0)),
                "-o" => offset = Vec2::new(at(0, 0.0), at(1, 0.0)),
                _ => self.warn("option of an image", location, format!("the option {option} of {key} is ignored")),
            }
        }
        if rest.is_empty() {
            self.warn("image without name", location, format!("{key} has no file name; the constant is shown"));
            return;
        }
        if !(scale.is_finite() && offset.is_finite()) {
            self.warn("option of an image", location, format!("-s or -o of {key} is not finite and is ignored"));
            (scale, offset) = (Vec2::ONE, Vec2::ZERO);
        }
        let transform = Affine2::from_scale_angle_translation(scale, 0.0, offset);
        let file = ImageFile::file(folder.join(file_name(rest)), location.clone());
        let lookup = Lookup { transform, wrap, ..Lookup::default() };
        self.properties.push(Property::Image(image, Some((file, lookup))));
    }
}

/// Rec. 709 primaries of CIE XYZ (IEC 61966-2-1), by columns.
const XYZ_TO_RGB: Mat3 = Mat3::from_cols_array(&[
    3.240_97,
    -0.969_243_6,
    0.055_630_1,
    -1.537_383_2,
    1.875_967_5,
    -0.203_977,
    -0.498_610_8,
    0.041_555_1,
    1.056_971_5,
]);

/// The options of images, and how many numbers or words each has: at least, and at most.
const OPTIONS: [(&str, usize, usize); 13] = [
    ("-s", 1, 3),
    ("-o", 1, 3),
    ("-t", 1, 3),
    ("-mm", 2, 2),
    ("-clamp", 1, 1),
    ("-blendu", 1, 1),
    ("-blendv", 1, 1),
    ("-cc", 1, 1),
    ("-imfchan", 1, 1),
    ("-texres", 1, 1),
    ("-bm", 1, 1),
    ("-boost", 1, 1),
    ("-colorspace", 1, 1),
];
