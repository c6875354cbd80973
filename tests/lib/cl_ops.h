/* cl_ops.h - the bed of tests/unit/test_cl_ops_*.c: one carved frame set and its problem, here and on a device, with the
 * vectors of a solve filled alike and compared.  Vectors that do not come from a product are the same to the bit, sums to
 * their rounding. */
#ifndef TESTS_CL_OPS_H
#define TESTS_CL_OPS_H
#include "recon/opencl/ops.h"
#include "recon/solve/card.h"
#include "tests/lib/cl_bed.h"
#include "tests/lib/scene.h"
#include "tests/lib/slot.h"

#define EPS 0x1p-53
enum { HERE, THERE };
enum way { GREY, COLOUR, MOSAIC };

static rec_cl *cl;

/* Voxels along a grid without coarser ones, on a simulated device, else with them. */
static inline int32_t small(void)
{
    return cl_bed_is_simulated() ? 8 : 32;
}

/* One carved set, here and on the device, and a problem of each. */
struct bed {
    struct scene s;
    rec_frame *f;
    struct rec_pictures in;
    rec_cl_matrix *m;
    rec_cl_system *y;
    rec_cl_solver *v;
    struct rec_subsys *sub;
    rec_levels *levels;
    int32_t *col;
    struct rec_descent descent;
    rec_problem *pb[2];
    struct rec_pcg t[2];
    struct rec_pcg_passes table;
    bool *row; /* bins that are rows */
    size_t n, room, cs;
};

/* The vectors of a solve, by their places. */
enum of { COLUMN, COLUMN_ONE, BIN, BIN_ONE, BIN_FOUR };
static const struct vector {
    const char *name;
    enum of of;
    bool in_problem;
    size_t at;
} vectors[] = {
#define OF_PCG(name, of)                                 \
    {                                                    \
#name, of, false, offsetof(struct rec_pcg, name) \
    }
#define OF_PROBLEM(name, of)                         \
    {                                                \
#name, of, true, offsetof(rec_problem, name) \
    }
    OF_PCG(x, COLUMN),
    OF_PCG(next, COLUMN),
    OF_PCG(phi, COLUMN),
    OF_PCG(phi_old, COLUMN),
    OF_PCG(d, COLUMN),
    OF_PCG(lx, COLUMN),
    OF_PCG(ar, COLUMN),
    OF_PCG(scale, COLUMN),
    OF_PCG(stiff.by, COLUMN_ONE),
    OF_PCG(stiff.inverse, COLUMN_ONE),
    OF_PCG(stiff.diag, COLUMN_ONE),
    OF_PCG(smooth.diag2, COLUMN_ONE),
    OF_PCG(r, BIN),
    OF_PCG(q, BIN),
    OF_PROBLEM(column, COLUMN_ONE),
    OF_PROBLEM(b, BIN),
    OF_PROBLEM(w, BIN_ONE),
    OF_PROBLEM(w4, BIN_FOUR),
};
enum { N_VECTORS = sizeof vectors / sizeof *vectors };

static inline float *vector_of(struct rec_pcg *t, const struct vector *v)
{
    return *(float **)((v->in_problem ? (char *)t->pb : (char *)t) + v->at);
}
static inline bool is_there(const struct bed *b, const struct vector *v)
{
    return v->of != BIN_FOUR || b->in.per_channel;
}
static inline size_t floats_of(const struct bed *b, const struct vector *v)
{
    return v->of == COLUMN       ? b->n * b->cs
           : v->of == COLUMN_ONE ? b->n
           : v->of == BIN        ? b->room * b->cs
                                 : b->room * (v->of == BIN_FOUR ? 4 : 1);
}

/* ---- up and down ---------------------------------------------------------------------------------*/

static inline void up(struct bed *b, const float *name, const float *from, size_t floats)
{
    rec_cl_upload(b->v->queue, rec_cl_twin_of(b->v, name), 0, from, floats * sizeof *from);
}
static inline float *down(struct bed *b, const float *name, size_t floats)
{
    float *to = pvx_calloc(floats, sizeof *to);
    rec_cl_download(b->v->queue, rec_cl_twin_of(b->v, name), 0, to, floats * sizeof *to);
    T_OK(rec_cl_wait(b->v->queue));
    return to;
}

