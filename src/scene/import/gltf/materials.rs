//! glTF's materials by their physics.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{Affine2, Mat2, Vec2, Vec3};

use super::data::{Data, Place, resolve};
use super::json;
use crate::scene::{
    self, Lookup, Parameter, Surface, Wrap,
    error::Location,
    import::{ImageFile, ImageSource, Import, Map, Material, Response},
    sources::{Sources, Warning},
    text::{excerpt, name},
};

/// The materials and images of a file as far as they are imported.
#[derive(Default)]
pub(super) struct Materials {
    known: HashMap<Option<usize>, Imported>,
    images: HashMap<usize, Option<usize>>,
    /// Where light goes on as it came.
    nothing: Option<u32>,
}

/// A material that is imported.
#[derive(Debug, Clone, Copy)]
pub(super) struct Imported {
    /// Its index in [`Import::materials`].
    pub index: u32,
    /// Which set of texture coordinates its images lie by.
    pub coordinates: usize,
    /// Whether it lets light through by its alpha.
    pub has_alpha: bool,
}

/// What the import of a material needs.
pub(super) struct Context<'a, 'b> {
    pub path: &'a Path,
    pub data: &'a Data<'a>,
    pub sources: &'a mut Sources<'b>,
    pub import: &'a mut Import,
}

impl Context<'_, '_> {
    pub fn note(&mut self, kind: &'static str, text: impl Into<String>) {
        let location = Location::file(self.path);
        self.sources.note(&Warning { kind, location, text: text.into() });
    }

    fn add(&mut self, optics: scene::Material, maps: &[(Parameter, Option<Map>)]) -> u32 {
        let mut material = Material::named(&optics.name);
        material.location = Some(Location::file(self.path));
        material.optics = optics;
        for (parameter, map) in maps {
            if map.is_some() {
                material.set_map(*parameter, *map);
            }
        }
        self.import.materials.push(material);
        self.import.materials.len() as u32 - 1
    }
}

/// The images of one material: they lie by one set of texture coordinates.
struct Images<'a> {
    materials: &'a mut Materials,
    material: String,
    coordinates: Option<usize>,
}

impl Images<'_> {
    /// What an image gives; `None` where there is none that can be shown.
    fn map(&mut self, info: Option<&json::TextureInfo>, context: &mut Context<'_, '_>) -> Result<Option<Map>, String> {
        let Some(info) = info else { return Ok(None) };
        let document = context.data.document;
        let missing =
            |what: &str, index: usize| format!("material `{}` names {what} {index}, which is not there", self.material);
        let texture =
            document.textures.get(info.index).ok_or_else(|| missing("texture", info.index) + "; export it anew")?;
        let Some(source) = texture.source.or(texture.extensions.webp.as_ref().map(|webp| webp.source)) else {
            context.note(
                "texture without image",
                "a texture has no image in a format that is read; the constant is shown",
            );
            return Ok(None);
        };
        let transform = info.extensions.transform.as_ref();
        let coordinates = transform.and_then(|transform| transform.tex_coord).unwrap_or(info.tex_coord);
        if *self.coordinates.get_or_insert(coordinates) != coordinates {
            let text = format!(
                "images of `{}` lie by several sets of texture coordinates; those of another set than the first show the \
                 constant",
                excerpt(&self.material)
            );
            context.note("sets of texture coordinates", text);
            return Ok(None);
        }
        let sampler = match texture.sampler {
            Some(index) => {
                Some(document.samplers.get(index).ok_or_else(|| missing("sampler", index) + "; export it anew")?)
            }
            None => None,
        };
        let wrap = |code: Option<u32>| match code {
            Some(33071) => Wrap::Clamp,
            Some(33648) => Wrap::Mirror,
            _ => Wrap::Repeat,
        };
        let wraps = [sampler.and_then(|sampler| sampler.wrap_s), sampler.and_then(|sampler| sampler.wrap_t)].map(wrap);
        if wraps[0] != wraps[1] {
            context.note(
                "wrapping of two kinds",
                "an image wraps differently along u and v; along both it wraps as along u",
            );
        }
        let lookup = Lookup {
            transform: transform.map_or(Affine2::IDENTITY, flipped),
            wrap: wraps[0],
            // 9728 is the nearest texel.
            is_smooth: sampler.and_then(|sampler| sampler.mag_filter) != Some(9728),
        };
        let lookup = match lookup.transform.is_finite() {
            true => lookup,
            false => return Err("a texture transform is not finite; correct it".to_owned()),
        };
        let image = match self.materials.images.get(&source) {
            Some(known) => *known,
            None => image(source, context)?,
        };
        self.materials.images.insert(source, image);
        Ok(image.map(|image| Map { lookup, ..Map::colour(image) }))
    }
}

