/* random.h - repeatable random numbers for simulated cameras: xorshift64* (Vigna 2016, "An
 * experimental exploration of Marsaglia's xorshift generators, scrambled").
 * Threads: the state is the caller's. */
#ifndef CAP_RANDOM_H
#define CAP_RANDOM_H
#include <stdint.h>

/* Next number of [0,1), 53 bits of it.  *state must not be 0 at the start: it would stay so. */
static inline double cap_uniform(uint64_t *state)
{
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    return (double)(*state * 0x2545F4914F6CDD1Du >> 11) * 0x1p-53;
}
#endif
