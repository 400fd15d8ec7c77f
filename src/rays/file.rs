//! Ray dumps in files.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;

use rayon::prelude::*;

use super::{Fault, Metadata, RayDump, RayRecord, RayScene, RaysError, RecordLayout};
use crate::whole_file;

/// What every dump begins with, before the version.
const MAGIC: &str = "raywave rays ";
const VERSION: &str = "1";
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
            writeln!(file, "{MAGIC}{VERSION}\n{metadata}")?;
            self.rays.chunks(RECORDS_AT_ONCE).try_for_each(|rays| {
                let bytes: Vec<_> = rays.iter().map(to_bytes).collect();
                file.write_all(bytes.as_flattened())
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
    if version != VERSION.as_bytes() {
        return fault(MAGIC.len() as u64, Fault::Version(String::from_utf8_lossy(version).into_owned()));
    }

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
    if let Err(wrong) = check(&metadata, scene) {
        return fault(start, wrong);
    }

    let size = size_of::<RayRecord>() as u64;
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
        let more = rest.by_ref().take((RECORDS_AT_ONCE * RECORD_BYTES) as u64).read_to_end(&mut bytes)?;
        found += more as u64;
        let (records, _) = bytes.as_chunks();
        rays.extend(records.iter().map(from_bytes));
        if more < RECORDS_AT_ONCE * RECORD_BYTES {
            break;
        }
    }
    if found < expected {
        return fault(end + found, Fault::Cut { whole: found / size, rays: metadata.rays });
    }
    if found > expected {
        return fault(end + expected, Fault::TooLong { rays: metadata.rays });
    }
    let (class, triangles) = (metadata.class, metadata.scene.triangles);
    if let Some(number) = rays.par_iter().position_first(|ray| ray.fault_in(class, triangles).is_some()) {
        let (byte, wrong) = rays[number].fault_in(class, triangles).expect("it was just found");
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
fn check(metadata: &Metadata, scene: &RayScene) -> Result<(), Fault> {
    if metadata.record != RecordLayout::of_rays() {
        return Err(Fault::Layout);
    }
    let dumped = &metadata.scene;
    if dumped.scene_hash != scene.scene_hash {
        return Err(Fault::Scene { dumped: Box::new(dumped.clone()), named: Box::new(scene.clone()) });
    }
    let same = (dumped.triangles, dumped.centre, dumped.scale) == (scene.triangles, scene.centre, scene.scale);
    if same { Ok(()) } else { Err(Fault::Space(metadata.raywave_version.clone())) }
}

const RECORD_BYTES: usize = size_of::<RayRecord>();
/// Records that are read or written at a time.
const RECORDS_AT_ONCE: usize = 1 << 15;

fn to_bytes(ray: &RayRecord) -> [u8; RECORD_BYTES] {
    let words: [u32; RECORD_BYTES / 4] = bytemuck::cast(*ray);
    bytemuck::cast(words.map(u32::to_le))
}

fn from_bytes(bytes: &[u8; RECORD_BYTES]) -> RayRecord {
    let words: [u32; RECORD_BYTES / 4] = bytemuck::pod_read_unaligned(bytes);
    bytemuck::cast(words.map(u32::from_le))
}
