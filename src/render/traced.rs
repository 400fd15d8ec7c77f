//! What a trace shows of a render: its batches by their submissions, with the queues of their bounces.

use std::collections::VecDeque;
use std::mem::take;

use crate::gpu::{Alignment, TracedSubmission};
use crate::layout::RayCount;

/// What the device did in a session, on the host's clock.
#[derive(Debug, Clone)]
pub struct DeviceTrace {
    /// How its times were brought to that clock.
    pub alignment: Alignment,
    /// Batches in order.
    pub batches: Vec<TracedBatch>,
}

/// A batch, or a launch of the megakernel.
#[derive(Debug, Clone)]
pub struct TracedBatch {
    /// What it was for.
    pub purpose: Purpose,
    /// Its submissions in order. Their counts are in `queues`.
    pub submissions: Vec<TracedSubmission>,
    /// Queues by bounce, up to the last that had a ray; the last of `COUNTED_BOUNCES` has those of all that follow. Empty
    /// for the megakernel, which keeps none.
    pub queues: Vec<QueueLengths>,
}

/// What a batch is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// To measure how long paths take; its samples are thrown away.
    Sampling,
    /// For the film.
    Render,
}

/// Rays that waited at a bounce.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct QueueLengths {
    /// To the next surface: paths that were alive.
    pub rays: u64,
    /// To a light, from the surfaces that were found.
    pub shadow_rays: u64,
}

impl DeviceTrace {
    /// Passes that there was no room for.
    pub fn dropped_passes(&self) -> usize {
        self.batches.iter().flat_map(|batch| &batch.submissions).map(|submission| submission.dropped).sum()
    }
}

/// Puts submissions together to batches.
#[derive(Debug)]
pub(super) struct Gathering {
    has_queues: bool,
    purpose: Purpose,
    /// Of the submissions that have not been seen to end: whether each ends a batch.
    ends: VecDeque<bool>,
    under_way: Vec<TracedSubmission>,
    /// Rays that the device had counted before the batch under way.
    counted: Vec<QueueLengths>,
    batches: Vec<TracedBatch>,
}

impl Gathering {
    /// Of batches that leave queues to count or, by the megakernel, none.
    pub fn new(has_queues: bool) -> Self {
        Self {
            has_queues,
            purpose: Purpose::Sampling,
            ends: VecDeque::new(),
            under_way: Vec::new(),
            counted: Vec::new(),
            batches: Vec::new(),
        }
    }

    /// What follows is for the film, and the device's counts begin anew.
    pub fn begin_render(&mut self) {
        self.purpose = Purpose::Render;
        self.counted.clear();
    }

    /// A submission was made.
    pub fn expect(&mut self, ends_batch: bool) {
        self.ends.push_back(ends_batch);
    }

    /// Submissions ended, in the order in which they were made.
    pub fn add(&mut self, submissions: Vec<TracedSubmission>) {
        for mut submission in submissions {
            let counts = take(&mut submission.counts);
            self.under_way.push(submission);
            if self.ends.pop_front() == Some(true) {
                self.end_batch(&bytemuck::pod_collect_to_vec(&counts));
            }
        }
    }

    fn end_batch(&mut self, counts: &[RayCount]) {
        let counts: Vec<_> = counts.iter().map(QueueLengths::of).collect();
        self.counted.resize(counts.len(), QueueLengths::default());
        let mut queues: Vec<_> = counts.iter().zip(&self.counted).map(|(now, before)| now.since(*before)).collect();
        let used = queues.iter().rposition(|queue| *queue != QueueLengths::default()).map_or(0, |last| last + 1);
        queues.truncate(if self.has_queues { used } else { 0 });
        self.counted = counts;
        self.batches.push(TracedBatch { purpose: self.purpose, submissions: take(&mut self.under_way), queues });
    }

    /// The batches so far. One that did not come to its end, as where the device was lost, has no queues.
    pub fn batches(mut self) -> Vec<TracedBatch> {
        if !self.under_way.is_empty() {
            let (submissions, queues) = (self.under_way, Vec::new());
            self.batches.push(TracedBatch { purpose: self.purpose, submissions, queues });
        }
        self.batches
    }
}

impl QueueLengths {
    fn of(count: &RayCount) -> Self {
        Self { rays: count.rays(), shadow_rays: count.shadow_rays() }
    }

    fn since(self, before: Self) -> Self {
        Self { rays: self.rays - before.rays, shadow_rays: self.shadow_rays - before.shadow_rays }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    fn counts(rays: &[(u32, u32)]) -> Vec<RayCount> {
        rays.iter().map(|&(rays, shadow_rays)| RayCount { rays: [rays, 0], shadow_rays: [shadow_rays, 0] }).collect()
    }

    fn submission(counts: &[RayCount]) -> TracedSubmission {
        let now = Instant::now();
        let counts = bytemuck::cast_slice(counts).to_vec();
        TracedSubmission { submitted: now, seen: now, passes: Vec::new(), dropped: 3, counts }
    }

    #[test]
    fn queues_are_what_a_batch_added_to_the_counts() {
        let mut gathering = Gathering::new(true);
        gathering.expect(true);
        gathering.add(vec![submission(&counts(&[(9, 9), (0, 0), (0, 0)]))]);
        // The counts begin anew.
        gathering.begin_render();
        [false, true, true, false].into_iter().for_each(|ends| gathering.expect(ends));
        gathering.add(vec![submission(&counts(&[(8, 5), (5, 0), (0, 0)]))]);
        gathering.add(vec![
            submission(&counts(&[(8, 6), (5, 0), (2, 0)])),
            submission(&counts(&[(16, 6), (5, 0), (2, 0)])),
            submission(&counts(&[(20, 6), (5, 0), (2, 0)])),
        ]);
        let trace = DeviceTrace { alignment: Alignment::BySubmission, batches: gathering.batches() };
        let told: Vec<_> = trace.batches.iter().map(|b| (b.purpose, b.submissions.len())).collect();
        let expected = [(Purpose::Sampling, 1), (Purpose::Render, 2), (Purpose::Render, 1), (Purpose::Render, 1)];
        assert_eq!(told, expected);
        let queue = |rays, shadow_rays| QueueLengths { rays, shadow_rays };
        let queues: Vec<_> = trace.batches.into_iter().map(|batch| batch.queues).collect();
        let expected = [vec![queue(9, 9)], vec![queue(8, 6), queue(5, 0), queue(2, 0)], vec![queue(8, 0)], vec![]];
        assert_eq!(queues, expected);
    }

    #[test]
    fn passes_without_room_are_counted() {
        let mut gathering = Gathering::new(false);
        [true, true].into_iter().for_each(|ends| gathering.expect(ends));
        gathering.add(vec![submission(&counts(&[(1, 1)])), submission(&counts(&[(2, 1)]))]);
        let trace = DeviceTrace { alignment: Alignment::NoClock, batches: gathering.batches() };
        assert_eq!(trace.dropped_passes(), 6);
        assert!(trace.batches.iter().all(|batch| batch.queues.is_empty()), "the megakernel has no queues");
    }
}
