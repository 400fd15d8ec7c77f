//! glTF's meshes as triangles, in the pose in which they rest.

use std::collections::{BTreeMap, HashMap};

use glam::{DAffine3, DMat3, DMat4, DVec3, Vec2, Vec3};

use super::json;
use super::materials::{Context, Materials};
use crate::scene::{
    NONE, Triangle,
    error::Location,
    import::{Mesh, light},
    transform::cofactors,
};

/// The accessors of a primitive: positions, normals, texture coordinates, colours.
type Accessors = [Option<usize>; 4];

/// Matrices that take the vertices of a skin to the world, by joint.
pub(super) type Joints = Vec<DAffine3>;

/// Adds a mesh to those of the import; `None` where it has no triangles. Its targets count by `weights`, and a skin takes it
/// to the world.
pub(super) fn add(
    mesh: &json::Mesh,
    weights: &[f64],
    joints: Option<&Joints>,
    materials: &mut Materials,
    context: &mut Context<'_, '_>,
) -> Result<Option<usize>, String> {
    let mut made = Mesh {
        location: Location::file(context.path),
        positions: Vec::new(),
        normals: Vec::new(),
        uvs: Vec::new(),
        colours: Vec::new(),
        triangles: Vec::new(),
    };
    // Primitives often share their vertices.
    let mut known: HashMap<Accessors, [u32; 3]> = HashMap::new();
    for primitive in &mesh.primitives {
        add_primitive(primitive, weights, joints, materials, context, &mut made, &mut known)?;
    }
    if made.triangles.is_empty() {
        return Ok(None);
    }
    context.import.meshes.push(made);
    Ok(Some(context.import.meshes.len() - 1))
}

fn add_primitive(
    primitive: &json::Primitive,
    weights: &[f64],
    joints: Option<&Joints>,
    materials: &mut Materials,
    context: &mut Context<'_, '_>,
    made: &mut Mesh,
    known: &mut HashMap<Accessors, [u32; 3]>,
) -> Result<(), String> {
    let mode = primitive.mode.unwrap_or(4);
    if !(4..=6).contains(&mode) {
        context.note("points and lines", "points and lines have no surface and are left out");
        return Ok(());
    }
    let Some(&position) = primitive.attributes.get("POSITION") else {
        context.note("primitive without positions", "a primitive without positions is left out");
        return Ok(());
    };
    if primitive.extensions.variants.is_some() {
        context.note("variants", "variants of materials are not shown; the first choice is");
    }
    let bytes = |accessor: &json::Accessor| accessor.buffer_view.is_some() || accessor.sparse.is_some();
    if primitive.extensions.draco.is_some() && !context.data.document.accessors.get(position).is_some_and(bytes) {
        return Err(super::compressed("KHR_draco_mesh_compression"));
    }
    let material = materials.of(primitive.material, context)?;
    let attribute = |name: &str| primitive.attributes.get(name).copied();
    let texture_set = format!("TEXCOORD_{}", material.coordinates);
    let key = [Some(position), attribute("NORMAL"), attribute(&texture_set), attribute("COLOR_0")];
    let is_posed = joints.is_some() || !primitive.targets.is_empty();
    let [first, first_normal, first_uv] = match known.get(&key) {
        Some(places) if !is_posed => *places,
        _ => {
            let places = add_vertices(primitive, &key, weights, joints, material.has_alpha, context, made)?;
            known.insert(key, places);
            places
        }
    };

    let data = context.data;
    let count = data.document.accessors.get(position).map_or(0, |accessor| accessor.count) as u32;
    let corners: Vec<u32> = match primitive.indices {
        None => (0..count).collect(),
        Some(indices) => {
            let elements = data.elements(indices, &["SCALAR"])?;
            if !elements.are_indices() {
                return Err(format!("accessor {indices} is no list of indices; export it anew"));
            }
            (0..elements.count).map(|element| elements.value(element, 0) as u32).collect()
        }
    };
    if let Some(corner) = corners.iter().find(|corner| **corner >= count) {
        return Err(format!("vertex index {corner} is out of range; the primitive has {count} vertices"));
    }
    let mut push = |corners: [u32; 3]| {
        let from = |first: u32| if first == NONE { [NONE; 3] } else { corners.map(|corner| first + corner) };
        made.triangles.push(Triangle {
            positions: from(first),
            normals: from(first_normal),
            uvs: from(first_uv),
            material: material.index,
        });
    };
    match mode {
        4 => {
            corners.chunks_exact(3).for_each(|triangle| push([triangle[0], triangle[1], triangle[2]]));
            if !corners.len().is_multiple_of(3) {
                context.note("incomplete triangle", "corners that make no whole triangle are left out");
            }
        }
        // Every other triangle of a strip runs the other way round.
        5 => {
            for (index, triangle) in corners.windows(3).enumerate() {
                let [a, b, c] = [triangle[0], triangle[1], triangle[2]];
                push(if index % 2 == 0 { [a, b, c] } else { [a, c, b] });
            }
        }
        _ => {
            for pair in corners.get(1..).unwrap_or_default().windows(2) {
                push([pair[0], pair[1], corners[0]]);
            }
        }
    }
    Ok(())
}

