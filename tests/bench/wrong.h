/* wrong.h - what a real rig does to a scene: cameras that are not as their calibration says, and pictures that are
 * not the light that fell on them.
 *
 * `wrongs` is the list, with one function for each way to be wrong.  Each draws from a seed of its own, so gains off
 * by 3 % and by 10 % are the same draw, and no case changes another.  The unseen camera stays right.
 * Pixels are those of pictures that were taken in bins of 2x2, as everywhere in bench_judge. */
#ifndef BENCH_WRONG_H
#define BENCH_WRONG_H
#include <turbojpeg.h>

#include "shot.h"

struct wrong {
    const char *name;
    double gains; /* standard deviation of log gain; the mean of all cameras' gains is right */
    double poses; /* pixels, each camera in a direction of its own */
    double blur;  /* sigma in pixels, of the first camera */
    double power; /* of the response, 0: linear */
    double late;  /* m that the flame has risen when the second camera sees it */
    bool clipped; /* black is 0, and there is nothing below it */
    bool bits8;   /* clipped at both ends and rounded */
    int jpeg;     /* quality, of 8 bits with colour in every second column; 0: none */
};

/* A flame rises by about 1 m/s; half a frame at 32 frames/s. */
#define HALF_A_FRAME (1.0 / 64)

static const struct wrong wrongs[] = {
    {.name = "exact"},
    {.name = "gains 3 %", .gains = 0.03},
    {.name = "gains 5 %", .gains = 0.05},
    {.name = "gains 10 %", .gains = 0.1},
    {.name = "gains 20 %", .gains = 0.2},
    {.name = "poses 0.3 px", .poses = 0.3},
    {.name = "poses 0.5 px", .poses = 0.5},
    {.name = "poses 0.7 px", .poses = 0.7},
    {.name = "poses 1 px", .poses = 1},
    {.name = "gains and poses", .gains = 0.1, .poses = 0.5},
    {.name = "one blurred", .blur = 2},
    {.name = "power 0.9", .power = 0.9},
    {.name = "black clipped", .clipped = true},
    {.name = "8 bits", .bits8 = true},
    {.name = "JPEG 90", .jpeg = 90},
    {.name = "one late", .late = HALF_A_FRAME},
    {.name = "gains and poses in 8 bits", .gains = 0.1, .poses = 0.5, .bits8 = true},
};
#define N_WRONGS (sizeof wrongs / sizeof *wrongs)

static inline const struct wrong *wrong_named(const char *name)
{
    for (size_t i = 0; i < N_WRONGS; i++)
        if (strcmp(wrongs[i].name, name) == 0)
            return &wrongs[i];
    fprintf(stderr, "no way to be wrong is called %s\n", name);
    exit(1);
}

/* ---- the scene, before its noise ---------------------------------------------------------------- */

static inline size_t wrong_floats(const struct scene *s, size_t c)
{
    return (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height * (size_t)s->nch;
}

static inline void wrong_gains(struct scene *s, double by)
{
    double k[REC_MAX_CAMERAS], sum = 0;
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        sum += k[c] = exp(by * bench_normal());
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        for (size_t i = 0; i < wrong_floats(s, c); i++)
            s->image[c][i] *= (float)(k[c] * (double)s->rig.n_cameras / sum);
}

/* The pictures are there already: the calibration goes wrong, not the camera. */
static inline void wrong_poses(struct scene *s, double by)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        double angle = 6.2832 * bench_even();
        s->rig.cameras[c].cx += 0.5 * by * cos(angle);
        s->rig.cameras[c].cy += 0.5 * by * sin(angle);
    }
}

/* Along x (step: one bin) or y (a row), a Gaussian that ends at four sigma and at the border. */
static inline void blur_along(float *img, size_t n, size_t step, size_t length, double sigma)
{
    enum { MOST = 16 };
    float *in = must_floats(n);
    double k[MOST + 1];
    int reach = (int)fmin(MOST, ceil(4 * sigma));
    for (int i = 0; i <= reach; i++)
        k[i] = exp(-0.5 * i * i / (sigma * sigma));
    memcpy(in, img, n * sizeof *in);
    for (size_t i = 0; i < n; i++) {
        long at = (long)(i / step % length);
        double sum = 0, weight = 0;
        for (long d = -reach; d <= reach; d++)
            if (at + d >= 0 && at + d < (long)length) {
                sum += k[labs(d)] * (double)in[(long)i + d * (long)step];
                weight += k[labs(d)];
            }
        img[i] = (float)(sum / weight);
    }
    free(in);
}

