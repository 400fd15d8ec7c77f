//! The device's clock, calibrated against the host's: VK_KHR_calibrated_timestamps, or the extension of EXT that it comes from.

use std::ffi::CStr;
use std::time::{Duration, Instant};

use ash::{ext, khr, vk};

use super::device::Shared;
use super::error::{Action, GpuError};
use super::instance::Instance;

/// How times of the device were brought to the host's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alignment {
    /// Both clocks were read at once, after each submission. They may be that far apart, at most.
    Calibrated {
        /// The most that any reading left open.
        max_deviation: Duration,
    },
    /// The first timestamp stands where the host submitted it; on the device it was later.
    BySubmission,
    /// The device has no clock.
    NoClock,
}

/// The extension by which a driver reads both clocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Calibrates {
    Khr,
    Ext,
}

/// The host's clock, of those that drivers know: the one that `Instant` reads on Linux.
const HOST: vk::TimeDomainKHR = vk::TimeDomainKHR::CLOCK_MONOTONIC;
const DEVICE: vk::TimeDomainKHR = vk::TimeDomainKHR::DEVICE;

/// Readings of the host's clock of which the fastest is taken.
const READINGS: u32 = 16;

impl Calibrates {
    /// The extension that reads both clocks, if the device has one.
    pub fn of(instance: &Instance, raw: vk::PhysicalDevice, has: impl Fn(&CStr) -> bool) -> Option<Self> {
        let [khr, ext] = [Self::Khr, Self::Ext].map(|calibrates| has(calibrates.name()).then_some(calibrates));
        let calibrates = khr.or(ext)?;
        // SAFETY: `raw` comes from this instance and has the extension whose function is called.
        let domains = unsafe {
            match calibrates {
                Self::Khr => khr::calibrated_timestamps::Instance::new(&instance.entry, &instance.raw)
                    .get_physical_device_calibrateable_time_domains(raw),
                Self::Ext => ext::calibrated_timestamps::Instance::new(&instance.entry, &instance.raw)
                    .get_physical_device_calibrateable_time_domains(raw),
            }
        };
        let domains = domains.unwrap_or_default();
        (domains.contains(&HOST) && domains.contains(&DEVICE)).then_some(calibrates)
    }

    /// Name of the extension.
    pub fn name(self) -> &'static CStr {
        match self {
            Self::Khr => khr::calibrated_timestamps::NAME,
            Self::Ext => ext::calibrated_timestamps::NAME,
        }
    }
}

/// Brings timestamps to the host's clock.
pub(super) struct Clock {
    calibration: Option<Calibration>,
    alignment: Alignment,
    /// A time by both clocks.
    anchor: Option<(u64, Instant)>,
    nanoseconds_per_tick: f64,
    /// Bits of a timestamp that count.
    mask: u64,
}

/// How both clocks are read.
struct Calibration {
    functions: Functions,
    /// A time by `Instant` and in nanoseconds of the host's clock.
    host: (Instant, u64),
    /// How far these may be apart.
    host_deviation: Duration,
}

enum Functions {
    Khr(khr::calibrated_timestamps::Device),
    Ext(ext::calibrated_timestamps::Device),
}

impl Functions {
    /// Reads clocks at once: their times, and how far these may be apart, in nanoseconds.
    fn read(&self, domains: &[vk::TimeDomainKHR]) -> Result<(Vec<u64>, u64), GpuError> {
        let infos: Vec<_> =
            domains.iter().map(|domain| vk::CalibratedTimestampInfoKHR::default().time_domain(*domain)).collect();
        // SAFETY: the extension is enabled, and the device said that it knows these clocks.
        let read = unsafe {
            match self {
                Self::Khr(functions) => functions.get_calibrated_timestamps(&infos),
                Self::Ext(functions) => functions.get_calibrated_timestamps(&infos),
            }
        };
        read.during("reading the clocks")
    }
}

impl Clock {
    /// The clock of a device. It is calibrated where the device was opened for a trace.
    pub fn new(device: &Shared) -> Result<Self, GpuError> {
        let bits = device.description.timestamp_bits;
        let calibration = device.calibrates.map(|calibrates| Calibration::new(device, calibrates)).transpose()?;
        let alignment = match &calibration {
            _ if bits == 0 => Alignment::NoClock,
            Some(_) => Alignment::Calibrated { max_deviation: Duration::ZERO },
            None => Alignment::BySubmission,
        };
        Ok(Self {
            calibration,
            alignment,
            anchor: None,
            nanoseconds_per_tick: device.description.timestamp_period.into(),
            mask: u64::MAX >> (64 - bits.clamp(1, 64)),
        })
    }

