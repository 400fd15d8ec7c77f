//! What the compiler made of a render's kernels, for people and as JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::measure::stage;
use crate::gpu::{DeviceDescription, Executable, Figure, FigureValue};
use crate::render::{RenderError, Session};
use crate::studies::{CompiledKernelRow, ExecutableRow, FigureRow};

/// Compiles the kernels of a session once more, in pipelines of their own, and asks the driver about them. In the order
/// in which a bounce runs them.
///
/// # Errors
/// When a kernel cannot be built.
pub fn kernels(session: &Session, device: &DeviceDescription) -> Result<Vec<CompiledKernelRow>, RenderError> {
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

/// As JSON; `null` where the driver does not tell.
pub fn record(kernels: &[CompiledKernelRow]) -> Value {
    let told = kernels.iter().any(|kernel| kernel.executables.is_some());
    if told { json!(kernels) } else { Value::Null }
}

/// As lines.
pub fn lines(kernels: &[CompiledKernelRow], device: &DeviceDescription) -> String {
    if kernels.iter().all(|kernel| kernel.executables.is_none()) {
        return format!("\ncompiled         {} does not tell what it made of kernels\n", device.driver);
    }
    let mut text = String::new();
    for kernel in kernels {
        for ExecutableRow { name, subgroup_size_lanes, figures } in kernel.executables.iter().flatten() {
            let _ = writeln!(text, "\n{:<24} {name}, {subgroup_size_lanes} lanes a subgroup", kernel.kernel);
            for FigureRow { name, value, .. } in figures {
                let _ = writeln!(text, "  {name:<30} {:>14}", value.to_string());
            }
        }
        if let Some(share) = kernel.occupancy_by_registers {
            let _ = writeln!(text, "  {:<30} {:>12.0} %", "occupancy by registers", 100.0 * share);
        }
    }
    text
}
