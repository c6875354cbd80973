/* bars.h - error bars of a frame against the truth: by classes of voxels, in boxes, in a view that no solve saw. */
#ifndef BENCH_BARS_H
#define BENCH_BARS_H
#include "bench.h"
#include "recon/frame/bars.h"
#include "recon/frame/inside.h"

enum { CLASS_ALL, CLASS_RIM, CLASS_CORE, CLASS_THIN, CLASS_FEW, N_CLASSES };

#define BARS_Z   1.96
#define BARS_LIT 0.02
#define BARS_FEW 60 /* voxels that a class needs */

/* A frame's volume, truth and bars on the whole grid. */
struct dense_bars {
    const struct scene *s;
    const rec_frame *f;
    struct rec_bars_view v;
    struct rec_sparse x;
    size_t n, nch;
    int side[3];
    double *truth; /* [n] sum of the channels, from 0 to 1 */
    bool *active;  /* [n] */
};

static inline void dense_bars_new(struct dense_bars *d, const struct scene *s, const rec_frame *f,
                                  const struct rec_bars_view *v)
{
    const struct rec_grid *g = &s->rig.grid;
    double most = 0;
    *d =
        (struct dense_bars){.s = s, .f = f, .v = *v, .n = rec_grid_count(g), .nch = (size_t)s->nch};
    rec_frame_volume(f, &d->x);
    memcpy(d->side, g->n, sizeof d->side);
    d->truth = pvx_calloc(d->n, sizeof *d->truth);
    d->active = pvx_calloc(d->n, sizeof *d->active);
    CHECK(d->truth != NULL && d->active != NULL && v->sd != NULL ? PVX_OK : PVX_ENOMEM);
    for (size_t i = 0; i < d->n; i++) {
        for (size_t l = 0; l < d->nch; l++)
            d->truth[i] += (double)s->truth[i * d->nch + l];
        most = fmax(most, d->truth[i]);
    }
    for (size_t i = 0; i < d->n; i++)
        d->truth[i] /= most > 0 ? most : 1;
    for (int32_t q = 0; q < v->n; q++)
        d->active[v->index[q]] = true;
}

static inline void dense_bars_free(struct dense_bars *d)
{
    free(d->truth);
    free(d->active);
}

/* ---- classes of voxels --------------------------------------------------------------------------*/

/* Sums of the truth over the cubes of 3 and of 5 voxels about voxel i; whether all of the latter are lit. */
struct around {
    double three, five;
    bool lit;
};
static inline struct around bars_around(const struct dense_bars *d, size_t i)
{
    struct around a = {0, 0, true};
    int nx = d->side[0], ny = d->side[1], x = (int)(i % (size_t)nx),
        y = (int)(i / (size_t)nx % (size_t)ny), z = (int)(i / (size_t)nx / (size_t)ny);
    for (int k = -2; k <= 2; k++)
        for (int j = -2; j <= 2; j++)
            for (int h = -2; h <= 2; h++) {
                bool in = x + h >= 0 && y + j >= 0 && z + k >= 0 && x + h < nx && y + j < ny &&
                          z + k < d->side[2];
                double t = in ? d->truth[(size_t)(((z + k) * ny + y + j) * nx + x + h)] : 0;
                a.five += t;
                a.three += abs(h) < 2 && abs(j) < 2 && abs(k) < 2 ? t : 0;
                a.lit = a.lit && t > BARS_LIT;
            }
    return a;
}

/* Bit of each class that active voxel q is in. */
static inline uint32_t bars_class(const struct dense_bars *d, int32_t q, const float *seen)
{
    size_t i = (size_t)d->v.index[q];
    if (d->truth[i] <= BARS_LIT)
        return 0;
    struct around a = bars_around(d, i);
    bool thin = d->truth[i] > 2.5 * (a.five - a.three) / 98;
    bool few = 2 * seen[q] <= (float)d->s->rig.n_cameras;
    return 1 << CLASS_ALL | 1 << (a.lit ? CLASS_CORE : CLASS_RIM) | (uint32_t)thin << CLASS_THIN |
           (uint32_t)few << CLASS_FEW;
}

