//! What a render takes where its settings leave a choice open: the one home of such choices.
//!
//! They follow a tuning, where there is one, then what the device is, and on software what was measured of it
//! ([`crate::facts`]); never a driver's name or version. [`Defaults::of`] asks a device; [`Defaults::choose`] is
//! arithmetic and is tested without one.

use serde::{Deserialize, Serialize};

use super::plan::SceneLevels;
use crate::bvh::{BvhKind, MAX_LISTED, MAX_TRIANGLES};
use crate::facts::{self, Facts};
use crate::gpu::{Device, GpuError};
use crate::scene::Scene;
use crate::settings::{Fetch, Instances, Packets, Scheduler, Settings, ShadowRays, Sort};
use crate::shaders::{Access, Form, Forms};

/// What the defaults of a device hang on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Defaults {
    /// Whether it is software: few threads, small caches.
    pub software: bool,
    /// Lanes of a subgroup.
    pub lanes: u32,
    /// How its kernels read a scene faster.
    pub fetch: Fetch,
    /// What portable quotients and roots are made of.
    pub forms: Forms,
    /// Turns after which an invocation leaves its loops, whatever they are for; `None` where it does not.
    pub loop_turns: Option<u32>,
    /// Bytes of the heap that buffers lie in.
    pub memory_bytes: u64,
    /// What a tuning found fastest on the device for scenes of the size, if there is one.
    pub tuned: Option<Tuned>,
}

/// What a tuning chooses. It stands in for what settings leave open.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tuned {
    /// Shape of the BVH.
    pub bvh: BvhKind,
    /// How kernels read the scene's buffers.
    pub fetch: Fetch,
    /// Invocations of a workgroup, of the wavefront's kernels only: they were measured.
    pub workgroup_size: u32,
    /// Classes of rays that are traced in packets.
    pub packets: Packets,
}

/// How a render is done: what its settings asked for and, where they left it open, what was chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Choices {
    /// How the work is cut into kernels.
    pub scheduler: Scheduler,
    /// Shape of the BVH.
    pub bvh: BvhKind,
    /// How meshes lie in memory that are placed more than once.
    pub instances: Instances,
    /// How kernels read the scene's buffers.
    pub fetch: Fetch,
    /// Classes of rays that are traced in packets.
    pub packets: Packets,
    /// Invocations of a workgroup.
    pub workgroup_size: u32,
    /// Whether a tuning chose some of it.
    pub tuned: bool,
}

impl Choices {
    /// The settings with these choices made.
    pub fn settle(&self, settings: &Settings) -> Settings {
        Settings {
            scheduler: Some(self.scheduler),
            bvh: Some(self.bvh),
            instances: Some(self.instances),
            fetch: Some(self.fetch),
            packets: Some(self.packets),
            workgroup_size: Some(self.workgroup_size),
            ..*settings
        }
    }
}

/// How rays are traced: what a tuning chooses. Whatever it is, the image stays the same to the last bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Traversal {
    /// Shape of the BVH.
    pub bvh: BvhKind,
    /// How kernels read the scene's buffers.
    pub fetch: Fetch,
    /// Invocations of a workgroup.
    pub workgroup_size: u32,
    /// Whether they are in packets, which each class of rays decides for itself.
    pub packets: bool,
}

impl Traversal {
    /// What all kernels of a render share, whatever rays they trace.
    pub fn shared(&self) -> Self {
        Self { packets: false, ..*self }
    }
}

/// A device's own quotients and roots where it was found to round them right; else they are made by `fma`, or by
/// integers where that is not fused either.
fn forms(facts: &Facts) -> Forms {
    let form = |exact| match (exact, facts.fma_fused) {
        (true, _) => Form::Native,
        (false, true) => Form::ByFma,
        (false, false) => Form::ByIntegers,
    };
    Forms {
        division: form(facts.division_exact),
        reciprocal: form(facts.reciprocal_exact),
        root: form(facts.root_exact),
    }
}

