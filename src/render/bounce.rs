//! The bounce scheduler: a kernel that takes paths through a whole bounce, a queue between bounces.

use std::mem::offset_of;
use std::ops::Range;

use super::plan::{Plan, SampleRange};
use crate::layout::Control;
use crate::recording::Recording;

/// Kernels that the recordings name.
pub const KERNELS: [&str; 2] = ["bounce", "prepare_dispatch"];

/// Takes every path through the bounces. Bounce 0 begins the paths, one in every slot.
pub fn advance(recording: &mut Recording, plan: &Plan, range: SampleRange, bounces: Range<u32>) {
    for bounce in bounces {
        let batch = range.at_bounce(bounce);
        if bounce == 0 {
            recording.dispatch("bounce", plan.groups(range.pixel_count * range.sample_count), batch);
        } else {
            recording.dispatch_indirect("bounce", offset_of!(Control, ray_groups), batch);
        }
        recording.dispatch("prepare_dispatch", 1, range.at_bounce(bounce + 1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Pass;

    const RANGE: SampleRange = SampleRange { first_pixel: 600, pixel_count: 100, first_sample: 4, sample_count: 3 };

    fn record(bounces: Range<u32>) -> Vec<Pass> {
        let plan = Plan { pixels: 1000, path_capacity: 300, workgroup_size: 64, paths_per_invocation: 1 };
        let mut recording = Recording::default();
        advance(&mut recording, &plan, RANGE, bounces);
        recording.passes
    }

    fn prepare(bounce: u32) -> Pass {
        Pass::Dispatch { kernel: "prepare_dispatch", groups: 1, batch: RANGE.at_bounce(bounce) }
    }

    #[test]
    fn the_host_sizes_the_first_launch_and_the_device_those_that_follow() {
        let arguments = offset_of!(Control, ray_groups) as u64;
        let following = |bounce| Pass::DispatchIndirect { kernel: "bounce", arguments, batch: RANGE.at_bounce(bounce) };
        // 300 paths in workgroups of 64.
        let first = Pass::Dispatch { kernel: "bounce", groups: 5, batch: RANGE.at_bounce(0) };
        assert_eq!(record(0..3), [first, prepare(1), following(1), prepare(2), following(2), prepare(3)]);
        assert_eq!(record(32..33), [following(32), prepare(33)]);
    }

    #[test]
    fn bounces_can_be_recorded_in_parts() {
        assert_eq!([record(0..2), record(2..5)].concat(), record(0..5));
    }
}
