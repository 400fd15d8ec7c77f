//! Ray dumps: the rays of one bounce as a file, so that traversal can be studied without a renderer.
//!
//! This room owns the file format, which `docs/ray-dumps.md` describes, and its errors. It knows nothing of BVHs or of
//! the GPU: triangles are identified by their index in the scene, so a dump outlives every change of how scenes are
//! laid out.

mod error;
mod file;
mod npy;

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};

pub use error::{Fault, RaysError};
pub use npy::{write_distances, write_triangles};

use crate::constants::{NO_TRIANGLE, WORLD_INSTANCE};

/// Rays with everything that is needed to trace them elsewhere.
#[derive(Debug, Clone, PartialEq)]
pub struct RayDump {
    /// What they are.
    pub metadata: Metadata,
    /// As many records as the metadata says, at least 1.
    pub rays: Vec<RayRecord>,
}

/// A ray of normalised space (the scene's bounds fit [-1, 1]³). 40 bytes, of which version 1 of the format has 32.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct RayRecord {
    /// Start. Finite.
    pub origin: [f32; 3],
    /// Triangle that the origin lies on, which the ray cannot hit, by its number among those of its instance; or
    /// `NO_TRIANGLE`.
    pub leaves: u32,
    /// Direction; distances are in its lengths. Finite, not zero. A shadow ray to a light reaches it at 1.
    pub direction: [f32; 3],
    /// Of a shadow ray, the light's triangle, which does not occlude it, by its number among those of its instance.
    /// `NO_TRIANGLE` for a shadow ray without an end, and for other rays.
    pub target: u32,
    /// Instance of `leaves`: 0 is the world, then come the placements of meshes in the scene's order; means nothing without
    /// a triangle.
    pub leaves_instance: u32,
    /// Instance of `target`.
    pub target_instance: u32,
}

impl RayRecord {
    /// Whether it can be traced: all numbers are finite and the direction is not zero.
    pub fn is_sound(&self) -> bool {
        self.fault().is_none()
    }

    /// What is wrong with its numbers, and how many bytes into the record.
    fn fault(&self) -> Option<(u64, Fault)> {
        let not_finite = |v: [f32; 3]| v.iter().zip(0..).find(|(x, _)| !x.is_finite()).map(|(x, i)| (4 * i, *x));
        if let Some((byte, value)) = not_finite(self.origin) {
            return Some((byte, Fault::NotFinite { field: "origin", value }));
        }
        if let Some((byte, value)) = not_finite(self.direction) {
            return Some((DIRECTION_BYTE + byte, Fault::NotFinite { field: "direction", value }));
        }
        (self.direction == [0.0; 3]).then_some((DIRECTION_BYTE, Fault::NoDirection))
    }

    /// What is wrong with it as a ray of that class in a scene of instances with those ends, and how many bytes into the
    /// record.
    fn fault_in(&self, class: RayClass, instances: &Instances) -> Option<(u64, Fault)> {
        if let Some(fault) = self.fault() {
            return Some(fault);
        }
        let fields = [
            ("leaves", self.leaves, self.leaves_instance, LEAVES_BYTE, LEAVES_INSTANCE_BYTE),
            ("target", self.target, self.target_instance, TARGET_BYTE, TARGET_INSTANCE_BYTE),
        ];
        for (field, triangle, instance, byte, instance_byte) in
            fields.into_iter().filter(|field| field.1 != NO_TRIANGLE)
        {
            match instances.triangles(instance) {
                None => {
                    let instances = instances.count();
                    return Some((instance_byte, Fault::NoSuchInstance { field, instance, instances }));
                }
                Some(triangles) if triangle >= triangles => {
                    let fault = match instance {
                        WORLD_INSTANCE => Fault::NoSuchTriangle { field, triangle, triangles },
                        _ => Fault::NoSuchTriangleOfInstance { field, triangle, triangles },
                    };
                    return Some((byte, fault));
                }
                Some(_) => {}
            }
        }
        (class != RayClass::Shadow && self.target != NO_TRIANGLE).then_some((TARGET_BYTE, Fault::Target))
    }
}

const LEAVES_BYTE: u64 = std::mem::offset_of!(RayRecord, leaves) as u64;
const DIRECTION_BYTE: u64 = std::mem::offset_of!(RayRecord, direction) as u64;
const TARGET_BYTE: u64 = std::mem::offset_of!(RayRecord, target) as u64;

const LEAVES_INSTANCE_BYTE: u64 = std::mem::offset_of!(RayRecord, leaves_instance) as u64;
const TARGET_INSTANCE_BYTE: u64 = std::mem::offset_of!(RayRecord, target_instance) as u64;

/// How many triangles the instances of a scene have.
struct Instances {
    /// For each run of instances of as many triangles: the number of the first instance after it, and the triangles.
    runs: Vec<(u64, u32)>,
}

