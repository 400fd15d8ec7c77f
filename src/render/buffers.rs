//! Buffers of a render by their GLSL names, with their sizes: arithmetic without a device.

use super::plan::Plan;
use super::prepare::{Needs, PreparedScene, SceneBuffer};
use crate::constants::{COUNTED_BOUNCES, STAGES};
use crate::gpu::{BufferRole, BufferUse};
use crate::layout::{Bins, Control, Frame, RayCount, WorkCount};
use crate::settings::{Settings, Sort};
use crate::shaders::buffers;

/// Buffers that the scene fills.
pub fn scene_buffers<'a>(
    scene: &'a PreparedScene,
    settings: &Settings,
    frame: &'a Frame,
) -> impl Iterator<Item = BufferRole<'a>> {
    let bytes = bytemuck::cast_slice::<Frame, u8>(std::slice::from_ref(frame));
    let uniform =
        BufferRole { name: buffers::FRAME, usage: BufferUse::Uniform, size: bytes.len() as u64, contents: Some(bytes) };
    let data = |SceneBuffer { name, texel_bytes, contents, size }| BufferRole {
        name,
        usage: BufferUse::Scene { texel_bytes },
        size,
        contents: (!contents.is_empty()).then_some(contents),
    };
    std::iter::once(uniform).chain(scene.buffers(settings.specialize).into_iter().map(data))
}

/// Buffers with a record for each path in flight, or of stacks for each invocation: bytes of a record.
pub(super) fn path_records(sort: Sort, needs: &Needs) -> [(&'static str, u64); 14] {
    let if_two_levels = |bytes| if needs.two_levels { bytes } else { 0 };
    [
        // Two halves, but for paths that go on nowhere.
        (buffers::RAY_QUEUE, if needs.scatters { 8 } else { 4 }),
        (buffers::RAY_ORIGINS, 16),
        (buffers::RAY_DIRECTIONS, 16),
        (buffers::THROUGHPUTS, 16),
        (buffers::RADIANCES, 16),
        (buffers::HITS, 16),
        (buffers::SHADOW_ORIGINS, 16),
        (buffers::SHADOW_DIRECTIONS, 16),
        (buffers::SHADOW_RADIANCES, 16),
        (buffers::RAY_INSTANCES, if_two_levels(4)),
        (buffers::HIT_INSTANCES, if_two_levels(4)),
        (buffers::SHADOW_INSTANCES, if_two_levels(8)),
        (buffers::STACK_BLOCKS, needs.stack_bytes(1)),
        (buffers::SORTED_RAYS, if sort == Sort::None { 0 } else { 4 }),
    ]
}

/// Buffers of the paths in flight and of the film.
pub(super) fn path_buffers<'a>(plan: &Plan, sort: Sort, needs: &Needs) -> impl Iterator<Item = BufferRole<'a>> {
    let state = |name, size| BufferRole { name, usage: BufferUse::State, size, contents: None };
    let records_of = |name| if name == buffers::STACK_BLOCKS { plan.stacks() } else { u64::from(plan.path_capacity) };
    // Kernels that do not sort bind one entry of the sorted queue, and never read it.
    let records = path_records(sort, needs).map(|(name, bytes)| state(name, (bytes * records_of(name)).max(16)));
    let shared = [
        state(buffers::CONTROL, size_of::<Control>() as u64),
        state(buffers::BINS, size_of::<Bins>() as u64),
        state(buffers::WORK_COUNTS, u64::from(STAGES * COUNTED_BOUNCES) * size_of::<WorkCount>() as u64),
        state(buffers::RAY_COUNTS, u64::from(COUNTED_BOUNCES) * size_of::<RayCount>() as u64),
        state(buffers::FILM, plan.film_bytes()),
    ];
    records.into_iter().chain(shared)
}
