//! Presets from the fronts that `raywave tradeoff` measured; see docs/studies.

use strum::{EnumMessage, EnumString, IntoStaticStr, VariantArray};

use super::{Integrator, RouletteMode, Sampler, Settings};

/// Settings from a measured front of error against time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, EnumString, IntoStaticStr, VariantArray, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum Quality {
    /// A few samples and bounces, for looking around; BIASED: light of later bounces is missing.
    Draft,
    /// For looking at: no bias.
    Balanced,
    /// For measuring against: no bias.
    Reference,
}

impl Quality {
    /// Bounces of a draft at most.
    const DRAFT_BOUNCES: u32 = 4;

    /// A scene's settings at this quality.
    pub fn of(self, given: Settings) -> Settings {
        let samples = match self {
            Self::Draft => 4,
            Self::Balanced => 64,
            Self::Reference => 4096,
        };
        let fewer = |bounces: Option<u32>| Some(bounces.map_or(Self::DRAFT_BOUNCES, |n| n.min(Self::DRAFT_BOUNCES)));
        Settings {
            samples,
            integrator: Integrator::Mis,
            sampler: Sampler::Sobol,
            max_bounces: if self == Self::Draft { fewer(given.max_bounces) } else { given.max_bounces },
            roulette_mode: RouletteMode::Throughput,
            ..given
        }
    }
}
