// Subgroup operations, in the builds that have them.
#ifndef SUBGROUP_GLSL
#define SUBGROUP_GLSL
#ifdef SUBGROUP_BALLOT
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#endif
#endif