impl Instances {
    fn of(scene: &RayScene) -> Self {
        let mut end = 1;
        let placed = scene.placed.iter().map(|[triangles, placements]| {
            end += u64::from(*placements);
            (end, *triangles)
        });
        Self { runs: [(1, scene.triangles)].into_iter().chain(placed).collect() }
    }

    fn count(&self) -> u64 {
        self.runs.last().map_or(0, |(end, _)| *end)
    }

    fn triangles(&self, instance: u32) -> Option<u32> {
        let run = self.runs.partition_point(|(end, _)| *end <= u64::from(instance));
        self.runs.get(run).map(|(_, triangles)| *triangles)
    }
}

/// What rays are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RayClass {
    /// From the camera to the first surface.
    Camera,
    /// From a scattering to the next surface.
    Bounce,
    /// From a surface to a sampled light.
    Shadow,
}

impl RayClass {
    /// Its name in flags and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Bounce => "bounce",
            Self::Shadow => "shadow",
        }
    }
}

/// The order that rays are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RayOrder {
    /// Order of the path slots: pixels in rows from the top left, then samples. Repeatable.
    Slot,
    /// Order of the renderer's queue, as it happened to be filled.
    Queue,
}

/// The scene that rays belong to, and the transform from their space to world space.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RayScene {
    /// Name of the scene, for people.
    pub scene: String,
    /// BLAKE3 of the scene's files, lower-case hex.
    pub scene_hash: String,
    /// Triangles of the scene but for those of meshes that are placed more than once.
    pub triangles: u32,
    /// Of each mesh that is placed more than once, its triangles and its placements.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub placed: Vec<[u32; 2]>,
    /// world = normalised / scale + centre, world units.
    pub centre: [f64; 3],
    /// A power of two.
    pub scale: f64,
}

/// The second line of a dump, as JSON with these keys. Keys that are not needed to trace the rays say how to produce
/// them again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metadata {
    /// Version of raywave that made the dump.
    pub raywave_version: String,
    /// The scene.
    #[serde(flatten)]
    pub scene: RayScene,
    /// What the rays are for.
    pub class: RayClass,
    /// Scattering events before the ray; of a shadow ray, before the surface that it leaves.
    pub bounce: u32,
    /// Number of rays.
    pub rays: u64,
    /// Their order.
    pub order: RayOrder,
    /// Image width.
    pub width_pixels: u32,
    /// Image height.
    pub height_pixels: u32,
    /// The rays are of that many first pixels, in rows from the top left,
    pub pixels: u32,
    /// and of that many first samples of each.
    pub samples_per_pixel: u32,
    /// Seed of the random numbers.
    pub seed: u32,
    /// Name of the integrator.
    pub integrator: String,
    /// Scattering events between camera and light; -1 is unbounded.
    pub max_bounces: i64,
    /// Probability of stopping at each vertex.
    pub roulette: f64,
    /// Name of the device that computed them.
    pub device: String,
    /// Its driver, with version.
    pub driver: String,
    /// Layout of the records.
    pub record: RecordLayout,
}

/// Version of the format: 2 is of scenes that place meshes more than once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Version {
    One,
    Two,
}

impl Version {
    fn of(scene: &RayScene) -> Self {
        if scene.placed.is_empty() { Self::One } else { Self::Two }
    }

    /// Bytes of a record, from the start of a [`RayRecord`].
    fn record_bytes(self) -> usize {
        match self {
            Self::One => LEAVES_INSTANCE_BYTE as usize,
            Self::Two => size_of::<RayRecord>(),
        }
    }
}

/// Layout of a record, in the form that `numpy.dtype` takes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordLayout {
    /// Names of the fields.
    pub names: Vec<String>,
    /// Types of the fields.
    pub formats: Vec<String>,
    /// Bytes from the start of the record.
    pub offsets: Vec<u64>,
    /// Bytes of a record.
    pub itemsize: u64,
}

impl RecordLayout {
    /// The layout of a [`RayRecord`] of a scene, the only one that can be read.
    pub fn of_rays(scene: &RayScene) -> Self {
        let fields = [
            ("origin", "3<f4", 0),
            ("leaves", "<u4", LEAVES_BYTE),
            ("direction", "3<f4", DIRECTION_BYTE),
            ("target", "<u4", TARGET_BYTE),
            ("leaves_instance", "<u4", LEAVES_INSTANCE_BYTE),
            ("target_instance", "<u4", TARGET_INSTANCE_BYTE),
        ];
        let version = Version::of(scene);
        let fields = &fields[..if version == Version::One { 4 } else { fields.len() }];
        Self {
            names: fields.iter().map(|(name, ..)| (*name).to_owned()).collect(),
            formats: fields.iter().map(|(_, format, _)| (*format).to_owned()).collect(),
            offsets: fields.iter().map(|(.., offset)| *offset).collect(),
            itemsize: version.record_bytes() as u64,
        }
    }
}
