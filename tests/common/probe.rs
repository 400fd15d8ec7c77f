//! Calls of single GLSL functions: the probes of `tests/shaders`, on what kernels see of a scene.

use bytemuck::Pod;
use glam::{DVec3, Vec3};
use raywave::gpu::{BufferRole, BufferUse, Device, Executor, ExecutorDescription};
use raywave::layout::Batch;
use raywave::recording::Recording;
use raywave::render::{PreparedScene, Settings, scene_buffers};
use raywave::scene::{Camera, Environment, Material, Mesh, RenderDefaults, Scene, Surface, Triangle};
use raywave::shaders::{Access, Binding, BindingKind, Kernel, Variant};

use super::assert_silent;

include!(concat!(env!("OUT_DIR"), "/probes.rs"));

/// Where probes run: a device and a scene.
pub struct Bench {
    pub device: Device,
    pub scene: PreparedScene,
    pub settings: Settings,
    /// How kernels reach memory; the device's own way without.
    pub access: Option<Access>,
}

impl Bench {
    pub fn new(device: &Device, scene: &Scene) -> Self {
        Self {
            device: device.clone(),
            scene: PreparedScene::new(scene).expect("the scene fits"),
            settings: Settings::of(scene),
            access: None,
        }
    }

    /// What the probe of that name gives for each input.
    pub fn run<I: Pod, O: Pod>(&self, name: &str, inputs: &[I]) -> Vec<O> {
        let kernel = PROBES.iter().find(|kernel| kernel.name == name).expect("tests name probes that exist");
        let workgroup_size = self.device.description().max_workgroup_size.min(256);
        let frame = self.scene.frame(&self.settings, 1);
        let state = |name, size, contents| BufferRole { name, usage: BufferUse::State, size, contents };
        let input_bytes = bytemuck::cast_slice(inputs);
        let output_size = size_of::<O>() * inputs.len();
        let probe_buffers = [
            state("probe_inputs", input_bytes.len() as u64, Some(input_bytes)),
            state("probe_outputs", output_size as u64, None),
        ];
        let description = ExecutorDescription {
            kernels: &[kernel],
            specialization: &self.scene.specialization(&self.settings, workgroup_size),
            buffers: scene_buffers(&self.scene, &frame).chain(probe_buffers).collect(),
            access: self.access,
        };
        let mut executor = Executor::new(&self.device, description).expect("the probe is built");
        let items = inputs.len() as u32;
        let batch = Batch { first_pixel: 0, pixel_count: items, first_sample: 0, sample_count: 1, bounce: 0 };
        let mut recording = Recording::default();
        recording.dispatch(kernel.name, items.div_ceil(workgroup_size), batch);
        executor.submit(&recording).expect("the probe runs");
        let outputs = bytemuck::pod_collect_to_vec(&executor.read("probe_outputs").expect("the probe ends"));
        drop(executor);
        assert_silent(&self.device);
        outputs
    }
}

/// A scene of triangles that all have one material, with all else at its plainest.
pub fn scene_of(triangles: &[[DVec3; 3]]) -> Scene {
    let none = [raywave::scene::NONE; 3];
    let corners = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
    Scene {
        name: "probe".into(),
        camera: Camera { eye: DVec3::Z, target: DVec3::ZERO, up: DVec3::Y, vfov: 60.0, aperture: 0.0, focus: 1.0 },
        width: 1,
        height: 1,
        defaults: RenderDefaults::default(),
        mesh: Mesh {
            positions: triangles.as_flattened().to_vec(),
            triangles: corners.map(|positions| Triangle { positions, normals: none, uvs: none, material: 0 }).collect(),
            ..Mesh::default()
        },
        materials: vec![grey()],
        textures: Vec::new(),
        environment: Environment::Black,
        hash: String::new(),
        warnings: Vec::new(),
    }
}

/// A triangle for probes that need no scene.
pub fn any_scene() -> Scene {
    scene_of(&[[DVec3::ZERO, DVec3::X, DVec3::Y]])
}

/// Lambert of reflectance one half.
pub fn grey() -> Material {
    Material {
        name: "grey".into(),
        surface: Surface::Glossy,
        kd: Vec3::splat(0.5),
        ks: Vec3::ZERO,
        ns: 0.0,
        ni: 1.0,
        tf: Vec3::ONE,
        ke: Vec3::ZERO,
        map_kd: None,
    }
}
