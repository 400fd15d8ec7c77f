//! The page of a comparison: times, ratios to the baseline, where the time goes, and the images.

use serde_json::Value;

use super::images::{PageImages, image_figure};
use super::page::{Frame, Page, legend};
use super::plots::{self, KernelColours, RatioRow, crossing_text};
use super::svg::escape;
use super::table::{Cell, table};
use crate::export::numbers::{Unit, bounds, bytes, grouped, power_of_ten, seconds, significant};
use crate::export::{compiled, plain};
use crate::stats::{Interval, TOO_FEW_ROUNDS};
use crate::studies::{
    Clock, CombinationReport, Measurement, Provenance, RatioVerdict, Report, SceneReport, StageWork, Verdict,
};

/// Most rows of the plot of all scenes; above, it shows only each scene's fastest.
const MAX_OVERVIEW_ROWS: usize = 40;

/// The page of a report.
pub fn page(report: &Report, provenance: &Provenance, page: &mut Page) -> String {
    let mut images = page.images();
    let colours = KernelColours::of(&report.scenes);
    let scenes: String =
        report.scenes.iter().enumerate().map(|(i, scene)| scene_article(i, scene, &colours, &mut images)).collect();
    let title = title(report);
    let main = format!(
        "{overview}{speeds}<section id=\"scenes\"><h2>Where the time goes</h2>\n{tabs}{scenes}</section>\n\
         {work}{compiled}{starts}{caveats}",
        overview = overview(report),
        speeds = speeds(report),
        tabs = tabs(report),
        work = work(report),
        compiled = compiled_kernels(report),
        starts = starts(report),
        caveats = caveats(report),
    );
    let frame = Frame {
        command: "compare",
        title: &title,
        heading: &title,
        unfinished: (!report.complete).then_some("This study was not finished. The page shows what it had so far."),
        findings: report.scenes.iter().flat_map(findings).collect(),
        style: "",
        main,
        provenance: entries(report),
    };
    frame.html(provenance, images.into_uris())
}

/// The factors that have several levels.
fn varied(report: &Report) -> impl Iterator<Item = &'static str> {
    report.factors.iter().filter(|(_, levels)| levels.len() > 1).map(|(name, _)| *name)
}

fn title(report: &Report) -> String {
    let names: Vec<&str> = varied(report).collect();
    escape(&if names.is_empty() { "one configuration".to_owned() } else { names.join(" × ") })
}

/// What came of a scene, in sentences of HTML.
fn findings(scene: &SceneReport) -> Vec<String> {
    let name = escape(&scene.facts.scene);
    let mut findings = Vec::new();
    for crossover in &scene.crossovers {
        let (a, b) = (escape(&crossover.a), escape(&crossover.b));
        let crossings: Vec<String> = crossover.crossings.iter().map(|c| escape(&crossing_text(crossover, c))).collect();
        let text = if crossings.is_empty() {
            format!("{a} and {b} do not cross over {}", escape(crossover.factor))
        } else {
            crossings.join("; ")
        };
        findings.push(format!("<b>{name}</b> {text}"));
    }
    if scene.crossovers.is_empty() {
        let with_ratio = scene.combinations.iter().filter_map(|c| Some((c, c.ratio?)));
        let best = with_ratio.min_by(|a, b| a.1.estimate.value.total_cmp(&b.1.estimate.value));
        if let Some((best, found)) = best {
            let (label, base) = (escape(&best.label), escape(&best.baseline));
            let times = |value: f64, from: f64, to: f64| format!("{value:.2}× <small>[{from:.2}, {to:.2}]</small>");
            let value = found.estimate.value;
            let Interval { low, high } = found.estimate.interval.unwrap_or(Interval { low: value, high: value });
            let time = times(value, low, high);
            findings.push(match found.verdict() {
                RatioVerdict::TooFewRounds => format!(
                    "<b>{name}</b> {TOO_FEW_ROUNDS} to say what is fastest; {label} took {value:.2}× the time of {base}"
                ),
                RatioVerdict::WithinNoise => {
                    format!("<b>{name}</b> no combination beats {base} beyond noise; {label} takes {time} its time")
                }
                RatioVerdict::Faster => {
                    let speed = times(1.0 / value, 1.0 / high, 1.0 / low);
                    format!("<b>{name}</b> {label} is {speed} as fast as {base}")
                }
                RatioVerdict::Slower => {
                    format!("<b>{name}</b> {base} is fastest; {label}, the next, takes {time} its time")
                }
            });
        }
    }
    let wrong = scene.combinations.iter().filter(|c| matches!(c.verdict, Verdict::Wrong { .. })).count();
    if wrong > 0 {
        let what = if wrong == 1 { "combination renders" } else { "combinations render" };
        findings.push(format!("<b>{name}</b> <em class=\"wrong\">{wrong} {what} a wrong image</em> and cannot win"));
    }
    findings
}

