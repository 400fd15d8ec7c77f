//! How a sweep runs: a reference, one knob at a time, then combinations of those that were worth it.

use std::ops::ControlFlow;

use super::departures::{Reference, ReferenceSum, mean_radiance};
use super::knobs::{Base, exact, knobs, label};
use super::report::{Held, KnobReport, Stage, TradeoffReport, Worth};
use crate::stats::{Bootstrap, CONFIDENCE, FEWEST_ROUNDS, SplitMix64};
use crate::studies::{Configuration, Measurement, Purpose, Renderer, SceneFacts, StudyError, shuffle};

/// Share of the budget that goes to the reference, if there is none yet.
const REFERENCE_SHARE: f64 = 0.35;
/// Share of the budget that goes to knobs, one at a time.
const ONE_KNOB_SHARE: f64 = 0.35;
/// Rounds for which the samples of the base are chosen.
const WANTED_ROUNDS: usize = 8;
/// Minimum number of renders of a reference: their scatter gives its noise.
const FEWEST_REFERENCES: u64 = 8;
/// First seed of a reference; points begin at 0.
const REFERENCE_SEED: u32 = 1 << 30;
/// Numbers of samples of combinations, over those of the base.
const LADDER: [f64; 5] = [1.0 / 16.0, 0.25, 1.0, 4.0, 16.0];
/// Share of the base's error at which knobs are chosen to be combined.
const FINER: f64 = 0.25;
/// Share of the base's time to an equal error below which a knob is tried in combinations.
const PROMISING: f64 = 0.97;
/// Share of the base's time that it must be significantly below for that.
const HARDLY_WORSE: f64 = 1.1;
/// Configurations that are pursued towards a wanted error.
const CANDIDATES: usize = 3;

/// A sweep: a scene, a budget, and what is asked.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// The scene.
    pub scene: String,
    /// Flags of `render` that load the scene as here, which are repeated in those of every point.
    pub load_flags: String,
    /// Seconds of rendering that it may take, on the host's clock. Building kernels and writing files are extra.
    pub budget_seconds: f64,
    /// Rounds of a stage at most.
    pub rounds: usize,
    /// Whether the base's samples are fixed. Otherwise they are reduced to what the budget allows.
    pub fixed_samples: bool,
    /// relMSE of the reference by its own noise that is good enough.
    pub reference_error: f64,
    /// The relMSE to reach soonest, if one is given.
    pub target: Option<f64>,
    /// How intervals of errors are computed.
    pub bootstrap: Bootstrap,
    /// Seed of the order of the renders.
    pub seed: u64,
}

/// Keeps references from one sweep to the next.
pub trait ReferenceKeeper {
    /// The reference for the scene with those settings, if there is one.
    ///
    /// # Errors
    /// A reference that was named and cannot be read or has another size.
    fn load(&mut self, facts: &SceneFacts, base: &Base) -> Result<Option<Reference>, StudyError>;

    /// Keeps a reference.
    fn store(&mut self, facts: &SceneFacts, base: &Base, reference: &Reference);
}

/// What a stage will do, reported before it begins.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepPlan {
    /// What it is.
    pub stage: &'static str,
    /// Points that are rendered in each round.
    pub points: Vec<String>,
    /// Rounds.
    pub rounds: usize,
    /// Approximate seconds of rendering that it takes.
    pub seconds: f64,
    /// Approximate bytes of images that it keeps.
    pub image_bytes: u64,
}

