//! Sensors, films, samplers and integrators.

use glam::DAffine3;

use super::{Importer, xml::Object};
use crate::scene::{Camera, error::SceneError, text::excerpt};
use crate::settings::Filter;
use crate::settings::{Integrator, MAX_SAMPLES, RouletteMode, Sampler};

/// The probability with which a path ends that has lost nothing, past `rr_depth`, as Mitsuba has it.
const ROULETTE: f64 = 0.05;

impl Importer<'_, '_, '_> {
    /// Takes camera, image size and samples of a sensor.
    pub fn sensor(&mut self, place: usize) -> Result<(), SceneError> {
        let document = self.document;
        let object = &document.objects[place];
        if !matches!(&*object.plugin, "perspective" | "thinlens" | "orthographic") {
            self.unsupported(object);
            return Ok(());
        }
        // Its rays begin at the eye, and there is no shutter.
        object.ignore(&["near_clip", "shutter_open", "shutter_close"]);
        let film = document.children_of(object, "film").next();
        let (mut width, mut height) = (768, 576);
        if let Some(film) = film {
            (width, height) = self.film(&document.objects[film])?;
        }
        (self.import.settings.width, self.import.settings.height) = (width, height);
        self.import.settings.samples = 4;
        if let Some(sampler) = document.children_of(object, "sampler").next() {
            self.sampler(&document.objects[sampler])?;
        }
        let aspect = f64::from(width) / f64::from(height);
        let DAffine3 { matrix3, translation: eye } = object.transform("to_world")?.unwrap_or(DAffine3::IDENTITY);
        let (Some(along), Some(up)) = (matrix3.z_axis.try_normalize(), matrix3.y_axis.try_normalize()) else {
            return Err(object.at("to_world").refuse("`to_world` flattens the camera; correct it"));
        };
        if matrix3.determinant() < 0.0 {
            let text = "the camera mirrors its image; it is shown as it is";
            self.note("mirrored camera", object.at("to_world"), text);
        }
        let far = object.float("far_clip", 1e4)?;
        let focus = object.float_in("focus_distance", far, f64::MIN_POSITIVE..=1e30, "a distance above 0")?;
        let mut camera =
            Camera { eye, target: eye + along, up, vfov: 45.0, orthographic: None, aperture: 0.0, focus: 1.0 };
        match &*object.plugin {
            "orthographic" => {
                let (x, y) = (matrix3.x_axis.length(), matrix3.y_axis.length());
                if (x / y - 1.0).abs() > 1e-4 {
                    let text = "the camera scales x and y by different factors; that of y is taken";
                    self.note("scale of a camera", object.at("to_world"), text);
                }
                camera.orthographic = Some(2.0 * y / aspect);
            }
            plugin => {
                camera.vfov = self.vfov(object, aspect)?;
                if plugin == "thinlens" {
                    camera.aperture = object.float_in("aperture_radius", 0.0, 0.0..=1e30, "a radius of 0 or more")?;
                    camera.focus = focus;
                    camera.target = eye + focus * along;
                }
            }
        }
        for name in ["principal_point_offset_x", "principal_point_offset_y"] {
            if object.float(name, 0.0)? != 0.0 {
                self.note("principal point", object.at(name), "the principal point is taken to be the centre");
            }
        }
        if !(camera.target - camera.eye).is_finite() || camera.target == camera.eye {
            return Err(object.at("to_world").refuse("the camera is too far off for its direction; move the scene"));
        }
        self.import.camera = Some(camera);
        Ok(())
    }

    /// The vertical field of view in degrees.
    fn vfov(&mut self, object: &Object, aspect: f64) -> Result<f64, SceneError> {
        let axes = ["x", "y", "diagonal", "smaller", "larger"];
        let (fov, axis) = if object.has("fov") {
            (object.float("fov", 0.0)?, object.choice("fov_axis", &axes)?)
        } else {
            // Of the diagonal of 24 x 36 mm.
            let text = object.text("focal_length")?.unwrap_or("50mm");
            let length = text.trim().trim_end_matches("mm").parse().ok().filter(|length: &f64| *length > 0.0);
            let Some(length) = length else {
                let problem = format!("`{}` is no focal length; write it as 50mm", excerpt(text));
                return Err(object.at("focal_length").refuse(problem));
            };
            object.ignore(&["fov_axis"]);
            (2.0 * libm::atan(36_f64.hypot(24.0) / (2.0 * length)).to_degrees(), "diagonal")
        };
        if !(fov > 0.0 && fov < 180.0) {
            return Err(object.at("fov").refuse("fov is outside (0, 180); give degrees between them"));
        }
        let half = libm::tan((0.5 * fov).to_radians());
        // The tangent of half of the vertical angle.
        let vertical = match axis {
            "y" => half,
            "smaller" if aspect > 1.0 => half,
            "larger" if aspect <= 1.0 => half,
            "diagonal" => half / aspect.hypot(1.0),
            _ => half / aspect,
        };
        Ok(2.0 * libm::atan(vertical).to_degrees())
    }

    /// Width and height of the image, pixels.
    fn film(&mut self, object: &Object) -> Result<(u32, u32), SceneError> {
        const LARGEST: i64 = 65536;
        if object.plugin != "hdrfilm" {
            self.unsupported(object);
        }
        let mut size = [768, 576];
        for (slot, name) in size.iter_mut().zip(["width", "height"]) {
            let pixels = object.integer(name, i64::from(*slot))?;
            if !(1..=LARGEST).contains(&pixels) {
                let problem = format!("{name} is outside 1 to {LARGEST}; give pixels between them");
                return Err(object.at(name).refuse(problem));
            }
            *slot = pixels as u32;
        }
        let crops = ["crop_width", "crop_height", "crop_offset_x", "crop_offset_y"];
        if let Some(crop) = crops.iter().find(|crop| object.has(crop)) {
            self.note("crop", object.at(crop), "the whole image is rendered, not a crop of it");
        }
        object.ignore(&crops);
        object.ignore(&["file_format", "pixel_format", "component_format", "sample_border", "compensate", "banner"]);
        let document = self.document;
        let filter = document.children_of(object, "rfilter").next().map(|place| &document.objects[place]);
        filter.iter().for_each(|filter| filter.ignore(&["radius", "lobes", "B", "C"]));
        let (name, location) = filter.map_or(("gaussian", &object.location), |f| (&*f.plugin, &f.location));
        let deviation = filter.map_or(Ok(0.5), |filter| filter.float("stddev", 0.5))?;
        self.import.settings.filter = if name == "gaussian" { Filter::Gaussian } else { Filter::Box };
        if name != "box" && (name != "gaussian" || deviation != 0.5) {
            let text =
                format!("the filter of pixels is a box here, or a Gaussian of 0.5 pixels, not `{}`", excerpt(name));
            self.note("pixel filter", location, text);
        }
        Ok((size[0], size[1]))
    }

    fn sampler(&mut self, object: &Object) -> Result<(), SceneError> {
        let samples = object.integer("sample_count", 4)?;
        let in_range = u32::try_from(samples).ok().filter(|count| (1..=MAX_SAMPLES).contains(count));
        let Some(count) = in_range else {
            let problem = format!("{samples} samples; give 1 to {MAX_SAMPLES}");
            return Err(object.at("sample_count").refuse(problem));
        };
        object.ignore(&["seed", "jitter"]);
        self.import.settings.samples = count;
        self.import.settings.sampler = match &*object.plugin {
            "independent" => Sampler::Independent,
            // All others are stratified.
            _ => Sampler::Sobol,
        };
        Ok(())
    }

    /// Takes the length of paths of an integrator.
    pub fn integrator(&mut self, place: usize, depth: u32) -> Result<(), SceneError> {
        let document = self.document;
        let object = &document.objects[place];
        object.ignore(&["block_size", "samples_per_pass", "timeout"]);
        let nested = document.children_of(object, "integrator").next();
        match &*object.plugin {
            "path" | "volpath" | "volpathmis" | "prb" | "prbvolpath" => {
                let depth = object.integer("max_depth", -1)?;
                let from = object.integer("rr_depth", 5)?;
                let settings = &mut self.import.settings;
                settings.integrator = Integrator::Mis;
                settings.max_bounces = u32::try_from((depth - 1).max(0)).ok().filter(|_| depth >= 0);
                settings.roulette = ROULETTE;
                settings.roulette_mode = RouletteMode::Throughput;
                settings.roulette_from = u32::try_from((from - 1).max(0)).unwrap_or(u32::MAX);
                if depth == 0 {
                    self.note("no light", object.at("max_depth"), "a max_depth of 0 shows nothing; 1 is taken");
                }
            }
            "direct" => {
                object.ignore(&["shading_samples", "emitter_samples", "bsdf_samples"]);
                self.import.settings.integrator = Integrator::Mis;
                self.import.settings.max_bounces = Some(1);
            }
            "moment" | "aov" | "stokes" if nested.is_some() && depth < 8 => {
                if object.plugin != "moment" {
                    let text = format!("of `{}` the image is rendered and nothing beside it", object.plugin);
                    self.note("outputs", &object.location, text);
                    object.ignore(&["aovs", "img"]);
                }
                return self.integrator(nested.unwrap_or(place), depth + 1);
            }
            _ => self.unsupported(object),
        }
        if object.boolean("hide_emitters", false)? {
            self.note("hidden emitters", object.at("hide_emitters"), "emitters are seen, hidden or not");
        }
        Ok(())
    }
}
