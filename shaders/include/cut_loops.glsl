// Whether the driver left an invocation's loops before their end.
#ifndef CUT_LOOPS_GLSL
#define CUT_LOOPS_GLSL
#include "bindings_scene.glsl"
#include "bindings_path.glsl"

// Reports it to the host. Call it last: a driver that leaves all loops after some number of turns leaves this one too
// early. The sum shows it, since compilers take a loop's own condition to hold when it ends. The number of turns is not
// uniform: uniform ones make lavapipe compile the kernel for every launch.
void report_cut_loops() {
    uint turns = (gl_LocalInvocationIndex & 1u) + 2u;
    uint sum = 0u;
    for (uint turn = 1u; turn <= turns; turn++) {
        sum += turn;
    }
    if (sum != turns * (turns + 1u) / 2u) {
        control.cut_loops = 1u;
    }
}

#endif
