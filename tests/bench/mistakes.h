/* mistakes.h - a flame in motion before the cameras of a rig, and the mistakes that are made with rigs and recordings,
 * each with the verdict of recon/check/plausible.h that is right. */
#ifndef BENCH_MISTAKES_H
#define BENCH_MISTAKES_H
#include "liars.h"
#include "recon/carve/photo.h"
#include "recon/check/plausible.h"
#include "recon/geom/blind.h"

enum { SETS = 6, W = 128, H = 96 };

struct shots {
    struct rec_rig rig;
    float *p[SETS][REC_MAX_CAMERAS]; /* [H][W], clean, brightest 0.8 */
};

/* Pictures of a flame in motion; false: no data. */
static inline bool shots_new(struct shots *t, enum flame_kind kind, enum rig_kind rigs, size_t n,
                             pvx_pool *pool)
{
    memset(t, 0, sizeof *t);
    random_rig(&t->rig, rigs, n, W, 64);
    double peak = 0;
    for (int i = 0; i < SETS; i++) {
        struct scene s = {.scale = 1, .unseen = t->rig.cameras[0]};
        const struct flame *f = &flames[kind];
        CHECK(rec_rig_copy(&t->rig, &s.rig));
        bool still = f->folder == NULL && kind != FLAME_RING;
        for (size_t c = 0; c < n && still; c++) /* it rises */
            for (int a = 0; a < 3; a++)
                s.rig.cameras[c].t[a] += s.rig.cameras[c].R[3 * a + 2] * 0.015 * (i - 3);
        if (!scene_burn(&s, kind, kind == FLAME_RING ? 0.5 + 0.05 * i : i, pool))
            return false;
        if (i == 0 && f->folder != NULL) /* the box of a volume on disk */
            t->rig.grid = s.rig.grid;
        scene_rescale(&s, 1 / s.scale);
        for (size_t c = 0; c < n; c++) {
            t->p[i][c] = must_floats(W * H);
            for (size_t k = 0; k < W * H; k++)
                t->p[i][c][k] = s.image[c][k * (size_t)s.nch];
            for (size_t k = 0; k < W * H; k++)
                peak = fmax(peak, t->p[i][c][k]);
        }
        scene_fini(&s);
    }
    for (int i = 0; i < SETS; i++)
        for (size_t c = 0; c < n; c++)
            for (size_t k = 0; k < W * H; k++)
                t->p[i][c][k] *= (float)(PEAK / peak);
    return true;
}

static inline void shots_free(struct shots *t)
{
    for (int i = 0; i < SETS; i++)
        for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
            free(t->p[i][c]);
    rec_rig_fini(&t->rig);
}

/* ---- mistakes ---- */

