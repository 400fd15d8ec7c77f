//! What properties give: constants, or images.

use glam::{Affine2, DVec3, Mat2, Vec2, Vec3};

use super::{
    Importer,
    spectra::Role,
    xml::{Object, Value},
};
use crate::scene::{
    Lookup, Wrap,
    error::{Location, SceneError},
    import::{ImageFile, ImageSource, LUMINANCE, Map, Response},
    text::excerpt,
};

/// A constant or an image.
#[derive(Debug, Clone, Copy)]
pub(super) enum Given<T> {
    Constant(T),
    Image(Map),
}

impl Importer<'_, '_, '_> {
    /// The colour that a property gives.
    pub fn colour(&mut self, object: &Object, name: &str, default: f64, role: Role) -> Result<Given<Vec3>, SceneError> {
        let given = self.given(object, name, default, role, false)?;
        Ok(match given {
            Given::Constant(colour) => Given::Constant(colour.as_vec3()),
            Given::Image(map) => Given::Image(map),
        })
    }

    /// A colour that no image can give.
    pub fn constant_colour(
        &mut self,
        object: &Object,
        name: &str,
        default: f64,
        role: Role,
    ) -> Result<Vec3, SceneError> {
        match self.colour(object, name, default, role)? {
            Given::Constant(colour) => Ok(colour),
            Given::Image(_) => {
                let text = format!("`{name}` of {} takes no image here; {default} is taken", excerpt(&object.plugin));
                self.note("image for a constant", object.at(name), text);
                Ok(Vec3::splat(default as f32))
            }
        }
    }

    /// The number that a property gives.
    pub fn scalar(&mut self, object: &Object, name: &str, default: f64) -> Result<Given<f32>, SceneError> {
        let given = self.given(object, name, default, Role::Unbounded, true)?;
        Ok(match given {
            Given::Constant(colour) => Given::Constant((colour.element_sum() / 3.0) as f32),
            Given::Image(map) => Given::Image(map),
        })
    }

    fn given(
        &mut self,
        object: &Object,
        name: &str,
        default: f64,
        role: Role,
        is_scalar: bool,
    ) -> Result<Given<DVec3>, SceneError> {
        let Some((value, location)) = object.value(name) else { return Ok(Given::Constant(DVec3::splat(default))) };
        let colour = match value {
            Value::Float(value) => DVec3::splat(*value),
            Value::Integer(value) => DVec3::splat(*value as f64),
            Value::Rgb(colour) | Value::Vector(colour) => *colour,
            Value::Spectrum(spectrum) => spectrum.rgb(role),
            Value::Object(place) => return self.texture(*place, role, is_scalar),
            _ => {
                let plugin = excerpt(&object.plugin);
                return Err(
                    location.refuse(format!("`{name}` of {plugin} is no colour; give an rgb, a float or a texture"))
                );
            }
        };
        checked(colour, name, role, location).map(Given::Constant)
    }

    /// What a texture gives; images of numbers give them by their luminance.
    pub fn texture(&mut self, place: usize, role: Role, is_scalar: bool) -> Result<Given<DVec3>, SceneError> {
        let document = self.document;
        let object = &document.objects[place];
        if object.tag != "texture" {
            return Err(object.location.refuse(format!("a {} where a texture is to be; correct it", object.tag)));
        }
        match &*object.plugin {
            "bitmap" => self.bitmap(object).map(Given::Image),
            "checkerboard" => self.checkerboard(place, role, is_scalar).map(Given::Image),
            "rawconstant" | "uniform" => self.given(object, "value", 1.0, Role::Unbounded, is_scalar),
            "srgb" => self.given(object, "color", 1.0, role, is_scalar),
            "d65" => {
                let scale = object.float("scale", 1.0)?;
                Ok(match self.given(object, "color", 1.0, Role::Emission, is_scalar)? {
                    Given::Constant(colour) => Given::Constant(colour * scale),
                    Given::Image(map) => Given::Image(Map { factor: map.factor * scale as f32, ..map }),
                })
            }
            _ => {
                self.unsupported(object);
                Ok(Given::Constant(DVec3::splat(0.5)))
            }
        }
    }

    fn bitmap(&mut self, object: &Object) -> Result<Map, SceneError> {
        let path = object.file(self.sources)?;
        object.ignore(&["format", "accel"]);
        let image = self.import.images.index_of(&ImageFile::file(path, object.at("filename").clone()));
        let wrap = match object.choice("wrap_mode", &["repeat", "mirror", "clamp"])? {
            "mirror" => Wrap::Mirror,
            "clamp" => Wrap::Clamp,
            _ => Wrap::Repeat,
        };
        let is_smooth = object.choice("filter_type", &["bilinear", "nearest"])? == "bilinear";
        let lookup = Lookup { transform: to_uv(object)?, wrap, is_smooth };
        let is_raw = object.boolean("raw", false)?;
        Ok(Map { image, lookup, is_raw, channel: LUMINANCE, factor: Vec3::ONE, response: Response::Linear })
    }

    /// Squares of half a unit in two colours. Where it gives numbers Mitsuba takes the other one first.
    fn checkerboard(&mut self, place: usize, role: Role, is_scalar: bool) -> Result<Map, SceneError> {
        let document = self.document;
        let object = &document.objects[place];
        let mut colours = [Vec3::ZERO; 2];
        for (slot, (name, default)) in colours.iter_mut().zip([("color0", 0.4), ("color1", 0.2)]) {
            *slot = match self.given(object, name, default, role, is_scalar)? {
                Given::Constant(colour) => colour.as_vec3(),
                Given::Image(_) => {
                    let Some((Value::Object(inner), _)) = object.value(name) else { continue };
                    self.unsupported(&document.objects[*inner]);
                    continue;
                }
            };
        }
        if is_scalar {
            colours.swap(0, 1);
        }
        let [a, b] = colours.map(|colour| [colour.x, colour.y, colour.z, 1.0]);
        let image = self.texels(object, vec![a, b, b, a], 2);
        let lookup = Lookup { transform: to_uv(object)?, wrap: Wrap::Repeat, is_smooth: false };
        Ok(Map { lookup, ..self.plain(image) })
    }

    /// An image of a single texel.
    pub fn constant_image(&mut self, object: &Object, colour: Vec3) -> Map {
        let image = self.texels(object, vec![[colour.x, colour.y, colour.z, 1.0]], 1);
        self.plain(image)
    }

    fn texels(&mut self, object: &Object, texels: Vec<[f32; 4]>, width: u32) -> usize {
        let path = object.name().into();
        let known = self.import.images.files.iter().position(|image| {
            matches!(&image.source, ImageSource::Texels { texels: other, .. } if *other == texels && image.path == path)
        });
        known.unwrap_or_else(|| {
            let source = ImageSource::Texels { width, texels };
            self.import.images.add(ImageFile { path, location: object.location.clone(), source })
        })
    }

    fn plain(&self, image: usize) -> Map {
        let lookup = Lookup::default();
        Map { image, lookup, is_raw: true, channel: LUMINANCE, factor: Vec3::ONE, response: Response::Linear }
    }
}

