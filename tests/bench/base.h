/* base.h - what every benchmark needs: stop on error, numbers by chance, memory, CSV. */
#ifndef BENCH_BASE_H
#define BENCH_BASE_H
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/err.h"
#include "base/mem.h"
#include "base/pool.h"

#define CHECK(expr)                                                                                \
    do {                                                                                           \
        pvx_err check_e_ = (expr);                                                                 \
        if (check_e_ != PVX_OK) {                                                                  \
            fprintf(stderr, "%s:%d: %s: %s\n", __FILE__, __LINE__, #expr, pvx_strerror(check_e_)); \
            exit(1);                                                                               \
        }                                                                                          \
    } while (0)

/* One generator for the program; a seed makes what follows independent of what came before. */
static inline uint64_t *bench_state(void)
{
    static uint64_t s = 88172645463325252u;
    return &s;
}

static inline void bench_seed(uint64_t seed)
{
    *bench_state() = 88172645463325252u ^ (seed * 0x9E3779B97F4A7C15u);
}

static inline uint64_t bench_random(void)
{
    uint64_t *s = bench_state();
    *s ^= *s << 13;
    *s ^= *s >> 7;
    *s ^= *s << 17;
    return *s;
}

/* Even in (0,1). */
static inline double bench_even(void)
{
    return ((double)(bench_random() >> 11) + 0.5) * 0x1p-53;
}

static inline double bench_normal(void)
{
    double u = bench_even(), v = bench_even();
    return sqrt(-2 * log(u)) * cos(6.283185307179586 * v);
}

static inline float *bench_floats(size_t n)
{
    float *p = pvx_calloc(n, sizeof *p);
    if (p == NULL)
        CHECK(PVX_ENOMEM);
    return p;
}

static inline double ms(int64_t ns)
{
    return (double)ns * 1e-6;
}

/* NAME.csv in the folder of argv[1] (default: the current one). */
static inline FILE *bench_csv(int argc, char **argv, const char *name)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%s.csv", argc > 1 ? argv[1] : ".", name);
    FILE *f = fopen(path, "w");
    if (f == NULL) {
        perror(path);
        exit(1);
    }
    return f;
}

#endif
