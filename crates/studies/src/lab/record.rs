//! What belongs to an image: every setting that made it, and where it was made.

use serde_json::{Map, Value, json};

use raywave::gpu::DeviceDescription;
use raywave::render::Statistics;
use raywave::scene::Scene;
use raywave::settings::{self, Settings};

/// Every setting of a render by its key, with what was chosen where it was left open, and how far the render came.
pub fn settings_record(settings: &Settings, statistics: &Statistics) -> Map<String, Value> {
    let resolved = Settings {
        samples: statistics.samples,
        block_samples: Some(settings.block_samples()),
        in_flight: Some(statistics.paths_in_flight),
        paths_per_invocation: Some(statistics.paths_per_invocation),
        ..statistics.choices.settle(settings)
    };
    let mut map = settings::record(&resolved);
    map.extend(object(json!({
        "biased_by": settings.biased_by(),
        "tuned": statistics.choices.tuned,
        "finished_rows_pixels": statistics.rows,
        "samples_by_rows": samples_by_rows(statistics),
        "tile_rows_pixels": statistics.tile_rows,
    })));
    map
}

/// Rows from the top by the samples of their pixels, as "540x8 540x4".
pub fn samples_by_rows(statistics: &Statistics) -> String {
    samples_of_rows(statistics.bands.iter().map(|band| (band.rows, band.samples.into())))
}

/// The same of numbers of rows and of their samples.
pub(super) fn samples_of_rows(bands: impl IntoIterator<Item = (u32, u64)>) -> String {
    let bands: Vec<_> = bands.into_iter().map(|(rows, samples)| format!("{rows}x{samples}")).collect();
    bands.join(" ")
}

/// Every setting of a render and its provenance.
pub fn record(
    scene: &Scene,
    settings: &Settings,
    device: &DeviceDescription,
    statistics: &Statistics,
) -> Map<String, Value> {
    let mut map = object(json!({
        "raywave_version": raywave::VERSION,
        "rustc_version": raywave::RUSTC_VERSION,
        "scene": scene.name,
        "scene_hash": scene.hash,
    }));
    map.extend(settings_record(settings, statistics));
    map.extend(object(json!({
        "device": device.name,
        "device_kind": device.kind.name(),
        "driver": device.driver,
        "vulkan_version": device.vulkan_version,
        "subgroup_size_lanes": device.subgroup_size,
    })));
    map
}

pub(super) fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(map) => map,
        _ => unreachable!("the literals are objects"),
    }
}
