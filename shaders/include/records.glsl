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

// What a ray can hit.
struct Primitive {
    uint triangle;  // its place in leaf order, or NO_TRIANGLE
    uint instance;  // with TWO_LEVEL the mesh in its place that it is of, else WORLD_INSTANCE
};

// A triangle in leaf order of no mesh in its place.
Primitive world_primitive(uint triangle) { return Primitive(triangle, WORLD_INSTANCE); }

Primitive no_primitive() { return Primitive(NO_TRIANGLE, TWO_LEVEL ? NO_TRIANGLE : WORLD_INSTANCE); }

bool same_primitive(Primitive a, Primitive b) {
    return a.triangle == b.triangle && (!TWO_LEVEL || a.instance == b.instance);
}

bool is_none(Primitive primitive) { return primitive.triangle == NO_TRIANGLE; }

// Where a mesh is placed: its axes and its origin in normalised space.
struct Placement {
    vec3 x_axis;
    vec3 y_axis;
    vec3 z_axis;
    vec3 translation;
    bool is_mirrored;  // the second and third corners of its triangles change places
};

Placement no_placement() {
    return Placement(vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0), vec3(0.0), false);
}

Placement fetch_placement(uint instance, out uint root) {
    uvec4 a = fetch_instances(INSTANCE_TEXELS * instance);
    uvec4 b = fetch_instances(INSTANCE_TEXELS * instance + 1u);
    uvec4 c = fetch_instances(INSTANCE_TEXELS * instance + 2u);
    uvec4 d = fetch_instances(INSTANCE_TEXELS * instance + 3u);
    root = a.w;
    return Placement(uintBitsToFloat(a.xyz), uintBitsToFloat(b.xyz), uintBitsToFloat(c.xyz), uintBitsToFloat(d.xyz), b.w != 0u);
}

bool is_mirrored(uint instance) { return fetch_instances(INSTANCE_TEXELS * instance + 1u).w != 0u; }

// The light that is the first of an instance.
uint first_light(uint instance) { return fetch_instances(INSTANCE_TEXELS * instance + 2u).w; }

// What takes rays to the coordinates of a mesh: the columns of a linear map, and how far boxes are widened there.
struct ToMesh {
    vec4 x;
    vec4 y;
    vec4 z;
};

ToMesh fetch_to_mesh(uint instance) {
    uint place = INSTANCE_TEXELS * instance + 4u;
    return ToMesh(uintBitsToFloat(fetch_instances(place)), uintBitsToFloat(fetch_instances(place + 1u)),
        uintBitsToFloat(fetch_instances(place + 2u)));
}

// A normal of a mesh in its place in normalised space, to any length.
vec3 placed_normal(uint instance, vec3 n) {
    uint place = INSTANCE_TEXELS * instance + 7u;
    vec3 x = uintBitsToFloat(fetch_instances(place).xyz);
    vec3 y = uintBitsToFloat(fetch_instances(place + 1u).xyz);
    vec3 z = uintBitsToFloat(fetch_instances(place + 2u).xyz);
    return x * n.x + y * n.y + z * n.z;
}

// A vertex of a mesh in normalised space: by these operations in this order, as the host places those of meshes that it
// flattens.
vec3 place(Placement at, vec3 v) { return at.x_axis * v.x + at.y_axis * v.y + at.z_axis * v.z + at.translation; }

Triangle place(Placement at, Triangle t) {
    vec3 b = place(at, t.v1);
    vec3 c = place(at, t.v2);
    return Triangle(place(at, t.v0), at.is_mirrored ? c : b, at.is_mirrored ? b : c, t.material, t.original);
}

// As it is in memory: of a mesh in its place, in the mesh's own coordinates.
Triangle fetch_triangle(uint index) {
    uvec4 a = fetch_triangles(TRIANGLE_TEXELS * index);
    uvec4 b = fetch_triangles(TRIANGLE_TEXELS * index + 1u);
    uvec4 c = fetch_triangles(TRIANGLE_TEXELS * index + 2u);
    return Triangle(uintBitsToFloat(a.xyz), uintBitsToFloat(b.xyz), uintBitsToFloat(c.xyz), b.w, a.w);
}

// In normalised space.
Triangle fetch_triangle(Primitive primitive) {
    Triangle t = fetch_triangle(primitive.triangle);
    if (TWO_LEVEL) {
        uint root;
        t = place(fetch_placement(primitive.instance, root), t);
    }
    return t;
}

