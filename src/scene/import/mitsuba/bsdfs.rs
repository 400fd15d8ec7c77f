//! BSDFs to materials.

use glam::{Vec2, Vec3};

use super::{
    Importer,
    spectra::{INDICES, Role, complex_index, index_of_refraction, names},
    textures::Given,
    xml::{Object, Value},
};
use crate::constants::MAX_BLENDS;
use crate::scene::{
    self, Parameter, Surface,
    error::SceneError,
    import::{Map, Material, Response},
    text::excerpt,
};

/// What BSDFs around another one do to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(super) struct Around {
    /// The `bumpmap` or `normalmap`, by its place.
    turned_by: Option<usize>,
    /// Whether it is for both sides.
    is_two_sided: bool,
}

/// A surface that is yet to be described, with Mitsuba's defaults.
fn material(object: &Object, surface: Surface) -> Material {
    let mut material = Material::named(object.name());
    material.location = Some(object.location.clone());
    // Mitsuba loses light that microfacets scatter more than once.
    let black =
        scene::Material { compensates: false, name: object.name().to_owned(), ..scene::Material::diffuse(Vec3::ZERO) };
    material.optics = scene::Material { surface, ..black };
    material
}

/// Where a material keeps a share.
type Share = fn(&mut scene::Material) -> &mut f32;

