//! The scene as the kernels read it: normalised, in leaf order, with only what it requires.
//!
//! [`Features`] are what the scene has and [`Needs`] what a render asks of its kernels; `space` has the units, `camera`
//! the camera's vectors, `instances` meshes in their places, `lights` the area lights and `sky` the environment as light sampling picks them, `pack` the
//! records.

mod camera;
mod features;
mod instances;
mod lights;
mod microfacets;
mod pack;
mod sky;
mod space;

use std::f64::consts::PI;

use glam::{DVec3, Vec2};
use thiserror::Error;

use self::camera::camera_frame;
pub use self::features::{FeatureFlag, Features, Needs};
use self::instances::{Attributes, Soup, Wanted};
use self::lights::{AreaLights, MAX_CELLS, brightness, punctual_probability, sky_probability};
use self::microfacets::Tables;
use self::pack::{pack_detail, pack_lights, pack_material, pack_textures};
use self::sky::Sky;
pub use self::space::Normalisation;
use self::space::{radiance_scale, scaled};
use super::defaults::Defaults;
use super::plan::{Plan, SceneLevels};
use crate::bvh::{self, Bvh, BvhKind, Primitive};
use crate::constants::*;
use crate::layout::{
    EnvironmentSplit, EnvironmentTexel, Frame, Instance, Light, Material, MaterialDetail, Normals, PlacedLight,
    PunctualLight, Triangle,
};
use crate::scene::{Environment, Scene};
use crate::settings::{Instances, Integrator, Settings};
use crate::trace::Stages;

/// Why the kernels cannot hold a scene.
#[derive(Debug, Error, PartialEq)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum PrepareError {
    #[error("the scene has {0} triangles and a BVH can address {max}; use a smaller scene", max = bvh::MAX_TRIANGLES)]
    TooManyTriangles(u64),
    #[error(
        "the scene has {0} triangles once its meshes are flattened, and a BVH can address {max}; use --instances two-level \
         with --bvh bvh2",
        max = bvh::MAX_TRIANGLES
    )]
    TooManyFlattened(u64),
    #[error("the scene places meshes {0} times and a BVH can address {max}; use fewer", max = bvh::MAX_TRIANGLES)]
    TooManyInstances(u64),
    #[error("instances of two levels are of --bvh bvh2 alone; leave out --bvh {0}, or use --instances flatten")]
    TwoLevels(&'static str),
    #[error("the scene has {0} triangles and a list holds at most {max}; use another --bvh", max = bvh::MAX_LISTED)]
    TooManyListed(usize),
    #[error("the BVH has {nodes} nodes and one of this shape can address {max}; use --bvh bvh2")]
    TooManyNodes { nodes: usize, max: usize },
    #[error("the scene has {0} emitting triangles and light sampling can tell {max} apart; use fewer", max = MAX_CELLS)]
    TooManyLights(usize),
    #[error("the environment has {0} texels and light sampling can tell {max} apart; scale the image down", max = MAX_CELLS)]
    TooManyTexels(usize),
}

/// Scene data in the layouts of the GPU.
#[derive(Debug)]
pub struct PreparedScene {
    /// The hierarchy over `triangles`.
    pub bvh: Bvh,
    /// Triangles in leaf order; of a mesh that is not flattened once, in the mesh's own space.
    pub triangles: Vec<Triangle>,
    /// Materials in the scene's order.
    pub materials: Vec<Material>,
    /// What else materials have, in the same order, where some have more.
    pub material_details: Vec<MaterialDetail>,
    /// Area lights: emissive triangles, as cells of an alias table.
    pub lights: Vec<Light>,
    /// What else those have where meshes are placed.
    pub placed_lights: Vec<PlacedLight>,
    /// Lights that are no surfaces, as cells of another.
    pub punctual_lights: Vec<PunctualLight>,
    /// Shading normals in the scene's order, if there are any.
    pub normals: Vec<Normals>,
    /// Three texture coordinates a triangle in the scene's order, if there are textures.
    pub texture_coordinates: Vec<Vec2>,
    /// Colours of vertices, three a triangle in the order of the scene; empty where there are none.
    pub vertex_colours: Vec<[u32; 2]>,
    /// Textures: sizes, lookups and texels as halves; then tables of microfacets.
    pub textures: Vec<[u32; 2]>,
    /// Texels of a lat-long environment.
    pub environment: Vec<EnvironmentTexel>,
    /// The hierarchy by which light sampling picks a texel.
    pub environment_splits: Vec<EnvironmentSplit>,
    /// What the scene needs of the kernels.
    pub features: Features,
    /// How its positions came from the world's.
    pub normalisation: Normalisation,
    /// The kernels' radiance over the scene's, a power of two.
    pub radiance_scale: f64,
    /// Triangles of the scene: of a mesh as many times as it is placed.
    pub triangle_count: u64,
    frame: Frame,
    /// The number of the first triangle of each instance: of the world, then of each placement. Placements of a mesh that is
    /// not flattened have the same.
    firsts: Vec<u32>,
}

