//! The bounce scheduler: a kernel that takes paths to their next surface and shades it, a queue between bounces.

use std::mem::offset_of;
use std::ops::Range;

use super::plan::SampleRange;
use crate::layout::Control;
use crate::recording::Recording;

/// Kernels that the recordings name. `connects` is whether shadow rays are queued.
pub fn kernels(connects: bool) -> Vec<&'static str> {
    let connecting: &[&str] = if connects { &["connect"] } else { &[] };
    ["generate", "bounce", "prepare_dispatch", "resolve"].iter().chain(connecting).copied().collect()
}

/// Takes every path through the bounces.
pub fn advance(recording: &mut Recording, connects: bool, range: SampleRange, bounces: Range<u32>) {
    for bounce in bounces {
        let batch = range.at_bounce(bounce);
        recording.dispatch_indirect("bounce", offset_of!(Control, ray_groups), batch);
        recording.dispatch("prepare_dispatch", 1, range.at_bounce(bounce + 1));
        if connects {
            recording.dispatch_indirect("connect", offset_of!(Control, shadow_groups), batch);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Pass;

    const RANGE: SampleRange =
        SampleRange { first_pixel: 600, pixel_count: 100, first_sample: 4, sample_count: 3, film_pixel: 200 };

    /// Kernels and bounces of the passes, and where the indirect ones find their counts.
    fn record(connects: bool, bounces: Range<u32>) -> Vec<(&'static str, u32, Option<u64>)> {
        let mut recording = Recording::default();
        advance(&mut recording, connects, RANGE, bounces);
        let told = |pass: Pass| match pass {
            Pass::Dispatch { kernel, groups, batch } => {
                assert_eq!((groups, batch), (1, RANGE.at_bounce(batch.bounce)));
                (kernel, batch.bounce, None)
            }
            Pass::DispatchIndirect { kernel, arguments, batch } => {
                assert_eq!(batch, RANGE.at_bounce(batch.bounce));
                (kernel, batch.bounce, Some(arguments))
            }
        };
        recording.passes.into_iter().map(told).collect()
    }

    #[test]
    fn rays_are_counted_before_they_are_traced() {
        let rays = Some(offset_of!(Control, ray_groups) as u64);
        let shadow_rays = Some(offset_of!(Control, shadow_groups) as u64);
        let bounce = |bounce| [("bounce", bounce, rays), ("prepare_dispatch", bounce + 1, None)];
        assert_eq!(record(false, 0..2), [bounce(0), bounce(1)].concat());
        let connect = |bounce| ("connect", bounce, shadow_rays);
        let expected = [&bounce(0)[..], &[connect(0)], &bounce(1), &[connect(1)]].concat();
        assert_eq!(record(true, 0..2), expected);
    }

    #[test]
    fn bounces_can_be_recorded_in_parts() {
        for connects in [true, false] {
            let parts = [0..32, 32..40].map(|bounces| record(connects, bounces));
            assert_eq!(parts.concat(), record(connects, 0..40));
        }
    }

    #[test]
    fn every_kernel_that_is_recorded_is_built() {
        for connects in [true, false] {
            let built = kernels(connects);
            assert!(record(connects, 0..1).iter().all(|(kernel, ..)| built.contains(kernel)));
        }
        assert!(!kernels(false).contains(&"connect"));
    }
}
