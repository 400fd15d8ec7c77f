//! What the compiler made of a render's kernels, in the order in which a bounce runs them.

use serde_json::json;

use crate::studies::{CompiledKernelRow, ExecutableRow, FigureRow};
use raywave::gpu::{DeviceDescription, Executable, Figure, FigureValue};
use raywave::render::{RenderError, Session};

/// The order in which a bounce runs its kernels, for tables.
const KERNEL_ORDER: [&str; 14] = [
    "megakernel",
    "bounce",
    "bounce_packets",
    "generate",
    "extend",
    "extend_packets",
    "count_bins",
    "place_bins",
    "sort_rays",
    "shade",
    "prepare_dispatch",
    "connect",
    "connect_packets",
    "resolve",
];

/// The place of a kernel in a bounce; `None` of one that is no part of it.
pub fn stage(kernel: &str) -> Option<usize> {
    KERNEL_ORDER.iter().position(|name| *name == kernel)
}

/// Compiles the kernels of a session once more, in pipelines of their own, and asks the driver about them. In the order
/// in which a bounce runs them.
///
/// # Errors
/// When a kernel cannot be built.
pub fn compiled_kernels(session: &Session, device: &DeviceDescription) -> Result<Vec<CompiledKernelRow>, RenderError> {
    let compiled = session.compiled_kernels()?;
    let kernel = |(name, instructions): (&'static str, usize)| {
        let told = compiled.iter().flatten().find(|compiled| compiled.kernel == name);
        let executables = told.map(|told| {
            let executable = |executable: &Executable| ExecutableRow {
                name: executable.name.clone(),
                subgroup_size_lanes: executable.subgroup_size,
                figures: executable.figures.iter().map(figure).collect(),
            };
            told.executables.iter().map(executable).collect()
        });
        let occupancy = || Some(device.multiprocessors?.occupancy(told?.registers()?, session.workgroup_size()));
        CompiledKernelRow {
            kernel: name.to_owned(),
            spirv_instructions: instructions as u64,
            executables,
            occupancy_by_registers: occupancy(),
        }
    };
    let mut rows: Vec<_> = session.instructions().map(kernel).collect();
    rows.sort_by_key(|row| stage(&row.kernel));
    Ok(rows)
}

fn figure(Figure { name, description, value }: &Figure) -> FigureRow {
    let value = match *value {
        FigureValue::Bool(value) => json!(value),
        FigureValue::Signed(value) => json!(value),
        FigureValue::Unsigned(value) => json!(value),
        FigureValue::Float(value) => json!(value),
    };
    FigureRow { name: name.clone(), description: description.clone(), value }
}
