//! A frame as plain data: the list of passes that a scheduler asks for and an executor runs.
//!
//! Nothing here touches Vulkan, so schedulers are tested without a device.

use crate::layout::Batch;

/// Passes in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// What to run.
    pub passes: Vec<Pass>,
    /// The bounce that is being recorded.
    bounce: Option<u32>,
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
        /// The bounce that it is a part of; `None` for what a batch begins and ends with.
        of_bounce: Option<u32>,
    },
    /// Runs a kernel over as many workgroups as the device wrote.
    DispatchIndirect {
        /// Name of the kernel.
        kernel: &'static str,
        /// Where the three counts lie in the `control` buffer, in bytes.
        arguments: u64,
        /// Push constants.
        batch: Batch,
        /// As for `Dispatch`.
        of_bounce: Option<u32>,
    },
}

impl Pass {
    /// The bounce that it is a part of. Its push constants may tell another one: the launches of a bounce are sized by
    /// the last pass but one of the bounce before.
    pub fn of_bounce(&self) -> Option<u32> {
        let (Self::Dispatch { of_bounce, .. } | Self::DispatchIndirect { of_bounce, .. }) = self;
        *of_bounce
    }
}

impl Recording {
    /// Appends a direct dispatch.
    pub fn dispatch(&mut self, kernel: &'static str, groups: u32, batch: Batch) {
        self.passes.push(Pass::Dispatch { kernel, groups, batch, of_bounce: self.bounce });
    }

    /// Appends an indirect dispatch whose counts lie at `arguments` in `control`.
    pub fn dispatch_indirect(&mut self, kernel: &'static str, arguments: usize, batch: Batch) {
        self.passes.push(Pass::DispatchIndirect { kernel, arguments: arguments as u64, batch, of_bounce: self.bounce });
    }

    /// Appends what belongs to a bounce.
    pub fn bounce(&mut self, bounce: u32, fill: impl FnOnce(&mut Self)) {
        self.bounce = Some(bounce);
        fill(self);
        self.bounce = None;
    }
}
