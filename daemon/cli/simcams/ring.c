#include "daemon/cli/simcams/ring.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/mem.h"
#include "base/pool.h"
#include "base/random.h"
#include "capture/files/imgio.h"

#define NOISE_N 65536u   /* samples in the table of normal deviates; a power of two */
#define SCENE_1 16384.0f /* full scale in a scene */

struct job {
    const struct simcams_ring_params *p;
    struct rec_flame_pose pose;
    size_t i; /* image being rendered */
    size_t bands;
    float **scratch; /* per camera, [h][w][3] */
    struct simcams_ring *out;
    pvx_err failed[REC_MAX_CAMERAS];
};

static float *noise_table(uint32_t seed)
{
    float *t = pvx_calloc(NOISE_N, sizeof *t);
    for (uint64_t k = 0; t != NULL && k < NOISE_N; k += 2) { /* Box and Muller */
        uint64_t a = pvx_mix(((uint64_t)seed << 32) + 2 * k + 1);
        uint64_t b = pvx_mix(((uint64_t)seed << 32) + 2 * k + 2);
        double r = sqrt(-2 * log(((double)(a >> 11) + 0.5) * 0x1p-53));
        double w = 6.283185307179586 * (double)(b >> 11) * 0x1p-53;
        t[k] = (float)(r * cos(w));
        t[k + 1] = (float)(r * sin(w));
    }
    return t;
}

/* ---- images of scenes ------------------------------------------------------------------------- */

/* (1).  The input has no NaN. */
static void quantise(const float *restrict v, const float *restrict noise,
                     const float *restrict sigma, size_t n, unsigned char *restrict out)
{
    for (size_t k = 0; k < n; k++) {
        float x = (v[k] + sigma[k] * noise[k]) * 255.0f + 0.5f;
        x = x > 0 ? x : 0;
        out[k] = (unsigned char)(int)(x < 255 ? x : 255);
    }
}

/* Copy the samples of a row that the format contains into picks [n]. */
static size_t pick(const struct simcams_ring *r, const float *row, int32_t w, int32_t y,
                   float *picks)
{
    bool colours = r->fmt == CAP_RGB8;
    int32_t n = colours ? 3 * w : w;
    for (int32_t k = 0; k < n; k++)
        if (r->nch == 1)
            picks[k] = row[colours ? k / 3 : k];
        else
            picks[k] = row[colours ? k : 3 * k + (k & 1) + (y & 1)]; /* R G / G B */
    return (size_t)n;
}

/* Set the noise of each sample of an even and of an odd row. */
static pvx_err noise_of_rows(struct simcams_ring *r, const double noise[3])
{
    int32_t w = 0;
    for (size_t c = 0; c < r->n_cameras; c++)
        w = r->rig->cameras[c].width > w ? r->rig->cameras[c].width : w;
    for (int32_t y = 0; y < 2; y++) {
        if ((r->sigma[y] = pvx_calloc((size_t)w, 3 * sizeof **r->sigma)) == NULL)
            return PVX_ENOMEM;
        for (int32_t k = 0; k < 3 * w; k++)
            r->sigma[y][k] =
                (float)(r->fmt == CAP_RGB8        ? noise[k % 3]
                        : r->fmt == CAP_BAYER_RG8 ? noise[(k & 1) + y]
                                                  : (noise[0] + noise[1] + noise[2]) / 3);
    }
    return PVX_OK;
}

static void quantise_row(const struct simcams_ring *r, const float *v, const float *sigma, size_t n,
                         uint64_t key, unsigned char *out)
{
    size_t at = (uint32_t)pvx_mix(key) % NOISE_N;
    while (n > 0) { /* the table is a circle */
        size_t some = NOISE_N - at < n ? NOISE_N - at : n;
        quantise(v, r->noise + at, sigma, some, out);
        v += some;
        sigma += some;
        out += some;
        n -= some;
        at = 0;
    }
}

