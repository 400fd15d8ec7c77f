//! What an executor has measured: how long its kernels took, how long the device was idle, and the spans of a trace.

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use super::clock::{Alignment, Clock};
use super::device::Shared;
use super::error::GpuError;

/// Time and launches of a kernel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct KernelTime {
    /// Seconds between the end of the command before and the end of this one, summed.
    pub seconds: f64,
    /// Dispatches.
    pub launches: u64,
}

/// How long the device had no recording, by its own clock; `None` where it has none, or there was nothing before.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Idle {
    /// Seconds before the first recording, since the last one of any executor of the device.
    pub before: Option<f64>,
    /// Seconds between the recordings, summed.
    pub between: Option<f64>,
}

/// What the device did of one submission, on the host's clock.
#[derive(Debug, Clone)]
pub struct TracedSubmission {
    /// When the host handed it over.
    pub submitted: Instant,
    /// When the host saw that it had ended.
    pub seen: Instant,
    /// Its passes in order; none where the device has no clock, or there was no more room.
    pub passes: Vec<TracedPass>,
    /// Passes that there was no more room for.
    pub dropped: usize,
    /// What the buffer of [`super::Executor::keep_trace`] held at its end.
    pub counts: Vec<u8>,
}

/// A pass, which is the launch of a kernel, on the host's clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TracedPass {
    /// Name of its kernel.
    pub kernel: &'static str,
    /// The bounce that it is a part of.
    pub of_bounce: Option<u32>,
    /// When the command before it ended, or what the submission had to wait for.
    pub start: Instant,
    /// When it ended.
    pub end: Instant,
}

/// Timestamps of a submission that come before those of its steps: its very start, and the end of the barrier that opens
/// it. Each step has one at its end, and the last one is the submission's very end.
pub(super) const FIRST_STEP: usize = 2;

/// The launch that a step of a submission was; `None` for a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Launched {
    pub kernel: &'static str,
    /// The bounce that it is a part of.
    pub bounce: Option<u32>,
}

/// What has been measured so far.
pub(super) struct Times {
    /// By kernel and bounce.
    pub kernels: BTreeMap<(&'static str, u32), KernelTime>,
    /// Inside command buffers of recordings, from end to end.
    pub seconds: f64,
    pub idle: Idle,
    /// Of each submission that has been waited for and not been asked for.
    pub submission_seconds: Vec<f64>,
    /// Seconds of every launch, where they are kept.
    pub launches: Option<Vec<f64>>,
    /// What is kept for a trace, if anything is.
    pub tracing: Option<Tracing>,
    /// When the host saw the last submission end.
    pub last_end: Instant,
}

/// What is kept for a trace.
pub(super) struct Tracing {
    /// The buffer whose contents are kept after each submission.
    pub counts: &'static str,
    /// Passes that there is room for.
    room: usize,
    clock: Clock,
    /// End of the last pass.
    until: Option<Instant>,
    submissions: Vec<TracedSubmission>,
}

impl Tracing {
    /// Keeps up to `most_passes` passes, and what the buffer `counts` holds.
    pub fn new(counts: &'static str, most_passes: usize, clock: Clock) -> Self {
        Self { counts, room: most_passes, clock, until: None, submissions: Vec::new() }
    }

    /// How times are brought to the host's clock.
    pub fn alignment(&self) -> Alignment {
        self.clock.alignment()
    }

    /// What has been kept since the last call.
    pub fn take(&mut self) -> Vec<TracedSubmission> {
        std::mem::take(&mut self.submissions)
    }
}

impl Times {
    pub fn new() -> Self {
        Self {
            kernels: BTreeMap::new(),
            seconds: 0.0,
            idle: Idle::default(),
            submission_seconds: Vec::new(),
            launches: None,
            tracing: None,
            last_end: Instant::now(),
        }
    }

    /// Starts the times and launches anew.
    pub fn forget(&mut self) {
        self.kernels.clear();
        self.seconds = 0.0;
        self.idle = Idle::default();
    }

