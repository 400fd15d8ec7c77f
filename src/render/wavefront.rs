//! The wavefront: a kernel a stage, queues between them.

use std::mem::offset_of;
use std::ops::Range;

use super::plan::SampleRange;
use crate::layout::Control;
use crate::recording::Recording;
use crate::settings::{Packets, Sort};

/// Kernels that the recordings name.
pub fn kernels(sort: Sort, packets: Packets, connects: bool) -> Vec<&'static str> {
    let sorting: &[&str] = match sort {
        Sort::None => &[],
        Sort::Material => &["count_bins", "place_bins", "sort_rays"],
    };
    let connecting = connects.then(|| packets.connect());
    let mut all = vec!["generate", "shade", "prepare_dispatch", "resolve"];
    all.extend(packets.kernels("extend", "extend_packets"));
    all.extend(connecting.iter().chain(sorting));
    all
}

/// Takes every path through the bounces: find the next vertex, shade it, gather its light.
pub fn advance(
    recording: &mut Recording,
    sort: Sort,
    packets: Packets,
    connects: bool,
    range: SampleRange,
    bounces: Range<u32>,
) {
    for bounce in bounces {
        recording.bounce(bounce, |recording| {
            let batch = range.at_bounce(bounce);
            let extend = packets.kernel_at(bounce, "extend", "extend_packets");
            recording.dispatch_indirect(extend, offset_of!(Control, ray_groups), batch);
            if sort == Sort::Material {
                recording.dispatch_indirect("count_bins", offset_of!(Control, ray_groups), batch);
                recording.dispatch("place_bins", 1, batch);
                recording.dispatch_indirect("sort_rays", offset_of!(Control, ray_groups), batch);
            }
            recording.dispatch_indirect("shade", offset_of!(Control, ray_groups), batch);
            recording.dispatch("prepare_dispatch", 1, range.at_bounce(bounce + 1));
            if connects {
                recording.dispatch_indirect(packets.connect(), offset_of!(Control, shadow_groups), batch);
            }
        });
    }
}
