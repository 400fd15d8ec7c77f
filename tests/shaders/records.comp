// The fields of scene records, each read by the function that reads it for the renderer.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "bvh.glsl"
#include "light.glsl"

struct Answer {
    vec4 v0;         // material as bits
    vec4 v1;         // place in the scene's order as bits
    vec4 v2;
    vec4 kd;         // surface as bits
    vec4 ks;         // ns
    vec4 ke;         // ni
    vec4 tf;
    vec4 normal;     // shading normal at the first corner; 1 if it is the geometric one
    vec4 radiance;   // of an environment texel
};

// Takes an index, and which of it a texel of the environment is.
Answer probe(uvec4 index) {
    Triangle t = fetch_triangle(index.x);
    Material m = fetch_material(index.x, vec2(0.0));
    Surface surface = surface_at(Hit(index.x, vec2(index.yz), 0.0));
    return Answer(vec4(t.v0, uintBitsToFloat(t.material)), vec4(t.v1, uintBitsToFloat(t.original)), vec4(t.v2, 0.0),
        vec4(m.kd, uintBitsToFloat(m.surface)), vec4(m.ks, m.ns), vec4(m.ke, m.ni), vec4(m.tf, 0.0),
        vec4(surface.shading_normal, float(surface.shading_normal == surface.geometric_normal)),
        vec4(environment_texel(ivec2(index.x % frame.environment_width, index.x / frame.environment_width)), 0.0));
}

PROBE(uvec4, Answer)
