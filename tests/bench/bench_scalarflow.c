/* bench_scalarflow.c - a real capture with one view left out: ScalarFlow's plume, 5 cameras on an arc
 * of 114 degrees, real noise, compression and calibration.  Four views reconstruct, the fifth judges.
 *
 * What tells a fault from a sharp flame was fitted on it: in-sample (flames.h).
 * Grey, 1080x1920 in bins of 4x4 (270x480); each camera is left out in turn.  Nobody corrects the gain of the one that is
 * left out, so its view is also compared at the factor that fits it best (own_gain, at_own_gain). */
#include "capture/pixel/pixfmt.h"
#include "shot.h"
#include "plume.h"
#include "recon/frame/inside.h"

#define BIN     4
#define CAMERAS PLUME_CAMERAS

static const int frames[] = {40, 75, 110};
#define N_FRAMES ((int)(sizeof frames / sizeof *frames))

static FILE *csv;

/* The chosen frames of one camera, grey, [480][270] each; false: no video can be read here. */
static bool read_video(const struct rec_camera *c, float *out[N_FRAMES])
{
    cap_video *v = plume_video(c);
    if (v == NULL)
        return false;
    for (int at = 0, i = 0; i < N_FRAMES; at++) {
        struct cap_image img = plume_next(v, c, BIN);
        if (at != frames[i])
            continue;
        out[i] = must_floats((size_t)c->width * (size_t)c->height);
        CHECK(cap_bin(&img, BIN, 1, 0, c->height, out[i++]));
    }
    cap_video_close(&v);
    return true;
}

/* ---- one view left out -------------------------------------------------------------------------- */

/* Share of the unseen picture's light where the view of the hull is lit. */
static double covered(const struct scene *s, const rec_frame *f, pvx_pool *pool)
{
    const struct rec_subsys *a = rec_frame_subsys(f);
    size_t n = (size_t)s->unseen.width * (size_t)s->unseen.height;
    float *dense = must_floats(rec_grid_count(&s->rig.grid)), *img = must_floats(n);
    double all = 0, in = 0;
    for (int32_t q = 0; q < a->n; q++)
        dense[a->col[q]] = 1;
    CHECK(rec_render(&s->rig.grid, dense, 1, &(struct rec_eye){.camera = &s->unseen, .sub = 1},
                     pool, img));
    for (size_t i = 0; i < n; i++) {
        all += s->unseen_image[i];
        in += img[i] > 0 ? s->unseen_image[i] : 0;
    }
    free(dense);
    free(img);
    return all > 0 ? in / all : 1;
}

struct sums {
    double view, own_gain, at_own_gain, ms, iterations;
};

static double own_gain(float *img, const float *unseen, size_t n)
{
    double ab = 0, aa = 0;
    for (size_t i = 0; i < n; i++) {
        ab += (double)img[i] * unseen[i];
        aa += (double)img[i] * img[i];
    }
    for (size_t i = 0; i < n && aa > 0; i++)
        img[i] *= (float)(ab / aa);
    return aa > 0 ? ab / aa : 0;
}

static void solve(const struct scene *s, rec_frame *f, float *const image[], struct sums *sum,
                  double *cover, pvx_pool *pool)
{
    size_t n = (size_t)s->unseen.width * (size_t)s->unseen.height;
    float *dense = must_floats(rec_grid_count(&s->rig.grid)), *img = must_floats(n);
    struct rec_sparse v;
    double best = 1e300;
    rec_frame_reset(f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        memcpy(rec_frame_input(f, c), image[c], n * sizeof(float));
        rec_frame_camera(f, c)->present = true;
    }
    rec_frame_carve(f);
    for (int r = 0; r < 2 && (r == 0 || best < 200); r++) { /* the first one touches pages */
        int64_t t0 = pvx_now_mono();
        CHECK(rec_frame_solve(f, 0, NULL));
        best = fmin(best, ms(pvx_now_mono() - t0));
    }
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    CHECK(rec_render(&s->rig.grid, dense, 1, &(struct rec_eye){.camera = &s->unseen, .sub = 1},
                     pool, img)); /* bins are a quarter voxel */
    sum->view += image_mean_abs_255(img, s->unseen_image, n) / N_FRAMES;
    sum->own_gain += own_gain(img, s->unseen_image, n) / N_FRAMES;
    sum->at_own_gain += image_mean_abs_255(img, s->unseen_image, n) / N_FRAMES;
    sum->ms += best / N_FRAMES;
    sum->iterations += (double)rec_frame_get_report(f)->solve.iterations / N_FRAMES;
    if (cover != NULL)
        *cover += covered(s, f, pool) / N_FRAMES;
    free(dense);
    free(img);
}

