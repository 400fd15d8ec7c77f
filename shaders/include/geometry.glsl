// Rays, hits and the surface at a hit.
#ifndef GEOMETRY_GLSL
#define GEOMETRY_GLSL
#include "records.glsl"

// The distance of nothing: the largest finite number.
const float FARTHEST = 3.402823466e38;
// Below this numbers are subnormal.
const float SMALLEST_NORMAL = 1.17549435e-38;

struct Ray {
    vec3 origin;
    vec3 direction;
    Primitive leaves;  // that the origin lies on, which the ray cannot hit; or none
};

struct Hit {
    Primitive primitive;  // or none
    vec2 barycentrics;    // weights of the second and third vertex
    float distance;       // in lengths of the ray's direction
};

struct Surface {
    vec3 position;
    vec3 position_error;    // bound of the rounding error of each coordinate
    vec3 geometric_normal;  // unit, out of the front side
    vec3 shading_normal;    // unit, on the same side
    vec3 smooth_normal;     // the same before an image turns it
    vec2 uv;
    vec3 along_u;           // the change of position by the first texture coordinate, zero where there is none
    vec3 along_v;           // by the second
    vec3 colour;            // that multiplies the diffuse reflectance
    Primitive primitive;
    uint material;
};

// Whether shading normals may differ from geometric ones, and whether it matters where texture coordinates grow.
const bool HAS_SHADING_NORMALS = HAS_NORMALS || HAS_NORMAL_TEXTURES;
const bool HAS_TANGENTS = HAS_ANISOTROPY || HAS_NORMAL_TEXTURES;

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

// The side of the surface that `direction` leaves to: +1 front, -1 back.
float side_of(Surface surface, vec3 direction) { return dot(surface.geometric_normal, direction) < 0.0 ? -1.0 : 1.0; }

// Whether an image turned the shading normal.
bool is_turned(Surface surface) {
    return HAS_NORMAL_TEXTURES && any(notEqual(surface.smooth_normal, surface.shading_normal));
}

// The shading normal on the side that `direction` leaves to.
vec3 normal_towards(Surface surface, vec3 direction) { return surface.shading_normal * side_of(surface, direction); }

// A ray that leaves the surface to whichever side its direction points. A fixed offset takes it far enough off its plane
// that it need not remember the primitive.
Ray spawn_ray(Surface surface, vec3 direction) {
    vec3 side = dot(surface.geometric_normal, direction) < 0.0 ? -surface.geometric_normal : surface.geometric_normal;
    Primitive leaves = surface.primitive;
    if (FIXED_OFFSETS) {
        leaves = no_primitive();
    }
    return Ray(offset_from_plane(surface.position, surface.position_error, side), direction, leaves);
}

// Texture coordinates at barycentrics of a primitive, whose index in the scene's order is `original`.
vec2 corner_uv_at(Primitive primitive, uint original, vec2 barycentrics) {
    CornerUvs uvs = fetch_corner_uvs(primitive, original);
    return (1.0 - barycentrics.x - barycentrics.y) * uvs.a + barycentrics.x * uvs.b + barycentrics.y * uvs.c;
}

vec3 geometric_normal(Triangle t) { return normalize(cross(t.v1 - t.v0, t.v2 - t.v0)); }

Surface surface_at(Hit hit) {
    Triangle t = fetch_triangle(hit.primitive);
    Surface surface;
    surface.position = interpolate_position(t, hit.barycentrics, surface.position_error);
    surface.geometric_normal = geometric_normal(t);
    surface.shading_normal = surface.geometric_normal;
    surface.uv = vec2(0.0);
    surface.along_u = vec3(0.0);
    surface.along_v = vec3(0.0);
    surface.colour = vec3(1.0);
    surface.primitive = hit.primitive;
    surface.material = t.material;
    vec3 weights = vec3(1.0 - hit.barycentrics.x - hit.barycentrics.y, hit.barycentrics);
    if (HAS_NORMALS) {
        Normals normals = fetch_corner_normals(hit.primitive, t.original);
        vec3 n = weights.x * normals.a + weights.y * normals.b + weights.z * normals.c;
        // Normals of opposite corners can cancel. The geometric normal says which side is which.
        float len = length(n);
        if (normals.present && len > 1e-6) {
            n *= 1.0 / len;
            surface.shading_normal = dot(n, surface.geometric_normal) < 0.0 ? -n : n;
        }
    }
    surface.smooth_normal = surface.shading_normal;
    if (HAS_VERTEX_COLOURS) {
        surface.colour = fetch_vertex_colour(hit.primitive, t.original, weights);
    }
    if (HAS_TEXTURES || HAS_DETAIL_TEXTURES || HAS_TANGENTS) {
        CornerUvs uvs = fetch_corner_uvs(hit.primitive, t.original);
        surface.uv = weights.x * uvs.a + weights.y * uvs.b + weights.z * uvs.c;
        if (HAS_TANGENTS) {
            vec2 ab = uvs.b - uvs.a;
            vec2 ac = uvs.c - uvs.a;
            float determinant = ab.x * ac.y - ab.y * ac.x;
            float inverse = determinant != 0.0 ? 1.0 / determinant : 0.0;
            surface.along_u = (ac.y * (t.v1 - t.v0) - ab.y * (t.v2 - t.v0)) * inverse;
            surface.along_v = (ab.x * (t.v2 - t.v0) - ac.x * (t.v1 - t.v0)) * inverse;
        }
    }
    return surface;
}

#endif
