//! glTF 2.0 (ISO/IEC 12113:2022), as `.gltf` with its files or as `.glb`: nodes, meshes, materials, cameras and lights.

mod data;
mod json;
mod materials;
mod meshes;

use std::collections::HashMap;
use std::path::Path;

use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};

use self::{
    data::Data,
    json::Document,
    materials::{Context, Materials},
};
use super::{FARTHEST, Import, Instance};
use crate::scene::{
    Camera, Falloff, Light,
    error::{Location, SceneError},
    sources::Sources,
    text::{excerpt, one_line},
    transform::Transform,
};
use crate::settings::Integrator;

/// What is shown of extensions, or has no look.
const KNOWN: [&str; 17] = [
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    // Each use is told.
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    // Not required: then there are bytes without it.
    "EXT_meshopt_compression",
];

/// Extensions without which a mesh cannot be read.
const COMPRESSIONS: [&str; 3] = ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"];

/// What is wrong with a mesh that only an extension's decoder can read.
fn compressed(extension: &str) -> String {
    format!("its meshes are compressed by {extension}; decode them: npx @gltf-transform/cli copy IN.glb OUT.glb")
}

/// What a file holds besides its meshes, materials and images.
pub(super) struct Contents {
    pub instances: Vec<Instance>,
    /// All in the scene, in the order of its nodes, each with the names of its node and of its own.
    cameras: Vec<(Seen, Vec<String>)>,
    pub lights: Vec<Light>,
}

impl Contents {
    /// What is left out where only meshes are taken.
    pub fn note_rest(&self, path: &Path, sources: &mut Sources) {
        let (cameras, lights) = (self.cameras.len(), self.lights.len());
        if cameras + lights > 0 {
            let location = Location::file(path);
            sources.warn(format!(
                "{location}: its {cameras} cameras and {lights} lights are left out; its meshes are placed"
            ));
        }
    }
}

/// A camera, and width by height of its image where the file says it.
#[derive(Debug, Clone, Copy)]
struct Seen {
    camera: Camera,
    aspect: Option<f64>,
}

/// Imports a file as a scene.
pub(super) fn import(path: &Path, sources: &mut Sources) -> Result<Import, SceneError> {
    let mut import = Import::default();
    // Light samples alone find too little of what narrow lobes reflect.
    import.settings.integrator = Integrator::Mis;
    let location = Location::file(path);
    let Contents { instances, cameras, lights } = read(path, &location, sources, &mut import)?;
    let seen = match &sources.options.camera {
        None => cameras.first(),
        Some(wanted) => {
            let found = cameras.iter().find(|(_, names)| names.contains(wanted));
            if found.is_none() {
                let names: Vec<String> =
                    cameras.iter().flat_map(|(_, names)| names).map(|name| format!("`{}`", excerpt(name))).collect();
                let has =
                    if names.is_empty() { "it names none".to_owned() } else { format!("take {}", names.join(" or ")) };
                return Err(location.refuse(format!("no camera `{}`; {has}", excerpt(wanted))));
            }
            found
        }
    };
    if cameras.len() > 1 && sources.options.camera.is_none() {
        sources
            .warn(format!("{location}: the first of {} cameras is taken; --camera NAME takes another", cameras.len()));
    }
    if let Some((Seen { camera, aspect }, _)) = seen {
        import.camera = Some(*camera);
        let width = aspect.map_or(import.settings.width, |aspect| (f64::from(import.settings.height) * aspect) as u32);
        import.settings.width = width.clamp(1, 65536);
    }
    import.instances = instances;
    import.lights = lights;
    Ok(import)
}

/// Reads a file: meshes, materials and images go into the import.
pub(super) fn read(
    path: &Path,
    named_at: &Location,
    sources: &mut Sources,
    import: &mut Import,
) -> Result<Contents, SceneError> {
    let bytes = sources.require(path, named_at)?;
    let location = Location::file(path);
    let (document, binary) = data::parse(path, &bytes)?;
    check(&document, path, sources).map_err(|problem| location.refuse(problem))?;
    let data = Data::read(path, &document, binary, sources)?;
    let mut context = Context { path, data: &data, sources, import };
    let contents = walk(&document, &mut context).map_err(|problem| location.refuse(one_line(&problem)))?;
    if contents.instances.is_empty() {
        return Err(location.refuse("no triangles in its scene; export it with its meshes"));
    }
    Ok(contents)
}

