//! Runs a kernel of its own, `shaders/luminance_bins.comp`, on a rendered image: `cargo run --release --example kernel`.
//!
//! `build.rs` compiles what lies in `examples/shaders`, as it does the path tracer's kernels, and writes a table of it.
//! What a kernel binds, and what barriers it needs, follows from its SPIR-V: the host says which buffers there are, and in
//! which order to launch, upload and download.

use anyhow::ensure;
use bytemuck::{Pod, Zeroable};
use raywave::Renderer;
use raywave::constants::Specialization;
use raywave::gpu::{BufferRole, BufferUse, Device, Executor, ExecutorDescription};
use raywave::recording::Recording;
use raywave::scene::Scene;
use raywave::settings::Settings;
use raywave::shaders::{Access, Arithmetic, Binding, BindingKind, Edition, Kernel};

include!(concat!(env!("OUT_DIR"), "/examples.rs"));

/// As the kernel's push constants.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Arguments {
    pixel_count: u32,
}

const WORKGROUP: u32 = 64;

fn main() -> anyhow::Result<()> {
    let scene = Scene::cornell_box();
    let device = Device::find(None)?;
    let settings = Settings { width: 256, height: 256, samples: 16, ..scene.settings };
    let image = Renderer::new(&device)?.render(&scene, &settings)?.image();
    let radiances: Vec<[f32; 4]> = image.pixels.iter().map(|pixel| pixel.extend(0.0).to_array()).collect();
    let bytes: &[u8] = bytemuck::cast_slice(&radiances);

    let state = |name, size| BufferRole { name, usage: BufferUse::State, size, contents: None };
    let description = ExecutorDescription {
        kernels: &[kernels::LUMINANCE_BINS],
        specialization: &Specialization { workgroup_size: WORKGROUP, ..Specialization::DEFAULT }.words(),
        buffers: vec![
            BufferRole { contents: Some(bytes), ..state(buffers::PIXELS, bytes.len() as u64) },
            state(buffers::BINS, 256 * 4),
        ],
        access: Access { texel_fetch: false, subgroup_ballot: false },
        edition: Edition::Plain,
        arithmetic: Arithmetic::Native,
        driver: None,
    };
    let mut executor = Executor::new(&device, description)?;
    let arguments = Arguments { pixel_count: radiances.len() as u32 };
    let mut recording = Recording::default();
    recording.clear(buffers::BINS);
    recording.dispatch(kernels::LUMINANCE_BINS, arguments.pixel_count.div_ceil(WORKGROUP), &arguments);
    recording.download(buffers::BINS);
    let counts: Vec<u32> = bytemuck::pod_collect_to_vec(&executor.run(&recording)?[0]);

    // The device multiplies and adds as the host does, without fusing, so the counts are the same.
    let mut expected = vec![0; 256];
    for [red, green, blue, _] in radiances {
        let luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue;
        expected[(luminance.to_bits() >> 23) as usize] += 1;
    }
    ensure!(counts == expected, "the kernel counts otherwise than the host");
    for (exponent, count) in (-127..).zip(counts).filter(|(_, count)| *count > 0) {
        println!("2^{exponent:<4} {count}");
    }
    Ok(())
}
