//! What a driver reports about the kernels that it compiled: registers, memory, code.

use std::ffi::{CStr, c_char};
use std::sync::Arc;

use ash::{khr, vk};

use super::device::Shared;
use super::error::{Action, GpuError};
use super::pipeline::Pipelines;
use crate::shaders::Specialized;

/// A kernel as a driver compiled it.
#[derive(Debug, Clone, PartialEq)]
pub struct CompiledKernel {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// What the driver made of it; most make one executable.
    pub executables: Vec<Executable>,
}

/// Machine code that a driver made of a kernel. Names and descriptions are the driver's.
#[derive(Debug, Clone, PartialEq)]
pub struct Executable {
    /// Its name.
    pub name: String,
    /// Lanes of a subgroup.
    pub subgroup_size: u32,
    /// What the driver counts, in its order.
    pub figures: Vec<Figure>,
}

/// A number that a driver reports about an executable.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// What it is called.
    pub name: String,
    /// What it is.
    pub description: String,
    /// The number.
    pub value: FigureValue,
}

/// Value of a figure, in the type that the driver gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(missing_docs, reason = "the names say it")]
pub enum FigureValue {
    Bool(bool),
    Signed(i64),
    Unsigned(u64),
    Float(f64),
}

/// What is known of a streaming multiprocessor, to compute how many warps it can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Multiprocessors {
    /// On the device.
    pub count: u32,
    /// Warps that one holds, at most.
    pub warps: u32,
}

impl Multiprocessors {
    /// Registers of 32 bits of one: the same on all NVIDIA cards since Maxwell (CUDA C++ Programming Guide, table
    /// "Technical Specifications per Compute Capability").
    const REGISTERS: u32 = 65_536;
    /// Registers are allocated to warps in units of this many.
    const REGISTER_UNIT: u32 = 256;
    const LANES: u32 = 32;

    /// Occupancy: the share of a multiprocessor's warps that can be resident, for a kernel of that many registers a lane in
    /// workgroups of that size, as far as registers limit it. Shared memory may leave fewer.
    pub fn occupancy(&self, registers: u64, workgroup_size: u32) -> f64 {
        let warp_registers =
            (registers as u32).max(1).saturating_mul(Self::LANES).next_multiple_of(Self::REGISTER_UNIT);
        let workgroup_warps = workgroup_size.div_ceil(Self::LANES).max(1);
        let warps = (Self::REGISTERS / warp_registers).min(self.warps);
        f64::from(warps / workgroup_warps * workgroup_warps) / f64::from(self.warps)
    }
}

impl CompiledKernel {
    /// Registers of an invocation, where the driver reports them: the most of any executable.
    pub fn registers(&self) -> Option<u64> {
        let figures = self.executables.iter().flat_map(|executable| &executable.figures);
        let registers = figures.filter(|figure| figure.name.eq_ignore_ascii_case("register count"));
        registers.filter_map(|figure| figure.value.unsigned()).max()
    }
}

impl FigureValue {
    /// The number, if it is a count.
    fn unsigned(self) -> Option<u64> {
        match self {
            Self::Unsigned(value) => Some(value),
            Self::Signed(value) => value.try_into().ok(),
            Self::Bool(_) | Self::Float(_) => None,
        }
    }
}

