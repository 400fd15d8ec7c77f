//! Builds a scene in memory, renders it by two schedulers, and shows that their images are the same to the last bit:
//! `cargo run --release --example scene -- glass.png`.

use anyhow::ensure;
use glam::{DVec3, Vec3, dvec3};
use raywave::Renderer;
use raywave::gpu::Device;
use raywave::image::{WriteOptions, write_image};
use raywave::scene::{Camera, Environment, Material, SceneBuilder, shapes};
use raywave::settings::{Integrator, Scheduler, Settings};

fn main() -> anyhow::Result<()> {
    let path = std::env::args_os().nth(1).unwrap_or_else(|| "glass.png".into());
    let scene = SceneBuilder::new(Camera::pinhole(dvec3(2.0, 2.5, 5.0), dvec3(0.0, 0.4, 0.0), 35.0))
        .resolution(320, 240)
        .environment(Environment::Constant(Vec3::splat(0.4)))
        .material(Material::diffuse(Vec3::splat(0.7)))
        .square(dvec3(0.0, -0.5, 0.0), DVec3::Y, 4.0)
        .material(Material::dielectric(1.5))
        .polygons(shapes::cuboid(dvec3(-1.2, -0.499, -0.5), dvec3(-0.2, 0.7, 0.5)))
        .material(Material::phong(Vec3::new(0.1, 0.3, 0.6), Vec3::splat(0.3), 60.0))
        .polygons(shapes::cuboid(dvec3(0.3, -0.499, -0.7), dvec3(1.2, 0.4, 0.2)))
        .material(Material::emitter(Vec3::splat(12.0)))
        .square(dvec3(0.0, 3.0, 0.0), DVec3::NEG_Y, 0.6)
        .build();
    let settings = Settings { samples: 64, integrator: Integrator::Mis, ..scene.settings };

    let renderer = Renderer::new(&Device::find(None)?)?;
    let render = |scheduler| renderer.render(&scene, &Settings { scheduler: Some(scheduler), ..settings });
    let (wavefront, megakernel) = (render(Scheduler::Wavefront)?, render(Scheduler::Megakernel)?);
    let image = wavefront.image();
    ensure!(image == megakernel.image(), "the schedulers' images differ");
    write_image(path.as_ref(), &image, &WriteOptions::default())?;
    for outcome in [wavefront, megakernel] {
        let statistics = outcome.statistics;
        println!("{:?}: {:.2} s", statistics.choices.scheduler, statistics.wall_time.as_secs_f64());
    }
    Ok(())
}
