/* test_hull_property.c - the hull is conservative: with exact images no coefficient that carries light
 * is carved, whatever the rig, in both bases, also where some cameras do not see it. */
#include "../t.h"

#include "base/mem.h"
#include "recon/carve/hull.h"
#include "tests/lib/centre.h"

enum { W = 48, H = 36, TURNS = 24, VOXELS = 3, POINTS = 15 };

/* The camera is turned aside until voxel j's support lies partly or, by a hair, wholly outside its
 * image: it then sees that there is no light beside it. */
static void look_past(struct rec_camera *c, const struct rec_grid *g, int32_t j, double by)
{
    double x[3], X[3], uv[2], right = -1e9, reach = g->basis == REC_BOX ? 0.5 : 1;
    grid_centre(g, j, x);
    for (int i = 0; i < POINTS * POINTS * POINTS; i++) {
        int at[3] = {i % POINTS, i / POINTS % POINTS, i / POINTS / POINTS};
        for (int a = 0; a < 3; a++)
            X[a] = x[a] + rec_grid_h(g, a) * reach * (2.0 * at[a] / (POINTS - 1) - 1);
        if (rec_camera_project(c, X, uv))
            right = fmax(right, uv[0]);
    }
    c->cx += -0.5 - right + by;
}

/* Bins in which a point of the inside of voxel j's support is seen. */
static void light_up(const struct rec_camera *c, const struct rec_grid *g, int32_t j, uint8_t *lit)
{
    double x[3], X[3], uv[2], reach = g->basis == REC_BOX ? 0.5 : 1;
    grid_centre(g, j, x);
    for (int i = 0; i < POINTS * POINTS * POINTS; i++) {
        int at[3] = {i % POINTS, i / POINTS % POINTS, i / POINTS / POINTS};
        for (int a = 0; a < 3; a++)
            X[a] = x[a] + 0.999 * rec_grid_h(g, a) * reach * (2.0 * at[a] / (POINTS - 1) - 1);
        if (!rec_camera_project(c, X, uv))
            continue;
        double u = floor(uv[0] + 0.5), v = floor(uv[1] + 0.5);
        if (u >= 0 && v >= 0 && u < c->width && v < c->height)
            lit[(int)v * c->width + (int)u] = 1;
    }
}

/* Glass before it, oblique; a tilted sensor, parallel rays or a lens out of focus behind that. */
static void other_optics(struct rec_camera *c, int kind)
{
    double at[3];
    struct rec_glass *w = &c->window[0];
    rec_camera_centre(c, at);
    for (int a = 0; a < 3; a++) {
        w->normal[a] = cos(0.5) * c->R[6 + a] + sin(0.5) * c->R[3 + a];
        w->at += w->normal[a] * at[a];
    }
    w->at += 0.01;
    w->thickness = 0.05;
    w->index = 1.5;
    c->n_windows = 1;
    if (kind == 1) {
        c->model = REC_SCHEIMPFLUG;
        c->tilt[0] = 0.15;
        c->tilt[1] = -0.1;
    } else if (kind == 2) {
        c->model = REC_TELECENTRIC;
        memset(c->dist, 0, sizeof c->dist);
    } else if (kind == 3) {
        c->blur.aperture = 0.05;
        c->blur.focus = 3;
    }
}

static void no_light(bool other)
{
    static uint8_t bits[6][W * H];
    const uint8_t *lit[6];
    int partly = 0, dark = 0;
    for (int turn = 0; turn < TURNS; turn++) {
        struct rec_rig rig;
        size_t n = 2 + (size_t)turn % 5;
        T_EQ_I(rec_rig_ring(n, 2.2, W, H, 10, &rig), PVX_OK);
        rig.grid.basis = turn % 2 == 0 ? REC_BOX : REC_TRILINEAR;
        for (int a = 0; a < 3; a++)
            rig.grid.n[a] = 7 + (int32_t)(t_rand() % 7);
        int32_t voxel[VOXELS];
        for (int i = 0; i < VOXELS; i++)
            voxel[i] = (int32_t)(t_rand() % rec_grid_count(&rig.grid));
        for (size_t c = 0; c < n; c++) {
            struct rec_camera *cam = &rig.cameras[c];
            double round = t_uniform(0, 6.2831853), far = t_uniform(0.9, 4);
            rec_camera_look(
                (double[3]){far * cos(round), far * sin(round), t_uniform(-0.5, 2)},
                (double[3]){t_uniform(-0.3, 0.3), t_uniform(-0.3, 0.3), t_uniform(0.2, 0.8)}, cam);
            cam->fx = cam->fy = t_uniform(25, 120);
            if (other)
                other_optics(cam, turn / 2 % 4);
            if (turn % 3 == 1)
                look_past(cam, &rig.grid, voxel[0],
                          c % 2 == 0 ? -t_uniform(0, 0.1) : t_uniform(0, 0.5));
        }
        struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = 1 + turn % 2};
        struct rec_hull_params hp = {.min_views = 0, .keep_partial = 1};
        rec_sysmat *S;
        rec_hull *h;
        T_EQ_I(rec_sysmat_build(&rig, &p, NULL, NULL, NULL, &S, NULL), PVX_OK);
        T_EQ_I(rec_hull_new(S, &h), PVX_OK);
        bool present[6];
        for (size_t c = 0; c < n; c++) {
            memset(bits[c], 0, sizeof bits[c]);
            for (int i = 0; i < VOXELS; i++)
                light_up(&rig.cameras[c], &rig.grid, voxel[i], bits[c]);
            lit[c] = bits[c];
            present[c] = turn % 7 != 0 || c != 0;
        }
        int32_t *col = pvx_calloc(rec_grid_count(&rig.grid), sizeof *col);
        uint8_t *klass = pvx_calloc(rec_grid_count(&rig.grid), 1);
        struct rec_hull_kept kept = {.col = col, .klass = klass};
        rec_hull_carve(h, &hp, lit, present, NULL, &kept);
        for (int i = 0; i < VOXELS; i++) {
            bool seen = false;
            int in_dark = 0;
            for (size_t c = 0; c < n; c++) {
                struct rec_rect r = rec_footprint(S, c, voxel[i]);
                bool here = present[c] && rec_rect_seen(r);
                uint8_t own[W * H] = {0};
                size_t light = 0;
                light_up(&rig.cameras[c], &rig.grid, voxel[i], own);
                for (int k = 0; k < W * H; k++)
                    light += own[k];
                seen = seen || (present[c] && light > 0);
                in_dark += here && light == 0;
            }
            partly += seen && in_dark > 0;
            dark += !seen;
            T_CHECK_(!seen || klass[voxel[i]] != 0,
                     "turn %d: voxel %d of %dx%dx%d %s carries light and was carved", turn,
                     voxel[i], rig.grid.n[0], rig.grid.n[1], rig.grid.n[2],
                     rec_basis_name(rig.grid.basis));
        }
        free(col);
        free(klass);
        rec_hull_free(&h);
        rec_sysmat_free(&S);
        rec_rig_fini(&rig);
    }
    T_OK(dark < TURNS); /* most voxels are seen by somebody */
    T_OK(partly > 0);   /* and footprints at an image's edge occur */
}

T_CASE(no_light_is_carved)
{
    no_light(false);
}

T_CASE(no_light_is_carved_behind_glass)
{
    no_light(true);
}
