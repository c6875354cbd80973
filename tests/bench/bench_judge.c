/* bench_judge.c - every solver judged from outside: as it stops by itself, in both bases, against one truth, on rigs
 * that are as their calibration says and on rigs that are not (wrong.h).
 *
 * What is returned is a field of emission, constant in a voxel (box) or interpolated between centres
 * (trilinear), and is compared as such with the field that burnt, at 2x2x2 points of every voxel: one
 * figure for both bases and for any grid, larger than against the coefficients of one basis by what no
 * volume of that basis can show.  The view is one that no solver saw; its error is the mean over the
 * pixels on which the flame is, of 255.
 * Where the default corrects the cameras (selfcal.h), all others also see the pictures as it corrected them:
 * pictures "corrected" instead of "given".  Labs' rigs are drawn several times: noise, gains and poses.
 * judge.py makes the table, bench_scalarflow adds the real capture to it.
 *
 *     bench_judge [FOLDER [CHOICE [SEED]]]
 * CHOICE is a regular expression on "flame, cameras, noise, wrong, basis, solver", for example
 * 'pool, 8.*gains.*trilinear, (pcg|mlem)'.  SEED (1) is the first draw. */
#include <regex.h>

#include "corrected.h"
#include "wrong.h"

#define DRAWS 3 /* of a lab's rig */

/* ---- cases -------------------------------------------------------------------------------------- */

static const struct view_set views_4 = {"4 on a ring", 8, 4, 3, {0, 2, 4, 6}},
                             arc_6 = {"6 on 150 deg", 12, 6, 6, {0, 1, 2, 3, 4, 5}},
                             arc_5 = {"5 on 120 deg", 12, 5, 5, {0, 1, 2, 3, 4}},
                             views_5 = {"5 on a ring", 6, 5, 2, {0, 1, 3, 4, 5}},
                             views_12 = {"12 on a ring",
                                         13,
                                         12,
                                         6,
                                         {0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12}};
static const struct noise noise_3 = {"3 %", 0.03, 0}, noise_low = {"0.3 %", 0.003, 0},
                          noise_blue = {"0.5; blue 2 %", 0.005, 0.02};
static const int32_t size_96[3] = {240, 180, 96};

static const struct judged {
    enum flame_kind kind;
    const struct view_set *views;
    const struct noise *noise;
    const char *wrong; /* its name */
    const int32_t *size;
} cases[] = {
    {FLAME_RING, &views_8, &noise_1, "exact", size_64},
    {FLAME_CAMPFIRE, &views_8, &noise_1, "exact", size_64},
    {FLAME_CAMPFIRE, &arc_6, &noise_3, "exact", size_64},
    {FLAME_GAUSS40, &views_8, &noise_1, "exact", size_64},
    {FLAME_RAGGED, &views_8, &noise_1, "exact", size_64},
    {FLAME_RAGGED, &views_8, &noise_blue, "exact", size_64},
    {FLAME_RAGGED, &views_4, &noise_1, "exact", size_64},
    {FLAME_POOL, &views_8, &noise_1, "exact", size_64},
    {FLAME_POOL, &views_8, &noise_0, "exact", size_64},
    {FLAME_POOL, &views_8, &noise_1, "poses 0.7 px", size_64},
    {FLAME_SHEETS, &views_8, &noise_1, "exact", size_64},
    {FLAME_SHEETS, &arc_6, &noise_3, "exact", size_64},
    {FLAME_SHELL, &views_8, &noise_low, "exact", size_96},
    {FLAME_SHELL, &views_8, &noise_5, "exact", size_64},
    {FLAME_WALL, &views_8, &noise_1, "exact", size_64},
    {FLAME_WALL, &views_8, &noise_blue, "exact", size_64},
    {FLAME_WALL, &views_8, &noise_blue, "black clipped", size_64},
    {FLAME_WALL, &arc_6, &noise_3, "exact", size_64},
    {FLAME_WALL, &arc_6, &noise_3, "black clipped", size_64},
    {FLAME_JET, &views_8, &noise_0, "exact", size_64},
    {FLAME_JET, &views_8, &noise_1, "exact", size_64},
    {FLAME_JET, &views_8, &noise_blue, "exact", size_64},
    {FLAME_JET, &arc_5, &noise_1, "exact", size_64},
    {FLAME_HOLLOW, &views_8, &noise_1, "exact", size_64},
    {FLAME_HOLLOW, &views_8, &noise_1, "poses 0.7 px", size_64},
    {FLAME_HOLLOW, &views_4, &noise_1, "exact", size_64},
    {FLAME_CANDLES, &views_8, &noise_1, "exact", size_64},
    {FLAME_CANDLES, &views_8, &noise_blue, "exact", size_64},
    {FLAME_CANDLES, &views_8, &noise_5, "exact", size_64},
    {FLAME_CANDLES, &views_8, &noise_5, "black clipped", size_64},
    {FLAME_CANDLES, &views_8, &noise_1, "8 bits", size_64},
};

