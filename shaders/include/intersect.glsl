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

// Makes a triangle the nearest hit if it is nearer. Among equal distances the one that the scene
// lists first is, so that the answer does not depend on the order of the walk.
void meet_triangle(uint triangle, Ray ray, RaySpace space, inout Hit nearest, inout uint nearest_original) {
    count_triangle();
    Triangle t = fetch_triangle(triangle);
    float distance;
    vec2 barycentrics;
    bool hit = intersect_triangle(ray.origin, space, t, distance, barycentrics) && triangle != ray.leaves;
    if (hit && (distance < nearest.distance || (distance == nearest.distance && t.original < nearest_original))) {
        nearest = Hit(triangle, barycentrics, distance);
        nearest_original = t.original;
    }
}

// Whether a triangle that is not `target` lies on the ray nearer than `limit`.
bool blocks(uint triangle, Ray ray, RaySpace space, uint target, float limit) {
    count_triangle();
    float distance;
    vec2 barycentrics;
    bool hit = intersect_triangle(ray.origin, space, fetch_triangle(triangle), distance, barycentrics);
    return hit && distance < limit && triangle != ray.leaves && triangle != target;
}

#endif
