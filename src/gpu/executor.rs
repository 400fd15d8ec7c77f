//! Runs recordings with buffers and pipelines of its own: what they are made from, and what can be asked of them.

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use ash::vk;
use gpu_allocator::MemoryLocation;

use super::buffer::Buffer;
use super::clock::{Alignment, Clock};
use super::device::{Device, Shared};
use super::error::GpuError;
use super::executables::{CompiledKernel, compiled_kernels};
use super::memory::{MemoryLimits, MemoryPlan, plan_memory};
use super::pipeline::Pipelines;
use super::resources::{Resources, carried_bytes};
use super::roles::BufferRole;
use super::steps::{Room, Step, submissions};
use super::submit::{MAX_STEPS, SLOTS, Show, Slot};
use super::times::{Idle, KernelTime, Times, TracedSubmission, Tracing};
use crate::recording::{Command, Recording};
use crate::shaders::{Access, Arithmetic, Build, Edition, Kernel, Library, Specialized, portable_library};
use crate::trace::Stages;

/// What an executor is made from.
pub struct ExecutorDescription<'a> {
    /// Kernels that recordings will name.
    pub kernels: &'a [&'static Kernel],
    /// Specialization constants by id.
    pub specialization: &'a [u32],
    /// Every buffer that the kernels bind. One that no kernel binds as it is specialized is not made.
    pub buffers: Vec<BufferRole<'a>>,
    /// How kernels are to reach memory, as far as the device can.
    pub access: Access,
    /// Which builds of the kernels to run.
    pub edition: Edition,
    /// How they compute with floats.
    pub arithmetic: Arithmetic,
    /// Functions that stand for the driver's own operations, for tests of what other drivers do.
    pub driver: Option<&'static Library>,
}

/// Runs recordings on a device, with its own buffers and pipelines.
pub struct Executor {
    pub(super) resources: Resources,
    pub(super) pipelines: Pipelines,
    pipelines_time: Duration,
    pub(super) command_pool: vk::CommandPool,
    pub(super) slots: Vec<Slot>,
    pub(super) next_slot: usize,
    pub(super) times: Times,
    access: Access,
    memory_bytes: u64,
    /// What the pipelines were built from.
    kernels: Vec<(&'static str, Specialized)>,
    pub(super) device: Arc<Shared>,
}

impl Executor {
    /// Makes buffers and pipelines, and uploads the first contents.
    ///
    /// Scene buffers are read the other way than is wanted where only that one is wide enough.
    ///
    /// # Errors
    /// When a buffer is over the device's limits or its memory, or a kernel cannot be built.
    pub fn new(device: &Device, mut description: ExecutorDescription<'_>) -> Result<Self, GpuError> {
        let shared = &device.shared;
        let limits = &shared.description;
        let wanted = description.access;
        let access = Access { subgroup_ballot: wanted.subgroup_ballot && limits.subgroup_ballot, ..wanted };
        let specialized = |access| -> Vec<_> {
            let build = Build {
                constants: description.specialization,
                access,
                edition: description.edition,
                arithmetic: description.arithmetic,
                driver: description.driver,
                promises: limits.promises,
            };
            let specialize = |kernel: &&'static Kernel| (kernel.name, kernel.specialize(&build, portable_library()));
            description.kernels.iter().map(specialize).collect()
        };
        let specializing = shared.stages().begin("specialize kernels");
        // What kernels bind does not depend on how they reach it, and what none binds takes no memory.
        let kernels = specialized(access);
        let bound: HashSet<_> = kernels.iter().flat_map(|(_, kernel)| &kernel.bindings).map(|b| b.name).collect();
        description.buffers.retain(|role| bound.contains(role.name));
        let memory = MemoryLimits {
            storage_buffer_bytes: limits.max_storage_buffer_bytes,
            texels: limits.max_texel_buffer_elements,
            heap_bytes: limits.memory_bytes,
            used_bytes: device.used_memory(),
        };
        // To the device and back.
        let carried = 2 * SLOTS as u64 * carried_bytes(&description.buffers);
        let MemoryPlan { texel_fetch, bytes } =
            plan_memory(&description.buffers, carried, access.texel_fetch, &memory)?;
        let kernels =
            if texel_fetch == access.texel_fetch { kernels } else { specialized(Access { texel_fetch, ..access }) };
        let access = Access { texel_fetch, ..access };

        drop(specializing);
        let compiling = shared.stages().begin("compile kernels");
        let start = Instant::now();
        let pipelines = Pipelines::new(shared, &kernels)?;
        let pipelines_time = start.elapsed();
        drop(compiling);
        let uploading = shared.stages().begin("upload");
        let resources = Resources::new(shared, &description.buffers, texel_fetch, &pipelines, SLOTS)?;
        let mut executor = Self {
            resources,
            pipelines,
            pipelines_time,
            command_pool: vk::CommandPool::null(),
            slots: Vec::new(),
            next_slot: 0,
            times: Times::new(),
            access,
            memory_bytes: bytes,
            kernels,
            device: Arc::clone(shared),
        };
        executor.make_slots()?;
        executor.fill_first(&description.buffers)?;
        drop(uploading);
        let _compiling = shared.stages().begin("compile kernels");
        let start = Instant::now();
        executor.warm_up()?;
        executor.pipelines_time += start.elapsed();
        Ok(executor)
    }

