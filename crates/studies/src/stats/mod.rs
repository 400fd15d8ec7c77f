//! Statistics: summaries, tests of hypotheses, intervals, and the comparison of two images.
//!
//! Pure functions of numbers. They draw random numbers only from their own seeded generator, so every result can be
//! repeated to the last bit.

mod bootstrap;
mod estimate;
mod hypothesis;
mod images;
mod summary;

pub use bootstrap::{Bootstrap, SplitMix64};
pub use estimate::{CONFIDENCE, Estimate, FEWEST_ROUNDS, Interval, TOO_FEW_ROUNDS};
pub use hypothesis::{ChiSquare, ZTest, chi_square, normal_cdf, normal_quantile, sidak_adjusted, sidak_level, z_test};
pub use images::{
    DARK, Differences, ImageComparison, NonFinite, PixelTest, SizesDiffer, compare_images, relative_squared_error,
    test_pixels,
};
pub use summary::{Moments, mean, median, quantile, standard_error, variance};
