// raywave's own forms of operations whose result Vulkan leaves to the driver, from operations whose result it does
// not: sums, differences and products in floats, and integers. docs/numerics.md says what each rounds to.
//
// No kernel includes this file. The host links a function from here in place of each such operation of a kernel
// (crates/shaders/src/link.rs): a function `portable_NAME` stands for the operation NAME of its operands' types, and one
// whose name goes on with `_by_fma` or `_by_integers` is the form for devices that can, or cannot, fuse.
//
// Parameters are `const`, so that they are passed by value. Selections stand for branches: functions that are called a
// hundred times in a kernel take SwiftShader's compiler three times as long with branches in them.
#version 460

const uint SIGN = 0x80000000u;
const uint INFINITE = 0x7f800000u;
const uint NOT_A_NUMBER = 0x7fc00000u;
const uint MANTISSA = 0x007fffffu;
const uint LEADING_BIT = 0x00800000u;
// Within these magnitudes nothing that the fused forms compute on the way is subnormal or infinite.
const float SMALLEST_FUSED = 8.8817842e-16;  // 2^-50
const float LARGEST_FUSED = 1.1529215e18;    // 2^60

// What a number's bits are once a subnormal one has become a zero of its sign.
uint flushed(const uint bits) { return mix(bits, bits & SIGN, (bits & INFINITE) == 0u); }

// Quotient and remainder of a division of integers of which the quotient is near `guess`: nothing is rounded modulo
// 2^32, and the remainder is small enough to be told by its lowest 32 bits.
uint quotient_by_guess(const uint dividend_low, const uint divisor, const uint guess, out uint remainder) {
    int rest = int(dividend_low - guess * divisor);
    int more = int(floor(float(rest) / float(divisor)));
    uint quotient = guess + uint(more);
    rest -= more * int(divisor);
    bool over = rest < 0;
    quotient -= over ? 1u : 0u;
    rest += over ? int(divisor) : 0;
    bool under = rest >= int(divisor);
    quotient += under ? 1u : 0u;
    rest -= under ? int(divisor) : 0;
    remainder = uint(rest);
    return quotient;
}

// The quotient rounded to nearest, ties to even. Subnormal operands and results are zeros. The driver's own division
// makes guesses alone: they may be off by a dozen units in the last place.
float portable_divide_by_integers(const float a, const float b) {
    uint x = flushed(floatBitsToUint(a));
    uint y = flushed(floatBitsToUint(b));
    uint sign = (x ^ y) & SIGN;
    x &= ~SIGN;
    y &= ~SIGN;
    uint dividend = (x & MANTISSA) | LEADING_BIT;
    uint divisor = (y & MANTISSA) | LEADING_BIT;
    // The quotient of the mantissas is brought into [2^23, 2^24).
    bool below = dividend < divisor;
    uint guess = uint(float(dividend) / float(divisor) * (below ? 16777216.0 : 8388608.0));
    uint remainder;
    uint quotient = quotient_by_guess(dividend << (below ? 24u : 23u), divisor, guess, remainder);
    uint twice = 2u * remainder;
    quotient += uint(twice + (quotient & 1u) > divisor);
    int exponent = int(x >> 23) - int(y >> 23) + (below ? 126 : 127);
    // A carry out of the mantissa is one into the exponent.
    int rounded = exponent * int(LEADING_BIT) + int(quotient - LEADING_BIT);
    uint result = mix(uint(rounded), 0u, rounded < int(LEADING_BIT));
    result = mix(result, INFINITE, exponent > 254);
    bool zero = any(equal(uvec2(x, y), uvec2(0u, INFINITE)));
    bool infinite = any(equal(uvec2(x, y), uvec2(INFINITE, 0u)));
    bool none = any(greaterThan(uvec2(x, y), uvec2(INFINITE)));
    result = mix(mix(result, 0u, zero), INFINITE, infinite) | sign;
    return uintBitsToFloat(mix(mix(result, NOT_A_NUMBER, zero && infinite), NOT_A_NUMBER, none));
}

bool is_within(const float x) { return abs(x) >= SMALLEST_FUSED && abs(x) <= LARGEST_FUSED; }

// Whether the fused forms round quotients by a number right: of one just below a power of two the reciprocal lies so
// close to the middle of two numbers that the last step cannot tell on which side.
bool has_fused_reciprocal(const float b) { return is_within(b) && (floatBitsToUint(b) & MANTISSA) != MANTISSA; }

// The same by fused multiplication and addition: a reciprocal is brought to half a unit in the last place, and the
// quotient by the remainder that it leaves. (Markstein 1990, Computation of Elementary Functions on the IBM RISC
// System/6000 Processor)
float portable_divide_by_fma(const float a, const float b) {
    float guess = 1.0 / b;
    float reciprocal = fma(fma(-b, guess, 1.0), guess, guess);
    float quotient = a * reciprocal;
    float result = fma(fma(-b, quotient, a), reciprocal, quotient);
    if (!(has_fused_reciprocal(b) && is_within(result))) {
        result = portable_divide_by_integers(a, b);
    }
    return result;
}

