// Counts the current rays of each bin.
// Threads: one a current ray. Reads: ray queue, hits, scene. Writes: bins.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"
#include "material_bin.glsl"

void main() {
    uint place = gl_GlobalInvocationID.x;
    if (place < control.current_rays) {
        atomicAdd(bins.counts[material_bin(load_hit(current_ray(place)))], 1u);
    }
}
