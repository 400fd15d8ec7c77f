// Traversal of the two-wide BVH, and the watertight triangle test.
#ifndef BVH_GLSL
#define BVH_GLSL
#include "geometry.glsl"
#include "stack.glsl"
#include "work.glsl"

// The ray's own space: its axes permuted so that the direction is longest along z, then sheared
// so that it becomes (0, 0, 1). (Woop, Benthin and Wald 2013, Watertight Ray/Triangle Intersection)
struct RaySpace {
    vec3 shear;
    bool x_is_longest;
    bool y_is_longest;
};

vec3 permute(vec3 v, bool x_is_longest, bool y_is_longest) {
    return x_is_longest ? v.yzx : y_is_longest ? v.zxy : v;
}

RaySpace ray_space(vec3 d) {
    vec3 a = abs(d);
    bool x_is_longest = a.x >= a.y && a.x >= a.z;
    bool y_is_longest = !x_is_longest && a.y >= a.z;
    vec3 p = permute(d, x_is_longest, y_is_longest);
    float inverse = 1.0 / p.z;
    return RaySpace(vec3(p.xy * inverse, inverse), x_is_longest, y_is_longest);
}

// A vertex in the ray's space but for the scale of z: one point, whatever triangle it belongs to.
vec3 to_ray_space(RaySpace space, vec3 origin, vec3 vertex) {
    vec3 p = permute(vertex - origin, space.x_is_longest, space.y_is_longest);
    return vec3(p.xy - space.shear.xy * p.z, p.z);
}

// Intersects one triangle. Each edge's sign is that of the exact sheared geometry or zero, and
// zero counts as inside, so a ray cannot slip between neighbours.
bool intersect_triangle(vec3 origin, RaySpace space, Triangle t, out float distance, out vec2 barycentrics) {
    vec3 a = to_ray_space(space, origin, t.v0);
    vec3 b = to_ray_space(space, origin, t.v1);
    vec3 c = to_ray_space(space, origin, t.v2);
    float u = c.x * b.y - c.y * b.x;
    float v = a.x * c.y - a.y * c.x;
    float w = b.x * a.y - b.y * a.x;
    float determinant = u + v + w;
    float inverse = 1.0 / determinant;
    distance = (u * a.z + v * b.z + w * c.z) * (inverse * space.shear.z);
    barycentrics = vec2(v, w) * inverse;
    bool inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    return inside && determinant != 0.0 && distance > 0.0;
}

// Reciprocal direction, finite: a zero component becomes tiny, which misses the same boxes.
vec3 safe_inverse(vec3 d) {
    return 1.0 / mix(d, mix(vec3(-1e-20), vec3(1e-20), greaterThanEqual(d, vec3(0.0))), lessThan(abs(d), vec3(1e-20)));
}

// Widens a slab interval over its own rounding and that of triangle distances.
// (Ize 2013, Robust BVH Ray Traversal)
const float SLAB_SLACK = 1.0000008;

// min and max as one instruction each: the built-ins carry a rule for NaN, which no box has.
float lesser(float a, float b) { return a < b ? a : b; }
float greater(float a, float b) { return a > b ? a : b; }

// Where the ray enters the box, or a negative number if it misses it before `limit`.
float enter_box(vec3 low, vec3 high, vec3 origin, vec3 inverse, float limit) {
    vec3 a = (low - origin) * inverse;
    vec3 b = (high - origin) * inverse;
    float enter = greater(greater(lesser(a.x, b.x), lesser(a.y, b.y)), greater(lesser(a.z, b.z), 0.0));
    float leave = lesser(lesser(greater(a.x, b.x), greater(a.y, b.y)), lesser(greater(a.z, b.z), limit));
    return enter <= leave * SLAB_SLACK ? enter : -1.0;
}

bool is_inner(uint reference) { return (reference & LEAF_BIT) == 0u; }

// Steps from inner node `current` to its nearer child that the ray enters, the other one pushed,
// or to the newest entry of the stack.
uint descend(uint current, vec3 origin, vec3 inverse, float limit, inout Stack stack) {
    count_node();
    uvec4 left_low = fetch_nodes(NODE_TEXELS * current);
    uvec4 left_high = fetch_nodes(NODE_TEXELS * current + 1u);
    uvec4 right_low = fetch_nodes(NODE_TEXELS * current + 2u);
    uvec4 right_high = fetch_nodes(NODE_TEXELS * current + 3u);
    float left = enter_box(uintBitsToFloat(left_low.xyz), uintBitsToFloat(left_high.xyz), origin, inverse, limit);
    float right = enter_box(uintBitsToFloat(right_low.xyz), uintBitsToFloat(right_high.xyz), origin, inverse, limit);
    bool left_is_near = right < 0.0 || (left >= 0.0 && left <= right);
    uint near = left_is_near ? left_low.w : right_low.w;
    uint far = left_is_near ? right_low.w : left_low.w;
    bool both = left >= 0.0 && right >= 0.0;
    bool neither = left < 0.0 && right < 0.0;
    uint newest = update_stack(stack, both, neither, far);
    return neither ? newest : near;
}

uint leaf_count(uint leaf) { return (leaf & ~LEAF_BIT) >> LEAF_COUNT_SHIFT; }
uint leaf_first(uint leaf) { return leaf & ((1u << LEAF_COUNT_SHIFT) - 1u); }

// The nearest hit. Among equal distances the triangle that the scene lists first wins, so that
// the answer does not depend on the order of the walk.
Hit trace_closest(Ray ray) {
    vec3 inverse = safe_inverse(ray.direction);
    RaySpace space = ray_space(ray.direction);
    Hit nearest = Hit(NO_TRIANGLE, vec2(0.0), FARTHEST);
    uint nearest_original = NO_TRIANGLE;
    Stack stack = empty_stack();
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        while (is_inner(current)) {
            current = descend(current, ray.origin, inverse, nearest.distance, stack);
        }
        if (current != TRAVERSAL_DONE) {
            uint triangle = leaf_first(current);
            uint end = triangle + leaf_count(current);
            while (triangle < end) {
                count_triangle();
                Triangle t = fetch_triangle(triangle);
                float distance;
                vec2 barycentrics;
                bool hit = intersect_triangle(ray.origin, space, t, distance, barycentrics) && triangle != ray.leaves;
                if (hit && (distance < nearest.distance || (distance == nearest.distance && t.original < nearest_original))) {
                    nearest = Hit(triangle, barycentrics, distance);
                    nearest_original = t.original;
                }
                triangle += 1u;
            }
            current = update_stack(stack, false, true, 0u);
        }
    }
    return nearest;
}

// Whether anything but the triangle `target` lies on the ray nearer than `limit`.
bool trace_any(Ray ray, uint target, float limit) {
    vec3 inverse = safe_inverse(ray.direction);
    RaySpace space = ray_space(ray.direction);
    bool blocked = false;
    Stack stack = empty_stack();
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        while (is_inner(current)) {
            current = descend(current, ray.origin, inverse, limit, stack);
        }
        if (current != TRAVERSAL_DONE) {
            uint triangle = leaf_first(current);
            uint end = triangle + leaf_count(current);
            while (triangle < end) {
                count_triangle();
                float distance;
                vec2 barycentrics;
                bool hit = intersect_triangle(ray.origin, space, fetch_triangle(triangle), distance, barycentrics);
                blocked = blocked || (hit && distance < limit && triangle != ray.leaves && triangle != target);
                triangle += 1u;
            }
            uint newest = update_stack(stack, false, true, 0u);
            current = blocked ? TRAVERSAL_DONE : newest;
        }
    }
    return blocked;
}

#endif
