// The path tracer: what happens at one vertex. Every scheduler calls these functions and keeps
// the state; nothing here reads or writes a queue or a path buffer.
#ifndef PATH_GLSL
#define PATH_GLSL
#include "camera.glsl"
#include "light.glsl"
#include "random.glsl"

// The branch that a triangle's scattering is in.
uint material_branch(uint triangle) { return triangle % MATERIAL_BRANCHES; }

struct Path {
    uint pixel;
    uint sample_index;
    uint bounce;         // scattering events so far
    Ray ray;             // to the next vertex
    vec3 throughput;
    bool sees_emission;  // whether light found by the ray counts; with MIS it always does, in part
    float density;       // with MIS: of the ray's direction over solid angle, or ONE_DIRECTION
    float sky_density;   // with MIS: the same if a constant environment had been sampled for it
};

struct ShadowRay {
    Ray ray;
    uint light;     // triangle it may touch, or NO_TRIANGLE for the environment
    vec3 radiance;  // that arrives at the pixel if nothing blocks it; zero for no ray
};

// What a vertex gives: light found, a shadow ray, and whether the path goes on.
struct Vertex {
    vec3 emission;
    ShadowRay shadow;
    bool continues;
};

// How far a shadow ray must be free, in lengths of its direction.
float shadow_limit(uint light) { return light == NO_TRIANGLE ? FARTHEST : 1.0; }

Path begin_path(uint pixel, uint sample_index) {
    vec4 u = random4(pixel, sample_index, CAMERA_BLOCK, frame.seed);
    return Path(pixel, sample_index, 0u, camera_ray(pixel, u), vec3(1.0), true, ONE_DIRECTION, 0.0);
}

Vertex ended(vec3 emission) {
    ShadowRay none;
    none.ray = Ray(vec3(0.0), vec3(0.0), NO_TRIANGLE);
    none.light = NO_TRIANGLE;
    none.radiance = vec3(0.0);
    return Vertex(emission, none, false);
}

// Subnormal numbers become zeros: some devices take them for that in arithmetic and others do not.
vec3 normal_or_zero(vec3 x) { return mix(x, vec3(0.0), lessThan(abs(x), vec3(SMALLEST_NORMAL))); }

// Light that a sample may keep of one vertex, which is so many bounces from the camera. Biased: what is
// brighter than the clamp and came by two bounces or more is dimmed to it.
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
    if (shines_from_afar() && path.sees_emission) {
        light = path.throughput * environment_radiance(path.ray.direction);
        if (MIS) {
            float density = path.sky_density;
            if (environment_is(ENVIRONMENT_LAT_LONG)) {
                density = lat_long_density(path.ray.direction);
            }
            light *= mis_weight(path.density, choice_of(true) * density);
        }
    }
    return ended(clamped(light, path.bounce));
}

// Spends SHADING_COST dependent steps and yields 1: it stands for a costlier material.
float spend(float x) {
    for (uint step = 0u; step < SHADING_COST; step++) {
        x = x * 0.75 + 0.125;
    }
    // From [0, 1) the steps lead towards 1/2, which no compiler knows.
    return x < 2.0 ? 1.0 : 0.0;
}

// Scatters by the BRDF and pays for it.
Scatter scatter_at(Surface surface, Material material, bool specular, vec3 wo, vec4 u) {
    Scatter scatter;
    if (HAS_SPECULAR && (!HAS_PHONG || specular)) {
        scatter = scatter_specular(material, surface, wo, u.y);
    } else {
        scatter = scatter_glossy(material, surface, wo, u.zw);
    }
    if (SHADING_COST > 0u) {
        scatter.weight *= spend(u.y);
    }
    return scatter;
}

// As scatter_at, in the branch that the triangle belongs to: invocations of different branches
// wait for each other, as those of different BRDFs in a switch do. A loop stands for the branch
// because some devices run both sides of an `if`.
Scatter scatter_in_branch(uint triangle, Surface surface, Material material, bool specular, vec3 wo, vec4 u) {
    Scatter scatter;
    for (uint branch = 0u; branch < MATERIAL_BRANCHES; branch++) {
        bool taken = branch == material_branch(triangle);
        while (taken) {
            scatter = scatter_at(surface, material, specular, wo, u);
            taken = false;
        }
    }
    return scatter;
}

// Probability that a path goes on: its throughput as it would be outside, since glass scales radiance
// up on the way in and down again on the way out.
float survival_of(vec3 throughput, Surface surface, Material material, vec3 direction) {
    float likely = max(max(throughput.r, throughput.g), throughput.b);
    if (HAS_GLASS) {
        bool inside = is_specular(material) && material.surface != SURFACE_MIRROR && side_of(surface, direction) < 0.0;
        likely *= inside ? material.ni * material.ni : 1.0;
    }
    return min(1.0 - frame.roulette, likely);
}

