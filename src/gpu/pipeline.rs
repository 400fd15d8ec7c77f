//! Compute pipelines, made from the kernel table.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use ash::vk;
use cpu_time::ThreadTime;

use super::device::Shared;
use super::error::{Action, GpuError};
use crate::parallel;
use crate::shaders::{Binding, BindingKind, Specialized};

/// The kernels of a render: one pipeline each, one layout for all, so that descriptor sets are
/// bound once.
pub(super) struct Pipelines {
    pub layout: vk::PipelineLayout,
    /// By set number.
    pub set_layouts: Vec<vk::DescriptorSetLayout>,
    /// Union of the kernels' bindings, by set and binding.
    pub bindings: BTreeMap<(u32, u32), Binding>,
    /// The most that a kernel declares; 0 where none does.
    pub push_constant_size: u32,
    flags: vk::PipelineCreateFlags,
    kernels: BTreeMap<&'static str, Built>,
    device: Arc<Shared>,
}

/// A pipeline, what it was built from, and how long that took.
pub(super) struct Built {
    pub pipeline: vk::Pipeline,
    pub bindings: Vec<Binding>,
    /// Bytes of push constants that the kernel takes; 0 for none.
    pub push_constant_size: u32,
    /// CPU time of the thread that built it; wall time would include waiting for the driver's locks.
    time: Duration,
}