/// The index of an image in [`Import::images`]; `None` where it cannot be shown.
fn image(index: usize, context: &mut Context<'_, '_>) -> Result<Option<usize>, String> {
    let document = context.data.document;
    let image = document.images.get(index).ok_or_else(|| format!("no image {index}; export it anew"))?;
    let location = Location::file(context.path);
    let inside = || PathBuf::from(format!("{} image {index}", context.path.to_string_lossy()));
    let of_bytes = |bytes: &[u8]| ImageFile {
        path: inside(),
        location: location.clone(),
        source: ImageSource::Bytes(bytes.into()),
    };
    let file = match (&image.uri, image.buffer_view) {
        (Some(uri), _) => match resolve(uri, context.path, context.sources) {
            Ok(Place::File(file)) => {
                return Ok(Some(context.import.images.index_of(&ImageFile::file(file, location))));
            }
            Ok(Place::Bytes(bytes)) => of_bytes(&bytes),
            Err(problem) => {
                context.note("image of a bad URI", format!("{problem}; the constant is shown"));
                return Ok(None);
            }
        },
        (None, Some(view)) => of_bytes(context.data.view(view)?),
        (None, None) => {
            context.note("image without data", "an image has neither a URI nor a buffer view; the constant is shown");
            return Ok(None);
        }
    };
    Ok(Some(context.import.images.add(file)))
}

/// KHR_texture_transform, which scales, turns and moves coordinates of which v grows downwards, for such of which it grows
/// upwards.
fn flipped(transform: &json::TextureTransform) -> Affine2 {
    let vector = |values: [f64; 2]| Vec2::from(values.map(|value| value as f32));
    // Counter-clockwise for the eye, so clockwise where v grows downwards.
    let turned = Mat2::from_angle(-transform.rotation as f32);
    let scaled = Mat2::from_diagonal(vector(transform.scale.unwrap_or([1.0; 2])));
    let map = Affine2::from_mat2_translation(turned * scaled, vector(transform.offset));
    let flip = Affine2::from_mat2_translation(Mat2::from_diagonal(Vec2::new(1.0, -1.0)), Vec2::Y);
    flip * map * flip
}

/// A colour in range.
fn colour(values: [f64; 3]) -> Vec3 {
    Vec3::from(values.map(|value| value as f32))
}

impl Materials {
    /// Imports a material, or glTF's default one, once.
    pub fn of(&mut self, index: Option<usize>, context: &mut Context<'_, '_>) -> Result<Imported, String> {
        if let Some(known) = self.known.get(&index) {
            return Ok(*known);
        }
        let default = json::Material::default();
        let (described, called) = match index {
            None => (&default, "default".to_owned()),
            Some(index) => {
                let material = context.data.document.materials.get(index);
                let material = material.ok_or_else(|| format!("no material {index}; export it anew"))?;
                let called = material.name.as_deref().map(name).filter(|called| !called.is_empty());
                (material, called.unwrap_or_else(|| format!("material {index}")))
            }
        };
        let imported = self.add(described, &called, context)?;
        self.known.insert(index, imported);
        Ok(imported)
    }

