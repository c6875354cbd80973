/* bench_temporal.c - moving flames with the volume before and without: error over that of single frames, the
 * time of a frame over theirs.
 *
 * Eight cameras, 160x120, 64 voxels high, 5 % and 1 % noise, both bases.  The ring moves at 30 Hz; the fires are
 * volumes 1/24 s apart and stay so, which is harder: nothing between them is made up.  Means over all frames but
 * the first; both: the mean with the way from the last frame to the first, over the frames between those two.
 * And a flame that jumps: frame by frame another one, 16 cm to the side. */
#include "curve.h"

#define MAX_FRAME 12

struct way {
    rec_frame *f[2];
    bool temporal;
    double error, ms;
    double inner; /* error of the frames that have one on either side */
    float *volume[MAX_FRAME];
};

static void way_new(struct way *w, const struct scene *s, const rec_sysmat *S, bool temporal,
                    pvx_pool *pool)
{
    struct rec_frame_params p = rec_frame_defaults;
    *w = (struct way){.temporal = temporal};
    p.nch = s->nch;
    p.photo.saturation = 1e30F;
    p.temporal = temporal;
    for (int i = 0; i < 2; i++)
        CHECK(rec_frame_alone(S, &s->rig, &p, pool, &w->f[i], NULL));
}

/* Frame i; the shorter time of three, the first of which touches pages. */
static void way_step(struct way *w, const struct scene *s, const struct shot *shot, int i,
                     float *dense)
{
    rec_frame *f = w->f[i % 2];
    struct rec_sparse before, now;
    int64_t least = INT64_MAX;
    rec_frame_volume(w->f[(i + 1) % 2], &before);
    for (int r = 0; r < 3; r++) {
        shot_put(shot, f);
        rec_frame_carve(f);
        CHECK(rec_frame_solve(f, 0, w->temporal && i > 0 ? &before : NULL));
        int64_t t = rec_frame_total_ns(rec_frame_get_report(f));
        least = t < least ? t : least;
    }
    rec_frame_volume(f, &now);
    rec_sparse_to_dense(&now, dense);
    if (i == 0)
        return;
    w->error += rec_rel_l2(dense, s->truth, rec_grid_count(&s->rig.grid) * (size_t)s->nch);
    w->ms += ms(least);
}

/* From the last frame to the first, and the mean with w's volumes: error of the inner frames. */
static double both_ways(struct way *w, const struct scene *s, int n, const rec_sysmat *S,
                        const struct noise *noise, pvx_pool *pool)
{
    size_t floats = rec_grid_count(&S->grid) * (size_t)s->nch;
    float *dense = must_floats(floats);
    struct way back;
    double error = 0;
    way_new(&back, s, S, true, pool);
    for (int k = 0; k < n; k++) {
        int i = n - 1 - k;
        struct shot shot;
        shot_new(&shot, &s[i], noise, 1 + (uint64_t)i);
        way_step(&back, &s[i], &shot, k, dense);
        for (size_t q = 0; q < floats; q++)
            dense[q] = 0.5F * (dense[q] + w->volume[i][q]);
        if (i > 0 && k > 0)
            error += rec_rel_l2(dense, s[i].truth, floats) / (n - 2);
        shot_free(&shot);
    }
    for (int i = 0; i < 2; i++)
        rec_frame_free(&back.f[i]);
    free(dense);
    return error;
}

static void sequence(FILE *csv, const char *name, const char *use, struct scene *s, int n,
                     pvx_pool *pool)
{
    const struct noise *noise[] = {&noise_5, &noise_1};
    for (int basis = REC_TRILINEAR; basis >= REC_BOX; basis--) {
        for (int i = 0; i < n; i++)
            scene_truth(&s[i], (enum rec_basis)basis, pool);
        rec_sysmat *S = scene_matrix(&s[0], 2, pool, NULL);
        size_t floats = rec_grid_count(&S->grid) * (size_t)s->nch;
        for (int k = 0; k < 2; k++) {
            struct way way[2];
            double trust = 0;
            for (int t = 0; t < 2; t++)
                way_new(&way[t], s, S, t, pool);
            for (int i = 0; i < n; i++) {
                struct shot shot;
                shot_new(&shot, &s[i], noise[k], 1 + (uint64_t)i);
                for (int t = 0; t < 2; t++) {
                    way[t].volume[i] = must_floats(floats);
                    way_step(&way[t], &s[i], &shot, i, way[t].volume[i]);
                    if (i > 0 && i < n - 1)
                        way[t].inner += rec_rel_l2(way[t].volume[i], s[i].truth, floats) / (n - 2);
                }
                trust += rec_frame_get_report(way[1].f[i % 2])->temporal / (n - 1);
                shot_free(&shot);
            }
            bench_row(csv, "%s,%s,%s,%s,%.4f,%.4f,%.3f,%.1f,%.2f,%.2f,%.3f", name, use,
                      rec_basis_name((enum rec_basis)basis), noise[k]->name, way[0].error / (n - 1),
                      way[1].error / (n - 1), way[1].error / way[0].error, way[0].ms / (n - 1),
                      way[1].ms / way[0].ms, trust,
                      both_ways(&way[1], s, n, S, noise[k], pool) / way[0].inner);
            for (int t = 0; t < 2; t++) {
                for (int i = 0; i < 2; i++)
                    rec_frame_free(&way[t].f[i]);
                for (int i = 0; i < n; i++)
                    free(way[t].volume[i]);
            }
        }
        rec_sysmat_free(&S);
    }
    for (int i = 0; i < n; i++)
        scene_fini(&s[i]);
}

/* The first n volumes of a flame, with one exposure for all, as a camera has. */
static void volumes(FILE *csv, enum flame_kind kind, int n, pvx_pool *pool)
{
    static struct scene s[MAX_FRAME];
    double peak = 0;
    for (int i = 0; i < n; i++)
        if (!scene_new(&s[i], kind, &views_8, size_64, i, pool))
            return;
    for (int i = 0; i < n; i++)
        peak = fmax(peak, s[i].peak / s[i].scale);
    for (int i = 0; i < n; i++)
        scene_rescale(&s[i], PEAK / (peak * s[i].scale));
    sequence(csv, flames[kind].name, "seen", s, n,
             pool); /* the trust was chosen with them in sight */
}

int main(int argc, char **argv)
{
    static struct scene s[MAX_FRAME];
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\nthe volume before as what is expected, 8 x 160x120, %u threads; trust: how far\n",
           pvx_pool_threads(pool));
    FILE *csv = bench_csv(argc, argv, "temporal",
                          "scene,use,basis,noise,single,temporal,ratio,ms,time,trust,both");
    for (int i = 0; i < MAX_FRAME; i++)
        (void)scene_new(&s[i], FLAME_RING, &views_8, size_64, 0.3 + i / 30.0, pool);
    sequence(csv, "ring", "fitted", s, MAX_FRAME, pool);
    volumes(csv, FLAME_CAMPFIRE, MAX_FRAME, pool);
    volumes(csv, FLAME_JET, 4, pool); /* the first four follow each other */
    volumes(csv, FLAME_HOLLOW, 4, pool);
    volumes(csv, FLAME_CANDLES, 4, pool);
    for (int i = 0; i < 4; i++) {
        scene_views(&s[i], &views_8, 160, 120, 64);
        pose_ring(&s[i], (uint32_t)(1 + i), 0.3, i % 2 == 0 ? -0.08 : 0.08);
        scene_shoot(&s[i], pool);
    }
    sequence(csv, "jumps", "fitted", s, 4, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
