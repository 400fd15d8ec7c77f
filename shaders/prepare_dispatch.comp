// Turns what was appended into what is read next, and writes the indirect dispatch arguments.
// Threads: one. Reads and writes: control, ray counts.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#define CONTROL_ACCESS
#include "bindings_path.glsl"
#include "specialization.glsl"

layout(constant_id = WORKGROUP_SIZE_ID) const uint WORKGROUP_SIZE = 256u;
layout(local_size_x = 1) in;

uint groups(uint count) { return (count + WORKGROUP_SIZE - 1u) / WORKGROUP_SIZE; }

// Adds to a sum of two words.
#define ADD_WIDE(TOTAL, MORE) { uint carry; TOTAL[0] = uaddCarry(TOTAL[0], MORE, carry); TOTAL[1] += carry; }

void main() {
    uint rays = control.next_rays;
    control.current_rays = rays;
    control.next_rays = 0u;
    control.ray_groups[0] = groups(rays);
    ADD_WIDE(ray_counts.bounces[min(batch.bounce, COUNTED_BOUNCES - 1u)].rays, rays)

    if (CASTS_SHADOWS) {
        uint shadow_rays = control.next_shadow_rays;
        control.current_shadow_rays = shadow_rays;
        control.next_shadow_rays = 0u;
        control.shadow_groups[0] = groups(shadow_rays);
        // They belong to the bounce that appended them.
        ADD_WIDE(ray_counts.bounces[min(max(batch.bounce, 1u) - 1u, COUNTED_BOUNCES - 1u)].shadow_rays, shadow_rays)
    }
}
