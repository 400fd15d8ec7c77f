//! The one home of structs that the GPU sees. A test compares them with the SPIR-V.
//!
//! Scene records are read as 16-byte (or 8-byte) texels of bits, so their fields are arranged by texel; in GLSL only
//! `records.glsl` reads them. Lengths are in normalised units (the scene's bounds fit [-1, 1]³), radiance is the scene's
//! times `PreparedScene::radiance_scale`.

use bytemuck::{Pod, Zeroable};

use crate::constants::{MATERIAL_BINS, TRACED_SAMPLES};

/// What is uniform over a render. 188 bytes of a std140 block.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[allow(missing_docs, reason = "each field is described at its GLSL twin")]
pub struct Frame {
    pub camera_eye: [f32; 3],
    pub lens_radius: f32,
    pub camera_right: [f32; 3],
    pub focus_distance: f32,
    pub camera_up: [f32; 3],
    pub roulette: f32,
    pub camera_forward: [f32; 3],
    pub max_bounces: u32,
    pub environment_radiance: [f32; 3],
    pub seed: u32,
    pub environment_x: [f32; 3],
    pub punctual_count: u32,
    pub environment_y: [f32; 3],
    pub punctual_probability: f32,
    pub environment_z: [f32; 3],
    pub width: u32,
    pub height: u32,
    pub light_count: u32,
    pub sky_probability: f32,
    pub environment_width: u32,
    pub environment_height: u32,
    pub path_capacity: u32,
    pub environment: u32,
    pub radiance_clamp: f32,
    pub roulette_from: u32,
    pub camera_distance: f32,
    pub is_orthographic: u32,
    pub height_scale: f32,
}

/// Inner BVH node: the boxes and references of its two children. 64 bytes, 4 texels.
///
/// A reference with `LEAF_BIT` is a leaf: 4 bits of triangle count, 27 bits of first triangle.
/// Without it, it is the index of a node. A child that is not there is a leaf of no triangles
/// in a box far away: an inverted box could be entered by a test that sorts its planes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Node {
    /// Lower corner of the left child's box.
    pub left_low: [f32; 3],
    /// Reference to the left child.
    pub left: u32,
    /// Upper corner of the left child's box.
    pub left_high: [f32; 3],
    /// Not used.
    pub unused0: u32,
    /// Lower corner of the right child's box.
    pub right_low: [f32; 3],
    /// Reference to the right child.
    pub right: u32,
    /// Upper corner of the right child's box.
    pub right_high: [f32; 3],
    /// Not used.
    pub unused1: u32,
}

/// Triangle in leaf order. 48 bytes, 3 texels.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Triangle {
    /// First vertex.
    pub v0: [f32; 3],
    /// Index of the triangle in the scene's order.
    pub original: u32,
    /// Second vertex.
    pub v1: [f32; 3],
    /// Index of the material.
    pub material: u32,
    /// Third vertex.
    pub v2: [f32; 3],
    /// Its area over the probability that a light sample among area lights picks it, normalised units squared; 0 where
    /// it emits nothing. Of a mesh that is placed: the bits of its number among those of the mesh that emit.
    pub light_area: f32,
}

/// A mesh in its place, of a scene whose meshes are not flattened. 160 bytes, 10 texels.
///
/// Its vertices are those of the mesh, v, taken to normalised space as ((x_axis v.x + y_axis v.y) + z_axis v.z) +
/// translation, each operation rounded by itself: on the host and in kernels, so that a mesh that is flattened has the
/// same.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Instance {
    /// Where the mesh's x axis goes.
    pub x_axis: [f32; 3],
    /// Index of the root of the mesh's tree.
    pub root: u32,
    /// Where its y axis goes.
    pub y_axis: [f32; 3],
    /// 1 where the second and third corners of its triangles change places, else 0.
    pub is_mirrored: u32,
    /// Where its z axis goes.
    pub z_axis: [f32; 3],
    /// Index of the first of its lights.
    pub first_light: u32,
    /// Where its origin goes.
    pub translation: [f32; 3],
    /// Not used.
    pub unused: u32,
    /// Columns of the inverse of the three axes, and how far boxes are widened along the mesh's axes for what roundings do,
    /// but for those of the way from a ray's origin.
    pub inverse: [[f32; 4]; 3],
    /// Columns of what takes normals along, to any length; the fourth components are not used.
    pub of_normals: [[f32; 4]; 3],
}

