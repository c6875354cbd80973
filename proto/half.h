/* half.h - IEEE 754 binary16 in plain integer arithmetic: the same bits on every machine.
 *
 * To half: round to nearest, ties to even; magnitudes above 65504 become 65504 (the caller flags
 * it), as a reader is better served by a cut value than by an infinity.  The input is finite.
 * From half: exact; infinities and NaN stay what they are. */
#ifndef PVP_HALF_H
#define PVP_HALF_H
#include <stdint.h>
#include <string.h>

/* `bits`: of a finite float. */
static inline uint16_t pvp_half_from_bits(uint32_t bits)
{
    uint32_t sign = bits >> 16 & 0x8000u, mag = bits & 0x7fffffffu;
    if (mag >= 0x477fe000u) /* 65504 */
        return (uint16_t)(sign | 0x7bffu);
    if (mag < 0x38800000u) {    /* below 2^-14: a subnormal half, in units of 2^-24 */
        if (mag <= 0x33000000u) /* 2^-25 and less; the tie goes to even, 0 */
            return (uint16_t)sign;
        uint32_t shift = 126 - (mag >> 23); /* 14..24: value = mant * 2^(e-150) = mant >> shift */
        uint32_t mant = (mag & 0x7fffffu) | 0x800000u;
        uint32_t h = mant >> shift, rest = mant & ((1u << shift) - 1), half = 1u << (shift - 1);
        h += rest > half || (rest == half && (h & 1));
        return (uint16_t)(sign | h);
    }
    /* Exponent bias 127 -> 15, 13 bits of mantissa rounded away; a carry runs into the exponent. */
    uint32_t odd = mag >> 13 & 1;
    return (uint16_t)(sign | ((mag - (112u << 23) + 0xfffu + odd) >> 13));
}

static inline float pvp_half_to_float(uint32_t h)
{
    uint32_t sign = (h & 0x8000u) << 16, e = h >> 10 & 31, m = h & 0x3ffu, bits;
    if (e == 0) {
        float f = (float)m * 0x1p-24f; /* exact: m has 10 bits */
        memcpy(&bits, &f, sizeof bits);
    } else {
        bits = (e == 31 ? 255u : e + 112) << 23 | m << 13;
    }
    bits |= sign;
    float f;
    memcpy(&f, &bits, sizeof f);
    return f;
}
#endif
