//! The megakernel: one kernel that follows a path from the camera to its end.

use super::plan::{Plan, SampleRange};
use crate::recording::Recording;

/// Kernels that the recordings name.
pub const KERNELS: [&str; 3] = ["megakernel", "prepare_dispatch", "resolve"];

/// Takes every path of a batch from the camera to its end.
pub fn follow(recording: &mut Recording, plan: &Plan, range: SampleRange) {
    let invocations = (range.pixel_count * range.sample_count).div_ceil(plan.paths_per_invocation);
    recording.dispatch("megakernel", plan.groups(invocations), range.at_bounce(0));
    // Adds the rays that the kernel counted to the totals.
    recording.dispatch("prepare_dispatch", 1, range.at_bounce(1));
}
