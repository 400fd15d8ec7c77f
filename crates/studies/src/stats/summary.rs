//! Mean, variance and quantiles of a list of numbers.

/// Mean and variance of a stream of numbers in one pass, without the cancellation of raw sums.
///
/// Source: Welford, "Note on a method for calculating corrected sums of squares and products",
/// Technometrics 4 (1962); merging after Chan, Golub and LeVeque (1979).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Moments {
    count: u64,
    mean: f64,
    squares: f64,
}

impl Moments {
    /// Adds a number.
    pub fn push(&mut self, value: f64) {
        self.count += 1;
        let before = value - self.mean;
        self.mean += before / self.count as f64;
        self.squares += before * (value - self.mean);
    }

    /// The summary of `count` numbers, given the sum and the sum of squares of their differences from `shift`.
    pub(super) fn of_sums(count: u64, shift: f64, sum: f64, squares: f64) -> Self {
        if count == 0 {
            return Self::default();
        }
        let mean = sum / count as f64;
        // Rounding may leave a value just below zero.
        Self { count, mean: shift + mean, squares: (squares - sum * mean).max(0.0) }
    }

    /// Adds everything that `other` has seen.
    pub fn merge(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        let count = self.count + other.count;
        let apart = other.mean - self.mean;
        let share = other.count as f64 / count as f64;
        self.squares += other.squares + apart * apart * self.count as f64 * share;
        self.mean += apart * share;
        self.count = count;
    }

    /// How many numbers were added.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Their mean; NaN without numbers.
    pub fn mean(&self) -> f64 {
        if self.count == 0 { f64::NAN } else { self.mean }
    }

    /// The unbiased sample variance, the sum of squares over n - 1; NaN below two numbers.
    pub fn variance(&self) -> f64 {
        if self.count < 2 { f64::NAN } else { self.squares / (self.count - 1) as f64 }
    }

    /// The standard error of the mean, sqrt(variance / n); NaN below two numbers.
    pub fn standard_error(&self) -> f64 {
        (self.variance() / self.count as f64).sqrt()
    }
}

impl Extend<f64> for Moments {
    fn extend<I: IntoIterator<Item = f64>>(&mut self, values: I) {
        values.into_iter().for_each(|value| self.push(value));
    }
}

impl FromIterator<f64> for Moments {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut moments = Self::default();
        moments.extend(values);
        moments
    }
}

/// The mean; NaN without values.
pub fn mean(values: &[f64]) -> f64 {
    Moments::from_iter(values.iter().copied()).mean()
}

/// The unbiased sample variance; NaN below two values.
pub fn variance(values: &[f64]) -> f64 {
    Moments::from_iter(values.iter().copied()).variance()
}

/// The standard error of the mean of independent values; NaN below two.
pub fn standard_error(values: &[f64]) -> f64 {
    Moments::from_iter(values.iter().copied()).standard_error()
}

/// The middle value, or the mean of the two middle ones; NaN without values.
pub fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// The value below which the share `q` in [0, 1] lies, interpolated linearly between neighbours; NaN without values, or
/// if a NaN is among them.
///
/// Source: definition 7 of Hyndman and Fan, "Sample quantiles in statistical packages", The
/// American Statistician 50 (1996), the default of R and NumPy.
///
/// # Panics
///
/// When `q` is outside [0, 1].
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    quantile_of_sorted(&sorted, q)
}

/// [`quantile`] of values that are in ascending order.
pub(super) fn quantile_of_sorted(sorted: &[f64], q: f64) -> f64 {
    assert!((0.0..=1.0).contains(&q), "a quantile is in [0, 1], not {q}");
    // NaN sorts to the ends, by its sign.
    let (Some(first), Some(last)) = (sorted.first(), sorted.last()) else {
        return f64::NAN;
    };
    if first.is_nan() || last.is_nan() {
        return f64::NAN;
    }
    let rank = q * (sorted.len() - 1) as f64;
    let below = sorted[rank.floor() as usize];
    let above = sorted[rank.ceil() as usize];
    // Equal neighbours are returned as they are, infinite ones included.
    if below == above { below } else { below + (above - below) * rank.fract() }
}
