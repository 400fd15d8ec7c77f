// No surface: light goes on as it came. It is what is left where an opacity is below 1.
#ifndef NOTHING_GLSL
#define NOTHING_GLSL
#include "bsdf/contract.glsl"

const uint NOTHING_FLAGS = BSDF_SPECULAR | BSDF_TRANSMIT;

BsdfSample sample_nothing(vec3 wo) {
    return BsdfSample(-wo, vec3(1.0), ONE_DIRECTION, BSDF_SPECULAR | BSDF_TRANSMIT, 1.0);
}

#endif
