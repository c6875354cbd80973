/* flame_rig.h - frame sets of the analytic flame in motion as one channel, and what can be done to a camera's
 * pictures, for tests and benches of recon/check. */
#ifndef TESTS_FLAME_RIG_H
#define TESTS_FLAME_RIG_H
#include "recon/check/judge.h"
#include "recon/view/flame.h"
#include "tests/lib/must.h"

#define FLAME_RIG_SETS 12

struct flame_rig {
    struct rec_rig rig; /* as the cameras really stand */
    int32_t w, h;
    size_t n;                                        /* sets */
    float *picture[FLAME_RIG_SETS][REC_MAX_CAMERAS]; /* [h][w] */
};

static inline void flame_rig_shoot(struct flame_rig *f, uint32_t seed, double step_s,
                                   double (*noise)(void))
{
    struct rec_flame flame;
    struct rec_flame_pose pose;
    size_t bins = (size_t)f->w * (size_t)f->h;
    float *raw = must_floats(bins * 3);
    rec_flame_init(&flame, &f->rig.grid, seed);
    for (size_t i = 0; i < f->n; i++) {
        rec_flame_at(&flame, step_s * (double)i, &pose);
        for (size_t c = 0; c < f->rig.n_cameras; c++) {
            f->picture[i][c] = must_floats(bins);
            rec_flame_render(&pose, &f->rig.cameras[c], 2, 0, f->h, raw);
            for (size_t k = 0; k < bins; k++)
                f->picture[i][c][k] =
                    (raw[3 * k] + raw[3 * k + 1] + raw[3 * k + 2]) / 3 + 0.005F * (float)noise();
        }
    }
    free(raw);
}

static inline void flame_rig_new(struct flame_rig *f, size_t cameras, int32_t w, size_t sets,
                                 uint32_t seed, double (*noise)(void))
{
    *f = (struct flame_rig){.w = w, .h = w * 3 / 4, .n = sets};
    CHECK(rec_rig_ring(cameras, 2.2, w, w * 3 / 4, 48, &f->rig));
    flame_rig_shoot(f, seed, 0.05, noise);
}

static inline void flame_rig_free(struct flame_rig *f)
{
    for (size_t i = 0; i < FLAME_RIG_SETS; i++)
        for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
            free(f->picture[i][c]);
    rec_rig_fini(&f->rig);
}

/* ---- one camera that is wrong ---- */

enum spoil {
    SPOIL_NOTHING,
    SPOIL_SHIFT, /* 3 right, 2 up */
    SPOIL_TENTH,
    SPOIL_CAP,
    SPOIL_FLOOD,
    SPOIL_MIRROR,
    SPOIL_LATE, /* one set */
    SPOIL_FROZEN,
    SPOIL_BLUR, /* sigma 2 */
    SPOIL_HALF,
    N_SPOILS
};

static inline void spoil_shift(const struct flame_rig *f, const float *in, int32_t dx, int32_t dy,
                               float *out)
{
    for (int32_t y = 0; y < f->h; y++)
        for (int32_t x = 0; x < f->w; x++) {
            int32_t u = x - dx, v = y - dy;
            bool there = u >= 0 && v >= 0 && u < f->w && v < f->h;
            out[(size_t)y * (size_t)f->w + (size_t)x] =
                there ? in[(size_t)v * (size_t)f->w + (size_t)u] : 0;
        }
}

/* Picture of set i of camera c as it comes then, into out [h][w]. */
static inline void spoil_picture(const struct flame_rig *f, enum spoil s, size_t i, size_t c,
                                 double (*noise)(void), float *out)
{
    size_t n = (size_t)f->w * (size_t)f->h, w = (size_t)f->w;
    const float *in = f->picture[s == SPOIL_LATE     ? (i > 0 ? i - 1 : 0)
                                 : s == SPOIL_FROZEN ? 0
                                                     : i][c];
    memcpy(out, in, n * sizeof *out);
    if (s == SPOIL_SHIFT)
        spoil_shift(f, in, 3, -2, out);
    else if (s == SPOIL_TENTH)
        spoil_shift(f, in, f->w / 10, 0, out);
    else if (s == SPOIL_BLUR) {
        float *tmp = must_floats(n);
        rec_smooth(in, f->w, f->h, 8, out, tmp);
        free(tmp);
    }
    for (size_t k = 0; k < n; k++) {
        if (s == SPOIL_CAP)
            out[k] = 0.005F * (float)noise();
        else if (s == SPOIL_FLOOD)
            out[k] = 1;
        else if (s == SPOIL_HALF)
            out[k] *= 0.5F;
        else if (s == SPOIL_MIRROR)
            out[k] = in[k / w * w + w - 1 - k % w];
    }
}

/* ---- as a source of a check ---- */

struct flame_source {
    const struct flame_rig *f;
    enum spoil what[REC_MAX_CAMERAS];
    double (*noise)(void);
    float *spoilt[REC_MAX_CAMERAS]; /* [h][w] where something is done, else NULL */
    const float *picture[REC_MAX_CAMERAS];
};

static inline pvx_err flame_source_get(void *ctx, size_t i, struct rec_check_set *out)
{
    struct flame_source *s = ctx;
    for (size_t c = 0; c < s->f->rig.n_cameras; c++) {
        s->picture[c] = s->f->picture[i][c];
        if (s->what[c] == SPOIL_NOTHING)
            continue;
        if (s->spoilt[c] == NULL)
            s->spoilt[c] = must_floats((size_t)s->f->w * (size_t)s->f->h);
        spoil_picture(s->f, s->what[c], i, c, s->noise, s->spoilt[c]);
        s->picture[c] = s->spoilt[c];
    }
    *out = (struct rec_check_set){i, s->picture, true};
    return PVX_OK;
}

static inline void flame_source_free(struct flame_source *s)
{
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        free(s->spoilt[c]);
}

#endif