/// A triangle as scene files have it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TriangleName {
    /// 0 for the world's own triangles, then placements in the scene's order, of meshes that are placed more than once.
    pub instance: u32,
    /// Its number among those of the world, or of the mesh.
    pub triangle: u32,
}

/// Data of a scene for a buffer of its name on the device.
#[derive(Debug, Clone, Copy)]
pub struct SceneBuffer<'a> {
    /// Name of the GLSL variable.
    pub name: &'static str,
    /// Bytes of the words that kernels read: 8 or 16.
    pub texel_bytes: u64,
    /// Its contents; without any it is zeros.
    pub contents: &'a [u8],
    /// Bytes, at least a word.
    pub size: u64,
}

impl PreparedScene {
    /// [`PreparedScene::with_bvh`] of eight children a node.
    ///
    /// # Errors
    /// When the scene is too large for the kernels' indices.
    pub fn new(scene: &Scene) -> Result<Self, PrepareError> {
        Self::with_bvh(scene, BvhKind::Cwbvh)
    }

    /// [`PreparedScene::with_bvh`] of the kind that the settings ask for, or else of the device's default.
    ///
    /// # Errors
    /// When the scene is too large for the kernels' indices.
    pub fn for_device(scene: &Scene, settings: &Settings, defaults: &Defaults) -> Result<Self, PrepareError> {
        Self::in_stages(scene, settings, defaults, &Stages::default())
    }

    /// As [`PreparedScene::for_device`]; notes its stages.
    ///
    /// # Errors
    /// As [`PreparedScene::for_device`].
    pub fn in_stages(
        scene: &Scene,
        settings: &Settings,
        defaults: &Defaults,
        stages: &Stages,
    ) -> Result<Self, PrepareError> {
        let (kind, instances) = defaults.tree(settings, scene);
        Self::lay_out(scene, kind, instances, stages)
    }

    /// Builds a BVH of that kind and lays the scene out, with all meshes flattened.
    ///
    /// # Errors
    /// When the scene is too large for the kernels' indices.
    pub fn with_bvh(scene: &Scene, kind: BvhKind) -> Result<Self, PrepareError> {
        Self::with_tree(scene, kind, Instances::Flatten)
    }

    /// Builds a BVH of that kind, over meshes in their places or over their triangles, and lays the scene out.
    ///
    /// # Errors
    /// When the scene is too large for the kernels' indices, or there are no two levels of that kind.
    pub fn with_tree(scene: &Scene, kind: BvhKind, instances: Instances) -> Result<Self, PrepareError> {
        Self::lay_out(scene, kind, instances, &Stages::default())
    }

