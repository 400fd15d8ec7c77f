//! The Vulkan instance, its validation messages, and the devices that it offers.

use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex};

use ash::{ext, khr, nv, vk};

use super::clock::Calibrates;
use super::discovery::Discovery;
use super::error::{Action, GpuError};
use super::executables::Multiprocessors;
use super::labels;
use super::pipeline_cache::Identity;
use crate::shaders::{Promises, Reconvergence};
use crate::trace::Stages;

/// Layer that checks every call.
const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Extensions of devices that are younger than validation layers which are still about, with the first version of
/// Vulkan's headers that has them. A layer that is older objects to them, so they are left alone under it.
const YOUNG_EXTENSIONS: [(&CStr, u32); 2] = [
    (khr::calibrated_timestamps::NAME, vk::make_api_version(0, 1, 3, 273)),
    (khr::shader_maximal_reconvergence::NAME, vk::make_api_version(0, 1, 3, 276)),
];

/// What shall be seen of the work from outside.
#[derive(Debug, Clone, Default)]
pub struct Tools {
    /// Whether the validation layer checks every call.
    pub validation: bool,
    /// Whether objects have names and passes labels even if no tool is known that shows them.
    pub labels: bool,
    /// Where the stages of the host's work are noted. Where they are kept, devices are opened so that their clocks can be
    /// read beside the host's.
    pub stages: Stages,
}

/// A Vulkan instance.
pub struct Instance {
    pub(super) raw: ash::Instance,
    pub(super) tools: Tools,
    /// Whether VK_EXT_debug_utils is enabled.
    pub(super) has_debug_utils: bool,
    /// The version of Vulkan that the validation layer was made for, where it is enabled.
    validated_version: Option<u32>,
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    /// Boxed: the messenger holds a pointer to it.
    messages: Arc<Messages>,
    pub(super) entry: ash::Entry,
}

type Messages = Mutex<Vec<String>>;

/// What a device is, in the order in which raywave prefers them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum DeviceKind {
    /// A card of its own.
    Discrete,
    /// Part of the processor.
    Integrated,
    /// A share of a card.
    Virtual,
    /// Software.
    Cpu,
    /// The driver does not say.
    Other,
}

impl DeviceKind {
    /// Its name, for people and records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Cpu => "cpu",
            Self::Other => "other",
        }
    }
}

/// A device and what matters of it here.
#[derive(Debug, Clone)]
pub struct DeviceDescription {
    pub(super) raw: vk::PhysicalDevice,
    /// Name that the driver gives.
    pub name: String,
    /// The same in all interfaces to the device.
    pub uuid: [u8; vk::UUID_SIZE],
    /// What it is.
    pub kind: DeviceKind,
    /// Name and version of the driver.
    pub driver: String,
    /// Highest Vulkan version, as major.minor.patch.
    pub vulkan_version: String,
    /// Lanes of a subgroup.
    pub subgroup_size: u32,
    /// Whether compute shaders have subgroup ballots, with the votes and sums that come with them, and lanes that parted
    /// are promised to meet again in front of one: by the driver, or since software runs a subgroup under one mask.
    pub subgroup_ballot: bool,
    /// What the driver promises kernels that ask.
    pub promises: Promises,
    /// Whether the driver may give kernels subgroups of several sizes unless one is asked for.
    pub subgroup_size_varies: bool,
    /// Most bytes that a storage buffer binding can span.
    pub max_storage_buffer_bytes: u64,
    /// Most texels that a texel buffer can have.
    pub max_texel_buffer_elements: u64,
    /// Most invocations of a workgroup.
    pub max_workgroup_size: u32,
    /// Most workgroups of a dispatch in one dimension.
    pub max_workgroups: u32,
    /// Bytes of the largest device-local memory heap.
    pub memory_bytes: u64,
    /// Nanoseconds per tick of the timestamp counter; 0 where it has none.
    pub timestamp_period: f32,
    /// Why it cannot be used, if it cannot.
    pub unusable: Option<String>,
    /// What is known of its multiprocessors, which only NVIDIA's drivers report.
    pub multiprocessors: Option<Multiprocessors>,
    /// Whether the driver tells what it made of kernels.
    pub(super) tells_executables: bool,
    /// How its clock can be read together with the host's.
    pub(super) calibrates: Option<Calibrates>,
    pub(super) identity: Identity,
    pub(super) queue_family: u32,
    /// The heap of `memory_bytes`.
    heap: usize,
    /// Whether the driver tells what of its memory is taken.
    has_memory_budget: bool,
    pub(super) timestamp_bits: u32,
}