impl Defaults {
    /// Those of a GPU of which nothing else is known.
    pub const GPU: Self = Self {
        software: false,
        lanes: 32,
        fetch: Fetch::Storage,
        forms: Forms::CAREFUL,
        loop_turns: None,
        memory_bytes: u64::MAX,
        tuned: None,
    };

    /// Invocations of a workgroup, where a device has that many.
    pub const WORKGROUP: u32 = 256;
    /// Paths in flight on a GPU. On data-centre cards 2^23 are 3 to 20 % faster than 2^20.
    const GPU_PATHS: u32 = 1 << 23;
    /// On software: enough to keep every core busy between two dispatches, few enough for its caches.
    const SOFTWARE_PATHS: u32 = 1 << 18;
    /// Those of the megakernel on software, where a path in flight is its radiance alone, and the launch of so long a
    /// kernel costs lavapipe some milliseconds: with a tree, and with a list, which is faster.
    const FOLLOWED_PATHS: u32 = 1 << 20;
    const LISTED_PATHS: u32 = 1 << 22;
    /// Paths in flight take at most one part in this many of the device's memory.
    const MEMORY_SHARE: u64 = 4;
    /// Invocations of the megakernel on software, if at least that many paths are in flight: 64 workgroups to share among the
    /// cores. The more paths an invocation follows, the less it matters that the last ones of its subgroup end apart.
    const INVOCATIONS: u32 = 1 << 14;
    /// Paths of a render from which on the megakernel takes less time than bounce on lavapipe: an invocation
    /// then follows 32 or more.
    const MANY_PATHS: u64 = 1 << 19;
    /// Paths that an invocation must be able to follow for it.
    const MANY_FOLLOWED: u32 = 16;
    /// Most bounces of paths of which an invocation may follow many, one after the other, in a list of triangles, which
    /// takes no loops, where loops have a limit.
    const COUNTABLE_BOUNCES: u32 = 255;

    /// Those of a device, which is measured where it never was.
    ///
    /// # Errors
    /// When the device fails.
    pub fn of(device: &Device) -> Result<Self, GpuError> {
        let (description, facts) = (device.description(), facts::of(device)?);
        let software = description.is_software();
        Ok(Self {
            software,
            lanes: description.subgroup_size,
            fetch: if software && facts.texels_are_faster() { Fetch::Texel } else { Fetch::Storage },
            forms: forms(&facts),
            loop_turns: facts.loop_turns,
            memory_bytes: description.memory_bytes,
            tuned: None,
        })
    }

    /// The same where a tuning was found.
    #[must_use]
    pub fn with(self, tuned: Option<Tuned>) -> Self {
        Self { tuned, ..self }
    }

    /// Makes every choice that the settings leave open, for a scene with such a BVH and such levels.
    pub fn choose(&self, settings: &Settings, bvh: BvhKind, levels: SceneLevels) -> Choices {
        let scheduler = self.scheduler(settings, levels);
        let packets = self.packets(settings);
        let workgroup = self.tuned.filter(|_| scheduler == Scheduler::Wavefront).map(|tuned| tuned.workgroup_size);
        let is_open = settings.bvh.is_none()
            || settings.fetch.is_none()
            || (settings.packets.is_none() && packets.is_some())
            || (settings.workgroup_size.is_none() && workgroup.is_some());
        Choices {
            scheduler,
            bvh,
            instances: if levels.two_levels { Instances::TwoLevel } else { Instances::Flatten },
            fetch: self.fetch(settings),
            packets: packets.unwrap_or_default(),
            workgroup_size: settings.workgroup_size.or(workgroup).unwrap_or(Self::WORKGROUP),
            tuned: self.tuned.is_some() && is_open,
        }
    }

    fn fetch(&self, settings: &Settings) -> Fetch {
        settings.fetch.or(self.tuned.map(|tuned| tuned.fetch)).unwrap_or(self.fetch)
    }

    /// `None` where neither settings nor tuning ask for any: to ask for none asks for queues too.
    fn packets(&self, settings: &Settings) -> Option<Packets> {
        let tuned = self.tuned.map(|tuned| tuned.packets).filter(|packets| *packets != Packets::default());
        settings.packets.or(tuned)
    }

