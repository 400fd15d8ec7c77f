// Set 0: what does not change during a render. Read-only for every kernel.
//
// Each scene buffer is an array of 16-byte (textures, texture_coordinates, vertex_colours, placed_lights: 8-byte) words of bits.
// It is a storage buffer or, where the host makes it one, a uniform texel buffer: software devices read those faster,
// devices with few texels have larger storage buffers.
#ifndef BINDINGS_SCENE_GLSL
#define BINDINGS_SCENE_GLSL

// Uniform over a render. Lengths are in normalised units, radiance is the scene's times its radiance_scale.
layout(set = 0, binding = 0, std140) uniform Frame {
    vec3 camera_eye;            // or, of a camera far away, the point of its view axis where rays start
    float lens_radius;
    vec3 camera_right;          // from the image centre to its right edge, at distance 1
    float focus_distance;       // along the view axis
    vec3 camera_up;             // from the image centre to its top edge, at distance 1
    float roulette;             // q, the probability that constant Russian roulette ends a path
    vec3 camera_forward;        // unit
    uint max_bounces;           // or UNBOUNDED
    vec3 environment_radiance;  // of a constant environment
    uint seed;
    vec3 environment_x;         // axes of the lat-long image in the world, unit
    uint punctual_count;        // lights that are no surfaces
    vec3 environment_y;
    float punctual_probability; // with which a light sample goes to them
    vec3 environment_z;
    uint width;                 // pixels
    uint height;
    uint light_count;
    float sky_probability;      // with which a light sample goes to the environment
    uint environment_width;     // texels
    uint environment_height;
    uint path_capacity;         // path slots, and entries of each half of the ray queue
    uint environment;           // one of ENVIRONMENT_BLACK, _CONSTANT, _LAT_LONG
    float radiance_clamp;       // the most that one vertex adds of indirect light
    uint roulette_from;         // first vertex with Russian roulette by throughput
    float camera_distance;      // from the pinhole to camera_eye, along the view axis; 0 unless the scene is far
    uint is_orthographic;       // 1 where all rays go forward, from camera_eye and what lies across
    float height_scale;         // normalised lengths of a unit of height
} frame;

#define SCENE_BUFFER(BINDING, NAME, WORD) \
    layout(set = 0, binding = BINDING, std430) readonly buffer Buffer_##NAME { WORD words[]; } NAME; \
    WORD fetch_##NAME(uint index) { return NAME.words[index]; }

// Read through records.glsl only.
SCENE_BUFFER(1, nodes, uvec4)                  // NODE_TEXELS a node
SCENE_BUFFER(2, triangles, uvec4)              // TRIANGLE_TEXELS a triangle, in leaf order
SCENE_BUFFER(3, materials, uvec4)              // MATERIAL_TEXELS a material
SCENE_BUFFER(4, lights, uvec4)                 // triangle, alias threshold, alias, unused
SCENE_BUFFER(12, instances, uvec4)             // INSTANCE_TEXELS a mesh in its place
SCENE_BUFFER(13, placed_lights, uvec2)         // of a light: instance, area over probability
SCENE_BUFFER(5, normals, uvec4)                // three octahedral normals, 1 if there are any
SCENE_BUFFER(6, texture_coordinates, uvec2)    // three a triangle
SCENE_BUFFER(14, vertex_colours, uvec2)        // three a triangle: linear RGB as halves, and whether there are any
SCENE_BUFFER(7, textures, uvec2)               // per image its header, then linear RGB as halves; tables
SCENE_BUFFER(8, environment, uvec4)            // radiance, probability of the texel
SCENE_BUFFER(9, environment_splits, uvec4)     // probability of a block's upper half; of the left in each half; unused
SCENE_BUFFER(10, material_details, uvec4)      // MATERIAL_DETAIL_TEXELS a material, if some have details
SCENE_BUFFER(11, punctual_lights, uvec4)       // PUNCTUAL_LIGHT_TEXELS a light

#endif