static uint16_t *scene_of(const struct simcams_ring *r, size_t c, size_t i)
{
    return r->scene[r->keep ? c * r->n + i : c];
}

static void ring_make(struct simcams_ring *r, size_t c, size_t i, const struct cap_optics *o)
{
    const struct rec_camera *cam = &r->rig->cameras[c];
    const uint16_t *scene = scene_of(r, c, i);
    size_t row = (size_t)cam->width * (size_t)r->nch, n = (size_t)cam->height * row;
    size_t bytes = cap_pixfmt_row(r->fmt, cam->width);
    struct cap_optics_shape s = {.width = cam->width,
                                 .height = cam->height,
                                 .nch = r->nch,
                                 .seed = (uint64_t)r->seed * 64 + c};
    float *v = r->work[c], *picks = v + n;
    unsigned char *image = r->image[c * r->n + i];
    for (size_t k = 0; k < n; k++)
        v[k] = (float)scene[k] * (1 / SCENE_1);
    cap_optics_apply(o, &s, v, picks);
    for (int32_t y = 0; y < cam->height; y++) {
        uint64_t key = ((s.seed * 65536 + i) * 65536) + (uint64_t)y;
        size_t samples = pick(r, v + (size_t)y * row, cam->width, y, picks);
        quantise_row(r, picks, r->sigma[y & 1], samples, key + 1, image + (size_t)y * bytes);
    }
    memcpy(&r->made[c * r->n + i], o, sizeof *o);
}

bool simcams_ring_renew(struct simcams_ring *r, size_t c, size_t k, const struct cap_optics *o)
{
    if (memcmp(&r->made[c * r->n + k], o, sizeof *o) == 0)
        return false;
    ring_make(r, c, k, o);
    return true;
}

/* ---- scenes ----------------------------------------------------------------------------------- */

static uint16_t to_scene(float l)
{
    l = l * SCENE_1 + 0.5f;
    return l < 65535 ? (uint16_t)l : 65535;
}

static void keep_rows(const struct simcams_ring *r, const float *rgb, size_t n, uint16_t *out)
{
    for (size_t k = 0; k < n; k++, rgb += 3)
        if (r->nch == 1)
            *out++ = to_scene((rgb[0] + rgb[1] + rgb[2]) / 3);
        else
            for (int ch = 0; ch < 3; ch++)
                *out++ = to_scene(rgb[ch]);
}

/* One band of rows of one camera. */
static void ring_render(void *ctx, size_t t)
{
    struct job *j = ctx;
    struct simcams_ring *r = j->out;
    size_t c = t / j->bands, band = t % j->bands;
    const struct rec_camera *cam = &r->rig->cameras[c];
    int32_t y0 = (int32_t)band * REC_FLAME_BAND;
    if (y0 >= cam->height) /* cameras may differ in size */
        return;
    int32_t y1 = y0 + REC_FLAME_BAND < cam->height ? y0 + REC_FLAME_BAND : cam->height;
    if (j->p->board == NULL)
        rec_flame_render(&j->pose, cam, j->p->sub, y0, y1, j->scratch[c]);
    else if (j->i % SIMCAMS_OF_POSE == 0 || j->i % SIMCAMS_OF_POSE >= SIMCAMS_STILLS)
        j->failed[c] = simcams_board_draw(j->p->board, j->i, cam, j->scratch[c]);
    if (j->p->board != NULL) /* the band is the whole picture */
        y1 = cam->height;
    size_t first = (size_t)y0 * (size_t)cam->width;
    keep_rows(r, j->scratch[c] + 3 * first, (size_t)(y1 - y0) * (size_t)cam->width,
              scene_of(r, c, j->i) + first * (size_t)r->nch);
}

static void ring_expose(void *ctx, size_t c)
{
    const struct job *j = ctx;
    ring_make(j->out, c, j->i,
              j->p->state != NULL ? &j->p->state[c].fault.optics : &cap_optics_none);
}