impl Instance {
    /// A mesh of the world itself.
    pub const WORLD: Self = Self {
        x_axis: [1.0, 0.0, 0.0],
        root: 0,
        y_axis: [0.0, 1.0, 0.0],
        is_mirrored: 0,
        z_axis: [0.0, 0.0, 1.0],
        first_light: 0,
        translation: [0.0; 3],
        unused: 0,
        inverse: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        of_normals: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    };

    /// A vertex of the mesh in normalised space.
    pub fn place(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|i| ((self.x_axis[i] * x + self.y_axis[i] * y) + self.z_axis[i] * z) + self.translation[i])
    }

    /// The corners of a triangle of the mesh in normalised space, in their order there.
    pub fn place_corners<T: Copy>(&self, corners: [T; 3], place: impl Fn(T) -> T) -> [T; 3] {
        let [a, b, c] = corners.map(place);
        if self.is_mirrored == 0 { [a, b, c] } else { [a, c, b] }
    }
}

/// Material. 64 bytes, 4 texels.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Material {
    /// Lambert reflectance, [0, 1].
    pub kd: [f32; 3],
    /// One of `SURFACE_*`.
    pub surface: u32,
    /// Phong lobe weight or mirror reflectance, [0, 1].
    pub ks: [f32; 3],
    /// Phong exponent, at least 0.
    pub ns: f32,
    /// Emitted radiance, at least 0.
    pub ke: [f32; 3],
    /// Index of refraction inside, above 0.
    pub ni: f32,
    /// Tint of transmitted light, at least 0.
    pub tf: [f32; 3],
    /// One more than the place of the image that replaces `kd` in the texture buffer; 0 for none.
    pub map_kd: u32,
}

/// What else a material may have. 176 bytes, 11 texels.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct MaterialDetail {
    /// Real part of a metal's index of refraction, at least 0.
    pub eta: [f32; 3],
    /// Width of the microfacets' distribution along the tangent.
    pub alpha_x: f32,
    /// Imaginary part of a metal's index of refraction, at least 0.
    pub absorption: [f32; 3],
    /// Width of the microfacets' distribution across the tangent.
    pub alpha_y: f32,
    /// Share of metal, [0, 1].
    pub metalness: f32,
    /// Share of the clear coat, [0, 1].
    pub coat: f32,
    /// Width of the distribution of the coat's microfacets.
    pub coat_alpha: f32,
    /// Share of the first part of a blend, [0, 1].
    pub weight: f32,
    /// One more than the place of the image that gives each in the texture buffer; 0 for none.
    pub map_ks: u32,
    /// Of `alpha_x`.
    pub map_alpha_x: u32,
    /// Of `alpha_y`.
    pub map_alpha_y: u32,
    /// Of `metalness`.
    pub map_metalness: u32,
    /// Of `coat`.
    pub map_coat: u32,
    /// Of `anisotropy`.
    pub map_anisotropy: u32,
    /// Of `sheen`.
    pub map_sheen: u32,
    /// Of `sheen_tint`.
    pub map_sheen_tint: u32,
    /// Of `specular_tint`.
    pub map_specular_tint: u32,
    /// Of `specular_share`.
    pub map_specular_share: u32,
    /// Of `flatness`.
    pub map_flatness: u32,
    /// Of `diffuse_transmission`.
    pub map_diffuse_transmission: u32,
    /// Of the shading normal.
    pub map_normal: u32,
    /// Of height over the surface.
    pub map_height: u32,
    /// Of `ke`.
    pub map_ke: u32,
    /// Of `weight`.
    pub map_weight: u32,
    /// Index of the first part of a blend, or of the front.
    pub first: u32,
    /// Index of its second part, or of the back.
    pub second: u32,
    /// Bits of `DETAIL_*`.
    pub flags: u32,
    /// Share of diffuse light that the inside of a coat reflects.
    pub inner_reflectance: f32,
    /// Mean of the reflectance at the microfacets, weighted by the cosine.
    pub mean_reflectance: [f32; 3],
    /// One more than the place of the table of its microfacets in the texture buffer; 0 for none.
    pub table: u32,
    /// Of principled materials, from here on, each in [0, 1]: how far apart the widths of microfacets are.
    pub anisotropy: f32,
    /// Weight of the sheen.
    pub sheen: f32,
    /// How far the base colour tints the sheen.
    pub sheen_tint: f32,
    /// How far the base colour tints what a dielectric reflects.
    pub specular_tint: f32,
    /// Share of what is specular in place of the diffuse body.
    pub specular_share: f32,
    /// Share of diffuse light that seems to come from below the surface.
    pub flatness: f32,
    /// Share of diffuse light that is transmitted.
    pub diffuse_transmission: f32,
    /// Not used.
    pub unused: u32,
}

