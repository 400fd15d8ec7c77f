// Shades the hit of every current ray: adds the light it found, queues its shadow ray and, where
// the path goes on, its next ray.
// Threads: one a current ray. Reads: ray queue or its sorted copy, path state, hits, scene.
// Writes: path state, radiances, shadow rays, the next half of the ray queue.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"
#define CONTROL_ACCESS
#include "path_state.glsl"
#include "append.glsl"
#include "cut_loops.glsl"
#include "work.glsl"

void main() {
    uint place = gl_GlobalInvocationID.x;
    bool live = place < control.current_rays;
    uint slot = 0u;
    Path path;
    Vertex vertex = vertex_without_scatter(vec3(0.0));
    if (live) {
        slot = SORTED ? sorted_rays.paths[place] : current_ray(place);
        path = load_path(slot);
        Hit hit = load_hit(slot);
        vertex = shade_vertex(path, hit);
        count_vertex();
        count_item(STAGE_SHADE, batch.bounce);
        if (any(notEqual(vertex.emission, vec3(0.0)))) {
            radiances.rgb[slot] += vec4(vertex.emission, 0.0);
        }
    }

    if (CASTS_SHADOWS) {
        uint shadow_place;
        bool casts = live && carries_light(vertex.shadow);
        APPEND(control.next_shadow_rays, casts, shadow_place)
        if (casts) {
            store_shadow_ray(shadow_place, slot, vertex.shadow);
        }
    }

    if (SCATTERS) {
        queue_path(live && vertex.continues, slot, path);
    }
    report_cut_loops();
}
