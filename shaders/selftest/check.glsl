// What the self-test's kernels share: the launch, numbers that the host can make too, and a kernel of a function.
//
// The batch of a launch says which invocations have work, pixel_count of them, and what they are to do, bounce.
#ifndef CHECK_GLSL
#define CHECK_GLSL
#include "workgroup.glsl"

#include "bindings_path.glsl"
#include "random.glsl"

// Four words that belong to an index and a purpose.
uvec4 words_of(uint index, uint purpose) { return pcg4d(uvec4(index, purpose, 0u, 0u)); }

// A function of every case, as probe.glsl makes of `ANSWER probe(CASE)`.
#define CHECK(CASE, ANSWER) \
    layout(set = 2, binding = 0, std430) readonly buffer Cases { CASE items[]; } cases; \
    layout(set = 2, binding = 1, std430) writeonly buffer Answers { ANSWER items[]; } answers; \
    void main() { \
        uint place = gl_GlobalInvocationID.x; \
        if (place < batch.pixel_count) { \
            answers.items[place] = check(cases.items[place]); \
        } \
    }

#endif
