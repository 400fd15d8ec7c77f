//! Analysis of a study's timings: medians, ratios, their intervals, and warnings.

use std::fmt;
use std::sync::Arc;

use serde::ser::SerializeStruct;
use serde::{Serialize, Serializer};
use serde_json::{Map, Value};

use super::crossover::{Crossover, CrossoverPoint, find_crossings};
use super::measurement::{Measurement, SceneFacts, WarmUpRow, WorkCounters};
use super::noise::{outliers, trend};
use super::validity::Verdict;
use super::{Configuration, Design, Rounds, Study};
use crate::stats::{CONFIDENCE, Estimate, FEWEST_ROUNDS, TOO_FEW_ROUNDS, median};
use raywave::clocks::ClockState;
use raywave::image::Image;
use raywave::settings::Role;

/// p-value of a trend below which the timings drift.
const DRIFT_P: f64 = 0.01;
/// Width of an interval that [`CombinationReport::rounds_needed`] aims at, if the user names none.
const TARGET_WIDTH: f64 = 0.03;
/// Largest share of the total that the kernels' times may miss without a warning.
const KERNEL_SUM_TOLERANCE: f64 = 0.05;

/// Largest deviation of the device's clock from its median in a round, as a share of it.
const CLOCK_TOLERANCE: f64 = 0.02;
/// Reasons for a low clock that are not a problem: the device is idle, or the user has set the clock.
const IDLE: [&str; 2] = ["gpu_idle", "applications_clocks_setting"];

/// The clock by which combinations are compared.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// The host's, around the whole render.
    #[default]
    Wall,
    /// The device's, inside its command buffers.
    Gpu,
}

/// A study and its results.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Whether the study ran to its end.
    pub complete: bool,
    /// Factors and their levels, in order.
    #[serde(serialize_with = "factors")]
    pub factors: Vec<(&'static str, Vec<String>)>,
    /// The baseline.
    pub baseline: Configuration,
    /// How often everything is repeated.
    pub rounds: Rounds,
    /// The clock that is compared.
    pub clock: Clock,
    /// Share of intervals that cover the true value.
    pub confidence: f64,
    /// Seed of the order of the rounds.
    pub seed: u64,
    /// Scene by scene, as far as the study went.
    pub scenes: Vec<SceneReport>,
}

/// The results of one scene.
#[derive(Debug, Clone, Serialize)]
pub struct SceneReport {
    /// The scene.
    #[serde(flatten)]
    pub facts: SceneFacts,
    /// Every combination, in the design's order.
    pub combinations: Vec<CombinationReport>,
    /// Where the faster combination changes, for each workload that was swept.
    pub crossovers: Vec<Crossover>,
}

/// The results of one combination.
#[derive(Debug, Clone, Serialize)]
pub struct CombinationReport {
    /// The combination.
    pub configuration: Configuration,
    /// What distinguishes it from the others.
    pub label: String,
    /// The label of the combination that it is compared with.
    pub baseline: String,
    /// Whether its image passed the gate.
    #[serde(flatten)]
    pub verdict: Verdict,
    /// Median time of a render; `None` if it does not count or has no run.
    pub seconds: Option<Estimate>,
    /// Its time over the baseline's; `None` for the baseline itself.
    pub ratio: Option<Ratio>,
    /// Rank by time among those that do the same work; 1 is the fastest.
    pub rank: Option<usize>,
    /// Rounds after which its intervals would be as narrow as asked for, or 3 %, if widths fall with the square root of
    /// the number of rounds.
    pub rounds_needed: Option<usize>,
    /// Warnings.
    pub warnings: Vec<Warning>,
    /// The first render, with pipelines and start-up. No statistic includes its times.
    pub first: Option<Measurement>,
    /// Work of traversal.
    pub counters: Option<WorkCounters>,
    /// Every timed run.
    #[serde(serialize_with = "bare_runs")]
    pub runs: Vec<Run>,
    /// The complete run with the median time: its kernels add up, which the kernels' medians do not.
    pub typical: Option<Measurement>,
    /// The image of the first render.
    #[serde(skip)]
    pub image: Option<Arc<Image>>,
}

/// One timed run.
#[derive(Debug, Clone)]
pub struct Run {
    /// Its round, from 0.
    pub round: usize,
    /// Its place in the round, from 0.
    pub position: usize,
    /// What it cost.
    pub measurement: Measurement,
}

/// How many times the baseline's time a combination takes: the median over the rounds of the ratio within a round. Runs
/// of a round share its noise, if there is any to share; if there is none, the interval is as wide as that of the ratio
/// of the medians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratio {
    /// The ratio; below 1 is faster than the baseline.
    pub estimate: Estimate,
}

