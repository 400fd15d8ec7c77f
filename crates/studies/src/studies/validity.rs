//! The gate before the speeds: a combination counts only if its image is right.

use serde::Serialize;

use crate::stats::{Differences, ImageComparison, compare_images, sidak_adjusted};
use raywave::image::Image;

/// Probability with which a right image is rejected if the contract is statistical.
const FALSE_ALARM: f64 = 1e-3;

/// Difference of two means, as a share of them, that rounding in f32 explains. Images of the same random numbers have
/// so little noise between them that it would not excuse rounding.
const ROUNDING: f64 = 1e-6;

/// How close two images must be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Contract {
    /// Every bit of every channel.
    Bits,
    /// No channel's mean differs by more than its noise or rounding explains.
    Statistics,
}

/// The gate's verdict on a combination.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "verdict", rename_all = "snake_case")]
pub enum Verdict {
    /// Not rendered yet.
    Pending,
    /// The combination that others are compared with.
    Baseline,
    /// The baseline's image to the last bit.
    Identical,
    /// The baseline's image up to noise, which is what its contract asks.
    Agrees {
        /// How they differ.
        comparison: Box<ImageComparison>,
    },
    /// Another image. Its speed means nothing and is not reported.
    Wrong {
        /// What is wrong, in a sentence without a full stop.
        reason: String,
        /// How the images differ, if they can be compared.
        comparison: Option<Box<ImageComparison>>,
    },
    /// It could not be rendered.
    Failed {
        /// What the renderer said.
        reason: String,
    },
}

impl Verdict {
    /// Whether its speed may be reported.
    pub fn counts(&self) -> bool {
        matches!(self, Self::Baseline | Self::Identical | Self::Agrees { .. })
    }

    /// One word for tables.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Pending => "pending",
            Self::Baseline => "baseline",
            Self::Identical => "identical",
            Self::Agrees { .. } => "agrees",
            Self::Wrong { .. } => "wrong",
            Self::Failed { .. } => "failed",
        }
    }

    /// A sentence without a full stop that explains the word.
    pub fn explanation(&self) -> String {
        match self {
            Self::Pending => "not rendered yet".to_owned(),
            Self::Baseline => "what the others are compared with".to_owned(),
            Self::Identical => "the baseline's image to the last bit".to_owned(),
            Self::Agrees { comparison } => {
                format!("the baseline's image up to noise (z {:.2})", comparison.whole.z)
            }
            Self::Wrong { reason, .. } | Self::Failed { reason } => reason.clone(),
        }
    }

    /// How its image differs from the baseline's, if it does.
    pub fn comparison(&self) -> Option<&ImageComparison> {
        match self {
            Self::Agrees { comparison } | Self::Wrong { comparison: Some(comparison), .. } => Some(comparison),
            _ => None,
        }
    }
}

/// Compares a combination's image with its baseline's.
pub fn judge(contract: Contract, image: &Image, baseline: &Image) -> Verdict {
    // Nearly all images are identical, and this comparison is fast.
    if image.is_identical(baseline) {
        return Verdict::Identical;
    }
    let comparison = match compare_images(image, baseline) {
        Ok(comparison) => Box::new(comparison),
        Err(sizes) => return Verdict::Wrong { reason: sizes.to_string(), comparison: None },
    };
    let reason = match contract {
        Contract::Bits => Some(format!(
            "{:.3} % of the pixels differ from the baseline's, by {:.2e} at most (relMSE {:.2e}, z {:.2})",
            100.0 * comparison.share_of_differing_pixels,
            comparison.whole.max_abs_difference,
            comparison.whole.rel_mse,
            comparison.whole.z,
        )),
        Contract::Statistics => biased(&comparison),
    };
    match reason {
        Some(reason) => Verdict::Wrong { reason, comparison: Some(comparison) },
        None => Verdict::Agrees { comparison },
    }
}

/// A difference that noise does not explain, if there is one.
fn biased(comparison: &ImageComparison) -> Option<String> {
    let unusable = |n: crate::stats::NonFinite| n.nan_count + n.inf_count;
    if unusable(comparison.non_finite_a) > unusable(comparison.non_finite_b) {
        return Some(format!("{} pixels are NaN or infinite", unusable(comparison.non_finite_a)));
    }
    let channels = comparison.channels.iter().zip(["red", "green", "blue"]);
    // Equal channels, and single pixels, have no standard error and no p.
    let rounding = |d: &Differences| d.mean_difference.abs() <= ROUNDING * d.mean_b.abs();
    let tested = channels.filter(|(differences, _)| differences.p.is_finite() && !rounding(differences));
    let (worst, name) = tested.min_by(|a, b| a.0.p.total_cmp(&b.0.p))?;
    (sidak_adjusted(worst.p, 3) < FALSE_ALARM)
        .then(|| format!("mean {name} is {:.1} standard errors from the baseline's", worst.z))
}
