//! Portable float maps: `PF` for colour or `Pf` for grey, width, height, scale, and floats in rows from the bottom up.
//!
//! A negative scale means little-endian floats. Its size says in which unit they are, which no program follows, and is
//! ignored.

use super::{ImageProblem, Texels, limits::check_size};

/// Reads a float map of either colour type and either order of bytes.
pub fn decode(bytes: &[u8]) -> Result<Texels, ImageProblem> {
    let damaged = |cause: &str| ImageProblem::decode("PFM", cause);
    // Four words, each ended by one byte of white space; what follows are floats.
    let mut rest = bytes;
    let mut word = || {
        let start = rest.iter().position(|byte| !byte.is_ascii_whitespace())?;
        let length = rest[start..].iter().position(u8::is_ascii_whitespace)?;
        let word = std::str::from_utf8(&rest[start..start + length]).ok();
        rest = &rest[start + length + 1..];
        word
    };
    let channels = match word() {
        Some("PF") => 3,
        Some("Pf") => 1,
        _ => return Err(damaged("it does not begin with PF or Pf")),
    };
    let mut size = || word().and_then(|word| word.parse::<u32>().ok()).ok_or_else(|| damaged("it gives no size"));
    let (width, height) = (size()?, size()?);
    let scale = word().and_then(|word| word.parse::<f32>().ok()).filter(|scale| scale.is_finite() && *scale != 0.0);
    let scale = scale.ok_or_else(|| damaged("it gives no scale"))?;
    check_size(width.into(), height.into(), bytes.len())?;
    let row = width as usize * channels * size_of::<f32>();
    let Some(floats) = rest.get(..row * height as usize) else {
        return Err(damaged("it ends too early"));
    };
    let float = |bytes: [u8; 4]| if scale < 0.0 { f32::from_le_bytes(bytes) } else { f32::from_be_bytes(bytes) };
    let texel = |bytes: &[u8]| {
        let channel = |index: usize| float(std::array::from_fn(|byte| bytes[4 * (index % channels) + byte]));
        [channel(0), channel(1), channel(2), 1.0]
    };
    // A row of an image without width has no bytes.
    let rows = floats.rchunks_exact(row.max(1));
    let rgba = rows.flat_map(|row| row.chunks_exact(4 * channels).map(texel)).collect();
    Ok(Texels { width, height, rgba })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_run_from_the_bottom_in_either_order_of_bytes() {
        let floats = [1.0f32, 2.0, 3.0, -4.0, 5.0, f32::INFINITY];
        let expected = vec![[-4.0, 5.0, f32::INFINITY, 1.0], [1.0, 2.0, 3.0, 1.0]];
        let little = [b"PF\n1 2\n-2.5\n".as_slice(), &floats.map(f32::to_le_bytes).concat()].concat();
        let big = [b"PF 1\n2 1\n".as_slice(), &floats.map(f32::to_be_bytes).concat()].concat();
        for bytes in [little, big] {
            let texels = decode(&bytes).expect("it is well formed");
            assert_eq!((texels.width, texels.height, &texels.rgba), (1, 2, &expected));
        }
        let grey = [b"Pf\n2 1\n1\n".as_slice(), &[0.5f32, 7.0].map(f32::to_be_bytes).concat()].concat();
        assert_eq!(decode(&grey).expect("it is well formed").rgba, [[0.5, 0.5, 0.5, 1.0], [7.0, 7.0, 7.0, 1.0]]);
    }

    #[test]
    fn damaged_maps_are_refused() {
        for (bytes, says) in [
            (b"".as_slice(), "PF or Pf"),
            (b"P6\n1 1\n255\n", "PF or Pf"),
            (b"PF\n1", "size"),
            (b"PF\n1 -1\n1\n", "size"),
            (b"PF\n1 1\n0\n", "scale"),
            (b"PF\n1 1\nnan\n", "scale"),
            (b"PF\n1 1\n1\n12345678901", "too early"),
            (b"PF\n99999 99999\n1\n1234", "scale it down"),
            (b"Pf\n16000 16000\n1\n1234", "cut off"),
        ] {
            let problem = decode(bytes).expect_err(says).to_string();
            assert!(problem.contains(says), "{problem}");
        }
    }
}
