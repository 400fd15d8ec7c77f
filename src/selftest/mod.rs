//! The self-test: what the tracer relies on, each checked on a device by a kernel of its own against the CPU.
//!
//! This room owns the checks, their kernels in `shaders/selftest` and the verdicts; what came of a check is a [`Row`].
//! It never prints. A check says three things apart: that all is as the tracer needs it, what the device does in a way
//! of its own that spoils nothing, and what spoils results.

mod arithmetic;
mod bench;
mod cases;
mod conversions;
mod exactness;
mod functions;
mod image;
mod lanes;
mod launches;
mod specials;
mod watertight;

use std::time::Instant;

use serde::Serialize;
use serde_json::{Map, Value};

pub use bench::Bench;

use crate::render::RenderError;

/// What came of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// All is as the tracer needs it.
    Ok,
    /// The device has a way of its own, which spoils nothing.
    Property,
    /// Something is off that spoils results.
    Off,
}

/// A check of one thing that the tracer relies on.
pub struct Check {
    /// Short name.
    pub name: &'static str,
    /// What is checked.
    pub checked: &'static str,
    /// What is wrong where the check fails.
    pub spoils: &'static str,
    run: fn(&Bench<'_>) -> Result<Finding, RenderError>,
}

/// What a check found.
struct Finding {
    cases: u64,
    verdict: Verdict,
    found: String,
    numbers: Map<String, Value>,
}

/// A check and what came of it.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Short name of the check.
    pub name: &'static str,
    /// What was checked.
    pub checked: &'static str,
    /// How many cases of it.
    pub cases: u64,
    /// What came of it.
    pub verdict: Verdict,
    /// What was found, for people.
    pub found: String,
    /// What is wrong if the verdict is `off`.
    pub spoils: &'static str,
    /// What was found, by name.
    pub numbers: Map<String, Value>,
    /// Time that the check took.
    pub seconds: f64,
}

/// Whatever is checked, in the order of the report.
pub const CHECKS: &[&[Check]] = &[
    arithmetic::CHECKS,
    exactness::CHECKS,
    conversions::CHECKS,
    specials::CHECKS,
    functions::CHECKS,
    lanes::CHECKS,
    launches::CHECKS,
    watertight::CHECKS,
    image::CHECKS,
];

/// All checks.
pub fn checks() -> impl Iterator<Item = &'static Check> {
    CHECKS.iter().copied().flatten()
}

impl Check {
    /// Runs its kernels. A device that fails at it is off.
    pub fn run(&self, bench: &Bench<'_>) -> Row {
        let start = Instant::now();
        let finding =
            (self.run)(bench).unwrap_or_else(|error| Finding::new(0, Verdict::Off, format!("did not run: {error}")));
        Row {
            name: self.name,
            checked: self.checked,
            cases: finding.cases,
            verdict: finding.verdict,
            found: finding.found,
            spoils: self.spoils,
            numbers: finding.numbers,
            seconds: start.elapsed().as_secs_f64(),
        }
    }
}

impl Finding {
    fn new(cases: u64, verdict: Verdict, found: impl Into<String>) -> Self {
        Self { cases, verdict, found: found.into(), numbers: Map::new() }
    }

    fn ok(cases: u64, found: impl Into<String>) -> Self {
        Self::new(cases, Verdict::Ok, found)
    }

    /// Adds a number to what is told by name.
    fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.numbers.insert(name.to_owned(), value.into());
        self
    }
}

/// Cases of which some are wrong.
#[derive(Debug, Clone, Default, PartialEq)]
struct Faults {
    cases: u64,
    wrong: u64,
    /// The first that is wrong.
    example: String,
}

impl Faults {
    /// Looks at one more case. `example` tells of it if it is wrong.
    fn see(&mut self, right: bool, example: impl FnOnce() -> String) {
        self.cases += 1;
        if !right {
            if self.wrong == 0 {
                self.example = example();
            }
            self.wrong += 1;
        }
    }

    /// Adds those of another part.
    fn join(&mut self, other: Self) {
        if self.wrong == 0 {
            self.example = other.example;
        }
        self.cases += other.cases;
        self.wrong += other.wrong;
    }

    /// What was found: `all` where nothing is wrong, else a verdict with an example.
    fn finding(self, all: &str, verdict: Verdict) -> Finding {
        let Self { cases, wrong, example } = self;
        let finding = match wrong {
            0 => Finding::ok(cases, all),
            wrong => Finding::new(cases, verdict, format!("{wrong} are wrong, as {example}")),
        };
        finding.with("wrong", wrong)
    }
}
