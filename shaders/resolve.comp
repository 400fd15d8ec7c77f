// Adds the finished samples of the batch to the film, in the order of their numbers whatever the
// batches are, with compensation, so that a mean over millions of samples does not drift.
// Threads: one a pixel of the batch. Reads: radiances. Writes: film, control.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "workgroup.glsl"
#define CONTROL_ACCESS
#include "bindings_path.glsl"

// Adds x to sum + compensation. What rounding took goes into the next summand, so that it never grows
// to a sum of its own: a compensation that only gathers is itself rounded off after some 2^20 samples.
// (Kahan 1965, with Neumaier's order of the two summands)
void add(inout vec3 sum, inout vec3 compensation, vec3 x) {
    x += compensation;
    vec3 total = sum + x;
    vec3 small_x = (sum - total) + x;
    vec3 small_sum = (x - total) + sum;
    compensation = mix(small_sum, small_x, greaterThanEqual(abs(sum), abs(x)));
    sum = total;
}

bool is_finite(vec3 x) { return !any(isnan(x)) && !any(isinf(x)); }

void main() {
    uint index = gl_GlobalInvocationID.x;
    if (index < batch.pixel_count) {
        FilmPixel pixel = film.pixels[batch.film_pixel + index];
        bool has_nonfinite = false;
        // From slot to slot: a loop whose bound is the same for all pixels lavapipe compiles for each number of samples.
        uint first = index * batch.sample_count;
        uint end = first + batch.sample_count;
        for (uint slot = first; slot < end; slot++) {
            vec3 radiance = radiances.rgb[slot].rgb;
            bool finite = is_finite(radiance);
            has_nonfinite = has_nonfinite || !finite;
            radiance = finite ? radiance : vec3(0.0);
            add(pixel.sum.rgb, pixel.sum_compensation.rgb, radiance);
            add(pixel.squares.rgb, pixel.squares_compensation.rgb, radiance * radiance);
        }
        film.pixels[batch.film_pixel + index] = pixel;

        // Report which samples were left out.
        for (uint slot = first; has_nonfinite && slot < end; slot++) {
            if (!is_finite(radiances.rgb[slot].rgb)) {
                uint place = atomicAdd(control.nonfinite_samples, 1u);
                if (place < TRACED_SAMPLES) {
                    control.traced_samples[place] = uvec2(batch.first_pixel + index, batch.first_sample + slot - first);
                }
            }
        }
    }
}
