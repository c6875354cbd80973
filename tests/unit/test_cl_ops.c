/* test_cl_ops.c - the operations of a solve on a device, one by one, against the loops of the processor on the same
 * inputs: vectors to the bit where they do not come from a product, sums to their rounding; then whole solves. */
#include "recon/opencl/ops.h"
#include "recon/solve/blend.h"
#include "recon/solve/card.h"
#include "tests/lib/cl_bed.h"
#include "tests/lib/scene.h"
#include "tests/lib/slot.h"

#define EPS 0x1p-53
enum { HERE, THERE };
enum way { GREY, COLOUR, MOSAIC };

static rec_cl *cl;

/* Voxels along a grid without coarser ones, on a simulated device, else with them. */
static int32_t small(void)
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

static float *vector_of(struct rec_pcg *t, const struct vector *v)
{
    return *(float **)((v->in_problem ? (char *)t->pb : (char *)t) + v->at);
}
static bool is_there(const struct bed *b, const struct vector *v)
{
    return v->of != BIN_FOUR || b->in.per_channel;
}
static size_t floats_of(const struct bed *b, const struct vector *v)
{
    return v->of == COLUMN       ? b->n * b->cs
           : v->of == COLUMN_ONE ? b->n
           : v->of == BIN        ? b->room * b->cs
                                 : b->room * (v->of == BIN_FOUR ? 4 : 1);
}

/* ---- up and down ---------------------------------------------------------------------------------*/

static void up(struct bed *b, const float *name, const float *from, size_t floats)
{
    rec_cl_upload(b->v->queue, rec_cl_twin_of(b->v, name), 0, from, floats * sizeof *from);
}
static float *down(struct bed *b, const float *name, size_t floats)
{
    float *to = pvx_calloc(floats, sizeof *to);
    rec_cl_download(b->v->queue, rec_cl_twin_of(b->v, name), 0, to, floats * sizeof *to);
    T_OK(rec_cl_wait(b->v->queue));
    return to;
}

/* Compares floats that are rows, or all. */
static void same_floats(const struct bed *b, const char *what, const char *name, const float *want,
                        const float *got, size_t floats, size_t lanes_of_bin)
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
static void same(struct bed *b, const char *what, const struct vector *v)
{
    float *got = down(b, vector_of(&b->t[THERE], v), floats_of(b, v));
    size_t lanes = v->of == BIN ? b->cs : v->of == BIN_ONE ? 1 : v->of == BIN_FOUR ? 4 : 0;
    same_floats(b, what, v->name, vector_of(&b->t[HERE], v), got, floats_of(b, v), lanes);
    free(got);
}
/* All but the vectors in `but`, bit by bit of their numbers. */
static void all_same(struct bed *b, const char *what, unsigned but)
{
    for (unsigned i = 0; i < N_VECTORS; i++)
        if (is_there(b, &vectors[i]) && (but >> i & 1) == 0)
            same(b, what, &vectors[i]);
}
static unsigned number_of(const char *name)
{
    unsigned i = 0;
    while (strcmp(vectors[i].name, name) != 0)
        i++;
    return i;
}
#define BUT(name) (1u << number_of(name))

/* What is on the device of a vector comes here. */
static void take(struct bed *b, const char *name)
{
    const struct vector *v = &vectors[number_of(name)];
    float *got = down(b, vector_of(&b->t[THERE], v), floats_of(b, v));
    memcpy(vector_of(&b->t[HERE], v), got, floats_of(b, v) * sizeof *got);
    free(got);
}

