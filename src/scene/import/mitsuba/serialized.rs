//! Meshes of Mitsuba's serialized format, versions 3 and 4: several in a file, each deflated by itself.

use std::io::Read;

use flate2::read::ZlibDecoder;
use glam::{DVec3, Vec2};

use super::shapes::Geometry;

/// The first two bytes of a file, little endian as everything in it.
const MAGIC: u16 = 0x041c;
/// Magic and version, which stand before each mesh too.
const HEADER: usize = 4;

const HAS_NORMALS: u32 = 0x0001;
const HAS_UVS: u32 = 0x0002;
const HAS_COLOURS: u32 = 0x0008;
const IS_DOUBLE: u32 = 0x2000;

/// No deflated byte stands for more.
const MOST_INFLATED: u64 = 1032;

/// Reads the mesh of an index in a file. The error says what is wrong and what to do.
pub(super) fn read(bytes: &[u8], index: usize) -> Result<Geometry, String> {
    let (magic, version) = (u16_at(bytes, 0)?, u16_at(bytes, 2)?);
    if magic != MAGIC {
        return Err("not a serialized mesh; export it anew".to_owned());
    }
    if !matches!(version, 3 | 4) {
        return Err(format!("version {version} of the format; export the mesh as version 3 or 4, or as PLY or OBJ"));
    }
    let start = if index == 0 { 0 } else { offset(bytes, version, index)? };
    let deflated = bytes.get(start..).and_then(|rest| rest.get(HEADER..)).ok_or_else(cut)?;
    let mut stream = Stream { inflated: ZlibDecoder::new(deflated), left: deflated.len() as u64 * MOST_INFLATED };
    let flags = u32::from_le_bytes(stream.array()?);
    if version == 4 {
        // The name of the mesh, which ends in a zero.
        while stream.array::<1>()? != [0] {}
    }
    let vertices = u64::from_le_bytes(stream.array()?);
    let faces = u64::from_le_bytes(stream.array()?);
    let size = if flags & IS_DOUBLE != 0 { 8 } else { 4 };
    let positions = vectors(&stream.numbers(vertices, 3, size)?);
    let normals = if flags & HAS_NORMALS != 0 { vectors(&stream.numbers(vertices, 3, size)?) } else { Vec::new() };
    let uvs = if flags & HAS_UVS != 0 { stream.numbers(vertices, 2, size)? } else { Vec::new() };
    let uvs: Vec<Vec2> = uvs.chunks_exact(2).map(|uv| Vec2::new(uv[0] as f32, uv[1] as f32)).collect();
    if flags & HAS_COLOURS != 0 {
        stream.numbers(vertices, 3, size)?;
    }
    let corners = stream.bytes(faces, 12)?;
    let corner = |bytes: &[u8]| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let triangles: Vec<[u32; 3]> =
        corners.chunks_exact(12).map(|face| [corner(face), corner(&face[4..]), corner(&face[8..])]).collect();
    if triangles.is_empty() {
        return Err("a mesh without triangles; export it with its faces".to_owned());
    }
    if let Some(wrong) = triangles.iter().flatten().find(|corner| u64::from(**corner) >= vertices) {
        return Err(format!("vertex {wrong} of {vertices} is out of range; export the mesh anew"));
    }
    if !positions.iter().all(|point| point.is_finite()) || !uvs.iter().all(|uv| uv.is_finite()) {
        return Err("coordinates that are not finite; export the mesh anew".to_owned());
    }
    Ok(Geometry { positions, normals, uvs, triangles })
}

/// Where the mesh of an index begins, which a table at the end of the file says.
fn offset(bytes: &[u8], version: u16, index: usize) -> Result<usize, String> {
    let table_end = bytes.len().checked_sub(4).ok_or_else(cut)?;
    let count = u32_at(bytes, table_end)? as usize;
    if index >= count {
        return Err(format!("it has {count} meshes, counted from 0, and no number {index}; correct shape_index"));
    }
    let width = if version == 4 { 8 } else { 4 };
    let back = (count - index).checked_mul(width).ok_or_else(cut)?;
    let place = table_end.checked_sub(back).ok_or_else(cut)?;
    let low = u64::from(u32_at(bytes, place)?);
    let high = if version == 4 { u64::from(u32_at(bytes, place + 4)?) } else { 0 };
    usize::try_from(high << 32 | low).map_err(|_| cut())
}

fn cut() -> String {
    "the file is cut off; copy it anew".to_owned()
}