    /// How the kernels reach memory.
    pub fn access(&self) -> Access {
        self.access
    }

    /// Bytes of device memory that the buffers take.
    pub fn memory_bytes(&self) -> u64 {
        self.memory_bytes
    }

    /// Time and launches of each kernel at each bounce, of the recordings that have been waited for. What a batch begins
    /// and ends with counts as bounce 0.
    pub fn kernel_times(&self) -> &BTreeMap<(&'static str, u32), KernelTime> {
        &self.times.kernels
    }

    /// Seconds between the start and the end of the command buffers of recordings that have been
    /// waited for, on the device's clock; 0 where it has none. The kernels' times are parts of it.
    pub fn device_seconds(&self) -> f64 {
        self.times.seconds
    }

    /// Whether the device has a clock of its own.
    pub fn has_clock(&self) -> bool {
        self.device.description.timestamp_bits > 0
    }

    /// How long the device was idle before and between the recordings that have been waited for.
    pub fn idle(&self) -> Idle {
        self.times.idle
    }

    /// Keeps the time of every launch from now on, until they are taken.
    pub fn keep_launches(&mut self) {
        self.times.launches = Some(Vec::new());
    }

    /// Seconds of every launch that has been waited for since [`Executor::keep_launches`], in order: from the end of the
    /// command before, in its command buffer, to its own. Empty where the device has no clock.
    pub fn take_launches(&mut self) -> Vec<f64> {
        self.times.launches.take().unwrap_or_default()
    }

    /// Keeps from now on what the device does in each submission, for a trace: up to `most_passes` launches, and what the
    /// buffer `counts` holds at the end.
    ///
    /// # Errors
    /// When the device fails.
    ///
    /// # Panics
    /// When no buffer has that name.
    pub fn keep_trace(&mut self, counts: &'static str, most_passes: usize) -> Result<(), GpuError> {
        self.wait()?;
        let size = self.resources.size(counts);
        for slot in &mut self.slots {
            let (usage, location) = (vk::BufferUsageFlags::TRANSFER_DST, MemoryLocation::GpuToCpu);
            slot.counts = Some(Buffer::new(&self.device, "counts of a submission", size, usage, location)?);
        }
        self.times.tracing = Some(Tracing::new(counts, most_passes, Clock::new(&self.device)?));
        Ok(())
    }

    /// What has been kept of the submissions that were waited for, since the last call.
    pub fn take_traced(&mut self) -> Vec<TracedSubmission> {
        self.times.tracing.as_mut().map(Tracing::take).unwrap_or_default()
    }

    /// How the times of a trace were brought to the host's clock; `None` where none is kept.
    pub fn alignment(&self) -> Option<Alignment> {
        self.times.tracing.as_ref().map(Tracing::alignment)
    }

