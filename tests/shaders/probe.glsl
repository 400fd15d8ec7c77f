// Makes a kernel of a function, so that a test can call it on the device.
//
// A probe declares what it takes and gives as structs of 16-byte members, defines
// `OUTPUT probe(INPUT)`, and ends with PROBE(INPUT, OUTPUT): the function of every input.
#ifndef PROBE_GLSL
#define PROBE_GLSL
#include "workgroup.glsl"
#include "bindings_path.glsl"

#define PROBE(INPUT, OUTPUT) \
    layout(set = 2, binding = 0, std430) readonly buffer ProbeInputs { INPUT items[]; } probe_inputs; \
    layout(set = 2, binding = 1, std430) writeonly buffer ProbeOutputs { OUTPUT items[]; } probe_outputs; \
    void main() { \
        uint place = gl_GlobalInvocationID.x; \
        if (place < batch.pixel_count) { \
            probe_outputs.items[place] = probe(probe_inputs.items[place]); \
        } \
    }

#endif
