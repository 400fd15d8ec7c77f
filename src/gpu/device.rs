//! A logical device with one compute queue and its memory.

use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use ash::{ext, khr, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};

use super::clock::Calibrates;
use super::error::{Action, GpuError};
use super::instance::{DeviceDescription, Instance};
use super::labels::Labels;
use super::pipeline_cache::PipelineCache;
use crate::shaders::Reconvergence;
use crate::trace::Stages;

/// A device that can run kernels. Cheap to clone: clones are the same device.
#[derive(Clone)]
pub struct Device {
    pub(super) shared: Arc<Shared>,
}

/// What every object of the device keeps alive.
pub(super) struct Shared {
    pub raw: ash::Device,
    /// Submissions of several executors take turns.
    pub queue: Mutex<vk::Queue>,
    /// Dropped by hand, before the device.
    pub allocator: ManuallyDrop<Mutex<Allocator>>,
    pub pipeline_cache: PipelineCache,
    pub cache_folder: Option<PathBuf>,
    pub description: DeviceDescription,
    /// What names its objects.
    pub labels: Labels,
    /// How its clock is read together with the host's, if it was opened for a trace and the driver can.
    pub calibrates: Option<Calibrates>,
    /// Submissions of recordings until the device counts as lost.
    pub submissions_left: AtomicU64,
    /// Timestamp of the end of the last recording of any executor that has been waited for; 0 before the first.
    pub last_end: AtomicU64,
    pub instance: Arc<Instance>,
}

impl Device {
    /// Opens the device of that name or number, as `raywave devices` lists them, or the best one. An instance of Vulkan
    /// is made for it.
    ///
    /// # Errors
    /// When there is no Vulkan or no such device, or the driver refuses.
    pub fn find(wanted: Option<&str>) -> Result<Self, GpuError> {
        let instance = Arc::new(Instance::new(false)?);
        Self::open(&instance, instance.choose(wanted)?)
    }

    /// Opens a device.
    ///
    /// # Errors
    /// When the driver refuses.
    pub fn open(instance: &Arc<Instance>, description: DeviceDescription) -> Result<Self, GpuError> {
        Self::open_with_cache(instance, description, None)
    }

