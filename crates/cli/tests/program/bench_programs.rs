//! The benches of `bench/`: they run without their peers, and say what is missing where they are asked for one.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::common::install::install;
use crate::common::not_tested::not_tested;
use crate::common::project::{program, project_file};
use tempfile::TempDir;

fn bench(name: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new("python3");
    command.arg(project_file("bench").join(name)).arg("--raywave").arg(program()).args(arguments);
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

fn read_json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(path).expect("it is written")).expect("JSON")
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
    cell.split([' ', ','])
        .next()
        .and_then(|word| word.parse().ok())
        .unwrap_or_else(|| panic!("{cell} begins with a number"))
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
fn a_scene_pays_for_its_own_materials() {
    let text = printed(bench("material_costs", &["--only", "thin dielectric"]));
    let rows = rows(&text);
    assert_eq!(rows.iter().map(|row| row[0]).collect::<Vec<_>>(), ["thin dielectric", "diffuse"]);
    // A plate has no lobe, and so no shadow rays.
    let paid = rows.iter().map(|row| number(&row[1].replace(',', ""))).collect::<Vec<_>>();
    assert!(paid[0] < paid[1], "{text}");
}

#[test]
fn raywave_alone_is_measured_without_peers() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let json = folder.path().join("report.json");
    let json = json.to_str().expect("a plain path");
    let tiny = ["--peers", "none", "--cases", "cornell-box", "--size", "24", "16", "--rounds", "2", "--json", json];
    let read = || read_json(Path::new(json));

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
fn rays_are_measured_as_the_scene_grows() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [html, json] = ["growth.html", "growth.json"].map(|name| folder.path().join(name));
    let mut command = bench("growth.py", &["--triangles", "5000,20000", "--width", "32", "--rounds", "2"]);
    command.args(["--html".as_ref(), html.as_os_str(), "--json".as_ref(), json.as_os_str()]);
    let text = printed(command);
    assert_eq!(text.lines().count(), 3, "{text}");
    let report = read_json(&json);
    let scenes = report.as_array().expect("a row a scene");
    assert_eq!(scenes.len(), 2);
    for scene in scenes {
        let triangles = scene["triangles"].as_f64().expect("a count");
        assert!((5e3..21e3).contains(&triangles), "{triangles}");
        let bytes = scene["device_bytes_per_triangle"].as_f64().expect("a number");
        assert!((50.0..300.0).contains(&bytes), "{bytes} bytes a triangle");
        assert!(scene["bvh_build_triangles_per_second"].as_f64() > Some(1e3));
        assert!(scene["rays"]["bounce 2"]["rays_per_second"]["median"].as_f64() > Some(0.0));
    }
    assert!(fs::read_to_string(html).expect("it is written").contains("</svg>"));
}

/// `bench/gpu` of the project that lies in `root`.
fn gpu(root: &Path, raywave: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(root.join("bench/gpu"));
    command.current_dir(root).arg("--raywave").arg(raywave).args(arguments);
    command
}

#[test]
fn a_study_is_built_once_and_an_unknown_one_is_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let build = |study: &str| {
        let mut command = Command::new(project_file("bench/studies"));
        command.arg("--raywave").arg(program()).arg("--out").arg(folder.path()).args(["--quick", study]);
        ended(command)
    };
    let (_, said, code) = build("shading-cost");
    assert_eq!(code, Some(0), "{said}");
    let page = fs::read_to_string(folder.path().join("shading-cost.html")).expect("the page is written");
    assert!(page.contains("cornell-phong") && page.ends_with("</html>\n"), "{}", &page[page.len() - 100..]);
    let (_, said, code) = build("shading-cost");
    assert_eq!((&*said, code), ("shading-cost: there already\n", Some(0)));
    let (_, said, code) = build("speed");
    assert_eq!((&*said, code), ("error: there is no study speed; --list has them\n", Some(2)));
}

/// What it wrote, what it said, and its exit code.
fn ended(mut command: Command) -> (String, String, Option<i32>) {
    let Output { status, stdout, stderr } = command.output().expect("bash starts");
    let [out, err] = [stdout, stderr].map(|bytes| String::from_utf8(bytes).expect("text"));
    (out, err, status.code())
}

