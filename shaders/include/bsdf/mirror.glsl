// A perfect mirror.
#ifndef MIRROR_GLSL
#define MIRROR_GLSL
#include "bsdf/contract.glsl"

const uint MIRROR_FLAGS = BSDF_SPECULAR | BSDF_REFLECT;

// The normal about which a specular surface mirrors `wo`. A shading normal that faces away, or reflects into the surface,
// gives way to the geometric one.
vec3 mirroring_normal(Surface surface, vec3 wo) {
    float side = side_of(surface, wo);
    vec3 n = surface.shading_normal * side;
    bool bent = dot(n, wo) <= 0.0 || side_of(surface, reflect(-wo, n)) != side;
    return HAS_NORMALS && bent ? surface.geometric_normal * side : n;
}

BsdfSample sample_mirror(Material m, Surface surface, vec3 wo) {
    vec3 wi = reflect(-wo, mirroring_normal(surface, wo));
    return BsdfSample(wi, m.ks, ONE_DIRECTION, BSDF_SPECULAR | BSDF_REFLECT, 1.0);
}

#endif
