//! Material keys: what an MTL file or a `[material.NAME]` table says, and the [`Material`] it means.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

use glam::Vec3;

use super::{
    Material, Surface,
    error::{Place, SceneError},
    text::{excerpt, keyword, name, number, statements},
};

/// The numeric keys, spelled as in MTL.
pub(super) const NUMERIC_KEYS: [&str; 7] = ["Kd", "Ks", "Ke", "Tf", "Ns", "Ni", "illum"];

/// An image and the line that names it.
#[derive(Debug, Clone)]
pub(super) struct ImageName {
    pub path: PathBuf,
    pub place: Place,
}

/// The keys of one material; `None` where the file is silent.
#[derive(Debug, Clone, Default)]
pub(super) struct MaterialKeys {
    /// Where the material is defined, or overridden; `None` where it is nowhere.
    pub place: Option<Place>,
    kd: Option<Vec3>,
    ks: Option<Vec3>,
    ke: Option<Vec3>,
    tf: Option<Vec3>,
    ns: Option<f32>,
    ni: Option<f32>,
    surface: Option<Surface>,
    /// `Some(None)` takes the image away that another file gave.
    pub map_kd: Option<Option<ImageName>>,
    /// What to tell a user whose scene uses this material.
    pub warnings: Vec<String>,
}

impl MaterialKeys {
    /// No keys yet, of a material that is named at `place`.
    pub(super) fn at(place: Place) -> Self {
        Self { place: Some(place), ..Self::default() }
    }

    /// Sets one of [`NUMERIC_KEYS`]. Returns a warning where the value is read as another, and
    /// an error that says what is wrong and what to do where it cannot be used.
    pub(super) fn set(&mut self, key: &str, values: &[f64]) -> Result<Option<String>, String> {
        match key {
            "Kd" => self.kd = Some(colour(key, values)?),
            "Ks" => self.ks = Some(colour(key, values)?),
            "Ke" => self.ke = Some(colour(key, values)?),
            "Tf" => self.tf = Some(colour(key, values)?),
            "Ns" => match scalar(key, values)? {
                ns if ns >= 0.0 => self.ns = Some(ns),
                ns => return Err(format!("Ns is {ns}; a Phong exponent is 0 or more")),
            },
            "Ni" => match scalar(key, values)? {
                ni if ni > 0.0 => self.ni = Some(ni),
                ni => return Err(format!("Ni is {ni}; an index of refraction is above 0")),
            },
            "illum" => {
                let illum = scalar(key, values)?;
                if illum.fract() != 0.0 {
                    return Err(format!("illum is {illum}; give a whole number, 0 to 9"));
                }
                let surface = Surface::from_illum(illum);
                self.surface = Some(surface.unwrap_or(Surface::Glossy));
                if surface.is_none() {
                    return Ok(Some(format!("illum {illum} has no meaning here; 2 is taken")));
                }
            }
            _ => return Err(format!("`{key}` is not a material key")),
        }
        Ok(None)
    }

    /// These keys with those of `over` laid on top.
    pub(super) fn overridden_by(self, over: &Self) -> Self {
        let over = over.clone();
        Self {
            place: over.place.or(self.place),
            kd: over.kd.or(self.kd),
            ks: over.ks.or(self.ks),
            ke: over.ke.or(self.ke),
            tf: over.tf.or(self.tf),
            ns: over.ns.or(self.ns),
            ni: over.ni.or(self.ni),
            surface: over.surface.or(self.surface),
            map_kd: over.map_kd.or(self.map_kd),
            warnings: [self.warnings, over.warnings].concat(),
        }
    }

    /// The image that the surface shows, where the surface can show one.
    pub(super) fn image(&self) -> Option<&ImageName> {
        let shows_image = self.surface() == Surface::Glossy && self.emission() == Vec3::ZERO;
        self.map_kd.as_ref()?.as_ref().filter(|_| shows_image)
    }

    fn surface(&self) -> Surface {
        self.surface.unwrap_or(Surface::Glossy)
    }

    fn emission(&self) -> Vec3 {
        self.ke.unwrap_or(Vec3::ZERO)
    }

