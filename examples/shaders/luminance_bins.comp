// Counts the pixels of an image by the exponent of their luminance: a bin a stop.
// Threads: one a pixel. Reads: pixels. Writes: bins.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"

layout(push_constant) uniform Arguments { uint pixel_count; } arguments;
layout(set = 0, binding = 0, std430) readonly buffer Pixels { vec4 radiance[]; } pixels;
layout(set = 0, binding = 1, std430) buffer Bins { uint count[256]; } bins;

void main() {
    uint pixel = gl_GlobalInvocationID.x;
    if (pixel < arguments.pixel_count) {
        vec3 radiance = pixels.radiance[pixel].rgb;
        float luminance = 0.2126 * radiance.r + 0.7152 * radiance.g + 0.0722 * radiance.b;
        atomicAdd(bins.count[floatBitsToUint(luminance) >> 23], 1u);
    }
}
