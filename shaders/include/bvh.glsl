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

// Whether the ray is occluded: anything but `target` lies on it nearer than `t_max`.
bool trace_any(Ray ray, Primitive target, float t_max) {
    bool occluded;
    if (BVH_WIDTH == 1u) {
        occluded = trace_any_listed(ray, target, t_max);
    } else if (BVH_WIDTH == 2u) {
        occluded = trace_any_binary(ray, target, t_max);
    } else {
        occluded = trace_any_wide(ray, target, t_max);
    }
    return occluded;
}

#endif
