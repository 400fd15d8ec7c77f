// Finds the nearest hit of every current ray.
// Threads: one a current ray. Reads: ray queue, rays, scene. Writes: hits, control.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"
#define CONTROL_ACCESS
#include "path_state.glsl"
#include "bvh.glsl"
#include "cut_loops.glsl"

void main() {
    uint place = gl_GlobalInvocationID.x;
    if (place < control.current_rays) {
        uint slot = current_ray(place);
        store_hit(slot, trace_closest(load_ray(slot)));
        count_item(STAGE_EXTEND, batch.bounce);
    }
    report_cut_loops();
}
