//! What can go wrong on the device.

use ash::vk;
use thiserror::Error;

/// An error of the Vulkan room. Each names the resource that failed and what to do.
#[derive(Debug, Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum GpuError {
    #[error(
        "no Vulkan loader was found ({0}); install it: on Debian or Ubuntu `apt install libvulkan1 mesa-vulkan-drivers`; `raywave devices --why` says more"
    )]
    NoLoader(ash::LoadingError),
    #[error("no Vulkan driver was found: {cause}; `raywave devices --why` says more")]
    NoDriver { cause: String },
    #[error("no device is a Vulkan 1.2 device with compute; `raywave devices --why` says what there is")]
    NoUsableDevice,
    #[error("no device is called or numbered '{wanted}'; there are: {available}")]
    UnknownDevice { wanted: String, available: String },
    #[error("device '{name}' cannot be used: {reason}")]
    UnusableDevice { name: String, reason: String },
    #[error("the Vulkan validation layer was asked for and is not installed; `apt install vulkan-validationlayers`")]
    NoValidationLayer,
    #[error(
        "labels were asked for, and nothing here offers VK_EXT_debug_utils; leave out --labels, or install a newer Vulkan loader"
    )]
    NoLabels,
    #[error("{buffer} needs {needed} bytes in one buffer and the device allows {allowed}; {advice}")]
    BufferTooLarge { buffer: &'static str, needed: u64, allowed: u64, advice: &'static str },
    #[error(
        "the render needs {needed} bytes of device memory ({roles}) and the device has {free}{}; use a smaller scene or --in-flight",
        in_use(*used)
    )]
    OutOfMemory { needed: u64, roles: String, free: u64, used: u64 },
    #[error("memory for {buffer} ({bytes} bytes) could not be had: {source}")]
    Allocation { buffer: &'static str, bytes: u64, source: gpu_allocator::AllocationError },
    #[error("a kernel binds {binding}, which nobody provides")]
    UnboundBinding { binding: &'static str },
    #[error("kernel {kernel} could not be built: {result}")]
    Pipeline { kernel: &'static str, result: vk::Result },
    #[error("the device was lost while it ran {pass}")]
    DeviceLost { pass: String },
    #[error("{action} failed: {result}")]
    Vulkan { action: &'static str, result: vk::Result },
}

/// What is taken of a heap, for a message.
fn in_use(used: u64) -> String {
    if used > 0 { format!(" ({used} more are in use)") } else { String::new() }
}

/// Names the call of a Vulkan result.
pub(super) trait Action<T> {
    fn during(self, action: &'static str) -> Result<T, GpuError>;
}

impl<T> Action<T> for Result<T, vk::Result> {
    fn during(self, action: &'static str) -> Result<T, GpuError> {
        self.map_err(|result| match result {
            vk::Result::ERROR_DEVICE_LOST => GpuError::DeviceLost { pass: format!("what came before {action}") },
            result => GpuError::Vulkan { action, result },
        })
    }
}
