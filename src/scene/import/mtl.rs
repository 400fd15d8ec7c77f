//! MTL: the keys of its materials, and what they say of the physics of a surface. The tables
//! `[material.NAME]` of scene files have the same keys.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

use glam::Vec3;

use super::{ImageFile, Material, index_of_image};
use crate::scene::{
    Surface,
    error::{Location, SceneError},
    text::{excerpt, keyword, name, number, statements},
};

/// The numeric keys.
const NUMERIC_KEYS: [&str; 7] = ["Kd", "Ks", "Ke", "Tf", "Ns", "Ni", "illum"];

/// The materials of an MTL file by name.
pub(super) type Library = HashMap<String, Definition>;

/// What is said of one material.
#[derive(Debug, Clone)]
pub(super) struct Definition {
    pub location: Location,
    /// In the order in which they are laid over a material.
    properties: Vec<Property>,
    /// Warnings for a user whose scene uses this material, one line each.
    warnings: Vec<String>,
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
    /// `None` takes the image away that another file gave.
    DiffuseImage(Option<ImageFile>),
}

impl Definition {
    /// Nothing yet of a material that is named at `location`.
    pub fn at(location: Location) -> Self {
        Self { location, properties: Vec::new(), warnings: Vec::new() }
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
            "illum" => {
                let illum = scalar(key, values)?;
                if illum.fract() != 0.0 {
                    return Err(format!("illum is {illum}; give a whole number, 0 to 9"));
                }
                let surface = surface_of(illum);
                if surface.is_none() {
                    self.warn(location, format!("illum {illum} has no meaning here; 2 is taken"));
                }
                Property::Surface(surface.unwrap_or(Surface::Glossy))
            }
            _ => return Err(format!("`{key}` is not a material key")),
        };
        self.properties.push(property);
        Ok(())
    }

    /// Gives the material a diffuse image, or takes one away.
    pub fn set_diffuse_image(&mut self, image: Option<ImageFile>) {
        self.properties.push(Property::DiffuseImage(image));
    }

    fn warn(&mut self, location: &Location, warning: String) {
        self.warnings.push(format!("{location}: {warning}"));
    }

    /// Lays what is said over a material, whose image is then one of `images`.
    pub fn apply(&self, material: &mut Material, images: &mut Vec<ImageFile>) {
        if material.location.is_none() {
            // It warned of nothing but its lack of a definition.
            material.warnings.clear();
        }
        material.location = Some(self.location.clone());
        material.warnings.extend_from_slice(&self.warnings);
        for property in &self.properties {
            match property {
                Property::Surface(surface) => material.surface = *surface,
                Property::Diffuse(reflectance) => material.diffuse = *reflectance,
                Property::Specular(reflectance) => material.specular = *reflectance,
                Property::Exponent(exponent) => material.exponent = *exponent,
                Property::Ior(ior) => material.ior = *ior,
                Property::Transmission(tint) => material.transmission = *tint,
                Property::Emission(radiance) => material.emission = *radiance,
                Property::DiffuseImage(image) => {
                    material.diffuse_image = image.as_ref().map(|image| index_of_image(images, image));
                }
            }
        }
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

/// Reads an MTL file. A name that comes twice continues the first.
pub(super) fn read(path: &Path, text: &str) -> Result<Library, SceneError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut materials = Library::new();
    let mut current: Option<&mut Definition> = None;
    for (line, statement) in statements(text) {
        let location = Location::line(path, line);
        let (key, rest) = keyword(&statement);
        if key == "newmtl" {
            if rest.is_empty() {
                return Err(location.refuse("newmtl has no name; give the material one"));
            }
            current = Some(materials.entry(name(rest)).or_insert_with(|| Definition::at(location)));
            continue;
        }
        let is_numeric = NUMERIC_KEYS.contains(&key);
        let Some(material) = current.as_mut() else {
            if is_numeric || key == "map_Kd" {
                return Err(location.refuse(format!("{key} belongs to no material; put newmtl above it")));
            }
            continue;
        };
        if is_numeric {
            let values: Result<Vec<f64>, _> = rest.split_whitespace().map(number).collect();
            let values = values.map_err(|e| location.refuse(format!("{key}: {e}; give plain numbers")))?;
            material.set(key, &values, &location).map_err(|problem| location.refuse(problem))?;
        } else if key == "map_Kd" {
            let has_options = rest.starts_with('-');
            let file = match has_options {
                true => rest.split_whitespace().next_back().unwrap_or(""),
                false => rest,
            };
            if file.is_empty() {
                return Err(location.refuse("map_Kd has no file name; give one"));
            }
            if has_options {
                material.warn(&location, "the options of map_Kd are ignored".to_owned());
            }
            material.set_diffuse_image(Some(ImageFile { path: folder.join(portable(file)), location }));
        } else if key.starts_with("map_") || ["bump", "disp", "decal", "norm"].contains(&key) {
            material.warn(&location, format!("`{}` is ignored: map_Kd is the only image read", excerpt(key)));
        }
    }
    Ok(materials)
}

/// A relative path as MTL files hold it, with either kind of slash.
pub(super) fn portable(path: &str) -> PathBuf {
    PathBuf::from(path.replace('\\', "/"))
}