/// Adds the vertices of a primitive. Returns where they begin: positions, normals, texture coordinates; [`NONE`] where there
/// are none.
fn add_vertices(
    primitive: &json::Primitive,
    key: &Accessors,
    weights: &[f64],
    joints: Option<&Joints>,
    has_alpha: bool,
    context: &mut Context<'_, '_>,
    made: &mut Mesh,
) -> Result<[u32; 3], String> {
    let data = context.data;
    let &[Some(position), normal, uv, colour] = key else { return Err("a primitive without positions".to_owned()) };
    let mut positions: Vec<DVec3> = data.vectors(position)?.into_iter().map(DVec3::from_array).collect();
    let count = positions.len();
    let checked = |accessor: usize, found: usize| match found == count {
        true => Ok(()),
        false => Err(format!("accessor {accessor} has {found} elements for {count} vertices; export it anew")),
    };
    let mut normals: Option<Vec<DVec3>> = match normal {
        Some(normal) => Some(data.vectors(normal)?.into_iter().map(DVec3::from_array).collect()),
        None => None,
    };
    if let (Some(accessor), Some(normals)) = (normal, &normals) {
        checked(accessor, normals.len())?;
    }

    for (target, weight) in primitive.targets.iter().zip(weights) {
        if *weight == 0.0 {
            continue;
        }
        let move_by = |name: &str, vectors: Option<&mut Vec<DVec3>>| -> Result<(), String> {
            let (Some(&accessor), Some(vectors)) = (target.get(name), vectors) else { return Ok(()) };
            let moves: Vec<[f64; 3]> = data.vectors(accessor)?;
            checked(accessor, moves.len())?;
            vectors.iter_mut().zip(moves).for_each(|(vector, by)| *vector += *weight * DVec3::from(by));
            Ok(())
        };
        move_by("POSITION", Some(&mut positions))?;
        move_by("NORMAL", normals.as_mut())?;
    }
    if let Some(joints) = joints {
        pose(&primitive.attributes, joints, &mut positions, normals.as_mut(), context)?;
    }
    if let Some(vertex) = positions.iter().position(|position| !position.is_finite()) {
        return Err(format!("vertex {vertex} of accessor {position} is not finite; correct or remove it"));
    }

    let mut uvs: Vec<Vec2> = Vec::new();
    if let Some(accessor) = uv {
        // Rows of an image count from the top, v from the bottom.
        let flip = |[u, v]: [f64; 2]| Vec2::new(u as f32, (1.0 - v) as f32);
        uvs = data.vectors(accessor)?.into_iter().map(flip).collect();
        checked(accessor, uvs.len())?;
        if !uvs.iter().all(|uv| uv.is_finite()) {
            let text = "texture coordinates are not finite; their primitive is taken to have none";
            context.note("texture coordinates of glTF", text);
            uvs.clear();
        }
    }
    let mut colours: Vec<Vec3> = Vec::new();
    if let Some(accessor) = colour {
        let elements = data.elements(accessor, &["VEC3", "VEC4"])?.normalized();
        checked(accessor, elements.count)?;
        let mut is_clamped = false;
        let mut clamped = |value: f64| {
            let clamped = light(value as f32);
            is_clamped |= f64::from(clamped) != f64::from(value as f32);
            clamped
        };
        let colour = |[r, g, b, _]: [f64; 4]| Vec3::new(clamped(r), clamped(g), clamped(b));
        let vectors = elements.vectors::<4>();
        let has_clear = elements.width == 4 && vectors.iter().any(|[.., alpha]| *alpha < 1.0);
        colours = vectors.into_iter().map(colour).collect();
        if is_clamped {
            context.note("colours of vertices", "colours of vertices are negative or not finite; they are clamped");
        }
        if has_clear && has_alpha {
            context.note("alpha of vertices", "the alpha of vertices is not shown");
        }
    }

    let places = [made.positions.len(), made.normals.len(), made.uvs.len()];
    if places.iter().any(|place| place + count >= NONE as usize) {
        return Err("more vertices than 32-bit indices reach; split the mesh".to_owned());
    }
    // Vertices without colours among others that have them are white.
    if !colours.is_empty() || !made.colours.is_empty() {
        made.colours.resize(made.positions.len(), Vec3::ONE);
        made.colours.extend(&colours);
        made.colours.resize(made.positions.len() + count, Vec3::ONE);
    }
    let [first, first_normal, first_uv] = places.map(|place| place as u32);
    let first_normal = if normals.is_some() { first_normal } else { NONE };
    let first_uv = if uvs.is_empty() { NONE } else { first_uv };
    made.positions.append(&mut positions);
    made.normals.extend(normals.into_iter().flatten());
    made.uvs.append(&mut uvs);
    Ok([first, first_normal, first_uv])
}

