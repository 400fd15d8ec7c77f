// The nearest hit of a ray, and whether anything but a target lies nearer than a limit.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "bvh.glsl"

struct Query {
    uvec4 origin;     // bits, triangle left
    uvec4 direction;  // bits, target
    vec4 limit;       // limit, unused
};

struct Answer {
    uvec4 hit;    // triangle, bits of barycentrics and distance
    uvec4 walk;   // 1 where the ray is occluded, most entries that a stack that spills held, unused
};

uint entries(Stack stack) { return stack.count + STACK_BLOCK * stack.blocks; }

uint deepest_wide_stack(Ray ray) {
    GridRay grid = grid_ray(ray);
    Stack stack = empty_stack();
    uint deepest = 0u;
    uint node = 0u;
    while (node != NO_NODE) {
        uint first_triangle, children;
        uint hits = enter_children(node, grid, FARTHEST, first_triangle, children);
        node = next_node(children, entered_by_any(hits >> WIDE_INNER_BIT), grid.octant, stack);
        balance_stack(stack);
        deepest = max(deepest, entries(stack));
    }
    return deepest;
}

uint deepest_binary_stack(Ray ray) {
    Stack stack = empty_stack();
    uint deepest = 0u;
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        if (is_inner(current)) {
            current = descend(current, box_ray(ray), FARTHEST, stack);
        } else {
            current = pop_if(true, stack);
        }
        balance_stack(stack);
        deepest = max(deepest, entries(stack));
    }
    return deepest;
}

// Walks every node that the ray, or one of its packet, enters, to see how far the stack grows.
uint deepest_stack(Ray ray) {
    return BVH_WIDTH == 2u ? deepest_binary_stack(ray) : deepest_wide_stack(ray);
}

Answer probe(Query query) {
    Ray ray = Ray(uintBitsToFloat(query.origin.xyz), uintBitsToFloat(query.direction.xyz), world_primitive(query.origin.w));
    Hit hit = trace_closest(ray);
    bool occluded = trace_any(ray, world_primitive(query.direction.w), query.limit.x);
    return Answer(uvec4(hit.primitive.triangle, floatBitsToUint(hit.barycentrics), floatBitsToUint(hit.distance)),
        uvec4(uint(occluded), deepest_stack(ray), 0u, 0u));
}

PROBE(Query, Answer)