#[test]
fn a_gpu_is_measured_once() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let results = folder.path().join("results");
    let measure = |more: &[&str]| {
        let mut command = gpu(&project_file(""), &program(), &["--quick", "--minutes", "20", "--only", "renders"]);
        command.arg("--out").arg(&results).args(more);
        ended(command)
    };
    let (summary, said, code) = measure(&["cornell-box"]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(fs::read_to_string(results.join("summary.md")).expect("it is written"), summary);
    let rows = rows(summary.split("## renders").nth(1).expect("a section of the part"));
    assert_eq!(rows.iter().map(|row| row[0]).collect::<Vec<_>>(), ["list", "bvh2", "cwbvh", "bvh4"]);
    for row in rows {
        assert!(row.len() == 5 && row[2..].iter().all(|cell| number(cell) > 0.0), "{row:?}");
    }
    let render = read_json(&results.join("renders/cornell-box.16384.bvh4.wavefront.json"));
    assert_eq!(render["settings"]["bvh"], "bvh4");
    assert_eq!(render["settings"]["scheduler"], "wavefront");

    let (again, said, code) = measure(&["cornell-box"]);
    assert!(code == Some(0) && again == summary && said.contains("renders: done already"), "{said}");
    // Another choice of scenes does not mix with it.
    let (_, said, code) = measure(&["cornell-glass"]);
    assert!(code == Some(2) && said.contains("name another folder by --out"), "{said}");
}

/// A project of `bench/gpu` and a program that answers at once: with the digest that `digest` names, but in scenes that
/// have "odd" in their name, and with no image in those that have "bad". A file `slow` in the project has it sleep.
fn fake_project() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let place = |name: &str| folder.path().join(name);
    for name in ["bench", "tests", "scenes"] {
        fs::create_dir(place(name)).expect("a temporary folder");
    }
    install(&project_file("bench/gpu"), &place("bench/gpu"));
    fs::write(place("scenes/plain.toml"), "").expect("a temporary file");
    let script = r#"#!/bin/bash
case "$*" in
    devices) echo '0 Abacus  (chosen)' ;;
    --version) echo 'raywave 0' ;;
    render*--help) ;;
    render*)
        echo "$*" >>calls
        [ ! -e slow ] || sleep 0.3
        case $2 in *odd*) digest=7 ;; *bad*) echo 'error: a wheel is broken' >&2; exit 1 ;; *) digest=42 ;; esac
        while [ "$1" != --stats ]; do shift; done
        printf '{\n  "samples": 64,\n  "gpu_seconds": 0.5,\n  "pixels_blake3": "%s"\n}\n' $digest >"$2"
        ;;
    *) exit 2 ;;
esac
"#;
    fs::write(place("script"), script).expect("a temporary file");
    install(&place("script"), &place("raywave"));
    folder
}

#[test]
fn pixels_that_are_not_those_of_the_project_are_told() {
    let folder = fake_project();
    let digest = |scene: &str| {
        format!(
            "[[digest]]\nscene = \"{scene}\"\nintegrator = \"mis\"\nwidth = 96\nsamples = 4\npixels_blake3 = \"42\"\n"
        )
    };
    let run = |scenes: &[&str], out: &str| {
        let table: String = scenes.iter().map(|scene| digest(scene)).collect();
        fs::write(folder.path().join("tests/digests.toml"), table).expect("a temporary file");
        ended(gpu(folder.path(), Path::new("./raywave"), &["--only", "digests", "--out", out, "scenes/plain.toml"]))
    };
    let (summary, said, code) = run(&["plain", "other"], "right");
    assert!(code == Some(0) && summary.contains("`tests/digests.toml`: 2 of 2."), "{said}{summary}");
    let calls = fs::read_to_string(folder.path().join("calls")).expect("it was called");
    assert!(calls.contains("scenes/plain.toml --integrator mis --width 96 --samples 4 -o "), "{calls}");

    let (summary, said, code) = run(&["plain", "odd", "bad"], "wrong");
    assert_eq!(code, Some(1), "{said}");
    assert!(summary.contains("`tests/digests.toml`: 1 of 3."), "{summary}");
    assert!(summary.contains("WRONG: other pixels in 1 renders: odd.integrator-mis.width-96.samples-4\n"), "{summary}");
    assert!(summary.contains("exit code 1: error: a wheel is broken"), "{summary}");
}

