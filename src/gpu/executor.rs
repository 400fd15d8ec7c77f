//! Runs recordings: binds by name, orders by what each kernel reads and writes, and times.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use ash::vk;
use gpu_allocator::MemoryLocation;

use super::buffer::Buffer;
use super::clock::{Alignment, Clock};
use super::device::{Device, Shared};
use super::error::{Action, GpuError};
use super::executables::{CompiledKernel, compiled_kernels};
use super::memory::{MemoryLimits, MemoryPlan, plan_memory};
use super::pipeline::{Pipelines, descriptor_type};
use crate::recording::{Pass, Recording};
use crate::shaders::{Access, Arithmetic, BindingKind, Build, Edition, Kernel, Library, Specialized};
use crate::trace::Stages;

/// How kernels see a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BufferUse {
    /// Constants of the render.
    Uniform,
    /// Scene data of that many bytes a texel (8 or 16): a texel or storage buffer.
    Scene {
        /// 8 or 16.
        texel_bytes: u64,
    },
    /// State that kernels read and write.
    State,
}

/// A buffer by its GLSL name.
#[derive(Debug, Clone)]
pub struct BufferRole<'a> {
    /// Name of the GLSL variable.
    pub name: &'static str,
    /// How kernels see it.
    pub usage: BufferUse,
    /// Bytes, above 0.
    pub size: u64,
    /// First contents; zeros without.
    pub contents: Option<&'a [u8]>,
}

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

/// Time and launches of a kernel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct KernelTime {
    /// Seconds between the end of the pass before and the end of this one, summed.
    pub seconds: f64,
    /// Dispatches.
    pub launches: u64,
}

/// How long the device had no recording, by its own clock; `None` where it has none, or there was nothing before.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Idle {
    /// Seconds before the first recording, since the last one of any executor of the device.
    pub before: Option<f64>,
    /// Seconds between the recordings, summed.
    pub between: Option<f64>,
}

/// What the device did of one submission, on the host's clock.
#[derive(Debug, Clone)]
pub struct TracedSubmission {
    /// When the host handed it over.
    pub submitted: Instant,
    /// When the host saw that it had ended.
    pub seen: Instant,
    /// Its passes in order; none where the device has no clock, or there was no more room.
    pub passes: Vec<TracedPass>,
    /// Passes that there was no more room for.
    pub dropped: usize,
    /// What the buffer of [`Executor::keep_trace`] held at its end.
    pub counts: Vec<u8>,
}

/// A pass on the host's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TracedPass {
    /// Name of its kernel.
    pub kernel: &'static str,
    /// The bounce that it is a part of.
    pub of_bounce: Option<u32>,
    /// When the pass before it ended, or what the submission had to wait for.
    pub start: Instant,
    /// When it ended.
    pub end: Instant,
}

/// Passes that one command buffer can time.
const MAX_TIMED_PASSES: u32 = 2048;
/// Timestamps of a command buffer: its very start, the end of the barrier that opens it, the end of
/// each pass, and its very end.
const FIRST_PASS: usize = 2;
/// Bytes of each of the buffers that carry data to and from the device, at most: no more than the largest that they serve.
const STAGING_BYTES: u64 = 16 << 20;
/// Submissions that the device may have at once.
const SLOTS: usize = 2;