    fn lay_out(scene: &Scene, kind: BvhKind, instances: Instances, stages: &Stages) -> Result<Self, PrepareError> {
        let laying_out = stages.begin("lay out scene");
        let has_two_levels = instances == Instances::TwoLevel && !scene.placed.is_empty();
        check_size(scene, kind, has_two_levels)?;
        let normalisation = Normalisation::of(scene);
        let mut features = Features::of(scene);
        let wanted = Wanted {
            normals: features.normals,
            coordinates: features.has_coordinates(),
            colours: features.vertex_colours,
        };
        let soup = match has_two_levels {
            true => Soup::by_meshes(scene, &normalisation, wanted),
            false => Soup::flattened(scene, &normalisation, wanted),
        };
        drop(laying_out);
        let building = stages.begin("build BVH");
        let mut bvh = if has_two_levels { tree_of_instances(&soup) } else { Bvh::build(kind, &soup.corners) };
        drop(building);
        let _laying_out = stages.begin("lay out scene");
        let (nodes, max) = (bvh.node_places(), kind.max_nodes());
        if nodes > max {
            return Err(PrepareError::TooManyNodes { nodes, max });
        }
        let mut triangles: Vec<Triangle> = bvh
            .order
            .iter()
            .map(|&original| {
                let [v0, v1, v2] = soup.corners[original as usize].map(|v| v.to_array());
                let material = soup.materials[original as usize];
                Triangle { v0, original, v1, material, v2, light_area: 0.0 }
            })
            .collect();
        let radiance_scale = radiance_scale(scene, &normalisation);
        let area_lights = AreaLights::of(scene, &mut bvh, &soup)?;
        let mut placed_lights = Vec::new();
        for (place, light) in area_lights.cells.iter().enumerate() {
            let (instance, light_area) = (area_lights.instances[place], area_lights.areas[place] as f32);
            match bvh.instances.get(instance as usize) {
                None => triangles[light.triangle as usize].light_area = light_area,
                Some(Instance { first_light, .. }) => {
                    placed_lights.push(PlacedLight { instance, light_area });
                    triangles[light.triangle as usize].light_area = f32::from_bits(place as u32 - first_light);
                }
            }
        }

        let mut frame = camera_frame(&scene.camera, &normalisation, &soup);
        features.thin_triangles = bvh.has_thin_triangles;
        features.distance = frame.camera_distance > 0.0;
        let (mut textures, headers) = pack_textures(scene, radiance_scale);
        let mut tables = Tables::new(&mut textures);
        let details = scene.materials.iter().map(|material| pack_detail(material, &headers, &mut tables));
        let material_details = if features.has_details() { details.collect() } else { Vec::new() };
        let (punctual_lights, punctual_power) = pack_lights(&scene.lights, &normalisation, radiance_scale);
        let sky = match &scene.environment {
            Environment::LatLong(map) => Sky::of(map, radiance_scale)?,
            Environment::Constant(radiance) => Sky { power: 4.0 * PI * brightness(*radiance), ..Sky::default() },
            Environment::Black => Sky::default(),
        };
        frame.light_count = area_lights.cells.len() as u32;
        let (low, high) = scene.bounds();
        frame.sky_probability =
            sky_probability(features, &area_lights, &sky, normalisation.point(high) - normalisation.point(low));
        frame.punctual_count = punctual_lights.len() as u32;
        frame.punctual_probability = punctual_probability(
            punctual_power,
            &area_lights,
            &sky,
            normalisation.point(high) - normalisation.point(low),
        );
        frame.environment = features.environment;
        match &scene.environment {
            Environment::Constant(radiance) => {
                frame.environment_radiance = scaled(*radiance, radiance_scale);
            }
            Environment::LatLong(map) => {
                (frame.environment_width, frame.environment_height) = (map.width, map.height);
                let [x, y, z] = map.rotation.to_cols_array_2d().map(|column| DVec3::from(column).as_vec3().to_array());
                (frame.environment_x, frame.environment_y, frame.environment_z) = (x, y, z);
            }
            Environment::Black => {}
        }
        let firsts = soup.firsts.clone();
        let Attributes { normals, coordinates, colours } = soup.attributes;
        Ok(Self {
            bvh,
            triangles,
            materials: scene.materials.iter().map(|m| pack_material(m, &headers, radiance_scale)).collect(),
            material_details,
            lights: area_lights.cells,
            placed_lights,
            punctual_lights,
            normals,
            texture_coordinates: coordinates,
            vertex_colours: colours,
            textures,
            environment: sky.texels,
            environment_splits: sky.splits,
            features,
            normalisation,
            radiance_scale,
            triangle_count: scene.triangle_count(),
            frame,
            firsts,
        })
    }

    /// Corners of the triangles in the scene's order, in normalised space: of the world, then of each placement.
    pub fn corners(&self) -> Vec<[[f32; 3]; 3]> {
        let mut corners = vec![[[0.0; 3]; 3]; self.triangles.len()];
        for Triangle { v0, v1, v2, original, .. } in &self.triangles {
            corners[*original as usize] = [*v0, *v1, *v2];
        }
        if !self.bvh.has_two_levels() {
            return corners;
        }
        let mut ends: Vec<u32> = self.firsts[1..].to_vec();
        ends.dedup();
        ends.push(corners.len() as u32);
        let placed = self.bvh.instances.iter().zip(&self.firsts).enumerate().flat_map(|(number, (instance, first))| {
            // The world's own end where the first mesh begins.
            let end = if number == 0 { ends[0] } else { ends[ends.partition_point(|end| end <= first)] };
            let own = &corners[*first as usize..end as usize];
            own.iter().map(|corners| instance.place_corners(*corners, |corner| instance.place(corner)))
        });
        placed.collect()
    }