impl Pipelines {
    /// Builds kernels by name.
    pub fn new(device: &Arc<Shared>, kernels: &[(&'static str, Specialized)]) -> Result<Self, GpuError> {
        Self::with_flags(device, kernels, vk::PipelineCreateFlags::empty())
    }

    /// As [`Pipelines::new`], for pipelines that the driver is to be asked about.
    pub fn to_be_described(device: &Arc<Shared>, kernels: &[(&'static str, Specialized)]) -> Result<Self, GpuError> {
        Self::with_flags(device, kernels, vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR)
    }

    fn with_flags(
        device: &Arc<Shared>,
        kernels: &[(&'static str, Specialized)],
        flags: vk::PipelineCreateFlags,
    ) -> Result<Self, GpuError> {
        let mut pipelines = Self {
            layout: vk::PipelineLayout::null(),
            set_layouts: Vec::new(),
            bindings: BTreeMap::new(),
            push_constant_size: 0,
            flags,
            kernels: BTreeMap::new(),
            device: Arc::clone(device),
        };
        for (_, kernel) in kernels {
            pipelines.bindings.extend(kernel.bindings.iter().map(|b| ((b.set, b.binding), *b)));
            pipelines.push_constant_size = pipelines.push_constant_size.max(kernel.push_constant_size);
        }
        pipelines.make_layout()?;
        // Side by side: drivers that compile here take a tenth of a second a kernel and more.
        let build = |(name, kernel): &(&'static str, Specialized)| {
            let start = ThreadTime::now();
            let pipeline = pipelines.build(name, &kernel.words);
            let Specialized { bindings, push_constant_size, .. } = kernel;
            let (bindings, push_constant_size) = (bindings.clone(), *push_constant_size);
            pipeline.map(|pipeline| (*name, Built { pipeline, bindings, push_constant_size, time: start.elapsed() }))
        };
        let built = parallel::map(kernels.len(), &|kernel| build(&kernels[kernel]));
        // What was built is dropped with the others where one is not.
        let mut failed = None;
        for kernel in built {
            match kernel {
                Ok((name, built)) => drop(pipelines.kernels.insert(name, built)),
                Err(error) => failed = failed.or(Some(error)),
            }
        }
        failed.map_or(Ok(pipelines), Err)
    }

    /// The kernel of that name, built.
    ///
    /// # Panics
    /// When the executor was made without it.
    pub fn get(&self, name: &str) -> &Built {
        self.kernels.get(name).unwrap_or_else(|| panic!("{name} is no kernel of this executor"))
    }

    /// The kernels.
    pub fn names(&self) -> Vec<&'static str> {
        self.kernels.keys().copied().collect()
    }

    /// Adds what came after the pipeline was made to the time of a kernel.
    pub fn add_time(&mut self, name: &str, time: Duration) {
        if let Some(built) = self.kernels.get_mut(name) {
            built.time += time;
        }
    }

    /// Time that each kernel took to build. The making of pipelines counts as the time of a processor.
    pub fn build_times(&self) -> impl Iterator<Item = (&'static str, Duration)> {
        self.kernels.iter().map(|(name, built)| (*name, built.time))
    }

    fn make_layout(&mut self) -> Result<(), GpuError> {
        let sets = self.bindings.keys().map(|(set, _)| set + 1).max().unwrap_or(0);
        for set in 0..sets {
            let bindings: Vec<_> = self
                .bindings
                .values()
                .filter(|binding| binding.set == set)
                .map(|binding| {
                    vk::DescriptorSetLayoutBinding::default()
                        .binding(binding.binding)
                        .descriptor_type(descriptor_type(binding.kind))
                        .descriptor_count(1)
                        .stage_flags(vk::ShaderStageFlags::COMPUTE)
                })
                .collect();
            let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
            // SAFETY: `info` holds locals only.
            let layout = unsafe { self.device.raw.create_descriptor_set_layout(&info, None) }
                .during("making a descriptor set layout")?;
            self.device.labels.name(layout, format_args!("layout of set {set}"));
            self.set_layouts.push(layout);
        }
        let range =
            vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(self.push_constant_size);
        // Where no kernel reads any, there is no range: an empty one is not allowed.
        let ranges: Vec<_> = (self.push_constant_size > 0).then_some(range).into_iter().collect();
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&self.set_layouts).push_constant_ranges(&ranges);
        // SAFETY: the set layouts are alive.
        self.layout =
            unsafe { self.device.raw.create_pipeline_layout(&info, None) }.during("making a pipeline layout")?;
        self.device.labels.name(self.layout, format_args!("layout of all kernels"));
        Ok(())
    }

    fn build(&self, name: &'static str, words: &[u32]) -> Result<vk::Pipeline, GpuError> {
        let info = vk::ShaderModuleCreateInfo::default().code(words);
        // SAFETY: the words are SPIR-V that the build compiled for Vulkan 1.2.
        let module = unsafe { self.device.raw.create_shader_module(&info, None) }
            .map_err(|result| GpuError::Pipeline { kernel: name, result })?;
        self.device.labels.name(module, format_args!("{name}.comp"));
        let description = &self.device.description;
        let mut size = vk::PipelineShaderStageRequiredSubgroupSizeCreateInfo::default()
            .required_subgroup_size(description.subgroup_size);
        let mut stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main");
        // Counts of lanes are of one size.
        if description.subgroup_size_varies {
            stage = stage.push_next(&mut size);
        }
        let infos = [vk::ComputePipelineCreateInfo::default().flags(self.flags).stage(stage).layout(self.layout)];
        // SAFETY: module and layout are alive, and the layout holds every binding of the kernel.
        let built = unsafe { self.device.raw.create_compute_pipelines(self.device.pipeline_cache.raw, &infos, None) };
        // SAFETY: a pipeline does not need its module once it is built.
        unsafe { self.device.raw.destroy_shader_module(module, None) };
        if let Ok(pipelines) = &built {
            self.device.labels.name(pipelines[0], format_args!("{name}"));
        }
        built.map(|pipelines| pipelines[0]).map_err(|(_, result)| GpuError::Pipeline { kernel: name, result })
    }
}

impl Drop for Pipelines {
    fn drop(&mut self) {
        // SAFETY: the executor waits for the device before it drops its pipelines.
        unsafe {
            for built in self.kernels.values() {
                self.device.raw.destroy_pipeline(built.pipeline, None);
            }
            self.device.raw.destroy_pipeline_layout(self.layout, None);
            for layout in &self.set_layouts {
                self.device.raw.destroy_descriptor_set_layout(*layout, None);
            }
        }
    }
}

/// The Vulkan name of a binding's kind.
pub(super) fn descriptor_type(kind: BindingKind) -> vk::DescriptorType {
    match kind {
        BindingKind::UniformBuffer => vk::DescriptorType::UNIFORM_BUFFER,
        BindingKind::StorageBuffer => vk::DescriptorType::STORAGE_BUFFER,
        BindingKind::UniformTexelBuffer => vk::DescriptorType::UNIFORM_TEXEL_BUFFER,
    }
}
