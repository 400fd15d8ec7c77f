// What a pipeline is built for: the host sets these from the scene's features, and the driver
// removes the code of all that the scene does not need. A kernel that has more than a scene needs
// gives the same bits: the scene's data then say what is there.
#ifndef SPECIALIZATION_GLSL
#define SPECIALIZATION_GLSL
#include "constants.glsl"

layout(constant_id = SPEC_STACK_SIZE) const uint STACK_SIZE = 64u;
layout(constant_id = SPEC_INTEGRATOR) const uint INTEGRATOR = INTEGRATOR_EXPLICIT;
layout(constant_id = SPEC_ENVIRONMENT) const uint ENVIRONMENT = ENVIRONMENT_BLACK;
layout(constant_id = SPEC_HAS_LIGHTS) const bool HAS_LIGHTS = true;
layout(constant_id = SPEC_HAS_PHONG) const bool HAS_PHONG = true;
layout(constant_id = SPEC_HAS_MIRROR) const bool HAS_MIRROR = true;
layout(constant_id = SPEC_HAS_REFRACTIVE) const bool HAS_REFRACTIVE = true;
layout(constant_id = SPEC_HAS_DIELECTRIC) const bool HAS_DIELECTRIC = true;
layout(constant_id = SPEC_HAS_TEXTURES) const bool HAS_TEXTURES = true;
layout(constant_id = SPEC_HAS_NORMALS) const bool HAS_NORMALS = true;
layout(constant_id = SPEC_HAS_LENS) const bool HAS_LENS = true;
layout(constant_id = SPEC_HAS_ROULETTE) const bool HAS_ROULETTE = true;
layout(constant_id = SPEC_SHADING_COST) const uint SHADING_COST = 0u;
layout(constant_id = SPEC_MATERIAL_BRANCHES) const uint MATERIAL_BRANCHES = 1u;
layout(constant_id = SPEC_SORTED) const bool SORTED = false;
layout(constant_id = SPEC_REGENERATES) const bool REGENERATES = false;
layout(constant_id = SPEC_BVH_WIDTH) const uint BVH_WIDTH = 2u;
layout(constant_id = SPEC_LISTED_COUNT) const uint LISTED_COUNT = 0u;
layout(constant_id = SPEC_HAS_GLOSSY) const bool HAS_GLOSSY = true;
layout(constant_id = SPEC_SCATTERS) const bool SCATTERS = true;
layout(constant_id = SPEC_BOUNDED) const bool BOUNDED = true;
layout(constant_id = SPEC_CASTS_SHADOWS) const bool CASTS_SHADOWS = true;
layout(constant_id = SPEC_DEFERS_SHADOW_RAYS) const bool DEFERS_SHADOW_RAYS = true;
layout(constant_id = SPEC_HALF_STATE) const bool HALF_STATE = false;
layout(constant_id = SPEC_FIXED_OFFSETS) const bool FIXED_OFFSETS = false;
layout(constant_id = SPEC_SOBOL) const bool SOBOL = false;
layout(constant_id = SPEC_ROULETTE_BY_THROUGHPUT) const bool ROULETTE_BY_THROUGHPUT = false;
layout(constant_id = SPEC_CLAMPS) const bool CLAMPS = false;
layout(constant_id = SPEC_HAS_DISTANCE) const bool HAS_DISTANCE = true;

const bool EXPLICIT = INTEGRATOR == INTEGRATOR_EXPLICIT;
const bool MIS = INTEGRATOR == INTEGRATOR_MIS;
const bool HAS_GLASS = HAS_REFRACTIVE || HAS_DIELECTRIC;
const bool HAS_SPECULAR = HAS_MIRROR || HAS_GLASS;

#endif
