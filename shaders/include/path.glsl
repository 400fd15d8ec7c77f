// The path tracer: what happens at one vertex. Every scheduler calls these functions and keeps
// the state; nothing here reads or writes a queue or a path buffer, or asks which BSDF a material has.
#ifndef PATH_GLSL
#define PATH_GLSL
#include "bsdf.glsl"
#include "camera.glsl"
#include "light.glsl"
#include "random.glsl"
#include "skippable_if.glsl"

// The branch that scatters at a primitive.
uint material_branch(Primitive primitive) { return primitive.triangle % MATERIAL_BRANCHES; }

struct Path {
    uint pixel;
    uint sample_index;
    uint bounce;         // scattering events so far
    Ray ray;             // to the next vertex
    vec3 throughput;
    bool sees_emission;  // whether emission that the ray finds counts; with MIS it always does, in part
    float pdf;           // with MIS: of the ray's direction by BSDF sampling, over solid angle, or ONE_DIRECTION
    float sky_pdf;       // with MIS: of the same direction by sampling a constant environment
};

struct ShadowRay {
    Ray ray;
    Primitive light;  // that it aims at and may touch, or none for the environment
    vec3 radiance;    // that arrives at the pixel unless the ray is occluded; zero for no ray
};

// What a vertex gives: emission found, a shadow ray, and whether the path goes on.
struct Vertex {
    vec3 emission;
    ShadowRay shadow;
    bool continues;
};

// How far a shadow ray must be free, in lengths of its direction.
float shadow_t_max(ShadowRay shadow) { return is_none(shadow.light) ? FARTHEST : 1.0; }

Path begin_path(uint pixel, uint sample_index) {
    vec4 u = random4(pixel, sample_index, CAMERA_BLOCK, frame.seed);
    return Path(pixel, sample_index, 0u, camera_ray(pixel, u), vec3(1.0), true, ONE_DIRECTION, 0.0);
}

// A vertex at which the path ends, without a shadow ray.
Vertex vertex_without_scatter(vec3 emission) {
    ShadowRay none = ShadowRay(Ray(vec3(0.0), vec3(0.0), no_primitive()), no_primitive(), vec3(0.0));
    return Vertex(emission, none, false);
}

// Subnormal numbers become zeros: some devices take them for that in arithmetic and others do not.
vec3 normal_or_zero(vec3 x) { return mix(x, vec3(0.0), lessThan(abs(x), vec3(SMALLEST_NORMAL))); }

// Clamps what one vertex adds to a sample, by its largest channel, if the light came by two bounces or more. Biased.
vec3 clamped(vec3 light, uint bounces) {
    if (CLAMPS) {
        float peak = max(max(light.r, light.g), light.b);
        light *= bounces > 1u && peak > frame.radiance_clamp ? frame.radiance_clamp / peak : 1.0;
    }
    return light;
}

// The path left the scene.
Vertex shade_miss(Path path) {
    vec3 light = vec3(0.0);
    if (environment_emits() && path.sees_emission) {
        light = path.throughput * environment_radiance(path.ray.direction);
        if (MIS) {
            float light_pdf = path.sky_pdf;
            if (environment_is(ENVIRONMENT_LAT_LONG)) {
                light_pdf = lat_long_pdf(path.ray.direction);
            }
            light *= mis_weight(path.pdf, light_selection_pmf(LIGHTS_OF_ENVIRONMENT) * light_pdf);
        }
    }
    return vertex_without_scatter(clamped(light, path.bounce));
}

// Spends SHADING_COST dependent steps and yields 1: it stands for a more expensive material.
float spend(float x) {
    for (uint step = 0u; step < SHADING_COST; step++) {
        x = x * 0.75 + 0.125;
    }
    // From [0, 1) the steps lead towards 1/2, which no compiler knows.
    return x < 2.0 ? 1.0 : 0.0;
}

// Samples the BSDF and pays for it.
BsdfSample scatter(Material material, Surface surface, vec3 wo, vec4 u) {
    BsdfSample drawn = sample_bsdf(material, surface, wo, u.y, u.zw);
    if (SHADING_COST > 0u) {
        drawn.weight *= spend(u.y);
    }
    return drawn;
}

// The same in the branch that the primitive belongs to: lanes of different branches wait for each other, as those of
// different BSDFs in a switch do.
BsdfSample scatter_in_branch(Material material, Surface surface, vec3 wo, vec4 u) {
    BsdfSample drawn;
    for (uint branch = 0u; branch < MATERIAL_BRANCHES; branch++) {
        SKIPPABLE_IF(branch == material_branch(surface.primitive)) {
            drawn = scatter(material, surface, wo, u);
        }
    }
    return drawn;
}

