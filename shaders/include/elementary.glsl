// Sines, cosines, arc tangents, exponentials and logarithms from sums, differences, products and quotients alone.
// Drivers' own may be off by 2^-11, each in its way; these are the same numbers everywhere. Errors are in units in the
// last place of the result (ulp), measured by tests/gpu/numerics.rs.
#ifndef ELEMENTARY_GLSL
#define ELEMENTARY_GLSL

const float PI = 3.14159265358979;
const float TWO_PI = 6.28318530717959;
const float INVERSE_PI = 0.318309886183791;
const float INVERSE_TWO_PI = 0.159154943091895;

// The natural logarithm of 2 in two parts; the first has so few bits that its products with exponents are exact.
const float LN2_HIGH = 0.693359375;
const float LN2_LOW = -2.12194440e-4;

// The unit vector at an angle in turns, to 2^-23. From the nearest quarter turn it is an eighth at most, for which a
// few terms suffice; close to 0 the sine is good to 2 ulp. (Minimax polynomials of Moshier's Cephes, sinf and cosf)
vec2 on_circle(float turns) {
    float quarters = 4.0 * turns;
    float quarter = floor(quarters + 0.5);
    float x = (quarters - quarter) * (0.5 * PI);
    float z = x * x;
    float s = ((-1.9515295891e-4 * z + 8.3321608736e-3) * z - 1.6666654611e-1) * z * x + x;
    float c = ((2.443315711809948e-5 * z - 1.388731625493765e-3) * z + 4.166664568298827e-2) * z * z - 0.5 * z + 1.0;
    int turned = int(quarter);
    vec2 p = (turned & 1) != 0 ? vec2(-s, c) : vec2(c, s);
    return (turned & 2) != 0 ? -p : p;
}

// The angle of (x, y) from the x axis in [-pi, pi], to 4 ulp; 0 of the origin. The arc tangent of a number up to 1 is
// a polynomial. (Abramowitz and Stegun 1964, 4.4.49)
float angle_of(float x, float y) {
    float a = abs(x);
    float b = abs(y);
    float larger = max(a, b);
    float t = larger > 0.0 ? min(a, b) / larger : 0.0;
    float z = t * t;
    float p = ((0.0028662257 * z - 0.0161657367) * z + 0.0429096138) * z - 0.0752896400;
    p = (((p * z + 0.1065626393) * z - 0.1420889944) * z + 0.1999355085) * z - 0.3333314528;
    float angle = p * z * t + t;
    angle = b > a ? 0.5 * PI - angle : angle;
    angle = x < 0.0 ? PI - angle : angle;
    return y < 0.0 ? -angle : angle;
}

// e to the power of x, to 2 ulp. Below the smallest normal number it is 0. (Moshier's Cephes, expf)
float exponential(float x) {
    float power = floor(x * 1.44269504088896 + 0.5);
    float r = x - power * LN2_HIGH - power * LN2_LOW;
    float p = ((1.9875691500e-4 * r + 1.3981999507e-3) * r + 8.3334519073e-3) * r + 4.1665795894e-2;
    p = (p * r + 1.6666665459e-1) * r + 5.0000001201e-1;
    float value = p * (r * r) + r + 1.0;
    float scaled = intBitsToFloat(floatBitsToInt(value) + (int(power) << 23));
    return x < -87.0 ? 0.0 : x > 88.0 ? uintBitsToFloat(0x7f800000u) : scaled;
}

// The natural logarithm of a number that is normal and above 0, to 2 ulp. (Moshier's Cephes, logf)
float logarithm(float x) {
    int bits = floatBitsToInt(x);
    // The mantissa is taken from [sqrt(1/2), sqrt(2)), where the logarithm is small on both sides.
    int power = (bits - 0x3f3504f3) >> 23;
    float r = intBitsToFloat(bits - (power << 23)) - 1.0;
    float z = r * r;
    float p = ((7.0376836292e-2 * r - 1.1514610310e-1) * r + 1.1676998740e-1) * r - 1.2420140846e-1;
    p = ((p * r + 1.4249322787e-1) * r - 1.6668057665e-1) * r + 2.0000714765e-1;
    p = (p * r - 2.4999993993e-1) * r + 3.3333331174e-1;
    float e = float(power);
    return r + (p * r * z + e * LN2_LOW - 0.5 * z) + e * LN2_HIGH;
}

#endif
