// Copies the current rays in the order of their bins. The order within a bin is left to chance.
// Threads: one a current ray. Reads: ray queue, hits, scene. Writes: bins, sorted rays.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"
#include "material_bin.glsl"

void main() {
    uint place = gl_GlobalInvocationID.x;
    if (place < control.current_rays) {
        uint slot = current_ray(place);
        sorted_rays.paths[atomicAdd(bins.places[material_bin(load_hit(slot))], 1u)] = slot;
    }
}
