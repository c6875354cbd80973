/* The restricted system against S itself, entry by entry, and as a pair of operators. */
#include "../scene.h"

static struct scene sc;

/* Every third voxel, and a run. */
static int32_t pick(int32_t *col)
{
    int32_t n = 0;
    for (int32_t i = 0; i < (int32_t)sc.voxels; i++)
        if (i % 3 == 1 || (i > 500 && i < 640))
            col[n++] = i;
    return n;
}

static struct rec_subsys *make(const struct rec_kernels *k, int cs, const int32_t *col, int32_t n,
                               const bool *present)
{
    struct rec_subsys *a = NULL;
    if (rec_subsys_new(sc.S, k, sc.pool, cs, &a) != PVX_OK)
        exit(2);
    rec_subsys_restrict(a, col, n, present);
    return a;
}

/* Whether a row is of a present camera. */
static bool here(const bool *present, uint32_t row)
{
    for (size_t c = 0; c < sc.S->n_cameras; c++)
        if (row >= sc.S->row0[c] && row < sc.S->row0[c + 1])
            return present[c];
    return false;
}

static void entries_are_those_of_S(void)
{
    struct rec_kernels k;
    rec_kernels_init(&k, REC_CPU_ALL);
    int32_t *col = pvx_calloc(sc.voxels, sizeof *col), n = pick(col);
    bool present[REC_MAX_CAMERAS] = {true, false, true, true};
    struct rec_subsys *a = make(&k, 4, col, n, present);
    size_t rows = a->row0[sc.S->n_cameras];
    double *column = pvx_calloc(rows, sizeof *column);
    uint64_t nnz = 0;
    int64_t wrong = 0;
    for (int32_t q = 0; q < n; q++) {
        for (uint32_t e = sc.S->colptr[col[q]]; e < sc.S->colptr[col[q] + 1]; e++)
            if (here(present, sc.S->row[e])) {
                column[sc.S->row[e]] = (float)rec_sysmat_value(sc.S, e);
                nnz++;
            }
        for (uint32_t e = a->by_col.ptr[q]; e < a->by_col.ptr[q + 1]; e++) {
            double *at = &column[a->ray[rec_packed_index(&a->by_col, e)]];
            if (rec_packed_value(&a->by_col, e) == 0)
                continue; /* padding */
            wrong += *at != rec_packed_value(&a->by_col, e);
            *at = 0;
        }
        for (uint32_t e = sc.S->colptr[col[q]]; e < sc.S->colptr[col[q] + 1]; e++)
            wrong += column[sc.S->row[e]] != 0; /* nothing left over */
    }
    T_EQ_I(wrong, 0);
    T_EQ_I(a->nnz, nnz);
    T_EQ_I(a->by_row.ptr[a->rows], nnz);
    for (int32_t i = 0; i < a->rows; i++) { /* no empty row, absent camera's rows are out */
        wrong += a->by_row.ptr[i] == a->by_row.ptr[i + 1];
        wrong += a->ray[i] >= a->row0[1] && a->ray[i] < a->row0[2];
        wrong += i > 0 && a->ray[i] <= a->ray[i - 1];
        for (uint32_t e = a->by_row.ptr[i] + 1; e < a->by_row.ptr[i + 1]; e++)
            wrong += rec_packed_index(&a->by_row, e) <= rec_packed_index(&a->by_row, e - 1);
    }
    T_EQ_I(wrong, 0);
    free(column);
    free(col);
    rec_subsys_free(&a);
}

/* What restrict should give, by its definition. */
static int64_t differences(const struct rec_subsys *a, const int32_t *col, int32_t n,
                           const bool *present)
{
    const rec_sysmat *S = sc.S;
    size_t space = S->row0[S->n_cameras];
    uint32_t *number = pvx_calloc(space, sizeof *number),
             *next = pvx_calloc(space + 1, sizeof *next);
    uint32_t rows = 0, nnz = 0, at = 0;
    int64_t wrong = 0;
    for (int32_t q = 0; q < n; q++)
        for (uint32_t e = S->colptr[col[q]]; e < S->colptr[col[q] + 1]; e++)
            number[S->row[e]] += here(present, S->row[e]);
    for (uint32_t r = 0; r < space; r++) {
        if (number[r] == 0)
            continue;
        if ((int32_t)rows < a->rows)
            wrong += a->ray[rows] != r || a->by_row.ptr[rows] != nnz;
        next[rows] = nnz;
        nnz += number[r];
        number[r] = rows++;
    }
    wrong += a->n != n || a->rows != (int32_t)rows || a->nnz != nnz || a->by_row.ptr[rows] != nnz;
    for (int32_t q = 0; q < n && wrong == 0; q++) {
        wrong += a->by_col.ptr[q] != at;
        for (uint32_t e = S->colptr[col[q]]; e < S->colptr[col[q] + 1]; e++) {
            if (!here(present, S->row[e]))
                continue;
            uint32_t r = number[S->row[e]], k = next[r]++;
            float v = S->unit * (float)S->val[e];
            wrong += rec_packed_index(&a->by_row, k) != (uint32_t)q ||
                     rec_packed_value(&a->by_row, k) != v;
            wrong += rec_packed_index(&a->by_col, at) != r || rec_packed_value(&a->by_col, at) != v;
            at++;
        }
        for (; (at - a->by_col.ptr[q]) % 4 != 0; at++)
            wrong +=
                rec_packed_index(&a->by_col, at) >= rows || rec_packed_value(&a->by_col, at) != 0;
    }
    wrong += a->by_col.ptr[n] != at;
    free(number);
    free(next);
    return wrong;
}

