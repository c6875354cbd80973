/* bench_means.c - the mean of N noisy pictures of one phase of a cycle, solved once: NUMERICS.md, 4.
 *
 * 8 cameras of 120x90, 48^3, trilinear, noise of 5 % of the peak in each picture; `clipped`: a camera without a
 * pedestal sends nothing below 0.  The floor is the error without noise.  `excess` is what noise adds to it,
 * sqrt(error^2 - floor^2), times sqrt N over that of one picture: 1 where the error falls as 1/sqrt N.  The automatic
 * weight of the smoothness term falls with the noise, so that detail comes back too; the same weight for all N shows the
 * noise alone.
 *
 *     bench_means [FOLDER] */
#include "daemon/cli/common/means.h"
#include "wrong.h"

#define NOISE 0.05
static const int32_t size_48[3] = {120, 90, 48};
static const enum flame_kind of[] = {FLAME_WALL, FLAME_POOL, FLAME_JET, FLAME_HOLLOW};
static const uint32_t pictures[] = {1, 4, 16, 64, 256};
#define COUNT(a) (sizeof(a) / sizeof *(a))

/* The mean of n pictures of each camera, in the frame's input. */
static void fill(const struct scene *s, rec_frame *f, uint32_t n, double noise, bool clipped)
{
    size_t nch = (size_t)s->nch, cs = nch == 3 ? 4 : 1;
    rec_frame_reset(f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        size_t px = (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height;
        struct means_sum m = {pvx_calloc(px * cs, sizeof(double)),
                              pvx_calloc(px * cs, sizeof(double)), pvx_calloc(px * cs, 1), px * cs,
                              0};
        struct rec_frame_camera *k = rec_frame_camera(f, c);
        float *in = rec_frame_input(f, c);
        for (uint32_t p = 0; p < n; p++) {
            for (size_t i = 0; i < px * nch; i++) {
                double v =
                    (double)s->image[c][i] + (noise > 0 ? noise * s->peak * bench_normal() : 0);
                in[i / nch * cs + i % nch] = (float)(clipped ? fmax(v, 0) : v);
            }
            means_add(&m, in, INFINITY);
        }
        means_take(&m, in, INFINITY);
        *k = (struct rec_frame_camera){.present = true, .pictures = n};
        CHECK(means_noise(&m, cs, nch, k->noise));
        free(m.sum);
        free(m.square);
        free(m.full);
    }
}

static double error(const struct scene *s, rec_frame *f, float *dense, size_t n)
{
    struct rec_sparse v;
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    return rec_rel_l2(dense, s->truth, n);
}

static const struct {
    const char *blacks, *weight;
    bool clipped;
    float lambda;
} ways[] = {{"pedestal", "automatic", false, -1},
            {"pedestal", "the same", false, 0.04F},
            {"clipped", "automatic", true, -1},
            {"clipped", "the same", true, 0.04F}};

static bool judge(FILE *csv, enum flame_kind kind, pvx_pool *pool)
{
    struct scene s;
    if (!scene_new(&s, kind, &views_8, size_48, 0, pool))
        return false;
    s.rig.grid.basis = REC_TRILINEAR;
    rec_sysmat *S = scene_matrix(&s, 0, pool);
    scene_truth(&s, REC_TRILINEAR, pool);
    size_t n = rec_grid_count(&S->grid) * (size_t)s.nch;
    float *dense = must_floats(n);
    for (size_t w = 0; w < COUNT(ways); w++) {
        struct rec_frame_params p = rec_frame_defaults;
        rec_frame *f;
        p.nch = s.nch;
        p.photo.saturation = 1e30F;
        p.solve.lambda = ways[w].lambda;
        CHECK(rec_frame_alone(S, &s.rig, &p, pool, &f, NULL));
        bench_seed(35);
        fill(&s, f, 1, 0, ways[w].clipped);
        double floor = error(&s, f, dense, n), first = 0;
        for (size_t k = 0; k < COUNT(pictures); k++) {
            fill(&s, f, pictures[k], NOISE, ways[w].clipped);
            double e = error(&s, f, dense, n), excess = sqrt(fmax(0, e * e - floor * floor));
            first = k == 0 ? excess : first;
            bench_row(csv, "%s,%s,%s,%s,%u,%.4f,%.4f,%.2f", flames[kind].name, flames[kind].use,
                      ways[w].blacks, ways[w].weight, pictures[k], e, floor,
                      excess * sqrt(pictures[k]) / first);
        }
        rec_frame_free(&f);
    }
    rec_sysmat_free(&S);
    free(dense);
    scene_fini(&s);
    return true;
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    FILE *csv = bench_csv(argc, argv, "means",
                          "flame,use,blacks,weight,pictures,error,floor,excess x sqrt N");
    for (size_t i = 0; i < COUNT(of); i++)
        (void)judge(csv, of[i], pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