static inline void wrong_blur(struct scene *s, double sigma)
{
    size_t w = (size_t)s->rig.cameras[0].width, nch = (size_t)s->nch;
    blur_along(s->image[0], wrong_floats(s, 0), nch, w, 0.5 * sigma);
    blur_along(s->image[0], wrong_floats(s, 0), nch * w, (size_t)s->rig.cameras[0].height,
               0.5 * sigma);
}

/* Full scale stays where it is. */
static inline void wrong_power(struct scene *s, double power)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        for (size_t i = 0; i < wrong_floats(s, c); i++)
            s->image[c][i] = powf(s->image[c][i], (float)power);
}

/* A flame that has risen looks as from a camera that is lower by as much. */
static inline void wrong_late(struct scene *s, double by, pvx_pool *pool)
{
    struct rec_camera low = s->rig.cameras[1];
    for (int a = 0; a < 3; a++)
        low.t[a] += low.R[3 * a + 2] * by;
    free(s->image[1]);
    s->image[1] = scene_image(s, &low, pool);
}

static inline void wrong_scene(const struct wrong *w, struct scene *s, uint64_t seed,
                               pvx_pool *pool)
{
    if (w->late > 0)
        wrong_late(s, w->late, pool);
    if (w->blur > 0)
        wrong_blur(s, w->blur);
    bench_seed(1000 + seed);
    if (w->gains > 0)
        wrong_gains(s, w->gains);
    bench_seed(2000 + seed);
    if (w->poses > 0)
        wrong_poses(s, w->poses);
    if (w->power > 0)
        wrong_power(s, w->power);
}

/* ---- its pictures, after it --------------------------------------------------------------------- */

static inline void wrong_clipped(float *px, size_t n)
{
    for (size_t i = 0; i < n; i++)
        px[i] = fmaxf(px[i], 0);
}

static inline void wrong_bits8(float *px, size_t n)
{
    for (size_t i = 0; i < n; i++)
        px[i] = (float)(fmin(255, fmax(0, floor(255 * (double)px[i] + 0.5))) / 255);
}

static inline void wrong_jpeg(float *px, const struct rec_camera *c, int nch, int quality)
{
    size_t cs = nch == 3 ? 4 : 1, n = (size_t)c->width * (size_t)c->height;
    int format = nch == 3 ? TJPF_RGB : TJPF_GRAY;
    uint8_t *bytes = pvx_calloc(n, (size_t)nch), *file = NULL;
    unsigned long size = 0;
    tjhandle in = tjInitCompress(), out = tjInitDecompress();
    for (size_t i = 0; bytes != NULL && i < n * (size_t)nch; i++)
        bytes[i] = (uint8_t)lrintf(255 * px[i / (size_t)nch * cs + i % (size_t)nch]);
    if (bytes == NULL || in == NULL || out == NULL ||
        tjCompress2(in, bytes, c->width, 0, c->height, format, &file, &size,
                    nch == 3 ? TJSAMP_422 : TJSAMP_GRAY, quality, 0) != 0 ||
        tjDecompress2(out, file, size, bytes, c->width, 0, c->height, format, 0) != 0) {
        fprintf(stderr, "JPEG: %s\n", tjGetErrorStr2(NULL));
        exit(1);
    }
    for (size_t i = 0; i < n * (size_t)nch; i++)
        px[i / (size_t)nch * cs + i % (size_t)nch] = (float)bytes[i] / 255;
    tjDestroy(in);
    tjDestroy(out);
    tjFree(file);
    free(bytes);
}

static inline void wrong_shot(const struct wrong *w, const struct scene *s, struct shot *t)
{
    for (size_t c = 0; c < t->n_cameras; c++) {
        if (w->clipped)
            wrong_clipped(t->px[c], t->floats[c]);
        if (w->bits8 || w->jpeg > 0)
            wrong_bits8(t->px[c], t->floats[c]);
        if (w->jpeg > 0)
            wrong_jpeg(t->px[c], &s->rig.cameras[c], s->nch, w->jpeg);
    }
}

#endif
