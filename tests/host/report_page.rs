//! Reports as files: they parse back, and the page works in a browser.
//!
//! The page is opened in headless Chromium (Debian's package `chromium`). Where there is none the
//! test fails, unless `RAYWAVE_NO_CHROMIUM` is set. `RAYWAVE_REPORT_PAGE` names a file to which the
//! example page is written, to be looked at.

use std::collections::BTreeMap;
use std::error::Error;
use std::ops::ControlFlow;
use std::process::{Command, Stdio};

use glam::Vec3;
use raywave::image::read_image;
use raywave_studies::export::{Document, Exports, Format, Page};
use raywave_studies::stats::Bootstrap;
use raywave_studies::studies::tradeoff::{Base, Reference, ReferenceKeeper, Sweep, TradeoffReport};
use raywave_studies::studies::{
    Configuration, Cpu, Envelope, Limit, Measurement, Provenance, Purpose, Renderer, Report, SceneFacts, StudyError,
    Trial,
};

use crate::fake_renderer::{self, FakeRenderer, normal, study};
use crate::not_tested::not_tested;
use crate::project::project_file;

/// A report with all that can be in one: two scenes, combinations that are faster, slower, within
/// noise, of another estimator, wrong and failed, warnings, texts that need escapes.
fn example() -> Report {
    let mut study = study(&["scheduler=wavefront,megakernel,in-flight=16k,64k,1M,integrator=explicit,implicit"], 15);
    study.scenes = vec!["caustic".to_owned(), "glass".to_owned()];
    let mut renderer = FakeRenderer::new(|call, random| {
        let level = |factor| call.configuration.level(factor).unwrap_or_default();
        let seconds = match (level("scheduler"), level("in-flight")) {
            ("wavefront", "16k") => 0.40,
            ("wavefront", "64k") => 0.31,
            ("wavefront", _) => 0.27,
            (_, in_flight) => match (call.scene, in_flight) {
                ("glass", _) => 0.36,
                (_, "16k") => 0.402,
                _ => 0.43,
            },
        };
        let integrator = if level("integrator") == "implicit" { 0.62 } else { 1.0 };
        let slow = if call.before == 6 && level("in-flight") == "64k" && call.scene == "glass" { 1.3 } else { 1.0 };
        seconds * integrator * slow * (0.012 * normal(random)).exp()
    });
    renderer.image = Box::new(|call, random| {
        let file = format!("tests/references/{}-n4.exr", if call.scene == "glass" { "box" } else { "caustic" });
        let mut image = read_image(&project_file(&file)).expect("a reference image");
        if call.configuration.level("integrator") == Some("implicit") && call.before == 0 {
            // The same noise in every run: seeded anew.
            let mut seeded = raywave_studies::stats::SplitMix64::new(4);
            image.pixels.iter_mut().for_each(|pixel| *pixel *= 1.0 + 0.2 * normal(&mut seeded) as f32);
        } else if call.configuration.level("integrator") == Some("implicit") {
            return None;
        }
        let wrong = [("scheduler", "megakernel"), ("in-flight", "1M"), ("integrator", "explicit")];
        if call.scene == "caustic" && wrong.iter().all(|(f, l)| call.configuration.level(f) == Some(l)) {
            let width = image.width;
            for (i, pixel) in image.pixels.iter_mut().enumerate() {
                if (i as u32 / width / 8 + i as u32 % width / 8).is_multiple_of(5) {
                    *pixel += Vec3::splat(1e-3 * random.next_f64() as f32);
                }
            }
        }
        Some(image)
    });
    renderer.failure = Box::new(|call, _| {
        let fails = call.scene == "glass" && call.configuration.level("in-flight") == Some("1M");
        (fails && call.configuration.level("scheduler") == Some("megakernel"))
            .then(|| "the device is out of memory, \"heap\" <0> | 2 GiB".to_owned())
    });
    study.run(&mut renderer, &mut |_| ControlFlow::Continue(())).expect("the fake renderer renders")
}

