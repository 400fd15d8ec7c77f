// The bin that a ray is sorted into: what shading it will do.
#ifndef MATERIAL_BIN_GLSL
#define MATERIAL_BIN_GLSL
#include "path_state.glsl"

uint material_bin(Hit hit) {
    uint bin = 0u;
    if (hit.triangle != NO_TRIANGLE) {
        uint material = fetch_triangles(TRIANGLE_TEXELS * hit.triangle + 1u).w;
        uint surface = fetch_materials(MATERIAL_TEXELS * material).w;
        bin = 1u + (MATERIAL_BRANCHES > 1u ? material_branch(hit.triangle) : surface);
    }
    return bin;
}

#endif
