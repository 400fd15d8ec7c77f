//! The wavefront: a kernel a stage, queues between them.

use std::mem::offset_of;
use std::ops::Range;

use super::plan::{Plan, SampleRange};
use crate::layout::{Batch, Control};
use crate::recording::Recording;

/// Kernels that the recordings name.
pub const KERNELS: [&str; 6] = ["generate", "extend", "shade", "connect", "prepare_dispatch", "resolve"];

/// Starts a batch: a path in every slot.
pub fn begin(recording: &mut Recording, plan: &Plan, range: SampleRange) {
    let batch = batch_at(range, 0);
    recording.dispatch("generate", plan.groups(range.pixel_count * range.sample_count), batch);
    recording.dispatch("prepare_dispatch", 1, batch);
}

/// Takes every path through the bounces: find the next vertex, shade it, gather its light.
pub fn advance(recording: &mut Recording, range: SampleRange, bounces: Range<u32>) {
    for bounce in bounces {
        let batch = batch_at(range, bounce);
        recording.dispatch_indirect("extend", offset_of!(Control, ray_groups), batch);
        recording.dispatch_indirect("shade", offset_of!(Control, ray_groups), batch);
        recording.dispatch("prepare_dispatch", 1, batch_at(range, bounce + 1));
        recording.dispatch_indirect("connect", offset_of!(Control, shadow_groups), batch);
    }
}

/// Ends a batch: its samples go to the film.
pub fn end(recording: &mut Recording, plan: &Plan, range: SampleRange) {
    recording.dispatch("resolve", plan.groups(range.pixel_count), batch_at(range, 0));
}

fn batch_at(range: SampleRange, bounce: u32) -> Batch {
    let SampleRange { first_pixel, pixel_count, first_sample, sample_count } = range;
    Batch { first_pixel, pixel_count, first_sample, sample_count, bounce }
}
