/* advise_scenes.h - recordings of which it is known what they need: random rigs and flames, each with or without
 * absorption, saturated pixels, a camera of another gain, a black level, a body in the way and,
 * where nothing absorbs (which bends what is bright as well), a response of power 1/2.2.
 *
 * Scenes are numbered; the number is all that they come from.  Negative ones are without the flames that are held out
 * (flames.h). */
#ifndef BENCH_ADVISE_SCENES_H
#define BENCH_ADVISE_SCENES_H
#include "daemon/cli/advise/advise.h"
#include "liars.h"

enum { SEEN_W = 96, SEEN_H = 72, SEEN_SETS = 6, SEEN_CELLS = 64 };

struct needs {
    bool black, saturated, absorption, gain, body, response;
};

struct advise_scene {
    struct needs needs;
    struct flame_sets_args args;
    struct flame_sets sets;
    const char *flame;
    double depth, off, level, noise, hidden, at_top; /* what is wrong by how much */
    size_t which;                                    /* camera of another gain */
    double sigma;                                    /* noise of a pixel */
};

static inline double between(double lo, double hi)
{
    return lo + (hi - lo) * bench_even();
}

/* ---- flames ------------------------------------------------------------------------------------- */

struct burning {
    int kind;
    struct rec_flame flame;
    struct rec_flame_pose pose;
    double drift[3], rise[REC_FLAME_MAX_BLOBS][3];
};

static const char *const advise_flames[] = {"ring", "blobs", "candles", "wall", "pool", "shell"};

/* Blobs in a few tongues, the whole as flat as it comes. */
static inline void random_blobs(struct burning *q, int tongues, double wide)
{
    double flat = between(0.25, 1), turn = between(0, 3.1416);
    q->pose.n = 50;
    for (int b = 0; b < q->pose.n; b++) {
        struct rec_blob *k = &q->pose.blob[b];
        double way = 6.2832 * (b % tongues) / tongues + 0.4 * bench_normal(), up = bench_even();
        double out = wide * (tongues > 4 ? sqrt(bench_even()) : 1) + 0.03 * bench_normal();
        double x = out * cos(way), y = flat * out * sin(way), heat = bench_even();
        k->m[0] = x * cos(turn) - y * sin(turn);
        k->m[1] = x * sin(turn) + y * cos(turn);
        k->m[2] = 0.15 + 0.6 * up * (tongues > 4 ? 1 : 0.7);
        k->s[0] = k->s[1] = between(0.02, 0.05);
        k->s[2] = between(0.03, 0.08);
        k->a[0] = 1;
        k->a[1] = 0.3 + 0.5 * heat;
        k->a[2] = 0.05 + 0.5 * heat * heat;
        for (int a = 0; a < 3; a++)
            q->rise[b][a] = a == 2 ? between(0.5, 1.5) : 0.2 * bench_normal();
    }
}

static inline void burn(struct burning *q, const struct rec_grid *g, bool held_out)
{
    q->kind = (int)(bench_even() * (held_out ? 6 : 3));
    for (int a = 0; a < 3; a++)
        q->drift[a] = a < 2 ? 0.3 * bench_normal() : 0;
    if (q->kind == 0)
        rec_flame_init(&q->flame, g, 1 + (uint32_t)(1e6 * bench_even()));
    else
        random_blobs(q, q->kind == 1 ? 7 : 2 + (int)(3 * bench_even()),
                     between(0.12, q->kind == 1 ? 0.3 : 0.22));
}

/* A closed form, mean of 2 x 2 x 2 points a cell. */
static inline void sampled(void (*at)(const double *, double *), const struct rec_grid *g, float *v)
{
    int n = SEEN_CELLS;
    for (size_t i = 0; i < rec_grid_count(g); i++)
        for (int s = 0; s < 8; s++) {
            int k[3] = {(int)i % n, (int)i / n % n, (int)i / n / n};
            double x[3], e[3];
            for (int a = 0; a < 3; a++)
                x[a] = g->min[a] + (k[a] + 0.25 + 0.5 * (s >> a & 1)) / n;
            at(x, e);
            for (int ch = 0; ch < 3; ch++)
                v[3 * i + (size_t)ch] += (float)e[ch] / 8;
        }
}