/* Number of cameras that see each active voxel. */
static inline float *bars_seen(const struct dense_bars *d)
{
    const struct rec_subsys *a = rec_frame_subsys(d->f);
    float *seen = must_floats((size_t)d->v.n), *one = must_floats((size_t)d->v.n);
    for (int32_t c = 0; c < (int32_t)d->s->rig.n_cameras; c++) {
        rec_column_sums_cameras(a, (struct rec_cameras){c, c + 1}, NULL, one);
        for (int32_t q = 0; q < d->v.n; q++)
            seen[q] += one[q] > 0 ? 1 : 0;
    }
    free(one);
    return seen;
}

static inline double bars_error(const struct dense_bars *d, int32_t q, size_t l)
{
    return (double)d->x.value[(size_t)q * (size_t)d->x.cs + l] -
           (double)d->s->truth[(size_t)d->v.index[q] * d->nch + l];
}
static inline double bars_sd(const struct dense_bars *d, int32_t q, size_t l)
{
    return (double)d->v.sd[(size_t)q * (size_t)d->v.cs + l];
}

/* Coverage in percent of each class; NAN: too few voxels.  few: whether that class is asked for. */
static inline void bars_classes(const struct dense_bars *d, bool few, double held[N_CLASSES])
{
    double in[N_CLASSES] = {0}, all[N_CLASSES] = {0};
    float *seen = bars_seen(d);
    for (int32_t q = 0; q < d->v.n; q++) {
        uint32_t of = bars_class(d, q, seen);
        for (size_t l = 0; l < d->nch && of != 0; l++) {
            bool held_ = fabs(bars_error(d, q, l)) <= BARS_Z * bars_sd(d, q, l);
            for (int c = 0; c < N_CLASSES; c++) {
                all[c] += of >> c & 1;
                in[c] += held_ && (of >> c & 1) != 0;
            }
        }
    }
    for (int c = 0; c < N_CLASSES; c++)
        held[c] = all[c] >= (double)(BARS_FEW * d->nch) && (c != CLASS_FEW || few)
                      ? 100 * in[c] / all[c]
                      : NAN;
    free(seen);
}

/* Root mean square of the bars over that of the errors. */
static inline double bars_size(const struct dense_bars *d)
{
    double sd2 = 0, e2 = 0;
    for (int32_t q = 0; q < d->v.n; q++)
        for (size_t l = 0; l < d->nch && d->truth[d->v.index[q]] > BARS_LIT; l++) {
            sd2 += bars_sd(d, q, l) * bars_sd(d, q, l);
            e2 += bars_error(d, q, l) * bars_error(d, q, l);
        }
    return sqrt(sd2 / e2);
}

/* ---- sums over boxes ----------------------------------------------------------------------------*/

/* t^2 of (1) in recon/frame/bars.h. */
static inline double bars_rest(const struct dense_bars *d, int32_t q, size_t l)
{
    size_t cs = (size_t)d->v.cs, at = (size_t)q * cs + l;
    double rest = bars_sd(d, q, l) * bars_sd(d, q, l);
    for (uint32_t k = 0; k < d->v.n_modes; k++) {
        double m = d->v.modes[(size_t)k * (size_t)d->v.n * cs + at];
        rest -= m * m;
    }
    return fmax(rest, 0);
}

struct cuboid {
    int lo[3], hi[3];
};

/* Error of the sum over a box and its variance by (2) of recon/frame/bars.h. */
static inline double bars_box(const struct dense_bars *d, const struct cuboid *b, size_t l,
                              double *var)
{
    double sum = 0, mode[REC_BARS_MOST + 1] = {0};
    size_t cs = (size_t)d->v.cs, vector = (size_t)d->v.n * cs;
    *var = 0;
    for (int z = b->lo[2]; z < b->hi[2]; z++)
        for (int y = b->lo[1]; y < b->hi[1]; y++)
            for (int x = b->lo[0]; x < b->hi[0]; x++)
                sum -=
                    (double)
                        d->s->truth[(size_t)((z * d->side[1] + y) * d->side[0] + x) * d->nch + l];
    for (int32_t q = 0; q < d->v.n; q++) {
        int32_t i = d->v.index[q];
        int x = i % d->side[0], y = i / d->side[0] % d->side[1], z = i / d->side[0] / d->side[1];
        if (x < b->lo[0] || y < b->lo[1] || z < b->lo[2] || x >= b->hi[0] || y >= b->hi[1] ||
            z >= b->hi[2])
            continue;
        sum += (double)d->x.value[(size_t)q * cs + l];
        *var += bars_rest(d, q, l);
        for (uint32_t k = 0; k < d->v.n_modes; k++)
            mode[k] += (double)d->v.modes[k * vector + (size_t)q * cs + l];
    }
    for (uint32_t k = 0; k < d->v.n_modes; k++)
        *var += mode[k] * mode[k];
    return sum;
}

