//! Settings that are a choice among names. The text of a choice stands in its enum once: what a flag takes, what a
//! record holds, what a study varies and what help says of it all come from there.

use serde::{Deserialize, Serialize};
use strum::{EnumMessage, EnumString, IntoStaticStr, VariantArray};

/// One of a setting's choices.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Name {
    /// As flags, files and records have it, in kebab-case.
    pub name: &'static str,
    /// What it stands for, a sentence without its full stop.
    pub meaning: String,
}

/// A setting whose values are names.
pub trait Named: VariantArray + EnumMessage + Copy + Into<&'static str> {
    /// Its name.
    fn name(self) -> &'static str {
        self.into()
    }

    /// All choices, in the order of the enum.
    fn names() -> Vec<Name> {
        let name = |choice: &Self| Name {
            name: choice.name(),
            meaning: words(choice.get_documentation().unwrap_or_default()).trim_end_matches('.').to_owned(),
        };
        Self::VARIANTS.iter().map(name).collect()
    }
}

/// The text in one line.
fn words(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

impl<T: VariantArray + EnumMessage + Copy + Into<&'static str>> Named for T {}

/// Enums whose variants are names in kebab-case, for flags, files and records alike.
macro_rules! named {
    ($($(#[$attribute:meta])* pub enum $name:ident { $($variants:tt)* })*) => {
        $(
            $(#[$attribute])*
            #[derive(
                Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, EnumString, IntoStaticStr,
                VariantArray, EnumMessage,
            )]
            #[serde(rename_all = "kebab-case")]
            #[strum(serialize_all = "kebab-case")]
            pub enum $name { $($variants)* }
        )*
    };
}

named! {
    /// How light is gathered along a path.
    pub enum Integrator {
        /// BSDF importance sampling only.
        Implicit,
        /// Next-event estimation, a light sample at every vertex.
        Explicit,
        /// Both, weighted by multiple importance sampling with the power heuristic.
        Mis,
    }

    /// Where random numbers come from.
    pub enum Sampler {
        /// Independent pseudo-random numbers.
        Independent,
        /// An Owen-scrambled Sobol sequence in each pixel.
        Sobol,
    }

    /// How Russian roulette decides. Either way the image stays the same in expectation.
    pub enum RouletteMode {
        /// Every vertex stops the path with probability q.
        Constant,
        /// From a vertex on the path survives with the probability of its throughput, the largest channel, and of 1 - q at
        /// most.
        Throughput,
    }

    /// How exactly the state of a path is kept between its vertices.
    pub enum PathState {
        /// In floats, as it was computed.
        F32,
        /// Throughput in halves, rounded stochastically so that the image is the same in expectation, and directions in 48
        /// bits: 16 bytes a path less; a throughput above 65,504 is clamped to it.
        F16,
    }

    /// How the light about a pixel makes its value.
    pub enum Filter {
        /// All of it in the pixel's square, equally.
        Box,
        /// By a Gaussian about its centre, with a standard deviation of half a pixel, as Mitsuba's and pbrt's is.
        Gaussian,
    }

    /// How rays are kept from hitting the surface that they leave.
    pub enum Offsets {
        /// They begin as far off it as rounding can err there, and remember its triangle; a thin triangle at which one
        /// begins is checked to lie in front of it.
        Robust,
        /// As robust, without that check; BIASED where thin triangles meet at convex edges.
        Unchecked,
        /// They begin 10⁻⁴ of the scene off it; BIASED where surfaces are closer than that.
        Fixed,
    }

    /// Who defines what arithmetic gives where Vulkan leaves it to the driver: quotients, roots, dot and cross products, and
    /// functions made of them.
    pub enum Numerics {
        /// By raywave: the image is the same on every device, to the last bit.
        Portable,
        /// By the driver: the image is the same on this device and driver only, whatever the scheduler.
        Native,
    }

    /// How the work is cut into kernels. The image is the same to the last bit.
    pub enum Scheduler {
        /// A kernel a stage, queues between them.
        Wavefront,
        /// A kernel that takes paths to their next surface and shades it, a queue between bounces.
        Bounce,
        /// One kernel that follows a path from the camera to its end.
        Megakernel,
    }

    /// How meshes lie in memory that are placed more than once.
    pub enum Instances {
        /// Each placement has triangles of its own, in one tree.
        Flatten,
        /// A mesh is there once, under a tree over the placements of all; `bvh2` only.
        TwoLevel,
    }

    /// How kernels read the scene's buffers.
    pub enum Fetch {
        /// As texel buffers, where the device's can hold the scene.
        Texel,
        /// As storage buffers.
        Storage,
    }

    /// The order in which the wavefront shades.
    pub enum Sort {
        /// As the rays were queued.
        None,
        /// By kind of surface, or by branch with --materials.
        Material,
    }

    /// When the bounce scheduler traces shadow rays.
    pub enum ShadowRays {
        /// By a kernel of their own, from a queue, so that every lane has one.
        Deferred,
        /// Where they arise, with nothing written down; lanes without one wait.
        AtOnce,
    }
}
