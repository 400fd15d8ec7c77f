//! How a study runs: first renders, the gate, then rounds in random order.

use std::ops::ControlFlow;
use std::sync::Arc;

use serde::Serialize;

use super::analysis::{Clock, CombinationReport, Report, Run, SceneReport};
use super::measurement::{Measurement, Purpose, Renderer};
use super::noise::shuffle;
use super::validity::{Verdict, judge};
use super::{Configuration, Design, StudyError};
use crate::stats::SplitMix64;
use raywave::image::Image;

/// Results are analysed again only after 1/N more rounds, since the device waits for the analysis.
const ROUNDS_PER_ANALYSIS: usize = 8;

/// How often everything is repeated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rounds {
    /// Minimum number of rounds, at least 1. A 95 % interval of a median needs six.
    pub min: usize,
    /// Maximum number of rounds.
    pub max: usize,
    /// Stop between the two as soon as every interval is narrower than this share of its value.
    ///
    /// An interval that ended the study by being narrow is a little too narrow on average, since the study waited for
    /// it.
    pub until: Option<f64>,
}

/// A study: what to vary, over which scenes, how often.
#[derive(Debug, Clone)]
pub struct Study {
    /// What is varied.
    pub design: Design,
    /// Scenes, one after the other.
    pub scenes: Vec<String>,
    /// How often.
    pub rounds: Rounds,
    /// The clock that is compared.
    pub clock: Clock,
    /// Seed of the order of the rounds.
    pub seed: u64,
    /// Whether each combination is rendered once more with kernels that count.
    pub counting: bool,
}

