// Takes every path of the queue through one bounce: finds the next surface, shades it, gathers its
// light, and queues the path if it goes on. Bounce 0 begins the paths.
// Threads: one a current ray; at bounce 0, one a slot. Reads: frame, ray queue, path state, scene.
// Writes: path state, radiances, the next half of the ray queue, control.
#version 460
#extension GL_GOOGLE_include_directive : require
#ifdef SUBGROUP_BALLOT
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_ballot : require
#endif
#include "constants.glsl"
#define CONTROL_ACCESS
#include "path_state.glsl"
#include "append.glsl"
#include "bvh.glsl"
#include "cut_loops.glsl"

layout(local_size_x_id = SPEC_WORKGROUP_SIZE) in;

void main() {
    bool first = batch.bounce == 0u;
    uint slot = gl_GlobalInvocationID.x;
    bool live = slot < (first ? batch.pixel_count * batch.sample_count : control.current_rays);
    Path path;
    // Loops of one turn at most: devices that run both sides of an `if` skip them.
    bool begins = live && first;
    while (begins) {
        path = begin_path(pixel_of(slot), sample_of(slot));
        begins = false;
    }
    bool resumes = live && !first;
    while (resumes) {
        slot = current_ray(slot);
        path = load_path(slot);
        resumes = false;
    }

    Vertex vertex = ended(vec3(0.0));
    if (live) {
        Hit hit = trace_closest(path.ray);
        count_item(STAGE_EXTEND, batch.bounce);
        if (hit.triangle == NO_TRIANGLE) {
            vertex = shade_miss(path);
        } else {
            vertex = shade_hit(path, hit);
        }
        count_vertex();
        count_item(STAGE_SHADE, batch.bounce);
    }

    bool casts = live && carries_light(vertex.shadow);
    COUNT(control.next_shadow_rays, casts)
    vec3 gathered = vec3(0.0);
    while (casts) {
        if (!trace_any(vertex.shadow.ray, vertex.shadow.light, shadow_limit(vertex.shadow.light))) {
            gathered = vertex.shadow.radiance;
        }
        count_item(STAGE_CONNECT, batch.bounce);
        casts = false;
    }
    // In the order of the other schedulers: what the path found, then what the shadow ray brings.
    bool gains = live && (first || any(notEqual(vertex.emission, vec3(0.0))) || any(notEqual(gathered, vec3(0.0))));
    while (gains) {
        vec3 radiance = first ? vec3(0.0) : radiances.rgb[slot].rgb;
        radiance += vertex.emission;
        radiances.rgb[slot] = vec4(radiance + gathered, 0.0);
        gains = false;
    }

    uint next_place;
    bool continues = live && vertex.continues;
    APPEND(control.next_rays, continues, next_place)
    if (continues) {
        store_path(slot, path);
        ray_queue.paths[((batch.bounce + 1u) & 1u) * frame.path_capacity + next_place] = slot;
    }
    tell_cut_loops();
}