/// What happens in a sweep, as it happens.
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs, reason = "the fields say it")]
pub enum SweepEvent<'a> {
    /// A stage is about to begin.
    Planned(&'a SweepPlan),
    /// A render begins; a reference has no round.
    Rendering { label: &'a str, round: Option<usize> },
    /// The report has changed: worth writing down, in case there is no next one.
    Updated(&'a TradeoffReport),
}

/// Receives events and says whether to go on.
pub type SweepListener<'a> = dyn FnMut(SweepEvent<'_>) -> ControlFlow<()> + 'a;

/// A point with one knob changed: its index, the factor, its level and the base's.
type Turned = (usize, &'static str, String, String);

/// A running sweep.
struct Run<'a> {
    sweep: &'a Sweep,
    renderer: &'a mut dyn Renderer,
    listen: &'a mut SweepListener<'a>,
    report: TradeoffReport,
    turned: Vec<Turned>,
    random: SplitMix64,
    /// Seconds of rendering so far.
    spent: f64,
    /// Seconds of a sample of every pixel in the base.
    sample_seconds: f64,
}

impl Sweep {
    /// Runs the sweep. When `listen` breaks it ends there, and the report holds the results so far.
    ///
    /// # Errors
    /// A scene that does not open, a base that does not render, a reference that does not fit.
    pub fn run<'a>(
        &'a self,
        renderer: &'a mut dyn Renderer,
        keeper: &mut dyn ReferenceKeeper,
        listen: &'a mut SweepListener<'a>,
    ) -> Result<TradeoffReport, StudyError> {
        let facts =
            renderer.open(&self.scene).map_err(|cause| StudyError::Scene { scene: self.scene.clone(), cause })?;
        let report = TradeoffReport::new(self, facts);
        let random = SplitMix64::new(self.seed);
        let mut run =
            Run { sweep: self, renderer, listen, report, turned: Vec::new(), random, spent: 0.0, sample_seconds: 0.0 };
        let outcome = run.carry_out(keeper)?;
        run.report.complete = outcome.is_continue();
        run.report.analyse(&run.turned, self.target);
        let _ = (run.listen)(SweepEvent::Updated(&run.report));
        Ok(run.report)
    }
}

impl TradeoffReport {
    fn new(sweep: &Sweep, facts: SceneFacts) -> Self {
        Self {
            complete: false,
            base_samples: facts.samples_per_pixel,
            facts,
            base_settings: serde_json::Map::new(),
            reference: String::new(),
            reference_noise: None,
            confidence: CONFIDENCE,
            bootstrap_resamples: sweep.bootstrap.resamples,
            seed: sweep.seed,
            points: Vec::new(),
            knobs: Vec::new(),
            front: Vec::new(),
            target: None,
            load_flags: sweep.load_flags.clone(),
            bootstrap: sweep.bootstrap,
            held_against: None,
        }
    }
}

