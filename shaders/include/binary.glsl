// Traversal of the two-wide BVH.
#ifndef BINARY_GLSL
#define BINARY_GLSL
#include "intersect.glsl"
#include "slab.glsl"
#include "stack.glsl"
#include "work.glsl"

// Widens a slab interval over its own rounding. (Ize 2013, Robust BVH Ray Traversal)
const float SLAB_SLACK = 1.0000008;

// Where the ray enters the box, or a negative number if it misses it before `reach`.
float enter_box(vec3 low, vec3 high, vec3 origin, vec3 inverse, float reach) {
    vec3 a = (low - origin) * inverse;
    vec3 b = (high - origin) * inverse;
    float enter = greater(greater(lesser(a.x, b.x), lesser(a.y, b.y)), greater(lesser(a.z, b.z), 0.0));
    float leave = lesser(lesser(greater(a.x, b.x), greater(a.y, b.y)), lesser(greater(a.z, b.z), reach));
    return enter <= leave * SLAB_SLACK ? enter : -1.0;
}

bool is_inner(uint reference) { return (reference & LEAF_BIT) == 0u; }

// Steps from inner node `current` to its nearer child that the ray enters, the other one pushed,
// or to the newest entry of the stack.
uint descend(uint current, vec3 origin, vec3 inverse, float reach, inout Stack stack) {
    count_node();
    uvec4 left_low = fetch_nodes(NODE_TEXELS * current);
    uvec4 left_high = fetch_nodes(NODE_TEXELS * current + 1u);
    uvec4 right_low = fetch_nodes(NODE_TEXELS * current + 2u);
    uvec4 right_high = fetch_nodes(NODE_TEXELS * current + 3u);
    float left = enter_box(uintBitsToFloat(left_low.xyz), uintBitsToFloat(left_high.xyz), origin, inverse, reach);
    float right = enter_box(uintBitsToFloat(right_low.xyz), uintBitsToFloat(right_high.xyz), origin, inverse, reach);
    bool left_is_near = right < 0.0 || (left >= 0.0 && left <= right);
    uint near = left_is_near ? left_low.w : right_low.w;
    uint far = left_is_near ? right_low.w : left_low.w;
    bool both = left >= 0.0 && right >= 0.0;
    bool neither = left < 0.0 && right < 0.0;
    uint newest = update_stack(stack, int(both) - int(neither), far);
    return neither ? newest : near;
}

bool is_leaf(uint reference) { return !is_inner(reference) && reference != TRAVERSAL_DONE; }
uint leaf_count(uint reference) { return is_leaf(reference) ? (reference & ~LEAF_BIT) >> LEAF_COUNT_SHIFT : 0u; }
uint leaf_first(uint leaf) { return leaf & ((1u << LEAF_COUNT_SHIFT) - 1u); }

// Steps from a leaf to the newest entry of the stack; stays at an inner node, where the walk waited for
// the stack to be balanced.
uint leave_leaf(uint current, inout Stack stack) {
    bool leaf = is_leaf(current);
    uint newest = update_stack(stack, -int(leaf), 0u);
    return leaf ? newest : current;
}

Hit trace_closest_binary(Ray ray) {
    vec3 inverse = safe_inverse(ray.direction);
    RaySpace space = ray_space(ray.direction);
    Nearest nearest = nothing();
    Stack stack = empty_stack();
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        float reach = reach_of(nearest.hit.distance, inverse);
        while (is_inner(current) && !is_unbalanced(stack)) {
            current = descend(current, ray.origin, inverse, reach, stack);
        }
        uint triangle = leaf_first(current);
        uint end = triangle + leaf_count(current);
        while (triangle < end) {
            meet_triangle(triangle, ray, space, nearest);
            triangle += 1u;
        }
        balance_stack(stack);
        current = leave_leaf(current, stack);
    }
    return nearest.hit;
}

bool trace_any_binary(Ray ray, uint target, float limit) {
    vec3 inverse = safe_inverse(ray.direction);
    RaySpace space = ray_space(ray.direction);
    float reach = reach_of(limit, inverse);
    bool blocked = false;
    Stack stack = empty_stack();
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        while (is_inner(current) && !is_unbalanced(stack)) {
            current = descend(current, ray.origin, inverse, reach, stack);
        }
        uint triangle = leaf_first(current);
        uint end = triangle + leaf_count(current);
        while (triangle < end) {
            blocked = blocks(triangle, fetch_triangle(triangle), ray, space, target, limit) || blocked;
            triangle += 1u;
        }
        balance_stack(stack);
        uint next = leave_leaf(current, stack);
        current = blocked ? TRAVERSAL_DONE : next;
    }
    return blocked;
}

#endif
