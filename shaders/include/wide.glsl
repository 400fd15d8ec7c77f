// Traversal of four- and eight-wide BVHs with quantised boxes.
// (Ylitie, Karras and Laine 2017, Efficient Incoherent Ray Traversal on GPUs Through Compressed
// Wide BVHs)
//
// A node is four texels for four children, five for eight:
//     origin of its grid (three floats), exponents of the grid's steps (three bytes)
//     place of children << 8, first triangle, meta of each child (8 bytes)
//     low x, high x, low y, high y, low z, high z of four children (a byte each), then of the others
// An inner child is the node at the place of children + its octant. Its meta is 001 and WIDE_INNER_BIT +
// its octant (5 bits); that of a leaf its triangles in unary (3 bits) and the first of them, from the node's
// first triangle on (5 bits).
#ifndef WIDE_GLSL
#define WIDE_GLSL
#include "intersect.glsl"
#include "slab.glsl"
#include "stack.glsl"
#include "work.glsl"

const uint WIDE_TEXELS = BVH_WIDTH == 8u ? 5u : 4u;
const uint NO_NODE = 0xffffffffu;

// A plane's distance is off by at most eight roundings of the largest terms that it is made of.
const float PLANE_ERROR = 8.0 * 5.9604645e-8;

// By way of signed numbers, which convert to floats in one instruction.
vec4 bytes(uint word) { return vec4(ivec4((uvec4(word) >> uvec4(0u, 8u, 16u, 24u)) & 255u)); }


// A packet is the rays of a subgroup. They walk the tree together, through every node that one of them
// meets, so that none waits for another's nodes; each meets its own triangles. Single rays walk alone.
#if defined(PACKETS) && defined(SUBGROUP_BALLOT)
uint met_by_any(uint children) { return subgroupOr(children); }
bool any_ray(bool is) { return subgroupAny(is); }
bool all_rays(bool are) { return subgroupAll(are); }
uint of_first_ray(uint octant) { return subgroupBroadcastFirst(octant); }
#else
uint met_by_any(uint children) { return children; }
bool any_ray(bool is) { return is; }
bool all_rays(bool are) { return are; }
uint of_first_ray(uint octant) { return octant; }
#endif

// A ray as nodes see it.
struct GridRay {
    vec3 origin;
    vec3 inverse;
    bvec3 backwards;
    uint octant;  // of the nearest corner of a box, in each byte; a packet has its first ray's
};

GridRay grid_ray(Ray ray) {
    vec3 inverse = safe_inverse(ray.direction);
    bvec3 backwards = lessThan(inverse, vec3(0.0));
    uint octant = (backwards.x ? 0u : 4u) | (backwards.y ? 0u : 2u) | (backwards.z ? 0u : 1u);
    return GridRay(ray.origin, inverse, backwards, of_first_ray(octant) * 0x01010101u);
}

// The ray against four children: bits of what it meets.
uint meet_four(uvec2 x, uvec2 y, uvec2 z, uint meta, GridRay ray, vec3 scale, vec3 near, vec3 far, float reach) {
    vec4 near_x = bytes(ray.backwards.x ? x.y : x.x) * scale.x + near.x;
    vec4 near_y = bytes(ray.backwards.y ? y.y : y.x) * scale.y + near.y;
    vec4 near_z = bytes(ray.backwards.z ? z.y : z.x) * scale.z + near.z;
    vec4 far_x = bytes(ray.backwards.x ? x.x : x.y) * scale.x + far.x;
    vec4 far_y = bytes(ray.backwards.y ? y.x : y.y) * scale.y + far.y;
    vec4 far_z = bytes(ray.backwards.z ? z.x : z.y) * scale.z + far.z;
    vec4 enter = greater(greater(near_x, near_y), greater(near_z, vec4(0.0)));
    vec4 leave = lesser(lesser(far_x, far_y), lesser(far_z, vec4(reach)));
    bvec4 met = lessThanEqual(enter, leave);

    // In each byte: whether the child is inner, the place of its lowest bit, its bits.
    uint inner = (((meta & (meta << 1)) & 0x10101010u) >> 4) * 0xffu;
    uvec4 places = (uvec4((meta ^ (ray.octant & inner)) & 0x1f1f1f1fu) >> uvec4(0u, 8u, 16u, 24u)) & 255u;
    uvec4 bits = (uvec4((meta >> 5) & 0x07070707u) >> uvec4(0u, 8u, 16u, 24u)) & 255u;
    uvec4 hits = mix(uvec4(0u), bits << places, met);
    return hits.x | hits.y | hits.z | hits.w;
}

// What the ray meets in a node: inner children from WIDE_INNER_BIT on, the nearest one highest, and
// triangles from `first_triangle` on in the bits under it.
uint meet_children(uint node, GridRay ray, float reach, out uint first_triangle, out uint children) {
    count_node();
    uvec4 grid = fetch_nodes(WIDE_TEXELS * node);
    uvec4 links = fetch_nodes(WIDE_TEXELS * node + 1u);
    uvec4 planes = fetch_nodes(WIDE_TEXELS * node + 2u);
    uvec4 more_planes = fetch_nodes(WIDE_TEXELS * node + 3u);
    children = links.x;
    first_triangle = links.y;
    vec3 scale = uintBitsToFloat(((uvec3(grid.w) >> uvec3(0u, 8u, 16u)) & 255u) << 23) * ray.inverse;
    vec3 offset = (uintBitsToFloat(grid.xyz) - ray.origin) * ray.inverse;
    vec3 error = (abs(offset) + 255.0 * abs(scale)) * PLANE_ERROR;
    vec3 near = offset - error;
    vec3 far = offset + error;
    uint hits = meet_four(planes.xy, planes.zw, more_planes.xy, links.z, ray, scale, near, far, reach);
    if (BVH_WIDTH == 8u) {
        uvec4 last_planes = fetch_nodes(WIDE_TEXELS * node + 4u);
        hits |= meet_four(more_planes.zw, last_planes.xy, last_planes.zw, links.w, ray, scale, near, far, reach);
    }
    return hits;
}

