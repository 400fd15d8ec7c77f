//! The design of an experiment: factors, their levels, and every combination of them.

use std::fmt;

use serde::ser::{Serialize, SerializeMap, Serializer};

use super::{Contract, StudyError};
use raywave::settings::{Role, Setting, Settings, Values, parse_count};

/// Most combinations of a study. Each is rendered dozens of times.
pub const MAX_COMBINATIONS: usize = 4096;

/// The names of all settings that a study can vary, for messages: those that leave the image as it is come first.
pub(super) fn names() -> String {
    let of = |role| Setting::factors().filter(move |setting| setting.role == role).map(|setting| setting.flag);
    [Role::Schedule, Role::Estimator, Role::Workload].into_iter().flat_map(of).collect::<Vec<_>>().join(", ")
}

/// A setting and the levels that a study gives it, the first of which is the baseline's.
#[derive(Debug, Clone, PartialEq)]
pub struct Factor {
    /// The setting.
    pub setting: &'static Setting,
    /// Its levels as the user wrote them, at least one, all different.
    pub levels: Vec<String>,
}

impl Factor {
    /// Reads factors, each `name` or `name=level,level,…`, with commas between them. A part that is not a factor's name
    /// is another level of the factor before it.
    ///
    /// # Errors
    /// An unknown factor, a level that it does not take, a level named twice.
    pub fn parse_list(text: &str) -> Result<Vec<Self>, StudyError> {
        let mut factors: Vec<String> = Vec::new();
        for part in text.split(',') {
            let begins = part.contains('=') || Setting::factors().any(|setting| setting.flag == part);
            match factors.last_mut().filter(|factor| !begins && factor.contains('=')) {
                Some(factor) => *factor += &format!(",{part}"),
                None => factors.push(part.to_owned()),
            }
        }
        factors.iter().map(|factor| Self::parse(factor)).collect()
    }

    /// Reads `name` or `name=level,level,…`.
    ///
    /// # Errors
    /// An unknown factor, a level that it does not take, a level named twice.
    pub fn parse(text: &str) -> Result<Self, StudyError> {
        let (name, given) = match text.split_once('=') {
            Some((name, levels)) => (name, Some(levels)),
            None => (text, None),
        };
        let setting = Setting::factors()
            .find(|setting| setting.flag == name)
            .ok_or_else(|| StudyError::UnknownFactor(name.to_owned()))?;
        let levels: Vec<String> = match given {
            Some(given) => given.split(',').map(|level| level.trim().to_owned()).collect(),
            None => setting.levels.iter().map(|&level| level.to_owned()).collect(),
        };
        for (i, level) in levels.iter().enumerate() {
            check(setting, level)?;
            if levels[..i].iter().any(|before| setting.same(before, level)) {
                return Err(StudyError::LevelTwice { factor: setting.flag, level: level.clone() });
            }
        }
        Ok(Self { setting, levels })
    }
}

/// Refuses a text that is not a value of the setting.
fn check(setting: &Setting, level: &str) -> Result<(), StudyError> {
    let mut settings = Settings::default();
    let fits = setting.set(&mut settings, level).is_ok() && settings.validate().is_ok();
    let bad = || StudyError::BadLevel { factor: setting.flag, level: level.to_owned(), allowed: setting.allowed() };
    fits.then_some(()).ok_or_else(bad)
}

/// One level of each factor, in the order of the factors.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Configuration(Vec<(&'static str, String)>);

impl Configuration {
    /// The level of a factor; `None` if it is not varied.
    pub fn level(&self, factor: &str) -> Option<&str> {
        self.iter().find(|&(name, _)| name == factor).map(|(_, level)| level)
    }

    /// The level of a factor that is a count; `None` if it is not varied or its level is a name.
    pub fn count(&self, factor: &str) -> Option<u64> {
        parse_count(self.level(factor)?)
    }

    /// This configuration with a factor at that level, replaced in place or appended.
    #[must_use]
    pub fn with(&self, factor: &'static str, level: &str) -> Self {
        let mut with = self.clone();
        match with.0.iter_mut().find(|(name, _)| *name == factor) {
            Some((_, old)) => level.clone_into(old),
            None => with.0.push((factor, level.to_owned())),
        }
        with
    }

    /// Settings with the levels in place of their own values.
    ///
    /// # Errors
    /// Says which level is not a value of its setting, or why the settings contradict each other.
    pub fn of(&self, mut base: Settings) -> Result<Settings, String> {
        for (factor, level) in self.iter() {
            let setting = Setting::of(factor).ok_or_else(|| format!("{factor} is no setting"))?;
            setting.set(&mut base, level).map_err(|problem| format!("{factor}={level}: {problem}"))?;
        }
        base.validate().map_err(|error| error.to_string())?;
        Ok(base)
    }

    /// The other factors and their levels.
    pub fn without(&self, factor: &str) -> Self {
        Self(self.0.iter().filter(|(name, _)| *name != factor).cloned().collect())
    }