uint triangle_material(uint index) { return fetch_triangles(TRIANGLE_TEXELS * index + 1u).w; }

// Area of an emissive triangle over the probability that light sampling picks it; 0 of any other.
float light_area(Primitive primitive) {
    uint area = fetch_triangles(TRIANGLE_TEXELS * primitive.triangle + 2u).w;
    if (TWO_LEVEL) {
        // It is the number of the triangle among the lights of its mesh.
        area = fetch_placed_lights(first_light(primitive.instance) + area).y;
    }
    return uintBitsToFloat(area);
}

// What only principled materials have, each in [0, 1].
struct Principled {
    float anisotropy;            // how far apart the widths of microfacets are
    float sheen;
    float sheen_tint;            // how far the base colour tints it
    float specular_tint;         // how far the base colour tints what a dielectric reflects
    float specular_share;        // of what is specular in place of the diffuse body
    float flatness;              // share of diffuse light that seems to come from below the surface
    float diffuse_transmission;  // share of diffuse light that is transmitted
};

// What some materials have beyond the words of each.
struct MaterialDetail {
    vec3 eta;                 // real part of a metal's index of refraction
    vec3 absorption;          // its imaginary part
    vec2 alpha;               // widths of the microfacets' distribution along the tangent and across it
    float metalness;          // share of metal
    float coat;               // share of the clear coat
    float coat_alpha;         // width of the distribution of its microfacets
    bool beckmann;            // whether the distribution is Beckmann's, and not GGX
    bool nonlinear;           // whether what is reflected inside a coat shifts the colour of its base
    float inner_reflectance;  // share of diffuse light that the inside of a coat reflects
    vec3 mean_reflectance;    // at the microfacets, weighted by the cosine
    uint table;               // of microfacets: one more than its place, or 0
    bool transmits;           // whether a principled body has an inside
    Principled principled;
};

struct Material {
    vec3 kd;       // Lambert reflectance, or base colour
    uint surface;  // one of SURFACE_*
    vec3 ks;       // Phong lobe weight, mirror reflectance, or what multiplies other specular reflection
    float ns;      // Phong exponent
    vec3 ke;       // emitted radiance
    float ni;      // index of refraction inside
    vec3 tf;       // tint of transmitted light
    uint map_kd;   // one more than the header of the image that replaces kd; 0 without one
    MaterialDetail detail;
};

const bool HAS_METALS = HAS_SMOOTH_CONDUCTOR || HAS_CONDUCTOR;
const bool HAS_COATS = HAS_PLASTIC || HAS_ROUGH_PLASTIC || HAS_METAL_ROUGH;
const bool HAS_ANY_PRINCIPLED = HAS_PRINCIPLED || HAS_PRINCIPLED_THIN;
const bool HAS_DETAILS = HAS_METALS || HAS_COATS || HAS_ROUGH_DIELECTRIC || HAS_ANY_PRINCIPLED || HAS_DETAIL_TEXTURES;

MaterialDetail fetch_material_detail(uint index) {
    uint place = MATERIAL_DETAIL_TEXELS * index;
    uvec4 a = fetch_material_details(place);
    uvec4 b = fetch_material_details(place + 1u);
    vec3 c = uintBitsToFloat(fetch_material_details(place + 2u).xyz);
    uvec2 f = fetch_material_details(place + 7u).zw;
    uvec4 g = fetch_material_details(place + 8u);
    Principled principled;
    if (HAS_ANY_PRINCIPLED) {
        vec4 h = uintBitsToFloat(fetch_material_details(place + 9u));
        vec3 i = uintBitsToFloat(fetch_material_details(place + 10u).xyz);
        principled = Principled(h.x, h.y, h.z, h.w, i.x, i.y, i.z);
    }
    return MaterialDetail(uintBitsToFloat(a.xyz), uintBitsToFloat(b.xyz), uintBitsToFloat(uvec2(a.w, b.w)), c.x, c.y, c.z,
        (f.x & DETAIL_BECKMANN) != 0u, (f.x & DETAIL_NONLINEAR) != 0u, uintBitsToFloat(f.y), uintBitsToFloat(g.xyz), g.w,
        (f.x & DETAIL_TRANSMITS) != 0u, principled);
}