enum mistake {
    M_BOX_Z,
    M_BOX_X,
    M_SWAP_NEAR,
    M_SWAP_FAR,
    M_MIRROR_ALL,
    M_MIRROR_ONE,
    M_UPSIDE_ONE,
    M_TURNED_ONE,
    M_R_TRANSPOSED,
    M_INVERTED,
    M_OPENGL,
    M_PLACE,
    M_MM,
    M_K_TWICE,
    M_K_HALF,
    M_K_RATIO,
    M_K_ORDER,
    M_LATE_1,
    M_LATE_2,
    M_EARLY_1,
    M_LATE_TWO,
    M_K_ONE,
    M_R_ONE,
    M_INVERTED_ONE,
    M_OVEREXPOSED,
    M_BLACK,
    M_REPEATS,
    M_HALF_GAIN,
    M_MOVED,
    N_MISTAKES
};
static const struct {
    const char *name;
    enum rec_cause cause;
    int cameras; /* that must be named */
    const char *words;
} mistakes[N_MISTAKES] = {
    [M_BOX_Z] = {"box too low", REC_CAUSE_BOX, 0, "max"},
    [M_BOX_X] = {"box half as wide", REC_CAUSE_BOX, 0, "max"},
    [M_SWAP_NEAR] = {"neighbours swapped", REC_CAUSE_SWAPPED, 2, ""},
    [M_SWAP_FAR] = {"two swapped", REC_CAUSE_SWAPPED, 2, ""},
    [M_MIRROR_ALL] = {"all mirrored", REC_CAUSE_TURNED, 0, "left to right"},
    [M_MIRROR_ONE] = {"one mirrored", REC_CAUSE_TURNED, 1, "left to right"},
    [M_UPSIDE_ONE] = {"one upside down", REC_CAUSE_TURNED, 1, "top to bottom"},
    [M_TURNED_ONE] = {"one turned", REC_CAUSE_TURNED, 1, "180"},
    [M_R_TRANSPOSED] = {"R transposed", REC_CAUSE_RIG, 0, "R is transposed"},
    [M_INVERTED] = {"pose to world", REC_CAUSE_RIG, 0, "from the camera to the world"},
    [M_OPENGL] = {"OpenGL's axes", REC_CAUSE_RIG, 0, "OpenGL"},
    [M_PLACE] = {"t is the place", REC_CAUSE_RIG, 0, "t is the camera's place"},
    [M_MM] = {"millimetres", REC_CAUSE_RIG, 0, "millimetres"},
    [M_K_TWICE] = {"K twice", REC_CAUSE_RIG, 0, "K is that of pictures of twice"},
    [M_K_HALF] = {"K half", REC_CAUSE_RIG, 0, "K is that of pictures of half"},
    [M_K_RATIO] = {"K times 1.5", REC_CAUSE_RIG, 0, "K is "},
    [M_K_ORDER] = {"K in another order", REC_CAUSE_RIG, 0, "K is "},
    [M_LATE_1] = {"one late by 1", REC_CAUSE_LATE, 1, "1 frame late"},
    [M_LATE_2] = {"one late by 2", REC_CAUSE_LATE, 1, "2 frames late"},
    [M_EARLY_1] = {"one early by 1", REC_CAUSE_LATE, 1, "1 frame early"},
    [M_LATE_TWO] = {"two late by 1", REC_CAUSE_LATE, 2, "1 frame late"},
    [M_K_ONE] = {"K twice in one", REC_CAUSE_RIG, 1, "K is"},
    [M_R_ONE] = {"R transposed in one", REC_CAUSE_RIG, 1, "R is transposed"},
    [M_INVERTED_ONE] = {"pose to world in one", REC_CAUSE_RIG, 1, "from the camera"},
    [M_OVEREXPOSED] = {"overexposed 4 times", REC_CAUSE_SATURATED, 0, ""},
    [M_BLACK] = {"black level of 8 %", REC_CAUSE_BLACK, 0, "--black 0.0"},
    [M_REPEATS] = {"one repeats", REC_CAUSE_REPEATS, 1, ""},
    [M_HALF_GAIN] = {"one half as bright", REC_CAUSE_GAIN, 1, ""},
    [M_MOVED] = {"one moved", REC_CAUSE_CAMERA, 1, ""},
};

static inline void to_world(struct rec_camera *c, bool place)
{
    struct rec_camera was = *c;
    for (int i = 0; i < 9; i++)
        c->R[i] = was.R[3 * (i % 3) + i / 3];
    if (place)
        rec_camera_centre(&was, c->t);
}

static inline void scale_K(struct rec_camera *c, double by)
{
    c->fx *= by;
    c->fy *= by;
    c->cx = (c->cx + 0.5) * by - 0.5;
    c->cy = (c->cy + 0.5) * by - 0.5;
}

