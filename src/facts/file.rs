//! Facts as a file in the cache folder, one for each device, version of its driver and version of raywave.
//!
//! As with every cache, a problem is never an error: facts that cannot be read or trusted are measured again.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Facts;
use crate::gpu::DeviceDescription;
use crate::whole_file;

/// The contents of the file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Record {
    raywave_version: String,
    device: String,
    driver: String,
    facts: Facts,
}

/// The file of a device's facts.
pub fn path(folder: &Path, device: &DeviceDescription) -> PathBuf {
    folder.join(format!("{}-{}.facts.toml", device.cache_name(), crate::VERSION))
}

/// The facts in a file, if it is complete and of this device, driver and version.
pub fn read(file: &Path, device: &DeviceDescription) -> Option<Facts> {
    parse(&fs::read_to_string(file).ok()?, &device.name, &device.driver)
}

fn parse(text: &str, device: &str, driver: &str) -> Option<Facts> {
    let record: Record = toml::from_str(text).ok()?;
    let is_own = [&*record.raywave_version, &record.device, &record.driver] == [crate::VERSION, device, driver];
    let Facts { texel_ns, storage_ns, launch_seconds, .. } = record.facts;
    let is_time = |time: f64| time > 0.0 && time.is_finite();
    (is_own && [texel_ns, storage_ns, launch_seconds].into_iter().all(is_time)).then_some(record.facts)
}

/// Writes a file, and creates its folder if it is missing. If that fails, nothing is kept.
pub fn write(file: &Path, device: &DeviceDescription, facts: &Facts) {
    let Some(text) = text(facts, &device.name, &device.driver) else { return };
    let folder = file.parent().unwrap_or(Path::new("."));
    let _ = fs::create_dir_all(folder).and_then(|()| whole_file::write_text(file, &text));
}

fn text(facts: &Facts, device: &str, driver: &str) -> Option<String> {
    let record = Record {
        raywave_version: crate::VERSION.to_owned(),
        device: device.to_owned(),
        driver: driver.to_owned(),
        facts: facts.clone(),
    };
    let toml = toml::to_string(&record).ok()?;
    Some(format!("# What raywave measured of a device at its first use. It may be deleted.\n{toml}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const FACTS: Facts = Facts {
        texel_ns: 0.375,
        storage_ns: 0.5,
        launch_seconds: 3e-5,
        loop_turns: Some(65_535),
        division_exact: true,
        reciprocal_exact: true,
        root_exact: false,
        fma_fused: false,
        flushes_operands: true,
        flushes_results: false,
    };

    fn kept(facts: &Facts) -> String {
        text(facts, "a \"card\"", "its driver 1").expect("facts are TOML")
    }

    fn read_back(text: &str) -> Option<Facts> {
        parse(text, "a \"card\"", "its driver 1")
    }

    #[test]
    fn a_file_gives_back_what_was_measured() {
        for facts in [FACTS, Facts { loop_turns: None, ..FACTS }] {
            assert_eq!(read_back(&kept(&facts)), Some(facts));
        }
    }

    #[test]
    fn other_devices_drivers_and_versions_do_not_listen() {
        let text = kept(&FACTS);
        assert_eq!(parse(&text, "another", "its driver 1"), None);
        assert_eq!(parse(&text, "a \"card\"", "its driver 2"), None);
        assert_eq!(read_back(&text.replace(crate::VERSION, "0.0.0")), None);
    }

    #[test]
    fn damaged_files_are_measured_anew() {
        let text = kept(&FACTS);
        for damaged in [
            String::new(),
            text[..text.len() - 5].to_owned(),
            text.replace("texel_ns = 0.375", "texel_ns = 0.0"),
            text.replace("texel_ns = 0.375", "texel_ns = nan"),
            text.replace("texel_ns", "textile_ns"),
            text.replace("root_exact = false", "root_exact = 0"),
        ] {
            assert_ne!(damaged, text);
            assert_eq!(read_back(&damaged), None, "{damaged}");
        }
    }
}
