/* test_cl_pooled.c - the vote on pictures that a device pooled: the numbers and the verdict of the processor's, to the bit. */
#include "tests/t.h"
#include "tests/lib/cl_bed.h"
#include "tests/lib/must.h"

#include "base/mem.h"
#include "recon/opencl/pooled.h"
#include "recon/vote/impl.h"

enum { CAMERAS = 6 };
static rec_cl *cl;
static uint32_t known, unknown, dazzled, verdicts; /* what was tried */

/* Pictures of a flame in every camera, some parts without weight. */
struct bed {
    const rec_sysmat *S;
    size_t rows, cs;
    float *b, *w, *w4;
    uint8_t *lit;
    bool present[CAMERAS];
    float noise[CAMERAS];
    struct rec_pictures in;
};

static void paint(struct bed *t, size_t c, bool mosaic)
{
    static const uint8_t cell[4] = {0, 1, 1, 2};
    const struct rec_sysmat_block *k = &t->S->block[c];
    double gone = t_rand() % 2 == 0 ? 0.02 : 0.3, gain = t_rand() % 4 == 0 ? 0.3 : 1;
    for (int32_t y = 0; y < k->bh; y++)
        for (int32_t x = 0; x < k->bw; x++) {
            size_t i = t->S->row0[c] + (size_t)y * (size_t)k->bw + (size_t)x;
            double u = x - k->bw / 2.0, v = y - k->bh / 2.0, r = sqrt(u * u + v * v) / k->bh * 4;
            double light = gain * fmax(0, 1 - r) + 0.01 * t_normal();
            t->w[i] = t_uniform(0, 1) < gone ? 0 : 1;
            t->lit[i] = light > 0.03;
            for (size_t l = 0; l < t->cs; l++)
                t->b[i * t->cs + l] = l < 3 ? (float)(light * (1 + (double)l / 3)) : 0;
            for (size_t l = 0; l < 4; l++) {
                bool has = l < 3 && (!mosaic || cell[y % 2 * 2 + x % 2] == l);
                t->w4[i * 4 + l] = has ? t->w[i] : 0;
                if (!has && l < t->cs)
                    t->b[i * t->cs + l] = 0;
            }
        }
}

static struct bed bed_new(const rec_sysmat *S, int nch, bool per_channel)
{
    struct bed t = {.S = S, .rows = S->row0[S->n_cameras], .cs = nch == 3 ? 4 : 1};
    t.b = pvx_calloc(t.rows * t.cs, sizeof(float));
    t.w = pvx_calloc(t.rows, sizeof(float));
    t.w4 = pvx_calloc(t.rows * 4, sizeof(float));
    t.lit = pvx_calloc(t.rows, 1);
    for (size_t c = 0; c < CAMERAS; c++) {
        t.present[c] = c != 2 || t_rand() % 2 == 0;
        t.noise[c] = 3e-4f;
        if (t.present[c])
            paint(&t, c, per_channel && c != 1);
    }
    t.in =
        (struct rec_pictures){.b = t.b, .w = per_channel ? t.w4 : t.w, .per_channel = per_channel};
    return t;
}
static void bed_free(struct bed *t)
{
    free(t->b);
    free(t->w);
    free(t->w4);
    free(t->lit);
}

struct device {
    rec_cl_queue *q;
    rec_cl_pooled *p;
    struct rec_cl_pictures to;
};
static const struct rec_vote_pooled *pool(struct device *o, const struct bed *t, const rec_vote *v)
{
    struct pvx_diag d = {""};
    o->q = cl_bed_queue(cl);
    T_EQ_I(rec_cl_pooled_new(cl, t->S, v, &o->p, &d), PVX_OK);
    o->to.b = cl_bed_buffer(cl, o->q, t->b, t->rows * t->cs * sizeof(float));
    o->to.w = cl_bed_buffer(cl, o->q, t->w, t->rows * sizeof(float));
    o->to.w4 = cl_bed_buffer(cl, o->q, t->w4, t->in.per_channel ? t->rows * 16 : 0);
    o->to.lit = cl_bed_buffer(cl, o->q, t->lit, t->rows);
    const struct rec_vote_pooled *p = rec_cl_pooled_take(o->p, o->q, &o->to);
    T_OK(rec_cl_wait(o->q));
    return p;
}
static void device_free(struct device *o)
{
    rec_cl_pooled_free(&o->p);
    rec_cl_buffer_free(cl, &o->to.b);
    rec_cl_buffer_free(cl, &o->to.w);
    rec_cl_buffer_free(cl, &o->to.w4);
    rec_cl_buffer_free(cl, &o->to.lit);
    rec_cl_queue_free(&o->q);
}

static void compare(const struct bed *t, rec_vote *a, rec_vote *b, int nch)
{
    struct rec_verdict one, two;
    struct rec_restrictor *r;
    struct device o = {0};
    struct rec_vote_set set = {.channels = nch,
                               .in = &t->in,
                               .lit = t->lit,
                               .present = t->present,
                               .noise = t->noise,
                               .gains = true};
    const struct rec_pictures none = {.per_channel = t->in.per_channel};
    size_t n = a->level->row0[CAMERAS];
    CHECK(rec_restrictor_new(t->S, &r));
    rec_vote_take(a, r, &set, &one);
    set.pooled = pool(&o, t, b);
    set.in = &none;
    set.lit = NULL;
    rec_vote_take(b, r, &set, &two);
    T_OK(memcmp(a->b, b->b, n * sizeof *a->b) == 0);
    T_OK(memcmp(a->use, b->use, n * sizeof *a->use) == 0);
    T_OK(memcmp(a->lit, b->lit, n) == 0);
    T_OK(memcmp(a->of, b->of, sizeof a->of) == 0);
    T_OK(memcmp(&one, &two, sizeof one) == 0);
    for (size_t c = 0; c < CAMERAS; c++) {
        known += a->of[c].measured;
        unknown += a->of[c].unknown;
        dazzled += a->of[c].saturated;
    }
    verdicts |= 1u << one.state;
    rec_restrictor_free(&r);
    device_free(&o);
}

/* A grid whose coarsest bins are 2^shift bins wide. */
static void grid(int32_t voxels, int32_t w, int32_t h, int shift)
{
    struct rec_rig rig;
    struct rec_kernels kernels;
    rec_sysmat *S;
    rec_vote *a, *b;
    CHECK(rec_rig_ring(CAMERAS, 2, w, h, voxels, &rig));
    CHECK(rec_sysmat_build(&rig, &rec_sysmat_defaults, NULL, NULL, NULL, &S, NULL));
    rec_kernels_init(&kernels, PVX_CPU_BEST);
    CHECK(rec_vote_new(S, &kernels, NULL, 0, &a));
    CHECK(rec_vote_new(S, &kernels, NULL, 0, &b));
    T_EQ_I(a->shift, shift);
    for (int kind = 0; kind < 9; kind++) {
        int nch = kind % 3 == 0 ? 1 : 3;
        struct bed t = bed_new(S, nch, kind % 3 == 2);
        compare(&t, a, b, nch);
        bed_free(&t);
    }
    rec_vote_free(&a);
    rec_vote_free(&b);
    rec_sysmat_free(&S);
    rec_rig_fini(&rig);
}

T_CASE(votes_as_the_processor)
{
    grid(16, 61, 47, 0);
    grid(32, 81, 67, 1);
    if (getenv("T_OPENCL") == NULL) /* Oclgrind is slow */
        grid(64, 90, 61, 2);
    T_OK(known > 100 && unknown > 100 && dazzled > 20 && verdicts != 0);
}

T_MAIN((cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
