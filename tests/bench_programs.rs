//! The benches of `bench/`: they run without their peers, and say what is missing where they are asked for one.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use tempfile::TempDir;

const RAYWAVE: &str = env!("CARGO_BIN_EXE_raywave");

fn bench(name: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new("python3");
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("bench").join(name);
    command.arg(program).args(["--raywave", RAYWAVE]).args(arguments);
    command
}

fn output(mut command: Command) -> Output {
    command.output().expect("python3 starts")
}

/// Stdout of a bench that runs to its end.
fn printed(command: Command) -> String {
    let Output { status, stdout, stderr } = output(command);
    assert!(status.success(), "{}", String::from_utf8_lossy(&stderr));
    String::from_utf8(stdout).expect("text")
}

/// The one line that a bench ends with when something is missing.
fn complaint(command: Command) -> String {
    let Output { status, stderr, .. } = output(command);
    let said = String::from_utf8(stderr).expect("text");
    assert_eq!(status.code(), Some(2), "{said}");
    let line = said.lines().last().expect("something is said").to_owned();
    assert!(line.starts_with("error: ") && !said.contains("Traceback"), "{said}");
    line
}

/// Cells of the rows of a table, without its head.
fn rows(text: &str) -> Vec<Vec<&str>> {
    text.lines()
        .filter(|line| line.starts_with('|'))
        .skip(2)
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect()
}

/// The first number of a cell.
fn number(cell: &str) -> f64 {
    cell.split(' ').next().and_then(|word| word.parse().ok()).unwrap_or_else(|| panic!("{cell} begins with a number"))
}

/// A folder with a program in it that fails.
fn failing(name: &str) -> TempDir {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(name);
    fs::write(&path, "#!/bin/sh\nexit 1\n").expect("a temporary file");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("it is ours");
    folder
}

#[test]
fn raywave_alone_is_measured_without_peers() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let json = folder.path().join("report.json");
    let json = json.to_str().expect("a plain path");
    let tiny = ["--peers", "none", "--cases", "cornell-box", "--size", "24", "16", "--rounds", "2", "--json", json];
    let read = || serde_json::from_slice::<serde_json::Value>(&fs::read(json).expect("it is written")).expect("JSON");

    let text = printed(bench("traversal", &[&tiny[..], &["--seconds", "0.001"]].concat()));
    let rows_of_traversal = rows(&text);
    let classes: Vec<_> = rows_of_traversal.iter().map(|row| (row[1], row[2])).collect();
    assert_eq!(classes, [("primary", "raywave"), ("bounce", "raywave"), ("shadow", "raywave")]);
    assert!(rows_of_traversal.iter().all(|row| number(row[3]) > 0.0), "{text}");
    let report = read();
    let (hits, rays) = (&report["rows"][0]["hits"], &report["turns"][0]["dump"]["rays"]);
    assert_eq!(*rays, 2 * 24 * 16);
    assert!(hits.as_u64() > Some(0) && hits.as_u64() < rays.as_u64(), "{hits}: the image shows more than the box");
    assert_eq!(report["turns"][2]["rays_per_second"]["raywave"].as_array().map(Vec::len), Some(2));

    let text = printed(bench("samples", &[&tiny[..], &["--samples", "3"]].concat()));
    let rows_of_samples = rows(&text);
    assert_eq!(rows_of_samples.len(), 1, "{text}");
    assert_eq!(rows_of_samples[0][0], "cornell-box 24x16, N=8, 3 samples per pixel");
    assert!(number(rows_of_samples[0][1]) > 0.0, "{text}");
    let settings = &read()["works"][0]["settings"];
    for (key, value) in [("width_pixels", 24), ("height_pixels", 16), ("samples_per_pixel", 3), ("max_bounces", 8)] {
        assert_eq!(settings[key], value, "{key}");
    }
}

#[test]
fn what_is_missing_is_told_with_its_package() {
    let compiler = failing("g++");
    let mut command = bench("traversal", &["--peers", "embree", "--cases", "cornell-box"]);
    let path = std::env::var("PATH").expect("there is a path");
    command.env("PATH", format!("{}:{path}", compiler.path().display()));
    assert!(complaint(command).contains("apt-get install libembree-dev"));

    let python = failing("python");
    let python = python.path().join("python");
    let python = python.to_str().expect("a plain path");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/bench/common.py");
    let line = complaint(bench("samples", &["--oracle", script, "--python", python, "--cases", "cornell-box"]));
    assert!(line.contains("pip install mitsuba numpy"), "{line}");
}