#[test]
fn a_gpu_that_is_taken_away_is_measured_on_later() {
    let folder = fake_project();
    let calls = || fs::read_to_string(folder.path().join("calls")).unwrap_or_default().lines().count();
    let measure = || gpu(folder.path(), Path::new("./raywave"), &["--only", "renders", "--quick", "scenes/plain.toml"]);
    fs::write(folder.path().join("slow"), "").expect("a temporary file");
    let child = measure().stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("bash starts");
    while calls() < 2 {
        sleep(Duration::from_millis(20));
    }
    // To bash alone: a terminal would tell the program too.
    let kill = format!("kill -INT {}", child.id());
    assert!(Command::new("sh").args(["-c", &kill]).status().expect("sh starts").success());
    assert_eq!(child.wait_with_output().expect("it ends").status.code(), Some(130));
    let results = folder.path().join("gpu-results");
    assert!(results.join("renders.unfinished.md").exists() && !results.join("renders.md").exists());
    let kept = fs::read_dir(results.join("renders")).expect("the part's folder").count() - 1;
    let begun = calls();

    fs::remove_file(folder.path().join("slow")).expect("it is there");
    let (summary, said, code) = ended(measure());
    assert_eq!(code, Some(0), "{said}");
    assert!(!summary.contains("UNFINISHED") && !results.join("renders.unfinished.md").exists());
    // Three schedulers by three BVHs; what was finished was not rendered again.
    assert!((1..9).contains(&kept), "{kept}");
    assert_eq!(calls() - begun, 9 - kept);
}

#[test]
fn parts_are_listed_and_others_are_refused() {
    let (list, _, code) = ended(gpu(&project_file(""), &program(), &["--list"]));
    let seconds = list.lines().map(|line| line.split_whitespace().nth(1).and_then(|word| word.parse::<u32>().ok()));
    assert_eq!((seconds.sum::<Option<u32>>(), code), (Some(360), Some(0)), "{list}");
    for (arguments, words) in [
        (&["--only", "selftest,abacus"][..], "there is no part abacus"),
        (&["--minutes", "0"], "--minutes takes a whole number"),
        (&["--abacus"], "there is no flag --abacus"),
        (&["--out"], "--out asks for a value"),
        (&["--device", "abacus"], "no device"),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut command = gpu(&project_file(""), &program(), arguments);
        command.current_dir(folder.path());
        let (_, said, code) = ended(command);
        assert!(code == Some(2) && said.contains(words), "{said}");
    }
}

fn has_llvmpipe() -> bool {
    let mut command = Command::new(program());
    command.arg("devices").env_remove("RAYWAVE_DEVICE");
    printed(command).contains("llvmpipe")
}