/* The flame of set i, dt apart, as a field. */
static inline void field_of(struct burning *q, const struct rec_grid *rig, double t,
                            struct field *f)
{
    static void (*const at[])(const double *, double *) = {at_wall, at_pool, at_shell};
    struct rec_flame_pose p = q->pose;
    struct rec_grid g = *rig;
    g.basis = REC_BOX;
    for (int a = 0; a < 3; a++)
        f->n[a] = g.n[a] = SEEN_CELLS;
    if (f->v == NULL)
        f->v = must_floats(3 * rec_grid_count(&g));
    for (int a = 0; a < 3; a++) {
        double by = q->kind > 2 ? 0.08 * sin(q->drift[a] * t / 0.08) : 0;
        f->lo[a] = g.min[a] + by;
        f->hi[a] = g.max[a] + by;
    }
    if (q->kind > 2) {
        if (t == 0)
            sampled(at[q->kind - 3], &g, f->v);
        return;
    }
    if (q->kind == 0)
        rec_flame_at(&q->flame, 0.3 + t, &p);
    for (int b = 0; b < p.n && q->kind > 0; b++)
        for (int a = 0; a < 3; a++) {
            double to = p.blob[b].m[a] + t * (q->rise[b][a] + q->drift[a]);
            p.blob[b].m[a] = a == 2 ? 0.12 + fmod(to - 0.12, 0.65) : to;
        }
    rec_flame_voxels(&p, &g, 0, g.n[2], f->v);
}

/* ---- pictures ----------------------------------------------------------------------------------- */

static inline float *grey_image(const struct field *f, const struct rec_camera *c, pvx_pool *pool)
{
    float *rgb = field_image(f, c, pool), *out = must_floats(SEEN_W * SEEN_H);
    for (size_t i = 0; i < SEEN_W * SEEN_H; i++)
        out[i] = (rgb[3 * i] + rgb[3 * i + 1] + rgb[3 * i + 2]) / 3;
    free(rgb);
    return out;
}

/* The value that so many of the flame's pixels exceed, of one set; flame: 5 % of the brightest. */
static int by_value(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}
static inline double exceeded(float *const *p, size_t cameras, double share)
{
    size_t n = cameras * SEEN_W * SEEN_H, dark = 0;
    float *v = must_floats(n);
    for (size_t c = 0; c < cameras; c++)
        memcpy(v + c * SEEN_W * SEEN_H, p[c], SEEN_W * SEEN_H * sizeof *v);
    qsort(v, n, sizeof *v, by_value);
    while (dark < n && v[dark] < 0.05F * v[n - 1])
        dark++;
    double top = (double)v[n - 1 - (size_t)(share * (double)(n - dark))];
    free(v);
    return top;
}

/* Share of the flame's pixels of the camera of which it hides most that a body leaves nothing of. */
static inline double hidden_by(const struct field *f, float *const *clear, const struct rec_rig *r,
                               pvx_pool *pool)
{
    double most = 0, peak = exceeded(clear, r->n_cameras, 0);
    for (size_t c = 0; c < r->n_cameras; c++) {
        float *with = grey_image(f, &r->cameras[c], pool);
        double gone = 0, all = 0;
        for (size_t i = 0; i < SEEN_W * SEEN_H; i++) {
            bool flame = (double)clear[c][i] > 0.05 * peak;
            all += flame;
            gone += flame && with[i] < 0.05F * clear[c][i];
        }
        most = fmax(most, gone / fmax(all, 1));
        free(with);
    }
    return most;
}

/* A rod or a post somewhere about the flame. */
static inline void random_body(struct rec_body *b)
{
    double way = between(0, 6.2832), far = between(0, 0.5), lean = between(-0.2, 0.2);
    const double foot[2] = {far * cos(way), far * sin(way)};
    *b = (struct rec_body){.name = "rod", .kind = REC_BODY_CYLINDER};
    b->radius = between(0.025, 0.07);
    for (int a = 0; a < 2; a++) {
        b->a[a] = foot[a];
        b->b[a] = foot[a] + lean * (a == 0 ? 1 : -1);
    }
    b->b[2] = between(0.4, 1.2);
}

static inline void spoil_pixels(struct advise_scene *s, float *const *clean, size_t n, size_t i)
{
    for (size_t c = 0; c < n; c++)
        for (size_t k = 0; k < SEEN_W * SEEN_H; k++) {
            double light = (double)clean[c][k] * (c == s->which ? s->off : 1);
            double v = (s->needs.response ? pow(light, 1 / 2.2) : light) + s->level +
                       s->sigma * bench_normal();
            s->sets.picture[i][c][k] = (float)fmin(v, 1);
        }
}

static inline void advise_scene_draw(struct advise_scene *s, size_t n)
{
    struct needs *q = &s->needs;
    q->absorption = bench_even() < 0.35;
    q->saturated = bench_even() < 0.3;
    q->gain = bench_even() < 0.35;
    q->black = bench_even() < 0.35;
    q->body = bench_even() < 0.3;
    s->depth = between(2, 4);
    s->depth = q->absorption ? s->depth : 0;
    s->which = (size_t)(bench_even() * (double)n);
    double off = between(0.15, 0.35);
    s->off = !q->gain ? 1 : bench_even() < 0.5 ? 1 - off : 1 + off;
    s->level = between(0.005, 0.03);
    s->level = q->black ? s->level : 0;
    s->sigma = between(0.002, 0.02);
    s->at_top = between(0.02, 0.08);
    s->at_top = q->saturated ? s->at_top : 0;
}

