//! What needs no device: files, scenes, statistics, reports, the build of the kernels, and the map of the sources.

#[path = "../fake_renderer/mod.rs"]
mod fake_renderer;
#[path = "../common/instances.rs"]
mod instances;
#[path = "../common/not_tested.rs"]
mod not_tested;
#[path = "../common/project.rs"]
mod project;

mod film_files;
mod formats;
mod mitsuba_files;
mod placed_meshes;
mod ray_files;
mod report_page;
mod scene_files;
mod spirv;
mod statistics_module;