/// A crossover that noise blurs.
fn example_of_a_crossover() -> Report {
    let study = study(&["scheduler=wavefront,megakernel,shading-cost"], 12);
    let mut renderer = FakeRenderer::new(|call, random| {
        let cost = call.configuration.count("shading-cost").unwrap_or(0) as f64;
        let mega = call.configuration.level("scheduler") == Some("megakernel");
        let seconds = if mega { 0.22 + 2.1e-4 * cost } else { 0.30 + 0.9e-4 * cost };
        seconds * (0.03 * normal(random)).exp()
    });
    renderer.image = Box::new(|_, _| Some(fake_renderer::gradient(16, 16)));
    study.run(&mut renderer, &mut |_| ControlFlow::Continue(())).expect("the fake renderer renders")
}

/// A renderer whose pictures have the more noise the fewer samples there are, and two knobs that matter.
struct SweepRenderer;

impl Renderer for SweepRenderer {
    fn open(&mut self, _: &str) -> Result<SceneFacts, Box<dyn Error + Send + Sync>> {
        let image = read_image(&reference_file()).expect("a reference image");
        Ok(SceneFacts {
            scene: "caustic <&>".to_owned(),
            width_pixels: image.width,
            height_pixels: image.height,
            samples_per_pixel: 64,
            ..SceneFacts::default()
        })
    }

    fn run(
        &mut self,
        configuration: &Configuration,
        purpose: Purpose,
    ) -> Result<Measurement, Box<dyn Error + Send + Sync>> {
        let samples = configuration.count("samples").unwrap_or(1) as f64;
        let mis = configuration.level("integrator") == Some("mis");
        let short = configuration.level("max-bounces") == Some("3");
        if configuration.level("bvh") == Some("bvh4") {
            return Err("out of memory, \"heap\" <0>".into());
        }
        let seed = if let Purpose::Seeded(seed) = purpose { seed } else { 0 };
        let mut random = raywave_studies::stats::SplitMix64::new(u64::from(seed) * 1000 + samples as u64);
        let seconds = 0.02 * samples * if short { 0.6 } else { 1.0 } * (0.02 * normal(&mut random)).exp();
        let noise = (if mis { 0.1 } else { 0.3 } / samples).sqrt();
        let mut image = read_image(&reference_file()).expect("a reference image");
        let kept = if short { 0.9 } else { 1.0 };
        image.pixels.iter_mut().for_each(|pixel| *pixel *= (kept + noise * normal(&mut random)) as f32);
        let settings = r#"{"max_bounces": 8, "integrator": "explicit", "bvh": "cwbvh", "note": "</script><b>"}"#;
        Ok(Measurement {
            wall_seconds: seconds,
            gpu_seconds: seconds,
            image: Some(image),
            settings: serde_json::from_str(settings).expect("JSON"),
            ..Measurement::default()
        })
    }
}

/// Has no reference, and keeps none.
struct NoKeeper;

impl ReferenceKeeper for NoKeeper {
    fn load(&mut self, _: &SceneFacts, _: &Base) -> Result<Option<Reference>, StudyError> {
        Ok(None)
    }

    fn store(&mut self, _: &SceneFacts, _: &Base, _: &Reference) {}
}

fn reference_file() -> std::path::PathBuf {
    project_file("tests/references/caustic-n4.exr")
}

fn example_of_a_sweep() -> TradeoffReport {
    let sweep = Sweep {
        scene: String::new(),
        load_flags: String::new(),
        budget_seconds: 120.0,
        rounds: 5,
        fixed_samples: false,
        reference_error: 1e-3,
        target: Some(1e-2),
        bootstrap: Bootstrap { resamples: 100, ..Bootstrap::default() },
        seed: 0,
    };
    sweep.run(&mut SweepRenderer, &mut NoKeeper, &mut |_| ControlFlow::Continue(())).expect("it renders")
}

