// The watertight triangle test.
#ifndef INTERSECT_GLSL
#define INTERSECT_GLSL
#include "geometry.glsl"
#include "skippable_if.glsl"
#include "sliver.glsl"
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

// A triangle in the ray's space, and the barycentrics of where they meet, times their sum.
struct Edges {
    vec3 a;
    vec3 b;
    vec3 c;
    float u;
    float v;
    float w;
    float determinant;
};

Edges edges_of(vec3 origin, RaySpace space, Triangle t) {
    vec3 a = to_ray_space(space, origin, t.v0);
    vec3 b = to_ray_space(space, origin, t.v1);
    vec3 c = to_ray_space(space, origin, t.v2);
    float u = c.x * b.y - c.y * b.x;
    float v = a.x * c.y - a.y * c.x;
    float w = b.x * a.y - b.y * a.x;
    return Edges(a, b, c, u, v, w, u + v + w);
}

// Intersects one triangle and yields the nearness of the hit, or a number with its highest bit set.
// Each edge's sign is that of the exact sheared geometry or zero, and zero counts as inside, so a ray
// cannot slip between neighbours.
uint intersect_triangle(vec3 origin, RaySpace space, Triangle t, out float distance, out vec2 barycentrics) {
    Edges e = edges_of(origin, space, t);
    float inverse = 1.0 / e.determinant;
    distance = (e.u * e.a.z + e.v * e.b.z + e.w * e.c.z) * (inverse * space.shear.z);
    barycentrics = vec2(e.v, e.w) * inverse;
    // Inside, all three have the sign of their sum. Where the sum is zero the distance is NaN.
    uint sign = floatBitsToUint(e.determinant) & 0x80000000u;
    uint outside = below_zero(floatBitsToUint(e.u) ^ sign) | below_zero(floatBitsToUint(e.v) ^ sign)
        | below_zero(floatBitsToUint(e.w) ^ sign);
    return nearness(distance) | (outside & 0x80000000u);
}

// Sides: with CHECKS_SIDES a thin triangle that touches a ray's origin is checked to lie in front of it.
//
// The distance of a thin triangle is off by roundings of its length times its aspect. So where a ray leaves a convex
// edge, the neighbour of the triangle that it leaves may be found in front. A bound on the distance (Pharr, Jakob and
// Humphreys, 6.8.7) would let rays through concave edges instead. The exact side is too expensive for every hit: a
// traversal keeps one that touches its origin apart, and checks it at its end.

// How near a hit touches the origin, along the longest axis of the ray.
const float TOUCHING = 1.0 / 1024.0;
bool touches_origin(uint found, RaySpace space) { return CHECKS_SIDES && found < nearness(TOUCHING * abs(space.shear.z)); }

// Whether a triangle that was found in front of the ray's origin is thin and lies behind it or at it.
bool lies_behind(Ray ray, RaySpace space, Triangle t) {
    float determinant = edges_of(ray.origin, space, t).determinant;
    float volume = signed_volume(t.v0 - ray.origin, t.v1 - ray.origin, t.v2 - ray.origin);
    uint signs = floatBitsToUint(volume) ^ floatBitsToUint(determinant) ^ floatBitsToUint(space.shear.z);
    bool ahead = volume != 0.0 && (signs & 0x80000000u) != 0u;
    return is_thin(t) && !ahead;
}

// The nearest hits so far.
struct Nearest {
    Hit hit;             // that does not touch the origin
    uint original;       // its triangle's index in the scene's order
    Primitive touching;  // that does, or none
    float touching_distance;
    uint touching_original;
};

Nearest no_nearest() {
    Hit none = Hit(no_primitive(), vec2(0.0), FARTHEST);
    return Nearest(none, NO_TRIANGLE, no_primitive(), FARTHEST, NO_TRIANGLE);
}

// Whether the scene lists one primitive before another, by their indices in its order.
bool is_listed_before(Primitive a, uint original_a, Primitive b, uint original_b) {
    bool is_before = original_a < original_b;
    if (TWO_LEVEL) {
        is_before = a.instance < b.instance || (a.instance == b.instance && is_before);
    }
    return is_before;
}