/* Compares floats that are rows, or all. */
static inline void same_floats(const struct bed *b, const char *what, const char *name,
                               const float *want, const float *got, size_t floats,
                               size_t lanes_of_bin)
{
    size_t wrong = 0, first = 0;
    for (size_t i = floats; i-- > 0;)
        if (want[i] != got[i] && (lanes_of_bin == 0 || b->row[i / lanes_of_bin])) {
            wrong++;
            first = i;
        }
    T_CHECK_(wrong == 0, "%s: %zu of %zu floats of %s differ, first %zu: %.9g, here %.9g", what,
             wrong, floats, name, first, (double)got[first], (double)want[first]);
}
static inline void same(struct bed *b, const char *what, const struct vector *v)
{
    float *got = down(b, vector_of(&b->t[THERE], v), floats_of(b, v));
    size_t lanes = v->of == BIN ? b->cs : v->of == BIN_ONE ? 1 : v->of == BIN_FOUR ? 4 : 0;
    same_floats(b, what, v->name, vector_of(&b->t[HERE], v), got, floats_of(b, v), lanes);
    free(got);
}
/* All but the vectors in `but`, bit by bit of their numbers. */
static inline void all_same(struct bed *b, const char *what, unsigned but)
{
    for (unsigned i = 0; i < N_VECTORS; i++)
        if (is_there(b, &vectors[i]) && (but >> i & 1) == 0)
            same(b, what, &vectors[i]);
}
static inline unsigned number_of(const char *name)
{
    unsigned i = 0;
    while (strcmp(vectors[i].name, name) != 0)
        i++;
    return i;
}
#define BUT(name) (1u << number_of(name))

/* What is on the device of a vector comes here. */
static inline void take(struct bed *b, const char *name)
{
    const struct vector *v = &vectors[number_of(name)];
    float *got = down(b, vector_of(&b->t[THERE], v), floats_of(b, v));
    memcpy(vector_of(&b->t[HERE], v), got, floats_of(b, v) * sizeof *got);
    free(got);
}

/* Sums of n terms each, all of one sign: `size` is NULL; else the sums of their sizes. */
static inline void same_sums(const struct bed *b, const char *what, size_t n, const double here[4],
                             const double there[4], const double *size)
{
    for (size_t l = 0; l < 4; l++) {
        double bound = 2 * (double)n * EPS * (size != NULL ? size[l] : fabs(here[l]));
        T_CHECK_(fabs(here[l] - there[l]) <= bound, "%s: lane %zu: sum %.17g, here %.17g +- %g",
                 what, l, there[l], here[l], bound);
        T_CHECK_(l < b->cs || there[l] == 0, "%s: lane %zu", what, l);
    }
}
/* Sums over columns of |u v|, v NULL: of |u|. */
static inline void sizes(const struct bed *b, const float *u, const float *v, double out[4])
{
    memset(out, 0, sizeof(double[4]));
    for (size_t i = 0; i < b->n * b->cs; i++)
        out[i % b->cs] += fabs((double)u[i] * (v != NULL ? (double)v[i] : 1));
}

/* ---- beds ----------------------------------------------------------------------------------------*/

/* Some bins have no weight, some a little, and so have channels of a mosaic. */
static inline void bed_weights(struct bed *b)
{
    rec_frame *f = b->f;
    for (size_t i = 0; i < f->rows; i++) {
        f->weight[i] *= i % 97 == 0 ? 0 : i % 5 == 0 ? (float)t_uniform(0.1, 0.9) : 1;
        for (size_t l = 0; l < 4 && f->per_channel; l++)
            f->weight4[i * 4 + l] *= i % 101 == 0 ? 0 : (float)t_uniform(0.1, 1);
    }
}

static inline void bed_carve(struct bed *b)
{
    rec_frame *f = b->f;
    const uint8_t *lit[REC_MAX_CAMERAS];
    struct rec_hull_kept kept = {.col = b->col};
    bool too_many;
    for (size_t c = 0; c < b->s.rig.n_cameras; c++)
        lit[c] = rec_frame_lit(f, c);
    const struct rec_cl_carving in = {.hull = &f->carver->p.hull,
                                      .lit = lit,
                                      .present = f->believed,
                                      .in = &b->in,
                                      .weight = f->weight};
    T_OK(rec_cl_carve(b->y, &in, &kept, b->sub, &too_many));
    if (b->levels != NULL) {
        rec_levels_restrict(b->levels, f->carver->restrictor, b->sub, &b->in);
        rec_levels_restrict(f->levels, f->carver->restrictor, f->sub, &b->in);
    }
    rec_cl_solver_begin(b->v, b->y);
    T_EQ_I(b->sub->n, f->sub->n);
    T_OK(memcmp(b->col, f->col, (size_t)f->sub->n * sizeof *f->col) == 0);
}

