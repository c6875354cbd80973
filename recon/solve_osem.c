/* solve_osem.c - "osem": ordered-subset expectation maximisation.
 *
 *     for s = 1..K, j:  x_j <- x_j / (sum_i w_i A_ij) * sum_i w_i A_ij max(b_i,0) / (A x)_i,
 *                       both sums over i in I_s                                              (1)
 * Source: H. M. Hudson, R. S. Larkin, IEEE Trans. Med. Imag. 13(4):601-609, 1994.
 * I_s are the rows of two or more cameras that follow each other in the rig, K at most 4: with
 * more, a subset says too little about a voxel and the passes over the columns cost more than they
 * bring.  One iteration is one pass over all subsets.  Near the solution of mlem it runs in a
 * circle, wider with more noise, so it is a method for few iterations.  A voxel that a subset does
 * not see keeps its value there.
 * The rows of a subset are consecutive, so their entries are a piece of each column (which ascends
 * by row); the ends of the pieces are found once. */
#include <float.h>

#include "recon/simd/lanes.h"
#include "recon/solve/stop.h"

struct osem {
    struct rec_job *j;
    float *x, *ratio;
    int subsets, now;
    int32_t row[REC_OSEM_SUBSETS + 1];       /* first of each subset */
    uint32_t (*piece)[REC_OSEM_SUBSETS + 1]; /* [n] first entry of each subset */
    float *sens[REC_OSEM_SUBSETS];           /* [n] column sums of W A over a subset */
};

/* Cameras that have rows, dealt evenly in their order. */
static void choose_subsets(struct osem *t)
{
    const struct rec_subsys *a = t->j->a;
    int32_t first[REC_MAX_CAMERAS + 1], n = 0, at = 0;
    for (size_t c = 0; c < a->S->n_cameras; c++) {
        int32_t from = at;
        while (at < a->rows && a->ray[at] < a->row0[c + 1])
            at++;
        first[n] = from;
        n += at > from;
    }
    first[n] = a->rows;
    t->subsets = n / 2 < 1 ? 1 : n / 2 < REC_OSEM_SUBSETS ? n / 2 : REC_OSEM_SUBSETS;
    for (int s = 0; s <= t->subsets; s++)
        t->row[s] = first[s * n / t->subsets];
}

static void pieces_chunk(void *ctx, size_t k)
{
    struct osem *t = ctx;
    const struct rec_packed *g = &t->j->a->by_col;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        uint32_t e = g->ptr[q];
        double all = 0;
        for (int s = 0; s < t->subsets; s++) {
            double sum = 0;
            t->piece[q][s] = e;
            for (; e < g->ptr[q + 1] && rec_packed_index(g, e) < (uint32_t)t->row[s + 1]; e++)
                sum += (double)t->j->w[rec_packed_index(g, e)] * rec_packed_value(g, e);
            t->sens[s][q] = (float)sum;
            all += sum;
        }
        t->piece[q][t->subsets] = e;
        t->j->s->diag[q] = (float)all;
    }
}

/* Chunks of the rows of subset `now` are counted from its first row. */
REC_INLINE void rows_pass(struct osem *t, size_t k, size_t cs)
{
    int32_t i0, i1, from = t->row[t->now];
    rec_f4 zero = {0}, huge = rec_splat(FLT_MAX);
    rec_chunk_range(t->row[t->now + 1] - from, k, &i0, &i1);
    rec_forward_range(t->j->a, t->x, from + i0, from + i1, t->ratio);
    for (size_t i = (size_t)(from + i0); i < (size_t)(from + i1); i++) {
        rec_f4 ax = rec_ld(t->ratio, i, cs), b = rec_ld(t->j->b, i, cs);
        rec_f4 v = rec_splat(t->j->w[i]) * rec_select(b > 0, b, zero) / ax;
        rec_st(t->ratio, i, cs, rec_select((ax > 0) & (v <= huge), v, zero));
    }
}
static void rows_chunk(void *ctx, size_t k)
{
    struct osem *t = ctx;
    t->j->a->cs == 4 ? rows_pass(t, k, 4) : rows_pass(t, k, 1);
}

REC_INLINE void columns_pass(struct osem *t, size_t k, size_t cs)
{
    const struct rec_packed *g = &t->j->a->by_col;
    const float *sens = t->sens[t->now];
    int32_t q0, q1;
    rec_f4 zero = {0}, huge = rec_splat(FLT_MAX);
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    for (size_t q = (size_t)q0; q < (size_t)q1; q++) {
        rec_f4 up = {0}, x = rec_ld(t->x, q, cs);
        for (uint32_t e = t->piece[q][t->now]; e < t->piece[q][t->now + 1]; e++)
            up += rec_splat(rec_packed_value(g, e)) * rec_ld(t->ratio, rec_packed_index(g, e), cs);
        if (!(sens[q] > 0))
            continue;
        x *= up / rec_splat(sens[q]);
        rec_st(t->x, q, cs, rec_select((x > 0) & (x <= huge), x, zero));
    }
}
static void columns_chunk(void *ctx, size_t k)
{
    struct osem *t = ctx;
    t->j->a->cs == 4 ? columns_pass(t, k, 4) : columns_pass(t, k, 1);
}

void rec_solve_osem(struct rec_job *j)
{
    static const struct rec_stop_own own = {.most = 10, .blind = 2, .stall = 0.08};
    rec_solver *s = j->s;
    struct osem t = {.j = j, .x = j->x, .ratio = s->yv[0], .piece = s->piece};
    struct rec_stopper stop;
    double rr[4];
    for (int i = 0; i < REC_OSEM_SUBSETS; i++)
        t.sens[i] = s->xv[i];

    choose_subsets(&t);
    pvx_pool_run(j->a->pool, rec_job_chunks(j), pieces_chunk, &t);
    rec_positive_start(j, s->diag, t.x);
    rec_stop_begin(&stop, j, &own, s->xv[REC_OSEM_SUBSETS], s->xv[REC_OSEM_SUBSETS + 1]);
    while (rec_stop_next(&stop)) {
        for (t.now = 0; t.now < t.subsets; t.now++) {
            size_t rows = rec_chunks(t.row[t.now + 1] - t.row[t.now]);
            pvx_pool_run(j->a->pool, rows, rows_chunk, &t);
            pvx_pool_run(j->a->pool, rec_job_chunks(j), columns_chunk, &t);
        }
        rec_job_residual(j, t.x, t.ratio, s->yv[1], rr);
        if (rec_stop_after(&stop, t.x, 0, rec_lanes_total(rr)))
            break;
    }
    rec_stop_end(&stop, j->x);
}