#[test]
fn the_host_is_told_from_the_device() {
    if !has_llvmpipe() {
        return not_tested("the time of lavapipe's threads is taken off, and there is no lavapipe");
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let json = folder.path().join("host.json");
    let json = json.to_str().expect("a plain path");
    let small = ["--scale", "0.02", "--repeats", "1", "--cases", "compare,dump-rays,replay", "--json", json];
    let device = ["--device", "llvmpipe"];
    let text = printed(bench("host", &[&small[..], &device].concat()));
    let cases: Vec<_> = rows(&text).iter().map(|row| row[0].to_owned()).collect();
    assert_eq!(cases, ["compare", "dump-rays", "replay"], "{text}");
    let mut device_seconds = 0.0;
    for row in read_json(Path::new(json))["rows"].as_array().expect("a row a case") {
        let [all, device, wall] = ["all", "device", "wall"]
            .map(|of| row[format!("{of}_seconds_of_the_command")][0].as_f64().expect("seconds"));
        assert!(device < all && wall > 0.0, "{row}");
        device_seconds += device;
    }
    // Of a short command the device may have less than a tick.
    assert!(device_seconds > 0.0);
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
    let script = project_file("bench/common.py");
    let script = script.to_str().expect("a plain path");
    for (name, case) in [("samples", "cornell-box"), ("vs_mitsuba", "cornell-glass")] {
        let line = complaint(bench(name, &["--oracle", script, "--python", python, "--cases", case]));
        assert!(line.contains("pip install mitsuba numpy"), "{line}");
    }
}

#[test]
fn bad_arguments_are_told_in_a_line() {
    for (name, arguments, words) in [
        ("samples", &["--cases", "cornell-box"][..], "--oracle"),
        ("samples", &["--oracle", "nowhere.py"], "nowhere.py: there is no such script"),
        ("samples", &["--peers", "none", "--cases", "kitchen"], "kitchen is not part of raywave"),
        ("samples", &["--peers", "none", "--json", "/nowhere/a.json"], "/nowhere/a.json: cannot be written"),
        ("vs_mitsuba", &[], "--oracle"),
        ("vs_mitsuba", &["--oracle", "nowhere.py"], "nowhere.py: there is no such script"),
        ("vs_mitsuba", &["--json", "/nowhere/a.json"], "/nowhere/a.json: cannot be written"),
        ("traversal", &["--peers", "none", "--cases", "kitchen", "--scenes", "/"], "there is no kitchen.toml"),
        ("traversal", &["--peers", "none", "--cases", "cornell-box", "--device", "abacus"], "abacus"),
        ("mitsuba_suite", &["/nowhere"], "there is no such folder"),
        ("mitsuba_previews", &["/nowhere"], "there is no such scene"),
        ("mitsuba_previews", &["."], "none of these is a scene of Mitsuba"),
    ] {
        let line = complaint(bench(name, arguments));
        assert!(line.contains(words), "{line}");
    }
    for (name, arguments, words) in [
        ("traversal", ["--cases", "teapot"], "teapot is none of"),
        ("vs_mitsuba", ["--cases", "teapot"], "teapot is none of"),
        ("vs_mitsuba", ["--rounds", "2"], "--rounds must be 3 or more"),
        ("vs_mitsuba", ["--budget", "0"], "--budget must be above 0"),
        ("host", ["--cases", "sleep"], "sleep is none of"),
        ("host", ["--scale", "2"], "--scale must be above 0 and at most 1"),
        ("bias", ["--half", "0"], "--half must be above 0"),
        ("bias", ["--way", "mis"], "--way must be given twice or more"),
    ] {
        let usage = output(bench(name, &arguments));
        assert_eq!(usage.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&usage.stderr).contains(words), "{name}");
    }
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
    command.args(["-B", "-c", &format!("{MODULES}{script}")]).current_dir(project_file(""));
    let Output { status, stderr, .. } = output(command);
    assert!(status.success(), "{}", String::from_utf8_lossy(&stderr));
}