/// Runs recordings on a device, with its own buffers and pipelines.
pub struct Executor {
    buffers: HashMap<&'static str, Buffer>,
    pipelines: Pipelines,
    pipelines_time: Duration,
    descriptor_pool: vk::DescriptorPool,
    sets: Vec<vk::DescriptorSet>,
    command_pool: vk::CommandPool,
    slots: Vec<Slot>,
    next_slot: usize,
    /// What the host writes for the device.
    staging: Buffer,
    /// What the device writes for the host: memory that the host reads fast.
    readback: Buffer,
    times: BTreeMap<(&'static str, u32), KernelTime>,
    /// Inside command buffers of recordings, from end to end.
    seconds: f64,
    /// Of each submission of a recording that has been waited for and not been asked for.
    submission_seconds: Vec<f64>,
    /// When the host saw the last submission end.
    last_end: Instant,
    idle: Idle,
    /// Seconds of every pass, where they are kept.
    launches: Option<Vec<f64>>,
    /// What is kept for a trace, if anything is.
    tracing: Option<Tracing>,
    access: Access,
    memory_bytes: u64,
    /// What the pipelines were built from.
    kernels: Vec<(&'static str, Specialized)>,
    specialization: Vec<u32>,
    device: Arc<Shared>,
}

/// A command buffer that is free or on its way.
struct Slot {
    commands: vk::CommandBuffer,
    fence: vk::Fence,
    queries: vk::QueryPool,
    /// The passes in flight, one per timestamp from [`FIRST_PASS`] on.
    pending: Option<Vec<Launched>>,
    /// When it was submitted.
    start: Instant,
    /// Where the device leaves the counts that a trace wants.
    counts: Option<Buffer>,
}

/// A pass in flight.
struct Launched {
    kernel: &'static str,
    /// That its push constants tell.
    bounce: u32,
    /// That it is a part of.
    of_bounce: Option<u32>,
}

/// What is kept for a trace.
struct Tracing {
    /// The buffer whose contents are kept after each submission.
    counts: &'static str,
    /// Passes that there is room for.
    room: usize,
    clock: Clock,
    /// End of the last pass.
    until: Option<Instant>,
    submissions: Vec<TracedSubmission>,
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
        let build = Build {
            constants: description.specialization,
            arithmetic: description.arithmetic,
            driver: description.driver,
            promises: limits.promises,
        };
        let specialized = |access| -> Vec<_> {
            let variants =
                description.kernels.iter().map(|kernel| (kernel.name, kernel.variant(description.edition, access)));
            variants.map(|(name, variant)| (name, variant.specialize(&build))).collect()
        };
        let specializing = shared.stages().begin("specialize kernels");
        // What kernels bind does not depend on how they reach it, and what none binds takes no memory.
        let kernels = specialized(access);
        let bound: HashSet<_> = kernels.iter().flat_map(|(_, kernel)| &kernel.bindings).map(|b| b.name).collect();
        description.buffers.retain(|role| bound.contains(role.name));
        let largest = description.buffers.iter().map(|role| role.size).max().unwrap_or_default();
        let staging_bytes = largest.clamp(64, STAGING_BYTES);
        let memory = MemoryLimits {
            storage_buffer_bytes: limits.max_storage_buffer_bytes,
            texels: limits.max_texel_buffer_elements,
            heap_bytes: limits.memory_bytes,
            used_bytes: device.used_memory(),
        };
        let MemoryPlan { texel_fetch, bytes } =
            plan_memory(&description.buffers, 2 * staging_bytes, access.texel_fetch, &memory)?;
        let kernels =
            if texel_fetch == access.texel_fetch { kernels } else { specialized(Access { texel_fetch, ..access }) };
        let access = Access { texel_fetch, ..access };

        drop(specializing);
        let compiling = shared.stages().begin("compile kernels");
        let start = Instant::now();
        let pipelines = Pipelines::new(shared, &kernels, description.specialization)?;
        let pipelines_time = start.elapsed();
        drop(compiling);
        let uploading = shared.stages().begin("upload");
        let transfer = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        let staging = Buffer::new(shared, "staging", staging_bytes, transfer, MemoryLocation::CpuToGpu)?;
        let readback = Buffer::new(shared, "readback", staging_bytes, transfer, MemoryLocation::GpuToCpu)?;
        let mut executor = Self {
            buffers: HashMap::new(),
            pipelines,
            pipelines_time,
            descriptor_pool: vk::DescriptorPool::null(),
            sets: Vec::new(),
            command_pool: vk::CommandPool::null(),
            slots: Vec::new(),
            next_slot: 0,
            staging,
            readback,
            times: BTreeMap::new(),
            seconds: 0.0,
            submission_seconds: Vec::new(),
            last_end: Instant::now(),
            idle: Idle::default(),
            launches: None,
            tracing: None,
            access,
            memory_bytes: bytes,
            kernels,
            specialization: description.specialization.to_vec(),
            device: Arc::clone(shared),
        };
        executor.make_slots()?;
        for role in &description.buffers {
            executor.make_buffer(role)?;
        }
        executor.make_sets()?;
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

    /// Time and launches of each kernel at each bounce, of the recordings that have been waited for.
    pub fn kernel_times(&self) -> &BTreeMap<(&'static str, u32), KernelTime> {
        &self.times
    }

    /// Seconds between the start and the end of the command buffers of recordings that have been
    /// waited for, on the device's clock; 0 where it has none. The kernels' times are parts of it.
    pub fn device_seconds(&self) -> f64 {
        self.seconds
    }

    /// Whether the device has a clock of its own.
    pub fn has_clock(&self) -> bool {
        self.device.description.timestamp_bits > 0
    }

    /// How long the device was idle before and between the recordings that have been waited for.
    pub fn idle(&self) -> Idle {
        self.idle
    }

    /// Lets the time of every pass be kept from now on, until they are taken.
    pub fn keep_launches(&mut self) {
        self.launches = Some(Vec::new());
    }

    /// Seconds of every pass that has been waited for since [`Executor::keep_launches`], in order: from the end of the
    /// pass before, in its command buffer, to its own. Empty where the device has no clock.
    pub fn take_launches(&mut self) -> Vec<f64> {
        self.launches.take().unwrap_or_default()
    }

    /// Lets be kept from now on what the device does of each submission, for a trace: up to so many passes, and what the
    /// buffer `counts` holds at the end.
    ///
    /// # Errors
    /// When the device fails.
    ///
    /// # Panics
    /// When no buffer has that name.
    pub fn keep_trace(&mut self, counts: &'static str, most_passes: usize) -> Result<(), GpuError> {
        self.wait()?;
        let size = self.buffers[counts].size;
        for slot in &mut self.slots {
            let (usage, location) = (vk::BufferUsageFlags::TRANSFER_DST, MemoryLocation::GpuToCpu);
            slot.counts = Some(Buffer::new(&self.device, "counts of a submission", size, usage, location)?);
        }
        let clock = Clock::new(&self.device)?;
        self.tracing = Some(Tracing { counts, room: most_passes, clock, until: None, submissions: Vec::new() });
        Ok(())
    }

    /// What has been kept of the submissions that were waited for, since the last call.
    pub fn take_traced(&mut self) -> Vec<TracedSubmission> {
        self.tracing.as_mut().map(|tracing| std::mem::take(&mut tracing.submissions)).unwrap_or_default()
    }

    /// How the times of a trace were brought to the host's clock; `None` where none is kept.
    pub fn alignment(&self) -> Option<Alignment> {
        self.tracing.as_ref().map(|tracing| tracing.clock.alignment())
    }

    /// Where the stages of the host's work are noted.
    pub fn stages(&self) -> &Stages {
        self.device.stages()
    }

    /// Time until all kernels were built: pipelines are made side by side, then launched once in turn.
    pub fn pipelines_time(&self) -> Duration {
        self.pipelines_time
    }

    /// Time that the driver took to build each kernel, by name: that of a processor to make the pipeline, and
    /// to launch it once, which is when some drivers compile it.
    pub fn pipeline_times(&self) -> impl Iterator<Item = (&'static str, Duration)> {
        self.pipelines.build_times()
    }

    /// Seconds of each submission that has been waited for since the last call, in their order: by the device's clock,
    /// and where it has none by the host's, from its start or the end of the one before until the host saw it end.
    pub fn take_submission_seconds(&mut self) -> Vec<f64> {
        std::mem::take(&mut self.submission_seconds)
    }

    /// Compiles the kernels once more, in pipelines that are never run, and asks the driver about them: what it keeps for
    /// its answers might make these slower. `None` where it has none to give.
    ///
    /// # Errors
    /// When a kernel cannot be built.
    pub fn compiled_kernels(&self) -> Result<Option<Vec<CompiledKernel>>, GpuError> {
        compiled_kernels(&self.device, &self.kernels, &self.specialization)
    }

    /// Instructions of each kernel's SPIR-V that can run, by name.
    pub fn instructions(&self) -> impl Iterator<Item = (&'static str, usize)> {
        self.kernels.iter().map(|(name, kernel)| (*name, kernel.instructions))
    }

    /// Starts the times and launches anew.
    pub fn forget_times(&mut self) {
        self.times.clear();
        self.seconds = 0.0;
        self.idle = Idle::default();
    }

    /// Starts a recording. At most two are under way: a third waits for the first.
    ///
    /// # Errors
    /// When the device is lost or out of memory.
    pub fn submit(&mut self, recording: &Recording) -> Result<(), GpuError> {
        // A command buffer has a limit of passes that it can time.
        for passes in recording.passes.chunks(MAX_TIMED_PASSES as usize) {
            let slot = self.next_slot;
            self.next_slot = (slot + 1) % SLOTS;
            self.finish(slot)?;
            self.record(slot, passes)?;
            self.launch(slot)?;
        }
        Ok(())
    }

    /// Waits for everything that was submitted.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn wait(&mut self) -> Result<(), GpuError> {
        (0..SLOTS).try_for_each(|i| self.finish((self.next_slot + i) % SLOTS))
    }

    /// Copies a whole buffer to the host, after everything that was submitted.
    ///
    /// # Errors
    /// When the device is lost.
    ///
    /// # Panics
    /// When no buffer has that name.
    pub fn read(&mut self, name: &str) -> Result<Vec<u8>, GpuError> {
        let size = self.buffers[name].size;
        let mut bytes = Vec::with_capacity(size as usize);
        self.visit(name, size, |_, part| bytes.extend_from_slice(part))?;
        Ok(bytes)
    }

    /// Shows the host the first `size` bytes of a buffer where they are, after everything that was submitted: in parts
    /// of whole 64 bytes, each with the byte that it begins at.
    ///
    /// # Errors
    /// When the device is lost.
    ///
    /// # Panics
    /// When no buffer has that name or it is too small.
    pub fn visit(&mut self, name: &str, size: u64, mut show: impl FnMut(u64, &[u8])) -> Result<(), GpuError> {
        self.wait()?;
        assert!(size <= self.buffers[name].size, "what is read of {name} is in it");
        for offset in (0..size).step_by(STAGING_BYTES as usize) {
            let length = (size - offset).min(STAGING_BYTES);
            let regions = [vk::BufferCopy { src_offset: offset, dst_offset: 0, size: length }];
            let (source, readback) = (self.buffers[name].raw, self.readback.raw);
            self.run_once(|device, commands| {
                // SAFETY: both buffers are alive and the region lies in both.
                unsafe { device.cmd_copy_buffer(commands, source, readback, &regions) }
            })?;
            show(offset, &self.readback.bytes()[..length as usize]);
        }
        Ok(())
    }

    /// Overwrites a buffer from its start, after everything that was submitted.
    ///
    /// # Errors
    /// When the device is lost.
    ///
    /// # Panics
    /// When no buffer has that name or it is too small.
    pub fn write(&mut self, name: &str, bytes: &[u8]) -> Result<(), GpuError> {
        self.fill(name, bytes.len() as u64, |offset, part| {
            part.copy_from_slice(&bytes[offset as usize..][..part.len()]);
        })
    }

    /// Overwrites the first `size` bytes of a buffer, after everything that was submitted. `put` fills them in parts of
    /// whole 64 bytes, each with the byte that it begins at.
    ///
    /// # Errors
    /// When the device is lost.
    ///
    /// # Panics
    /// When no buffer has that name or it is too small.
    pub fn fill(&mut self, name: &str, size: u64, mut put: impl FnMut(u64, &mut [u8])) -> Result<(), GpuError> {
        self.wait()?;
        assert!(size <= self.buffers[name].size, "the contents of {name} fit it");
        for offset in (0..size).step_by(STAGING_BYTES as usize) {
            let length = (size - offset).min(STAGING_BYTES);
            put(offset, &mut self.staging.bytes()[..length as usize]);
            let regions = [vk::BufferCopy { src_offset: 0, dst_offset: offset, size: length }];
            let (staging, target) = (self.staging.raw, self.buffers[name].raw);
            self.run_once(|device, commands| {
                // SAFETY: both buffers are alive and the region lies in both.
                unsafe { device.cmd_copy_buffer(commands, staging, target, &regions) }
            })?;
        }
        Ok(())
    }

    /// Fills a buffer with zeros, after everything that was submitted.
    ///
    /// # Errors
    /// When the device is lost.
    ///
    /// # Panics
    /// When no buffer has that name.
    pub fn clear(&mut self, name: &str) -> Result<(), GpuError> {
        self.wait()?;
        let buffer = self.buffers[name].raw;
        self.run_once(|device, commands| {
            // SAFETY: the buffer is alive and has transfer usage.
            unsafe { device.cmd_fill_buffer(commands, buffer, 0, vk::WHOLE_SIZE, 0) }
        })
    }

    fn make_slots(&mut self) -> Result<(), GpuError> {
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
                .query_count(MAX_TIMED_PASSES + FIRST_PASS as u32 + 1);
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
            self.slots.push(Slot { commands, fence, queries, pending: None, start: Instant::now(), counts: None });
        }
        Ok(())
    }

