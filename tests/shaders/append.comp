// Appends by lanes that left a loop at different turns, while others left the function before.
#version 460
#extension GL_GOOGLE_include_directive : require
#define CONTROL_ACCESS
#include "probe.glsl"
#include "append.glsl"

const uint NO_PLACE = 0xffffffffu;

// Turns that a lane spends, and whether it leaves before the first append, appends first, and appends last.
uvec4 probe(uvec4 query) {
    uint x = query.x;
    for (uint turn = 0u; turn < query.x; turn++) {
        x = x * 1664525u + 1013904223u;
        if (x < 0x01000000u) {
            break;
        }
    }
    uvec4 answer = uvec4(NO_PLACE, NO_PLACE, x, 0u);
    if (query.y != 0u) {
        return answer;
    }
    uint place;
    APPEND(control.next_rays, query.z != 0u, place)
    answer.x = query.z != 0u ? place : NO_PLACE;
    uint turns = 0u;
    while (turns < x % 7u) {
        turns += 1u;
    }
    APPEND(control.next_shadow_rays, query.w != 0u, place)
    answer.y = query.w != 0u ? place : NO_PLACE;
    return answer;
}

PROBE(uvec4, uvec4)