    /// Where the stages of the host's work are noted.
    pub fn stages(&self) -> &Stages {
        self.device.stages()
    }

    /// Time until all kernels were built: pipelines are made side by side, then launched once in turn.
    pub fn pipelines_time(&self) -> Duration {
        self.pipelines_time
    }

    /// Time that the driver took to build each kernel, by name: CPU time to make the pipeline, and the time of one launch,
    /// which is when some drivers compile it.
    pub fn pipeline_times(&self) -> impl Iterator<Item = (&'static str, Duration)> {
        self.pipelines.build_times()
    }

    /// Seconds of each submission that has been waited for since the last call, in their order: by the device's clock,
    /// and where it has none by the host's, from its start or the end of the one before until the host saw it end.
    pub fn take_submission_seconds(&mut self) -> Vec<f64> {
        std::mem::take(&mut self.times.submission_seconds)
    }

    /// Compiles the kernels once more, in pipelines that are never run, and asks the driver about them: capturing
    /// statistics might slow down those that do run. `None` where the driver has none.
    ///
    /// # Errors
    /// When a kernel cannot be built.
    pub fn compiled_kernels(&self) -> Result<Option<Vec<CompiledKernel>>, GpuError> {
        compiled_kernels(&self.device, &self.kernels)
    }

    /// Instructions of each kernel's SPIR-V that can run, by name.
    pub fn instructions(&self) -> impl Iterator<Item = (&'static str, usize)> {
        self.kernels.iter().map(|(name, kernel)| (*name, kernel.instructions))
    }

    /// Starts the times and launches anew.
    pub fn forget_times(&mut self) {
        self.times.forget();
    }

    /// Starts a recording, which downloads nothing. At most two submissions are under way: a third waits for the first.
    ///
    /// # Errors
    /// When the device is lost or out of memory.
    ///
    /// # Panics
    /// When the recording names a kernel or a buffer that the executor does not have, or more bytes than a buffer holds.
    pub fn submit(&mut self, recording: &Recording) -> Result<(), GpuError> {
        let downloads = recording.commands.iter().any(|command| matches!(command, Command::Download { .. }));
        assert!(!downloads, "a recording that downloads is run, not submitted");
        self.submit_all(recording, &mut |_, _, _| ())
    }

    /// Runs a recording to its end, and what was started before it: what each of its downloads found, in their order.
    ///
    /// # Errors
    /// As [`Executor::submit`].
    ///
    /// # Panics
    /// As [`Executor::submit`].
    pub fn run(&mut self, recording: &Recording) -> Result<Vec<Vec<u8>>, GpuError> {
        let downloads = recording.commands.iter().filter(|command| matches!(command, Command::Download { .. }));
        let mut found = vec![Vec::new(); downloads.count()];
        self.run_seen(recording, |number, _, part| found[number].extend_from_slice(part))?;
        Ok(found)
    }

    /// As [`Executor::run`], but shows what downloads find where it lies, in parts of whole 64 bytes: with the number of the
    /// download, from 0, and the byte of the buffer that the part begins at.
    ///
    /// # Errors
    /// As [`Executor::submit`].
    ///
    /// # Panics
    /// As [`Executor::submit`].
    pub fn run_seen(&mut self, recording: &Recording, mut show: impl FnMut(usize, u64, &[u8])) -> Result<(), GpuError> {
        let ran = self.submit_all(recording, &mut show).and_then(|()| self.wait_for_all(&mut show));
        if ran.is_err() {
            // What still comes back belongs to no recording.
            self.slots.iter_mut().for_each(|slot| slot.downloads.clear());
        }
        ran
    }

    /// Waits for everything that was submitted.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn wait(&mut self) -> Result<(), GpuError> {
        self.wait_for_all(&mut |_, _, _| ())
    }