    /// Notes a submission with launches that took `host_seconds` by the host's clock. `ticks` are its timestamps, none
    /// where the device has no clock; `steps` are what it did.
    pub fn note(&mut self, device: &Shared, steps: &[Option<Launched>], ticks: &[u64], host_seconds: f64) {
        let launched = |step: &Option<Launched>| step.map(|launched| (launched.kernel, launched.bounce.unwrap_or(0)));
        let [first, opened, .., last] = ticks else {
            self.submission_seconds.push(host_seconds);
            for pass in steps.iter().filter_map(launched) {
                self.kernels.entry(pass).or_default().launches += 1;
            }
            return;
        };
        let mask = u64::MAX >> (64 - device.description.timestamp_bits.clamp(1, 64));
        let seconds_per_tick = f64::from(device.description.timestamp_period) * 1e-9;
        let seconds = |from: u64, to: u64| (to.wrapping_sub(from) & mask) as f64 * seconds_per_tick;
        self.seconds += seconds(*first, *last);
        // From the end of the opening barrier on: before it the submission may wait for the one before.
        self.submission_seconds.push(seconds(*opened, *last));
        let before = device.last_end.swap(*last, Ordering::Relaxed);
        // A recording may begin while the one before it ends.
        let overlaps = first.wrapping_sub(before) & mask > mask / 2;
        self.idle.note((before != 0).then(|| if overlaps { 0.0 } else { seconds(before, *first) }));
        for (step, pair) in steps.iter().zip(ticks[FIRST_STEP - 1..].windows(2)) {
            let Some(pass) = launched(step) else { continue };
            let time = self.kernels.entry(pass).or_default();
            time.seconds += seconds(pair[0], pair[1]);
            time.launches += 1;
            if let Some(launches) = &mut self.launches {
                launches.push(seconds(pair[0], pair[1]));
            }
        }
    }

    /// Keeps what a trace shows of a submission that has just ended: `steps` and `ticks` as in [`Times::note`], `counts`
    /// what the buffer of the trace held.
    pub fn trace(
        &mut self,
        steps: &[Option<Launched>],
        ticks: &[u64],
        submitted: Instant,
        counts: Vec<u8>,
    ) -> Result<(), GpuError> {
        let Some(tracing) = &mut self.tracing else { return Ok(()) };
        let launches = steps.iter().flatten().count();
        let mut passes = Vec::new();
        if let (Some(&first), true) = (ticks.first(), launches <= tracing.room) {
            tracing.clock.align(first, submitted)?;
            let times: Vec<_> = ticks[FIRST_STEP - 1..].iter().map(|&ticks| tracing.clock.time(ticks)).collect();
            let spans = spans_after(tracing.until, &times[..=steps.len()]);
            let traced = |(step, [start, end]): (&Option<Launched>, [Instant; 2])| {
                step.map(|Launched { kernel, bounce }| TracedPass { kernel, of_bounce: bounce, start, end })
            };
            tracing.until = spans.last().map(|[_, end]| *end);
            passes = steps.iter().zip(spans).filter_map(traced).collect();
            tracing.room -= passes.len();
        }
        let dropped = if ticks.is_empty() { 0 } else { launches - passes.len() };
        if dropped > 0 {
            // Nothing after a gap: what follows would look as if it were all.
            tracing.room = 0;
        }
        tracing.submissions.push(TracedSubmission { submitted, seen: self.last_end, passes, dropped, counts });
        Ok(())
    }
}

impl Idle {
    /// Notes the time before a recording; `None` before the device's first.
    fn note(&mut self, seconds: Option<f64>) {
        match self.between {
            None => (self.before, self.between) = (seconds, Some(0.0)),
            Some(between) => self.between = Some(between + seconds.unwrap_or(0.0)),
        }
    }
}

/// From each time to the next one, all of it moved so that it begins no earlier than `until`: clocks that are read anew
/// for each submission move it by as much as they may be apart, and passes do not overlap for that.
fn spans_after(until: Option<Instant>, times: &[Instant]) -> Vec<[Instant; 2]> {
    let late = until.map_or(Duration::ZERO, |until| until.saturating_duration_since(times[0]));
    times.windows(2).map(|pair| [pair[0] + late, pair[1].max(pair[0]) + late]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn submissions_do_not_overlap_for_what_clocks_are_apart() {
        let start = Instant::now();
        let at = |nanoseconds| start + Duration::from_nanos(nanoseconds);
        let times = [100, 130, 130, 170].map(at);
        let spans = |from: [u64; 4]| from.windows(2).map(|pair| [at(pair[0]), at(pair[1])]).collect::<Vec<_>>();
        assert_eq!(spans_after(None, &times), spans([100, 130, 130, 170]));
        assert_eq!(spans_after(Some(at(90)), &times), spans([100, 130, 130, 170]), "a gap stays one");
        assert_eq!(spans_after(Some(at(105)), &times), spans([105, 135, 135, 175]), "it is moved as a whole");
        assert!(spans_after(Some(at(105)), &times[..1]).is_empty());
    }
}
