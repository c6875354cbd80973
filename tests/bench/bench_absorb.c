/* bench_absorb.c - flames that absorb their own light, to a depth of 0 to 4 along the densest ray: the error with
 * nothing done about it, with the c that was, and with the c that is found; what the term costs. */
#include "curve.h"
#include "recon/check/absorption.h"

static const enum flame_kind kinds[] = {FLAME_WALL,    FLAME_POOL,  FLAME_JET,   FLAME_HOLLOW,
                                        FLAME_CANDLES, FLAME_SHELL, FLAME_SHEETS};
static const double depths[] = {0, 1, 2, 4};

/* The scene again with an optical depth of `depth` along the densest ray of the pictures, as bright as before; c in
 * its pixel values. */
static double darken(struct scene *s, double depth, pvx_pool *pool)
{
    double densest = 0;
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        size_t n = (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height;
        for (size_t i = 0; i < n; i++) {
            const float *p = s->image[c] + 3 * i;
            densest = fmax(densest, ((double)p[0] + (double)p[1] + (double)p[2]) / 3 / s->scale);
        }
        free(s->image[c]);
    }
    free(s->unseen_image);
    s->field.absorb = depth / densest;
    scene_shoot(s, pool);
    scene_rescale(s, PEAK / s->peak);
    return s->field.absorb / s->scale;
}

/* ---- c as it is found ---- */

struct source {
    const struct scene *s;
    float *grey[REC_MAX_CAMERAS];
};

static pvx_err get(void *ctx, size_t i, struct rec_check_set *out)
{
    struct source *g = ctx;
    *out = (struct rec_check_set){i, (const float *const *)g->grey, true};
    return PVX_OK;
}

static struct rec_absorption find(const struct scene *s, const struct shot *shot, pvx_pool *pool)
{
    struct source g = {.s = s};
    struct rec_check_source from = {.n = 1, .get = get, .ctx = &g};
    const struct rec_unseen_params p = REC_UNSEEN_DEFAULTS;
    struct rec_absorption a;
    rec_unseen *u;
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        size_t n = shot->floats[c] / 4;
        g.grey[c] = must_floats(n);
        for (size_t i = 0; i < n; i++)
            g.grey[c][i] =
                (shot->px[c][4 * i] + shot->px[c][4 * i + 1] + shot->px[c][4 * i + 2]) / 3;
    }
    CHECK(rec_unseen_new(&s->rig, &p, pool, &u, NULL));
    CHECK(rec_absorption_find(u, &from, &a, NULL));
    rec_unseen_free(&u);
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        free(g.grey[c]);
    return a;
}

/* ---- one flame ---- */

/* Error with this c; the least time of carving and solving. */
static double solve(const struct scene *s, const struct shot *shot, const rec_sysmat *S, double c,
                    pvx_pool *pool, double *least)
{
    struct rec_frame_params p = rec_frame_defaults;
    size_t n = rec_grid_count(&S->grid) * 3;
    float *dense = must_floats(n);
    struct rec_sparse v;
    rec_frame *f;
    p.photo.saturation = REC_PHOTO_UNSATURATED;
    p.absorption = c;
    CHECK(rec_frame_alone(S, &s->rig, &p, pool, &f, NULL));
    *least = INFINITY;
    for (int r = 0; r < 3; r++) {
        shot_put(shot, f);
        rec_frame_carve(f);
        CHECK(rec_frame_solve(f, 0, NULL));
        *least = fmin(*least, ms(rec_frame_total_ns(rec_frame_get_report(f))));
    }
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    double error = rec_rel_l2(dense, s->truth, n);
    rec_frame_free(&f);
    free(dense);
    return error;
}

static void flame(FILE *csv, enum flame_kind kind, const struct noise *noise, pvx_pool *pool)
{
    double thin = 0;
    for (size_t i = 0; i < sizeof depths / sizeof *depths; i++) {
        struct scene s;
        struct shot shot;
        double t[3], error[3];
        if (!scene_new(&s, kind, &views_8, size_64, flames[kind].t, pool))
            return;
        double c = darken(&s, depths[i], pool);
        shot_new(&shot, &s, noise, 1);
        scene_truth(&s, REC_TRILINEAR, pool);
        rec_sysmat *S = scene_matrix(&s, 0, pool, NULL);
        struct rec_absorption a = find(&s, &shot, pool);
        const double with[3] = {0, c, a.c};
        for (int k = 0; k < 3; k++)
            error[k] = solve(&s, &shot, S, with[k], pool, &t[k]);
        thin = i == 0 ? error[0] : thin;
        bench_row(csv, "%s,%s,%s,%g,%.4f,%.4f,%.4f,%.3f,%.3f,%.3f,%.3f,%.2f", flames[kind].name,
                  flames[kind].use, noise->name, depths[i], error[0], error[1], error[2],
                  error[2] / thin, c, a.c, a.gain, t[2] / t[0]);
        rec_sysmat_free(&S);
        shot_free(&shot);
        scene_fini(&s);
    }
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\nflames that absorb their own light; 64^3 trilinear, 8 views of 160x120; over thin: "
           "error with the c found over that of the same flame without absorption\n");
    FILE *csv = bench_csv(argc, argv, "absorb",
                          "scene,use,noise,depth,off,known c,found c,over thin,c,c found,gain,"
                          "time");
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        flame(csv, kinds[k], &noise_1, pool);
        flame(csv, kinds[k], &noise_5, pool);
    }
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
