// Follows each path of the batch from the camera to its end, its state in registers.
// Threads: one a slot. Reads: frame, scene. Writes: radiances, control.
#version 460
#extension GL_GOOGLE_include_directive : require
#ifdef SUBGROUP_BALLOT
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_ballot : require
#endif
#include "workgroup.glsl"
#define CONTROL_ACCESS
#include "path_state.glsl"
#include "bvh.glsl"
#include "cut_loops.glsl"

void main() {
    uint slots = batch.pixel_count * batch.sample_count;
    uint slot = gl_GlobalInvocationID.x;
    Path path = kept(begin_path(pixel_of(slot), sample_of(slot)));
    vec3 radiance = vec3(0.0);
    uint bounce_rays = 0u;
    uint shadow_rays = 0u;
    bool live = slot < slots;
    while (live) {
        Hit hit = trace_closest(path.ray);
        // The camera's rays are counted by the host.
        bounce_rays += path.bounce > 0u ? 1u : 0u;
        count_item(STAGE_EXTEND, path.bounce);
        uint bounce = path.bounce;
        Vertex vertex = shade_vertex(path, hit);
        path = kept(path);
        count_vertex();
        count_item(STAGE_SHADE, bounce);
        radiance += vertex.emission;
        bool lit = carries_light(vertex.shadow);
        // A loop of one turn at most: where no lane has a shadow ray, it is skipped.
        while (lit) {
            shadow_rays += 1u;
            if (!trace_any(vertex.shadow.ray, vertex.shadow.light, shadow_limit(vertex.shadow.light))) {
                radiance += vertex.shadow.radiance;
            }
            count_item(STAGE_CONNECT, bounce);
            lit = false;
        }
        bool ends = !vertex.continues;
        while (ends) {
            radiances.rgb[batch.first_slot + slot] = vec4(radiance, 0.0);
            live = false;
            // Take the next path at once rather than wait for the subgroup's longest. Its slot is
            // known beforehand: a shared counter would let the workgroups that a device runs first
            // take all paths.
            if (REGENERATES) {
                slot += gl_WorkGroupSize.x * gl_NumWorkGroups.x;
                live = slot < slots;
                path = kept(begin_path(pixel_of(slot), sample_of(slot)));
                radiance = vec3(0.0);
            }
            ends = false;
        }
    }
    atomicAdd(control.next_rays, bounce_rays);
    atomicAdd(control.next_shadow_rays, shadow_rays);
    tell_cut_loops();
}
