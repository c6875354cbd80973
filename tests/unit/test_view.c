/* test_view.c - pictures by the kept ray matrix are those of direct rendering. */
#include "tests/lib/scene.h"

#include "recon/view/render.h"
#include "recon/geom/rig.h"
#include "recon/view/view.h"
#include "tests/lib/centre.h"

enum { W = 72, H = 50 };

/* Light in a random ball of the volume. */
static void ball(const struct rec_grid *g, int nch, float *dense)
{
    double m[3], r = t_uniform(0.08, 0.2);
    memset(dense, 0, rec_grid_count(g) * (size_t)nch * sizeof *dense);
    for (int a = 0; a < 3; a++)
        m[a] = t_uniform(g->min[a], g->max[a]);
    for (size_t i = 0; i < rec_grid_count(g); i++) {
        double x[3], d = 0;
        grid_centre(g, (int32_t)i, x);
        for (int a = 0; a < 3; a++)
            d += (x[a] - m[a]) * (x[a] - m[a]);
        for (int c = 0; c < nch && d < r * r; c++)
            dense[i * (size_t)nch + (size_t)c] = (float)t_uniform(0, 1);
    }
}

T_CASE(equals_direct_rendering)
{
    struct rec_rig rig;
    T_EQ_I(rec_rig_ring(2, 2.2, W, H, 20, &rig), PVX_OK);
    size_t n = rec_grid_count(&rig.grid);
    float *dense = pvx_calloc(n * 3, sizeof *dense), a[W * H * 3], b[W * H * 3];
    for (int turn = 0; turn < 12; turn++) {
        int nch = turn % 2 == 0 ? 3 : 1, sub = 1 + turn % 3;
        rig.grid.basis = turn % 4 < 2 ? REC_BOX : REC_TRILINEAR;
        rec_view *v;
        T_EQ_I(rec_view_new(&(struct rec_eye){.camera = &rig.cameras[turn % 2], .sub = sub},
                            SIZE_MAX, NULL, &v),
               PVX_OK);
        for (int k = 0; k < 3; k++) { /* light moves about: the columns must follow */
            ball(&rig.grid, nch, dense);
            T_EQ_I(rec_view_render(v, &rig.grid, dense, nch, a), PVX_OK);
            T_EQ_I(rec_render(&rig.grid, dense, nch,
                              &(struct rec_eye){.camera = &rig.cameras[turn % 2], .sub = sub}, NULL,
                              b),
                   PVX_OK);
            double worst = 0, most = 0;
            for (int i = 0; i < W * H * nch; i++) {
                worst = fmax(worst, fabs((double)a[i] - b[i]));
                most = fmax(most, b[i]);
            }
            T_OK(most > 0);
            T_LE(worst, 1e-6 * most);
        }
        rec_view_free(&v);
    }
    free(dense);
    rec_rig_fini(&rig);
}

