// The fields of scene records, each read by the function that reads it for the renderer.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "bvh.glsl"
#include "light.glsl"

struct Answer {
    vec4 v0;
    vec4 v1;
    vec4 v2;
    vec4 kd;
    vec4 ks;        // ns
    vec4 ke;        // ni
    vec4 tf;
    vec4 normal;    // shading normal at a corner of the triangle
    vec4 radiance;  // of the environment's texel
    uvec4 words;    // the triangle's material and place in the scene's order, the material's surface
};

// Takes the index of the records, and barycentrics of 0 and 1.
Answer probe(uvec4 query) {
    uint index = query.x;
    Triangle t = fetch_triangle(index);
    Surface surface = surface_at(Hit(world_primitive(index), vec2(query.yz), 0.0));
    Surface textured = surface;
    textured.material = index;
    textured.uv = vec2(0.0);
    Material m = material_at(textured);
    ivec2 at = ivec2(index % frame.environment_width, index / frame.environment_width);
    return Answer(vec4(t.v0, 0.0), vec4(t.v1, 0.0), vec4(t.v2, 0.0), vec4(m.kd, 0.0), vec4(m.ks, m.ns),
        vec4(m.ke, m.ni), vec4(m.tf, 0.0), vec4(surface.shading_normal, 0.0), vec4(environment_texel(at), 0.0),
        uvec4(t.material, t.original, m.surface, 0u));
}

PROBE(uvec4, Answer)