// Of a dividend that is 1.
float portable_reciprocal_by_integers(const float one, const float b) { return portable_divide_by_integers(one, b); }

float portable_reciprocal_by_fma(const float one, const float b) {
    float guess = 1.0 / b;
    float reciprocal = fma(fma(-b, guess, 1.0), guess, guess);
    float result = fma(fma(-b, reciprocal, 1.0), reciprocal, reciprocal);
    if (!has_fused_reciprocal(b)) {
        result = portable_divide_by_integers(one, b);
    }
    return result;
}

// The square root rounded to nearest. That of a number below zero is none; of -0 it is -0.
float portable_root_by_integers(const float a) {
    uint x = flushed(floatBitsToUint(a));
    int exponent = int(x >> 23) - 127;
    bool odd = (exponent & 1) != 0;
    uint mantissa = (x & MANTISSA) | LEADING_BIT;
    // The radicand is the mantissa times 2^23 or 2^24, and its root in [2^23, 2^24).
    uint guess = uint(sqrt(float(mantissa) * (odd ? 2.3841858e-7 : 1.1920929e-7)) * 8388608.0);
    int rest = int((mantissa << (odd ? 24u : 23u)) - guess * guess);
    int more = int(floor(float(rest) / float(2u * guess)));
    uint root = guess + uint(more);
    rest -= more * int(guess + root);
    bool over = rest < 0;
    root -= over ? 1u : 0u;
    rest += over ? int(2u * root + 1u) : 0;
    bool under = rest > int(2u * root);
    rest -= under ? int(2u * root + 1u) : 0;
    root += under ? 1u : 0u;
    // Half a unit above the root is its square and its remainder and a quarter: there is no tie.
    root += rest > int(root) ? 1u : 0u;
    uint result = uint(((exponent >> 1) + 127) * int(LEADING_BIT)) + (root - LEADING_BIT);
    result = mix(mix(result, x, (x & ~SIGN) == 0u), x, x == INFINITE);
    // Bits above those of an infinity are NaN, or negative.
    return uintBitsToFloat(mix(result, NOT_A_NUMBER, x > INFINITE && x != SIGN));
}

// By fused multiplication and addition. (The same, Goldschmidt's iteration with Markstein's last step)
float portable_root_by_fma(const float a) {
    float guess = inversesqrt(a);
    float root = a * guess;
    float half_reciprocal = 0.5 * guess;
    float lacks = fma(-half_reciprocal, root, 0.5);
    root = fma(root, lacks, root);
    half_reciprocal = fma(half_reciprocal, lacks, half_reciprocal);
    float result = fma(fma(-root, root, a), half_reciprocal, root);
    if (!(a >= SMALLEST_FUSED && a <= LARGEST_FUSED)) {
        result = portable_root_by_integers(a);
    }
    return result;
}

#define VECTORS_OF_DIVISION(FORM) \
    vec2 portable_divide_##FORM(const vec2 a, const vec2 b) { \
        return vec2(portable_divide_##FORM(a.x, b.x), portable_divide_##FORM(a.y, b.y)); \
    } \
    vec3 portable_divide_##FORM(const vec3 a, const vec3 b) { \
        return vec3(portable_divide_##FORM(a.x, b.x), portable_divide_##FORM(a.y, b.y), portable_divide_##FORM(a.z, b.z)); \
    } \
    vec2 portable_reciprocal_##FORM(const vec2 one, const vec2 b) { \
        return vec2(portable_reciprocal_##FORM(one.x, b.x), portable_reciprocal_##FORM(one.y, b.y)); \
    } \
    vec3 portable_reciprocal_##FORM(const vec3 one, const vec3 b) { \
        return vec3(portable_reciprocal_##FORM(one.xy, b.xy), portable_reciprocal_##FORM(one.z, b.z)); \
    }
VECTORS_OF_DIVISION(by_integers)
VECTORS_OF_DIVISION(by_fma)

