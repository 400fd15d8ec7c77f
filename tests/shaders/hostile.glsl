// A driver that does all that Vulkan lets it do to a float: products are fused where a built-in hides them, quotients
// and roots are off by units in the last place, subnormal numbers are zeros, and sums are made from the last component
// on. The host links these in place of the operations (src/shaders/link.rs), so that tests see on any device what
// another driver may make of a kernel.
#version 460

// Moves a result by up to two units in the last place, by its bits.
float off(const float x, const int most) {
    uint bits = floatBitsToUint(x);
    uint magnitude = bits & 0x7fffffffu;
    int by = int((bits * 0x9e3779b1u) >> 20u) % (2 * most + 1) - most;
    bool moves = magnitude > 0x00800010u && magnitude < 0x7f7ffff0u;
    return moves ? uintBitsToFloat(bits + uint(by)) : x;
}

float flush(const float x) {
    uint bits = floatBitsToUint(x);
    return (bits & 0x7f800000u) == 0u ? uintBitsToFloat(bits & 0x80000000u) : x;
}

// What rounding took from a product, of numbers that are neither large nor small. (Dekker 1971)
float lost(const float a, const float b, const float product) {
    float p = a * 4097.0;
    float a_high = p - (p - a);
    float a_low = a - a_high;
    float q = b * 4097.0;
    float b_high = q - (q - b);
    float b_low = b - b_high;
    return ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low;
}

// a * b + c, rounded almost as if once.
float fused(const float a, const float b, const float c) {
    float product = a * b;
    float sum = product + c;
    float c_part = sum - product;
    float rest = (product - (sum - c_part)) + (c - c_part);
    float result = sum + (rest + lost(a, b, product));
    return abs(product) < 1e18 && abs(product) > 1e-18 ? result : sum;
}

float driver_add(const float a, const float b) { return flush(a + b); }
float driver_subtract(const float a, const float b) { return flush(a - b); }
float driver_multiply(const float a, const float b) { return flush(a * b); }
float driver_divide(const float a, const float b) { return flush(off(a / b, 2)); }
float driver_sqrt(const float a) { return off(sqrt(a), 2); }
float driver_inverse_sqrt(const float a) { return off(inversesqrt(a), 2); }
float driver_mix(const float a, const float b, const float t) { return fused(t, b - a, a); }

#define VECTORS(VECTOR, FLUSHED) \
    VECTOR flush(const VECTOR x) { return FLUSHED; } \
    VECTOR driver_add(const VECTOR a, const VECTOR b) { return flush(a + b); } \
    VECTOR driver_subtract(const VECTOR a, const VECTOR b) { return flush(a - b); } \
    VECTOR driver_multiply(const VECTOR a, const VECTOR b) { return flush(a * b); } \
    VECTOR driver_multiply(const VECTOR a, const float b) { return flush(a * b); }
VECTORS(vec2, vec2(flush(x.x), flush(x.y)))
VECTORS(vec3, vec3(flush(x.x), flush(x.y), flush(x.z)))
VECTORS(vec4, vec4(flush(x.x), flush(x.y), flush(x.z), flush(x.w)))

vec2 driver_divide(const vec2 a, const vec2 b) { return vec2(driver_divide(a.x, b.x), driver_divide(a.y, b.y)); }
vec3 driver_divide(const vec3 a, const vec3 b) {
    return vec3(driver_divide(a.xy, b.xy), driver_divide(a.z, b.z));
}

float driver_dot(const vec2 a, const vec2 b) { return fused(a.x, b.x, a.y * b.y); }
float driver_dot(const vec3 a, const vec3 b) { return fused(a.x, b.x, fused(a.y, b.y, a.z * b.z)); }
float driver_difference(const float a, const float b, const float c, const float d) { return fused(a, b, -(c * d)); }
vec3 driver_cross(const vec3 a, const vec3 b) {
    return vec3(driver_difference(a.y, b.z, b.y, a.z), driver_difference(a.z, b.x, b.z, a.x), driver_difference(a.x, b.y, b.x, a.y));
}
float driver_length(const vec2 a) { return driver_sqrt(driver_dot(a, a)); }
float driver_length(const vec3 a) { return driver_sqrt(driver_dot(a, a)); }
vec3 driver_normalize(const vec3 a) { return a * driver_inverse_sqrt(driver_dot(a, a)); }
vec3 driver_reflect(const vec3 a, const vec3 n) {
    float twice = 2.0 * driver_dot(n, a);
    return vec3(fused(-twice, n.x, a.x), fused(-twice, n.y, a.y), fused(-twice, n.z, a.z));
}
vec2 driver_mix(const vec2 a, const vec2 b, const vec2 t) {
    return vec2(driver_mix(a.x, b.x, t.x), driver_mix(a.y, b.y, t.y));
}
vec3 driver_mix(const vec3 a, const vec3 b, const vec3 t) {
    return vec3(driver_mix(a.xy, b.xy, t.xy), driver_mix(a.z, b.z, t.z));
}
vec2 driver_unpack_snorm(const uint bits) { return vec2(ivec2(int(bits << 16), int(bits)) >> 16) * (1.0 / 32767.0); }

// The compiler leaves out what nothing calls.
layout(local_size_x = 1) in;
void main() {
    float a = float(gl_GlobalInvocationID.x);
    vec2 b = vec2(a);
    vec3 c = vec3(a);
    vec4 d = vec4(a);
#define CALL_EACH(X) driver_add(X, X); driver_subtract(X, X); driver_multiply(X, X); driver_multiply(X, a);
    CALL_EACH(a)
    CALL_EACH(b)
    CALL_EACH(c)
    CALL_EACH(d)
    driver_divide(a, a); driver_divide(b, b); driver_divide(c, c); driver_sqrt(a); driver_inverse_sqrt(a);
    driver_dot(b, b); driver_dot(c, c); driver_cross(c, c); driver_length(b); driver_length(c); driver_normalize(c);
    driver_reflect(c, c); driver_mix(a, a, a); driver_mix(b, b, b); driver_mix(c, c, c);
    driver_unpack_snorm(floatBitsToUint(a));
}
