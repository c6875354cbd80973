/* card_pair.h - a frame set solved on a device and on the processors, and compared.
 *
 * Hull, columns, counts and decisions must be equal.  The volumes x differ by rounding: NUMERICS.md, "On a graphics
 * card", derives
 *     ||W^(1/2) A (x' - x)|| <= 8 K (sqrt(m) u ||W^(1/2) b|| + m 2^-149 sqrt(M))                    (1)
 * M: measured values, u = 2^-24, m: the number of terms of the longest sum, K: iterations and renewals on all grids, and
 * their starts. */
#ifndef TESTS_CARD_PAIR_H
#define TESTS_CARD_PAIR_H
#include "recon/opencl/impl.h"
#include "recon/opencl/matrix.h"
#include "recon/frame/impl.h"
#include "recon/solve/impl.h"
#include "tests/lib/cl_bed.h"
#include "tests/lib/entries.h"

struct card_pair {
    rec_frame *here, *there;
    struct rec_images images;
    int wrong; /* what was not as it should be; each is printed */
    /* Of the pairs that were compared: largest share of (1), largest ||x' - x|| / ||x||. */
    double worst, moved;
};

#define PAIR_OK(p, ok, ...)      \
    do {                         \
        if (!(ok)) {             \
            (p)->wrong++;        \
            printf("  card: ");  \
            printf(__VA_ARGS__); \
            printf("\n");        \
        }                        \
    } while (0)
#define PAIR_EQ(p, there, here)                                                       \
    PAIR_OK(p, (there) == (here), "%s = %lld, here %lld", #there, (long long)(there), \
            (long long)(here))

static inline void card_pair_new(struct card_pair *p, rec_cl *cl, const rec_sysmat *S,
                                 const struct rec_rig *rig, struct rec_frame_params f,
                                 pvx_pool *pool)
{
    struct pvx_diag d = {""};
    *p = (struct card_pair){0};
    f.card = NULL;
    pvx_err e = rec_frame_alone(S, rig, &f, pool, &p->here, &d);
    f.card = cl;
    PVX_THEN(e, rec_frame_alone(S, rig, &f, pool, &p->there, &d));
    PVX_THEN(e, rec_images_new(S, f.nch == 3 ? 4 : 1, &p->images));
    if (e == PVX_OK)
        return;
    printf("FAIL %s: %s\n", pvx_strerror(e), d.text);
    exit(1);
}
static inline void card_pair_free(struct card_pair *p)
{
    rec_frame_free(&p->here);
    rec_frame_free(&p->there);
    rec_images_free(&p->images);
}

/* What the frame here was given, before it is carved. */
static inline void card_pair_copy(struct card_pair *p)
{
    const rec_frame *from = p->here;
    rec_frame_reset(p->there);
    memcpy(p->there->b, from->b, from->rows * (size_t)from->cs * sizeof *from->b);
    memcpy(p->there->camera, from->camera, sizeof from->camera);
}

/* m of (1): the terms of the longest row or column, and as many partial sums. */
static inline double card_pair_terms(const struct rec_subsys *a)
{
    struct entries e = entries_of_system(a), t = entries_by_row(&e, a->S->win.room);
    uint32_t most = REC_SLABS_MAX;
    for (size_t j = 0; j < e.n; j++)
        most = e.colptr[j + 1] - e.colptr[j] > most ? e.colptr[j + 1] - e.colptr[j] : most;
    for (size_t i = 0; i < t.n; i++)
        most = t.colptr[i + 1] - t.colptr[i] > most ? t.colptr[i + 1] - t.colptr[i] : most;
    entries_free(&e);
    entries_free(&t);
    return 2.0 * most;
}

/* ||W^(1/2) v||^2 over A's rows. */
static inline double card_pair_norm2(const rec_frame *f, const float *v)
{
    double sum = 0;
    size_t cs = (size_t)f->cs;
    REC_FOR_BLOCK_ROWS (i, f->sub, ((struct rec_block_range){0, f->sub->n_blocks}))
        for (size_t l = 0; l < cs && f->sub->is_row[i]; l++) {
            double w = (double)(f->per_channel ? f->weight4[i * 4 + l] : f->weight[i]);
            sum += w * (double)v[i * cs + l] * (double)v[i * cs + l];
        }
    return sum;
}

