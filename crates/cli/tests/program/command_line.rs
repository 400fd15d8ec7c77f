//! The program as its users run it: exit codes, messages, files and numbers. What is malformed
//! gives one line on stderr and exit code 2, and leaves no file behind.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::common::project::program;
use crate::common::{self, device};
use glam::Vec3;
use raywave::gpu::GpuError;
use raywave::image::{Image, WriteOptions, image_bytes, read_image, read_metadata};
use raywave::render::{PreparedScene, RenderError, Session};
use raywave::scene::Scene;
use raywave::settings::{SETTINGS, Setting};
use serde_json::Value;
use tempfile::TempDir;

pub const CAMERA: &str = "[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nvfov = 40\n";
const LAMP_MTL: &str = "newmtl lamp\nKe 1 1 1\n";

/// A folder that the program runs in, with images and scenes to take.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        let folder = Self(tempfile::tempdir().expect("a temporary folder"));
        folder.write("lamp.mtl", LAMP_MTL);
        for (name, width) in [("small.png", 2), ("small.exr", 2), ("wide.png", 3), ("wide.exr", 3)] {
            folder.write(name, image(name, width));
        }
        folder
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, contents: impl AsRef<[u8]>) {
        fs::write(self.path(name), contents).expect("a temporary file");
    }

    /// A scene file over `lamp.toml`'s parts: `toml` under the camera, `faces` in the mesh.
    pub fn scene(&self, name: &str, toml: &str, obj: &str) {
        self.write(&format!("{name}.obj"), format!("mtllib lamp.mtl\nusemtl lamp\n{obj}"));
        self.write(&format!("{name}.toml"), format!("{toml}[[mesh]]\nfile = \"{name}.obj\"\n"));
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(program());
        // What was tuned on this machine is no part of a test.
        command.current_dir(self.0.path()).args(arguments).env("RAYWAVE_CACHE", "off");
        command
    }

    /// A shell in which `"$0" "$@"` is the program with these arguments.
    pub fn shell(&self, script: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]).arg(program()).args(arguments);
        command.current_dir(self.0.path()).env("RAYWAVE_CACHE", "off");
        command
    }

    pub fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().expect("the program starts")
    }

    /// Runs what must succeed; what it prints to stdout.
    pub fn succeed(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
        text(&output.stdout)
    }

    /// Names and contents of all files.
    fn files(&self) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
        let entries = fs::read_dir(self.0.path()).expect("the folder is there");
        let paths = entries.map(|entry| entry.expect("the folder is readable").path());
        paths.map(|path| (path.clone(), fs::read(path).ok())).collect()
    }
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("the program writes UTF-8")
}

fn image(name: &str, width: u32) -> Vec<u8> {
    let image = Image::new(width, 2, vec![Vec3::splat(0.5); 2 * width as usize]);
    image_bytes(Path::new(name), &image, &WriteOptions::default()).expect("a small image")
}