impl DeviceDescription {
    /// Whether the rays of a subgroup can walk a tree together: packets part in loops, and must meet again there.
    pub fn packets(&self) -> bool {
        self.subgroup_ballot && (self.is_software() || self.promises.reconvergence == Some(Reconvergence::Maximal))
    }

    /// A file name for what belongs only to this device and this version of its driver.
    pub fn cache_name(&self) -> String {
        self.identity.name()
    }

    /// Whether both are one device by the same driver.
    pub fn is_same(&self, other: &Self) -> bool {
        // A driver that gives none leaves zeros.
        let known = self.uuid != [0; vk::UUID_SIZE];
        self.raw == other.raw
            || (known && (self.uuid, &self.name, &self.driver) == (other.uuid, &other.name, &other.driver))
    }

    /// Whether it is software: its work runs on the CPU.
    pub fn is_software(&self) -> bool {
        self.kind == DeviceKind::Cpu
    }
}

impl Instance {
    /// Starts Vulkan. With `validation`, the validation layer checks every call, synchronisation
    /// included, and its words are kept for [`Instance::validation_messages`].
    ///
    /// # Errors
    /// When there is no loader, no driver, or no validation layer where one is wanted.
    pub fn new(validation: bool) -> Result<Self, GpuError> {
        Self::with_tools(Tools { validation, ..Tools::default() })
    }

