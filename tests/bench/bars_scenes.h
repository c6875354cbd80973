/* bars_scenes.h - flames, cameras and noise that judge error bars, beside those of flames.h and scenes.h.
 *
 *   fronts N   3 to 6 wrinkled fronts of a thickness of 0.006 to 0.03 m, by chance (seed N)
 *   clouds N   20 to 60 smooth blobs, by chance
 *   NAME moved     a flame of flames.h that is turned, shifted and of another size
 *   NAME at T      another instant of a volume
 *   NAME + NAME    the sum of two closed forms
 * Constants may be chosen on flames of the use "chosen on"; nothing is ever chosen on the others. */
#ifndef BENCH_BARS_SCENES_H
#define BENCH_BARS_SCENES_H
#include "bench.h"
#include "shot.h"

/* ---- rigs ---------------------------------------------------------------------------------------*/

static const struct view_set bars_4 = {"4 on a ring", 8, 4, 3, {0, 2, 4, 6}},
                             bars_5 = {"5 on a ring", 9, 5, 4, {0, 2, 3, 5, 7}},
                             bars_uneven = {"5 uneven", 11, 5, 5, {0, 1, 2, 6, 8}},
                             bars_arc = {"6 on 150 deg", 12, 6, 6, {0, 1, 2, 3, 4, 5}},
                             bars_6 = {"6 on a ring", 7, 6, 3, {0, 1, 2, 4, 5, 6}},
                             bars_7 = {"7 on a ring", 8, 7, 3, {0, 1, 2, 4, 5, 6, 7}},
                             bars_9 = {"9 on a ring", 10, 9, 4, {0, 1, 2, 3, 5, 6, 7, 8, 9}},
                             bars_12 = {"12 on a ring",
                                        13,
                                        12,
                                        6,
                                        {0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12}};

struct bars_case {
    const char *name;
    const struct view_set *views;
    double noise; /* of the peak */
    const char *wrong;
    bool narrow, above; /* odd cameras look past a part of the flame; the first one looks down */
    int32_t voxels;     /* a side; 0: 48 */
};
/* On gains, 7 cameras, 64^3 and 96^3 nothing was chosen. */
static const struct bars_case bars_cases[] = {
    {"8 cameras", &views_8, 0.01, "exact", false, false, 0},
    {"0.5 %", &views_8, 0.005, "exact", false, false, 0},
    {"5 %", &views_8, 0.05, "exact", false, false, 0},
    {"4 cameras", &bars_4, 0.01, "exact", false, false, 0},
    {"6 on an arc", &bars_arc, 0.02, "exact", false, false, 0},
    {"12 cameras", &bars_12, 0.01, "exact", false, false, 0},
    {"poses", &views_8, 0.01, "poses 0.3 px", false, false, 0},
    {"gains", &views_8, 0.01, "gains 5 %", false, false, 0},
    {"narrow", &views_8, 0.01, "exact", true, false, 0},
    {"5 cameras 2 %", &bars_5, 0.02, "exact", false, false, 0},
    {"5 uneven", &bars_uneven, 0.01, "exact", false, false, 0},
    {"6 cameras 5 %", &bars_6, 0.05, "exact", false, false, 0},
    {"7 cameras", &bars_7, 0.01, "exact", false, false, 0},
    {"9 cameras 3 %", &bars_9, 0.03, "exact", false, false, 0},
    {"one above", &bars_7, 0.01, "exact", false, true, 0},
    {"64^3", &views_8, 0.01, "exact", false, false, 64},
    {"96^3", &views_8, 0.01, "exact", false, false, 96},
};

/* The rig of a case. */
static inline void bars_rig(struct scene *s, const struct bars_case *k)
{
    int32_t n = k->voxels > 0 ? k->voxels : 48, wide = 5 * n / 2;
    scene_views(s, k->views, wide, 3 * wide / 4, n);
    static const double down[3] = {0.05, 0.02, 2.9}, aim[3] = {0, 0, 0.5};
    if (k->above)
        rec_camera_look(down, aim, &s->rig.cameras[0]);
    for (size_t c = 1; c < s->rig.n_cameras && k->narrow; c += 2)
        s->rig.cameras[c].cy -= 0.35 * s->rig.cameras[c].height;
}

/* ---- flames -------------------------------------------------------------------------------------*/

#define BARS_FRONTS 6

struct bars_front {
    double at[3], along[3], left[3], up[3]; /* a point, its normal, two directions in it */
    double thick, wide, bend[3], wave[3], e;
};
/* What burns, for functions of a place alone. */
static struct bars_fire {
    int fronts;
    struct bars_front front[BARS_FRONTS];
    void (*one)(const double x[3], double out[3]), (*other)(const double x[3], double out[3]);
    double size, turn[2], shift[2]; /* of `one`: cosine and sine, m */
} bars_fire;

