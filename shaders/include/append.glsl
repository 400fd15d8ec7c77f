// Appends to the queues, one atomic a subgroup where the device has ballots.
#ifndef APPEND_GLSL
#define APPEND_GLSL

// Adds one to COUNTER for every invocation whose `wanted` holds and yields its place. Call it in
// uniform control flow.
#ifdef SUBGROUP_BALLOT
#define APPEND(COUNTER, WANTED, PLACE) { \
    uvec4 takers = subgroupBallot(WANTED); \
    uint first = 0u; \
    if (subgroupElect()) first = atomicAdd(COUNTER, subgroupBallotBitCount(takers)); \
    PLACE = subgroupBroadcastFirst(first) + subgroupBallotExclusiveBitCount(takers); \
}
#else
#define APPEND(COUNTER, WANTED, PLACE) { PLACE = 0u; if (WANTED) PLACE = atomicAdd(COUNTER, 1u); }
#endif

#endif