fn overview(report: &Report) -> String {
    let others = |scene: &SceneReport| (0..scene.combinations.len()).filter(|&i| !scene.is_baseline(i)).count();
    if report.scenes.iter().all(|scene| others(scene) == 0) {
        return String::new();
    }
    let whole = report.scenes.iter().map(others).sum::<usize>() <= MAX_OVERVIEW_ROWS;
    let mut groups = Vec::new();
    for scene in &report.scenes {
        let mut rows: Vec<RatioRow<'_>> = Vec::new();
        for (i, combination) in scene.combinations.iter().enumerate() {
            if !scene.is_baseline(i) {
                rows.push(ratio_row(combination));
            }
        }
        if !whole {
            let value = |row: &RatioRow<'_>| row.ratio.map_or(f64::INFINITY, |ratio| ratio.estimate.value);
            rows.sort_by(|a, b| value(a).total_cmp(&value(b)));
            rows.truncate(1);
        }
        groups.push((scene.facts.scene.clone(), rows));
    }
    let which = if whole { "" } else { "Each scene's fastest combination; all of them are below, by scene. " };
    format!(
        "<section id=\"ratios\"><h2>Against the baseline</h2>\n<p>{which}Bars are {:.0} % intervals; those that \
         contain 1 are within noise and grey, and rings have {TOO_FEW_ROUNDS} for an interval.</p>\n<figure>{}</figure></section>\n",
        100.0 * report.confidence,
        plots::ratios(&groups)
    )
}

fn ratio_row(combination: &CombinationReport) -> RatioRow<'_> {
    let otherwise = match &combination.verdict {
        Verdict::Wrong { .. } => "wrong image, not ranked".to_owned(),
        Verdict::Failed { .. } => "did not run".to_owned(),
        _ => "not measured yet".to_owned(),
    };
    RatioRow { label: &combination.label, ratio: combination.ratio.as_ref(), otherwise }
}

/// Rows of a table over all combinations: the scene and the factors, then what `cells` adds.
fn rows(report: &Report, cells: impl Fn(&SceneReport, &CombinationReport) -> Vec<Cell>) -> Vec<(String, Vec<Cell>)> {
    several_rows(report, |scene, combination| vec![cells(scene, combination)])
}

/// As [`rows`], with any number of rows for a combination.
fn several_rows(
    report: &Report,
    cells: impl Fn(&SceneReport, &CombinationReport) -> Vec<Vec<Cell>>,
) -> Vec<(String, Vec<Cell>)> {
    let mut rows = Vec::new();
    for scene in &report.scenes {
        for (i, combination) in scene.combinations.iter().enumerate() {
            let class = if scene.is_baseline(i) { "baseline" } else { combination.verdict.word() };
            for cells in cells(scene, combination) {
                let mut row = vec![Cell::text(&scene.facts.scene)];
                row.extend(varied(report).map(|factor| {
                    let level = combination.configuration.level(factor).unwrap_or_default();
                    let count = combination.configuration.count(factor);
                    let key = count.map_or(level.to_owned(), |count| count.to_string());
                    Cell::html(escape(level), &key)
                }));
                row.extend(cells);
                rows.push((class.to_owned(), row));
            }
        }
    }
    rows
}