/// Whether the file is of a kind that can be shown.
fn check(document: &Document, path: &Path, sources: &mut Sources) -> Result<(), String> {
    let version = document.asset.min_version.as_ref().unwrap_or(&document.asset.version);
    if !(document.asset.version.starts_with("2.") && (document.asset.min_version.is_none() || version == "2.0")) {
        return Err(format!("glTF {}; convert it to 2.0", excerpt(version)));
    }
    for required in &document.extensions_required {
        if COMPRESSIONS.contains(&&**required) {
            return Err(compressed(required));
        }
        if !KNOWN.contains(&&**required) && !sources.options.lenient {
            return Err(format!(
                "it requires {}, which is not read; export it without, or pass --lenient",
                excerpt(required)
            ));
        }
    }
    let unknown = |name: &&String| !KNOWN.contains(&&***name) && !COMPRESSIONS.contains(&&***name);
    let unknown: Vec<String> = document.extensions_used.iter().filter(unknown).map(|name| excerpt(name)).collect();
    let location = Location::file(path);
    if !unknown.is_empty() {
        sources.warn(format!("{location}: these extensions are not shown: {}", unknown.join(", ")));
    }
    if !document.animations.is_empty() {
        sources.warn(format!("{location}: animations are not shown; everything rests"));
    }
    Ok(())
}

/// The nodes of the scene, each before its children, and where each node of the file is.
struct Nodes {
    shown: Vec<usize>,
    globals: Vec<DAffine3>,
}

impl Nodes {
    fn of(document: &Document, context: &mut Context<'_, '_>) -> Result<Self, String> {
        let nodes = &document.nodes;
        let mut is_child = vec![false; nodes.len()];
        for child in nodes.iter().flat_map(|node| &node.children) {
            let known = is_child.get_mut(*child).ok_or_else(|| format!("no node {child}; export it anew"))?;
            if std::mem::replace(known, true) {
                return Err(format!("node {child} has two parents; export it anew"));
            }
        }
        // Every node has one parent at most, so a walk from those without any comes to each once.
        let roots: Vec<usize> = (0..nodes.len()).filter(|node| !is_child[*node]).collect();
        let mut globals = vec![DAffine3::IDENTITY; nodes.len()];
        let mut places = vec![0; nodes.len()];
        let mut order = Vec::new();
        let mut stack: Vec<(usize, DAffine3)> = roots.iter().rev().map(|root| (*root, DAffine3::IDENTITY)).collect();
        while let Some((index, parent)) = stack.pop() {
            globals[index] = parent * local(&nodes[index], index)?;
            places[index] = order.len();
            order.push(index);
            stack.extend(nodes[index].children.iter().rev().map(|child| (*child, globals[index])));
        }
        if order.len() < nodes.len() {
            return Err("a node is among its own descendants; export it anew".to_owned());
        }

        let scene = document.scene.unwrap_or(0);
        let starts = match document.scenes.get(scene) {
            Some(shown) => {
                if document.scenes.len() > 1 {
                    let name = shown.name.as_deref().map_or_else(|| format!("{scene}"), excerpt);
                    context.note("scenes", format!("scene `{name}` is shown, of {}", document.scenes.len()));
                }
                &shown.nodes
            }
            None if document.scene.is_none() => &roots,
            None => return Err(format!("no scene {scene}; export it anew")),
        };
        let mut shown = Vec::new();
        let mut is_shown = vec![false; nodes.len()];
        let mut stack: Vec<usize> = starts.iter().rev().copied().collect();
        while let Some(index) = stack.pop() {
            let known = is_shown.get_mut(index).ok_or_else(|| format!("no node {index}; export it anew"))?;
            if !std::mem::replace(known, true) {
                shown.push(index);
                stack.extend(nodes[index].children.iter().rev());
            }
        }
        Ok(Self { shown, globals })
    }
}

