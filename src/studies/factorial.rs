//! The design of an experiment: factors, their levels, and every combination of them.

use std::fmt;

use serde::ser::{Serialize, SerializeMap, Serializer};

use super::{Contract, StudyError};

/// Most combinations of a study. Each is rendered dozens of times.
pub const MAX_COMBINATIONS: usize = 4096;

/// What a factor does to the picture, and so what may be compared with what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// How the work is done. The picture stays the same to the last bit.
    Schedule,
    /// How the picture is estimated or rounded. It stays the same up to noise.
    Estimator,
    /// What there is to do. Another level is another picture; only combinations of one level are
    /// compared, each with a baseline of that level.
    Workload,
}

/// What levels a factor takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Levels {
    /// These names.
    Named(&'static [&'static str]),
    /// Any count from `min` on, as [`parse_count`] reads it; `default` where none is given.
    Counts {
        /// Smallest count.
        min: u64,
        /// Levels where the user names none.
        default: &'static [&'static str],
    },
    /// Any number from `low` up to, not including, `high`; `default` where none is given.
    Numbers {
        /// Smallest number.
        low: f64,
        /// What every number is below.
        high: f64,
        /// Levels where the user names none.
        default: &'static [&'static str],
    },
    /// One of these names; where the user names none, those of the first list.
    NamedAndMore(&'static [&'static str], &'static [&'static str]),
    /// Any number above 0, or `off`; `default` where none is given.
    NumbersOrOff {
        /// Levels where the user names none.
        default: &'static [&'static str],
    },
}

/// A setting that a study can vary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FactorKind {
    /// Its name, that of the command line's option without the dashes.
    pub name: &'static str,
    /// What it does to the picture.
    pub role: Role,
    /// What levels it takes.
    pub levels: Levels,
    /// What it is, for axes and tables.
    pub meaning: &'static str,
}

