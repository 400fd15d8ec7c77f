//! What `raywave tune` has found fastest, kept from one run to the next.
//!
//! A tuning is a file in the folder of caches, for one device, one version of its driver, one
//! version of raywave and one size of scene: from 4^k triangles up to 4^(k + 1). It is of a size and
//! not of one scene, so that a scene whose camera or material is edited keeps it. As every cache, it
//! is never worth an error: what cannot be read or trusted is ignored, with a warning.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::{Deserialize, Serialize};

use super::host::cache_folder;
use raywave::bvh::BvhKind;
use raywave::gpu::DeviceDescription;
use raywave::rays::RayClass;
use raywave::render::{Choices, Traversal, Tuned};
use raywave::scene::Scene;
use raywave::settings::{Fetch, Named, Packets};
use raywave::whole_file;

/// How to trace rays, by class; of no class where nothing is tuned.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tuning {
    /// The choice of each class that was measured. What a render's kernels share is the same in all.
    pub classes: Vec<TunedClass>,
}

/// The choice of a class of rays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TunedClass {
    /// Which rays.
    pub class: RayClass,
    /// How they are traced fastest.
    pub traversal: Traversal,
    /// Median speed.
    pub rays_per_second: f64,
    /// Share of all rays, in (0, 1].
    pub share: f64,
}

/// What a tuning is for.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    /// Of the device and its driver, fit for a file's name.
    cache_name: String,
    device: String,
    driver: String,
    max_workgroup: u32,
    /// Triangles, from the first on, to before the second.
    triangles: [u64; 2],
}

impl Key {
    /// The tuning of such a device for scenes of about this many triangles.
    pub fn new(device: &DeviceDescription, triangles: u64) -> Self {
        let least = 4_u64.pow(triangles.max(1).ilog(4));
        Self {
            cache_name: device.cache_name(),
            device: device.name.clone(),
            driver: device.driver.clone(),
            max_workgroup: device.max_workgroup_size,
            triangles: [least, 4 * least],
        }
    }

    /// Its file, where there is a folder for caches.
    pub fn file(&self) -> Option<PathBuf> {
        let name = format!("{}-{}-{}.tuning.toml", self.cache_name, raywave::VERSION, self.triangles[0]);
        Some(cache_folder()?.join(name))
    }
}

/// A tuning as its file has it.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Record {
    raywave_version: String,
    device: String,
    driver: String,
    /// At least, and below.
    triangles: [u64; 2],
    /// The scene that it was measured on.
    scene: String,
    camera: Option<Choice>,
    bounce: Option<Choice>,
    shadow: Option<Choice>,
}

/// The choice of a class as the file has it.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Choice {
    bvh: String,
    fetch: String,
    workgroup: u32,
    packets: bool,
    rays_per_second: f64,
    share_of_rays: f64,
}

impl Tuning {
    /// The tuning for a scene on a device; empty where there is none. A file that is no good is worth a warning.
    pub fn of_scene(device: &DeviceDescription, scene: &Scene, warn: &mut dyn FnMut(&str)) -> Self {
        let key = Key::new(device, scene.triangle_count());
        let Some(file) = key.file() else { return Self::default() };
        Self::read(&file, &key).unwrap_or_else(|reason| {
            let file = file.display();
            warn(&format!("{file}: {reason}; it is ignored, and `raywave tune` writes a new one"));
            Self::default()
        })
    }

    /// What stands in for what settings leave open; `None` where nothing is tuned.
    pub fn chosen(&self) -> Option<Tuned> {
        let Traversal { bvh, fetch, workgroup_size, .. } = self.shared()?;
        Some(Tuned { bvh, fetch, workgroup_size, packets: self.packets() })
    }

    /// The classes of rays that are traced by packets.
    pub fn packets(&self) -> Packets {
        self.classes.iter().fold(Packets::default(), |all, tuned| all.with(tuned.class, tuned.traversal.packets))
    }

    /// What a render's kernels share.
    fn shared(&self) -> Option<Traversal> {
        self.classes.first().map(|tuned| tuned.traversal.shared())
    }