/* A box within the cuboid around what is lit, of at most half of its sides, that holds 0.2 % of the light. */
static inline struct cuboid bars_any_box(const struct dense_bars *d, const struct cuboid *lit,
                                         double light)
{
    for (;;) {
        struct cuboid b;
        double sum = 0;
        for (int a = 0; a < 3; a++) {
            int wide = lit->hi[a] - lit->lo[a], most = wide / 2 > 2 ? wide / 2 : 2;
            b.lo[a] = lit->lo[a] + (int)(bench_even() * wide);
            b.hi[a] = b.lo[a] + 2 + (int)(bench_even() * (most - 1));
            b.hi[a] = b.hi[a] < lit->hi[a] ? b.hi[a] : lit->hi[a];
        }
        for (int z = b.lo[2]; z < b.hi[2]; z++)
            for (int y = b.lo[1]; y < b.hi[1]; y++)
                for (int x = b.lo[0]; x < b.hi[0]; x++)
                    sum += d->truth[(z * d->side[1] + y) * d->side[0] + x];
        if (sum > 0.002 * light)
            return b;
    }
}

/* Coverage in percent of the sums over so many random boxes. */
static inline double bars_boxes(const struct dense_bars *d, int boxes, uint64_t seed)
{
    struct cuboid lit = {{d->side[0], d->side[1], d->side[2]}, {0}};
    double light = 0, in = 0;
    for (size_t i = 0; i < d->n; i++) {
        int at[3] = {(int)i % d->side[0], (int)i / d->side[0] % d->side[1],
                     (int)i / d->side[0] / d->side[1]};
        light += d->truth[i];
        for (int a = 0; a < 3 && d->truth[i] > BARS_LIT; a++) {
            lit.lo[a] = at[a] < lit.lo[a] ? at[a] : lit.lo[a];
            lit.hi[a] = at[a] + 1 > lit.hi[a] ? at[a] + 1 : lit.hi[a];
        }
    }
    bench_seed(seed);
    for (int k = 0; k < boxes; k++) {
        struct cuboid b = bars_any_box(d, &lit, light);
        for (size_t l = 0; l < d->nch; l++) {
            double var, e = bars_box(d, &b, l, &var);
            in += e * e <= BARS_Z * BARS_Z * var;
        }
    }
    return 100 * in / (boxes * (double)d->nch);
}

/* Root mean square, over the channels, of the error of the whole light over its bar. */
static inline double bars_total(const struct dense_bars *d)
{
    struct cuboid all = {{0, 0, 0}, {d->side[0], d->side[1], d->side[2]}};
    double z2 = 0;
    for (size_t l = 0; l < d->nch; l++) {
        double var, e = bars_box(d, &all, l, &var);
        z2 += e * e / var;
    }
    return sqrt(z2 / (double)d->nch);
}

/* ---- a view that no solve saw -------------------------------------------------------------------*/

/* The unseen camera's picture of values [n][cs] on the active voxels, all channels. */
static inline float *bars_picture(const struct dense_bars *d, const float *value, pvx_pool *pool)
{
    const struct rec_camera *c = &d->s->unseen;
    size_t px = (size_t)c->width * (size_t)c->height;
    float *dense = must_floats(d->n * d->nch), *img = must_floats(px * d->nch);
    for (int32_t q = 0; q < d->v.n; q++)
        for (size_t l = 0; l < d->nch; l++)
            dense[(size_t)d->v.index[q] * d->nch + l] = value[(size_t)q * (size_t)d->v.cs + l];
    CHECK(rec_render(&d->s->rig.grid, dense, (int)d->nch, &(struct rec_eye){.camera = c, .sub = 2},
                     pool, img));
    free(dense);
    return img;
}

static inline void bars_add_square(double *var, const float *img, size_t n, double by)
{
    for (size_t i = 0; i < n; i++)
        var[i] += by * (double)img[i] * img[i];
}