static pvx_err allocate_camera(struct job *j, size_t c)
{
    struct simcams_ring *r = j->out;
    const struct rec_camera *cam = &r->rig->cameras[c];
    size_t pixels = (size_t)cam->width * (size_t)cam->height, nch = (size_t)r->nch;
    size_t bands =
        j->p->board != NULL ? 1 : ((size_t)cam->height + REC_FLAME_BAND - 1) / REC_FLAME_BAND;
    if (bands > j->bands)
        j->bands = bands;
    j->scratch[c] = pvx_calloc(pixels, 3 * sizeof(float));
    r->work[c] = pvx_calloc(pixels * (nch + 3), sizeof(float)); /* picks of one row may be 3 w */
    if (j->scratch[c] == NULL || r->work[c] == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < (r->keep ? r->n : 1); i++)
        if ((r->scene[c * (r->keep ? r->n : 1) + i] = pvx_calloc(pixels * nch, sizeof(uint16_t))) ==
            NULL)
            return PVX_ENOMEM;
    for (size_t i = 0; i < r->n; i++)
        if ((r->image[c * r->n + i] = pvx_calloc(pixels, cap_pixfmt_row(r->fmt, 1))) == NULL)
            return PVX_ENOMEM;
    return PVX_OK;
}

static pvx_err ring_allocate(struct job *j)
{
    struct simcams_ring *r = j->out;
    size_t all = r->n_cameras * r->n;
    r->image = pvx_calloc(all, sizeof *r->image);
    r->scene = pvx_calloc(r->keep ? all : r->n_cameras, sizeof *r->scene);
    r->made = pvx_calloc(all, sizeof *r->made);
    r->work = pvx_calloc(r->n_cameras, sizeof *r->work);
    j->scratch = pvx_calloc(r->n_cameras, sizeof *j->scratch);
    r->noise = noise_table(r->seed);
    if (r->image == NULL || r->scene == NULL || r->made == NULL || r->work == NULL ||
        j->scratch == NULL || r->noise == NULL)
        return PVX_ENOMEM;
    for (size_t c = 0; c < r->n_cameras; c++)
        PVX_TRY(allocate_camera(j, c));
    return noise_of_rows(r, j->p->noise);
}

void simcams_flame(const struct rec_rig *rig, size_t n, double fps, uint32_t seed,
                   struct rec_flame *out)
{
    rec_flame_init(out, &rig->grid, seed);
    out->period_s = (double)n / fps;
}

static int scene_channels(const struct simcams_ring_params *p)
{
    return p->fmt == CAP_GREY8 || p->board != NULL ? 1 : 3; /* a board is grey */
}

size_t simcams_ring_bytes(const struct rec_rig *rig, const struct simcams_ring_params *p)
{
    size_t pixels = 0, each = cap_pixfmt_row(p->fmt, 1);
    for (size_t c = 0; c < rig->n_cameras; c++)
        pixels += (size_t)rig->cameras[c].width * (size_t)rig->cameras[c].height;
    if (p->keep)
        each += (size_t)scene_channels(p) * sizeof(uint16_t);
    return pixels * each * p->n;
}

/* Each blob as bright as its brightest channel, in this colour. */
static void ring_colour(struct rec_flame_pose *pose, const double colour[3])
{
    if (!(colour[0] + colour[1] + colour[2] > 0))
        return;
    for (int g = 0; g < pose->n; g++) {
        double *a = pose->blob[g].a, most = fmax(a[0], fmax(a[1], a[2]));
        for (int q = 0; q < 3; q++)
            a[q] = most * colour[q];
    }
}