/// Where a node is in its parent.
fn local(node: &json::Node, index: usize) -> Result<DAffine3, String> {
    if let Some(matrix) = node.matrix {
        return Ok(DAffine3::from_mat4(DMat4::from_cols_array(&matrix)));
    }
    let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let rotation = DQuat::from_xyzw(x, y, z, w).normalize();
    if !rotation.is_finite() {
        return Err(format!("the rotation of node {index} is no quaternion; export it anew"));
    }
    let scale = DVec3::from(node.scale.unwrap_or([1.0; 3]));
    Ok(DAffine3::from_scale_rotation_translation(scale, rotation, DVec3::from(node.translation.unwrap_or_default())))
}

/// Takes what the nodes of the scene hold.
fn walk(document: &Document, context: &mut Context<'_, '_>) -> Result<Contents, String> {
    let Nodes { shown, globals } = Nodes::of(document, context)?;
    let mut materials = Materials::default();
    let mut known: HashMap<(usize, Vec<u64>, Option<usize>), Option<usize>> = HashMap::new();
    let mut contents = Contents { instances: Vec::new(), cameras: Vec::new(), lights: Vec::new() };
    for index in shown {
        let (node, global) = (&document.nodes[index], globals[index]);
        if let Some(mesh_index) = node.mesh {
            let mesh =
                document.meshes.get(mesh_index).ok_or_else(|| format!("no mesh {mesh_index}; export it anew"))?;
            let weights = node.weights.as_ref().or(mesh.weights.as_ref()).map_or(&[][..], |weights| weights);
            let key = (mesh_index, weights.iter().map(|weight| weight.to_bits()).collect(), node.skin);
            let added = match known.get(&key) {
                Some(added) => *added,
                None => {
                    let joints = match node.skin {
                        Some(skin) => {
                            context.note("skins", "skins are shown as their joints rest");
                            let skin =
                                document.skins.get(skin).ok_or_else(|| format!("no skin {skin}; export it anew"))?;
                            Some(meshes::joints(skin, &globals, context)?)
                        }
                        None => None,
                    };
                    if mesh.primitives.iter().any(|primitive| !primitive.targets.is_empty()) {
                        context.note("morph targets", "morph targets are shown by their default weights");
                    }
                    meshes::add(mesh, weights, joints.as_ref(), &mut materials, context)?
                }
            };
            known.insert(key, added);
            if let Some(mesh) = added {
                // A skin has taken it to the world.
                let global = if node.skin.is_some() { DAffine3::IDENTITY } else { global };
                let place = |map: DAffine3| Instance {
                    mesh,
                    transform: Transform::affine(map),
                    is_mirrored: map.matrix3.determinant() < 0.0,
                };
                match &node.extensions.instancing {
                    Some(instancing) => {
                        let places = instances(&instancing.attributes, context)?;
                        contents.instances.extend(places.into_iter().map(|own| place(global * own)));
                    }
                    None => contents.instances.push(place(global)),
                }
            }
        }
        if let Some(index) = node.camera {
            let camera = document.cameras.get(index).ok_or_else(|| format!("no camera {index}; export it anew"))?;
            let names = [&node.name, &camera.name].into_iter().flatten().cloned().collect();
            contents.cameras.push((seen(camera, index, global)?, names));
        }
        if let Some(of) = &node.extensions.light {
            let lights = document.extensions.lights.as_ref().map_or(&[][..], |lights| &lights.lights);
            let light = lights.get(of.light).ok_or_else(|| format!("no light {}; export it anew", of.light))?;
            contents.lights.extend(lit(light, of.light, global, context)?);
        }
    }
    Ok(contents)
}

/// The places of EXT_mesh_gpu_instancing in their node.
fn instances(attributes: &json::InstanceAttributes, context: &Context<'_, '_>) -> Result<Vec<DAffine3>, String> {
    let data = context.data;
    let translations = attributes.translation.map(|accessor| data.vectors::<3>(accessor)).transpose()?;
    let scales = attributes.scale.map(|accessor| data.vectors::<3>(accessor)).transpose()?;
    let rotations = attributes.rotation.map(|accessor| data.elements(accessor, &["VEC4"])).transpose()?;
    let rotations = rotations.map(|elements| elements.normalized().vectors::<4>());
    let counts = [translations.as_ref().map(Vec::len), scales.as_ref().map(Vec::len), rotations.as_ref().map(Vec::len)];
    let count = counts.into_iter().flatten().next().unwrap_or(0);
    if counts.into_iter().flatten().any(|other| other != count) {
        return Err("the attributes of instances differ in number; export it anew".to_owned());
    }
    let instance = |index: usize| {
        let vector = |values: &Option<Vec<[f64; 3]>>, default| {
            values.as_ref().and_then(|values| values.get(index)).map_or(default, |value| DVec3::from(*value))
        };
        let rotation = rotations.as_ref().and_then(|values| values.get(index)).copied().unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let rotation = DQuat::from_array(rotation).normalize();
        match rotation.is_finite() {
            true => Ok(DAffine3::from_scale_rotation_translation(
                vector(&scales, DVec3::ONE),
                rotation,
                vector(&translations, DVec3::ZERO),
            )),
            false => Err(format!("the rotation of instance {index} is no quaternion; export it anew")),
        }
    };
    (0..count).map(instance).collect()
}