/// Compiles kernels in pipelines of their own and asks the driver about them. `None` where it has no answers.
pub(super) fn compiled_kernels(
    shared: &Arc<Shared>,
    kernels: &[(&'static str, Specialized)],
) -> Result<Option<Vec<CompiledKernel>>, GpuError> {
    if !shared.description.tells_executables {
        return Ok(None);
    }
    let pipelines = Pipelines::to_be_described(shared, kernels)?;
    let loader = khr::pipeline_executable_properties::Device::new(&shared.instance.raw, &shared.raw);
    let compiled = pipelines.names().into_iter().map(|kernel| {
        let pipeline = pipelines.get(kernel).pipeline;
        Ok(CompiledKernel { kernel, executables: executables(shared, &loader, pipeline)? })
    });
    compiled.collect::<Result<_, _>>().map(Some)
}

/// Asks for the executables of a pipeline that was made to be described.
fn executables(
    shared: &Arc<Shared>,
    loader: &khr::pipeline_executable_properties::Device,
    pipeline: vk::Pipeline,
) -> Result<Vec<Executable>, GpuError> {
    let (device, functions) = (shared.raw.handle(), loader.fp());
    let info = vk::PipelineInfoKHR::default().pipeline(pipeline);
    let mut count = 0;
    // SAFETY: the extension is enabled and the pipeline alive; a null array asks only for the count.
    unsafe {
        (functions.get_pipeline_executable_properties_khr)(device, &info, &mut count, std::ptr::null_mut()).result()
    }
    .during("counting executables")?;
    let mut properties = vec![vk::PipelineExecutablePropertiesKHR::default(); count as usize];
    // SAFETY: as above; the array has room for as many as are asked for.
    unsafe {
        (functions.get_pipeline_executable_properties_khr)(device, &info, &mut count, properties.as_mut_ptr()).result()
    }
    .during("listing executables")?;
    properties.truncate(count as usize);

    let executable = |(index, properties): (u32, &vk::PipelineExecutablePropertiesKHR<'_>)| {
        let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline).executable_index(index);
        let mut count = 0;
        // SAFETY: the pipeline was made to capture statistics and has an executable of that index.
        unsafe {
            (functions.get_pipeline_executable_statistics_khr)(device, &info, &mut count, std::ptr::null_mut()).result()
        }
        .during("counting an executable's figures")?;
        let mut figures = vec![vk::PipelineExecutableStatisticKHR::default(); count as usize];
        // SAFETY: as above; the array has room for as many as are asked for.
        unsafe {
            (functions.get_pipeline_executable_statistics_khr)(device, &info, &mut count, figures.as_mut_ptr()).result()
        }
        .during("reading an executable's figures")?;
        figures.truncate(count as usize);
        Ok(Executable {
            name: text(&properties.name),
            subgroup_size: properties.subgroup_size,
            figures: figures.iter().map(figure).collect(),
        })
    };
    (0..).zip(&properties).map(executable).collect()
}

fn figure(raw: &vk::PipelineExecutableStatisticKHR<'_>) -> Figure {
    use vk::PipelineExecutableStatisticFormatKHR as Format;
    // SAFETY: the driver says which member of the union it has written; all bits are valid for each.
    let value = unsafe {
        match raw.format {
            Format::BOOL32 => FigureValue::Bool(raw.value.b32 != 0),
            Format::INT64 => FigureValue::Signed(raw.value.i64),
            Format::FLOAT64 => FigureValue::Float(raw.value.f64),
            _ => FigureValue::Unsigned(believable(raw.value.u64)),
        }
    };
    Figure { name: text(&raw.name), description: text(&raw.description), value }
}

/// The count that a driver can have meant. NVIDIA's (580.159) leaves 16 in the upper word of the bytes of local memory; no
/// kernel has 2^32 of anything.
fn believable(count: u64) -> u64 {
    if count >> 32 == 16 { count & u64::from(u32::MAX) } else { count }
}

/// The text that ends at the first zero; all of it where the driver forgot that.
fn text(raw: &[c_char]) -> String {
    let bytes: Vec<u8> = raw.iter().map(|&c| c as u8).collect();
    CStr::from_bytes_until_nul(&bytes)
        .map_or_else(|_| String::from_utf8_lossy(&bytes), CStr::to_string_lossy)
        .into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_decide_how_many_warps_there_are() {
        let cards = Multiprocessors { count: 132, warps: 64 };
        // Half of the warps by 64 registers, all by 32; whole workgroups of eight warps by 72.
        for (registers, share) in
            [(16, 1.0), (32, 1.0), (33, 48.0 / 64.0), (64, 0.5), (72, 24.0 / 64.0), (255, 8.0 / 64.0)]
        {
            assert_eq!(cards.occupancy(registers, 256), share, "{registers} registers");
        }
        // A workgroup that does not fit.
        assert_eq!(cards.occupancy(255, 1024), 0.0);
        assert_eq!(cards.occupancy(64, 1024), 0.5);
    }

    #[test]
    fn registers_are_found_by_their_name() {
        let figure = |name: &str, value| Figure { name: name.to_owned(), description: String::new(), value };
        let executable = |figures| Executable { name: "main".to_owned(), subgroup_size: 32, figures };
        let kernel = |executables| CompiledKernel { kernel: "extend", executables };
        assert_eq!(kernel(vec![]).registers(), None);
        let told =
            [figure("Binary Size", FigureValue::Unsigned(4096)), figure("Register Count", FigureValue::Unsigned(64))];
        assert_eq!(kernel(vec![executable(told.to_vec())]).registers(), Some(64));
        let signed = vec![figure("Register Count", FigureValue::Signed(48))];
        assert_eq!(kernel(vec![executable(signed), executable(told.to_vec())]).registers(), Some(64));
    }
}
