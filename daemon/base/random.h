/* random.h - repeatable random numbers for simulated cameras, tests and benches: xorshift64* (Vigna
 * 2016, "An experimental exploration of Marsaglia's xorshift generators, scrambled").
 * Threads: the state is the caller's.  *state must not be 0 at the start, since it would stay 0. */
#ifndef PVX_RANDOM_H
#define PVX_RANDOM_H
#include <stdint.h>

static inline uint64_t pvx_random(uint64_t *state)
{
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    return *state * 0x2545F4914F6CDD1Du;
}

/* A different number for each z: the finaliser of splitmix64 (Steele, Lea, Flood 2014). */
static inline uint64_t pvx_mix(uint64_t z)
{
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
    z = (z ^ z >> 27) * 0x94D049BB133111EBu;
    return z ^ z >> 31;
}

/* Next number of [0,1), 53 bits of it. */
static inline double pvx_uniform(uint64_t *state)
{
    return (double)(pvx_random(state) >> 11) * 0x1p-53;
}
#endif
