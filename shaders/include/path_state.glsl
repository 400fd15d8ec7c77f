// Loads and stores of path state: the only functions that know how it lies in memory.
#ifndef PATH_STATE_GLSL
#define PATH_STATE_GLSL
#include "bindings_path.glsl"
#include "halves.glsl"
#include "path.glsl"

// Samples of a pixel lie side by side: the lanes of a subgroup see much the same of the scene.
uint pixel_of(uint slot) { return batch.first_pixel + slot / batch.sample_count; }
uint sample_of(uint slot) { return batch.first_sample + slot % batch.sample_count; }

// The half of the ray queue that the bounce reads; the other half takes what it appends.
uint current_ray(uint place) { return ray_queue.paths[(batch.bounce & 1u) * frame.path_capacity + place]; }

// The direction of a path's ray as the words of ray_directions have it.
vec3 unpack_direction(uvec4 words) {
    return HALF_STATE ? decode_direction(words.xy) : uintBitsToFloat(words.xyz);
}

// What the words of ray_directions hold of a path with HALF_STATE: 48 bits of direction, the throughput in
// three halves, and two more: its pdfs with MIS, or whether emission that the ray finds counts.
uvec4 pack_path(Path path) {
    uvec3 random = dither(path.ray.origin);
    vec3 throughput = round_to_halves(path.throughput, random);
    vec3 others = vec3(path.sees_emission ? 1.0 : 0.0, 0.0, 0.0);
    if (MIS) {
        others = round_to_halves(vec3(path.pdf, path.sky_pdf, 0.0), random.yzx);
    }
    uvec4 words = uvec4(encode_direction(path.ray.direction), packHalf2x16(throughput.xy), packHalf2x16(vec2(throughput.z, others.x)));
    words.y |= packHalf2x16(vec2(0.0, others.y));
    return words;
}

void unpack_path(uvec4 words, inout Path path) {
    vec2 rest = unpackHalf2x16(words.w);
    path.ray.direction = unpack_direction(words);
    path.throughput = vec3(unpackHalf2x16(words.z), rest.x);
    path.sees_emission = MIS || rest.y != 0.0;
    // The largest half stands for every pdf that is no smaller: no other strategy can find that direction.
    path.pdf = MIS && rest.y < LARGEST_HALF ? max(rest.y, SMALLEST_HALF) : ONE_DIRECTION;
    path.sky_pdf = unpackHalf2x16(words.y).y;
}

// The path as it would come back from memory, for a scheduler that keeps it in registers.
Path rounded_path(Path path) {
    if (HALF_STATE) {
        unpack_path(pack_path(path), path);
    }
    return path;
}

Ray load_ray(uint slot) {
    uvec4 origin = ray_origins.words[slot];
    Primitive leaves = world_primitive(origin.w);
    if (TWO_LEVEL) {
        leaves.instance = ray_instances.words[slot];
    }
    return Ray(uintBitsToFloat(origin.xyz), unpack_direction(ray_directions.words[slot]), leaves);
}

Path load_path(uint slot) {
    Path path = Path(pixel_of(slot), sample_of(slot), batch.bounce, load_ray(slot), vec3(1.0), true, ONE_DIRECTION, 0.0);
    uvec4 words = ray_directions.words[slot];
    if (HALF_STATE) {
        unpack_path(words, path);
    } else {
        path.sees_emission = MIS || words.w != 0u;
        path.pdf = MIS ? uintBitsToFloat(words.w) : ONE_DIRECTION;
        // Where nothing scatters, every ray is the camera's.
        if (SCATTERS) {
            vec4 throughput = throughputs.rgba[slot];
            path.throughput = throughput.rgb;
            path.sky_pdf = throughput.a;
        }
    }
    return path;
}

void store_path(uint slot, Path path) {
    ray_origins.words[slot] = uvec4(floatBitsToUint(path.ray.origin), path.ray.leaves.triangle);
    if (TWO_LEVEL) {
        ray_instances.words[slot] = path.ray.leaves.instance;
    }
    if (HALF_STATE) {
        ray_directions.words[slot] = pack_path(path);
    } else {
        uint word = MIS ? floatBitsToUint(path.pdf) : path.sees_emission ? 1u : 0u;
        ray_directions.words[slot] = uvec4(floatBitsToUint(path.ray.direction), word);
        if (SCATTERS) {
            throughputs.rgba[slot] = vec4(path.throughput, MIS ? path.sky_pdf : 0.0);
        }
    }
}

Hit load_hit(uint slot) {
    uvec4 bits = hits.words[slot];
    Primitive primitive = world_primitive(bits.x);
    if (TWO_LEVEL) {
        primitive.instance = hit_instances.words[slot];
    }
    return Hit(primitive, uintBitsToFloat(bits.yz), uintBitsToFloat(bits.w));
}

void store_hit(uint slot, Hit hit) {
    hits.words[slot] = uvec4(hit.primitive.triangle, floatBitsToUint(hit.barycentrics), floatBitsToUint(hit.distance));
    if (TWO_LEVEL) {
        hit_instances.words[slot] = hit.primitive.instance;
    }
}

ShadowRay load_shadow_ray(uint place, out uint slot) {
    uvec4 origin = shadow_origins.words[place];
    uvec4 direction = shadow_directions.words[place];
    uvec4 radiance = shadow_radiances.words[place];
    slot = radiance.w;
    Primitive leaves = world_primitive(origin.w);
    Primitive light = world_primitive(direction.w);
    if (TWO_LEVEL) {
        uvec2 instances = shadow_instances.words[place];
        leaves.instance = instances.x;
        light.instance = instances.y;
    }
    Ray ray = Ray(uintBitsToFloat(origin.xyz), uintBitsToFloat(direction.xyz), leaves);
    return ShadowRay(ray, light, uintBitsToFloat(radiance.xyz));
}

void store_shadow_ray(uint place, uint slot, ShadowRay shadow) {
    shadow_origins.words[place] = uvec4(floatBitsToUint(shadow.ray.origin), shadow.ray.leaves.triangle);
    shadow_directions.words[place] = uvec4(floatBitsToUint(shadow.ray.direction), shadow.light.triangle);
    shadow_radiances.words[place] = uvec4(floatBitsToUint(shadow.radiance), slot);
    if (TWO_LEVEL) {
        shadow_instances.words[place] = uvec2(shadow.ray.leaves.instance, shadow.light.instance);
    }
}

#endif
