//! Analysis of a sweep's renders: time and error of each point, the front, and what each knob is worth.

use std::sync::Arc;

use serde::Serialize;
use serde_json::{Map, Value};

use super::departures::{Decomposition, Departure, Products, Reference, ReferenceNoise, by_renders, products, widened};
use super::knobs::{flags, label};
use crate::stats::{Bootstrap, Estimate, TOO_FEW_ROUNDS, median};
use crate::studies::{Configuration, Measurement, SceneFacts};
use raywave::image::Image;

/// A sweep and its results.
#[derive(Debug, Clone, Serialize)]
pub struct TradeoffReport {
    /// Whether the sweep ran to its end.
    pub complete: bool,
    /// The scene.
    #[serde(flatten)]
    pub facts: SceneFacts,
    /// Settings of the base.
    pub base_settings: Map<String, Value>,
    /// Samples of each pixel that knobs are compared at.
    pub base_samples: u32,
    /// Where the reference comes from.
    pub reference: String,
    /// Its noise, if it is known.
    pub reference_noise: Option<ReferenceNoise>,
    /// Share of intervals that cover the true value.
    pub confidence: f64,
    /// Resamples of each interval of an error.
    pub bootstrap_resamples: usize,
    /// Seed of the order of the renders.
    pub seed: u64,
    /// Every point, in the order in which the sweep came to it; the base is the first.
    pub points: Vec<PointReport>,
    /// Every knob at every level except the base's, the most valuable first.
    pub knobs: Vec<KnobReport>,
    /// Indices in `points` of the front: those that no other point beats in both time and error, the fastest first.
    pub front: Vec<usize>,
    /// What reaches the wanted error soonest.
    pub target: Option<TargetAnswer>,
    #[serde(skip)]
    pub(super) load_flags: String,
    #[serde(skip)]
    pub(super) bootstrap: Bootstrap,
    #[serde(skip)]
    pub(super) held_against: Option<Held>,
}

/// The reference and its mean radiance, over pixels and channels.
#[derive(Debug, Clone)]
pub(super) struct Held {
    pub reference: Reference,
    pub mean: f64,
}

/// Why a point is in the sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// One knob changed, or none.
    OneKnob,
    /// Knobs that were worth it, combined, over numbers of samples.
    Combined,
    /// To reach the wanted error.
    Target,
}

/// A configuration with its samples, and its results. Estimates need two renders.
#[derive(Debug, Clone, Serialize)]
pub struct PointReport {
    /// What is different from the base, and the samples.
    pub configuration: Configuration,
    /// Its name, without samples.
    pub label: String,
    /// Samples of each pixel.
    pub samples: u32,
    /// Flags of `render` that make it.
    pub flags: String,
    /// Why it is in the sweep.
    pub stage: Stage,
    /// Why it was abandoned.
    pub failed: Option<String>,
    /// Median time of a render, on the device's clock if it has one.
    pub seconds: Option<Estimate>,
    /// Squared error over radiance² + 0.01, by pixel and channel: relMSE.
    pub rel_mse: Option<Decomposition>,
    /// Squared error, radiance squared.
    pub mse: Option<Decomposition>,
    /// Mean error over the mean of the reference: negative if light is lost.
    pub mean_error: Option<Estimate>,
    /// 1 / (relMSE · seconds).
    pub efficiency: Option<Estimate>,
    /// Whether no other point is both faster and more accurate.
    pub on_front: bool,
    /// Samples that were NaN or infinite, over all renders.
    pub nonfinite_samples: u64,
    /// Every render.
    pub runs: Vec<PointRun>,
    /// The image of the first render.
    #[serde(skip)]
    pub image: Option<Arc<Image>>,
    #[serde(skip)]
    series: Series,
}

/// One render of a point.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PointRun {
    /// Its seed.
    pub seed: u32,
    /// On the device's clock; 0 if it has none.
    pub gpu_seconds: f64,
    /// On the host's clock.
    pub wall_seconds: f64,
    /// relMSE, including the reference's noise.
    pub rel_mse: f64,
    /// MSE, including the reference's noise.
    pub mse: f64,
    /// Mean error, radiance.
    pub mean_error: f64,
}

