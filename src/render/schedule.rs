//! The frame function: how each scheduler takes a batch of paths from the camera to the film.
//!
//! [`Schedule::record`] is the whole of it: generate, then extend, shade and connect until no path is left, then resolve;
//! [`Schedule::read`] follows once a tile has its samples. They write down commands and run none, which is up to
//! [`super::Session`]. Shading, light sampling and traversal are the same GLSL functions whatever kernel calls them, so the
//! schedulers' images agree to the last bit.

use std::convert::Infallible;
use std::mem::offset_of;

use super::plan::{Plan, SampleRange, Tile};
use super::prepare::Needs;
use crate::layout::{Batch, Control, FilmPixel};
use crate::rays::RayClass;
use crate::recording::{Dispatch, Recording};
use crate::settings::{Packets, Scheduler, Settings, ShadowRays, Sort};
use crate::shaders::{Kernel, buffers, kernels};

/// A batch of paths, and where their radiance goes.
#[derive(Debug, Clone, Copy)]
pub struct Work {
    /// Pixels and samples.
    pub batch: SampleRange,
    /// Path slot of the batch's first path. Above 0 only for the megakernel, whose batches may share the slots that one
    /// resolve reads.
    pub first_slot: u32,
    /// Whether the frame ends with the batch's resolve. Otherwise the radiance stays in the path slots.
    pub resolves: bool,
}

/// The kernels of a render and the order in which they run.
#[derive(Debug, Clone, Copy)]
pub struct Schedule {
    scheduler: Scheduler,
    sort: Sort,
    packets: Packets,
    /// Whether vertices send shadow rays, and whether these wait in a queue for `connect`.
    casts_shadows: bool,
    queues_shadow_rays: bool,
    /// Vertices of the longest path: one after the last bounce, where it may still find emission.
    vertices: u32,
    plan: Plan,
}

/// Where `prepare_dispatch` leaves how many workgroups a launch over the rays of a queue has: a buffer, and the byte in it.
const RAYS: (&str, usize) = (buffers::CONTROL, offset_of!(Control, ray_groups));
const SHADOW_RAYS: (&str, usize) = (buffers::CONTROL, offset_of!(Control, shadow_groups));

impl Schedule {
    /// Records the passes of a batch.
    ///
    /// Where paths wait in queues, `goes_on` is called before each bounce and after the last, with the number of bounces
    /// recorded so far. It may run what `frame` holds, empty it and look at the queues; the frame ends when it returns
    /// false.
    ///
    /// # Errors
    /// Those of `goes_on`.
    pub fn record<E>(
        &self,
        frame: &mut Recording,
        work: Work,
        mut goes_on: impl FnMut(&mut Recording, u32) -> Result<bool, E>,
    ) -> Result<(), E> {
        let mut goes_on = |frame: &mut _, bounce| Ok(goes_on(frame, bounce)? && bounce < self.vertices);
        let batch = work.batch;
        match self.scheduler {
            Scheduler::Wavefront => {
                let mut bounce = 0;
                self.generate(frame, batch);
                while goes_on(frame, bounce)? {
                    let (now, next) = (batch.at_bounce(bounce), batch.at_bounce(bounce + 1));
                    frame.bounce(bounce, |frame| {
                        self.extend(frame, now);
                        self.sort(frame, now);
                        self.shade(frame, now);
                        self.prepare(frame, next);
                        self.connect(frame, now);
                    });
                    bounce += 1;
                }
            }
            Scheduler::Bounce => {
                let mut bounce = 0;
                self.generate(frame, batch);
                while goes_on(frame, bounce)? {
                    let (now, next) = (batch.at_bounce(bounce), batch.at_bounce(bounce + 1));
                    frame.bounce(bounce, |frame| {
                        self.extend_and_shade(frame, now);
                        self.prepare(frame, next);
                        self.connect(frame, now);
                    });
                    bounce += 1;
                }
            }
            Scheduler::Megakernel => self.follow_paths(frame, work),
        }
        if work.resolves {
            self.resolve(frame, batch);
        }
        Ok(())
    }

