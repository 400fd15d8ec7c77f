//! The scene file: TOML that names meshes, places them, and gives camera, light and settings.

use std::{
    collections::BTreeMap,
    ops::Range,
    path::{Path, PathBuf},
    str::FromStr,
};

use glam::{DMat3, DVec3, Vec3};
use serde::Deserialize;
use toml::Spanned;

use super::{Environment, FARTHEST, ImageFile, Import, Instance, MeshFiles, mtl::Definition};
use crate::scene::{
    Camera,
    error::{Location, SceneError},
    sources::Sources,
    text::{excerpt, file_name, name, one_line},
    transform::Transform,
};
use crate::settings::{Named, Settings};

/// Imports a scene file with the meshes that it names.
pub(super) fn import(path: &Path, sources: &mut Sources) -> Result<Import, SceneError> {
    let bytes = sources.require(path, &Location::file(path))?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = 1 + valid.iter().filter(|&&byte| byte == b'\n').count();
        Location::line(path, line).refuse("not UTF-8 text; save the file as UTF-8")
    })?;
    let Document { camera, settings, meshes, overrides, environment } = read(path, &text)?;
    let mut import = Import { camera: Some(camera), settings, environment, ..Import::default() };
    let mut files = MeshFiles::default();
    for MeshEntry { path, location, transform } in meshes {
        let placed = files.add(&path, &location, sources, &mut import)?.iter();
        let place = |part: &Instance| Instance { transform: transform.after(&part.transform), ..*part };
        let placed: Vec<Instance> = placed.map(place).collect();
        import.instances.extend(placed);
    }
    for Override { name, definition } in overrides {
        let mut is_used = false;
        for material in import.materials.iter_mut().filter(|material| material.optics.name == name) {
            definition.apply(material, &mut import.images);
            is_used = true;
        }
        if !is_used {
            let (location, name) = (&definition.location, excerpt(&one_line(&name)));
            sources.warn(format!("{location}: no mesh uses material `{name}`; the table has no effect"));
        }
    }
    Ok(import)
}

/// A checked scene file.
#[derive(Debug)]
struct Document {
    camera: Camera,
    settings: Settings,
    meshes: Vec<MeshEntry>,
    overrides: Vec<Override>,
    environment: Environment,
}

/// One `[[mesh]]`.
#[derive(Debug)]
struct MeshEntry {
    path: PathBuf,
    /// The line that names the file.
    location: Location,
    transform: Transform,
}

