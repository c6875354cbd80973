/* check_shots.h - what benches of recon/check look at: instants of a flame by eight cameras of 160x120, in one channel,
 * and rigs whose poses are off. */
#ifndef BENCH_CHECK_SHOTS_H
#define BENCH_CHECK_SHOTS_H
#include "curve.h"
#include "recon/check/judge.h"
#include "recon/check/gauge.h"

enum { W = 160, H = 120, MOST = 12 };

struct shots {
    struct scene scene[MOST];
    size_t n;
    float *grey[MOST][REC_MAX_CAMERAS];
    const float *at[REC_MAX_CAMERAS];
};

static inline bool shoot(struct shots *s, enum flame_kind kind, size_t n, double noise,
                         pvx_pool *pool)
{
    memset(s, 0, sizeof *s);
    for (size_t i = 0; i < n; i++) {
        struct scene *q = &s->scene[i];
        if (!scene_new(q, kind, &views_8, size_64,
                       flames[kind].folder != NULL ? (double)i : 0.3 + 0.05 * (double)i, pool))
            return false;
        s->n = i + 1;
        for (size_t c = 0; c < q->rig.n_cameras; c++) {
            float *g = s->grey[i][c] = must_floats(W * H);
            for (size_t k = 0; k < W * H; k++) {
                for (size_t l = 0; l < (size_t)q->nch; l++)
                    g[k] += q->image[c][k * (size_t)q->nch + l] / (float)q->nch;
                g[k] += (float)(noise * q->peak * bench_normal());
            }
        }
    }
    return true;
}

static inline void let_go(struct shots *s)
{
    for (size_t i = 0; i < s->n; i++) {
        for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
            free(s->grey[i][c]);
        scene_fini(&s->scene[i]);
    }
}

static inline pvx_err get(void *ctx, size_t i, struct rec_check_set *out)
{
    struct shots *s = ctx;
    for (size_t c = 0; c < s->scene[0].rig.n_cameras; c++)
        s->at[c] = s->grey[i][c];
    *out = (struct rec_check_set){i, s->at, true};
    return PVX_OK;
}

/* Every camera turned about its own lens and shifted, until that is so many pixels rms. */
static inline void disturb(struct rec_rig *rig, double px)
{
    struct rec_rig old;
    CHECK(rec_rig_copy(rig, &old));
    for (size_t c = 0; c < rig->n_cameras; c++) {
        struct rec_camera keep = rig->cameras[c];
        double X0[3], w[3], t[3], own[REC_MAX_CAMERAS], s = 1e-3;
        rec_camera_centre(&keep, X0);
        for (int a = 0; a < 3; a++) {
            w[a] = bench_normal() * (a == 2 ? 3 : 1);
            t[a] = bench_normal() * (a == 2 ? 1.8 : 0.6);
        }
        for (int round = 0; round < 6; round++) {
            double ws[3], ts[3];
            for (int a = 0; a < 3; a++) {
                ws[a] = s * w[a];
                ts[a] = s * t[a];
            }
            rig->cameras[c] = keep;
            rec_camera_nudge(&rig->cameras[c], X0, ws, ts);
            (void)rec_gauge_distance(&old, rig, own);
            s *= px / own[c];
        }
    }
    rec_rig_fini(&old);
}
#endif