/* Once: pictures of the first set tell how deep it is, what a body would hide, how long to expose. */
static inline double advise_scene_set_up(struct advise_scene *s, struct field *f,
                                         struct rec_bodies *bodies, pvx_pool *pool)
{
    const struct rec_rig *r = &s->sets.rig;
    float *p[REC_MAX_CAMERAS];
    for (int pass = 0; pass < 2; pass++) { /* thin, then as deep as it should be */
        for (size_t c = 0; c < r->n_cameras; c++)
            p[c] = grey_image(f, &r->cameras[c], pool);
        if (pass == 1 || s->depth == 0)
            break;
        f->absorb = s->depth / exceeded(p, r->n_cameras, 0);
        for (size_t c = 0; c < r->n_cameras; c++)
            free(p[c]);
    }
    for (int tries = 0; s->needs.body && tries < 20 && s->hidden < 0.03; tries++) {
        random_body(bodies->body);
        f->bodies = bodies;
        s->hidden = hidden_by(f, p, r, pool);
    }
    if (s->needs.body && s->hidden < 0.03) {
        f->bodies = NULL;
        s->needs.body = false;
    }
    double top = exceeded(p, r->n_cameras, s->at_top);
    double brighter = fmax(1, s->off);
    for (size_t c = 0; c < r->n_cameras; c++)
        free(p[c]);
    return (s->needs.saturated ? 1 : 0.85 / brighter) / top;
}

static inline void advise_scene_new(struct advise_scene *s, uint64_t number, bool held_out,
                                    pvx_pool *pool)
{
    static const struct flame_sets_args quiet = {.quiet = true, .rig = "rig", .frames = "scene"};
    struct rec_body body;
    struct rec_bodies bodies = {1, &body};
    struct burning q = {0};
    struct field f = {0};
    bench_seed(number + 1000003);
    bool bent = bench_even() < 0.2; /* of its own numbers: the others are as they were without */
    bench_seed(number);
    *s = (struct advise_scene){.args = quiet};
    size_t n = 5 + (size_t)(8 * bench_even());
    enum rig_kind kind = (enum rig_kind)(bench_even() * 3);
    random_rig(&s->sets.rig, kind, n, SEEN_W, SEEN_CELLS);
    burn(&q, &s->sets.rig.grid, held_out);
    s->flame = advise_flames[q.kind];
    advise_scene_draw(s, n);
    s->needs.response = bent && !s->needs.absorption;
    s->sets.a = &s->args;
    s->sets.nch = 1;
    s->sets.pool = pool;
    s->sets.params = (struct rec_unseen_params)REC_UNSEEN_DEFAULTS;
    s->sets.params.binning = 1;
    s->sets.there = s->sets.n = SEEN_SETS;
    s->sets.number = pvx_calloc(SEEN_SETS, sizeof *s->sets.number);
    s->sets.picture = pvx_calloc(SEEN_SETS, sizeof *s->sets.picture);
    double scale = 0;
    for (size_t i = 0; i < SEEN_SETS; i++) {
        float *clean[REC_MAX_CAMERAS];
        field_of(&q, &s->sets.rig.grid, (double)i / 30, &f);
        scale = i == 0 ? advise_scene_set_up(s, &f, &bodies, pool) : scale;
        s->sets.number[i] = i;
        for (size_t c = 0; c < n; c++) {
            clean[c] = grey_image(&f, &s->sets.rig.cameras[c], pool);
            for (size_t k = 0; k < SEEN_W * SEEN_H; k++)
                clean[c][k] *= (float)scale;
            s->sets.bins[c] = SEEN_W * SEEN_H;
            s->sets.picture[i][c] = must_floats(SEEN_W * SEEN_H);
        }
        spoil_pixels(s, clean, n, i);
        for (size_t c = 0; c < n; c++)
            free(clean[c]);
    }
    free(f.v);
}

/* ---- verdicts ----------------------------------------------------------------------------------- */

enum { ADVISE_TERMS = 6 };
static const char *const advise_term_names[ADVISE_TERMS] = {"black", "saturated", "absorption",
                                                            "gain",  "body",      "response"};

static inline void advise_verdict(const struct advise_scene *s, const struct advice *a,
                                  bool needed[ADVISE_TERMS], bool found[ADVISE_TERMS])
{
    const struct needs *q = &s->needs;
    bool body = false;
    for (size_t c = 0; c < s->sets.rig.n_cameras; c++)
        body |= a->body[c].share > 0;
    memcpy(needed, (bool[]){q->black, q->saturated, q->absorption, q->gain, q->body, q->response},
           ADVISE_TERMS);
    memcpy(found,
           (bool[]){a->level[a->darkest] > ADVISE_LEVEL, a->saturated > ADVISE_SATURATED,
                    a->absorption.c > 0, a->gain.on, body, a->response.on},
           ADVISE_TERMS);
}

static inline void advise_scene_free(struct advise_scene *s)
{
    s->sets.pool = NULL; /* not its own */
    flame_sets_fini(&s->sets);
}

#endif
