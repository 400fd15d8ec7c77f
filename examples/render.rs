//! Renders a scene file to an image: `cargo run --release --example render -- scenes/cornell-box.toml box.png`.

use std::path::PathBuf;

use anyhow::bail;
use raywave::Renderer;
use raywave::gpu::Device;
use raywave::image::{WriteOptions, write_image};
use raywave::scene::Scene;

fn main() -> anyhow::Result<()> {
    let paths: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [scene, image] = &paths[..] else { bail!("usage: render SCENE.toml IMAGE.exr|png|hdr") };
    let scene = Scene::load(scene)?;
    let outcome = Renderer::new(&Device::find(None)?)?.render(&scene, &scene.settings)?;
    write_image(image, &outcome.image(), &WriteOptions::default())?;
    println!("{} rays in {:.2} s", outcome.statistics.rays(), outcome.statistics.wall_time.as_secs_f64());
    Ok(())
}