/// All settings that a study can vary.
pub const FACTORS: &[FactorKind] = &[
    FactorKind {
        name: "scheduler",
        role: Role::Schedule,
        levels: Levels::Named(&["wavefront", "bounce", "megakernel"]),
        meaning: "scheduler",
    },
    FactorKind {
        name: "in-flight",
        role: Role::Schedule,
        levels: Levels::Counts { min: 1, default: &["16k", "64k", "256k", "1M"] },
        meaning: "paths in flight",
    },
    FactorKind {
        name: "workgroup",
        role: Role::Schedule,
        levels: Levels::Counts { min: 1, default: &["32", "64", "128", "256"] },
        meaning: "invocations of a workgroup",
    },
    FactorKind {
        name: "paths-per-invocation",
        role: Role::Schedule,
        levels: Levels::Counts { min: 1, default: &["1", "8", "32"] },
        meaning: "paths of a megakernel's invocation",
    },
    FactorKind {
        name: "bvh",
        role: Role::Schedule,
        levels: Levels::NamedAndMore(&["bvh2", "bvh4", "cwbvh"], &["list"]),
        meaning: "shape of the BVH",
    },
    FactorKind {
        name: "fetch",
        role: Role::Schedule,
        levels: Levels::Named(&["texel", "storage"]),
        meaning: "how kernels read the scene",
    },
    FactorKind {
        name: "sort",
        role: Role::Schedule,
        levels: Levels::Named(&["none", "material"]),
        meaning: "order of shading",
    },
    FactorKind {
        name: "shadow-rays",
        role: Role::Schedule,
        levels: Levels::Named(&["deferred", "at-once"]),
        meaning: "when the bounce scheduler traces shadow rays",
    },
    FactorKind {
        name: "packets",
        role: Role::Schedule,
        levels: Levels::NamedAndMore(
            &["none", "camera"],
            &["bounce", "shadow", "camera+shadow", "camera+bounce+shadow"],
        ),
        meaning: "rays traced by packets",
    },
    FactorKind {
        name: "specialize",
        role: Role::Schedule,
        levels: Levels::Named(&["off", "on"]),
        meaning: "kernels and buffers for this scene alone",
    },
    FactorKind {
        name: "numerics",
        role: Role::Estimator,
        levels: Levels::Named(&["portable", "native"]),
        meaning: "who lays down quotients, roots and vector products",
    },
    FactorKind {
        name: "fast-math",
        role: Role::Estimator,
        levels: Levels::Named(&["off", "on"]),
        meaning: "fused and reordered arithmetic",
    },
    FactorKind {
        name: "path-state",
        role: Role::Estimator,
        levels: Levels::Named(&["f32", "f16"]),
        meaning: "how exactly path state is kept",
    },
    FactorKind {
        name: "offsets",
        role: Role::Estimator,
        levels: Levels::Named(&["robust", "fixed"]),
        meaning: "how rays leave surfaces",
    },
    FactorKind {
        name: "integrator",
        role: Role::Estimator,
        levels: Levels::Named(&["explicit", "implicit", "mis"]),
        meaning: "integrator",
    },
    FactorKind {
        name: "roulette",
        role: Role::Estimator,
        levels: Levels::Numbers { low: 0.0, high: 1.0, default: &["0", "0.1", "0.2", "0.4"] },
        meaning: "probability of stopping at a vertex",
    },
    FactorKind {
        name: "samples",
        role: Role::Workload,
        levels: Levels::Counts { min: 1, default: &["4", "16", "64"] },
        meaning: "samples per pixel",
    },
    FactorKind {
        name: "max-bounces",
        role: Role::Workload,
        levels: Levels::Counts { min: 0, default: &["2", "4", "8", "16"] },
        meaning: "bounces of a path",
    },
    FactorKind {
        name: "clamp",
        role: Role::Workload,
        levels: Levels::NumbersOrOff { default: &["off", "10", "1"] },
        meaning: "most radiance of indirect light",
    },
    FactorKind {
        name: "sampler",
        role: Role::Estimator,
        levels: Levels::Named(&["independent", "sobol"]),
        meaning: "source of random numbers",
    },
    FactorKind {
        name: "roulette-mode",
        role: Role::Estimator,
        levels: Levels::Named(&["constant", "throughput"]),
        meaning: "how a roulette decides",
    },
    FactorKind {
        name: "shading-cost",
        role: Role::Workload,
        levels: Levels::Counts { min: 0, default: &["0", "64", "256", "1k", "4k"] },
        meaning: "added shading steps per hit",
    },
    FactorKind {
        name: "materials",
        role: Role::Workload,
        levels: Levels::Counts { min: 1, default: &["1", "2", "4", "8", "16"] },
        meaning: "branches of scattering",
    },
];

/// The names of [`FACTORS`], for messages.
pub(super) fn names() -> String {
    FACTORS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ")
}

/// A count as people write it: digits and perhaps a suffix, k for 1024 and M for 1024². Queues and
/// workgroups are sized in powers of two, so 64k is 65,536 here, not 64,000.
pub fn parse_count(text: &str) -> Option<u64> {
    let (digits, unit) = match text.as_bytes().last()? {
        b'k' | b'K' => (&text[..text.len() - 1], 1 << 10),
        b'M' | b'm' => (&text[..text.len() - 1], 1 << 20),
        _ => (text, 1),
    };
    // `parse` would take a plus sign.
    let plain = digits.bytes().all(|byte| byte.is_ascii_digit());
    digits.parse::<u64>().ok().filter(|_| plain)?.checked_mul(unit)
}

/// A setting and the levels that a study gives it, the first of which is the baseline's.
#[derive(Debug, Clone, PartialEq)]
pub struct Factor {
    /// The setting.
    pub kind: &'static FactorKind,
    /// Its levels as the user wrote them, at least one, no two alike.
    pub levels: Vec<String>,
}

