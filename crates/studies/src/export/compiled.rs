//! Statistics of compiled kernels, as rows next to their times.

use serde_json::Value;

use crate::studies::{CombinationReport, ExecutableRow};

/// Said where no kernel has executables.
pub const UNTOLD: &str = "The driver does not tell what it made of the kernels.";
/// The heading of [`Row::occupancy`].
pub const OCCUPANCY: &str = "occupancy by registers";

/// A kernel of a combination, and an executable that the driver made of it.
pub struct Row<'a> {
    /// Of the kernel, and of the executable where there are several.
    pub name: String,
    /// Of the kernel in the median run; `None` before it was timed.
    pub gpu_seconds: Option<f64>,
    /// Of the kernel.
    pub spirv_instructions: u64,
    /// Of the kernel, in [0, 1].
    pub occupancy: Option<f64>,
    /// `None` where the driver does not report it.
    pub executable: Option<&'a ExecutableRow>,
}

impl Row<'_> {
    /// Lanes of a subgroup.
    pub fn lanes(&self) -> Option<u32> {
        Some(self.executable?.subgroup_size_lanes)
    }

    /// What the driver counts by that name.
    pub fn figure(&self, name: &str) -> Option<&Value> {
        Some(&self.executable?.figures.iter().find(|figure| figure.name == name)?.value)
    }
}

/// The kernels of a combination: one row for each, or for each of its executables.
pub fn kernels<'a>(combination: &'a CombinationReport) -> Vec<Row<'a>> {
    let timed = combination.typical.iter().flat_map(|typical| &typical.kernels);
    let mut rows = Vec::new();
    for kernel in combination.first.iter().flat_map(|first| &first.compiled_kernels) {
        let executables = kernel.executables.as_deref().unwrap_or_default();
        let row = |executable: Option<&'a ExecutableRow>| Row {
            name: match executable {
                Some(executable) if executables.len() > 1 => format!("{}, {}", kernel.kernel, executable.name),
                _ => kernel.kernel.clone(),
            },
            gpu_seconds: timed.clone().find(|timed| timed.kernel == kernel.kernel).map(|timed| timed.gpu_seconds),
            spirv_instructions: kernel.spirv_instructions,
            occupancy: kernel.occupancy_by_registers,
            executable,
        };
        if executables.is_empty() {
            rows.push(row(None));
        }
        rows.extend(executables.iter().map(|executable| row(Some(executable))));
    }
    rows
}

/// The names of all that drivers count, in their order.
pub fn figures<'a>(rows: impl Iterator<Item = &'a Row<'a>>) -> Vec<&'a str> {
    let mut names: Vec<&str> = Vec::new();
    for figure in rows.filter_map(|row| row.executable).flat_map(|executable| &executable.figures) {
        if !names.contains(&figure.name.as_str()) {
            names.push(&figure.name);
        }
    }
    names
}
