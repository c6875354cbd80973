#include "recon/carve/photo.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "base/mem.h"
#include "recon/carve/photo_limits.h"
#include "recon/carve/photo_pass.h"

const struct rec_photo_params rec_photo_defaults = REC_PHOTO_DEFAULTS;

struct rec_photo_work *rec_photo_work_new(int32_t bw, int32_t bh)
{
    size_t n = ((size_t)bw * (size_t)bh + PVX_ALIGN - 1) / PVX_ALIGN * PVX_ALIGN;
    size_t bands = rec_band_count(bh) * sizeof(struct rec_photo_band);
    struct rec_photo_work *w = pvx_calloc(1, sizeof *w + bands + 2 * n);
    if (w == NULL)
        return NULL;
    w->band = (struct rec_photo_band *)(w + 1);
    w->raw = (uint8_t *)w->band + bands;
    w->clean = w->raw + n;
    rec_clipped_table(w->inverse);
    return w;
}

/* Cameras whose bands are worked on. */
struct job {
    const struct rec_photo_image *im;
    size_t n;
    const struct rec_photo_passes *pass;
    struct rec_bands bands;
    bool mosaic; /* at least one of them is a mosaic */
};

/* The picture and the band of a task; NULL: nothing to do, the camera is absent. */
static const struct rec_photo_image *task_image(const struct job *j, size_t task, int32_t *band)
{
    const struct rec_photo_image *im = &j->im[rec_bands_find(&j->bands, task, band)];
    return im->absent ? NULL : im;
}

/* Weights per channel: a mosaic's bin measures its colour. */
static void spread_weights(const struct rec_photo_image *im, int32_t y0, int32_t y1)
{
    const float *w = im->weight + (size_t)y0 * (size_t)im->bw;
    rec_f4 *out = (rec_f4 *)im->weight4 + (size_t)y0 * (size_t)im->bw;
    for (int32_t y = y0; y < y1; y++)
        for (int32_t x = 0; x < im->bw; x++, w++, out++) {
            rec_i4 lanes = {-1, -1, -1, 0};
            if (im->cell != NULL)
                lanes = rec_mosaic_lane(im->cell, x, y);
            *out = rec_select(lanes, rec_splat(*w), (rec_f4){0});
        }
}

static int32_t photo_brightest(const struct rec_photo_image *im, int32_t y0, int32_t y1)
{
    size_t cs = im->nch == 3 ? 4 : 1, row = (size_t)im->bw * cs;
    const float *b = im->img + (size_t)y0 * row;
    int32_t peak = 0;
    for (size_t i = 0, n = (size_t)(y1 - y0) * row; i < n; i++) {
        int32_t bits;
        memcpy(&bits, b + i, sizeof bits);
        peak = bits > peak ? bits : peak;
    }
    return peak;
}

static void linear(void *ctx, size_t task)
{
    const struct job *j = ctx;
    int32_t band, y0, y1;
    const struct rec_photo_image *im = &j->im[rec_bands_find(&j->bands, task, &band)];
    rec_band_rows(band, im->bh, &y0, &y1);
    if (im->absent) {
        size_t from = (size_t)y0 * (size_t)im->bw, n = (size_t)(y1 - y0) * (size_t)im->bw;
        size_t cs = im->nch == 3 ? 4 : 1;
        memset(im->img + from * cs, 0, n * cs * sizeof *im->img);
        memset(im->weight + from, 0, n * sizeof *im->weight);
        memset(im->lit + from, 0, n);
    } else {
        j->pass->linear(im, band);
        im->work->band[band].peak = im->params->dim > 0 ? photo_brightest(im, y0, y1) : 0;
    }
    if (im->weight4 != NULL)
        spread_weights(im, y0, y1);
}

/* The work that needs whole pictures: noise, one task per channel, and the planes of mosaics. */
static void levels(void *ctx, size_t task)
{
    const struct job *j = ctx;
    int32_t band;
    if (task < 3 * j->n) {
        const struct rec_photo_image *im = &j->im[task / 3];
        if (!im->absent && (int)(task % 3) < im->nch) {
            j->pass->noise(im, (int32_t)(task % 3));
            rec_clipped_find(im, (int)(task % 3));
        }
        return;
    }
    const struct rec_photo_image *im = task_image(j, task - 3 * j->n, &band);
    if (im != NULL && im->cell != NULL)
        j->pass->plane(im, band);
}

static void photo_judge(void *ctx, size_t task)
{
    const struct job *j = ctx;
    int32_t band;
    const struct rec_photo_image *im = task_image(j, task, &band);
    if (im != NULL)
        j->pass->judge(im, band);
}

/* Whether the flame is faint: the mean of the lit bins over the noise is below REC_PHOTO_NOISY even in the channel where
 * it is largest.  False if nothing is lit. */
