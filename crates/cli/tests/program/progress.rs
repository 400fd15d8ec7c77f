//! What `render --progress` tells programs.

use std::fs;

use serde_json::Value;

use crate::command_line::{Folder, text};

/// Two blocks of the built-in box.
const RENDER: [&str; 9] =
    ["render", "--quiet", "--width", "16", "--height", "8", "--samples", "128", "--block-samples"];

fn render(folder: &Folder, more: &str) -> String {
    let more = more.split(' ');
    folder.succeed(&RENDER.into_iter().chain(["64"]).chain(more).collect::<Vec<_>>())
}

fn objects(lines: &str) -> Vec<Value> {
    lines.lines().map(|line| serde_json::from_str(line).expect("an object a line")).collect()
}

fn number(object: &Value, key: &str) -> f64 {
    object[key].as_f64().unwrap_or_else(|| panic!("a number {key}, not {object}"))
}

/// Samples that the figures of the last line say were taken in the time that it tells.
fn taken(object: &Value) -> f64 {
    number(object, "samples_per_second") * number(object, "elapsed_seconds")
}

#[test]
fn json_is_an_object_a_line_and_ends_with_all_samples() {
    let folder = Folder::new();
    let told = objects(&render(&folder, "-o a.exr --stats a.json --progress json"));
    let keys = [
        "samples_done",
        "samples_total",
        "elapsed_seconds",
        "eta_seconds",
        "samples_per_second",
        "rays_per_second",
        "relmse_by_halves",
    ];
    for object in &told {
        let found: Vec<_> = object.as_object().expect("objects").keys().collect();
        assert_eq!(found, keys);
    }
    let done: Vec<_> = told.iter().map(|object| number(object, "samples_done")).collect();
    assert!(done.is_sorted(), "{done:?}");
    let last = told.last().expect("there is a line at the end");
    let total = 16.0 * 8.0 * 128.0;
    assert_eq!(
        [number(last, "samples_done"), number(last, "samples_total"), number(last, "eta_seconds")],
        [total, total, 0.0]
    );
    assert!((taken(last) - total).abs() < 1e-6 * total, "{last}");
    let stats: Value = serde_json::from_slice(&fs::read(folder.path("a.json")).expect("it is there")).expect("JSON");
    assert_eq!(last["rays_per_second"], stats["rays_per_second"]);
}

#[test]
fn what_was_in_the_film_takes_no_time() {
    let folder = Folder::new();
    render(&folder, "--film a.film --blocks 0");
    let told = objects(&render(&folder, "--film a.film --resume --progress json"));
    let last = told.last().expect("there is a line at the end");
    let total = 16.0 * 8.0 * 128.0;
    assert_eq!([number(last, "samples_done"), number(last, "samples_total")], [total, total]);
    assert!((taken(last) - total / 2.0).abs() < 1e-6 * total, "{last}");
}

#[test]
fn openjd_is_told_in_its_lines() {
    let folder = Folder::new();
    let lines = render(&folder, "-o a.exr --progress openjd");
    let percents: Vec<f64> = lines
        .lines()
        .filter_map(|line| Some(line.strip_prefix("openjd_progress: ")?.parse().expect("a number")))
        .collect();
    assert!(percents.is_sorted() && percents[0] >= 0.0 && percents.last() == Some(&100.0), "{lines}");
    let told = lines.lines().filter(|line| line.starts_with("openjd_status: ")).count();
    assert_eq!((told, lines.lines().count()), (percents.len(), 2 * percents.len()), "{lines}");
}

#[test]
fn openjd_is_told_of_failures() {
    let folder = Folder::new();
    let output = folder.run(&["render", "missing.toml", "-o", "a.exr", "--progress", "openjd"]);
    let (told, said) = (text(&output.stdout), text(&output.stderr));
    assert_eq!((output.status.code(), told.lines().count(), said.lines().count()), (Some(2), 1, 1), "{told}{said}");
    assert_eq!(told.strip_prefix("openjd_fail: "), said.strip_prefix("error: "));
}