fn columns(report: &Report, more: &[(&str, &'static str)]) -> Vec<(String, &'static str)> {
    let factors = varied(report).map(|factor| (factor.to_owned(), ""));
    let more = more.iter().map(|&(name, unit)| (name.to_owned(), unit));
    std::iter::once(("scene".to_owned(), "")).chain(factors).chain(more).collect()
}

/// The unit in which the longest time of the report is at least 1.
fn time_unit(report: &Report) -> Unit {
    let times = report.scenes.iter().flat_map(|scene| &scene.combinations).filter_map(|c| Some(c.seconds?.value));
    Unit::of_time(times.fold(0.0, f64::max))
}

fn speeds(report: &Report) -> String {
    let unit = time_unit(report);
    let confidence = format!("{:.0} % interval", 100.0 * report.confidence);
    let columns = columns(
        report,
        &[
            ("image", ""),
            ("time", unit.symbol),
            ("ratio", "to baseline"),
            ("samples", "M/s"),
            ("rays", "M/s"),
            ("device time", unit.symbol),
            ("idle before", ""),
            ("clock", "MHz"),
            ("runs", ""),
            ("caveats", ""),
        ],
    );
    let rows = rows(report, |_, c| {
        let typical = c.typical.as_ref();
        let mega = |value: f64| significant(value / 1e6, 3);
        let explanation = escape(&c.verdict.explanation());
        let image = format!("<span class=\"{0}\" title=\"{explanation}\">{0}</span>", c.verdict.word());
        let three = |value: f64| format!("{value:.3}");
        let own = matches!(c.verdict, Verdict::Baseline).then_some(1.0);
        let ratio = c.ratio.map(|ratio| ratio.estimate);
        vec![
            Cell::html(image, c.verdict.word()),
            Cell::number(c.seconds.map(|s| s.value), |v| unit.number(v))
                .with_interval(c.seconds.map(|s| bounds(&s, |v| unit.number(v)))),
            Cell::number(ratio.map(|r| r.value).or(own), three).with_interval(ratio.map(|r| bounds(&r, three))),
            Cell::number(c.samples_per_second(), mega),
            Cell::number(c.rays_per_second(), mega),
            Cell::number(typical.map(|t| t.gpu_seconds).filter(|s| *s > 0.0), |v| unit.number(v)),
            Cell::number(c.idle_before_seconds(), seconds),
            Cell::number(c.megahertz(), |v| format!("{v:.0}")),
            Cell::number(Some(c.runs.len() as f64), |v| v.to_string()),
            Cell::number(Some(caveats_of(c).len() as f64).filter(|n| *n > 0.0), |v| v.to_string()).linked("#caveats"),
        ]
    });
    format!(
        "<section id=\"speeds\"><h2>Speeds</h2>\n<p>Medians of the {} clock; {confidence}s beside them. Idle before \
         is how long the device had nothing to do until a run began. A heading sorts by its column.</p>\n{}</section>\n",
        clock(report),
        table("Speeds of all combinations", &columns, &rows)
    )
}

fn clock(report: &Report) -> &'static str {
    match report.clock {
        Clock::Wall => "host's",
        Clock::Gpu => "device's",
    }
}

fn tabs(report: &Report) -> String {
    if report.scenes.len() < 2 {
        return String::new();
    }
    let tab = |(i, scene): (usize, &SceneReport)| {
        format!(
            "<button type=\"button\" role=\"tab\" id=\"tab-{i}\" aria-controls=\"scene-{i}\">{}</button>",
            escape(&scene.facts.scene)
        )
    };
    let tabs: String = report.scenes.iter().enumerate().map(tab).collect();
    format!("<div class=\"tabs\" role=\"tablist\" aria-label=\"Scene\">{tabs}</div>\n")
}

/// Stages whose work is counted.
const STAGES: [&str; 3] = ["extend", "shade", "connect"];

fn scene_article(number: usize, scene: &SceneReport, colours: &KernelColours, images: &mut PageImages<'_>) -> String {
    let facts = &scene.facts;
    let mut html = format!(
        "<article id=\"scene-{number}\">\n<h3>{} <small>{} × {} pixels, {} samples per pixel, {} triangles, {} BVH nodes</small></h3>\n",
        escape(&facts.scene),
        facts.width_pixels,
        facts.height_pixels,
        facts.samples_per_pixel,
        grouped(facts.triangles),
        grouped(facts.bvh_nodes),
    );
    let timed: Vec<&CombinationReport> = scene.combinations.iter().filter(|c| c.typical.is_some()).collect();
    if !timed.is_empty() {
        let kernels = timed.iter().filter_map(|c| c.typical.as_ref()).flat_map(|t| &t.kernels);
        let mut names: Vec<&str> = Vec::new();
        for kernel in kernels {
            if !names.contains(&kernel.kernel.as_str()) {
                names.push(&kernel.kernel);
            }
        }
        html += &format!(
            "<figure><figcaption>Time of each kernel in the median run{}</figcaption>{}</figure>\n",
            legend(
                names
                    .iter()
                    .map(|name| (colours.class(name), *name))
                    .chain([("outside".to_owned(), "outside kernels")])
            ),
            plots::kernel_times(&timed, colours)
        );
    }
    let with_bounces = |c: &&&CombinationReport| c.typical.as_ref().is_some_and(|t| !t.bounces.is_empty());
    if let Some(Some((label, typical))) = timed.iter().find(with_bounces).map(|c| Some((&c.label, c.typical.as_ref()?)))
    {
        html += &format!(
            "<figure><figcaption>Bounce by bounce: {}{}</figcaption>{}</figure>\n",
            escape(label),
            bounce_legend(typical, colours),
            plots::bounces(typical, colours)
        );
    }
    let lanes = |c: &CombinationReport| c.counters.as_ref()?.active_lane_share();
    let counted: Vec<_> = timed.iter().filter_map(|c| Some((*c, lanes(c)?))).collect();
    if let Some(&(first, share)) = counted.first() {
        // Next to the first, the one that differs most from it: the others differ in what lanes do not see.
        let apart = |&&(_, other): &&(&CombinationReport, f64)| (other - share).abs();
        let other = counted[1..].iter().max_by(|a, b| apart(a).total_cmp(&apart(b)));
        let panels: Vec<_> = [Some(first), other.map(|other| other.0)].into_iter().flatten().collect();
        html += &format!(
            "<figure><figcaption>Share of active lanes{}</figcaption>{}</figure>\n",
            legend(STAGES.map(|stage| (colours.class(stage), stage)).into_iter()),
            plots::lanes(&panels, colours)
        );
    }
    for crossover in &scene.crossovers {
        let found: Vec<String> = crossover.crossings.iter().map(|c| escape(&crossing_text(crossover, c))).collect();
        let found = if found.is_empty() { "no crossing".to_owned() } else { found.join("; ") };
        html += &format!(
            "<figure><figcaption>Crossover over {}: {found}</figcaption>{}</figure>\n",
            escape(crossover.factor),
            plots::crossover(crossover)
        );
    }
    html += &slider(scene, images);
    html += "</article>\n";
    html
}

fn bounce_legend(measurement: &Measurement, colours: &KernelColours) -> String {
    let mut names: Vec<&str> = Vec::new();
    for row in &measurement.bounces {
        if !names.contains(&row.kernel.as_str()) {
            names.push(&row.kernel);
        }
    }
    legend(names.iter().map(|name| (colours.class(name), *name)))
}

/// The baseline's image and another's, with a divider to drag, and their difference.
fn slider(scene: &SceneReport, images: &mut PageImages<'_>) -> String {
    let mut options = String::new();
    for i in 0..scene.combinations.len() {
        let (other, base) = (&scene.combinations[i], scene.baseline_of(i));
        let (Some(image), Some(base_image)) = (&other.image, &base.image) else { continue };
        if scene.is_baseline(i) {
            continue;
        }
        let (left, right) = (images.add_image(base_image), images.add_image(image));
        let (heat, note) = match other.verdict.comparison() {
            Some(comparison) if (image.width, image.height) == (base_image.width, base_image.height) => {
                let (heat, low, high) = images.add_difference(image, base_image);
                let note = format!(
                    "{:.3} % of the pixels differ; relMSE {:.2e}, z {:.2}. Heat map: relative squared error, {} (black) to {} (yellow)",
                    100.0 * comparison.share_of_differing_pixels,
                    comparison.whole.rel_mse,
                    comparison.whole.z,
                    power_of_ten(low as i32),
                    power_of_ten(high as i32),
                );
                (heat.to_string(), note)
            }
            _ => (String::new(), other.verdict.explanation()),
        };
        let [base, label, note] = [&base.label, &other.label, &note].map(|text| escape(text));
        options += &format!(
            "<option data-left=\"{left}\" data-right=\"{right}\" data-heat=\"{heat}\" data-base=\"{base}\" \
             data-note=\"{note}\">{label}</option>\n"
        );
    }
    let size = (scene.facts.width_pixels, scene.facts.height_pixels);
    image_figure("The images", &options, size)
}

fn work(report: &Report) -> String {
    let columns = columns(
        report,
        &[
            ("camera", "M rays"),
            ("bounce", "M rays"),
            ("shadow", "M rays"),
            ("nodes", "per ray"),
            ("triangles", "per ray"),
            ("lanes", "%"),
            ("path state", ""),
            ("moved at", ""),
            ("memory", ""),
        ],
    );
    let rows = rows(report, |_, c| {
        let typical = c.typical.as_ref();
        let counters = c.counters.as_ref();
        let rays =
            |pick: fn(&Measurement) -> u64| Cell::number(typical.map(|t| pick(t) as f64), |v| significant(v / 1e6, 3));
        let some_bytes = |value: Option<f64>, unit: &str| {
            Cell::number(value.filter(|b| *b > 0.0), |v| format!("{}{unit}", bytes(v)))
        };
        vec![
            rays(|t| t.rays.camera),
            rays(|t| t.rays.bounce),
            rays(|t| t.rays.shadow),
            Cell::number(counters.map(|c| c.nodes_per_ray()), |v| significant(v, 3)),
            Cell::number(counters.map(|c| c.triangles_per_ray()), |v| significant(v, 3)),
            Cell::number(counters.and_then(|c| c.active_lane_share()), |v| significant(100.0 * v, 3)),
            some_bytes(typical.map(|t| t.path_state_bytes as f64), ""),
            some_bytes(c.path_state_bytes_per_second(), "/s"),
            some_bytes(typical.map(|t| t.memory_bytes as f64), ""),
        ]
    });
    format!(
        "<section id=\"work\"><h2>Work</h2>\n<p>Nodes, triangles and lanes are counted in a render of their own, never \
         in a timed one. Path state is what the kernels read and write of it, caches left aside. Lanes are the share of a \
         subgroup's lanes that take part in a node visit, a triangle test or a shading.</p>\n{}{}</section>\n",
        table("Work of all combinations", &columns, &rows),
        stage_work(report)
    )
}

/// What each stage did over all bounces, of the combinations that were counted.
fn stage_work(report: &Report) -> String {
    let columns = columns(
        report,
        &[("stage", ""), ("items", "M"), ("nodes", "per item"), ("triangles", "per item"), ("lanes", "%")],
    );
    let rows: Vec<_> = STAGES
        .iter()
        .flat_map(|stage| {
            rows(report, |_, c| {
                let work = c.counters.as_ref().map(|counters| counters.over_bounces(stage));
                let work = work.as_ref().filter(|work| work.items > 0);
                let per_item = |of: fn(&StageWork) -> u64| {
                    Cell::number(work.map(|w| of(w) as f64 / w.items as f64).filter(|v| *v > 0.0), |v| {
                        significant(v, 3)
                    })
                };
                vec![
                    Cell::text(stage),
                    Cell::number(work.map(|w| w.items as f64), |v| significant(v / 1e6, 3)),
                    per_item(|w| w.nodes_visited),
                    per_item(|w| w.triangles_tested),
                    Cell::number(work.and_then(StageWork::active_lane_share), |v| significant(100.0 * v, 3)),
                ]
            })
        })
        .collect();
    table("Work of the stages", &columns, &rows)
}

/// Statistics of each compiled kernel, next to its time.
fn compiled_kernels(report: &Report) -> String {
    let combinations = report.scenes.iter().flat_map(|scene| &scene.combinations);
    let all: Vec<_> = combinations.flat_map(compiled::kernels).collect();
    if all.is_empty() {
        return String::new();
    }
    let figures = compiled::figures(all.iter());
    let unit = time_unit(report);
    let fixed = [("kernel", ""), ("time", unit.symbol), ("instructions", "SPIR-V"), ("lanes", ""), ("occupancy", "%")];
    let mut columns = columns(report, &fixed);
    columns.extend(figures.iter().map(|name| ((*name).to_owned(), "")));
    let figure = |value: Option<&Value>| match value {
        Some(Value::Bool(is)) => Cell::text(if *is { "yes" } else { "no" }),
        value => Cell::number(value.and_then(Value::as_f64), |_| value.map_or_else(String::new, plain)),
    };
    let row = |row: compiled::Row<'_>| {
        let mut cells = vec![
            Cell::text(&row.name),
            Cell::number(row.gpu_seconds, |v| unit.number(v)),
            Cell::number(Some(row.spirv_instructions as f64), |_| grouped(row.spirv_instructions)),
            Cell::number(row.lanes().map(f64::from), |v| v.to_string()),
            Cell::number(row.occupancy, |share| format!("{:.0}", 100.0 * share)),
        ];
        cells.extend(figures.iter().map(|name| figure(row.figure(name))));
        cells
    };
    let rows = several_rows(report, |_, c| compiled::kernels(c).into_iter().map(row).collect());
    let untold = if all.iter().all(|row| row.executable.is_none()) { compiled::UNTOLD } else { "" };
    format!(
        "<section id=\"compiled\"><h2>Compiled</h2>\n<p>What the compiler made of each kernel, in pipelines that nothing \
         runs: instructions of the specialised SPIR-V, and what the driver reports, by its own names, next to the kernel's \
         time in the median run. Occupancy is the share of a multiprocessor's warps for which there are registers. \
         {untold}</p>\n{}</section>\n",
        table("Compiled kernels of all combinations", &columns, &rows)
    )
}