impl Factor {
    /// Reads factors, each `name` or `name=level,level,…`, with commas between them. A part that is
    /// no factor's name is one more level of the factor before it.
    ///
    /// # Errors
    /// An unknown factor, a level that it does not take, a level named twice.
    pub fn parse_list(text: &str) -> Result<Vec<Self>, StudyError> {
        let mut factors: Vec<String> = Vec::new();
        for part in text.split(',') {
            let begins = part.contains('=') || FACTORS.iter().any(|kind| kind.name == part);
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
        let kind =
            FACTORS.iter().find(|kind| kind.name == name).ok_or_else(|| StudyError::UnknownFactor(name.to_owned()))?;
        let levels: Vec<String> = match (given, kind.levels) {
            (Some(given), _) => given.split(',').map(|level| level.trim().to_owned()).collect(),
            (None, Levels::Named(names) | Levels::NamedAndMore(names, _)) => {
                names.iter().map(|&name| name.to_owned()).collect()
            }
            (
                None,
                Levels::Counts { default, .. } | Levels::Numbers { default, .. } | Levels::NumbersOrOff { default },
            ) => default.iter().map(|&level| level.to_owned()).collect(),
        };
        for (i, level) in levels.iter().enumerate() {
            kind.check(level)?;
            if levels[..i].iter().any(|before| kind.same(before, level)) {
                return Err(StudyError::LevelTwice { factor: kind.name, level: level.clone() });
            }
        }
        Ok(Self { kind, levels })
    }
}

impl FactorKind {
    fn check(&self, level: &str) -> Result<(), StudyError> {
        let (fits, allowed) = match self.levels {
            Levels::Named(names) => (names.contains(&level), format!("use {}", names.join(" or "))),
            Levels::NamedAndMore(names, more) => (
                names.contains(&level) || more.contains(&level),
                format!("use {}", [names, more].concat().join(" or ")),
            ),
            Levels::Counts { min, .. } => (
                parse_count(level).is_some_and(|count| count >= min),
                format!("use a count from {min} on, such as 64 or 16k (k is 1024, M is 1024²)"),
            ),
            Levels::Numbers { low, high, .. } => (
                level.parse::<f64>().is_ok_and(|number| (low..high).contains(&number)),
                format!("use a number from {low} up to, not including, {high}"),
            ),
            Levels::NumbersOrOff { .. } => (
                level == "off" || level.parse::<f64>().is_ok_and(|number| number > 0.0 && number.is_finite()),
                "use a number above 0, or off".to_owned(),
            ),
        };
        let bad = || StudyError::BadLevel { factor: self.name, level: level.to_owned(), allowed };
        fits.then_some(()).ok_or_else(bad)
    }

    /// Whether two levels are one and the same, as 64k and 65536 are.
    fn same(&self, a: &str, b: &str) -> bool {
        match self.levels {
            Levels::Named(_) | Levels::NamedAndMore(..) => a == b,
            Levels::Counts { .. } => parse_count(a) == parse_count(b),
            Levels::Numbers { .. } | Levels::NumbersOrOff { .. } => a.parse::<f64>().ok() == b.parse::<f64>().ok(),
        }
    }
}

/// One level of each factor, in the order of the factors.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Configuration(Vec<(&'static str, String)>);

impl Configuration {
    /// The level of a factor; `None` where it is not varied.
    pub fn level(&self, factor: &str) -> Option<&str> {
        self.iter().find(|&(name, _)| name == factor).map(|(_, level)| level)
    }

    /// The level of a factor that is a count; `None` where it is not varied or has a name.
    pub fn count(&self, factor: &str) -> Option<u64> {
        parse_count(self.level(factor)?)
    }

