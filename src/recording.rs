//! Work for a device as plain data: the list of commands that a scheduler asks for and an executor runs.
//!
//! Nothing here touches Vulkan, so schedulers are tested without a device. Buffers are named as in GLSL. No command says
//! what it must wait for: the executor derives that from what each of them reads and writes.

use bytemuck::Pod;

use crate::shaders::Kernel;

/// Commands in order.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// What to run.
    pub commands: Vec<Command>,
    /// The bounce that is being recorded.
    bounce: Option<u32>,
}

/// One step of a recording.
#[derive(Debug, Clone)]
pub enum Command {
    /// Runs a kernel.
    Dispatch(Dispatch),
    /// Writes bytes of the host to a buffer, from its start.
    Upload {
        /// The buffer.
        buffer: &'static str,
        /// No more than the buffer holds.
        contents: Vec<u8>,
    },
    /// Fills a buffer with zeros.
    Clear {
        /// The buffer.
        buffer: &'static str,
    },
    /// Copies the first bytes of a buffer to the start of another one.
    Copy {
        /// The buffer that is read.
        from: &'static str,
        /// The buffer that is written.
        to: &'static str,
        /// No more than either holds.
        bytes: u64,
    },
    /// Hands the first bytes of a buffer to the host.
    Download {
        /// The buffer.
        buffer: &'static str,
        /// No more than the buffer holds; `None` is all of it.
        bytes: Option<u64>,
    },
}

/// A launch of a kernel.
#[derive(Debug, Clone)]
pub struct Dispatch {
    /// The kernel.
    pub kernel: &'static Kernel,
    /// How many workgroups run.
    pub workgroups: Workgroups,
    /// Its push constants.
    pub constants: Vec<u8>,
    /// The bounce that it is a part of; `None` for what a batch begins and ends with. Push constants may name another
    /// bounce: `prepare_dispatch` of bounce n sizes the launches of bounce n + 1.
    pub bounce: Option<u32>,
}

/// The size of a launch, in one dimension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Workgroups {
    /// A number that the host knows.
    Direct(u32),
    /// A number that the device wrote.
    Indirect {
        /// The buffer that holds the three counts.
        buffer: &'static str,
        /// Where in it, in bytes; a multiple of 4.
        offset: u64,
    },
}

impl Command {
    /// The launch that it is, if it is one.
    pub fn dispatch(&self) -> Option<&Dispatch> {
        match self {
            Self::Dispatch(dispatch) => Some(dispatch),
            _ => None,
        }
    }
}

impl Recording {
    /// Appends a launch of `groups` workgroups.
    pub fn dispatch(&mut self, kernel: &'static Kernel, groups: u32, constants: &impl Pod) -> &mut Self {
        self.launch(kernel, Workgroups::Direct(groups), constants)
    }

    /// Appends a launch whose number of workgroups lies in `buffer` at `offset`, in bytes.
    pub fn dispatch_indirect(
        &mut self,
        kernel: &'static Kernel,
        (buffer, offset): (&'static str, usize),
        constants: &impl Pod,
    ) -> &mut Self {
        self.launch(kernel, Workgroups::Indirect { buffer, offset: offset as u64 }, constants)
    }

    fn launch(&mut self, kernel: &'static Kernel, workgroups: Workgroups, constants: &impl Pod) -> &mut Self {
        let (constants, bounce) = (bytemuck::bytes_of(constants).to_vec(), self.bounce);
        self.push(Command::Dispatch(Dispatch { kernel, workgroups, constants, bounce }))
    }

    /// Appends a write of the host's bytes to the start of a buffer.
    pub fn upload(&mut self, buffer: &'static str, contents: &[u8]) -> &mut Self {
        self.push(Command::Upload { buffer, contents: contents.to_vec() })
    }

    /// Appends zeros for all of a buffer.
    pub fn clear(&mut self, buffer: &'static str) -> &mut Self {
        self.push(Command::Clear { buffer })
    }

    /// Appends a copy of the first bytes of a buffer to the start of another one.
    pub fn copy(&mut self, from: &'static str, to: &'static str, bytes: u64) -> &mut Self {
        self.push(Command::Copy { from, to, bytes })
    }

    /// Appends a read of a whole buffer by the host.
    pub fn download(&mut self, buffer: &'static str) -> &mut Self {
        self.push(Command::Download { buffer, bytes: None })
    }

    /// Appends a read of the first bytes of a buffer by the host.
    pub fn download_first(&mut self, buffer: &'static str, bytes: u64) -> &mut Self {
        self.push(Command::Download { buffer, bytes: Some(bytes) })
    }

    /// Appends what belongs to a bounce.
    pub fn bounce(&mut self, bounce: u32, fill: impl FnOnce(&mut Self)) {
        self.bounce = Some(bounce);
        fill(self);
        self.bounce = None;
    }

    /// The launches, in order.
    pub fn dispatches(&self) -> impl Iterator<Item = &Dispatch> {
        self.commands.iter().filter_map(Command::dispatch)
    }

    fn push(&mut self, command: Command) -> &mut Self {
        self.commands.push(command);
        self
    }
}