/// A colour in the range of its role.
fn checked(colour: DVec3, name: &str, role: Role, location: &Location) -> Result<DVec3, SceneError> {
    let least = colour.min_element();
    if role == Role::Reflectance && !(least >= 0.0 && colour.max_element() <= 1.0) {
        return Err(location.refuse(format!("`{name}` is outside [0, 1]; nothing reflects more than it gets")));
    }
    if !(least >= 0.0 && colour.as_vec3().is_finite()) {
        return Err(location.refuse(format!("`{name}` is below 0 or beyond what floats hold; correct it")));
    }
    Ok(colour)
}

/// Takes texture coordinates of a surface to those of an image, whose row 0 is at v = 0 for Mitsuba and at v = 1 here.
fn to_uv(object: &Object) -> Result<Affine2, SceneError> {
    let mut transform = Affine2::from_cols(Vec2::X, Vec2::NEG_Y, Vec2::Y);
    if let Some(matrix) = object.matrix("to_uv")? {
        let [x, y, translation] =
            [matrix.x_axis, matrix.y_axis, matrix.w_axis].map(|axis| axis.truncate().truncate().as_vec2());
        transform *= Affine2::from_mat2_translation(Mat2::from_cols(x, y), translation);
    }
    match transform.is_finite() {
        true => Ok(transform),
        false => Err(object.at("to_uv").refuse("`to_uv` is beyond what floats hold; scale it down")),
    }
}
