//! Calls of single GLSL functions: the probes of `tests/shaders`, on what kernels see of a scene.
#![allow(dead_code, reason = "each test file uses its part")]

use std::f64::consts::TAU;
use std::sync::LazyLock;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3, Vec4};
use raywave::bvh::BvhKind;
use raywave::gpu::{BufferRole, BufferUse, Device, Executor, ExecutorDescription};
use raywave::layout::{Batch, Control};
use raywave::recording::Recording;
use raywave::render::{Defaults, Plan, PreparedScene, scene_buffers};
use raywave::scene::{Camera, Material, Scene, SceneBuilder};
use raywave::settings::Settings;
use raywave::shaders::{Access, Arithmetic, Binding, BindingKind, Edition, Forms, Kernel, Library};
use raywave_studies::stats::SplitMix64;

use crate::common::assert_silent;

include!(concat!(env!("OUT_DIR"), "/probes.rs"));

/// Where probes run: a device and a scene.
pub struct Bench {
    pub device: Device,
    pub scene: PreparedScene,
    pub settings: Settings,
    /// How kernels reach memory; the device's own way without.
    pub access: Option<Access>,
    /// What portable quotients and roots are made of; what suits the device without.
    pub forms: Option<Forms>,
    /// Functions that stand for the driver's own operations.
    pub driver: Option<&'static Library>,
    /// Invocations of a workgroup; 256 without, or as many as there may be.
    pub workgroup_size: Option<u32>,
}

/// A driver that does all that Vulkan lets it do: `tests/shaders/hostile.glsl`.
pub fn hostile() -> &'static Library {
    static LIBRARY: LazyLock<Library> = LazyLock::new(|| Library::of_words(HOSTILE));
    &LIBRARY
}

impl Bench {
    pub fn new(device: &Device, scene: &Scene) -> Self {
        Self::with_bvh(device, scene, BvhKind::Bvh2)
    }

    pub fn with_bvh(device: &Device, scene: &Scene, kind: BvhKind) -> Self {
        Self {
            device: device.clone(),
            scene: PreparedScene::with_bvh(scene, kind).expect("the scene fits"),
            settings: scene.settings,
            access: None,
            forms: None,
            driver: None,
            workgroup_size: None,
        }
    }

    /// What the probe of that name gives for each input.
    pub fn run<I: Pod, O: Pod>(&self, name: &str, inputs: &[I]) -> Vec<O> {
        let kernel = PROBES.iter().find(|kernel| kernel.name == name).expect("tests name probes that exist");
        let workgroup_size = self.workgroup_size.unwrap_or(256).min(self.device.description().max_workgroup_size);
        let items = inputs.len() as u32;
        let plan = Plan {
            width: items,
            height: 1,
            tile_rows: 1,
            path_capacity: items,
            workgroup_size,
            paths_per_invocation: 1,
        };
        let frame = self.scene.frame(&self.settings, items);
        let state = |name, size, contents| BufferRole { name, usage: BufferUse::State, size, contents };
        let input_bytes = bytemuck::cast_slice(inputs);
        let output_size = size_of::<O>() * inputs.len();
        let probe_buffers = [
            state(buffers::PROBE_INPUTS, input_bytes.len() as u64, Some(input_bytes)),
            state(buffers::PROBE_OUTPUTS, output_size as u64, None),
            state(buffers::CONTROL, size_of::<Control>() as u64, None),
            state(buffers::STACK_BLOCKS, self.scene.needs(&self.settings).stack_bytes(plan.stacks()).max(16), None),
        ];
        let defaults = Defaults::of(&self.device).expect("the device can be measured");
        let description = ExecutorDescription {
            kernels: &[kernel],
            specialization: &self.scene.specialization(&self.settings, &plan),
            buffers: scene_buffers(&self.scene, &self.settings, &frame).chain(probe_buffers).collect(),
            access: self.access.unwrap_or_else(|| defaults.access(&self.settings)),
            edition: Edition::Plain,
            arithmetic: Arithmetic::Portable(self.forms.unwrap_or(defaults.forms)),
            driver: self.driver,
        };
        let mut executor = Executor::new(&self.device, description).expect("the probe is built");
        let batch = Batch { pixel_count: items, sample_count: 1, ..bytemuck::Zeroable::zeroed() };
        let mut recording = Recording::default();
        recording.dispatch(kernel, items.div_ceil(workgroup_size), &batch).download(buffers::PROBE_OUTPUTS);
        let outputs = bytemuck::pod_collect_to_vec(&executor.run(&recording).expect("the probe runs")[0]);
        drop(executor);
        assert_silent(&self.device);
        outputs
    }
}