    /// Writes the file. Its folder is made where it is missing.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, file: &Path, key: &Key, scene: &str) -> anyhow::Result<()> {
        let choice = |class| {
            let tuned = self.classes.iter().find(|tuned| tuned.class == class)?;
            let Traversal { bvh, fetch, workgroup_size, packets } = tuned.traversal;
            Some(Choice {
                bvh: bvh.name().to_owned(),
                fetch: fetch.name().to_owned(),
                workgroup: workgroup_size,
                packets,
                rays_per_second: tuned.rays_per_second.round(),
                share_of_rays: tuned.share,
            })
        };
        let record = Record {
            raywave_version: raywave::VERSION.to_owned(),
            device: key.device.clone(),
            driver: key.driver.clone(),
            triangles: key.triangles,
            scene: scene.to_owned(),
            camera: choice(RayClass::Camera),
            bounce: choice(RayClass::Bounce),
            shadow: choice(RayClass::Shadow),
        };
        if let Some(folder) = file.parent() {
            fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        }
        let text = toml::to_string(&record).context("a tuning becomes TOML")?;
        let text = format!("# What `raywave tune` found fastest. It may be deleted.\n{text}");
        whole_file::write_text(file, &text).with_context(|| format!("{}: cannot be written", file.display()))
    }

    /// Reads the file; nothing where there is none. Says what is wrong with it.
    fn read(file: &Path, key: &Key) -> Result<Self, String> {
        match fs::read_to_string(file) {
            Ok(text) => Self::parse(&text, key),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Self::default()),
            Err(error) => Err(error.to_string()),
        }
    }

    fn parse(text: &str, key: &Key) -> Result<Self, String> {
        let record: Record =
            toml::from_str(text).map_err(|error| format!("not a tuning: {}", error.message().replace('\n', " ")))?;
        let own = [raywave::VERSION, &key.device, &key.driver];
        if [&record.raywave_version, &record.device, &record.driver].map(String::as_str) != own
            || record.triangles != key.triangles
        {
            return Err("a tuning for another device, driver, version or size of scene".to_owned());
        }
        let named =
            [(RayClass::Camera, record.camera), (RayClass::Bounce, record.bounce), (RayClass::Shadow, record.shadow)];
        let mut classes = Vec::new();
        for (class, choice) in named {
            let Some(Choice { bvh, fetch, workgroup, packets, rays_per_second, share_of_rays: share }) = choice else {
                continue;
            };
            if !(1..=key.max_workgroup).contains(&workgroup) {
                return Err(format!("the device has no workgroups of {workgroup}"));
            }
            let bvh = bvh.parse::<BvhKind>().map_err(|_| format!("'{bvh}' is no BVH"))?;
            let fetch = fetch.parse::<Fetch>().map_err(|_| format!("'{fetch}' is no fetch"))?;
            let traversal = Traversal { bvh, fetch, workgroup_size: workgroup, packets };
            classes.push(TunedClass { class, traversal, rays_per_second, share });
        }
        let tuning = Self { classes };
        let shared = tuning.shared().ok_or("it tunes no class of rays")?;
        if tuning.classes.iter().any(|tuned| tuned.traversal.shared() != shared) {
            return Err("its classes cannot be traced in one render".to_owned());
        }
        Ok(tuning)
    }
}

/// A way to trace for people.
pub fn describe(Traversal { bvh, fetch, workgroup_size, .. }: &Traversal, packets: Packets) -> String {
    let packets = if packets == Packets::default() { String::new() } else { format!(", packets of {packets} rays") };
    format!("{}, {} fetch, workgroup {workgroup_size}{packets}", bvh.name(), fetch.name())
}

/// The way in which a render's rays were traced, for people.
pub fn in_words(choices: &Choices) -> String {
    let Choices { bvh, fetch, workgroup_size, packets, .. } = *choices;
    describe(&Traversal { bvh, fetch, workgroup_size, packets: false }, packets)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key() -> Key {
        Key {
            cache_name: "0-0-0-0".to_owned(),
            device: "a \"card\"".to_owned(),
            driver: "its driver 1".to_owned(),
            max_workgroup: 256,
            triangles: [16, 64],
        }
    }

    fn tuning() -> Tuning {
        let tuned = |class, packets, share| {
            let traversal = Traversal { bvh: BvhKind::Bvh4, fetch: Fetch::Storage, workgroup_size: 64, packets };
            TunedClass { class, traversal, rays_per_second: 1e6, share }
        };
        Tuning { classes: vec![tuned(RayClass::Camera, true, 0.25), tuned(RayClass::Shadow, false, 0.75)] }
    }

    fn text() -> String {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("caches/a.toml");
        tuning().write(&file, &key(), "box").expect("the tuning is written");
        assert_eq!(Tuning::read(&file, &key()), Ok(tuning()));
        fs::read_to_string(&file).expect("the tuning is text")
    }

    #[test]
    fn a_file_gives_back_what_was_tuned() {
        assert_eq!(Tuning::parse(&text(), &key()), Ok(tuning()));
        assert_eq!(Tuning::read(Path::new("no/such/file"), &key()), Ok(Tuning::default()));
    }

    #[test]
    fn other_devices_drivers_and_sizes_do_not_listen() {
        let others = [
            Key { device: "another".to_owned(), ..key() },
            Key { driver: "its driver 2".to_owned(), ..key() },
            Key { triangles: [64, 256], ..key() },
            Key { max_workgroup: 32, ..key() },
        ];
        for other in others {
            assert!(Tuning::parse(&text(), &other).is_err(), "{other:?}");
        }
        let version = raywave::VERSION;
        assert!(Tuning::parse(&text().replace(version, "0.0.0"), &key()).is_err());
    }

    #[test]
    fn damaged_files_are_told() {
        let text = text();
        let end = text.find("[camera]").expect("a table");
        for (damaged, reason) in [
            (String::new(), "not a tuning: missing field"),
            (text[..end].to_owned(), "it tunes no class of rays"),
            (text[..text.len() - 3].to_owned() + "x", "not a tuning: "),
            (text.replace("bvh4", "bvh9"), "'bvh9' is no BVH"),
            (text.replace("storage", "magic"), "'magic' is no fetch"),
            (text.replace("workgroup = 64", "workgroup = 0"), "the device has no workgroups of 0"),
            (text.replacen("bvh4", "bvh2", 1), "its classes cannot be traced in one render"),
            (text.replace("[shadow]", "[shade]"), "not a tuning: unknown field"),
        ] {
            let error = Tuning::parse(&damaged, &key()).expect_err(reason);
            assert!(error.starts_with(reason), "{error} is not {reason}");
            assert!(!error.contains('\n'));
        }
    }

    #[test]
    fn a_render_takes_what_its_classes_share_and_their_packets() {
        let packets = Packets { camera: true, ..Packets::default() };
        let chosen = Tuned { bvh: BvhKind::Bvh4, fetch: Fetch::Storage, workgroup_size: 64, packets };
        assert_eq!(tuning().chosen(), Some(chosen));
        assert_eq!(Tuning::default().chosen(), None);
    }
}