    /// As [`Instance::new`], with more that shall be seen.
    ///
    /// # Errors
    /// As [`Instance::new`], and where labels are asked for that cannot be had.
    pub fn with_tools(tools: Tools) -> Result<Self, GpuError> {
        let _stage = tools.stages.begin("start Vulkan");
        let validation = tools.validation;
        // SAFETY: the loader is a library that expects to be loaded this way; it outlives every
        // object made from it because `Instance` owns it.
        let entry = unsafe { ash::Entry::load() }.map_err(GpuError::NoLoader)?;
        // SAFETY: enumeration has no preconditions.
        let layers = unsafe { entry.enumerate_instance_layer_properties() }.during("listing the Vulkan layers")?;
        let validated_version = match layers.iter().find(|l| l.layer_name_as_c_str() == Ok(VALIDATION_LAYER)) {
            _ if !validation => None,
            Some(layer) => Some(layer.spec_version),
            None => return Err(GpuError::NoValidationLayer),
        };

        // SAFETY: enumeration has no preconditions.
        let listed = unsafe { entry.enumerate_instance_extension_properties(None) }
            .map_err(|result| not_started("listing extensions", result))?;
        let lists = |name| listed.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name));
        let has_debug_utils = labels::extension_wanted(tools.labels, validation, lists(ext::debug_utils::NAME))?;

        let application = vk::ApplicationInfo::default().application_name(c"raywave").api_version(vk::API_VERSION_1_2);
        let layer_names: Vec<_> = validation.then_some(VALIDATION_LAYER.as_ptr()).into_iter().collect();
        let extensions: Vec<_> =
            [(has_debug_utils, ext::debug_utils::NAME), (validation, ext::validation_features::NAME)]
                .into_iter()
                .filter_map(|(wanted, name)| wanted.then_some(name.as_ptr()))
                .collect();
        let mut features = vk::ValidationFeaturesEXT::default()
            .enabled_validation_features(&[vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION]);
        let mut info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_layer_names(&layer_names)
            .enabled_extension_names(&extensions);
        if validation {
            info = info.push_next(&mut features);
        }
        // SAFETY: every pointer in `info` refers to a local that outlives the call.
        let raw =
            unsafe { entry.create_instance(&info, None) }.map_err(|result| not_started("starting Vulkan", result))?;

        let messages = Arc::new(Messages::default());
        let mut instance = Self { raw, tools, has_debug_utils, validated_version, messenger: None, messages, entry };
        if validation {
            instance.listen()?;
        }
        Ok(instance)
    }

    /// Keeps what the validation layer says.
    fn listen(&mut self) -> Result<(), GpuError> {
        let loader = ext::debug_utils::Instance::new(&self.entry, &self.raw);
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(
                vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
            )
            .message_type(
                vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION | vk::DebugUtilsMessageTypeFlagsEXT::PERFORMANCE,
            )
            .pfn_user_callback(Some(on_message))
            .user_data(Arc::as_ptr(&self.messages).cast_mut().cast());
        // SAFETY: the extension is enabled, and `messages` outlives the messenger: `drop` destroys
        // the messenger first.
        let messenger =
            unsafe { loader.create_debug_utils_messenger(&info, None) }.during("listening to the validation layer")?;
        self.messenger = Some((loader, messenger));
        Ok(())
    }

    /// What the validation layer has said so far; empty when all is well.
    pub fn validation_messages(&self) -> Vec<String> {
        self.messages.lock().map(|messages| messages.clone()).unwrap_or_default()
    }

    /// Every device, in the driver's order: the index of one is its number for `--device`. A device of which the loader
    /// found the driver twice, by two of its paths, is there once.
    ///
    /// # Errors
    /// When there is none.
    pub fn devices(&self) -> Result<Vec<DeviceDescription>, GpuError> {
        let _stage = self.tools.stages.begin("list devices");
        // SAFETY: the instance is alive.
        let raw = unsafe { self.raw.enumerate_physical_devices() }.during("listing the devices")?;
        let mut devices: Vec<DeviceDescription> = Vec::new();
        for device in raw.into_iter().map(|raw| self.describe(raw)) {
            if !devices.iter().any(|known| known.is_same(&device)) {
                devices.push(device);
            }
        }
        if devices.is_empty() {
            return Err(no_driver());
        }
        Ok(devices)
    }

    /// The device with that number or with that text in its name or its driver's, whatever the
    /// case; without a wish the best kind, and the first among equals.
    ///
    /// # Errors
    /// When there is no such device, or it cannot be used.
    pub fn choose(&self, wanted: Option<&str>) -> Result<DeviceDescription, GpuError> {
        let devices = self.devices()?;
        let Some(wanted) = wanted else {
            return devices
                .into_iter()
                .filter(|device| device.unusable.is_none())
                .min_by_key(|device| device.kind)
                .ok_or(GpuError::NoUsableDevice);
        };
        let names = || {
            let list: Vec<_> = devices.iter().enumerate().map(|(i, device)| format!("{i} {}", device.name)).collect();
            list.join(", ")
        };
        let by_number = wanted.parse().ok().and_then(|index: usize| devices.get(index));
        let text = wanted.to_lowercase();
        let by_name = || devices.iter().find(|d| format!("{} {}", d.name, d.driver).to_lowercase().contains(&text));
        let device = by_number
            .or_else(by_name)
            .ok_or_else(|| GpuError::UnknownDevice { wanted: wanted.to_owned(), available: names() })?;
        match &device.unusable {
            None => Ok(device.clone()),
            Some(reason) => Err(GpuError::UnusableDevice { name: device.name.clone(), reason: reason.clone() }),
        }
    }

    /// Bytes of the device's heap that cannot be had any more; 0 where the driver does not tell.
    pub(super) fn used_memory(&self, device: &DeviceDescription) -> u64 {
        if !device.has_memory_budget {
            return 0;
        }
        let mut budget = vk::PhysicalDeviceMemoryBudgetPropertiesEXT::default();
        let mut properties = vk::PhysicalDeviceMemoryProperties2::default().push_next(&mut budget);
        // SAFETY: the device comes from this instance and has the extension; the chain consists of locals.
        unsafe { self.raw.get_physical_device_memory_properties2(device.raw, &mut properties) };
        // The budget is what this process may have in all, its own use included.
        let free = budget.heap_budget[device.heap].saturating_sub(budget.heap_usage[device.heap]);
        device.memory_bytes.saturating_sub(free)
    }

    fn reconvergence(&self, raw: vk::PhysicalDevice, has: impl Fn(&CStr) -> bool) -> Option<Reconvergence> {
        let mut maximal = vk::PhysicalDeviceShaderMaximalReconvergenceFeaturesKHR::default();
        let mut uniform = vk::PhysicalDeviceShaderSubgroupUniformControlFlowFeaturesKHR::default();
        let mut features = vk::PhysicalDeviceFeatures2::default();
        if has(khr::shader_maximal_reconvergence::NAME) {
            features = features.push_next(&mut maximal);
        }
        if has(khr::shader_subgroup_uniform_control_flow::NAME) {
            features = features.push_next(&mut uniform);
        }
        // SAFETY: `raw` comes from this instance and has the extensions of the structs in the chain, which are locals.
        unsafe { self.raw.get_physical_device_features2(raw, &mut features) };
        if maximal.shader_maximal_reconvergence != 0 {
            Some(Reconvergence::Maximal)
        } else if uniform.shader_subgroup_uniform_control_flow != 0 {
            Some(Reconvergence::UniformControlFlow)
        } else {
            None
        }
    }

    /// Whether there are several sizes of subgroups, of which one can be asked for.
    fn subgroup_size_varies(&self, raw: vk::PhysicalDevice, has: impl Fn(&CStr) -> bool) -> bool {
        if !has(ext::subgroup_size_control::NAME) {
            return false;
        }
        let mut sizes = vk::PhysicalDeviceSubgroupSizeControlProperties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut sizes);
        let mut control = vk::PhysicalDeviceSubgroupSizeControlFeatures::default();
        let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut control);
        // SAFETY: `raw` comes from this instance and has the extension; the chains consist of locals.
        unsafe {
            self.raw.get_physical_device_properties2(raw, &mut properties);
            self.raw.get_physical_device_features2(raw, &mut features);
        }
        sizes.min_subgroup_size < sizes.max_subgroup_size
            && sizes.required_subgroup_size_stages.contains(vk::ShaderStageFlags::COMPUTE)
            && control.subgroup_size_control != 0
    }

    /// Whether a tool is at work, a layer as a rule, that says it shows names and labels.
    pub(super) fn tool_shows_labels(&self, raw: vk::PhysicalDevice) -> bool {
        let name = c"vkGetPhysicalDeviceToolPropertiesEXT";
        // SAFETY: the instance is alive, and the name ends with a zero.
        let known = unsafe { self.entry.get_instance_proc_addr(self.raw.handle(), name.as_ptr()) };
        if known.is_none() {
            return false;
        }
        let functions = ext::tooling_info::Instance::new(&self.entry, &self.raw);
        // SAFETY: `raw` comes from this instance, which has the function.
        let tools = unsafe { functions.get_physical_device_tool_properties(raw) }.unwrap_or_default();
        tools.iter().any(|tool| tool.purposes.contains(vk::ToolPurposeFlags::DEBUG_MARKERS_EXT))
    }

    /// Whether the driver tells what it made of kernels.
    fn tells_executables(&self, raw: vk::PhysicalDevice, has: impl Fn(&CStr) -> bool) -> bool {
        if !has(khr::pipeline_executable_properties::NAME) {
            return false;
        }
        let mut tells = vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default();
        let mut features = vk::PhysicalDeviceFeatures2::default().push_next(&mut tells);
        // SAFETY: `raw` comes from this instance and has the extension; the chain consists of locals.
        unsafe { self.raw.get_physical_device_features2(raw, &mut features) };
        tells.pipeline_executable_info != 0
    }

    fn multiprocessors(&self, raw: vk::PhysicalDevice, has: impl Fn(&CStr) -> bool) -> Option<Multiprocessors> {
        if !has(nv::shader_sm_builtins::NAME) {
            return None;
        }
        let mut builtins = vk::PhysicalDeviceShaderSMBuiltinsPropertiesNV::default();
        let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut builtins);
        // SAFETY: as above.
        unsafe { self.raw.get_physical_device_properties2(raw, &mut properties) };
        Some(Multiprocessors { count: builtins.shader_sm_count, warps: builtins.shader_warps_per_sm })
    }

    fn describe(&self, raw: vk::PhysicalDevice) -> DeviceDescription {
        let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
        let mut driver = vk::PhysicalDeviceDriverProperties::default();
        let mut floats = vk::PhysicalDeviceFloatControlsProperties::default();
        let mut id = vk::PhysicalDeviceIDProperties::default();
        let mut properties = vk::PhysicalDeviceProperties2::default()
            .push_next(&mut subgroup)
            .push_next(&mut driver)
            .push_next(&mut floats)
            .push_next(&mut id);
        // SAFETY: `raw` comes from this instance, and the chain consists of locals. Structs that a
        // Vulkan 1.0 device does not know are left as they are.
        let (memory, families) = unsafe {
            self.raw.get_physical_device_properties2(raw, &mut properties);
            (
                self.raw.get_physical_device_memory_properties(raw),
                self.raw.get_physical_device_queue_family_properties(raw),
            )
        };
        let core = properties.properties;
        let family = families.iter().position(|family| family.queue_flags.contains(vk::QueueFlags::COMPUTE));
        let version = core.api_version;
        let text = |name: Result<&CStr, _>| name.map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let heaps = &memory.memory_heaps[..memory.memory_heap_count as usize];
        let local = heaps.iter().enumerate().filter(|(_, heap)| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        let (heap, memory_bytes) =
            local.map(|(index, heap)| (index, heap.size)).max_by_key(|(_, size)| *size).unwrap_or((0, 0));
        // SAFETY: `raw` comes from this instance.
        let extensions = unsafe { self.raw.enumerate_device_extension_properties(raw) }.unwrap_or_default();
        let is_known = |name: &CStr| {
            let since = YOUNG_EXTENSIONS.iter().find(|(young, _)| *young == name).map_or(0, |(_, since)| *since);
            self.validated_version.is_none_or(|version| version >= since)
        };
        let has = |name: &CStr| {
            is_known(name) && extensions.iter().any(|extension| extension.extension_name_as_c_str() == Ok(name))
        };
        let reconvergence = self.reconvergence(raw, has);
        let is_software = core.device_type == vk::PhysicalDeviceType::CPU;
        let unusable = if version < vk::API_VERSION_1_2 {
            Some("it has no Vulkan 1.2".to_owned())
        } else if family.is_none() {
            Some("it has no compute queue".to_owned())
        } else {
            None
        };
        DeviceDescription {
            raw,
            name: text(core.device_name_as_c_str()),
            uuid: id.device_uuid,
            kind: match core.device_type {
                vk::PhysicalDeviceType::DISCRETE_GPU => DeviceKind::Discrete,
                vk::PhysicalDeviceType::INTEGRATED_GPU => DeviceKind::Integrated,
                vk::PhysicalDeviceType::VIRTUAL_GPU => DeviceKind::Virtual,
                vk::PhysicalDeviceType::CPU => DeviceKind::Cpu,
                _ => DeviceKind::Other,
            },
            driver: format!("{} {}", text(driver.driver_name_as_c_str()), text(driver.driver_info_as_c_str()))
                .trim()
                .to_owned(),
            vulkan_version: format!(
                "{}.{}.{}",
                vk::api_version_major(version),
                vk::api_version_minor(version),
                vk::api_version_patch(version)
            ),
            subgroup_size: subgroup.subgroup_size,
            promises: Promises {
                reconvergence,
                // Software keeps to all of that unasked, and lavapipe's kernels are slower where it is asked.
                special_values: !is_software && floats.shader_signed_zero_inf_nan_preserve_float32 != 0,
                nearest_rounding: !is_software && floats.shader_rounding_mode_rte_float32 != 0,
                flushes_subnormals: !is_software && floats.shader_denorm_flush_to_zero_float32 != 0,
            },
            subgroup_size_varies: self.subgroup_size_varies(raw, has),
            subgroup_ballot: (is_software || reconvergence.is_some())
                && subgroup.supported_operations.contains(
                    vk::SubgroupFeatureFlags::BASIC
                        | vk::SubgroupFeatureFlags::VOTE
                        | vk::SubgroupFeatureFlags::ARITHMETIC
                        | vk::SubgroupFeatureFlags::BALLOT,
                )
                && subgroup.supported_stages.contains(vk::ShaderStageFlags::COMPUTE),
            max_storage_buffer_bytes: u64::from(core.limits.max_storage_buffer_range),
            max_texel_buffer_elements: u64::from(core.limits.max_texel_buffer_elements),
            max_workgroup_size: core
                .limits
                .max_compute_work_group_invocations
                .min(core.limits.max_compute_work_group_size[0]),
            max_workgroups: core.limits.max_compute_work_group_count[0],
            memory_bytes,
            heap,
            has_memory_budget: has(ext::memory_budget::NAME),
            timestamp_period: core.limits.timestamp_period,
            unusable,
            multiprocessors: self.multiprocessors(raw, has),
            tells_executables: self.tells_executables(raw, has),
            calibrates: Calibrates::of(self, raw, has),
            identity: Identity {
                vendor: core.vendor_id,
                device: core.device_id,
                driver_version: core.driver_version,
                uuid: core.pipeline_cache_uuid,
            },
            queue_family: family.unwrap_or(0) as u32,
            timestamp_bits: family.map_or(0, |index| families[index].timestamp_valid_bits),
        }
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: devices hold the instance by reference count, so none is left; the messenger
        // goes before the instance that it belongs to.
        unsafe {
            if let Some((loader, messenger)) = self.messenger.take() {
                loader.destroy_debug_utils_messenger(messenger, None);
            }
            self.raw.destroy_instance(None);
        }
    }
}

/// Why Vulkan does not start. Of a driver's file that it cannot read a loader says that memory was short.
fn not_started(action: &'static str, result: vk::Result) -> GpuError {
    match result {
        vk::Result::ERROR_INCOMPATIBLE_DRIVER => no_driver(),
        vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
            Discovery::first_problem().map_or(GpuError::Vulkan { action, result }, |cause| GpuError::NoDriver { cause })
        }
        result => GpuError::Vulkan { action, result },
    }
}

fn no_driver() -> GpuError {
    let cause = Discovery::first_problem().unwrap_or_else(|| "the drivers that there are have no device".to_owned());
    GpuError::NoDriver { cause }
}

/// Stores a message of the validation layer.
///
/// # Safety
/// Called only by Vulkan, with valid `data` and with the `user_data` that `listen` passed.
unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user_data: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: Vulkan passes a valid struct, and `user_data` is the `Messages` of a live instance.
    unsafe {
        let messages = &*user_data.cast::<Messages>();
        let text = (*data).message_as_c_str().map(|m| m.to_string_lossy().into_owned()).unwrap_or_default();
        if let Ok(mut messages) = messages.lock() {
            messages.push(text);
        }
    }
    vk::FALSE
}
