//! What a batch begins and ends with, whichever scheduler takes it from one to the other.

use super::plan::{Plan, SampleRange};
use crate::recording::Recording;

/// Starts a path in every slot and queues it.
pub fn begin(recording: &mut Recording, plan: &Plan, range: SampleRange) {
    let batch = range.at_bounce(0);
    recording.dispatch("generate", plan.groups(range.paths()), batch);
    recording.dispatch("prepare_dispatch", 1, batch);
}

/// Adds the batch's samples to the film.
pub fn end(recording: &mut Recording, plan: &Plan, range: SampleRange) {
    recording.dispatch("resolve", plan.groups(range.pixel_count), range.at_bounce(0));
}
