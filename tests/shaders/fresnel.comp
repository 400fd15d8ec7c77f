// Reflectance by the cosines on both sides and the relative index.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "bsdf.glsl"

vec4 probe(vec4 query) { return vec4(fresnel(query.x, query.y, query.z), 0.0, 0.0, 0.0); }

PROBE(vec4, vec4)
