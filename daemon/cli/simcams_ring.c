#include "daemon/cli/simcams_ring.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/mem.h"
#include "base/pool.h"
#include "capture/files/imgio.h"

#define NOISE_N 65536u /* samples in the table of normal deviates; a power of two */

struct job {
    const struct rec_rig *rig;
    const struct simcams_ring_params *p;
    float *noise; /* [NOISE_N], standard deviation 1 */
    struct rec_flame_pose pose;
    size_t i; /* image being rendered */
    size_t bands;
    float **scratch; /* per camera, [h][w][3] */
    struct simcams_ring *out;
    pvx_err failed[REC_MAX_CAMERAS];
};

static uint64_t mix64(uint64_t z) /* finaliser of splitmix64 */
{
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
    z = (z ^ z >> 27) * 0x94D049BB133111EBu;
    return z ^ z >> 31;
}

static float *noise_table(uint32_t seed)
{
    float *t = pvx_calloc(NOISE_N, sizeof *t);
    for (uint64_t k = 0; t != NULL && k < NOISE_N; k += 2) { /* Box and Muller */
        uint64_t a = mix64(((uint64_t)seed << 32) + 2 * k + 1);
        uint64_t b = mix64(((uint64_t)seed << 32) + 2 * k + 2);
        double r = sqrt(-2 * log(((double)(a >> 11) + 0.5) * 0x1p-53));
        double w = 6.283185307179586 * (double)(b >> 11) * 0x1p-53;
        t[k] = (float)(r * cos(w));
        t[k + 1] = (float)(r * sin(w));
    }
    return t;
}

static unsigned char to_byte(float v)
{
    v = v * 255.0f + 0.5f;
    return v <= 0 ? 0 : v >= 255 ? 255 : (unsigned char)v; /* NaN cannot come out of (1) */
}

static void quantise_row(const struct job *j, const float *row, int32_t w, int32_t y,
                         uint32_t noise_at, unsigned char *out)
{
    float sigma = (float)j->p->noise, black = (float)j->p->black;
    switch (j->p->fmt) {
    case CAP_RGB8:
        for (int32_t k = 0; k < 3 * w; k++)
            out[k] = to_byte(black + row[k] + sigma * j->noise[(noise_at + (uint32_t)k) % NOISE_N]);
        break;
    case CAP_BAYER_RG8:
        for (int32_t x = 0; x < w; x++) {
            int ch = (x & 1) + (y & 1); /* R G / G B */
            out[x] = to_byte(black + row[3 * x + ch] +
                             sigma * j->noise[(noise_at + (uint32_t)x) % NOISE_N]);
        }
        break;
    default:
        for (int32_t x = 0; x < w; x++) {
            float mean = (row[3 * x] + row[3 * x + 1] + row[3 * x + 2]) / 3;
            out[x] = to_byte(black + mean + sigma * j->noise[(noise_at + (uint32_t)x) % NOISE_N]);
        }
    }
}

/* One band of rows of one camera. */
static void task(void *ctx, size_t t)
{
    struct job *j = ctx;
    size_t c = t / j->bands, band = t % j->bands;
    const struct rec_camera *cam = &j->rig->cameras[c];
    int32_t y0 = (int32_t)band * REC_FLAME_BAND;
    if (y0 >= cam->height) /* cameras may differ in size */
        return;
    int32_t y1 = y0 + REC_FLAME_BAND < cam->height ? y0 + REC_FLAME_BAND : cam->height;
    if (j->p->board == NULL)
        rec_flame_render(&j->pose, cam, j->p->sub, y0, y1, j->scratch[c]);
    else if (j->i % SIMCAMS_OF_POSE == 0 || j->i % SIMCAMS_OF_POSE >= SIMCAMS_STILLS)
        j->failed[c] = simcams_board_draw(j->p->board, j->i, cam, j->scratch[c]);
    if (j->p->board != NULL) /* a band is all of it */
        y1 = cam->height;
    size_t px = cap_pixfmt_row(j->p->fmt, 1), w = (size_t)cam->width;
    unsigned char *image = j->out->image[c * j->p->n + j->i];
    for (int32_t y = y0; y < y1; y++) {
        uint64_t key = (((uint64_t)j->p->seed * 64 + c) * 65536 + j->i) * 65536 + (uint64_t)y;
        quantise_row(j, j->scratch[c] + (size_t)y * w * 3, cam->width, y, (uint32_t)mix64(key + 1),
                     image + (size_t)y * w * px);
    }
}