// The child to visit next: the nearest of the `inner` children of a node that the ray meets, or of
// those that the stack remembers. A stack entry is the place of a node's children, and which are left.
uint next_node(uint children, uint inner, uint octant, inout Stack stack) {
    bool own = inner != 0u;
    uint group = own ? children | inner : stack.newer.x;
    uint nearest = findMSB(group & 255u);
    uint rest = group & ~(1u << nearest);
    bool left = (rest & 255u) != 0u;
    // A walk that ends here leaves an entry that nobody will ask for.
    stack.newer.x = !own && left ? rest : stack.newer.x;
    update_stack(stack, int(own) + int(left) - 1, rest);
    return group == TRAVERSAL_DONE ? NO_NODE : (group >> 8) + (nearest ^ (octant & 7u));
}

// Triangles that wait until enough lanes have some: in each group bits of those left to meet, from
// `firsts` on, the newest group first. A group without bits is none.
//
// A lane that has found triangles would else wait for the others of its subgroup. It looks for more
// meanwhile, and the few nodes that a nearer hit would have spared it cost less than its waiting.
struct Postponed {
    uvec3 groups;
    uvec3 firsts;
};

Postponed none_postponed() { return Postponed(uvec3(0u), uvec3(0u)); }

bool is_full(Postponed triangles, uint capacity) { return triangles.groups[capacity - 1u] != 0u; }

bool any_left(Postponed triangles) { return triangles.groups.x != 0u; }

void postpone(inout Postponed triangles, uint group, uint first) {
    bool found = group != 0u;
    triangles.groups = found ? uvec3(group, triangles.groups.xy) : triangles.groups;
    triangles.firsts = found ? uvec3(first, triangles.firsts.xy) : triangles.firsts;
}

uint take_triangle(inout Postponed triangles) {
    uint triangle = triangles.firsts.x + findLSB(triangles.groups.x);
    triangles.groups.x &= triangles.groups.x - 1u;
    bool spent = triangles.groups.x == 0u;
    triangles.groups = spent ? uvec3(triangles.groups.yz, 0u) : triangles.groups;
    triangles.firsts = spent ? uvec3(triangles.firsts.yz, 0u) : triangles.firsts;
    return triangle;
}

// Visits nodes from `node` on, until `capacity` groups of triangles are found, no node is left, or the
// stack wants balance.
void find_triangles(inout uint node, inout Stack stack, inout Postponed triangles, GridRay grid, float reach, uint capacity) {
    while (!any_ray(is_full(triangles, capacity)) && node != NO_NODE && !is_unbalanced(stack)) {
        uint first_triangle, children;
        uint hits = meet_children(node, grid, reach, first_triangle, children);
        postpone(triangles, hits & ((1u << WIDE_INNER_BIT) - 1u), first_triangle);
        node = next_node(children, met_by_any(hits >> WIDE_INNER_BIT), grid.octant, stack);
    }
}

// Whether triangles are to be met: none more are waited for, or there is no place for them.
bool is_due(Postponed triangles, uint node, uint capacity) {
    return any_ray(is_full(triangles, capacity)) || node == NO_NODE;
}

Hit trace_closest_wide(Ray ray) {
    GridRay grid = grid_ray(ray);
    RaySpace space = ray_space(ray.direction);
    Nearest nearest = nothing();
    Stack stack = empty_stack();
    Postponed triangles = none_postponed();
    uint node = 0u;
    while (node != NO_NODE) {
        find_triangles(node, stack, triangles, grid, reach_of(nearest.hit.distance, grid.inverse), CLOSEST_GROUPS);
        bool due = is_due(triangles, node, CLOSEST_GROUPS);
        while (due && any_left(triangles)) {
            meet_triangle(take_triangle(triangles), ray, space, nearest);
        }
        balance_stack(stack);
    }
    return nearest.hit;
}

bool trace_any_wide(Ray ray, uint target, float limit) {
    GridRay grid = grid_ray(ray);
    RaySpace space = ray_space(ray.direction);
    bool blocked = false;
    // A ray that is blocked meets no more nodes of its packet's.
    float reach = reach_of(limit, grid.inverse);
    Stack stack = empty_stack();
    Postponed triangles = none_postponed();
    uint node = 0u;
    while (node != NO_NODE) {
        find_triangles(node, stack, triangles, grid, reach, ANY_GROUPS);
        bool due = is_due(triangles, node, ANY_GROUPS);
        while (due && any_left(triangles)) {
            uint triangle = take_triangle(triangles);
            blocked = blocks(triangle, fetch_triangle(triangle), ray, space, target, limit) || blocked;
        }
        reach = blocked ? -1.0 : reach;
        node = all_rays(blocked) ? NO_NODE : node;
        balance_stack(stack);
    }
    return blocked;
}

#endif
