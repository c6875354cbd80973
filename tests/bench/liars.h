/* liars.h - frame sets in which a camera may be wrong: random rigs, what can be wrong with a picture, errors with
 * and without the vote.  Whoever includes it sees the flames that are held out: it chooses nothing. */
#ifndef BENCH_LIARS_H
#define BENCH_LIARS_H
#include "bench.h"

/* ---- rigs --------------------------------------------------------------------------------------- */

enum rig_kind { EVEN, ARC, DOME, MIXED, WILD, N_RIGS };

/* n cameras of w x 3/4 w pixels; MIXED and WILD differ in distance and focal length, so that some see a part
 * of the volume only. */
static inline void random_rig(struct rec_rig *rig, enum rig_kind kind, size_t n, int32_t w,
                              int32_t voxels)
{
    CHECK(rec_rig_ring(n, 2.2, w, w * 3 / 4, voxels, rig));
    double first = 6.283 * bench_even(), arc = kind == ARC ? 1.6 + 1.6 * bench_even() : 6.2832;
    bool mixed = kind == MIXED || kind == WILD, high = kind == DOME || kind == WILD;
    for (size_t i = 0; i < n; i++) {
        struct rec_camera *c = &rig->cameras[i];
        double far = mixed ? 1.7 + 1.8 * bench_even() : 2.2;
        double zoom = far / 2.2 * (mixed ? 0.8 + 0.5 * bench_even() : 1);
        double step = kind == EVEN ? 0.1 * (double)(i % 2) : 0.3 * (bench_even() - 0.5);
        double at = first + arc * ((double)i + step) / (double)(kind == ARC ? n - 1 : n);
        double up = high ? 1.2 * bench_even() : 0.1 + 0.1 * bench_even(), aim[3];
        const double eye[3] = {far * cos(at) * cos(up), far * sin(at) * cos(up),
                               0.5 + far * sin(up)};
        for (int a = 0; a < 3; a++)
            aim[a] = (a == 2 ? 0.5 : 0) + 0.06 * (bench_even() - 0.5);
        rec_camera_look(eye, aim, c);
        c->fx *= zoom;
        c->fy *= zoom;
    }
}

/* ---- what is wrong with a camera ---------------------------------------------------------------- */

enum fault { HEALTHY, BLACK, SHIFTED, FLOODED, HALF, LATE, FROZEN, N_FAULTS };
static const char *const fault_names[N_FAULTS] = {
    "healthy", "black", "shifted a tenth", "flooded", "half gain", "3 frames late", "frozen"};

struct take {
    struct scene now, late, frozen;
    bool moves; /* there are late and frozen */
    rec_sysmat *S;
    rec_frame *f, *trusting;
};

/* Pixel i of what the camera shows instead of s->image[c]. */
static inline float spoilt(const struct take *t, enum fault fault, size_t c, size_t i)
{
    const struct scene *s = &t->now;
    size_t nch = (size_t)s->nch, w = (size_t)s->rig.cameras[c].width, by = w / 10 * nch;
    switch (fault) {
    case BLACK: return 0;
    case SHIFTED: return i % (w * nch) >= by ? s->image[c][i - by] : 0;
    case FLOODED: return s->image[c][i] + 0.3F;
    case HALF: return 0.5F * s->image[c][i];
    case LATE: return t->late.image[c][i];
    case FROZEN: return t->frozen.image[c][i];
    default: return s->image[c][i];
    }
}

static inline void spoil(const struct take *t, rec_frame *f, enum fault fault, size_t c,
                         double noise)
{
    const struct scene *s = &t->now;
    size_t nch = (size_t)s->nch, cs = nch == 3 ? 4 : 1;
    size_t n = (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height;
    float *in = rec_frame_input(f, c);
    for (size_t i = 0; i < n * nch; i++)
        in[i / nch * cs + i % nch] =
            spoilt(t, fault, c, i) + (float)(noise > 0 ? noise * s->peak * bench_normal() : 0);
}

/* ---- takes -------------------------------------------------------------------------------------- */

static inline bool scene_at(struct scene *s, const struct rec_rig *rig, enum flame_kind kind,
                            double t, double scale, pvx_pool *pool)
{
    *s = (struct scene){.scale = 1, .unseen = rig->cameras[0]};
    CHECK(rec_rig_copy(rig, &s->rig));
    if (!scene_burn(s, kind, t, pool))
        return false;
    if (scale > 0)
        scene_rescale(s, scale / s->scale);
    return true;
}

static inline bool take_new(struct take *t, const struct rec_rig *rig, enum flame_kind kind,
                            enum rec_basis basis, bool moving, pvx_pool *pool)
{
    static const double back[N_FLAMES][2] = {[FLAME_RING] = {0.1, 0.7},
                                             [FLAME_CAMPFIRE] = {3, 6},
                                             [FLAME_JET] = {3, 2},
                                             [FLAME_HOLLOW] = {3, 2},
                                             [FLAME_CANDLES] = {3, 2}};
    double at = kind == FLAME_RING                                   ? 0.7 + 1.3 * bench_even()
                : kind == FLAME_CAMPFIRE                             ? 6 + floor(6 * bench_even())
                : flames[kind].folder != NULL && kind != FLAME_PLUME ? 3 + floor(3 * bench_even())
                                                                     : flames[kind].t;
    *t = (struct take){.moves = moving && back[kind][0] > 0};
    if (!scene_at(&t->now, rig, kind, at, 0, pool))
        return false;
    if (t->moves && (!scene_at(&t->late, rig, kind, at - back[kind][0], t->now.scale, pool) ||
                     !scene_at(&t->frozen, rig, kind, at - back[kind][1], t->now.scale, pool)))
        return false;
    struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = 1};
    struct rec_frame_params fp = rec_frame_defaults;
    scene_truth(&t->now, basis, pool);
    CHECK(rec_sysmat_build(&t->now.rig, &p, pool, NULL, NULL, &t->S, NULL));
    fp.nch = t->now.nch;
    CHECK(rec_frame_alone(t->S, &t->now.rig, &fp, pool, &t->f, NULL));
    fp.trust_all = true;
    CHECK(rec_frame_alone(t->S, &t->now.rig, &fp, pool, &t->trusting, NULL));
    return true;
}

static inline void take_free(struct take *t)
{
    rec_frame_free(&t->f);
    rec_frame_free(&t->trusting);
    rec_sysmat_free(&t->S);
    scene_fini(&t->now);
    if (t->moves) {
        scene_fini(&t->late);
        scene_fini(&t->frozen);
    }
}

/* Noise of every camera, and of every channel, from the same numbers whoever is asked. */
static inline void shoot(const struct take *t, rec_frame *f, enum fault fault, size_t bad,
                         double noise, uint64_t seed)
{
    bench_seed(seed);
    scene_fill(&t->now, f, noise);
    for (size_t c = 0; c < t->now.rig.n_cameras; c++)
        rec_frame_camera(f, c)->floats = true;
    if (fault != HEALTHY)
        spoil(t, f, fault, bad, noise);
}

static inline double error_of(const struct take *t, rec_frame *f)
{
    struct rec_sparse v;
    size_t n = rec_grid_count(&t->now.rig.grid) * (size_t)t->now.nch;
    float *dense = must_floats(n);
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    double e = rec_rel_l2(dense, t->now.truth, n);
    free(dense);
    return e;
}

#endif
