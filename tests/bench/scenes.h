/* scenes.h - flames with known truth, the cameras that see them and one more that judges.
 *
 *     ring      analytic flame in motion (recon/view/flame.h)
 *     campfire  a fluid simulation's fire, volumes in ../shared/data/campfire (12 frames)
 *     gauss40   40 Gaussians in an ellipsoid, one channel: smooth, convex
 *     ragged    64 thin streaks in five tongues: full of holes, detail below a voxel
 * Images come from line integrals that are known without the system matrix: those of Gaussians in
 * closed form, those of a volume summed in quarter-cell steps.  Pixels are area means. */
#ifndef BENCH_SCENES_H
#define BENCH_SCENES_H
#include "base.h"
#include "field.h"
#include "recon/view/flame.h"
#include "recon/geom/rig.h"

enum flame_kind { FLAME_RING, FLAME_CAMPFIRE, FLAME_GAUSS40, FLAME_RAGGED };
#define CAMPFIRE        "../shared/data/campfire"
#define CAMPFIRE_FRAMES 12

static inline const char *flame_name(enum flame_kind k)
{
    static const char *const name[] = {"ring", "campfire", "gauss40", "ragged"};
    return name[k];
}

/* One instant. */
struct scene {
    struct rec_rig rig;            /* cameras that are used */
    struct rec_camera unseen;      /* and the one that judges */
    int nch;                       /* 1 or 3 */
    struct rec_flame_pose pose;    /* what burns: blobs, */
    struct field field;            /* or a volume, when field.v is not NULL */
    double scale;                  /* of all images and the truth */
    float *image[REC_MAX_CAMERAS]; /* [h][w][nch], clean */
    float *unseen_image;
    float *truth; /* [nz][ny][nx][nch] on rig.grid */
    double peak;  /* brightest value of all images */
};

/* ---- cameras ------------------------------------------------------------------------------------ */

/* `n` cameras `use` of a standard ring of `ring`, and `judge`. */
struct view_set {
    const char *name;
    size_t ring, n, judge;
    uint8_t use[16];
};
/* The ring has uneven steps, so no two of its cameras face each other. */
static const struct view_set views_8 = {"8 on a ring", 9, 8, 4, {0, 1, 2, 3, 5, 6, 7, 8}};

static inline void scene_views(struct scene *s, const struct view_set *v, int32_t w, int32_t h,
                               int32_t voxels)
{
    struct rec_rig full;
    memset(s, 0, sizeof *s);
    s->nch = 3;
    s->scale = 1;
    CHECK(rec_rig_ring(v->ring, 2.2, w, h, voxels, &full));
    CHECK(rec_rig_copy(&full, &s->rig));
    for (size_t c = 0; c < v->n; c++)
        s->rig.cameras[c] = full.cameras[v->use[c]];
    s->rig.n_cameras = v->n;
    s->unseen = full.cameras[v->judge];
    rec_rig_fini(&full);
}

/* ---- images ------------------------------------------------------------------------------------- */

struct flame_job {
    const struct rec_flame_pose *pose;
    const struct rec_camera *camera;
    float *image;
};

static inline void flame_band(void *ctx, size_t band)
{
    const struct flame_job *j = ctx;
    int32_t y0 = (int32_t)band * REC_FLAME_BAND, y1 = y0 + REC_FLAME_BAND;
    rec_flame_render(j->pose, j->camera, 4, y0, y1 < j->camera->height ? y1 : j->camera->height,
                     j->image);
}

/* Three channels or the first of them, times scale; in place. */
static inline void keep_channels(const struct scene *s, float *v, size_t n)
{
    size_t nch = (size_t)s->nch;
    for (size_t i = 0; i < n; i++)
        for (size_t ch = 0; ch < nch; ch++)
            v[i * nch + ch] = (float)s->scale * v[i * 3 + ch];
}

static inline float *scene_image(const struct scene *s, const struct rec_camera *c, pvx_pool *pool)
{
    size_t n = (size_t)c->width * (size_t)c->height;
    float *img;
    if (s->field.v != NULL) {
        img = field_image(&s->field, c, pool);
    } else {
        img = bench_floats(n * 3);
        struct flame_job j = {&s->pose, c, img};
        pvx_pool_run(pool, ((size_t)c->height + REC_FLAME_BAND - 1) / REC_FLAME_BAND, flame_band,
                     &j);
    }
    keep_channels(s, img, n);
    return img;
}

static inline void scene_shoot(struct scene *s, pvx_pool *pool)
{
    s->peak = 0;
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        const struct rec_camera *cam = &s->rig.cameras[c];
        size_t n = (size_t)cam->width * (size_t)cam->height * (size_t)s->nch;
        s->image[c] = scene_image(s, cam, pool);
        for (size_t i = 0; i < n; i++)
            s->peak = fmax(s->peak, s->image[c][i]);
    }
    s->unseen_image = scene_image(s, &s->unseen, pool);
}

/* Multiply what was shot, so that the brightest pixel of a sequence is where it should be. */
static inline void scene_rescale(struct scene *s, double k)
{
    size_t nch = (size_t)s->nch;
    for (size_t c = 0; c <= s->rig.n_cameras; c++) {
        const struct rec_camera *cam = c < s->rig.n_cameras ? &s->rig.cameras[c] : &s->unseen;
        float *img = c < s->rig.n_cameras ? s->image[c] : s->unseen_image;
        for (size_t i = 0; i < (size_t)cam->width * (size_t)cam->height * nch; i++)
            img[i] *= (float)k;
    }
    s->scale *= k;
    s->peak *= k;
}

