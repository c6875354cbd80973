/* flames.h - every flame that a figure is about: where it is from, and what was fitted on it.
 *
 *   fitted    constants in the code were fitted on it: its figures are in-sample
 *   seen      nothing was fitted on it, but it stood in the benches while defaults were chosen
 *   held out  nothing was fitted or chosen on it, and nothing ever may be: the figures to believe
 *
 * Blobs and closed forms are made here; volumes and the real capture lie in $PYROVOX_DATA (default
 * ../shared/data), and a bench says so and ends with 77 where one of its flames is not there.  No
 * picture comes from the system matrix: line integrals of Gaussians are known in closed form, those of
 * a field are summed in quarter-cell steps. */
#ifndef BENCH_FLAMES_H
#define BENCH_FLAMES_H
#include "base.h"
#include "field.h"
#include "recon/view/flame.h"

enum flame_kind {
    FLAME_RING,
    FLAME_CAMPFIRE,
    FLAME_PLUME,
    FLAME_GAUSS40,
    FLAME_RAGGED,
    FLAME_JET,
    FLAME_HOLLOW,
    FLAME_CANDLES,
    FLAME_SHEETS,
    FLAME_WALL,
    FLAME_SHELL,
    FLAME_POOL,
    N_FLAMES
};

/* ---- blobs -------------------------------------------------------------------------------------- */

static inline void pose_gauss40(struct rec_flame_pose *p)
{
    p->n = 40;
    bench_seed(40);
    for (int b = 0; b < 40; b++) {
        struct rec_blob *q = &p->blob[b];
        double u[3], r2;
        do {
            r2 = 0;
            for (int a = 0; a < 3; a++) {
                u[a] = 2 * bench_even() - 1;
                r2 += u[a] * u[a];
            }
        } while (r2 > 1);
        double size = 0.024 + 0.030 * bench_even();
        for (int a = 0; a < 3; a++) {
            q->m[a] = u[a] * (a == 2 ? 0.30 : 0.17) + (a == 2 ? 0.5 : 0);
            q->s[a] = size;
            q->a[a] = 0;
        }
        q->a[0] = 0.5 + bench_even();
    }
}

static inline void pose_ragged(struct rec_flame_pose *p)
{
    p->n = 60;
    bench_seed(60);
    for (int b = 0; b < 60; b++) {
        struct rec_blob *q = &p->blob[b];
        double tongue = 1.2566 * (b % 5), up = bench_even(), out = 0.06 + 0.20 * up;
        q->m[0] = out * cos(tongue + up) + 0.02 * bench_normal();
        q->m[1] = out * sin(tongue + up) + 0.02 * bench_normal();
        q->m[2] = 0.12 + 0.66 * up;
        q->s[0] = q->s[1] = 0.007 + 0.010 * bench_even();
        q->s[2] = 0.015 + 0.045 * bench_even();
        double heat = bench_even();
        q->a[0] = 1;
        q->a[1] = 0.3 + 0.5 * heat;
        q->a[2] = 0.05 + 0.5 * heat * heat;
    }
}

/* ---- closed forms, in [-0.5,0.5]^2 x [0,1] ------------------------------------------------------ */

/* 1 at the middle of [lo,hi], falling to 0 with its slope at the ends. */
static inline double window(double v, double lo, double hi)
{
    double s = v > lo && v < hi ? sin(3.141592653589793 * (v - lo) / (hi - lo)) : 0;
    return s * s;
}

/* Emission e of a front at `d` thicknesses from it, whiter where it is hotter. */
static inline void glow(double d, double e, double out[3])
{
    double v = fabs(d) < 5 ? e * exp(-0.5 * d * d) : 0;
    out[0] += v;
    out[1] += v * (0.2 + 0.6 * v);
    out[2] += v * (0.05 + 0.4 * v * v);
}

/* Three wrinkled sheets, half a voxel of 1/64 thick (one sigma), one behind the other. */
static inline void at_sheets(const double x[3], double out[3])
{
    double e = window(x[0], -0.38, 0.38) * window(x[2], 0.02, 0.9);
    out[0] = out[1] = out[2] = 0;
    for (int k = 0; k < 3 && e > 1e-6; k++) {
        double bend =
            0.05 * sin(9 * x[0] + 7 * x[2] + 2 * k) + 0.03 * sin(17 * x[2] - 5 * x[0] + k);
        glow((x[1] - 0.18 * (k - 1) - bend) / 0.008, e, out);
    }
}

