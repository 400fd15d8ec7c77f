//! The buffers of an executor, the descriptor sets that bind them, and the memory that data pass through on their way to
//! and from the device.

use std::collections::{BTreeMap, HashMap};
use std::ops::RangeInclusive;
use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;

use super::buffer::Buffer;
use super::device::Shared;
use super::error::{Action, GpuError};
use super::pipeline::{Pipelines, descriptor_type};
use super::roles::{BufferRole, BufferUse};
use crate::shaders::{Binding, BindingKind};

/// Bytes that a submission carries in either direction, at least and at most.
const CARRIED: RangeInclusive<u64> = 1 << 16..=8 << 20;

/// Bytes that a submission can carry in either direction: half the largest buffer, whose halves follow each other.
pub(super) fn carried_bytes(roles: &[BufferRole<'_>]) -> u64 {
    let largest = roles.iter().map(|role| role.size).max().unwrap_or_default();
    largest.div_ceil(2).next_multiple_of(64).clamp(*CARRIED.start(), *CARRIED.end())
}

/// Buffers by name, and what binds them.
pub(super) struct Resources {
    buffers: HashMap<&'static str, Buffer>,
    descriptor_pool: vk::DescriptorPool,
    /// By set number.
    pub sets: Vec<vk::DescriptorSet>,
    /// What the host writes for the device: a part for each submission that may be under way.
    pub staging: Buffer,
    /// What the device writes for the host, in the same parts: memory that the host reads fast.
    pub readback: Buffer,
    /// Bytes of such a part.
    pub carried: u64,
    device: Arc<Shared>,
}

impl Resources {
    /// Makes the buffers, without contents, and binds them. `submissions` may be under way at once.
    pub fn new(
        device: &Arc<Shared>,
        roles: &[BufferRole<'_>],
        texel_fetch: bool,
        pipelines: &Pipelines,
        submissions: usize,
    ) -> Result<Self, GpuError> {
        let carried = carried_bytes(roles);
        let transfer = vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        let size = carried * submissions as u64;
        let mut resources = Self {
            buffers: HashMap::new(),
            descriptor_pool: vk::DescriptorPool::null(),
            sets: Vec::new(),
            staging: Buffer::new(device, "staging", size, transfer, MemoryLocation::CpuToGpu)?,
            readback: Buffer::new(device, "readback", size, transfer, MemoryLocation::GpuToCpu)?,
            carried,
            device: Arc::clone(device),
        };
        for role in roles {
            resources.make_buffer(role, texel_fetch)?;
        }
        resources.make_sets(&pipelines.bindings, &pipelines.set_layouts)?;
        Ok(resources)
    }

    /// The buffer of that name.
    ///
    /// # Panics
    /// When there is none.
    pub fn buffer(&self, name: &str) -> vk::Buffer {
        self.get(name).raw
    }

    /// Bytes of the buffer of that name.
    ///
    /// # Panics
    /// When there is none.
    pub fn size(&self, name: &str) -> u64 {
        self.get(name).size
    }

    fn get(&self, name: &str) -> &Buffer {
        self.buffers.get(name).unwrap_or_else(|| panic!("no kernel of this executor binds a buffer called {name}"))
    }

    /// The staging memory of a submission.
    pub fn staged(&mut self, submission: usize) -> &mut [u8] {
        let carried = self.carried as usize;
        &mut self.staging.bytes()[submission * carried..][..carried]
    }

    /// What a submission has brought back.
    pub fn brought(&mut self, submission: usize) -> &[u8] {
        let carried = self.carried as usize;
        &self.readback.bytes()[submission * carried..][..carried]
    }

    fn make_buffer(&mut self, role: &BufferRole<'_>, texel_fetch: bool) -> Result<(), GpuError> {
        let kind = match role.usage {
            BufferUse::Uniform => vk::BufferUsageFlags::UNIFORM_BUFFER,
            BufferUse::Scene { .. } if texel_fetch => vk::BufferUsageFlags::UNIFORM_TEXEL_BUFFER,
            BufferUse::Scene { .. } => vk::BufferUsageFlags::STORAGE_BUFFER,
            BufferUse::State => vk::BufferUsageFlags::STORAGE_BUFFER | vk::BufferUsageFlags::INDIRECT_BUFFER,
        };
        let usage = kind | vk::BufferUsageFlags::TRANSFER_SRC | vk::BufferUsageFlags::TRANSFER_DST;
        let mut buffer = Buffer::new(&self.device, role.name, role.size, usage, MemoryLocation::GpuOnly)?;
        if let (BufferUse::Scene { texel_bytes }, true) = (role.usage, texel_fetch) {
            buffer.view_as(
                role.name,
                if texel_bytes == 16 { vk::Format::R32G32B32A32_UINT } else { vk::Format::R32G32_UINT },
            )?;
        }
        self.buffers.insert(role.name, buffer);
        Ok(())
    }

    fn make_sets(
        &mut self,
        bindings: &BTreeMap<(u32, u32), Binding>,
        layouts: &[vk::DescriptorSetLayout],
    ) -> Result<(), GpuError> {
        let device = &self.device.raw;
        let mut counts: HashMap<vk::DescriptorType, u32> = HashMap::new();
        for binding in bindings.values() {
            *counts.entry(descriptor_type(binding.kind)).or_default() += 1;
        }
        let sizes: Vec<_> =
            counts.into_iter().map(|(ty, descriptor_count)| vk::DescriptorPoolSize { ty, descriptor_count }).collect();
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(layouts.len() as u32).pool_sizes(&sizes);
        // SAFETY: `info` holds locals only.
        self.descriptor_pool =
            unsafe { device.create_descriptor_pool(&info, None) }.during("making a descriptor pool")?;
        self.device.labels.name(self.descriptor_pool, format_args!("all sets"));
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.descriptor_pool).set_layouts(layouts);
        // SAFETY: the pool has room for exactly these sets.
        self.sets = unsafe { device.allocate_descriptor_sets(&info) }.during("making descriptor sets")?;
        for (number, set) in self.sets.iter().enumerate() {
            self.device.labels.name(*set, format_args!("set {number}"));
        }
        for binding in bindings.values() {
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
}

impl Drop for Resources {
    fn drop(&mut self) {
        // SAFETY: the executor waits for the device before it drops its resources.
        unsafe { self.device.raw.destroy_descriptor_pool(self.descriptor_pool, None) };
    }
}
