/* osem.c - "osem": ordered-subset expectation maximisation.
 *
 *     for s = 1..K, j:  x_j <- x_j / (sum_i w_i A_ij) * sum_i w_i A_ij max(b_i,0) / (A x)_i,
 *                       both sums over i in I_s                                              (1)
 * Source: H. M. Hudson, R. S. Larkin, IEEE Trans. Med. Imag. 13(4):601-609, 1994.
 * I_s are the rows of two or more cameras that follow each other in the rig, K at most 4: with
 * more, a subset holds too little information about a voxel, and the passes over the columns cost more
 * than they gain.  One iteration is one pass over all subsets.  Near the solution of mlem it runs in a
 * circle, wider with more noise, so it is a method for few iterations.  A voxel that a subset does
 * not see keeps its value there. */
#include <float.h>

#include "recon/simd/lanes.h"
#include "recon/solve/stop.h"

struct osem {
    rec_problem *pb;
    float *x, *up, *ratio;
    int subsets, now;
    struct rec_cameras of[REC_OSEM_SUBSETS];
    struct rec_block_range
        blocks[REC_OSEM_SUBSETS];  /* those of a subset; neighbours may share one */
    float *sens[REC_OSEM_SUBSETS]; /* [n] column sums of W A over a subset */
};

/* First block that begins at row `row` or covers it. */
static int32_t block_of(const struct rec_subsys *a, size_t row)
{
    int32_t lo = 0, hi = a->n_blocks;
    while (lo < hi) {
        int32_t mid = lo + (hi - lo) / 2;
        if ((a->block[mid] + (size_t)1) * REC_ROW_BLOCK <= row)
            lo = mid + 1;
        else
            hi = mid;
    }
    return lo;
}

static bool has_rows(const struct rec_subsys *a, size_t c)
{
    struct rec_block_range r = {block_of(a, a->row0[c]), block_of(a, a->row0[c + 1])};
    r.end += r.end < a->n_blocks; /* it may share the last with the next */
    REC_FOR_BLOCK_ROWS (i, a, r)
        if (i >= a->row0[c] && i < a->row0[c + 1] && a->is_row[i])
            return true;
    return false;
}

/* Cameras that have rows, dealt evenly in their order. */
static void choose_subsets(struct osem *t)
{
    const struct rec_subsys *a = t->pb->a;
    int32_t first[REC_MAX_CAMERAS + 1], n = 0;
    for (size_t c = 0; c < a->S->n_cameras; c++)
        if (has_rows(a, c))
            first[n++] = (int32_t)c;
    first[n] = (int32_t)a->S->n_cameras;
    t->subsets = n / 2 < 1 ? 1 : n / 2 < REC_OSEM_SUBSETS ? n / 2 : REC_OSEM_SUBSETS;
    for (int s = 0; s < t->subsets; s++) {
        struct rec_cameras *of = &t->of[s];
        *of = (struct rec_cameras){first[s * n / t->subsets], first[(s + 1) * n / t->subsets]};
        t->blocks[s].at = block_of(a, a->row0[of->c0]);
        t->blocks[s].end = block_of(a, a->row0[of->c1]);
        t->blocks[s].end += t->blocks[s].end < a->n_blocks;
    }
}

/* A'w of each subset, and of all. */
static void sensitivities(struct osem *t)
{
    const rec_problem *pb = t->pb;
    for (int s = 0; s < t->subsets; s++)
        rec_column_sums_cameras(pb->a, t->of[s], pb->w, t->sens[s]);
    for (int32_t q = 0; q < pb->a->n; q++) {
        double all = 0;
        for (int s = 0; s < t->subsets; s++)
            all += (double)t->sens[s][q];
        pb->column[q] = (float)all;
    }
}

/* Chunks of the blocks of subset `now`. */
REC_INLINE void osem_rows_pass(struct osem *t, size_t k, size_t cs)
{
    rec_problem *pb = t->pb;
    struct rec_block_range all = t->blocks[t->now], r;
    rec_f4 zero = {0}, huge = rec_splat(FLT_MAX);
    rec_chunk_range(all.end - all.at, k, &r.at, &r.end);
    r = (struct rec_block_range){all.at + r.at, all.at + r.end};
    rec_collect(pb->a, &pb->images, r, t->ratio);
    REC_FOR_BLOCK_ROWS (i, pb->a, r) {
        rec_f4 ax = rec_ld(t->ratio, i, cs), b = rec_ld(pb->b, i, cs);
        rec_f4 v = rec_splat(pb->w[i]) * rec_select(b > 0, b, zero) / ax;
        rec_st(t->ratio, i, cs, rec_select((ax > 0) & (v <= huge), v, zero));
    }
}
static void osem_rows_chunk(void *ctx, size_t k)
{
    struct osem *t = ctx;
    t->pb->cs == 4 ? osem_rows_pass(t, k, 4) : osem_rows_pass(t, k, 1);
}

REC_INLINE void osem_columns_pass(struct osem *t, size_t k, size_t cs)
{
    const float *sens = t->sens[t->now];
    int32_t q0, q1;
    rec_f4 zero = {0}, huge = rec_splat(FLT_MAX);
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    rec_adjoint_cameras(t->pb->a, t->of[t->now], t->ratio, q0, q1, t->up);
    for (size_t q = (size_t)q0; q < (size_t)q1; q++) {
        rec_f4 up = rec_ld(t->up, q, cs), x = rec_ld(t->x, q, cs);
        if (!(sens[q] > 0))
            continue;
        x *= up / rec_splat(sens[q]);
        rec_st(t->x, q, cs, rec_select((x > 0) & (x <= huge), x, zero));
    }
}
static void osem_columns_chunk(void *ctx, size_t k)
{
    struct osem *t = ctx;
    t->pb->cs == 4 ? osem_columns_pass(t, k, 4) : osem_columns_pass(t, k, 1);
}

void rec_solve_osem(rec_problem *pb, const struct rec_solve_params *p, float *x,
                    struct rec_solve_report *out)
{
    static const struct rec_stop_own own = {.most = 10, .blind = 2, .stall = 0.08};
    struct osem t = {.pb = pb, .x = x, .up = pb->xv[REC_OSEM_SUBSETS], .ratio = pb->yv[0]};
    pvx_pool *pool = pb->a->pool;
    size_t chunks = rec_column_chunks(pb);
    struct rec_stopper stop;
    double rr[4];
    for (int i = 0; i < REC_OSEM_SUBSETS; i++)
        t.sens[i] = pb->xv[i];

    choose_subsets(&t);
    sensitivities(&t); /* A'w, of each subset and in all */
    rec_start_positive(pb, pb->column, x);
    rec_stop_begin(&stop, pb, &own, p, out);
    while (rec_stop_next(&stop)) {
        for (t.now = 0; t.now < t.subsets; t.now++) {
            size_t rows = rec_chunks(t.blocks[t.now].end - t.blocks[t.now].at);
            rec_scatter_cameras(pb->a, &pb->images, t.of[t.now], x);
            pvx_pool_run(pool, rows, osem_rows_chunk, &t); /* ratio = w b / A x, of the subset */
            pvx_pool_run(pool, chunks, osem_columns_chunk, &t); /* x *= A'ratio / A'w */
        }
        rec_residual(pb, x, t.ratio, pb->yv[1], rr); /* r = A x - b */
        if (rec_stop_after(&stop, x, 0, rec_lanes_total(rr)))
            break;
    }
    rec_stop_end(&stop, x);
}
