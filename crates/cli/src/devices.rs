//! `raywave devices`.

use std::fmt::Write as _;

use anyhow::ensure;

use raywave::gpu::{DeviceDescription, Discovery, Instance};

use super::{print, readable_bytes};

#[derive(Debug, clap::Args)]
pub struct DevicesArguments {
    /// Device that would be chosen, by number or part of its name
    #[arg(long, env = "RAYWAVE_DEVICE")]
    device: Option<String>,
    /// Say what keeps devices from being found: the loader, drivers and their files, environment variables, permissions
    #[arg(long)]
    why: bool,
}

pub fn run(arguments: &DevicesArguments) -> anyhow::Result<()> {
    if arguments.why {
        return explain();
    }
    let instance = Instance::new(false)?;
    let devices = instance.devices()?;
    let chosen = instance.choose(arguments.device.as_deref());
    let mut text = String::new();
    for (number, device) in devices.iter().enumerate() {
        let mark = if chosen.as_ref().is_ok_and(|chosen| chosen.is_same(device)) { "  (chosen)" } else { "" };
        writeln!(text, "{number} {}{mark}", device.name)?;
        text += &limits(device)?;
        if let Some(reason) = &device.unusable {
            writeln!(text, "  cannot be used   {reason}")?;
        }
    }
    print(&text)?;
    chosen?;
    Ok(())
}

/// What was found on the way to the devices, a line each.
fn explain() -> anyhow::Result<()> {
    let discovery = Discovery::new();
    let lines: Vec<String> = discovery.findings.iter().map(|finding| format!("{finding}\n")).collect();
    print(&lines.concat())?;
    ensure!(discovery.has_device, "there is no device that can be used; the problems say why");
    Ok(())
}

/// What a device is and can, a line each.
pub fn limits(device: &DeviceDescription) -> anyhow::Result<String> {
    let mut text = String::new();
    writeln!(text, "  kind             {}", device.kind.name())?;
    writeln!(text, "  driver           {}", device.driver)?;
    writeln!(text, "  Vulkan           {}", device.vulkan_version)?;
    let ballot = if device.subgroup_ballot { "with ballots" } else { "no ballots" };
    writeln!(text, "  subgroup         {} lanes, {ballot}", device.subgroup_size)?;
    writeln!(text, "  workgroup        {} invocations at most", device.max_workgroup_size)?;
    writeln!(text, "  storage buffer   {} at most", readable_bytes(device.max_storage_buffer_bytes))?;
    writeln!(text, "  texel buffer     {} texels at most", device.max_texel_buffer_elements)?;
    writeln!(text, "  memory           {}", readable_bytes(device.memory_bytes))?;
    let clock = match device.timestamp_period {
        0.0 => "no timestamps".to_owned(),
        period => format!("{period} ns a tick"),
    };
    writeln!(text, "  clock            {clock}")?;
    Ok(text)
}
