// Takes every path of the queue through one bounce: finds the next surface, shades it, queues the
// path if it goes on, and traces its shadow ray or queues it for connect.
// Threads: one a current ray. Reads: ray queue, path state, scene. Writes: path state, radiances,
// the next half of the ray queue, shadow rays, control.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"
#define CONTROL_ACCESS
#include "path_state.glsl"
#include "append.glsl"
#include "occlusion.glsl"
#include "cut_loops.glsl"

void main() {
    uint place = gl_GlobalInvocationID.x;
    bool live = place < control.current_rays;
    uint slot = 0u;
    Path path;
    Vertex vertex = vertex_without_scatter(vec3(0.0));
    if (live) {
        slot = current_ray(place);
        // Traversal has few registers to spare: the rest of the path is loaded after it.
        Hit hit = trace_closest(load_ray(slot));
        count_item(STAGE_EXTEND, batch.bounce);
        path = load_path(slot);
        vertex = shade_vertex(path, hit);
        count_vertex();
        count_item(STAGE_SHADE, batch.bounce);
    }

    // For the same reason the path is stored before its shadow ray is traced.
    if (SCATTERS) {
        queue_path(live && vertex.continues, slot, path);
    }

    vec3 arriving = vec3(0.0);
    if (CASTS_SHADOWS) {
        uint shadow_place;
        bool casts = live && carries_light(vertex.shadow);
        APPEND(control.next_shadow_rays, casts, shadow_place)
        if (DEFERS_SHADOW_RAYS) {
            if (casts) {
                store_shadow_ray(shadow_place, slot, vertex.shadow);
            }
        } else {
            SKIPPABLE_IF(casts) {
                if (!is_occluded(vertex.shadow)) {
                    arriving = vertex.shadow.radiance;
                }
                count_item(STAGE_CONNECT, batch.bounce);
            }
        }
    }
    if (live && (any(notEqual(vertex.emission, vec3(0.0))) || any(notEqual(arriving, vec3(0.0))))) {
        // One after the other, as the other schedulers add them.
        vec3 radiance = radiances.rgb[slot].rgb + vertex.emission;
        radiances.rgb[slot] = vec4(radiance + arriving, 0.0);
    }
    report_cut_loops();
}
