/* half.h - IEEE 754 binary16 without branches, since a solver's values lie on both sides of the smallest normal half.
 * The bits are the same on every machine that rounds float32 to nearest.
 *
 * To half: round to nearest, ties to even.  Magnitudes above 65504 become 65504 (the caller flags it), since a reader
 * can use a cut value better than an infinity.  The input is finite.
 * From half: exact; infinities and NaN are kept. */
#ifndef PVP_HALF_H
#define PVP_HALF_H
#include <stdint.h>
#include <string.h>

static inline uint32_t pvp_float_bits(float f)
{
    uint32_t bits;
    memcpy(&bits, &f, sizeof bits);
    return bits;
}

static inline float pvp_bits_float(uint32_t bits)
{
    float f;
    memcpy(&f, &bits, sizeof f);
    return f;
}

/* `bits`: of a finite float. */
static inline uint16_t pvp_half_from_bits(uint32_t bits)
{
    uint32_t sign = bits >> 16 & 0x8000u, mag = bits & 0x7fffffffu;
    mag = mag > 0x477fe000u ? 0x477fe000u : mag; /* 65504 */
    /* Below 2^-14 a half counts units of 2^-24, and so does the last bit of a float from 1/2 on: the sum rounds. */
    uint32_t few = pvp_float_bits(pvp_bits_float(mag) + 0.5F) - 0x3f000000u;
    /* Exponent bias 127 -> 15, 13 bits of mantissa rounded away; a carry runs into the exponent. */
    uint32_t many = (mag - (112u << 23) + 0xfffu + (mag >> 13 & 1)) >> 13;
    uint32_t is_few = 0u - (mag < 0x38800000u);
    return (uint16_t)(sign | (few & is_few) | (many & ~is_few));
}

static inline float pvp_half_to_float(uint32_t h)
{
    uint32_t sign = (h & 0x8000u) << 16, mag = (h & 0x7fffu) << 13;
    /* A subnormal half has the bits of a float from 2^-14 on, minus 2^-14. */
    uint32_t few = pvp_float_bits(pvp_bits_float(mag + (113u << 23)) - 0x1p-14F);
    uint32_t beyond = 0u - (mag >= 31u << 23); /* infinities and NaN */
    uint32_t many = mag + (112u << 23) + (beyond & 112u << 23);
    uint32_t is_few = 0u - (mag < 1u << 23);
    return pvp_bits_float(sign | (few & is_few) | (many & ~is_few));
}
#endif
