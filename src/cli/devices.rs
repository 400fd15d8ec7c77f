//! `raywave devices`.

use crate::gpu::{DeviceKind, Instance};

use super::readable_bytes;

#[derive(Debug, clap::Args)]
pub struct DevicesArguments {
    /// Device that would be chosen, by number or part of its name
    #[arg(long, env = "RAYWAVE_DEVICE")]
    device: Option<String>,
}

pub fn run(arguments: &DevicesArguments) -> anyhow::Result<()> {
    let instance = Instance::new(false)?;
    let devices = instance.devices()?;
    let chosen = instance.choose(arguments.device.as_deref()).map(|device| device.name);
    for (number, device) in devices.iter().enumerate() {
        let mark = if chosen.as_ref().is_ok_and(|name| *name == device.name) { "  (chosen)" } else { "" };
        println!("{number} {}{mark}", device.name);
        println!("  kind             {}", kind_name(device.kind));
        println!("  driver           {}", device.driver);
        println!("  Vulkan           {}", device.vulkan_version);
        let ballot = if device.subgroup_ballot { "with ballots" } else { "no ballots" };
        println!("  subgroup         {} lanes, {ballot}", device.subgroup_size);
        println!("  workgroup        {} invocations at most", device.max_workgroup_size);
        println!("  storage buffer   {} at most", readable_bytes(device.max_storage_buffer_bytes));
        println!("  texel buffer     {} texels at most", device.max_texel_buffer_elements);
        println!("  memory           {}", readable_bytes(device.memory_bytes));
        let clock = match device.timestamp_period {
            0.0 => "no timestamps".to_owned(),
            period => format!("{period} ns a tick"),
        };
        println!("  clock            {clock}");
        if let Some(reason) = &device.unusable {
            println!("  cannot be used   {reason}");
        }
    }
    chosen?;
    Ok(())
}

/// A kind of device for people and for `--stats`.
pub fn kind_name(kind: DeviceKind) -> &'static str {
    match kind {
        DeviceKind::Discrete => "discrete",
        DeviceKind::Integrated => "integrated",
        DeviceKind::Virtual => "virtual",
        DeviceKind::Cpu => "cpu",
        DeviceKind::Other => "other",
    }
}
