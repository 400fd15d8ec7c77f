//! Where the faster of two combinations changes as the work grows.

use serde::Serialize;

use crate::stats::{Estimate, Interval};

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
    /// Where the faster one changes, ascending; empty if one is faster throughout.
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
    /// The cost. In its interval neither is significantly faster; `None` if a cost was measured in too few rounds.
    pub cost: Estimate,
    /// Which one is faster beyond.
    pub direction: CrossingDirection,
    /// Whether one is significantly faster before the interval and the other beyond it. Otherwise the interval ends
    /// with the measured range, and there may be no crossing at all.
    pub certain: bool,
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

/// Finds where the times of two combinations cross over ascending costs, by their differences, the first's time minus
/// the second's, in every round at each cost.
///
/// Between two costs the median difference is interpolated linearly in the cost, which is right if both times are
/// linear: added work always takes the same time. The ends of its interval are interpolated too, and the crossing lies
/// where that interval contains 0.
pub fn find_crossings(costs: &[f64], differences: &[Vec<f64>]) -> Vec<Crossing> {
    let medians: Vec<Estimate> = differences.iter().map(|differences| Estimate::of_median(differences)).collect();
    let mut crossings = Vec::new();
    let mut before: Option<usize> = None;
    // If the times are equal at a measured cost, the crossing is between the costs around it.
    for i in (0..costs.len()).filter(|i| medians[*i].value != 0.0) {
        if let Some(before) = before
            && (medians[before].value < 0.0) != (medians[i].value < 0.0)
        {
            crossings.push(crossing_between(costs, &medians, before, i));
        }
        before = Some(i);
    }
    crossings
}

/// The crossing between two costs, given by their indices.
fn crossing_between(costs: &[f64], medians: &[Estimate], before: usize, after: usize) -> Crossing {
    // With a sign for which the difference rises.
    let falls = medians[after].value < 0.0;
    let sign = if falls { -1.0 } else { 1.0 };
    let value = |i: usize| (costs[i], sign * medians[i].value);
    let low = |i: usize| (costs[i], if falls { -medians[i].highest() } else { medians[i].lowest() });
    let high = |i: usize| (costs[i], if falls { -medians[i].lowest() } else { medians[i].highest() });
    let surely_before = (0..=before).rev().find(|i| high(*i).1 < 0.0);
    let surely_after = (after..costs.len()).find(|i| low(*i).1 > 0.0);
    let known = medians.iter().all(|median| median.interval.is_some());
    let interval = known.then(|| Interval {
        low: surely_before.map_or(costs[0], |i| root(high(i), high(i + 1))),
        high: surely_after.map_or(costs[costs.len() - 1], |i| root(low(i - 1), low(i))),
    });
    Crossing {
        cost: Estimate { value: root(value(before), value(after)), interval },
        direction: if falls { CrossingDirection::AFasterBeyond } else { CrossingDirection::BFasterBeyond },
        certain: known && surely_before.is_some() && surely_after.is_some(),
    }
}

/// Where the line through two points is 0.
fn root((x, y): (f64, f64), (next_x, next_y): (f64, f64)) -> f64 {
    x + y / (y - next_y) * (next_x - x)
}
