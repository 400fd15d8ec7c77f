//! What the compiler made of a render's kernels, for people and as JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

use raywave::gpu::DeviceDescription;
use raywave_studies::studies::{CompiledKernelRow, ExecutableRow, FigureRow};

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
