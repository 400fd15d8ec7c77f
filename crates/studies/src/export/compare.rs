//! A comparison as CSV and Markdown.

use super::csv::Row;
use super::markdown::{escape, head};
use super::numbers::{Unit, count, estimate, grouped, interval, ratio, seconds};
use super::{compiled, plain};
use crate::studies::{Clock, CombinationReport, CrossingDirection, Provenance, RatioVerdict, Report, SceneReport};

/// A row for each combination of each scene.
pub fn rows(report: &Report, provenance: &Provenance) -> Vec<Row> {
    let of_scene = |scene: &'_ SceneReport| -> Vec<Row> {
        scene.combinations.iter().map(|combination| row(report, provenance, scene, combination)).collect()
    };
    report.scenes.iter().flat_map(of_scene).collect()
}

fn row(report: &Report, provenance: &Provenance, scene: &SceneReport, combination: &CombinationReport) -> Row {
    let (first, typical, counters) = (&combination.first, &combination.typical, &combination.counters);
    let ratio = combination.ratio;
    let warnings: Vec<String> = combination.warnings.iter().map(ToString::to_string).collect();

    let mut row = Row::of(provenance, &scene.facts);
    row.text("samples_per_pixel", scene.facts.samples_per_pixel);
    for (factor, _) in &report.factors {
        row.text(&factor.replace('-', "_"), combination.configuration.level(factor).unwrap_or_default());
    }
    row.text("verdict", combination.verdict.word());
    row.count("rank", combination.rank.map(|rank| rank as u64));
    row.text("runs", combination.runs.len());
    row.estimate("seconds", combination.seconds);
    row.estimate("ratio", ratio.map(|ratio| ratio.estimate));
    row.text("ratio_verdict", ratio.map_or("", |r| r.verdict().words()));
    row.number("samples_per_second", combination.samples_per_second());
    row.number("rays_per_second", combination.rays_per_second());
    row.number("wall_seconds", typical.as_ref().map(|t| t.wall_seconds));
    row.number("gpu_seconds", typical.as_ref().map(|t| t.gpu_seconds));
    row.number("idle_before_seconds", combination.idle_before_seconds());
    row.number("clock_megahertz", combination.megahertz());
    row.count("camera_rays", typical.as_ref().map(|t| t.rays.camera));
    row.count("bounce_rays", typical.as_ref().map(|t| t.rays.bounce));
    row.count("shadow_rays", typical.as_ref().map(|t| t.rays.shadow));
    row.number("nodes_visited_per_ray", counters.as_ref().map(|c| c.nodes_per_ray()));
    row.number("triangles_tested_per_ray", counters.as_ref().map(|c| c.triangles_per_ray()));
    row.number("active_lane_share", counters.as_ref().and_then(|c| c.active_lane_share()));
    row.count("memory_bytes", typical.as_ref().map(|t| t.memory_bytes));
    row.count("path_state_bytes", typical.as_ref().map(|t| t.path_state_bytes));
    row.number("path_state_bytes_per_second", combination.path_state_bytes_per_second());
    row.number("first_wall_seconds", first.as_ref().map(|f| f.wall_seconds));
    row.number("cold_start_up_seconds", first.as_ref().and_then(|f| f.cold_start_up_seconds));
    row.number("cached_start_up_seconds", first.as_ref().and_then(|f| f.cached_start_up_seconds));
    row.number("cold_pipeline_seconds", first.as_ref().and_then(|f| f.pipeline_seconds(false)));
    row.number("cached_pipeline_seconds", first.as_ref().and_then(|f| f.pipeline_seconds(true)));
    row.number("differing_pixel_share", combination.verdict.comparison().map(|c| c.share_of_differing_pixels));
    row.text("warnings", warnings.join("; "));
    row
}

/// A table for each scene, and what to distrust below it.
pub fn markdown(report: &Report, provenance: &Provenance) -> String {
    let mut text = head("compare", provenance);
    if !report.complete {
        text += "**The study was not finished; this is what it has so far.**\n\n";
    }
    text += &format!(
        "Medians of the {} clock with {:.0} % intervals. A ratio is time over the baseline's: below 1 is faster.\n",
        match report.clock {
            Clock::Wall => "host's",
            Clock::Gpu => "device's",
        },
        100.0 * report.confidence,
    );
    for scene in &report.scenes {
        text += &scene_text(scene);
    }
    text
}

