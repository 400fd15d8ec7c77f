// Light sampling (next-event estimation): area lights, which are emissive triangles, and the environment.
#ifndef LIGHT_GLSL
#define LIGHT_GLSL
#include "bsdf/contract.glsl"
#include "random.glsl"
#include "sampling.glsl"

const bool HAS_ENVIRONMENT = ENVIRONMENT != ENVIRONMENT_BLACK;

bool environment_is(uint kind) { return (ENVIRONMENT == ENVIRONMENT_ANY ? frame.environment : ENVIRONMENT) == kind; }

bool environment_emits() { return HAS_ENVIRONMENT && !environment_is(ENVIRONMENT_BLACK); }

// A point of light as a surface sees it.
struct LightSample {
    Ray ray;           // towards the light; reaches a primitive at 1 direction length
    vec3 direction;    // unit
    Primitive light;   // that emits, or none for the environment
    vec3 radiance;     // divided by the pdf
    float pdf;         // over solid angle, above 0
};

// Weight of a sample drawn with pdf `own` where another strategy has pdf `other`. (Veach and Guibas 1995, power
// heuristic)
float mis_weight(float own, float other) {
    float ratio = other / own;
    return own == ONE_DIRECTION ? 1.0 : 1.0 / (1.0 + ratio * ratio);
}

// Radiance of the lat-long image at a texel, clamped at the poles and repeated around.
vec3 environment_texel(ivec2 at) {
    int width = int(frame.environment_width);
    at.x = at.x < 0 ? at.x + width : at.x >= width ? at.x - width : at.x;
    at.y = clamp(at.y, 0, int(frame.environment_height) - 1);
    return environment_texel_radiance(uint(at.y * width + at.x));
}

// The centre column looks along -z, u grows towards +x, row 0 is +y. The arc cosine would be coarser near the poles.
vec2 environment_uv(vec3 direction) {
    float across = angle_of(-direction.z, direction.x);
    float down = angle_of(direction.y, length(direction.xz));
    return vec2(0.5 + across * INVERSE_TWO_PI, down * INVERSE_PI);
}

vec3 environment_radiance(vec3 direction) {
    if (environment_is(ENVIRONMENT_LAT_LONG)) {
        vec2 p = environment_uv(direction) * vec2(frame.environment_width, frame.environment_height) - 0.5;
        ivec2 corner = ivec2(floor(p));
        vec2 f = p - vec2(corner);
        vec3 top = mix(environment_texel(corner), environment_texel(corner + ivec2(1, 0)), f.x);
        vec3 bottom = mix(environment_texel(corner + ivec2(0, 1)), environment_texel(corner + ivec2(1, 1)), f.x);
        return mix(top, bottom, f.y);
    }
    return frame.environment_radiance;
}

// Solid angle of a texel in a row. The cosines of its edges differ by `cos_range`: as a product of
// sines that keeps its precision at the poles.
float texel_solid_angle(uint row, out float cos_range) {
    float half_height = 0.25 / float(frame.environment_height);
    cos_range = 2.0 * on_circle(float(2u * row + 1u) * half_height).y * on_circle(half_height).y;
    return TWO_PI / float(frame.environment_width) * cos_range;
}

// Pdf over solid angle of a sample of the lat-long image in a direction.
float lat_long_pdf(vec3 direction) {
    uvec2 size = uvec2(frame.environment_width, frame.environment_height);
    uvec2 at = min(uvec2(environment_uv(direction) * vec2(size)), size - 1u);
    float cos_range;
    float solid_angle = texel_solid_angle(at.y, cos_range);
    return environment_texel_probability(at.y * size.x + at.x) / solid_angle;
}

// The same of a sample of a constant environment, which depends on the surface that is lit.
float constant_environment_pdf(Surface surface, vec3 wo, vec3 direction) {
    return max(0.0, dot(normal_towards(surface, wo), direction)) * INVERSE_PI;
}

// Samples a texel by hierarchical warping: chooses a half of the image by u.y, a quarter by u.x, and descends. Points that
// are stratified over the square are so over the image, as an alias table would not let them be. (Clarberg et al. 2005)
uvec2 sample_texel(vec2 u) {
    uvec2 size = uvec2(frame.environment_width, frame.environment_height);
    uint longest = max(size.x, size.y) - 1u;
    uvec2 texel = uvec2(0u);
    uint first = 0u;
    for (int level = findMSB(longest) + 1; level > 0; --level) {
        uvec2 blocks = (size - 1u >> level) + 1u;
        EnvironmentSplit split = fetch_environment_split(first + texel.y * blocks.x + texel.x);
        bool below = split_sample(u.y, split.upper);
        bool right = split_sample(u.x, below ? split.lower_left : split.upper_left);
        texel = 2u * texel + uvec2(right, below);
        first += blocks.x * blocks.y;
    }
    return texel;
}