    /// What scene files call a triangle that kernels know by its place in leaf order and its instance.
    pub fn name_of(&self, Primitive { triangle, instance }: Primitive) -> TriangleName {
        let original = self.triangles[triangle as usize].original;
        let instance = match self.bvh.has_two_levels() {
            true => instance,
            false => self.firsts.partition_point(|first| *first <= original) as u32 - 1,
        };
        TriangleName { instance, triangle: original - self.firsts[instance as usize] }
    }

    /// The number of a triangle in the scene's order, by which [`PreparedScene::places`] are indexed, and its instance as
    /// kernels have it.
    pub fn number_of(&self, TriangleName { instance, triangle }: TriangleName) -> (u32, u32) {
        (self.firsts[instance as usize] + triangle, if self.bvh.has_two_levels() { instance } else { WORLD_INSTANCE })
    }

    /// The place in leaf order, which the kernels know, of every triangle by its number.
    pub fn places(&self) -> Vec<u32> {
        let mut places = vec![0; self.triangles.len()];
        for (triangle, place) in self.triangles.iter().zip(0..) {
            places[triangle.original as usize] = place;
        }
        places
    }

    /// The uniform block of a render with `path_capacity` slots.
    pub fn frame(&self, settings: &Settings, path_capacity: u32) -> Frame {
        let aspect = settings.width as f32 / settings.height as f32;
        // BSDF samples find a constant environment as well as light samples do, which are left to the area lights then.
        let found_anyway = settings.integrator == Integrator::Mis && self.features.environment == ENVIRONMENT_CONSTANT;
        let sky_probability = match self.frame.sky_probability {
            both if found_anyway && both < 1.0 => both.min(0.125),
            shared => shared,
        };
        Frame {
            sky_probability,
            // The camera was laid out for a square image.
            camera_right: self.frame.camera_right.map(|c| c * aspect),
            roulette: settings.roulette as f32,
            max_bounces: settings.max_bounces.unwrap_or(UNBOUNDED),
            radiance_clamp: (settings.clamp.unwrap_or_default() * self.radiance_scale) as f32,
            roulette_from: settings.roulette_from,
            seed: settings.seed,
            width: settings.width,
            height: settings.height,
            path_capacity,
            ..self.frame
        }
    }

    /// Depths of the scene's trees, which bound the kernels' loops.
    pub fn levels(&self) -> SceneLevels {
        let sky = self.frame.environment_width.max(self.frame.environment_height).max(1);
        let listed = self.bvh.kind == BvhKind::List;
        let bvh_tests = if listed { 0 } else { self.bvh.sah_cost.ceil() as u32 };
        let two_levels = self.bvh.has_two_levels();
        SceneLevels { bvh: self.bvh.depth, bvh_tests, sky: sky.next_power_of_two().ilog2(), two_levels }
    }

    /// Entries of the traversal stack: each inner node on the way down leaves one at most. Of a wide
    /// tree it is the siblings of the node that comes next, and the last level has none.
    fn stack_size(&self) -> u32 {
        match self.bvh.kind {
            BvhKind::List => 0,
            BvhKind::Bvh2 => self.bvh.depth,
            BvhKind::Bvh4 | BvhKind::Cwbvh => self.bvh.depth - 1,
        }
    }

    /// What the kernels of a render are built for: what it needs or, without specialization, everything.
    pub fn needs(&self, settings: &Settings) -> Needs {
        let two_levels = self.bvh.has_two_levels();
        if settings.specialize {
            Needs::of(self.features, settings, self.stack_size(), two_levels)
        } else {
            Needs { stack_size: self.stack_size().max(Needs::ALL.stack_size), two_levels, ..Needs::ALL }
        }
    }