static inline struct rec_pcg bed_pcg(const struct bed *b, rec_problem *pb, float *x)
{
    struct rec_pcg t = rec_pcg_of(pb, x, &b->table);
    rec_smooth_init(&t.smooth, &pb->a->S->grid);
    return t;
}

static inline void bed_new(struct bed *b, int32_t grid, enum way way)
{
    memset(b, 0, sizeof *b);
    struct pvx_diag d = {""};
    struct rec_frame_params p = rec_frame_defaults;
    int nch = p.nch = way == GREY ? 1 : 3;
    scene_new(&b->s, cl_bed_is_simulated() && grid > small() ? 3 : 6,
              cl_bed_is_simulated() ? 19 : grid + 11, grid, 1, 2);
    T_EQ_I(rec_frame_alone(b->s.S, &b->s.rig, &p, b->s.pool, &b->f, NULL), PVX_OK);
    rec_frame *f = b->f;
    b->cs = (size_t)f->cs;
    rec_frame_reset(f);
    for (size_t c = 0; c < b->s.rig.n_cameras; c++) {
        size_t n = b->s.S->row0[c + 1] - b->s.S->row0[c];
        for (size_t i = 0; i < n * b->cs; i++)
            rec_frame_input(f, c)[i] =
                b->s.image[c][i / b->cs * 4 + i % b->cs] + (float)(0.01 * t_normal());
        rec_frame_camera(f, c)->present = c != 2;
    }
    if (way == MOSAIC)
        scene_filter(&b->s, f);
    rec_frame_carve(f);
    bed_weights(b);
    b->in = slot_pictures(f, 0.01);
    T_EQ_I(b->in.per_channel, way == MOSAIC);
    b->n = (size_t)f->sub->n;
    b->room = f->solver->problem->room;
    b->col = pvx_calloc(b->s.voxels, sizeof *b->col);
    b->pb[HERE] = f->solver->problem;
    T_EQ_I(rec_problem_new(b->s.S, nch, &b->pb[THERE]), PVX_OK);
    if (b->s.S->coarse != NULL)
        T_EQ_I(rec_descent_init(&b->descent, b->s.S, nch), PVX_OK);
    T_EQ_I(rec_subsys_new(b->s.S, &f->carver->kernels, b->s.pool, f->cs, &b->sub), PVX_OK);
    T_EQ_I(rec_levels_new(b->s.S, &f->carver->kernels, b->s.pool, f->cs, &b->levels), PVX_OK);
    T_EQ_I(rec_cl_matrix_new(cl, b->s.S, &b->m, &d), PVX_OK);
    T_EQ_I(rec_cl_system_new(b->m, f->cs, b->s.voxels, &b->y, &d), PVX_OK);
    T_EQ_I(rec_cl_solver_new(b->m, f->cs, b->s.voxels, b->pb[THERE],
                             b->levels != NULL ? &b->descent : NULL, &b->v, &d),
           PVX_OK);
    bed_carve(b);
    b->row = pvx_calloc(b->room, sizeof *b->row);
    for (size_t k = 0; k < rec_row_pieces(f->sub); k++)
        REC_FOR_ROWS (i, f->sub, k)
            b->row[i] = f->sub->is_row[i] != 0;
    rec_pcg_passes_init(&b->table, PVX_CPU_BEST);
    T_OK(rec_problem_load(b->pb[HERE], f->sub, &b->in));
    T_OK(rec_problem_load(b->pb[THERE], b->sub, &b->in));
    b->t[HERE] = bed_pcg(b, b->pb[HERE], f->x);
    b->t[THERE] = bed_pcg(b, b->pb[THERE], rec_cl_solver_x(b->v));
}

static inline void bed_free(struct bed *b)
{
    rec_cl_solver_free(&b->v);
    rec_cl_system_free(&b->y);
    rec_cl_matrix_free(&b->m);
    rec_levels_free(&b->levels);
    rec_subsys_free(&b->sub);
    rec_descent_fini(&b->descent);
    rec_problem_free(&b->pb[THERE]);
    rec_frame_free(&b->f);
    free(b->col);
    free(b->row);
    scene_free(&b->s);
}

