//! Constants that Rust and GLSL share, each with its reason. `build.rs` includes this file and
//! writes `constants.glsl` from [`GLSL`], so that a number has one source.

/// Declares `u32` constants and lists them for the GLSL side.
macro_rules! shared_constants {
    ($($(#[$doc:meta])* $name:ident = $value:expr;)*) => {
        $($(#[$doc])* pub const $name: u32 = $value;)*
        /// Every shared constant, for the GLSL side.
        pub const GLSL: &[(&str, u32)] = &[$((stringify!($name), $value)),*];
    };
}

shared_constants! {
    /// Says that a ray leaves no triangle, or that it hit none.
    NO_TRIANGLE = u32::MAX;

    /// Bit of a BVH child reference that tells a leaf from an inner node.
    LEAF_BIT = 1 << 31;
    /// Where a leaf reference keeps its triangle count; the bits under it are its first triangle.
    LEAF_COUNT_SHIFT = 27;
    /// Most triangles a leaf can hold: the count has 4 bits, and 15 is kept for `TRAVERSAL_DONE`.
    LEAF_MAX_TRIANGLES = 8;
    /// What an empty traversal stack yields: it looks like a leaf, so that it ends the walk over
    /// inner nodes too.
    TRAVERSAL_DONE = u32::MAX;
    /// Bounces whose rays are counted apart; the last count takes all that follow.
    COUNTED_BOUNCES = 64;

    /// Where `count_item` counts a ray to the next surface.
    STAGE_EXTEND = 0;
    /// Where it counts a vertex.
    STAGE_SHADE = 1;
    /// Where it counts a ray to a light.
    STAGE_CONNECT = 2;
    /// Stages whose work is counted apart.
    STAGES = 3;
    /// Bins that rays are sorted into by what they hit: misses, then surfaces or branches.
    MATERIAL_BINS = 128;

    /// Samples that are not finite whose pixel and number are kept.
    TRACED_SAMPLES = 16;

    /// Entries of the traversal stack that are kept in registers.
    STACK_REGISTERS = 8;
    /// Entries of the traversal stack that move between registers and memory at a time.
    STACK_BLOCK = 4;
    /// Where the children of a wide node stand among what a ray meets in it; its triangles stand in
    /// the bits under it, three for each of eight children.
    WIDE_INNER_BIT = 24;
    /// Most triangles of a wide leaf.
    WIDE_LEAF_TRIANGLES = 3;
    /// Groups of triangles that a ray gathers from wide nodes before it meets them, in search of the
    /// nearest hit, at most 3; a group is of one node. On lavapipe 3 make rays of bounces 1.2 times as
    /// fast as 1.
    CLOSEST_GROUPS = 3;
    /// The same in search of any hit, where a group that blocks spares all that follows.
    ANY_GROUPS = 2;
    /// Most places for nodes of a wide BVH: a stack entry has 24 bits for that of a node's children, and 8 for which
    /// of them are left.
    WIDE_MAX_NODES = 1 << 24;
    /// Most triangles of a list: a kernel has instructions for each of them. One under a power of 4,
    /// so that a list fits all scenes of a tuning's class of sizes or none.
    LISTED_TRIANGLES = 63;
    /// 16-byte texels of a node of the two-wide BVH.
    NODE_TEXELS = 4;
    /// 16-byte texels of a triangle.
    TRIANGLE_TEXELS = 3;
    /// 16-byte texels of a material.
    MATERIAL_TEXELS = 4;

    /// Lambert plus Phong lobe.
    SURFACE_GLOSSY = 0;
    /// Perfect mirror.
    SURFACE_MIRROR = 1;
    /// Snell refraction without Fresnel split.
    SURFACE_REFRACTIVE = 2;
    /// Fresnel dielectric.
    SURFACE_DIELECTRIC = 3;
    /// Pure emitter.
    SURFACE_EMITTER = 4;

    /// No light from infinity.
    ENVIRONMENT_BLACK = 0;
    /// The same radiance from everywhere.
    ENVIRONMENT_CONSTANT = 1;
    /// A lat-long image.
    ENVIRONMENT_LAT_LONG = 2;
    /// Any of them: kernels ask the frame which.
    ENVIRONMENT_ANY = 3;

    /// Only BRDF sampling finds light.
    INTEGRATOR_IMPLICIT = 0;
    /// A light sample at every non-specular vertex.
    INTEGRATOR_EXPLICIT = 1;
    /// BRDF and light sampling, weighted by their densities.
    INTEGRATOR_MIS = 2;

    /// `max_bounces` of an unbounded path.
    UNBOUNDED = u32::MAX;

    /// Workgroup size of every kernel but those of one thread.
    SPEC_WORKGROUP_SIZE = 0;
    /// Entries of the traversal stack, in registers and in memory.
    SPEC_STACK_SIZE = 1;
    /// One of `INTEGRATOR_*`.
    SPEC_INTEGRATOR = 2;
    /// One of `ENVIRONMENT_*`.
    SPEC_ENVIRONMENT = 3;
    /// Whether some triangle emits.
    SPEC_HAS_LIGHTS = 4;
    /// Whether some material has a Phong lobe.
    SPEC_HAS_PHONG = 5;
    /// Whether some material is a mirror.
    SPEC_HAS_MIRROR = 6;
    /// Whether some material refracts without Fresnel split.
    SPEC_HAS_REFRACTIVE = 7;
    /// Whether some material is a Fresnel dielectric.
    SPEC_HAS_DIELECTRIC = 8;
    /// Whether some material has a texture.
    SPEC_HAS_TEXTURES = 9;
    /// Whether some triangle has shading normals.
    SPEC_HAS_NORMALS = 10;
    /// Whether the camera has a lens.
    SPEC_HAS_LENS = 11;
    /// Whether q > 0.
    SPEC_HAS_ROULETTE = 12;
    /// Steps of arithmetic added to the shading of each hit.
    SPEC_SHADING_COST = 13;
    /// Branches that the scattering of hits is spread over, at least 1.
    SPEC_MATERIAL_BRANCHES = 14;
    /// Whether shade takes rays in the order of what they hit.
    SPEC_SORTED = 15;
    /// Whether an invocation of the megakernel goes on with another path when one has ended.
    SPEC_REGENERATES = 16;
    /// Children of a BVH node: 2, 4 or 8; 1 is a list of triangles without nodes.
    SPEC_BVH_WIDTH = 17;
    /// Whether some material has a diffuse or Phong part.
    SPEC_HAS_GLOSSY = 18;
    /// Whether paths scatter at all: `max_bounces` is not 0.
    SPEC_SCATTERS = 19;
    /// Whether paths end at `max_bounces`.
    SPEC_BOUNDED = 20;
    /// Whether vertices may send shadow rays.
    SPEC_CASTS_SHADOWS = 21;
    /// Triangles of the list.
    SPEC_LISTED_COUNT = 22;
    /// Whether bounce queues its shadow rays for connect.
    SPEC_DEFERS_SHADOW_RAYS = 23;
    /// Whether random numbers are points of Sobol sequences.
    SPEC_SOBOL = 24;
    /// Whether the roulette goes by throughput.
    SPEC_ROULETTE_BY_THROUGHPUT = 25;
    /// Whether indirect light is clamped.
    SPEC_CLAMPS = 26;
    /// Whether what a path carries is kept in halves.
    SPEC_HALF_STATE = 27;
    /// Whether rays leave surfaces by a fixed offset.
    SPEC_FIXED_OFFSETS = 28;
    /// Whether the camera is so far from the scene that its rays start nearer to it.
    SPEC_HAS_DISTANCE = 29;
    /// Specialization constants that every kernel knows.
    SPEC_COUNT = 30;
    /// The first of nine constants a triangle of the list, its vertices.
    SPEC_LISTED_TRIANGLES = 64;
}
