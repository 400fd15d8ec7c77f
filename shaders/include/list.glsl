// Traversal without a tree: the ray is intersected with every triangle of a short list.
//
// The triangles are constants of the kernel and the loop over them is unrolled. So nothing is fetched,
// no lane waits for another, and what several triangles share, such as a vertex in the ray's space, is
// computed once.
#ifndef LIST_GLSL
#define LIST_GLSL
#extension GL_EXT_control_flow_attributes : require
#include "intersect.glsl"
#include "listed_triangles.glsl"

// Triangle `i` of `vertices`. A list is in the scene's order: the first of equal distances stays.
#define LISTED_TRIANGLE(i) Triangle(vertices[3u * i], vertices[3u * i + 1u], vertices[3u * i + 2u], 0u, i)

Hit trace_closest_listed(Ray ray) {
    vec3 vertices[3u * LISTED_TRIANGLES] = LISTED_VERTICES;
    RaySpace space = ray_space(ray.direction);
    Nearest nearest = no_nearest();
    [[unroll]] for (uint i = 0u; i < LISTED_COUNT; i++) {
        hit_triangle(world_primitive(i), LISTED_TRIANGLE(i), false, ray, space, nearest);
    }
    return nearest_hit(nearest, ray, space);
}

bool trace_any_listed(Ray ray, Primitive target, float t_max) {
    vec3 vertices[3u * LISTED_TRIANGLES] = LISTED_VERTICES;
    RaySpace space = ray_space(ray.direction);
    Occlusion occlusion = no_occlusion();
    [[unroll]] for (uint i = 0u; i < LISTED_COUNT; i++) {
        occlude(world_primitive(i), LISTED_TRIANGLE(i), ray, space, target, t_max, occlusion);
    }
    return is_occluded(occlusion, ray, space);
}

#endif
