//! Buffers of a render by their GLSL names, with their sizes: arithmetic without a device.

use super::plan::Plan;
use super::prepare::{Needs, PreparedScene, SceneBuffer};
use super::settings::{Settings, Sort};
use crate::constants::{COUNTED_BOUNCES, STAGES};
use crate::gpu::{BufferRole, BufferUse};
use crate::layout::{Bins, Control, Frame, RayCount, WorkCount};

/// Buffers that the scene fills.
pub fn scene_buffers<'a>(
    scene: &'a PreparedScene,
    settings: &Settings,
    frame: &'a Frame,
) -> impl Iterator<Item = BufferRole<'a>> {
    let bytes = bytemuck::cast_slice::<Frame, u8>(std::slice::from_ref(frame));
    let uniform =
        BufferRole { name: "frame", usage: BufferUse::Uniform, size: bytes.len() as u64, contents: Some(bytes) };
    let data = |SceneBuffer { name, texel_bytes, contents, size }| BufferRole {
        name,
        usage: BufferUse::Scene { texel_bytes },
        size,
        contents: (!contents.is_empty()).then_some(contents),
    };
    std::iter::once(uniform).chain(scene.buffers(settings.specialize).into_iter().map(data))
}

/// Buffers with a record for each path in flight, or of stacks for each invocation: bytes of a record.
pub(super) fn path_records(sort: Sort, needs: &Needs) -> [(&'static str, u64); 11] {
    [
        // Two halves, but for paths that go on nowhere.
        ("ray_queue", if needs.scatters { 8 } else { 4 }),
        ("ray_origins", 16),
        ("ray_directions", 16),
        ("throughputs", 16),
        ("radiances", 16),
        ("hits", 16),
        ("shadow_origins", 16),
        ("shadow_directions", 16),
        ("shadow_radiances", 16),
        ("stack_blocks", needs.stack_bytes(1)),
        ("sorted_rays", if sort == Sort::None { 0 } else { 4 }),
    ]
}

/// Buffers of the paths in flight and of the film.
pub(super) fn path_buffers<'a>(plan: &Plan, sort: Sort, needs: &Needs) -> impl Iterator<Item = BufferRole<'a>> {
    let state = |name, size| BufferRole { name, usage: BufferUse::State, size, contents: None };
    let records_of = |name| if name == "stack_blocks" { plan.stacks() } else { u64::from(plan.path_capacity) };
    // Kernels that do not sort bind one entry of the sorted queue, and never read it.
    let records = path_records(sort, needs).map(|(name, bytes)| state(name, (bytes * records_of(name)).max(16)));
    let shared = [
        state("control", size_of::<Control>() as u64),
        state("bins", size_of::<Bins>() as u64),
        state("work_counts", u64::from(STAGES * COUNTED_BOUNCES) * size_of::<WorkCount>() as u64),
        state("ray_counts", u64::from(COUNTED_BOUNCES) * size_of::<RayCount>() as u64),
        state("film", plan.film_bytes()),
    ];
    records.into_iter().chain(shared)
}
