//! Submissions of an executor: command buffers that are recorded with their barriers and timestamps, handed over, and
//! waited for.

use std::time::Instant;

use ash::vk;

use super::buffer::Buffer;
use super::error::{Action, GpuError};
use super::executor::Executor;
use super::hazards::Hazards;
use super::steps::{Downloaded, Step};
use super::times::{FIRST_STEP, Launched};
use crate::recording::{Dispatch, Workgroups};

/// Steps of a submission, at most: each has a timestamp.
pub(super) const MAX_STEPS: usize = 2048;
/// Submissions that the device may have at once.
pub(super) const SLOTS: usize = 2;

/// A command buffer that is free or on its way.
pub(super) struct Slot {
    pub commands: vk::CommandBuffer,
    pub fence: vk::Fence,
    pub queries: vk::QueryPool,
    /// The steps in flight, one per timestamp from [`FIRST_STEP`] on.
    pub pending: Option<Vec<Option<Launched>>>,
    /// What it brings back.
    pub downloads: Vec<Downloaded>,
    /// When it was submitted.
    pub start: Instant,
    /// Where the device leaves the counts that a trace wants.
    pub counts: Option<Buffer>,
}

/// Sees what is brought back: the number of the download, where the part begins in the buffer, and its bytes.
pub(super) type Show<'a> = dyn FnMut(usize, u64, &[u8]) + 'a;

impl Slot {
    /// Whether what is under way has launches.
    fn launches(&self) -> bool {
        self.pending.iter().flatten().any(Option::is_some)
    }
}

impl Executor {
    /// Makes the command buffers, each with a fence and its timestamps.
    pub(super) fn make_slots(&mut self) -> Result<(), GpuError> {
        let device = &self.device.raw;
        let info = vk::CommandPoolCreateInfo::default()
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER)
            .queue_family_index(self.device.description.queue_family);
        // SAFETY: the family is the device's own.
        self.command_pool = unsafe { device.create_command_pool(&info, None) }.during("making a command pool")?;
        let labels = &self.device.labels;
        labels.name(self.command_pool, format_args!("submissions"));
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(self.command_pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(SLOTS as u32);
        // SAFETY: the pool was just made.
        let buffers = unsafe { device.allocate_command_buffers(&info) }.during("making command buffers")?;
        for (number, commands) in buffers.into_iter().enumerate() {
            let info = vk::QueryPoolCreateInfo::default()
                .query_type(vk::QueryType::TIMESTAMP)
                .query_count((MAX_STEPS + FIRST_STEP) as u32 + 1);
            // SAFETY: the infos are complete; `drop` destroys what was made.
            let (fence, queries) = unsafe {
                (
                    device.create_fence(&vk::FenceCreateInfo::default(), None).during("making a fence")?,
                    device.create_query_pool(&info, None).during("making a query pool")?,
                )
            };
            labels.name(commands, format_args!("submission {number}"));
            labels.name(fence, format_args!("end of submission {number}"));
            labels.name(queries, format_args!("timestamps of submission {number}"));
            self.slots.push(Slot {
                commands,
                fence,
                queries,
                pending: None,
                downloads: Vec::new(),
                start: Instant::now(),
                counts: None,
            });
        }
        Ok(())
    }

    /// The slot that was submitted before the others, waited for.
    pub(super) fn free_slot(&mut self, show: &mut Show<'_>) -> Result<usize, GpuError> {
        let slot = self.next_slot;
        self.next_slot = (slot + 1) % SLOTS;
        self.finish(slot, show)?;
        Ok(slot)
    }

