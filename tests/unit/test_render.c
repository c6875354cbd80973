/* test_render.c - views of volumes with known answers. */
#include "tests/lib/scene.h"

#include "recon/view/flame.h"
#include "recon/view/metrics.h"
#include "recon/view/render.h"
#include "recon/view/view.h"
#include "recon/geom/rig.h"

/* A box full of ones: every ray sees its chord. */
T_CASE(full_box_gives_chords)
{
    struct rec_grid g = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {12, 9, 7}, REC_BOX};
    float *v = malloc(rec_grid_count(&g) * sizeof *v), img[40 * 30];
    for (size_t i = 0; i < rec_grid_count(&g); i++)
        v[i] = 1;
    struct rec_camera c;
    rec_orbit_camera(&g, 0, 0, 40, 30, &c);
    T_EQ_I(rec_render(&g, v, 1, &(struct rec_eye){.camera = &c, .sub = 1}, NULL, img), PVX_OK);
    /* the middle of an even image lies between pixels; all four see almost the whole depth */
    T_NEAR(img[15 * 40 + 20], 1, 2e-3);
    T_NEAR(img[0], 0, 0); /* corners of the image miss */
    double o[3], d[3];
    T_OK(rec_camera_ray(&c, 20, 15, o, d));
    T_NEAR(img[15 * 40 + 20], 1 / fabs(d[0]), 1e-6);
    free(v);
}

/* A wall across the middle of a box full of ones leaves the half before it; a view that keeps its rays agrees. */
T_CASE(bodies_end_rays)
{
    struct rec_grid g = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {12, 9, 7}, REC_BOX};
    size_t n = rec_grid_count(&g);
    float *v = malloc(n * sizeof *v), clear[40 * 30], img[40 * 30], kept[40 * 30];
    for (size_t i = 0; i < n; i++)
        v[i] = 1;
    struct rec_body wall = {.kind = REC_BODY_BOX,
                            .a = {-0.01, -9, -9},
                            .b = {0.01, 9, 9}}; /* half of the camera's rays */
    const struct rec_bodies one = {1, &wall};
    struct rec_camera c;
    rec_orbit_camera(&g, 0, 0, 40, 30, &c);
    struct rec_eye eye = {.camera = &c, .sub = 2};
    T_EQ_I(rec_render(&g, v, 1, &eye, NULL, clear), PVX_OK);
    eye.bodies = &one;
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        g.basis = (enum rec_basis)basis;
        rec_view *view;
        T_EQ_I(rec_render(&g, v, 1, &eye, NULL, img), PVX_OK);
        T_EQ_I(rec_view_new(&eye, SIZE_MAX, NULL, &view), PVX_OK);
        T_EQ_I(rec_view_render(view, &g, v, 1, kept), PVX_OK);
        rec_view_free(&view);
        for (int i = 0; i < 40 * 30; i++)
            T_NEAR(kept[i], img[i], 1e-6);
    }
    g.basis = REC_BOX;
    T_EQ_I(rec_render(&g, v, 1, &eye, NULL, img), PVX_OK);
    double o[3], d[3];
    T_OK(rec_camera_ray(&c, 20, 15, o, d));
    T_NEAR(img[15 * 40 + 20], 0.49 / fabs(d[0]), 2e-5); /* mean of four rays around it */
    T_NEAR(clear[15 * 40 + 20], 1 / fabs(d[0]), 2e-5);
    free(v);
}

/* The turntable camera sees x to the right when it stands at -y, z up, and frames every corner. */
T_CASE(orbit_camera_frames_the_box)
{
    struct rec_grid g = {{1, 2, 3}, {2, 4, 6}, {4, 4, 4}, REC_BOX};
    double tight = 1e9;
    for (int deg = 0; deg < 360; deg += 15)
        for (int el = -40; el <= 40; el += 40) {
            struct rec_camera c;
            rec_orbit_camera(&g, deg * 0.017453292519943295, el * 0.017453292519943295, 120, 200,
                             &c);
            for (int k = 0; k < 8; k++) {
                double X[3], uv[2];
                for (int a = 0; a < 3; a++)
                    X[a] = k >> a & 1 ? g.max[a] : g.min[a];
                T_OK(rec_camera_project(&c, X, uv));
                T_OK(uv[0] > -0.5 && uv[0] < 119.5 && uv[1] > -0.5 && uv[1] < 199.5);
                tight = fmin(tight, fmin(uv[1] + 0.5, uv[0] + 0.5));
            }
        }
    T_LE(tight, 5); /* and the box does fill the image */
    struct rec_camera c;
    double uv0[2], uv1[2], uv2[2];
    rec_orbit_camera(&g, -1.5707963267948966, 0, 100, 100, &c);
    T_OK(rec_camera_project(&c, (double[3]){1.5, 3, 4.5}, uv0));
    T_OK(rec_camera_project(&c, (double[3]){1.6, 3, 4.5}, uv1));
    T_OK(rec_camera_project(&c, (double[3]){1.5, 3, 4.6}, uv2));
    T_NEAR(uv0[0], 49.5, 1e-9);
    T_NEAR(uv0[1], 49.5, 1e-9);
    T_OK(uv1[0] > uv0[0] + 1 && fabs(uv1[1] - uv0[1]) < 1e-9);
    T_OK(uv2[1] < uv0[1] - 1);
}