/* A wall of flame that the wind lays over: thin at the foot, thick and torn further up. */
static inline void at_wall(const double x[3], double out[3])
{
    double e = window(x[1], -0.42, 0.42) * window(x[2], -0.3, 0.75), up = fmax(x[2], 0);
    double front = -0.3 + 0.75 * up * (1.6 - up) + 0.03 * sin(14 * x[1] + 9 * up);
    double torn = 1 - fmin(1, 1.6 * up) * window(sin(11 * x[1] + 6 * up) * cos(8 * up), -0.4, 1.4);
    out[0] = out[1] = out[2] = 0;
    if (x[2] > 0)
        glow((x[0] - front) / (0.015 + 0.06 * up), e * torn, out);
}

/* The shell of an explosion: a wrinkled sphere, dark inside but for a dim core. */
static inline void at_shell(const double x[3], double out[3])
{
    double u[3] = {x[0], x[1], x[2] - 0.5};
    double r = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) + 1e-9;
    double far = 0.28 + 0.02 * sin(13 * u[0] / r + 1) * sin(11 * u[1] / r) +
                 0.015 * cos(17 * u[2] / r + 5 * u[0] / r);
    out[0] = out[1] = out[2] = 0;
    glow((r - far) / 0.014, 0.7 + 0.3 * sin(7 * u[0] / r + 9 * u[2] / r), out);
    glow(r / 0.05, 0.3, out);
}

/* A pool fire: a thin sheet around the fuel that necks in, puffs and folds, more torn further up, and a
 * second one inside it. */
static inline void at_pool(const double x[3], double out[3])
{
    double r = sqrt(x[0] * x[0] + x[1] * x[1]), phi = atan2(x[1], x[0]), up = fmax(x[2], 0);
    double far = 0.3 - 0.42 * up * (1 - 0.75 * up) +
                 (0.02 + 0.05 * up) * sin(15 * up + 2 * x[0] / (r + 0.02)) +
                 (0.01 + 0.03 * up) * sin(5 * phi + 9 * up) + 0.012 * sin(11 * phi - 13 * up);
    double e = window(up, -0.2, 0.95) * (0.6 + 0.4 * sin(3 * phi + 8 * up));
    out[0] = out[1] = out[2] = 0;
    if (x[2] <= 0)
        return;
    glow((r - far) / 0.009, e, out);
    glow((r - 0.45 * far - 0.02 * sin(7 * phi + 12 * up)) / 0.009, 0.6 * window(up, 0.1, 0.95),
         out);
}

/* ---- the table ---------------------------------------------------------------------------------- */

static const struct flame {
    const char *name, *use;
    int nch;
    double t; /* the instant that benches of one instant show: s, or number of the volume */
    const char *folder; /* of volumes */
    void (*pose)(struct rec_flame_pose *p);
    void (*at)(const double x[3], double out[3]);
} flames[N_FLAMES] = {
    [FLAME_RING] = {"ring", "fitted", 3, 0.3, NULL, NULL, NULL}, /* recon/view/flame.h, in motion */
    [FLAME_CAMPFIRE] = {"campfire", "fitted", 3, 6, "campfire", NULL, NULL},
    [FLAME_PLUME] = {"plume", "fitted", 1, 0, "scalarflow", NULL, NULL}, /* a real capture */
    [FLAME_GAUSS40] = {"gauss40", "seen", 1, 0, NULL, pose_gauss40, NULL},
    [FLAME_RAGGED] = {"ragged", "seen", 3, 0, NULL, pose_ragged, NULL},
    [FLAME_JET] = {"jet", "held out", 3, 2, "fires/jet", NULL, NULL},
    [FLAME_HOLLOW] = {"hollow", "held out", 3, 2, "fires/hollow", NULL, NULL},
    [FLAME_CANDLES] = {"candles", "held out", 3, 2, "fires/candles", NULL, NULL},
    [FLAME_SHEETS] = {"sheets", "held out", 3, 0, NULL, NULL, at_sheets},
    [FLAME_WALL] = {"wall", "held out", 3, 0, NULL, NULL, at_wall},
    [FLAME_SHELL] = {"shell", "held out", 3, 0, NULL, NULL, at_shell},
    [FLAME_POOL] = {"pool", "held out", 3, 0, NULL, NULL, at_pool},
};

#endif
