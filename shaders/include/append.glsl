// Appends to the queues, one atomic a subgroup where the device has ballots.
#ifndef APPEND_GLSL
#define APPEND_GLSL
#include "path_state.glsl"
#include "subgroup.glsl"

// Adds one to COUNTER for every invocation whose WANTED holds and yields its PLACE. Call it in uniform control flow. Any
// lanes that are active together may call it, as long as they reconverge behind the branch of the one that counts: the
// host builds kernels with ballots only where the driver promises that.
#define APPEND(COUNTER, WANTED, PLACE) { \
    if (HAS_BALLOTS) { \
        uvec4 takers = subgroupBallot(WANTED); \
        uint first = 0u; \
        if (subgroupElect()) first = atomicAdd(COUNTER, subgroupBallotBitCount(takers)); \
        PLACE = subgroupBroadcastFirst(first) + subgroupBallotExclusiveBitCount(takers); \
    } else { \
        PLACE = 0u; \
        if (WANTED) PLACE = atomicAdd(COUNTER, 1u); \
    } \
}

// Stores a path that goes on and queues it for the next bounce. Call it in uniform control flow.
void queue_path(bool continues, uint slot, Path path) {
    uint place;
    APPEND(control.next_rays, continues, place)
    if (continues) {
        store_path(slot, path);
        ray_queue.paths[((batch.bounce + 1u) & 1u) * frame.path_capacity + place] = slot;
    }
}

#endif