impl Importer<'_, '_, '_> {
    /// The material of a BSDF.
    pub fn bsdf(&mut self, place: usize, around: Around, depth: u32) -> Result<u32, SceneError> {
        if let Some(known) = self.bsdfs.get(&(place, around)) {
            return Ok(*known);
        }
        let document = self.document;
        let object = &document.objects[place];
        if depth > MAX_BLENDS {
            let problem =
                format!("BSDFs are more than {MAX_BLENDS} deep in each other, or in themselves; take some out");
            return Err(object.location.refuse(problem));
        }
        let nested: Vec<usize> = document.children_of(object, "bsdf").collect();
        let nest = |importer: &mut Self, counts: &[usize], around: Around| -> Result<Vec<u32>, SceneError> {
            if !counts.contains(&nested.len()) {
                let plugin = excerpt(&object.plugin);
                let problem = format!("{plugin} has {} BSDFs in it; give it {}", nested.len(), counts[0]);
                return Err(object.location.refuse(problem));
            }
            nested.iter().map(|place| importer.bsdf(*place, around, depth + 1)).collect()
        };
        let index = match &*object.plugin {
            "twosided" => {
                object.ignore(&["allow_transmission"]);
                match nest(self, &[1, 2], Around { is_two_sided: true, ..around })?[..] {
                    [front, back] => self.add(material(object, Surface::Sides { front, back })),
                    ref one => one[0],
                }
            }
            "mask" => {
                let opaque = nest(self, &[1], around)?[0];
                let nothing = self.nothing(object);
                let mut blend = material(object, Surface::Blend(opaque, nothing));
                let weight = self.scalar(object, "opacity", 0.5)?;
                set_scalar(&mut blend, Parameter::Weight, weight, |optics, weight| {
                    optics.weight = weight.clamp(0.0, 1.0)
                });
                self.add(blend)
            }
            "blendbsdf" => {
                let parts = nest(self, &[2], around)?;
                // The weight is that of the second one.
                let mut blend = material(object, Surface::Blend(parts[1], parts[0]));
                let weight = self.scalar(object, "weight", 0.5)?;
                set_scalar(&mut blend, Parameter::Weight, weight, |optics, weight| {
                    optics.weight = weight.clamp(0.0, 1.0)
                });
                self.add(blend)
            }
            "bumpmap" | "normalmap" => {
                if around.turned_by.is_some() {
                    self.note(
                        "maps in maps",
                        &object.location,
                        "of bump and normal maps in each other the inner one counts",
                    );
                }
                nest(self, &[1], Around { turned_by: Some(place), ..around })?[0]
            }
            "null" => self.nothing(object),
            _ => {
                let mut leaf = self.leaf(object)?;
                if let Some(map) = around.turned_by {
                    self.turn(&mut leaf, map)?;
                }
                let reflects_only = !leaf.transmits();
                let front = self.add(leaf);
                match reflects_only && !around.is_two_sided {
                    true => {
                        let back = self.black(object);
                        self.add(material(object, Surface::Sides { front, back }))
                    }
                    false => front,
                }
            }
        };
        self.bsdfs.insert((place, around), index);
        Ok(index)
    }

    /// The material of a shape that names no BSDF.
    pub fn default_bsdf(&mut self, object: &Object, is_black: bool) -> u32 {
        if is_black {
            return self.black(object);
        }
        if let Some(known) = self.grey {
            return known;
        }
        let mut grey = material(object, Surface::Glossy);
        grey.optics.diffuse = Vec3::splat(0.5);
        let front = self.add(grey);
        let back = self.black(object);
        let index = self.add(material(object, Surface::Sides { front, back }));
        self.grey = Some(index);
        index
    }

    /// What reflects nothing.
    fn black(&mut self, object: &Object) -> u32 {
        if self.black.is_none() {
            self.black = Some(self.add(material(object, Surface::Glossy)));
        }
        self.black.unwrap_or_default()
    }

    /// No surface.
    fn nothing(&mut self, object: &Object) -> u32 {
        if self.nothing.is_none() {
            self.nothing = Some(self.add(material(object, Surface::Nothing)));
        }
        self.nothing.unwrap_or_default()
    }

    /// A material that also emits what an emitter of the kind `area` does.
    pub fn emitting(&mut self, base: u32, emitter: usize) -> Result<u32, SceneError> {
        if let Some(known) = self.emitting.get(&(base, emitter)) {
            return Ok(*known);
        }
        let document = self.document;
        let object = &document.objects[emitter];
        object.ignore(&["sampling_weight"]);
        let mut material = self.import.materials[base as usize].clone();
        material.optics.is_pure_emitter = Some(base) == self.black;
        match self.colour(object, "radiance", 1.0, Role::Emission)? {
            Given::Constant(radiance) => material.optics.emission = radiance,
            Given::Image(map) => {
                material.optics.emission = Vec3::ONE;
                material.set_map(Parameter::Emission, Some(map));
            }
        }
        let index = self.add(material);
        self.emitting.insert((base, emitter), index);
        Ok(index)
    }

    fn add(&mut self, material: Material) -> u32 {
        self.import.materials.push(material);
        self.import.materials.len() as u32 - 1
    }

    /// Turns the shading normals of a material by a `bumpmap` or a `normalmap`.
    fn turn(&mut self, leaf: &mut Material, place: usize) -> Result<(), SceneError> {
        let document = self.document;
        let object = &document.objects[place];
        object.ignore(&["flip_invalid_normals", "use_shadowing_function"]);
        let is_bump = object.plugin == "bumpmap";
        let texture = match is_bump {
            true => document.children_of(object, "texture").next(),
            false => match object.value("normalmap") {
                Some((Value::Object(texture), _)) => Some(*texture),
                _ => None,
            },
        };
        let Some(texture) = texture else {
            return Err(object.location.refuse(format!("{} has no texture; add one", object.plugin)));
        };
        let given = self.texture(texture, Role::Unbounded, is_bump)?;
        let map = match given {
            Given::Image(map) => map,
            // The same height everywhere turns nothing.
            Given::Constant(_) if is_bump => return Ok(()),
            Given::Constant(colour) => self.constant_image(&document.objects[texture], colour.as_vec3()),
        };
        if is_bump {
            let scale = object.float("scale", 1.0)? as f32;
            leaf.set_map(Parameter::Height, Some(Map { factor: map.factor * scale, ..map }));
        } else {
            // Mitsuba's second axis is n x s, which is against v once v is turned to grow upwards, unless the mesh is mirrored.
            let factor = map.factor * Vec3::new(1.0, -1.0, 1.0);
            leaf.set_map(Parameter::Normal, Some(Map { factor, ..map }));
        }
        Ok(())
    }

    /// A BSDF that has no others in it.
    fn leaf(&mut self, object: &Object) -> Result<Material, SceneError> {
        let mut leaf = material(object, Surface::Glossy);
        match &*object.plugin {
            "diffuse" => self.set_diffuse(&mut leaf, object, "reflectance")?,
            "dielectric" | "roughdielectric" | "thindielectric" => {
                leaf.optics.surface = match object.plugin == "thindielectric" {
                    true => Surface::ThinDielectric,
                    false => Surface::Dielectric,
                };
                leaf.optics.ior = index(object, "bk7")?;
                leaf.optics.transmission =
                    self.constant_colour(object, "specular_transmittance", 1.0, Role::Reflectance)?;
                let reflectance = self.constant_colour(object, "specular_reflectance", 1.0, Role::Reflectance)?;
                if reflectance != Vec3::ONE {
                    let text = "specular_reflectance of a dielectric is taken as 1";
                    self.note("reflectance of glass", object.at("specular_reflectance"), text);
                }
                if object.plugin == "roughdielectric" {
                    self.set_roughness(&mut leaf, object)?;
                }
            }
            "conductor" | "roughconductor" => self.set_conductor(&mut leaf, object)?,
            "plastic" | "roughplastic" => {
                leaf.optics.surface = Surface::Plastic { nonlinear: object.boolean("nonlinear", false)? };
                leaf.optics.ior = index(object, "polypropylene")?;
                self.set_diffuse(&mut leaf, object, "diffuse_reflectance")?;
                self.set_specular(&mut leaf, object)?;
                if object.plugin == "roughplastic" {
                    self.set_roughness(&mut leaf, object)?;
                }
            }
            "principled" | "principledthin" => self.set_principled(&mut leaf, object)?,
            _ => {
                self.unsupported(object);
                leaf.optics.diffuse = Vec3::splat(0.5);
            }
        }
        Ok(leaf)
    }

    fn set_diffuse(&mut self, leaf: &mut Material, object: &Object, name: &str) -> Result<(), SceneError> {
        let given = self.colour(object, name, 0.5, Role::Reflectance)?;
        set_colour(leaf, Parameter::Diffuse, given, |optics, colour| optics.diffuse = colour);
        Ok(())
    }

    fn set_specular(&mut self, leaf: &mut Material, object: &Object) -> Result<(), SceneError> {
        let given = self.colour(object, "specular_reflectance", 1.0, Role::Reflectance)?;
        set_colour(leaf, Parameter::Specular, given, |optics, colour| optics.specular = colour);
        Ok(())
    }

    fn set_conductor(&mut self, leaf: &mut Material, object: &Object) -> Result<(), SceneError> {
        let named = object.text("material")?.filter(|name| *name != "none");
        let has_index = object.has("eta") || object.has("k");
        leaf.optics.surface = Surface::Conductor;
        match named {
            Some(name) if !has_index => match complex_index(name) {
                Some([eta, absorption]) => {
                    (leaf.optics.eta, leaf.optics.absorption) = (eta.as_vec3(), absorption.as_vec3());
                }
                None => {
                    let problem = format!("no metal `{}` is known here; give eta and k", excerpt(name));
                    return Err(object.at("material").refuse(problem));
                }
            },
            Some(_) => {
                let problem = "material stands beside eta or k; keep one of the two";
                return Err(object.at("material").refuse(problem));
            }
            None => {
                leaf.optics.eta = self.constant_colour(object, "eta", 0.0, Role::Unbounded)?;
                leaf.optics.absorption = self.constant_colour(object, "k", 1.0, Role::Unbounded)?;
            }
        }
        self.set_specular(leaf, object)?;
        match object.plugin == "roughconductor" {
            true => self.set_roughness(leaf, object),
            false => Ok(()),
        }
    }

    /// Widths of the distribution of microfacets.
    fn set_roughness(&mut self, leaf: &mut Material, object: &Object) -> Result<(), SceneError> {
        leaf.optics.is_beckmann = object.choice("distribution", &["beckmann", "ggx"])? == "beckmann";
        object.ignore(&["sample_visible"]);
        let both = ["alpha_u", "alpha_v"];
        let names = match both.map(|name| object.has(name)) {
            [true, true] if !object.has("alpha") => both,
            [false, false] => ["alpha"; 2],
            _ => {
                let problem = "widths of microfacets are alpha, or alpha_u and alpha_v; give one or the other";
                return Err(object.location.refuse(problem));
            }
        };
        let mut given = [Given::Constant(0.1); 2];
        for (slot, name) in given.iter_mut().zip(names) {
            *slot = self.scalar(object, name, 0.1)?;
            if let Given::Constant(alpha) = slot
                && *alpha > 1.0
            {
                self.note("wide microfacets", object.at(name), format!("{name} is {alpha}; 1 is taken"));
                *alpha = 1.0;
            }
        }
        match (given, names[0] == names[1]) {
            ([Given::Constant(along), Given::Constant(across)], _) => leaf.optics.roughness = Vec2::new(along, across),
            ([Given::Image(map), _], true) => leaf.set_map(Parameter::Roughness, Some(map)),
            (given, _) => {
                for (parameter, given) in [Parameter::Roughness, Parameter::RoughnessAcross].into_iter().zip(given) {
                    let map = match given {
                        Given::Constant(alpha) => self.constant_image(object, Vec3::splat(alpha)),
                        Given::Image(map) => map,
                    };
                    leaf.set_map(parameter, Some(map));
                }
            }
        }
        Ok(())
    }

    /// Disney's BSDF, of a body or of a thin sheet.
    fn set_principled(&mut self, leaf: &mut Material, object: &Object) -> Result<(), SceneError> {
        let is_thin = object.plugin == "principledthin";
        leaf.optics.surface = if is_thin { Surface::PrincipledThin } else { Surface::Principled };
        self.set_diffuse(leaf, object, "base_color")?;
        self.set_shares(
            leaf,
            object,
            &[
                ("anisotropic", Parameter::Anisotropy, |optics| &mut optics.principled.anisotropy),
                ("spec_tint", Parameter::SpecularTint, |optics| &mut optics.principled.specular_tint),
                ("sheen", Parameter::Sheen, |optics| &mut optics.principled.sheen),
                ("sheen_tint", Parameter::SheenTint, |optics| &mut optics.principled.sheen_tint),
                ("flatness", Parameter::Flatness, |optics| &mut optics.principled.flatness),
                ("spec_trans", Parameter::SpecularShare, |optics| &mut optics.principled.specular_share),
            ],
        )?;
        match self.scalar(object, "roughness", 0.5)? {
            Given::Constant(roughness) => leaf.optics.roughness = Vec2::splat((roughness * roughness).min(1.0)),
            Given::Image(map) => {
                leaf.set_map(Parameter::Roughness, Some(Map { response: Response::Squared, ..map }));
            }
        }
        const INDEX: &str = "an index of refraction of 1 or more";
        let index = |default: f64| object.float_in("eta", default, 1.0..=1e3, INDEX);
        if is_thin {
            leaf.optics.ior = index(1.5)? as f32;
            match self.scalar(object, "diff_trans", 0.0)? {
                Given::Constant(twice) => leaf.optics.principled.diffuse_transmission = (0.5 * twice).clamp(0.0, 1.0),
                Given::Image(map) => {
                    leaf.set_map(Parameter::DiffuseTransmission, Some(Map { factor: 0.5 * map.factor, ..map }));
                }
            }
            object.ignore(&[
                "diffuse_reflectance_sampling_rate",
                "specular_reflectance_sampling_rate",
                "specular_transmittance_sampling_rate",
                "diffuse_transmittance_sampling_rate",
            ]);
            return Ok(());
        }
        self.set_shares(
            leaf,
            object,
            &[
                ("metallic", Parameter::Metalness, |optics| &mut optics.metalness),
                ("clearcoat", Parameter::Coat, |optics| &mut optics.coat),
            ],
        )?;
        let gloss = match self.scalar(object, "clearcoat_gloss", 0.0)? {
            Given::Constant(gloss) => gloss.clamp(0.0, 1.0),
            Given::Image(_) => {
                let text = "clearcoat_gloss of principled is a constant; 0.5 is taken for its texture";
                self.note("textures of principled", object.at("clearcoat_gloss"), text);
                0.5
            }
        };
        leaf.optics.coat_roughness = 0.1 + (0.001 - 0.1) * gloss;
        // Without a difference of indices nothing could be transmitted by a facet.
        let refracts = leaf.transmits();
        let ior = match object.has("eta") {
            true => match index(1.5)? {
                1.0 if refracts => 1.001,
                ior => ior,
            },
            false => {
                let specular = match object.float_in("specular", 0.5, 0.0..=1.0, "a number in [0, 1]")? {
                    0.0 if refracts => 1e-3,
                    specular => specular,
                };
                2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0
            }
        };
        leaf.optics.ior = ior as f32;
        object.ignore(&["main_specular_sampling_rate", "clearcoat_sampling_rate", "diffuse_reflectance_sampling_rate"]);
        Ok(())
    }

    /// Parameters in [0, 1] that are 0 where they are not given.
    fn set_shares(
        &mut self,
        leaf: &mut Material,
        object: &Object,
        shares: &[(&str, Parameter, Share)],
    ) -> Result<(), SceneError> {
        for (name, parameter, field) in shares {
            let given = self.scalar(object, name, 0.0)?;
            set_scalar(leaf, *parameter, given, |optics, share| *field(optics) = share.clamp(0.0, 1.0));
        }
        Ok(())
    }
}

