// Traversal of four- and eight-wide BVHs with quantised boxes.
// (Ylitie, Karras and Laine 2017, Efficient Incoherent Ray Traversal on GPUs Through Compressed
// Wide BVHs)
#ifndef WIDE_GLSL
#define WIDE_GLSL
#include "intersect.glsl"
#include "slab.glsl"
#include "stack.glsl"
#include "subgroup.glsl"
#include "work.glsl"

const uint NO_NODE = 0xffffffffu;

// A plane's distance is off by at most eight roundings of the largest terms that it is made of.
const float PLANE_ERROR = 8.0 * 5.9604645e-8;

// By way of signed numbers, which convert to floats in one instruction.
vec4 bytes(uint word) { return vec4(ivec4((uvec4(word) >> uvec4(0u, 8u, 16u, 24u)) & 255u)); }

// Packet traversal: the rays of a subgroup traverse the tree together, through every node that one of them enters, so
// that no lane waits for another's nodes; each intersects its own triangles. Single rays traverse it each on its own.
uint entered_by_any(uint children) { return IN_PACKETS ? subgroupOr(children) : children; }
bool any_ray(bool is) { return IN_PACKETS ? subgroupAny(is) : is; }
bool all_rays(bool are) { return IN_PACKETS ? subgroupAll(are) : are; }
uint of_first_ray(uint octant) { return IN_PACKETS ? subgroupBroadcastFirst(octant) : octant; }

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

// Intersects the ray with the boxes of four children: bits of those that it enters.
uint enter_four(FourBoxes boxes, uint meta, GridRay ray, vec3 scale, vec3 near, vec3 far, float t_max) {
    vec4 near_x = bytes(ray.backwards.x ? boxes.x.y : boxes.x.x) * scale.x + near.x;
    vec4 near_y = bytes(ray.backwards.y ? boxes.y.y : boxes.y.x) * scale.y + near.y;
    vec4 near_z = bytes(ray.backwards.z ? boxes.z.y : boxes.z.x) * scale.z + near.z;
    vec4 far_x = bytes(ray.backwards.x ? boxes.x.x : boxes.x.y) * scale.x + far.x;
    vec4 far_y = bytes(ray.backwards.y ? boxes.y.x : boxes.y.y) * scale.y + far.y;
    vec4 far_z = bytes(ray.backwards.z ? boxes.z.x : boxes.z.y) * scale.z + far.z;
    vec4 enter = max_bits(max_bits(near_x, near_y), max_bits(near_z, vec4(0.0)));
    vec4 leave = min_bits(min_bits(far_x, far_y), min_bits(far_z, vec4(t_max)));
    bvec4 entered = lessThanEqual(enter, leave);

    // In each byte: whether the child is inner, the place of its lowest bit, its bits.
    uint inner = (((meta & (meta << 1)) & 0x10101010u) >> 4) * 0xffu;
    uvec4 places = (uvec4((meta ^ (ray.octant & inner)) & 0x1f1f1f1fu) >> uvec4(0u, 8u, 16u, 24u)) & 255u;
    uvec4 bits = (uvec4((meta >> 5) & 0x07070707u) >> uvec4(0u, 8u, 16u, 24u)) & 255u;
    uvec4 hits = mix(uvec4(0u), bits << places, entered);
    return hits.x | hits.y | hits.z | hits.w;
}

// What the ray enters of a node: inner children from WIDE_INNER_BIT on, the nearest one highest, and
// triangles from `first_triangle` on in the bits under it.
uint enter_children(uint index, GridRay ray, float t_max, out uint first_triangle, out uint children) {
    count_node();
    WideNode node = fetch_wide_node(index);
    children = node.children;
    first_triangle = node.first_triangle;
    vec3 scale = uintBitsToFloat(((uvec3(node.exponents) >> uvec3(0u, 8u, 16u)) & 255u) << 23) * ray.inverse;
    vec3 offset = (node.origin - ray.origin) * ray.inverse;
    vec3 error = (abs(offset) + 255.0 * abs(scale)) * PLANE_ERROR;
    vec3 near = offset - error;
    vec3 far = offset + error;
    uint hits = enter_four(node.first, node.metas.x, ray, scale, near, far, t_max);
    if (BVH_WIDTH == 8u) {
        hits |= enter_four(node.others, node.metas.y, ray, scale, near, far, t_max);
    }
    return hits;
}