    /// The material without its image, missing keys filled in, and the factor that the energy
    /// rule scaled Kd and Ks by. `brightest` is the largest value in each channel of the image,
    /// where there is one: then the rule holds for the image, and Kd means nothing.
    pub(super) fn material(&self, name: &str, brightest: Option<Vec3>) -> (Material, f32) {
        let surface = self.surface();
        let is_emitter = self.emission() != Vec3::ZERO;
        let kd = self.kd.unwrap_or(Vec3::splat(0.8));
        let ks = self.ks.unwrap_or(Vec3::ZERO);
        let (kd, ks) = match surface {
            _ if is_emitter => (Vec3::ZERO, Vec3::ZERO),
            Surface::Glossy => (brightest.unwrap_or(kd), ks),
            Surface::Mirror => (Vec3::ZERO, ks),
            Surface::Refractive | Surface::Dielectric => (Vec3::ZERO, Vec3::ZERO),
        };
        let scale = 1.0 / (kd + ks).max_element().max(1.0);
        let material = Material {
            name: name.to_owned(),
            surface,
            kd: kd * scale,
            ks: ks * scale,
            ns: self.ns.unwrap_or(1.0),
            ni: self.ni.unwrap_or(1.0),
            tf: self.tf.unwrap_or(Vec3::ONE),
            ke: self.emission(),
            map_kd: None,
        };
        (material, scale)
    }
}

impl Surface {
    fn from_illum(illum: f32) -> Option<Self> {
        match illum {
            0.0 | 1.0 | 2.0 => Some(Self::Glossy),
            3.0 | 5.0 => Some(Self::Mirror),
            6.0 => Some(Self::Refractive),
            4.0 | 7.0 | 9.0 => Some(Self::Dielectric),
            _ => None,
        }
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

/// Reads an MTL file: its materials by name. A name that comes twice continues the first.
pub(super) fn read_mtl(path: &Path, text: &str) -> Result<HashMap<String, MaterialKeys>, SceneError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut materials = HashMap::<String, MaterialKeys>::new();
    let mut current: Option<&mut MaterialKeys> = None;
    for (line, statement) in statements(text) {
        let place = Place::line(path, line);
        let refuse = |problem| SceneError::Mtl { place: place.clone(), problem };
        let (key, rest) = keyword(&statement);
        if key == "newmtl" {
            if rest.is_empty() {
                return Err(refuse("newmtl has no name; give the material one".into()));
            }
            let material = materials.entry(name(rest));
            current = Some(material.or_insert_with(|| MaterialKeys::at(place)));
            continue;
        }
        let is_numeric = NUMERIC_KEYS.contains(&key);
        let Some(material) = current.as_mut() else {
            if is_numeric || key == "map_Kd" {
                return Err(refuse(format!("{key} belongs to no material; put newmtl above it")));
            }
            continue;
        };
        let mut warn = |warning| material.warnings.push(format!("{place}: {warning}"));
        if is_numeric {
            let values: Result<Vec<f64>, _> = rest.split_whitespace().map(number).collect();
            let values = values.map_err(|e| refuse(format!("{key}: {e}; give plain numbers")))?;
            if let Some(warning) = material.set(key, &values).map_err(refuse)? {
                material.warnings.push(format!("{place}: {warning}"));
            }
        } else if key == "map_Kd" {
            let has_options = rest.starts_with('-');
            let file = match has_options {
                true => rest.split_whitespace().next_back().unwrap_or(""),
                false => rest,
            };
            if file.is_empty() {
                return Err(refuse("map_Kd has no file name; give one".into()));
            }
            if has_options {
                warn("the options of map_Kd are ignored".to_owned());
            }
            material.map_kd = Some(Some(ImageName { path: folder.join(portable(file)), place }));
        } else if key.starts_with("map_") || ["bump", "disp", "decal", "norm"].contains(&key) {
            warn(format!("`{}` is ignored: map_Kd is the only image read", excerpt(key)));
        }
    }
    Ok(materials)
}

/// A relative path as MTL files hold it, with either kind of slash.
pub(super) fn portable(path: &str) -> PathBuf {
    PathBuf::from(path.replace('\\', "/"))
}