fn provenance() -> Provenance {
    Provenance {
        raywave_version: "0.1.0".to_owned(),
        command_line: "raywave compare caustic.toml glass.toml --vary scheduler,in-flight=16k,64k,1M,integrator"
            .to_owned(),
        date: "2026-01-02T03:04:05Z".to_owned(),
        device: "Example <GPU> & \"Co\"".to_owned(),
        device_kind: "discrete".to_owned(),
        driver: "example 1.2.3".to_owned(),
        vulkan_version: "1.3.290".to_owned(),
        subgroup_size_lanes: 32,
        rustc_version: "rustc 1.90.0".to_owned(),
        cpu: Some(Cpu { model: "Example | CPU".to_owned(), logical_processors: 3, megahertz: Some(2599.998) }),
        clocks: Some("locked at 1 < 2 GHz".to_owned()),
        settings: serde_json::from_str(r#"{"max_bounces": 8, "roulette": 0.0, "note": "</script><b>"}"#).expect("JSON"),
    }
}

#[test]
fn json_holds_everything() {
    let (report, provenance) = (example(), provenance());
    let json: serde_json::Value =
        serde_json::from_str(&Document { provenance: &provenance, report: &report }.json()).expect("it is JSON");
    assert_eq!(json["provenance"]["device"], "Example <GPU> & \"Co\"");
    assert_eq!(json["provenance"]["settings"]["max_bounces"], 8);
    assert_eq!(json["provenance"]["cpu"]["logical_processors"], 3);
    assert_eq!(json["complete"], true);
    assert_eq!(json["factors"]["in-flight"], serde_json::json!(["16k", "64k", "1M"]));
    assert_eq!(json["baseline"]["scheduler"], "wavefront");
    let scenes = json["scenes"].as_array().expect("scenes");
    assert_eq!((scenes.len(), scenes[0]["scene"].as_str()), (2, Some("caustic")));
    assert_eq!(scenes[0]["triangles"], 12_345);
    let combinations = scenes[0]["combinations"].as_array().expect("combinations");
    assert_eq!(combinations.len(), 12);
    let count = |scene: &serde_json::Value, word: &str| {
        scene["combinations"].as_array().expect("a list").iter().filter(|c| c["verdict"] == word).count()
    };
    assert_eq!((count(&scenes[0], "baseline"), count(&scenes[0], "wrong"), count(&scenes[0], "agrees")), (1, 1, 6));
    assert_eq!((count(&scenes[1], "failed"), count(&scenes[1], "identical")), (2, 4));
    for combination in combinations {
        let timed = combination["verdict"] != "wrong";
        assert_eq!(combination["seconds"].is_object(), timed);
        assert_eq!(combination["runs"].as_array().expect("runs").len(), if timed { 15 } else { 0 });
        let first = &combination["first"];
        for key in ["cold_seconds", "cached_seconds"] {
            assert!(first["pipelines"][0][key].is_number(), "{key}");
        }
        assert_eq!((&first["cold_start_up_seconds"], &first["cached_start_up_seconds"]), (&0.61.into(), &0.29.into()));
        assert_eq!(first["settings"]["max_bounces"], 8);
        let compiled = first["compiled_kernels"].as_array().expect("a list");
        assert_eq!(compiled[0]["spirv_instructions"], 1_000 + compiled[0]["kernel"].as_str().expect("a name").len());
        assert_eq!(compiled[0]["executables"][0]["figures"][0]["value"], 64);
        assert_eq!(compiled.last().expect("resolve")["executables"], serde_json::Value::Null);
        if timed {
            assert!(combination["typical"]["kernels"][0]["gpu_seconds"].is_number());
            let seconds = &combination["seconds"];
            assert!(seconds["low"].as_f64() <= seconds["value"].as_f64());
        }
    }
}

/// RFC 4180, as a reader would have it.
fn parse_csv(text: &str) -> Vec<Vec<String>> {
    let (mut rows, mut row, mut cell, mut quoted) = (Vec::new(), Vec::new(), String::new(), false);
    let mut characters = text.chars().peekable();
    while let Some(character) = characters.next() {
        match character {
            '"' if quoted && characters.peek() == Some(&'"') => {
                characters.next();
                cell.push('"');
            }
            '"' => quoted = !quoted,
            ',' if !quoted => row.push(std::mem::take(&mut cell)),
            '\r' if !quoted => (),
            '\n' if !quoted => {
                row.push(std::mem::take(&mut cell));
                rows.push(std::mem::take(&mut row));
            }
            _ => cell.push(character),
        }
    }
    assert!(!quoted && cell.is_empty() && row.is_empty(), "the last line ends");
    rows
}

#[test]
fn csv_has_a_row_for_each_combination() {
    let (report, provenance) = (example(), provenance());
    let rows = parse_csv(&Document { provenance: &provenance, report: &report }.csv());
    assert_eq!(rows.len(), 1 + 24);
    let header = &rows[0];
    let mut seen = std::collections::BTreeSet::new();
    for name in header {
        assert!(name.chars().all(|c| c.is_ascii_lowercase() || c == '_') && seen.insert(name), "{name}");
    }
    for (row, combination) in rows[1..].iter().zip(report.scenes.iter().flat_map(|scene| &scene.combinations)) {
        assert_eq!(row.len(), header.len());
        let cells: BTreeMap<&str, &str> =
            header.iter().map(String::as_str).zip(row.iter().map(String::as_str)).collect();
        assert_eq!(cells["device"], "Example <GPU> & \"Co\"");
        assert_eq!(cells["in_flight"], combination.configuration.level("in-flight").expect("it is varied"));
        assert_eq!(cells["verdict"], combination.verdict.word());
        assert_eq!(cells["seconds"].parse().ok(), combination.seconds.map(|seconds| seconds.value));
        let first = combination.first.as_ref();
        for (name, value) in [
            ("cold_start_up_seconds", first.and_then(|first| first.cold_start_up_seconds)),
            ("cached_start_up_seconds", first.and_then(|first| first.cached_start_up_seconds)),
            ("cold_pipeline_seconds", first.and_then(|first| first.pipeline_seconds(false))),
            ("cached_pipeline_seconds", first.and_then(|first| first.pipeline_seconds(true))),
        ] {
            assert_eq!(cells[name].parse().ok(), value, "{name}");
            assert_eq!(value.is_some(), first.is_some(), "{name}");
        }
        let interval = combination.ratio.map(|ratio| ratio.estimate.interval.expect("15 rounds are enough"));
        assert_eq!(cells["ratio_low"].parse().ok(), interval.map(|interval| interval.low));
        assert_eq!(cells["ratio_verdict"], combination.ratio.map_or("", |ratio| ratio.verdict().words()));
    }
}

#[test]
fn markdown_has_a_table_for_each_scene() {
    let (report, provenance) = (example(), provenance());
    let text = Document { provenance: &provenance, report: &report }.markdown();
    for start in ["| combination", "| start-up", "| compiled"] {
        assert_eq!(text.lines().filter(|line| line.starts_with(start)).count(), 2, "{start}");
    }
    let start = "| wavefront, in-flight 16k, explicit | ";
    let starts = "610 ms | 290 ms | 240 ms | 12.0 ms |";
    assert!(text.lines().any(|line| line.starts_with(start) && line.ends_with(starts)), "{text}");
    for told in ["max\\_bounces 8", "rustc 1.90.0", "Example \\| CPU, 3 logical processors, 2600 MHz", "1 \\< 2 GHz"] {
        assert!(text.contains(told), "{told} in {text}");
    }
    let tables = text.split("\n\n").filter(|part| part.starts_with('|'));
    let mut columns: Vec<usize> = Vec::new();
    for table in tables {
        let bars = |line: &str| line.replace("\\|", "").matches('|').count();
        columns.push(bars(table.lines().next().expect("a head")) - 1);
        assert!(table.lines().all(|line| bars(line) == bars(table.lines().next().expect("a head"))), "{table}");
    }
    assert_eq!(columns, [6, 8, 6, 6, 8, 6], "times, kernels and start-up of each scene");
    assert!(text.contains("**wrong**") && text.contains("**failed**"), "{text}");
    assert!(text.contains("Example \\<GPU>"), "{text}");
}

/// The table of compiled kernels has a row for each executable, beside the kernel's time, and says where a driver does not
/// tell of any.
#[test]
fn compiled_kernels_stand_beside_their_times() {
    let (mut report, provenance) = (example(), provenance());
    let told = |report: &Report| {
        let document = Document { provenance: &provenance, report };
        let page = document.html(&mut Page::new(0.0));
        let section = page.split("id=\"compiled\"").nth(1).and_then(|rest| rest.split("</section>").next());
        (document.markdown(), section.unwrap_or_default().to_owned())
    };
    let (markdown, section) = told(&report);
    let baseline = &report.scenes[0].combinations[0];
    let seconds = |kernel: &str| {
        let kernels = &baseline.typical.as_ref().expect("it is timed").kernels;
        kernels.iter().find(|row| row.kernel == kernel).expect("it ran").gpu_seconds
    };
    let rows: Vec<&str> =
        markdown.lines().filter(|line| line.starts_with(&format!("| {} | ", baseline.label))).collect();
    for (kernel, row) in [
        ("extend", "extend | TIME | 1,006 | 32 | 50 % | 64 | true |"),
        ("shade", "shade, SIMD16 | TIME | 1,005 | 16 | 50 % | 32 | false |"),
        ("shade", "shade, SIMD32 | TIME | 1,005 | 32 | 50 % | 64 | true |"),
        ("resolve", "resolve | TIME | 1,007 | – | – | – | – |"),
    ] {
        let digits = if seconds(kernel) < 0.1 { 1 } else { 0 };
        let row = row.replace("TIME", &format!("{:.digits$} ms", 1e3 * seconds(kernel)));
        assert!(rows.iter().any(|line| line.ends_with(&row)), "{row} in {rows:#?}");
    }
    for told in ["Register Count", "Spills &lt;|&gt;", ">shade, SIMD16<", ">1,005<", ">yes<"] {
        assert!(section.contains(told), "{told} in {section}");
    }
    // Of 12 combinations in two scenes two did not run; wavefronts have seven rows and megakernels two.
    assert_eq!(section.matches("<tr class=").count(), 12 * 7 + 10 * 2);
    let untold = "does not tell";
    assert!(!markdown.contains(untold) && !section.contains(untold));

    let firsts = report.scenes.iter_mut().flat_map(|scene| &mut scene.combinations).filter_map(|c| c.first.as_mut());
    firsts.flat_map(|first| &mut first.compiled_kernels).for_each(|kernel| kernel.executables = None);
    let (markdown, section) = told(&report);
    assert!(markdown.contains(untold) && section.contains(untold));
    assert!(markdown.contains("| shade | ") && !markdown.contains("Register Count"), "{markdown}");
}

#[test]
fn too_few_rounds_are_the_verdict_in_every_format() {
    let told = |rounds| {
        let study = study(&["scheduler=wavefront,megakernel,shading-cost=0,1k"], rounds);
        let mut renderer = FakeRenderer::new(|call, random| {
            let cost = call.configuration.count("shading-cost").unwrap_or(0) as f64;
            let mega = call.configuration.level("scheduler") == Some("megakernel");
            (if mega { 0.22 + 2.1e-4 * cost } else { 0.30 + 0.9e-4 * cost }) * (0.001 * normal(random)).exp()
        });
        let report = study.run(&mut renderer, &mut |_| ControlFlow::Continue(())).expect("it renders");
        let provenance = provenance();
        let document = Document { provenance: &provenance, report: &report };
        let page = document.html(&mut Page::new(0.0));
        (
            document.json(),
            [document.csv(), document.markdown(), page.split("<main>").next().unwrap_or("").to_owned()],
            page,
        )
    };
    let (json, texts, page) = told(2);
    for text in texts.iter().chain([&page]) {
        assert!(text.contains("too few rounds"), "{text}");
    }
    let json: serde_json::Value = serde_json::from_str(&json).expect("it is JSON");
    let scene = &json["scenes"][0];
    for estimate in [
        &scene["combinations"][0]["seconds"],
        &scene["combinations"][2]["ratio"],
        &scene["crossovers"][0]["points"][0]["a_seconds"],
        &scene["crossovers"][0]["crossings"][0]["cost"],
    ] {
        assert!(estimate["value"].is_number() && estimate["low"].is_null() && estimate["high"].is_null(), "{estimate}");
        assert_eq!(estimate["verdict"], "too few rounds");
    }
    assert_eq!(scene["combinations"][0]["warnings"][0]["kind"], "few_rounds");
    assert!(page.contains("class=\"unsure\""), "the plot has rings in place of bars");
    assert!(!page.contains("class=\"whisker"), "and no bars");

    let (json, texts, page) = told(6);
    assert!(!json.contains("too few rounds") && texts.iter().all(|text| !text.contains("too few rounds")));
    assert!(page.contains("class=\"whisker"));
}

#[test]
fn files_are_checked_before_the_work_begins() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("a.json");
    let twice = vec![(Format::Json, file.clone()), (Format::Html, file.clone())];
    assert!(Exports::open(twice, 0.0).expect_err("one file for two").to_string().contains("a.json"));
    let nowhere = vec![(Format::Csv, folder.path().join("none/a.csv"))];
    assert!(Exports::open(nowhere, 0.0).expect_err("no folder").to_string().contains("is missing"));
    assert!(!file.exists(), "a check leaves no trace");

    let (report, provenance) = (example_of_a_crossover(), provenance());
    let document = Document { provenance: &provenance, report: &report };
    let formats =
        [(Format::Json, "a.json"), (Format::Csv, "a.csv"), (Format::Markdown, "a.md"), (Format::Html, "a.html")];
    let files = formats.map(|(format, name)| (format, folder.path().join(name)));
    Exports::open(files.to_vec(), 0.0).expect("they can be written").write(&document).expect("they are");
    let written = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("it is there");
    assert_eq!(written("a.json"), document.json());
    assert_eq!(written("a.csv"), document.csv());
    assert_eq!(written("a.md"), document.markdown());
    assert_eq!(written("a.html"), document.html(&mut Page::new(0.0)));
}