/// A scene of triangles that all have one material, with all else at its plainest.
pub fn scene_of(triangles: &[[DVec3; 3]]) -> Scene {
    let camera = Camera::pinhole(DVec3::Z, DVec3::ZERO, 60.0);
    SceneBuilder::new(camera).resolution(1, 1).material(grey()).polygons(triangles).build()
}

/// A triangle for probes that need no scene.
pub fn any_scene() -> Scene {
    scene_of(&[[DVec3::ZERO, DVec3::X, DVec3::Y]])
}

/// A scene of these materials, each on a triangle: kernels know those that are used.
pub fn scene_of_materials(materials: Vec<Material>) -> Scene {
    let mut scene = scene_of(&vec![[DVec3::ZERO, DVec3::X, DVec3::Y]; materials.len()]);
    for (triangle, material) in scene.mesh.triangles.iter_mut().zip(0..) {
        triangle.material = material;
    }
    Scene { materials, ..scene }
}

/// Lambert of reflectance one half.
pub fn grey() -> Material {
    Material { name: "grey".into(), exponent: 0.0, ..Material::diffuse(Vec3::splat(0.5)) }
}

/// Input of the probe `bsdf`: `SurfaceQuery` of `surface_query.glsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct SurfaceQuery {
    pub geometric_normal: [f32; 4],
    pub shading_normal: [f32; 4],
    pub wo: [f32; 4],
    pub wi: [f32; 4],
    pub choice: f32,
    pub unused: f32,
    pub u: [f32; 2],
    pub material: [u32; 4],
}

impl SurfaceQuery {
    /// A flat surface about to be asked for a pair of directions.
    pub fn new(material: usize, normal: DVec3, wo: DVec3, wi: DVec3) -> Self {
        Self {
            geometric_normal: lanes(normal),
            shading_normal: lanes(normal),
            wo: lanes(wo),
            wi: lanes(wi),
            material: [material as u32, 0, 0, 0],
            ..Zeroable::zeroed()
        }
    }
}

/// Output of the probe `bsdf`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct BsdfAnswer {
    /// Of the pair of directions, with the cosine.
    pub value: [f32; 3],
    /// Of the pair of directions.
    pub pdf: f32,
    /// That was sampled, and its pdf.
    pub direction: [f32; 4],
    /// Of the sample, and the index of refraction of what it leads into.
    pub weight: [f32; 4],
    /// Components of the BSDF, and the one that was sampled.
    pub flags: [u32; 2],
    pub unused: [u32; 2],
}

/// A vector as GLSL's vec4, rounded.
pub fn lanes(v: DVec3) -> [f32; 4] {
    v.as_vec3().extend(0.0).to_array()
}

/// The first three lanes of a vec4.
pub fn vector(lanes: [f32; 4]) -> DVec3 {
    Vec4::from(lanes).truncate().as_dvec3()
}

/// Uniform numbers as the kernels draw them: multiples of 2^-24 in [0, 1).
pub struct Uniform(SplitMix64);

impl Uniform {
    pub fn new(seed: u64) -> Self {
        Self(SplitMix64::new(seed))
    }

    pub fn next<const N: usize>(&mut self) -> [f32; N] {
        std::array::from_fn(|_| (self.0.next_u64() >> 40) as f32 * (-24_f32).exp2())
    }

    /// Uniform over the unit sphere.
    pub fn direction(&mut self) -> DVec3 {
        let [u, v] = self.next();
        spherical(DVec3::Z, 1.0 - 2.0 * f64::from(u), TAU * f64::from(v))
    }
}

/// The unit vector at that cosine from a unit axis, and at that angle around it.
pub fn spherical(axis: DVec3, cosine: f64, phi: f64) -> DVec3 {
    let (x, y) = axis.any_orthonormal_pair();
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    sine * (phi.cos() * x + phi.sin() * y) + cosine * axis
}
