/* scene.h - a small rig, its matrix and pictures of the analytic flame, for tests of recon.
 * Pictures come from the flame's own line integrals, never from the matrix. */
#ifndef SCENE_H
#define SCENE_H
#include "base/mem.h"
#include "base/pool.h"
#include "recon/view/flame.h"
#include "recon/frame/frame.h"
#include "tests/t.h"

struct scene {
    struct rec_rig rig;
    rec_sysmat *S;
    struct rec_flame_pose pose;
    size_t voxels;
    float *truth;                  /* [voxels][3] */
    float *image[REC_MAX_CAMERAS]; /* [bh][bw][4], no noise */
    pvx_pool *pool;
};

/* The flame `seed` of this grid at time t. */
static inline struct rec_flame_pose scene_pose(const struct rec_grid *g, uint32_t seed, double t)
{
    struct rec_flame flame;
    struct rec_flame_pose pose;
    rec_flame_init(&flame, g, seed);
    rec_flame_at(&flame, t, &pose);
    return pose;
}

/* Truth and pictures of the flame at time t. */
__attribute__((unused)) static void scene_at(struct scene *s, double t)
{
    s->pose = scene_pose(&s->rig.grid, 1, t);
    rec_flame_voxels(&s->pose, &s->rig.grid, 0, s->rig.grid.n[2], s->truth);
    float *raw = pvx_calloc((size_t)s->rig.cameras[0].width * (size_t)s->rig.cameras[0].height * 3,
                            sizeof *raw);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        const struct rec_camera *cam = &s->rig.cameras[c];
        rec_flame_render(&s->pose, cam, 4, 0, cam->height, raw);
        for (size_t i = 0; i < (size_t)cam->width * (size_t)cam->height; i++)
            memcpy(s->image[c] + i * 4, raw + i * 3, 3 * sizeof(float));
    }
    free(raw);
}

/* n cameras of w x 3/4 w pixels, grid^3 voxels, auto binning off, `rays` per bin side. */
__attribute__((unused)) static void scene_new(struct scene *s, size_t n, int32_t w, int32_t grid,
                                              int32_t rays, unsigned threads)
{
    memset(s, 0, sizeof *s);
    struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = rays};
    if (pvx_pool_new(threads, "test", &s->pool) != PVX_OK ||
        rec_rig_ring(n, 2.2, w, w * 3 / 4, grid, &s->rig) != PVX_OK ||
        rec_sysmat_build(&s->rig, &p, s->pool, NULL, NULL, &s->S, NULL) != PVX_OK)
        exit(2); /* nothing in a test makes sense without it */
    s->voxels = rec_grid_count(&s->rig.grid);
    s->truth = pvx_calloc(s->voxels * 3, sizeof *s->truth);
    for (size_t c = 0; c < n; c++)
        s->image[c] = pvx_calloc((size_t)w * (size_t)(w * 3 / 4) * 4, sizeof(float));
    scene_at(s, 0.3);
}

__attribute__((unused)) static void scene_free(struct scene *s)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        free(s->image[c]);
    free(s->truth);
    rec_sysmat_free(&s->S);
    rec_rig_fini(&s->rig);
    pvx_pool_free(&s->pool);
}

/* The scene's pictures with Gaussian noise into frame f, all cameras present. */
__attribute__((unused)) static void scene_shoot(const struct scene *s, rec_frame *f, double noise)
{
    rec_frame_reset(f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        size_t n = (size_t)s->S->block[c].bw * (size_t)s->S->block[c].bh;
        float *in = rec_frame_input(f, c);
        for (size_t i = 0; i < n * 4; i++)
            in[i] = s->image[c][i] + (noise > 0 && i % 4 < 3 ? (float)(noise * t_normal()) : 0);
        rec_frame_camera(f, c)->present = true;
    }
}

/* Of frame f's pixels what an RGGB filter leaves: one channel each. */
__attribute__((unused)) static void scene_filter(const struct scene *s, rec_frame *f)
{
    static const uint8_t cell[4] = {0, 1, 1, 2};
    for (size_t k = 0; k < s->rig.n_cameras; k++) {
        size_t w = (size_t)s->S->block[k].bw, n = s->S->row0[k + 1] - s->S->row0[k];
        float *in = rec_frame_input(f, k);
        rec_frame_camera(f, k)->cell = cell;
        rec_frame_camera(f, k)->mosaic = true;
        for (size_t i = 0; i < n; i++)
            for (size_t l = 0; l < 3; l++)
                if (l != cell[(i / w % 2) * 2 + i % w % 2])
                    in[i * 4 + l] = NAN;
    }
}

/* Relative L2 error of a sparse volume against the truth; one of one channel, against the truth's first. */
__attribute__((unused)) static double scene_error(const struct scene *s, const struct rec_sparse *v)
{
    double e = 0, t = 0;
    int32_t at = 0;
    for (size_t i = 0; i < s->voxels; i++) {
        bool in = at < v->n && v->index[at] == (int32_t)i;
        for (int l = 0; l < (v->cs == 1 ? 1 : 3); l++) {
            double truth = s->truth[i * 3 + (size_t)l];
            double d = (in ? v->value[(size_t)at * (size_t)v->cs + (size_t)l] : 0) - truth;
            e += d * d;
            t += truth * truth;
        }
        at += in;
    }
    return sqrt(e / t);
}

#endif