    /// All factors and their levels.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, &str)> {
        self.0.iter().map(|(name, level)| (*name, level.as_str()))
    }
}

impl fmt::Display for Configuration {
    /// `scheduler=wavefront in-flight=64k`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts: Vec<_> = self.iter().map(|(name, level)| format!("{name}={level}")).collect();
        f.write_str(&parts.join(" "))
    }
}

impl Serialize for Configuration {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, level) in self.iter() {
            map.serialize_entry(name, level)?;
        }
        map.end()
    }
}

/// A full factorial design: every combination of the levels, and the baseline that the others are compared with.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    factors: Vec<Factor>,
    baseline: Configuration,
}

impl Design {
    /// A design of these factors. `baseline` reads `factor=level,…`; factors that it leaves out
    /// have their first level there.
    ///
    /// # Errors
    /// A factor that is given twice, a baseline that is not a combination, too many combinations.
    pub fn new(factors: Vec<Factor>, baseline: Option<&str>) -> Result<Self, StudyError> {
        for (i, factor) in factors.iter().enumerate() {
            if factors[..i].iter().any(|before| before.setting == factor.setting) {
                return Err(StudyError::FactorTwice(factor.setting.flag));
            }
        }
        let count = factors.iter().fold(1_usize, |count, factor| count.saturating_mul(factor.levels.len()));
        if count > MAX_COMBINATIONS {
            return Err(StudyError::TooManyCombinations(count));
        }
        let mut base = Configuration(factors.iter().map(|f| (f.setting.flag, f.levels[0].clone())).collect());
        for level in baseline.into_iter().flat_map(|text| text.split(',')) {
            let (name, level) = level
                .split_once('=')
                .map(|(name, level)| (name.trim(), level.trim()))
                .ok_or_else(|| StudyError::BadBaseline(baseline.unwrap_or_default().to_owned()))?;
            let factor = factors
                .iter()
                .position(|factor| factor.setting.flag == name)
                .ok_or_else(|| StudyError::BaselineNotVaried(name.to_owned()))?;
            let Factor { setting, levels } = &factors[factor];
            let known = levels.iter().find(|known| setting.same(known, level)).ok_or_else(|| StudyError::BadLevel {
                factor: setting.flag,
                level: level.to_owned(),
                allowed: format!("the baseline can have {}", levels.join(" or ")),
            })?;
            base.0[factor].1.clone_from(known);
        }
        Ok(Self { factors, baseline: base })
    }

    /// The factors, in the order in which they were given.
    pub fn factors(&self) -> &[Factor] {
        &self.factors
    }

    /// The combination that has all settings before any change.
    pub fn baseline(&self) -> &Configuration {
        &self.baseline
    }

    /// Every combination, the last factor changing fastest.
    pub fn combinations(&self) -> Vec<Configuration> {
        self.factors.iter().fold(vec![Configuration::default()], |shorter, factor| {
            let longer = |shorter: &Configuration, level: &String| {
                let mut longer = shorter.clone();
                longer.0.push((factor.setting.flag, level.clone()));
                longer
            };
            shorter.iter().flat_map(|shorter| factor.levels.iter().map(move |l| longer(shorter, l))).collect()
        })
    }

    /// The combination that this one is compared with: the baseline, given the same work.
    pub fn baseline_of(&self, configuration: &Configuration) -> Configuration {
        let mut base = self.baseline.clone();
        for (i, factor) in self.factors.iter().enumerate() {
            if factor.setting.role == Role::Workload {
                base.0[i] = configuration.0[i].clone();
            }
        }
        base
    }

    /// How close the images of a combination and of its baseline must be.
    pub fn contract(&self, configuration: &Configuration) -> Contract {
        let base = self.baseline_of(configuration);
        let estimator =
            |(i, factor): (usize, &Factor)| factor.setting.role == Role::Estimator && base.0[i] != configuration.0[i];
        if self.factors.iter().enumerate().any(estimator) { Contract::Statistics } else { Contract::Bits }
    }

    /// What distinguishes this combination from the others: the levels of factors that have several.
    pub fn label(&self, configuration: &Configuration) -> String {
        self.label_without(configuration, "")
    }

    /// [`Design::label`] without that factor.
    pub fn label_without(&self, configuration: &Configuration, left_out: &str) -> String {
        let parts: Vec<_> = (self.factors.iter().zip(configuration.iter()))
            .filter(|(factor, (name, _))| factor.levels.len() > 1 && *name != left_out)
            .map(|(factor, (name, level))| match factor.setting.values {
                // For the others a level says nothing without its factor.
                Values::RayClasses => level.to_owned(),
                Values::Names(_) if !factor.setting.names().contains(&"none") => level.to_owned(),
                _ => format!("{name} {level}"),
            })
            .collect();
        if parts.is_empty() { configuration.to_string() } else { parts.join(", ") }
    }
}
