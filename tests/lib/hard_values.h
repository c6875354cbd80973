/* hard_values.h - what a kernel is tried on: any values, denormal ones, a huge range of them. */
#ifndef TESTS_HARD_VALUES_H
#define TESTS_HARD_VALUES_H
#include <math.h>

#include "tests/t.h"

enum data { RANDOM, DENORMAL, HUGE_RANGE, N_DATA };
static inline float value(enum data d)
{
    double v = t_uniform(-1, 1);
    if (d == DENORMAL)
        v *= 0x1p-140;
    if (d == HUGE_RANGE)
        v *= exp2(t_uniform(-40, 40));
    return (float)v;
}

#endif
