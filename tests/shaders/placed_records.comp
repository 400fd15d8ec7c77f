// What kernels see of a triangle of a mesh in its place, each by the function that reads it for the renderer.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "probe.glsl"
#include "bvh.glsl"
#include "light.glsl"

struct Answer {
    vec4 v0;
    vec4 v1;
    vec4 v2;
    vec4 normals[3];
    vec4 uvs[3];
    vec4 to_mesh[3];
    uvec4 words;  // bits of the area over the probability, root of the mesh's tree, triangle and instance of its light
};

// Takes a place in leaf order and an instance.
Answer probe(uvec4 query) {
    Primitive primitive = Primitive(query.x, query.y);
    Triangle t = fetch_triangle(primitive);
    Normals normals = fetch_corner_normals(primitive, t.original);
    CornerUvs uvs = fetch_corner_uvs(primitive, t.original);
    uint root;
    fetch_placement(primitive.instance, root);
    ToMesh to = fetch_to_mesh(primitive.instance);
    uint light = first_light(primitive.instance) + fetch_triangles(TRIANGLE_TEXELS * primitive.triangle + 2u).w;
    Primitive lamp = fetch_light(light).primitive;
    return Answer(vec4(t.v0, 0.0), vec4(t.v1, 0.0), vec4(t.v2, 0.0),
        vec4[3](vec4(normals.a, 0.0), vec4(normals.b, 0.0), vec4(normals.c, 0.0)),
        vec4[3](vec4(uvs.a, 0.0, 0.0), vec4(uvs.b, 0.0, 0.0), vec4(uvs.c, 0.0, 0.0)), vec4[3](to.x, to.y, to.z),
        uvec4(floatBitsToUint(light_area(primitive)), root, lamp.triangle, lamp.instance));
}

PROBE(uvec4, Answer)