    fn make_buffer(&mut self, role: &BufferRole<'_>) -> Result<(), GpuError> {
        let kind = match role.usage {
            BufferUse::Uniform => vk::BufferUsageFlags::UNIFORM_BUFFER,
            BufferUse::Scene { .. } if self.access.texel_fetch => vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER,
            BufferUse::Scene { .. } => vk::BufferUsageFlags::STORAGE_BUFFER,
            BufferUse::State => vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::INDIRECT_BUFFER,
        };
        let usage = kind | vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        let mut buffer = Buffer::new(&self.device, role.name, role.size, usage, MemoryLocation::GpuOnly)?;
        if let (BufferUse::Scene { texel_bytes }, true) = (role.usage, self.access.texel_fetch) {
            buffer.view_as(
                role.name,
                if texel_bytes == 16 { vk::Format::R32G32B32A32_UINT } else { vk::Format::R32G32_UINT },
            )?;
        }
        self.buffers.insert(role.name, buffer);
        match role.contents {
            Some(contents) => self.write(role.name, contents),
            None => self.clear(role.name),
        }
    }

    fn make_sets(&mut self) -> Result<(), GpuError> {
        let device = &self.device.raw;
        let mut counts: HashMap<vk::DescriptorType, u32> = HashMap::new();
        for binding in self.pipelines.bindings.values() {
            *counts.entry(descriptor_type(binding.kind)).or_default() += 1;
        }
        let sizes: Vec<_> =
            counts.into_iter().map(|(ty, descriptor_count)| vk::DescriptorPoolSize { ty, descriptor_count }).collect();
        let info = vk::DescriptorPoolCreateInfo::default()
            .max_sets(self.pipelines.set_layouts.len() as u32)
            .pool_sizes(&sizes);
        // SAFETY: `info` holds locals only.
        self.descriptor_pool =
            unsafe { device.create_descriptor_pool(&info, None) }.during("making a descriptor pool")?;
        self.device.labels.name(self.descriptor_pool, format_args!("all sets"));
        let info = vk::DescriptorSetAllocateInfo::default()
            .descriptor_pool(self.descriptor_pool)
            .set_layouts(&self.pipelines.set_layouts);
        // SAFETY: the pool has room for exactly these sets.
        self.sets = unsafe { device.allocate_descriptor_sets(&info) }.during("making descriptor sets")?;
        for (number, set) in self.sets.iter().enumerate() {
            self.device.labels.name(*set, format_args!("set {number}"));
        }
        for binding in self.pipelines.bindings.values() {
            let buffer = self.buffers.get(binding.name).ok_or(GpuError::UnboundBinding { binding: binding.name })?;
            let infos = [vk::DescriptorBufferInfo { buffer: buffer.raw, offset: 0, range: vk::WHOLE_SIZE }];
            let views = [buffer.view];
            let write = vk::WriteDescriptorSet::default()
                .dst_set(self.sets[binding.set as usize])
                .dst_binding(binding.binding)
                .descriptor_type(descriptor_type(binding.kind));
            let write = match binding.kind {
                BindingKind::UniformTexelBuffer => write.texel_buffer_view(&views),
                _ => write.buffer_info(&infos),
            };
            // SAFETY: set, buffer and view are alive, and no submission uses the set yet.
            unsafe { device.update_descriptor_sets(&[write], &[]) };
        }
        Ok(())
    }