    fn add(
        &mut self,
        described: &json::Material,
        called: &str,
        context: &mut Context<'_, '_>,
    ) -> Result<Imported, String> {
        let json::Material { pbr_metallic_roughness: pbr, extensions, .. } = described;
        let mut out_of_range = false;
        let mut share = |value: f64| {
            let clamped = value.clamp(0.0, 1.0);
            out_of_range |= clamped != value;
            clamped as f32
        };
        let [red, green, blue, alpha] = pbr.base_color_factor.unwrap_or([1.0; 4]).map(&mut share);
        let base = Vec3::new(red, green, blue);
        let metalness = share(pbr.metallic_factor.unwrap_or(1.0));
        let roughness = share(pbr.roughness_factor.unwrap_or(1.0));
        let transmission = extensions.transmission.as_ref().map_or(0.0, |it| share(it.transmission_factor));
        let coat = extensions.clearcoat.as_ref();
        let (coat, coat_roughness) =
            coat.map_or((0.0, 0.0), |it| (share(it.clearcoat_factor), share(it.clearcoat_roughness_factor)));
        let specular = extensions.specular.as_ref().map_or(Vec3::ONE, |it| {
            let factor = it.specular_factor;
            Vec3::from(it.specular_color_factor.map(|value| share(value * factor)))
        });
        let strength = extensions.emissive_strength.as_ref().and_then(|it| it.emissive_strength).unwrap_or(1.0);
        let emission = colour(described.emissive_factor.map(|value| value * strength));
        if !(emission.is_finite() && emission.min_element() >= 0.0) {
            return Err(format!("the emission of `{}` is negative or not finite; correct it", excerpt(called)));
        }
        let ior = extensions.ior.as_ref().and_then(|it| it.ior).unwrap_or(1.5) as f32;
        let ior = if ior.is_finite() && ior >= 1.0 {
            ior
        } else {
            let text = format!(
                "`{}` has an index of refraction of {ior}, which is not at least 1; 1.5 is taken",
                excerpt(called)
            );
            context.note("index of refraction", text);
            1.5
        };
        if out_of_range {
            let text = format!("factors of `{}` are outside of 0 to 1; they are clamped", excerpt(called));
            context.note("factors", text);
        }

        let mut images = Images { materials: self, material: called.to_owned(), coordinates: None };
        let base_image = images.map(pbr.base_color_texture.as_ref(), context)?;
        let metal_image = images.map(pbr.metallic_roughness_texture.as_ref(), context)?;
        let normal_image = images.map(described.normal_texture.as_ref(), context)?;
        let emission_image = images.map(described.emissive_texture.as_ref(), context)?;
        let transmission_image =
            images.map(extensions.transmission.as_ref().and_then(|it| it.transmission_texture.as_ref()), context)?;
        let specular_image =
            images.map(extensions.specular.as_ref().and_then(|it| it.specular_color_texture.as_ref()), context)?;
        let coordinates = images.coordinates.unwrap_or(0);
        note_what_is_not_shown(described, called, context);

        let raw = |map: Option<Map>, channel: usize, factor: f32| {
            map.map(|map| Map { is_raw: true, channel, factor: Vec3::splat(factor), ..map })
        };
        let roughness_map = raw(metal_image, 1, roughness).map(|map| Map { response: Response::Squared, ..map });
        // The scale multiplies the coordinates along the surface. Where it is above 1 the other one is divided by it: the
        // direction is the same, and coordinates stay within [-1, 1].
        let scale = described.normal_texture.as_ref().and_then(|it| it.scale).unwrap_or(1.0) as f32;
        let scale = if scale.is_finite() { scale } else { 1.0 };
        let factor = Vec3::new(scale, scale, 1.0) / scale.abs().max(1.0);
        let normal_map = normal_image.map(|map| Map { is_raw: true, factor, ..map });
        let emission_map = emission_image.map(|map| Map { factor: emission, ..map });
        let base_map = base_image.map(|map| Map { factor: base, ..map });

        let optics = |surface: scene::Material, called: &str| scene::Material { name: called.to_owned(), ..surface };
        let mut index = if extensions.unlit.is_some() {
            // What it looks like is what it gives.
            let light = optics(scene::Material::emitter(base), called);
            context.add(light, &[(Parameter::Emission, base_map)])
        } else {
            let alpha = roughness * roughness;
            let is_black = base == Vec3::ZERO && metalness == 0.0;
            let mut widths = Vec2::splat(alpha);
            if let Some(anisotropy) = &extensions.anisotropy {
                let strength = (anisotropy.anisotropy_strength as f32).clamp(0.0, 1.0);
                widths.x = alpha + (1.0 - alpha) * strength * strength;
            }
            let shared = |surface: scene::Material, called: &str| scene::Material {
                emission,
                is_pure_emitter: false,
                roughness: widths,
                ..optics(surface, called)
            };
            let opaque = |context: &mut Context<'_, '_>| {
                let surface = scene::Material {
                    specular,
                    ior,
                    coat,
                    coat_roughness: coat_roughness * coat_roughness,
                    is_pure_emitter: is_black,
                    ..shared(scene::Material::metal_rough(base, metalness, alpha), called)
                };
                let maps = [
                    (Parameter::Diffuse, base_map),
                    (Parameter::Metalness, raw(metal_image, 2, metalness)),
                    (Parameter::Roughness, roughness_map),
                    (Parameter::Specular, specular_image.map(|map| Map { factor: specular, ..map })),
                    (Parameter::Normal, normal_map),
                    (Parameter::Emission, emission_map),
                ];
                context.add(surface, &maps)
            };
            // Metal lets no light through; how much of it there is an image says, where there is one.
            let transmission = transmission * if metal_image.is_some() { 1.0 } else { 1.0 - metalness };
            if transmission == 0.0 {
                opaque(context)
            } else {
                let is_whole = transmission == 1.0 && transmission_image.is_none();
                let called_glass = if is_whole { called.to_owned() } else { format!("{called} (transmission)") };
                let is_solid = extensions.volume.as_ref().is_some_and(|volume| volume.thickness_factor > 0.0);
                let is_thin = !is_solid && roughness == 0.0 && metal_image.is_none();
                if !is_solid && !is_thin {
                    let text = format!("`{}` is thin and rough; it is shown as a solid of its index", excerpt(called));
                    context.note("thin rough glass", text);
                }
                if base_image.is_some() {
                    let text =
                        format!("the image of `{}` does not tint what it transmits; the factor does", excerpt(called));
                    context.note("image of transmission", text);
                }
                let glass = scene::Material {
                    surface: if is_thin { Surface::ThinDielectric } else { Surface::Dielectric },
                    transmission: base,
                    ..shared(scene::Material::dielectric(ior), &called_glass)
                };
                let maps = [
                    (Parameter::Roughness, roughness_map),
                    (Parameter::Normal, normal_map),
                    (Parameter::Emission, emission_map),
                ];
                let glass = context.add(glass, &maps);
                if is_whole {
                    glass
                } else {
                    let opaque = opaque(context);
                    let mixed = scene::Material {
                        surface: Surface::Blend(glass, opaque),
                        weight: transmission,
                        ..optics(scene::Material::diffuse(Vec3::ZERO), &format!("{called} (mixed)"))
                    };
                    context.add(mixed, &[(Parameter::Weight, raw(transmission_image, 0, transmission))])
                }
            }
        };

        let cutoff = match described.alpha_mode.as_deref() {
            None | Some("OPAQUE") => return Ok(Imported { index, coordinates, has_alpha: false }),
            Some("MASK") => Some(described.alpha_cutoff.unwrap_or(0.5) as f32),
            Some("BLEND") => None,
            Some(mode) => {
                let text = format!("`{}` has the unknown alpha mode {}; it is opaque", excerpt(called), excerpt(mode));
                context.note("alpha mode", text);
                return Ok(Imported { index, coordinates, has_alpha: false });
            }
        };
        let response = cutoff.map_or(Response::Linear, Response::Cutoff);
        if base_image.is_some() || response.of(alpha) < 1.0 {
            let nothing = *self.nothing.get_or_insert_with(|| {
                let nothing = scene::Material { surface: Surface::Nothing, ..scene::Material::diffuse(Vec3::ZERO) };
                context.add(optics(nothing, "(nothing)"), &[])
            });
            let covered = scene::Material {
                surface: Surface::Blend(index, nothing),
                weight: response.of(alpha),
                ..optics(scene::Material::diffuse(Vec3::ZERO), &format!("{called} (alpha)"))
            };
            // Alpha is never sRGB, whatever the colours beside it are.
            let map = base_image.map(|map| Map { channel: 3, factor: Vec3::splat(alpha), response, ..map });
            index = context.add(covered, &[(Parameter::Weight, map)]);
        }
        Ok(Imported { index, coordinates, has_alpha: true })
    }
}

