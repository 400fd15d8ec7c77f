//! The operating envelope of the renderer: what was driven to which extreme, how wrong the answers were, and where
//! they begin to fail.

use serde::Serialize;

/// How many standard errors a mean may be off by chance. Some tens of means are judged at once.
const CHANCE: f64 = 4.5;

/// Everything that was tried.
#[derive(Debug, Clone, Serialize)]
pub struct Envelope {
    /// How much of it was done: `quick`, `standard` or `thorough`.
    pub level: String,
    /// What was driven to its limits.
    pub limits: Vec<Limit>,
    /// False if the study was interrupted.
    pub complete: bool,
}

/// One thing that was driven to its limits.
#[derive(Debug, Clone, Serialize)]
pub struct Limit {
    /// Short name.
    pub name: &'static str,
    /// What was driven.
    pub driven: &'static str,
    /// How `measured` is defined, and against what.
    pub measure: &'static str,
    /// Largest `measured` that is right, apart from chance.
    pub allowed: f64,
    /// A note on the limit; may be empty.
    pub remark: &'static str,
    /// What this level left out compared with the thorough one; empty if nothing.
    pub reduced: &'static str,
    /// From the ordinary to the extreme.
    pub trials: Vec<Trial>,
    /// Time that its trials took.
    pub seconds: f64,
}

/// One value of the parameter that is driven.
#[derive(Debug, Clone, Serialize)]
pub struct Trial {
    /// The setting, for people.
    pub setting: String,
    /// Whether the renderer promises to hold here. The others look for the point where it fails.
    pub required: bool,
    /// Error or rate of defects.
    pub measured: f64,
    /// Standard error of `measured`; 0 if it is not a mean over random samples.
    pub standard_error: f64,
    /// Samples or rays that were looked at.
    pub checked: u64,
    /// Samples that were NaN or infinite.
    pub nonfinite_samples: u64,
    /// Why it did not run; empty if it did.
    pub failure: String,
}

impl Trial {
    /// Whether the answer was right.
    pub fn holds(&self, allowed: f64) -> bool {
        // A comparison with NaN is false.
        let within = self.measured <= allowed + CHANCE * self.standard_error;
        within && self.nonfinite_samples == 0 && self.failure.is_empty()
    }
}

impl Limit {
    /// Whether all holds that is promised.
    pub fn holds(&self) -> bool {
        self.trials.iter().all(|trial| !trial.required || trial.holds(self.allowed))
    }

    /// The first setting that failed, promised or not.
    pub fn threshold(&self) -> Option<&Trial> {
        self.trials.iter().find(|trial| !trial.holds(self.allowed))
    }

    /// The last setting before the first that failed.
    pub fn last_good(&self) -> Option<&Trial> {
        self.trials.iter().take_while(|trial| trial.holds(self.allowed)).last()
    }

    /// The largest error among promised settings.
    pub fn worst(&self) -> Option<&Trial> {
        self.trials.iter().filter(|trial| trial.required).max_by(|a, b| a.measured.total_cmp(&b.measured))
    }

    /// Samples or rays that were looked at.
    pub fn checked(&self) -> u64 {
        self.trials.iter().map(|trial| trial.checked).sum()
    }
}

impl Envelope {
    /// Whether all holds that is promised.
    pub fn holds(&self) -> bool {
        self.limits.iter().all(Limit::holds)
    }

    /// Samples that were NaN or infinite, over all trials.
    pub fn nonfinite_samples(&self) -> u64 {
        self.limits.iter().flat_map(|limit| &limit.trials).map(|trial| trial.nonfinite_samples).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trial(setting: &str, required: bool, measured: f64) -> Trial {
        Trial {
            setting: setting.to_owned(),
            required,
            measured,
            standard_error: 0.0,
            checked: 10,
            nonfinite_samples: 0,
            failure: String::new(),
        }
    }

    fn row(trials: Vec<Trial>) -> Limit {
        Limit { name: "r", driven: "", measure: "", allowed: 0.1, remark: "", reduced: "", trials, seconds: 0.0 }
    }

    #[test]
    fn the_threshold_is_the_first_setting_that_fails() {
        let row =
            row(vec![trial("1", true, 0.0), trial("2", true, 0.1), trial("3", false, 0.2), trial("4", false, 0.0)]);
        assert!(row.holds());
        assert_eq!(row.threshold().unwrap().setting, "3");
        assert_eq!(row.last_good().unwrap().setting, "2");
        assert_eq!(row.worst().unwrap().setting, "2");
        assert_eq!(row.checked(), 40);
    }

    #[test]
    fn faults_fail_whatever_was_measured() {
        let good = trial("1", true, 0.0);
        assert!(row(vec![good.clone()]).holds());
        for bad in [
            Trial { nonfinite_samples: 1, ..good.clone() },
            Trial { failure: "no".to_owned(), ..good.clone() },
            Trial { measured: f64::NAN, ..good.clone() },
            Trial { measured: 0.11, ..good.clone() },
        ] {
            assert!(!row(vec![good.clone(), bad]).holds());
        }
    }

    #[test]
    fn a_mean_may_be_off_by_chance() {
        let off = |standard_error| Trial { standard_error, ..trial("1", true, 0.2) };
        assert!(row(vec![off(0.03)]).holds());
        assert!(!row(vec![off(0.02)]).holds());
    }
}