fn set_colour(
    material: &mut Material,
    parameter: Parameter,
    given: Given<Vec3>,
    set: impl FnOnce(&mut scene::Material, Vec3),
) {
    match given {
        Given::Constant(colour) => set(&mut material.optics, colour),
        Given::Image(map) => {
            // What stands in where surfaces have no texture coordinates.
            set(&mut material.optics, Vec3::splat(if parameter == Parameter::Specular { 1.0 } else { 0.5 }));
            material.set_map(parameter, Some(map));
        }
    }
}

fn set_scalar(
    material: &mut Material,
    parameter: Parameter,
    given: Given<f32>,
    set: impl FnOnce(&mut scene::Material, f32),
) {
    match given {
        Given::Constant(value) => set(&mut material.optics, value),
        Given::Image(map) => material.set_map(parameter, Some(map)),
    }
}

/// The index of refraction inside relative to that outside; each is a number or a name.
fn index(object: &Object, inside: &str) -> Result<f32, SceneError> {
    let one = |name: &'static str, default: &str| -> Result<f64, SceneError> {
        let word = match object.value(name) {
            None => default,
            Some((Value::Text(word), _)) => word,
            Some(_) => return object.float_in(name, 1.0, 1e-3..=1e3, "an index of refraction, as 1.5"),
        };
        index_of_refraction(word).ok_or_else(|| {
            let problem = format!("no `{}` is known here; give a number, or one of {}", excerpt(word), names(INDICES));
            object.at(name).refuse(problem)
        })
    };
    Ok((one("int_ior", inside)? / one("ext_ior", "air")?) as f32)
}
