// Subgroup operations. A device without them is handed kernels that have none: they stand under HAS_BALLOTS.
#ifndef SUBGROUP_GLSL
#define SUBGROUP_GLSL
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#include "switches.glsl"
#endif