/// The renders of a point, and their products.
#[derive(Debug, Clone, Default)]
struct Series {
    images: Vec<Arc<Image>>,
    relative: Products,
    absolute: Products,
    /// Relative products of the differences from the base with the same seeds.
    from_base: Products,
}

/// What a knob is worth at one level, compared with more or fewer samples in the base.
#[derive(Debug, Clone, Serialize)]
pub struct KnobReport {
    /// The factor.
    pub factor: &'static str,
    /// Its level.
    pub level: String,
    /// The base's level.
    pub base_level: String,
    /// Time over the base's at equal samples.
    pub time_ratio: Estimate,
    /// Time over the base's to an equal variance: below 1 it gains more than it costs.
    pub cost_ratio: Estimate,
    /// Squared bias against the base, with equal seeds; in relMSE.
    pub bias_squared: Estimate,
    /// Its mean minus the base's, over the mean of the reference.
    pub mean_shift: Estimate,
    /// Whether all images are the base's to the last bit.
    pub identical: bool,
    /// The verdict.
    pub worth: Worth,
    /// Time over the base's to the relMSE that the base has at the samples that knobs are compared at, bias included;
    /// `None` if the bias exceeds it.
    pub equal_error_ratio: Option<f64>,
    /// The relMSE above which a biased knob is worth it.
    pub pays_above: Option<f64>,
}

impl KnobReport {
    /// Time over the base's to a relMSE, bias included; `None` if the bias exceeds it. The base's variance is
    /// proportional to the inverse of its time, and so is the knob's.
    pub fn time_to(&self, rel_mse: f64) -> Option<f64> {
        let bias = if self.biased() { self.bias_squared.value } else { 0.0 };
        (bias < rel_mse).then(|| self.cost_ratio.value * rel_mse / (rel_mse - bias))
    }

    /// Whether its bias is significantly above 0.
    pub fn biased(&self) -> bool {
        !self.identical && self.bias_squared.surely_above(0.0)
    }
}

/// What a knob is worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Worth {
    /// It takes significantly less time to an equal error, and shows no bias.
    Free,
    /// It takes significantly less time where its bias is acceptable.
    Trade,
    /// Not significantly better or worse than the base.
    Even,
    /// It takes significantly more time to an equal error: a change of samples does more.
    Never,
    /// There are no intervals to judge it by.
    TooFewRounds,
}

impl Worth {
    /// Words for tables.
    pub fn words(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::Trade => "trade",
            Self::Even => "even",
            Self::Never => "never",
            Self::TooFewRounds => TOO_FEW_ROUNDS,
        }
    }
}

/// What reaches a wanted error soonest.
#[derive(Debug, Clone, Serialize)]
pub struct TargetAnswer {
    /// The wanted relMSE.
    pub rel_mse: f64,
    /// The settings, with their samples; `None` if everything that was tried has more bias.
    pub configuration: Option<Configuration>,
    /// Their name.
    pub label: String,
    /// Flags of `render` that make them.
    pub flags: String,
    /// Samples of each pixel.
    pub samples: u32,
    /// Time of a render.
    pub seconds: f64,
    /// Whether it is a point of the sweep; otherwise it is inferred from the nearest.
    pub measured: bool,
    /// Arms and their times to the error, the fastest first.
    pub arms: Vec<(String, f64)>,
    /// Their configurations with the samples that should be enough.
    #[serde(skip)]
    pub(super) candidates: Vec<Configuration>,
}

impl PointReport {
    fn new(configuration: Configuration, stage: Stage, flags: String) -> Self {
        let samples = configuration.count("samples").and_then(|n| u32::try_from(n).ok()).unwrap_or(1);
        Self {
            label: label(&configuration),
            flags,
            samples,
            configuration,
            stage,
            failed: None,
            seconds: None,
            rel_mse: None,
            mse: None,
            mean_error: None,
            efficiency: None,
            on_front: false,
            nonfinite_samples: 0,
            runs: Vec::new(),
            image: None,
            series: Series::default(),
        }
    }

    /// Label and samples.
    pub fn full_label(&self) -> String {
        format!("{}, {} samples", self.label, self.samples)
    }

