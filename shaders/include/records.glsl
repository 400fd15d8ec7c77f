// Scene records: the only functions that know how they lie in memory. Their fields are those of src/layout.rs.
#ifndef RECORDS_GLSL
#define RECORDS_GLSL
#include "specialization.glsl"
#include "bindings_scene.glsl"

struct Triangle {
    vec3 v0;
    vec3 v1;
    vec3 v2;
    uint material;
    uint original;  // index in the scene's order
};

Triangle fetch_triangle(uint index) {
    uvec4 a = fetch_triangles(TRIANGLE_TEXELS * index);
    uvec4 b = fetch_triangles(TRIANGLE_TEXELS * index + 1u);
    uvec4 c = fetch_triangles(TRIANGLE_TEXELS * index + 2u);
    return Triangle(uintBitsToFloat(a.xyz), uintBitsToFloat(b.xyz), uintBitsToFloat(c.xyz), b.w, a.w);
}

uint triangle_material(uint index) { return fetch_triangles(TRIANGLE_TEXELS * index + 1u).w; }

// Area of an emissive triangle over the probability that light sampling picks it; 0 of any other.
float light_area(uint index) { return uintBitsToFloat(fetch_triangles(TRIANGLE_TEXELS * index + 2u).w); }

struct Material {
    vec3 kd;       // Lambert reflectance
    uint surface;  // one of SURFACE_*
    vec3 ks;       // Phong lobe weight, or mirror reflectance
    float ns;      // Phong exponent
    vec3 ke;       // emitted radiance
    float ni;      // index of refraction inside
    vec3 tf;       // tint of transmitted light
    uint map_kd;   // one more than the header of the image that replaces kd; 0 without one
};

Material fetch_material(uint index) {
    uvec4 a = fetch_materials(MATERIAL_TEXELS * index);
    uvec4 b = fetch_materials(MATERIAL_TEXELS * index + 1u);
    uvec4 c = fetch_materials(MATERIAL_TEXELS * index + 2u);
    uvec4 d = fetch_materials(MATERIAL_TEXELS * index + 3u);
    return Material(uintBitsToFloat(a.xyz), a.w, uintBitsToFloat(b.xyz), uintBitsToFloat(b.w),
        uintBitsToFloat(c.xyz), uintBitsToFloat(c.w), uintBitsToFloat(d.xyz), d.w);
}

uint material_surface(uint index) { return fetch_materials(MATERIAL_TEXELS * index).w; }

vec3 material_emission(uint index) { return uintBitsToFloat(fetch_materials(MATERIAL_TEXELS * index + 2u).xyz); }

// A cell of the alias table of emissive triangles.
struct Light {
    uint triangle;
    float threshold;  // probability that the cell stands for itself
    uint alias;       // the light that it stands for otherwise
};

Light fetch_light(uint index) {
    uvec4 light = fetch_lights(index);
    return Light(light.x, uintBitsToFloat(light.y), light.z);
}

// Decodes a unit vector. (Cigolle et al. 2014, octahedral, 16 bits a coordinate)
vec3 decode_normal(uint bits) {
    vec2 p = unpackSnorm2x16(bits);
    vec3 n = vec3(p, 1.0 - abs(p.x) - abs(p.y));
    float fold = max(-n.z, 0.0);
    n.x += n.x >= 0.0 ? -fold : fold;
    n.y += n.y >= 0.0 ? -fold : fold;
    return normalize(n);
}

// Shading normals of the corners of a triangle.
struct Normals {
    vec3 a;
    vec3 b;
    vec3 c;
    bool present;
};

Normals fetch_corner_normals(uint original) {
    uvec4 corners = fetch_normals(original);
    return Normals(decode_normal(corners.x), decode_normal(corners.y), decode_normal(corners.z), corners.w != 0u);
}

vec2 fetch_corner_uv(uint original, uint corner) {
    return uintBitsToFloat(fetch_texture_coordinates(3u * original + corner));
}

// An image is a header of its size, then its texels in rows.
ivec2 image_size(uint header) { return ivec2(fetch_textures(header)); }

// Linear RGB of the texel at that place in the image's rows.
vec3 image_texel(uint header, uint place) {
    uvec2 bits = fetch_textures(header + 1u + place);
    return vec3(unpackHalf2x16(bits.x), unpackHalf2x16(bits.y).x);
}

// Texels of the lat-long environment by their place in its rows.
vec3 environment_texel_radiance(uint place) { return uintBitsToFloat(fetch_environment(place).xyz); }

// Probability that light sampling picks the texel.
float environment_texel_probability(uint place) { return uintBitsToFloat(fetch_environment(place).w); }

// How light sampling chooses between the quarters of a block of the environment.
struct EnvironmentSplit {
    float upper;      // probability of the upper half
    float upper_left; // of the left quarter in the upper half
    float lower_left; // of the left quarter in the lower half
};

EnvironmentSplit fetch_environment_split(uint index) {
    vec3 split = uintBitsToFloat(fetch_environment_splits(index).xyz);
    return EnvironmentSplit(split.x, split.y, split.z);
}

// An inner node of the two-wide BVH: the boxes of its children and references to them.
struct BinaryNode {
    vec3 left_low;
    vec3 left_high;
    uint left;
    vec3 right_low;
    vec3 right_high;
    uint right;
};

BinaryNode fetch_binary_node(uint index) {
    uvec4 left_low = fetch_nodes(NODE_TEXELS * index);
    uvec4 left_high = fetch_nodes(NODE_TEXELS * index + 1u);
    uvec4 right_low = fetch_nodes(NODE_TEXELS * index + 2u);
    uvec4 right_high = fetch_nodes(NODE_TEXELS * index + 3u);
    return BinaryNode(uintBitsToFloat(left_low.xyz), uintBitsToFloat(left_high.xyz), left_low.w,
        uintBitsToFloat(right_low.xyz), uintBitsToFloat(right_high.xyz), right_low.w);
}

// Low and high planes of the boxes of four children on the grid of their node, a byte a child.
struct FourBoxes {
    uvec2 x;
    uvec2 y;
    uvec2 z;
};

// A node of a four- or eight-wide BVH: four texels for four children, five for eight. An inner child is the node at
// the place of children + its octant. Its meta is 001 and WIDE_INNER_BIT + its octant (5 bits); that of a leaf its
// triangles in unary (3 bits) and the first of them, from the node's first triangle on (5 bits).
struct WideNode {
    vec3 origin;          // of the grid
    uint exponents;       // of the grid's steps, a byte an axis
    uint children;        // place of its children << 8
    uint first_triangle;
    uvec2 metas;          // a byte a child: of the first four, then of the others
    FourBoxes first;
    FourBoxes others;     // of eight children
};

const uint WIDE_TEXELS = BVH_WIDTH == 8u ? 5u : 4u;

WideNode fetch_wide_node(uint index) {
    uvec4 grid = fetch_nodes(WIDE_TEXELS * index);
    uvec4 links = fetch_nodes(WIDE_TEXELS * index + 1u);
    uvec4 planes = fetch_nodes(WIDE_TEXELS * index + 2u);
    uvec4 more_planes = fetch_nodes(WIDE_TEXELS * index + 3u);
    uvec4 last_planes = uvec4(0u);
    if (BVH_WIDTH == 8u) {
        last_planes = fetch_nodes(WIDE_TEXELS * index + 4u);
    }
    return WideNode(uintBitsToFloat(grid.xyz), grid.w, links.x, links.y, links.zw,
        FourBoxes(planes.xy, planes.zw, more_planes.xy), FourBoxes(more_planes.zw, last_planes.xy, last_planes.zw));
}

#endif