Material fetch_material(uint index) {
    uvec4 a = fetch_materials(MATERIAL_TEXELS * index);
    uvec4 b = fetch_materials(MATERIAL_TEXELS * index + 1u);
    uvec4 c = fetch_materials(MATERIAL_TEXELS * index + 2u);
    uvec4 d = fetch_materials(MATERIAL_TEXELS * index + 3u);
    MaterialDetail detail;
    if (HAS_DETAILS) {
        detail = fetch_material_detail(index);
    }
    return Material(uintBitsToFloat(a.xyz), a.w, uintBitsToFloat(b.xyz), uintBitsToFloat(b.w),
        uintBitsToFloat(c.xyz), uintBitsToFloat(c.w), uintBitsToFloat(d.xyz), d.w, detail);
}

// The image that gives a parameter of a material, MAP_*: one more than its header; 0 is none.
uint material_map(uint index, uint parameter) {
    uvec4 maps = fetch_material_details(MATERIAL_DETAIL_TEXELS * index + 3u + (parameter >> 2u));
    return maps[parameter & 3u];
}

// Share of a blend's first part, and both parts; or the front and the back.
float blend_weight(uint index) { return uintBitsToFloat(fetch_material_details(MATERIAL_DETAIL_TEXELS * index + 2u).w); }

uvec2 blend_parts(uint index) { return fetch_material_details(MATERIAL_DETAIL_TEXELS * index + 7u).xy; }

uint material_surface(uint index) { return fetch_materials(MATERIAL_TEXELS * index).w; }

vec3 material_emission(uint index) { return uintBitsToFloat(fetch_materials(MATERIAL_TEXELS * index + 2u).xyz); }

// A cell of the alias table of emissive triangles.
struct Light {
    Primitive primitive;
    float threshold;  // probability that the cell stands for itself
    uint alias;       // the light that it stands for otherwise
};

Light fetch_light(uint index) {
    uvec4 light = fetch_lights(index);
    Primitive primitive = world_primitive(light.x);
    if (TWO_LEVEL) {
        primitive.instance = fetch_placed_lights(index).x;
    }
    return Light(primitive, uintBitsToFloat(light.y), light.z);
}

// A light that is no surface, a cell of the alias table of them.
struct PunctualLight {
    vec3 position;
    uint kind;        // one of LIGHT_*
    vec3 direction;   // where the light goes
    float threshold;  // probability that the cell stands for itself
    vec3 emission;    // power per solid angle, or irradiance, over the probability of its pick
    uint alias;       // the light that the cell stands for otherwise
    float full_from;  // of a spot: the angle from its axis, or the cosine, up to which its intensity is whole
    float none_from;  // and from which it is 0
};

