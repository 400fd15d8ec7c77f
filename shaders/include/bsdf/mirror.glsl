// A perfect mirror.
#ifndef MIRROR_GLSL
#define MIRROR_GLSL
#include "bsdf/contract.glsl"

const uint MIRROR_FLAGS = BSDF_SPECULAR | BSDF_REFLECT;

BsdfSample sample_mirror(Material m, Surface surface, vec3 wo) {
    vec3 wi = reflect(-wo, mirroring_normal(surface, wo));
    return BsdfSample(wi, m.ks, ONE_DIRECTION, BSDF_SPECULAR | BSDF_REFLECT, 1.0);
}

#endif
