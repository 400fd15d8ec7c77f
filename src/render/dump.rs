//! A queue of rays, frozen: what a bounce would trace, read back in the scene's terms.

use rayon::prelude::*;

use super::error::RenderError;
use super::plan::{SampleRange, Taken};
use super::prepare::{PreparedScene, TriangleName};
use super::schedule::Work;
use super::session::Session;
use crate::bvh::Primitive;
use crate::constants::{NO_TRIANGLE, WORLD_INSTANCE};
use crate::gpu::GpuError;
use crate::rays::{RayClass, RayOrder, RayRecord};
use crate::recording::Recording;
use crate::settings::PathState;
use crate::shaders::buffers;

/// Rays of one queue of one batch.
#[derive(Debug, Clone)]
pub struct QueuedRays {
    /// Those that can be traced.
    pub rays: Vec<RayRecord>,
    /// Rays that are left out because a number of them is NaN or infinite, or the direction zero.
    pub left_out: u64,
    /// Pixels and samples that they belong to.
    pub batch: SampleRange,
}

/// The buffers that hold the two halves of queued rays.
pub(super) fn ray_buffers(class: RayClass) -> [&'static str; 2] {
    match class {
        RayClass::Camera | RayClass::Bounce => [buffers::RAY_ORIGINS, buffers::RAY_DIRECTIONS],
        RayClass::Shadow => [buffers::SHADOW_ORIGINS, buffers::SHADOW_DIRECTIONS],
    }
}

/// The unit vector in 48 bits, as `decode_direction` of `halves.glsl` has it but for rounding.
fn decode_direction([low, high]: [u32; 2]) -> [f32; 3] {
    // The highest of 24 bits is the sign.
    let coordinate = |bits: u32| (bits.cast_signed() >> 8) as f32 / 8_388_607.0;
    let (mut x, mut y) = (coordinate(low << 8), coordinate(((low >> 16) & 0xff00) | (high << 16)));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    x += if x >= 0.0 { -fold } else { fold };
    y += if y >= 0.0 { -fold } else { fold };
    glam::Vec3::new(x, y, z).normalize().to_array()
}

impl Session {
    /// Renders the first batch up to a bounce and reads the rays that wait there: those that would be traced after
    /// that many scattering events or, of class shadow, from the surfaces that those rays hit.
    /// `scene` is the session's own.
    ///
    /// # Errors
    /// When no such ray is there, the scheduler has no queues, or the device fails.
    pub fn dump_rays(
        &mut self,
        scene: &PreparedScene,
        class: RayClass,
        bounce: u32,
        order: RayOrder,
    ) -> Result<QueuedRays, RenderError> {
        let shadow = class == RayClass::Shadow;
        if !self.schedule.has_queues() {
            return Err(RenderError::NoQueues);
        }
        if shadow && !self.schedule.queues_shadow_rays() {
            return Err(RenderError::NoShadowQueue);
        }
        self.clear()?;
        let tile = self.plan.tiles(0).next().expect("an image has a row");
        let batch = self.plan.next_batch(tile, Taken::default(), self.settings.samples, u32::MAX, u32::MAX);
        let batch = batch.expect("a render has a sample");
        let (mut count, mut last) = (0, None);
        let schedule = self.schedule;
        let work = Work { batch, first_slot: 0, resolves: false };
        schedule.record(&mut Recording::default(), work, |frame, recorded| {
            // Shadow rays of a bounce are queued while it is shaded, the others by the bounce before.
            let Some(at) = recorded.checked_sub(shadow.into()) else { return Ok(true) };
            let (control, _) = self.run_part(frame)?;
            count = if shadow { control.current_shadow_rays } else { control.current_rays };
            if count > 0 {
                last = Some(at);
            }
            Ok::<_, GpuError>(control.current_rays > 0 && at < bounce)
        })?;
        if last != Some(bounce) {
            return Err(RenderError::NoRays { rays: if shadow { "shadow" } else { "path" }, bounce, last });
        }

        let mut places = self.places(shadow, bounce, count)?;
        if order == RayOrder::Slot {
            places = self.in_slot_order(&places);
        }
        let [origins, directions] = ray_buffers(class);
        let origins: Vec<[u32; 4]> = self.read(origins, self.plan.path_capacity)?;
        let directions: Vec<[u32; 4]> = self.read(directions, self.plan.path_capacity)?;
        let halves = !shadow && self.settings.path_state == PathState::F16;
        let has_two_levels = scene.bvh.has_two_levels();
        // Instances of what rays leave and aim at, by place.
        let instances: Vec<[u32; 2]> = match (has_two_levels, shadow) {
            (false, _) => Vec::new(),
            (true, true) => self.read(buffers::SHADOW_INSTANCES, self.plan.path_capacity)?,
            (true, false) => {
                let leaves: Vec<u32> = self.read(buffers::RAY_INSTANCES, self.plan.path_capacity)?;
                leaves.into_iter().map(|instance| [instance, NO_TRIANGLE]).collect()
            }
        };
        let name = |triangle: u32, instance: u32| match triangle {
            NO_TRIANGLE => TriangleName { instance: WORLD_INSTANCE, triangle },
            triangle => scene.name_of(Primitive { triangle, instance }),
        };
        let record = |&(_, place): &(u32, u32)| {
            let ([x, y, z, leaves], [u, v, w, target]) = (origins[place as usize], directions[place as usize]);
            let [of_leaves, of_target] = instances.get(place as usize).copied().unwrap_or([WORLD_INSTANCE; 2]);
            // Other rays keep there whether light that they find counts.
            let target = if shadow { target } else { NO_TRIANGLE };
            let [leaves, target] = [name(leaves, of_leaves), name(target, of_target)];
            RayRecord {
                origin: [x, y, z].map(f32::from_bits),
                leaves: leaves.triangle,
                direction: if halves { decode_direction([u, v]) } else { [u, v, w].map(f32::from_bits) },
                target: target.triangle,
                leaves_instance: leaves.instance,
                target_instance: target.instance,
            }
        };
        let mut rays: Vec<_> = places.par_iter().map(record).collect();
        if !rays.par_iter().all(RayRecord::is_sound) {
            rays.retain(RayRecord::is_sound);
        }
        let left_out = u64::from(count) - rays.len() as u64;
        Ok(QueuedRays { rays, left_out, batch })
    }

    /// Path slot and place in the buffers of each ray, in the order of the queue.
    fn places(&mut self, shadow: bool, bounce: u32, count: u32) -> Result<Vec<(u32, u32)>, GpuError> {
        if shadow {
            let radiances: Vec<[u32; 4]> = self.read(buffers::SHADOW_RADIANCES, count)?;
            return Ok(radiances.iter().zip(0..count).map(|([.., slot], place)| (*slot, place)).collect());
        }
        let half = (bounce & 1) * self.plan.path_capacity;
        let queue: Vec<u32> = self.read(buffers::RAY_QUEUE, half + count)?;
        Ok(queue[half as usize..].iter().map(|slot| (*slot, *slot)).collect())
    }

    /// The rays in the order of their path slots; each slot has one ray.
    fn in_slot_order(&self, places: &[(u32, u32)]) -> Vec<(u32, u32)> {
        let mut by_slot = vec![None; self.plan.path_capacity as usize];
        places.iter().for_each(|&(slot, place)| by_slot[slot as usize] = Some((slot, place)));
        by_slot.into_iter().flatten().collect()
    }
}