/* Any state of an iteration: half of x at the bound, steps that clip, a lane that stands still, columns without a
 * diagonal.  Lanes that are not there are 0. */
static inline void bed_fill(struct bed *b)
{
    for (unsigned i = 0; i < N_VECTORS; i++) {
        const struct vector *v = &vectors[i];
        float *to = vector_of(&b->t[HERE], v);
        if (!is_there(b, v) || (v->in_problem && v->of != COLUMN_ONE))
            continue;
        for (size_t k = 0; k < floats_of(b, v); k++) {
            bool none = b->cs == 4 && (v->of == COLUMN || v->of == BIN) && k % 4 == 3;
            double u = v->of == COLUMN_ONE ? t_uniform(0.1, 2) : t_uniform(-1, 1);
            to[k] = none || (v->of == BIN && !b->row[k / b->cs]) ? 0 : (float)u;
        }
    }
    for (size_t i = 0; i < b->n * b->cs; i++)
        b->t[HERE].x[i] = fmaxf(b->t[HERE].x[i], 0);
    for (size_t q = 0; q < b->n; q++) {
        b->t[HERE].stiff.by[q] = 1 / b->t[HERE].stiff.inverse[q];
        b->pb[HERE]->column[q] *= q % 9 != 8;
    }
    for (unsigned i = 0; i < N_VECTORS; i++)
        if (is_there(b, &vectors[i]))
            up(b, vector_of(&b->t[THERE], &vectors[i]), vector_of(&b->t[HERE], &vectors[i]),
               floats_of(b, &vectors[i]));
    struct rec_pcg *t = &b->t[HERE];
    for (int l = 0; l < 4; l++) {
        t->alpha[l] = l == 1 ? 0 : t_uniform(0.1, 3);
        t->beta[l] = t_uniform(0, 1);
        t->mu[l] = t_uniform(0, 1);
        t->back[l] = t_uniform(0, 1);
        t->lambda[l] = l == 2 ? 0 : t_uniform(0, 2);
        b->pb[HERE]->share[l] = b->pb[THERE]->share[l] = t_uniform(0.2, 1);
    }
    t->usual = t_uniform(0.1, 1);
    for (int i = 0; i < 2; i++)
        b->pb[i]->diag = b->pb[i]->column;
    struct rec_pcg *to = &b->t[THERE];
    memcpy(to->alpha, t->alpha, sizeof t->alpha);
    memcpy(to->beta, t->beta, sizeof t->beta);
    memcpy(to->mu, t->mu, sizeof t->mu);
    memcpy(to->back, t->back, sizeof t->back);
    memcpy(to->lambda, t->lambda, sizeof t->lambda);
    to->usual = t->usual;
}

/* ---- passes and products -------------------------------------------------------------------------*/

struct sums {
    double of[2][3][4];
};
static inline struct sums run(struct bed *b, enum rec_pcg_pass which)
{
    struct sums s = {{{{0}}}};
    for (int i = 0; i < 2; i++)
        rec_pcg_pass(&b->t[i], which, s.of[i]);
    return s;
}

/* size: |A||u| in rows, or |A'||u|, as the processor has it.  Each sum of so many terms rounds as often. */
static inline void near_product(const struct bed *b, const char *what, bool rows, const float *here,
                                const float *there, const float *size)
{
    size_t floats = (rows ? b->room : b->n) * b->cs, terms = rows ? b->n : 64 * b->s.rig.n_cameras;
    double worst = 0;
    size_t at = 0;
    for (size_t i = 0; i < floats; i++) {
        double off = fabs((double)here[i] - (double)there[i]);
        if (rows && !b->row[i / b->cs])
            continue;
        if (off > worst * (double)size[i]) {
            worst = size[i] > 0 ? off / (double)size[i] : INFINITY;
            at = i;
        }
    }
    T_CHECK_(worst <= 2 * (double)terms * 0x1p-24, "%s: %g of |A||x| at %zu, for %zu terms", what,
             worst, at, terms);
}
/* A |u|, for u of columns. */
static inline float *forward_size(struct bed *b, const float *u)
{
    float *v = pvx_calloc(b->n * b->cs, sizeof *v), *y = pvx_calloc(b->room * b->cs, sizeof *y);
    for (size_t i = 0; i < b->n * b->cs; i++)
        v[i] = fabsf(u[i]);
    rec_forward(b->f->sub, &b->pb[HERE]->images, v, y);
    free(v);
    return y;
}
#endif
