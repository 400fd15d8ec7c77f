// The camera: a point of the pixel by its filter, through a pinhole or a thin lens, or straight on.
#ifndef CAMERA_GLSL
#define CAMERA_GLSL
#include "geometry.glsl"
#include "sampling.glsl"

// Standard deviation of the Gaussian filter, in pixels.
const float FILTER_DEVIATION = 0.5;

// A point of the image by the filter of a pixel, from the pixel's upper left corner. (Ernst et al. 2006, Filter Importance
// Sampling; Box and Muller 1958)
vec2 sample_filter(vec2 u) {
    if (GAUSSIAN_FILTER) {
        return 0.5 + FILTER_DEVIATION * sqrt(-2.0 * log_of_rest(u.x)) * on_circle(u.y);
    }
    return u;
}

Ray camera_ray(uint pixel, vec4 u) {
    vec2 image_size = vec2(frame.width, frame.height);
    vec2 position = (vec2(pixel % frame.width, pixel / frame.width) + sample_filter(u.xy)) / image_size;
    vec3 across = (2.0 * position.x - 1.0) * frame.camera_right + (1.0 - 2.0 * position.y) * frame.camera_up;
    vec3 direction = frame.camera_forward + across;
    vec3 origin = frame.camera_eye;
    if (HAS_ORTHOGRAPHIC && frame.is_orthographic != 0u) {
        return Ray(origin + across, frame.camera_forward, no_primitive());
    }
    // A camera far away: the ray starts where it crosses a plane in front of the scene. The pinhole's coordinates are so
    // large that they have fewer digits behind the point than the scene's, and so would every hit.
    if (HAS_DISTANCE) {
        origin += frame.camera_distance * across;
    }
    if (HAS_LENS && frame.lens_radius > 0.0) {
        vec2 lens = frame.lens_radius * sample_disk(u.zw);
        vec3 shift = lens.x * normalize(frame.camera_right) + lens.y * normalize(frame.camera_up);
        direction = frame.focus_distance * direction - shift;
        origin += HAS_DISTANCE ? shift * (1.0 - frame.camera_distance / frame.focus_distance) : shift;
    }
    return Ray(origin, normalize(direction), no_primitive());
}

#endif
