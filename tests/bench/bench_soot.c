/* bench_soot.c - temperature and soot of flames whose both are known: NUMERICS.md, 22.
 *
 * 8 cameras of 160x120, 64^3, trilinear, the default solver with its error bars (8 solves).  Three published response
 * curves, shot noise, 8 and 12 bits, without and with self-absorption; with it, the solver has its term (kappa over
 * emission as it is on average) or not.  `own`: the temperature is the flame's, steep across each front.
 * Columns: voxels whose weakest channel is above 20 and 5 to 20 of its bars; |dT|/T of half and of 95 % of those that have a
 * temperature, its mean; share of them within 2 bars, T and f; share of all voxels with soot that are called soot.
 *
 *     bench_soot [FOLDER] [FLAME] */
#include "base/median.h"
#include "soot.h"

static const struct {
    const char *name;
    struct soot_flame f;
} cases[] = {
    {"wall", {at_wall, false, 0.5e-6}},    {"pool", {at_pool, false, 0.5e-6}},
    {"shell", {at_shell, false, 0.5e-6}},  {"sheets", {at_sheets, false, 0.5e-6}},
    {"round", {at_round, false, 0.5e-6}},  {"round thin", {at_round, false, 0.1e-6}},
    {"wall own", {at_wall, true, 0.5e-6}}, {"pool own", {at_pool, true, 0.5e-6}},
};
#define COUNT(a) (sizeof(a) / sizeof *(a))

struct bed {
    struct rec_rig rig;
    rec_sysmat *S;
    pvx_pool *pool;
    rec_bars *bars;
};

/* The c for which c e is nearest to kappa over the flame, by least squares. */
static double absorption(const struct soot_flame *f, const struct soot_cameras *k, int c,
                         const struct rec_grid *g)
{
    double kappa = 0, light = 0;
    for (int32_t i = 0; i < g->n[0] * g->n[1] * g->n[2]; i += 7) {
        double x[3], amount, T, e[3];
        grid_centre(g, i, x);
        soot_flame_at(f, x, &amount, &T);
        rec_soot_emission(k->m[c], T, e);
        double thick = amount * (k->kappa[c][0] + k->kappa[c][1] + k->kappa[c][2]) / 3;
        double bright = amount * (e[0] + e[1] + e[2]) / 3;
        kappa += thick * bright;
        light += bright * bright;
    }
    return kappa / light;
}

/* The mean misfit by the right curves, and by those of the other cameras calibrated by the same lamp. */
static void lean(const struct soot_cameras *k, int c, const struct rec_sparse *v,
                 const struct rec_bars_view *view, char *text, size_t size)
{
    size_t n = 0;
    for (int i = 0; i < CURVES; i++) {
        struct rec_spectral s = k->s[(c + i) % CURVES];
        rec_soot *m;
        double mean;
        for (int q = 0; q < 3 && i > 0; q++)
            s.constant[q] = k->s[c].constant[q] *
                            rec_planck_channel(&k->s[c], q, 2850, NULL, NULL, NULL) /
                            rec_planck_channel(&s, q, 2850, NULL, NULL, NULL);
        CHECK(rec_soot_new(&s, &rec_soot_defaults, &m, NULL));
        double z = soot_lean(m, s.covariance, v, view, &mean);
        n += (size_t)snprintf(text + n, size - n, ",%.2f,%.1f", 100 * mean, z);
        rec_soot_free(&m);
    }
}

static void row(FILE *csv, const char *name, int c, int bits, const char *absorbed,
                const struct soot_score *s, const char *leans)
{
    double all = 0;
    for (int k = 0; k < REC_N_SOOT_STATES; k++)
        all += (double)s->state[k];
    for (int k = 0; k < SOOT_CLASSES; k++) {
        double n = fmax((double)s->known[k], 1);
        bench_row(csv, "%s,%d,%d,%s,%s,%zu,%.2f,%.2f,%+.2f,%.1f,%.1f,%.1f,%.1f%s", name, c, bits,
                  absorbed, k == 0 ? ">20" : "5..20", s->known[k], 100 * soot_quantile(s, k, 0.5),
                  100 * soot_quantile(s, k, 0.95), 100 * s->mean[k], 100 * (double)s->held_t[k] / n,
                  100 * (double)s->held_f[k] / n, 100 * (double)s->state[REC_SOOT_OK] / all,
                  100 * (double)s->state[REC_SOOT_NOT] / all, leans);
    }
}

