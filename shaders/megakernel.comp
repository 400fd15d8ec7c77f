// Follows each path of the batch from the camera to its end, its state in registers.
// Threads: one a slot. Reads: frame, scene. Writes: radiances, control.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#define CONTROL_ACCESS
#include "path_state.glsl"
#include "bvh.glsl"

layout(local_size_x_id = SPEC_WORKGROUP_SIZE) in;

void main() {
    uint slot = gl_GlobalInvocationID.x;
    bool live = slot < batch.pixel_count * batch.sample_count;
    Path path = begin_path(pixel_of(slot), sample_of(slot));
    vec3 radiance = vec3(0.0);
    uint rays = 0u;
    uint shadow_rays = 0u;
    bool continues = live;
    while (continues) {
        Hit hit = trace_closest(path.ray);
        rays += 1u;
        Vertex vertex;
        if (hit.triangle == NO_TRIANGLE) {
            vertex = shade_miss(path);
        } else {
            vertex = shade_hit(path, hit);
        }
        radiance += vertex.emission;
        bool lit = carries_light(vertex.shadow);
        // A loop of one turn at most: where no lane has a shadow ray, it is skipped.
        while (lit) {
            shadow_rays += 1u;
            if (!trace_any(vertex.shadow.ray, vertex.shadow.light, shadow_limit(vertex.shadow.light))) {
                radiance += vertex.shadow.radiance;
            }
            lit = false;
        }
        continues = vertex.continues;
    }
    if (live) {
        radiances.rgb[slot] = vec4(radiance, 0.0);
        // The camera ray is counted by the host.
        atomicAdd(control.next_rays, rays - 1u);
        atomicAdd(control.next_shadow_rays, shadow_rays);
    }

    // Where a driver leaves all loops after so many turns, it leaves this one too early. The sum
    // tells: compilers take a loop's own condition to hold when it ends.
    uint turns = (frame.width & 1u) + 2u;
    uint sum = 0u;
    for (uint turn = 1u; turn <= turns; turn++) {
        sum += turn;
    }
    if (sum != turns * (turns + 1u) / 2u) {
        control.cut_loops = 1u;
    }
}