/// A place and the direction of an axis there, unit.
fn axis(global: DAffine3, axis: DVec3, what: &str, index: usize) -> Result<(DVec3, DVec3), String> {
    let (place, direction) = (global.translation, (global.matrix3 * axis).normalize());
    match place.abs().max_element() <= FARTHEST && place.is_finite() && direction.is_finite() {
        true => Ok((place, direction)),
        false => Err(format!("{what} {index} has no place or no direction; correct the scale of its node")),
    }
}

fn seen(camera: &json::Camera, index: usize, global: DAffine3) -> Result<Seen, String> {
    let (eye, along) = axis(global, DVec3::NEG_Z, "camera", index)?;
    let (_, up) = axis(global, DVec3::Y, "camera", index)?;
    let (vfov, orthographic, aspect) = match (&camera.perspective, &camera.orthographic) {
        (Some(perspective), _) => (perspective.yfov.to_degrees(), None, perspective.aspect_ratio),
        (None, Some(orthographic)) => {
            (45.0, Some(2.0 * orthographic.ymag.abs()), Some((orthographic.xmag / orthographic.ymag).abs()))
        }
        (None, None) => return Err(format!("camera {index} is neither perspective nor orthographic; export it anew")),
    };
    let in_range = vfov > 0.0 && vfov < 180.0 && orthographic.is_none_or(|height| height > 0.0 && height <= FARTHEST);
    if !in_range {
        return Err(format!("camera {index} sees nothing; correct its yfov or ymag"));
    }
    // Far enough for the target to be apart from the eye.
    let distance = eye.abs().max_element().max(1.0);
    let camera = Camera { eye, target: eye + distance * along, up, vfov, orthographic, aperture: 0.0, focus: distance };
    Ok(Seen { camera, aspect: aspect.filter(|aspect| *aspect > 0.0 && aspect.is_finite()) })
}

/// A light; `None` where it gives none.
fn lit(
    light: &json::Light,
    index: usize,
    global: DAffine3,
    context: &mut Context<'_, '_>,
) -> Result<Option<Light>, String> {
    let (position, direction) = axis(global, DVec3::NEG_Z, "light", index)?;
    let intensity = Vec3::from(light.color.map(|channel| (channel * light.intensity) as f32));
    if !(intensity.is_finite() && intensity.min_element() >= 0.0) {
        return Err(format!("light {index} is negative or not finite; correct its color and intensity"));
    }
    if light.range.is_some() {
        context.note(
            "range of lights",
            "lights reach farther than their range: they fall off with the square of the distance",
        );
    }
    if intensity == Vec3::ZERO {
        context.note("black lights", "a light of intensity 0 is left out");
        return Ok(None);
    }
    Ok(Some(match &*light.kind {
        "point" => Light::Point { position, intensity },
        "directional" => Light::Directional { direction, irradiance: intensity },
        "spot" => {
            let outer = light.spot.outer_cone_angle.to_degrees();
            let inner = light.spot.inner_cone_angle.to_degrees();
            if !(0.0 <= inner && inner < outer && outer <= 90.0) {
                return Err(format!(
                    "light {index} has an inner cone that is not inside of its outer one; correct them"
                ));
            }
            Light::Spot { position, direction, intensity, angles: [inner, outer], falloff: Falloff::SquaredCosine }
        }
        kind => {
            context.note("kinds of lights", format!("lights of the kind `{}` are not shown", excerpt(kind)));
            return Ok(None);
        }
    }))
}
