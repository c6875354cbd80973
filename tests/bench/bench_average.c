/* bench_average.c - gains and aims of cameras averaged over frame sets, against each set by itself: NUMERICS.md, 17.
 *
 * Eight instants of a flame (closed forms: turned by 0.7 rad from one to the next), 8 cameras of 120x90, 48^3,
 * trilinear, noise 1 %.  Poses that are off move the flame by T, which no picture shows (selfcal.h, (5)).  So each
 * volume is held against the truth where it is, and against the truth moved by T.
 *
 *     bench_average [FOLDER [FLAME [WRONG]]] */
#include "recon/geom/spd.h"
#include "recon/solve/average.h"
#include "wrong.h"

#define SETS 8
static const int32_t size_48[3] = {120, 90, 48};
static const enum flame_kind of[] = {FLAME_WALL, FLAME_SHEETS, FLAME_CAMPFIRE,
                                     FLAME_POOL, FLAME_RING,   FLAME_CANDLES,
                                     FLAME_JET,  FLAME_HOLLOW, FLAME_SHELL};
static const char *const how[] = {"exact", "gains 3 %", "poses 0.3 px", "poses 0.5 px",
                                  "gains and poses"};
#define COUNT(a) (sizeof(a) / sizeof *(a))

/* ---- flames -------------------------------------------------------------------------------------- */

static double turn, moved[3]; /* of a closed form */
static void (*still)(const double x[3], double out[3]);

static void at_turned(const double x[3], double out[3])
{
    double u[3] = {x[0] - moved[0], x[1] - moved[1], x[2] - moved[2]};
    double v[3] = {cos(turn) * u[0] - sin(turn) * u[1], sin(turn) * u[0] + cos(turn) * u[1], u[2]};
    still(v, out);
}

static bool burn(struct scene *s, enum flame_kind kind, int k, pvx_pool *pool)
{
    const struct flame *f = &flames[kind];
    if (f->at == NULL)
        return scene_new(
            s, kind, &views_8, size_48,
            f->folder == NULL ? f->t + 0.15 * k : k % (kind == FLAME_CAMPFIRE ? 12 : 4), pool);
    scene_views(s, &views_8, size_48[0], size_48[1], size_48[2]);
    still = f->at;
    turn = 0.7 * k;
    s->field = (struct field){
        .at = at_turned, .n = {64, 64, 64}, .lo = {-0.5, -0.5, 0}, .hi = {0.5, 0.5, 1}};
    scene_shoot(s, pool);
    scene_rescale(s, PEAK / s->peak);
    return true;
}

/* Of the volume in f, against the truth of set k moved by T. */
static double error(const struct scene *from, int k, const rec_frame *f, const double T[3],
                    pvx_pool *pool)
{
    struct scene s = *from;
    struct rec_sparse v;
    rec_frame_volume(f, &v);
    size_t n = rec_grid_count(v.grid) * (size_t)s.nch;
    float *dense = must_floats(n);
    rec_sparse_to_dense(&v, dense);
    s.truth = NULL;
    turn = 0.7 * k;
    memcpy(moved, T, sizeof moved);
    for (int a = 0; a < 3 && s.field.v != NULL; a++) {
        s.field.lo[a] += T[a];
        s.field.hi[a] += T[a];
    }
    for (int b = 0; b < s.pose.n; b++)
        for (int a = 0; a < 3; a++)
            s.pose.blob[b].m[a] += T[a];
    scene_truth(&s, REC_TRILINEAR, pool);
    memset(moved, 0, sizeof moved);
    double e = rec_rel_l2(dense, s.truth, n);
    free(s.truth);
    free(dense);
    return e;
}

/* ---- rigs ---------------------------------------------------------------------------------------- */

/* How far the principal points of `is` are from those of `rig`, and T that explains most of it. */
static void motion(const struct rec_rig *rig, const struct rec_rig *is, double T[3])
{
    double A[3][3] = {{0}}, X[3], step = 0.01;
    memset(T, 0, 3 * sizeof *T);
    for (int a = 0; a < 3; a++)
        X[a] = 0.5 * (rig->grid.min[a] + rig->grid.max[a]);
    for (size_t c = 0; c < rig->n_cameras; c++) {
        const struct rec_camera *k = &rig->cameras[c];
        double J[3][2], d[2] = {is->cameras[c].cx - k->cx, is->cameras[c].cy - k->cy};
        for (int a = 0; a < 3; a++) {
            double Y[3] = {X[0], X[1], X[2]}, to[2], here[2];
            Y[a] += step;
            CHECK(rec_camera_project(k, X, here) && rec_camera_project(k, Y, to) ? PVX_OK
                                                                                 : PVX_EINVAL);
            for (int m = 0; m < 2; m++)
                J[a][m] = (to[m] - here[m]) / step;
        }
        for (int a = 0; a < 3; a++)
            for (int m = 0; m < 2; m++) {
                T[a] += J[a][m] * d[m];
                for (int b = 0; b < 3; b++)
                    A[a][b] += J[a][m] * J[b][m];
            }
    }
    CHECK(rec_spd_solve(&A[0][0], T, 3) ? PVX_OK : PVX_EINVAL);
}