#[test]
fn bad_arguments_are_told_in_a_line() {
    for (name, arguments, words) in [
        ("samples", &["--cases", "cornell-box"][..], "--oracle"),
        ("samples", &["--oracle", "nowhere.py"], "nowhere.py: there is no such script"),
        ("samples", &["--peers", "none", "--cases", "kitchen"], "kitchen is not part of raywave"),
        ("samples", &["--peers", "none", "--json", "/nowhere/a.json"], "/nowhere/a.json: cannot be written"),
        ("traversal", &["--peers", "none", "--cases", "kitchen", "--scenes", "/"], "there is no kitchen.toml"),
        ("traversal", &["--peers", "none", "--cases", "cornell-box", "--device", "abacus"], "abacus"),
    ] {
        let line = complaint(bench(name, arguments));
        assert!(line.contains(words), "{line}");
    }
    let usage = output(bench("traversal", &["--cases", "teapot"]));
    assert_eq!(usage.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&usage.stderr).contains("teapot is none of"));
}

/// Runs Python that has the benches at hand as modules.
fn assert_python(script: &str) {
    const MODULES: &str = "
import sys; sys.path.insert(0, 'bench')
import importlib.machinery, importlib.util, random, types, common
def bench(name):
    loader = importlib.machinery.SourceFileLoader(name, f'bench/{name}')
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader(name, loader))
    loader.exec_module(module)
    return module
";
    let mut command = Command::new("python3");
    command.args(["-B", "-c", &format!("{MODULES}{script}")]).current_dir(env!("CARGO_MANIFEST_DIR"));
    let Output { status, stderr, .. } = output(command);
    assert!(status.success(), "{}", String::from_utf8_lossy(&stderr));
}

#[test]
fn intervals_hold_the_median_as_often_as_they_say() {
    assert_python(
        "
assert common.interval(range(1, 12)) == (2, 10)
assert common.interval([5, 1, 3]) == (1, 5)
assert common.median([4, 1, 3, 2]) == 2.5
draw = random.Random(7)
held = 0
for _ in range(4000):
    low, high = common.interval([draw.expovariate(1) for _ in range(15)])
    held += low <= 0.6931471805599453 <= high
# 15 values: 4th lowest to 4th highest, 96.5 %.
assert 0.955 < held / 4000 < 0.975, held
assert common.verdict({'median': 1.1, 'low': 1.0, 'high': 1.3}, 1.2) == 'missed, within noise'
assert common.verdict({'median': 1.3, 'low': 1.25, 'high': 1.4}, 1.2) == 'met'
",
    );
}

#[test]
fn programs_that_disagree_are_told() {
    assert_python(
        "
def difference(means):
    return common.complaint(list(common.differences(means)))
draw = random.Random(3)
def means(centre):
    return [[draw.gauss(c, 0.01) for c in centre] for _ in range(11)]
assert difference({'raywave': means([0.5, 0.4, 0.3]), 'mitsuba': means([0.5, 0.4, 0.3])}) is None
assert 'green' in difference({'raywave': means([0.5, 0.44, 0.3]), 'mitsuba': means([0.5, 0.4, 0.3])})
nan = [[0.5, 0.4, float('nan')]] * 11
assert 'blue' in difference({'raywave': nan, 'mitsuba': means([0.5, 0.4, 0.3])})

disagreement = bench('traversal').disagreement
rays = types.SimpleNamespace(about={'rays': 100_000})
def program(wrong, excused):
    return types.SimpleNamespace(name='abacus', wrong=wrong, excused=excused)
assert disagreement(rays, [program(0, 0), program(10, 100)]) is None
assert 'abacus answers 11 of 100000' in disagreement(rays, [program(0, 0), program(11, 0)])
assert 'abacus answers 101 of 100000' in disagreement(rays, [program(0, 101)])
",
    );
}