/// What a ratio says about a combination.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RatioVerdict {
    /// The interval is below 1.
    Faster,
    /// The interval is above 1.
    Slower,
    /// The interval contains 1.
    WithinNoise,
    /// There is no interval.
    TooFewRounds,
}

impl RatioVerdict {
    /// Words for tables and files.
    pub fn words(self) -> &'static str {
        match self {
            Self::Faster => "faster",
            Self::Slower => "slower",
            Self::WithinNoise => "within noise",
            Self::TooFewRounds => TOO_FEW_ROUNDS,
        }
    }
}

/// A reason to distrust a combination's timings.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[allow(missing_docs, reason = "the messages say it")]
pub enum Warning {
    FewRounds { rounds: usize, enough: usize },
    SlowFirstRound { times_the_median: f64 },
    Outliers { rounds: Vec<usize> },
    Drift(Drift),
    KernelSum { share_of_gpu_time: f64 },
    NonfiniteSamples { samples: u64 },
    Unsteady { rounds: Vec<usize> },
    OtherClock { rounds: Vec<usize>, median_megahertz: f64 },
    Throttled { rounds: Vec<usize>, reasons: Vec<String> },
}

/// A trend of a combination's timings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Drift {
    /// Spearman's rank correlation of time with round: above 0 if it got slower.
    pub rank_correlation: f64,
    /// Two-sided p-value.
    pub p: f64,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FewRounds { rounds, enough } => {
                write!(f, "{TOO_FEW_ROUNDS} for an interval: {rounds}, where {enough} can hold its confidence")
            }
            Self::SlowFirstRound { times_the_median } => {
                write!(f, "the first round took {times_the_median:.2} times the median; something was still warming up")
            }
            Self::Outliers { rounds } => {
                write!(f, "outliers in round {}; something else was using the machine", numbers(rounds))
            }
            Self::Drift(Drift { rank_correlation, p }) => {
                let way = if *rank_correlation > 0.0 { "slower" } else { "faster" };
                write!(f, "it got {way} from round to round (rank correlation {rank_correlation:.2}, p {p:.4})")
            }
            Self::KernelSum { share_of_gpu_time } => {
                write!(f, "its kernels add up to {:.1} % of the device's time", 100.0 * share_of_gpu_time)
            }
            Self::Unsteady { rounds } => {
                write!(f, "the device's speed had not settled within 1 % before round {}", numbers(rounds))
            }
            Self::OtherClock { rounds, median_megahertz } => {
                let share = 100.0 * CLOCK_TOLERANCE;
                let rounds = numbers(rounds);
                write!(
                    f,
                    "the device's clock was over {share} % off its median of {median_megahertz:.0} MHz in round {rounds}"
                )
            }
            Self::Throttled { rounds, reasons } => {
                write!(f, "the device was throttled in round {}: {}", numbers(rounds), reasons.join(", "))
            }
            Self::NonfiniteSamples { samples } => write!(f, "{samples} samples were NaN or infinite"),
        }
    }
}

/// Rounds as people count them, from 1.
fn numbers(rounds: &[usize]) -> String {
    rounds.iter().map(|round| (round + 1).to_string()).collect::<Vec<_>>().join(", ")
}

impl Report {
    pub(super) fn new(study: &Study) -> Self {
        let factors = study.design.factors();
        Self {
            complete: false,
            factors: factors.iter().map(|factor| (factor.setting.flag, factor.levels.clone())).collect(),
            baseline: study.design.baseline().clone(),
            rounds: study.rounds,
            clock: study.clock,
            confidence: CONFIDENCE,
            seed: study.seed,
            scenes: Vec::new(),
        }
    }

    /// The settings that all combinations of all scenes share, as far as they were rendered.
    pub fn shared_settings(&self) -> Map<String, Value> {
        let firsts = self.scenes.iter().flat_map(|scene| &scene.combinations).filter_map(|c| c.first.as_ref());
        let mut all = firsts.map(|first| &first.settings);
        let mut shared = all.next().cloned().unwrap_or_default();
        for settings in all {
            shared.retain(|key, value| settings.get(key) == Some(value));
        }
        shared
    }

    /// Whether any combination's image is wrong.
    pub fn has_wrong(&self) -> bool {
        let wrong = |c: &CombinationReport| matches!(c.verdict, Verdict::Wrong { .. });
        self.scenes.iter().flat_map(|scene| &scene.combinations).any(wrong)
    }
}