/// Light that is no surface, a cell of an alias table. 64 bytes, 4 texels.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct PunctualLight {
    /// Position; means nothing of a directional light.
    pub position: [f32; 3],
    /// One of `LIGHT_*`.
    pub kind: u32,
    /// Where the light goes, unit; means nothing of a point.
    pub direction: [f32; 3],
    /// Probability that light sampling of these lights picks the cell itself and not its alias.
    pub threshold: f32,
    /// Power per solid angle, or irradiance, over the probability of its pick.
    pub emission: [f32; 3],
    /// The light that the cell stands for otherwise.
    pub alias: u32,
    /// Of a spot: the angle from its axis, or the cosine, up to which its intensity is whole.
    pub full_from: f32,
    /// And from which it is 0.
    pub none_from: f32,
    /// Not used.
    pub unused: [u32; 2],
}

/// Emissive triangle, a cell of the alias table. 16 bytes, 1 texel.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Light {
    /// Place of the triangle in leaf order; of a mesh that is placed, [`PlacedLight`] has the rest.
    pub triangle: u32,
    /// Probability that the cell stands for itself, [0, 1].
    pub threshold: f32,
    /// The light that it stands for otherwise.
    pub alias: u32,
    /// Not used.
    pub unused: u32,
}

/// What else an emissive triangle has where meshes are placed. 8 bytes, 1 texel.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct PlacedLight {
    /// Index of the mesh in its place.
    pub instance: u32,
    /// Area of the triangle over the probability that a light sample among area lights picks it, normalised units squared.
    pub light_area: f32,
}

/// Shading normals of a triangle, in the scene's order. 16 bytes, 1 texel.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Normals {
    /// Octahedral unit vectors, two 16-bit signed fractions each.
    pub corners: [u32; 3],
    /// 1 where the triangle has shading normals, 0 where it is flat.
    pub present: u32,
}

/// Texel of the lat-long environment. 16 bytes, 1 texel.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct EnvironmentTexel {
    /// Radiance at the texel's centre.
    pub radiance: [f32; 3],
    /// Probability that light sampling picks the texel.
    pub probability: f32,
}

/// Four quarters of a block of the lat-long environment, as light sampling chooses between them. 16 bytes, 1 texel.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct EnvironmentSplit {
    /// Probability of the upper half, [0, 1].
    pub upper: f32,
    /// Probability of the left quarter within the upper half, and within the lower half.
    pub left: [f32; 2],
    /// Not used.
    pub unused: u32,
}

/// Counts and arguments that stay on the device between kernels. 176 bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct Control {
    /// Rays that extend and shade read.
    pub current_rays: u32,
    /// Rays that generate and shade appended.
    pub next_rays: u32,
    /// Shadow rays that connect reads.
    pub current_shadow_rays: u32,
    /// Shadow rays that shade appended.
    pub next_shadow_rays: u32,
    /// Indirect arguments of extend and shade.
    pub ray_groups: [u32; 3],
    /// Indirect arguments of connect.
    pub shadow_groups: [u32; 3],
    /// Samples that were NaN or infinite and were left out of the film.
    pub nonfinite_samples: u32,
    /// 1 if the driver left a loop before its end.
    pub cut_loops: u32,
    /// Pixel, in rows from the top left, and number of the first samples that were left out.
    pub traced_samples: [[u32; 2]; TRACED_SAMPLES as usize],
}