/* (1); K: iterations. */
static inline void card_pair_volumes(struct card_pair *p, double K)
{
    const rec_frame *f = p->here;
    const struct rec_subsys *a = f->sub;
    size_t n = (size_t)a->n * (size_t)f->cs;
    double m = card_pair_terms(a), u = 0x1p-24, off = 0, size = 0;
    float *d = pvx_calloc(n + 1, sizeof *d);
    float *y = pvx_calloc(a->S->win.room * (size_t)f->cs, sizeof *y);
    for (size_t i = 0; i < n; i++) {
        d[i] = p->there->x[i] - f->x[i];
        off += (double)d[i] * (double)d[i];
        size += (double)f->x[i] * (double)f->x[i];
        PAIR_OK(p, p->there->x[i] >= 0, "voxel %zu is %g", i, (double)p->there->x[i]);
    }
    rec_forward(a, &p->images, d, y);
    double got = sqrt(card_pair_norm2(f, y)), b = sqrt(card_pair_norm2(f, f->b));
    double bound = 8 * K * (sqrt(m) * u * b + m * 0x1p-149 * sqrt((double)a->rows * f->nch));
    PAIR_OK(p, got <= bound, "the volumes' pictures differ by %g, more than %g", got, bound);
    p->worst = bound > 0 && got / bound > p->worst ? got / bound : p->worst;
    p->moved = size > 0 && sqrt(off / size) > p->moved ? sqrt(off / size) : p->moved;
    free(d);
    free(y);
}

/* Both reports; returns K. */
static inline double card_pair_reports(struct card_pair *p, const struct rec_frame_report *h,
                                       const struct rec_frame_report *t)
{
    PAIR_OK(p, memcmp(&h->hull, &t->hull, sizeof h->hull) == 0, "another hull");
    PAIR_EQ(p, t->active_voxels, h->active_voxels);
    PAIR_EQ(p, t->active_rays, h->active_rays);
    PAIR_EQ(p, t->entries, h->entries);
    PAIR_EQ(p, t->cameras, h->cameras);
    PAIR_EQ(p, t->vote.out, h->vote.out);
    PAIR_EQ(p, t->warm, h->warm);
    PAIR_EQ(p, t->coarse_iterations, h->coarse_iterations);
    PAIR_EQ(p, t->solve.status, h->solve.status);
    PAIR_EQ(p, t->solve.iterations, h->solve.iterations);
    PAIR_EQ(p, t->solve.blended, h->solve.blended);
    PAIR_EQ(p, t->solve.renewals, h->solve.renewals);
    PAIR_EQ(p, t->selfcal.gain, h->selfcal.gain);
    PAIR_EQ(p, t->selfcal.shift, h->selfcal.shift);
    double starts = 2 * REC_CL_LEVELS; /* the start and at most one renewal of each grid */
    return starts + h->coarse_iterations + h->solve.iterations + h->solve.renewals;
}

/* Carves and solves both, whose pictures are the same, and compares. */
static inline void card_pair_solve(struct card_pair *p, const struct rec_sparse *before_here,
                                   const struct rec_sparse *before_there)
{
    rec_frame *h = p->here, *t = p->there;
    rec_frame_carve(h);
    rec_frame_carve(t);
    PAIR_OK(p, t->sub->card != NULL, "carved here: %s", t->report.why_here);
    PAIR_EQ(p, rec_frame_solve(t, 0, before_there), rec_frame_solve(h, 0, before_here));
    PAIR_OK(p, t->report.on_card && t->report.why_here[0] == '\0', "solved here: %s",
            t->report.why_here);
    PAIR_OK(p, !h->report.on_card && h->report.why_here[0] == '\0', "why here? %s",
            h->report.why_here);
    double K = card_pair_reports(p, &h->report, &t->report);
    bool same = t->report.active_voxels == h->report.active_voxels &&
                memcmp(h->col, t->col, (size_t)h->report.active_voxels * sizeof *h->col) == 0;
    PAIR_OK(p, same, "other columns");
    if (same)
        card_pair_volumes(p, K);
}

/* The same, with the pictures of the frame here. */
static inline void card_pair_take(struct card_pair *p, const struct rec_sparse *before_here,
                                  const struct rec_sparse *before_there)
{
    card_pair_copy(p);
    card_pair_solve(p, before_here, before_there);
}

#endif
