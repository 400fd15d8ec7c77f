// Set 1: the state of the paths in flight, the queues between kernels, and the film.
//
// Path state is indexed by path slot, shadow rays by their place in the shadow queue. Words are
// bits, so that indices and floats can share a load.
#ifndef BINDINGS_PATH_GLSL
#define BINDINGS_PATH_GLSL

#ifndef CONTROL_ACCESS
#define CONTROL_ACCESS readonly
#endif

// Counts of the queues, and arguments of the indirect dispatches.
layout(set = 1, binding = 0, std430) CONTROL_ACCESS buffer Control {
    uint current_rays;          // what extend and shade read
    uint next_rays;             // what generate and shade append to
    uint current_shadow_rays;   // what connect reads
    uint next_shadow_rays;      // what shade appends to
    uint ray_groups[3];         // workgroups of extend and shade
    uint shadow_groups[3];      // workgroups of connect
    uint nonfinite_samples;     // left out of the film
    uint cut_loops;             // 1 if the driver left a loop before its end
    uvec2 traced_samples[TRACED_SAMPLES];  // pixel and number of samples that were left out
} control;

// Rays traced so far, by bounce: low and high half.
struct RayCount {
    uint rays[2];
    uint shadow_rays[2];
};

layout(set = 1, binding = 1, std430) buffer RayQueue { uint paths[]; } ray_queue;  // two halves
layout(set = 1, binding = 2, std430) buffer RayOrigins { uvec4 words[]; } ray_origins;        // origin, primitive that the ray leaves
layout(set = 1, binding = 3, std430) buffer RayDirections { uvec4 words[]; } ray_directions;  // direction, sees_emission or with MIS pdf; with HALF_STATE as pack_path has it
layout(set = 1, binding = 4, std430) buffer Throughputs { vec4 rgba[]; } throughputs;            // throughput, with MIS sky_pdf
layout(set = 1, binding = 5, std430) buffer Radiances { vec4 rgb[]; } radiances;
layout(set = 1, binding = 6, std430) buffer Hits { uvec4 words[]; } hits;                     // primitive, barycentrics, distance
layout(set = 1, binding = 7, std430) buffer ShadowOrigins { uvec4 words[]; } shadow_origins;        // origin, primitive that the ray leaves
layout(set = 1, binding = 8, std430) buffer ShadowDirections { uvec4 words[]; } shadow_directions;  // direction, primitive that it aims at
layout(set = 1, binding = 9, std430) buffer ShadowRadiances { uvec4 words[]; } shadow_radiances;    // radiance, path slot

// Compensated sums over the samples of a pixel: value = sum + compensation.
struct FilmPixel {
    vec4 sum;
    vec4 sum_compensation;
    vec4 squares;
    vec4 squares_compensation;
};
layout(set = 1, binding = 10, std430) buffer Film { FilmPixel pixels[]; } film;
layout(set = 1, binding = 12, std430) buffer RayCounts { RayCount bounces[]; } ray_counts;  // COUNTED_BOUNCES

layout(set = 1, binding = 14, std430) buffer SortedRays { uint paths[]; } sorted_rays;  // the current rays by bin
layout(set = 1, binding = 15, std430) buffer Bins {
    uint counts[MATERIAL_BINS];  // rays of each bin
    uint places[MATERIAL_BINS];  // where the next ray of each bin goes
} bins;

// With TWO_LEVEL, the instances of primitives whose triangles stand elsewhere.
layout(set = 1, binding = 16, std430) buffer RayInstances { uint words[]; } ray_instances;        // that the ray leaves
layout(set = 1, binding = 17, std430) buffer HitInstances { uint words[]; } hit_instances;
layout(set = 1, binding = 18, std430) buffer ShadowInstances { uvec2 words[]; } shadow_instances;  // that the ray leaves, that it aims at

// The batch of samples in flight: slots run over the samples of a pixel first, then over pixels.
layout(push_constant) uniform Batch {
    uint first_pixel;
    uint pixel_count;
    uint first_sample;
    uint sample_count;
    uint bounce;
    uint film_pixel;  // place of the first pixel in the film, which holds a tile of the image
    uint first_slot;  // where the radiances of the megakernel's paths begin: several launches fill what one resolve takes
} batch;

#endif