    /// How the work is cut for a scene of those levels.
    ///
    /// On GPUs bounce is the fastest, or level with the wavefront. So it is on software of eight lanes a subgroup, but
    /// where the invocations of the megakernel may follow many paths one after the other: that takes many paths, of a
    /// bound where loops have a limit, or a list of triangles, in which rays cost the same. With fewer lanes it is the
    /// wavefront, which alone can sort.
    pub fn scheduler(&self, settings: &Settings, levels: SceneLevels) -> Scheduler {
        let preferred = if settings.sort == Sort::Material || (self.software && self.lanes < 8) {
            Scheduler::Wavefront
        } else if self.software && self.follows_many(settings, levels) {
            Scheduler::Megakernel
        } else {
            Scheduler::Bounce
        };
        settings.scheduler.unwrap_or(preferred)
    }

    /// Whether the megakernel has enough paths for its invocations to be the fastest.
    fn follows_many(&self, settings: &Settings, levels: SceneLevels) -> bool {
        if levels.bvh == 0 {
            let bounces = settings.max_bounces.unwrap_or(u32::MAX);
            return self.loop_turns.is_none() || bounces <= Self::COUNTABLE_BOUNCES;
        }
        // The megakernel has none of the rays that these are said of.
        let asks_for_queues = self.packets(settings).is_some() || settings.shadow_rays == ShadowRays::AtOnce;
        let paths = u64::from(settings.width) * u64::from(settings.height) * u64::from(settings.samples);
        self.safe_paths_per_invocation(settings, levels) >= Self::MANY_FOLLOWED
            && paths >= Self::MANY_PATHS
            && !asks_for_queues
    }

    /// The shape of a scene's BVH, and how meshes lie in memory that are placed more than once.
    pub fn tree(&self, settings: &Settings, scene: &Scene) -> (BvhKind, Instances) {
        let instances = match settings.instances {
            _ if scene.placed.is_empty() => Instances::Flatten,
            Some(instances) => instances,
            None if settings.bvh.is_some_and(|bvh| bvh != BvhKind::Bvh2) => Instances::Flatten,
            None => pays(scene.mesh.triangles.len() as u64, &scene.placed_counts()),
        };
        let bvh = match instances {
            Instances::Flatten => self.bvh(settings, scene.triangle_count() as usize),
            Instances::TwoLevel => settings.bvh.unwrap_or(BvhKind::Bvh2),
        };
        (bvh, instances)
    }

    /// The shape of the BVH of this many triangles. A list is the fastest as long as it is short. Else it is two-wide on
    /// GPUs, for nearly every class of rays, and on software of four lanes a subgroup; on eight lanes it is eight-wide.
    pub fn bvh(&self, settings: &Settings, triangles: usize) -> BvhKind {
        let default = match (self.software, self.lanes) {
            (true, ..8) => BvhKind::Bvh2,
            _ if triangles <= MAX_LISTED => BvhKind::List,
            (true, _) => BvhKind::Cwbvh,
            (false, _) => BvhKind::Bvh2,
        };
        settings.bvh.or(self.tuned.map(|tuned| tuned.bvh)).unwrap_or(default)
    }

    /// How kernels reach memory, as far as the device can.
    pub fn access(&self, settings: &Settings) -> Access {
        Access { texel_fetch: self.fetch(settings) == Fetch::Texel, subgroup_ballot: true }
    }

    /// Paths in flight, each with this many bytes of state.
    pub(super) fn paths_in_flight(&self, scheduler: Scheduler, levels: SceneLevels, state_bytes: u64) -> u32 {
        let wanted = match (self.software, scheduler, levels.bvh) {
            (true, Scheduler::Megakernel, 0) => Self::LISTED_PATHS,
            (true, Scheduler::Megakernel, _) => Self::FOLLOWED_PATHS,
            (true, ..) => Self::SOFTWARE_PATHS,
            (false, ..) => Self::GPU_PATHS,
        };
        let fit = self.memory_bytes / Self::MEMORY_SHARE / state_bytes.max(1);
        u64::from(wanted).min(fit.max(1)) as u32
    }

