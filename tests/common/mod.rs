//! What GPU tests share: a device under validation, scenes from text, renders.
#![allow(dead_code, reason = "each test file uses its part")]

pub mod install;
pub mod not_tested;
pub mod project;

use std::path::Path;
use std::sync::Arc;

pub use project::project_file;
use raywave::Renderer;
use raywave::gpu::{Device, Instance};
use raywave::render::{Outcome, PreparedScene};
use raywave::scene::{LoadOptions, Scene};
use raywave::settings::Settings;
use raywave_studies::gallery::generate_gallery;

/// Vulkan under validation, or without where `RAYWAVE_NO_VALIDATION` is set, for machines that lack the layer.
pub fn instance() -> Arc<Instance> {
    let validation = std::env::var_os("RAYWAVE_NO_VALIDATION").is_none();
    Arc::new(Instance::new(validation).expect("GPU tests need Vulkan and its validation layer"))
}

/// The device of `RAYWAVE_DEVICE`, or the best one.
pub fn device() -> Device {
    device_with_cache(None)
}

/// The same, with a folder of caches.
pub fn device_with_cache(folder: Option<&Path>) -> Device {
    let instance = instance();
    let wanted = std::env::var("RAYWAVE_DEVICE").ok();
    let description = instance.choose(wanted.as_deref()).expect("GPU tests need a Vulkan device");
    Device::open_with_cache(&instance, description, folder).expect("the device opens")
}

/// Whether a test of many cases tries the one of that index on this device: on lavapipe each, elsewhere one of `n`.
/// SwiftShader and the compilers of hardware take half a second and more to build the kernels of a render. Such devices are
/// there for another compiler and other lanes, which show in any case; what shows in few of them shows on lavapipe. `n`
/// shares no divisor with the numbers of what is combined, so that the cases left have all of it in turn.
pub fn tries(device: &Device, index: usize, n: usize) -> bool {
    let compiles_quickly = device.description().is_software() && !is_swiftshader(device);
    compiles_quickly || index.is_multiple_of(n)
}

/// The samples that a test takes on this device where any number makes a sound test. SwiftShader is ten times slower
/// than lavapipe. What a sixteenth of the samples no longer shows there, noise being four times as large, is left to
/// lavapipe and to `ray_counts.rs`, which holds paths on both against the CPU's.
pub fn samples_on(device: &Device, samples: u32) -> u32 {
    if is_swiftshader(device) { samples / 16 } else { samples }
}

/// Whether the device is SwiftShader.
pub fn is_swiftshader(device: &Device) -> bool {
    device.description().name.contains("SwiftShader")
}

/// Fails with everything that the validation layer said.
pub fn assert_silent(device: &Device) {
    let messages = device.validation_messages();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
}

/// The scene as the device takes it by its defaults.
pub fn prepare(device: &Device, scene: &Scene, settings: &Settings) -> PreparedScene {
    let renderer = Renderer::new(device).expect("the device can be measured");
    renderer.prepare(scene, settings).expect("the settings make sense, and the scene fits")
}

/// Renders and checks that validation is silent and no sample was lost.
pub fn render_on(device: &Device, scene: &Scene, settings: &Settings) -> Outcome {
    let renderer = Renderer::new(device).expect("the device can be measured");
    let outcome = renderer.render(scene, settings).expect("the render ends");
    assert_silent(device);
    assert_eq!(outcome.statistics.nonfinite_samples, 0, "NaN or infinite samples");
    outcome
}

/// As [`render_on`], on a device of its own.
pub fn render(scene: &Scene, settings: &Settings) -> Outcome {
    render_on(&device(), scene, settings)
}

/// A scene of `scenes/`.
pub fn own_scene(name: &str) -> Scene {
    let files = ["toml", "xml", "gltf"].map(|extension| project_file(&format!("scenes/{name}.{extension}")));
    let file = files.iter().find(|file| file.exists()).expect("tests name scenes that there are");
    Scene::load(file).expect("own scenes load")
}

/// A gallery of about so many triangles.
pub fn gallery(triangles: usize) -> Scene {
    let folder = tempfile::tempdir().expect("a temporary folder");
    generate_gallery(folder.path(), triangles).expect("the gallery is written");
    Scene::load(&folder.path().join("gallery.toml")).expect("the gallery loads")
}

/// A scene from texts: `scene.toml`, `scene.obj`, `scene.mtl`.
pub fn scene_from(toml: &str, obj: &str, mtl: &str) -> Scene {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in [("scene.toml", toml), ("scene.obj", obj), ("scene.mtl", mtl)] {
        std::fs::write(folder.path().join(name), text).expect("a temporary file");
    }
    // Skies lie in folders of their own.
    let options = LoadOptions { allow_outside: true, ..LoadOptions::default() };
    Scene::load_with(&folder.path().join("scene.toml"), &options).expect("the test's scene loads")
}

/// A floor that fills the image under a sky, and materials in a file: `floor` is its own.
pub fn floor(mtl: &str) -> Scene {
    let toml = "[camera]\neye = [0, 1, 0.1]\ntarget = [0, 0, 0]\nvfov = 60\n[[mesh]]\nfile = \"scene.obj\"\n[environment]\nradiance = [1, 1, 1]\n";
    let obj = "mtllib scene.mtl\nv -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nusemtl floor\nf 4 3 2 1\n";
    scene_from(toml, obj, mtl)
}