impl SceneReport {
    pub(super) fn new(study: &Study, facts: SceneFacts) -> Self {
        let design = &study.design;
        let combination = |configuration: Configuration| CombinationReport {
            label: design.label(&configuration),
            baseline: design.label(&design.baseline_of(&configuration)),
            configuration,
            verdict: Verdict::Pending,
            seconds: None,
            ratio: None,
            rank: None,
            rounds_needed: None,
            warnings: Vec::new(),
            first: None,
            counters: None,
            runs: Vec::new(),
            typical: None,
            image: None,
        };
        let combinations = design.combinations().into_iter().map(combination).collect();
        Self { facts, combinations, crossovers: Vec::new() }
    }

    /// Whether others are compared with this combination.
    pub fn is_baseline(&self, i: usize) -> bool {
        self.combinations[i].label == self.combinations[i].baseline
    }

    /// The combination that this one is compared with.
    pub fn baseline_of(&self, i: usize) -> &CombinationReport {
        let label = &self.combinations[i].baseline;
        self.combinations.iter().find(|c| c.label == *label).expect("a full factorial has every baseline")
    }

    pub(super) fn find(&self, configuration: &Configuration) -> usize {
        let position = self.combinations.iter().position(|c| c.configuration == *configuration);
        position.expect("a full factorial has every combination")
    }

    /// Width of the widest interval of times and ratios, as a share of its value; infinite before the first round.
    pub fn widest_interval(&self) -> f64 {
        self.combinations.iter().filter(|c| c.verdict.counts()).map(CombinationReport::width).fold(0.0, f64::max)
    }

    /// Computes everything that follows from the runs.
    pub(super) fn analyse(&mut self, study: &Study) {
        for i in 0..self.combinations.len() {
            let ratio = (!self.is_baseline(i)).then(|| {
                let (runs, base) = (&self.combinations[i], self.baseline_of(i));
                let both_count = runs.verdict.counts() && base.verdict.counts();
                both_count.then(|| Ratio::of(&runs.runs, &base.runs, study.clock))?
            });
            self.combinations[i].ratio = ratio.flatten();
            self.combinations[i].analyse(study);
        }
        self.rank();
        self.crossovers = crossovers(self, &study.design, study.clock);
    }

    fn rank(&mut self) {
        let times: Vec<_> = self.combinations.iter().map(|c| (c.baseline.clone(), c.seconds)).collect();
        for (i, combination) in self.combinations.iter_mut().enumerate() {
            let (work, own) = &times[i];
            combination.rank = own.map(|own| {
                let faster = |(others, time): &&(String, Option<Estimate>)| {
                    others == work && time.is_some_and(|time| time.value < own.value)
                };
                1 + times.iter().filter(faster).count()
            });
        }
    }
}

/// The crossovers of a scene: for each workload that has several levels, the baseline against each
/// other combination.
fn crossovers(scene: &SceneReport, design: &Design, clock: Clock) -> Vec<Crossover> {
    let swept = design.factors().iter().filter(|f| f.setting.role == Role::Workload && f.levels.len() > 1);
    swept.flat_map(|factor| sweeps(scene, design, factor.setting.flag, clock)).collect()
}

fn sweeps(scene: &SceneReport, design: &Design, factor: &'static str, clock: Clock) -> Vec<Crossover> {
    let mut lowest: Vec<&Configuration> = Vec::new();
    for configuration in scene.combinations.iter().map(|combination| &combination.configuration) {
        if !lowest.iter().any(|known| known.without(factor) == configuration.without(factor)) {
            lowest.push(configuration);
        }
    }
    let sweep = |configuration: &Configuration| {
        let base = design.baseline_of(configuration).without(factor);
        let other = configuration.without(factor);
        if base == other {
            return None;
        }
        let mut points: Vec<_> = (0..scene.combinations.len())
            .filter(|&i| scene.combinations[i].configuration.without(factor) == other)
            .filter_map(|i| {
                let (b, a) = (&scene.combinations[i], scene.baseline_of(i));
                let point = CrossoverPoint {
                    cost: b.configuration.count(factor)? as f64,
                    a_seconds: a.seconds?,
                    b_seconds: b.seconds?,
                };
                let differences = in_rounds(&a.runs, &b.runs, clock).map(|(a, b)| a - b).collect();
                Some((point, differences))
            })
            .collect();
        if points.len() < 2 {
            return None;
        }
        points.sort_by(|x, y| x.0.cost.total_cmp(&y.0.cost));
        let (points, differences): (Vec<CrossoverPoint>, Vec<Vec<f64>>) = points.into_iter().unzip();
        let costs: Vec<f64> = points.iter().map(|point| point.cost).collect();
        Some(Crossover {
            factor,
            a: design.label_without(&design.baseline_of(configuration), factor),
            b: design.label_without(configuration, factor),
            points,
            crossings: find_crossings(&costs, &differences),
        })
    };
    lowest.into_iter().filter_map(sweep).collect()
}

