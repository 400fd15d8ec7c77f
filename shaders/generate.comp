// Starts a path in every slot of the batch and queues it.
// Threads: one a slot. Reads: frame. Writes: path state, radiances, the next half of the ray queue.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"
#define CONTROL_ACCESS
#include "path_state.glsl"

void main() {
    uint slot = gl_GlobalInvocationID.x;
    uint count = batch.pixel_count * batch.sample_count;
    if (slot == 0u) {
        control.next_rays = count;
    }
    if (slot < count) {
        Path path = begin_path(pixel_of(slot), sample_of(slot));
        store_path(slot, path);
        radiances.rgb[slot] = vec4(0.0);
        // Bounce 0 reads this half.
        ray_queue.paths[slot] = slot;
    }
}
