// Adds the light of every shadow ray that is not occluded. A path has one shadow ray a bounce, so
// no two invocations add to the same slot.
// Threads: one a current shadow ray. Reads: shadow rays, scene. Writes: radiances, control.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"
#define CONTROL_ACCESS
#include "path_state.glsl"
#include "occlusion.glsl"
#include "cut_loops.glsl"

void main() {
    uint place = gl_GlobalInvocationID.x;
    if (place < control.current_shadow_rays) {
        uint slot;
        ShadowRay shadow = load_shadow_ray(place, slot);
        if (!is_occluded(shadow)) {
            radiances.rgb[slot] += vec4(shadow.radiance, 0.0);
        }
        count_item(STAGE_CONNECT, batch.bounce);
    }
    report_cut_loops();
}