    /// Opens a device that keeps its compiled kernels in a folder. The folder is made when there is
    /// something to keep; where it cannot be read or written, the kernels are compiled anew.
    ///
    /// # Errors
    /// As [`Device::open`].
    pub fn open_with_cache(
        instance: &Arc<Instance>,
        description: DeviceDescription,
        folder: Option<&Path>,
    ) -> Result<Self, GpuError> {
        let _stage = instance.tools.stages.begin("open device");
        let queues = [vk::DeviceQueueCreateInfo::default()
            .queue_family_index(description.queue_family)
            .queue_priorities(&[1.0])];
        let mut maximal =
            vk::PhysicalDeviceShaderMaximalReconvergenceFeaturesKHR::default().shader_maximal_reconvergence(true);
        let mut uniform = vk::PhysicalDeviceShaderSubgroupUniformControlFlowFeaturesKHR::default()
            .shader_subgroup_uniform_control_flow(true);
        let mut size_control = vk::PhysicalDeviceSubgroupSizeControlFeatures::default().subgroup_size_control(true);
        let mut executables =
            vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
        let mut extensions = Vec::new();
        let mut info = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
        match description.promises.reconvergence {
            Some(Reconvergence::Maximal) => {
                extensions.push(khr::shader_maximal_reconvergence::NAME.as_ptr());
                info = info.push_next(&mut maximal);
            }
            Some(Reconvergence::UniformControlFlow) => {
                extensions.push(khr::shader_subgroup_uniform_control_flow::NAME.as_ptr());
                info = info.push_next(&mut uniform);
            }
            None => {}
        }
        if description.subgroup_size_varies {
            extensions.push(ext::subgroup_size_control::NAME.as_ptr());
            info = info.push_next(&mut size_control);
        }
        if description.tells_executables {
            extensions.push(khr::pipeline_executable_properties::NAME.as_ptr());
            info = info.push_next(&mut executables);
        }
        let calibrates = description.calibrates.filter(|_| instance.tools.stages.are_kept());
        extensions.extend(calibrates.map(|calibrates| calibrates.name().as_ptr()));
        let info = info.enabled_extension_names(&extensions);
        // SAFETY: the physical device comes from this instance; `info` holds locals only.
        let raw = unsafe { instance.raw.create_device(description.raw, &info, None) }.during("opening the device")?;
        // SAFETY: the family was asked for with one queue.
        let queue = unsafe { raw.get_device_queue(description.queue_family, 0) };
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: raw.clone(),
            physical_device: description.raw,
            debug_settings: gpu_allocator::AllocatorDebugSettings::default(),
            buffer_device_address: false,
            allocation_sizes: gpu_allocator::AllocationSizes::default(),
        })
        .map_err(|source| GpuError::Allocation { buffer: "the allocator", bytes: 0, source })?;
        let pipeline_cache = PipelineCache::open(&raw, &description.identity, folder);
        let labels = Labels::new(instance, description.raw, &raw);
        labels.name(raw.handle(), format_args!("raywave"));
        labels.name(queue, format_args!("compute queue"));
        labels.name(pipeline_cache.raw, format_args!("kernels of earlier runs"));
        Ok(Self {
            shared: Arc::new(Shared {
                raw,
                pipeline_cache,
                cache_folder: folder.map(Path::to_owned),
                queue: Mutex::new(queue),
                allocator: ManuallyDrop::new(Mutex::new(allocator)),
                description,
                labels,
                calibrates,
                submissions_left: AtomicU64::new(u64::MAX),
                last_end: AtomicU64::new(0),
                instance: Arc::clone(instance),
            }),
        })
    }

    /// What the device is.
    pub fn description(&self) -> &DeviceDescription {
        &self.shared.description
    }

    /// Whether objects have names and passes labels.
    pub fn has_labels(&self) -> bool {
        self.shared.labels.are_set()
    }

    /// Where the stages of the host's work are noted.
    pub fn stages(&self) -> &Stages {
        self.shared.stages()
    }

    /// Simulates the loss of the device after that many more submissions of recordings, for tests of what follows.
    pub fn lose_after(&self, submissions: u64) {
        self.shared.submissions_left.store(submissions, Ordering::Relaxed);
    }

    /// The folder in which what belongs to this device is kept, if anything is to be.
    pub fn cache_folder(&self) -> Option<&Path> {
        self.shared.cache_folder.as_deref()
    }

    /// Bytes of the heap of [`DeviceDescription::memory_bytes`] in use, by this and all other processes; 0 where the driver
    /// does not report them.
    pub(super) fn used_memory(&self) -> u64 {
        self.shared.instance.used_memory(&self.shared.description)
    }

    /// What the validation layer has said so far; empty when all is well.
    pub fn validation_messages(&self) -> Vec<String> {
        self.shared.instance.validation_messages()
    }
}

impl Shared {
    /// Where the stages of the host's work are noted.
    pub fn stages(&self) -> &Stages {
        &self.instance.tools.stages
    }

    /// Whether the device counts as lost; `counts` is whether it is asked for a recording.
    pub fn is_lost(&self, counts: bool) -> bool {
        let left = self.submissions_left.load(Ordering::Relaxed);
        if counts && left > 0 && left < u64::MAX {
            self.submissions_left.store(left - 1, Ordering::Relaxed);
        }
        left == 0
    }
}

impl Drop for Shared {
    fn drop(&mut self) {
        // SAFETY: buffers, pipelines and executors hold `Shared` by reference count, so none is
        // left; the allocator frees its memory before the device goes, and is not used after.
        unsafe {
            ManuallyDrop::drop(&mut self.allocator);
            self.raw.destroy_pipeline_cache(self.pipeline_cache.raw, None);
            self.raw.destroy_device(None);
        }
    }
}
