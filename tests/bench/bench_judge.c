/* bench_judge.c - every solver judged from outside: as it stops by itself, in both bases, against one truth.
 *
 * What is returned is a field of emission, constant in a voxel (box) or interpolated between centres
 * (trilinear), and is compared as such with the field that burnt, at 2x2x2 points of every voxel: one
 * figure for both bases and for any grid, larger than against the coefficients of one basis by what no
 * volume of that basis can show.  The view is one that no solver saw; its error is the mean over the
 * pixels on which the flame is, of 255.
 * judge.py makes the table, bench_scalarflow adds the real capture to it. */
#include "shot.h"

/* ---- cases -------------------------------------------------------------------------------------- */

static const struct view_set views_4 = {"4 on a ring", 8, 4, 3, {0, 2, 4, 6}},
                             arc_6 = {"6 on 150 deg", 12, 6, 6, {0, 1, 2, 3, 4, 5}},
                             arc_5 = {"5 on 120 deg", 12, 5, 5, {0, 1, 2, 3, 4}};
static const struct noise noise_3 = {"3 %", 0.03, false, 0}, noise_low = {"0.3 %", 0.003, false, 0},
                          noise_blue = {"0.5; blue 2 %", 0.005, false, 0.02};
static const int32_t size_96[3] = {240, 180, 96};

/* Calibration off by 0.7 pixels of 320x240 pictures in bins of 2x2, as which these stand. */
#define OFF 0.35

static const struct judged {
    enum flame_kind kind;
    const struct view_set *views;
    const struct noise *noise;
    double off; /* pixels, each camera in a direction of its own */
    const int32_t *size;
} cases[] = {
    {FLAME_RING, &views_8, &noise_1, 0, size_64},
    {FLAME_CAMPFIRE, &views_8, &noise_1, 0, size_64},
    {FLAME_CAMPFIRE, &arc_6, &noise_3, 0, size_64},
    {FLAME_GAUSS40, &views_8, &noise_1, 0, size_64},
    {FLAME_RAGGED, &views_8, &noise_1, 0, size_64},
    {FLAME_RAGGED, &views_8, &noise_blue, 0, size_64},
    {FLAME_RAGGED, &views_4, &noise_1, 0, size_64},
    {FLAME_POOL, &views_8, &noise_1, 0, size_64},
    {FLAME_POOL, &views_8, &noise_0, 0, size_64},
    {FLAME_POOL, &views_8, &noise_1, OFF, size_64},
    {FLAME_SHEETS, &views_8, &noise_1, 0, size_64},
    {FLAME_SHEETS, &arc_6, &noise_3, 0, size_64},
    {FLAME_SHELL, &views_8, &noise_low, 0, size_96},
    {FLAME_SHELL, &views_8, &noise_5, 0, size_64},
    {FLAME_WALL, &views_8, &noise_1, 0, size_64},
    {FLAME_WALL, &views_8, &noise_blue, 0, size_64},
    {FLAME_WALL, &arc_6, &noise_3, 0, size_64},
    {FLAME_JET, &views_8, &noise_0, 0, size_64},
    {FLAME_JET, &views_8, &noise_1, 0, size_64},
    {FLAME_JET, &views_8, &noise_blue, 0, size_64},
    {FLAME_JET, &arc_5, &noise_1, 0, size_64},
    {FLAME_HOLLOW, &views_8, &noise_1, 0, size_64},
    {FLAME_HOLLOW, &views_8, &noise_1, OFF, size_64},
    {FLAME_HOLLOW, &views_4, &noise_1, 0, size_64},
    {FLAME_CANDLES, &views_8, &noise_1, 0, size_64},
    {FLAME_CANDLES, &views_8, &noise_blue, 0, size_64},
    {FLAME_CANDLES, &views_8, &noise_5, 0, size_64},
    {FLAME_CANDLES, &views_8, &noise_8bit, 0, size_64},
};

/* ---- errors ------------------------------------------------------------------------------------- */

