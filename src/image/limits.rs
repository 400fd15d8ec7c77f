//! How large an image may be.

use super::ImageProblem;

/// Most pixels that an image is read with, 4 GiB of memory. A damaged header cannot ask for more.
pub const MAX_PIXELS: u64 = 1 << 28;

/// Most bytes that a decoder may take beside its output.
pub(super) const MAX_WORKING_BYTES: u64 = 1 << 30;

/// Pixels that are believed of a file of any length: some formats hold any number of pixels of one colour in a few bytes.
const ALWAYS_BELIEVED: u64 = 1 << 24;

/// Most pixels a byte of a larger image. Deflate, the tightest of the common codings, comes to 8256 at a bit a pixel.
const PIXELS_PER_BYTE: u64 = 8300;

/// Refuses what would not fit into memory, and what a file of that many bytes can hardly hold.
pub(super) fn check_size(width: u64, height: u64, bytes: usize) -> Result<(), ImageProblem> {
    let most_in_file = (bytes as u64).saturating_mul(PIXELS_PER_BYTE).max(ALWAYS_BELIEVED);
    match width.saturating_mul(height) {
        pixels if pixels > MAX_PIXELS => Err(ImageProblem::TooLarge { width, height, most: MAX_PIXELS }),
        pixels if pixels > most_in_file => Err(ImageProblem::TooShort { width, height, bytes }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_is_believed_of_a_file_that_can_hold_it() {
        assert!(check_size(1 << 12, 1 << 12, 30).is_ok(), "one colour takes no more");
        assert!(check_size(1 << 14, 1 << 14, 1 << 16).is_ok());
        assert!(matches!(check_size(1 << 14, 1 << 14, 1 << 10), Err(ImageProblem::TooShort { .. })));
        assert!(matches!(check_size(1 << 14, 1 << 15, 1 << 30), Err(ImageProblem::TooLarge { .. })));
        assert!(matches!(check_size(u64::MAX, 2, 1 << 30), Err(ImageProblem::TooLarge { .. })));
    }
}
