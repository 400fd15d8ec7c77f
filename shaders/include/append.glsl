// Appends to the queues, one atomic a subgroup where the device has ballots.
#ifndef APPEND_GLSL
#define APPEND_GLSL

// COUNT adds one to COUNTER for every invocation whose `wanted` holds; APPEND yields its place too.
// Call them in uniform control flow.
#ifdef SUBGROUP_BALLOT
#define COUNT(COUNTER, WANTED) { \
    uint takers = subgroupBallotBitCount(subgroupBallot(WANTED)); \
    if (subgroupElect()) atomicAdd(COUNTER, takers); \
}
#define APPEND(COUNTER, WANTED, PLACE) { \
    uvec4 takers = subgroupBallot(WANTED); \
    uint first = 0u; \
    if (subgroupElect()) first = atomicAdd(COUNTER, subgroupBallotBitCount(takers)); \
    PLACE = subgroupBroadcastFirst(first) + subgroupBallotExclusiveBitCount(takers); \
}
#else
#define COUNT(COUNTER, WANTED) { if (WANTED) atomicAdd(COUNTER, 1u); }
#define APPEND(COUNTER, WANTED, PLACE) { PLACE = 0u; if (WANTED) PLACE = atomicAdd(COUNTER, 1u); }
#endif

#endif