    /// How its times are brought to the host's clock.
    pub fn alignment(&self) -> Alignment {
        self.alignment
    }

    /// Reads both clocks anew, so that they do not drift apart in a long render; where that cannot be, the first
    /// timestamp that this is called with stands at the time when the host submitted it, for good.
    pub fn align(&mut self, first: u64, submitted: Instant) -> Result<(), GpuError> {
        if let (Some(calibration), Alignment::Calibrated { max_deviation }) = (&self.calibration, &mut self.alignment) {
            let (ticks, at, deviation) = calibration.read()?;
            *max_deviation = deviation.max(*max_deviation);
            self.anchor = Some((ticks, at));
        } else if self.anchor.is_none() {
            self.anchor = Some((first, submitted));
        }
        Ok(())
    }

    /// When a timestamp was, by the host's clock. The clocks have been aligned.
    pub fn time(&self, ticks: u64) -> Instant {
        let (anchor, at) = self.anchor.expect("a clock is aligned before it is asked");
        let after = ticks.wrapping_sub(anchor) & self.mask;
        let before = anchor.wrapping_sub(ticks) & self.mask;
        let length = |ticks: u64| Duration::from_nanos((ticks as f64 * self.nanoseconds_per_tick).round() as u64);
        // The shorter way round is the right one: counters turn over in minutes at the least.
        if after <= before { at + length(after) } else { at.checked_sub(length(before)).unwrap_or(at) }
    }
}

impl Calibration {
    fn new(device: &Shared, calibrates: Calibrates) -> Result<Self, GpuError> {
        let instance = &device.instance.raw;
        let functions = match calibrates {
            Calibrates::Khr => Functions::Khr(khr::calibrated_timestamps::Device::new(instance, &device.raw)),
            Calibrates::Ext => Functions::Ext(ext::calibrated_timestamps::Device::new(instance, &device.raw)),
        };
        // `Instant` does not tell its nanoseconds, so it is read before and after the clock that it comes from.
        let mut best: Option<(Instant, u64, Duration)> = None;
        for _ in 0..READINGS {
            let before = Instant::now();
            let (times, _) = functions.read(&[HOST])?;
            let between = before.elapsed() / 2;
            if best.is_none_or(|(.., deviation)| between < deviation) {
                best = Some((before + between, times[0], between));
            }
        }
        let (at, nanoseconds, host_deviation) = best.expect("there was a reading");
        Ok(Self { functions, host: (at, nanoseconds), host_deviation })
    }

    /// A time by both clocks, and how far these may be apart.
    fn read(&self) -> Result<(u64, Instant, Duration), GpuError> {
        let (times, deviation) = self.functions.read(&[DEVICE, HOST])?;
        let (at, nanoseconds) = self.host;
        let since = Duration::from_nanos(times[1].saturating_sub(nanoseconds));
        Ok((times[0], at + since, Duration::from_nanos(deviation) + self.host_deviation))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(bits: u32, anchor: u64, at: Instant) -> Clock {
        Clock {
            calibration: None,
            alignment: Alignment::BySubmission,
            anchor: Some((anchor, at)),
            nanoseconds_per_tick: 2.5,
            mask: u64::MAX >> (64 - bits),
        }
    }

    #[test]
    fn ticks_lie_on_both_sides_of_the_anchor() {
        let at = Instant::now();
        for bits in [36, 64] {
            let clock = clock(bits, 1000, at);
            assert_eq!(clock.time(1000), at);
            assert_eq!(clock.time(1004), at + Duration::from_nanos(10));
            assert_eq!(clock.time(996), at - Duration::from_nanos(10));
        }
        // A counter of 36 bits that turns over in between.
        let clock = clock(36, 2, at);
        assert_eq!(clock.time((1 << 36) - 2), at - Duration::from_nanos(10));
        assert_eq!(clock.time((1 << 36) | 6), at + Duration::from_nanos(10));
    }

    #[test]
    fn without_calibration_the_first_submission_stays_where_it_is() {
        let at = Instant::now();
        let mut clock = Clock { anchor: None, ..clock(64, 0, at) };
        clock.align(500, at).expect("nothing is read");
        clock.align(900, at + Duration::from_secs(1)).expect("nothing is read");
        assert_eq!(clock.time(504), at + Duration::from_nanos(10));
    }
}
