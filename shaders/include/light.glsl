// Light sampling: emitting triangles, and the environment.
#ifndef LIGHT_GLSL
#define LIGHT_GLSL
#include "bsdf.glsl"
#include "random.glsl"

const bool HAS_ENVIRONMENT = ENVIRONMENT != ENVIRONMENT_BLACK;

bool environment_is(uint kind) { return (ENVIRONMENT == ENVIRONMENT_ANY ? frame.environment : ENVIRONMENT) == kind; }

bool shines_from_afar() { return HAS_ENVIRONMENT && !environment_is(ENVIRONMENT_BLACK); }

// A point of light as a surface sees it.
struct LightSample {
    Ray ray;           // towards the light; reaches a triangle at 1 direction length
    vec3 direction;    // unit
    uint triangle;     // that emits, or NO_TRIANGLE for the environment
    vec3 radiance;     // divided by its density
    float density;     // over solid angle, above 0
};

// Weight of a sample of density `own` where samples of another kind have density `other`. (Veach and
// Guibas 1995, power heuristic)
float mis_weight(float own, float other) {
    float ratio = other / own;
    return own == ONE_DIRECTION ? 1.0 : 1.0 / (1.0 + ratio * ratio);
}

// Radiance of the lat-long image at a texel, clamped at the poles and repeated around.
vec3 environment_texel(ivec2 at) {
    int width = int(frame.environment_width);
    at.x = at.x < 0 ? at.x + width : at.x >= width ? at.x - width : at.x;
    at.y = clamp(at.y, 0, int(frame.environment_height) - 1);
    return uintBitsToFloat(fetch_environment(uint(at.y * width + at.x)).xyz);
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

// Density over solid angle of the lat-long image's samples in a direction.
float lat_long_density(vec3 direction) {
    uvec2 size = uvec2(frame.environment_width, frame.environment_height);
    uvec2 at = min(uvec2(environment_uv(direction) * vec2(size)), size - 1u);
    float cos_range;
    float solid_angle = texel_solid_angle(at.y, cos_range);
    return uintBitsToFloat(fetch_environment(at.y * size.x + at.x).w) / solid_angle;
}

// The same of a constant environment's, which only the surface that was left can tell.
float constant_density(Surface surface, vec3 wo, vec3 direction) {
    return max(0.0, dot(surface.shading_normal * side_of(surface, wo), direction)) * INVERSE_PI;
}

// A texel by its probability: a half of the image by u.y, of that a half by u.x, and so on. Points
// that fill the square evenly then fill the image so, as a table of aliases would not let them.
// (Clarberg et al. 2005, hierarchical sample warping)
uvec2 pick_texel(vec2 u) {
    uvec2 size = uvec2(frame.environment_width, frame.environment_height);
    uint longest = max(size.x, size.y) - 1u;
    uvec2 texel = uvec2(0u);
    uint first = 0u;
    for (int level = findMSB(longest) + 1; level > 0; --level) {
        uvec2 blocks = (size - 1u >> level) + 1u;
        vec3 split = uintBitsToFloat(fetch_environment_splits(first + texel.y * blocks.x + texel.x).xyz);
        bool below = falls_above(u.y, split.x);
        bool right = falls_above(u.x, below ? split.z : split.y);
        texel = 2u * texel + uvec2(right, below);
        first += blocks.x * blocks.y;
    }
    return texel;
}

// A texel by its probability, then a direction uniform in its solid angle. The density is
// exact for the texel, and the bilinear radiance is zero wherever the density is.
LightSample sample_lat_long(Surface surface, vec4 u) {
    uvec2 texel = pick_texel(u.xy);
    float probability = uintBitsToFloat(fetch_environment(texel.y * frame.environment_width + texel.x).w);
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
    return LightSample(leave(surface, direction), direction, NO_TRIANGLE, environment_radiance(direction) / pdf, pdf);
}

// From a constant environment the cosine alone matters: sampled like the Lambert lobe.
LightSample sample_constant(Surface surface, vec3 wo, vec2 u) {
    vec3 n = surface.shading_normal * side_of(surface, wo);
    vec3 direction = sample_cosine(n, u);
    float pdf = dot(n, direction) * INVERSE_PI;
    vec3 radiance = pdf > 0.0 ? frame.environment_radiance / pdf : vec3(0.0);
    return LightSample(leave(surface, direction), direction, NO_TRIANGLE, radiance, pdf > 0.0 ? pdf : 1.0);
}

// Density over solid angle of samples of lamps towards a point of one.
float lamp_density(float light_area, float distance2, float cos_light) { return distance2 / (cos_light * light_area); }

// A lamp by its probability, as a cell of a table or as its alias (Walker 1974), then a point uniform over its
// area. One pair of numbers does both, so that points that fill their square evenly do so on each lamp.
LightSample sample_triangles(Surface surface, vec3 u) {
    uvec4 light = fetch_lights(pick_cell(u.x, frame.light_count, u.z));
    uint triangle = light.x;
    if (falls_above(u.x, uintBitsToFloat(light.y))) {
        triangle = fetch_lights(light.z).x;
    }
    Triangle t = fetch_triangle(triangle);
    vec3 normal = geometric_normal(t);
    vec3 error;
    vec3 point = interpolate_position(t, sample_triangle(u.xy), error);
    vec3 direction = normalize(point - surface.position);
    Ray ray = leave(surface, direction);
    ray.direction = offset_from_plane(point, error, normal) - ray.origin;
    float distance2 = dot(ray.direction, ray.direction);
    float cos_light = -dot(normal, direction);
    vec3 ke = uintBitsToFloat(fetch_materials(MATERIAL_TEXELS * t.material + 2u).xyz);
    // Light leaves the front side alone; area becomes solid angle.
    bool lit = cos_light > 0.0 && distance2 > 0.0;
    float light_area = fetch_light_area(triangle);
    vec3 radiance = lit ? ke * (cos_light * light_area / distance2) : vec3(0.0);
    float density = lit ? lamp_density(light_area, distance2, cos_light) : 1.0;
    return LightSample(ray, direction, triangle, radiance, density);
}

// Probability that a light sample goes to the environment, or to a lamp.
float choice_of(bool far) {
    if (HAS_ENVIRONMENT && HAS_LIGHTS) {
        return far ? frame.sky_probability : 1.0 - frame.sky_probability;
    }
    return 1.0;
}

// One sample of all light: of a lamp, or of the environment.
LightSample sample_light(Surface surface, vec3 wo, vec4 u) {
    bool far = HAS_ENVIRONMENT;
    if (HAS_ENVIRONMENT && HAS_LIGHTS) {
        far = !falls_above(u.x, frame.sky_probability);
    }
    LightSample light;
    if (HAS_ENVIRONMENT && (!HAS_LIGHTS || far)) {
        if (environment_is(ENVIRONMENT_LAT_LONG)) {
            light = sample_lat_long(surface, u);
        } else {
            light = sample_constant(surface, wo, u.zw);
        }
    } else {
        light = sample_triangles(surface, u.xyz);
    }
    light.radiance *= 1.0 / choice_of(far);
    light.density *= choice_of(far);
    return light;
}

#endif
