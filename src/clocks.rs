//! Clocks, power, temperature and throttling of a device, as far as its driver reports them.
//!
//! A speed means little without the clock that it was reached at. NVIDIA's drivers report it through NVML, a library
//! that is loaded if there is one; for other devices nothing is known. This room knows nothing of Vulkan: it identifies
//! a device by the UUID that all interfaces to it share.

use std::sync::OnceLock;

use nvml_wrapper::Nvml;
use nvml_wrapper::bitmasks::device::ThrottleReasons;
use nvml_wrapper::enum_wrappers::device::{Clock, TemperatureSensor};
use serde::{Deserialize, Serialize};

/// The state of a device at a time. What its driver does not report is `None`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ClockState {
    /// Clock of its processors.
    pub sm_megahertz: Option<u32>,
    /// Clock of its memory.
    pub memory_megahertz: Option<u32>,
    /// Power that it draws, with its board.
    pub power_watts: Option<f64>,
    /// Temperature of the chip.
    pub temperature_celsius: Option<u32>,
    /// Why its clocks are lower than they could be, by NVML's names; empty if they are not.
    pub throttle_reasons: Option<Vec<String>>,
}

/// A source of one device's clocks: its driver, or a fake one in tests.
pub trait Clocks {
    /// The state of the device now.
    fn state(&self) -> ClockState;
}

/// The clocks of the device of that UUID; `None` if nothing reports them.
pub fn of_device(uuid: [u8; 16]) -> Option<Box<dyn Clocks>> {
    let device = nvml()?.device_by_uuid(nvidia_name(uuid)).ok()?;
    Some(Box::new(NvidiaClocks(device)))
}

/// The library, loaded once a process.
fn nvml() -> Option<&'static Nvml> {
    static NVML: OnceLock<Option<Nvml>> = OnceLock::new();
    let load = || {
        // The name without a version exists only where development packages are installed.
        let versioned = Nvml::builder().lib_path("libnvidia-ml.so.1".as_ref()).init();
        versioned.or_else(|_| Nvml::init()).ok()
    };
    NVML.get_or_init(load).as_ref()
}

/// A UUID as NVML writes it.
fn nvidia_name(uuid: [u8; 16]) -> String {
    let digits: String = uuid.iter().map(|byte| format!("{byte:02x}")).collect();
    let parts = [0..8, 8..12, 12..16, 16..20, 20..32].map(|part| &digits[part]);
    format!("GPU-{}", parts.join("-"))
}

struct NvidiaClocks(nvml_wrapper::Device<'static>);

impl Clocks for NvidiaClocks {
    fn state(&self) -> ClockState {
        let device = &self.0;
        let names = |reasons: ThrottleReasons| reasons.iter_names().map(|(name, _)| name.to_lowercase()).collect();
        ClockState {
            sm_megahertz: device.clock_info(Clock::SM).ok(),
            memory_megahertz: device.clock_info(Clock::Memory).ok(),
            power_watts: device.power_usage().ok().map(|milliwatts| f64::from(milliwatts) / 1e3),
            temperature_celsius: device.temperature(TemperatureSensor::Gpu).ok(),
            throttle_reasons: device.current_throttle_reasons().ok().map(names),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uuids_are_written_as_nvml_does() {
        let uuid = std::array::from_fn(|i| 0x11 * i as u8);
        assert_eq!(nvidia_name(uuid), "GPU-00112233-4455-6677-8899-aabbccddeeff");
    }

    #[test]
    fn a_device_that_nothing_tells_of_has_no_clocks() {
        assert!(of_device([0; 16]).is_none());
    }

    #[test]
    fn what_is_not_told_is_null() {
        let json = serde_json::to_value(ClockState::default()).expect("it becomes JSON");
        for key in ["sm_megahertz", "memory_megahertz", "power_watts", "temperature_celsius", "throttle_reasons"] {
            assert!(json[key].is_null() && json.get(key).is_some(), "{key}");
        }
    }
}
