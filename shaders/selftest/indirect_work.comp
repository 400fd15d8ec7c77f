// Tells how large the launch is that it is part of.
// Threads: as many as indirect_size wrote workgroups for. Writes: answers.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "check.glsl"

layout(set = 2, binding = 1, std430) buffer Answers { uvec4 items[]; } answers;  // invocations, workgroups met, workgroups told, unused

void main() {
    atomicAdd(answers.items[batch.bounce].x, 1u);
    atomicMax(answers.items[batch.bounce].y, gl_WorkGroupID.x + 1u);
    atomicMax(answers.items[batch.bounce].z, gl_NumWorkGroups.x);
}