// The path met a surface: it finds a lamp, or gathers light and scatters.
Vertex shade_hit(inout Path path, Hit hit) {
    Surface surface = surface_at(hit);
    Material material = fetch_material(surface.material, surface.uv);
    vec3 wo = -path.ray.direction;
    if (HAS_LIGHTS && material.surface == SURFACE_EMITTER) {
        bool lit = path.sees_emission && side_of(surface, wo) > 0.0;
        vec3 light = path.throughput * material.ke;
        if (MIS) {
            float cos_light = dot(surface.geometric_normal, wo);
            float density = lamp_density(fetch_light_area(hit.triangle), hit.distance * hit.distance, cos_light);
            light *= mis_weight(path.density, choice_of(false) * density);
        }
        return ended(lit ? clamped(light, path.bounce) : vec3(0.0));
    }
    Vertex vertex = ended(vec3(0.0));
    if (!SCATTERS || (BOUNDED && path.bounce == frame.max_bounces)) {
        return vertex;
    }
    bool specular = is_specular(material);

    // Sample a light, unless the surface answers to one direction only.
    if (INTEGRATOR != INTEGRATOR_IMPLICIT && CASTS_SHADOWS) {
        LightSample light = sample_light(surface, wo, random4(path.pixel, path.sample_index, light_block(path.bounce), frame.seed));
        float pdf;
        vec3 value = evaluate_glossy(material, surface, wo, light.direction, pdf);
        vertex.shadow.ray = light.ray;
        vertex.shadow.light = light.triangle;
        vec3 radiance = path.throughput * value * light.radiance;
        if (MIS) {
            radiance *= mis_weight(light.density, pdf);
        }
        vertex.shadow.radiance = specular ? vec3(0.0) : clamped(radiance, path.bounce + 1u);
    }
    // A last bounce that is not specular has all its light now.
    if (EXPLICIT && BOUNDED && !specular && path.bounce + 1u == frame.max_bounces) {
        return vertex;
    }

    // Stop with probability q, unless throughput is to decide.
    vec4 u = random4(path.pixel, path.sample_index, scatter_block(path.bounce), frame.seed);
    if (HAS_ROULETTE && !ROULETTE_BY_THROUGHPUT) {
        if (u.x < frame.roulette) {
            return vertex;
        }
        path.throughput *= 1.0 / (1.0 - frame.roulette);
    }

    Scatter scatter;
    if (MATERIAL_BRANCHES > 1u) {
        scatter = scatter_in_branch(hit.triangle, surface, material, specular, wo, u);
    } else {
        scatter = scatter_at(surface, material, specular, wo, u);
    }
    path.throughput *= scatter.weight;
    if (HAS_ROULETTE && ROULETTE_BY_THROUGHPUT && path.bounce >= frame.roulette_from) {
        float survival = survival_of(path.throughput, surface, material, scatter.direction);
        if (u.x >= survival) {
            return vertex;
        }
        path.throughput *= 1.0 / survival;
    }
    if (MIS) {
        path.density = scatter.density;
        if (environment_is(ENVIRONMENT_CONSTANT)) {
            path.sky_density = constant_density(surface, wo, scatter.direction);
        }
    }
    path.ray = leave(surface, scatter.direction);
    path.bounce += 1u;
    path.sees_emission = !EXPLICIT || specular;
    path.throughput = normal_or_zero(path.throughput);
    vertex.continues = any(greaterThan(path.throughput, vec3(0.0)));
    return vertex;
}

// Whether all that goes on from the vertex is numbers. Sums tell: one that is no number spoils them.
bool is_sound(Path path, Vertex vertex) {
    vec3 sum = path.throughput + path.ray.origin + path.ray.direction + vertex.shadow.radiance;
    return abs(sum.x + sum.y + sum.z) <= FARTHEST;
}

// What the path found: a surface, or nothing. A fault shines: it becomes light that is no number, which
// resolve counts, where a path that just ended would leave the pixel too dark and nobody the wiser.
Vertex shade_vertex(inout Path path, Hit hit) {
    Vertex vertex;
    if (hit.triangle == NO_TRIANGLE) {
        vertex = shade_miss(path);
    } else {
        vertex = shade_hit(path, hit);
    }
    vertex.emission = normal_or_zero(vertex.emission);
    vertex.shadow.radiance = normal_or_zero(vertex.shadow.radiance);
    bool sound = is_sound(path, vertex);
    vertex.emission = sound ? vertex.emission : vec3(uintBitsToFloat(0x7fc00000u));
    vertex.continues = sound && vertex.continues;
    return vertex;
}

bool carries_light(ShadowRay shadow) { return CASTS_SHADOWS && any(notEqual(shadow.radiance, vec3(0.0))); }

#endif