struct outcome {
    double world, own; /* errors, against both truths */
    double ms;
    int corrected; /* sets */
};

struct run {
    struct scene set[SETS];
    const rec_sysmat *S;
    double T[3];
    pvx_pool *pool;
};

static void solve_set(const struct run *r, rec_frame *f, int k)
{
    bench_seed(77 + (uint64_t)k);
    scene_fill(&r->set[k], f, 0.01);
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
}

static struct outcome solve_all(const struct run *r, enum rec_selfcal_mode mode, rec_average *a)
{
    struct rec_frame_params p = rec_frame_defaults;
    const double nothing[3] = {0};
    struct outcome o = {0};
    rec_frame *f;
    p.nch = r->set[0].nch;
    p.photo.saturation = 1e30F;
    p.selfcal = mode;
    CHECK(rec_frame_alone(r->S, &r->set[0].rig, &p, r->pool, &f, NULL));
    struct rec_selfcal_report told = {.gain = true};
    if (a != NULL)
        rec_solver_average(f->solver, a);
    for (int round = 0; a != NULL && round < 2 && (told.gain || told.shift); round++) {
        rec_average_learn(a);
        for (int k = 0; k < SETS; k++)
            solve_set(r, f, k);
        rec_average_tell(a, &told);
    }
    if (a != NULL)
        rec_average_fix(a);
    for (int k = 0; k < SETS; k++) {
        solve_set(r, f, k);
        const struct rec_frame_report *q = rec_frame_get_report(f);
        o.ms += ms(q->solve_ns) / SETS;
        o.corrected += q->selfcal.gain || q->selfcal.shift;
        o.world += error(&r->set[k], k, f, nothing, r->pool) / SETS;
        o.own += error(&r->set[k], k, f, r->T, r->pool) / SETS;
    }
    rec_frame_free(&f);
    return o;
}

/* ---- a flame ------------------------------------------------------------------------------------- */

static bool judge(FILE *csv, enum flame_kind kind, const char *name, pvx_pool *pool)
{
    static struct run r;
    struct rec_rig right;
    rec_sysmat *S;
    rec_average *a;
    r = (struct run){.pool = pool};
    for (int k = 0; k < SETS; k++) {
        if (!burn(&r.set[k], kind, k, pool))
            return false;
        if (k == 0)
            CHECK(rec_rig_copy(&r.set[0].rig, &right));
        wrong_scene(wrong_named(name), &r.set[k], 1, pool);
        r.set[k].rig.grid.basis = REC_TRILINEAR;
    }
    motion(&r.set[0].rig, &right, r.T);
    r.S = S = scene_matrix(&r.set[0], 0, pool);
    CHECK(rec_average_new(S->n_cameras, S->binning, 1, SETS + 1, &a));
    const struct outcome o[] = {solve_all(&r, REC_SELFCAL_OFF, NULL),
                                solve_all(&r, REC_SELFCAL_ON, NULL),
                                solve_all(&r, REC_SELFCAL_ON, a)};
    static const char *const by[] = {"off", "each set", "mean"};
    for (size_t i = 0; i < COUNT(o); i++)
        bench_row(csv, "%s,%s,%s,%s,%.4f,%.4f,%d,%.1f", flames[kind].name, flames[kind].use, name,
                  by[i], o[i].world, o[i].own, o[i].corrected, o[i].ms);
    rec_average_free(&a);
    rec_sysmat_free(&S);
    rec_rig_fini(&right);
    for (int k = 0; k < SETS; k++)
        scene_fini(&r.set[k]);
    return true;
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    FILE *csv = bench_csv(argc, argv, "average",
                          "flame,use,wrong,corrected by,error,error where it is,sets,ms");
    for (size_t i = 0; i < COUNT(of); i++) {
        bool there = argc <= 2 || strcmp(argv[2], flames[of[i]].name) == 0;
        for (size_t w = 0; w < COUNT(how) && there; w++)
            if (argc <= 3 || strcmp(argv[3], how[w]) == 0)
                there = judge(csv, of[i], how[w], pool);
    }
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
