// Follows each path of the batch from the camera to its end, its state in registers.
// Threads: one a slot. Reads: frame, scene. Writes: radiances, control.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"
#define CONTROL_ACCESS
#include "path_state.glsl"
#include "occlusion.glsl"
#include "cut_loops.glsl"

void main() {
    uint slots = batch.pixel_count * batch.sample_count;
    uint slot = gl_GlobalInvocationID.x;
    Path path = rounded_path(begin_path(pixel_of(slot), sample_of(slot)));
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
        path = rounded_path(path);
        count_vertex();
        count_item(STAGE_SHADE, bounce);
        radiance += vertex.emission;
        SKIPPABLE_IF(carries_light(vertex.shadow)) {
            shadow_rays += 1u;
            if (!is_occluded(vertex.shadow)) {
                radiance += vertex.shadow.radiance;
            }
            count_item(STAGE_CONNECT, bounce);
        }
        SKIPPABLE_IF(!vertex.continues) {
            radiances.rgb[batch.first_slot + slot] = vec4(radiance, 0.0);
            live = false;
            // Path regeneration: begin the next path rather than wait for the subgroup's longest. (Novak, Havran and
            // Dachsbacher 2010) Its slot is known beforehand: with a shared counter the workgroups that a device runs
            // first would take all paths.
            if (REGENERATES) {
                slot += gl_WorkGroupSize.x * gl_NumWorkGroups.x;
                live = slot < slots;
                path = rounded_path(begin_path(pixel_of(slot), sample_of(slot)));
                radiance = vec3(0.0);
            }
        }
    }
    atomicAdd(control.next_rays, bounce_rays);
    atomicAdd(control.next_shadow_rays, shadow_rays);
    report_cut_loops();
}
