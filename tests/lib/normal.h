/* normal.h - normal deviates that can be repeated. */
#ifndef NORMAL_H
#define NORMAL_H
#include <math.h>

#include "base/random.h"

/* Of mean 0 and variance 1: Box and Muller. */
static inline double normal_deviate(uint64_t *state)
{
    double r = sqrt(-2 * log(1 - pvx_uniform(state)));
    return r * cos(6.283185307179586 * pvx_uniform(state));
}
#endif
