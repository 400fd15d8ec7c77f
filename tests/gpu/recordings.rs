//! Recordings on a device: transfers of any size come through, in the order of the commands, and launches take push
//! constants and sizes from wherever they are said to lie.

use crate::common::{assert_silent, device};
use bytemuck::Zeroable;
use raywave::constants::Specialization;
use raywave::gpu::{BufferRole, BufferUse, Device, Executor, ExecutorDescription};
use raywave::layout::{Batch, Control, Frame, RayCount};
use raywave::recording::Recording;
use raywave::shaders::{Access, Arithmetic, Edition, buffers, kernels};
use raywave_studies::stats::SplitMix64;

/// Bytes of two of the buffers: more than two submissions carry, and no whole number of their parts.
const LARGE: usize = (20 << 20) + 48;

/// The kernels that resolve and size launches, with their buffers.
fn executor(device: &Device) -> Executor {
    let specialization = Specialization { workgroup_size: 64, ..Specialization::DEFAULT }.words();
    let state = |name, size: usize| BufferRole { name, usage: BufferUse::State, size: size as u64, contents: None };
    let frame = BufferRole { usage: BufferUse::Uniform, ..state(buffers::FRAME, size_of::<Frame>()) };
    let description = ExecutorDescription {
        kernels: &[kernels::PREPARE_DISPATCH, kernels::RESOLVE],
        specialization: &specialization,
        buffers: vec![
            frame,
            state(buffers::RADIANCES, LARGE),
            state(buffers::FILM, LARGE),
            state(buffers::CONTROL, size_of::<Control>()),
            state(buffers::RAY_COUNTS, 64 * size_of::<RayCount>()),
        ],
        access: Access { texel_fetch: false, subgroup_ballot: false },
        edition: Edition::Plain,
        arithmetic: Arithmetic::Native,
        driver: None,
    };
    Executor::new(device, description).expect("the device has room for it")
}

#[test]
fn transfers_of_any_size_come_through_in_order() {
    let device = device();
    let mut executor = executor(&device);
    let mut random = SplitMix64::new(1);
    let bytes: Vec<u8> = (0..LARGE / 8).flat_map(|_| random.next_u64().to_le_bytes()).collect();
    let mut recording = Recording::default();
    recording.upload(buffers::RADIANCES, &bytes).download_first(buffers::RADIANCES, 20);
    recording.copy(buffers::RADIANCES, buffers::FILM, LARGE as u64 - 16).clear(buffers::RADIANCES);
    recording.upload(buffers::RADIANCES, &[7; 4]).download(buffers::FILM).download_first(buffers::RADIANCES, 8);
    let found = executor.run(&recording).expect("the device goes on");
    assert_eq!(found.len(), 3);
    assert_eq!(found[0], bytes[..20]);
    assert!(found[1][..LARGE - 16] == bytes[..LARGE - 16], "the copy is another");
    assert_eq!(found[1][LARGE - 16..], [0; 16], "buffers begin as zeros, and the copy ends where it should");
    assert_eq!(found[2], [7, 7, 7, 7, 0, 0, 0, 0]);

    // Parts are shown in order, and those of different downloads apart.
    let mut shown = [0, 0];
    let mut recording = Recording::default();
    recording.download(buffers::FILM).download_first(buffers::FILM, 1 << 20);
    let seen = executor.run_seen(&recording, |number, offset, part| {
        assert_eq!(offset, shown[number]);
        assert!(found[1][offset as usize..][..part.len()] == *part);
        shown[number] += part.len() as u64;
    });
    seen.expect("the device goes on");
    assert_eq!(shown, [LARGE as u64, 1 << 20]);
    drop(executor);
    assert_silent(&device);
}

#[test]
fn more_commands_than_a_submission_takes_are_all_run() {
    let device = device();
    let mut executor = executor(&device);
    let mut recording = Recording::default();
    // A chain: each launch moves what was appended to what is read.
    for rays in 1..=3000_u32 {
        let control = Control { next_rays: rays, ..Control::zeroed() };
        recording.upload(buffers::CONTROL, bytemuck::bytes_of(&control));
        recording.dispatch(kernels::PREPARE_DISPATCH, 1, &Batch { bounce: 5, ..Batch::zeroed() });
    }
    recording.download(buffers::CONTROL).download(buffers::RAY_COUNTS);
    let found = executor.run(&recording).expect("the device goes on");
    let control: Control = bytemuck::pod_read_unaligned(&found[0]);
    assert_eq!((control.current_rays, control.ray_groups[0]), (3000, 3000_u32.div_ceil(64)));
    let counts: Vec<RayCount> = bytemuck::pod_collect_to_vec(&found[1]);
    assert_eq!(counts[5].rays(), 3000 * 3001 / 2, "each launch saw its upload");
    assert_eq!(executor.kernel_times()[&("prepare_dispatch", 0)].launches, 3000);
    drop(executor);
    assert_silent(&device);
}

#[test]
fn a_launch_takes_its_size_from_any_buffer() {
    let device = device();
    let mut executor = executor(&device);
    let control = Control { next_rays: 9, ..Control::zeroed() };
    let sizes: [u32; 8] = [u32::MAX, u32::MAX, 0, 1, 1, 1, 1, 1];
    let launches = |groups: usize| {
        let mut recording = Recording::default();
        recording.upload(buffers::CONTROL, bytemuck::bytes_of(&control));
        recording.upload(buffers::FILM, bytemuck::cast_slice(&sizes));
        let size = (buffers::FILM, groups * size_of::<u32>());
        recording.dispatch_indirect(kernels::PREPARE_DISPATCH, size, &Batch::zeroed()).download(buffers::CONTROL);
        recording
    };
    for (place, rays) in [(2, 0), (3, 9)] {
        let found = executor.run(&launches(place)).expect("the device goes on");
        let control: Control = bytemuck::pod_read_unaligned(&found[0]);
        assert_eq!(control.current_rays, rays);
    }
    drop(executor);
    assert_silent(&device);
}

#[test]
#[should_panic(expected = "prepare_dispatch takes 28 bytes of push constants")]
fn push_constants_of_another_size_are_refused() {
    let device = device();
    let mut recording = Recording::default();
    recording.dispatch(kernels::PREPARE_DISPATCH, 1, &0_u32);
    drop(executor(&device).submit(&recording));
}