/* Truth for a basis: its coefficients are cell means (box) or values at the centres. */
static inline void scene_truth(struct scene *s, enum rec_basis basis, pvx_pool *pool)
{
    struct rec_grid *g = &s->rig.grid;
    g->basis = basis;
    free(s->truth);
    if (s->field.v != NULL) {
        s->truth = field_voxels(&s->field, g, pool);
    } else {
        s->truth = bench_floats(rec_grid_count(g) * 3);
        rec_flame_voxels(&s->pose, g, 0, g->n[2], s->truth);
    }
    keep_channels(s, s->truth, rec_grid_count(g));
}

static inline void scene_fini(struct scene *s)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        free(s->image[c]);
    free(s->unseen_image);
    free(s->truth);
    free(s->field.v);
    rec_rig_fini(&s->rig);
}

/* ---- flames ------------------------------------------------------------------------------------- */

/* The peak of a picture whose scale is arbitrary. */
#define PEAK 0.8

/* Seed of the analytic flame, and where it stands (x offset, m). */
static inline void pose_ring(struct scene *s, uint32_t seed, double t, double dx)
{
    struct rec_flame f;
    rec_flame_init(&f, &s->rig.grid, seed);
    rec_flame_at(&f, t, &s->pose);
    for (int b = 0; b < s->pose.n; b++)
        s->pose.blob[b].m[0] += dx;
}

static inline void pose_gauss40(struct scene *s)
{
    s->nch = 1;
    s->pose.n = 40;
    bench_seed(40);
    for (int b = 0; b < 40; b++) {
        struct rec_blob *q = &s->pose.blob[b];
        double u[3], r2;
        do {
            r2 = 0;
            for (int a = 0; a < 3; a++) {
                u[a] = 2 * bench_even() - 1;
                r2 += u[a] * u[a];
            }
        } while (r2 > 1);
        double size = 0.024 + 0.030 * bench_even();
        for (int a = 0; a < 3; a++) {
            q->m[a] = u[a] * (a == 2 ? 0.30 : 0.17) + (a == 2 ? 0.5 : 0);
            q->s[a] = size;
            q->a[a] = 0;
        }
        q->a[0] = 0.5 + bench_even();
    }
}

static inline void pose_ragged(struct scene *s)
{
    s->pose.n = 60;
    bench_seed(60);
    for (int b = 0; b < 60; b++) {
        struct rec_blob *q = &s->pose.blob[b];
        double tongue = 1.2566 * (b % 5), up = bench_even(), out = 0.06 + 0.20 * up;
        q->m[0] = out * cos(tongue + up) + 0.02 * bench_normal();
        q->m[1] = out * sin(tongue + up) + 0.02 * bench_normal();
        q->m[2] = 0.12 + 0.66 * up;
        q->s[0] = q->s[1] = 0.007 + 0.010 * bench_even();
        q->s[2] = 0.015 + 0.045 * bench_even();
        double heat = bench_even();
        q->a[0] = 1;
        q->a[1] = 0.3 + 0.5 * heat;
        q->a[2] = 0.05 + 0.5 * heat * heat;
    }
}

/* The campfire, shrunk to the rig: its box of 2 x 2 x 4 m becomes 1/2 x 1/2 x 1, voxels a 1/64. */
static inline bool pose_campfire(struct scene *s, int frame)
{
    static const double lo[3] = {-0.25, -0.25, 0}, hi[3] = {0.25, 0.25, 1};
    struct rec_grid *g = &s->rig.grid;
    char path[sizeof CAMPFIRE + 32];
    snprintf(path, sizeof path, CAMPFIRE "/emission-%06d.npy", frame);
    if (!field_load(&s->field, path, lo, hi))
        return false;
    memcpy(g->min, lo, sizeof g->min);
    memcpy(g->max, hi, sizeof g->max);
    g->n[0] = g->n[1] = g->n[2] / 2;
    return true;
}

/* A flame seen by a set of cameras: `t` is the time of the ring, or the campfire's frame.  Images
 * only; scene_truth follows.  false: data that are not there, a line says so. */
static inline bool scene_new(struct scene *s, enum flame_kind kind, const struct view_set *v,
                             int32_t w, int32_t h, int32_t voxels, double t, pvx_pool *pool)
{
    scene_views(s, v, w, h, voxels);
    switch (kind) {
    case FLAME_RING: pose_ring(s, 1, t, 0); break;
    case FLAME_GAUSS40: pose_gauss40(s); break;
    case FLAME_RAGGED: pose_ragged(s); break;
    case FLAME_CAMPFIRE:
        if (!pose_campfire(s, (int)t)) {
            printf("  campfire: skipped, no " CAMPFIRE " here\n");
            rec_rig_fini(&s->rig);
            return false;
        }
    }
    scene_shoot(s, pool);
    if (kind != FLAME_RING) /* which is scaled already */
        scene_rescale(s, PEAK / s->peak);
    return true;
}

/* The analytic flame with its truth. */
static inline void scene_flame(struct scene *s, size_t n, int32_t w, int32_t h, int32_t voxels,
                               enum rec_basis basis, double t, pvx_pool *pool)
{
    struct view_set v = {.ring = n + 1, .n = n, .judge = n / 2};
    for (size_t c = 0; c < n; c++)
        v.use[c] = (uint8_t)(c < n / 2 ? c : c + 1);
    (void)scene_new(s, FLAME_RING, &v, w, h, voxels, t, pool);
    scene_truth(s, basis, pool);
}

#endif
