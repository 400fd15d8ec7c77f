//! `raywave tune` as its users run it: what it measures, what it keeps, and who listens to that.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use crate::common::project::program;
use crate::common::{device, project_file};
use raywave::bvh::BvhKind;
use raywave::image::read_image;
use raywave::scene::Scene;
use serde_json::Value;
use tempfile::TempDir;

/// A home without caches, in which the program runs.
struct Home(TempDir);

impl Home {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(program());
        command.current_dir(self.0.path()).args(arguments).env("XDG_CACHE_HOME", self.0.path());
        command.env_remove("RAYWAVE_CACHE");
        command
    }

    fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().expect("the program starts")
    }

    fn succeed(&self, arguments: &[&str]) -> (String, String) {
        let output = self.run(arguments);
        let [out, err] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).expect("UTF-8"));
        assert!(output.status.success(), "{arguments:?}: {err}");
        (out, err)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Tunings in the cache.
    fn tunings(&self) -> Vec<PathBuf> {
        let Ok(entries) = fs::read_dir(self.path("raywave")) else { return Vec::new() };
        let paths = entries.map(|entry| entry.expect("the folder is readable").path());
        paths.filter(|path| path.to_string_lossy().ends_with(".tuning.toml")).collect()
    }

    /// Tunes the built-in scene and changes the choice to one that is no device's default. It is tuned once: each
    /// way to trace has kernels of its own, which some drivers take long to build.
    fn tune_oddly(&self) -> PathBuf {
        static TUNED: OnceLock<(OsString, String)> = OnceLock::new();
        let (name, text) = TUNED.get_or_init(|| {
            let home = Self::new();
            home.succeed(&[&["tune", "--rounds", "1", "--quiet"], &TINY[..]].concat());
            let file = home.tunings().pop().expect("the choice is kept");
            let text = fs::read_to_string(&file).expect("the choice is text");
            (file.file_name().expect("a file has a name").to_owned(), text)
        });
        fs::create_dir_all(self.path("raywave")).expect("the folder of caches can be made");
        let file = self.path("raywave").join(name);
        let odd = text.lines().map(|line| match line.split_once(" = ") {
            Some(("bvh", _)) => "bvh = \"bvh4\"\n".to_owned(),
            Some(("fetch", _)) => "fetch = \"storage\"\n".to_owned(),
            Some(("workgroup", _)) => "workgroup = 64\n".to_owned(),
            Some(("packets", _)) => "packets = true\n".to_owned(),
            _ => format!("{line}\n"),
        });
        fs::write(&file, odd.collect::<String>()).expect("the choice can be changed");
        file
    }

    /// Renders the built-in scene, or another: settings in the statistics, what was said, the image.
    fn render(&self, more: &[&str]) -> (Value, String, PathBuf) {
        let (_, said) = self.succeed(&[&["render", "-o", "a.exr", "--stats", "a.json"], &TINY[..], more].concat());
        (self.settings(), said, self.path("a.exr"))
    }

    fn settings(&self) -> Value {
        let json = fs::read_to_string(self.path("a.json")).expect("the statistics are written");
        serde_json::from_str::<Value>(&json).expect("they are JSON")["settings"].clone()
    }
}

const TINY: [&str; 6] = ["--width", "16", "--height", "16", "--samples", "2"];

fn pixels(path: &Path) -> Vec<[u32; 3]> {
    let image = read_image(path).expect("the image is readable");
    image.pixels.iter().map(|pixel| pixel.to_array().map(f32::to_bits)).collect()
}

/// BVH, fetch, workgroup, and whether they are tuned.
fn choice(settings: &Value) -> (&str, &str, u64, bool) {
    (
        settings["bvh"].as_str().expect("a name"),
        settings["scene_fetch"].as_str().expect("a name"),
        settings["workgroup_size_invocations"].as_u64().expect("a number"),
        settings["tuned"].as_bool().expect("a flag"),
    )
}

#[test]
fn every_way_is_measured_and_the_choice_is_kept() {
    let home = Home::new();
    let (out, _) = home.succeed(&[&["tune", "--rounds", "2", "--json"], &TINY[..]].concat());
    let report: Value = serde_json::from_str(&out).expect("the report is JSON");
    let description = device().description().clone();
    let workgroups = [64, 256, 1024].into_iter().filter(|size| *size <= description.max_workgroup_size).count();
    let variants = report["variants"].as_array().expect("a list");
    let shapes = BvhKind::all_of(Scene::cornell_box().mesh.triangles.len());
    // Rays of wide trees may be in packets.
    let walks: usize = shapes.map(|kind| if kind.width() > 2 { 2 } else { 1 }).sum();
    assert_eq!(variants.len(), walks * 2 * workgroups * 3, "walks, fetches, workgroups, classes");
    let distinct: std::collections::BTreeSet<String> = variants
        .iter()
        .map(|v| {
            let way = ["class", "bvh", "scene_fetch", "workgroup_size_invocations", "packets"];
            way.map(|key| v[key].to_string()).join(" ")
        })
        .collect();
    assert_eq!(distinct.len(), variants.len());
    for variant in variants {
        let speed = &variant["rays_per_second"];
        assert!(speed["value"].as_f64().is_some_and(|speed| speed > 0.0), "{speed}");
        assert!(speed["low"].is_null() && speed["verdict"] == "too few rounds", "{speed}");
        assert_eq!(variant["seconds_per_ray"].as_array().map(Vec::len), Some(2));
    }
    let shares =
        report["classes"].as_array().expect("a list").iter().map(|c| c["share_of_rays"].as_f64().expect("a share"));
    assert!((shares.sum::<f64>() - 1.0).abs() < 1e-9);
    assert!(
        report["against_default"].as_array().expect("a list").iter().any(|plan| plan["bvh"] == report["chosen"]["bvh"])
    );

    assert_eq!(home.tunings(), [PathBuf::from(report["file"].as_str().expect("the file is told"))]);
    let (settings, said, _) = home.render(&["--scheduler", "wavefront"]);
    let chosen = &report["chosen"];
    let words = ["bvh", "scene_fetch"].map(|key| chosen[key].as_str().expect("a name"));
    let workgroup = chosen["workgroup_size_invocations"].as_u64().expect("a number");
    assert_eq!(choice(&settings), (words[0], words[1], workgroup, true));
    let packets = match report["packets"].as_str().expect("classes of rays") {
        "none" => String::new(),
        classes => format!(", packets of {classes} rays"),
    };
    let told = format!("; tuned: {}, {} fetch, workgroup {workgroup}{packets}\n", words[0], words[1]);
    assert!(said.contains(&told), "{said} has not {told}");
}