/// Invocations that are refused, each with a part of the message. Arguments are split at blanks.
#[rustfmt::skip]
const REFUSED: &[(&str, &str)] = &[
    // Arguments
    ("rneder -o a.png", "unrecognized subcommand 'rneder'"),
    ("render", "--output <FILE>"),
    ("render -o a.png --unknown", "unexpected argument '--unknown'"),
    ("render -o a.png --progress dots", "possible values: bar, openjd, json"),
    ("render -o - --progress json", "--output and --progress both go to stdout"),
    ("render -o a.png --stats - --progress openjd", "--stats and --progress both go to stdout"),
    ("render -o a.png one.obj two.obj", "unexpected argument 'two.obj'"),
    ("render -o a.png --width 0", "0 is not in 1..=65536"),
    ("render -o a.png --width 0 --height 0", "0 is not in 1..=65536"),
    ("render -o a.png --height -5", "-5"),
    ("render -o a.png --width 9999999999", "--width <WIDTH>"),
    ("render -o a.png --width 1x1", "invalid digit"),
    ("render -o a.png --samples 0", "--samples <SAMPLES>"),
    ("render -o a.png --samples many", "invalid digit"),
    ("render -o a.png --width 1 --height 1 --samples 1000000000", "1000000000 samples per pixel"),
    ("render -o a.png --max-bounces -2", "-2 is not in -1..=1000000"),
    ("render -o a.png --max-bounces -1", "unbounded paths never end without a roulette"),
    ("render -o a.png --integrator magic", "possible values: implicit, explicit, mis"),
    ("render -o a.png --roulette 1", "roulette 1 is not a probability"),
    ("render -o a.png --roulette -0.1", "roulette -0.1 is not a probability"),
    ("render -o a.png --roulette nan", "roulette NaN is not a probability"),
    ("render -o a.png --roulette inf", "roulette inf is not a probability"),
    ("render -o a.png --roulette-mode sometimes", "possible values: constant, throughput"),
    ("render -o a.png --roulette-mode throughput --max-bounces -1", "unbounded paths never end without a roulette"),
    ("render -o a.png --sampler halton", "possible values: independent, sobol"),
    ("render -o a.png --clamp 0", "a clamp of 0 lets no light through"),
    ("render -o a.png --clamp -1", "a clamp of -1 lets no light through"),
    ("render -o a.png --clamp nan", "a clamp of NaN lets no light through"),
    ("render -o a.png --clamp inf", "a clamp of inf lets no light through"),
    ("render -o a.png --seed -1", "-1"),
    ("render -o a.png --in-flight 0", "--in-flight <PATHS>"),
    ("render -o a.png --workgroup 0", "--workgroup <SIZE>"),
    ("render -o a.png --scheduler magic", "possible values: wavefront, bounce, megakernel"),
    ("render -o a.png --shading-cost 40000", "40000 is not in 0..=32768"),
    ("compare --vary colour", "colour"),
    ("compare --vary in-flight=many", "many"),
    ("compare --vary scheduler --baseline workgroup=64", "workgroup"),
    ("compare --rounds 0", "--rounds <N>"),
    ("compare --until 3%% --html page.html", "--until <SHARE>"),
    ("compare --html missing/page.html", "missing"),
    ("compare missing.toml --rounds 1", "missing.toml"),
    ("compare --vary roulette=1", "use a number from 0 up to, not including, 1"),
    ("compare --vary clamp=-1", "use a number above 0, or off"),
    ("tradeoff --budget soon", "it is not a time such as 90s, 10m or 1h"),
    ("tradeoff --target-error 0", "it is not a number above 0"),
    ("tradeoff --html missing/page.html", "missing"),
    ("tradeoff missing.toml", "missing.toml"),
    ("tradeoff --reference missing.exr", "missing.exr"),
    ("tradeoff --reference folder.png", "folder.png"),
    ("render -o a.png --path-state f8", "possible values: f32, f16"),
    ("render -o a.png --offsets magic", "possible values: robust, unchecked, fixed"),
    ("start-up --rounds 0", "--rounds <N>"),
    ("start-up missing.toml", "missing.toml: cannot read"),
    ("start-up --device abacus", "no device is called or numbered 'abacus'"),
    ("start-up --width 60000 --height 60000", "60000x60000 has 3600000000 pixels"),
    ("first-sample", "no settings on stdin"),
    ("dump-rays -o a.rays", "--bounce <B>"),
    ("dump-rays --bounce 0", "--output <FILE>"),
    ("dump-rays --bounce -1 -o a.rays", "unexpected argument '-1'"),
    ("dump-rays --bounce 0 --rays light -o a.rays", "possible values: path, shadow"),
    ("dump-rays --bounce 0 --order depth -o a.rays", "possible values: slot, queue"),
    ("dump-rays --bounce 0 --scheduler megakernel -o a.rays", "the megakernel keeps no queues"),
    ("dump-rays --bounce 0 --rays shadow --scheduler bounce --shadow-rays at-once -o a.rays", "shadow rays that are traced at once are in no queue"),
    ("dump-rays --bounce 9 --width 9 --height 9 -o a.rays", "there are no path rays at bounce 9; there are some up to bounce "),
    ("dump-rays --bounce 2 --max-bounces 0 -o a.rays", "there are no path rays at bounce 2; there are some at bounce 0"),
    ("dump-rays --bounce 1 --rays shadow --integrator implicit -o a.rays", "shadow rays at bounce 1, nor before it; they need --integrator explicit"),
    ("dump-rays missing.toml --bounce 0 -o a.rays", "missing.toml: cannot read"),
    ("dump-rays --bounce 0 -o nowhere/a.rays", "the folder nowhere is missing"),
    ("dump-rays --bounce 0 -o folder.png", "it is a folder"),
    ("dump-rays --bounce 0 -o a.rays --triangles nowhere/a.npy", "the folder nowhere is missing"),
    ("dump-rays --bounce 0 -o a.rays --distances folder.png", "it is a folder"),
    ("dump-rays --bounce 0 -o a.rays --triangles a.npy --distances ./a.npy", "two outputs name this file"),
    ("replay", "<FILE>"),
    ("replay missing.rays", "missing.rays: cannot read the rays"),
    ("replay folder.png", "folder.png: cannot read the rays"),
    ("replay missing.toml good.rays", "missing.toml: cannot read"),
    ("replay lamp.mtl", "lamp.mtl: byte 0: this is no ray dump"),
    ("replay cut.rays", "cut.rays: byte "),
    ("replay cut.rays", ": the file ends after 80 of 81 rays"),
    ("replay nan.rays", ": ray 80: direction holds NaN, which is not finite"),
    ("replay lamp.toml good.rays", "good.rays: byte 15: the rays are of scene cornell-box"),
    ("replay good.rays --rounds 0", "0 is not in 1..=1000000"),
    ("replay good.rays --repeat 0", "0 is not in 1..=65536"),
    ("replay good.rays --workgroup 0", "--workgroup <SIZE>"),
    ("replay good.rays --in-flight 0", "--in-flight <RAYS>"),
    ("replay good.rays --device abacus", "no device is called or numbered 'abacus'"),
    ("replay good.rays --json ./good.rays", "--json would overwrite the rays"),
    ("replay good.rays --json nowhere/a.json", "the folder nowhere is missing"),
    ("render -o a.png --exposure nan", "it is no number of stops"),
    ("render -o a.png --exposure bright", "it is no number of stops"),
    ("render -o a.png --device abacus", "no device is called or numbered 'abacus'; there are: 0 "),
    ("render -o a.png --device 99", "no device is called or numbered '99'"),
    ("render -o a.png --width 60000 --height 60000", "60000x60000 has 3600000000 pixels"),

    // Outputs
    ("render -o", "--output <FILE>"),
    ("render -o a", "unknown image format"),
    ("render -o a.jpg", "unknown image format"),
    ("render -o nowhere/a.png", "the folder nowhere is missing"),
    ("render -o folder.png", "it is a folder"),
    ("render -o lamp.mtl/a.png", "lamp.mtl"),
    ("render -o a.png --stats nowhere/a.json", "the folder nowhere is missing"),
    ("render -o a.png --stats folder.png", "it is a folder"),
    ("render -o a.png --stats a.png", "name the same file"),
    ("render -o a.png --stats ./a.png", "name the same file"),
    ("render -o a.png --trace nowhere/a.json", "the folder nowhere is missing"),
    ("render -o a.png --trace folder.png", "it is a folder"),
    ("render -o a.png --trace ./a.png", "--trace and --output name the same file"),
    ("render -o a.png --stats a.json --trace ./a.json", "--trace and --stats name the same file"),
    ("render -o no\nwhere/a.png", "is missing"),

    // Scenes
    ("render missing.toml -o a.png", "missing.toml: cannot read"),
    ("render missing.obj -o a.png", "missing.obj: cannot read"),
    ("render small.png -o a.png", "neither .toml, .xml, .gltf, .glb, .obj nor .ply"),
    ("render folder.toml -o a.png", "folder.toml: cannot read"),
    ("render bytes.toml -o a.png", "bytes.toml:1: not UTF-8"),
    ("render bytes.obj -o a.png", "bytes.obj: not an OBJ file but UTF-16 text"),
    ("render empty.toml -o a.png", "empty.toml: no [camera]"),
    ("render no-mesh.toml -o a.png", "no-mesh.toml: no [[mesh]]"),
    ("render vfov.toml -o a.png", "vfov.toml:4: vfov is outside (0, 180)"),
    ("render film.toml -o a.png", "film.toml:6: width is outside"),
    ("render q.toml -o a.png", "q.toml:6: roulette is outside [0, 1)"),
    ("render magic.toml -o a.png", "magic.toml:6: no integrator `magic`"),
    ("render sky.toml -o a.png", "sky.toml:6: image `missing.exr` cannot be read"),
    ("render broken-sky.toml -o a.png", "broken-sky.toml:6: image `broken.exr`"),
    ("render nan.toml -o a.png", "nan.obj:4: `nan` in a vertex is not finite"),
    ("render index.toml -o a.png", "index.obj:6: vertex index 4 is out of range"),
    ("render no-faces.toml -o a.png", "no-faces.obj: no faces"),
    ("render point.toml -o a.png", "no triangle has an area"),
    ("render ke.obj -o a.png", "ke.mtl:2: Ke is negative"),
    ("render texture.obj -o a.png", "texture.mtl:2: image `broken.png`"),

    // The other commands
    ("info missing.toml", "missing.toml: cannot read"),
    ("info nan.toml", "is not finite"),
    ("devices --device abacus", "no device is called or numbered 'abacus'"),
    ("diff small.png", "<B>"),
    ("diff small.png missing.png", "missing.png: cannot open"),
    ("diff small.png wide.png", "cannot compare small.png with wide.png"),
    ("diff small.exr wide.exr", "cannot compare small.exr with wide.exr"),
    ("diff broken.png small.png", "broken.png: not a readable PNG image"),
    ("diff broken.exr small.exr", "broken.exr: not a readable EXR image"),
    ("diff lamp.mtl small.png", "unknown image format"),
    ("diff small.png small.png --heatmap nowhere/a.png", "the folder nowhere is missing"),
    ("diff small.png small.png --scale absolute", "--heatmap <FILE.png>"),
    ("gallery", "<FOLDER>"),
    ("gallery a --triangles 3", "3 is not in 5000..=100000000"),
    ("gallery lamp.mtl", "lamp.mtl: cannot be written"),
];