    /// Makes the driver finish every pipeline by a launch of no workgroup: lavapipe compiles a
    /// kernel when it is first launched, with its bindings. What the launch took belongs to the
    /// pipeline's time.
    fn warm_up(&mut self) -> Result<(), GpuError> {
        for name in self.pipelines.names() {
            let (pipeline, _) = self.pipelines.get(name);
            let (layout, sets) = (self.pipelines.layout, self.sets.clone());
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

    /// Records passes into a free slot.
    fn record(&mut self, slot: usize, passes: &[Pass]) -> Result<(), GpuError> {
        let _stage = self.device.stages().begin("record");
        let (device, labels) = (&self.device.raw, &self.device.labels);
        let Slot { commands, queries, .. } = self.slots[slot];
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        let timestamps = (FIRST_PASS + passes.len() + 1) as u32;
        // SAFETY: the slot is free; sets, layout and pool are alive until the executor is dropped.
        // The pool has room for as many passes as a submission has, here and below.
        unsafe {
            device.begin_command_buffer(commands, &begin).during("recording commands")?;
            device.cmd_reset_query_pool(commands, queries, 0, timestamps);
            device.cmd_write_timestamp(commands, vk::PipelineStageFlags::TOP_OF_PIPE, queries, 0);
            device.cmd_bind_descriptor_sets(
                commands,
                vk::PipelineBindPoint::COMPUTE,
                self.pipelines.layout,
                0,
                &self.sets,
                &[],
            );
        }
        // What earlier submissions wrote is seen by this one.
        self.barrier(commands);
        let mut hazards = Hazards::default();
        let mut launched = Vec::with_capacity(passes.len());
        let mut before = None;
        // SAFETY: as above.
        unsafe { device.cmd_write_timestamp(commands, vk::PipelineStageFlags::BOTTOM_OF_PIPE, queries, 1) };
        for pass in passes {
            let (Pass::Dispatch { kernel, batch, .. } | Pass::DispatchIndirect { kernel, batch, .. }) = pass;
            let (pipeline, bindings) = self.pipelines.get(kernel);
            let indirect = matches!(pass, Pass::DispatchIndirect { .. }).then_some("control");
            let reads = bindings.iter().filter(|b| b.reads).map(|b| b.name).chain(indirect);
            let writes = bindings.iter().filter(|b| b.writes).map(|b| b.name);
            if hazards.needs_barrier(reads, writes) {
                self.barrier(commands);
            }
            let constants = bytemuck::bytes_of(batch);
            let takes = self.pipelines.push_constant_size;
            assert!(takes == 0 || takes == constants.len() as u32, "{kernel} takes a batch or nothing");
            launched.push(Launched { kernel, bounce: batch.bounce, of_bounce: pass.of_bounce() });
            labels.between(commands, before.replace(pass), Some(pass));
            // SAFETY: the pipeline belongs to the layout that is bound; indirect arguments lie in
            // `control`, which has indirect usage; the query index is within the pool.
            unsafe {
                device.cmd_bind_pipeline(commands, vk::PipelineBindPoint::COMPUTE, pipeline);
                if takes > 0 {
                    let stages = vk::ShaderStageFlags::COMPUTE;
                    device.cmd_push_constants(commands, self.pipelines.layout, stages, 0, constants);
                }
                match pass {
                    Pass::Dispatch { groups, .. } => device.cmd_dispatch(commands, *groups, 1, 1),
                    Pass::DispatchIndirect { arguments, .. } => {
                        device.cmd_dispatch_indirect(commands, self.buffers["control"].raw, *arguments);
                    }
                }
                device.cmd_write_timestamp(
                    commands,
                    vk::PipelineStageFlags::BOTTOM_OF_PIPE,
                    queries,
                    (FIRST_PASS + launched.len()) as u32 - 1,
                );
            }
        }
        labels.between(commands, before, None);
        self.barrier(commands);
        // SAFETY: as above.
        unsafe {
            device.cmd_write_timestamp(commands, vk::PipelineStageFlags::BOTTOM_OF_PIPE, queries, timestamps - 1);
        }
        if let (Some(tracing), Some(counts)) = (&self.tracing, &self.slots[slot].counts) {
            let regions = [vk::BufferCopy { src_offset: 0, dst_offset: 0, size: counts.size }];
            // SAFETY: both buffers are alive and as large as the region; the host has read what was there before.
            unsafe { device.cmd_copy_buffer(commands, self.buffers[tracing.counts].raw, counts.raw, &regions) };
            self.host_barrier(commands);
        }
        // SAFETY: recording was begun above.
        unsafe { device.end_command_buffer(commands) }.during("recording commands")?;
        self.slots[slot].pending = Some(launched);
        Ok(())
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

    fn launch(&mut self, slot: usize) -> Result<(), GpuError> {
        let _stage = self.device.stages().begin("submit");
        let Slot { commands, fence, .. } = self.slots[slot];
        let buffers = [commands];
        let submits = [vk::SubmitInfo::default().command_buffers(&buffers)];
        let is_recording = self.slots[slot].pending.as_ref().is_some_and(|passes| !passes.is_empty());
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

    /// Waits for a slot and gathers its times.
    fn finish(&mut self, slot: usize) -> Result<(), GpuError> {
        let Slot { fence, queries, .. } = self.slots[slot];
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
        let launched = self.slots[slot].pending.take().unwrap_or_default();
        let host_seconds = self.slots[slot].start.max(self.last_end).elapsed().as_secs_f64();
        self.last_end = Instant::now();
        if launched.is_empty() {
            return Ok(());
        }
        if self.device.description.timestamp_bits == 0 {
            self.submission_seconds.push(host_seconds);
            for pass in &launched {
                self.times.entry((pass.kernel, pass.bounce)).or_default().launches += 1;
            }
            return self.trace(slot, &launched, &[]);
        }
        let mut ticks = vec![0_u64; FIRST_PASS + launched.len() + 1];
        // SAFETY: the commands that wrote these queries are complete.
        unsafe { self.device.raw.get_query_pool_results(queries, 0, &mut ticks, vk::QueryResultFlags::TYPE_64) }
            .during("reading timestamps")?;
        let mask = u64::MAX >> (64 - self.device.description.timestamp_bits.clamp(1, 64));
        let seconds_per_tick = f64::from(self.device.description.timestamp_period) * 1e-9;
        let seconds = |from: u64, to: u64| (to.wrapping_sub(from) & mask) as f64 * seconds_per_tick;
        let whole = seconds(ticks[0], ticks[ticks.len() - 1]);
        self.seconds += whole;
        // From the end of the opening barrier on: before it the submission may wait for the one before.
        self.submission_seconds.push(seconds(ticks[FIRST_PASS - 1], ticks[ticks.len() - 1]));
        let before = self.device.last_end.swap(ticks[ticks.len() - 1], Ordering::Relaxed);
        // A recording may begin while the one before it ends.
        let overlaps = ticks[0].wrapping_sub(before) & mask > mask / 2;
        self.idle.note((before != 0).then(|| if overlaps { 0.0 } else { seconds(before, ticks[0]) }));
        for (pass, pair) in launched.iter().zip(ticks[FIRST_PASS - 1..].windows(2)) {
            let time = self.times.entry((pass.kernel, pass.bounce)).or_default();
            time.seconds += seconds(pair[0], pair[1]);
            time.launches += 1;
            if let Some(launches) = &mut self.launches {
                launches.push(seconds(pair[0], pair[1]));
            }
        }
        self.trace(slot, &launched, &ticks)
    }

    /// Keeps what a trace shows of a submission that has just ended, by its timestamps; none where the device has no
    /// clock.
    fn trace(&mut self, slot: usize, launched: &[Launched], ticks: &[u64]) -> Result<(), GpuError> {
        let Slot { start: submitted, counts, .. } = &mut self.slots[slot];
        let (Some(tracing), Some(counts)) = (&mut self.tracing, counts) else { return Ok(()) };
        let mut passes = Vec::new();
        if let (Some(&first), true) = (ticks.first(), launched.len() <= tracing.room) {
            tracing.clock.align(first, *submitted)?;
            let times: Vec<_> = ticks[FIRST_PASS - 1..].iter().map(|&ticks| tracing.clock.time(ticks)).collect();
            let spans = spans_after(tracing.until, &times[..=launched.len()]);
            let traced = |(pass, [start, end]): (&Launched, [Instant; 2])| {
                let Launched { kernel, of_bounce, .. } = *pass;
                TracedPass { kernel, of_bounce, start, end }
            };
            passes = launched.iter().zip(spans).map(traced).collect();
            tracing.until = passes.last().map(|pass| pass.end);
            tracing.room -= passes.len();
        }
        let dropped = if ticks.is_empty() { 0 } else { launched.len() - passes.len() };
        if dropped > 0 {
            // Nothing after a gap: what follows would look as if it were all.
            tracing.room = 0;
        }
        let counts = counts.bytes().to_vec();
        tracing.submissions.push(TracedSubmission {
            submitted: *submitted,
            seen: self.last_end,
            passes,
            dropped,
            counts,
        });
        Ok(())
    }

    /// Names what ran when the device was lost.
    fn lost(&self, slot: usize, result: Result<(), vk::Result>, action: &'static str) -> Result<(), GpuError> {
        result.map_err(|result| match result {
            vk::Result::ERROR_DEVICE_LOST => {
                let passes = self.slots[slot].pending.iter().flatten();
                let mut kernels: Vec<_> = passes.map(|pass| pass.kernel).collect();
                kernels.sort_unstable();
                kernels.dedup();
                let pass = if kernels.is_empty() { "a copy".to_owned() } else { kernels.join(", ") };
                GpuError::DeviceLost { pass }
            }
            result => GpuError::Vulkan { action, result },
        })
    }

    /// Records, runs and awaits commands that are not passes. Nothing else is under way.
    fn run_once(&mut self, fill: impl FnOnce(&ash::Device, vk::CommandBuffer)) -> Result<(), GpuError> {
        let slot = self.next_slot;
        self.finish(slot)?;
        let commands = self.slots[slot].commands;
        let begin = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: the slot is free.
        unsafe { self.device.raw.begin_command_buffer(commands, &begin) }.during("recording commands")?;
        self.barrier(commands);
        fill(&self.device.raw, commands);
        self.host_barrier(commands);
        // SAFETY: recording was begun above.
        unsafe { self.device.raw.end_command_buffer(commands) }.during("recording commands")?;
        self.slots[slot].pending = Some(Vec::new());
        self.launch(slot)?;
        self.finish(slot)
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
}

/// From each time to the next one, all of it moved so that it begins no earlier than `until`: clocks that are read anew
/// for each submission move it by as much as they may be apart, and passes do not overlap for that.
fn spans_after(until: Option<Instant>, times: &[Instant]) -> Vec<[Instant; 2]> {
    let late = until.map_or(Duration::ZERO, |until| until.saturating_duration_since(times[0]));
    times.windows(2).map(|pair| [pair[0] + late, pair[1].max(pair[0]) + late]).collect()
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
            device.destroy_descriptor_pool(self.descriptor_pool, None);
        }
    }
}

impl Idle {
    /// Notes the time before a recording; `None` before the device's first.
    fn note(&mut self, seconds: Option<f64>) {
        match self.between {
            None => (self.before, self.between) = (seconds, Some(0.0)),
            Some(between) => self.between = Some(between + seconds.unwrap_or(0.0)),
        }
    }
}

/// Buffers touched since the last barrier.
#[derive(Default)]
struct Hazards {
    read: HashSet<&'static str>,
    written: HashSet<&'static str>,
}

impl Hazards {
    /// Notes a pass, and says whether it must wait for the passes before it.
    fn needs_barrier(
        &mut self,
        reads: impl Iterator<Item = &'static str> + Clone,
        writes: impl Iterator<Item = &'static str> + Clone,
    ) -> bool {
        let after_write = reads.clone().chain(writes.clone()).any(|name| self.written.contains(name));
        let after_read = writes.clone().any(|name| self.read.contains(name));
        let hazard = after_write || after_read;
        if hazard {
            self.read.clear();
            self.written.clear();
        }
        self.read.extend(reads);
        self.written.extend(writes);
        hazard
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn submissions_do_not_overlap_for_what_clocks_are_apart() {
        let start = Instant::now();
        let at = |nanoseconds| start + Duration::from_nanos(nanoseconds);
        let times = [100, 130, 130, 170].map(at);
        let spans = |from: [u64; 4]| from.windows(2).map(|pair| [at(pair[0]), at(pair[1])]).collect::<Vec<_>>();
        assert_eq!(spans_after(None, &times), spans([100, 130, 130, 170]));
        assert_eq!(spans_after(Some(at(90)), &times), spans([100, 130, 130, 170]), "a gap stays one");
        assert_eq!(spans_after(Some(at(105)), &times), spans([105, 135, 135, 175]), "it is moved as a whole");
        assert!(spans_after(Some(at(105)), &times[..1]).is_empty());
    }

    #[test]
    fn passes_wait_for_what_they_share() {
        let mut hazards = Hazards::default();
        let mut pass = |reads: &[&'static str], writes: &[&'static str]| {
            hazards.needs_barrier(reads.iter().copied(), writes.iter().copied())
        };
        assert!(!pass(&["scene"], &["hits"]));
        assert!(!pass(&["scene"], &["film"]), "readers of one buffer do not wait for each other");
        assert!(pass(&["hits"], &["paths"]), "a read waits for a write");
        assert!(!pass(&["scene"], &["film"]), "a barrier clears what came before it");
        assert!(pass(&["scene"], &["hits"]), "a write waits for a read");
        assert!(pass(&["scene"], &["hits"]), "a write waits for a write");
    }
}