/* A fine grid of the flame's own voxel values looks like the flame itself, in both bases. */
T_CASE(flame_on_a_grid_looks_like_the_flame)
{
    struct rec_rig rig;
    T_EQ_I(rec_rig_ring(3, 2.2, 80, 60, 64, &rig), PVX_OK);
    struct rec_flame_pose p = scene_pose(&rig.grid, 2, 0.4);
    float *v = malloc(rec_grid_count(&rig.grid) * 3 * sizeof *v);
    float *a = malloc(80 * 60 * 3 * sizeof *a), *b = malloc(80 * 60 * 3 * sizeof *b);
    for (int basis = 0; basis < 2; basis++) {
        rig.grid.basis = basis == 0 ? REC_BOX : REC_TRILINEAR;
        rec_flame_voxels(&p, &rig.grid, 0, 64, v);
        T_EQ_I(rec_render(&rig.grid, v, 3, &(struct rec_eye){.camera = &rig.cameras[1], .sub = 2},
                          NULL, a),
               PVX_OK);
        rec_flame_render(&p, &rig.cameras[1], 2, 0, 60, b);
        T_LE(rec_rel_l2(a, b, 80 * 60 * 3), 0.03);
    }
    free(v);
    free(a);
    free(b);
    rec_rig_fini(&rig);
}

T_CASE_OF_THREADS(threads_give_the_same_bits)
{
    struct rec_grid g = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {16, 16, 16}, REC_TRILINEAR};
    float *v = malloc(rec_grid_count(&g) * 3 * sizeof *v);
    for (size_t i = 0; i < rec_grid_count(&g) * 3; i++)
        v[i] = (float)t_uniform(0, 1);
    struct rec_camera c;
    rec_orbit_camera(&g, 1, 0.3, 50, 41, &c);
    float *a = malloc(50 * 41 * 3 * sizeof *a), *b = malloc(50 * 41 * 3 * sizeof *b);
    T_EQ_I(rec_render(&g, v, 3, &(struct rec_eye){.camera = &c, .sub = 2}, NULL, a), PVX_OK);
    pvx_pool *pool;
    T_EQ_I(pvx_pool_new(3, "t", &pool), PVX_OK);
    T_EQ_I(rec_render(&g, v, 3, &(struct rec_eye){.camera = &c, .sub = 2}, pool, b), PVX_OK);
    pvx_pool_free(&pool);
    T_EQ_I(memcmp(a, b, 50 * 41 * 3 * sizeof *a), 0);
    T_EQ_I(rec_render(&g, v, 3, &(struct rec_eye){.camera = &c, .sub = 0}, NULL, a), PVX_EINVAL);
    T_EQ_I(rec_render(&g, v, 4, &(struct rec_eye){.camera = &c, .sub = 1}, NULL, a), PVX_EINVAL);
    free(v);
    free(a);
    free(b);
}

T_CASE(look_at)
{
    struct rec_camera c;
    double eye[3] = {3, -2, 1.5}, target[3] = {0.2, 0.1, 0.5}, up[3] = {0, 0, 2}, uv[2], X[3];
    T_EQ_I(rec_look_at_camera(eye, target, up, 0.6, 80, 60, &c), PVX_OK);
    rec_camera_centre(&c, X);
    for (int a = 0; a < 3; a++)
        T_NEAR(X[a], eye[a], 1e-12);
    T_OK(rec_camera_project(&c, target, uv));
    T_NEAR(uv[0], 39.5, 1e-9);
    T_NEAR(uv[1], 29.5, 1e-9);
    X[0] = target[0];
    X[1] = target[1];
    X[2] = target[2] + 0.1; /* z is up in the image */
    T_OK(rec_camera_project(&c, X, uv));
    T_NEAR(uv[0], 39.5, 1e-9);
    T_OK(uv[1] < 29);
    /* the top edge of the image is fov/2 above the middle */
    double o[3], d[3], cosine = 0;
    T_OK(rec_camera_ray(&c, 39.5, -0.5, o, d));
    for (int a = 0; a < 3; a++)
        cosine += d[a] * c.R[6 + a];
    T_NEAR(acos(cosine), 0.3, 1e-9);
    double det = 0;
    for (int a = 0; a < 3; a++)
        det += c.R[a] * (c.R[3 + (a + 1) % 3] * c.R[6 + (a + 2) % 3] -
                         c.R[3 + (a + 2) % 3] * c.R[6 + (a + 1) % 3]);
    T_NEAR(det, 1, 1e-12);
    T_EQ_I(rec_look_at_camera(eye, eye, up, 0.6, 80, 60, &c), PVX_EINVAL);
    T_EQ_I(rec_look_at_camera((double[3]){0, 0, 5}, (double[3]){0, 0, 0}, up, 0.6, 80, 60, &c),
           PVX_EINVAL);
    T_EQ_I(rec_look_at_camera(eye, target, up, 0, 80, 60, &c), PVX_EINVAL);
}