fn scene_text(scene: &SceneReport) -> String {
    let facts = &scene.facts;
    let mut text = format!(
        "\n## {}\n\n{} x {} pixels, {} samples per pixel\n\n",
        escape(&facts.scene),
        facts.width_pixels,
        facts.height_pixels,
        facts.samples_per_pixel
    );
    let longest = scene.combinations.iter().filter_map(|c| Some(c.seconds?.value)).fold(0.0, f64::max);
    let unit = Unit::of_time(longest);
    text += &format!("| combination | image | time, {} | ratio | samples/s | rays/s |\n", unit.symbol);
    text += "| :-- | :-- | --: | --: | --: | --: |\n";
    for combination in &scene.combinations {
        text += &table_row(combination, unit);
    }
    text += &compiled_kernels(scene);
    text += &starts(scene);
    let notes: Vec<String> = scene.combinations.iter().flat_map(notes).collect();
    if !notes.is_empty() {
        text += &format!("\n{}", notes.concat());
    }
    for crossover in &scene.crossovers {
        let (a, b) = (escape(&crossover.a), escape(&crossover.b));
        if crossover.crossings.is_empty() {
            text += &format!("\n- {a} and {b} do not cross over {}.\n", crossover.factor);
        }
        for crossing in &crossover.crossings {
            let beyond = if crossing.direction == CrossingDirection::AFasterBeyond { &a } else { &b };
            text += &format!(
                "\n- {a} and {b} cross at {} {}; {beyond} is faster beyond.\n",
                crossover.factor,
                estimate(&crossing.cost, |cost| format!("{cost:.0}")),
            );
        }
    }
    text
}

fn table_row(combination: &CombinationReport, unit: Unit) -> String {
    let rate = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), count);
    let seconds = combination.seconds.map_or_else(|| "–".to_owned(), |seconds| interval(&seconds, unit));
    let against = match &combination.ratio {
        Some(found) if found.verdict() == RatioVerdict::WithinNoise => {
            format!("{}, within noise", ratio(&found.estimate))
        }
        Some(found) => ratio(&found.estimate),
        None if combination.label == combination.baseline => "1".to_owned(),
        None => "–".to_owned(),
    };
    let verdict = if combination.verdict.counts() {
        combination.verdict.word().to_owned()
    } else {
        format!("**{}**", combination.verdict.word())
    };
    format!(
        "| {} | {verdict} | {seconds} | {against} | {} | {} |\n",
        escape(&combination.label),
        rate(combination.samples_per_second()),
        rate(combination.rays_per_second()),
    )
}

/// A table of start-ups, where they were measured.
fn starts(scene: &SceneReport) -> String {
    let firsts = scene.combinations.iter().filter_map(|c| Some((c, c.first.as_ref()?)));
    let measured: Vec<_> = firsts.filter(|(_, first)| first.cold_start_up_seconds.is_some()).collect();
    if measured.is_empty() {
        return String::new();
    }
    let mut text =
        "\n| start-up | first render | to first sample, cold | cached | pipelines, cold | cached |\n".to_owned();
    text += "| :-- | --: | --: | --: | --: | --: |\n";
    for (combination, first) in measured {
        let times = [
            Some(first.wall_seconds),
            first.cold_start_up_seconds,
            first.cached_start_up_seconds,
            first.pipeline_seconds(false),
            first.pipeline_seconds(true),
        ];
        let cells = times.map(|time| time.map_or_else(|| "–".to_owned(), seconds));
        text += &format!("| {} | {} |\n", escape(&combination.label), cells.join(" | "));
    }
    text
}

/// A table of what the compiler made of each kernel, where it was asked.
fn compiled_kernels(scene: &SceneReport) -> String {
    let rows: Vec<_> =
        scene.combinations.iter().flat_map(|c| compiled::kernels(c).into_iter().map(move |row| (c, row))).collect();
    if rows.is_empty() {
        return String::new();
    }
    let figures = compiled::figures(rows.iter().map(|(_, row)| row));
    let heads = ["compiled", "kernel", "time", "SPIR-V instructions", "lanes", compiled::OCCUPANCY];
    let heads: Vec<String> = heads.into_iter().chain(figures.iter().copied()).map(escape).collect();
    let mut text = format!("\n| {} |\n| :-- | :--{} |\n", heads.join(" | "), " | --:".repeat(heads.len() - 2));
    let dash = || "–".to_owned();
    for (combination, row) in &rows {
        let mut cells = vec![
            escape(&combination.label),
            escape(&row.name),
            row.gpu_seconds.map_or_else(dash, seconds),
            grouped(row.spirv_instructions),
            row.lanes().map_or_else(dash, |lanes| lanes.to_string()),
            row.occupancy.map_or_else(dash, |share| format!("{:.0} %", 100.0 * share)),
        ];
        cells.extend(figures.iter().map(|name| row.figure(name).map_or_else(dash, |value| escape(&plain(value)))));
        text += &format!("| {} |\n", cells.join(" | "));
    }
    if rows.iter().all(|(_, row)| row.executable.is_none()) {
        text += &format!("\n{}\n", compiled::UNTOLD);
    }
    text
}

fn notes(combination: &CombinationReport) -> Vec<String> {
    let gate = (!combination.verdict.counts()).then(|| combination.verdict.explanation());
    let all = gate.into_iter().chain(combination.warnings.iter().map(ToString::to_string));
    all.map(|note| format!("- {}: {}\n", escape(&combination.label), escape(&note))).collect()
}
