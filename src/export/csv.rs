//! Comma-separated values.

use super::Document;
use crate::studies::{CombinationReport, SceneReport};

/// The header and a row for each combination.
pub fn write(document: &Document<'_>) -> String {
    let factors: Vec<&str> = document.report.factors.iter().map(|(name, _)| *name).collect();
    let mut lines = Vec::new();
    for scene in &document.report.scenes {
        for combination in &scene.combinations {
            let cells = cells(document, scene, combination, &factors);
            if lines.is_empty() {
                lines.push(line(cells.iter().map(|(name, _)| name.as_str())));
            }
            lines.push(line(cells.iter().map(|(_, value)| value.as_str())));
        }
    }
    lines.concat()
}

/// Names and values of a row, in one place, so that they cannot fall apart.
fn cells(
    document: &Document<'_>,
    scene: &SceneReport,
    combination: &CombinationReport,
    factors: &[&str],
) -> Vec<(String, String)> {
    let number = |value: Option<f64>| value.filter(|v| v.is_finite()).map_or_else(String::new, |v| v.to_string());
    let count = |value: Option<u64>| value.map_or_else(String::new, |v| v.to_string());
    let (provenance, facts) = (document.provenance, &scene.facts);
    let (first, typical, counters) = (&combination.first, &combination.typical, &combination.counters);
    let (seconds, ratio) = (combination.seconds, combination.ratio);
    let seconds_interval = seconds.and_then(|seconds| seconds.interval);
    let ratio_interval = ratio.and_then(|ratio| ratio.estimate.interval);
    let warnings: Vec<String> = combination.warnings.iter().map(ToString::to_string).collect();

    let mut cells = vec![
        ("device", provenance.device.clone()),
        ("driver", provenance.driver.clone()),
        ("raywave_version", provenance.raywave_version.clone()),
        ("scene", facts.scene.clone()),
        ("scene_hash", facts.scene_hash.clone()),
        ("width_pixels", facts.width_pixels.to_string()),
        ("height_pixels", facts.height_pixels.to_string()),
        ("samples_per_pixel", facts.samples_per_pixel.to_string()),
    ];
    for factor in factors {
        cells.push((factor, combination.configuration.level(factor).unwrap_or_default().to_owned()));
    }
    cells.extend([
        ("verdict", combination.verdict.word().to_owned()),
        ("rank", count(combination.rank.map(|rank| rank as u64))),
        ("runs", combination.runs.len().to_string()),
        ("seconds", number(seconds.map(|s| s.value))),
        ("seconds_low", number(seconds_interval.map(|i| i.low))),
        ("seconds_high", number(seconds_interval.map(|i| i.high))),
        ("ratio", number(ratio.map(|r| r.estimate.value))),
        ("ratio_low", number(ratio_interval.map(|i| i.low))),
        ("ratio_high", number(ratio_interval.map(|i| i.high))),
        ("ratio_verdict", ratio.map_or("", |r| r.verdict().words()).to_owned()),
        ("samples_per_second", number(combination.samples_per_second())),
        ("rays_per_second", number(combination.rays_per_second())),
        ("wall_seconds", number(typical.as_ref().map(|t| t.wall_seconds))),
        ("gpu_seconds", number(typical.as_ref().map(|t| t.gpu_seconds))),
        ("idle_before_seconds", number(combination.idle_before_seconds())),
        ("clock_megahertz", number(combination.megahertz())),
        ("camera_rays", count(typical.as_ref().map(|t| t.rays.camera))),
        ("bounce_rays", count(typical.as_ref().map(|t| t.rays.bounce))),
        ("shadow_rays", count(typical.as_ref().map(|t| t.rays.shadow))),
        ("nodes_visited_per_ray", number(counters.as_ref().map(|c| c.nodes_per_ray()))),
        ("triangles_tested_per_ray", number(counters.as_ref().map(|c| c.triangles_per_ray()))),
        ("active_lane_share", number(counters.as_ref().and_then(|c| c.active_lane_share()))),
        ("memory_bytes", count(typical.as_ref().map(|t| t.memory_bytes))),
        ("path_state_bytes", count(typical.as_ref().map(|t| t.path_state_bytes))),
        ("path_state_bytes_per_second", number(combination.path_state_bytes_per_second())),
        ("first_wall_seconds", number(first.as_ref().map(|f| f.wall_seconds))),
        ("cold_start_up_seconds", number(first.as_ref().and_then(|f| f.cold_start_up_seconds))),
        ("cached_start_up_seconds", number(first.as_ref().and_then(|f| f.cached_start_up_seconds))),
        ("cold_pipeline_seconds", number(first.as_ref().and_then(|f| f.pipeline_seconds(false)))),
        ("cached_pipeline_seconds", number(first.as_ref().and_then(|f| f.pipeline_seconds(true)))),
        ("differing_pixel_share", number(combination.verdict.comparison().map(|c| c.share_of_differing_pixels))),
        ("warnings", warnings.join("; ")),
    ]);
    cells.into_iter().map(|(name, value)| (name.replace('-', "_"), value)).collect()
}

pub fn line<'a>(cells: impl Iterator<Item = &'a str>) -> String {
    cells.map(quote).collect::<Vec<_>>().join(",") + "\r\n"
}

fn quote(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.to_owned() }
}