#[test]
fn the_page_asks_nothing_of_the_network_and_escapes_what_it_shows() {
    let (report, provenance) = (example(), provenance());
    let page = Document { provenance: &provenance, report: &report }.html(&mut Page::new(0.0));
    for reference in ["http://", "https://", "src=\"/", "@import", "url("] {
        assert!(!page.contains(reference), "{reference}");
    }
    assert!(!page.contains("<GPU>") && !page.contains("</script><b>") && !page.contains("heap\" <0>"));
    assert!(page.contains("Example &lt;GPU&gt; &amp; &quot;Co&quot;"));
    for told in [
        "<dt>max_bounces</dt><dd>8</dd>",
        "<dt>built by</dt><dd>rustc 1.90.0</dd>",
        "<dt>processor</dt><dd>Example | CPU, 3 logical processors, 2600 MHz</dd>",
        "<dt>clocks</dt><dd>locked at 1 &lt; 2 GHz</dd>",
    ] {
        assert!(page.contains(told), "{told}");
    }
    let starts =
        page.split("id=\"start-up\"").nth(1).and_then(|rest| rest.split("</section>").next()).unwrap_or_default();
    for told in ["start-up, cold", "start-up, cached", "610 ms", "290 ms", "240 ms", "12.0 ms"] {
        assert!(starts.contains(told), "{told} in {starts}");
    }
    // Equal images are in it once: two of each scene's own, the implicit ones, and differences.
    assert!(page.matches("data:image/png").count() <= 2 * 2 + 1 + 3, "{}", page.matches("data:image/png").count());
}

