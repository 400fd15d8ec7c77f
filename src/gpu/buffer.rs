//! Buffers with their memory.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use gpu_allocator::vulkan::{Allocation, AllocationCreateDesc, AllocationScheme};

use super::device::Shared;
use super::error::{Action, GpuError};

/// A buffer that owns its memory and, where texels are read from it, its view.
pub(super) struct Buffer {
    pub raw: vk::Buffer,
    /// Null for a buffer that is not read by texels.
    pub view: vk::BufferView,
    pub size: u64,
    allocation: Option<Allocation>,
    device: Arc<Shared>,
}

impl Buffer {
    pub fn new(
        device: &Arc<Shared>,
        name: &'static str,
        size: u64,
        usage: vk::BufferUsageFlags,
        location: MemoryLocation,
    ) -> Result<Self, GpuError> {
        let info = vk::BufferCreateInfo::default().size(size).usage(usage);
        // SAFETY: the device is alive and `size` is above 0.
        let raw = unsafe { device.raw.create_buffer(&info, None) }.during("making a buffer")?;
        device.labels.name(raw, format_args!("{name}"));
        let mut buffer = Self { raw, view: vk::BufferView::null(), size, allocation: None, device: Arc::clone(device) };
        // SAFETY: the buffer was just made by this device.
        let requirements = unsafe { device.raw.get_buffer_memory_requirements(raw) };
        let failed = |source| GpuError::Allocation { buffer: name, bytes: size, source };
        let allocation = device
            .allocator
            .lock()
            .expect("no thread panics while it holds the allocator")
            .allocate(&AllocationCreateDesc {
                name,
                requirements,
                location,
                linear: true,
                allocation_scheme: AllocationScheme::GpuAllocatorManaged,
            })
            .map_err(failed)?;
        // SAFETY: the allocation is alive.
        let memory = unsafe { allocation.memory() };
        // Many buffers lie in one block of memory.
        device.labels.name(memory, format_args!("memory, {location:?}"));
        // SAFETY: the memory was allocated for this buffer's requirements and is bound once.
        let bound = unsafe { device.raw.bind_buffer_memory(raw, memory, allocation.offset()) };
        buffer.allocation = Some(allocation);
        bound.during("binding memory")?;
        Ok(buffer)
    }

    /// Makes the whole buffer readable by texels.
    pub fn view_as(&mut self, name: &str, format: vk::Format) -> Result<(), GpuError> {
        let info = vk::BufferViewCreateInfo::default().buffer(self.raw).format(format).range(vk::WHOLE_SIZE);
        // SAFETY: the buffer has texel usage and its memory is bound.
        self.view = unsafe { self.device.raw.create_buffer_view(&info, None) }.during("making a texel view")?;
        self.device.labels.name(self.view, format_args!("{name} by texels"));
        Ok(())
    }

    /// The mapped bytes of a buffer that the host can see.
    pub fn bytes(&mut self) -> &mut [u8] {
        self.allocation
            .as_mut()
            .and_then(Allocation::mapped_slice_mut)
            .expect("only host-visible buffers are read or written by the host")
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        // SAFETY: the executor waits for the device before it drops its buffers; the view goes
        // before the buffer, the buffer before its memory.
        unsafe {
            self.device.raw.destroy_buffer_view(self.view, None);
            self.device.raw.destroy_buffer(self.raw, None);
        }
        if let (Some(allocation), Ok(mut allocator)) = (self.allocation.take(), self.device.allocator.lock()) {
            // Freeing fails only for an allocation of another allocator.
            let _ = allocator.free(allocation);
        }
    }
}