static void judge(FILE *csv, const struct bed *b, size_t i, const struct soot_pictures *p, int c,
                  int bits, int absorbed)
{
    static const char *const said[] = {"no", "unknown", "term", "shade"};
    double scale[CURVES];
    struct soot_cameras k;
    struct rec_frame_params fp = rec_frame_defaults;
    struct rec_sparse v;
    struct rec_bars_view view;
    struct soot_score s;
    rec_frame *f;
    char leans[160];
    int way = 2 * c + (absorbed > 0);
    for (int q = 0; q < CURVES; q++)
        scale[q] = PEAK / p->peak[2 * q + (absorbed > 0)];
    soot_cameras_new(&k, scale);
    fp.nch = 3;
    fp.photo.saturation = 1e30F;
    fp.absorption = absorbed == 2 ? absorption(&cases[i].f, &k, c, &b->rig.grid) : 0;
    CHECK(rec_frame_alone(b->S, &b->rig, &fp, b->pool, &f, NULL));
    bench_seed(1000 * i + 100 * (size_t)c + (size_t)bits);
    soot_expose(f, p, way, scale[c], bits);
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
    CHECK(rec_frame_bars(f, b->bars, 1, &view));
    rec_frame_volume(f, &v);
    double *tau = NULL, kappa[3];
    if (absorbed == 3) {
        struct rec_shade shade;
        rec_shade_kappa(&k.s[c], &rec_soot_defaults, kappa);
        rec_shade_init(&shade, &b->rig, &b->rig.grid, kappa);
        tau = soot_shade(k.m[c], &shade, &v, &view);
    }
    soot_judge(&cases[i].f, k.m[c], &v, &view, tau, &s);
    free(tau);
    lean(&k, c, &v, &view, leans, sizeof leans);
    row(csv, cases[i].name, c, bits, said[absorbed], &s, leans);
    soot_score_free(&s);
    rec_frame_free(&f);
    soot_cameras_free(&k);
}

int main(int argc, char **argv)
{
    struct bed b;
    struct scene s;
    struct soot_cameras k;
    struct pvx_diag d = {""};
    CHECK(pvx_pool_new(2, "bench", &b.pool));
    scene_views(&s, &views_8, size_64[0], size_64[1], size_64[2]);
    b.rig = s.rig;
    b.rig.grid.basis = REC_TRILINEAR;
    s.rig = b.rig;
    b.S = scene_matrix(&s, 0, b.pool);
    bench_check(rec_bars_new(b.S, 3, 8, &b.bars, &d), &d);
    soot_cameras_new(&k, NULL);
    FILE *csv = bench_csv(
        argc, argv, "soot",
        "flame,camera,bits,absorbs,clear,voxels,half %,95 %,mean %,T in 2,f in 2,soot %,not %,"
        "misfit %,over sd,other 1 %,over sd,other 2 %,over sd");
    for (size_t i = 0; i < COUNT(cases); i++) {
        struct soot_pictures p;
        if (argc > 2 && strcmp(argv[2], cases[i].name) != 0)
            continue;
        soot_shoot(&p, &cases[i].f, &k, &b.rig, b.pool);
        for (int c = 0; c < CURVES; c++)
            for (int bits = 8; bits <= 12; bits += 4)
                for (int absorbed = 0; absorbed < (c == 0 ? 4 : 1); absorbed++)
                    judge(csv, &b, i, &p, c, bits, absorbed);
        soot_pictures_free(&p);
    }
    fclose(csv);
    soot_cameras_free(&k);
    rec_bars_free(&b.bars);
    rec_sysmat_free(&b.S);
    rec_rig_fini(&b.rig);
    pvx_pool_free(&b.pool);
    return *bench_status();
}