    /// The schedule of a render whose kernels have what it needs.
    pub fn new(scheduler: Scheduler, settings: &Settings, needs: &Needs, plan: &Plan) -> Self {
        let queues_shadow_rays = match settings.shadow_rays {
            ShadowRays::Deferred => scheduler != Scheduler::Megakernel,
            ShadowRays::AtOnce => scheduler == Scheduler::Wavefront,
        };
        Self {
            scheduler,
            sort: settings.sort,
            packets: settings.packets.unwrap_or_default(),
            casts_shadows: needs.shadows,
            queues_shadow_rays,
            vertices: settings.vertices(),
            plan: *plan,
        }
    }

    /// The kernels that frames run, each once.
    pub fn kernels(&self) -> Vec<&'static Kernel> {
        // Camera rays and those after a bounce may be traced by different kernels.
        let short = Self { vertices: self.vertices.min(2), ..*self };
        let one = SampleRange { first_pixel: 0, pixel_count: 1, first_sample: 0, sample_count: 1, film_pixel: 0 };
        let mut recording = Recording::default();
        let work = Work { batch: one, first_slot: 0, resolves: true };
        let Ok(()) = short.record(&mut recording, work, |_, _| Ok::<_, Infallible>(true));
        let mut all: Vec<&Kernel> = Vec::new();
        for Dispatch { kernel, .. } in recording.dispatches() {
            if all.iter().all(|other| other.name != kernel.name) {
                all.push(kernel);
            }
        }
        all
    }

    /// Vertices of the longest path.
    pub fn vertices(&self) -> u32 {
        self.vertices
    }

    /// Whether shadow rays, where there are any, wait in a queue.
    pub fn queues_shadow_rays(&self) -> bool {
        self.queues_shadow_rays
    }

    /// Whether paths wait in queues between bounces.
    pub fn has_queues(&self) -> bool {
        self.scheduler != Scheduler::Megakernel
    }

    /// Adds the radiance in the path slots to the film: that of `samples`, whose first path has slot 0.
    pub fn resolve(&self, frame: &mut Recording, samples: SampleRange) {
        // Queues are counted bounce by bounce; the megakernel's rays are added to the totals here.
        if !self.has_queues() {
            self.prepare(frame, samples.at_bounce(1));
        }
        frame.dispatch(kernels::RESOLVE, self.plan.groups(samples.pixel_count), &samples.at_bounce(0));
    }

    /// Reads the film of a tile.
    pub fn read(&self, frame: &mut Recording, tile: Tile) {
        // The last tile may have fewer rows than the buffer.
        let pixels = u64::from(tile.rows) * u64::from(self.plan.width);
        frame.download_first(buffers::FILM, pixels * size_of::<FilmPixel>() as u64);
    }

    /// Starts a path in every slot and queues its camera ray.
    fn generate(&self, frame: &mut Recording, batch: SampleRange) {
        frame.dispatch(kernels::GENERATE, self.plan.groups(batch.paths()), &batch.at_bounce(0));
        self.prepare(frame, batch.at_bounce(0));
    }

    /// Finds the closest hit of every queued ray.
    fn extend(&self, frame: &mut Recording, batch: Batch) {
        frame.dispatch_indirect(extend_kernel(self.packets, class_at(batch.bounce)), RAYS, &batch);
    }

    /// Orders the queued rays by the kind of surface that they hit, if the render sorts.
    fn sort(&self, frame: &mut Recording, batch: Batch) {
        if self.sort == Sort::Material {
            frame.dispatch_indirect(kernels::COUNT_BINS, RAYS, &batch);
            frame.dispatch(kernels::PLACE_BINS, 1, &batch);
            frame.dispatch_indirect(kernels::SORT_RAYS, RAYS, &batch);
        }
    }

    /// At every hit, adds emission, queues a shadow ray (next-event estimation), samples the BSDF and queues the next ray.
    fn shade(&self, frame: &mut Recording, batch: Batch) {
        frame.dispatch_indirect(kernels::SHADE, RAYS, &batch);
    }

    /// Extend and shade in one kernel, which keeps the hit in registers.
    fn extend_and_shade(&self, frame: &mut Recording, batch: Batch) {
        let in_packets = self.packets.has(class_at(batch.bounce));
        frame.dispatch_indirect(if in_packets { kernels::BOUNCE_PACKETS } else { kernels::BOUNCE }, RAYS, &batch);
    }

    /// Swaps the halves of the ray queue, sizes the launches over the queues and counts their rays.
    fn prepare(&self, frame: &mut Recording, batch: Batch) {
        frame.dispatch(kernels::PREPARE_DISPATCH, 1, &batch);
    }

    /// Traces the queued shadow rays, if there are any, and adds the radiance of those that are not occluded.
    fn connect(&self, frame: &mut Recording, batch: Batch) {
        if self.casts_shadows && self.queues_shadow_rays {
            frame.dispatch_indirect(connect_kernel(self.packets), SHADOW_RAYS, &batch);
        }
    }

    /// Follows every path from the camera to its end, in registers.
    fn follow_paths(&self, frame: &mut Recording, Work { batch, first_slot, .. }: Work) {
        let groups = self.plan.groups(self.plan.invocations(batch.paths()));
        frame.dispatch(kernels::MEGAKERNEL, groups, &Batch { first_slot, ..batch.at_bounce(0) });
    }
}