/// What happens in a study, as it happens.
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs, reason = "the fields say it")]
pub enum Event<'a> {
    /// A scene is open; its first renders follow.
    Opened { report: &'a SceneReport },
    /// A render begins. `round` counts from 0; the first render and the counting one have none.
    Rendering { scene: &'a str, label: &'a str, purpose: Purpose, round: Option<usize> },
    /// A render has ended.
    Rendered { scene: &'a str, label: &'a str, purpose: Purpose, measurement: &'a Measurement },
    /// The gate has judged an image.
    Judged { scene: &'a str, label: &'a str, verdict: &'a Verdict },
    /// The report has changed: worth writing down, in case there is no next one. At first after every round, then after
    /// every eighth more.
    Updated { report: &'a Report },
}

/// Receives events and says whether to go on.
pub type Listener<'a> = dyn FnMut(Event<'_>) -> ControlFlow<()> + 'a;

impl Study {
    /// Runs the study. When `listen` breaks, the study ends there, and the report holds the results so far.
    ///
    /// # Errors
    /// A scene that does not open, or a baseline that cannot be rendered. The latest [`Event::Updated`] had the results
    /// so far.
    pub fn run(&self, renderer: &mut dyn Renderer, listen: &mut Listener<'_>) -> Result<Report, StudyError> {
        let mut report = Report::new(self);
        let mut random = SplitMix64::new(self.seed);
        for scene in &self.scenes {
            if self.run_scene(scene, renderer, &mut random, &mut report, listen)?.is_break() {
                return Ok(report);
            }
        }
        report.complete = true;
        let _ = listen(Event::Updated { report: &report });
        Ok(report)
    }

    fn run_scene(
        &self,
        scene: &str,
        renderer: &mut dyn Renderer,
        random: &mut SplitMix64,
        report: &mut Report,
        listen: &mut Listener<'_>,
    ) -> Result<ControlFlow<()>, StudyError> {
        let facts = renderer.open(scene).map_err(|cause| StudyError::Scene { scene: scene.to_owned(), cause })?;
        report.scenes.push(SceneReport::new(self, facts));
        let index = report.scenes.len() - 1;
        let mut progress = listen(Event::Opened { report: &report.scenes[index] });

        // Baselines come first: the others are compared with their images.
        let (baselines, others): (Vec<usize>, Vec<usize>) =
            (0..report.scenes[index].combinations.len()).partition(|&i| report.scenes[index].is_baseline(i));
        for i in baselines.into_iter().chain(others) {
            if progress.is_continue() {
                progress = self.first_render(i, renderer, &mut report.scenes[index], listen)?;
            }
            if progress.is_continue() {
                progress = listen(Event::Updated { report });
            }
        }

        let (mut round, mut analysed) = (0, 0_usize);
        while progress.is_continue() && self.wants_round(round, &report.scenes[index]) {
            progress = self.round(round, renderer, random, &mut report.scenes[index], listen)?;
            round += 1;
            let last = progress.is_break() || !self.wants_round(round, &report.scenes[index]);
            if last || round >= analysed + analysed.div_ceil(ROUNDS_PER_ANALYSIS) {
                report.scenes[index].analyse(self);
                analysed = round;
                let heard = listen(Event::Updated { report });
                if heard.is_break() {
                    progress = heard;
                }
            }
        }
        Ok(progress)
    }

    /// Renders a combination for the first time, judges its image, and counts its work.
    fn first_render(
        &self,
        i: usize,
        renderer: &mut dyn Renderer,
        scene: &mut SceneReport,
        listen: &mut Listener<'_>,
    ) -> Result<ControlFlow<()>, StudyError> {
        let configuration = scene.combinations[i].configuration.clone();
        let base = self.design.baseline_of(&configuration);
        let (name, label) = (scene.facts.scene.clone(), scene.combinations[i].label.clone());
        let mut render = |purpose, listen: &mut Listener<'_>| {
            let mut heard = listen(Event::Rendering { scene: &name, label: &label, purpose, round: None });
            let rendered = renderer.run(&configuration, purpose);
            if let Ok(measurement) = &rendered {
                let after = listen(Event::Rendered { scene: &name, label: &label, purpose, measurement });
                heard = if heard.is_break() { heard } else { after };
            }
            (rendered, heard)
        };

        let (rendered, mut progress) = render(Purpose::First, listen);
        match rendered {
            Err(cause) => self.failed(i, scene, &cause.to_string())?,
            Ok(mut first) => {
                let image = first.image.take().map(Arc::new);
                scene.combinations[i].first = Some(first);
                let base = scene.find(&base);
                let verdict = match (&image, base) {
                    (None, _) => Verdict::Wrong { reason: "the renderer made no image".to_owned(), comparison: None },
                    (Some(_), base) if base == i => Verdict::Baseline,
                    (Some(image), base) => match &scene.combinations[base].image {
                        Some(baseline) => judge(self.design.contract(&configuration), image, baseline),
                        None => Verdict::Wrong { reason: "its baseline has no image".to_owned(), comparison: None },
                    },
                };
                scene.combinations[i].image = match verdict {
                    // One copy of equal images is enough.
                    Verdict::Identical => scene.combinations[base].image.clone(),
                    _ => image,
                };
                scene.combinations[i].verdict = verdict;
            }
        }
        if self.counting && progress.is_continue() && scene.combinations[i].verdict.counts() {
            let (counted, heard) = render(Purpose::Counting, listen);
            progress = heard;
            match counted {
                Err(cause) => self.failed(i, scene, &cause.to_string())?,
                Ok(mut counted) => {
                    let image = counted.image.take();
                    scene.combinations[i].counters = counted.counters;
                    recheck(&mut scene.combinations[i], image, "its image differs when its work is counted");
                }
            }
        }
        let heard = listen(Event::Judged { scene: &name, label: &label, verdict: &scene.combinations[i].verdict });
        Ok(if progress.is_break() { progress } else { heard })
    }

    /// Renders every combination that counts once, in a new random order.
    fn round(
        &self,
        round: usize,
        renderer: &mut dyn Renderer,
        random: &mut SplitMix64,
        scene: &mut SceneReport,
        listen: &mut Listener<'_>,
    ) -> Result<ControlFlow<()>, StudyError> {
        let mut order: Vec<usize> =
            (0..scene.combinations.len()).filter(|&i| scene.combinations[i].verdict.counts()).collect();
        shuffle(&mut order, random);
        let name = scene.facts.scene.clone();
        let purpose = Purpose::Timed;
        for (position, i) in order.into_iter().enumerate() {
            let combination = &mut scene.combinations[i];
            let label = combination.label.clone();
            if listen(Event::Rendering { scene: &name, label: &label, purpose, round: Some(round) }).is_break() {
                return Ok(ControlFlow::Break(()));
            }
            match renderer.run(&combination.configuration, purpose) {
                Err(cause) => self.failed(i, scene, &cause.to_string())?,
                Ok(mut measurement) => {
                    let image = measurement.image.take();
                    recheck(combination, image, "its image differs from one run to the next");
                    let heard =
                        listen(Event::Rendered { scene: &name, label: &label, purpose, measurement: &measurement });
                    combination.runs.push(Run { round, position, measurement });
                    if heard.is_break() {
                        return Ok(ControlFlow::Break(()));
                    }
                }
            }
        }
        Ok(ControlFlow::Continue(()))
    }

    fn wants_round(&self, done: usize, scene: &SceneReport) -> bool {
        if !scene.combinations.iter().any(|combination| combination.verdict.counts()) {
            return false;
        }
        let Rounds { min, max, until } = self.rounds;
        done < min || (done < max && until.is_some_and(|share| scene.widest_interval() > share))
    }

    /// Notes that a combination cannot be rendered.
    fn failed(&self, i: usize, scene: &mut SceneReport, cause: &str) -> Result<(), StudyError> {
        if scene.is_baseline(i) {
            let configuration: &Configuration = &scene.combinations[i].configuration;
            return Err(StudyError::Baseline {
                scene: scene.facts.scene.clone(),
                configuration: configuration.to_string(),
                cause: cause.to_owned(),
            });
        }
        scene.combinations[i].verdict = Verdict::Failed { reason: cause.to_owned() };
        Ok(())
    }
}

/// Compares a later image of a combination with its first one, to the last bit: a rerun changes nothing that any
/// contract leaves open.
fn recheck(combination: &mut CombinationReport, image: Option<Image>, reason: &str) {
    let (Some(image), Some(first)) = (image, &combination.image) else { return };
    if let Verdict::Wrong { comparison, .. } = judge(super::Contract::Bits, &image, first) {
        combination.verdict = Verdict::Wrong { reason: reason.to_owned(), comparison };
    }
}