T_CASE(traces_only_for_new_light)
{
    struct rec_rig rig;
    struct rec_view_stats st;
    rec_view *v;
    T_EQ_I(rec_rig_ring(2, 2.2, W, H, 20, &rig), PVX_OK);
    float *dense = pvx_calloc(20 * 20 * 20, sizeof *dense), img[W * H];
    T_EQ_I(rec_view_new(&(struct rec_eye){.camera = &rig.cameras[0], .sub = 2}, SIZE_MAX, NULL, &v),
           PVX_OK);
    T_EQ_I(rec_view_render(v, &rig.grid, dense, 1, img), PVX_OK); /* dark */
    for (int i = 0; i < W * H; i++)
        T_NEAR(img[i], 0, 0);
    rec_view_get_stats(v, &st);
    T_EQ_I(st.traced * 10 + st.rendered, 1);
    int32_t at = rec_grid_index(&rig.grid, 10, 10, 10);
    dense[at] = 1;
    T_EQ_I(rec_view_render(v, &rig.grid, dense, 1, img), PVX_OK);
    dense[at + 2] = dense[at - 1] = 3; /* next to it */
    dense[at] = 0;
    T_EQ_I(rec_view_render(v, &rig.grid, dense, 1, img), PVX_OK);
    rec_view_get_stats(v, &st);
    T_EQ_I(st.traced * 10 + st.rendered, 13);
    T_EQ_I(st.columns, 125);
    dense[at + 3] = 1;
    T_EQ_I(rec_view_render(v, &rig.grid, dense, 1, img), PVX_OK);
    rec_view_get_stats(v, &st);
    T_EQ_I(st.traced, 2);
    rig.grid.max[2] = 1.1; /* another grid */
    T_EQ_I(rec_view_render(v, &rig.grid, dense, 1, img), PVX_OK);
    rec_view_get_stats(v, &st);
    T_EQ_I(st.traced, 3);
    rec_view_free(&v);
    T_EQ_I(rec_view_new(&(struct rec_eye){.camera = &rig.cameras[0], .sub = 0}, SIZE_MAX, NULL, &v),
           PVX_EINVAL);
    T_EQ_I(rec_view_new(&(struct rec_eye){.camera = &rig.cameras[0], .sub = 2}, 1000, NULL, &v),
           PVX_OK);
    T_EQ_I(rec_view_render(v, &rig.grid, dense, 1, img), PVX_ERANGE);
    T_EQ_I(rec_view_render(v, &rig.grid, dense, 2, img), PVX_EINVAL);
    rec_view_free(&v);
    free(dense);
    rec_rig_fini(&rig);
}

T_CASE_OF_THREADS(threads_give_the_same_bits)
{
    struct rec_rig rig;
    rec_view *v;
    pvx_pool *pool;
    T_EQ_I(rec_rig_ring(2, 2.2, W, H, 20, &rig), PVX_OK);
    float *dense = pvx_calloc(20 * 20 * 20 * 3, sizeof *dense), a[W * H * 3], b[W * H * 3];
    ball(&rig.grid, 3, dense);
    T_EQ_I(rec_view_new(&(struct rec_eye){.camera = &rig.cameras[0], .sub = 2}, SIZE_MAX, NULL, &v),
           PVX_OK);
    T_EQ_I(rec_view_render(v, &rig.grid, dense, 3, a), PVX_OK);
    rec_view_free(&v);
    T_EQ_I(pvx_pool_new(3, "t", &pool), PVX_OK);
    T_EQ_I(rec_view_new(&(struct rec_eye){.camera = &rig.cameras[0], .sub = 2}, SIZE_MAX, pool, &v),
           PVX_OK);
    T_EQ_I(rec_view_render(v, &rig.grid, dense, 3, b), PVX_OK);
    rec_view_free(&v);
    pvx_pool_free(&pool);
    T_EQ_I(memcmp(a, b, sizeof a), 0);
    free(dense);
    rec_rig_fini(&rig);
}

/* A flame that moves is traced anew now and then, not for every picture. */
T_CASE(a_moving_flame)
{
    struct rec_rig rig;
    struct rec_view_stats st;
    rec_view *v;
    T_EQ_I(rec_rig_ring(2, 2.2, W, H, 32, &rig), PVX_OK);
    size_t n = rec_grid_count(&rig.grid);
    float *dense = pvx_calloc(n * 3, sizeof *dense), img[W * H * 3];
    T_EQ_I(rec_view_new(&(struct rec_eye){.camera = &rig.cameras[0], .sub = 2}, SIZE_MAX, NULL, &v),
           PVX_OK);
    for (int k = 0; k < 8; k++) {
        struct rec_flame_pose p = scene_pose(&rig.grid, 1, 0.07 * k);
        rec_flame_voxels(&p, &rig.grid, 0, 32, dense);
        for (size_t i = 0; i < n * 3; i++)
            dense[i] = dense[i] > 0.02f ? dense[i] : 0;
        T_EQ_I(rec_view_render(v, &rig.grid, dense, 3, img), PVX_OK);
    }
    rec_view_get_stats(v, &st);
    T_OK(st.traced >= 1 && st.traced < 8);
    rec_view_free(&v);
    free(dense);
    rec_rig_fini(&rig);
}
