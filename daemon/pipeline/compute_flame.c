#include "daemon/pipeline/compute_flame.h"

#include <string.h>

#include "base/cpu.h"
#include "base/mem.h"
#include "base/random.h"
#include "recon/frame/inside.h"
#include "recon/view/flame.h"

#define FLAME_SEED  1
#define FLAME_NOISE 0.01f /* largest, of full scale */

struct dmn_compute_flame {
    const rec_sysmat *S;
    int cs;
    float *pixels; /* [room][cs] */
};

/* The voxels with light: their numbers into col, their emission into x [n][cs].  dense: [voxels][3]. */
static int32_t flame_columns(const float *dense, size_t voxels, int cs, int32_t *col, float *x)
{
    int32_t n = 0;
    for (size_t v = 0; v < voxels; v++) {
        const float *e = dense + 3 * v;
        if (!(e[0] + e[1] + e[2] > 0))
            continue;
        float *to = x + (size_t)n * (size_t)cs;
        if (cs == 1)
            to[0] = (e[0] + e[1] + e[2]) / 3;
        else
            memcpy(to, e, 3 * sizeof *e);
        col[n++] = (int32_t)v;
    }
    return n;
}

/* b = S x, then the camera's black and noise. */
static pvx_err flame_project(dmn_compute_flame *f, pvx_pool *pool, const int32_t *col, int32_t n,
                             const float *x)
{
    struct rec_kernels kernels;
    struct rec_subsys *a = NULL;
    struct rec_restrictor *r = NULL;
    bool all[REC_MAX_CAMERAS];
    memset(all, 1, sizeof all);
    rec_kernels_init(&kernels, pvx_cpu());
    pvx_err e = rec_subsys_new(f->S, &kernels, pool, f->cs, &a);
    PVX_THEN(e, rec_restrictor_new(f->S, &r));
    if (e == PVX_OK) {
        rec_subsys_restrict(a, r, col, n, all);
        rec_forward_alone(a, x, f->pixels);
    }
    rec_restrictor_free(&r);
    rec_subsys_free(&a);
    return e;
}

static void flame_noise(dmn_compute_flame *f, float black)
{
    uint64_t state = FLAME_SEED;
    size_t n = f->S->row0[f->S->n_cameras] * (size_t)f->cs;
    for (size_t i = 0; i < n; i++)
        f->pixels[i] += black + FLAME_NOISE * (float)(2 * pvx_uniform(&state) - 1);
}

static pvx_err flame_make(dmn_compute_flame *f, const struct rec_frame_params *p, pvx_pool *pool)
{
    const struct rec_grid *g = &f->S->grid;
    const size_t voxels = rec_grid_count(g);
    float *dense = pvx_calloc(3 * voxels, sizeof *dense);
    float *x = pvx_calloc(voxels * (size_t)f->cs, sizeof *x);
    int32_t *col = pvx_calloc(voxels, sizeof *col);
    f->pixels = pvx_calloc(f->S->win.room * (size_t)f->cs, sizeof *f->pixels);
    pvx_err e =
        dense != NULL && x != NULL && col != NULL && f->pixels != NULL ? PVX_OK : PVX_ENOMEM;
    if (e == PVX_OK) {
        struct rec_flame flame;
        struct rec_flame_pose pose;
        rec_flame_init(&flame, g, FLAME_SEED);
        rec_flame_at(&flame, 0, &pose);
        rec_flame_voxels(&pose, g, 0, g->n[2], dense);
        e = flame_project(f, pool, col, flame_columns(dense, voxels, f->cs, col, x), x);
        flame_noise(f, p->photo.black);
    }
    free(dense);
    free(x);
    free(col);
    return e;
}

pvx_err dmn_compute_flame_new(const rec_sysmat *S, const struct rec_frame_params *p, pvx_pool *pool,
                              dmn_compute_flame **out)
{
    dmn_compute_flame *f = *out = pvx_calloc(1, sizeof *f);
    PVX_NEED(f);
    f->S = S;
    f->cs = p->nch == 1 ? 1 : 4;
    pvx_err e = flame_make(f, p, pool);
    if (e != PVX_OK)
        dmn_compute_flame_free(out);
    return e;
}

void dmn_compute_flame_free(dmn_compute_flame **f)
{
    if (*f == NULL)
        return;
    free((*f)->pixels);
    PVX_FREE(*f);
}

void dmn_compute_flame_load(const dmn_compute_flame *f, rec_frame *to)
{
    for (size_t c = 0; c < f->S->n_cameras; c++) {
        size_t at = f->S->row0[c] * (size_t)f->cs, end = f->S->row0[c + 1] * (size_t)f->cs;
        memcpy(rec_frame_input(to, c), f->pixels + at, (end - at) * sizeof *f->pixels);
        rec_frame_camera(to, c)->present = true;
    }
}