    /// This configuration with a factor at that level, in its place or at the end.
    #[must_use]
    pub fn with(&self, factor: &'static str, level: &str) -> Self {
        let mut with = self.clone();
        match with.0.iter_mut().find(|(name, _)| *name == factor) {
            Some((_, old)) => level.clone_into(old),
            None => with.0.push((factor, level.to_owned())),
        }
        with
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

/// A full factorial: every combination of the levels, and the one that the others are measured
/// against.
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
    /// A factor that stands twice, a baseline that is no combination, too many combinations.
    pub fn new(factors: Vec<Factor>, baseline: Option<&str>) -> Result<Self, StudyError> {
        for (i, factor) in factors.iter().enumerate() {
            if factors[..i].iter().any(|before| before.kind == factor.kind) {
                return Err(StudyError::FactorTwice(factor.kind.name));
            }
        }
        let count = factors.iter().fold(1_usize, |count, factor| count.saturating_mul(factor.levels.len()));
        if count > MAX_COMBINATIONS {
            return Err(StudyError::TooManyCombinations(count));
        }
        let mut base = Configuration(factors.iter().map(|f| (f.kind.name, f.levels[0].clone())).collect());
        for setting in baseline.into_iter().flat_map(|text| text.split(',')) {
            let (name, level) = setting
                .split_once('=')
                .map(|(name, level)| (name.trim(), level.trim()))
                .ok_or_else(|| StudyError::BadBaseline(baseline.unwrap_or_default().to_owned()))?;
            let factor = factors
                .iter()
                .position(|factor| factor.kind.name == name)
                .ok_or_else(|| StudyError::BaselineNotVaried(name.to_owned()))?;
            let Factor { kind, levels } = &factors[factor];
            let known = levels.iter().find(|known| kind.same(known, level)).ok_or_else(|| StudyError::BadLevel {
                factor: kind.name,
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

    /// The combination that stands for all settings before any change.
    pub fn baseline(&self) -> &Configuration {
        &self.baseline
    }

    /// Every combination, the last factor changing fastest.
    pub fn combinations(&self) -> Vec<Configuration> {
        self.factors.iter().fold(vec![Configuration::default()], |shorter, factor| {
            let longer = |shorter: &Configuration, level: &String| {
                let mut longer = shorter.clone();
                longer.0.push((factor.kind.name, level.clone()));
                longer
            };
            shorter.iter().flat_map(|shorter| factor.levels.iter().map(move |l| longer(shorter, l))).collect()
        })
    }

    /// The combination that this one is compared with: the baseline, given the same work.
    pub fn baseline_of(&self, configuration: &Configuration) -> Configuration {
        let mut base = self.baseline.clone();
        for (i, factor) in self.factors.iter().enumerate() {
            if factor.kind.role == Role::Workload {
                base.0[i] = configuration.0[i].clone();
            }
        }
        base
    }

    /// How alike the pictures of a combination and of its baseline must be.
    pub fn contract(&self, configuration: &Configuration) -> Contract {
        let base = self.baseline_of(configuration);
        let estimator =
            |(i, factor): (usize, &Factor)| factor.kind.role == Role::Estimator && base.0[i] != configuration.0[i];
        if self.factors.iter().enumerate().any(estimator) { Contract::Statistics } else { Contract::Bits }
    }

    /// What tells this combination from the others: the levels of factors that have several.
    pub fn label(&self, configuration: &Configuration) -> String {
        self.label_without(configuration, "")
    }

    /// [`Design::label`] without that factor.
    pub fn label_without(&self, configuration: &Configuration, left_out: &str) -> String {
        let parts: Vec<_> = (self.factors.iter().zip(configuration.iter()))
            .filter(|(factor, (name, _))| factor.levels.len() > 1 && *name != left_out)
            .map(|(factor, (name, level))| match factor.kind.levels {
                // A switch's level says nothing by itself.
                Levels::NamedAndMore(..) => level.to_owned(),
                Levels::Named(names) if !names.contains(&"on") && !names.contains(&"none") => level.to_owned(),
                _ => format!("{name} {level}"),
            })
            .collect();
        if parts.is_empty() { configuration.to_string() } else { parts.join(", ") }
    }
}
