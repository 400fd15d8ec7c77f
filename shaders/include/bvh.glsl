// Traversal: the nearest hit, and whether anything is hit, by the BVH that the scene was given.
#ifndef BVH_GLSL
#define BVH_GLSL
#include "binary.glsl"
#include "wide.glsl"
#include "list.glsl"

// The nearest hit.
Hit trace_closest(Ray ray) {
    Hit hit;
    if (BVH_WIDTH == 1u) {
        hit = trace_closest_listed(ray);
    } else if (BVH_WIDTH == 2u) {
        hit = trace_closest_binary(ray);
    } else {
        hit = trace_closest_wide(ray);
    }
    return hit;
}

// Whether anything but the triangle `target` lies on the ray nearer than `limit`.
bool trace_any(Ray ray, uint target, float limit) {
    bool blocked;
    if (BVH_WIDTH == 1u) {
        blocked = trace_any_listed(ray, target, limit);
    } else if (BVH_WIDTH == 2u) {
        blocked = trace_any_binary(ray, target, limit);
    } else {
        blocked = trace_any_wide(ray, target, limit);
    }
    return blocked;
}

#endif
