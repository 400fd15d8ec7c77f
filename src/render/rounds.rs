//! Renders that go over the whole image in rounds, each with more samples, until their error is known to be small.

use std::ops::ControlFlow;

use super::error::RenderError;
use super::kept::Kept;
use super::session::{Ending, Progress, Session};
use super::statistics::Statistics;
use crate::settings::SECOND_HALF;

/// Samples of a pixel in the first round: in two halves of four, which are of equal rows.
const FIRST: u32 = 8;
/// Orders of convergence that are believed: 1 is that of independent samples, and 2 more than any scene has kept up.
const ORDERS: (f64, f64) = (0.7, 2.0);

impl Session {
    /// As [`Session::go_on`], in rounds over the whole image, so that all pixels have about equal samples whenever it ends.
    /// With `target`, and settings that take samples in halves, it ends after the round that brings the relMSE, by the
    /// difference of the halves, down to that. Returns the last relMSE too.
    ///
    /// # Errors
    /// When the device fails.
    pub fn go_on_by_rounds(
        &mut self,
        kept: &mut Kept,
        target: Option<f64>,
        mut progress: impl FnMut(&Progress<'_>) -> ControlFlow<Ending>,
    ) -> Result<(Statistics, Option<f64>), RenderError> {
        // Halves are equal where their sum is even.
        let most = if self.settings.halves { self.settings.samples.max(2) & !1 } else { self.settings.samples };
        let begun = kept.film().map_or(0, |film| film.most_samples().min(most.into()) as u32);
        let mut samples = FIRST.max(begun).next_multiple_of(2).min(most);
        let mut before: Option<(u32, f64)> = None;
        loop {
            self.take_samples(samples);
            let error = before.map(|(_, error)| error);
            // What independent samples would take, at most all.
            let total = |of_round: &Progress<'_>| match (error, target) {
                (Some(error), Some(target)) => {
                    let all = of_round.samples_total / u64::from(samples) * u64::from(most);
                    let before = before.map_or(samples, |(samples, _)| samples);
                    let of_pixel = f64::from(before) * error / target;
                    let needed = of_round.samples_total as f64 / f64::from(samples) * of_pixel;
                    (needed as u64).clamp(of_round.samples_total, all.max(of_round.samples_total))
                }
                _ => of_round.samples_total,
            };
            let mut ended = false;
            let statistics = self.go_on(kept, |of_round| {
                let flow = progress(&Progress { error, samples_total: total(of_round), ..*of_round });
                ended = flow.is_break();
                flow
            })?;
            let error = kept.film().and_then(|film| film.error_by_halves(SECOND_HALF));
            let is_reached = error.zip(target).is_some_and(|(error, target)| error <= target);
            if ended || is_reached || samples == most {
                return Ok((statistics, error));
            }
            let next = match (error, target) {
                (Some(error), Some(target)) => {
                    let order = before.map_or(ORDERS.0, |(fewer, larger)| {
                        (larger / error).ln() / (f64::from(samples) / f64::from(fewer)).ln()
                    });
                    let needed = f64::from(samples) * (error / target).powf(order.clamp(ORDERS.0, ORDERS.1).recip());
                    // Not a hair more, but neither hardly more than there are.
                    needed.clamp(1.125 * f64::from(samples), 2.0 * f64::from(samples)).ceil() as u32
                }
                _ => 2 * samples,
            };
            before = error.map(|error| (samples, error));
            samples = next.next_multiple_of(2).min(most);
        }
    }
}