#[test]
fn a_page_of_a_study_that_has_only_begun_is_whole() {
    let mut pages = Vec::new();
    let (mut page, provenance) = (Page::new(0.0), provenance());
    let mut renderer = FakeRenderer::new(|_, _| 1.0);
    let _ = study(&["scheduler=wavefront,megakernel,in-flight"], 2).run(&mut renderer, &mut |event| {
        if let raywave_studies::studies::Event::Updated { report } = event {
            pages.push(Document { provenance: &provenance, report }.html(&mut page));
        }
        ControlFlow::Continue(())
    });
    assert!(pages.len() > 10);
    for page in &pages {
        let before_the_scripts = page.split("<script").next().unwrap_or_default();
        assert!(page.ends_with("</html>\n") && !before_the_scripts.contains("NaN"));
    }
    assert!(pages[0].contains("not finished") && !pages[pages.len() - 1].contains("not finished"));
}

/// What a reader does to the page, and whether it obeys. It leaves its findings in the document.
const SELF_TEST: &str = r##"
const failures = [];
const check = (what, holds) => { if (!holds) failures.push(what); };
const all = (selector, root = document) => [...root.querySelectorAll(selector)];
// Without an `await`: the browser prints the document once its load event is over, and waits for nothing else.
addEventListener("load", () => {
  try {
    for (const table of all("table.sortable")) {
      const headings = [...table.tHead.rows[0].cells];
      headings.forEach((heading, column) => {
        const keys = () => [...table.tBodies[0].rows].map((row) => row.cells[column].dataset.key);
        const count = keys().length;
        for (const [direction, sign] of [["ascending", 1], ["descending", -1]]) {
          heading.querySelector("button").click();
          check("aria-sort says " + direction, heading.getAttribute("aria-sort") === direction);
          const present = keys().filter((key) => key !== "");
          const sorted = present.every((key, i) => i === 0 ||
            sign * (isNaN(key) ? present[i - 1].localeCompare(key) : present[i - 1] - key) <= 0);
          check(heading.textContent + " is " + direction + ": " + present, sorted);
          const empty = keys().slice(present.length).every((key) => key === "");
          check(heading.textContent + " has what is empty last", empty && keys().length === count);
        }
      });
      check("one column is sorted by", all("[aria-sort]", table).length === 1);
    }
    for (const figure of all("figure.images")) {
      const panel = figure.closest("article");
      if (panel.hidden) document.getElementById(panel.getAttribute("aria-labelledby")).click();
      check("its tab shows a scene", !panel.hidden);
      const [stage, split, left] = [".stage", ".split", "img.left"].map((s) => figure.querySelector(s));
      check("the left image is there", left.naturalWidth > 0);
      const edge = () => figure.querySelector(".divider").getBoundingClientRect().left - stage.getBoundingClientRect().left;
      const width = stage.getBoundingClientRect().width;
      check("the stage has a size", width > 100);
      for (const value of [0, 25, 80, 100]) {
        split.value = value;
        split.dispatchEvent(new Event("input", { bubbles: true }));
        check("the divider is at " + value, Math.abs(edge() + 1 - width * value / 100) < 2);
        check("the image is clipped at " + value, getComputedStyle(left).clipPath.includes("calc(" + (100 - value)) ||
          getComputedStyle(left).clipPath.includes((100 - value) + "%") || value === 100);
      }
      split.focus();
      check("the slider takes the keyboard", document.activeElement === split);
      const select = figure.querySelector("select");
      const heat = figure.querySelector("img.heat");
      const toggle = figure.querySelector(".heat-switch");
      let maps = 0;
      [...select.options].forEach((option, i) => {
        select.selectedIndex = i;
        select.dispatchEvent(new Event("change", { bubbles: true }));
        check("the right label follows", figure.querySelector(".tag.right").textContent === option.label);
        check("a note is there", figure.querySelector(".note").textContent.length > 0);
        if (toggle.disabled) return;
        maps += 1;
        toggle.click();
        check("the difference shows", !heat.hidden && heat.src.startsWith("data:image/png"));
        toggle.click();
        check("the difference goes", heat.hidden);
      });
      document.body.dataset.maps = (document.body.dataset.maps || "") + maps + " ";
    }
    const tabs = all("[role=tab]");
    if (tabs.length > 1) {
      tabs[0].click();
      tabs[0].dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" }));
      check("the arrow goes to the next tab", tabs[1].getAttribute("aria-selected") === "true");
    }
    const paper = () => getComputedStyle(document.body).backgroundColor;
    const before = paper();
    document.getElementById("theme").click();
    check("the theme changes", paper() !== before);
    check("plots have names", all("svg").every((svg) => svg.getAttribute("aria-label")));
    check("images have texts", all("img").every((img) => img.hasAttribute("alt")));
    for (const text of all("svg text")) {
      const [box, frame] = [text, text.ownerSVGElement].map((element) => element.getBoundingClientRect());
      if (frame.width) check("inside its plot: " + text.textContent, box.left >= frame.left - 1 && box.right <= frame.right + 1);
    }
  } catch (error) { failures.push(String(error)); }
  document.body.dataset.selfTest = failures.length ? failures.join("\n") : "passed";
});
"##;

