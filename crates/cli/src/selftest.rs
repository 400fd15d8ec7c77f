//! `raywave selftest`.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::ensure;
use indicatif::HumanCount;
use serde::Serialize;

use super::compare::provenance;
use super::devices::limits;
use super::{check_text_output, open_device, output_path, print, write_text};
use raywave::gpu::DeviceDescription;
use raywave::whole_file::is_stdout;
use raywave_studies::lab::sign;
use raywave_studies::selftest::{Bench, Row, Verdict, checks};
use raywave_studies::studies::Provenance;

/// Check what the tracer relies on, each on the device against the CPU
///
/// What it prints belongs into a bug report. Exits with 1 where something is off that spoils results, and names it.
#[derive(Debug, clap::Args)]
pub struct SelftestArguments {
    /// Checks to run, by name; all without
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    only: Vec<String>,
    /// Print the names of the checks and what they look at, and run none
    #[arg(long)]
    list: bool,
    /// Device, by number or part of its name; see `raywave devices`
    #[arg(long, env = "RAYWAVE_DEVICE")]
    device: Option<String>,
    /// Write everything, as JSON; without FILE to stdout in place of the table
    #[arg(long, value_name = "FILE", value_parser = output_path(), num_args = 0..=1, default_missing_value = "-")]
    json: Option<PathBuf>,
    /// No progress
    #[arg(long, short)]
    quiet: bool,
}

/// Checks that found what spoils results.
#[derive(Debug, thiserror::Error)]
#[error("off: {0}")]
pub struct OffDevice(String);

pub fn run(arguments: &SelftestArguments) -> anyhow::Result<()> {
    if arguments.list {
        return print(&checks().map(|check| format!("{:<14} {}\n", check.name, check.checked)).collect::<String>());
    }
    let names: Vec<&str> = checks().map(|check| check.name).collect();
    for name in &arguments.only {
        ensure!(names.contains(&name.as_str()), "--only {name} is no check; the checks are {}", names.join(", "));
    }
    arguments.json.as_deref().map_or(Ok(()), check_text_output)?;

    let device = open_device(arguments.device.as_deref())?;
    let description = device.description();
    let report = |rows| Report { provenance: sign(description, provenance()), limits: Limits::of(description), rows };
    let bench = Bench::new(&device);
    let is_chosen = |name| arguments.only.is_empty() || arguments.only.iter().any(|wanted| wanted == name);
    let chosen: Vec<_> = checks().filter(|check| is_chosen(check.name)).collect();
    let mut rows = Vec::new();
    for (number, check) in chosen.iter().enumerate() {
        if !arguments.quiet {
            tell!("{} of {}: {}", number + 1, chosen.len(), check.name);
        }
        rows.push(check.run(&bench));
    }
    let report = report(rows);
    let json = serde_json::to_string_pretty(&report)? + "\n";
    let written = arguments.json.as_ref().map_or(Ok(()), |path| write_text(path, &json));
    if !arguments.json.as_deref().is_some_and(is_stdout) {
        print(&report.lines(description)?)?;
    }
    written?;
    report.judge()
}

/// What was found, and of what.
#[derive(Debug, Serialize)]
struct Report {
    provenance: Provenance,
    limits: Limits,
    rows: Vec<Row>,
}

/// What of a device decides how raywave runs on it.
#[derive(Debug, Serialize)]
struct Limits {
    subgroup_ballot: bool,
    max_workgroup_size: u32,
    max_workgroups: u32,
    max_storage_buffer_bytes: u64,
    max_texel_buffer_elements: u64,
    memory_bytes: u64,
    /// Nanoseconds per tick.
    timestamp_period: f32,
}

impl Limits {
    fn of(device: &DeviceDescription) -> Self {
        Self {
            subgroup_ballot: device.subgroup_ballot,
            max_workgroup_size: device.max_workgroup_size,
            max_workgroups: device.max_workgroups,
            max_storage_buffer_bytes: device.max_storage_buffer_bytes,
            max_texel_buffer_elements: device.max_texel_buffer_elements,
            memory_bytes: device.memory_bytes,
            timestamp_period: device.timestamp_period,
        }
    }
}

impl Report {
    /// Names what is off and what it spoils.
    fn judge(&self) -> anyhow::Result<()> {
        let off = self.rows.iter().filter(|row| row.verdict == Verdict::Off);
        let off: Vec<String> = off.map(|row| format!("{} ({})", row.name, row.spoils)).collect();
        if off.is_empty() { Ok(()) } else { Err(OffDevice(off.join(", ")).into()) }
    }

    fn lines(&self, device: &DeviceDescription) -> anyhow::Result<String> {
        let mut text = format!("raywave {}\n{}\n", self.provenance.raywave_version, device.name);
        text += &limits(device)?;
        if let Some(cpu) = &self.provenance.cpu {
            writeln!(text, "  processor        {cpu}")?;
        }
        text += "\n";
        for row in &self.rows {
            let verdict = match row.verdict {
                Verdict::Ok => "ok",
                Verdict::Property => "property",
                Verdict::Off => "OFF",
            };
            writeln!(text, "{verdict:<9} {:<14} {}: {} cases", row.name, row.checked, HumanCount(row.cases))?;
            writeln!(text, "          {}", row.found)?;
            if row.verdict == Verdict::Off {
                writeln!(text, "          spoilt: {}", row.spoils)?;
            }
        }
        let count = |verdict| self.rows.iter().filter(|row| row.verdict == verdict).count();
        let seconds: f64 = self.rows.iter().map(|row| row.seconds).sum();
        writeln!(
            text,
            "\n{} checks in {seconds:.1} s: {} ok, {} properties of the device, {} off",
            self.rows.len(),
            count(Verdict::Ok),
            count(Verdict::Property),
            count(Verdict::Off),
        )?;
        Ok(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exit_code;

    #[test]
    fn what_is_off_is_named_and_exits_with_1() {
        let row = |name, verdict| Row {
            name,
            checked: "",
            cases: 1,
            verdict,
            found: String::new(),
            spoils: "the image",
            numbers: serde_json::Map::new(),
            seconds: 0.0,
        };
        let limits = Limits {
            subgroup_ballot: false,
            max_workgroup_size: 128,
            max_workgroups: 1,
            max_storage_buffer_bytes: 1,
            max_texel_buffer_elements: 1,
            memory_bytes: 1,
            timestamp_period: 1.0,
        };
        let rows = vec![row("a", Verdict::Ok), row("b", Verdict::Property)];
        let mut report = Report { provenance: Provenance::default(), limits, rows };
        assert!(report.judge().is_ok());
        report.rows.extend([row("c", Verdict::Off), row("d", Verdict::Off)]);
        let error = report.judge().expect_err("two are off");
        assert_eq!(error.to_string(), "off: c (the image), d (the image)");
        assert_eq!(format!("{:?}", exit_code(&error)), format!("{:?}", std::process::ExitCode::from(1)));
    }
}