static void leave_out(const struct rec_camera cam[CAMERAS], const struct rec_grid *g, int out,
                      float *image[CAMERAS][N_FRAMES], pvx_pool *pool)
{
    struct scene s = {.nch = 1, .unseen = cam[out]};
    struct rec_camera used[CAMERAS];
    int from[CAMERAS], n = 0;
    for (int c = 0; c < CAMERAS; c++)
        if (c != out) {
            from[n] = c;
            used[n++] = cam[c];
        }
    s.rig = (struct rec_rig){.grid = *g, .n_cameras = (size_t)n, .cameras = used};
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        s.rig.grid.basis = (enum rec_basis)basis;
        rec_sysmat *S = scene_matrix(&s, 1, pool);
        double cover = 0;
        for (int k = 0; rec_solver_names()[k] != NULL; k++) {
            struct rec_frame_params p = rec_frame_defaults;
            rec_frame *f;
            struct sums sum = {0};
            p.nch = 1;
            p.solve.solver = rec_solver_names()[k];
            CHECK(rec_frame_alone(S, &s.rig, &p, pool, &f, NULL));
            for (int i = 0; i < N_FRAMES; i++) {
                float *used_image[CAMERAS];
                for (int c = 0; c < n; c++)
                    used_image[c] = image[from[c]][i];
                s.unseen_image = image[out][i];
                solve(&s, f, used_image, &sum, k == 0 ? &cover : NULL, pool);
            }
            const struct rec_frame_report *r = rec_frame_get_report(f);
            bench_row(csv, "%s,%s,%s,%.4f,%.3f,%.4f,%.1f,%.3f,%lld,%llu,%.4f,%.4f", cam[out].name,
                      rec_basis_name(s.rig.grid.basis), p.solve.solver, sum.view, sum.own_gain,
                      sum.at_own_gain, sum.iterations, sum.ms, (long long)r->active_voxels,
                      (unsigned long long)r->entries, cover, (double)r->sigma);
            rec_frame_free(&f);
        }
        rec_sysmat_free(&S);
    }
}

int main(int argc, char **argv)
{
    struct rec_camera cam[CAMERAS];
    struct rec_grid g;
    static float *image[CAMERAS][N_FRAMES];
    pvx_pool *pool;
    if (!plume_rig(BIN, cam, &g))
        return *bench_status();
    for (int c = 0; c < CAMERAS; c++)
        if (!read_video(&cam[c], image[c]))
            return *bench_status();
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf(
        "\nreal capture (ScalarFlow; fitted: in-sample), grey 270x480, 64x96x64 voxels, 4 views "
        "in, the fifth judges; mean of %d frames, %u threads, default stops; covered: share of its "
        "light in the hull\n",
        N_FRAMES, pvx_pool_threads(pool));
    csv = bench_csv(argc, argv, "scalarflow",
                    "left_out,basis,solver,view,own_gain,at_own_gain,iterations,ms,voxels,entries,"
                    "covered,sigma");
    for (int c = 0; c < CAMERAS; c++) /* the data set keeps train02 for tests */
        leave_out(cam, &g, c, image, pool);
    for (int c = 0; c < CAMERAS; c++)
        for (int i = 0; i < N_FRAMES; i++)
            free(image[c][i]);
    fclose(csv);
    pvx_pool_free(&pool);
    return 0;
}
