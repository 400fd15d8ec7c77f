//! Alias tables: sampling a discrete distribution in constant time. (Walker 1974; Vose 1991)

/// Cell of an alias table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AliasCell {
    /// Probability that the cell yields itself, in [0, 1].
    pub threshold: f32,
    /// The outcome that it yields otherwise.
    pub alias: u32,
}

/// Builds the table for weights, each at least 0 and finite, with a sum above 0.
///
/// A sample chooses cell `i` uniformly and yields `i` with probability `threshold`, else `alias`.
pub fn alias_table(weights: &[f64]) -> Vec<AliasCell> {
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    let mut share: Vec<f64> = weights.iter().map(|weight| weight / mean).collect();
    let mut cells: Vec<AliasCell> = (0..weights.len() as u32).map(|i| AliasCell { threshold: 1.0, alias: i }).collect();
    let (mut poor, mut rich): (Vec<usize>, Vec<usize>) = (0..weights.len()).partition(|&i| share[i] < 1.0);
    while let (Some(&giver), Some(taker)) = (rich.last(), poor.pop()) {
        cells[taker] = AliasCell { threshold: share[taker] as f32, alias: giver as u32 };
        share[giver] -= 1.0 - share[taker];
        if share[giver] < 1.0 {
            rich.pop();
            poor.push(giver);
        }
    }
    // Rounding leaves some cells slightly poor with no rich cell left. They represent themselves, except that a weight
    // of 0 must never be chosen.
    for cell in poor {
        if weights[cell] == 0.0 {
            let heaviest = (0..weights.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b])).unwrap_or(cell);
            cells[cell] = AliasCell { threshold: 0.0, alias: heaviest as u32 };
        }
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Probability of each outcome, read back from the cells.
    fn probabilities(cells: &[AliasCell]) -> Vec<f64> {
        let mut p = vec![0.0; cells.len()];
        for (i, cell) in cells.iter().enumerate() {
            p[i] += f64::from(cell.threshold);
            p[cell.alias as usize] += 1.0 - f64::from(cell.threshold);
        }
        p.iter().map(|p| p / cells.len() as f64).collect()
    }

    proptest! {
        #[test]
        fn cells_give_back_the_weights(weights in prop::collection::vec(prop_oneof![Just(0.0), 1e-6..1e6_f64], 1..200)) {
            let total: f64 = weights.iter().sum();
            prop_assume!(total > 0.0);
            for (p, weight) in probabilities(&alias_table(&weights)).iter().zip(&weights) {
                prop_assert!((p - weight / total).abs() < 1e-6);
                prop_assert!(*weight > 0.0 || *p == 0.0);
            }
        }
    }
}
