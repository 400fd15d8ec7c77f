//! How large an image may be.

use super::ImageProblem;

/// Most pixels that an image is read with, 3 GiB of memory. A damaged header cannot ask for more.
pub const MAX_PIXELS: u64 = 1 << 28;

/// Refuses what would not fit into memory.
pub(super) fn check_size(width: u64, height: u64) -> Result<(), ImageProblem> {
    match width.checked_mul(height) {
        Some(pixels) if pixels <= MAX_PIXELS => Ok(()),
        _ => Err(ImageProblem::TooLarge { width, height, most: MAX_PIXELS }),
    }
}