// Makes the primitive, whose triangle is `t`, the nearest hit if it is nearer, or as near and `wins_ties`.
void hit_triangle(Primitive primitive, Triangle t, bool wins_ties, Ray ray, RaySpace space, inout Nearest nearest) {
    count_triangle();
    float distance;
    vec2 barycentrics;
    uint found = intersect_triangle(ray.origin, space, t, distance, barycentrics);
    bool can_be_hit = FIXED_OFFSETS || !same_primitive(primitive, ray.leaves);
    bool touches = touches_origin(found, space);
    uint limit = nearness(nearest.hit.distance) + (wins_ties ? 1u : 0u);
    if (found < limit && can_be_hit && !touches) {
        nearest.hit = Hit(primitive, barycentrics, distance);
        nearest.original = t.original;
    }
    if (CHECKS_SIDES) {
        bool is_before = is_listed_before(primitive, t.original, nearest.touching, nearest.touching_original);
        uint touching_limit = nearness(nearest.touching_distance) + (is_before ? 1u : 0u);
        if (found < touching_limit && can_be_hit && touches) {
            nearest.touching = primitive;
            nearest.touching_distance = distance;
            nearest.touching_original = t.original;
        }
    }
}

// The same of a primitive in memory, whose mesh is placed there. Among equal distances the one that the scene lists first
// wins, so that the answer does not depend on the order of traversal.
void hit_triangle(Primitive primitive, Placement placement, Ray ray, RaySpace space, inout Nearest nearest) {
    Triangle t = fetch_triangle(primitive.triangle);
    if (TWO_LEVEL) {
        t = place(placement, t);
    }
    hit_triangle(primitive, t, is_listed_before(primitive, t.original, nearest.hit.primitive, nearest.original), ray, space, nearest);
}

// The nearest hit when the traversal has ended.
Hit nearest_hit(Nearest nearest, Ray ray, RaySpace space) {
    Hit hit = nearest.hit;
    if (CHECKS_SIDES) {
        SKIPPABLE_IF(!is_none(nearest.touching)) {
            Triangle t = fetch_triangle(nearest.touching);
            if (!lies_behind(ray, space, t)) {
                hit.primitive = nearest.touching;
                intersect_triangle(ray.origin, space, t, hit.distance, hit.barycentrics);
            }
        }
    }
    return hit;
}

// What a ray is occluded by so far.
struct Occlusion {
    bool occluded;
    Primitive touching;  // touches the origin and may lie behind it; or none
};

Occlusion no_occlusion() { return Occlusion(false, no_primitive()); }

// Notes the primitive, whose triangle is `t`, if it lies on the ray nearer than `t_max` and is not `target`. Of two that
// touch the origin one is believed.
void occlude(Primitive primitive, Triangle t, Ray ray, RaySpace space, Primitive target, float t_max,
    inout Occlusion occlusion) {
    count_triangle();
    float distance;
    vec2 barycentrics;
    uint found = intersect_triangle(ray.origin, space, t, distance, barycentrics);
    bool counts = FIXED_OFFSETS || (!same_primitive(primitive, ray.leaves) && !same_primitive(primitive, target));
    bool occludes = found < nearness(t_max) && counts;
    bool is_first = touches_origin(found, space) && is_none(occlusion.touching);
    occlusion.occluded = (occludes && !is_first) || occlusion.occluded;
    if (CHECKS_SIDES) {
        occlusion.touching.triangle = occludes && is_first ? primitive.triangle : occlusion.touching.triangle;
        if (TWO_LEVEL) {
            occlusion.touching.instance = occludes && is_first ? primitive.instance : occlusion.touching.instance;
        }
    }
}

// Whether the ray is occluded, when the traversal has ended.
bool is_occluded(Occlusion occlusion, Ray ray, RaySpace space) {
    bool occluded = occlusion.occluded;
    if (CHECKS_SIDES) {
        SKIPPABLE_IF(!occlusion.occluded && !is_none(occlusion.touching)) {
            occluded = !lies_behind(ray, space, fetch_triangle(occlusion.touching));
        }
    }
    return occluded;
}

#endif
