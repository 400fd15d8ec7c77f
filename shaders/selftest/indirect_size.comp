// Writes how many workgroups the launch after it has.
// Threads: one. Reads: cases. Writes: control.
#version 460
#extension GL_GOOGLE_include_directive : require
#define CONTROL_ACCESS
#include "constants.glsl"

layout(local_size_x = 1) in;

#include "bindings_path.glsl"

layout(set = 2, binding = 0, std430) readonly buffer Cases { uint items[]; } cases;

void main() { control.ray_groups[0] = cases.items[batch.bounce]; }