PunctualLight fetch_punctual_light(uint index) {
    uvec4 a = fetch_punctual_lights(PUNCTUAL_LIGHT_TEXELS * index);
    uvec4 b = fetch_punctual_lights(PUNCTUAL_LIGHT_TEXELS * index + 1u);
    uvec4 c = fetch_punctual_lights(PUNCTUAL_LIGHT_TEXELS * index + 2u);
    vec2 d = uintBitsToFloat(fetch_punctual_lights(PUNCTUAL_LIGHT_TEXELS * index + 3u).xy);
    return PunctualLight(uintBitsToFloat(a.xyz), a.w, uintBitsToFloat(b.xyz), uintBitsToFloat(b.w),
        uintBitsToFloat(c.xyz), c.w, d.x, d.y);
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

// Encodes a vector of any length, as the host does. (The same)
uint encode_normal(vec3 n) {
    n = n / (abs(n.x) + abs(n.y) + abs(n.z));
    vec2 away = vec2(n.x >= 0.0 ? 1.0 - abs(n.y) : abs(n.y) - 1.0, n.y >= 0.0 ? 1.0 - abs(n.x) : abs(n.x) - 1.0);
    vec2 p = n.z >= 0.0 ? n.xy : away;
    uvec2 bits = uvec2(ivec2(floor(clamp(p, vec2(-1.0), vec2(1.0)) * 32767.0 + 0.5))) & 0xffffu;
    return bits.x | bits.y << 16;
}

// The normals of the primitive whose index in the scene's order is `original`. Those of a mesh in its place are encoded anew
// there, as they are where meshes are flattened.
Normals fetch_corner_normals(Primitive primitive, uint original) {
    uvec4 corners = fetch_normals(original);
    if (TWO_LEVEL) {
        uvec3 placed = uvec3(encode_normal(placed_normal(primitive.instance, decode_normal(corners.x))),
            encode_normal(placed_normal(primitive.instance, decode_normal(corners.y))),
            encode_normal(placed_normal(primitive.instance, decode_normal(corners.z))));
        corners.xyz = is_mirrored(primitive.instance) ? placed.xzy : placed;
    }
    return Normals(decode_normal(corners.x), decode_normal(corners.y), decode_normal(corners.z), corners.w != 0u);
}

// Texture coordinates of the corners of a triangle.
struct CornerUvs {
    vec2 a;
    vec2 b;
    vec2 c;
};

CornerUvs fetch_corner_uvs(Primitive primitive, uint original) {
    vec2 a = uintBitsToFloat(fetch_texture_coordinates(3u * original));
    vec2 b = uintBitsToFloat(fetch_texture_coordinates(3u * original + 1u));
    vec2 c = uintBitsToFloat(fetch_texture_coordinates(3u * original + 2u));
    bool swaps = false;
    if (TWO_LEVEL) {
        swaps = is_mirrored(primitive.instance);
    }
    return CornerUvs(a, swaps ? c : b, swaps ? b : c);
}

vec3 decode_colour(uvec2 halves) { return vec3(unpackHalf2x16(halves.x), unpackHalf2x16(halves.y).x); }

// What the diffuse reflectance of a primitive is multiplied by, at weights of its corners.
vec3 fetch_vertex_colour(Primitive primitive, uint original, vec3 weights) {
    uvec2 a = fetch_vertex_colours(3u * original);
    uvec2 b = fetch_vertex_colours(3u * original + 1u);
    uvec2 c = fetch_vertex_colours(3u * original + 2u);
    bool swaps = false;
    if (TWO_LEVEL) {
        swaps = is_mirrored(primitive.instance);
    }
    vec3 colour = weights.x * decode_colour(a) + weights.y * decode_colour(swaps ? c : b)
        + weights.z * decode_colour(swaps ? b : c);
    bool is_coloured = (a.y >> 16u) != 0u;
    return is_coloured ? colour : vec3(1.0);
}

// An image is a header, then its texels in rows.
ivec2 image_size(uint header) { return ivec2(fetch_textures(header)); }

// How texels are found for texture coordinates: LOOKUP_*.
uint image_lookup(uint header) { return fetch_textures(header + 1u).x; }

// The image's own coordinates at the surface's.
vec2 image_coordinates(uint header, vec2 uv) {
    vec2 x = uintBitsToFloat(fetch_textures(header + 2u));
    vec2 y = uintBitsToFloat(fetch_textures(header + 3u));
    vec2 origin = uintBitsToFloat(fetch_textures(header + 4u));
    return x * uv.x + y * uv.y + origin;
}

// Linear RGB of the texel at that place in the image's rows. Without lookups each image has its own texels behind its header.
vec3 image_texel(uint header, uint place) {
    uint first = header + IMAGE_HEADER_WORDS;
    if (HAS_LOOKUPS) {
        first = fetch_textures(header + 1u).y;
    }
    uvec2 bits = fetch_textures(first + place);
    return vec3(unpackHalf2x16(bits.x), unpackHalf2x16(bits.y).x);
}

// A table of microfacets at a cosine, in the rows next to a roughness: linear between equal steps of the roots of both.
float table_row_at(uint table, float row, float x) {
    float column = min(floor(x), float(TABLE_SIZE - 2u));
    vec2 pair = uintBitsToFloat(fetch_textures(table - 1u + uint(row) * TABLE_SIZE + uint(column)));
    return mix(pair.x, pair.y, x - column);
}

float table_at(uint table, float cosine, float alpha) {
    float x = sqrt(clamp(cosine, 0.0, 1.0)) * float(TABLE_SIZE - 1u);
    float y = sqrt(alpha) * float(TABLE_SIZE - 1u);
    float row = min(floor(y), float(TABLE_SIZE - 2u));
    return mix(table_row_at(table, row, x), table_row_at(table, row + 1.0, x), y - row);
}

// Its mean over the cosine, weighted by the cosine.
float table_mean(uint table, float alpha) {
    float y = sqrt(alpha) * float(TABLE_SIZE - 1u);
    float row = min(floor(y), float(TABLE_SIZE - 2u));
    vec2 pair = uintBitsToFloat(fetch_textures(table - 1u + TABLE_SIZE * TABLE_SIZE + uint(row)));
    return mix(pair.x, pair.y, y - row);
}

// The table behind another: of microfacets seen from inside.
uint next_table(uint table) { return table + TABLE_SIZE * TABLE_SIZE + TABLE_SIZE; }

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
