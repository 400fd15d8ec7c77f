// Adds the finished samples of the batch to the film, in the order of their numbers whatever the
// batches are, with compensation, so that a mean over millions of samples does not drift.
// Threads: one a pixel of the batch. Reads: radiances. Writes: film, control.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#define CONTROL_ACCESS
#include "bindings_path.glsl"

layout(local_size_x_id = SPEC_WORKGROUP_SIZE) in;

// Adds x to sum + compensation. (Neumaier 1974)
void add(inout vec3 sum, inout vec3 compensation, vec3 x) {
    vec3 total = sum + x;
    vec3 small_x = (sum - total) + x;
    vec3 small_sum = (x - total) + sum;
    compensation += mix(small_sum, small_x, greaterThanEqual(abs(sum), abs(x)));
    sum = total;
}

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index < batch.pixel_count) {
        FilmPixel pixel = film.pixels[batch.film_pixel + index];
        for (uint i = 0u; i < batch.sample_count; i++) {
            vec3 radiance = radiances.rgb[index * batch.sample_count + i].rgb;
            if (any(isnan(radiance)) || any(isinf(radiance))) {
                atomicAdd(control.nonfinite_samples, 1u);
            } else {
                add(pixel.sum.rgb, pixel.sum_compensation.rgb, radiance);
                add(pixel.squares.rgb, pixel.squares_compensation.rgb, radiance * radiance);
            }
        }
        film.pixels[batch.film_pixel + index] = pixel;
    }
}
