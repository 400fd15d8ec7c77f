//! `raywave info`.

use std::fmt::Write as _;
use std::path::PathBuf;

use crate::bvh::Bvh;
use crate::layout;
use crate::render::PreparedScene;

use super::picture::BvhName;
use super::{load_scene, print, readable_bytes};

/// Tell what a scene holds: triangles, materials, lights, bounds, BVH, memory
#[derive(Debug, clap::Args)]
pub struct InfoArguments {
    /// Scene file (.toml) or mesh (.obj); the built-in Cornell box without
    scene: Option<PathBuf>,
    /// Shape of the BVH
    #[arg(long, default_value = "cwbvh")]
    bvh: BvhName,
}

pub fn run(arguments: &InfoArguments) -> anyhow::Result<()> {
    let scene = load_scene(arguments.scene.as_deref(), false)?;
    let prepared = PreparedScene::with_bvh(&scene, arguments.bvh.into())?;
    let (low, high) = scene.bounds();
    let triangles = scene.mesh.triangles.len();
    let mut text = String::new();
    writeln!(text, "scene            {}", scene.name)?;
    writeln!(text, "hash             {}", scene.hash)?;
    writeln!(text, "triangles        {triangles}")?;
    writeln!(text, "vertices         {}", scene.mesh.positions.len())?;
    writeln!(text, "materials        {}", scene.materials.len())?;
    writeln!(text, "textures         {}", scene.textures.len())?;
    writeln!(text, "light triangles  {}", prepared.lights.len())?;
    writeln!(text, "environment      {}", environment(&scene))?;
    writeln!(text, "bounds           {low} to {high}")?;
    writeln!(text, "needs            {}", needs(&prepared))?;
    let Bvh { depth, leaf_count, sah_cost, build_time, .. } = &prepared.bvh;
    writeln!(text, "BVH nodes        {}", prepared.bvh.node_count())?;
    writeln!(text, "BVH leaves       {leaf_count}, {:.2} triangles each", triangles as f64 / f64::from(*leaf_count))?;
    writeln!(text, "BVH depth        {depth}")?;
    writeln!(text, "BVH SAH cost     {sah_cost:.2}")?;
    let speed = triangles as f64 / build_time.as_secs_f64() / 1e6;
    writeln!(text, "BVH build        {:.1} ms, {speed:.2} M triangles/s", build_time.as_secs_f64() * 1e3)?;
    let buffers = prepared.buffer_bytes();
    let total: u64 = buffers.iter().map(|(_, bytes)| bytes).sum();
    writeln!(
        text,
        "device memory    {}, {:.1} bytes a triangle",
        readable_bytes(total),
        total as f64 / triangles as f64
    )?;
    for (name, bytes) in buffers {
        writeln!(text, "  {name:<20} {}", readable_bytes(bytes))?;
    }
    writeln!(text, "frame            {} bytes", size_of::<layout::Frame>())?;
    print(&text)
}

fn environment(scene: &crate::scene::Scene) -> String {
    use crate::scene::Environment::*;
    match &scene.environment {
        Black => "none".to_owned(),
        Constant(radiance) => format!("constant {radiance}"),
        LatLong(map) => format!("{} ({}x{})", map.path.display(), map.width, map.height),
    }
}

/// Names of the features that the kernels are built with.
fn needs(prepared: &PreparedScene) -> String {
    let f = &prepared.features;
    let named = [
        ("area lights", f.lights),
        ("environment", f.environment != crate::constants::ENVIRONMENT_BLACK),
        ("Phong lobes", f.phong),
        ("mirrors", f.mirror),
        ("refraction", f.refractive),
        ("Fresnel glass", f.dielectric),
        ("textures", f.textures),
        ("shading normals", f.normals),
        ("lens", f.lens),
    ];
    let names: Vec<_> = named.iter().filter(|(_, needed)| *needed).map(|(name, _)| *name).collect();
    if names.is_empty() { "diffuse surfaces alone".to_owned() } else { names.join(", ") }
}