// The child to visit next: the nearest of the `inner` children of a node that the ray enters, or of those that the stack
// remembers. A stack entry is the place of a node's children, and which are left.
uint next_node(uint children, uint inner, uint octant, inout Stack stack) {
    bool own = inner != 0u;
    uint group = own ? children | inner : stack.newer.x;
    uint nearest = findMSB(group & 255u);
    uint rest = group & ~(1u << nearest);
    bool left = (rest & 255u) != 0u;
    // A traversal that ends here leaves an entry that nobody will ask for.
    stack.newer.x = !own && left ? rest : stack.newer.x;
    push_if(own && left, rest, stack);
    pop_if(!own && !left, stack);
    return group == TRAVERSAL_DONE ? NO_NODE : (group >> 8) + (nearest ^ (octant & 7u));
}

// Postponed traversal (Aila and Laine 2009, there for one leaf): triangles wait until enough lanes have some. Each group
// has bits of those left to intersect, from `firsts` on, the newest group first; a group without bits is empty.
//
// A lane that has found triangles would else be inactive until the others of its subgroup have. It looks for more
// meanwhile, and the few nodes that a nearer hit would have spared it cost less than waiting.
struct Postponed {
    uvec3 groups;
    uvec3 firsts;
};

Postponed no_triangles() { return Postponed(uvec3(0u), uvec3(0u)); }

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
// stack must be balanced.
void find_triangles(inout uint node, inout Stack stack, inout Postponed triangles, GridRay grid, float t_max, uint capacity) {
    while (!any_ray(is_full(triangles, capacity)) && node != NO_NODE && !is_unbalanced(stack)) {
        uint first_triangle, children;
        uint hits = enter_children(node, grid, t_max, first_triangle, children);
        postpone(triangles, hits & ((1u << WIDE_INNER_BIT) - 1u), first_triangle);
        node = next_node(children, entered_by_any(hits >> WIDE_INNER_BIT), grid.octant, stack);
    }
}

// Whether to intersect triangles now: no more can be found, or there is no room for more.
bool is_due(Postponed triangles, uint node, uint capacity) {
    return any_ray(is_full(triangles, capacity)) || node == NO_NODE;
}

Hit trace_closest_wide(Ray ray) {
    GridRay grid = grid_ray(ray);
    RaySpace space = ray_space(ray.direction);
    Nearest nearest = no_nearest();
    Stack stack = empty_stack();
    Postponed triangles = no_triangles();
    uint node = 0u;
    while (node != NO_NODE) {
        find_triangles(node, stack, triangles, grid, box_t_max(nearest.hit.distance, grid.inverse), CLOSEST_GROUPS);
        bool due = is_due(triangles, node, CLOSEST_GROUPS);
        while (due && any_left(triangles)) {
            hit_triangle(world_primitive(take_triangle(triangles)), no_placement(), ray, space, nearest);
        }
        balance_stack(stack);
    }
    return nearest_hit(nearest, ray, space);
}

bool trace_any_wide(Ray ray, Primitive target, float t_max) {
    GridRay grid = grid_ray(ray);
    RaySpace space = ray_space(ray.direction);
    Occlusion occlusion = no_occlusion();
    // A ray that is occluded enters no more of its packet's nodes.
    float boxes_t_max = box_t_max(t_max, grid.inverse);
    Stack stack = empty_stack();
    Postponed triangles = no_triangles();
    uint node = 0u;
    while (node != NO_NODE) {
        find_triangles(node, stack, triangles, grid, boxes_t_max, ANY_GROUPS);
        bool due = is_due(triangles, node, ANY_GROUPS);
        while (due && any_left(triangles)) {
            uint triangle = take_triangle(triangles);
            occlude(world_primitive(triangle), fetch_triangle(triangle), ray, space, target, t_max, occlusion);
        }
        boxes_t_max = occlusion.occluded ? -1.0 : boxes_t_max;
        node = all_rays(occlusion.occluded) ? NO_NODE : node;
        balance_stack(stack);
    }
    return is_occluded(occlusion, ray, space);
}

#endif
