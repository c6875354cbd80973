#include "daemon/pipeline/compute_check.h"

#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "base/pool.h"
#include "base/random.h"
#include "daemon/pipeline/images.h"
#include "recon/view/flame.h"

#define CAMERAS 5
#define WIDTH   64
#define HEIGHT  48
#define VOXELS  32 /* along an edge: there are coarser grids too */
#define SEED    1

struct check {
    struct rec_rig rig;
    pvx_pool *pool;
    rec_sysmat *S;
    uint8_t *bytes; /* [CAMERAS][HEIGHT][WIDTH][3] */
    size_t voxels;
    float *dense[2]; /* [voxels][3]: here, there */
};

/* Raw pictures of a flame with some noise. */
static pvx_err check_shoot(struct check *k, int nch)
{
    struct rec_flame flame;
    struct rec_flame_pose pose;
    uint64_t noise = SEED;
    const size_t samples = (size_t)WIDTH * HEIGHT * 3, per = (size_t)nch;
    float *light = pvx_calloc(samples, sizeof *light);
    PVX_NEED(light);
    rec_flame_init(&flame, &k->rig.grid, SEED);
    rec_flame_at(&flame, 0.3, &pose);
    for (size_t c = 0; c < CAMERAS; c++) {
        rec_flame_render(&pose, &k->rig.cameras[c], 2, 0, HEIGHT, light);
        for (size_t i = 0; i < samples / 3 * per; i++) {
            double v = (double)light[i / per * 3 + i % per] + 0.02 * (pvx_uniform(&noise) - 0.5);
            k->bytes[c * samples + i] = (uint8_t)fmin(fmax(255 * v + 0.5, 0), 255);
        }
    }
    free(light);
    return PVX_OK;
}

static void check_load(const struct check *k, int nch, dmn_images *images, rec_frame *f)
{
    const size_t row = (size_t)WIDTH * (size_t)nch, samples = (size_t)WIDTH * HEIGHT * 3;
    struct cap_image image[CAMERAS];
    const struct cap_image *set[CAMERAS];
    uint64_t mask;
    rec_frame_reset(f);
    for (size_t c = 0; c < CAMERAS; c++) {
        image[c] = (struct cap_image){.data = k->bytes + c * samples,
                                      .size = row * HEIGHT,
                                      .width = WIDTH,
                                      .height = HEIGHT,
                                      .stride = (ptrdiff_t)row,
                                      .fmt = nch == 3 ? CAP_RGB8 : CAP_GREY8};
        set[c] = &image[c];
    }
    (void)dmn_images_bin_frame(images, set, f, &mask);
}

/* The volume of a set on a card, or here, to dense [voxels][nch]. */
static pvx_err check_solve(const struct check *k, int nch, rec_cl *card, float *dense,
                           struct pvx_diag *d)
{
    const struct dmn_images_params how = {.nch = nch, .binning = 1};
    struct rec_frame_params p = rec_frame_defaults;
    dmn_images *images = NULL;
    rec_frame *f = NULL;
    p.nch = nch;
    p.card = card;
    pvx_err e = rec_frame_alone(k->S, &k->rig, &p, k->pool, &f, d);
    PVX_THEN(e, dmn_images_new(&how, &k->rig, k->pool, &images, d));
    if (e == PVX_OK) {
        check_load(k, nch, images, f);
        rec_frame_carve(f);
        e = rec_frame_solve(f, 0, NULL);
        const struct rec_frame_report *r = rec_frame_get_report(f);
        if (card != NULL && !r->on_card)
            e = pvx_fail(d, PVX_ENODEV, "%s: %s", rec_cl_about(card)->name, r->why_here);
    }
    if (e == PVX_OK) {
        struct rec_sparse v;
        rec_frame_volume(f, &v);
        rec_sparse_to_dense(&v, dense);
    }
    dmn_images_free(&images);
    rec_frame_free(&f);
    return e;
}

/* The volumes' difference as a share of the one here. */
static double check_apart(const struct check *k, int nch)
{
    double off = 0, all = 0;
    for (size_t i = 0; i < k->voxels * (size_t)nch; i++) {
        double here = (double)k->dense[0][i], there = (double)k->dense[1][i];
        off += (there - here) * (there - here);
        all += here * here;
    }
    return sqrt(off / all);
}

static pvx_err check_channels(struct check *k, int nch, rec_cl *card, struct pvx_diag *d)
{
    PVX_TRY(check_shoot(k, nch));
    PVX_TRY(check_solve(k, nch, NULL, k->dense[0], d));
    PVX_TRY(check_solve(k, nch, card, k->dense[1], d));
    double apart = check_apart(k, nch);
    if (apart <= DMN_COMPUTE_APART)
        return PVX_OK;
    return pvx_fail(d, PVX_EUNSUP,
                    "%s (%s): it computes wrongly: the volume of a small flame differs by %.2g of "
                    "the processors', more than %g: update its driver (now %s)",
                    rec_cl_about(card)->name, rec_cl_about(card)->platform, apart,
                    DMN_COMPUTE_APART, rec_cl_about(card)->driver);
}

static pvx_err check_make(struct check *k, struct pvx_diag *d)
{
    const struct rec_sysmat_params m = {.binning = 1, .rays_per_bin = 1};
    PVX_TRY(rec_rig_ring(CAMERAS, 2.2, WIDTH, HEIGHT, VOXELS, &k->rig));
    k->rig.grid.basis = REC_TRILINEAR;
    PVX_TRY(pvx_pool_new(1, "check", &k->pool));
    PVX_TRY(rec_sysmat_build(&k->rig, &m, k->pool, NULL, NULL, &k->S, d));
    k->voxels = rec_grid_count(&k->S->grid);
    k->bytes = pvx_calloc((size_t)CAMERAS * WIDTH * HEIGHT * 3, 1);
    for (int i = 0; i < 2; i++)
        k->dense[i] = pvx_calloc(k->voxels * 3, sizeof *k->dense[i]);
    return k->bytes != NULL && k->dense[0] != NULL && k->dense[1] != NULL ? PVX_OK : PVX_ENOMEM;
}

pvx_err dmn_compute_check(rec_cl *card, struct pvx_diag *d)
{
    struct check k = {.pool = NULL};
    pvx_err e = check_make(&k, d);
    PVX_THEN(e, check_channels(&k, 3, card, d));
    PVX_THEN(e, check_channels(&k, 1, card, d));
    free(k.bytes);
    free(k.dense[0]);
    free(k.dense[1]);
    rec_sysmat_free(&k.S);
    pvx_pool_free(&k.pool);
    rec_rig_fini(&k.rig);
    return e;
}
