/* moving.h - flames of flames.h in motion: a sequence of scenes, for what is averaged along time.
 *
 * A closed form or a volume turns about the vertical axis and sways by a wave that rises through it.  Blobs turn likewise.
 * `ring` moves as it is made to.  `speed`: voxels that a point 12 voxels off the axis moves from one set to the next.
 * The pictures are integrals over a field of 96^3 values, twice as fine as the grid: the system matrix has no part in it. */
#ifndef BENCH_MOVING_H
#define BENCH_MOVING_H
#include "bench.h"

#define MOVING_CELLS 96
#define MOVING_SWAY  0.03 /* of the height */

struct moving {
    enum flame_kind kind;
    double speed;       /* voxels of 1/48 a set */
    struct field still; /* of a volume */
    float *at;          /* [96^3][3] */
    int k;
};

static inline bool moving_new(struct moving *m, enum flame_kind kind, double speed)
{
    const struct flame *f = &flames[kind];
    char path[1024], file[128];
    *m = (struct moving){.kind = kind, .speed = speed};
    if (f->folder == NULL)
        return true;
    snprintf(file, sizeof file, "%s/emission-%06d.npy", f->folder, (int)f->t);
    bench_data(path, file);
    if (!field_load(&m->still, path)) {
        bench_not_run(f->name, path);
        return false;
    }
    for (int a = 0; a < 3; a++) { /* 1 m high, in the middle */
        double wide = (double)m->still.n[a] / m->still.n[2];
        m->still.lo[a] = a < 2 ? -wide / 2 : 0;
        m->still.hi[a] = m->still.lo[a] + wide;
    }
    return true;
}

static inline void moving_free(struct moving *m)
{
    free(m->still.v);
}

static inline double moving_angle(const struct moving *m, int k)
{
    return m->speed * k / 12;
}

static inline void moving_slice(void *ctx, size_t z)
{
    const struct moving *m = ctx;
    const struct flame *f = &flames[m->kind];
    double a = moving_angle(m, m->k), c = cos(a), s = sin(a);
    for (int y = 0; y < MOVING_CELLS; y++)
        for (int x = 0; x < MOVING_CELLS; x++) {
            double p[3] = {(x + 0.5) / MOVING_CELLS - 0.5, (y + 0.5) / MOVING_CELLS - 0.5,
                           ((double)z + 0.5) / MOVING_CELLS};
            double way = MOVING_SWAY * (sin(6 * p[2] - 4 * a) - sin(6 * p[2])), e[3];
            double u[3] = {c * p[0] - s * p[1] - way, s * p[0] + c * p[1], p[2]};
            if (f->at != NULL)
                f->at(u, e);
            else
                field_at(&m->still, NULL, u, e);
            float *to = m->at + ((z * MOVING_CELLS + (size_t)y) * MOVING_CELLS + (size_t)x) * 3;
            for (int l = 0; l < 3; l++)
                to[l] = e[l] > 1e-3 ? (float)e[l] : 0;
        }
}

/* Set k of the sequence before the cameras of s->rig; scene_truth follows.  peak: of the first set's pictures, in and
 * out; 0: not known yet. */
static inline void moving_burn(struct moving *m, int k, struct scene *s, double *peak,
                               pvx_pool *pool)
{
    const struct flame *f = &flames[m->kind];
    s->nch = f->nch;
    if (f->pose != NULL || m->kind == FLAME_RING) {
        double a = moving_angle(m, k), c = cos(a), q = sin(a);
        if (f->pose != NULL)
            f->pose(&s->pose);
        else
            pose_ring(s, 1, f->t + 0.02 * m->speed * k, 0);
        for (int b = 0; b < s->pose.n && f->pose != NULL; b++) {
            double *p = s->pose.blob[b].m, x = p[0], y = p[1];
            p[0] = c * x + q * y;
            p[1] = c * y - q * x;
        }
    } else {
        m->k = k;
        m->at = must_floats((size_t)MOVING_CELLS * MOVING_CELLS * MOVING_CELLS * 3);
        pvx_pool_run(pool, MOVING_CELLS, moving_slice, m);
        s->field = (struct field){.v = m->at,
                                  .n = {MOVING_CELLS, MOVING_CELLS, MOVING_CELLS},
                                  .lo = {-0.5, -0.5, 0},
                                  .hi = {0.5, 0.5, 1}};
    }
    scene_shoot(s, pool);
    if (*peak <= 0)
        *peak = s->peak;
    scene_rescale(s, PEAK / *peak);
}

#endif
