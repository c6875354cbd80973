/* must.h - for programs that measure: what goes wrong in the harness itself ends them. */
#ifndef TESTS_MUST_H
#define TESTS_MUST_H
#include <stdio.h>
#include <stdlib.h>

#include "base/err.h"
#include "base/mem.h"

#define CHECK(expr)                                                                                \
    do {                                                                                           \
        pvx_err check_e_ = (expr);                                                                 \
        if (check_e_ != PVX_OK) {                                                                  \
            fprintf(stderr, "%s:%d: %s: %s\n", __FILE__, __LINE__, #expr, pvx_strerror(check_e_)); \
            exit(2);                                                                               \
        }                                                                                          \
    } while (0)

/* n zeros. */
static inline float *must_floats(size_t n)
{
    float *p = pvx_calloc(n, sizeof *p);
    if (p == NULL)
        CHECK(PVX_ENOMEM);
    return p;
}
#endif
