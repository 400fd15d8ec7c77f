//! Makes the validated [`Scene`] of what an importer found: decodes the images that it shows, holds
//! its materials to the conservation of energy, and places its meshes in the world.

mod geometry;
mod materials;

use std::path::Path;

use glam::{DQuat, DVec3, Vec3};

use self::geometry::Dressing;
use self::materials::Materials;
use super::{
    Camera, Environment, EnvironmentMap, Material, Mesh, PlacedMesh, Scene, around_both,
    error::{Location, SceneError},
    import::{self, ImageFile, ImageSource, Import},
    sources::{Sources, Warning},
    text::one_line,
};
use crate::image::{Encoding, ImageProblem, Texels, decode_texels};

/// Makes the scene of the file at `path`, from which `import` was read.
pub(super) fn assemble(import: Import, path: &Path, mut sources: Sources) -> Result<Scene, SceneError> {
    let Import { meshes, materials, images, mut instances, camera, settings, environment, lights } = import;
    let location = Location::file(path);

    // One mesh after the other.
    let mut materials = Materials::new(materials, images.files);
    let (mut mesh, mut placed) = (Mesh::default(), Vec::new());
    let mut without_area = 0;
    instances.sort_by_key(|instance| instance.mesh);
    let mut instances = &instances[..];
    for (index, imported) in meshes.into_iter().enumerate() {
        let count = instances.iter().take_while(|instance| instance.mesh == index).count();
        let (own, rest) = instances.split_at(count);
        instances = rest;
        if own.is_empty() {
            continue;
        }
        let dressing = Dressing::of(&imported, &mut materials, &mut sources)?;
        let mut own = own.to_vec();
        let placements = PlacedMesh::placements(&imported, &mut own);
        if !placements.is_empty() {
            // Singular placements are the exception: only they need the mesh again.
            let copy = if own.is_empty() { None } else { Some(imported.clone()) };
            let (several, dropped) = PlacedMesh::of(imported, &dressing, placements)?;
            without_area += dropped;
            placed.extend(Some(several).filter(|placed| !placed.mesh.triangles.is_empty()));
            without_area += copy.map_or(Ok(0), |copy| mesh.add_instances(copy, &dressing, &own))?;
        } else {
            without_area += mesh.add_instances(imported, &dressing, &own)?;
        }
    }
    if mesh.triangles.is_empty() && placed.is_empty() {
        return Err(location.refuse("no triangle has an area; check scale and the mesh"));
    }
    if without_area > 0 {
        sources.warn(format!("{location}: {without_area} triangles without area were dropped"));
    }

    let (materials, textures) = materials.finish();
    let mut environment = decoded_environment(environment, &mut sources)?;
    let is_dark =
        matches!(environment, Environment::Black) && lights.is_empty() && !materials.iter().any(Material::is_emitter);
    if is_dark && camera.is_none() {
        environment = Environment::Constant(Vec3::ONE);
        sources.warn(format!("{location}: nothing emits light; lit by a white environment of radiance 1"));
    } else if is_dark {
        sources.warn(format!("{location}: nothing emits light; add a material with Ke or an [environment]"));
    }
    let up = sources.options.up.map(DVec3::from);
    if up.is_some() && camera.is_some() {
        sources.warn(format!("{location}: its camera says which way is up; --up is for scenes without one"));
    }
    let up = up.unwrap_or(DVec3::Y).normalize();
    if !up.is_finite() {
        return Err(location.refuse("up has no direction; give one other than 0"));
    }
    let (hash, warnings) = sources.finish();
    let bounds = placed.iter().map(PlacedMesh::bounds).fold(mesh.bounds(), around_both);
    Ok(Scene {
        name: one_line(&path.file_stem().unwrap_or_default().to_string_lossy()),
        camera: camera.unwrap_or_else(|| Camera::framing(bounds, up)),
        settings,
        mesh,
        placed,
        materials,
        textures,
        environment,
        lights,
        hash,
        warnings,
    })
}

fn decoded_environment(environment: import::Environment, sources: &mut Sources) -> Result<Environment, SceneError> {
    let (file, scale, rotation, has_rows_at_poles) = match environment {
        import::Environment::Black => return Ok(Environment::Black),
        import::Environment::Constant(radiance) if radiance == Vec3::ZERO => return Ok(Environment::Black),
        import::Environment::Constant(radiance) => return Ok(Environment::Constant(radiance)),
        import::Environment::LatLong { image, scale, rotation, has_rows_at_poles } => {
            (image, scale, rotation, has_rows_at_poles)
        }
    };
    let image = decoded(&file, Encoding::Srgb, sources)?;
    let mut radiance: Vec<Vec3> = image.rgba.iter().map(|texel| Vec3::from_slice(texel) * scale).collect();
    if radiance.iter().any(|radiance| !radiance.is_finite()) {
        let problem = format!("radiance overflows times scale {scale}; give a smaller scale");
        return Err(file.location.refuse(problem));
    }
    if radiance.iter().all(|&radiance| radiance == Vec3::ZERO) {
        sources.warn(format!("{}: the environment is black", file.location));
        return Ok(Environment::Black);
    }
    if has_rows_at_poles {
        radiance = off_the_poles(&radiance, image.width as usize);
    }
    let (width, height) = (image.width, radiance.len() as u32 / image.width);
    Ok(Environment::LatLong(EnvironmentMap { path: file.path, width, height, radiance, rotation }))
}