static inline void spoil_camera(struct rec_camera *c, enum mistake m)
{
    struct rec_camera was = *c;
    if (m == M_R_TRANSPOSED || m == M_R_ONE)
        to_world(c, false);
    if (m == M_INVERTED || m == M_INVERTED_ONE)
        to_world(c, true);
    if (m == M_PLACE)
        rec_camera_centre(&was, c->t);
    for (int i = 0; i < 3; i++) {
        c->t[i] *= m == M_MM ? 1000 : 1;
        c->t[i] *= m == M_OPENGL && i > 0 ? -1 : 1;
    }
    for (int i = 3; i < 9 && m == M_OPENGL; i++)
        c->R[i] = -c->R[i];
    if (m == M_K_TWICE || m == M_K_ONE || m == M_K_HALF || m == M_K_RATIO)
        scale_K(c, m == M_K_HALF ? 0.5 : m == M_K_RATIO ? 1.5 : 2);
    if (m == M_K_ORDER) {
        c->fy = was.cx;
        c->cx = was.fy;
    }
}

/* The height below which at most four fifths of the light are, in the first camera. */
static inline double shots_half(const struct shots *t)
{
    const struct rec_grid *g = &t->rig.grid;
    for (double share = 0.5; share > 0.1; share -= 0.05) {
        const double X[3] = {0.5 * (g->min[0] + g->max[0]), 0.5 * (g->min[1] + g->max[1]),
                             g->min[2] + share * (g->max[2] - g->min[2])};
        double uv[2], above = 0, all = 0;
        (void)rec_camera_project(&t->rig.cameras[0], X, uv);
        for (int i = 0; i < W * H; i++) {
            all += (double)t->p[0][0][i];
            above += i / W < uv[1] ? (double)t->p[0][0][i] : 0;
        }
        if (above > 0.2 * all)
            return X[2];
    }
    return 0.9 * g->min[2] + 0.1 * g->max[2];
}

static inline void spoil_rig(struct rec_rig *r, enum mistake m, size_t a)
{
    struct rec_grid *g = &r->grid;
    if (m == M_BOX_X)
        g->max[0] = 0.5 * (g->min[0] + g->max[0]);
    for (size_t c = 0; c < r->n_cameras; c++)
        if (mistakes[m].cameras != 1 || c == a)
            spoil_camera(&r->cameras[c], m);
}

/* Whose picture of which set camera c has then, and how it is turned. */
static inline const float *spoil_source(const struct shots *t, enum mistake m, size_t a, size_t b,
                                        int i, size_t c, int *lag)
{
    *lag = 0;
    if ((c == a && (m == M_LATE_1 || m == M_LATE_TWO)) || (c == b && m == M_LATE_TWO))
        *lag = -1;
    else if (c == a)
        *lag = m == M_LATE_2 ? -2 : m == M_EARLY_1 ? 1 : 0;
    int at = i + *lag;
    if (m == M_REPEATS && c == a)
        at = 0;
    if ((m == M_SWAP_NEAR || m == M_SWAP_FAR) && (c == a || c == b))
        c = c == a ? b : a;
    return at >= 0 && at < SETS ? t->p[at][c] : NULL;
}

static inline void spoil_picture_of(enum mistake m, bool about, const float *in, double noise,
                                    float *out)
{
    bool across = m == M_MIRROR_ALL || (about && (m == M_MIRROR_ONE || m == M_TURNED_ONE));
    bool upside = about && (m == M_UPSIDE_ONE || m == M_TURNED_ONE);
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++) {
            int u = across ? W - 1 - x : x, v = upside ? H - 1 - y : y;
            if (m == M_MOVED && about)
                u -= W / 12;
            float value = u >= 0 ? in[v * W + u] : 0;
            value *= m == M_OVEREXPOSED ? 4 : m == M_HALF_GAIN && about ? 0.5F : 1;
            value += m == M_BLACK ? 0.08F : 0;
            value += (float)(noise * PEAK * bench_normal());
            out[y * W + x] = m == M_OVEREXPOSED ? fminf(value, 1) : value;
        }
}

/* ---- a recording ---- */

struct bed {
    struct rec_photo_work *work;
    float img[REC_MAX_CAMERAS][W * H], weight[REC_MAX_CAMERAS][W * H];
    uint8_t lit[REC_MAX_CAMERAS][W * H];
};

