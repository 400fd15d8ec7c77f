//! The bounce scheduler: a kernel that takes paths to their next surface and shades it, a queue between bounces.

use std::mem::offset_of;
use std::ops::Range;

use super::plan::SampleRange;
use crate::layout::Control;
use crate::recording::Recording;
use crate::settings::Packets;

/// Kernels that the recordings name. `connects` is whether shadow rays are queued.
pub fn kernels(packets: Packets, connects: bool) -> Vec<&'static str> {
    let mut all = vec!["generate", "prepare_dispatch", "resolve"];
    all.extend(packets.kernels("bounce", "bounce_packets"));
    all.extend(connects.then(|| packets.connect()));
    all
}

/// Takes every path through the bounces.
pub fn advance(recording: &mut Recording, packets: Packets, connects: bool, range: SampleRange, bounces: Range<u32>) {
    for bounce in bounces {
        recording.bounce(bounce, |recording| {
            let batch = range.at_bounce(bounce);
            let kernel = packets.kernel_at(bounce, "bounce", "bounce_packets");
            recording.dispatch_indirect(kernel, offset_of!(Control, ray_groups), batch);
            recording.dispatch("prepare_dispatch", 1, range.at_bounce(bounce + 1));
            if connects {
                recording.dispatch_indirect(packets.connect(), offset_of!(Control, shadow_groups), batch);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Pass;

    const RANGE: SampleRange =
        SampleRange { first_pixel: 600, pixel_count: 100, first_sample: 4, sample_count: 3, film_pixel: 200 };

    /// Kernels and bounces of the passes, and where the indirect ones find their counts.
    fn record(packets: Packets, connects: bool, bounces: Range<u32>) -> Vec<(&'static str, u32, Option<u64>)> {
        let mut recording = Recording::default();
        advance(&mut recording, packets, connects, RANGE, bounces);
        let told = |pass: Pass| match pass {
            Pass::Dispatch { kernel, groups, batch, .. } => {
                assert_eq!((groups, batch), (1, RANGE.at_bounce(batch.bounce)));
                (kernel, batch.bounce, None)
            }
            Pass::DispatchIndirect { kernel, arguments, batch, of_bounce } => {
                assert_eq!((batch, of_bounce), (RANGE.at_bounce(batch.bounce), Some(batch.bounce)));
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
        let none = Packets::default();
        assert_eq!(record(none, false, 0..2), [bounce(0), bounce(1)].concat());
        let connect = |bounce| ("connect", bounce, shadow_rays);
        let expected = [&bounce(0)[..], &[connect(0)], &bounce(1), &[connect(1)]].concat();
        assert_eq!(record(none, true, 0..2), expected);
    }

    #[test]
    fn bounces_can_be_recorded_in_parts() {
        for connects in [true, false] {
            let parts = [0..32, 32..40].map(|bounces| record(Packets::default(), connects, bounces));
            assert_eq!(parts.concat(), record(Packets::default(), connects, 0..40));
        }
    }

    #[test]
    fn every_kernel_that_is_recorded_is_built() {
        for text in ["none", "camera", "bounce+shadow", "camera+bounce+shadow"] {
            let packets: Packets = text.parse().unwrap();
            assert_eq!(packets.to_string(), text);
            for connects in [true, false] {
                let built = kernels(packets, connects);
                let recorded = record(packets, connects, 0..2);
                assert!(recorded.iter().all(|(kernel, ..)| built.contains(kernel)));
                assert_eq!(
                    recorded.iter().any(|(kernel, ..)| kernel.ends_with("_packets")),
                    packets != Packets::default() && (connects || text != "shadow")
                );
            }
        }
        assert!(!kernels(Packets::default(), false).contains(&"connect"));
    }
}