/* All images, one instant after the other. */
static pvx_err render_all(struct job *j, bool (*progress)(void *ctx, double done), void *ctx)
{
    const struct simcams_ring_params *p = j->p;
    size_t cameras = j->out->n_cameras;
    struct rec_flame flame;
    pvx_pool *pool = NULL;
    simcams_flame(j->out->rig, p->n, p->fps, p->seed, &flame);
    pvx_err e = pvx_pool_new(0, "ring", &pool);
    for (size_t i = 0; e == PVX_OK && i < p->n; i++) {
        rec_flame_at(&flame, (double)i / p->fps, &j->pose);
        ring_colour(&j->pose, p->colour);
        j->i = i;
        pvx_pool_run(pool, cameras * j->bands, ring_render, j);
        for (size_t c = 0; e == PVX_OK && c < cameras; c++)
            e = j->failed[c];
        if (e != PVX_OK)
            break;
        pvx_pool_run(pool, cameras, ring_expose, j);
        if (progress != NULL && !progress(ctx, (double)(i + 1) / (double)p->n))
            e = PVX_ECANCELED;
    }
    pvx_pool_free(&pool);
    return e;
}

static void free_each(void *array, size_t n)
{
    void **a = array;
    for (size_t k = 0; a != NULL && k < n; k++)
        free(a[k]);
    free(a);
}

static void drop_scenes(struct simcams_ring *r)
{
    free_each(r->scene, r->keep ? r->n_cameras * r->n : r->n_cameras);
    free_each(r->work, r->n_cameras);
    r->scene = NULL;
    r->work = NULL;
    PVX_FREE(r->noise);
    PVX_FREE(r->sigma[0]);
    PVX_FREE(r->sigma[1]);
    PVX_FREE(r->made);
}

pvx_err simcams_ring_init(const struct rec_rig *rig, const struct simcams_ring_params *p,
                          bool (*progress)(void *ctx, double done), void *ctx,
                          struct simcams_ring *out)
{
    *out = (struct simcams_ring){.n_cameras = rig->n_cameras,
                                 .n = p->n,
                                 .rig = rig,
                                 .fmt = p->fmt,
                                 .seed = p->seed,
                                 .nch = scene_channels(p),
                                 .keep = p->keep};
    for (size_t c = 0; p->state != NULL && c < rig->n_cameras; c++)
        out->late[c] = (size_t)p->state[c].fault.late;
    struct job *j = pvx_calloc(1, sizeof *j);
    PVX_NEED(j);
    j->p = p;
    j->out = out;
    pvx_err e = ring_allocate(j);
    PVX_THEN(e, render_all(j, progress, ctx));
    free_each(j->scratch, rig->n_cameras);
    free(j);
    if (e != PVX_OK)
        simcams_ring_fini(out);
    else if (!p->keep)
        drop_scenes(out);
    return e;
}

pvx_err simcams_ring_save(const struct simcams_ring *r, size_t i, size_t step, const char *dir,
                          struct pvx_diag *d)
{
    int nch = cap_pixfmt_channels(r->fmt);
    if (r->fmt != CAP_GREY8 && r->fmt != CAP_RGB8)
        return pvx_fail(d, PVX_EUNSUP, "%s: %s is not written; take mono8 or rgb8", dir,
                        cap_pixfmt_name(r->fmt));
    for (size_t c = 0; c < r->n_cameras; c++) {
        const struct rec_camera *cam = &r->rig->cameras[c];
        size_t sets = r->n / step, shown = (i + sets - r->late[c] % sets) % sets;
        const unsigned char *px = r->image[c * r->n + shown * step];
        char path[4400];
        snprintf(path, sizeof path, "%.4000s/%s", dir, cam->name);
        PVX_TRY(pvx_mkdirs(path, d));
        snprintf(path, sizeof path, "%.4000s/%s/%06zu.png", dir, cam->name, i);
        PVX_TRY(cap_image_write(path, px, cam->width, cam->height, nch, 8, d));
    }
    return PVX_OK;
}

void simcams_ring_fini(struct simcams_ring *r)
{
    free_each(r->image, r->n_cameras * r->n);
    drop_scenes(r);
    memset(r, 0, sizeof *r);
}