    /// Adds a render, which [`TradeoffReport::analyse`] compares with the reference.
    pub(super) fn add(&mut self, seed: u32, measurement: Measurement, image: Image) {
        let image = Arc::new(image);
        self.image.get_or_insert_with(|| Arc::clone(&image));
        self.series.images.push(image);
        self.nonfinite_samples += measurement.nonfinite_samples;
        self.runs.push(PointRun {
            seed,
            gpu_seconds: measurement.gpu_seconds,
            wall_seconds: measurement.wall_seconds,
            rel_mse: f64::NAN,
            mse: f64::NAN,
            mean_error: f64::NAN,
        });
    }

    fn times(&self) -> Vec<f64> {
        let clock = |run: &PointRun| if run.gpu_seconds > 0.0 { run.gpu_seconds } else { run.wall_seconds };
        self.runs.iter().map(clock).collect()
    }

    fn analyse(&mut self, Held { reference, mean }: &Held, bootstrap: &Bootstrap) {
        if self.runs.len() < 2 {
            return;
        }
        let times = self.times();
        let (relative, uncertainty) = reference.relative_noise();
        self.seconds = Some(Estimate::of_median(&times));
        self.rel_mse = Decomposition::of(&self.series.relative, relative, uncertainty, bootstrap);
        let (absolute, absolute_uncertainty) = reference.absolute_noise();
        self.mse = Decomposition::of(&self.series.absolute, absolute, absolute_uncertainty, bootstrap);
        let errors: Vec<f64> = self.runs.iter().map(|run| run.mean_error / mean).collect();
        let own_error = reference.noise.map_or(0.0, |noise| noise.mean_standard_error / mean);
        let error = bootstrap.estimate(&errors, crate::stats::mean);
        self.mean_error = Some(widened(error, own_error));
        self.efficiency = Some(by_renders(times.len(), bootstrap, |weights| {
            let squares = (0..times.len()).map(|k| weights[k] * self.series.relative.square(k)).sum::<f64>();
            let error = squares / weights.iter().sum::<f64>() - relative;
            1.0 / (error.max(f64::MIN_POSITIVE) * weighted_median(&times, weights))
        }));
    }
}

/// The median of values with multiplicities.
fn weighted_median(values: &[f64], weights: &[f64]) -> f64 {
    let repeated = values.iter().zip(weights).flat_map(|(value, weight)| std::iter::repeat_n(*value, *weight as usize));
    median(&repeated.collect::<Vec<_>>())
}

impl TradeoffReport {
    /// The flags of `render` that load the scene and make a point; empty for a configuration that is not valid.
    fn flags(&self, configuration: &Configuration) -> String {
        let mut flags = flags(&self.facts.settings, configuration);
        if !flags.is_empty() && !self.load_flags.is_empty() {
            flags = format!("{} {flags}", self.load_flags);
        }
        flags
    }

    /// Adds a point that is still to be rendered.
    pub(super) fn add_point(&mut self, configuration: Configuration, stage: Stage) {
        let flags = self.flags(&configuration);
        self.points.push(PointReport::new(configuration, stage, flags));
    }

    /// The reference's image, once there is one.
    pub fn reference_image(&self) -> Option<&Arc<Image>> {
        self.held_against.as_ref().map(|held| &held.reference.image)
    }

    pub(super) fn point(&self, configuration: &Configuration) -> Option<usize> {
        self.points.iter().position(|point| point.configuration == *configuration)
    }