// The path hit a surface: it finds an area light, or samples light and scatters.
Vertex shade_hit(inout Path path, Hit hit) {
    Surface surface = surface_at(hit);
    vec3 wo = -path.ray.direction;
    // What the vertex draws for scattering: for roulette, for a component, for a direction.
    vec4 u;
    if (HAS_BLENDS) {
        u = random4(path.pixel, path.sample_index, scatter_block(path.bounce), frame.seed);
    }
    Material material = material_towards(surface, wo, u.y);
    Vertex vertex = vertex_without_scatter(vec3(0.0));
    if (is_emissive(material)) {
        bool lit = path.sees_emission && side_of(surface, wo) > 0.0;
        vec3 light = path.throughput * material.ke;
        if (MIS) {
            float cos_light = dot(surface.geometric_normal, wo);
            float light_pdf = area_light_pdf(light_area(hit.primitive), hit.distance * hit.distance, cos_light);
            light *= mis_weight(path.pdf, light_selection_pmf(LIGHTS_OF_AREAS) * light_pdf);
        }
        vertex.emission = lit ? clamped(light, path.bounce) : vec3(0.0);
        if (!scatters_too(material)) {
            return vertex;
        }
    }
    if (!SCATTERS || (BOUNDED && path.bounce == frame.max_bounces)) {
        return vertex;
    }
    if (HAS_NORMAL_TEXTURES) {
        surface = with_normal_map(surface, wo);
    }
    uint flags = bsdf_flags(material);

    // Next-event estimation: sample a light. A BSDF that is all specular scatters none of it.
    if (INTEGRATOR != INTEGRATOR_IMPLICIT && CASTS_SHADOWS) {
        LightSample light = sample_light(surface, wo, flags, random4(path.pixel, path.sample_index, light_block(path.bounce), frame.seed));
        BsdfValue value = evaluate_bsdf(material, surface, wo, light.direction);
        vertex.shadow.ray = light.ray;
        vertex.shadow.light = light.light;
        vec3 radiance = path.throughput * value.f_cos * light.radiance;
        if (MIS) {
            radiance *= mis_weight(light.pdf, value.pdf);
        }
        bool scatters = (flags & BSDF_NON_SPECULAR) != 0u;
        vertex.shadow.radiance = scatters ? clamped(radiance, path.bounce + 1u) : vec3(0.0);
    }
    // At the last bounce next-event estimation has found all light, unless specular components scatter some.
    if (EXPLICIT && BOUNDED && (flags & BSDF_SPECULAR) == 0u && path.bounce + 1u == frame.max_bounces) {
        return vertex;
    }

    // Constant Russian roulette: end the path with probability q.
    if (!HAS_BLENDS) {
        u = random4(path.pixel, path.sample_index, scatter_block(path.bounce), frame.seed);
    }
    if (HAS_ROULETTE && !ROULETTE_BY_THROUGHPUT) {
        if (u.x < frame.roulette) {
            return vertex;
        }
        path.throughput *= 1.0 / (1.0 - frame.roulette);
    }

    // Sample the BSDF.
    BsdfSample drawn;
    if (MATERIAL_BRANCHES > 1u) {
        drawn = scatter_in_branch(material, surface, wo, u);
    } else {
        drawn = scatter(material, surface, wo, u);
    }
    path.throughput *= drawn.weight;

    // Russian roulette by throughput, as it would be outside: inside an index of eta radiance is larger by eta squared.
    if (HAS_ROULETTE && ROULETTE_BY_THROUGHPUT && path.bounce >= frame.roulette_from) {
        float largest = max(max(path.throughput.r, path.throughput.g), path.throughput.b);
        float survival = min(1.0 - frame.roulette, largest * (drawn.eta * drawn.eta));
        if (u.x >= survival) {
            return vertex;
        }
        path.throughput *= 1.0 / survival;
    }

    // Spawn the next ray.
    if (MIS) {
        path.pdf = drawn.pdf;
        if (environment_is(ENVIRONMENT_CONSTANT)) {
            path.sky_pdf = constant_environment_pdf(surface, wo, flags, drawn.direction);
        }
    }
    path.ray = spawn_ray(surface, drawn.direction);
    path.bounce += 1u;
    path.sees_emission = !EXPLICIT || (drawn.flags & BSDF_SPECULAR) != 0u;
    path.throughput = normal_or_zero(path.throughput);
    vertex.continues = any(greaterThan(path.throughput, vec3(0.0)));
    return vertex;
}

// Whether all that goes on from the vertex is finite. A sum is enough: one number that is not finite makes it so.
bool is_finite(Path path, Vertex vertex) {
    vec3 sum = path.throughput + path.ray.origin + path.ray.direction + vertex.shadow.radiance;
    return abs(sum.x + sum.y + sum.z) <= FARTHEST;
}

// Shades what the ray found: a surface, or nothing. Non-finite path state is turned into NaN radiance so that resolve
// counts it; ending the path would darken the pixel silently.
Vertex shade_vertex(inout Path path, Hit hit) {
    Vertex vertex;
    if (is_none(hit.primitive)) {
        vertex = shade_miss(path);
    } else {
        vertex = shade_hit(path, hit);
    }
    vertex.emission = normal_or_zero(vertex.emission);
    vertex.shadow.radiance = normal_or_zero(vertex.shadow.radiance);
    bool finite = is_finite(path, vertex);
    vertex.emission = finite ? vertex.emission : vec3(uintBitsToFloat(0x7fc00000u));
    vertex.continues = finite && vertex.continues;
    return vertex;
}

bool carries_light(ShadowRay shadow) { return CASTS_SHADOWS && any(notEqual(shadow.radiance, vec3(0.0))); }

#endif
