//! What accompanies a dump for other tracers, as `.npy` files: the triangles, and how far the rays go.

use std::path::Path;

use super::RaysError;
use crate::whole_file;

/// Writes the corners of triangles, an array of shape (triangles, 3, 3), whole or not at all.
///
/// # Errors
/// A file that cannot be written.
pub fn write_triangles(path: &Path, triangles: &[[[f32; 3]; 3]]) -> Result<(), RaysError> {
    let shape = format!("({}, 3, 3)", triangles.len());
    write(path, &shape, triangles.as_flattened().as_flattened())
}

/// Writes a distance for each ray, an array of shape (rays,), whole or not at all.
///
/// # Errors
/// A file that cannot be written.
pub fn write_distances(path: &Path, distances: &[f32]) -> Result<(), RaysError> {
    write(path, &format!("({},)", distances.len()), distances)
}

/// Version 1.0 of the format, as `numpy.lib.format` describes it: its header is padded to a multiple of 64 bytes.
fn write(path: &Path, shape: &str, numbers: &[f32]) -> Result<(), RaysError> {
    const BEFORE_TEXT: usize = 10;
    let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
    let padded = (BEFORE_TEXT + text.len() + 1).next_multiple_of(64) - BEFORE_TEXT - 1;
    let length = u16::try_from(padded + 1).expect("a shape is short");
    whole_file::write(path, |file| {
        file.write_all(b"\x93NUMPY\x01\x00")?;
        file.write_all(&length.to_le_bytes())?;
        writeln!(file, "{text:padded$}")?;
        numbers.iter().try_for_each(|number| file.write_all(&number.to_le_bytes()))
    })
    .map_err(|cause| RaysError::Write { path: path.into(), cause })
}