/// Rays of a bounce, traced so far: low and high halves. 16 bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct RayCount {
    /// Rays that extend traced.
    pub rays: [u32; 2],
    /// Rays that connect traced.
    pub shadow_rays: [u32; 2],
}

impl RayCount {
    /// Rays to the next surface.
    pub fn rays(&self) -> u64 {
        wide(self.rays)
    }

    /// Rays to a light.
    pub fn shadow_rays(&self) -> u64 {
        wide(self.shadow_rays)
    }

    /// These rays and others.
    pub fn plus(&self, other: &Self) -> Self {
        Self { rays: sum(self.rays, other.rays), shadow_rays: sum(self.shadow_rays, other.shadow_rays) }
    }
}

/// Work of a stage at one bounce, summed over its items: low and high halves. 32 bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct WorkCount {
    /// Rays traced, or vertices shaded.
    pub items: [u32; 2],
    /// Nodes visited.
    pub nodes: [u32; 2],
    /// Triangles tested.
    pub triangles: [u32; 2],
    /// Node visits, triangle tests and shadings, each counted once for the active lanes of a subgroup; 0 where the
    /// device has no ballots.
    pub steps: [u32; 2],
}

impl WorkCount {
    /// This work and other work.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            items: sum(self.items, other.items),
            nodes: sum(self.nodes, other.nodes),
            triangles: sum(self.triangles, other.triangles),
            steps: sum(self.steps, other.steps),
        }
    }

    /// Rays traced, or vertices shaded.
    pub fn items(&self) -> u64 {
        wide(self.items)
    }

    /// Nodes visited.
    pub fn nodes(&self) -> u64 {
        wide(self.nodes)
    }

    /// Triangles tested.
    pub fn triangles(&self) -> u64 {
        wide(self.triangles)
    }

    /// Steps of subgroups.
    pub fn steps(&self) -> u64 {
        wide(self.steps)
    }
}

/// Bins that rays are sorted into. 1024 bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub struct Bins {
    /// Rays of each bin.
    pub counts: [u32; MATERIAL_BINS as usize],
    /// Where the next ray of each bin goes.
    pub places: [u32; MATERIAL_BINS as usize],
}

/// A sum of numbers by their low and high halves.
fn sum(a: [u32; 2], b: [u32; 2]) -> [u32; 2] {
    let sum = wide(a) + wide(b);
    [sum as u32, (sum >> 32) as u32]
}

fn wide([low, high]: [u32; 2]) -> u64 {
    u64::from(high) << 32 | u64::from(low)
}

/// Sums over the samples of a pixel; each is value + compensation. 64 bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct FilmPixel {
    /// Sum of radiance, RGB and an unused lane.
    pub sum: [f32; 4],
    /// What rounding took from `sum`.
    pub sum_compensation: [f32; 4],
    /// Sum of squared radiance.
    pub squares: [f32; 4],
    /// What rounding took from `squares`.
    pub squares_compensation: [f32; 4],
}

/// Push constants: the samples in flight. Slots run over the samples of a pixel first, then over pixels.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct Batch {
    /// First pixel, in rows from the top left.
    pub first_pixel: u32,
    /// Pixels in the batch.
    pub pixel_count: u32,
    /// Number of the first sample of each pixel.
    pub first_sample: u32,
    /// Samples of each pixel in the batch.
    pub sample_count: u32,
    /// Scattering events that the paths have had.
    pub bounce: u32,
    /// Place of the first pixel in the film, which holds a tile of the image.
    pub film_pixel: u32,
    /// Where the radiances of the megakernel's paths begin: several launches fill what one resolve takes.
    pub first_slot: u32,
}