fn starts(report: &Report) -> String {
    let columns = columns(
        report,
        &[
            ("first render", ""),
            ("over the median", "×"),
            ("start-up, cold", ""),
            ("start-up, cached", ""),
            ("pipelines, cold", ""),
            ("pipelines, cached", ""),
        ],
    );
    let rows = rows(report, |_, c| {
        let first = c.first.as_ref();
        let time = |pick: fn(&Measurement) -> Option<f64>| Cell::number(first.and_then(pick), seconds);
        let slower = first.and_then(|first| Some(first.wall_seconds / c.seconds?.value));
        vec![
            Cell::number(first.map(|f| f.wall_seconds), seconds),
            Cell::number(slower, |v| format!("{v:.2}")),
            time(|f| f.cold_start_up_seconds),
            time(|f| f.cached_start_up_seconds),
            time(|f| f.pipeline_seconds(false)),
            time(|f| f.pipeline_seconds(true)),
        ]
    });
    format!(
        "<section id=\"start-up\"><h2>Start-up</h2>\n<p>First renders are in no statistic above. \
         Start-up runs from the start of a process to the end of its first sample, pipelines until they have been \
         launched once; both by processes of their own, without any cache of compiled kernels and with all of them \
         filled.</p>\n{}</section>\n",
        table("Start-up of all combinations", &columns, &rows)
    )
}

