// Traversal of the two-wide BVH.
#ifndef BINARY_GLSL
#define BINARY_GLSL
#include "intersect.glsl"
#include "slab.glsl"
#include "stack.glsl"
#include "work.glsl"

// Widens a slab interval over its own rounding. (Ize 2013, Robust BVH Ray Traversal)
const float SLAB_SLACK = 1.0000008;

// Where the ray enters the box, or a negative number if it misses it before `t_max`.
float enter_box(vec3 low, vec3 high, vec3 origin, vec3 inverse, float t_max) {
    vec3 a = (low - origin) * inverse;
    vec3 b = (high - origin) * inverse;
    float enter = max_bits(max_bits(min_bits(a.x, b.x), min_bits(a.y, b.y)), max_bits(min_bits(a.z, b.z), 0.0));
    float leave = min_bits(min_bits(max_bits(a.x, b.x), max_bits(a.y, b.y)), min_bits(max_bits(a.z, b.z), t_max));
    return enter <= leave * SLAB_SLACK ? enter : -1.0;
}

bool is_inner(uint reference) { return (reference & LEAF_BIT) == 0u; }

// Steps from inner node `current` to its nearer child that the ray enters, the other one pushed,
// or to the newest entry of the stack.
uint descend(uint current, vec3 origin, vec3 inverse, float t_max, inout Stack stack) {
    count_node();
    BinaryNode node = fetch_binary_node(current);
    float left = enter_box(node.left_low, node.left_high, origin, inverse, t_max);
    float right = enter_box(node.right_low, node.right_high, origin, inverse, t_max);
    bool left_is_near = right < 0.0 || (left >= 0.0 && left <= right);
    uint near = left_is_near ? node.left : node.right;
    uint far = left_is_near ? node.right : node.left;
    bool both = left >= 0.0 && right >= 0.0;
    bool neither = left < 0.0 && right < 0.0;
    push_if(both, far, stack);
    uint newest = pop_if(neither, stack);
    return neither ? newest : near;
}

bool is_leaf(uint reference) { return !is_inner(reference) && reference != TRAVERSAL_DONE; }
uint leaf_count(uint reference) { return is_leaf(reference) ? (reference & ~LEAF_BIT) >> LEAF_COUNT_SHIFT : 0u; }
uint leaf_first(uint leaf) { return leaf & ((1u << LEAF_COUNT_SHIFT) - 1u); }

// Steps from a leaf to the newest entry of the stack; stays at an inner node, where traversal left its loop for the stack
// to be balanced.
uint leave_leaf(uint current, inout Stack stack) {
    bool leaf = is_leaf(current);
    uint newest = pop_if(leaf, stack);
    return leaf ? newest : current;
}

Hit trace_closest_binary(Ray ray) {
    vec3 inverse = safe_inverse(ray.direction);
    RaySpace space = ray_space(ray.direction);
    Nearest nearest = no_nearest();
    Stack stack = empty_stack();
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        float t_max = box_t_max(nearest.hit.distance, inverse);
        while (is_inner(current) && !is_unbalanced(stack)) {
            current = descend(current, ray.origin, inverse, t_max, stack);
        }
        uint triangle = leaf_first(current);
        uint end = triangle + leaf_count(current);
        while (triangle < end) {
            hit_triangle(Primitive(triangle), ray, space, nearest);
            triangle += 1u;
        }
        balance_stack(stack);
        current = leave_leaf(current, stack);
    }
    return nearest_hit(nearest, ray, space);
}

bool trace_any_binary(Ray ray, Primitive target, float t_max) {
    vec3 inverse = safe_inverse(ray.direction);
    RaySpace space = ray_space(ray.direction);
    float boxes_t_max = box_t_max(t_max, inverse);
    Occlusion occlusion = no_occlusion();
    Stack stack = empty_stack();
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        while (is_inner(current) && !is_unbalanced(stack)) {
            current = descend(current, ray.origin, inverse, boxes_t_max, stack);
        }
        uint triangle = leaf_first(current);
        uint end = triangle + leaf_count(current);
        while (triangle < end) {
            occlude(Primitive(triangle), fetch_triangle(triangle), ray, space, target, t_max, occlusion);
            triangle += 1u;
        }
        balance_stack(stack);
        uint next = leave_leaf(current, stack);
        current = occlusion.occluded ? TRAVERSAL_DONE : next;
    }
    return is_occluded(occlusion, ray, space);
}

#endif