/// One `[material.NAME]`.
#[derive(Debug)]
struct Override {
    name: String,
    definition: Definition,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawScene {
    camera: Option<RawCamera>,
    #[serde(default)]
    film: RawFilm,
    #[serde(default)]
    render: RawRender,
    #[serde(default)]
    mesh: Vec<RawMesh>,
    #[serde(default)]
    material: BTreeMap<Spanned<String>, RawMaterial>,
    environment: Option<Spanned<RawEnvironment>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawCamera {
    eye: Spanned<[f64; 3]>,
    target: Spanned<[f64; 3]>,
    up: Option<Spanned<[f64; 3]>>,
    vfov: Spanned<f64>,
    aperture: Option<Spanned<f64>>,
    focus: Option<Spanned<f64>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct RawFilm {
    width: Option<Spanned<i64>>,
    height: Option<Spanned<i64>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct RawRender {
    integrator: Option<Spanned<String>>,
    samples: Option<Spanned<i64>>,
    max_bounces: Option<Spanned<i64>>,
    roulette: Option<Spanned<f64>>,
    sampler: Option<Spanned<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawMesh {
    file: Spanned<String>,
    scale: Option<Spanned<Numbers>>,
    rotate: Option<Spanned<[f64; 3]>>,
    translate: Option<Spanned<[f64; 3]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case, reason = "keys are spelled as in MTL")]
struct RawMaterial {
    Kd: Option<Spanned<Numbers>>,
    Ks: Option<Spanned<Numbers>>,
    Ke: Option<Spanned<Numbers>>,
    Tf: Option<Spanned<Numbers>>,
    Ns: Option<Spanned<Numbers>>,
    Ni: Option<Spanned<Numbers>>,
    illum: Option<Spanned<Numbers>>,
    Pr: Option<Spanned<Numbers>>,
    Pm: Option<Spanned<Numbers>>,
    Pc: Option<Spanned<Numbers>>,
    Pcr: Option<Spanned<Numbers>>,
    d: Option<Spanned<Numbers>>,
    map_Kd: Option<Spanned<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawEnvironment {
    radiance: Option<Spanned<[f64; 3]>>,
    file: Option<Spanned<String>>,
    scale: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a number or an array of numbers")]
enum Numbers {
    One(f64),
    Many(Vec<f64>),
}

impl Numbers {
    fn as_slice(&self) -> &[f64] {
        match self {
            Self::One(value) => std::slice::from_ref(value),
            Self::Many(values) => values,
        }
    }
}

/// Reads a scene file's text. Errors name the offending line.
fn read(path: &Path, text: &str) -> Result<Document, SceneError> {
    let reader = Reader { path, text };
    let raw: RawScene = toml::from_str(text).map_err(|error| {
        let problem = format!("{}; see the scene format", one_line(error.message()));
        match error.span() {
            Some(span) => reader.refuse(&span, problem),
            None => reader.refuse_file(problem),
        }
    })?;

    let camera = match &raw.camera {
        Some(camera) => reader.camera(camera)?,
        None => {
            let problem = "no [camera]; add one with eye, target and vfov";
            return Err(reader.refuse_file(problem.into()));
        }
    };
    if raw.mesh.is_empty() {
        let problem = "no [[mesh]]; add one that names a mesh";
        return Err(reader.refuse_file(problem.into()));
    }
    Ok(Document {
        camera,
        settings: reader.settings(&raw.film, &raw.render)?,
        meshes: raw.mesh.iter().map(|mesh| reader.mesh(mesh)).collect::<Result<_, _>>()?,
        overrides: raw.material.iter().map(|(name, keys)| reader.material(name, keys)).collect::<Result<_, _>>()?,
        environment: match &raw.environment {
            Some(environment) => reader.environment(environment)?,
            None => Environment::Black,
        },
    })
}

/// Checks values and knows which line they stand on.
struct Reader<'a> {
    path: &'a Path,
    text: &'a str,
}

impl Reader<'_> {
    fn location(&self, span: &Range<usize>) -> Location {
        let before = &self.text.as_bytes()[..span.start.min(self.text.len())];
        let line = 1 + before.iter().filter(|&&byte| byte == b'\n').count();
        Location::line(self.path, line)
    }

    fn refuse(&self, span: &Range<usize>, problem: String) -> SceneError {
        self.location(span).refuse(problem)
    }

    fn refuse_file(&self, problem: String) -> SceneError {
        Location::file(self.path).refuse(problem)
    }

    /// A path beside the scene file.
    fn beside(&self, file: &str) -> PathBuf {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        folder.join(file_name(file))
    }

    fn require(&self, holds: bool, span: Range<usize>, problem: &str) -> Result<(), SceneError> {
        match holds {
            true => Ok(()),
            false => Err(self.refuse(&span, problem.to_owned())),
        }
    }

    /// Three coordinates in range.
    fn vector(&self, key: &str, value: &Spanned<[f64; 3]>) -> Result<DVec3, SceneError> {
        let vector = DVec3::from(*value.get_ref());
        let in_range = vector.abs().max_element() <= FARTHEST && vector.is_finite();
        let problem = format!("{key} is not finite, or beyond {FARTHEST:e}; give plain numbers");
        self.require(in_range, value.span(), &problem)?;
        Ok(vector)
    }

    fn camera(&self, raw: &RawCamera) -> Result<Camera, SceneError> {
        let eye = self.vector("eye", &raw.eye)?;
        let target = self.vector("target", &raw.target)?;
        let up = match &raw.up {
            Some(up) => self.vector("up", up)?,
            None => DVec3::Y,
        };
        let up_span = raw.up.as_ref().map_or(0..0, Spanned::span);
        let problem = "target equals eye; move one of them";
        self.require(target != eye, raw.target.span(), problem)?;
        self.require(up != DVec3::ZERO, up_span, "up is zero; give it a direction")?;

        let vfov = *raw.vfov.get_ref();
        let problem = "vfov is outside (0, 180); give degrees between them";
        self.require(vfov > 0.0 && vfov < 180.0, raw.vfov.span(), problem)?;

        let aperture = raw.aperture.as_ref().map_or(0.0, |value| *value.get_ref());
        let aperture_span = raw.aperture.as_ref().map_or(0..0, Spanned::span);
        let problem = "aperture is not a lens radius; give 0 for a pinhole, or more";
        let in_range = (0.0..=FARTHEST).contains(&aperture);
        self.require(in_range, aperture_span.clone(), problem)?;

        let focus = match &raw.focus {
            Some(focus) => {
                let problem = "focus is not a distance; give a number above 0";
                let in_range = *focus.get_ref() > 0.0 && *focus.get_ref() <= FARTHEST;
                self.require(in_range, focus.span(), problem)?;
                *focus.get_ref()
            }
            None => {
                let problem = "an aperture needs focus; give the distance to the plane in focus";
                self.require(aperture == 0.0, aperture_span, problem)?;
                eye.distance(target)
            }
        };
        Ok(Camera { eye, target, up, vfov, orthographic: None, aperture, focus })
    }

    fn pixels(&self, key: &str, value: &Option<Spanned<i64>>, default: u32) -> Result<u32, SceneError> {
        const LARGEST: i64 = 65536;
        let Some(value) = value else {
            return Ok(default);
        };
        let problem = format!("{key} is outside 1 to {LARGEST}; give pixels between them");
        let in_range = (1..=LARGEST).contains(value.get_ref());
        self.require(in_range, value.span(), &problem)?;
        Ok(*value.get_ref() as u32)
    }

    /// Reads a choice among names.
    fn choice<T: Named + FromStr>(&self, key: &str, value: &Spanned<String>) -> Result<T, SceneError> {
        value.get_ref().parse().map_err(|_| {
            let names: Vec<String> = T::names().iter().map(|name| format!("`{}`", name.name)).collect();
            let (last, others) = names.split_last().expect("a choice has names");
            let problem = format!("no {key} `{}`; take {} or {last}", one_line(value.get_ref()), others.join(", "));
            self.refuse(&value.span(), problem)
        })
    }

    fn settings(&self, film: &RawFilm, raw: &RawRender) -> Result<Settings, SceneError> {
        let mut settings = Settings::default();
        settings.width = self.pixels("width", &film.width, settings.width)?;
        settings.height = self.pixels("height", &film.height, settings.height)?;
        if let Some(integrator) = &raw.integrator {
            settings.integrator = self.choice("integrator", integrator)?;
        }
        if let Some(sampler) = &raw.sampler {
            settings.sampler = self.choice("sampler", sampler)?;
        }
        if let Some(samples) = &raw.samples {
            let count = u32::try_from(*samples.get_ref()).ok().filter(|&n| n > 0);
            let problem = "samples is out of range; give 1 or more";
            self.require(count.is_some(), samples.span(), problem)?;
            settings.samples = count.unwrap_or(settings.samples);
        }
        if let Some(roulette) = &raw.roulette {
            settings.roulette = *roulette.get_ref();
            let problem = "roulette is outside [0, 1); give the probability of stopping";
            self.require((0.0..1.0).contains(&settings.roulette), roulette.span(), problem)?;
        }
        if let Some(bounces) = &raw.max_bounces {
            settings.max_bounces = u32::try_from(*bounces.get_ref()).ok();
            let problem = "max_bounces is out of range; give 0 or more, or -1 for unbounded";
            let in_range = *bounces.get_ref() == -1 || settings.max_bounces.is_some();
            self.require(in_range, bounces.span(), problem)?;
            let problem = "unbounded paths need roulette above 0; set it, or a bound";
            let ends = settings.max_bounces.is_some() || settings.roulette > 0.0;
            self.require(ends, bounces.span(), problem)?;
        }
        Ok(settings)
    }

    fn mesh(&self, raw: &RawMesh) -> Result<MeshEntry, SceneError> {
        let scale = match &raw.scale {
            None => DVec3::ONE,
            Some(scale) => {
                let values = match *scale.get_ref().as_slice() {
                    [one] => [one; 3],
                    [x, y, z] => [x, y, z],
                    _ => {
                        let problem = "scale needs one number, or three; correct it";
                        return Err(self.refuse(&scale.span(), problem.into()));
                    }
                };
                let values = self.vector("scale", &Spanned::new(scale.span(), values))?;
                let problem = "scale flattens the mesh; give numbers other than 0";
                self.require(values.cmpne(DVec3::ZERO).all(), scale.span(), problem)?;
                values
            }
        };
        let vector = |key, value: &Option<Spanned<[f64; 3]>>| match value {
            Some(value) => self.vector(key, value),
            None => Ok(DVec3::ZERO),
        };
        Ok(MeshEntry {
            path: self.beside(raw.file.get_ref()),
            location: self.location(&raw.file.span()),
            transform: Transform::new(scale, vector("rotate", &raw.rotate)?, vector("translate", &raw.translate)?),
        })
    }

    /// A file that is named at `file`, beside the scene file.
    fn image(&self, file: &Spanned<String>) -> ImageFile {
        ImageFile::file(self.beside(file.get_ref()), self.location(&file.span()))
    }

    fn material(&self, material: &Spanned<String>, raw: &RawMaterial) -> Result<Override, SceneError> {
        let mut definition = Definition::at(self.location(&material.span()));
        let numeric = [
            ("Kd", &raw.Kd),
            ("Ks", &raw.Ks),
            ("Ke", &raw.Ke),
            ("Tf", &raw.Tf),
            ("Ns", &raw.Ns),
            ("Ni", &raw.Ni),
            ("illum", &raw.illum),
            ("Pr", &raw.Pr),
            ("Pm", &raw.Pm),
            ("Pc", &raw.Pc),
            ("Pcr", &raw.Pcr),
            ("d", &raw.d),
        ];
        for (key, value) in numeric {
            let Some(value) = value else { continue };
            let location = self.location(&value.span());
            definition.set(key, value.get_ref().as_slice(), &location).map_err(|problem| location.refuse(problem))?;
        }
        if let Some(file) = &raw.map_Kd {
            // An empty name takes the image of the MTL file away.
            definition.set_diffuse_image((!file.get_ref().is_empty()).then(|| self.image(file)));
        }
        Ok(Override { name: name(material.get_ref()), definition })
    }

    fn environment(&self, table: &Spanned<RawEnvironment>) -> Result<Environment, SceneError> {
        let raw = table.get_ref();
        match (&raw.radiance, &raw.file) {
            (Some(radiance), None) => {
                if let Some(scale) = &raw.scale {
                    let problem = "scale goes with file only; multiply radiance instead";
                    return Err(self.refuse(&scale.span(), problem.into()));
                }
                let value = Vec3::from(radiance.get_ref().map(|x| x as f32));
                let problem = "radiance is negative or not finite; give numbers of 0 or more";
                let in_range = value.is_finite() && value.min_element() >= 0.0;
                self.require(in_range, radiance.span(), problem)?;
                Ok(Environment::Constant(value))
            }
            (None, Some(file)) => {
                let scale = raw.scale.as_ref().map_or(1.0, |scale| *scale.get_ref() as f32);
                let span = raw.scale.as_ref().map_or(0..0, Spanned::span);
                let problem = "scale is negative or not finite; give a number of 0 or more";
                self.require(scale.is_finite() && scale >= 0.0, span, problem)?;
                let (image, rotation) = (self.image(file), DMat3::IDENTITY);
                Ok(Environment::LatLong { image, scale, rotation, has_rows_at_poles: false })
            }
            (Some(_), Some(file)) => {
                let problem = "file and radiance exclude each other; remove one";
                Err(self.refuse(&file.span(), problem.into()))
            }
            (None, None) => {
                let problem = "an [environment] needs radiance or file; add one of them";
                Err(self.refuse(&table.span(), problem.into()))
            }
        }
    }
}
