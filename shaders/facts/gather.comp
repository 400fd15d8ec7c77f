// Follows links from node to node, as a ray follows a BVH: first as kernels fetch scene data, then by loads from a
// storage buffer. What a launch of either takes tells what a fetch costs.
// Threads: INVOCATIONS, in whole workgroups. Reads: nodes and links, which hold the same. Writes: ends.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"
#include "bindings_scene.glsl"
#include "bindings_path.glsl"

// What the push constants stand for here.
#define NODES batch.first_pixel
#define FETCHED_STEPS batch.first_sample
#define LOADED_STEPS batch.sample_count

layout(set = 2, binding = 0, std430) readonly buffer Links { uvec4 words[]; } links;
layout(set = 2, binding = 1, std430) writeonly buffer Ends { uint nodes[]; } ends;

// The node that four words lead to. Half of the components are read: of nodes kernels read all, of materials and lamps
// few, and by halves the two ways compare as renders by them do, on the drivers where both were timed.
uint next_node(uvec4 a, uvec4 b, uvec4 c, uvec4 d) {
    uvec2 links = a.xy ^ b.zw ^ c.yz ^ d.xw;
    return links.x ^ links.y;
}

void main() {
    uint node = gl_GlobalInvocationID.x % NODES;
    for (uint turn = 0u; turn < FETCHED_STEPS; turn++) {
        uint first = NODE_TEXELS * node;
        node = next_node(fetch_nodes(first), fetch_nodes(first + 1u), fetch_nodes(first + 2u), fetch_nodes(first + 3u));
    }
    for (uint turn = 0u; turn < LOADED_STEPS; turn++) {
        uint first = NODE_TEXELS * node;
        node = next_node(links.words[first], links.words[first + 1u], links.words[first + 2u], links.words[first + 3u]);
    }
    ends.nodes[gl_GlobalInvocationID.x] = node;
}
