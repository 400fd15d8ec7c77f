//! Ray dumps in files.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;

use rayon::prelude::*;

use super::{Fault, Instances, Metadata, RayDump, RayRecord, RayScene, RaysError, RecordLayout, Version};
use crate::whole_file;

/// What every dump begins with, before the version.
const MAGIC: &str = "raywave rays ";
/// The versions, as they are written.
const VERSIONS: [(Version, &str); 2] = [(Version::One, "1"), (Version::Two, "2")];
/// Most bytes that are searched for the end of the metadata.
const MAX_METADATA_BYTES: u64 = 1 << 20;

impl RayDump {
    /// Writes the dump whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), RaysError> {
        let metadata = serde_json::to_string(&self.metadata).expect("numbers and names become JSON");
        let fill = |file: &mut dyn Write| {
            let version = Version::of(&self.metadata.scene);
            let (_, number) = VERSIONS.into_iter().find(|(known, _)| *known == version).expect("it is known");
            writeln!(file, "{MAGIC}{number}\n{metadata}")?;
            self.rays.chunks(RECORDS_AT_ONCE).try_for_each(|rays| {
                let bytes: Vec<_> = rays.iter().flat_map(|ray| to_bytes(ray, version)).collect();
                file.write_all(&bytes)
            })
        };
        whole_file::write(path, fill).map_err(|cause| RaysError::Write { path: path.into(), cause })
    }

    /// Reads a dump of the given scene and checks every ray of it.
    ///
    /// # Errors
    /// A file that cannot be read, is no dump, is damaged, or belongs to another scene.
    pub fn read(path: &Path, scene: &RayScene) -> Result<Self, RaysError> {
        let unreadable = |cause| RaysError::Read { path: path.into(), cause };
        let file = File::open(path).map_err(unreadable)?;
        parse(BufReader::new(file), scene).map_err(|error| match error {
            ParseError::Read(cause) => unreadable(cause),
            ParseError::Fault(byte, fault) => RaysError::Malformed { path: path.into(), byte, fault },
        })
    }
}

/// An error with its byte, or the system's message.
enum ParseError {
    Read(std::io::Error),
    Fault(u64, Fault),
}

impl From<std::io::Error> for ParseError {
    fn from(error: std::io::Error) -> Self {
        Self::Read(error)
    }
}

fn parse(mut file: impl BufRead, scene: &RayScene) -> Result<RayDump, ParseError> {
    let fault = |byte: u64, fault| Err(ParseError::Fault(byte, fault));

    let magic = line(&mut file, 64)?;
    let Some(version) = magic.strip_prefix(MAGIC.as_bytes()).and_then(|rest| rest.strip_suffix(b"\n")) else {
        return fault(0, Fault::Magic);
    };
    let Some((version, _)) = VERSIONS.into_iter().find(|(_, number)| number.as_bytes() == version) else {
        return fault(MAGIC.len() as u64, Fault::Version(String::from_utf8_lossy(version).into_owned()));
    };

    let start = magic.len() as u64;
    let text = line(&mut file, MAX_METADATA_BYTES)?;
    let end = start + text.len() as u64;
    if text.last() != Some(&b'\n') {
        let too_long = text.len() as u64 == MAX_METADATA_BYTES;
        return fault(end, if too_long { Fault::MetadataTooLong(MAX_METADATA_BYTES) } else { Fault::MetadataCut });
    }
    let metadata: Metadata = match serde_json::from_slice(&text) {
        Ok(metadata) => metadata,
        Err(error) => {
            // There is one line, so the byte is the column.
            let said = error.to_string();
            let said = said.split(" at line ").next().unwrap_or_default().to_owned();
            return fault(start + (error.column() as u64).saturating_sub(1), Fault::Metadata(said));
        }
    };
    if let Err(wrong) = check(&metadata, scene, version) {
        return fault(start, wrong);
    }

    let size = version.record_bytes() as u64;
    let bytes = metadata.rays.checked_mul(size).filter(|bytes| *bytes > 0 && *bytes < isize::MAX as u64);
    let Some(expected) = bytes else {
        return fault(start, Fault::Count(metadata.rays));
    };
    // One more byte shows a file that is too long. Memory grows with the file, not with the size that it claims.
    let mut rays: Vec<RayRecord> = Vec::new();
    let mut bytes = Vec::new();
    let mut rest = file.take(expected + 1);
    let mut found = 0;
    loop {
        bytes.clear();
        let most = RECORDS_AT_ONCE * version.record_bytes();
        let more = rest.by_ref().take(most as u64).read_to_end(&mut bytes)?;
        found += more as u64;
        rays.extend(bytes.chunks_exact(version.record_bytes()).map(from_bytes));
        if more < most {
            break;
        }
    }
    if found < expected {
        return fault(end + found, Fault::Cut { whole: found / size, rays: metadata.rays });
    }
    if found > expected {
        return fault(end + expected, Fault::TooLong { rays: metadata.rays });
    }
    let (class, instances) = (metadata.class, Instances::of(&metadata.scene));
    if let Some(number) = rays.par_iter().position_first(|ray| ray.fault_in(class, &instances).is_some()) {
        let (byte, wrong) = rays[number].fault_in(class, &instances).expect("it was just found");
        let number = number as u64;
        return fault(end + number * size + byte, Fault::Ray { ray: number, fault: Box::new(wrong) });
    }
    Ok(RayDump { metadata, rays })
}

/// A line with its end, or as much of it as is within `limit` bytes.
fn line(file: &mut impl BufRead, limit: u64) -> std::io::Result<Vec<u8>> {
    let mut line = Vec::new();
    file.take(limit).read_until(b'\n', &mut line)?;
    Ok(line)
}

/// Checks that the records have the layout that is read, and belong to the scene.
fn check(metadata: &Metadata, scene: &RayScene, version: Version) -> Result<(), Fault> {
    let dumped = &metadata.scene;
    if metadata.record != RecordLayout::of_rays(dumped) || Version::of(dumped) != version {
        return Err(Fault::Layout);
    }
    if dumped.scene_hash != scene.scene_hash {
        return Err(Fault::Scene { dumped: Box::new(dumped.clone()), named: Box::new(scene.clone()) });
    }
    let space = |of: &RayScene| (of.triangles, of.placed.clone(), of.centre, of.scale);
    let same = space(dumped) == space(scene);
    if same { Ok(()) } else { Err(Fault::Space(metadata.raywave_version.clone())) }
}

/// Records that are read or written at a time.
const RECORDS_AT_ONCE: usize = 1 << 15;
/// Numbers of a record of the last version.
const WORDS: usize = size_of::<RayRecord>() / 4;

fn to_bytes(ray: &RayRecord, version: Version) -> impl Iterator<Item = u8> + use<> {
    let words: [u32; WORDS] = bytemuck::cast(*ray);
    words.into_iter().flat_map(u32::to_le_bytes).take(version.record_bytes())
}

/// A record whose last numbers may be left out: they are 0 then.
fn from_bytes(bytes: &[u8]) -> RayRecord {
    let mut words = [0; WORDS];
    for (word, bytes) in words.iter_mut().zip(bytes.as_chunks().0) {
        *word = u32::from_le_bytes(*bytes);
    }
    bytemuck::cast(words)
}
