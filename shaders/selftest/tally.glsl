// Counts of results by how far they are from the right one, which integer arithmetic tells.
#ifndef TALLY_GLSL
#define TALLY_GLSL
#include "check.glsl"

layout(set = 2, binding = 1, std430) buffer Answers {
    uint wrong;       // results that are not the nearest number
    uint beyond_one;  // that are off by more than one unit in the last place
    uint beyond_two;
    uint example;     // the complement of the first case that is wrong; 0 without one
} answers;

// Of one invocation.
struct Tally {
    uint wrong;
    uint beyond_one;
    uint beyond_two;
    uint example;
};

Tally no_tally() { return Tally(0u, 0u, 0u, 0u); }

// Counts a result that is off by `twice` half units, each of size `unit`, if it is not `lost` altogether.
void tally(bool lost, uint twice, uint unit, uint number, inout Tally t) {
    bool wrong = lost || twice > unit;
    t.wrong += uint(wrong);
    t.beyond_one += uint(lost || twice > 3u * unit);
    t.beyond_two += uint(lost || twice > 5u * unit);
    t.example = max(t.example, wrong ? ~number : 0u);
}

void add(Tally t) {
    if (t.wrong > 0u) {
        atomicAdd(answers.wrong, t.wrong);
        atomicAdd(answers.beyond_one, t.beyond_one);
        atomicAdd(answers.beyond_two, t.beyond_two);
        atomicMax(answers.example, t.example);
    }
}

// The significand of a normal number as an integer of 24 bits, and its exponent as it is stored.
uint significand(uint bits) { return (bits & 0x7fffffu) | 0x800000u; }
uint exponent(uint bits) { return (bits >> 23) & 0xffu; }

// A result's significand where its exponent should be `stored`: beyond 24 bits if it is another.
uint significand_at(uint bits, uint stored) { return bits - (stored << 23) + 0x800000u; }

// Counts the quotient of two positive numbers. The remainder of the significands is exact modulo 2^32, which is
// enough: the quotient is first found to be right to 64 units.
void tally_quotient(float a, float b, float quotient, uint number, inout Tally t) {
    uint dividend = significand(floatBitsToUint(a));
    uint divisor = significand(floatBitsToUint(b));
    bool less = dividend < divisor;
    uint stored = exponent(floatBitsToUint(a)) - exponent(floatBitsToUint(b)) + (less ? 126u : 127u);
    uint found = significand_at(floatBitsToUint(quotient), stored);
    uint remainder = (dividend << (less ? 24u : 23u)) - found * divisor;
    bool near = abs(quotient * b - a) <= a * 3.8146973e-6;
    tally(!near, 2u * uint(abs(int(remainder))), divisor, number, t);
}

// Counts the root of a number in [1, 4). The nearest root s of x is told by -s < x - s^2 <= s.
void tally_root(float x, float root, uint number, inout Tally t) {
    uint radicand = significand(floatBitsToUint(x));
    uint shift = x < 2.0 ? 23u : 24u;
    uint found = significand_at(floatBitsToUint(root), 127u);
    int remainder = int((radicand << shift) - found * found);
    bool near = abs(root * root - x) <= x * 3.8146973e-6;
    // One less on the other side, so that both bounds are 2 s in halves.
    uint twice = remainder >= 0 ? 2u * uint(remainder) : 2u * uint(-remainder) + 1u;
    tally(!near, twice, 2u * found, number, t);
}

#endif
