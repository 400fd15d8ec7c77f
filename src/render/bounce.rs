//! The bounce scheduler: a kernel that takes paths to their next surface and shades it, a queue between bounces.

use std::mem::offset_of;
use std::ops::Range;

use super::plan::SampleRange;
use super::settings::ShadowRays;
use crate::layout::Control;
use crate::recording::Recording;

/// Kernels that the recordings name.
pub fn kernels(shadow_rays: ShadowRays) -> Vec<&'static str> {
    let tracing: &[&str] = match shadow_rays {
        ShadowRays::Deferred => &["connect"],
        ShadowRays::AtOnce => &[],
    };
    ["generate", "bounce", "prepare_dispatch", "resolve"].iter().chain(tracing).copied().collect()
}

/// Takes every path through the bounces.
pub fn advance(recording: &mut Recording, shadow_rays: ShadowRays, range: SampleRange, bounces: Range<u32>) {
    for bounce in bounces {
        let batch = range.at_bounce(bounce);
        recording.dispatch_indirect("bounce", offset_of!(Control, ray_groups), batch);
        recording.dispatch("prepare_dispatch", 1, range.at_bounce(bounce + 1));
        if shadow_rays == ShadowRays::Deferred {
            recording.dispatch_indirect("connect", offset_of!(Control, shadow_groups), batch);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Pass;

    const RANGE: SampleRange = SampleRange { first_pixel: 600, pixel_count: 100, first_sample: 4, sample_count: 3 };

    /// Kernels and bounces of the passes, and where the indirect ones find their counts.
    fn record(shadow_rays: ShadowRays, bounces: Range<u32>) -> Vec<(&'static str, u32, Option<u64>)> {
        let mut recording = Recording::default();
        advance(&mut recording, shadow_rays, RANGE, bounces);
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
        assert_eq!(record(ShadowRays::AtOnce, 0..2), [bounce(0), bounce(1)].concat());
        let connect = |bounce| ("connect", bounce, shadow_rays);
        let expected = [&bounce(0)[..], &[connect(0)], &bounce(1), &[connect(1)]].concat();
        assert_eq!(record(ShadowRays::Deferred, 0..2), expected);
    }

    #[test]
    fn bounces_can_be_recorded_in_parts() {
        for shadow_rays in [ShadowRays::Deferred, ShadowRays::AtOnce] {
            let parts = [0..32, 32..40].map(|bounces| record(shadow_rays, bounces));
            assert_eq!(parts.concat(), record(shadow_rays, 0..40));
        }
    }

    #[test]
    fn every_kernel_that_is_recorded_is_built() {
        for shadow_rays in [ShadowRays::Deferred, ShadowRays::AtOnce] {
            let built = kernels(shadow_rays);
            assert!(record(shadow_rays, 0..1).iter().all(|(kernel, ..)| built.contains(kernel)));
        }
        assert!(!kernels(ShadowRays::AtOnce).contains(&"connect"));
    }
}
