//! Properties of a device and its driver, measured at first use: speeds that defaults depend on, and the arithmetic
//! that Vulkan leaves to the driver.
//!
//! [`of`] measures once and keeps the facts, for the process and in the device's cache folder. It knows nothing of
//! renders, nor of drivers' names and versions: a version says what was true elsewhere, a measurement what is true
//! here.

mod file;
mod measure;

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use serde::{Deserialize, Serialize};

use crate::gpu::{Device, GpuError};

/// Measurements of a device.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Facts {
    /// Nanoseconds of the whole device for a fetch of 16 bytes by texel, where every invocation fetches from elsewhere.
    pub texel_ns: f64,
    /// The same from a storage buffer.
    pub storage_ns: f64,
    /// Seconds of a launch of next to no work, with the barrier before it.
    pub launch_seconds: f64,
    /// Loop iterations, over all its loops, after which an invocation leaves them; `None` if it ran [`MOST_TURNS`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loop_turns: Option<u32>,
    /// Whether quotients are rounded correctly. This and the following hold for some hundred thousand operands, not for
    /// all.
    pub division_exact: bool,
    /// Whether reciprocals are.
    pub reciprocal_exact: bool,
    /// Whether square roots are.
    pub root_exact: bool,
    /// Whether `fma` rounds once.
    pub fma_fused: bool,
    /// Whether sums or products flush denormal operands to zero.
    pub flushes_operands: bool,
    /// Whether denormal sums or products are flushed to zero.
    pub flushes_results: bool,
}

/// Loop iterations that are tried. A driver that runs as many counts as having no limit.
pub const MOST_TURNS: u32 = 1 << 18;

impl Facts {
    /// Whether denormals are flushed, as operands or as results.
    pub fn flushes_denormals(&self) -> bool {
        self.flushes_operands || self.flushes_results
    }

    /// Whether a fetch by texel is the faster one.
    pub fn texels_are_faster(&self) -> bool {
        self.texel_ns < self.storage_ns
    }
}

/// The facts of a device: those that this process knows, else those of the device's cache folder, else measured now and
/// kept. Measuring takes some tens of milliseconds.
///
/// # Errors
/// When the device fails.
pub fn of(device: &Device) -> Result<Arc<Facts>, GpuError> {
    static KNOWN: Mutex<Option<HashMap<String, Arc<Facts>>>> = Mutex::new(None);
    let description = device.description();
    let key = format!("{} {} {}", description.cache_name(), description.name, description.driver);
    // Locked meanwhile, so that no two threads measure at once.
    let mut known = KNOWN.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let known = known.get_or_insert_default();
    if let Some(facts) = known.get(&key) {
        return Ok(Arc::clone(facts));
    }
    let file = device.cache_folder().map(|folder| file::path(folder, description));
    let kept = file.as_deref().and_then(|file| file::read(file, description));
    let facts = match kept {
        Some(facts) => facts,
        None => {
            let facts = measure::measure(device)?;
            if let Some(file) = &file {
                file::write(file, description, &facts);
            }
            facts
        }
    };
    let facts = Arc::new(facts);
    known.insert(key, Arc::clone(&facts));
    Ok(facts)
}