    /// Paths that an invocation of the megakernel follows one after the other, of this many in flight.
    pub(super) fn paths_per_invocation(&self, settings: &Settings, levels: SceneLevels, in_flight: u32) -> u32 {
        if !self.software {
            return 1;
        }
        (in_flight / Self::INVOCATIONS).clamp(1, self.safe_paths_per_invocation(settings, levels))
    }

    /// As many paths as stay within the turns of the loops: each vertex has two rays, and a ray was
    /// seen to take three turns a level at most, where boxes overlap much some for each test that the SAH
    /// expects; and a light sample, which takes one a level of the sky.
    fn safe_paths_per_invocation(&self, settings: &Settings, levels: SceneLevels) -> u32 {
        let Some(most) = self.loop_turns else { return u32::MAX };
        let vertices = settings.vertices();
        let ray = (4 * levels.bvh.max(1)).max(levels.bvh_tests.saturating_mul(3));
        let vertex = ray.saturating_mul(2).saturating_add(levels.sky).saturating_add(settings.shading_cost);
        let turns = vertices.saturating_mul(vertex);
        (most / turns).max(1)
    }
}

/// How meshes lie in memory that are placed more than once: by the triangles of each, and how often it is placed, in a scene
/// with that many other triangles. A tree of two levels takes more time a ray, so it must save a lot, or be the only one
/// that can address them.
fn pays(others: u64, placed: &[[u32; 2]]) -> Instances {
    /// Bytes of a triangle and its share of nodes, about.
    const TRIANGLE_BYTES: u64 = 80;
    /// Bytes of a mesh in its place, and of a node above it.
    const INSTANCE_BYTES: u64 = 160 + 64;
    /// Bytes that any device has.
    const AFFORDABLE_BYTES: u64 = 256 << 20;
    /// How many times the bytes of two levels flattened triangles may take.
    const WORTHWHILE: u64 = 4;
    let (mut flattened, mut two_level) = (others, others * TRIANGLE_BYTES);
    for &[triangles, placements] in placed {
        let (triangles, placements) = (u64::from(triangles), u64::from(placements));
        flattened = flattened.saturating_add(triangles.saturating_mul(placements));
        two_level += triangles * TRIANGLE_BYTES + placements * INSTANCE_BYTES;
    }
    let fits = flattened <= MAX_TRIANGLES as u64;
    let flattened = flattened.saturating_mul(TRIANGLE_BYTES);
    match !fits || (flattened > AFFORDABLE_BYTES && flattened / WORTHWHILE > two_level) {
        true => Instances::TwoLevel,
        false => Instances::Flatten,
    }
}

