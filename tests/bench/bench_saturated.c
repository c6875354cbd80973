/* bench_saturated.c - flames of which 5 % (and 20 %) of the pixels are brighter than full scale: the error when these
 * are left out, when they say "at least this", and of pictures that had room for them. */
#include "curve.h"

static const enum flame_kind kinds[] = {FLAME_WALL,    FLAME_POOL,  FLAME_JET,   FLAME_HOLLOW,
                                        FLAME_CANDLES, FLAME_SHELL, FLAME_SHEETS};
static const double parts[] = {0.05, 0.2};

static int compare(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return x < y ? -1 : x > y;
}

/* The value that `share` of the flame's pixels are above in some channel. */
static double level(const struct scene *s, double share)
{
    size_t n = 0, all = 0;
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        all += (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height;
    float *v = must_floats(all);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        size_t m = (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height;
        for (size_t i = 0; i < m; i++) {
            const float *p = s->image[c] + 3 * i;
            float most = fmaxf(p[0], fmaxf(p[1], p[2]));
            if (most > 0.01 * s->peak)
                v[n++] = most;
        }
    }
    qsort(v, n, sizeof *v, compare);
    double at = (double)v[(size_t)((1 - share) * (double)n)];
    free(v);
    return at;
}

struct result {
    double error, ms;
    uint32_t saturated;
};

static struct result solve(const struct scene *s, const struct shot *shot, const rec_sysmat *S,
                           bool clip, bool at_least, pvx_pool *pool)
{
    struct rec_frame_params p = rec_frame_defaults;
    size_t n = rec_grid_count(&S->grid) * 3;
    float *dense = must_floats(n);
    struct result out = {.ms = INFINITY};
    struct rec_sparse v;
    rec_frame *f;
    p.photo.saturation = clip ? 1 : REC_PHOTO_UNSATURATED;
    p.at_least = at_least;
    CHECK(rec_frame_alone(S, &s->rig, &p, pool, &f, NULL));
    for (int r = 0; r < 3; r++) {
        shot_put(shot, f);
        for (size_t c = 0; c < s->rig.n_cameras && clip; c++) {
            float *px = rec_frame_input(f, c);
            for (size_t i = 0; i < shot->floats[c]; i++)
                px[i] = fminf(px[i], 1);
        }
        rec_frame_carve(f);
        CHECK(rec_frame_solve(f, 0, NULL));
        out.ms = fmin(out.ms, ms(rec_frame_total_ns(rec_frame_get_report(f))));
    }
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    out.error = rec_rel_l2(dense, s->truth, n);
    out.saturated = rec_frame_get_report(f)->saturated;
    rec_frame_free(&f);
    free(dense);
    return out;
}

static void flame(FILE *csv, enum flame_kind kind, double share, pvx_pool *pool)
{
    struct scene s;
    struct shot shot;
    if (!scene_new(&s, kind, &views_8, size_64, flames[kind].t, pool))
        return;
    scene_rescale(&s, 1 / level(&s, share));
    const struct noise noise = {"1 %", 0.01 / s.peak, false, 0}; /* of full scale */
    shot_new(&shot, &s, &noise, 1);
    scene_truth(&s, REC_TRILINEAR, pool);
    rec_sysmat *S = scene_matrix(&s, 0, pool, NULL);
    struct result whole = solve(&s, &shot, S, false, false, pool);
    struct result out = solve(&s, &shot, S, true, false, pool);
    struct result least = solve(&s, &shot, S, true, true, pool);
    bench_row(csv, "%s,%s,%g,%u,%.4f,%.4f,%.4f,%.3f,%.3f,%.2f", flames[kind].name, flames[kind].use,
              100 * share, out.saturated, whole.error, out.error, least.error,
              out.error / whole.error, least.error / whole.error, least.ms / out.ms);
    rec_sysmat_free(&S);
    shot_free(&shot);
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\nsaturated pixels; 64^3 trilinear, 8 views of 160x120, noise 1 %% of full scale\n");
    FILE *csv = bench_csv(argc, argv, "saturated",
                          "scene,use,share,pixels,whole,left out,at least,left out over whole,at "
                          "least over whole,time");
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++)
        for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
            flame(csv, kinds[k], parts[i], pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