/// Tells which parts of a material are left out.
fn note_what_is_not_shown(described: &json::Material, called: &str, context: &mut Context<'_, '_>) {
    let extensions = &described.extensions;
    let called = excerpt(called);
    let coat = extensions.clearcoat.as_ref();
    let anisotropy = extensions.anisotropy.as_ref();
    let attenuates = |volume: &json::Volume| {
        volume.thickness_factor > 0.0 && volume.attenuation_distance.is_some() && volume.attenuation_color != [1.0; 3]
    };
    let lacks = [
        (
            "images of clear coats",
            coat.is_some_and(|coat| {
                let images =
                    [&coat.clearcoat_texture, &coat.clearcoat_roughness_texture, &coat.clearcoat_normal_texture];
                images.iter().any(|image| image.is_some())
            }),
            "images of its clear coat",
        ),
        (
            "directions of anisotropy",
            anisotropy.is_some_and(|it| it.anisotropy_texture.is_some() || it.anisotropy_rotation != 0.0),
            "the rotation and the image of its anisotropy",
        ),
        (
            "images of specular weights",
            extensions.specular.as_ref().is_some_and(|it| it.specular_texture.is_some()),
            "the image of its specular weight",
        ),
        ("absorption", extensions.volume.as_ref().is_some_and(attenuates), "the absorption inside it"),
    ];
    for (kind, is_lacking, what) in lacks {
        if is_lacking {
            context.note(kind, format!("`{called}` is shown without {what}"));
        }
    }
}