static pvx_err allocate(const struct rec_rig *rig, const struct simcams_ring_params *p,
                        struct job *j)
{
    struct simcams_ring *r = j->out;
    r->n = p->n;
    r->image = pvx_calloc(rig->n_cameras * p->n, sizeof *r->image);
    j->scratch = pvx_calloc(rig->n_cameras, sizeof *j->scratch);
    j->noise = noise_table(p->seed);
    if (r->image == NULL || j->scratch == NULL || j->noise == NULL)
        return PVX_ENOMEM;
    r->n_cameras = rig->n_cameras;
    for (size_t c = 0; c < rig->n_cameras; c++) {
        const struct rec_camera *cam = &rig->cameras[c];
        size_t pixels = (size_t)cam->width * (size_t)cam->height;
        size_t bands =
            p->board != NULL ? 1 : ((size_t)cam->height + REC_FLAME_BAND - 1) / REC_FLAME_BAND;
        if (bands > j->bands)
            j->bands = bands;
        if ((j->scratch[c] = pvx_calloc(pixels, 3 * sizeof(float))) == NULL)
            return PVX_ENOMEM;
        for (size_t i = 0; i < p->n; i++)
            if ((r->image[c * p->n + i] = pvx_calloc(pixels, cap_pixfmt_row(p->fmt, 1))) == NULL)
                return PVX_ENOMEM;
    }
    return PVX_OK;
}

void simcams_flame(const struct rec_rig *rig, size_t n, double fps, uint32_t seed,
                   struct rec_flame *out)
{
    rec_flame_init(out, &rig->grid, seed);
    out->period_s = (double)n / fps;
}

size_t simcams_ring_bytes(const struct rec_rig *rig, const struct simcams_ring_params *p)
{
    size_t pixels = 0;
    for (size_t c = 0; c < rig->n_cameras; c++)
        pixels += (size_t)rig->cameras[c].width * (size_t)rig->cameras[c].height;
    return pixels * cap_pixfmt_row(p->fmt, 1) * p->n;
}

pvx_err simcams_ring_init(const struct rec_rig *rig, const struct simcams_ring_params *p,
                          bool (*progress)(void *ctx, double done), void *ctx,
                          struct simcams_ring *out)
{
    memset(out, 0, sizeof *out);
    struct job *j = pvx_calloc(1, sizeof *j);
    if (j == NULL)
        return PVX_ENOMEM;
    j->rig = rig;
    j->p = p;
    j->out = out;
    pvx_pool *pool = NULL;
    struct rec_flame flame;
    simcams_flame(rig, p->n, p->fps, p->seed, &flame);
    pvx_err e = allocate(rig, p, j);
    if (e == PVX_OK)
        e = pvx_pool_new(0, "ring", &pool);
    for (size_t i = 0; e == PVX_OK && i < p->n; i++) {
        rec_flame_at(&flame, (double)i / p->fps, &j->pose);
        j->i = i;
        pvx_pool_run(pool, rig->n_cameras * j->bands, task, j);
        for (size_t c = 0; e == PVX_OK && c < rig->n_cameras; c++)
            e = j->failed[c];
        if (e != PVX_OK)
            break;
        if (progress != NULL && !progress(ctx, (double)(i + 1) / (double)p->n))
            e = PVX_ECANCELED;
    }
    pvx_pool_free(&pool);
    for (size_t c = 0; j->scratch != NULL && c < rig->n_cameras; c++)
        free(j->scratch[c]);
    free(j->scratch);
    free(j->noise);
    free(j);
    if (e != PVX_OK)
        simcams_ring_fini(out);
    return e;
}

pvx_err simcams_ring_save(const struct simcams_ring *r, const struct rec_rig *rig,
                          enum cap_pixfmt fmt, size_t i, size_t number, const char *dir,
                          struct pvx_diag *d)
{
    int nch = cap_pixfmt_channels(fmt);
    if (fmt != CAP_GREY8 && fmt != CAP_RGB8)
        return pvx_fail(d, PVX_EUNSUP, "%s: %s is not written; take mono8 or rgb8", dir,
                        cap_pixfmt_name(fmt));
    for (size_t c = 0; c < rig->n_cameras; c++) {
        const struct rec_camera *cam = &rig->cameras[c];
        const unsigned char *px = r->image[c * r->n + i];
        char path[4400];
        snprintf(path, sizeof path, "%.4000s/%s", dir, cam->name);
        PVX_TRY(pvx_mkdirs(path, d));
        snprintf(path, sizeof path, "%.4000s/%s/%06zu.png", dir, cam->name, number);
        PVX_TRY(cap_image_write(path, px, cam->width, cam->height, nch, 8, d));
    }
    return PVX_OK;
}

void simcams_ring_fini(struct simcams_ring *r)
{
    for (size_t k = 0; r->image != NULL && k < r->n_cameras * r->n; k++)
        free(r->image[k]);
    free(r->image);
    memset(r, 0, sizeof *r);
}
