//! The built-in box by every scheduler.

use super::bench::Bench;
use super::{Check, Finding, Verdict};
use raywave::render::{RenderError, Renderer};
use raywave::scene::Scene;
use raywave::settings::{Scheduler, Settings};

pub const CHECKS: &[Check] = &[Check {
    name: "box",
    checked: "the built-in Cornell box is the same image by every scheduler",
    spoils: "what a render shows hangs on how its work is cut into kernels",
    run: schedulers,
}];

/// The digest of the box on every device.
const EXPECTED: Option<&str> = Some("cd45b0caa9ad6518f39203ffdd6ee9546876fdff5c3d79a578230ee279dc1255");

const SCHEDULERS: [(Scheduler, &str); 3] =
    [(Scheduler::Wavefront, "wavefront"), (Scheduler::Bounce, "bounce"), (Scheduler::Megakernel, "megakernel")];

fn schedulers(bench: &Bench<'_>) -> Result<Finding, RenderError> {
    let scene = Scene::cornell_box();
    let settings = Settings { width: 96, height: 96, samples: 4, max_bounces: Some(6), ..scene.settings };
    let renderer = Renderer::new(bench.device)?;
    let mut digests = Vec::new();
    for (scheduler, name) in SCHEDULERS {
        let settings = Settings { scheduler: Some(scheduler), ..settings };
        digests.push((name, renderer.render(&scene, &settings)?.image().digest()));
    }
    Ok(judge(&digests, EXPECTED, u64::from(settings.width) * u64::from(settings.height)))
}

fn judge(digests: &[(&str, String)], expected: Option<&str>, pixels: u64) -> Finding {
    let first = digests[0].1.as_str();
    let are_equal = digests.iter().all(|(_, digest)| digest == first);
    let list = || digests.iter().map(|(name, digest)| format!("{name} {digest}")).collect::<Vec<_>>().join(", ");
    let (verdict, found) = match expected {
        _ if !are_equal => (Verdict::Off, list()),
        Some(expected) if expected != first => (Verdict::Off, format!("{first} by all, for {expected}")),
        _ => (Verdict::Ok, format!("{first} by all")),
    };
    let finding = Finding::new(pixels * digests.len() as u64, verdict, found);
    digests.iter().fold(finding, |finding, (name, digest)| finding.with(name, digest.as_str()))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use raywave::image::Image;

    use super::*;

    #[test]
    fn digests_must_be_equal_and_as_expected() {
        let of = |digests: [&str; 3]| ["a", "b", "c"].into_iter().zip(digests.map(str::to_owned)).collect::<Vec<_>>();
        assert_eq!(judge(&of(["1", "1", "1"]), None, 1).verdict, Verdict::Ok);
        assert_eq!(judge(&of(["1", "1", "2"]), None, 1).verdict, Verdict::Off);
        assert_eq!(judge(&of(["1", "1", "1"]), Some("1"), 1).verdict, Verdict::Ok);
        assert_eq!(judge(&of(["1", "1", "1"]), Some("2"), 1).verdict, Verdict::Off);
    }

    #[test]
    fn a_digest_is_of_every_bit() {
        let image = |x| Image::new(1, 2, vec![Vec3::ONE, Vec3::new(0.5, 0.25, x)]);
        assert_eq!(image(0.125).digest(), image(0.125).digest());
        assert_ne!(image(0.125).digest(), image(0.125_f32.next_up()).digest());
        assert_ne!(image(0.0).digest(), image(-0.0).digest());
    }
}