/// Takes vertices to the world by the joints that pull them.
fn pose(
    attributes: &BTreeMap<String, usize>,
    joints: &Joints,
    positions: &mut [DVec3],
    mut normals: Option<&mut Vec<DVec3>>,
    context: &Context<'_, '_>,
) -> Result<(), String> {
    let data = context.data;
    let mut pulls = Vec::new();
    for set in 0.. {
        let attribute = |name: &str| attributes.get(&format!("{name}_{set}")).copied();
        let (Some(of), Some(weights)) = (attribute("JOINTS"), attribute("WEIGHTS")) else { break };
        let (joints, weights): (Vec<[f64; 4]>, _) =
            (data.vectors(of)?, data.elements(weights, &["VEC4"])?.normalized().vectors::<4>());
        if joints.len() != positions.len() || weights.len() != positions.len() {
            return Err("a skin has another number of vertices than its mesh; export it anew".to_owned());
        }
        pulls.push((joints, weights));
    }
    for (vertex, position) in positions.iter_mut().enumerate() {
        let (mut linear, mut translation, mut total) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        for (of, weights) in &pulls {
            for (joint, weight) in of[vertex].into_iter().zip(weights[vertex]) {
                if weight == 0.0 {
                    continue;
                }
                let Some(joint) = joints.get(joint as usize) else {
                    return Err(format!("joint {joint} is out of range; the skin has {}", joints.len()));
                };
                linear += joint.matrix3 * weight;
                translation += joint.translation * weight;
                total += weight;
            }
        }
        // What nothing pulls stays where it is.
        if total == 0.0 {
            continue;
        }
        let placed = DAffine3 { matrix3: linear * (1.0 / total), translation: translation / total };
        *position = placed.transform_point3(*position);
        if let Some(normal) = normals.as_mut().and_then(|normals| normals.get_mut(vertex)) {
            *normal = cofactors(placed.matrix3) * *normal;
        }
    }
    Ok(())
}

/// The matrices of a skin: what takes its vertices to a joint at rest, then where the joint is.
pub(super) fn joints(skin: &json::Skin, globals: &[DAffine3], context: &Context<'_, '_>) -> Result<Joints, String> {
    let inverse_binds = match skin.inverse_bind_matrices {
        Some(accessor) => context.data.vectors::<16>(accessor)?,
        None => Vec::new(),
    };
    let joint = |(place, node): (usize, &usize)| {
        let global = globals.get(*node).ok_or_else(|| format!("a skin names node {node}, which is not there"))?;
        let bind = match inverse_binds.get(place) {
            Some(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(matrix)),
            None if inverse_binds.is_empty() => DAffine3::IDENTITY,
            None => {
                return Err(format!("a skin has {} matrices for {} joints", inverse_binds.len(), skin.joints.len()));
            }
        };
        Ok(*global * bind)
    };
    let joints: Result<Joints, String> = skin.joints.iter().enumerate().map(joint).collect();
    joints.map_err(|problem| problem + "; export it anew")
}
