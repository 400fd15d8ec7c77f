//! What kernels compute on a device, each part held against a closed form, a statistic or the CPU.

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/instances.rs"]
mod instances;
#[path = "../common/meshes.rs"]
mod meshes;
#[path = "../common/probe.rs"]
mod probe;

mod bsdf;
mod bvh;
mod closed_form;
mod convergence;
mod digests;
mod lanes;
mod layouts;
mod lost_device;
mod microfacets;
mod numeric_settings;
mod numerics;
mod oracle_images;
mod parts;
mod pipeline_cache;
mod placed_meshes;
mod ray_counts;
mod ray_dumps;
mod recordings;
mod samplers;
mod schedulers;
mod specialize;
mod stability;
mod tiles;
mod together;
mod traversal;
mod variants;
mod workload;