/* Every way to be wrong, in the basis that has the smaller errors: on one flame that was fitted on and four that are
 * held out, and the usual ones on other numbers of cameras. */
static const enum flame_kind lab_flames[] = {FLAME_CAMPFIRE, FLAME_POOL, FLAME_WALL, FLAME_JET,
                                             FLAME_HOLLOW};
static const enum flame_kind count_flames[] = {FLAME_POOL, FLAME_JET};
static const struct view_set *const counts[] = {&views_5, &arc_6, &views_12};
static const char *const usual[] = {"exact", "gains and poses", "gains and poses in 8 bits"};
#define COUNT(a) (sizeof(a) / sizeof *(a))

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

/* Total light of the volume over the true one, of the channel where that is farthest off. */
static double light_ratio(const struct scene *s, const float *dense)
{
    size_t n = rec_grid_count(&s->rig.grid), nch = (size_t)s->nch;
    double worst = 1;
    for (size_t c = 0; c < nch; c++) {
        double is = 0, should = 0;
        for (size_t i = 0; i < n; i++)
            is += 8 * (double)dense[i * nch + c];
        for (size_t i = 0; i < 8 * n; i++)
            should += (double)s->truth[i * nch + c];
        worst = fabs(log(is / should)) > fabs(log(worst)) ? is / should : worst;
    }
    return worst;
}

/* ---- one case ----------------------------------------------------------------------------------- */

struct run {
    FILE *csv;
    pvx_pool *pool;
    regex_t *choice; /* or NULL: all */
    uint64_t seed;
};

/* Whether a row is chosen; basis and solver NULL: whether one of a case is. */
static bool chosen(const struct run *r, const struct judged *j, const char *basis,
                   const char *solver)
{
    char row[256];
    snprintf(row, sizeof row, "%s, %s, %s, %s, %s, %s", flames[j->kind].name, j->views->name,
             j->noise->name, j->wrong, basis, solver);
    return r->choice == NULL || regexec(r->choice, row, 0, NULL, 0) == 0;
}

static bool any_chosen(const struct run *r, const struct judged *j, enum rec_basis first,
                       enum rec_basis last)
{
    for (int basis = (int)first; basis <= (int)last; basis++)
        for (const char *const *name = rec_solver_names(); *name != NULL; name++)
            if (chosen(r, j, rec_basis_name((enum rec_basis)basis), *name))
                return true;
    return false;
}

/* One row; returns what the solve found of the cameras. */
static struct rec_selfcal_report solver(const struct run *r, const struct judged *j,
                                        const struct scene *s, const struct shot *shot,
                                        const rec_sysmat *S, const char *name, bool corrected)
{
    const struct flame *f = &flames[j->kind];
    double least;
    float *dense = must_floats(rec_grid_count(&S->grid) * (size_t)s->nch);
    struct rec_frame_report report = solve_once(s, shot, S, name, r->pool, dense, &least);
    bench_row(r->csv, "%s,%s,%s,%s,%s,%llu,%d,%s,%s,%s,%u,%.2f,%llu,%.5f,%.4f,%.4f,%s", f->name,
              f->use, j->views->name, j->noise->name, j->wrong, (unsigned long long)r->seed,
              S->grid.n[2], rec_basis_name(S->grid.basis), corrected ? "corrected" : "given", name,
              report.solve.iterations, least, (unsigned long long)report.entries,
              field_error(s, dense, S->grid.basis), view_error(s, dense, r->pool),
              light_ratio(s, dense), rec_status_name(report.solve.status));
    free(dense);
    return report.selfcal;
}