#[cfg(test)]
impl Defaults {
    /// Of software with eight lanes, whose loops have a limit.
    pub(super) const LIMITED_SOFTWARE: Self = Self {
        software: true,
        lanes: 8,
        fetch: Fetch::Texel,
        forms: Forms::NATIVE,
        loop_turns: Some(65_535),
        memory_bytes: 1 << 31,
        tuned: None,
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use crate::settings::Packets;

    /// Software of eight lanes whose loops have a limit, without one, and of four lanes.
    const LIMITED: Defaults = Defaults::LIMITED_SOFTWARE;
    const UNLIMITED: Defaults = Defaults { loop_turns: None, ..LIMITED };
    const NARROW: Defaults = Defaults { lanes: 4, ..UNLIMITED };

    const TREE: SceneLevels = SceneLevels { bvh: 12, bvh_tests: 0, sky: 0, two_levels: false };
    const LIST: SceneLevels = SceneLevels { bvh: 0, ..TREE };

    fn few() -> Settings {
        Settings { width: 64, height: 64, samples: 4, ..Scene::cornell_box().settings }
    }

    fn many() -> Settings {
        Settings { width: 1 << 10, height: 1 << 9, samples: 1, ..few() }
    }

    #[test]
    fn the_scheduler_follows_device_scene_and_sort() {
        let by = |settings: Settings, defaults: Defaults| defaults.scheduler(&settings, TREE);
        for settings in [few(), many()] {
            assert_eq!(by(settings, Defaults::GPU), Scheduler::Bounce);
            assert_eq!(by(settings, NARROW), Scheduler::Wavefront);
        }
        assert_eq!(Defaults::GPU.scheduler(&many(), LIST), Scheduler::Bounce);
        assert_eq!(by(few(), LIMITED), Scheduler::Bounce);
        let sorted = Settings { sort: Sort::Material, ..few() };
        assert_eq!([LIMITED, Defaults::GPU].map(|device| by(sorted, device)), [Scheduler::Wavefront; 2]);
        let chosen = Settings { scheduler: Some(Scheduler::Megakernel), ..sorted };
        assert_eq!(by(chosen, LIMITED), Scheduler::Megakernel);
    }

    #[test]
    fn the_megakernel_is_for_many_paths_as_long_as_loops_allow() {
        let by = |settings: Settings, defaults: Defaults| defaults.scheduler(&settings, TREE);
        for device in [LIMITED, UNLIMITED] {
            assert_eq!(by(many(), device), Scheduler::Megakernel);
            assert_eq!(by(Settings { width: (1 << 10) - 1, ..many() }, device), Scheduler::Bounce);
            assert_eq!(by(Settings { packets: Some(Packets::default()), ..many() }, device), Scheduler::Bounce);
            assert_eq!(by(Settings { shadow_rays: ShadowRays::AtOnce, ..many() }, device), Scheduler::Bounce);
        }
        let unbounded = Settings { max_bounces: None, roulette: 0.2, ..many() };
        for long in [unbounded, Settings { max_bounces: Some(60), ..many() }] {
            assert_eq!([LIMITED, UNLIMITED].map(|device| by(long, device)), [Scheduler::Bounce, Scheduler::Megakernel]);
        }

        let listed = |max_bounces, defaults: Defaults| {
            defaults.scheduler(&Settings { max_bounces, roulette: 0.2, ..few() }, LIST)
        };
        assert_eq!(listed(Some(255), LIMITED), Scheduler::Megakernel);
        assert_eq!([Some(256), None].map(|bounces| listed(bounces, LIMITED)), [Scheduler::Bounce; 2]);
        assert_eq!([Some(256), None].map(|bounces| listed(bounces, UNLIMITED)), [Scheduler::Megakernel; 2]);
        assert_eq!(listed(Some(8), NARROW), Scheduler::Wavefront);
    }

    #[test]
    fn invocations_follow_as_many_paths_as_their_loops_allow() {
        let deep = SceneLevels { bvh: 40, ..SceneLevels::default() };
        let paths = |max_bounces, levels, defaults: Defaults| {
            let settings = Settings { max_bounces, ..many() };
            let in_flight = defaults.paths_in_flight(Scheduler::Megakernel, levels, 16);
            defaults.paths_per_invocation(&settings, levels, in_flight)
        };
        assert_eq!([Some(8), Some(50), None].map(|bounces| paths(bounces, deep, LIMITED)), [22, 4, 1]);
        assert_eq!(paths(Some(50), SceneLevels { sky: 10, ..deep }, LIMITED), 3);
        assert_eq!(paths(Some(8), SceneLevels { bvh_tests: 400, ..deep }, LIMITED), 3);
        assert_eq!(paths(Some(8), LIST, LIMITED), 256);
        assert_eq!([Some(8), Some(50), None].map(|bounces| paths(bounces, deep, UNLIMITED)), [64; 3]);
        assert_eq!(paths(Some(8), deep, Defaults::GPU), 1);
        // A small image has an invocation for each path.
        assert_eq!(UNLIMITED.paths_per_invocation(&few(), LIST, 64 * 64), 1);
    }

    #[test]
    fn a_tuning_chooses_what_settings_leave_open() {
        let packets = Packets { camera: true, ..Packets::default() };
        let tuned = Tuned { bvh: BvhKind::Bvh4, fetch: Fetch::Storage, workgroup_size: 64, packets };
        let device = Defaults::GPU.with(Some(tuned));
        let choose = |settings: Settings| {
            let bvh = device.bvh(&settings, 1000);
            let choices = device.choose(&settings, bvh, TREE);
            assert_eq!(choices.settle(&settings).bvh, Some(choices.bvh));
            (choices.bvh, choices.fetch, choices.workgroup_size, choices.packets, choices.tuned)
        };
        let open = few();
        for scheduler in [None, Some(Scheduler::Bounce), Some(Scheduler::Megakernel)] {
            // The workgroup was measured with the wavefront's kernels.
            let chosen = choose(Settings { scheduler, ..open });
            assert_eq!(chosen, (BvhKind::Bvh4, Fetch::Storage, Defaults::WORKGROUP, packets, true));
        }
        let wavefront = Settings { scheduler: Some(Scheduler::Wavefront), ..open };
        assert_eq!(choose(wavefront).2, 64);
        assert_eq!(choose(Settings { workgroup_size: Some(8), ..wavefront }).2, 8);
        let shadow = Packets { shadow: true, ..Packets::default() };
        let all = Settings {
            bvh: Some(BvhKind::Bvh2),
            fetch: Some(Fetch::Texel),
            workgroup_size: Some(8),
            packets: Some(shadow),
            ..open
        };
        assert_eq!(choose(all), (BvhKind::Bvh2, Fetch::Texel, 8, shadow, false));
        let untuned = Defaults::GPU.choose(&open, BvhKind::Bvh2, TREE);
        assert_eq!((untuned.packets, untuned.tuned), (Packets::default(), false));
        // A tuning without packets asks for no queues.
        let single = Defaults { tuned: Some(Tuned { packets: Packets::default(), ..tuned }), ..LIMITED };
        assert_eq!(single.scheduler(&many(), TREE), Scheduler::Megakernel);
        assert_eq!(LIMITED.with(Some(tuned)).scheduler(&many(), TREE), Scheduler::Bounce);
    }

    #[test]
    fn meshes_stay_placed_where_flattening_would_not_pay() {
        // A mesh of 100,000 triangles: 31 placements take 248 MB, 34 take 272 MB and more than 256 MiB.
        let by = |placements| pays(12, &[[100_000, placements]]);
        assert_eq!([2, 33, 34, 100_000].map(by)[..2], [Instances::Flatten; 2]);
        assert_eq!([34, 100_000].map(by), [Instances::TwoLevel; 2]);
        // 10^7 placements of two triangles are no more than their instances.
        assert_eq!(pays(0, &[[2, 10_000_000]]), Instances::Flatten);
        // What else there is counts on both sides.
        assert_eq!(pays(10_000_000, &[[100_000, 34]]), Instances::Flatten);
        assert_eq!(pays(0, &[[u32::MAX, u32::MAX]]), Instances::TwoLevel);
        // One tree cannot address twice 100 million.
        assert_eq!(pays(0, &[[100_000_000, 2]]), Instances::TwoLevel);
    }

    #[test]
    fn the_tree_follows_device_and_scene() {
        let by = |triangles| [LIMITED, NARROW, Defaults::GPU].map(|defaults| defaults.bvh(&few(), triangles));
        assert_eq!(by(MAX_LISTED), [BvhKind::List, BvhKind::Bvh2, BvhKind::List]);
        assert_eq!(by(MAX_LISTED + 1), [BvhKind::Cwbvh, BvhKind::Bvh2, BvhKind::Bvh2]);
        let chosen = Settings { bvh: Some(BvhKind::Bvh4), ..few() };
        assert_eq!(Defaults::GPU.bvh(&chosen, 12), BvhKind::Bvh4);
    }

    #[test]
    fn paths_in_flight_leave_room_for_the_scene() {
        let paths = |memory_bytes, state_bytes| {
            Defaults { memory_bytes, ..Defaults::GPU }.paths_in_flight(Scheduler::Bounce, TREE, state_bytes)
        };
        assert_eq!(paths(80 << 30, 160), 1 << 23);
        assert_eq!(paths(4 << 30, 1 << 10), 1 << 20);
        assert_eq!(paths(0, 160), 1);
        assert_eq!(LIMITED.paths_in_flight(Scheduler::Bounce, TREE, 160), 1 << 18);
    }
}