/// What to distrust in a combination.
fn caveats_of(combination: &CombinationReport) -> Vec<String> {
    let gate = matches!(combination.verdict, Verdict::Wrong { .. } | Verdict::Failed { .. })
        .then(|| format!("{}: {}", combination.verdict.word(), combination.verdict.explanation()));
    gate.into_iter().chain(combination.warnings.iter().map(ToString::to_string)).collect()
}

fn caveats(report: &Report) -> String {
    let mut items = String::new();
    for scene in &report.scenes {
        for combination in &scene.combinations {
            for caveat in caveats_of(combination) {
                let (scene, label) = (escape(&scene.facts.scene), escape(&combination.label));
                items += &format!("<li><b>{scene}</b>, {label}: {}</li>\n", escape(&caveat));
            }
        }
    }
    if items.is_empty() {
        items = "<li>None: every image is right, and no timing has outliers or drifts.</li>\n".to_owned();
    }
    format!("<section id=\"caveats\"><h2>Caveats</h2>\n<ul>\n{items}</ul></section>\n")
}

/// Entries of the provenance that only a comparison has.
fn entries(report: &Report) -> Vec<(String, String)> {
    let until = report.rounds.until.map_or_else(String::new, |share| {
        format!(", until every interval is narrower than {} % of its value", significant(100.0 * share, 2))
    });
    let method = format!(
        "First renders of every combination, unmeasured; renders that are thrown away until two windows of them agree \
         within 1 %, or for 3 s, before the first round and wherever the device had rested; then {} to {} rounds{until}. Each round renders every \
         combination once, in a random order (seed {}). A ratio is the median of the rounds' own. \
         Intervals of medians run from one order statistic to another and hold their confidence whatever the distribution.",
        report.rounds.min, report.rounds.max, report.seed
    );
    let mut entries = vec![("baseline".to_owned(), report.baseline.to_string()), ("method".to_owned(), method)];
    for scene in &report.scenes {
        entries.push((format!("hash of {}", scene.facts.scene), scene.facts.scene_hash.clone()));
    }
    entries
}