/* Any columns, any cameras, any number of threads, one frame set after the other. */
static void any_restriction(void)
{
    struct rec_kernels k;
    rec_kernels_init(&k, REC_CPU_ALL);
    int32_t *col = pvx_calloc(sc.voxels, sizeof *col);
    for (unsigned threads = 1; threads <= 4; threads++) {
        pvx_pool *pool = NULL;
        struct rec_subsys *a = NULL;
        T_EQ_I(pvx_pool_new(threads, "t", &pool), PVX_OK);
        T_EQ_I(rec_subsys_new(sc.S, &k, pool, 4, &a), PVX_OK);
        for (int trial = 0; trial < 60; trial++) {
            bool present[REC_MAX_CAMERAS];
            uint64_t cameras = trial % 3 == 0 ? 15 : t_rand() % 16;
            for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
                present[c] = cameras >> c & 1;
            double density = trial % 5 == 0 ? 1 : pow(t_uniform(0, 1), 3);
            int32_t n = 0;
            for (int32_t j = 0; j < (int32_t)sc.voxels; j++)
                if (t_uniform(0, 1) < density)
                    col[n++] = j;
            rec_subsys_restrict(a, col, n, present);
            T_EQ_I(differences(a, col, n, present), 0);
        }
        rec_subsys_free(&a);
        pvx_pool_free(&pool);
    }
    free(col);
}

/* |<Ax,y> - <x,A'y>| <= (n_max+2) u sum |a||x||y| twice, by the bound of the kernels. */
static void adjoint(int cs, unsigned mask, bool full)
{
    struct rec_kernels k;
    rec_kernels_init(&k, mask);
    int32_t *col = pvx_calloc(sc.voxels, sizeof *col), n = pick(col);
    bool present[REC_MAX_CAMERAS];
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        present[c] = true;
    if (full)
        for (n = 0; n < (int32_t)sc.voxels; n++)
            col[n] = n;
    struct rec_subsys *a = make(&k, cs, col, n, present);
    size_t w = (size_t)cs;
    float *x = pvx_calloc((size_t)n * w, 4), *y = pvx_calloc((size_t)a->rows * w, 4);
    float *ax = pvx_calloc((size_t)a->rows * w, 4), *aty = pvx_calloc((size_t)n * w, 4);
    for (size_t i = 0; i < (size_t)n * w; i++)
        x[i] = i % w == 3 ? 0 : (float)t_uniform(-1, 1);
    for (size_t i = 0; i < (size_t)a->rows * w; i++)
        y[i] = i % w == 3 ? 0 : (float)t_uniform(-1, 1);
    rec_forward(a, x, ax);
    rec_adjoint(a, y, aty);
    double left[4], right[4], size[4] = {0};
    uint32_t longest = 0;
    rec_dot(a, a->rows, ax, y, left);
    rec_dot(a, n, x, aty, right);
    for (int32_t i = 0; i < a->rows; i++)
        for (uint32_t e = a->by_row.ptr[i]; e < a->by_row.ptr[i + 1]; e++) {
            for (size_t l = 0; l < w; l++)
                size[l] += fabs((double)rec_packed_value(&a->by_row, e) *
                                x[rec_packed_index(&a->by_row, e) * w + l] * y[(size_t)i * w + l]);
            if (a->by_row.ptr[i + 1] - a->by_row.ptr[i] > longest)
                longest = a->by_row.ptr[i + 1] - a->by_row.ptr[i];
        }
    for (int32_t q = 0; q < n; q++)
        if (a->by_col.ptr[q + 1] - a->by_col.ptr[q] > longest)
            longest = a->by_col.ptr[q + 1] - a->by_col.ptr[q];
    for (size_t l = 0; l < w; l++)
        T_NEAR(left[l], right[l], 2 * (longest + 2) * 0x1p-24 * size[l]);
    T_OK(size[0] > 0);
    float *d2 = pvx_calloc((size_t)n, 4), *d1 = pvx_calloc((size_t)n, 4);
    rec_column_norms(a, NULL, d2, d1);
    int32_t q = n / 2;
    double w2 = 0, w1 = 0;
    for (uint32_t e = a->by_col.ptr[q]; e < a->by_col.ptr[q + 1]; e++) {
        w1 += rec_packed_value(&a->by_col, e);
        w2 += (double)rec_packed_value(&a->by_col, e) * rec_packed_value(&a->by_col, e);
    }
    T_NEAR(d1[q], w1, 1e-6 * w1);
    T_NEAR(d2[q], w2, 1e-6 * w2);
    free(d1);
    free(d2);
    free(x);
    free(y);
    free(ax);
    free(aty);
    free(col);
    rec_subsys_free(&a);
}
static void forward_and_adjoint_agree(void)
{
    for (int full = 0; full < 2; full++) {
        adjoint(4, REC_CPU_ALL, full);
        adjoint(1, REC_CPU_ALL, full);
        adjoint(4, 0, full);
        adjoint(1, 0, full);
    }
}

static void nothing_active(void)
{
    struct rec_kernels k;
    rec_kernels_init(&k, REC_CPU_ALL);
    bool present[REC_MAX_CAMERAS] = {true, true, true, true};
    int32_t col[1] = {0};
    struct rec_subsys *a = make(&k, 4, col, 0, present);
    T_EQ_I(a->rows, 0);
    T_EQ_I(a->nnz, 0);
    rec_forward(a, NULL, NULL);
    rec_adjoint(a, NULL, NULL);
    rec_subsys_free(&a);
}

int main(void)
{
    if (!scene_new(&sc, 4, 48, 14, 2, 2))
        return 2;
    T_RUN(entries_are_those_of_S);
    T_RUN(any_restriction);
    T_RUN(forward_and_adjoint_agree);
    T_RUN(nothing_active);
    scene_free(&sc);
    return t_done();
}
