// Rays from within a closed body at its vertices, edges and faces: each finds a triangle.
// Threads: one for sample_count rays. Reads: scene. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"
#include "bvh.glsl"

// Rays that find none, the complement of the first of them, then the hits of the first rays, as many as there is room.
layout(set = 2, binding = 1, std430) buffer Answers {
    uint lost;
    uint example;
    uint unused[2];
    uvec4 hits[];
} answers;

const float STEP = 5.9604645e-8;

// A ray from near the middle, all of whose arithmetic the host repeats.
Ray ray_of(uint number, uint triangle_count) {
    uvec4 a = words_of(number, 0u);
    uvec4 b = words_of(number, 1u);
    Triangle t = fetch_triangle(a.x % triangle_count);
    vec3 origin = 0.2 * (vec3(b.xyz >> 8u) * STEP - 0.5);
    float along = float(a.y >> 8u) * STEP;
    vec3 target = t.v0;
    if ((number & 3u) == 1u) {
        target = t.v0 + along * (t.v1 - t.v0);
    } else if ((number & 3u) == 2u) {
        target = t.v1 + along * (t.v2 - t.v1);
        target = target + float(a.z >> 8u) * STEP * (t.v0 - target);
    } else if ((number & 3u) == 3u) {
        // From the very middle, which lies in planes of symmetry.
        origin = vec3(0.0);
        target = (number & 4u) == 0u ? t.v0 : 0.5 * (t.v0 + t.v1);
    }
    return Ray(origin, target - origin, no_primitive());
}

void main() {
    uint invocation = gl_GlobalInvocationID.x;
    if (invocation < batch.pixel_count) {
        for (uint i = 0u; i < batch.sample_count; i++) {
            // Neighbours take neighbouring rays.
            uint number = i * batch.pixel_count + invocation;
            Hit hit = trace_closest(ray_of(number, batch.first_pixel));
            if (is_none(hit.primitive)) {
                atomicAdd(answers.lost, 1u);
                atomicMax(answers.example, ~number);
            }
            if (number < batch.first_sample) {
                answers.hits[number] = uvec4(hit.primitive.triangle, floatBitsToUint(hit.barycentrics), floatBitsToUint(hit.distance));
            }
        }
    }
}