// Sums are made from the first component on.
float portable_dot(const vec2 a, const vec2 b) { return a.x * b.x + a.y * b.y; }
float portable_dot(const vec3 a, const vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
float portable_dot(const vec4 a, const vec4 b) { return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w; }

vec3 portable_cross(const vec3 a, const vec3 b) {
    return vec3(a.y * b.z - b.y * a.z, a.z * b.x - b.z * a.x, a.x * b.y - b.x * a.y);
}

// The operations that these are made of are replaced in turn.
float portable_length(const vec2 a) { return sqrt(portable_dot(a, a)); }
float portable_length(const vec3 a) { return sqrt(portable_dot(a, a)); }
vec2 portable_normalize(const vec2 a) { return a * (1.0 / sqrt(portable_dot(a, a))); }
vec3 portable_normalize(const vec3 a) { return a * (1.0 / sqrt(portable_dot(a, a))); }
vec3 portable_reflect(const vec3 a, const vec3 n) { return a - (2.0 * portable_dot(n, a)) * n; }
float portable_inverse_sqrt(const float a) { return 1.0 / sqrt(a); }

// Where an operand is NaN the first one is the answer.
#define SELECTIONS(TYPE, BOOL) \
    TYPE portable_min(const TYPE a, const TYPE b) { return mix(a, b, lessThan(b, a)); } \
    TYPE portable_max(const TYPE a, const TYPE b) { return mix(a, b, greaterThan(b, a)); } \
    TYPE portable_clamp(const TYPE a, const TYPE low, const TYPE high) { return portable_min(portable_max(a, low), high); }
SELECTIONS(vec2, bvec2)
SELECTIONS(vec3, bvec3)
SELECTIONS(vec4, bvec4)
float portable_min(const float a, const float b) { return b < a ? b : a; }
float portable_max(const float a, const float b) { return b > a ? b : a; }
float portable_clamp(const float a, const float low, const float high) { return portable_min(portable_max(a, low), high); }

#define ARITHMETIC(TYPE, UINT) \
    TYPE portable_mix(const TYPE a, const TYPE b, const TYPE t) { return a * (1.0 - t) + b * t; } \
    TYPE portable_fract(const TYPE a) { return a - floor(a); }
ARITHMETIC(float, uint)
ARITHMETIC(vec2, uvec2)
ARITHMETIC(vec3, uvec3)
ARITHMETIC(vec4, uvec4)

// By the bits: a driver may take all numbers to be numbers.
bool portable_is_nan(const float a) { return (floatBitsToUint(a) & ~SIGN) > INFINITE; }
bool portable_is_inf(const float a) { return (floatBitsToUint(a) & ~SIGN) == INFINITE; }
bvec3 portable_is_nan(const vec3 a) { return greaterThan(floatBitsToUint(a) & ~SIGN, uvec3(INFINITE)); }
bvec3 portable_is_inf(const vec3 a) { return equal(floatBitsToUint(a) & ~SIGN, uvec3(INFINITE)); }

// A half as a float. A subnormal one is an integer times 2^-24.
float of_half(const uint bits) {
    uint magnitude = bits & 0x7fffu;
    uint above = magnitude << 13;
    uint normal = mix(above + 0x38000000u, above | INFINITE, magnitude >= 0x7c00u);
    float value = mix(uintBitsToFloat(normal), float(magnitude) * 5.9604645e-8, magnitude < 0x400u);
    return uintBitsToFloat(floatBitsToUint(value) | (bits & 0x8000u) << 16);
}

vec2 portable_unpack_half(const uint bits) { return vec2(of_half(bits & 0xffffu), of_half(bits >> 16)); }

// A float as a half, rounded to nearest, ties to even.
uint to_half(const float a) {
    uint bits = floatBitsToUint(a);
    uint sign = (bits & SIGN) >> 16;
    uint magnitude = bits & ~SIGN;
    // Below 2^-14 a half's last bit is 2^-24, which is the last bit of a float of [1/2, 1): the sum rounds there.
    uint small = floatBitsToUint(uintBitsToFloat(min(magnitude, 0x38800000u)) + 0.5) - 0x3f000000u;
    uint rounded = (magnitude - 0x38000000u + 0xfffu + (magnitude >> 13 & 1u)) >> 13;
    uint finite = mix(min(rounded, 0x7c00u), small, magnitude < 0x38800000u);
    uint infinite = mix(0x7c00u, 0x7e00u, magnitude > INFINITE);
    return mix(finite, infinite, magnitude >= 0x47800000u) | sign;
}

uint portable_pack_half(const vec2 a) { return to_half(a.x) | to_half(a.y) << 16; }

// The lowest number stands for -1, as the next one does.
vec2 portable_unpack_snorm(const uint bits) {
    ivec2 numbers = ivec2(int(bits << 16), int(bits)) >> 16;
    return vec2(max(numbers, ivec2(-32767))) / 32767.0;
}

// The compiler leaves out what nothing calls.
layout(local_size_x = 1) in;
void main() {
    float a = float(gl_GlobalInvocationID.x);
    vec2 b = vec2(a);
    vec3 c = vec3(a);
    vec4 d = vec4(a);
#define CALL_DIVISION(FORM) \
    portable_divide_##FORM(a, a); portable_divide_##FORM(b, b); portable_divide_##FORM(c, c); \
    portable_reciprocal_##FORM(a, a); portable_reciprocal_##FORM(b, b); portable_reciprocal_##FORM(c, c); portable_root_##FORM(a);
    CALL_DIVISION(by_integers)
    CALL_DIVISION(by_fma)
    portable_dot(b, b); portable_dot(c, c); portable_dot(d, d); portable_cross(c, c); portable_length(b); portable_length(c);
    portable_normalize(b); portable_normalize(c); portable_reflect(c, c); portable_inverse_sqrt(a);
#define CALL_EACH(X) \
    portable_min(X, X); portable_max(X, X); portable_clamp(X, X, X); portable_mix(X, X, X); portable_fract(X);
    CALL_EACH(a)
    CALL_EACH(b)
    CALL_EACH(c)
    CALL_EACH(d)
    portable_is_nan(a); portable_is_nan(c); portable_is_inf(a); portable_is_inf(c);
    portable_pack_half(b); portable_unpack_half(floatBitsToUint(a)); portable_unpack_snorm(floatBitsToUint(a));
}
