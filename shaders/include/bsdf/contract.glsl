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

// A direction drawn from a BSDF.
struct BsdfSample {
    vec3 direction;
    vec3 weight;  // f cos / pdf, zero where the path ends
    float pdf;    // over solid angle, or ONE_DIRECTION
    uint flags;   // the component that it was drawn from: BSDF_*
    float eta;    // index of refraction of what the direction leads into: 1 outside, the material's own inside
};

// A BSDF for a pair of directions.
struct BsdfValue {
    vec3 f_cos;
    float pdf;  // with which `wi` is drawn, over solid angle
};

// Whether a material is of KIND, for which kernels have code under HAS_KIND. OTHERS says whether they have code for any
// of the kinds that it could be else at this place: without it, it is of that kind.
#define IS_KIND(KIND, OTHERS, MATERIAL) (HAS_##KIND && (!(OTHERS) || (MATERIAL).surface == SURFACE_##KIND))

#endif