/// The class of the queued rays after that many bounces.
fn class_at(bounce: u32) -> RayClass {
    if bounce == 0 { RayClass::Camera } else { RayClass::Bounce }
}

/// The kernel that finds the closest hits of rays of a class.
pub fn extend_kernel(packets: Packets, class: RayClass) -> &'static Kernel {
    if packets.has(class) { kernels::EXTEND_PACKETS } else { kernels::EXTEND }
}

/// The kernel that traces shadow rays.
pub fn connect_kernel(packets: Packets) -> &'static Kernel {
    if packets.has(RayClass::Shadow) { kernels::CONNECT_PACKETS } else { kernels::CONNECT }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Workgroups;
    use crate::scene::Scene;

    const BATCH: SampleRange =
        SampleRange { first_pixel: 600, pixel_count: 100, first_sample: 4, sample_count: 3, film_pixel: 200 };
    const PLAN: Plan =
        Plan { width: 64, height: 64, tile_rows: 64, path_capacity: 512, workgroup_size: 64, paths_per_invocation: 2 };

    fn schedule(scheduler: Scheduler, settings: Settings, shadows: bool) -> Schedule {
        Schedule::new(scheduler, &settings, &Needs { shadows, ..Needs::ALL }, &PLAN)
    }

    fn settings(max_bounces: u32) -> Settings {
        Settings { max_bounces: Some(max_bounces), ..Scene::cornell_box().settings }
    }

    /// Kernels of the passes with the bounces in their push constants, and where indirect ones find their counts.
    fn record(schedule: Schedule, mut goes_on: impl FnMut(u32) -> bool) -> Vec<(&'static str, u32, Option<u64>)> {
        let mut recording = Recording::default();
        let work = Work { batch: BATCH, first_slot: 7, resolves: true };
        let Ok(()) = schedule.record(&mut recording, work, |_, bounce| Ok::<_, Infallible>(goes_on(bounce)));
        let seen = |dispatch: &Dispatch| {
            let batch: Batch = bytemuck::pod_read_unaligned(&dispatch.constants);
            let arguments = match dispatch.workgroups {
                Workgroups::Direct(_) => None,
                Workgroups::Indirect { buffer, offset } => {
                    assert_eq!((batch, dispatch.bounce), (BATCH.at_bounce(batch.bounce), Some(batch.bounce)));
                    assert_eq!(buffer, buffers::CONTROL);
                    Some(offset)
                }
            };
            (dispatch.kernel.name, batch.bounce, arguments)
        };
        recording.dispatches().map(seen).collect()
    }

    #[test]
    fn each_scheduler_has_its_stages() {
        let (rays, shadow_rays) = (Some(RAYS.1 as u64), Some(SHADOW_RAYS.1 as u64));
        let begin = [("generate", 0, None), ("prepare_dispatch", 0, None)];
        let end = [("resolve", 0, None)];
        let expected = |bounce: &dyn Fn(u32) -> Vec<_>| [&begin[..], &bounce(0), &bounce(1), &end].concat();

        let wavefront = |bounce| {
            vec![
                ("extend", bounce, rays),
                ("shade", bounce, rays),
                ("prepare_dispatch", bounce + 1, None),
                ("connect", bounce, shadow_rays),
            ]
        };
        assert_eq!(record(schedule(Scheduler::Wavefront, settings(1), true), |_| true), expected(&wavefront));
        let sorted = Settings { sort: Sort::Material, ..settings(1) };
        let sorting = |bounce| {
            let bins = [("count_bins", bounce, rays), ("place_bins", bounce, None), ("sort_rays", bounce, rays)];
            let passes = wavefront(bounce);
            [&passes[..1], &bins, &passes[1..]].concat()
        };
        assert_eq!(record(schedule(Scheduler::Wavefront, sorted, true), |_| true), expected(&sorting));

        let fused = |bounce| vec![("bounce", bounce, rays), ("prepare_dispatch", bounce + 1, None)];
        let deferred = |bounce| [fused(bounce), vec![("connect", bounce, shadow_rays)]].concat();
        let at_once = Settings { shadow_rays: ShadowRays::AtOnce, ..settings(1) };
        for (settings, shadows) in [(at_once, true), (settings(1), false)] {
            assert_eq!(record(schedule(Scheduler::Bounce, settings, shadows), |_| true), expected(&fused));
        }
        assert_eq!(record(schedule(Scheduler::Bounce, settings(1), true), |_| true), expected(&deferred));

        let followed = [("megakernel", 0, None), ("prepare_dispatch", 1, None), ("resolve", 0, None)];
        assert_eq!(record(schedule(Scheduler::Megakernel, settings(1), true), |_| unreachable!()), followed);
    }

    #[test]
    fn the_host_may_end_a_frame_before_any_bounce() {
        for (max_bounces, last, looks) in [(5, 3, vec![0, 1, 2, 3]), (1, 9, vec![0, 1, 2]), (5, 0, vec![0])] {
            let mut seen = Vec::new();
            let passes = record(schedule(Scheduler::Bounce, settings(max_bounces), true), |bounce| {
                seen.push(bounce);
                bounce < last
            });
            assert_eq!(seen, looks, "up to {max_bounces} bounces");
            let bounces = passes.iter().filter(|(kernel, ..)| *kernel == "bounce").count() as u32;
            assert_eq!(bounces, last.min(max_bounces + 1));
            assert_eq!(passes.last().map(|(kernel, ..)| *kernel), Some("resolve"));
        }
    }

    #[test]
    fn the_megakernel_fills_slots_that_one_resolve_reads() {
        let schedule = schedule(Scheduler::Megakernel, settings(1), true);
        let mut recording = Recording::default();
        let work = Work { batch: BATCH, first_slot: 7, resolves: false };
        let Ok(()) = schedule.record(&mut recording, work, |_, _| Ok::<_, Infallible>(true));
        let seen: Vec<_> = recording.dispatches().map(|pass| (pass.kernel.name, &pass.constants[..])).collect();
        let expected = Batch { first_slot: 7, ..BATCH.at_bounce(0) };
        assert_eq!(seen, [("megakernel", bytemuck::bytes_of(&expected))]);
    }

    #[test]
    fn every_kernel_of_a_long_frame_is_listed() {
        for scheduler in [Scheduler::Wavefront, Scheduler::Bounce, Scheduler::Megakernel] {
            for text in ["none", "camera", "bounce+shadow", "camera+bounce+shadow"] {
                let packets: Packets = text.parse().expect("these are classes of rays");
                let settings = Settings { packets: Some(packets), sort: Sort::Material, ..settings(9) };
                let schedule = schedule(scheduler, settings, true);
                let mut recorded: Vec<_> = record(schedule, |_| true).into_iter().map(|(kernel, ..)| kernel).collect();
                recorded.sort_unstable();
                recorded.dedup();
                let mut listed: Vec<_> = schedule.kernels().iter().map(|kernel| kernel.name).collect();
                listed.sort_unstable();
                assert_eq!(listed, recorded, "{scheduler:?} with packets {text}");
                let in_packets = recorded.iter().any(|kernel| kernel.ends_with("_packets"));
                assert_eq!(in_packets, text != "none" && scheduler != Scheduler::Megakernel);
            }
        }
    }
}