/* Sums of n terms each, all of one sign: `size` is NULL; else the sums of their sizes. */
static void same_sums(const struct bed *b, const char *what, size_t n, const double here[4],
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
static void sizes(const struct bed *b, const float *u, const float *v, double out[4])
{
    memset(out, 0, sizeof(double[4]));
    for (size_t i = 0; i < b->n * b->cs; i++)
        out[i % b->cs] += fabs((double)u[i] * (v != NULL ? (double)v[i] : 1));
}

/* ---- beds ----------------------------------------------------------------------------------------*/

/* Some bins have no weight, some a little, and so have channels of a mosaic. */
static void bed_weights(struct bed *b)
{
    rec_frame *f = b->f;
    for (size_t i = 0; i < f->rows; i++) {
        f->weight[i] *= i % 97 == 0 ? 0 : i % 5 == 0 ? (float)t_uniform(0.1, 0.9) : 1;
        for (size_t l = 0; l < 4 && f->per_channel; l++)
            f->weight4[i * 4 + l] *= i % 101 == 0 ? 0 : (float)t_uniform(0.1, 1);
    }
}

static void bed_carve(struct bed *b)
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

/* As rec_solve_pcg has them. */
static struct rec_pcg bed_pcg(const struct bed *b, rec_problem *pb, float *x)
{
    struct rec_pcg t = {.pb = pb,
                        .smooth = {.run = pb->run, .diag2 = pb->diag2},
                        .stiff = pb->stiff,
                        .x = x,
                        .next = pb->xv[0],
                        .phi = pb->xv[1],
                        .phi_old = pb->xv[2],
                        .d = pb->xv[3],
                        .lx = pb->xv[4],
                        .ar = pb->xv[5],
                        .scale = pb->xv[7],
                        .r = pb->yv[0],
                        .q = pb->yv[1],
                        .pass = &b->table};
    rec_smooth_init(&t.smooth, &pb->a->S->grid);
    return t;
}

static void bed_new(struct bed *b, int32_t grid, enum way way)
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

static void bed_free(struct bed *b)
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
static void bed_fill(struct bed *b)
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

/* ---- passes --------------------------------------------------------------------------------------*/

struct sums {
    double of[2][3][4];
};
static struct sums run(struct bed *b, enum rec_pcg_pass which)
{
    struct sums s = {{{{0}}}};
    for (int i = 0; i < 2; i++)
        rec_pcg_pass(&b->t[i], which, s.of[i]);
    return s;
}
static void sums_are_same(struct bed *b, const char *what, const struct sums *s, int slot,
                          const double *size)
{
    same_sums(b, what, b->n + b->room, s->of[HERE][slot], s->of[THERE][slot], size);
}

/* size: |A||u| in rows, or |A'||u|, as the processor has it.  Each sum of so many terms rounds as often. */
static void near_product(const struct bed *b, const char *what, bool rows, const float *here,
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
static float *forward_size(struct bed *b, const float *u)
{
    float *v = pvx_calloc(b->n * b->cs, sizeof *v), *y = pvx_calloc(b->room * b->cs, sizeof *y);
    for (size_t i = 0; i < b->n * b->cs; i++)
        v[i] = fabsf(u[i]);
    rec_forward(b->f->sub, &b->pb[HERE]->images, v, y);
    free(v);
    return y;
}
static float *adjoint_size(struct bed *b, const float *u)
{
    float *v = pvx_calloc(b->room * b->cs, sizeof *v), *x = pvx_calloc(b->n * b->cs, sizeof *x);
    for (size_t i = 0; i < b->room * b->cs; i++)
        v[i] = fabsf(u[i]);
    rec_adjoint_range(b->f->sub, v, 0, (int32_t)b->n, x);
    free(v);
    return x;
}

static void passes_over_columns(struct bed *b)
{
    double size[4];
    struct rec_pcg *t = &b->t[HERE];
    (void)run(b, REC_PASS_BEGIN);
    all_same(b, "begin", 0);
    bed_fill(b);
    (void)run(b, REC_PASS_SCALE);
    all_same(b, "scale", 0);
    bed_fill(b);
    struct sums s = run(b, REC_PASS_DIRECTION);
    all_same(b, "direction", 0);
    sizes(b, t->d, t->phi, size);
    sums_are_same(b, "direction", &s, 0, size);
    s = run(b, REC_PASS_STEP);
    all_same(b, "step", 0);
    sums_are_same(b, "step", &s, 0, NULL);
    T_OK(b->t[THERE].any_clipped && t->any_clipped);
    s = run(b, REC_PASS_SLOPE);
    float *step = pvx_calloc(b->n * b->cs, sizeof *step);
    for (size_t i = 0; i < b->n * b->cs; i++)
        step[i] = t->next[i] - t->x[i];
    sizes(b, step, t->phi, size);
    free(step);
    sums_are_same(b, "slope", &s, 0, size);
    (void)run(b, REC_PASS_RETREAT);
    all_same(b, "retreat", 0);
    s = run(b, REC_PASS_SMOOTHNESS);
    all_same(b, "smoothness", 0);
    sums_are_same(b, "smoothness: penalty", &s, 0, NULL);
    sums_are_same(b, "smoothness: norm", &s, 1, NULL);
    s = run(b, REC_PASS_BRIGHTNESS);
    all_same(b, "brightness", 0);
    memset(size, 0, sizeof size);
    for (size_t q = 0; q < b->n; q++)
        size[0] += fabs((double)t->next[q]);
    sums_are_same(b, "brightness: y", &s, 0, size);
    sums_are_same(b, "brightness: y^2", &s, 1, NULL);
    sums_are_same(b, "brightness: lit", &s, 2, NULL);
    s = run(b, REC_PASS_STIFFNESS);
    all_same(b, "stiffness", 0);
    sums_are_same(b, "stiffness", &s, 0, NULL);
    b->t[HERE].usual = b->t[THERE].usual = 0; /* nothing burns: V = 1 */
    (void)run(b, REC_PASS_STIFFNESS);
    all_same(b, "stiffness of the dark", 0);
    bed_fill(b);
    s = run(b, REC_PASS_REGRADIENT);
    all_same(b, "regradient", 0);
    sums_are_same(b, "regradient", &s, 0, NULL);
    sizes(b, t->phi, t->phi_old, size);
    for (int l = 0; l < 4; l++)
        size[l] *= 4; /* S <= 2 */
    sums_are_same(b, "regradient: cross", &s, 1, size);
}

/* No clipping: alpha is small where d points down. */
static void a_step_without_clipping(struct bed *b)
{
    bed_fill(b);
    for (int i = 0; i < 2; i++)
        memset(b->t[i].alpha, 0, sizeof b->t[i].alpha);
    (void)run(b, REC_PASS_STEP);
    T_OK(!b->t[THERE].any_clipped && !b->t[HERE].any_clipped);
}

static void passes_with_products(struct bed *b)
{
    struct rec_pcg *t = &b->t[HERE];
    bed_fill(b);
    struct sums s = run(b, REC_PASS_CURVATURE);
    all_same(b, "curvature", BUT("q"));
    float *size = forward_size(b, t->d);
    float *q = down(b, b->t[THERE].q, b->room * b->cs);
    near_product(b, "A d", true, t->q, q, size);
    sums_are_same(b, "curvature: d'L V L d", &s, 1, NULL);
    double qwq[4] = {0};
    for (size_t i = 0; i < b->room * b->cs; i++) {
        float w = rec_weight_at(b->pb[HERE], i / b->cs, i % b->cs);
        if (b->row[i / b->cs])
            qwq[i % b->cs] += (double)(w * q[i]) * (double)q[i];
    }
    same_sums(b, "curvature: q'Wq", b->room, qwq, s.of[THERE][0], NULL);
    free(size);

    (void)run(b, REC_PASS_STEP);
    rec_pcg_pass(&b->t[THERE], REC_PASS_CLIPPED, NULL);
    float *e = down(b, b->t[THERE].ar, b->n * b->cs);
    size_t wrong = 0, some = 0;
    for (size_t i = 0; i < b->n * b->cs; i++) {
        float alpha = (float)t->alpha[i % b->cs],
              inverse = alpha > 0 ? (float)(1 / t->alpha[i % b->cs]) : 0;
        float want = t->x[i] + alpha * t->d[i] < 0 ? -t->x[i] * inverse - t->d[i] : 0;
        wrong += e[i] != want;
        some += want != 0;
    }
    T_EQ_I(wrong, 0);
    T_OK(some > 10);
    float *change = pvx_calloc(b->room * b->cs, sizeof *change);
    rec_forward(b->f->sub, &b->pb[HERE]->images, e, change);
    size = forward_size(b, e);
    float *after = down(b, b->t[THERE].q, b->room * b->cs);
    for (size_t i = 0; i < b->room * b->cs; i++) {
        change[i] += q[i];
        size[i] += fabsf(q[i]);
    }
    near_product(b, "A e", true, change, after, size);
    free(q);
    free(e);
    free(change);
    free(size);
    free(after);

    take(b, "q"); /* from the same q on */
    take(b, "ar");
    t->any_clipped = false;
    s = run(b, REC_PASS_RESIDUAL);
    all_same(b, "residual", 0);
    sums_are_same(b, "residual: r'Wr", &s, 0, NULL);
    sums_are_same(b, "residual: penalty", &s, 1, NULL);
    sums_are_same(b, "residual: norm", &s, 2, NULL);

    s = run(b, REC_PASS_GRADIENT);
    float *ar = down(b, b->t[THERE].ar, b->n * b->cs);
    size = adjoint_size(b, t->q);
    near_product(b, "A'W r", false, t->ar, ar, size);
    free(size);
    free(ar);
    take(b, "ar");
    double sums[3][4], cross[4];
    rec_pcg_pass(t, REC_PASS_REGRADIENT, sums);
    all_same(b, "gradient", 0);
    same_sums(b, "gradient", b->n, sums[0], s.of[THERE][0], NULL);
    sizes(b, t->phi, t->phi_old, cross);
    for (int l = 0; l < 4; l++)
        cross[l] *= 4;
    same_sums(b, "gradient: cross", b->n, sums[1], s.of[THERE][1], cross);
}

T_CASE(passes_are_those_of_the_processor)
{
    for (enum way way = GREY; way <= MOSAIC; way++) {
        if (cl_bed_is_simulated() && way == COLOUR)
            continue;
        struct bed b;
        bed_new(&b, small(), way);
        all_same(&b, "load", ~(BUT("b") | BUT("w") | BUT("w4")));
        bed_fill(&b);
        passes_over_columns(&b);
        passes_with_products(&b);
        a_step_without_clipping(&b);
        bed_free(&b);
    }
}

/* ---- problem.c, start.c, lambda.c ----------------------------------------------------------------*/

static void loads(struct bed *b)
{
    const rec_problem *here = b->pb[HERE], *there = b->pb[THERE];
    struct rec_card_load sum;
    size_t measured = 0, ones = 0;
    double light[4] = {0};
    rec_cl_ops.load(b->pb[THERE], &sum);
    for (size_t i = 0; i < b->room; i++) {
        measured += b->row[i] && here->w[i] > 0;
        ones += b->row[i] && here->w[i] == 1;
        for (size_t l = 0; l < b->cs && b->row[i]; l++)
            light[l] += fabs((double)rec_weight_at(here, i, l) * (double)here->b[i * b->cs + l]);
    }
    T_EQ_I(sum.rows, measured);
    T_EQ_I(sum.ones, ones);
    double n = (double)b->room * (double)b->cs * EPS;
    T_NEAR(there->b_norm2, here->b_norm2, 2 * n * here->b_norm2);
    T_EQ_I(there->m, here->m);
    T_EQ_I(there->whole, here->whole);
    for (int l = 0; l < 4; l++) {
        T_NEAR(there->light[l], here->light[l], 2 * n * light[l]);
        if (b->in.per_channel)
            T_EQ_I(there->measured[l], here->measured[l]);
        T_NEAR(there->share[l], here->share[l], 4 * n);
    }
}

static void weights(struct bed *b)
{
    rec_problem *here = b->pb[HERE], *there = b->pb[THERE];
    rec_problem_weigh(here, -1);
    rec_problem_weigh(there, -1);
    float *column = down(b, there->column, b->n);
    same_floats(b, "diagonal", "column", here->diag, column, b->n, 0);
    free(column);
    for (int l = 0; l < here->nch; l++) {
        T_OK(here->lambda[l] > 0 && here->noise2[l] > 0);
        /* the processor adds up floats, the device doubles before they are rounded; lambda has powers of the sums */
        double n = 0x1p-24, m = 4 * (double)b->room * EPS;
        T_NEAR(there->unit[l], here->unit[l], n * here->unit[l]);
        T_NEAR(there->noise2[l], here->noise2[l], m * here->noise2[l]);
        T_NEAR(there->lambda[l], here->lambda[l], (4 * n + 4 * m) * here->lambda[l]);
    }
}

static void residuals(struct bed *b)
{
    struct rec_pcg *t = b->t;
    double rwr[2][4];
    bed_fill(b);
    for (int i = 0; i < 2; i++)
        rec_residual(b->pb[i], t[i].x, t[i].r, t[i].q, rwr[i]);
    float *r = down(b, t[THERE].r, b->room * b->cs), *size = forward_size(b, t[HERE].x);
    for (size_t i = 0; i < b->room * b->cs; i++)
        size[i] += fabsf(b->pb[HERE]->b[i]);
    near_product(b, "A x - b", true, t[HERE].r, r, size);
    free(r);
    free(size);
    take(b, "r");
    take(b, "q");
    double sum[4] = {0};
    for (size_t i = 0; i < b->room * b->cs; i++)
        if (b->row[i / b->cs])
            sum[i % b->cs] += (double)t[HERE].q[i] * (double)t[HERE].r[i];
    same_sums(b, "r'Wr", b->room, sum, rwr[THERE], NULL);

    rec_problem *pb = b->pb[THERE];
    double fit[4], length[4], want[2][4] = {{0}}, abs_fit[4] = {0};
    rec_cl_ops.fit(pb, t[THERE].r, fit, length);
    for (size_t i = 0; i < b->room * b->cs; i++) {
        double v = b->pb[HERE]->b[i], ax = (double)t[HERE].r[i] + v;
        double w = rec_weight_at(b->pb[HERE], i / b->cs, i % b->cs);
        if (!b->row[i / b->cs])
            continue;
        want[0][i % b->cs] += w * ax * v;
        abs_fit[i % b->cs] += fabs(w * ax * v);
        want[1][i % b->cs] += w * ax * ax;
    }
    same_sums(b, "fit", b->room, want[0], fit, abs_fit);
    same_sums(b, "fit: size", b->room, want[1], length, NULL);

    const float scale[4] = {0.7f, 1.3f, 0, 0};
    float *x = pvx_calloc(b->n * b->cs, sizeof *x), *q = pvx_calloc(b->room * b->cs, sizeof *q);
    memset(sum, 0, sizeof sum);
    for (size_t i = 0; i < b->n * b->cs; i++)
        t[HERE].x[i] *= scale[i % b->cs];
    for (size_t i = 0; i < b->room * b->cs; i++) {
        float *to = &t[HERE].r[i], v = b->pb[HERE]->b[i];
        if (b->row[i / b->cs])
            sum[i % b->cs] += rec_put_residual(b->pb[HERE], i / b->cs, i % b->cs,
                                               scale[i % b->cs] * (*to + v) - v, to, &t[HERE].q[i]);
    }
    rec_cl_ops.scale(pb, scale, t[THERE].x, t[THERE].r, t[THERE].q, rwr[THERE]);
    all_same(b, "scale", 0);
    same_sums(b, "scale: r'Wr", b->room, sum, rwr[THERE], NULL);
    free(x);
    free(q);

    for (int i = 0; i < 2; i++) {
        b->pb[i]->start = REC_START_ZERO;
        rec_start_residual(b->pb[i], t[i].x, rwr[i]);
    }
    all_same(b, "residual of 0", 0);
    same_sums(b, "residual of 0", b->room, rwr[HERE], rwr[THERE], NULL);

    T_NEAR(rec_norm_x(b->pb[THERE], t[THERE].phi), rec_norm_x(b->pb[HERE], t[HERE].phi),
           (double)b->n * EPS * rec_norm_x(b->pb[HERE], t[HERE].phi));
    for (int i = 0; i < 2; i++) {
        rec_copy_x(b->pb[i], t[i].x, t[i].phi);
        rec_clear_x(b->pb[i], t[i].phi_old);
    }
    all_same(b, "copy", 0);
}

T_CASE(loads_weights_and_residuals_are_those_of_the_processor)
{
    for (enum way way = GREY; way <= MOSAIC; way++) {
        if (cl_bed_is_simulated() && way == COLOUR)
            continue;
        struct bed b;
        bed_new(&b, small(), way);
        loads(&b);
        weights(&b);
        residuals(&b);
        bed_free(&b);
    }
}

/* ---- blend.c -------------------------------------------------------------------------------------*/

/* Compares a vector of one lane. */
static void same_one(struct bed *b, const char *name, const float *here, const float *there,
                     size_t floats, bool bins)
{
    float *got = down(b, there, floats);
    same_floats(b, "blend", name, here, got, floats, bins ? 1 : 0);
    free(got);
}

/* Sums of c x and of its square and product with x. */
static void colours(struct bed *b, const double c[4])
{
    double want[3][4] = {{0}}, got[3][4];
    for (size_t q = 0; q < b->n; q++) {
        const float *x = b->t[HERE].x + q * 4;
        float s = ((float)c[0] * x[0] + (float)c[1] * x[1]) + (float)c[2] * x[2];
        for (int l = 0; l < 4; l++) {
            want[0][l] += (double)x[l] * (double)s;
            want[1][l] += (double)s * (double)s;
            want[2][l] += (double)x[l] * (double)x[l];
        }
    }
    rec_cl_ops.colours(&b->t[THERE], c, got[0], got[1], got[2]);
    for (int i = 0; i < 3; i++)
        same_sums(b, "colours", b->n, want[i], got[i], NULL);
}

T_CASE(the_sum_of_channels_is_that_of_the_processor)
{
    struct bed b;
    struct rec_pcg one[2];
    double rwr[2][4];
    const double c[4] = {0.4, 1, 0.3, 0};
    bed_new(&b, small(), COLOUR);
    weights(&b);
    (void)run(&b, REC_PASS_BEGIN);
    bed_fill(&b);
    colours(&b, c);
    for (int i = 0; i < 2; i++) {
        for (int l = 0; l < 4; l++) /* sums differ by their rounding, and so would c */
            b.pb[THERE]->light[l] = b.pb[HERE]->light[l];
        rec_blend_begin(&b.t[i], &one[i], rwr[i]);
    }
    same_one(&b, "x", one[HERE].x, one[THERE].x, b.n, false);
    same_one(&b, "d", one[HERE].d, one[THERE].d, b.n, false);
    same_one(&b, "b", one[HERE].pb->b, one[THERE].pb->b, b.room, true);
    same_one(&b, "r", one[HERE].r, one[THERE].r, b.room, true);
    same_one(&b, "W r", one[HERE].q, one[THERE].q, b.room, true);
    same_sums(&b, "blend", b.room, rwr[HERE], rwr[THERE], NULL);
    double all[3][4];
    for (int i = 0; i < 2; i++) /* one lane of a system of four */
        rec_pcg_pass(&one[i], REC_PASS_SMOOTHNESS, all);
    same_one(&b, "L x", one[HERE].lx, one[THERE].lx, b.n, false);
    for (size_t q = 0; q < b.n; q++)
        one[HERE].x[q] *= 1.25f;
    up(&b, one[THERE].x, one[HERE].x, b.n);

    double sum[4], zero[4], want[2][4] = {{0}};
    for (size_t i = 0; i < b.n * 4; i++) {
        const float *x = b.t[HERE].x + i / 4 * 4;
        float s = ((float)c[0] * x[0] + (float)c[1] * x[1]) + (float)c[2] * x[2];
        want[0][i % 4] += (double)b.t[HERE].x[i];
        want[1][i % 4] += (double)s;
    }
    rec_cl_ops.tint(&b.t[THERE], c, sum, zero);
    same_sums(&b, "tint", b.n, want[0], sum, NULL);
    same_sums(&b, "tint: all", b.n, want[1], zero, NULL);
    const double tint[4] = {0.2, 0.7, 0.1, 0};
    const float least = 0.02f;
    for (size_t q = 0; q < b.n; q++) {
        float *x = b.t[HERE].x + q * 4;
        float s = ((float)c[0] * x[0] + (float)c[1] * x[1]) + (float)c[2] * x[2];
        s = one[HERE].x[q] / (s + least);
        for (int l = 0; l < 4; l++)
            x[l] = (x[l] + least * (float)tint[l]) * s;
    }
    rec_cl_ops.colour(&b.t[THERE], &one[THERE], c, tint, least);
    same(&b, "colour", &vectors[number_of("x")]);
    bed_free(&b);
}

/* ---- selfcal.c -----------------------------------------------------------------------------------*/

T_CASE(corrections_of_cameras_are_those_of_the_processor)
{
    for (enum way way = cl_bed_is_simulated() ? COLOUR : GREY; way <= COLOUR; way++) {
        struct bed b;
        struct rec_selfcal_given given = {.gain = true, .shift = true};
        struct rec_selfcal *s[2];
        struct rec_selfcal_look look[2][REC_MAX_CAMERAS];
        bed_new(&b, small(), way);
        bed_fill(&b);
        for (size_t c = 0; c < b.s.rig.n_cameras; c++) {
            given.camera[c].gain = t_uniform(0.9, 1.1);
            for (int i = 0; i < 2; i++)
                given.camera[c].shift[i] = c == 1 ? 0 : t_uniform(-2, 2);
        }
        for (int i = 0; i < 2; i++) {
            T_EQ_I(rec_selfcal_new(b.s.S, &s[i]), PVX_OK);
            rec_selfcal_begin(s[i], REC_SELFCAL_ON, REC_SELFCAL_GIVEN, &given);
            rec_selfcal_attach(b.pb[i], s[i]);
            rec_selfcal_apply(b.pb[i]);
        }
        same(&b, "correct", &vectors[number_of("b")]);
        for (int i = 0; i < 2; i++) {
            T_OK(rec_selfcal_due_last(b.pb[i])); /* counts the cameras */
            (void)rec_selfcal_estimate(b.pb[i], b.t[i].r);
            rec_selfcal_look(s[i], look[i]);
        }
        /* A tile has at most room bins, each of three lanes; the step is a quotient of such sums, whose determinant
         * may lose as much as 1e6 (selfcal.c). */
        double n = 3 * (double)b.room * EPS * 1e6;
        for (size_t c = 0; c < b.s.rig.n_cameras; c++) {
            const struct rec_selfcal_look *o = &look[HERE][c], *p = &look[THERE][c];
            T_EQ_I(p->known, o->known);
            T_EQ_I(o->known, c != 2);
            if (!o->known)
                continue;
            T_OK(o->gain_var > 0 && isfinite(o->var[0]));
            T_NEAR(p->log_gain, o->log_gain, n);
            T_NEAR(p->shift[0], o->shift[0], n);
            T_NEAR(p->shift[1], o->shift[1], n);
            T_NEAR(p->gain_var, o->gain_var, n * o->gain_var);
            T_NEAR(p->var[2], o->var[2], n * o->var[2]);
        }
        for (int i = 0; i < 2; i++) {
            rec_selfcal_attach(b.pb[i], NULL);
            rec_selfcal_free(&s[i]);
        }
        bed_free(&b);
    }
}

/* ---- levels.c ------------------------------------------------------------------------------------*/

/* A value of the coarse grid, 0 where it has no column. */
static float coarse_value(const struct rec_grid *g, const int32_t *at, const float *x, size_t cs,
                          const int32_t ijk[3])
{
    for (int i = 0; i < 3; i++)
        if (ijk[i] < 0 || ijk[i] >= g->n[i])
            return 0;
    int32_t q = at[rec_grid_index(g, ijk[0], ijk[1], ijk[2])];
    return q < 0 ? 0 : x[(size_t)q * cs];
}
/* (1) of levels.h along the axes up to `axis`, for the half `up` of each. */
static float refined(const struct rec_grid *g, const int32_t *at, const float *x, size_t cs,
                     const int32_t ijk[3], const int up[3], int axis)
{
    float c[3];
    for (int m = 0; m < 3; m++) {
        int32_t to[3] = {ijk[0], ijk[1], ijk[2]};
        to[axis] += m - 1;
        c[m] = axis == 0 ? coarse_value(g, at, x, cs, to) : refined(g, at, x, cs, to, up, axis - 1);
    }
    float d = 0.125f * (c[2] - c[0]);
    return up[axis] ? c[1] + d : c[1] - d;
}

static void refines(struct bed *b)
{
    const rec_sysmat *C = b->s.S->coarse;
    struct rec_cl_part *part = &b->y->part[1];
    struct rec_subsys coarse = {.S = C, .card = &part->base, .cs = (int)b->cs, .n = part->n};
    size_t n = (size_t)part->n, wrong = 0, burns = 0;
    int32_t *at = pvx_calloc(rec_grid_count(&C->grid), sizeof *at);
    int32_t *col = pvx_calloc(n, sizeof *col);
    rec_cl_download(b->y->queue, &part->col, 0, col, n * sizeof *col);
    T_OK(rec_cl_wait(b->y->queue) && n > 20);
    memset(at, -1, rec_grid_count(&C->grid) * sizeof *at);
    for (size_t q = 0; q < n; q++)
        at[col[q]] = (int32_t)q;
    float *x = pvx_calloc(n * b->cs, sizeof *x);
    for (size_t i = 0; i < n * b->cs; i++)
        x[i] = (float)fmax(t_normal(), 0);
    const float *name = b->descent.x[0] + b->cs;
    up(b, name, x, n * b->cs);
    b->sub->card->op->refine(&coarse, name, b->sub, b->t[THERE].x);
    float *got = down(b, b->t[THERE].x, b->n * b->cs);
    for (size_t i = 0; i < b->n * b->cs; i++) {
        int32_t ijk[3], half[3];
        rec_grid_ijk(&b->s.rig.grid, b->col[i / b->cs], ijk);
        for (int m = 0; m < 3; m++)
            half[m] = ijk[m] / 2;
        const int up_of[3] = {ijk[0] & 1, ijk[1] & 1, ijk[2] & 1};
        float v = refined(&C->grid, at, x + i % b->cs, b->cs, half, up_of, 2);
        wrong += got[i] != (v > 0 ? v : 0);
        burns += v > 0;
    }
    T_EQ_I(wrong, 0);
    T_OK(burns > b->n / 4 && burns < b->n * b->cs);
    free(at);
    free(col);
    free(x);
    free(got);
}

/* A volume of other voxels, more than there is room for at once. */
static void takes_an_earlier_volume(struct bed *b)
{
    size_t n = b->s.voxels / 2, kept = 0, wrong = 0;
    int32_t *index = pvx_calloc(n, sizeof *index);
    float *value = pvx_calloc(n * b->cs, sizeof *value);
    for (size_t i = 0; i < n; i++)
        index[i] = (int32_t)(2 * i + 1);
    for (size_t i = 0; i < n * b->cs; i++)
        value[i] = (float)t_uniform(0.1, 1);
    rec_cl_solver_earlier(b->v, (int32_t)n, index, value);
    float *got = pvx_calloc(b->n * b->cs, sizeof *got);
    T_OK(rec_cl_solver_end(b->v, got));
    for (size_t i = 0; i < b->n * b->cs; i++) {
        size_t voxel = (size_t)b->col[i / b->cs];
        bool has = voxel % 2 == 1 && voxel / 2 < n;
        wrong += got[i] != (has ? value[voxel / 2 * b->cs + i % b->cs] : 0);
        kept += has;
    }
    T_EQ_I(wrong, 0);
    T_OK(kept > 0 && kept < b->n * b->cs);
    free(index);
    free(value);
    free(got);
}

T_CASE(starts_are_those_of_the_processor)
{
    for (enum way way = GREY; way <= MOSAIC; way++) {
        if (cl_bed_is_simulated() && way != MOSAIC)
            continue;
        struct bed b;
        bed_new(&b, 33, way);
        refines(&b);
        takes_an_earlier_volume(&b);
        bed_free(&b);
    }
}

/* ---- whole solves --------------------------------------------------------------------------------*/

/* Solves from the coarser grids, or from an earlier volume: `b->f->x`, or a volume that is on the device. */
static void solve(struct bed *b, int i, bool warm, const struct rec_solve_params *p,
                  struct rec_solve_report *out, uint32_t *coarse)
{
    rec_problem *pb = b->pb[i];
    struct rec_descent *d = i == HERE ? &b->f->solver->descent : &b->descent;
    d->levels = i == HERE ? b->f->levels : b->levels;
    T_OK(rec_problem_load(pb, i == HERE ? b->f->sub : b->sub, &b->in));
    rec_problem_weigh(pb, -1);
    (void)rec_levels_start(pb, d, b->t[i].x, warm ? d->spare : NULL);
    *coarse = d->iterations;
    T_EQ_I(rec_solve(pb, p, b->t[i].x, out), PVX_OK);
}

/* The largest difference from the processor's volume, over its largest value. */
static double apart(const struct bed *b, const float *got)
{
    double most = 0, off = 0;
    for (size_t i = 0; i < b->n * b->cs; i++) {
        most = fmax(most, (double)b->f->x[i]);
        off = fmax(off, fabs((double)got[i] - (double)b->f->x[i]));
    }
    return off / most;
}

static void solves(struct bed *b, enum way way, enum rec_blend blend)
{
    struct rec_solve_params p = rec_solve_defaults;
    struct rec_solve_report r[2];
    uint32_t coarse[2];
    float *got = pvx_calloc(b->n * b->cs, sizeof *got);
    float *again = pvx_calloc(b->n * b->cs, sizeof *again);
    p.blend = blend;
    for (int warm = 0; warm < 2; warm++) {
        for (int i = 0; i < 2; i++)
            solve(b, i, warm, &p, &r[i], &coarse[i]);
        T_OK(rec_cl_solver_end(b->v, got));
        T_EQ_I(r[THERE].status, r[HERE].status);
        T_EQ_I(coarse[THERE], coarse[HERE]);
        T_OK(r[HERE].iterations > 0 && coarse[HERE] > 0);
        T_EQ_I(r[THERE].iterations, r[HERE].iterations);
        T_EQ_I(r[THERE].blended, r[HERE].blended);
        T_EQ_I(r[HERE].blended > 0, blend == REC_BLEND_ON && way == COLOUR);
        double off = apart(b, got);
        /* each iteration adds the rounding of products of some 100 terms */
        double n = 100 * 0x1p-24 * (double)(coarse[HERE] + r[HERE].iterations);
        T_LE(off, n);
        T_NEAR(r[THERE].objective, r[HERE].objective, n * r[HERE].objective);
        if (warm == 0) { /* the same bits once more */
            solve(b, THERE, false, &p, &r[THERE], &coarse[THERE]);
            T_OK(rec_cl_solver_end(b->v, again));
            T_OK(memcmp(got, again, b->n * b->cs * sizeof *got) == 0);
        }
    }
    free(got);
    free(again);
}

T_CASE(whole_solves_are_those_of_the_processor)
{
    if (cl_bed_is_simulated())
        T_SKIP("simulated: the other cases have the same kernels");
    for (enum way way = GREY; way <= MOSAIC; way++) {
        struct bed b;
        bed_new(&b, 32, way);
        solves(&b, way, REC_BLEND_OFF);
        if (way == COLOUR)
            solves(&b, way, REC_BLEND_ON);
        T_OK(rec_cl_lost(cl) == NULL);
        bed_free(&b);
    }
}
T_MAIN((cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
