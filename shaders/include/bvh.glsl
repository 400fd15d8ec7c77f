// Traversal of the two-wide BVH, and the watertight triangle test.
#ifndef BVH_GLSL
#define BVH_GLSL
#include "geometry.glsl"

// The ray's own space: rows of the shear that takes its direction to (0, 0, 1).
// (Woop, Benthin and Wald 2013, Watertight Ray/Triangle Intersection)
struct RaySpace {
    vec3 x;
    vec3 y;
    vec3 z;
};

RaySpace ray_space(vec3 d) {
    vec3 a = abs(d);
    if (a.x >= a.y && a.x >= a.z) {
        float s = 1.0 / d.x;
        return RaySpace(vec3(-d.y * s, 1.0, 0.0), vec3(-d.z * s, 0.0, 1.0), vec3(s, 0.0, 0.0));
    }
    if (a.y >= a.z) {
        float s = 1.0 / d.y;
        return RaySpace(vec3(0.0, -d.z * s, 1.0), vec3(1.0, -d.x * s, 0.0), vec3(0.0, s, 0.0));
    }
    float s = 1.0 / d.z;
    return RaySpace(vec3(1.0, 0.0, -d.x * s), vec3(0.0, 1.0, -d.y * s), vec3(0.0, 0.0, s));
}

// A dot product in a stated order, so that a vertex lands on one point whatever its triangle.
float ordered_dot(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// Intersects one triangle. Each edge's sign is that of the exact sheared geometry or zero, and
// zero counts as inside, so a ray cannot slip between neighbours.
bool intersect_triangle(vec3 origin, RaySpace space, Triangle t, out float distance, out vec2 barycentrics) {
    vec3 a = t.v0 - origin;
    vec3 b = t.v1 - origin;
    vec3 c = t.v2 - origin;
    vec2 pa = vec2(ordered_dot(space.x, a), ordered_dot(space.y, a));
    vec2 pb = vec2(ordered_dot(space.x, b), ordered_dot(space.y, b));
    vec2 pc = vec2(ordered_dot(space.x, c), ordered_dot(space.y, c));
    float u = pc.x * pb.y - pc.y * pb.x;
    float v = pa.x * pc.y - pa.y * pc.x;
    float w = pb.x * pa.y - pb.y * pa.x;
    float determinant = u + v + w;
    float inverse = 1.0 / determinant;
    distance = (u * ordered_dot(space.z, a) + v * ordered_dot(space.z, b) + w * ordered_dot(space.z, c)) * inverse;
    barycentrics = vec2(v, w) * inverse;
    bool inside = min(min(u, v), w) >= 0.0 || max(max(u, v), w) <= 0.0;
    return inside && determinant != 0.0 && distance > 0.0;
}

// Reciprocal direction, finite: a zero component becomes tiny, which misses the same boxes.
vec3 safe_inverse(vec3 d) {
    return 1.0 / mix(d, mix(vec3(-1e-20), vec3(1e-20), greaterThanEqual(d, vec3(0.0))), lessThan(abs(d), vec3(1e-20)));
}

// Widens a slab interval over its own rounding and that of triangle distances.
// (Ize 2013, Robust BVH Ray Traversal)
const float SLAB_SLACK = 1.0000008;

// Where the ray enters the box, or a negative number if it misses it before `limit`.
float enter_box(vec3 low, vec3 high, vec3 origin, vec3 inverse, float limit) {
    vec3 t0 = (low - origin) * inverse;
    vec3 t1 = (high - origin) * inverse;
    vec3 near = min(t0, t1);
    vec3 far = max(t0, t1);
    float enter = max(max(near.x, near.y), max(near.z, 0.0));
    float leave = min(min(far.x, far.y), min(far.z, limit));
    return enter <= leave * SLAB_SLACK ? enter : -1.0;
}

bool is_inner(uint reference) { return (reference & LEAF_BIT) == 0u; }

// Steps from inner node `current` to its nearer child that the ray enters, the other one pushed,
// or to the top of the stack.
uint descend(uint current, vec3 origin, vec3 inverse, float limit, inout uint stack[STACK_SIZE], inout uint depth) {
    uvec4 left_low = fetch_nodes(NODE_TEXELS * current);
    uvec4 left_high = fetch_nodes(NODE_TEXELS * current + 1u);
    uvec4 right_low = fetch_nodes(NODE_TEXELS * current + 2u);
    uvec4 right_high = fetch_nodes(NODE_TEXELS * current + 3u);
    float left = enter_box(uintBitsToFloat(left_low.xyz), uintBitsToFloat(left_high.xyz), origin, inverse, limit);
    float right = enter_box(uintBitsToFloat(right_low.xyz), uintBitsToFloat(right_high.xyz), origin, inverse, limit);
    bool left_is_near = right < 0.0 || (left >= 0.0 && left <= right);
    uint near = left_is_near ? left_low.w : right_low.w;
    uint far = left_is_near ? right_low.w : left_low.w;
    if (max(left, right) < 0.0) {
        depth -= 1u;
        return stack[depth];
    }
    if (min(left, right) >= 0.0) {
        stack[depth] = far;
        depth += 1u;
    }
    return near;
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
    uint stack[STACK_SIZE];
    stack[0] = TRAVERSAL_DONE;
    uint depth = 1u;
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        while (is_inner(current)) {
            current = descend(current, ray.origin, inverse, nearest.distance, stack, depth);
        }
        if (current != TRAVERSAL_DONE) {
            uint triangle = leaf_first(current);
            uint end = triangle + leaf_count(current);
            while (triangle < end) {
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
            depth -= 1u;
            current = stack[depth];
        }
    }
    return nearest;
}

// Whether anything but the triangle `target` lies on the ray nearer than `limit`.
bool trace_any(Ray ray, uint target, float limit) {
    vec3 inverse = safe_inverse(ray.direction);
    RaySpace space = ray_space(ray.direction);
    bool blocked = false;
    uint stack[STACK_SIZE];
    stack[0] = TRAVERSAL_DONE;
    uint depth = 1u;
    uint current = 0u;
    while (current != TRAVERSAL_DONE) {
        while (is_inner(current)) {
            current = descend(current, ray.origin, inverse, limit, stack, depth);
        }
        if (current != TRAVERSAL_DONE) {
            uint triangle = leaf_first(current);
            uint end = triangle + leaf_count(current);
            while (triangle < end) {
                float distance;
                vec2 barycentrics;
                bool hit = intersect_triangle(ray.origin, space, fetch_triangle(triangle), distance, barycentrics);
                blocked = blocked || (hit && distance < limit && triangle != ray.leaves && triangle != target);
                triangle += 1u;
            }
            depth -= 1u;
            current = blocked ? TRAVERSAL_DONE : stack[depth];
        }
    }
    return blocked;
}

#endif