    /// Records steps into a free slot. Those of a submission without a launch are not timed.
    pub(super) fn record(&mut self, slot: usize, steps: &[Step<'_>]) -> Result<(), GpuError> {
        let launches = steps.iter().any(|step| step.dispatch().is_some());
        let _stage = launches.then(|| self.device.stages().begin("record"));
        self.put_uploads(slot, steps);
        let (device, labels) = (&self.device.raw, &self.device.labels);
        let Slot { commands, queries, .. } = self.slots[slot];
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let timestamps = (FIRST_STEP + steps.len() + 1) as u32;
        let end = vk::PipelineStageFlags::BOTTOM_OF_PIPE;
        // SAFETY: the slot is free, and the pool has room for a timestamp of each step that a submission may have.
        let stamp = |stage, query| unsafe {
            if launches {
                device.cmd_write_timestamp(commands, stage, queries, query);
            }
        };
        // SAFETY: the slot is free; sets, layout and pool are alive until the executor is dropped.
        unsafe {
            device.begin_command_buffer(commands, &begin).during("recording commands")?;
            if launches {
                device.cmd_reset_query_pool(commands, queries, 0, timestamps);
                device.cmd_bind_descriptor_sets(
                    commands,
                    vk::PipelineBindPoint::COMPUTE,
                    self.pipelines.layout,
                    0,
                    &self.resources.sets,
                    &[],
                );
            }
        }
        stamp(vk::PipelineStageFlags::TOP_OF_PIPE, 0);
        // What earlier submissions wrote is seen by this one.
        self.barrier(commands);
        stamp(end, 1);
        let mut hazards = Hazards::default();
        let mut before = None;
        for (query, step) in (FIRST_STEP as u32..).zip(steps) {
            let bindings = step.dispatch().map(|dispatch| self.pipelines.get(dispatch.kernel.name).bindings.as_slice());
            if hazards.needs_barrier(&step.accesses(bindings.unwrap_or_default())) {
                self.barrier(commands);
            }
            labels.between(commands, before.replace(step), Some(step));
            self.encode(commands, slot, step);
            stamp(end, query);
        }
        labels.between(commands, before, None);
        self.barrier(commands);
        stamp(end, timestamps - 1);
        let downloads = steps.iter().filter_map(|step| match step {
            Step::Download(part) => Some(*part),
            _ => None,
        });
        let downloads: Vec<_> = downloads.collect();
        let mut host_reads = !downloads.is_empty();
        if let (Some(tracing), Some(counts), true) = (&self.times.tracing, &self.slots[slot].counts, launches) {
            let regions = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: counts.size }];
            let source = self.resources.buffer(tracing.counts);
            // SAFETY: both buffers are alive and as large as the region; the host has read what was there before.
            unsafe { device.cmd_copy_buffer(commands, source, counts.raw, &regions) };
            host_reads = true;
        }
        if host_reads {
            self.host_barrier(commands);
        }
        // SAFETY: recording was begun above.
        unsafe { device.end_command_buffer(commands) }.during("recording commands")?;
        let launched = |Dispatch { kernel, bounce, .. }: &Dispatch| Launched { kernel: kernel.name, bounce: *bounce };
        self.slots[slot].pending = Some(steps.iter().map(|step| step.dispatch().map(launched)).collect());
        self.slots[slot].downloads = downloads;
        Ok(())
    }

    /// Puts what a submission uploads where the device takes it from.
    fn put_uploads(&mut self, slot: usize, steps: &[Step<'_>]) {
        for step in steps {
            if let Step::Upload { staged_at, contents: Some(contents), .. } = step {
                self.resources.staged(slot)[*staged_at as usize..][..contents.len()].copy_from_slice(contents);
            }
        }
    }

    /// Records one step.
    fn encode(&self, commands: vk::CommandBuffer, slot: usize, step: &Step<'_>) {
        let (device, resources) = (&self.device.raw, &self.resources);
        let carried_at = slot as u64 * resources.carried;
        let copy = |from, src_offset, to, dst_offset, size| {
            let regions = [vk::BufferCopy { src_offset, dst_offset, size }];
            // SAFETY: both buffers are alive and have transfer usage, and the region lies in both.
            unsafe { device.cmd_copy_buffer(commands, from, to, &regions) };
        };
        match *step {
            Step::Dispatch(dispatch) => self.dispatch(commands, dispatch),
            Step::Upload { buffer, offset, staged_at, bytes, .. } => {
                copy(resources.staging.raw, carried_at + staged_at, resources.buffer(buffer), offset, bytes);
            }
            // SAFETY: the buffer is alive and has transfer usage.
            Step::Clear { buffer } => unsafe {
                device.cmd_fill_buffer(commands, resources.buffer(buffer), 0, vk::WHOLE_SIZE, 0);
            },
            Step::Copy { from, to, bytes } => copy(resources.buffer(from), 0, resources.buffer(to), 0, bytes),
            Step::Download(Downloaded { buffer, offset, at, bytes, .. }) => {
                copy(resources.buffer(buffer), offset, resources.readback.raw, carried_at + at, bytes);
            }
        }
    }

    /// Records a launch.
    fn dispatch(&self, commands: vk::CommandBuffer, dispatch: &Dispatch) {
        let (device, layout) = (&self.device.raw, self.pipelines.layout);
        let Dispatch { kernel, workgroups, constants, .. } = dispatch;
        let built = self.pipelines.get(kernel.name);
        let takes = built.push_constant_size as usize;
        assert!(takes == 0 || takes == constants.len(), "{} takes {takes} bytes of push constants", kernel.name);
        // SAFETY: the pipeline belongs to the layout that is bound, whose range holds the kernel's push constants; a buffer
        // of state has indirect usage, and its size holds the arguments.
        unsafe {
            device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, built.pipeline);
            if takes > 0 {
                device.cmd_push_constants(commands, layout, vk::ShaderStageFlags::COMPUTE, 0, constants);
            }
            match *workgroups {
                Workgroups::Direct(groups) => device.cmd_dispatch(commands, groups, 1, 1),
                Workgroups::Indirect { buffer, offset } => {
                    assert!(offset + 12 <= self.resources.size(buffer), "{buffer} holds the size of a launch");
                    device.cmd_dispatch_indirect(commands, self.resources.buffer(buffer), offset);
                }
            }
        }
    }

    /// Makes all that was written visible to all that follows.
    fn barrier(&self, commands: vk::CommandBuffer) {
        let stages = vk::PipelineStageFlags::COMPUTE_SHADER | vk::PipelineStageFlags::TRANSFER;
        let barriers = [vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::SHADER_WRITE | vk::AccessFlags::TRANSFER_WRITE)
            .dst_access_mask(
                vk::AccessFlags::SHADER_READ
                    | vk::AccessFlags::SHADER_WRITE
                    | vk::AccessFlags::UNIFORM_READ
                    | vk::AccessFlags::INDIRECT_COMMAND_READ
                    | vk::AccessFlags::TRANSFER_READ
                    | vk::AccessFlags::TRANSFER_WRITE,
            )];
        // SAFETY: the command buffer is being recorded.
        unsafe {
            self.device.raw.cmd_pipeline_barrier(
                commands,
                stages | vk::PipelineStageFlags::DRAW_INDIRECT,
                stages | vk::PipelineStageFlags::DRAW_INDIRECT,
                vk::DependencyFlags::empty(),
                &barriers,
                &[],
                &[],
            );
        }
    }

    /// Lets the host read what a copy wrote.
    fn host_barrier(&self, commands: vk::CommandBuffer) {
        let barriers = [vk::MemoryBarrier::default()
            .src_access_mask(vk::AccessFlags::TRANSFER_WRITE)
            .dst_access_mask(vk::AccessFlags::HOST_READ)];
        // SAFETY: the command buffer is being recorded.
        unsafe {
            self.device.raw.cmd_pipeline_barrier(
                commands,
                vk::PipelineStageFlags::TRANSFER,
                vk::PipelineStageFlags::HOST,
                vk::DependencyFlags::empty(),
                &barriers,
                &[],
                &[],
            );
        }
    }

    /// Hands a recorded slot to the device.
    pub(super) fn launch(&mut self, slot: usize) -> Result<(), GpuError> {
        let is_recording = self.slots[slot].launches();
        let _stage = self.device.stages().begin("submit");
        let Slot { commands, fence, .. } = self.slots[slot];
        let buffers = [commands];
        let submits = [vk::SubmitInfo::default().command_buffers(&buffers)];
        self.slots[slot].start = Instant::now();
        let result = if self.device.is_lost(is_recording) {
            Err(vk::Result::ERROR_DEVICE_LOST)
        } else {
            let queue = self.device.queue.lock().expect("no thread panics while it submits");
            // SAFETY: the command buffer is complete, the fence is unsignalled, and the lock keeps
            // other threads from the queue.
            unsafe { self.device.raw.queue_submit(*queue, &submits, fence) }
        };
        let result = self.lost(slot, result, "submitting commands");
        if result.is_err() {
            // Nothing is under way that would signal the fence.
            self.slots[slot].pending = None;
        }
        result
    }

    /// Waits for a slot, gathers its times and shows what it has brought back.
    pub(super) fn finish(&mut self, slot: usize, show: &mut Show<'_>) -> Result<(), GpuError> {
        let Slot { fence, queries, start, .. } = self.slots[slot];
        if self.slots[slot].pending.is_none() {
            return Ok(());
        }
        let waiting = self.device.stages().begin("wait");
        // SAFETY: the fence was submitted with the pending commands.
        let result = unsafe { self.device.raw.wait_for_fences(&[fence], true, u64::MAX) };
        self.lost(slot, result, "waiting for the device")?;
        drop(waiting);
        // SAFETY: the fence is signalled and nothing waits for it.
        unsafe { self.device.raw.reset_fences(&[fence]) }.during("resetting a fence")?;
        let is_recording = self.slots[slot].launches();
        let steps = self.slots[slot].pending.take().unwrap_or_default();
        let host_seconds = start.max(self.times.last_end).elapsed().as_secs_f64();
        self.times.last_end = Instant::now();
        if is_recording {
            let mut ticks = vec![0_u64; if self.has_clock() { FIRST_STEP + steps.len() + 1 } else { 0 }];
            if self.has_clock() {
                let flags = vk::QueryResultFlags::TYPE_64;
                // SAFETY: the commands that wrote these queries are complete.
                unsafe { self.device.raw.get_query_pool_results(queries, 0, &mut ticks, flags) }
                    .during("reading timestamps")?;
            }
            self.times.note(&self.device, &steps, &ticks, host_seconds);
            if let Some(counts) = &mut self.slots[slot].counts {
                let counts = counts.bytes().to_vec();
                self.times.trace(&steps, &ticks, start, counts)?;
            }
        }
        for Downloaded { number, offset, at, bytes, .. } in std::mem::take(&mut self.slots[slot].downloads) {
            show(number, offset, &self.resources.brought(slot)[at as usize..][..bytes as usize]);
        }
        Ok(())
    }

    /// Names what ran when the device was lost.
    fn lost(&self, slot: usize, result: Result<(), vk::Result>, action: &'static str) -> Result<(), GpuError> {
        result.map_err(|result| match result {
            vk::Result::ERROR_DEVICE_LOST => {
                let steps = self.slots[slot].pending.iter().flatten().flatten();
                let mut kernels: Vec<_> = steps.map(|launched| launched.kernel).collect();
                kernels.sort_unstable();
                kernels.dedup();
                let pass = if kernels.is_empty() { "a copy".to_owned() } else { kernels.join(", ") };
                GpuError::DeviceLost { pass }
            }
            result => GpuError::Vulkan { action, result },
        })
    }

    /// Records, runs and awaits commands that are no recording. Nothing else is under way.
    pub(super) fn run_once(&mut self, fill: impl FnOnce(&ash::Device, vk::CommandBuffer)) -> Result<(), GpuError> {
        let slot = self.free_slot(&mut |_, _, _| ())?;
        let commands = self.slots[slot].commands;
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the slot is free.
        unsafe { self.device.raw.begin_command_buffer(commands, &begin) }.during("recording commands")?;
        self.barrier(commands);
        fill(&self.device.raw, commands);
        // SAFETY: recording was begun above.
        unsafe { self.device.raw.end_command_buffer(commands) }.during("recording commands")?;
        self.slots[slot].pending = Some(Vec::new());
        self.launch(slot)?;
        self.wait()
    }
}
