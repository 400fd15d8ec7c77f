//! `raywave dump-rays`: freezes a queue of rays to a file.

use std::path::PathBuf;

use anyhow::ensure;
use clap::ValueEnum;
use indicatif::HumanCount;

use raywave::bvh::MAX_TRIANGLES;
use raywave::rays::{Metadata, RayClass, RayDump, RayOrder, RayScene, RecordLayout, write_distances, write_triangles};
use raywave::render::{Defaults, PreparedScene, Session, distances};
use raywave::scene::Scene;
use raywave::settings::{Named, Scheduler};
use raywave::whole_file::is_same;

use super::picture::PictureArguments;
use super::{check_text_output, load_scene, output_path};

/// Freeze the rays of a bounce to a file, for `raywave replay` and other tracers
///
/// Renders as many pixels and samples as are in flight at once up to the bounce, and writes the rays that wait there.
/// docs/ray-dumps.md tells how to read the file.
#[derive(Debug, clap::Args)]
pub struct DumpRaysArguments {
    /// Scene (.toml, .gltf, .glb, Mitsuba's .xml) or mesh (.obj, .ply); the built-in Cornell box without
    scene: Option<PathBuf>,
    /// Scattering events before the rays: 0 is the camera's, or the first surface's shadow rays
    #[arg(long, value_name = "B")]
    bounce: u32,
    /// Which of the bounce's rays
    #[arg(long, value_name = "KIND", default_value = "path")]
    rays: KindName,
    /// In which order
    #[arg(long, value_name = "ORDER", default_value = "slot")]
    order: OrderName,
    /// File to write; - is stdout
    #[arg(short, long, value_name = "FILE", value_parser = output_path())]
    output: PathBuf,
    /// Write the corners of the scene's triangles in the space of the rays, as .npy
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    triangles: Option<PathBuf>,
    /// Write how far each ray goes, as .npy; shadow rays 0 where blocked
    #[arg(long, value_name = "FILE", value_parser = output_path())]
    distances: Option<PathBuf>,
    #[command(flatten)]
    picture: PictureArguments,
    /// No warnings or summary
    #[arg(long, short)]
    quiet: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum KindName {
    /// Rays to the next surface
    Path,
    /// Rays to a light
    Shadow,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum OrderName {
    /// That of the paths, which is always the same
    Slot,
    /// That of the queue, which some devices leave to chance
    Queue,
}

pub fn run(arguments: &DumpRaysArguments) -> anyhow::Result<()> {
    let outputs = [Some(&arguments.output), arguments.triangles.as_ref(), arguments.distances.as_ref()];
    let outputs: Vec<_> = outputs.into_iter().flatten().collect();
    for (at, path) in outputs.iter().enumerate() {
        check_text_output(path)?;
        for other in &outputs[..at] {
            ensure!(!is_same(path, other)?, "{}: two outputs name this file; name another", path.display());
        }
    }
    let scene = load_scene(arguments.scene.as_deref(), &arguments.picture.load.options(), arguments.quiet)?;
    let mut settings = arguments.picture.settings(&scene)?;
    // The megakernel has no queues to take rays from.
    settings.scheduler.get_or_insert(Scheduler::Wavefront);
    let device = arguments.picture.open_device()?;
    let prepared = PreparedScene::for_device(&scene, &settings, &Defaults::of(&device)?)?;
    let mut session = Session::new(&device, &prepared, &settings)?;
    let class = match (arguments.rays, arguments.bounce) {
        (KindName::Shadow, _) => RayClass::Shadow,
        (KindName::Path, 0) => RayClass::Camera,
        (KindName::Path, _) => RayClass::Bounce,
    };
    let order = match arguments.order {
        OrderName::Slot => RayOrder::Slot,
        OrderName::Queue => RayOrder::Queue,
    };
    let queued = session.dump_rays(&prepared, class, arguments.bounce, order)?;
    ensure!(
        !queued.rays.is_empty(),
        "none of the {} rays is finite; look for what is extreme in the scene",
        queued.left_out
    );

    let of_scene = ray_scene(&scene, &prepared);
    let record = RecordLayout::of_rays(&of_scene);
    let metadata = Metadata {
        raywave_version: raywave::VERSION.to_owned(),
        scene: of_scene,
        class,
        bounce: arguments.bounce,
        rays: queued.rays.len() as u64,
        order,
        width_pixels: settings.width,
        height_pixels: settings.height,
        pixels: queued.batch.pixel_count,
        samples_per_pixel: queued.batch.sample_count,
        seed: settings.seed,
        integrator: settings.integrator.name().to_owned(),
        max_bounces: settings.max_bounces.map_or(-1, i64::from),
        roulette: settings.roulette,
        device: device.description().name.clone(),
        driver: device.description().driver.clone(),
        record,
    };
    let dump = RayDump { metadata, rays: queued.rays };
    if let Some(path) = &arguments.triangles {
        let triangles = scene.triangle_count();
        ensure!(
            triangles <= MAX_TRIANGLES as u64,
            "{}: the scene has {triangles} triangles, of each mesh as many times as it is placed, and {MAX_TRIANGLES} are \
             the most that are written; leave out --triangles",
            path.display()
        );
        write_triangles(path, &prepared.corners())?;
    }
    if let Some(path) = &arguments.distances {
        write_distances(path, &distances(&prepared, class, &dump.rays))?;
    }
    dump.write(&arguments.output)?;
    if !arguments.quiet {
        let Metadata { rays, pixels, samples_per_pixel, .. } = dump.metadata;
        let all = settings.width * settings.height;
        tell!(
            "{}: {} {}; {} of {} pixels, {samples_per_pixel} samples per pixel",
            arguments.output.display(),
            HumanCount(rays),
            class_name(&dump.metadata),
            HumanCount(pixels.into()),
            HumanCount(all.into()),
        );
        if queued.left_out > 0 {
            tell!("warning: {} rays were not finite and are left out", queued.left_out);
        }
    }
    Ok(())
}

/// What ties rays to a scene.
pub fn ray_scene(scene: &Scene, prepared: &PreparedScene) -> RayScene {
    RayScene {
        scene: scene.name.clone(),
        scene_hash: scene.hash.clone(),
        triangles: scene.mesh.triangles.len() as u32,
        placed: scene.placed_counts(),
        centre: prepared.normalisation.centre.to_array(),
        scale: prepared.normalisation.scale,
    }
}

/// What rays are, for people.
pub fn class_name(metadata: &Metadata) -> String {
    match metadata.class {
        RayClass::Camera => "camera rays".to_owned(),
        RayClass::Bounce => format!("rays of bounce {}", metadata.bounce),
        RayClass::Shadow => format!("shadow rays of bounce {}", metadata.bounce),
    }
}
