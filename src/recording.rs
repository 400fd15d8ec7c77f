//! A frame as plain data: the list of passes that a scheduler asks for and an executor runs.
//!
//! Nothing here touches Vulkan, so schedulers are tested without a device.

use crate::layout::Batch;

/// Passes in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// What to run.
    pub passes: Vec<Pass>,
}

/// One step of a recording.
#[derive(Debug, Clone, PartialEq)]
pub enum Pass {
    /// Runs a kernel over `groups` workgroups.
    Dispatch {
        /// Name of the kernel.
        kernel: &'static str,
        /// Workgroups, in one dimension.
        groups: u32,
        /// Push constants.
        batch: Batch,
    },
    /// Runs a kernel over as many workgroups as the device wrote.
    DispatchIndirect {
        /// Name of the kernel.
        kernel: &'static str,
        /// Where the three counts lie in the `control` buffer, in bytes.
        arguments: u64,
        /// Push constants.
        batch: Batch,
    },
}

impl Recording {
    /// Appends a direct dispatch.
    pub fn dispatch(&mut self, kernel: &'static str, groups: u32, batch: Batch) {
        self.passes.push(Pass::Dispatch { kernel, groups, batch });
    }

    /// Appends an indirect dispatch whose counts lie at `arguments` in `control`.
    pub fn dispatch_indirect(&mut self, kernel: &'static str, arguments: usize, batch: Batch) {
        self.passes.push(Pass::DispatchIndirect { kernel, arguments: arguments as u64, batch });
    }
}