/* All solvers that are chosen, the default first: it says how the pictures are corrected for the others. */
static void solvers(const struct run *r, const struct judged *j, const struct scene *s,
                    const struct shot *shot, const rec_sysmat *S)
{
    struct shot other = {0};
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        if (!chosen(r, j, rec_basis_name(S->grid.basis), *name))
            continue;
        struct rec_selfcal_report found = solver(r, j, s, shot, S, *name, false);
        if (rec_solver_is_default(*name) && (found.gain || found.shift))
            shot_correct(&other, s, shot, &found);
        else if (other.n_cameras > 0)
            (void)solver(r, j, s, &other, S, *name, true);
    }
    shot_free(&other);
}

static void judge_case(const struct run *r, const struct judged *j, enum rec_basis first)
{
    struct scene s;
    struct shot shot;
    if (!any_chosen(r, j, first, REC_TRILINEAR) ||
        !scene_new(&s, j->kind, j->views, j->size, flames[j->kind].t, r->pool))
        return;
    truth_at_points(&s, r->pool);
    wrong_scene(wrong_named(j->wrong), &s, r->seed, r->pool);
    shot_new(&shot, &s, j->noise, r->seed);
    wrong_shot(wrong_named(j->wrong), &s, &shot);
    for (int basis = (int)first; basis <= REC_TRILINEAR; basis++) {
        s.rig.grid.basis = (enum rec_basis)basis;
        if (!any_chosen(r, j, s.rig.grid.basis, s.rig.grid.basis))
            continue;
        rec_sysmat *S = scene_matrix(&s, 0, r->pool);
        solvers(r, j, &s, &shot, S);
        rec_sysmat_free(&S);
    }
    shot_free(&shot);
    scene_fini(&s);
}

/* Every draw.  The same case as one of the list must not make rows twice. */
static void judge_lab(const struct run *r, enum flame_kind kind, const struct view_set *views,
                      const char *wrong)
{
    struct judged j = {kind, views, &noise_1, wrong, size_64};
    struct run of = *r;
    bool listed = false;
    for (size_t i = 0; i < COUNT(cases); i++)
        listed = listed ||
                 (cases[i].kind == kind && cases[i].views == views && cases[i].noise == j.noise &&
                  cases[i].size == j.size && strcmp(cases[i].wrong, wrong) == 0);
    for (int draw = listed; draw < DRAWS; draw++) {
        of.seed = r->seed + (uint64_t)draw;
        judge_case(&of, &j, REC_TRILINEAR);
    }
}

static void judge_labs(const struct run *r)
{
    for (size_t f = 0; f < COUNT(lab_flames); f++)
        for (size_t w = 0; w < N_WRONGS; w++)
            judge_lab(r, lab_flames[f], &views_8, wrongs[w].name);
    for (size_t f = 0; f < COUNT(count_flames); f++)
        for (size_t v = 0; v < COUNT(counts); v++)
            for (size_t w = 0; w < COUNT(usual); w++)
                judge_lab(r, count_flames[f], counts[v], usual[w]);
}

int main(int argc, char **argv)
{
    struct run r = {.seed = argc > 3 ? strtoull(argv[3], NULL, 10) : 1};
    regex_t choice;
    if (argc > 2 && regcomp(&choice, argv[2], REG_EXTENDED | REG_NOSUB) != 0) {
        fprintf(stderr, "%s: no regular expression\n", argv[2]);
        return 1;
    }
    r.choice = argc > 2 ? &choice : NULL;
    CHECK(pvx_pool_new(2, "bench", &r.pool));
    printf("\nevery solver as it stops by itself, against one truth for both bases, %u threads; "
           "wrong: "
           "what the calibration or the pictures do not say\n",
           pvx_pool_threads(r.pool));
    r.csv = bench_csv(argc, argv, "judge",
                      "scene,use,rig,noise,wrong,draw,voxels,basis,pictures,solver,iterations,ms,"
                      "entries,volume,view,light,status");
    for (size_t i = 0; i < COUNT(cases); i++)
        judge_case(&r, &cases[i], REC_BOX);
    judge_labs(&r);
    fclose(r.csv);
    pvx_pool_free(&r.pool);
    if (r.choice != NULL)
        regfree(&choice);
    return *bench_status();
}