/// The files that `REFUSED` names.
fn broken_files() -> Folder {
    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let folder = Folder::new();
    for name in ["folder.png", "folder.toml"] {
        fs::create_dir(folder.path(name)).expect("a folder");
    }
    for name in ["bytes.toml", "bytes.obj"] {
        folder.write(name, [0xff, 0xfe, 0, 1, 2]);
    }
    for name in ["small.png", "small.exr"] {
        let whole = fs::read(folder.path(name)).expect("it was just written");
        folder.write(&name.replace("small", "broken"), &whole[..whole.len() / 2]);
    }
    let size = ["--width", "9", "--height", "9", "--samples", "1", "--quiet"];
    folder.succeed(&[&["dump-rays", "--bounce", "0", "-o", "good.rays"], &size[..]].concat());
    let mut rays = fs::read(folder.path("good.rays")).expect("it was just written");
    let end = rays.len();
    folder.write("cut.rays", &rays[..end - 1]);
    rays[end - 8..end - 4].copy_from_slice(&f32::NAN.to_le_bytes());
    folder.write("nan.rays", rays);
    folder.scene("lamp", CAMERA, TRIANGLE);
    folder.write("empty.toml", "");
    folder.write("no-mesh.toml", CAMERA);
    for (name, line) in [
        ("film", "[film]\nwidth = 0\n"),
        ("q", "[render]\nroulette = 1.0\n"),
        ("magic", "[render]\nintegrator = \"magic\"\n"),
        ("sky", "[environment]\nfile = \"missing.exr\"\n"),
        ("broken-sky", "[environment]\nfile = \"broken.exr\"\n"),
    ] {
        folder.scene(name, &format!("{CAMERA}{line}"), TRIANGLE);
    }
    folder.scene("vfov", &CAMERA.replace("40", "180"), TRIANGLE);
    for (name, obj) in [
        ("nan", "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n"),
        ("index", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n"),
        ("no-faces", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        ("point", "v 0 0 0\nf 1 1 1\n"),
    ] {
        folder.scene(name, CAMERA, obj);
    }
    for (name, key) in [("ke", "Ke -1 0 0"), ("texture", "map_Kd broken.png")] {
        let corners = "vt 0 0\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/1 3/1\n";
        folder.write(&format!("{name}.mtl"), format!("newmtl a\n{key}\n"));
        folder.write(&format!("{name}.obj"), format!("mtllib {name}.mtl\nusemtl a\n{corners}"));
    }
    folder
}

/// Clocks are told of NVIDIA's cards; no driver of software tells its own.
fn assert_clocks(clocks: &Value) {
    if device().description().is_software() {
        assert!(clocks.is_null(), "{clocks}");
    } else {
        assert!(clocks.is_null() || clocks["sm_megahertz"].as_f64().is_some_and(|clock| clock > 0.0), "{clocks}");
    }
}

/// What a driver made of a kernel; those of software do not tell.
fn assert_executables(kernel: &Value) {
    let (executables, occupancy) = (&kernel["executables"], &kernel["occupancy_by_registers"]);
    if device().description().is_software() {
        assert!(executables.is_null() && occupancy.is_null(), "{kernel}");
    } else if let Some(executables) = executables.as_array() {
        assert!(executables.iter().all(|executable| executable["figures"].is_array()), "{kernel}");
        assert!(occupancy.is_null() || occupancy.as_f64().is_some_and(|share| share > 0.0 && share <= 1.0), "{kernel}");
    }
}

#[test]
fn what_is_malformed_gives_one_line_and_no_file() {
    let folder = broken_files();
    let mut before = folder.files();
    let mut faults = Vec::new();
    for (line, part) in REFUSED {
        let arguments: Vec<&str> = line.split(' ').collect();
        let output = folder.run(&arguments);
        let message = text(&output.stderr);
        let well_said = message.starts_with("error: ")
            && message.ends_with('\n')
            && message.lines().count() == 1
            && message.contains(part)
            && !message.contains("panicked");
        if output.status.code() != Some(2) || !well_said {
            faults.push(format!("{line}\n  {}, not about {part:?}:\n{message}", output.status));
        }
        let after = folder.files();
        if after != before {
            faults.push(format!("{line}\n  changes files"));
            before = after;
        }
    }
    assert!(REFUSED.len() >= 30);
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn help_and_version_are_data() {
    let folder = Folder::new();
    assert!(folder.succeed(&["--version"]).starts_with("raywave "));
    for command in [&[][..], &["render"], &["devices"], &["info"], &["diff"], &["dump-rays"], &["replay"], &["gallery"]]
    {
        let help = folder.succeed(&[command, &["--help"]].concat());
        assert!(help.contains("Usage: raywave"), "{help}");
    }
    let output = folder.run(&[]);
    assert_eq!(output.status.code(), Some(2), "no command is an error");
    assert!(output.stdout.is_empty() && text(&output.stderr).contains("Usage: raywave"));
}

#[test]
fn batches_do_not_change_the_image() {
    let folder = Folder::new();
    let bytes = |paths: &str| {
        folder.succeed(&[&["render", "-o", "box.hdr", "--in-flight", paths], &TINY[..]].concat());
        fs::read(folder.path("box.hdr")).expect("the image is written")
    };
    let whole = bytes("100000");
    for paths in ["1", "100", "256", "300"] {
        assert_eq!(bytes(paths), whole, "{paths} paths in flight");
    }
}

#[test]
fn schedulers_write_the_same_pixels() {
    let folder = Folder::new();
    let render = |name: &str, flags: &[&str]| {
        folder.succeed(&[&["render", "-o", name], &TINY[..], flags].concat());
    };
    render("wavefront.exr", &["--scheduler", "wavefront", "--in-flight", "100"]);
    render("megakernel.exr", &["--scheduler", "megakernel", "--in-flight", "333", "--workgroup", "64"]);
    render("bounce.exr", &["--scheduler", "bounce", "--in-flight", "333", "--workgroup", "64"]);
    render("at-once.exr", &["--scheduler", "bounce", "--shadow-rays", "at-once", "--in-flight", "100"]);
    render("seed.exr", &["--seed", "1"]);
    let identical = |other| {
        let report = folder.succeed(&["diff", "wavefront.exr", other]);
        let line = report.lines().find_map(|line| line.strip_prefix("identical_pixels"));
        line.unwrap_or_else(|| panic!("no identical pixels in {report}")).trim().to_owned()
    };
    for same in ["megakernel.exr", "bounce.exr", "at-once.exr"] {
        assert_eq!(identical(same), "256 of 256, to the last bit", "{same}");
    }
    assert_ne!(identical("seed.exr"), "256 of 256, to the last bit");
}

#[test]
fn one_pixel_takes_every_sample() {
    // lavapipe leaves a loop after 65 535 rounds: samples went missing from a large batch.
    let folder = Folder::new();
    let bytes = |paths: &str| {
        let size = ["--width", "1", "--height", "1", "--samples", "100000", "--quiet"];
        folder.succeed(&[&["render", "-o", "box.hdr", "--in-flight", paths], &size[..]].concat());
        fs::read(folder.path("box.hdr")).expect("the image is written")
    };
    assert_eq!(bytes("100000"), bytes("10000"));
}

const TINY: [&str; 7] = ["--width", "16", "--height", "16", "--samples", "2", "--quiet"];

#[test]
fn the_same_command_gives_the_same_bytes() {
    let folder = Folder::new();
    for name in ["box.png", "box.exr", "box.hdr"] {
        let bytes = || {
            folder.succeed(&[&["render", "-o", name], &TINY[..]].concat());
            let bytes = fs::read(folder.path(name)).expect("the image is written");
            fs::remove_file(folder.path(name)).expect("it was just read");
            bytes
        };
        let first = bytes();
        assert_eq!(first, bytes(), "{name}");
        folder.write(name, first);
        let image = read_image(&folder.path(name)).expect("the image is readable");
        assert_eq!((image.width, image.height), (16, 16), "{name}");
        assert!(image.pixels.iter().any(|pixel| pixel.max_element() > 0.0), "{name} is black");
    }
}

#[test]
fn statistics_and_metadata_hold_every_setting() {
    let folder = Folder::new();
    let flags =
        ["--integrator", "implicit", "--max-bounces", "-1", "--roulette", "0.25", "--seed", "7", "--in-flight", "100"];
    let output = ["render", "-o", "box.exr", "--stats", "box.json", "--scheduler", "bounce"];
    let estimator =
        ["--sampler", "independent", "--roulette-mode", "throughput", "--roulette-from", "2", "--clamp", "1.5"];
    folder.succeed(&[&output, &TINY[..], &flags[..], &estimator].concat());

    let json = fs::read_to_string(folder.path("box.json")).expect("the statistics are written");
    let statistics: Value = serde_json::from_str(&json).expect("the statistics are JSON");
    for key in ["samples_per_second", "rays_per_second", "wall_seconds", "device_memory_bytes", "bvh_build_seconds"] {
        assert!(statistics[key].as_f64().is_some_and(|value| value > 0.0), "{key} in {json}");
    }
    for key in ["gpu_seconds", "idle_seconds", "nonfinite_samples", "shadow_rays"] {
        assert!(statistics[key].is_number(), "{key} in {json}");
    }
    for key in ["clocks_before", "clocks_after"] {
        assert_clocks(&statistics[key]);
    }
    assert_eq!(statistics["samples"], 16 * 16 * 2);
    assert_eq!(statistics["camera_rays"], 16 * 16 * 2);
    assert_eq!(statistics["triangles"], Scene::cornell_box().mesh.triangles.len());
    let kernels = statistics["kernels"].as_object().expect("kernels are listed");
    for kernel in ["generate", "bounce", "prepare_dispatch", "resolve"] {
        let kernel = &kernels[kernel];
        assert!(kernel["launches"].as_u64().is_some_and(|n| n > 0) && kernel["gpu_seconds"].is_number(), "{json}");
    }
    assert!(!kernels.contains_key("connect"), "BRDF sampling alone sends no shadow rays");

    let settings = statistics["settings"].as_object().expect("settings are listed");
    for (key, value) in [
        ("width_pixels", Value::from(16)),
        ("height_pixels", 16.into()),
        ("samples_per_pixel", 2.into()),
        ("integrator", "implicit".into()),
        ("max_bounces", (-1).into()),
        ("roulette", 0.25.into()),
        ("roulette_mode", "throughput".into()),
        ("roulette_from_vertex", 2.into()),
        ("sampler", "independent".into()),
        ("clamp_radiance", 1.5.into()),
        ("biased_by", ["clamp"].as_slice().into()),
        ("seed", 7.into()),
        ("paths_in_flight", 100.into()),
        ("scene", "cornell-box".into()),
        ("scene_hash", Scene::cornell_box().hash.into()),
        ("device", device().description().name.clone().into()),
    ] {
        assert_eq!(settings[key], value, "{key}");
    }
    for key in [
        "raywave_version",
        "rustc_version",
        "scheduler",
        "shadow_rays",
        "bvh",
        "driver",
        "vulkan_version",
        "workgroup_size_invocations",
    ] {
        assert!(settings.contains_key(key), "{key} in {json}");
    }

    let in_image: BTreeMap<String, String> =
        read_metadata(&folder.path("box.exr")).expect("the image has metadata").into_iter().collect();
    let as_text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    let digest = ("pixels_blake3".to_owned(), statistics["pixels_blake3"].clone());
    let in_json = settings.clone().into_iter().chain([digest]);
    let in_json = in_json.map(|(key, value)| (format!("raywave.{key}"), as_text(&value))).collect();
    assert_eq!(in_image, in_json);
    let image = read_image(&folder.path("box.exr")).expect("the image can be read");
    assert_eq!(statistics["pixels_blake3"], image.digest());
}

/// A picture that no default is like, without `--quiet`.
const ODD: [&str; 12] = [
    "--width",
    "16",
    "--height",
    "8",
    "--scheduler",
    "megakernel",
    "--workgroup",
    "64",
    "--in-flight",
    "100",
    "--seed",
    "7",
];

#[test]
fn start_up_is_that_of_the_picture_that_is_asked_for() {
    let folder = Folder::new();
    let output = folder.succeed(&[&["start-up", "--rounds", "2", "--json"], &ODD[..]].concat());
    let json: Value = serde_json::from_str(&output).expect("it is JSON");
    for (key, value) in [
        ("width_pixels", Value::from(16)),
        ("height_pixels", 8.into()),
        ("samples_per_pixel", 1.into()),
        ("scheduler", "megakernel".into()),
        ("workgroup_size_invocations", 64.into()),
        ("paths_in_flight", 100.into()),
        ("seed", 7.into()),
        ("scene_hash", Scene::cornell_box().hash.into()),
        ("device", device().description().name.clone().into()),
    ] {
        assert_eq!(json["settings"][key], value, "{key}");
    }
    let is_estimate = |value: &Value| {
        let measured = value["value"].as_f64().is_some_and(|seconds| seconds > 0.0);
        measured && value["low"].is_null() && value["high"].is_null() && value["verdict"] == "too few rounds"
    };
    let pipelines = json["pipelines"].as_array().expect("a list");
    let kernels: Vec<_> = pipelines.iter().map(|pipeline| pipeline["kernel"].as_str().expect("a name")).collect();
    assert_eq!(kernels, ["megakernel", "prepare_dispatch", "resolve"]);
    for times in pipelines.iter().chain([&json["start_up"], &json["all_pipelines"]]) {
        for key in ["cold_seconds", "cached_seconds"] {
            assert!(is_estimate(&times[key]), "{key} in {times}");
        }
    }
    for (key, start_up) in [("cold_seconds", &json["start_up"]), ("cached_seconds", &json["start_up"])] {
        let runs: Vec<_> = json["runs"][key].as_array().expect("a list").iter().filter_map(Value::as_f64).collect();
        let middle = start_up[key]["value"].as_f64().expect("a number");
        assert_eq!(runs.len(), 2);
        assert!((runs.iter().sum::<f64>() / 2.0 - middle).abs() < 1e-9, "{runs:?} have the median {middle}");
        // A process is longer than the parts of it that it tells of.
        assert!(middle > json["all_pipelines"][key]["value"].as_f64().expect("a number"), "{key}");
    }
}

#[test]
fn start_up_leaves_no_file() {
    let folder = Folder::new();
    folder.scene("lamp", CAMERA, "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n");
    let before = folder.files();
    // What is found of the device is kept with the caches.
    let caches = tempfile::tempdir().expect("a temporary folder");
    let home = caches.path().as_os_str();
    let output = folder
        .command(&["start-up", "lamp.toml", "--rounds", "1", "--width", "8", "--height", "8", "--scheduler", "bounce"])
        .envs([("HOME", home), ("XDG_CACHE_HOME", home), ("MESA_SHADER_CACHE_DIR", home)])
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(folder.files(), before);
    let table = text(&output.stdout);
    for row in ["lamp, 8x8, bounce, on ", "start-up ", "pipelines ", "  generate ", "  bounce ", "  resolve "] {
        assert!(table.lines().any(|line| line.starts_with(row)), "{row} in {table}");
    }
}

#[test]
fn a_comparison_tells_of_start_up_and_of_shared_settings() {
    let folder = Folder::new();
    let compare = ["compare", "--vary", "scheduler", "--rounds", "1", "--start-ups", "1", "--seed", "7"];
    let compare = |more: &[&str], temporary: Option<&Path>| {
        let arguments = [&compare, &TINY[..6], &["--json", "study.json", "--csv", "study.csv"], more].concat();
        let mut command = folder.command(&arguments);
        command.envs(temporary.map(|path| ("TMPDIR", path)));
        let output = command.output().expect("the program starts");
        assert!(output.status.success(), "{}", text(&output.stderr));
        let file = fs::read(folder.path("study.json")).expect("the study is written");
        let json: Value = serde_json::from_slice(&file).expect("it is JSON");
        (json, text(&output.stdout), text(&output.stderr))
    };
    let firsts = |json: &Value| {
        let combinations = json["scenes"][0]["combinations"].as_array().expect("a list").clone();
        combinations.into_iter().map(|combination| combination["first"].clone()).collect::<Vec<_>>()
    };

    let (json, markdown, warnings) = compare(&[], None);
    assert!(!warnings.contains("start-up"), "{warnings}");
    assert!(markdown.contains("| start-up |"), "{markdown}");
    let shared = json["provenance"]["settings"].as_object().expect("settings are told");
    assert_eq!((&shared["seed"], &shared["max_bounces"], &shared["width_pixels"]), (&7.into(), &8.into(), &16.into()));
    assert!(!shared.contains_key("scheduler"), "it is varied");
    assert!(json["provenance"]["rustc_version"].as_str().is_some_and(|version| version.starts_with("rustc ")));
    for (first, (scheduler, kernels)) in firsts(&json).iter().zip([("wavefront", 6), ("bounce", 5), ("megakernel", 3)])
    {
        assert_eq!(first["settings"]["scheduler"], scheduler);
        let pipelines = first["pipelines"].as_array().expect("a list");
        assert_eq!(pipelines.len(), kernels, "{scheduler}");
        let compiled = first["compiled_kernels"].as_array().expect("a list");
        assert_eq!(compiled.len(), kernels, "{scheduler}");
        for kernel in compiled {
            assert!(kernel["spirv_instructions"].as_u64().is_some_and(|count| count > 10), "{kernel}");
            assert_executables(kernel);
            let row = format!(" | {} | ", kernel["kernel"].as_str().expect("a name").replace('_', "\\_"));
            assert!(markdown.lines().any(|line| line.contains(&row)), "{row} in {markdown}");
        }
        for key in ["cold_seconds", "cached_seconds"] {
            assert!(pipelines.iter().all(|pipeline| pipeline[key].as_f64().is_some_and(|s| s > 0.0)), "{pipelines:?}");
        }
        for key in ["cold_start_up_seconds", "cached_start_up_seconds"] {
            assert!(first[key].as_f64().is_some_and(|seconds| seconds > 0.0), "{key}");
        }
    }

    // Where no process can be started, the study goes on without.
    let (json, markdown, warnings) = compare(&[], Some(&folder.path("nowhere")));
    assert_eq!(warnings.matches("warning: start-up and compile times are not measured").count(), 1, "{warnings}");
    assert!(!markdown.contains("| start-up |"), "{markdown}");
    for first in firsts(&json) {
        assert_eq!((&first["cold_start_up_seconds"], &first["cached_start_up_seconds"]), (&Value::Null, &Value::Null));
        assert_eq!(first["pipelines"], Value::Array(Vec::new()));
    }
    let csv = fs::read_to_string(folder.path("study.csv")).expect("the study is written");
    assert!(csv.lines().skip(1).all(|line| line.contains(",,,,")), "{csv}");
}

#[test]
fn a_render_tells_what_it_did() {
    let folder = Folder::new();
    let output = folder.run(&[&["render", "-o", "box.png"], &TINY[..6]].concat());
    assert!(output.status.success() && output.stdout.is_empty());
    let summary = text(&output.stderr);
    for part in ["box.png: 16x16, 2 samples per pixel, ", "M samples/s", "M rays/s"] {
        assert!(summary.contains(part), "{summary}");
    }
    let quiet = folder.run(&[&["render", "-o", "box.png"], &TINY[..]].concat());
    assert!(quiet.stderr.is_empty(), "{}", text(&quiet.stderr));
}

#[test]
fn exposure_brightens_a_png() {
    let folder = Folder::new();
    let mean = |name, stops| {
        folder.succeed(&[&["render", "-o", name, "--exposure", stops], &TINY[..]].concat());
        let pixels = read_image(&folder.path(name)).expect("the image is readable").pixels;
        pixels.iter().map(|pixel| pixel.element_sum()).sum::<f32>()
    };
    assert!(mean("dark.png", "-3") < mean("bright.png", "1"));
}

#[test]
fn devices_are_listed_and_one_is_chosen() {
    let devices = Folder::new().succeed(&["devices"]);
    let name = device().description().name.clone();
    assert!(devices.starts_with("0 "), "{devices}");
    assert!(devices.contains(&format!("{name}  (chosen)")), "{devices}");
    for row in ["kind", "driver", "Vulkan", "subgroup", "workgroup", "storage buffer", "memory", "clock"] {
        assert!(devices.lines().any(|line| line.trim_start().starts_with(row)), "{row} in {devices}");
    }
}

#[test]
fn info_tells_of_the_built_in_scene_and_of_files() {
    let folder = Folder::new();
    let value = |info: &str, row: &str| -> String {
        let line = info.lines().find_map(|line| line.strip_prefix(row));
        line.unwrap_or_else(|| panic!("{row} in {info}")).trim().to_owned()
    };
    let built_in = folder.succeed(&["info"]);
    assert_eq!(value(&built_in, "scene"), "cornell-box");
    assert_eq!(value(&built_in, "hash"), Scene::cornell_box().hash);
    assert_eq!(value(&built_in, "triangles"), Scene::cornell_box().mesh.triangles.len().to_string());
    assert_eq!(value(&built_in, "light triangles"), "2");
    let path = common::project_file("scenes/cornell-box.toml");
    let from_file = folder.succeed(&["info", path.to_str().expect("the path is UTF-8")]);
    assert_eq!(value(&from_file, "hash"), value(&built_in, "hash"));
    for row in ["bounds", "needs", "BVH nodes", "BVH depth", "BVH SAH cost", "device memory"] {
        assert!(!value(&from_file, row).is_empty());
    }
}

#[test]
fn info_tells_every_setting_and_who_gave_it_its_value() {
    let folder = Folder::new();
    let path = common::project_file("scenes/smooth.toml");
    let of_scene = [path.to_str().expect("the path is UTF-8"), "--fetch", "texel", "--clamp", "2.5"];
    let told = folder.succeed(&[&["info"][..], &of_scene].concat());
    let row = |flag: &str| -> Vec<String> {
        let mut lines = told.lines().map(|line| line.split_whitespace().map(str::to_owned).collect::<Vec<_>>());
        lines.find(|words| words.len() == 3 && words[0] == flag).unwrap_or_else(|| panic!("{flag} in {told}"))
    };
    for setting in SETTINGS {
        assert_eq!(row(setting.flag).len(), 3);
    }
    assert_eq!(row("clamp")[1..], ["2.5", "flag"]);
    assert_eq!(row("fetch")[1..], ["texel", "flag"]);
    assert_eq!(row("seed")[1..], ["0", "default"]);
    assert_eq!(row("scheduler")[2], "device");
    assert_eq!(row("max-bounces")[2], "scene");
    let json: Value =
        serde_json::from_str(&folder.succeed(&[&["info", "--json"][..], &of_scene].concat())).expect("JSON");
    let keys: Vec<&str> = SETTINGS.iter().map(|setting| setting.key).collect();
    assert_eq!(json["settings"].as_object().expect("an object").keys().collect::<Vec<_>>(), keys);
    assert_eq!(json["settings"][Setting::of("clamp").expect("it is one").key], 2.5);
}

#[test]
fn an_image_differs_from_itself_by_nothing() {
    let folder = Folder::new();
    let report = folder.succeed(&["diff", "small.exr", "small.exr"]);
    let mse = report.lines().find(|line| line.starts_with("mse")).expect("mse is in the report");
    assert_eq!(mse.split_whitespace().nth(1).map(str::parse), Some(Ok(0.0)), "{report}");
    let json: Value =
        serde_json::from_str(&folder.succeed(&["diff", "small.exr", "small.exr", "--json"])).expect("JSON");
    assert_eq!(json["whole"]["max_abs_difference"], 0.0);
}

#[test]
fn dumped_rays_are_replayed() {
    let folder = Folder::new();
    let dump = |name: &str| {
        let kind = ["dump-rays", "--bounce", "1", "--rays", "shadow", "--seed", "7", "-o", name];
        let output = folder.run(&[&kind[..], &TINY[..6]].concat());
        assert!(output.status.success() && output.stdout.is_empty());
        let summary = text(&output.stderr);
        assert!(summary.starts_with(&format!("{name}: ")), "{summary}");
        assert!(summary.ends_with(" shadow rays of bounce 1; 256 of 256 pixels, 2 samples per pixel\n"), "{summary}");
        fs::read(folder.path(name)).expect("the rays are written")
    };
    assert_eq!(dump("a.rays"), dump("b.rays"));
    let beside = ["dump-rays", "--bounce", "1", "-o", "c.rays", "--triangles", "c.npy", "--distances", "d.npy"];
    folder.run(&[&beside[..], &TINY[..6]].concat());
    let bytes = |name: &str| fs::metadata(folder.path(name)).expect("the file is written").len();
    let records = fs::read(folder.path("c.rays")).expect("the rays are written");
    let head: usize = records.split(|byte| *byte == b'\n').take(2).map(|line| line.len() + 1).sum();
    assert_eq!(bytes("c.npy"), 128 + 36 * Scene::cornell_box().mesh.triangles.len() as u64);
    assert_eq!(bytes("d.npy"), 128 + (records.len() - head) as u64 / 32 * 4);

    let scene = common::project_file("scenes/cornell-box.toml");
    let scene = scene.to_str().expect("the path is UTF-8");
    // The built-in scene is that of the file.
    for (scene, rounds, enough) in [(&[scene][..], "3", false), (&[], "6", true)] {
        let flags = ["a.rays", "--rounds", rounds, "--repeat", "2", "--in-flight", "100", "--json", "a.json"];
        let lines = folder.succeed(&[&["replay"], scene, &flags[..]].concat());
        let json = fs::read_to_string(folder.path("a.json")).expect("the report is written");
        let report: Value = serde_json::from_str(&json).expect("the report is JSON");
        let dumped = report["dump"]["rays"].as_u64().expect("rays are counted");
        for row in ["scene", "device", "blocked", "warm-up", "rounds", "range"] {
            assert!(lines.lines().any(|line| line.starts_with(row)), "{row} in {lines}");
        }
        for part in [
            format!(
                "rays      {dumped} shadow rays of bounce 1, 2 times over, in {} launches\n",
                (2 * dumped).div_ceil(100)
            ),
            "kernel    connect, ".to_owned(),
            format!("checked   {dumped} rays, equal to the CPU's to the last bit\n"),
            if enough { " M rays/s, 95 % [" } else { " M rays/s, too few rounds\n" }.to_owned(),
        ] {
            assert!(lines.contains(&part), "{part} in {lines}");
        }
        for (key, value) in [
            ("rays", Value::from(2 * dumped)),
            ("repeat", 2.into()),
            ("kernel", "connect".into()),
            ("checked_rays", dumped.into()),
            ("device", device().description().name.clone().into()),
        ] {
            assert_eq!(report[key], value, "{key}");
        }
        for (key, value) in [("class", Value::from("shadow")), ("bounce", 1.into()), ("seed", 7.into())] {
            assert_eq!(report["dump"][key], value, "{key}");
        }
        let warm_up = &report["warm_up"];
        assert!(warm_up["seconds"].as_f64().is_some_and(|seconds| seconds > 0.0) && warm_up.get("steady").is_some());
        assert!(report["idle_seconds"].as_f64().is_some_and(|idle| idle >= 0.0), "{json}");
        assert_clocks(&report["clocks_before"]);
        assert_clocks(&report["clocks_after"]);
        assert!(report["hit_share"].as_f64().is_some_and(|share| share > 0.0 && share < 1.0), "{json}");
        assert_eq!(report["seconds"].as_array().map(Vec::len), rounds.parse().ok());
        let speed = |key: &str| report["rays_per_second"][key].as_f64().expect("speeds are numbers");
        let keys: &[&str] = if enough { &["min", "low", "median", "high", "max"] } else { &["min", "median", "max"] };
        let order: Vec<f64> = keys.iter().map(|key| speed(key)).collect();
        assert!(order[0] > 0.0 && order.is_sorted(), "{json}");
        assert_eq!(report["rays_per_second"]["verdict"] == "too few rounds", !enough, "{json}");
        assert_eq!(report["rays_per_second"]["low"].is_null(), !enough, "{json}");
    }
}

#[test]
fn a_gallery_can_be_inspected() {
    let folder = Folder::new();
    folder.succeed(&["gallery", "halls", "--triangles", "5000"]);
    assert!(folder.succeed(&["info", "halls/gallery.toml"]).starts_with("scene            gallery\n"));
}

#[test]
fn a_reader_that_leaves_is_no_error() {
    let folder = Folder::new();
    for arguments in [&["info"][..], &["devices"], &["diff", "small.exr", "small.exr"], &["--help"]] {
        let mut child =
            folder.command(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        // The program takes longer to load than this takes to close the pipe.
        drop(child.stdout.take());
        let output = child.wait_with_output().expect("it ends");
        assert!(output.status.success() && output.stderr.is_empty(), "{arguments:?}: {}", text(&output.stderr));
    }
}

/// Waits until the child catches SIGINT, as its signal mask in /proc says.
#[cfg(target_os = "linux")]
pub fn await_handler(child: &mut Child) {
    const CATCHES_INTERRUPT: u64 = 1 << 1;
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(60) {
        assert!(child.try_wait().expect("the child can be asked").is_none(), "the render ends too early");
        let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
        if mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|m| m & CATCHES_INTERRUPT != 0) {
            return;
        }
        sleep(Duration::from_millis(20));
    }
    panic!("the render never listens for Ctrl-C");
}

#[cfg(target_os = "linux")]
#[test]
fn ctrl_c_writes_the_samples_that_are_done() {
    let folder = Folder::new();
    // Years of work, in batches of a fraction of a second.
    let arguments = ["render", "-o", "box.exr", "--stats", "box.json", "--width", "32", "--height", "32"];
    let mut child = folder
        .command(&[&arguments[..], &["--samples", "16777216", "--in-flight", "4096"]].concat())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    await_handler(&mut child);
    sleep(Duration::from_millis(300));
    let killed = Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status().expect("kill runs");
    assert!(killed.success());
    let output = child.wait_with_output().expect("the render ends");
    let summary = text(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{summary}");

    let metadata = read_metadata(&folder.path("box.exr")).expect("the image is written");
    let value =
        |key: &str| metadata.iter().find(|(k, _)| k == key).map(|(_, value)| value.clone()).expect("it is told");
    let samples = value("raywave.samples_per_pixel");
    assert!((1..16_777_216).contains(&samples.parse().expect("samples are a number")));
    assert!(summary.contains(&format!("{samples} samples per pixel, of 16777216 asked for")), "{summary}");
    let json = fs::read_to_string(folder.path("box.json")).expect("the statistics are written");
    let statistics: Value = serde_json::from_str(&json).expect("the statistics are JSON");
    // A busy machine may have no time to come to equal samples.
    let by_rows = value("raywave.samples_by_rows");
    let bands = by_rows.split(' ').map(|band| {
        let (rows, samples) = band.split_once('x').expect("rows and samples");
        [rows, samples].map(|number| number.parse::<u64>().expect("numbers"))
    });
    let bands: Vec<[u64; 2]> = bands.collect();
    let done: u64 = bands.iter().map(|[rows, samples]| 32 * rows * samples).sum();
    assert_eq!(statistics["samples"].as_u64(), Some(done), "{by_rows}");
    // Nor to any sample of the lowest rows.
    let finished = 32 * bands.iter().map(|[rows, _]| *rows as usize).sum::<usize>();
    let image = read_image(&folder.path("box.exr")).expect("the image is readable");
    assert!(image.pixels[..finished].iter().all(|pixel| pixel.is_finite()), "{by_rows}");
    assert!(image.pixels[finished..].iter().all(|pixel| pixel.is_nan()), "{by_rows}");
}

#[test]
fn a_device_that_is_lost_once_costs_no_sample() {
    let folder = Folder::new();
    let render = |name: &str, more: &[&str]| {
        let arguments = ["render", "-o", name, "--width", "32", "--height", "32", "--samples", "64"];
        folder.run(&[&arguments[..], more].concat())
    };
    let undisturbed = render("a.exr", &[]);
    assert!(undisturbed.status.success(), "{}", text(&undisturbed.stderr));
    for (name, more) in [
        ("b.exr", &["--lose-device", "4"][..]),
        ("c.exr", &["--lose-device", "4", "--keep-every", "0.000001s"]),
        ("d.exr", &["--lose-device", "0"]),
    ] {
        let lost = render(name, more);
        let said = text(&lost.stderr);
        assert!(lost.status.success(), "{said}");
        let warning = said.lines().next().expect("the loss is told");
        assert!(warning.starts_with("warning: the device was lost while it ran "), "{said}");
        assert!(warning.contains("it is opened anew, and the render goes on from "), "{said}");
        assert!(fs::read(folder.path(name)).ok() == fs::read(folder.path("a.exr")).ok(), "{more:?}: another image");
    }

    // What was finished is written where it is lost again.
    let lost = render("e.exr", &["--lose-device", "4,4", "--keep-every", "0.000001s"]);
    let said = text(&lost.stderr);
    assert_eq!(lost.status.code(), Some(1), "{said}");
    assert!(said.lines().last().is_some_and(|line| line.starts_with("error: the device was lost while it ran ")));
    let image = read_image(&folder.path("e.exr")).expect("the image is written");
    assert!(image.pixels[0].is_finite());
    let metadata = read_metadata(&folder.path("e.exr")).expect("the image is readable");
    let value =
        |key: &str| metadata.iter().find(|(k, _)| k == key).map(|(_, value)| value.clone()).expect("it is told");
    let rows: u32 = value("raywave.finished_rows_pixels").parse().expect("rows are a number");
    let by_samples = value("raywave.samples_by_rows");
    let bands = by_samples.split(' ').map(|band| band.split_once('x').expect("rows and samples"));
    assert_eq!(bands.map(|(rows, _)| rows.parse::<u32>().expect("a number")).sum::<u32>(), rows, "{by_samples}");

    // Nothing was.
    let lost = render("f.exr", &["--lose-device", "0,0"]);
    assert_eq!((lost.status.code(), folder.path("f.exr").exists()), (Some(1), false), "{}", text(&lost.stderr));
}

#[test]
fn a_scene_over_the_limits_of_the_device_is_refused() {
    let device = device();
    let scene = Scene::cornell_box();
    let mut prepared = PreparedScene::new(&scene).expect("the box fits");
    // More texels than either kind of buffer may have. Untouched zeros cost no memory.
    let limits = device.description();
    let texels = 1 + limits.max_texel_buffer_elements.max(limits.max_storage_buffer_bytes / 8);
    prepared.textures = vec![[0; 2]; texels as usize];
    prepared.features.textures = true;
    let error = Session::new(&device, &prepared, &scene.settings).err().expect("the scene is too large");
    let RenderError::Gpu(GpuError::BufferTooLarge { buffer, needed, allowed, .. }) = error else { panic!("{error}") };
    assert_eq!((buffer, needed), ("textures", 8 * texels));
    assert!(allowed < needed);
}

#[test]
fn a_tradeoff_keeps_its_reference() {
    let folder = Folder::new();
    folder.scene("lamp", CAMERA, "v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n");
    let home = folder.0.path().as_os_str();
    let run = |more: &[&str]| {
        let size = ["--width", "8", "--height", "8", "--samples", "1", "--max-bounces", "1", "--budget", "1s"];
        let arguments = [&["tradeoff", "lamp.toml", "--json", "a.json"][..], &size, more].concat();
        let output = folder
            .command(&arguments)
            .env_remove("RAYWAVE_CACHE")
            .env("XDG_CACHE_HOME", home)
            .output()
            .expect("the program starts");
        (output.status.success(), text(&output.stdout), text(&output.stderr))
    };
    let (well, markdown, plan) = run(&["--target-error", "0.1", "--quiet"]);
    assert!(well && markdown.contains("### The front") && plan.is_empty(), "{markdown} {plan}");
    let json: Value =
        serde_json::from_slice(&fs::read(folder.path("a.json")).expect("it is written")).expect("it is JSON");
    assert!(json["complete"] == true && json["points"].as_array().is_some_and(|points| points.len() > 10));
    let failed: Vec<_> = json["points"].as_array().expect("points").iter().filter(|p| !p["failed"].is_null()).collect();
    assert!(failed.is_empty(), "{failed:?}");
    let kept: Vec<_> = fs::read_dir(folder.path("raywave"))
        .expect("there is a folder of caches")
        .map(|entry| entry.expect("its entries are readable").file_name().to_string_lossy().into_owned())
        .filter(|name| name.ends_with(".reference.exr"))
        .collect();
    assert_eq!(kept.len(), 1, "{kept:?}");
    let (well, markdown, plan) = run(&["--rounds", "4"]);
    assert!(well && markdown.contains(&kept[0]) && !plan.contains("reference:"), "{markdown} {plan}");
    assert!(plan.contains("one knob at a time: ") && plan.contains("path-state f16, 1 samples"), "{plan}");

    fs::write(folder.path("image.exr"), {
        let image = Image::new(2, 2, vec![glam::Vec3::ONE; 4]);
        image_bytes(Path::new("image.exr"), &image, &WriteOptions::default()).expect("an image")
    })
    .expect("it is written");
    let (well, _, error) = run(&["--reference", "image.exr"]);
    assert!(!well && error.contains("2 x 2 pixels and the render 8 x 8; render both at one size"), "{error}");
}
