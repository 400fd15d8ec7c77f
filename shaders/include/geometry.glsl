// Rays, hits and the surface at a hit.
#ifndef GEOMETRY_GLSL
#define GEOMETRY_GLSL
#include "specialization.glsl"
#include "bindings_scene.glsl"

// The distance of nothing: the largest finite number.
const float FARTHEST = 3.402823466e38;
// Below this numbers are subnormal.
const float SMALLEST_NORMAL = 1.17549435e-38;

struct Ray {
    vec3 origin;
    vec3 direction;
    uint leaves;  // triangle that the origin lies on, which the ray cannot hit; or NO_TRIANGLE
};

struct Hit {
    uint triangle;      // or NO_TRIANGLE
    vec2 barycentrics;  // weights of the second and third vertex
    float distance;     // in lengths of the ray's direction
};

struct Triangle {
    vec3 v0;
    vec3 v1;
    vec3 v2;
    uint material;
    uint original;  // index in the scene's order
};

struct Surface {
    vec3 position;
    vec3 position_error;    // bound of the rounding error of each coordinate
    vec3 geometric_normal;  // unit, out of the front side
    vec3 shading_normal;    // unit, on the same side
    vec2 uv;
    uint triangle;
    uint material;
};

Triangle fetch_triangle(uint index) {
    uvec4 a = fetch_triangles(TRIANGLE_TEXELS * index);
    uvec4 b = fetch_triangles(TRIANGLE_TEXELS * index + 1u);
    uvec4 c = fetch_triangles(TRIANGLE_TEXELS * index + 2u);
    return Triangle(uintBitsToFloat(a.xyz), uintBitsToFloat(b.xyz), uintBitsToFloat(c.xyz), b.w, a.w);
}

// Area of an emitting triangle over the probability that light sampling picks it; 0 of any other.
float fetch_light_area(uint index) { return uintBitsToFloat(fetch_triangles(TRIANGLE_TEXELS * index + 2u).w); }

// A bound of n roundings. (Pharr, Jakob and Humphreys, Physically Based Rendering, 6.8)
float rounding_bound(float n) { return n * 5.9604645e-8 / (1.0 - n * 5.9604645e-8); }

// The point at barycentrics, with the bound of its rounding error. (The same, 6.8.5)
vec3 interpolate_position(Triangle t, vec2 barycentrics, out vec3 error) {
    vec3 a = (1.0 - barycentrics.x - barycentrics.y) * t.v0;
    vec3 b = barycentrics.x * t.v1;
    vec3 c = barycentrics.y * t.v2;
    error = rounding_bound(7.0) * (abs(a) + abs(b) + abs(c));
    return a + b + c;
}

// How far fixed offsets move a point off its plane, in normalised lengths: 1/20,000 to 1/10,000 of the
// scene's longest side. What is closer than that to a surface is not seen from it.
const float FIXED_OFFSET = 1e-4;

// Moves a computed point off its plane to the side that `normal` shows, by a quarter more than
// its error can be: the sum is rounded too. (After the same, 6.8.6) The error counts in full,
// whatever its direction: along a plane through the origin it has no part across, yet the distance
// to a triangle in that plane is rounded all the same.
vec3 offset_from_plane(vec3 position, vec3 error, vec3 normal) {
    float offset = FIXED_OFFSETS ? FIXED_OFFSET : 1.25 * (error.x + error.y + error.z);
    return position + offset * normal;
}

// A ray that leaves the surface to whichever side its direction points. Far enough off its plane it need
// not remember the triangle.
Ray leave(Surface surface, vec3 direction) {
    vec3 side = dot(surface.geometric_normal, direction) < 0.0 ? -surface.geometric_normal : surface.geometric_normal;
    uint triangle = FIXED_OFFSETS ? NO_TRIANGLE : surface.triangle;
    return Ray(offset_from_plane(surface.position, surface.position_error, side), direction, triangle);
}

// Decodes a unit vector. (Cigolle et al. 2014, octahedral, 16 bits a coordinate)
vec3 decode_normal(uint bits) {
    vec2 p = unpackSnorm2x16(bits);
    vec3 n = vec3(p, 1.0 - abs(p.x) - abs(p.y));
    float fold = max(-n.z, 0.0);
    n.x += n.x >= 0.0 ? -fold : fold;
    n.y += n.y >= 0.0 ? -fold : fold;
    return normalize(n);
}

vec3 geometric_normal(Triangle t) { return normalize(cross(t.v1 - t.v0, t.v2 - t.v0)); }

Surface surface_at(Hit hit) {
    Triangle t = fetch_triangle(hit.triangle);
    Surface surface;
    surface.position = interpolate_position(t, hit.barycentrics, surface.position_error);
    surface.geometric_normal = geometric_normal(t);
    surface.shading_normal = surface.geometric_normal;
    surface.uv = vec2(0.0);
    surface.triangle = hit.triangle;
    surface.material = t.material;
    vec3 weights = vec3(1.0 - hit.barycentrics.x - hit.barycentrics.y, hit.barycentrics);
    if (HAS_NORMALS) {
        uvec4 corners = fetch_normals(t.original);
        vec3 n = weights.x * decode_normal(corners.x) + weights.y * decode_normal(corners.y)
            + weights.z * decode_normal(corners.z);
        // Opposite corner normals can cancel; geometry decides sides.
        float len = length(n);
        if (corners.w != 0u && len > 1e-6) {
            n *= 1.0 / len;
            surface.shading_normal = dot(n, surface.geometric_normal) < 0.0 ? -n : n;
        }
    }
    if (HAS_TEXTURES) {
        surface.uv = weights.x * uintBitsToFloat(fetch_texture_coordinates(3u * t.original))
            + weights.y * uintBitsToFloat(fetch_texture_coordinates(3u * t.original + 1u))
            + weights.z * uintBitsToFloat(fetch_texture_coordinates(3u * t.original + 2u));
    }
    return surface;
}

#endif
