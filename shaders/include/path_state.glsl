// Loads and stores of path state: the only functions that know how it lies in memory.
#ifndef PATH_STATE_GLSL
#define PATH_STATE_GLSL
#include "bindings_path.glsl"
#include "path.glsl"

// Samples of a pixel lie side by side: the lanes of a subgroup see much the same of the scene.
uint pixel_of(uint slot) { return batch.first_pixel + slot / batch.sample_count; }
uint sample_of(uint slot) { return batch.first_sample + slot % batch.sample_count; }

// The half of the ray queue that the bounce reads; the other half takes what it appends.
uint current_ray(uint place) { return ray_queue.paths[(batch.bounce & 1u) * frame.path_capacity + place]; }

Ray load_ray(uint slot) {
    uvec4 origin = ray_origins.words[slot];
    uvec4 direction = ray_directions.words[slot];
    return Ray(uintBitsToFloat(origin.xyz), uintBitsToFloat(direction.xyz), origin.w);
}

Path load_path(uint slot) {
    Ray ray = load_ray(slot);
    uint word = ray_directions.words[slot].w;
    // Where nothing scatters, every ray is the camera's.
    vec4 throughput = vec4(1.0, 1.0, 1.0, 0.0);
    if (SCATTERS) {
        throughput = throughputs.rgba[slot];
    }
    bool sees_emission = MIS || word != 0u;
    float density = MIS ? uintBitsToFloat(word) : ONE_DIRECTION;
    return Path(pixel_of(slot), sample_of(slot), batch.bounce, ray, throughput.rgb, sees_emission, density, throughput.a);
}

void store_path(uint slot, Path path) {
    ray_origins.words[slot] = uvec4(floatBitsToUint(path.ray.origin), path.ray.leaves);
    uint word = MIS ? floatBitsToUint(path.density) : path.sees_emission ? 1u : 0u;
    ray_directions.words[slot] = uvec4(floatBitsToUint(path.ray.direction), word);
    if (SCATTERS) {
        throughputs.rgba[slot] = vec4(path.throughput, MIS ? path.sky_density : 0.0);
    }
}

Hit load_hit(uint slot) {
    uvec4 bits = hits.words[slot];
    return Hit(bits.x, uintBitsToFloat(bits.yz), uintBitsToFloat(bits.w));
}

void store_hit(uint slot, Hit hit) {
    hits.words[slot] = uvec4(hit.triangle, floatBitsToUint(hit.barycentrics), floatBitsToUint(hit.distance));
}

ShadowRay load_shadow_ray(uint place, out uint slot) {
    uvec4 origin = shadow_origins.words[place];
    uvec4 direction = shadow_directions.words[place];
    uvec4 radiance = shadow_radiances.words[place];
    slot = radiance.w;
    Ray ray = Ray(uintBitsToFloat(origin.xyz), uintBitsToFloat(direction.xyz), origin.w);
    return ShadowRay(ray, direction.w, uintBitsToFloat(radiance.xyz));
}

void store_shadow_ray(uint place, uint slot, ShadowRay shadow) {
    shadow_origins.words[place] = uvec4(floatBitsToUint(shadow.ray.origin), shadow.ray.leaves);
    shadow_directions.words[place] = uvec4(floatBitsToUint(shadow.ray.direction), shadow.light);
    shadow_radiances.words[place] = uvec4(floatBitsToUint(shadow.radiance), slot);
}

#endif
