// Whether the driver left an invocation's loops before their end.
#ifndef CUT_LOOPS_GLSL
#define CUT_LOOPS_GLSL
#include "bindings_scene.glsl"
#include "bindings_path.glsl"

// Tells the host. Call it last: where a driver leaves all loops after so many turns, it leaves this
// one too early. The sum tells, since compilers take a loop's own condition to hold when it ends.
// The turns are not uniform: loops whose turns are make lavapipe compile the kernel for every launch.
void tell_cut_loops() {
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