    /// Specialization constants by id: those of the table, then the vertices of a list.
    pub fn specialization(&self, settings: &Settings, plan: &Plan) -> Vec<u32> {
        let mut constants = self.needs(settings).specialization(settings, plan, &self.bvh).words();
        if self.bvh.kind == BvhKind::List {
            let vertices = self.triangles.iter().flat_map(|t| [t.v0, t.v1, t.v2]);
            constants.extend(vertices.flatten().map(f32::to_bits));
        }
        constants
    }
}

/// Whether the kernels' indices reach all of a scene.
fn check_size(scene: &Scene, kind: BvhKind, has_two_levels: bool) -> Result<(), PrepareError> {
    let (count, most) = (scene.triangle_count(), bvh::MAX_TRIANGLES as u64);
    if has_two_levels {
        let own = scene.mesh.triangles.len() as u64;
        let [triangles, placements] = scene.placed_counts().iter().fold([own, 1], |sum, [triangles, placements]| {
            [sum[0] + u64::from(*triangles), sum[1] + u64::from(*placements)]
        });
        return match () {
            () if kind != BvhKind::Bvh2 => Err(PrepareError::TwoLevels(kind.into())),
            () if triangles > most => Err(PrepareError::TooManyTriangles(triangles)),
            () if placements > most => Err(PrepareError::TooManyInstances(placements)),
            () => Ok(()),
        };
    }
    match () {
        () if count > most && !scene.placed.is_empty() => Err(PrepareError::TooManyFlattened(count)),
        () if count > most => Err(PrepareError::TooManyTriangles(count)),
        () if kind == BvhKind::List && count > bvh::MAX_LISTED as u64 => {
            Err(PrepareError::TooManyListed(count as usize))
        }
        () => Ok(()),
    }
}

/// A tree over the meshes of a soup in their places.
fn tree_of_instances(soup: &Soup) -> Bvh {
    let shown = soup.parts.iter().filter(|part| !part.range.is_empty());
    let trees: Vec<Bvh> = shown.map(|part| Bvh::build(BvhKind::Bvh2, &soup.corners[part.range.clone()])).collect();
    let mut tree = 0;
    let instances = soup.parts.iter().flat_map(|part| {
        let own = (!part.range.is_empty()).then_some(tree);
        tree += usize::from(own.is_some());
        part.instances.iter().map(move |instance| (own, *instance))
    });
    Bvh::of_instances(&trees, instances.collect())
}

impl PreparedScene {
    /// The scene's buffers. What the scene has no data for is one word or, without specialization, as
    /// long as if each triangle had some.
    pub fn buffers(&self, specialize: bool) -> [SceneBuffer<'_>; 14] {
        let triangles = if specialize { 1 } else { self.triangles.len() as u64 };
        let details = if specialize { 1 } else { u64::from(MATERIAL_DETAIL_TEXELS) * self.materials.len() as u64 };
        fn buffer<'a>(name: &'static str, texel_bytes: u64, contents: &'a [u8], least: u64) -> SceneBuffer<'a> {
            SceneBuffer { name, texel_bytes, contents, size: (contents.len() as u64).max(least) }
        }
        [
            buffer("nodes", 16, bytemuck::cast_slice(&self.bvh.texels), 16),
            buffer("triangles", 16, bytemuck::cast_slice(&self.triangles), 16),
            buffer("materials", 16, bytemuck::cast_slice(&self.materials), 16),
            buffer("material_details", 16, bytemuck::cast_slice(&self.material_details), 16 * details),
            buffer("punctual_lights", 16, bytemuck::cast_slice(&self.punctual_lights), 16),
            buffer("lights", 16, bytemuck::cast_slice(&self.lights), 16),
            buffer("instances", 16, bytemuck::cast_slice(&self.bvh.instances), 16),
            buffer("placed_lights", 8, bytemuck::cast_slice(&self.placed_lights), 8),
            buffer("normals", 16, bytemuck::cast_slice(&self.normals), 16 * triangles),
            buffer("texture_coordinates", 8, bytemuck::cast_slice(&self.texture_coordinates), 3 * 8 * triangles),
            buffer("vertex_colours", 8, bytemuck::cast_slice(&self.vertex_colours), 3 * 8 * triangles),
            buffer("textures", 8, bytemuck::cast_slice(&self.textures), 8),
            buffer("environment", 16, bytemuck::cast_slice(&self.environment), 16),
            buffer("environment_splits", 16, bytemuck::cast_slice(&self.environment_splits), 16),
        ]
    }
}
