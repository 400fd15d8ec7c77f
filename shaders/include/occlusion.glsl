// Whether anything lies between a surface and the light that was sampled for it.
#ifndef OCCLUSION_GLSL
#define OCCLUSION_GLSL
#include "bvh.glsl"
#include "path.glsl"

bool is_occluded(ShadowRay shadow) { return trace_any(shadow.ray, shadow.light, shadow_t_max(shadow)); }

#endif
