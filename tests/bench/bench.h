/* bench.h - what the benchmarks share: scenes with known truth, a bandwidth to compare with, CSV.
 *
 * Images come from line integrals that are known without the system matrix: the analytic flame's, or
 * those of a volume integrated in quarter-cell steps.  Pixels are area means (4x4 rays). */
#ifndef BENCH_H
#define BENCH_H
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "base/pool.h"
#include "capture/imgio.h"
#include "recon/flame.h"
#include "recon/frame.h"
#include "recon/metrics.h"
#include "recon/render.h"

#define CHECK(expr)                                                                                \
    do {                                                                                           \
        pvx_err check_e_ = (expr);                                                                 \
        if (check_e_ != PVX_OK) {                                                                  \
            fprintf(stderr, "%s:%d: %s: %s\n", __FILE__, __LINE__, #expr, pvx_strerror(check_e_)); \
            exit(1);                                                                               \
        }                                                                                          \
    } while (0)

struct scene {
    struct rec_rig rig;            /* cameras that are used */
    struct rec_camera unseen;      /* and the one that judges */
    float *image[REC_MAX_CAMERAS]; /* [h][w][3], clean */
    float *unseen_image;
    float *truth; /* [nz][ny][nx][3] on rig.grid */
    double peak;  /* brightest value of all images */
};

static inline uint64_t bench_random(void)
{
    static uint64_t s = 88172645463325252u;
    s ^= s << 13;
    s ^= s >> 7;
    s ^= s << 17;
    return s;
}

static inline double bench_normal(void)
{
    double u = ((double)(bench_random() >> 11) + 0.5) * 0x1p-53;
    double v = (double)(bench_random() >> 11) * 0x1p-53;
    return sqrt(-2 * log(u)) * cos(6.283185307179586 * v);
}

static inline float *bench_floats(size_t n)
{
    float *p = pvx_calloc(n, sizeof *p);
    if (p == NULL)
        CHECK(PVX_ENOMEM);
    return p;
}

/* Ring of n cameras and one more that is kept back. */
static inline void scene_rig(struct scene *s, size_t n, int32_t w, int32_t h, int32_t voxels,
                             enum rec_basis basis)
{
    memset(s, 0, sizeof *s);
    CHECK(rec_rig_ring(n + 1, 2.2, w, h, voxels, &s->rig));
    s->rig.grid.basis = basis;
    s->unseen = s->rig.cameras[n / 2];
    memmove(&s->rig.cameras[n / 2], &s->rig.cameras[n / 2 + 1],
            (n - n / 2) * sizeof *s->rig.cameras);
    s->rig.n_cameras = n;
}

static inline void scene_peak(struct scene *s)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        size_t n = (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height * 3;
        for (size_t i = 0; i < n; i++)
            s->peak = fmax(s->peak, s->image[c][i]);
    }
}

struct flame_job {
    const struct rec_flame_pose *pose;
    const struct rec_camera *camera;
    float *image;
};

static inline void flame_band(void *ctx, size_t band)
{
    const struct flame_job *j = ctx;
    int32_t y0 = (int32_t)band * REC_FLAME_BAND, y1 = y0 + REC_FLAME_BAND;
    rec_flame_render(j->pose, j->camera, 4, y0, y1 < j->camera->height ? y1 : j->camera->height,
                     j->image);
}

static inline float *flame_image(const struct rec_flame_pose *pose, const struct rec_camera *c,
                                 pvx_pool *pool)
{
    float *img = bench_floats((size_t)c->width * (size_t)c->height * 3);
    struct flame_job j = {pose, c, img};
    pvx_pool_run(pool, ((size_t)c->height + REC_FLAME_BAND - 1) / REC_FLAME_BAND, flame_band, &j);
    return img;
}

static inline void scene_flame(struct scene *s, size_t n, int32_t w, int32_t h, int32_t voxels,
                               enum rec_basis basis, double t, pvx_pool *pool)
{
    scene_rig(s, n, w, h, voxels, basis);
    struct rec_flame f;
    struct rec_flame_pose pose;
    rec_flame_init(&f, &s->rig.grid, 1);
    rec_flame_at(&f, t, &pose);
    for (size_t c = 0; c < n; c++)
        s->image[c] = flame_image(&pose, &s->rig.cameras[c], pool);
    s->unseen_image = flame_image(&pose, &s->unseen, pool);
    s->truth = bench_floats(rec_grid_count(&s->rig.grid) * 3);
    rec_flame_voxels(&pose, &s->rig.grid, 0, s->rig.grid.n[2], s->truth);
    scene_peak(s);
}

static inline void scene_fini(struct scene *s)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        free(s->image[c]);
    free(s->unseen_image);
    free(s->truth);
    rec_rig_fini(&s->rig);
}

/* Write noisy pixels (sigma as a share of the peak) into a frame slot; binning must be 1. */
static inline void scene_fill(const struct scene *s, rec_frame *f, double noise)
{
    rec_frame_reset(f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        size_t n = (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height;
        float *in = rec_frame_input(f, c);
        for (size_t i = 0; i < n; i++)
            for (int ch = 0; ch < 3; ch++)
                in[i * 4 + (size_t)ch] =
                    s->image[c][i * 3 + (size_t)ch] +
                    (noise > 0 ? (float)(noise * s->peak * bench_normal()) : 0);
        rec_frame_present(f, c, true);
    }
}

struct quality {
    double volume, view, psnr, ssim;
};

/* Volume error, and the unseen view against the real one. */
static inline struct quality judge(const struct scene *s, const float *dense, pvx_pool *pool)
{
    const struct rec_camera *c = &s->unseen;
    size_t n = (size_t)c->width * (size_t)c->height * 3;
    float *img = bench_floats(n);
    CHECK(rec_render(&s->rig.grid, dense, 3, c, 2, pool, img));
    struct quality q = {
        .volume = rec_rel_l2(dense, s->truth, rec_grid_count(&s->rig.grid) * 3),
        .view = rec_mean_abs_255(img, s->unseen_image, n),
        .psnr = rec_psnr(img, s->unseen_image, n, s->peak),
    };
    for (int ch = 0; ch < 3; ch++)
        q.ssim += rec_ssim(img + ch, s->unseen_image + ch, c->width, c->height, 3, s->peak) / 3;
    free(img);
    return q;
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
    t.a = bench_floats(t.n);
    t.b = bench_floats(t.n);
    t.c = bench_floats(t.n);
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
