/* scenes.h - a flame of flames.h at an instant, the cameras that see it and one more that judges.
 * Pixels are area means. */
#ifndef BENCH_SCENES_H
#define BENCH_SCENES_H
#include "flames.h"
#include "recon/geom/rig.h"

/* One instant. */
struct scene {
    struct rec_rig rig;            /* cameras that are used */
    struct rec_camera unseen;      /* and the one that judges */
    int nch;                       /* 1 or 3 */
    struct rec_flame_pose pose;    /* what burns: blobs, */
    struct field field;            /* or a field, when it has cells */
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
    if (s->field.n[0] > 0) {
        img = field_image(&s->field, c, pool);
    } else {
        img = must_floats(n * 3);
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
    if (s->field.n[0] > 0) {
        s->truth = field_voxels(&s->field, g, pool);
    } else {
        s->truth = must_floats(rec_grid_count(g) * 3);
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

/* A volume shrunk to the rig: 1 m high, the grid around it in steps of four voxels of 1/64 m. */
static inline bool load_volume(struct scene *s, const struct flame *f, int number)
{
    struct rec_grid *g = &s->rig.grid;
    char path[1024], file[128];
    snprintf(file, sizeof file, "%s/emission-%06d.npy", f->folder, number);
    bench_data(path, file);
    if (!field_load(&s->field, path)) {
        bench_not_run(f->name, path);
        return false;
    }
    for (int a = 0; a < 3; a++) { /* cells are cubes */
        double wide = (double)s->field.n[a] / s->field.n[2];
        double voxels = a < 2 ? 4 * ceil(wide * g->n[2] / 4 - 1e-9) : g->n[2];
        s->field.lo[a] = a < 2 ? -wide / 2 : 0;
        s->field.hi[a] = s->field.lo[a] + wide;
        g->min[a] = a < 2 ? -voxels / g->n[2] / 2 : 0;
        g->max[a] = g->min[a] + voxels / g->n[2];
        if (a < 2)
            g->n[a] = (int32_t)voxels;
    }
    return true;
}

/* A flame at time or frame `t` before the cameras of s->rig and s->unseen.  Images only; scene_truth follows.
 * false: data that are not there, a line says so, and the rig is gone. */
static inline bool scene_burn(struct scene *s, enum flame_kind kind, double t, pvx_pool *pool)
{
    const struct flame *f = &flames[kind];
    s->nch = f->nch;
    if (f->folder != NULL && !load_volume(s, f, (int)t)) {
        rec_rig_fini(&s->rig);
        return false;
    }
    if (f->pose != NULL)
        f->pose(&s->pose);
    else if (f->at != NULL)
        s->field = (struct field){
            .at = f->at, .n = {64, 64, 64}, .lo = {-0.5, -0.5, 0}, .hi = {0.5, 0.5, 1}};
    else if (f->folder == NULL)
        pose_ring(s, 1, t, 0);
    scene_shoot(s, pool);
    if (kind != FLAME_RING) /* which is scaled already */
        scene_rescale(s, PEAK / s->peak);
    return true;
}

/* The same seen by a set of cameras. */
static inline bool scene_new(struct scene *s, enum flame_kind kind, const struct view_set *v,
                             const int32_t size[3], double t, pvx_pool *pool)
{
    scene_views(s, v, size[0], size[1], size[2]);
    return scene_burn(s, kind, t, pool);
}

/* Pictures of 160x120, 64 voxels high. */
static const int32_t size_64[3] = {160, 120, 64};

/* The analytic flame with its truth. */
static inline void scene_flame(struct scene *s, const int32_t size[3], enum rec_basis basis,
                               pvx_pool *pool)
{
    (void)scene_new(s, FLAME_RING, &views_8, size, flames[FLAME_RING].t, pool);
    scene_truth(s, basis, pool);
}

#endif
