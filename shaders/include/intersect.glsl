// The watertight triangle test.
#ifndef INTERSECT_GLSL
#define INTERSECT_GLSL
#include "geometry.glsl"
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

// Orders hits in one unsigned comparison: what lies behind the origin or at it, and NaN, comes after
// every distance in front. Comparisons are expensive on software devices, arithmetic on bits is not.
uint nearness(float distance) { return floatBitsToUint(distance) - 1u; }

// The highest bit says whether the number is below zero, which -0 is not.
uint below_zero(uint bits) { return bits & (bits - 1u); }

// Intersects one triangle and yields the nearness of the hit, or a number with its highest bit set.
// Each edge's sign is that of the exact sheared geometry or zero, and zero counts as inside, so a ray
// cannot slip between neighbours.
uint intersect_triangle(vec3 origin, RaySpace space, Triangle t, out float distance, out vec2 barycentrics) {
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
    // Inside, all three have the sign of their sum. Where the sum is zero the distance is NaN.
    uint sign = floatBitsToUint(determinant) & 0x80000000u;
    uint outside = below_zero(floatBitsToUint(u) ^ sign) | below_zero(floatBitsToUint(v) ^ sign)
        | below_zero(floatBitsToUint(w) ^ sign);
    return nearness(distance) | (outside & 0x80000000u);
}

// The nearest hit so far.
struct Nearest {
    Hit hit;
    uint original;  // the triangle's index in the scene's order
};

Nearest no_nearest() { return Nearest(Hit(no_primitive(), vec2(0.0), FARTHEST), NO_TRIANGLE); }

// Makes the primitive, whose triangle is `t`, the nearest hit if it is nearer, or as near and `wins_ties`.
void hit_triangle(Primitive primitive, Triangle t, bool wins_ties, Ray ray, RaySpace space, inout Nearest nearest) {
    count_triangle();
    float distance;
    vec2 barycentrics;
    uint found = intersect_triangle(ray.origin, space, t, distance, barycentrics);
    uint limit = nearness(nearest.hit.distance) + (wins_ties ? 1u : 0u);
    if (found < limit && (FIXED_OFFSETS || !same_primitive(primitive, ray.leaves))) {
        nearest = Nearest(Hit(primitive, barycentrics, distance), t.original);
    }
}

// The same of a primitive in memory. Among equal distances the one that the scene lists first wins, so that the answer
// does not depend on the order of traversal.
void hit_triangle(Primitive primitive, Ray ray, RaySpace space, inout Nearest nearest) {
    Triangle t = fetch_triangle(primitive.triangle);
    hit_triangle(primitive, t, t.original < nearest.original, ray, space, nearest);
}

// Whether the primitive, whose triangle is `t`, lies on the ray nearer than `t_max` and is not `target`.
bool occludes(Primitive primitive, Triangle t, Ray ray, RaySpace space, Primitive target, float t_max) {
    count_triangle();
    float distance;
    vec2 barycentrics;
    uint found = intersect_triangle(ray.origin, space, t, distance, barycentrics);
    bool counts = FIXED_OFFSETS || (!same_primitive(primitive, ray.leaves) && !same_primitive(primitive, target));
    return found < nearness(t_max) && counts;
}

#endif
