//! What a driver tells of compiled kernels, for people and as JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

use crate::gpu::{CompiledKernel, DeviceDescription, Executable, Figure, FigureValue};

/// The share of its threads that a multiprocessor can hold of a kernel, by its registers, where both are known.
fn occupancy(kernel: &CompiledKernel, device: &DeviceDescription, workgroup_size: u32) -> Option<f64> {
    Some(device.multiprocessors?.occupancy(kernel.registers()?, workgroup_size))
}

/// As JSON; `null` where the driver does not tell.
pub fn record(kernels: Option<&[CompiledKernel]>, device: &DeviceDescription, workgroup_size: u32) -> Value {
    let figure = |Figure { name, description, value }: &Figure| {
        let value = match *value {
            FigureValue::Bool(value) => json!(value),
            FigureValue::Signed(value) => json!(value),
            FigureValue::Unsigned(value) => json!(value),
            FigureValue::Float(value) => json!(value),
        };
        json!({ "name": name, "description": description, "value": value })
    };
    let executable = |Executable { name, subgroup_size, figures }: &Executable| {
        json!({
            "name": name,
            "subgroup_size_lanes": subgroup_size,
            "figures": figures.iter().map(figure).collect::<Vec<_>>(),
        })
    };
    let kernel = |kernel: &CompiledKernel| {
        json!({
            "kernel": kernel.kernel,
            "executables": kernel.executables.iter().map(executable).collect::<Vec<_>>(),
            "occupancy_by_registers": occupancy(kernel, device, workgroup_size),
        })
    };
    kernels.map_or(Value::Null, |kernels| kernels.iter().map(kernel).collect())
}

/// As lines.
pub fn lines(kernels: Option<&[CompiledKernel]>, device: &DeviceDescription, workgroup_size: u32) -> String {
    let Some(kernels) = kernels else {
        return format!("\ncompiled         {} does not tell what it made of kernels\n", device.driver);
    };
    let mut text = String::new();
    for kernel in kernels {
        for Executable { name, subgroup_size, figures } in &kernel.executables {
            let _ = writeln!(text, "\n{:<24} {name}, {subgroup_size} lanes a subgroup", kernel.kernel);
            for Figure { name, value, .. } in figures {
                let value = match value {
                    FigureValue::Bool(value) => value.to_string(),
                    FigureValue::Signed(value) => value.to_string(),
                    FigureValue::Unsigned(value) => value.to_string(),
                    FigureValue::Float(value) => value.to_string(),
                };
                let _ = writeln!(text, "  {name:<30} {value:>14}");
            }
        }
        if let Some(share) = occupancy(kernel, device, workgroup_size) {
            let _ = writeln!(text, "  {:<30} {:>12.0} %", "occupancy by registers", 100.0 * share);
        }
    }
    text
}
