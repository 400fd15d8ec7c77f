// The size of a workgroup, which the host sets. It is declared before anything that may read it: until its declaration
// gl_WorkGroupSize is 1.
#ifndef WORKGROUP_GLSL
#define WORKGROUP_GLSL
#include "specialization.glsl"

layout(local_size_x_id = WORKGROUP_SIZE_ID) in;

#endif
