//! Where the faster of two combinations changes as the work grows.

use serde::Serialize;

use super::analysis::{Clock, SceneReport};
use super::{Configuration, Design, Role};
use crate::stats::{Bootstrap, Estimate, Interval, SplitMix64, median, quantile};

/// Two combinations over a swept cost.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Crossover {
    /// The factor that was swept.
    pub factor: &'static str,
    /// The baseline's label, without the swept factor.
    pub a: String,
    /// The other's label, without the swept factor.
    pub b: String,
    /// The measured costs, ascending.
    pub points: Vec<CrossoverPoint>,
    /// Where the faster one changes, ascending; empty where one is faster throughout.
    pub crossings: Vec<Crossing>,
}

/// Both combinations at one cost.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CrossoverPoint {
    /// The level of the swept factor.
    pub cost: f64,
    /// Median time of `a`.
    pub a_seconds: Estimate,
    /// Median time of `b`.
    pub b_seconds: Estimate,
}

/// A cost at which both take the same time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Crossing {
    /// The cost. Its interval is of those resamples that cross; `None` where a list of timings has fewer
    /// than can hold the confidence.
    pub cost: Estimate,
    /// Which one is faster beyond.
    pub direction: CrossingDirection,
    /// Share of resamples that cross in this direction, in [0, 1]. Well below 1 it is not certain
    /// that there is a crossing at all. `None` where there is no interval.
    pub support: Option<f64>,
}

/// Which of two combinations is faster beyond a crossing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CrossingDirection {
    /// The first.
    AFasterBeyond,
    /// The second.
    BFasterBeyond,
}

/// Finds where the medians of two lists of timings cross over ascending costs, one list for each
/// cost.
///
/// Between two costs the difference of the medians is taken to be linear in the cost, which it is
/// where both times are: added work takes its time each time. The interval comes from resampling
/// every list by itself and looking for the crossing of the same direction that is nearest.
pub fn find_crossings(costs: &[f64], a: &[Vec<f64>], b: &[Vec<f64>], bootstrap: &Bootstrap) -> Vec<Crossing> {
    let medians = |lists: &[Vec<f64>]| lists.iter().map(|list| median(list)).collect::<Vec<f64>>();
    let mut random = SplitMix64::new(bootstrap.seed);
    let mut resampled = |lists: &[Vec<f64>]| {
        let resample = |list: &Vec<f64>| {
            let draws: Vec<f64> = (0..list.len()).map(|_| list[random.next_index(list.len())]).collect();
            median(&draws)
        };
        lists.iter().map(resample).collect::<Vec<f64>>()
    };
    let found = crossings_of(costs, &medians(a), &medians(b));
    if a.iter().chain(b).any(|list| list.len() < bootstrap.enough()) {
        let bare =
            |(cost, direction)| Crossing { cost: Estimate { value: cost, interval: None }, direction, support: None };
        return found.into_iter().map(bare).collect();
    }
    let mut nearest: Vec<Vec<f64>> = vec![Vec::new(); found.len()];
    if !found.is_empty() {
        for _ in 0..bootstrap.resamples {
            let others = crossings_of(costs, &resampled(a), &resampled(b));
            for (crossing, nearest) in found.iter().zip(&mut nearest) {
                let alike = others.iter().filter(|other| other.1 == crossing.1).map(|other| other.0);
                nearest.extend(alike.min_by(|x, y| (x - crossing.0).abs().total_cmp(&(y - crossing.0).abs())));
            }
        }
    }
    let tail = (1.0 - bootstrap.confidence) / 2.0;
    let with_interval = |((cost, direction), resamples): ((f64, CrossingDirection), Vec<f64>)| Crossing {
        cost: Estimate {
            value: cost,
            interval: Some(Interval { low: quantile(&resamples, tail), high: quantile(&resamples, 1.0 - tail) }),
        },
        direction,
        support: Some(resamples.len() as f64 / bootstrap.resamples as f64),
    };
    found.into_iter().zip(nearest).map(with_interval).collect()
}

/// Costs at which `a` and `b` take the same time.
fn crossings_of(costs: &[f64], a: &[f64], b: &[f64]) -> Vec<(f64, CrossingDirection)> {
    let mut crossings = Vec::new();
    // Where the times are equal at a measured cost, the crossing is between the costs around it.
    let differences = costs.iter().zip(a.iter().zip(b).map(|(a, b)| a - b)).filter(|(_, d)| *d != 0.0);
    let mut before: Option<(f64, f64)> = None;
    for (&cost, difference) in differences {
        if let Some((cost_before, difference_before)) = before
            && (difference_before < 0.0) != (difference < 0.0)
        {
            let share = difference_before / (difference_before - difference);
            let direction =
                if difference < 0.0 { CrossingDirection::AFasterBeyond } else { CrossingDirection::BFasterBeyond };
            crossings.push((cost_before + share * (cost - cost_before), direction));
        }
        before = Some((cost, difference));
    }
    crossings
}

/// The crossovers of a scene: for each workload that has several levels, the baseline against each
/// other combination.
pub(super) fn crossovers(scene: &SceneReport, design: &Design, clock: Clock, bootstrap: &Bootstrap) -> Vec<Crossover> {
    let swept = design.factors().iter().filter(|f| f.kind.role == Role::Workload && f.levels.len() > 1);
    swept.flat_map(|factor| sweeps(scene, design, factor.kind.name, clock, bootstrap)).collect()
}

fn sweeps(
    scene: &SceneReport,
    design: &Design,
    factor: &'static str,
    clock: Clock,
    bootstrap: &Bootstrap,
) -> Vec<Crossover> {
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
                let seconds =
                    |c: &super::CombinationReport| c.runs.iter().map(|run| run.seconds(clock)).collect::<Vec<f64>>();
                Some((point, seconds(a), seconds(b)))
            })
            .collect();
        if points.len() < 2 {
            return None;
        }
        points.sort_by(|x, y| x.0.cost.total_cmp(&y.0.cost));
        let costs: Vec<f64> = points.iter().map(|point| point.0.cost).collect();
        let (a, b): (Vec<Vec<f64>>, Vec<Vec<f64>>) =
            points.iter().map(|point| (point.1.clone(), point.2.clone())).unzip();
        Some(Crossover {
            factor,
            a: design.label_without(&design.baseline_of(configuration), factor),
            b: design.label_without(configuration, factor),
            points: points.into_iter().map(|point| point.0).collect(),
            crossings: find_crossings(&costs, &a, &b, bootstrap),
        })
    };
    lowest.into_iter().filter_map(sweep).collect()
}
