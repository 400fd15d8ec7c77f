//! The megakernel: one kernel that follows a path from the camera to its end.

use super::plan::{Plan, SampleRange};
use crate::layout::Batch;
use crate::recording::Recording;

/// Kernels that the recordings name.
pub const KERNELS: [&str; 3] = ["megakernel", "prepare_dispatch", "resolve"];

/// Takes every path of a batch from the camera to its end. Their radiances lie from `first_slot` on.
pub fn follow(recording: &mut Recording, plan: &Plan, range: SampleRange, first_slot: u32) {
    let batch = Batch { first_slot, ..range.at_bounce(0) };
    recording.dispatch("megakernel", plan.groups(plan.invocations(range.paths())), batch);
}

/// Adds the rays that the kernel counted to the totals.
pub fn count(recording: &mut Recording, range: SampleRange) {
    recording.dispatch("prepare_dispatch", 1, range.at_bounce(1));
}