static inline double bars_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void at_fronts(const double x[3], double out[3])
{
    out[0] = out[1] = out[2] = 0;
    for (int k = 0; k < bars_fire.fronts; k++) {
        const struct bars_front *f = &bars_fire.front[k];
        double r[3] = {x[0] - f->at[0], x[1] - f->at[1], x[2] - f->at[2]};
        double u = bars_dot(r, f->left), v = bars_dot(r, f->up), d = bars_dot(r, f->along);
        double far = (u * u + v * v) / (f->wide * f->wide);
        if (far >= 1 || fabs(d) > 0.4)
            continue;
        d -= f->bend[0] * sin(f->wave[0] * u + f->wave[1] * v + k) +
             f->bend[1] * cos(f->wave[2] * v - k) + f->bend[2] * far;
        glow(d / f->thick, f->e * (1 - far) * (1 - far), out);
    }
}

/* A place of the flame that is moved to x. */
static inline void at_moved(const double x[3], double out[3])
{
    const struct bars_fire *f = &bars_fire;
    double u = (x[0] - f->shift[0]) / f->size, v = (x[1] - f->shift[1]) / f->size;
    double at[3] = {f->turn[0] * u + f->turn[1] * v, f->turn[0] * v - f->turn[1] * u,
                    x[2] / f->size};
    f->one(at, out);
}
static inline void at_sum(const double x[3], double out[3])
{
    double more[3];
    at_moved(x, out);
    bars_fire.other(x, more);
    for (int l = 0; l < 3; l++)
        out[l] += more[l];
}

