//! The settings that a sweep varies, its knobs, and the levels that it gives them.

use serde_json::{Map, Value};

use crate::studies::Configuration;
use raywave::settings::{self, Knob, SETTINGS, Setting, Settings};

/// The settings that a sweep starts from.
#[derive(Debug, Clone, Default)]
pub struct Base {
    /// As they were asked for.
    pub settings: Settings,
    /// The record of a render with them, which includes the device's defaults.
    pub record: Map<String, Value>,
    /// Mean radiance of the reference.
    pub mean_radiance: f64,
}

impl Base {
    /// The level that a setting has.
    pub fn level(&self, setting: &Setting) -> String {
        match self.record.get(setting.key) {
            None => (setting.get)(&self.settings).to_string(),
            Some(Value::Null | Value::Bool(false)) => "off".to_owned(),
            Some(Value::Bool(true)) => "on".to_owned(),
            Some(Value::String(level)) => level.clone(),
            Some(value) => value.to_string(),
        }
    }

    /// Every level of a knob except the base's own; empty for a setting that is not a knob.
    pub fn other_levels(&self, setting: &Setting) -> Vec<String> {
        let own = self.level(setting);
        let levels = setting.knob.map(|knob| (knob.values)(&self.settings, self.mean_radiance)).unwrap_or_default();
        levels.into_iter().filter(|level| !setting.same(level, &own)).collect()
    }
}

/// Every setting that a sweep varies. The number of samples is not one of them: the others are measured in samples.
pub fn knobs() -> impl Iterator<Item = (&'static Setting, Knob)> {
    SETTINGS.iter().filter_map(|setting| Some((setting, setting.knob?)))
}

/// The base with every knob at its exact level.
pub fn exact(configuration: &Configuration) -> Configuration {
    knobs().fold(configuration.clone(), |configuration, (setting, knob)| match knob.exact {
        Some(level) => configuration.with(setting.flag, level),
        None => configuration,
    })
}

/// The name of a configuration, without its samples: `mis, max-bounces 4, fast-math`.
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

/// The flags of `render` that make a point of a sweep over these settings; empty for a configuration that is not valid.
pub fn flags(base: &Settings, configuration: &Configuration) -> String {
    configuration.of(*base).map(|settings| settings::flags(&settings)).unwrap_or_default()
}