    /// Computes everything that follows from the renders; `turned` lists points with one knob changed, as index,
    /// factor, level and the base's level.
    pub(super) fn analyse(&mut self, turned: &[(usize, &'static str, String, String)], target: Option<f64>) {
        let Some(held) = self.held_against.clone() else { return };
        self.hold(turned, &held.reference.image);
        let bootstrap = self.bootstrap;
        for point in &mut self.points {
            point.analyse(&held, &bootstrap);
        }
        let costs = |point: &PointReport| {
            let (seconds, error) = (point.seconds.as_ref()?.value, point.rel_mse.as_ref()?.total.value);
            point.failed.is_none().then_some((seconds, error))
        };
        let all: Vec<Option<(f64, f64)>> = self.points.iter().map(costs).collect();
        self.front = front(&all);
        for (i, point) in self.points.iter_mut().enumerate() {
            point.on_front = self.front.contains(&i);
        }
        self.judge_knobs(turned, &held);
        self.target = target.map(|wanted| self.answer(wanted));
    }

    /// Compares renders with the reference, and those with a knob changed with the base's of the same seeds, unless
    /// that is done already.
    fn hold(&mut self, turned: &[(usize, &'static str, String, String)], reference: &Image) {
        let mut departures = Vec::new();
        let mut places = Vec::new();
        for (i, PointReport { series, .. }) in self.points.iter().enumerate() {
            for k in series.relative.len()..series.images.len() {
                departures.push(Departure::among(k, true, |k| [&series.images[k], reference]));
                places.push((i, false));
            }
            if turned.iter().any(|(point, ..)| *point == i) {
                let base = &self.points[0].series.images;
                for k in series.from_base.len()..series.images.len().min(base.len()) {
                    departures.push(Departure::among(k, false, |k| [&series.images[k], &base[k]]));
                    places.push((i, true));
                }
            }
        }
        for ((i, is_from_base), row) in places.into_iter().zip(products(&departures, reference)) {
            let PointReport { series, runs, .. } = &mut self.points[i];
            if is_from_base {
                series.from_base.push(row.relative);
                continue;
            }
            series.relative.push(row.relative);
            series.absolute.push(row.absolute);
            let k = series.relative.len() - 1;
            let (rel_mse, mse) = (series.relative.square(k), series.absolute.square(k));
            runs[k] = PointRun { rel_mse, mse, mean_error: row.mean, ..runs[k] };
        }
    }

    fn judge_knobs(&mut self, turned: &[(usize, &'static str, String, String)], held: &Held) {
        self.knobs.clear();
        if self.points.is_empty() {
            return;
        }
        let (base, others) = self.points.split_at(1);
        let base = &base[0];
        for (i, factor, level, base_level) in turned {
            let point = &others[i - 1];
            if point.failed.is_none() {
                let judged = point.judge(base, held, &self.bootstrap, (*factor, level, base_level));
                self.knobs.extend(judged);
            }
        }
        // Those that gain come first, by what they gain here.
        let order = |knob: &KnobReport| {
            let buys = matches!(knob.worth, Worth::Free | Worth::Trade);
            let rank = if buys { 0 } else { 1 + knob.worth as usize };
            (rank, if buys { knob.equal_error_ratio.unwrap_or(f64::MAX) } else { knob.cost_ratio.value })
        };
        self.knobs.sort_by(|a, b| {
            let ((a_rank, a_cost), (b_rank, b_cost)) = (order(a), order(b));
            a_rank.cmp(&b_rank).then(a_cost.total_cmp(&b_cost))
        });
    }

    /// What reaches the error soonest. Each configuration is judged by its point nearest to the error; its variance is
    /// proportional to the inverse of the samples, its bias constant.
    fn answer(&self, wanted: f64) -> TargetAnswer {
        let mut best: Vec<(f64, Configuration, u32, bool)> = Vec::new();
        for (i, point) in self.points.iter().enumerate() {
            let arm = point.configuration.without("samples");
            if self.points[..i].iter().any(|before| before.configuration.without("samples") == arm) {
                continue;
            }
            let measured = self.points.iter().filter(|point| point.configuration.without("samples") == arm);
            let known = measured.filter_map(|point| {
                let (seconds, error) = (point.seconds?.value, point.rel_mse?);
                point.failed.is_none().then_some((point, seconds, error))
            });
            let apart = |error: &Decomposition| (error.total.value / wanted).ln().abs();
            let nearest = known.min_by(|a, b| apart(&a.2).total_cmp(&apart(&b.2)));
            let Some((point, seconds, error)) = nearest else { continue };
            // A bias that is not significant counts as 0.
            let bias = if error.is_biased() { error.bias_squared.value } else { 0.0 };
            let variance = error.total.value - bias;
            if bias >= wanted || variance <= 0.0 {
                continue;
            }
            let within = error.total.value <= wanted && error.total.value > 0.8 * wanted;
            let samples = (f64::from(point.samples) * variance / (wanted - bias)).ceil().max(1.0);
            let samples = if within { point.samples } else { samples.min(f64::from(u32::MAX)) as u32 };
            let time = seconds * f64::from(samples) / f64::from(point.samples);
            let configuration = point.configuration.with("samples", &samples.to_string());
            best.push((time, configuration, samples, samples == point.samples));
        }
        best.sort_by(|a, b| a.0.total_cmp(&b.0));
        let arms = best.iter().map(|(time, configuration, ..)| (label(configuration), *time)).collect();
        let candidates = best.iter().map(|(_, configuration, ..)| configuration.clone()).collect();
        let first = best.into_iter().next();
        let (seconds, samples, measured) = first.as_ref().map_or((f64::NAN, 0, false), |b| (b.0, b.2, b.3));
        let configuration = first.map(|best| best.1);
        let label = configuration.as_ref().map(label).unwrap_or_default();
        let flags = configuration.as_ref().map(|configuration| self.flags(configuration)).unwrap_or_default();
        TargetAnswer { rel_mse: wanted, configuration, label, flags, samples, seconds, measured, arms, candidates }
    }
}

/// Indices of the points on the front: no other point is at least as good in time and error and better in one. The
/// fastest first.
pub fn front(points: &[Option<(f64, f64)>]) -> Vec<usize> {
    let known: Vec<(usize, (f64, f64))> = points.iter().enumerate().filter_map(|(i, p)| Some((i, (*p)?))).collect();
    let beaten = |(time, error): (f64, f64)| {
        known.iter().any(|(_, (t, e))| *t <= time && *e <= error && (*t < time || *e < error))
    };
    let mut front: Vec<(usize, (f64, f64))> = known.iter().copied().filter(|(_, point)| !beaten(*point)).collect();
    front.sort_by(|a, b| a.1.0.total_cmp(&b.1.0));
    front.into_iter().map(|(i, _)| i).collect()
}

impl PointReport {
    fn judge(
        &self,
        base: &Self,
        held: &Held,
        bootstrap: &Bootstrap,
        (factor, level, base_level): (&'static str, &str, &str),
    ) -> Option<KnobReport> {
        let common = self.series.from_base.len();
        let ratios: Vec<f64> =
            self.times().iter().zip(base.times()).take(common).map(|(own, base)| own / base).collect();
        let time_ratio = Estimate::of_median(&ratios);
        let identical = (0..common).all(|k| self.series.from_base.square(k) == 0.0);
        let cost = |weights: &[f64]| {
            let variances = self.series.relative.variance(weights) / base.series.relative.variance(weights);
            weighted_median(&ratios, weights) * variances
        };
        let bias = Decomposition::of(&self.series.from_base, 0.0, 0.0, bootstrap)?;
        let cost_ratio = if identical { time_ratio } else { by_renders(common, bootstrap, cost) };
        let shift = |(own, base): (&PointRun, &PointRun)| (own.mean_error - base.mean_error) / held.mean;
        let shifts: Vec<f64> = self.runs.iter().zip(&base.runs).map(shift).collect();
        let mean_shift = bootstrap.estimate(&shifts, crate::stats::mean);
        let mut knob = KnobReport {
            factor,
            level: level.to_owned(),
            base_level: base_level.to_owned(),
            time_ratio,
            cost_ratio,
            bias_squared: bias.bias_squared,
            mean_shift,
            identical,
            worth: Worth::Even,
            equal_error_ratio: None,
            pays_above: None,
        };
        let (less, more) = (knob.cost_ratio.surely_below(1.0), knob.cost_ratio.surely_above(1.0));
        knob.worth = match knob.biased() {
            _ if knob.cost_ratio.interval.is_none() => Worth::TooFewRounds,
            true if less => Worth::Trade,
            true if knob.cost_ratio.value >= 1.0 => Worth::Never,
            _ if more => Worth::Never,
            false if less => Worth::Free,
            _ => Worth::Even,
        };
        let pays_above = knob.bias_squared.value / (1.0 - knob.cost_ratio.value);
        knob.pays_above = (knob.worth == Worth::Trade).then_some(pays_above);
        knob.equal_error_ratio = base.rel_mse.and_then(|error| knob.time_to(error.total.value));
        Some(knob)
    }
}
