//! The self-test: what the tracer relies on, each checked on a device by a kernel of its own against the CPU.
//!
//! This room owns the checks, their kernels in `shaders/selftest` and the verdicts; the result of a check is a [`Row`].
//! It never prints. A check distinguishes three outcomes: everything is as the tracer needs it, the device differs in a
//! way that spoils nothing, or something spoils results.

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

use raywave::render::RenderError;

/// What came of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Everything is as the tracer needs it.
    Ok,
    /// The device differs in a way that spoils nothing.
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
    /// What a failure of the check spoils.
    pub spoils: &'static str,
    run: fn(&Bench<'_>) -> Result<Finding, RenderError>,
}

/// The findings of a check.
struct Finding {
    cases: u64,
    verdict: Verdict,
    found: String,
    numbers: Map<String, Value>,
}

/// A check and its result.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Short name of the check.
    pub name: &'static str,
    /// What was checked.
    pub checked: &'static str,
    /// Number of cases.
    pub cases: u64,
    /// The verdict.
    pub verdict: Verdict,
    /// The findings, for people.
    pub found: String,
    /// What it spoils if the verdict is `off`.
    pub spoils: &'static str,
    /// Measured numbers, by name.
    pub numbers: Map<String, Value>,
    /// Time that the check took.
    pub seconds: f64,
}

/// The checks, in the order of the report.
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
    /// Runs its kernels. An error of the device counts as `off`.
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

    /// Adds a number to those that are reported by name.
    fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.numbers.insert(name.to_owned(), value.into());
        self
    }
}

/// A count of cases, and of those that are wrong.
#[derive(Debug, Clone, Default, PartialEq)]
struct Faults {
    cases: u64,
    wrong: u64,
    /// The first that is wrong.
    example: String,
}

impl Faults {
    /// Counts one more case. `example` describes it if it is wrong.
    fn see(&mut self, right: bool, example: impl FnOnce() -> String) {
        self.cases += 1;
        if !right {
            if self.wrong == 0 {
                self.example = example();
            }
            self.wrong += 1;
        }
    }

    /// Adds the counts of another part.
    fn join(&mut self, other: Self) {
        if self.wrong == 0 {
            self.example = other.example;
        }
        self.cases += other.cases;
        self.wrong += other.wrong;
    }

    /// The findings: `all` if nothing is wrong, otherwise a verdict with an example.
    fn finding(self, all: &str, verdict: Verdict) -> Finding {
        let Self { cases, wrong, example } = self;
        let finding = match wrong {
            0 => Finding::ok(cases, all),
            wrong => Finding::new(cases, verdict, format!("{wrong} are wrong, as {example}")),
        };
        finding.with("wrong", wrong)
    }
}