/// An image whose first and last row lie on the poles as one whose rows begin there: with some rows for each, as many as fit
/// into a sky, since what is linear between rows of the one is so only nearly between those of the other.
fn off_the_poles(radiance: &[Vec3], width: usize) -> Vec<Vec3> {
    const MOST_ROWS: usize = 4;
    const MOST_TEXELS: usize = 1 << 24;
    let gaps = (radiance.len() / width).saturating_sub(1);
    if gaps == 0 {
        return radiance.to_vec();
    }
    let rows = (MOST_TEXELS / (gaps * width)).clamp(1, MOST_ROWS);
    let row = |row: usize| {
        let at = (row as f32 + 0.5) / rows as f32;
        let above = row / rows * width;
        (above..above + width).map(move |texel| radiance[texel].lerp(radiance[texel + width], at - at.floor()))
    };
    (0..gaps * rows).flat_map(row).collect()
}

/// Reads an image. Every value is finite and at least 0: what is negative or NaN counts as 0, what is infinite as the
/// brightest value that is not.
fn decoded(file: &ImageFile, encoding: Encoding, sources: &mut Sources) -> Result<Texels, SceneError> {
    let name = one_line(&file.path.to_string_lossy());
    let refuse = |problem: String| file.location.refuse(format!("image `{name}` {}", one_line(&problem)));
    let undecodable = |problem: ImageProblem| refuse(format!("cannot be decoded: {problem}"));
    let mut image = match &file.source {
        ImageSource::File => {
            let bytes = sources.read(&file.path);
            let bytes = bytes.map_err(|error| refuse(format!("cannot be read ({error}); check the name")))?;
            decode_texels(&file.path, &bytes, encoding).map_err(undecodable)?
        }
        ImageSource::Bytes(bytes) => decode_texels(&file.path, bytes, encoding).map_err(undecodable)?,
        ImageSource::Texels { width, texels } => {
            let height = texels.len() as u32 / (*width).max(1);
            Texels { width: *width, height, rgba: texels.clone() }
        }
    };
    if image.rgba.is_empty() {
        return Err(refuse("has no pixels; export it anew".into()));
    }
    let is_radiance = |texel: &[f32; 4]| texel.iter().all(|value| value.is_finite() && *value >= 0.0);
    if let Some(first) = image.rgba.iter().position(|texel| !is_radiance(texel)) {
        let brightest = image.rgba.iter().flatten().filter(|value| value.is_finite()).copied().fold(0.0, f32::max);
        let mut count = 0;
        for texel in image.rgba.iter_mut().filter(|texel| !is_radiance(texel)) {
            *texel = texel.map(|value| if value.is_nan() { 0.0 } else { value.clamp(0.0, brightest) });
            count += 1;
        }
        let (x, y) = (first % image.width as usize, first / image.width as usize);
        let text = format!(
            "image `{name}`: {count} of {} texels, the first at ({x}, {y}), are negative or not finite; they are taken as 0, \
             or as the brightest",
            image.rgba.len()
        );
        sources.note(&Warning { kind: "texels", location: file.location.clone(), text });
    }
    Ok(image)
}

impl Camera {
    /// A camera that sees the whole of a box, along -z and a little from above where +y is up, which is a unit vector.
    fn framing((low, high): (DVec3, DVec3), up: DVec3) -> Self {
        const VFOV: f64 = 45.0;
        const MARGIN: f64 = 1.05;
        let centre = 0.5 * (low + high);
        let radius = 0.5 * low.distance(high);
        let distance = MARGIN * radius / libm::sin((0.5 * VFOV).to_radians());
        let towards = DVec3::new(0.0, 0.25, 1.0).normalize();
        // The same view to the last bit where nothing turns.
        let towards = if up == DVec3::Y { towards } else { DQuat::from_rotation_arc(DVec3::Y, up) * towards };
        Self {
            eye: centre + distance * towards,
            target: centre,
            up,
            vfov: VFOV,
            orthographic: None,
            aperture: 0.0,
            focus: distance,
        }
    }
}