impl CombinationReport {
    fn analyse(&mut self, study: &Study) {
        (self.seconds, self.typical, self.rounds_needed) = (None, None, None);
        self.warnings.clear();
        if !self.verdict.counts() || self.runs.is_empty() {
            return;
        }
        let seconds: Vec<f64> = self.runs.iter().map(|run| run.seconds(study.clock)).collect();
        let estimate = Estimate::of_median(&seconds);
        self.seconds = Some(estimate);
        let mut order: Vec<usize> = (0..seconds.len()).collect();
        order.sort_by(|&a, &b| seconds[a].total_cmp(&seconds[b]));
        self.typical = Some(self.runs[order[(order.len() - 1) / 2]].measurement.clone());
        let shrink = self.width() / study.rounds.until.unwrap_or(TARGET_WIDTH);
        self.rounds_needed = shrink.is_finite().then(|| (seconds.len() as f64 * shrink * shrink).ceil() as usize);
        self.warn(&seconds, estimate.value);
    }

    fn warn(&mut self, seconds: &[f64], median: f64) {
        if seconds.len() < FEWEST_ROUNDS {
            self.warnings.push(Warning::FewRounds { rounds: seconds.len(), enough: FEWEST_ROUNDS });
        }
        let mut outliers = outliers(seconds);
        if outliers.first() == Some(&0) && seconds[0] > median {
            outliers.remove(0);
            self.warnings.push(Warning::SlowFirstRound { times_the_median: seconds[0] / median });
        }
        if !outliers.is_empty() {
            let rounds = outliers.into_iter().map(|i| self.runs[i].round).collect();
            self.warnings.push(Warning::Outliers { rounds });
        }
        let (rank_correlation, p) = trend(seconds);
        if p < DRIFT_P {
            self.warnings.push(Warning::Drift(Drift { rank_correlation, p }));
        }
        let unsteady = |run: &Run| run.measurement.warm_up.is_some_and(|warm_up| warm_up.steady == Some(false));
        let rounds = self.rounds_where(unsteady);
        if !rounds.is_empty() {
            self.warnings.push(Warning::Unsteady { rounds });
        }
        self.warn_of_clocks();
        let Some(typical) = &self.typical else { return };
        let share_of_gpu_time = typical.kernels.iter().map(|k| k.gpu_seconds).sum::<f64>() / typical.gpu_seconds;
        if (share_of_gpu_time - 1.0).abs() > KERNEL_SUM_TOLERANCE {
            self.warnings.push(Warning::KernelSum { share_of_gpu_time });
        }
        if typical.nonfinite_samples > 0 {
            self.warnings.push(Warning::NonfiniteSamples { samples: typical.nonfinite_samples });
        }
    }

    fn warn_of_clocks(&mut self) {
        let Some(median_megahertz) = self.megahertz() else { return };
        let off = |megahertz: f64| (megahertz / median_megahertz - 1.0).abs() > CLOCK_TOLERANCE;
        let rounds = self.rounds_where(|run| run.measurement.megahertz().is_some_and(off));
        if !rounds.is_empty() {
            self.warnings.push(Warning::OtherClock { rounds, median_megahertz });
        }
        let reasons_of = |run: &Run| -> Vec<String> {
            let after = run.measurement.clocks_after.as_ref().and_then(|clocks| clocks.throttle_reasons.clone());
            after.unwrap_or_default().into_iter().filter(|reason| !IDLE.contains(&reason.as_str())).collect()
        };
        let mut reasons: Vec<String> = self.runs.iter().flat_map(reasons_of).collect();
        reasons.sort_unstable();
        reasons.dedup();
        if !reasons.is_empty() {
            let rounds = self.rounds_where(|run| !reasons_of(run).is_empty());
            self.warnings.push(Warning::Throttled { rounds, reasons });
        }
    }

    /// Clock of the device's processors in the median run, in MHz; `None` if it is not known.
    pub fn megahertz(&self) -> Option<f64> {
        let known: Vec<f64> = self.runs.iter().filter_map(|run| run.measurement.megahertz()).collect();
        (!known.is_empty()).then(|| median(&known))
    }