#[test]
fn intervals_hold_the_median_as_often_as_they_say() {
    assert_python(
        "
assert common.interval(range(1, 12)) == (2, 10)
assert common.interval([5, 1, 3]) == (None, None)
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

/// Programs whose images are a picture and noise that is known, rendered in no time.
const FAKE_PROGRAMS: &str = "
import math
vs = bench('vs_mitsuba')
picture = [0.0, 0.1, 0.5, 2.0] * 150
class Fake:
    # Of each setting: relMSE of one sample, how it falls, seconds of a sample, and what is added to every pixel.
    def __init__(self, kinds):
        self.kinds, self.draw, self.rendered = kinds, random.Random(5), []
    def pair(self, setting, samples, number):
        error, order, cost, bias = self.kinds[setting]
        self.rendered.append((setting, samples, number))
        deviation = math.sqrt(error * samples ** -order)
        image = lambda: [p + bias + self.draw.gauss(0, deviation * math.sqrt(p * p + vs.DARK)) for p in picture]
        images = [image(), image()]
        seconds = lambda: cost * samples * self.draw.uniform(0.95, 1.05)
        shots = [{'samples': samples, 'seconds': seconds(), 'mean': [sum(i) / len(i)] * 3} for i in images]
        return vs.Pair(shots, images)
    def shot(self, setting, samples, seed):
        self.pair(setting, samples, seed)
quick, slow = (vs.Setting('raywave', name, ()) for name in ('quick', 'slow'))
peer = vs.Setting('mitsuba', 'peer', ())
";

#[test]
fn time_to_an_error_is_that_of_the_line_through_two_counts() {
    assert_python(&format!(
        "{FAKE_PROGRAMS}
P = vs.Point
near = lambda a, b: all(abs(x / y - 1) < 1e-9 for x, y in zip(a, b))
# Error of order 2, time in proportion: between the counts, and beyond.
assert near(vs.reach([P(16, 1.6, 0.04), P(64, 6.4, 0.0025)], 0.01), (32, 3.2))
assert near(vs.reach([P(4, 0.4, 0.64), P(16, 1.6, 0.04)], 0.01), (32, 3.2))
# Errors that do not fall, by chance, are taken to fall as of independent samples.
assert near(vs.reach([P(4, 0.4, 0.02), P(16, 1.6, 0.02)], 0.01), (16, 1.6))
# Fewer than one sample there is not.
assert vs.reach([P(4, 0.4, 1e-6), P(16, 1.6, 1e-7)], 0.01)[0] == 1
# The pilot takes the two on both sides of the target.
known = [P(4, 0.4, 0.08), P(16, 1.6, 0.02), P(64, 6.4, 0.00125)]
assert near(vs.predicted(known, 0.01), vs.reach(known[1:], 0.01))
assert near(vs.predicted(known, 0.05), vs.reach(known[:2], 0.05))
assert near(vs.predicted(known[:1], 0.01), (32, 3.2))
# A power of two above what is needed, where the time allows.
assert vs.choose({{quick: known}}, 0.01, 100) == (quick, 8, 32)
assert vs.choose({{quick: known}}, 0.0001, 1.7) == (quick, 4, 16)
assert vs.verdict({{'low': 1.1, 'high': 1.3}}) == 'ahead' and vs.verdict({{'low': 0.9, 'high': 1.1}}) == 'within noise'
assert vs.digits(0.012345) == '0.0123' and vs.digits(12345.6) == '12346'
"
    ));
}

#[test]
fn time_to_an_error_is_found_again_in_images_of_known_noise() {
    assert_python(&format!(
        "{FAKE_PROGRAMS}
kinds = {{quick: (1.0, 1.0, 0.001, 0.0), slow: (1.0, 1.0, 0.002, 0.0), peer: (2.0, 1.5, 0.001, 0.0)}}
fake, shuffle = Fake(kinds), random.Random(2)
vs.TARGETS = [1e-1, 1e-2]
points, reference = vs.pilot(fake, list(kinds), 1e9, shuffle)
assert set(points) == {{quick, peer}}, points
assert 0 < reference.error() < 1e-2
choices = {{(s.program, t): vs.choose({{s: points[s]}}, t, 1e9) for s in points for t in vs.TARGETS}}
fake.rendered.clear()
rounds, apart = vs.measure(fake, choices, 8, reference.weights(), shuffle)
# The order of a round is drawn.
orders = [[task[:2] for task in fake.rendered if task[2] == 1_000_000 + n] for n in range(8)]
assert len(set(map(tuple, orders))) > 1 and all(sorted(o) == sorted(orders[0]) for o in orders)
means = {{s.program: [m for row in rounds for m in row[s, choices[s.program, 1e-2].top]['means']] for s in points}}
assert vs.complaint(means, apart) is None
work = types.SimpleNamespace(words=lambda: 'fake')
rows = list(vs.rows_of(work, choices, rounds, apart))
for row in rows:
    for name, (error, order, cost, _) in (('raywave', kinds[quick]), ('mitsuba', kinds[peer])):
        truth = cost * (error / row['target']) ** (1 / order)
        told = row[name]['seconds']
        assert told['low'] * 0.98 <= truth <= told['high'] * 1.02 and told['high'] < 1.5 * told['low'], (row, truth)
# 0.1 s beside 0.034 s.
assert rows[1]['verdict'] == 'behind' and 0.28 < rows[1]['ratio']['value'] < 0.42, rows[1]
assert all(len(vs.cells(row)) == 9 for row in rows)
"
    ));
}

#[test]
fn stray_samples_do_not_hide_in_the_light_they_make() {
    assert_python(&format!(
        "{FAKE_PROGRAMS}
class Strays(Fake):
    def pair(self, setting, samples, number):
        pair = super().pair(setting, samples, number)
        if setting == quick:
            for image in pair.images:
                image[self.draw.randrange(len(image))] += 1000.0 / samples
        return pair
kinds = {{quick: (0.1, 1.0, 0.001, 0.0), slow: (1.0, 1.0, 0.002, 0.0), peer: (2.0, 1.5, 0.001, 0.0)}}
vs.TARGETS = [1e-1, 1e-2]
points, reference = vs.pilot(Strays(kinds), list(kinds), 1e9, random.Random(2))
assert set(points) == {{slow, peer}}, points
# Nor are they left in what the rounds are weighed by.
assert set(reference.sums) == {{slow, peer}} and reference.error() < 1e-2
"
    ));
}

#[test]
fn images_that_are_apart_are_told_pixel_by_pixel() {
    assert_python(&format!(
        "{FAKE_PROGRAMS}
def apart(bias, rounds=8):
    fake = Fake({{quick: (1.0, 1.0, 1, 0.0), peer: (1.0, 1.0, 1, bias)}})
    weights = [1 / (p * p + vs.DARK) for p in picture]
    return [vs.apart_of(fake.pair(quick, 256, n), fake.pair(peer, 256, n), weights) for n in range(rounds)]
same = {{name: [[0.5 + n * 1e-3] * 3 for n in range(8)] for name in vs.PROGRAMS}}
assert vs.complaint(same, apart(0.0)) is None
# 0.05 squared over picture squared and 0.01, on average.
truth = sum(0.0025 / (p * p + vs.DARK) for p in picture) / len(picture)
mean, error = common.mean_and_error(apart(0.05, 40))
assert abs(mean - truth) < 4 * error < truth / 4, (mean, truth, error)
assert 'apart' in vs.complaint(same, apart(0.05))
assert 'apart' in vs.complaint(same, [float('nan')] * 8)
assert 'red' in vs.complaint(same | {{'mitsuba': [[0.9] * 3] * 8}}, apart(0.0))
# The error of a pair is the relMSE that its noise has, 1/256.
fake = Fake({{quick: (1.0, 1.0, 1, 0.0)}})
weights = [1 / (p * p + vs.DARK) for p in picture]
error = sum(vs.error_of(fake.pair(quick, 256, n), weights) for n in range(40)) / 40
assert abs(256 * error - 1) < 0.04, error
"
    ));
}

#[test]
fn intervals_of_few_rounds_hold_what_they_estimate() {
    assert_python(&format!(
        "{FAKE_PROGRAMS}
draw = random.Random(11)
vs.RESAMPLES, held = 200, 0
for _ in range(500):
    rounds = [math.exp(draw.gauss(0, 0.3)) for _ in range(6)]
    told = vs.with_interval(rounds, lambda some: sum(some) / len(some), draw)
    held += told['low'] <= math.exp(0.045) <= told['high']
assert 0.91 < held / 500 < 0.985, held
"
    ));
}

#[test]
fn a_bias_of_an_exact_setting_is_told() {
    assert_python(
        "
bias = bench('bias')
draw = random.Random(11)
# Of each way: its mean, and the noise of an image.
kinds = {'first': (0.5, 1e-5), 'exact': (0.5, 1e-4), 'noisy': (0.5, 3e-4), 'dark': (0.4998, 2e-5)}
def render(options, scene, way, seed, folder):
    seeds.append(seed)
    way.means.append(draw.gauss(*kinds[way.flags]))
bias.render, seeds = render, []
ticks = iter(range(10**6))
def run(**options):
    given = types.SimpleNamespace(**{'way': list(kinds), 'half': 3e-5, 'budget': 10**6, **options})
    return {way.flags: way for way in bias.measure(given, None, None, clock=lambda: next(ticks))}
ways = run()
found = {name: way.beside(ways['first']) for name, way in ways.items() if name != 'first'}
assert all(half <= 3e-5 for _, half in found.values()), found
assert {name: bias.verdict(*of) for name, of in found.items()} == {
    'exact': 'below 1e-4', 'noisy': 'below 1e-4', 'dark': 'APART'}, found
assert abs(found['dark'][0] + 4e-4) < 6e-5, found
# No two images have a seed in common, and more go to where they are needed.
assert len(set(seeds)) == len(seeds)
assert len(ways['noisy'].means) > 5 * len(ways['exact'].means) > 200
# When the time is up what is not known is said to be so.
ways = run(budget=30)
assert bias.verdict(*ways['noisy'].beside(ways['first'])) == 'not known so well'
",
    );
}

#[test]
fn a_forest_has_as_many_trees_as_it_is_asked_for() {
    let folder = TempDir::new().expect("a temporary folder");
    let mut command = Command::new("python3");
    command.arg(project_file("bench/forest.py")).arg(folder.path()).args(["--triangles", "100", "--places", "50"]);
    assert!(printed(command).ends_with("forest.gltf: 50 trees of 100 triangles\n"));
    let info = Command::new(program()).arg("info").arg(folder.path().join("forest.gltf")).output().expect("it runs");
    let told = String::from_utf8(info.stdout).expect("text");
    assert!(
        told.contains("triangles        5002\nplaced meshes    1, of 100 triangles, 50 times; flatten\n"),
        "{told}"
    );
}