/* The emission at the points, [2 nz][2 ny][2 nx][nch]: the values at the centres of a grid twice as fine. */
static void truth_at_points(struct scene *s, pvx_pool *pool)
{
    struct rec_grid g = s->rig.grid;
    for (int a = 0; a < 3; a++)
        s->rig.grid.n[a] *= 2;
    scene_truth(s, REC_TRILINEAR, pool);
    s->rig.grid = g;
}

/* A volume between its centres along one axis: of [before][n][after] values [before][2 n][after].  A point
 * lies a quarter of a voxel from its own centre; beyond the last ones there is nothing. */
static float *between(const float *v, size_t before, size_t n, size_t after, enum rec_basis basis)
{
    float own = basis == REC_BOX ? 1 : 0.75F, *out = must_floats(before * 2 * n * after);
    for (size_t b = 0; b < before; b++)
        for (size_t i = 0; i < 2 * n; i++) {
            const float *at = v + (b * n + i / 2) * after;
            const float *near =
                i % 2 == 0 ? (i > 0 ? at - after : NULL) : (i / 2 + 1 < n ? at + after : NULL);
            for (size_t k = 0; k < after; k++)
                out[(b * 2 * n + i) * after + k] =
                    own * at[k] + (1 - own) * (near != NULL ? near[k] : 0);
        }
    return out;
}

static double field_error(const struct scene *s, const float *dense, enum rec_basis basis)
{
    size_t n[3], nch = (size_t)s->nch;
    for (int a = 0; a < 3; a++)
        n[a] = (size_t)s->rig.grid.n[a];
    float *x = between(dense, n[2] * n[1], n[0], nch, basis);
    float *y = between(x, n[2], n[1], 2 * n[0] * nch, basis);
    float *z = between(y, 1, n[2], 4 * n[0] * n[1] * nch, basis);
    double error = rec_rel_l2(z, s->truth, 8 * n[0] * n[1] * n[2] * nch);
    free(x);
    free(y);
    free(z);
    return error;
}

/* ---- one case ----------------------------------------------------------------------------------- */

static void solver(FILE *csv, const struct judged *j, const struct scene *s,
                   const struct shot *shot, const rec_sysmat *S, const char *name, pvx_pool *pool)
{
    const struct flame *f = &flames[j->kind];
    double least;
    float *dense = must_floats(rec_grid_count(&S->grid) * (size_t)s->nch);
    struct rec_frame_report r = solve_once(s, shot, S, name, pool, dense, &least);
    bench_row(csv, "%s,%s,%s,%s,%g,%d,%s,%s,%u,%.2f,%llu,%.5f,%.4f,%s", f->name, f->use,
              j->views->name, j->noise->name, 2 * j->off, S->grid.n[2],
              rec_basis_name(S->grid.basis), name, r.solve.iterations, least,
              (unsigned long long)r.entries, field_error(s, dense, S->grid.basis),
              view_error(s, dense, pool), rec_status_name(r.solve.status));
    free(dense);
}

static void judge_case(FILE *csv, const struct judged *j, pvx_pool *pool)
{
    struct scene s;
    struct shot shot;
    if (!scene_new(&s, j->kind, j->views, j->size, flames[j->kind].t, pool))
        return;
    shot_new(&shot, &s, j->noise, 1);
    truth_at_points(&s, pool);
    for (size_t c = 0; c < s.rig.n_cameras; c++) { /* the pictures are there already */
        double angle = 6.2832 * bench_even();
        s.rig.cameras[c].cx += j->off * cos(angle);
        s.rig.cameras[c].cy += j->off * sin(angle);
    }
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        s.rig.grid.basis = (enum rec_basis)basis;
        rec_sysmat *S = scene_matrix(&s, 0, pool);
        for (const char *const *name = rec_solver_names(); *name != NULL; name++)
            solver(csv, j, &s, &shot, S, *name, pool);
        rec_sysmat_free(&S);
    }
    shot_free(&shot);
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf(
        "\nevery solver as it stops by itself, against one truth for both bases, %u threads; off: "
        "raw pixels that the calibration is wrong by\n",
        pvx_pool_threads(pool));
    FILE *csv =
        bench_csv(argc, argv, "judge",
                  "scene,use,rig,noise,off,voxels,basis,solver,iterations,ms,entries,volume,"
                  "view,status");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        judge_case(csv, &cases[i], pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
