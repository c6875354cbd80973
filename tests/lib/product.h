/* product.h - y = A x;  x = A^T y.  Vectors over rows have room for all bins, S->win.room. */
#ifndef PRODUCT_H
#define PRODUCT_H
#include <stdio.h>
#include <stdlib.h>

#include "base/pool.h"
#include "recon/matrix/subsys.h"

/* In all blocks of A; the rest of y stays. */
static inline void product_ax(const struct rec_subsys *a, const float *x, float *y)
{
    struct rec_images images;
    if (rec_images_new(a->S, a->cs, &images) != PVX_OK) {
        fprintf(stderr, "no memory for images\n");
        exit(2);
    }
    rec_forward(a, &images, x, y);
    rec_images_free(&images);
}

struct product_aty {
    const struct rec_subsys *a;
    const float *y;
    float *x;
};

static inline void product_aty_chunk(void *ctx, size_t k)
{
    struct product_aty *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->a->n, k, &q0, &q1);
    rec_adjoint_range(t->a, t->y, q0, q1, t->x);
}

static inline void product_aty(const struct rec_subsys *a, const float *y, float *x)
{
    struct product_aty t = {.a = a, .y = y, .x = x};
    pvx_pool_run(a->pool, rec_chunks(a->n), product_aty_chunk, &t);
}
#endif