    /// Overwrites the first `size` bytes of a buffer, after everything that was submitted, with what is made in place:
    /// `put` fills them in parts of whole 64 bytes, each with the byte that it begins at.
    ///
    /// # Errors
    /// When the device is lost.
    ///
    /// # Panics
    /// When no buffer has that name or it is too small.
    pub fn fill(
        &mut self,
        buffer: &'static str,
        size: u64,
        mut put: impl FnMut(u64, &mut [u8]),
    ) -> Result<(), GpuError> {
        assert!(size <= self.resources.size(buffer), "the contents of {buffer} fit it");
        for offset in (0..size).step_by(self.resources.carried as usize) {
            let bytes = (size - offset).min(self.resources.carried);
            let slot = self.free_slot(&mut |_, _, _| ())?;
            put(offset, &mut self.resources.staged(slot)[..bytes as usize]);
            self.record(slot, &[Step::Upload { buffer, offset, staged_at: 0, bytes, contents: None }])?;
            self.launch(slot)?;
        }
        Ok(())
    }

    /// Gives the buffers their first contents.
    fn fill_first(&mut self, roles: &[BufferRole<'_>]) -> Result<(), GpuError> {
        let mut zeros = Recording::default();
        for role in roles {
            match role.contents {
                Some(contents) => self.fill(role.name, contents.len() as u64, |offset, part| {
                    part.copy_from_slice(&contents[offset as usize..][..part.len()]);
                })?,
                None => drop(zeros.clear(role.name)),
            }
        }
        self.submit(&zeros)?;
        self.wait()
    }

    /// Makes the driver finish every pipeline by a launch of no workgroup: lavapipe compiles a kernel when it is first
    /// launched, with its bindings. The launch counts towards the pipeline's build time.
    fn warm_up(&mut self) -> Result<(), GpuError> {
        for name in self.pipelines.names() {
            let pipeline = self.pipelines.get(name).pipeline;
            let (layout, sets) = (self.pipelines.layout, self.resources.sets.clone());
            let constants = vec![0; self.pipelines.push_constant_size as usize];
            let shared = Arc::clone(&self.device);
            let start = Instant::now();
            self.run_once(|device, commands| {
                let point = vk::PipelineBindPoint::COMPUTE;
                shared.labels.region(commands, format_args!("no workgroup of {name}"), || {
                    // SAFETY: pipeline, layout and sets are alive until the executor is dropped.
                    unsafe {
                        device.cmd_bind_descriptor_sets(commands, point, layout, 0, &sets, &[]);
                        device.cmd_bind_pipeline(commands, point, pipeline);
                        if !constants.is_empty() {
                            device.cmd_push_constants(commands, layout, vk::ShaderStageFlags::COMPUTE, 0, &constants);
                        }
                        device.cmd_dispatch(commands, 0, 1, 1);
                    }
                });
            })?;
            self.pipelines.add_time(name, start.elapsed());
        }
        self.device.pipeline_cache.save(&self.device.raw);
        Ok(())
    }

    /// Submits a recording, cut to what fits a submission. Shows what earlier ones bring back that are waited for.
    fn submit_all(&mut self, recording: &Recording, show: &mut Show<'_>) -> Result<(), GpuError> {
        let room = Room { steps: MAX_STEPS, bytes: self.resources.carried };
        let cut = submissions(recording, room, |name| self.resources.size(name));
        for steps in cut.iter().filter(|steps| !steps.is_empty()) {
            let slot = self.free_slot(show)?;
            self.record(slot, steps)?;
            self.launch(slot)?;
        }
        Ok(())
    }

    fn wait_for_all(&mut self, show: &mut Show<'_>) -> Result<(), GpuError> {
        (0..SLOTS).try_for_each(|i| self.finish((self.next_slot + i) % SLOTS, show))
    }
}

impl Drop for Executor {
    fn drop(&mut self) {
        // Whatever the device says, nothing may be destroyed before it has stopped.
        let _ = self.wait();
        let device = &self.device.raw;
        // SAFETY: the device is idle, so nothing uses these objects any more.
        unsafe {
            for slot in &self.slots {
                device.destroy_fence(slot.fence, None);
                device.destroy_query_pool(slot.queries, None);
            }
            device.destroy_command_pool(self.command_pool, None);
        }
    }
}
