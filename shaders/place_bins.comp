// Gives each bin its place in the sorted queue, one after the other, and empties the counts.
// Threads: one. Reads and writes: bins.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "bindings_path.glsl"

layout(local_size_x = 1) in;

void main() {
    uint place = 0u;
    for (uint bin = 0u; bin < MATERIAL_BINS; bin++) {
        bins.places[bin] = place;
        place += bins.counts[bin];
        bins.counts[bin] = 0u;
    }
}
