// The bin that a ray is sorted into: what shading it will do.
#ifndef MATERIAL_BIN_GLSL
#define MATERIAL_BIN_GLSL
#include "path_state.glsl"

uint material_bin(Hit hit) {
    uint bin = 0u;
    if (!is_none(hit.primitive)) {
        uint surface = material_surface(triangle_material(hit.primitive.triangle));
        bin = 1u + (MATERIAL_BRANCHES > 1u ? material_branch(hit.primitive) : surface);
    }
    return bin;
}

#endif