fn u16_at(bytes: &[u8], at: usize) -> Result<u16, String> {
    let bytes = bytes.get(at..at + 2).ok_or_else(cut)?;
    Ok(u16::from_le_bytes([bytes[0], bytes[1]]))
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32, String> {
    let bytes = bytes.get(at..).and_then(|rest| rest.get(..4)).ok_or_else(cut)?;
    Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
}

fn vectors(numbers: &[f64]) -> Vec<DVec3> {
    numbers.chunks_exact(3).map(DVec3::from_slice).collect()
}

struct Stream<'a> {
    inflated: ZlibDecoder<&'a [u8]>,
    /// Bytes that may still come.
    left: u64,
}

impl Stream<'_> {
    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let mut array = [0; N];
        self.inflated
            .read_exact(&mut array)
            .map_err(|error| format!("it cannot be inflated ({error}); copy it anew"))?;
        Ok(array)
    }

    /// So many records of a size.
    fn bytes(&mut self, count: u64, size: u64) -> Result<Vec<u8>, String> {
        let length = count.checked_mul(size).filter(|length| *length <= self.left).ok_or_else(|| {
            format!("it claims {count} records where it has no room for so many; export the mesh anew")
        })?;
        self.left -= length;
        let mut bytes = Vec::new();
        let read = (&mut self.inflated).take(length).read_to_end(&mut bytes);
        read.map_err(|error| format!("it cannot be inflated ({error}); copy it anew"))?;
        if bytes.len() as u64 == length { Ok(bytes) } else { Err(cut()) }
    }

    /// So many tuples of floats, of 4 or 8 bytes each.
    fn numbers(&mut self, count: u64, dimensions: u64, size: u64) -> Result<Vec<f64>, String> {
        let bytes = self.bytes(count, dimensions * size)?;
        let double = |b: &[u8]| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]);
        let single = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        Ok(match size {
            8 => bytes.chunks_exact(8).map(double).collect(),
            _ => bytes.chunks_exact(4).map(single).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::{Compression, write::ZlibEncoder};

    use super::*;

    /// A file of a version with meshes of one triangle each, the first with normals and coordinates, the second in doubles.
    fn file(version: u16) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut offsets = Vec::new();
        for flags in [HAS_NORMALS | HAS_UVS, IS_DOUBLE] {
            offsets.push(bytes.len() as u64);
            bytes.extend(MAGIC.to_le_bytes());
            bytes.extend(version.to_le_bytes());
            let mut body = flags.to_le_bytes().to_vec();
            body.extend(if version == 4 { b"name\0".as_slice() } else { b"" });
            body.extend(3_u64.to_le_bytes());
            body.extend(1_u64.to_le_bytes());
            let positions = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
            if flags & IS_DOUBLE != 0 {
                body.extend(positions.iter().flat_map(|x: &f64| x.to_le_bytes()));
            } else {
                let extra = [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0];
                body.extend(positions.iter().chain(&extra).flat_map(|x| (*x as f32).to_le_bytes()));
            }
            body.extend([0_u32, 1, 2].iter().flat_map(|corner| corner.to_le_bytes()));
            let mut encoder = ZlibEncoder::new(&mut bytes, Compression::fast());
            encoder.write_all(&body).expect("memory takes it");
            encoder.finish().expect("memory takes it");
        }
        for offset in &offsets {
            match version {
                4 => bytes.extend(offset.to_le_bytes()),
                _ => bytes.extend((*offset as u32).to_le_bytes()),
            }
        }
        bytes.extend((offsets.len() as u32).to_le_bytes());
        bytes
    }

    #[test]
    fn both_versions_are_read() {
        for version in [3, 4] {
            let bytes = file(version);
            let first = read(&bytes, 0).expect("it is well formed");
            assert_eq!((first.normals.len(), first.uvs[2], first.triangles[0]), (3, Vec2::Y, [0, 1, 2]));
            let second = read(&bytes, 1).expect("it is well formed");
            assert_eq!((second.positions[1], second.normals.len()), (DVec3::X, 0));
            assert!(read(&bytes, 2).expect_err("there are two").contains("2 meshes"));
        }
    }

    #[test]
    fn no_bytes_are_too_strange() {
        let bytes = file(4);
        for length in 0..bytes.len() {
            let _ = read(&bytes[..length], 1);
            assert!(read(&bytes[..length.min(40)], 0).is_err());
        }
        for at in 0..bytes.len() {
            let mut wrong = bytes.clone();
            wrong[at] ^= 0xff;
            let _ = (read(&wrong, 0), read(&wrong, 1));
        }
    }
}