#[test]
fn renders_take_the_choice_and_give_the_same_image() {
    let home = Home::new();
    home.tune_oddly();
    let (settings, _, image) = home.render(&["--scheduler", "wavefront"]);
    assert_eq!(choice(&settings), ("bvh4", "storage", 64, true));
    assert_eq!(settings["packets"], "camera+bounce+shadow");
    let tuned = pixels(&image);
    assert!(tuned.iter().any(|pixel| *pixel != [0; 3]));
    let (settings, said, image) = home.render(&["--tuned", "off"]);
    assert!(!choice(&settings).3 && choice(&settings).0 != "bvh4" && !said.contains("tuned"));
    assert_eq!(pixels(&image), tuned, "a tuning changes the image");

    // What is given stands; the workgroups of other schedulers were not measured.
    let (settings, ..) = home.render(&["--bvh", "bvh2", "--workgroup", "32"]);
    assert_eq!(choice(&settings), ("bvh2", "storage", 32, true));
    let (settings, ..) = home.render(&["--bvh", "bvh2", "--workgroup", "32", "--fetch", "texel", "--packets", "none"]);
    assert_eq!(choice(&settings), ("bvh2", "texel", 32, false));
    for scheduler in ["bounce", "megakernel"] {
        let (settings, ..) = home.render(&["--scheduler", scheduler]);
        assert_eq!(choice(&settings).0, "bvh4");
        assert_ne!(choice(&settings).2, 64);
    }

    // Another size of scene, and no caches at all.
    let furnace = project_file("scenes/smooth.toml");
    let (settings, ..) = home.render(&[furnace.to_str().expect("the path is UTF-8")]);
    assert!(!choice(&settings).3);
    let off = home.command(&[&["render", "-o", "a.exr", "--stats", "a.json"], &TINY[..]].concat());
    let mut off = off;
    assert!(off.env("RAYWAVE_CACHE", "off").status().expect("it starts").success());
    assert!(!choice(&home.settings()).3);
}

#[test]
fn comparisons_take_the_choice_where_they_vary_nothing_else() {
    let home = Home::new();
    home.tune_oddly();
    let flags = ["compare", "--vary", "bvh=bvh2,bvh4", "--rounds", "1", "--no-counters", "--start-ups", "0", "-q"];
    home.succeed(&[&flags[..], &TINY[..], &["--json", "a.json"]].concat());
    let json = fs::read_to_string(home.path("a.json")).expect("the study is written");
    let study: Value = serde_json::from_str(&json).expect("it is JSON");
    let shared = study["provenance"]["settings"].clone();
    assert_eq!((&shared["scene_fetch"], &shared["tuned"]), (&"storage".into(), &true.into()), "{shared}");
}

#[test]
fn damaged_choices_are_ignored_with_a_warning() {
    let home = Home::new();
    let file = home.tune_oddly();
    let whole = fs::read_to_string(&file).expect("the choice is text");
    for damaged in [whole[..whole.len() / 2].to_owned(), String::new(), whole.replace("storage", "magic")] {
        fs::write(&file, &damaged).expect("the choice can be damaged");
        let (settings, said, _) = home.render(&[]);
        assert!(!choice(&settings).3);
        let warnings: Vec<_> = said.lines().filter(|line| line.starts_with("warning: ")).collect();
        assert_eq!(warnings.len(), 1, "{said}");
        assert!(warnings[0].ends_with("; it is ignored, and `raywave tune` writes a new one"), "{said}");
        let (_, said, _) = home.render(&["-q"]);
        assert!(said.is_empty(), "{said}");
    }
    // A tuning mends it.
    home.succeed(&[&["tune", "--rounds", "1"], &TINY[..]].concat());
    assert!(choice(&home.render(&[]).0).3);
}

#[test]
fn what_cannot_be_tuned_is_one_line() {
    let home = Home::new();
    for (arguments, reason) in [
        (&["tune", "--bvh", "bvh2"][..], "error: --bvh is what tune chooses; leave it out"),
        (&["tune", "--fetch", "texel"], "error: --fetch is what tune chooses"),
        (&["tune", "--workgroup", "8"], "error: --workgroup is what tune chooses"),
        (&["tune", "--rounds", "0"], "error: invalid value '0' for '--rounds <N>'"),
        (&["tune", "missing.toml"], "error: missing.toml"),
        (&["tune", "--device", "no such device"], "error: no device is called"),
        (&["render", "-o", "a.png", "--tuned", "perhaps"], "error: invalid value 'perhaps' for '--tuned"),
        (&["render", "-o", "a.png", "--specialize", "2"], "error: invalid value '2' for '--specialize"),
    ] {
        let output = home.run(arguments);
        let said = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.starts_with(reason) && said.lines().count() == 1, "{arguments:?}: {said}");
    }
    assert!(home.tunings().is_empty());
}