static inline void bed_photo(struct bed *q, size_t c)
{
    const struct rec_photo_params p = REC_PHOTO_DEFAULTS;
    const float gain[3] = {1, 1, 1};
    struct rec_photo_stats stats;
    struct rec_photo_image im = {.img = q->img[c],
                                 .bw = W,
                                 .bh = H,
                                 .nch = 1,
                                 .binning = 1,
                                 .gain = gain,
                                 .params = &p,
                                 .weight = q->weight[c],
                                 .lit = q->lit[c],
                                 .stats = &stats,
                                 .work = q->work};
    rec_photo_apply(&im, 1, NULL);
}

struct case_of {
    enum mistake m; /* N_MISTAKES: none */
    double noise, poses, gains;
    size_t a, b;
};

static inline void bed_judge(struct bed *q, const struct shots *t, const struct case_of *k,
                             struct rec_plausible_verdict *out)
{
    struct rec_rig rig;
    rec_plausible *p;
    double gain[REC_MAX_CAMERAS];
    CHECK(rec_rig_copy(&t->rig, &rig));
    for (size_t c = 0; c < rig.n_cameras; c++) {
        double angle = 6.2832 * bench_even();
        rig.cameras[c].cx += k->poses * W / 640 * cos(angle); /* of pictures of 640 pixels */
        rig.cameras[c].cy += k->poses * W / 640 * sin(angle);
        gain[c] = exp(k->gains * fmax(-2, fmin(2, bench_normal())));
    }
    if (k->m < N_MISTAKES)
        spoil_rig(&rig, k->m, k->a);
    if (k->m == M_BOX_Z)
        rig.grid.max[2] = shots_half(t);
    *out = (struct rec_plausible_verdict){.cause = REC_CAUSE_NONE};
    if (rec_rig_blind(&rig, out->text, sizeof out->text) == REC_BLIND_ALL) {
        out->cause = REC_CAUSE_RIG;
        rec_rig_fini(&rig);
        return;
    }
    CHECK(rec_plausible_new(&rig, 1, &p));
    for (int i = 0; i < SETS; i++) {
        struct rec_plausible_set s = {.number = (uint64_t)i, .nch = 1, .cs = 1};
        for (size_t c = 0; c < rig.n_cameras; c++) {
            int lag;
            const float *in = spoil_source(t, k->m, k->a, k->b, i, c, &lag);
            if (in == NULL)
                continue;
            if (k->m == M_REPEATS && c == k->a)
                bench_seed(77); /* the noise repeats, too */
            spoil_picture_of(k->m, c == k->a, in, k->noise, q->img[c]);
            if (k->m == M_REPEATS && c == k->a)
                bench_seed((uint64_t)(i + 1) * 31);
            for (int j = 0; j < W * H; j++)
                q->img[c][j] *= (float)gain[c];
            bed_photo(q, c);
            s.b[c] = q->img[c];
            s.weight[c] = q->weight[c];
            s.lit[c] = q->lit[c];
        }
        rec_plausible_add(p, &s);
    }
    CHECK(rec_plausible_judge(p, REC_PLAUSIBLE_HYPOTHESES, NULL, NULL, out));
    rec_plausible_free(&p);
    rec_rig_fini(&rig);
}

static inline bool bed_right(const struct case_of *k, const struct rec_plausible_verdict *v)
{
    if (k->m == N_MISTAKES)
        return v->cause == REC_CAUSE_NONE;
    uint64_t about = mistakes[k->m].cameras == 0 ? 0 : (uint64_t)1 << k->a;
    if (mistakes[k->m].cameras == 2)
        about |= (uint64_t)1 << k->b;
    return v->cause == mistakes[k->m].cause && (about == 0 || v->cameras == about) &&
           (strstr(v->text, mistakes[k->m].words) != NULL ||
            strstr(v->next, mistakes[k->m].words) != NULL);
}

#endif
