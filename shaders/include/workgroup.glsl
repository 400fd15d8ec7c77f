// The size of a workgroup, which the host sets. It is declared before anything that may read it: until its declaration
// gl_WorkGroupSize is 1.
#ifndef WORKGROUP_GLSL
#define WORKGROUP_GLSL
#include "constants.glsl"

layout(local_size_x_id = SPEC_WORKGROUP_SIZE) in;

#endif
