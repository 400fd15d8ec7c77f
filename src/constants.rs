//! Constants that Rust and GLSL share, each with its reason. `build.rs` includes this file and writes `constants.glsl`
//! from [`GLSL`] and `specialization_constants.glsl` from [`Specialization::TABLE`], so that a number has one source.

/// Declares `u32` constants and lists them for the GLSL side.
macro_rules! shared_constants {
    ($($(#[$doc:meta])* $name:ident = $value:expr;)*) => {
        $($(#[$doc])* pub const $name: u32 = $value;)*
        /// Every shared constant, for the GLSL side.
        pub const GLSL: &[(&str, u32)] = &[$((stringify!($name), $value)),*];
    };
}

shared_constants! {
    /// No primitive: a ray leaves none, or hit none.
    NO_TRIANGLE = u32::MAX;

    /// Bit of a BVH child reference that is set for a leaf and clear for an inner node.
    LEAF_BIT = 1 << 31;
    /// Where a leaf reference keeps its triangle count; the bits under it are its first triangle.
    LEAF_COUNT_SHIFT = 27;
    /// Most triangles a leaf can hold: the count has 4 bits, and 15 is kept for `TRAVERSAL_DONE`.
    LEAF_MAX_TRIANGLES = 8;
    /// What an empty traversal stack yields: it looks like a leaf, so that it ends the loop over inner nodes too.
    TRAVERSAL_DONE = u32::MAX;
    /// Count of a leaf reference that is no leaf but a mesh in its place: the bits under it are its index.
    LEAF_INSTANCE = 14;
    /// Where a traversal is done with a mesh in its place and is in the world again: as a leaf without triangles.
    INSTANCE_DONE = (1 << 31) | (13 << 27);
    /// The instance of what is no mesh in its place: a triangle of the world itself.
    WORLD_INSTANCE = 0;
    /// Bounces whose rays are counted apart; the last count takes all later ones too.
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

    /// Capacity of the list of non-finite samples.
    TRACED_SAMPLES = 16;

    /// Entries of the traversal stack that are kept in registers.
    STACK_REGISTERS = 8;
    /// Entries of the traversal stack that move between registers and memory at a time.
    STACK_BLOCK = 4;
    /// Where the inner children of a wide node begin among the bits of what a ray enters in it; its triangles have the
    /// bits under it, three for each of eight children.
    WIDE_INNER_BIT = 24;
    /// Most triangles of a wide leaf.
    WIDE_LEAF_TRIANGLES = 3;
    /// Groups of triangles that a ray gathers from wide nodes before it intersects them, in search of the
    /// nearest hit, at most 3; a group is of one node. On lavapipe 3 make rays of bounces 1.2 times as
    /// fast as 1.
    CLOSEST_GROUPS = 3;
    /// The same in search of any hit, where a group that occludes spares all later ones.
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
    /// 16-byte texels of a mesh in its place.
    INSTANCE_TEXELS = 10;
    /// 16-byte texels of a material.
    MATERIAL_TEXELS = 4;
    /// 16-byte texels of what else a material may have.
    MATERIAL_DETAIL_TEXELS = 11;
    /// 16-byte texels of a light that is no surface.
    PUNCTUAL_LIGHT_TEXELS = 4;

    /// Phong BRDF: Lambert plus modified Phong lobe.
    SURFACE_PHONG = 0;
    /// Perfect mirror.
    SURFACE_MIRROR = 1;
    /// Glass that refracts by Snell's law without Fresnel's split.
    SURFACE_REFRACTIVE = 2;
    /// Fresnel dielectric.
    SURFACE_DIELECTRIC = 3;
    /// Area light, which scatters nothing.
    SURFACE_EMITTER = 4;
    /// Metal without microfacets.
    SURFACE_SMOOTH_CONDUCTOR = 5;
    /// Metal with microfacets.
    SURFACE_CONDUCTOR = 6;
    /// Dielectric with microfacets.
    SURFACE_ROUGH_DIELECTRIC = 7;
    /// Plate of a dielectric through which light goes straight.
    SURFACE_THIN_DIELECTRIC = 8;
    /// Diffuse base under a smooth coat.
    SURFACE_PLASTIC = 9;
    /// Diffuse base under a coat with microfacets.
    SURFACE_ROUGH_PLASTIC = 10;
    /// glTF's mixture of a metal and of a diffuse body under an interface, perhaps under a coat.
    SURFACE_METAL_ROUGH = 11;
    /// No surface.
    SURFACE_NOTHING = 12;
    /// One of two materials by chance.
    SURFACE_BLEND = 13;
    /// One material for each side.
    SURFACE_SIDES = 14;
    /// Disney's BSDF of a body.
    SURFACE_PRINCIPLED = 15;
    /// Disney's BSDF of a thin sheet.
    SURFACE_PRINCIPLED_THIN = 16;
    /// Bit of a material's details: what is reflected inside a coat shifts the colour of its base.
    DETAIL_NONLINEAR = 1;
    /// Bit of them: microfacets are of Beckmann's distribution, and not GGX.
    DETAIL_BECKMANN = 2;
    /// Bit of them: a principled body has an inside, which light gets into somewhere.
    DETAIL_TRANSMITS = 4;
    /// Places of images among those of a material: of `ks`.
    MAP_KS = 0;
    /// Of the microfacets' width along the tangent.
    MAP_ALPHA_X = 1;
    /// Of that across it.
    MAP_ALPHA_Y = 2;
    /// Of the share of metal.
    MAP_METALNESS = 3;
    /// How many of those that say how light scatters come first.
    MAPS_OF_SCATTERING = 4;
    /// Of what only principled materials show: the share of the clear coat.
    MAP_COAT = 4;
    /// Of the anisotropy.
    MAP_ANISOTROPY = 5;
    /// Of the sheen.
    MAP_SHEEN = 6;
    /// Of the sheen's tint.
    MAP_SHEEN_TINT = 7;
    /// Of the tint of specular reflection.
    MAP_SPECULAR_TINT = 8;
    /// Of the share of what is specular in place of the diffuse body.
    MAP_SPECULAR_SHARE = 9;
    /// Of the flatness.
    MAP_FLATNESS = 10;
    /// Of the share of diffuse light that is transmitted.
    MAP_DIFFUSE_TRANSMISSION = 11;
    /// How many of both come first.
    MAPS_OF_PRINCIPLED = 12;
    /// Of the shading normal.
    MAP_NORMAL = 12;
    /// Of the height over the surface.
    MAP_HEIGHT = 13;
    /// Of emitted radiance.
    MAP_KE = 14;
    /// Of a blend's weight.
    MAP_WEIGHT = 15;
    /// Rows, and columns, of a table of microfacets.
    TABLE_SIZE = 32;
    /// Most blends within each other, and sides.
    MAX_BLENDS = 8;

    /// Bit of a texture's lookup: the nearest texel is taken.
    LOOKUP_NEAREST = 1;
    /// Bit of it: the image is mirrored beyond its edges.
    LOOKUP_MIRROR = 2;
    /// Bit of it: its edges go on.
    LOOKUP_CLAMP = 4;
    /// 8-byte words of an image before its texels: its size, its lookup and where its texels begin, and the transform of
    /// texture coordinates.
    IMAGE_HEADER_WORDS = 5;

    /// Light from a point, equally into all directions.
    LIGHT_POINT = 0;
    /// Light from a point into a cone, with a falloff that is linear in the angle.
    LIGHT_SPOT = 1;
    /// The same with one that is the square of what is linear in the cosine.
    LIGHT_SPOT_SQUARED = 2;
    /// Light from far away.
    LIGHT_DIRECTIONAL = 3;

    /// No environment light.
    ENVIRONMENT_BLACK = 0;
    /// The same radiance from everywhere.
    ENVIRONMENT_CONSTANT = 1;
    /// A lat-long image.
    ENVIRONMENT_LAT_LONG = 2;
    /// Any of them: the frame says which.
    ENVIRONMENT_ANY = 3;

    /// Only BSDF sampling finds light.
    INTEGRATOR_IMPLICIT = 0;
    /// Next-event estimation: a light sample at every vertex that is not all specular.
    INTEGRATOR_EXPLICIT = 1;
    /// Multiple importance sampling: BSDF and light samples, weighted by their pdfs.
    INTEGRATOR_MIS = 2;

    /// Pseudo-random numbers that are independent of each other.
    SAMPLER_INDEPENDENT = 0;
    /// Points of scrambled Sobol sequences.
    SAMPLER_SOBOL = 1;
    /// Bit of the number of a sample that is set in the second of two halves.
    SECOND_HALF_BIT = 23;

    /// `max_bounces` of an unbounded path.
    UNBOUNDED = u32::MAX;
}

/// A specialization constant, for the GLSL side. Its id is its place in [`Specialization::TABLE`].
#[derive(Debug)]
pub struct SpecializationConstant {
    /// Its name in Rust; GLSL has it in capitals.
    pub name: &'static str,
    /// `u32` or `bool`.
    pub rust_type: &'static str,
    /// The value in a module that nobody specialized; 1 for true.
    pub default: u32,
    /// What it means.
    pub meaning: &'static str,
}

/// Declares what kernels are specialized by: a struct of the values, and a table for the GLSL side.
macro_rules! specialization_constants {
    ($($(#[doc = $meaning:literal])* $name:ident: $type:ident = $default:expr;)*) => {
        /// What a render's kernels are built for: the values of all specialization constants but the vertices of a list.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub struct Specialization {
            $($(#[doc = $meaning])* pub $name: $type,)*
        }

        impl Specialization {
            /// The values of a module that nobody specialized.
            pub const DEFAULT: Self = Self { $($name: $default),* };

            /// Every constant, by id.
            pub const TABLE: &[SpecializationConstant] = &[$(SpecializationConstant {
                name: stringify!($name),
                rust_type: stringify!($type),
                default: $default as u32,
                meaning: concat!($($meaning),*),
            }),*];

            /// The values by id.
            pub fn words(&self) -> Vec<u32> {
                vec![$(u32::from(self.$name)),*]
            }
        }
    };
}

specialization_constants! {
    /// Workgroup size of every kernel but those of one thread.
    workgroup_size: u32 = 256;
    /// Entries of the traversal stack, in registers and in memory.
    stack_size: u32 = 64;
    /// Children of a BVH node: 2, 4 or 8; 1 is a list of triangles without nodes.
    bvh_width: u32 = 2;
    /// Triangles of the list.
    listed_count: u32 = 0;
    /// Whether meshes lie in their places under a tree of their own, and not as triangles in one.
    two_level: bool = false;
    /// One of `INTEGRATOR_*`.
    integrator: u32 = INTEGRATOR_EXPLICIT;
    /// One of `SAMPLER_*`.
    sampler: u32 = SAMPLER_INDEPENDENT;
    /// Whether samples are taken in two halves that are scrambled independently.
    halves: bool = false;
    /// One of `ENVIRONMENT_*`.
    environment: u32 = ENVIRONMENT_BLACK;
    /// Whether some triangle emits.
    has_lights: bool = true;
    /// Whether some material is a Phong BRDF: Lambert plus lobe.
    has_phong: bool = true;
    /// Whether the lobe of some Phong BRDF is above zero.
    has_phong_lobes: bool = true;
    /// Whether some material is a mirror.
    has_mirror: bool = true;
    /// Whether some material refracts without Fresnel split.
    has_refractive: bool = true;
    /// Whether some material is a Fresnel dielectric.
    has_dielectric: bool = true;
    /// Whether some material is a metal without microfacets.
    has_smooth_conductor: bool = true;
    /// Whether some material is a metal with microfacets.
    has_conductor: bool = true;
    /// Whether some material is a dielectric with microfacets.
    has_rough_dielectric: bool = true;
    /// Whether some material is a thin plate of a dielectric.
    has_thin_dielectric: bool = true;
    /// Whether some material is a diffuse base under a smooth coat.
    has_plastic: bool = true;
    /// Whether some material is a diffuse base under a coat with microfacets.
    has_rough_plastic: bool = true;
    /// Whether some material is glTF's mixture of metal and diffuse.
    has_metal_rough: bool = true;
    /// Whether some of those has a clear coat.
    has_coat: bool = true;
    /// Whether some material is Disney's BSDF of a body.
    has_principled: bool = true;
    /// Whether some material is Disney's BSDF of a thin sheet.
    has_principled_thin: bool = true;
    /// Whether some material is no surface.
    has_nothing: bool = true;
    /// Whether some material is a blend, or has one for each side.
    has_blends: bool = true;
    /// Whether some material is turned by the direction of its texture coordinates.
    has_anisotropy: bool = true;
    /// Whether the microfacets of some material are of Beckmann's distribution.
    has_beckmann: bool = true;
    /// Whether some material makes up for light that its microfacets scatter more than once.
    has_compensation: bool = true;
    /// Whether vertices of some triangle have colours.
    has_vertex_colours: bool = true;
    /// Whether some material has a texture of diffuse reflectance.
    has_textures: bool = true;
    /// Whether some material has a texture of another parameter.
    has_detail_textures: bool = true;
    /// Whether some texture turns shading normals.
    has_normal_textures: bool = true;
    /// Whether some texture is not bilinear and repeated as it is.
    has_lookups: bool = true;
    /// Whether some surface both emits and scatters.
    has_scattering_lights: bool = true;
    /// Whether some light is no surface.
    has_punctual_lights: bool = true;
    /// Whether the lat-long environment is turned.
    has_turned_environment: bool = true;
    /// Whether the camera is orthographic.
    has_orthographic: bool = true;
    /// Whether pixels gather light by a Gaussian, and not in a box.
    gaussian_filter: bool = false;
    /// Whether some triangle has shading normals.
    has_normals: bool = true;
    /// Whether the camera has a lens.
    has_lens: bool = true;
    /// Whether the camera is so far from the scene that its rays start nearer to it.
    has_distance: bool = true;
    /// Whether paths scatter at all: `max_bounces` is not 0.
    scatters: bool = true;
    /// Whether paths end at `max_bounces`.
    bounded: bool = true;
    /// Whether vertices may send shadow rays.
    casts_shadows: bool = true;
    /// Whether Russian roulette may end paths.
    has_roulette: bool = true;
    /// Whether Russian roulette goes by throughput.
    roulette_by_throughput: bool = false;
    /// Whether indirect light is clamped.
    clamps: bool = false;
    /// Whether what a path carries is kept in halves.
    half_state: bool = false;
    /// Whether rays leave surfaces by a fixed offset.
    fixed_offsets: bool = false;
    /// Whether a thin triangle that touches a ray's origin is checked to lie in front of it.
    checks_sides: bool = false;
    /// Steps of arithmetic added to the shading of each hit.
    shading_cost: u32 = 0;
    /// Branches that the scattering of hits is spread over, at least 1.
    material_branches: u32 = 1;
    /// Whether shade takes rays sorted by the material that they hit.
    sorted: bool = false;
    /// Whether bounce queues its shadow rays for connect.
    defers_shadow_rays: bool = true;
    /// Whether an invocation of the megakernel goes on with another path when one has ended.
    regenerates: bool = false;
}
