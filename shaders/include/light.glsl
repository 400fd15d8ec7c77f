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

// A direction of the world in the lat-long image, and back.
vec3 to_environment(vec3 direction) {
    if (HAS_TURNED_ENVIRONMENT) {
        direction = vec3(dot(direction, frame.environment_x), dot(direction, frame.environment_y), dot(direction, frame.environment_z));
    }
    return direction;
}

vec3 from_environment(vec3 direction) {
    if (HAS_TURNED_ENVIRONMENT) {
        direction = frame.environment_x * direction.x + frame.environment_y * direction.y + frame.environment_z * direction.z;
    }
    return direction;
}

vec3 environment_radiance(vec3 direction) {
    if (environment_is(ENVIRONMENT_LAT_LONG)) {
        vec2 p = environment_uv(to_environment(direction)) * vec2(frame.environment_width, frame.environment_height) - 0.5;
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
    uvec2 at = min(uvec2(environment_uv(to_environment(direction)) * vec2(size)), size - 1u);
    float cos_range;
    float solid_angle = texel_solid_angle(at.y, cos_range);
    return environment_texel_probability(at.y * size.x + at.x) / solid_angle;
}

// Whether some BSDF transmits light into more than one direction.
const bool HAS_ROUGH_TRANSMISSION = HAS_ROUGH_DIELECTRIC || HAS_PRINCIPLED || HAS_PRINCIPLED_THIN;

// Whether a BSDF of these components gathers light from both sides of the surface.
bool gathers_from_both_sides(uint flags) {
    return HAS_ROUGH_TRANSMISSION && (flags & BSDF_TRANSMIT) != 0u && (flags & BSDF_NON_SPECULAR) != 0u;
}

// The same of a sample of a constant environment, which depends on the surface that is lit.
float constant_environment_pdf(Surface surface, vec3 wo, uint flags, vec3 direction) {
    float cosine = dot(normal_towards(surface, wo), direction);
    float pdf = max(0.0, cosine) * INVERSE_PI;
    if (gathers_from_both_sides(flags)) {
        pdf = abs(cosine) * INVERSE_TWO_PI;
    }
    return pdf;
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
    vec3 direction = from_environment(vec3(across.y, cos_theta, -across.x));
    float pdf = probability / solid_angle;
    return LightSample(spawn_ray(surface, direction), direction, no_primitive(), environment_radiance(direction) / pdf, pdf);
}

// Of a constant environment only the cosine matters: it is sampled like the Lambert BRDF.
LightSample sample_constant_environment(Surface surface, vec3 wo, uint flags, vec2 u) {
    vec3 n = normal_towards(surface, wo);
    float side_pmf = 1.0;
    if (gathers_from_both_sides(flags)) {
        n = split_sample(u.x, 0.5) ? -n : n;
        side_pmf = 0.5;
    }
    vec3 direction = sample_cosine(n, u);
    float pdf = dot(n, direction) * INVERSE_PI * side_pmf;
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
    Primitive primitive = cell.primitive;
    if (split_sample(u.x, cell.threshold)) {
        primitive = fetch_light(cell.alias).primitive;
    }
    Triangle t = fetch_triangle(primitive);
    vec3 normal = geometric_normal(t);
    vec3 error;
    vec3 point = interpolate_position(t, sample_triangle(u.xy), error);
    vec3 direction = normalize(point - surface.position);
    Ray ray = spawn_ray(surface, direction);
    ray.direction = offset_from_plane(point, error, normal) - ray.origin;
    float distance2 = dot(ray.direction, ray.direction);
    float cos_light = -dot(normal, direction);
    vec3 emission = material_emission(t.material);
    if (HAS_DETAIL_TEXTURES) {
        emission = emission_at(t.material, corner_uv_at(primitive, t.original, sample_triangle(u.xy)), emission);
    }
    // Only the front side emits. Area becomes solid angle.
    bool lit = cos_light > 0.0 && distance2 > 0.0;
    float area = light_area(primitive);
    vec3 radiance = lit ? emission * (cos_light * area / distance2) : vec3(0.0);
    float pdf = lit ? area_light_pdf(area, distance2, cos_light) : 1.0;
    return LightSample(ray, direction, primitive, radiance, pdf);
}

// Stands for the primitive of a light that is none: a ray ends there and nothing can be hit.
Primitive at_point() { return world_primitive(NO_TRIANGLE - 1u); }

// Intensity of a spot in the direction of unit `from` the light, over that along its axis.
float spot_falloff(PunctualLight light, vec3 from) {
    float cosine = dot(light.direction, from);
    if (light.kind == LIGHT_SPOT) {
        // The angle from the chord: an arc cosine is coarse near the axis.
        vec3 across = cross(light.direction, from);
        float angle = angle_of(cosine, length(across));
        return clamp((light.none_from - angle) / max(light.none_from - light.full_from, 1e-6), 0.0, 1.0);
    }
    float share = clamp((cosine - light.none_from) / max(light.full_from - light.none_from, 1e-6), 0.0, 1.0);
    return share * share;
}

// A light that is no surface, by its strength.
LightSample sample_punctual_light(Surface surface, vec4 u) {
    PunctualLight light = fetch_punctual_light(split_sample_evenly(u.x, frame.punctual_count, u.z));
    if (split_sample(u.x, light.threshold)) {
        light = fetch_punctual_light(light.alias);
    }
    if (light.kind == LIGHT_DIRECTIONAL) {
        vec3 direction = -light.direction;
        return LightSample(spawn_ray(surface, direction), direction, no_primitive(), light.emission, ONE_DIRECTION);
    }
    vec3 towards = light.position - surface.position;
    float distance2 = dot(towards, towards);
    vec3 direction = distance2 > 0.0 ? normalize(towards) : surface.geometric_normal;
    Ray ray = spawn_ray(surface, direction);
    ray.direction = light.position - ray.origin;
    vec3 radiance = distance2 > 0.0 ? light.emission / distance2 : vec3(0.0);
    if (light.kind != LIGHT_POINT) {
        radiance *= spot_falloff(light, -direction);
    }
    return LightSample(ray, direction, at_point(), radiance, ONE_DIRECTION);
}

// Kinds of light between which a light sample chooses.
const uint LIGHTS_OF_AREAS = 0u;
const uint LIGHTS_OF_ENVIRONMENT = 1u;
const uint LIGHTS_OF_POINTS = 2u;

// Probability that a light sample is of that kind.
float light_selection_pmf(uint kind) {
    float pmf = 1.0;
    if (HAS_ENVIRONMENT && HAS_LIGHTS) {
        pmf = kind == LIGHTS_OF_ENVIRONMENT ? frame.sky_probability : 1.0 - frame.sky_probability;
    }
    if (HAS_PUNCTUAL_LIGHTS) {
        float of_points = frame.punctual_probability;
        pmf = kind == LIGHTS_OF_POINTS ? of_points : pmf * (1.0 - of_points);
    }
    return pmf;
}

// One sample of all light that a BSDF of these components gathers: of an area light, of the environment, or of a light that
// is no surface.
LightSample sample_light(Surface surface, vec3 wo, uint flags, vec4 u) {
    uint kind = HAS_ENVIRONMENT ? LIGHTS_OF_ENVIRONMENT : LIGHTS_OF_AREAS;
    bool of_point = false;
    if (HAS_PUNCTUAL_LIGHTS) {
        of_point = !split_sample(u.x, frame.punctual_probability);
    }
    if (HAS_ENVIRONMENT && HAS_LIGHTS) {
        kind = split_sample(u.x, frame.sky_probability) ? LIGHTS_OF_AREAS : LIGHTS_OF_ENVIRONMENT;
    }
    kind = of_point ? LIGHTS_OF_POINTS : kind;
    LightSample light;
    if (HAS_PUNCTUAL_LIGHTS && kind == LIGHTS_OF_POINTS) {
        light = sample_punctual_light(surface, u);
    } else if (HAS_ENVIRONMENT && (!HAS_LIGHTS || kind == LIGHTS_OF_ENVIRONMENT)) {
        if (environment_is(ENVIRONMENT_LAT_LONG)) {
            light = sample_lat_long(surface, u);
        } else {
            light = sample_constant_environment(surface, wo, flags, u.zw);
        }
    } else {
        light = sample_area_light(surface, u.xyz);
    }
    light.radiance *= 1.0 / light_selection_pmf(kind);
    light.pdf *= light_selection_pmf(kind);
    light.pdf = HAS_PUNCTUAL_LIGHTS && kind == LIGHTS_OF_POINTS ? ONE_DIRECTION : light.pdf;
    return light;
}

#endif
