//! The settings that a sweep turns, and the levels that it gives them.

use serde_json::{Map, Value};

use crate::studies::Configuration;
use crate::studies::factorial::{FACTORS, Levels};

/// A setting that buys speed with error, or looks as if it might.
#[derive(Debug, Clone, Copy)]
pub struct Knob {
    /// The factor that it is to `compare`, and the flag without its dashes.
    pub factor: &'static str,
    /// Its key in the record of settings.
    pub setting: &'static str,
    /// The level that a reference is rendered with: an exact one, and of several the surest. `None` leaves
    /// the base's.
    pub exact: Option<&'static str>,
    /// Levels to try in such a base; its own is left out afterwards.
    levels: fn(&Base) -> Vec<String>,
}

/// The settings that a sweep starts from.
#[derive(Debug, Clone, Default)]
pub struct Base {
    /// The record of them, snake_case keys.
    pub settings: Map<String, Value>,
    /// Mean radiance of the reference.
    pub mean_radiance: f64,
}

impl Base {
    /// The level that a knob has.
    pub fn level(&self, knob: &Knob) -> String {
        match self.settings.get(knob.setting) {
            None | Some(Value::Null | Value::Bool(false)) => "off".to_owned(),
            Some(Value::Bool(true)) => "on".to_owned(),
            Some(Value::String(level)) => level.clone(),
            Some(value) => value.to_string(),
        }
    }

    fn number(&self, setting: &str) -> f64 {
        self.settings.get(setting).and_then(Value::as_f64).unwrap_or(0.0)
    }

    fn unbounded(&self) -> bool {
        self.number("max_bounces") < 0.0
    }
}

/// All names that the factor takes.
fn every_name(factor: &str) -> Vec<String> {
    match FACTORS.iter().find(|kind| kind.name == factor).map(|kind| kind.levels) {
        Some(Levels::Named(names) | Levels::NamedAndMore(names, _)) => {
            names.iter().map(|&name| name.to_owned()).collect()
        }
        _ => Vec::new(),
    }
}

/// Two digits of a number above 0.
fn significant(value: f64) -> String {
    format!("{value:.1e}").parse().map_or_else(|_| "1".to_owned(), |rounded: f64| rounded.to_string())
}

fn numbers(numbers: &[f64]) -> Vec<String> {
    numbers.iter().map(ToString::to_string).collect()
}

/// Every knob but the number of samples, which each of the others is measured in.
pub const KNOBS: &[Knob] = &[
    Knob { factor: "integrator", setting: "integrator", exact: Some("mis"), levels: |_| every_name("integrator") },
    Knob { factor: "sampler", setting: "sampler", exact: Some("independent"), levels: |_| every_name("sampler") },
    Knob {
        factor: "max-bounces",
        setting: "max_bounces",
        exact: None,
        // More bounces than the picture has would be another picture.
        levels: |base| {
            let fewer = |bounces: &&u32| base.unbounded() || f64::from(**bounces) < base.number("max_bounces");
            [1_u32, 2, 3, 4, 8, 16].iter().filter(fewer).map(ToString::to_string).collect()
        },
    },
    Knob {
        factor: "roulette",
        setting: "roulette",
        exact: None,
        levels: |base| numbers(if base.unbounded() { &[0.05, 0.1, 0.2, 0.4] } else { &[0.0, 0.1, 0.2, 0.4] }),
    },
    Knob { factor: "roulette-mode", setting: "roulette_mode", exact: None, levels: |_| every_name("roulette-mode") },
    Knob {
        factor: "clamp",
        setting: "clamp_radiance",
        exact: Some("off"),
        levels: |base| [2.0, 8.0, 32.0].map(|times| significant(times * base.mean_radiance)).to_vec(),
    },
    Knob { factor: "path-state", setting: "path_state", exact: Some("f32"), levels: |_| every_name("path-state") },
    Knob { factor: "offsets", setting: "offsets", exact: Some("robust"), levels: |_| every_name("offsets") },
    Knob { factor: "fast-math", setting: "fast_math", exact: Some("off"), levels: |_| every_name("fast-math") },
    Knob { factor: "bvh", setting: "bvh", exact: None, levels: |_| every_name("bvh") },
];

impl Knob {
    /// Every other level than the base's.
    pub fn other_levels(&self, base: &Base) -> Vec<String> {
        let own = base.level(self);
        let same = |level: &String| {
            *level == own || matches!((level.parse::<f64>(), own.parse::<f64>()), (Ok(a), Ok(b)) if a == b)
        };
        (self.levels)(base).into_iter().filter(|level| !same(level)).collect()
    }
}

/// The base with every knob at its exact level.
pub fn exact(configuration: &Configuration) -> Configuration {
    let with_exact = |configuration: Configuration, knob: &Knob| match knob.exact {
        Some(level) => configuration.with(knob.factor, level),
        None => configuration,
    };
    KNOBS.iter().fold(configuration.clone(), with_exact)
}

/// What a configuration is called, its samples left out: `mis, max-bounces 4, fast-math`.
pub fn label(configuration: &Configuration) -> String {
    let speaks_for_itself = |factor: &str| matches!(factor, "integrator" | "sampler" | "bvh");
    let part = |(factor, level): (&'static str, &str)| match level {
        "on" => factor.to_owned(),
        _ if speaks_for_itself(factor) => level.to_owned(),
        _ => format!("{factor} {level}"),
    };
    let parts: Vec<String> = configuration.iter().filter(|(factor, _)| *factor != "samples").map(part).collect();
    if parts.is_empty() { "base".to_owned() } else { parts.join(", ") }
}

/// The flags of `render` that make a point of a sweep: every knob that is not as it is without a flag, and those
/// that a scene file may set.
pub fn flags(base: &Base, configuration: &Configuration) -> String {
    let mut flags: Vec<String> = [("width", "width_pixels"), ("height", "height_pixels")]
        .map(|(flag, setting)| format!("--{flag} {}", base.number(setting)))
        .to_vec();
    flags.extend(configuration.level("samples").map(|samples| format!("--samples {samples}")));
    for knob in KNOBS {
        let turned = configuration.level(knob.factor).map(str::to_owned);
        let level = turned.clone().unwrap_or_else(|| base.level(knob));
        match (knob.factor, level.as_str()) {
            // The shape of the BVH is the device's choice unless it was turned.
            ("bvh", _) if turned.is_none() => {}
            (_, "off") | ("roulette-mode", "constant") | ("path-state", "f32") | ("offsets", "robust") => {}
            (factor, "on") => flags.push(format!("--{factor}")),
            (factor, level) => flags.push(format!("--{factor} {level}")),
        }
    }
    flags.join(" ")
}
