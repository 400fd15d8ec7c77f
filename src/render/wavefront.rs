//! The wavefront: a kernel a stage, queues between them.

use std::mem::offset_of;
use std::ops::Range;

use super::plan::SampleRange;
use super::settings::Sort;
use crate::layout::Control;
use crate::recording::Recording;

/// Kernels that the recordings name.
pub fn kernels(sort: Sort, connects: bool) -> Vec<&'static str> {
    let sorting: &[&str] = match sort {
        Sort::None => &[],
        Sort::Material => &["count_bins", "place_bins", "sort_rays"],
    };
    let connecting: &[&str] = if connects { &["connect"] } else { &[] };
    let all = ["generate", "extend", "shade", "prepare_dispatch", "resolve"];
    all.iter().chain(connecting).chain(sorting).copied().collect()
}

/// Takes every path through the bounces: find the next vertex, shade it, gather its light.
pub fn advance(recording: &mut Recording, sort: Sort, connects: bool, range: SampleRange, bounces: Range<u32>) {
    for bounce in bounces {
        let batch = range.at_bounce(bounce);
        recording.dispatch_indirect("extend", offset_of!(Control, ray_groups), batch);
        if sort == Sort::Material {
            recording.dispatch_indirect("count_bins", offset_of!(Control, ray_groups), batch);
            recording.dispatch("place_bins", 1, batch);
            recording.dispatch_indirect("sort_rays", offset_of!(Control, ray_groups), batch);
        }
        recording.dispatch_indirect("shade", offset_of!(Control, ray_groups), batch);
        recording.dispatch("prepare_dispatch", 1, range.at_bounce(bounce + 1));
        if connects {
            recording.dispatch_indirect("connect", offset_of!(Control, shadow_groups), batch);
        }
    }
}