static bool is_noisy(const struct rec_photo_image *im)
{
    const struct rec_photo_work *w = im->work;
    double total[3] = {0}, best = 0;
    uint32_t hits = 0;
    for (size_t b = 0; b < rec_band_count(im->bh); b++) {
        hits += w->band[b].hits;
        for (int c = 0; c < im->nch; c++)
            total[c] += w->band[b].sum[c];
    }
    for (int c = 0; c < im->nch && hits > 0; c++)
        best = fmax(best, total[c] / hits / fmax((double)w->sigma[c], 1e-9));
    return w->means && (float)best > 0 && (float)best < REC_PHOTO_NOISY;
}

static void photo_widen(void *ctx, size_t task)
{
    const struct job *j = ctx;
    int32_t band;
    const struct rec_photo_image *im = task_image(j, task, &band);
    if (im != NULL && im->work->noisy)
        j->pass->widen(im, band);
}

static void photo_finish(void *ctx, size_t task)
{
    const struct job *j = ctx;
    int32_t band;
    const struct rec_photo_image *im = task_image(j, task, &band);
    if (im != NULL)
        j->pass->finish(im, band, im->params->threshold < 0 && im->params->despeckle,
                        im->params->margin > 0 ? im->work->clean : im->lit);
}

/* Square dilation by the margin r: columns as the union of 2r+1 rows, then rows by a running count. */
static void photo_grow(void *ctx, size_t task)
{
    const struct job *j = ctx;
    int32_t band, y0, y1;
    const struct rec_photo_image *im = task_image(j, task, &band);
    if (im == NULL || im->params->margin <= 0)
        return;
    const int32_t bw = im->bw, bh = im->bh, r = im->params->margin;
    uint32_t lit = 0;
    rec_band_rows(band, bh, &y0, &y1);
    for (int32_t y = y0; y < y1; y++) {
        uint8_t *in = im->work->raw + (size_t)y * (size_t)bw, *out = im->lit + (in - im->work->raw);
        int32_t v0 = y > r ? y - r : 0, v1 = r < bh - 1 - y ? y + r : bh - 1, inside = 0;
        memset(in, 0, (size_t)bw); /* its content is not needed any more */
        for (int32_t v = v0; v <= v1; v++)
            for (int32_t x = 0; x < bw; x++)
                in[x] |= im->work->clean[(size_t)v * (size_t)bw + (size_t)x];
        for (int32_t x = 0; x < r && x < bw; x++)
            inside += in[x];
        for (int32_t x = 0; x < bw; x++) {
            if (r < bw - x)
                inside += in[x + r];
            if (x > r)
                inside -= in[x - r - 1];
            out[x] = inside > 0;
            lit += out[x];
        }
    }
    im->work->band[band].lit = lit;
}

static void photo_mend(void *ctx, size_t task)
{
    const struct job *j = ctx;
    int32_t band, y0, y1;
    const struct rec_photo_image *im = task_image(j, task, &band);
    if (im == NULL || !rec_photo_is_clipped(im))
        return;
    rec_band_rows(band, im->bh, &y0, &y1);
    rec_clipped_mend(im, y0, y1);
}

void rec_photo_apply(const struct rec_photo_image *im, size_t n, pvx_pool *pool)
{
    struct rec_photo_passes pass;
    struct job j = {.im = im, .n = n, .pass = &pass};
    bool noisy = false, margin = false, clipped = false;
    rec_photo_passes_init(&pass, pvx_cpu());
    for (size_t c = 0; c < n; c++) {
        rec_bands_add(&j.bands, im[c].bh);
        im[c].work->grain = rec_photo_grain(&im[c]);
        j.mosaic |= im[c].cell != NULL;
        margin |= im[c].params->margin > 0;
    }
    size_t bands = rec_bands_all(&j.bands);
    pvx_pool_run(pool, bands, linear, &j);
    pvx_pool_run(pool, 3 * n + (j.mosaic ? bands : 0), levels, &j);
    for (size_t c = 0; c < n; c++)
        rec_photo_set_limits(&im[c]);
    pvx_pool_run(pool, bands, photo_judge, &j);
    for (size_t c = 0; c < n; c++) {
        im[c].work->noisy = !im[c].absent && is_noisy(&im[c]);
        noisy |= im[c].work->noisy;
        clipped |= rec_photo_is_clipped(&im[c]);
    }
    if (noisy)
        pvx_pool_run(pool, bands, photo_widen, &j);
    pvx_pool_run(pool, bands, photo_finish, &j);
    if (margin)
        pvx_pool_run(pool, bands, photo_grow, &j);
    if (clipped)
        pvx_pool_run(pool, bands, photo_mend, &j);
    for (size_t c = 0; c < n; c++)
        rec_photo_report(&im[c]);
}
