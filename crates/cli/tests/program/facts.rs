//! What is measured of a device at its first use: told, kept, and what defaults follow. That its loops have the limit
//! that was found, and no other, is held by `schedulers.rs`.

use std::fs;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;

use crate::common::project::program;
use crate::common::{assert_silent, device, device_with_cache};
use raywave::facts;
use raywave::gpu::DeviceKind;
use serde_json::Value;
use tempfile::TempDir;

/// A home in which the program runs.
struct Home(TempDir);

impl Home {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn run(&self, arguments: &[&str], caches: bool) -> String {
        let mut command = Command::new(program());
        command.current_dir(self.0.path()).args(arguments).env("XDG_CACHE_HOME", self.0.path());
        match caches {
            true => command.env_remove("RAYWAVE_CACHE"),
            false => command.env("RAYWAVE_CACHE", "off"),
        };
        let output = command.output().expect("the program starts");
        let said = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(output.status.success() && said.is_empty(), "{arguments:?}: {said}");
        String::from_utf8(output.stdout).expect("UTF-8")
    }

    /// Files with facts.
    fn files(&self) -> Vec<PathBuf> {
        let Ok(entries) = fs::read_dir(self.0.path().join("raywave")) else { return Vec::new() };
        let paths = entries.map(|entry| entry.expect("the folder is readable").path());
        paths.filter(|path| path.to_string_lossy().ends_with(".facts.toml")).collect()
    }

    /// What `info` tells of the device.
    fn told(&self, caches: bool) -> Value {
        serde_json::from_str::<Value>(&self.run(&["info", "--json"], caches)).expect("JSON")["device_facts"].clone()
    }

    /// How a render fetches its scene.
    fn fetch(&self) -> String {
        let size = ["--width", "8", "--height", "8", "--samples", "1", "-q"];
        self.run(&[&["render", "-o", "a.hdr", "--stats", "a.json"], &size[..]].concat(), true);
        let json = fs::read_to_string(self.0.path().join("a.json")).expect("the statistics are written");
        let statistics: Value = serde_json::from_str(&json).expect("they are JSON");
        assert_eq!(statistics["device_facts"], self.told(true));
        statistics["settings"]["scene_fetch"].as_str().expect("a name").to_owned()
    }
}

/// A file of facts with another value of a key.
fn with(text: &str, key: &str, value: &str) -> String {
    let line = |line: &str| match line.split_once(" = ") {
        Some((name, _)) if name == key => format!("{key} = {value}\n"),
        _ => format!("{line}\n"),
    };
    text.lines().map(line).collect()
}

#[test]
fn a_process_measures_once() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [first, second] = [0, 1].map(|_| {
        let device = device_with_cache(Some(folder.path()));
        let facts = facts::of(&device).expect("the device can be measured");
        assert_silent(&device);
        facts
    });
    assert!(Arc::ptr_eq(&first, &second));
    for time in [first.texel_ns, first.storage_ns, first.launch_seconds] {
        assert!(time > 0.0 && time.is_finite(), "{first:?}");
    }
}

#[test]
fn facts_are_kept_and_believed() {
    let home = Home::new();
    let facts = home.told(true);
    let files = home.files();
    assert_eq!(files.len(), 1, "{files:?}");
    let text = fs::read_to_string(&files[0]).expect("facts are text");
    assert!(text.contains(&format!("device = {:?}", device().description().name)), "{text}");
    assert_eq!(home.told(true), facts, "they are measured again");

    // A device that fetches much faster one way than the other, as the file has it: software takes that way.
    let software = device().description().kind == DeviceKind::Cpu;
    for (texel, storage, fetch) in [("0.001", "1000.0", "texel"), ("1000.0", "0.001", "storage")] {
        let altered = with(&with(&text, "texel_ns", texel), "storage_ns", storage);
        fs::write(&files[0], altered).expect("a cache is writable");
        assert_eq!(home.told(true)["texel_ns"].as_f64(), texel.parse().ok());
        assert_eq!(home.fetch(), if software { fetch } else { "storage" });
    }
    assert_ne!(home.told(false)["texel_ns"].as_f64(), Some(1000.0), "caches are off");

    // What is damaged is measured anew, and kept again.
    fs::write(&files[0], &text[..text.len() / 2]).expect("a cache is writable");
    assert_eq!(home.told(true).as_object().map(|facts| facts.len()), facts.as_object().map(|facts| facts.len()));
    assert_eq!(home.files(), files);
    let mended = fs::read_to_string(&files[0]).expect("facts are text");
    assert_eq!(mended.lines().count(), text.lines().count());
}

#[test]
fn without_caches_nothing_is_kept() {
    let home = Home::new();
    assert!(home.told(false).is_object());
    assert!(home.files().is_empty());
}