impl Run<'_> {
    fn carry_out(&mut self, keeper: &mut dyn ReferenceKeeper) -> Result<ControlFlow<()>, StudyError> {
        let mut base = self.first_look()?;
        let Some(reference) = self.reference(&base, keeper)? else { return Ok(ControlFlow::Break(())) };
        base.mean_radiance = mean_radiance(&reference.image);
        self.report.reference.clone_from(&reference.origin);
        self.report.reference_noise = reference.noise;
        self.report.held_against = Some(Held { reference, mean: base.mean_radiance });

        self.choose_samples(&base);
        self.turn_knobs(&base);
        let knobs = (0..self.report.points.len()).collect();
        let rest = self.sweep.budget_seconds - self.spent;
        let share = rest * ONE_KNOB_SHARE / (1.0 - REFERENCE_SHARE);
        if self.stage("one knob at a time", knobs, share).is_break() {
            return Ok(ControlFlow::Break(()));
        }
        let rest = self.sweep.budget_seconds - self.spent;
        let share = if self.sweep.target.is_some() { 0.6 * rest } else { rest };
        let combined = self.combine(share);
        if !combined.is_empty() && self.stage("what is worth it, along the samples", combined, share).is_break() {
            return Ok(ControlFlow::Break(()));
        }
        let Some(target) = self.sweep.target else { return Ok(ControlFlow::Continue(())) };
        let rest = self.sweep.budget_seconds - self.spent;
        let candidates = self.candidates(target, rest);
        if candidates.is_empty() {
            return Ok(ControlFlow::Continue(()));
        }
        Ok(self.stage("towards the wanted error", candidates, rest))
    }

    /// The first render of the base: its settings and its speed.
    fn first_look(&mut self) -> Result<Base, StudyError> {
        let few = self.report.base_samples.min(8);
        let configuration = Configuration::default().with("samples", &few.to_string());
        let _ = (self.listen)(SweepEvent::Rendering { label: "first look", round: None });
        let broken = |cause: String| StudyError::Baseline {
            scene: self.report.facts.scene.clone(),
            configuration: "the base".to_owned(),
            cause,
        };
        let first = self.renderer.run(&configuration, Purpose::First).map_err(|cause| broken(cause.to_string()))?;
        self.spent += first.wall_seconds;
        self.sample_seconds = first.wall_seconds / f64::from(few);
        self.report.base_settings.clone_from(&first.settings);
        Ok(Base { settings: self.report.facts.settings, record: first.settings, mean_radiance: 0.0 })
    }

    /// The reference: a kept one, or a new one. `None` if the user interrupted.
    fn reference(&mut self, base: &Base, keeper: &mut dyn ReferenceKeeper) -> Result<Option<Reference>, StudyError> {
        if let Some(reference) = keeper.load(&self.report.facts, base)? {
            return Ok(Some(reference));
        }
        let allowed = REFERENCE_SHARE * self.sweep.budget_seconds;
        // A render takes a fiftieth of what is allowed, so that noise decides their number.
        let samples = (allowed / 50.0 / self.sample_seconds).clamp(1.0, 1024.0) as u32;
        let configuration = exact(&Configuration::default()).with("samples", &samples.to_string());
        let plan = SweepPlan {
            stage: "reference",
            points: vec![label(&configuration)],
            rounds: (allowed / (f64::from(samples) * self.sample_seconds)) as usize,
            seconds: allowed,
            image_bytes: 0,
        };
        let _ = (self.listen)(SweepEvent::Planned(&plan));
        let (mut sum, mut next_look) = (ReferenceSum::default(), FEWEST_REFERENCES);
        let begin = self.spent;
        loop {
            if (self.listen)(SweepEvent::Rendering { label: "reference", round: None }).is_break() {
                return Ok(None);
            }
            let seed = REFERENCE_SEED + sum.renders() as u32;
            let broken = |cause: String| StudyError::Baseline {
                scene: self.report.facts.scene.clone(),
                configuration: "the reference".to_owned(),
                cause,
            };
            let rendered = self.renderer.run(&configuration, Purpose::Seeded(seed));
            let measurement = rendered.map_err(|cause| broken(cause.to_string()))?;
            self.spent += measurement.seconds_spent();
            let image = measurement.image.ok_or_else(|| broken("the renderer made no image".to_owned()))?;
            sum.add(&image);
            // Computing the noise takes as long as some renders do.
            let over = self.spent - begin >= allowed;
            if sum.renders() < next_look && !(over && sum.renders() >= FEWEST_REFERENCES) {
                continue;
            }
            next_look = sum.renders() + sum.renders().div_ceil(8);
            let reference = sum.reference(samples.into());
            let good = reference.noise.is_some_and(|noise| noise.relative_variance <= self.sweep.reference_error);
            if good || over {
                keeper.store(&self.report.facts, base, &reference);
                return Ok(Some(reference));
            }
        }
    }

    /// Reduces the base's samples to what the budget allows.
    fn choose_samples(&mut self, base: &Base) {
        if self.sweep.fixed_samples {
            return;
        }
        let points = 1 + knobs().map(|(setting, _)| base.other_levels(setting).len()).sum::<usize>();
        let rest = (self.sweep.budget_seconds - self.spent) * ONE_KNOB_SHARE / (1.0 - REFERENCE_SHARE);
        let samples = rest / (WANTED_ROUNDS * points) as f64 / self.sample_seconds;
        let power = (samples.max(1.0).log2().floor()).exp2() as u32;
        self.report.base_samples = power.min(self.report.base_samples).max(1);
    }

    fn turn_knobs(&mut self, base: &Base) {
        let samples = self.report.base_samples.to_string();
        let start = Configuration::default().with("samples", &samples);
        self.report.add_point(start.clone(), Stage::OneKnob);
        for (setting, _) in knobs() {
            for level in base.other_levels(setting) {
                let configuration = start.with(setting.flag, &level);
                self.turned.push((self.report.points.len(), setting.flag, level, base.level(setting)));
                self.report.add_point(configuration, Stage::OneKnob);
            }
        }
    }

    /// Combines what seems worth it individually, over numbers of samples: the base, all knobs without bias, these with
    /// each biased one, and with all of those. As many numbers of samples as fit the seconds. Returns the new points'
    /// indices.
    fn combine(&mut self, seconds: f64) -> Vec<usize> {
        // The samples come first, as in the points with one knob changed.
        let none = Configuration::default().with("samples", &self.report.base_samples.to_string());
        let error = self.report.points[0].rel_mse.map_or(f64::INFINITY, |error| error.total.value);
        // A biased knob must be worth it with more samples too.
        let wanted = self.sweep.target.unwrap_or(FINER * error);
        let buys = |knob: &KnobReport| {
            knob.time_to(wanted).filter(|ratio| *ratio < PROMISING && knob.cost_ratio.surely_below(HARDLY_WORSE))
        };
        let best = |biased: bool| {
            let mut best: Vec<(&KnobReport, f64)> = Vec::new();
            let promising =
                self.report.knobs.iter().filter(|knob| knob.worth != Worth::Never && knob.biased() == biased);
            for (knob, ratio) in promising.filter_map(|knob| Some((knob, buys(knob)?))) {
                match best.iter_mut().find(|(other, _)| other.factor == knob.factor) {
                    Some(other) if other.1 > ratio => *other = (knob, ratio),
                    Some(_) => {}
                    None => best.push((knob, ratio)),
                }
            }
            best
        };
        let with = |arm: &(Configuration, f64), knob: &KnobReport| {
            // Two levels of one factor exclude each other.
            let ratio = if arm.0.level(knob.factor).is_some() { 1.0 } else { knob.time_ratio.value };
            (arm.0.with(knob.factor, &knob.level), arm.1 * ratio)
        };
        let (right, biased) = (best(false), best(true));
        let start = (none, 1.0);
        let all_right = right.iter().fold(start.clone(), |arm, (knob, _)| with(&arm, knob));
        let everything = biased.iter().fold(all_right.clone(), |arm, (knob, _)| with(&arm, knob));
        let mut arms = vec![start, all_right.clone()];
        arms.extend(biased.iter().map(|(knob, _)| with(&all_right, knob)));
        arms.push(everything);
        let mut points: Vec<(Configuration, f64)> = Vec::new();
        for (configuration, time_ratio) in arms {
            for step in LADDER {
                let samples = (f64::from(self.report.base_samples) * step).round();
                let configuration = configuration.with("samples", &samples.to_string());
                // Points with one knob are there already, with as many renders as they need.
                let known =
                    self.report.point(&configuration).is_some() || points.iter().any(|(c, _)| *c == configuration);
                if samples >= 1.0 && !known {
                    points.push((configuration, samples * self.sample_seconds * time_ratio));
                }
            }
        }
        let round = |points: &[(Configuration, f64)]| points.iter().map(|(_, seconds)| seconds).sum::<f64>();
        while FEWEST_ROUNDS as f64 * round(&points) > seconds && points.len() > 1 {
            let longest = (0..points.len()).max_by(|&a, &b| points[a].1.total_cmp(&points[b].1));
            points.remove(longest.unwrap_or(0));
        }
        let first = self.report.points.len();
        for (configuration, _) in points {
            self.report.add_point(configuration, Stage::Combined);
        }
        (first..self.report.points.len()).collect()
    }

    /// Points at which those that seem to reach the wanted error soonest should reach it, as many as fit the seconds.
    /// Points that take too long to render are inferred.
    fn candidates(&mut self, target: f64, seconds: f64) -> Vec<usize> {
        self.report.analyse(&self.turned, Some(target));
        let Some(answer) = &self.report.target else { return Vec::new() };
        let mut left = seconds;
        let fits = |time: &f64| {
            left -= FEWEST_ROUNDS as f64 * time;
            left >= 0.0
        };
        let fitting = answer.arms.iter().map(|(_, time)| *time).take_while(fits).count().min(CANDIDATES);
        let wanted: Vec<Configuration> = answer.candidates[..fitting].to_vec();
        let first = self.report.points.len();
        for configuration in wanted {
            if self.report.point(&configuration).is_none() {
                self.report.add_point(configuration, Stage::Target);
            }
        }
        (first..self.report.points.len()).collect()
    }

    /// Rounds over the points, each in a new random order, for as long as the seconds last.
    fn stage(&mut self, name: &'static str, points: Vec<usize>, seconds: f64) -> ControlFlow<()> {
        let samples = |i: &usize| f64::from(self.report.points[*i].samples) * self.sample_seconds;
        let round_seconds: f64 = points.iter().map(samples).sum();
        let fitting = if round_seconds > 0.0 { (seconds / round_seconds) as usize } else { usize::MAX };
        let rounds = fitting.clamp(FEWEST_ROUNDS, self.sweep.rounds.max(FEWEST_ROUNDS));
        let pixels = u64::from(self.report.facts.width_pixels) * u64::from(self.report.facts.height_pixels);
        let plan = SweepPlan {
            stage: name,
            points: points.iter().map(|i| self.report.points[*i].full_label()).collect(),
            rounds,
            seconds: rounds as f64 * round_seconds,
            image_bytes: 12 * pixels * (points.len() * rounds) as u64,
        };
        let begin = self.spent;
        (self.listen)(SweepEvent::Planned(&plan))?;
        for round in 0..rounds {
            // Later rounds are dropped if earlier ones took longer than expected.
            if round >= FEWEST_ROUNDS && self.spent - begin + round_seconds > seconds.max(plan.seconds) {
                break;
            }
            let outcome = self.round(round, &points);
            self.report.analyse(&self.turned, self.sweep.target);
            (self.listen)(SweepEvent::Updated(&self.report))?;
            outcome?;
        }
        ControlFlow::Continue(())
    }

    fn round(&mut self, round: usize, points: &[usize]) -> ControlFlow<()> {
        let mut order: Vec<usize> =
            points.iter().copied().filter(|i| self.report.points[*i].failed.is_none()).collect();
        shuffle(&mut order, &mut self.random);
        // All points have the same seeds, so that they can be compared render by render.
        let seed = round as u32;
        let mut progress = ControlFlow::Continue(());
        for i in order {
            let label = self.report.points[i].full_label();
            progress = (self.listen)(SweepEvent::Rendering { label: &label, round: Some(round) });
            if progress.is_break() {
                break;
            }
            let rendered = self.renderer.run(&self.report.points[i].configuration, Purpose::Seeded(seed));
            self.take(i, seed, rendered.map_err(|cause| cause.to_string()));
        }
        progress
    }

    fn take(&mut self, i: usize, seed: u32, rendered: Result<Measurement, String>) {
        let point = &mut self.report.points[i];
        match rendered {
            Err(cause) => point.failed = Some(cause),
            Ok(mut measurement) => {
                self.spent += measurement.seconds_spent();
                match measurement.image.take() {
                    None => point.failed = Some("the renderer made no image".to_owned()),
                    Some(image) => point.add(seed, measurement, image),
                }
            }
        }
    }
}