/// An envelope is exported as the reports of the other studies are.
#[test]
fn an_envelope_comes_in_every_format() {
    let trial = |setting: &str, required, measured| Trial {
        setting: setting.to_owned(),
        required,
        measured,
        standard_error: 0.0,
        checked: 1000,
        nonfinite_samples: 0,
        failure: String::new(),
    };
    let limit = Limit {
        name: "distance",
        driven: "how far the eye is, <radii>",
        measure: "relative error",
        allowed: 1e-3,
        remark: "",
        reduced: "",
        trials: vec![trial("1", true, 0.0), trial("10^6, at most", true, 2e-4), trial("10^9", false, 0.5)],
        seconds: 1.5,
    };
    let envelope = Envelope { level: "quick".to_owned(), limits: vec![limit], complete: true };
    let provenance = provenance();
    let document = Document { provenance: &provenance, report: &envelope };

    let json: serde_json::Value = serde_json::from_str(&document.json()).expect("it is JSON");
    assert_eq!(json["limits"][0]["trials"][1]["measured"], 2e-4);
    let rows = parse_csv(&document.csv());
    assert_eq!(rows.len(), 4, "a header and a row for each setting");
    let column = |name: &str| rows[0].iter().position(|cell| cell == name).expect("there is such a column");
    let cells = |name: &str| [1, 2, 3].map(|row| rows[row][column(name)].as_str());
    assert_eq!(cells("setting"), ["1", "10^6, at most", "10^9"]);
    assert_eq!(cells("holds"), ["true", "true", "false"]);
    assert_eq!(cells("device"), [provenance.device.as_str(); 3]);
    let markdown = document.markdown();
    assert!(markdown.contains("| distance |") && markdown.contains("\\<radii>"), "{markdown}");
    let page = document.html(&mut Page::new(0.0));
    assert!(page.contains("Operating envelope") && page.contains("&lt;radii&gt;") && page.ends_with("</html>\n"));
    assert!(page.contains("all that is promised holds") && page.contains("10^9"));
}

