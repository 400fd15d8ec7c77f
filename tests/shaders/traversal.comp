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
    uvec4 walk;   // 1 where something blocks, most entries that a stack that spills held, unused
};

// Walks every node that the ray enters, to see how far the stack grows.
uint deepest_stack(Ray ray) {
    Stack stack = empty_stack();
    uint deepest = 0u;
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        if (is_inner(current)) {
            current = descend(current, ray.origin, safe_inverse(ray.direction), FARTHEST, stack);
        } else {
            current = update_stack(stack, false, true, 0u);
        }
        deepest = max(deepest, stack.count + STACK_BLOCK * stack.blocks);
    }
    return deepest;
}

Answer probe(Query query) {
    Ray ray = Ray(uintBitsToFloat(query.origin.xyz), uintBitsToFloat(query.direction.xyz), query.origin.w);
    Hit hit = trace_closest(ray);
    bool blocked = trace_any(ray, query.direction.w, query.limit.x);
    return Answer(uvec4(hit.triangle, floatBitsToUint(hit.barycentrics), floatBitsToUint(hit.distance)),
        uvec4(uint(blocked), deepest_stack(ray), 0u, 0u));
}

PROBE(Query, Answer)