// A texel by its probability, then a direction uniform in its solid angle. The pdf is exact for the texel, and the
// bilinear radiance is zero wherever the pdf is.
LightSample sample_lat_long(Surface surface, vec4 u) {
    uvec2 texel = sample_texel(u.xy);
    float probability = environment_texel_probability(texel.y * frame.environment_width + texel.x);
    vec2 size = vec2(frame.environment_width, frame.environment_height);
    vec2 corner = vec2(texel);
    float turns = (corner.x + u.z) / size.x - 0.5;
    // Uniform in the cosine between the texel's edges.
    float cos_range;
    float solid_angle = texel_solid_angle(texel.y, cos_range);
    float cos_theta = on_circle(0.5 * corner.y / size.y).x - u.w * cos_range;
    vec2 across = sqrt(max(0.0, 1.0 - cos_theta * cos_theta)) * on_circle(turns);
    vec3 direction = vec3(across.y, cos_theta, -across.x);
    float pdf = probability / solid_angle;
    return LightSample(spawn_ray(surface, direction), direction, no_primitive(), environment_radiance(direction) / pdf, pdf);
}

// Of a constant environment only the cosine matters: it is sampled like the Lambert BRDF.
LightSample sample_constant_environment(Surface surface, vec3 wo, vec2 u) {
    vec3 n = normal_towards(surface, wo);
    vec3 direction = sample_cosine(n, u);
    float pdf = dot(n, direction) * INVERSE_PI;
    vec3 radiance = pdf > 0.0 ? frame.environment_radiance / pdf : vec3(0.0);
    return LightSample(spawn_ray(surface, direction), direction, no_primitive(), radiance, pdf > 0.0 ? pdf : 1.0);
}

// Pdf over solid angle of a sample of area lights towards a point of one.
float area_light_pdf(float light_area, float distance2, float cos_light) { return distance2 / (cos_light * light_area); }

// An emissive triangle by its probability, as a cell of an alias table or as the cell's alias (Walker 1974), then a point
// uniform over its area. One pair of numbers does both, so that points that are stratified over their square are so on
// each triangle.
LightSample sample_area_light(Surface surface, vec3 u) {
    Light cell = fetch_light(split_sample_evenly(u.x, frame.light_count, u.z));
    uint triangle = cell.triangle;
    if (split_sample(u.x, cell.threshold)) {
        triangle = fetch_light(cell.alias).triangle;
    }
    Triangle t = fetch_triangle(triangle);
    vec3 normal = geometric_normal(t);
    vec3 error;
    vec3 point = interpolate_position(t, sample_triangle(u.xy), error);
    vec3 direction = normalize(point - surface.position);
    Ray ray = spawn_ray(surface, direction);
    ray.direction = offset_from_plane(point, error, normal) - ray.origin;
    float distance2 = dot(ray.direction, ray.direction);
    float cos_light = -dot(normal, direction);
    vec3 emission = material_emission(t.material);
    // Only the front side emits. Area becomes solid angle.
    bool lit = cos_light > 0.0 && distance2 > 0.0;
    float area = light_area(triangle);
    vec3 radiance = lit ? emission * (cos_light * area / distance2) : vec3(0.0);
    float pdf = lit ? area_light_pdf(area, distance2, cos_light) : 1.0;
    return LightSample(ray, direction, Primitive(triangle), radiance, pdf);
}

// Probability that a light sample is of the environment, or else of the area lights.
float light_selection_pmf(bool of_environment) {
    if (HAS_ENVIRONMENT && HAS_LIGHTS) {
        return of_environment ? frame.sky_probability : 1.0 - frame.sky_probability;
    }
    return 1.0;
}

// One sample of all light: of an area light, or of the environment.
LightSample sample_light(Surface surface, vec3 wo, vec4 u) {
    bool of_environment = HAS_ENVIRONMENT;
    if (HAS_ENVIRONMENT && HAS_LIGHTS) {
        of_environment = !split_sample(u.x, frame.sky_probability);
    }
    LightSample light;
    if (HAS_ENVIRONMENT && (!HAS_LIGHTS || of_environment)) {
        if (environment_is(ENVIRONMENT_LAT_LONG)) {
            light = sample_lat_long(surface, u);
        } else {
            light = sample_constant_environment(surface, wo, u.zw);
        }
    } else {
        light = sample_area_light(surface, u.xyz);
    }
    light.radiance *= 1.0 / light_selection_pmf(of_environment);
    light.pdf *= light_selection_pmf(of_environment);
    return light;
}

#endif