/* How a view is judged, and what else it says. */
struct bars_look {
    double sigma; /* noise of the picture */
    bool
        real; /* it is a picture with this noise in it, by a camera of unknown gain and a volume that may be too small */
    double size;    /* out: root mean square of the prediction over that of the errors */
    double outside; /* out, real: share of the light whose rays meet no voxel */
};

/* 1 where a ray passes a voxel's side or more of active voxels, and everywhere in a simulation. */
static inline bool *bars_met(const struct dense_bars *d, bool real, size_t n, pvx_pool *pool)
{
    bool *met = pvx_calloc(n, sizeof *met);
    CHECK(met != NULL ? PVX_OK : PVX_ENOMEM);
    memset(met, 1, n);
    if (!real)
        return met;
    size_t vector = (size_t)d->v.n * (size_t)d->v.cs;
    float *one = must_floats(vector);
    for (size_t i = 0; i < vector; i++)
        one[i] = 1;
    float *path = bars_picture(d, one, pool);
    for (size_t i = 0; i < n; i++)
        met[i] = (double)path[i] > rec_grid_h(&d->s->rig.grid, 0);
    free(path);
    free(one);
    return met;
}

/* Least squares over the pixels that are met. */
static inline double bars_gain(const float *img, const float *should, const bool *met, size_t n)
{
    double both = 0, square = 0;
    for (size_t i = 0; i < n; i++)
        if (met[i]) {
            both += (double)img[i] * (double)should[i];
            square += (double)img[i] * (double)img[i];
        }
    return square > 0 ? both / square : 1;
}

/* Variance of the unseen picture by the bars: modes, and t^2 by four draws of independent voxels. */
static inline double *bars_view_variance(const struct dense_bars *d, size_t n, pvx_pool *pool)
{
    size_t cs = (size_t)d->v.cs, vector = (size_t)d->v.n * cs;
    double *var = pvx_calloc(n, sizeof *var);
    float *rest = must_floats(vector);
    enum { DRAWS = 4 };
    CHECK(var != NULL ? PVX_OK : PVX_ENOMEM);
    for (uint32_t k = 0; k < d->v.n_modes; k++) {
        float *of = bars_picture(d, d->v.modes + k * vector, pool);
        bars_add_square(var, of, n, 1);
        free(of);
    }
    for (int k = 0; k < DRAWS; k++) {
        for (int32_t q = 0; q < d->v.n; q++)
            for (size_t l = 0; l < d->nch; l++)
                rest[(size_t)q * cs + l] =
                    (float)((bench_even() < 0.5 ? -1 : 1) * sqrt(bars_rest(d, q, l)));
        float *of = bars_picture(d, rest, pool);
        bars_add_square(var, of, n, 1.0 / DRAWS);
        free(of);
    }
    free(rest);
    return var;
}

/* Mean over the pixels on which the flame is, of (picture of the volume - picture)^2 over its predicted variance, both
 * with the picture's own noise.  real: over those that are met, after the gain of the view that nobody corrected. */
static inline double bars_view(const struct dense_bars *d, struct bars_look *o, pvx_pool *pool)
{
    const struct rec_camera *c = &d->s->unseen;
    const float *should = d->s->unseen_image;
    size_t n = (size_t)c->width * (size_t)c->height * d->nch;
    double *var = bars_view_variance(d, n, pool), sum = 0, all = 0, peak = 0, e2 = 0, v2 = 0;
    float *img = bars_picture(d, d->x.value, pool);
    bool *met = bars_met(d, o->real, n, pool);
    double gain = o->real ? bars_gain(img, should, met, n) : 1, light = 0, missed = 0;
    for (size_t i = 0; i < n; i++)
        peak = fmax(peak, (double)should[i]);
    for (size_t i = 0; i < n; i++) {
        double noise = o->real ? 0 : o->sigma * bench_normal();
        double e = gain * (double)img[i] - (double)should[i] + noise;
        double v = gain * gain * var[i] + o->sigma * o->sigma;
        light += (double)should[i];
        missed += met[i] ? 0 : (double)should[i];
        if ((double)should[i] <= BARS_LIT * peak || !met[i])
            continue;
        sum += e * e / v;
        e2 += e * e;
        v2 += v;
        all++;
    }
    o->size = e2 > 0 ? sqrt(v2 / e2) : NAN;
    o->outside = light > 0 ? missed / light : 0;
    free(var);
    free(img);
    free(met);
    return all > 0 ? sum / all : NAN;
}

#endif
