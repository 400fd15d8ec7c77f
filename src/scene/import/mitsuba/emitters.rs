//! Emitters that are no surfaces.

use std::f64::consts::PI;

use glam::{DAffine3, DMat3, DVec3};

use super::{Importer, spectra::Role, xml::Object};
use crate::scene::{
    Falloff, Light,
    error::SceneError,
    import::{Environment, ImageFile},
};

impl Importer<'_, '_, '_> {
    /// Adds an emitter of the scene.
    pub fn emitter(&mut self, place: usize) -> Result<(), SceneError> {
        let document = self.document;
        let object = &document.objects[place];
        // It shines from the shapes that refer to it.
        if object.plugin == "area" && object.id.is_some() {
            return Ok(());
        }
        object.ignore(&["sampling_weight"]);
        let to_world = object.transform("to_world")?.unwrap_or(DAffine3::IDENTITY);
        let along = |direction: DVec3| {
            direction
                .try_normalize()
                .ok_or_else(|| object.location.refuse("the direction is zero; correct the emitter"))
        };
        match &*object.plugin {
            "point" => {
                let position = object.vector("position")?.unwrap_or(to_world.translation);
                let intensity = self.constant_colour(object, "intensity", 1.0, Role::Emission)?;
                self.import.lights.push(Light::Point { position, intensity });
            }
            "spot" => {
                let intensity = self.constant_colour(object, "intensity", 1.0, Role::Emission)?;
                let cutoff = object.float_in("cutoff_angle", 20.0, 0.0..=180.0, "degrees from 0 to 180")?;
                let beam =
                    object.float_in("beam_width", 0.75 * cutoff, 0.0..=cutoff, "degrees up to the cutoff_angle")?;
                if object.has("texture") {
                    let text = "the texture of a spot is not shown";
                    self.note("texture of a spot", object.at("texture"), text);
                    object.ignore(&["texture"]);
                }
                self.import.lights.push(Light::Spot {
                    position: to_world.translation,
                    direction: along(to_world.matrix3.z_axis)?,
                    intensity,
                    angles: [beam, cutoff],
                    falloff: Falloff::Angle,
                });
            }
            "directional" => {
                let irradiance = self.constant_colour(object, "irradiance", 1.0, Role::Emission)?;
                let direction = along(object.vector("direction")?.unwrap_or(to_world.matrix3.z_axis))?;
                self.import.lights.push(Light::Directional { direction, irradiance });
            }
            "constant" => {
                let radiance = self.constant_colour(object, "radiance", 1.0, Role::Emission)?;
                self.set_environment(object, Environment::Constant(radiance))?;
            }
            "envmap" => {
                let path = object.file(self.sources)?;
                let image = ImageFile::file(path, object.at("filename").clone());
                let scale = object.float_in("scale", 1.0, 0.0..=1e30, "a number of 0 or more")? as f32;
                object.ignore(&["mis_compensation"]);
                let rotation = to_world.matrix3 * half_turn();
                let Some(rotation) = orthonormal(rotation) else {
                    return Err(object.at("to_world").refuse("`to_world` flattens the image; give a rotation"));
                };
                self.set_environment(object, Environment::LatLong { image, scale, rotation, has_rows_at_poles: true })?;
            }
            _ => self.unsupported(object),
        }
        Ok(())
    }

    fn set_environment(&mut self, object: &Object, environment: Environment) -> Result<(), SceneError> {
        match self.import.environment {
            Environment::Black => {
                self.import.environment = environment;
                Ok(())
            }
            _ => Err(object.location.refuse("a second light from infinity; keep one")),
        }
    }
}

/// Takes directions of our images to those of Mitsuba's: ours look along -z in the middle, Mitsuba's at the left edge, and
/// both grow towards +x from there.
fn half_turn() -> DMat3 {
    DMat3::from_rotation_y(PI)
}

/// A matrix with its axes made unit and upright to each other.
fn orthonormal(matrix: DMat3) -> Option<DMat3> {
    let y = matrix.y_axis.try_normalize()?;
    let z = matrix.z_axis.reject_from_normalized(y).try_normalize()?;
    let x = y.cross(z);
    let is_mirrored = matrix.determinant() < 0.0;
    Some(DMat3::from_cols(if is_mirrored { -x } else { x }, y, z))
}
