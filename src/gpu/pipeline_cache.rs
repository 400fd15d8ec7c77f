//! The driver's compiled kernels, kept on disk from one run to the next.
//!
//! A cache saves time and is never worth an error: what cannot be read, written or trusted is left
//! alone, and the driver compiles. Software drivers hand out nothing to keep (lavapipe has a disk
//! cache of its own), and then no file is written.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use ash::vk;

use crate::whole_file;

/// Bytes of the header that every cache starts with: `VkPipelineCacheHeaderVersionOne`.
const HEADER_BYTES: usize = 32;
/// Bytes of the BLAKE3 hash that a file starts with: drivers trust what follows their header.
const HASH_BYTES: usize = 32;

/// What a cache is for. Another driver version means other code, whatever its header says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Identity {
    pub vendor: u32,
    pub device: u32,
    pub driver_version: u32,
    /// `pipelineCacheUUID`.
    pub uuid: [u8; vk::UUID_SIZE],
}

impl Identity {
    /// A name that no other device and no other version of its driver has, for files.
    pub fn name(&self) -> String {
        let uuid: String = self.uuid.iter().map(|byte| format!("{byte:02x}")).collect();
        format!("{:08x}-{:08x}-{:08x}-{uuid}", self.vendor, self.device, self.driver_version)
    }

    fn file_name(&self) -> String {
        self.name() + ".pipelines"
    }

    /// The driver's data in a file, if it is whole and of this device and driver.
    fn open(&self, file: &[u8]) -> Option<Vec<u8>> {
        let (hash, data) = file.split_at_checked(HASH_BYTES)?;
        let header = data.get(..HEADER_BYTES)?;
        let word = |i: usize| u32::from_le_bytes(header[4 * i..4 * i + 4].try_into().expect("a word has four bytes"));
        let known =
            [HEADER_BYTES as u32, vk::PipelineCacheHeaderVersion::ONE.as_raw() as u32, self.vendor, self.device];
        let is_own = (0..4).all(|i| word(i) == known[i]) && header[16..] == self.uuid;
        (is_own && blake3::hash(data).as_bytes() == hash).then(|| data.to_vec())
    }
}

/// A file for the driver's data.
fn sealed(data: &[u8]) -> Vec<u8> {
    [blake3::hash(data).as_bytes(), data].concat()
}

/// A Vulkan pipeline cache and its file.
pub(super) struct PipelineCache {
    pub raw: vk::PipelineCache,
    /// Without one, nothing is kept.
    file: Option<PathBuf>,
    /// What the file holds.
    saved: Mutex<Vec<u8>>,
}

impl PipelineCache {
    /// A cache with what the folder has for this device and driver.
    pub fn open(device: &ash::Device, identity: &Identity, folder: Option<&Path>) -> Self {
        let file = folder.map(|folder| folder.join(identity.file_name()));
        let saved = file.as_ref().and_then(|file| identity.open(&fs::read(file).ok()?)).unwrap_or_default();
        let make = |data: &[u8]| {
            let info = vk::PipelineCacheCreateInfo::default().initial_data(data);
            // SAFETY: `info` holds locals only, and the data is none or what this driver once gave.
            unsafe { device.create_pipeline_cache(&info, None) }
        };
        // Null is no cache, which every driver takes.
        let raw = make(&saved).or_else(|_| make(&[])).unwrap_or_default();
        Self { raw, file, saved: Mutex::new(saved) }
    }

    /// Writes the file, if there is more to keep than it holds.
    pub fn save(&self, device: &ash::Device) {
        let (Some(file), false) = (&self.file, self.raw == vk::PipelineCache::null()) else { return };
        // SAFETY: the cache is alive, and drivers synchronise its use.
        let Ok(data) = (unsafe { device.get_pipeline_cache_data(self.raw) }) else { return };
        let mut saved = self.saved.lock().expect("no thread panics while it saves");
        if data.len() <= HEADER_BYTES || *saved == data {
            return;
        }
        let folder = file.parent().unwrap_or(Path::new("."));
        let bytes = sealed(&data);
        let written = fs::create_dir_all(folder).and_then(|()| whole_file::write(file, |out| out.write_all(&bytes)));
        if written.is_ok() {
            *saved = data;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: Identity = Identity { vendor: 0x10de, device: 7, driver_version: 3, uuid: *b"0123456789abcdef" };

    fn data_of(identity: &Identity) -> Vec<u8> {
        let words = [HEADER_BYTES as u32, 1, identity.vendor, identity.device];
        let header = words.iter().flat_map(|word| word.to_le_bytes()).chain(identity.uuid);
        header.chain(*b"compiled kernels").collect()
    }

    #[test]
    fn a_file_gives_back_what_it_was_made_of() {
        let data = data_of(&OWN);
        assert_eq!(OWN.open(&sealed(&data)), Some(data));
    }

    #[test]
    fn damaged_and_foreign_files_are_ignored() {
        let file = sealed(&data_of(&OWN));
        for length in 0..file.len() {
            assert_eq!(OWN.open(&file[..length]), None, "{length} bytes of {}", file.len());
        }
        for place in 0..file.len() {
            let mut damaged = file.clone();
            damaged[place] ^= 0x10;
            assert_eq!(OWN.open(&damaged), None, "byte {place} is wrong");
        }
        let foreign = [
            Identity { vendor: 0x8086, ..OWN },
            Identity { device: 8, ..OWN },
            Identity { uuid: *b"0123456789abcdeF", ..OWN },
        ];
        for other in foreign {
            assert_eq!(OWN.open(&sealed(&data_of(&other))), None, "{other:?}");
            assert_ne!(other.file_name(), OWN.file_name());
        }
        assert_ne!(Identity { driver_version: 4, ..OWN }.file_name(), OWN.file_name());
    }
}
