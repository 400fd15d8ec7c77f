//! Every variant of the kernels renders the same bits: by texels or as storage buffers, with
//! ballots or without.

use std::ops::ControlFlow;

use crate::common::{self, own_scene};
use glam::DVec3;
use raywave::gpu::Device;
use raywave::render::{PreparedScene, Session, SessionOptions};
use raywave::scene::Scene;
use raywave::settings::{Fetch, Settings};
use raywave::shaders::Access;

fn render(device: &Device, scene: &Scene, access: Access) -> (Vec<DVec3>, Vec<DVec3>, u64) {
    // Small, but of more than one batch.
    let settings = Settings {
        width: 64,
        height: 64,
        samples: 4,
        max_bounces: Some(6),
        roulette: 0.1,
        in_flight: Some(6000),
        ..scene.settings
    };
    let prepared = PreparedScene::new(scene).expect("the scene fits");
    let mut session = Session::with_options(
        device,
        &prepared,
        &settings,
        SessionOptions { access: Some(access), ..SessionOptions::default() },
    )
    .expect("the session starts");
    let outcome = session.render(|_| ControlFlow::Continue(())).expect("the render ends");
    // A scene may have more texels than the device can address.
    let words = prepared.buffers(true).into_iter().map(|buffer| buffer.size / 8).max();
    if words <= Some(device.description().max_texel_buffer_elements) {
        assert_eq!(outcome.statistics.choices.fetch == Fetch::Texel, access.texel_fetch);
    }
    (outcome.film.sum, outcome.film.sum_of_squares, outcome.statistics.rays())
}

#[test]
fn all_variants_render_the_same_bits() {
    let device = common::device();
    for name in ["cornell-glass", "cornell-phong", "textured-sky", "smooth"] {
        let scene = own_scene(name);
        let accesses = [(true, true), (true, false), (false, true), (false, false)]
            .map(|(texel_fetch, subgroup_ballot)| Access { texel_fetch, subgroup_ballot });
        let first = render(&device, &scene, accesses[0]);
        assert!(first.0.iter().any(|sum| *sum != DVec3::ZERO));
        for access in &accesses[1..] {
            assert!(render(&device, &scene, *access) == first, "{name} differs with {access:?}");
        }
    }
    common::assert_silent(&device);
}