/* Three directions at right angles by chance. */
static inline void bars_axes(double a[3], double b[3], double c[3])
{
    double along, n;
    for (int i = 0; i < 3; i++) {
        a[i] = bench_normal();
        b[i] = bench_normal();
    }
    n = sqrt(bars_dot(a, a));
    for (int i = 0; i < 3; i++)
        a[i] /= n;
    along = bars_dot(a, b);
    for (int i = 0; i < 3; i++)
        b[i] -= along * a[i];
    n = sqrt(bars_dot(b, b));
    for (int i = 0; i < 3; i++)
        b[i] /= n;
    for (int i = 0; i < 3; i++)
        c[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static inline void bars_draw_fronts(uint64_t seed)
{
    bench_seed(7000 + seed);
    bars_fire.fronts = 3 + (int)(4 * bench_even());
    for (int k = 0; k < bars_fire.fronts; k++) {
        struct bars_front *f = &bars_fire.front[k];
        bars_axes(f->along, f->left, f->up);
        for (int i = 0; i < 3; i++) {
            f->at[i] = 0.36 * (bench_even() - 0.5) + (i == 2 ? 0.5 : 0);
            f->bend[i] = 0.04 * bench_even();
            f->wave[i] = 6 + 14 * bench_even();
        }
        f->thick = 0.006 * pow(5, bench_even());
        f->wide = 0.12 + 0.16 * bench_even();
        f->e = 0.4 + 0.6 * bench_even();
    }
}

static inline void bars_draw_clouds(uint64_t seed, struct rec_flame_pose *p)
{
    bench_seed(8000 + seed);
    p->n = 20 + (int)(40 * bench_even());
    double usual = 0.012 * pow(5, bench_even());
    for (int b = 0; b < p->n; b++) {
        struct rec_blob *q = &p->blob[b];
        double heat = bench_even();
        for (int i = 0; i < 3; i++) {
            q->m[i] = 0.12 * bench_normal();
            q->m[i] = fmax(-0.3, fmin(0.3, q->m[i])) + (i == 2 ? 0.5 : 0);
            q->s[i] = usual * (0.7 + 0.6 * bench_even());
        }
        q->a[0] = 0.5 + heat;
        q->a[1] = q->a[0] * (0.3 + 0.5 * heat);
        q->a[2] = q->a[0] * (0.05 + 0.5 * heat * heat);
    }
}

enum bars_kind { BARS_AS_IT_IS, BARS_FRONTS_OF, BARS_CLOUDS_OF, BARS_MOVED, BARS_SUM };

struct bars_flame {
    const char *name;
    bool judged;
    enum bars_kind kind;
    enum flame_kind flame, other;
    double t; /* instant, or seed */
    double size, turn, shift[2];
};
static const struct bars_flame bars_flames[] = {
    {"ring", false, BARS_AS_IT_IS, FLAME_RING, 0, 0.3, 0, 0, {0}},
    {"campfire", false, BARS_AS_IT_IS, FLAME_CAMPFIRE, 0, 6, 0, 0, {0}},
    {"gauss40", false, BARS_AS_IT_IS, FLAME_GAUSS40, 0, 0, 0, 0, {0}},
    {"ragged", false, BARS_AS_IT_IS, FLAME_RAGGED, 0, 0, 0, 0, {0}},
    {"fronts 1", false, BARS_FRONTS_OF, 0, 0, 1, 0, 0, {0}},
    {"fronts 2", false, BARS_FRONTS_OF, 0, 0, 2, 0, 0, {0}},
    {"fronts 3", false, BARS_FRONTS_OF, 0, 0, 3, 0, 0, {0}},
    {"fronts 4", false, BARS_FRONTS_OF, 0, 0, 4, 0, 0, {0}},
    {"clouds 1", false, BARS_CLOUDS_OF, 0, 0, 1, 0, 0, {0}},
    {"clouds 2", false, BARS_CLOUDS_OF, 0, 0, 2, 0, 0, {0}},
    {"clouds 3", false, BARS_CLOUDS_OF, 0, 0, 3, 0, 0, {0}},

    {"jet", true, BARS_AS_IT_IS, FLAME_JET, 0, 2, 0, 0, {0}},
    {"hollow", true, BARS_AS_IT_IS, FLAME_HOLLOW, 0, 2, 0, 0, {0}},
    {"candles", true, BARS_AS_IT_IS, FLAME_CANDLES, 0, 2, 0, 0, {0}},
    {"sheets", true, BARS_AS_IT_IS, FLAME_SHEETS, 0, 0, 0, 0, {0}},
    {"wall", true, BARS_AS_IT_IS, FLAME_WALL, 0, 0, 0, 0, {0}},
    {"shell", true, BARS_AS_IT_IS, FLAME_SHELL, 0, 0, 0, 0, {0}},
    {"pool", true, BARS_AS_IT_IS, FLAME_POOL, 0, 0, 0, 0, {0}},
    {"fronts 11", true, BARS_FRONTS_OF, 0, 0, 11, 0, 0, {0}},
    {"fronts 12", true, BARS_FRONTS_OF, 0, 0, 12, 0, 0, {0}},
    {"fronts 13", true, BARS_FRONTS_OF, 0, 0, 13, 0, 0, {0}},
    {"clouds 11", true, BARS_CLOUDS_OF, 0, 0, 11, 0, 0, {0}},
    {"clouds 12", true, BARS_CLOUDS_OF, 0, 0, 12, 0, 0, {0}},
    {"ring at 1.1", true, BARS_AS_IT_IS, FLAME_RING, 0, 1.1, 0, 0, {0}},
    {"pool moved", true, BARS_MOVED, FLAME_POOL, 0, 0, 0.8, 0.7, {0.05, -0.03}},
    {"sheets moved", true, BARS_MOVED, FLAME_SHEETS, 0, 0, 0.7, 0.5, {0.02, 0.04}},
    {"wall moved", true, BARS_MOVED, FLAME_WALL, 0, 0, 0.9, 2.1, {0, 0}},
    {"shell moved", true, BARS_MOVED, FLAME_SHELL, 0, 0, 0.8, 1.0, {-0.05, 0.05}},
    {"wall + pool", true, BARS_SUM, FLAME_WALL, FLAME_POOL, 0, 0.8, 0.3, {0.05, 0}},
    {"jet at 5", true, BARS_AS_IT_IS, FLAME_JET, 0, 5, 0, 0, {0}},
    {"hollow at 4", true, BARS_AS_IT_IS, FLAME_HOLLOW, 0, 4, 0, 0, {0}},
};

/* As scene_burn. */
static inline bool bars_burn(struct scene *s, const struct bars_flame *b, pvx_pool *pool)
{
    struct bars_fire *f = &bars_fire;
    if (b->kind == BARS_AS_IT_IS)
        return scene_burn(s, b->flame, b->t, pool);
    *f = (struct bars_fire){.one = flames[b->flame].at,
                            .other = flames[b->other].at,
                            .size = b->size,
                            .turn = {cos(b->turn), sin(b->turn)},
                            .shift = {b->shift[0], b->shift[1]}};
    s->nch = 3;
    if (b->kind == BARS_CLOUDS_OF) {
        bars_draw_clouds((uint64_t)b->t, &s->pose);
    } else {
        bars_draw_fronts((uint64_t)b->t);
        s->field = (struct field){.at = b->kind == BARS_FRONTS_OF ? at_fronts
                                        : b->kind == BARS_MOVED   ? at_moved
                                                                  : at_sum,
                                  .n = {80, 80, 80},
                                  .lo = {-0.5, -0.5, 0},
                                  .hi = {0.5, 0.5, 1}};
    }
    scene_shoot(s, pool);
    scene_rescale(s, PEAK / s->peak);
    return true;
}

#endif
