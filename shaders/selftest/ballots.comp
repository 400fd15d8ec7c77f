// What subgroup operations tell lanes that went different ways: after a loop that they left at different turns, on one
// side of a branch, and within a loop, each at a turn of its own.
// Threads: one an invocation. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "subgroup.glsl"
#include "wander.glsl"

struct Answer {
    uvec4 mask;   // of the lanes that are here together
    uvec4 lane;   // subgroup of the launch, lane, the lane that is first, 1 of the one that is elected
    uvec4 votes;  // lanes before this one, whether any and whether all have an odd word, all words joined
};
layout(set = 2, binding = 1, std430) writeonly buffer Answers { Answer items[]; } answers;

Answer ask(uint word) {
    uint subgroup = gl_WorkGroupID.x * gl_NumSubgroups + gl_SubgroupID;
    uvec4 mask = subgroupBallot(true);
    uint first = subgroupBroadcastFirst(gl_SubgroupInvocationID);
    return Answer(mask, uvec4(subgroup, gl_SubgroupInvocationID, first, uint(subgroupElect())),
        uvec4(subgroupBallotExclusiveBitCount(mask), uint(subgroupAny((word & 1u) != 0u)),
            uint(subgroupAll((word & 1u) != 0u)), subgroupOr(word)));
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    uint word = wander(index, 0u);
    answers.items[index] = ask(word);

    uint place = batch.pixel_count + index;
    if ((word & 6u) != 0u) {
        answers.items[place] = ask(word);
    } else {
        answers.items[place] = ask(~word);
    }

    place += batch.pixel_count;
    for (uint turn = 0u; turn < 32u; turn++) {
        if (turn == word >> 27) {
            answers.items[place] = ask(word);
            break;
        }
    }
}
