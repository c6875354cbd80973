/* bench.h - scenes, how a result is judged, a bandwidth to compare with. */
#ifndef BENCH_H
#define BENCH_H
#include "base.h"
#include "recon/view/metrics.h"
#include "recon/view/render.h"
#include "scenes.h"
#include "tests/lib/likeness.h"
#include "tests/lib/slot.h"

/* Write noisy pixels (sigma as a share of the peak) into a frame slot; binning must be 1. */
static inline void scene_fill(const struct scene *s, rec_frame *f, double noise)
{
    size_t nch = (size_t)s->nch, cs = nch == 3 ? 4 : 1;
    rec_frame_reset(f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        size_t n = (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height;
        float *in = rec_frame_input(f, c);
        for (size_t i = 0; i < n; i++)
            for (size_t ch = 0; ch < nch; ch++)
                in[i * cs + ch] = s->image[c][i * nch + ch] +
                                  (noise > 0 ? (float)(noise * s->peak * bench_normal()) : 0);
        rec_frame_camera(f, c)->present = true;
    }
}

/* Camera c's picture, RGB8 of noise 1 % of the peak; to be freed. */
static inline uint8_t *scene_rgb8(const struct scene *s, size_t c)
{
    size_t n = (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height * 3;
    uint8_t *px = malloc(n);
    for (size_t i = 0; i < n; i++) {
        double v = 255 * (s->image[c][i] + 0.01 * s->peak * bench_normal());
        px[i] = (uint8_t)(v < 0 ? 0 : v > 255 ? 255 : v + 0.5);
    }
    return px;
}

/* Mean |error| of 255 of the unseen view over the pixels that have 1 % of the picture's peak or more in some channel. */
static inline double view_error(const struct scene *s, const float *dense, pvx_pool *pool)
{
    const struct rec_camera *c = &s->unseen;
    size_t nch = (size_t)s->nch, n = (size_t)c->width * (size_t)c->height, lit = 0;
    float *img = must_floats(n * nch), least = 0;
    double sum = 0;
    CHECK(rec_render(&s->rig.grid, dense, s->nch, &(struct rec_eye){.camera = c, .sub = 2}, pool,
                     img));
    for (size_t i = 0; i < n * nch; i++)
        least = fmaxf(least, 0.01F * s->unseen_image[i]);
    for (size_t i = 0; i < n; i++) {
        const float *is = img + i * nch, *should = s->unseen_image + i * nch;
        float brightest = 0;
        for (size_t ch = 0; ch < nch; ch++)
            brightest = fmaxf(brightest, should[ch]);
        if (brightest < least)
            continue;
        sum += image_mean_abs_255(is, should, nch);
        lit++;
    }
    free(img);
    return sum / (double)lit;
}

/* Windows of a restricted system, which a product reads once. */
static inline double bytes_of_windows(const struct rec_subsys *a)
{
    double window = (double)(sizeof *a->win.at + rec_window_size(&a->win)), more = 0;
    for (int32_t s = 0; s < a->slabs; s++)
        more += a->more_end[s] - a->more_at[s];
    return (double)a->n * a->win.slots * window + more * sizeof *a->win.more;
}

struct triad {
    float *a, *b, *c;
    size_t n, chunk;
};

static inline void triad_task(void *ctx, size_t i)
{
    const struct triad *t = ctx;
    size_t end = (i + 1) * t->chunk < t->n ? (i + 1) * t->chunk : t->n;
    for (size_t k = i * t->chunk; k < end; k++)
        t->a[k] = t->b[k] + 3.0f * t->c[k];
}

/* Bytes per second of a = b + 3c over arrays of `bytes` in all, best of five. */
static inline double bench_bandwidth(size_t bytes, pvx_pool *pool)
{
    struct triad t = {.n = bytes / 12 + 1024, .chunk = 16384};
    t.a = must_floats(t.n);
    t.b = must_floats(t.n);
    t.c = must_floats(t.n);
    double best = 0;
    for (int r = 0; r < 6; r++) { /* the first one touches the pages */
        int64_t t0 = pvx_now_mono();
        pvx_pool_run(pool, (t.n + t.chunk - 1) / t.chunk, triad_task, &t);
        double rate = 12.0 * (double)t.n / ((double)(pvx_now_mono() - t0) * 1e-9);
        best = r > 0 ? fmax(best, rate) : 0;
    }
    free(t.a);
    free(t.b);
    free(t.c);
    return best;
}

#endif
