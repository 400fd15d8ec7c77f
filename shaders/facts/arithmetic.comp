// The operations whose results Vulkan leaves to the driver, as the driver has them.
// Threads: one a pair of operands, in whole workgroups. Reads: operands. Writes: results.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"

struct Results {
    float quotient;
    float reciprocal;  // of the second
    float root;        // of the first's magnitude
    float residual;    // what rounding took from the product: exact where fma is fused
    float product;
    float sum;
};

layout(set = 2, binding = 2, std430) readonly buffer Operands { vec2 pairs[]; } operands;
layout(set = 2, binding = 3, std430) writeonly buffer AllResults { Results pairs[]; } results;

void main() {
    vec2 pair = operands.pairs[gl_GlobalInvocationID.x];
    float product = pair.x * pair.y;
    results.pairs[gl_GlobalInvocationID.x] = Results(pair.x / pair.y, 1.0 / pair.y, sqrt(abs(pair.x)),
        fma(pair.x, pair.y, -product), product, pair.x + pair.y);
}