#[test]
fn the_page_works_in_a_browser() {
    let Some(chromium) = chromium() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let provenance = provenance();
    let sweep = example_of_a_sweep();
    let front = format!("{} ", sweep.front.len());
    let page = |report: &Report| Document { provenance: &provenance, report }.html(&mut Page::new(0.0));
    for (name, page, maps) in [
        ("factorial", page(&example()), Some("7 5 ")),
        ("crossover", page(&example_of_a_crossover()), None),
        ("sweep", Document { provenance: &provenance, report: &sweep }.html(&mut Page::new(0.0)), Some(&*front)),
    ] {
        if let Ok(path) = std::env::var("RAYWAVE_REPORT_PAGE") {
            std::fs::write(format!("{path}-{name}.html"), &page).expect("the page is written");
        }
        let tested = page.replace("</body>", &format!("<script>{SELF_TEST}</script></body>"));
        let file = folder.path().join(format!("{name}.html"));
        std::fs::write(&file, tested).expect("the page is written");
        let output = Command::new(&chromium)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
            .args(["--enable-logging=stderr", "--window-size=1200,1600"])
            .arg(format!("--user-data-dir={}", folder.path().join(format!("{name}-profile")).display()))
            .args(["--dump-dom".as_ref(), file.as_os_str()])
            .stdin(Stdio::null())
            .output()
            .expect("chromium starts");
        let (dom, log) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        let console: Vec<&str> = log.lines().filter(|line| line.contains("CONSOLE")).collect();
        assert!(console.is_empty(), "{name}: the console says:\n{}", console.join("\n"));
        let said = dom.split("data-self-test=\"").nth(1).and_then(|rest| rest.split('"').next());
        assert_eq!(said, Some("passed"), "{name}: {log}");
        if let Some(maps) = maps {
            assert!(dom.contains(&format!("data-maps=\"{maps}\"")), "{name}: difference maps of each scene");
        }
    }
}

/// The browser; `None` only where the environment says that there need not be one.
fn chromium() -> Option<std::path::PathBuf> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&folders)
        .flat_map(|folder| ["chromium", "chromium-browser"].map(|name| folder.join(name)))
        .find(|path| path.is_file());
    if found.is_none() && std::env::var_os("RAYWAVE_NO_CHROMIUM").is_none() {
        panic!(
            "the page is tested in Chromium; install the package chromium, or set RAYWAVE_NO_CHROMIUM=1 to go without"
        );
    }
    if found.is_none() {
        not_tested("RAYWAVE_NO_CHROMIUM is set, so no browser opened the page");
    }
    found
}

/// The console is heard: a page with an error in it does not pass.
#[test]
fn an_error_on_the_console_would_be_seen() {
    let Some(chromium) = chromium() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("broken.html");
    std::fs::write(&file, "<!doctype html><script>undefined_function()</script>").expect("the page is written");
    let output = Command::new(chromium)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--enable-logging=stderr"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic"])
        .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
        .args(["--dump-dom".as_ref(), file.as_os_str()])
        .stdin(Stdio::null())
        .output()
        .expect("chromium starts");
    assert!(String::from_utf8_lossy(&output.stderr).contains("CONSOLE"));
}
