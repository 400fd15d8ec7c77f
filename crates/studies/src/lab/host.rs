//! The machine around the device: its memory, its processor, and where it keeps what a later run can use again.

use std::fs;
use std::path::{Path, PathBuf};

use crate::studies::{Cpu, Provenance};
use raywave::gpu::{DeviceDescription, DeviceKind};

/// Folder of what a later run can use again; `None` where `RAYWAVE_CACHE` is `off` or nobody has a home.
pub fn cache_folder() -> Option<PathBuf> {
    if std::env::var_os("RAYWAVE_CACHE").is_some_and(|value| value == "off") {
        return None;
    }
    // The XDG base directory specification: a path that is not absolute is ignored.
    let folder = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    Some(folder("XDG_CACHE_HOME").or_else(|| Some(folder("HOME")?.join(".cache")))?.join("raywave"))
}

/// Bytes of memory that a device has. A software device has the host's, whatever its driver says: lavapipe of Mesa 22.3
/// says 2 GiB on every machine.
pub(super) fn memory(device: &DeviceDescription) -> u64 {
    let of_host = if device.is_software() { available_memory() } else { None };
    of_host.unwrap_or(0).max(device.memory_bytes)
}

/// The processor, as Linux tells of it.
fn cpu() -> Option<Cpu> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let values = |key: &str| {
        let of_key = move |line: &str| {
            let (name, value) = line.split_once(':')?;
            (name.trim() == key).then(|| value.trim().to_owned())
        };
        text.lines().filter_map(of_key).collect::<Vec<_>>()
    };
    Some(Cpu {
        model: values("model name").into_iter().next()?,
        logical_processors: std::thread::available_parallelism().ok()?.get(),
        megahertz: values("cpu MHz").iter().filter_map(|value| value.parse().ok()).reduce(f64::max),
    })
}

/// Adds the device to where a study was made.
pub fn sign(device: &DeviceDescription, provenance: Provenance) -> Provenance {
    Provenance {
        device: device.name.clone(),
        device_kind: device.kind.name().to_owned(),
        driver: device.driver.clone(),
        vulkan_version: device.vulkan_version.clone(),
        subgroup_size_lanes: device.subgroup_size,
        cpu: (device.kind == DeviceKind::Cpu).then(cpu).flatten(),
        ..provenance
    }
}

/// Bytes of memory that this process could still take without others giving way, as far as the system tells: what is free
/// or can be freed, within the limit of its control group.
pub fn available_memory() -> Option<u64> {
    let meminfo = fs::read_to_string("/proc/meminfo").ok()?;
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let free = line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()? << 10;
    let of_group = |name: &str| {
        let group = fs::read_to_string("/proc/self/cgroup").ok()?;
        let group = group.lines().find_map(|line| line.strip_prefix("0::"))?.trim_start_matches('/').to_owned();
        let path = Path::new("/sys/fs/cgroup").join(group).join(name);
        fs::read_to_string(path).ok()?.trim().parse::<u64>().ok()
    };
    // "max" is no number, and no limit.
    let within = of_group("memory.max").zip(of_group("memory.current")).map(|(most, taken)| most.saturating_sub(taken));
    Some(within.map_or(free, |within| within.min(free)))
}
