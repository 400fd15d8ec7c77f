// Traversal of the two-wide BVH.
#ifndef BINARY_GLSL
#define BINARY_GLSL
#include "intersect.glsl"
#include "slab.glsl"
#include "stack.glsl"
#include "work.glsl"

// Widens a slab interval over its own rounding. (Ize 2013, Robust BVH Ray Traversal)
const float SLAB_SLACK = 1.0000008;

// A ray as boxes see it: in normalised space, or in the coordinates of a mesh in its place.
struct BoxRay {
    vec3 from_low;   // the origin, farther from lower planes by as much as roundings may move it
    vec3 from_high;  // and from upper ones
    vec3 inverse;    // of the direction
};

BoxRay box_ray(Ray ray) { return BoxRay(ray.origin, ray.origin, safe_inverse(ray.direction)); }

// How far roundings move a ray in the coordinates of a mesh, by its way to the mesh. src/bvh/instances.rs has the bounds.
const float INSTANCE_SLACK = 32.0 * 5.9604645e-8;

BoxRay box_ray_in_mesh(Ray ray, ToMesh to, vec3 translation) {
    vec3 way = ray.origin - translation;
    vec3 origin = to.x.xyz * way.x + to.y.xyz * way.y + to.z.xyz * way.z;
    vec3 direction = to.x.xyz * ray.direction.x + to.y.xyz * ray.direction.y + to.z.xyz * ray.direction.z;
    vec3 reach = abs(to.x.xyz) * abs(way.x) + abs(to.y.xyz) * abs(way.y) + abs(to.z.xyz) * abs(way.z);
    vec3 margin = vec3(to.x.w, to.y.w, to.z.w) + reach * INSTANCE_SLACK;
    return BoxRay(origin + margin, origin - margin, safe_inverse(direction));
}

// Where the ray enters the box, or a negative number if it misses it before `t_max`.
float enter_box(vec3 low, vec3 high, BoxRay ray, float t_max) {
    vec3 a = (low - ray.from_low) * ray.inverse;
    vec3 b = (high - ray.from_high) * ray.inverse;
    float enter = max_bits(max_bits(min_bits(a.x, b.x), min_bits(a.y, b.y)), max_bits(min_bits(a.z, b.z), 0.0));
    float leave = min_bits(min_bits(max_bits(a.x, b.x), max_bits(a.y, b.y)), min_bits(max_bits(a.z, b.z), t_max));
    return enter <= leave * SLAB_SLACK ? enter : -1.0;
}

bool is_inner(uint reference) { return (reference & LEAF_BIT) == 0u; }

// Steps from inner node `current` to its nearer child that the ray enters, the other one pushed,
// or to the newest entry of the stack.
uint descend(uint current, BoxRay ray, float t_max, inout Stack stack) {
    count_node();
    BinaryNode node = fetch_binary_node(current);
    float left = enter_box(node.left_low, node.left_high, ray, t_max);
    float right = enter_box(node.right_low, node.right_high, ray, t_max);
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
uint leaf_first(uint leaf) { return leaf & ((1u << LEAF_COUNT_SHIFT) - 1u); }

// Triangles of a leaf; a mesh in its place, and the end of one, have none.
uint leaf_count(uint reference) {
    uint count = is_leaf(reference) ? (reference & ~LEAF_BIT) >> LEAF_COUNT_SHIFT : 0u;
    if (TWO_LEVEL) {
        count = count > LEAF_MAX_TRIANGLES ? 0u : count;
    }
    return count;
}

// The part of the tree that a ray is in: the world or, with TWO_LEVEL, a mesh in its place.
struct Level {
    BoxRay ray;
    uint instance;
    Placement placement;
};

Level world_level(BoxRay ray) { return Level(ray, WORLD_INSTANCE, no_placement()); }

bool is_instance(uint reference) { return is_leaf(reference) && (reference & ~LEAF_BIT) >> LEAF_COUNT_SHIFT == LEAF_INSTANCE; }

// Steps from a leaf to the newest entry of the stack, or from a mesh in its place to the root of its tree; stays at an inner
// node, where traversal left its loop for the stack to be balanced.
uint leave_leaf(uint current, Ray ray, BoxRay in_world, inout Level level, inout Stack stack) {
    bool enters = TWO_LEVEL && is_instance(current);
    bool leaf = is_leaf(current) && !enters;
    if (TWO_LEVEL) {
        push_if(enters, INSTANCE_DONE, stack);
    }
    uint newest = pop_if(leaf, stack);
    uint next = leaf ? newest : current;
    if (TWO_LEVEL) {
        SKIPPABLE_IF(current == INSTANCE_DONE) {
            level = world_level(in_world);
        }
        SKIPPABLE_IF(enters) {
            level.instance = leaf_first(current);
            level.placement = fetch_placement(level.instance, next);
            level.ray = box_ray_in_mesh(ray, fetch_to_mesh(level.instance), level.placement.translation);
        }
    }
    return next;
}

Hit trace_closest_binary(Ray ray) {
    BoxRay in_world = box_ray(ray);
    RaySpace space = ray_space(ray.direction);
    Nearest nearest = no_nearest();
    Stack stack = empty_stack();
    Level level = world_level(in_world);
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        float t_max = box_t_max(nearest.hit.distance, in_world.inverse);
        while (is_inner(current) && !is_unbalanced(stack)) {
            current = descend(current, level.ray, t_max, stack);
        }
        uint triangle = leaf_first(current);
        uint end = triangle + leaf_count(current);
        while (triangle < end) {
            hit_triangle(Primitive(triangle, level.instance), level.placement, ray, space, nearest);
            triangle += 1u;
        }
        balance_stack(stack);
        current = leave_leaf(current, ray, in_world, level, stack);
    }
    return nearest_hit(nearest, ray, space);
}

bool trace_any_binary(Ray ray, Primitive target, float t_max) {
    BoxRay in_world = box_ray(ray);
    RaySpace space = ray_space(ray.direction);
    float boxes_t_max = box_t_max(t_max, in_world.inverse);
    Occlusion occlusion = no_occlusion();
    Stack stack = empty_stack();
    Level level = world_level(in_world);
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        while (is_inner(current) && !is_unbalanced(stack)) {
            current = descend(current, level.ray, boxes_t_max, stack);
        }
        uint triangle = leaf_first(current);
        uint end = triangle + leaf_count(current);
        while (triangle < end) {
            Triangle t = fetch_triangle(triangle);
            if (TWO_LEVEL) {
                t = place(level.placement, t);
            }
            occlude(Primitive(triangle, level.instance), t, ray, space, target, t_max, occlusion);
            triangle += 1u;
        }
        balance_stack(stack);
        uint next = leave_leaf(current, ray, in_world, level, stack);
        current = occlusion.occluded ? TRAVERSAL_DONE : next;
    }
    return is_occluded(occlusion, ray, space);
}

#endif
