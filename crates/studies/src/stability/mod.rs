//! Stability: the renderer driven to its numerical limits, each time held against the oracle's paths in `f64` or against
//! a closed form.
//!
//! This room owns the scenes of that study, what they should give, and what is promised. It renders on a device; what
//! came of it is an [`Envelope`](crate::studies::Envelope), which `studies` judges and `export` writes. It never prints.

mod facets;
mod film;
mod lab;
mod light;
mod matter;
mod place;
mod shapes;
pub(crate) mod stage;

use std::time::Instant;

pub use lab::{Lab, Level};

use crate::studies::{Limit, Trial};
use raywave::gpu::Device;

/// A row of the study: what to drive, and what is promised.
pub struct Plan {
    /// Short name.
    pub name: &'static str,
    /// What is driven.
    pub driven: &'static str,
    measure: &'static str,
    allowed: f64,
    remark: &'static str,
    reduced: &'static str,
    trials: fn(&Lab<'_>) -> Vec<Trial>,
}

/// Whatever can be driven, in the order of the report.
pub const PLANS: &[&[Plan]] = &[place::PLANS, shapes::PLANS, matter::PLANS, facets::PLANS, light::PLANS, film::PLANS];

/// All plans.
pub fn plans() -> impl Iterator<Item = &'static Plan> {
    PLANS.iter().copied().flatten()
}

impl Plan {
    /// Renders its scenes on a device.
    pub fn run(&self, device: &Device, level: Level) -> Limit {
        let start = Instant::now();
        let trials = (self.trials)(&Lab { device, level });
        Limit {
            name: self.name,
            driven: self.driven,
            measure: self.measure,
            allowed: self.allowed,
            remark: self.remark,
            reduced: if level == Level::Thorough { "" } else { self.reduced },
            trials,
            seconds: start.elapsed().as_secs_f64(),
        }
    }
}
