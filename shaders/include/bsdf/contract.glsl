// What every BSDF answers. Directions point away from the surface: `wo` back along the path, `wi` onwards, towards the
// light.
//
// A BSDF called X is a file of this folder with
//     const uint X_FLAGS                                                its components, BSDF_*
//     BsdfSample sample_x(Material m, Surface surface, vec3 wo, ...)    a direction, drawn by random numbers
//     BsdfValue evaluate_x(Material m, Surface surface, vec3 wo, vec3 wi)  unless all of it is specular
// and a branch in each function of bsdf.glsl. Nobody else asks which BSDF a material has.
#ifndef CONTRACT_GLSL
#define CONTRACT_GLSL
#include "material.glsl"

// Components of a BSDF.
const uint BSDF_DIFFUSE = 1u;
const uint BSDF_GLOSSY = 2u;
const uint BSDF_SPECULAR = 4u;  // one direction for each wo
const uint BSDF_REFLECT = 8u;
const uint BSDF_TRANSMIT = 16u;
const uint BSDF_NON_SPECULAR = BSDF_DIFFUSE | BSDF_GLOSSY;

// Stands for the pdf of a direction that is the only one.
const float ONE_DIRECTION = FARTHEST;

// Above any pdf over solid angle that is not of one direction, and small enough that its square is finite.
const float LARGEST_PDF = 1e18;

// A direction drawn from a BSDF.
struct BsdfSample {
    vec3 direction;
    vec3 weight;  // f cos / pdf, zero where the path ends
    float pdf;    // over solid angle, or ONE_DIRECTION
    uint flags;   // the component that it was drawn from: BSDF_*
    float eta;    // index of refraction of what the direction leads into: 1 outside, the material's own inside
};

float mean3(vec3 c) { return (c.x + c.y + c.z) * (1.0 / 3.0); }

// A BSDF for a pair of directions.
struct BsdfValue {
    vec3 f_cos;
    float pdf;  // with which `wi` is drawn, over solid angle
};

// A direction that was drawn, by the value of its BSDF there.
BsdfSample sample_of(BsdfValue value, vec3 direction, uint flags, float eta) {
    vec3 weight = value.pdf > 0.0 ? value.f_cos / value.pdf : vec3(0.0);
    // Rounding must not make a direction that was drawn one that cannot be.
    return BsdfSample(direction, weight, clamp(value.pdf, 1e-20, LARGEST_PDF), flags, eta);
}

// Whether a material is of KIND, for which kernels have code under HAS_KIND. OTHERS says whether they have code for any
// of the kinds that it could be else at this place: without it, it is of that kind.
#define IS_KIND(KIND, OTHERS, MATERIAL) (HAS_##KIND && (!(OTHERS) || (MATERIAL).surface == SURFACE_##KIND))

// The normal about which a surface mirrors `wo`. A normal of vertices that faces away, or reflects into the surface, gives way
// to the geometric one, so that no triangle is black. One that an image turned stays: what it sends into the surface is lost.
vec3 mirroring_normal(Surface surface, vec3 wo) {
    float side = side_of(surface, wo);
    vec3 n = surface.shading_normal * side;
    bool bent = dot(n, wo) <= 0.0 || (!is_turned(surface) && side_of(surface, reflect(-wo, n)) != side);
    return HAS_SHADING_NORMALS && bent ? surface.geometric_normal * side : n;
}

// Whether `wi`, at a cosine from the normal towards `wo`, is on the side of `wo` by that normal and by geometry.
bool is_reflected(Surface surface, vec3 wo, vec3 wi, float cosine) {
    return cosine > 0.0 && side_of(surface, wo) == side_of(surface, wi);
}

#endif
