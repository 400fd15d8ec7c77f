// Counts what traversal and shading do, under COUNTS_WORK.
#ifndef WORK_GLSL
#define WORK_GLSL
#include "constants.glsl"
#include "subgroup.glsl"

// Sums over the items of a stage at one bounce: low and high half.
struct WorkCount {
    uint items[2];      // rays traced, or vertices shaded
    uint nodes[2];      // nodes visited
    uint triangles[2];  // triangles tested
    uint steps[2];      // node visits, triangle tests and shadings, each counted once a subgroup
};

// STAGES a bounce, COUNTED_BOUNCES bounces; the last bounce takes all that follow.
layout(set = 1, binding = 13, std430) buffer WorkCounts { WorkCount stages[]; } work_counts;

// Of the item at hand.
uint work_nodes = 0u;
uint work_triangles = 0u;
uint work_steps = 0u;

void count_step() {
    // Of the lanes that are active in a step, one counts it.
    if (COUNTS_WORK && HAS_BALLOTS) {
        work_steps += subgroupElect() ? 1u : 0u;
    }
}

void count_node() {
    if (COUNTS_WORK) {
        work_nodes += 1u;
        count_step();
    }
}

void count_triangle() {
    if (COUNTS_WORK) {
        work_triangles += 1u;
        count_step();
    }
}

void count_vertex() { count_step(); }

#define ATOMIC_ADD_WIDE(TOTAL, MORE) { uint before = atomicAdd(TOTAL[0], MORE); if (before + MORE < before) atomicAdd(TOTAL[1], 1u); }

// Ends an item: adds its counts to its stage and starts anew.
void count_item(uint stage, uint bounce) {
    if (COUNTS_WORK) {
        uint index = STAGES * min(bounce, COUNTED_BOUNCES - 1u) + stage;
        ATOMIC_ADD_WIDE(work_counts.stages[index].items, 1u)
        ATOMIC_ADD_WIDE(work_counts.stages[index].nodes, work_nodes)
        ATOMIC_ADD_WIDE(work_counts.stages[index].triangles, work_triangles)
        ATOMIC_ADD_WIDE(work_counts.stages[index].steps, work_steps)
        work_nodes = 0u;
        work_triangles = 0u;
        work_steps = 0u;
    }
}

#endif