    /// Rounds that have such runs.
    fn rounds_where(&self, such: impl Fn(&Run) -> bool) -> Vec<usize> {
        self.runs.iter().filter(|run| such(run)).map(|run| run.round).collect()
    }

    /// Width of its wider interval as a share of the value; infinite without one.
    fn width(&self) -> f64 {
        let ratio = self.ratio.map_or(0.0, |ratio| ratio.estimate.relative_width());
        self.seconds.map_or(f64::INFINITY, |seconds| seconds.relative_width().max(ratio))
    }

    /// Samples a second in the median run; `None` if it does not count.
    pub fn samples_per_second(&self) -> Option<f64> {
        Some(self.typical.as_ref()?.samples as f64 / self.seconds?.value)
    }

    /// Rays of all classes a second in the median run; `None` if it does not count.
    pub fn rays_per_second(&self) -> Option<f64> {
        Some(self.typical.as_ref()?.rays.total() as f64 / self.seconds?.value)
    }

    /// Median idle time of the device before a run; `None` if it is not known.
    pub fn idle_before_seconds(&self) -> Option<f64> {
        let idle: Vec<f64> = self.runs.iter().filter_map(|run| run.measurement.idle_before_seconds).collect();
        (!idle.is_empty()).then(|| median(&idle))
    }

    /// Path state that the kernels read and wrote per second of the device's time.
    pub fn path_state_bytes_per_second(&self) -> Option<f64> {
        let typical = self.typical.as_ref().filter(|typical| typical.gpu_seconds > 0.0)?;
        Some(typical.path_state_bytes as f64 / typical.gpu_seconds)
    }
}

impl Run {
    /// Its time on that clock.
    pub fn seconds(&self, clock: Clock) -> f64 {
        match clock {
            Clock::Wall => self.measurement.wall_seconds,
            Clock::Gpu => self.measurement.gpu_seconds,
        }
    }
}

impl Ratio {
    /// The ratio of the runs' times to the baseline's; `None` if they have no round in common.
    pub fn of(runs: &[Run], baseline: &[Run], clock: Clock) -> Option<Self> {
        let ratios: Vec<f64> = in_rounds(runs, baseline, clock).map(|(time, base)| time / base).collect();
        (!ratios.is_empty()).then(|| Self { estimate: Estimate::of_median(&ratios) })
    }

    /// What it says.
    pub fn verdict(&self) -> RatioVerdict {
        match self.estimate.interval {
            None => RatioVerdict::TooFewRounds,
            Some(_) if self.estimate.surely_below(1.0) => RatioVerdict::Faster,
            Some(_) if self.estimate.surely_above(1.0) => RatioVerdict::Slower,
            Some(_) => RatioVerdict::WithinNoise,
        }
    }
}

/// The times of two combinations in each round that both were rendered in.
fn in_rounds(runs: &[Run], others: &[Run], clock: Clock) -> impl Iterator<Item = (f64, f64)> {
    let other = |run: &Run| others.iter().find(|other| other.round == run.round);
    runs.iter().filter_map(move |run| Some((run.seconds(clock), other(run)?.seconds(clock))))
}

impl Serialize for Ratio {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_struct("Ratio", 4)?;
        fields.serialize_field("value", &self.estimate.value)?;
        fields.serialize_field("low", &self.estimate.interval.map(|interval| interval.low))?;
        fields.serialize_field("high", &self.estimate.interval.map(|interval| interval.high))?;
        fields.serialize_field("verdict", self.verdict().words())?;
        fields.end()
    }
}

fn factors<S: Serializer>(factors: &[(&'static str, Vec<String>)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(factors.iter().map(|(name, levels)| (name, levels)))
}

/// Runs as rows of numbers: with their kernels and bounces the file would repeat what `typical` has.
fn bare_runs<S: Serializer>(runs: &[Run], serializer: S) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Row<'a> {
        round: usize,
        position: usize,
        wall_seconds: f64,
        gpu_seconds: f64,
        idle_seconds: Option<f64>,
        idle_before_seconds: Option<f64>,
        warm_up: Option<WarmUpRow>,
        clocks_before: &'a Option<ClockState>,
        clocks_after: &'a Option<ClockState>,
    }
    serializer.collect_seq(runs.iter().map(|&Run { round, position, ref measurement }| Row {
        round,
        position,
        wall_seconds: measurement.wall_seconds,
        gpu_seconds: measurement.gpu_seconds,
        idle_seconds: measurement.idle_seconds,
        idle_before_seconds: measurement.idle_before_seconds,
        warm_up: measurement.warm_up,
        clocks_before: &measurement.clocks_before,
        clocks_after: &measurement.clocks_after,
    }))
}
