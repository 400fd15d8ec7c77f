// Turns what was appended into what is read next, and writes the indirect dispatch arguments.
// Threads: one. Reads and writes: control.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#define CONTROL_ACCESS
#include "bindings_path.glsl"

layout(constant_id = SPEC_WORKGROUP_SIZE) const uint WORKGROUP_SIZE = 256u;
layout(local_size_x = 1) in;

uint groups(uint count) { return (count + WORKGROUP_SIZE - 1u) / WORKGROUP_SIZE; }

void main() {
    uint rays = control.next_rays;
    uint shadow_rays = control.next_shadow_rays;
    control.current_rays = rays;
    control.current_shadow_rays = shadow_rays;
    control.next_rays = 0u;
    control.next_shadow_rays = 0u;
    control.ray_groups[0] = groups(rays);
    control.shadow_groups[0] = groups(shadow_rays);

    // The first call of a batch finds its camera rays.
    uint carry;
    if (batch.bounce > 0u) {
        control.bounce_rays[0] = uaddCarry(control.bounce_rays[0], rays, carry);
        control.bounce_rays[1] += carry;
    }
    control.shadow_rays[0] = uaddCarry(control.shadow_rays[0], shadow_rays, carry);
    control.shadow_rays[1] += carry;
}
