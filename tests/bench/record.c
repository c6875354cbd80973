/* record.c - recordings with known truth, for against.py: of every flame of flames.h that is there a
 * folder with rig.yaml, frames/<camera>/<6 digits>.npy with 1 % noise, and truth.npy (box basis).
 *
 *     record DIR          exit 77: some flame is not there
 *     record DIR plume    the real capture instead, every third frame, grey: rig.yaml and frames */
#include <sys/stat.h>

#include "base/file.h"
#include "capture/pixel/pixfmt.h"
#include "plume.h"

#define FRAMES 12 /* of one instant, each with noise of its own */

static void make_folder(const char *path)
{
    if (mkdir(path, 0777) != 0 && access(path, W_OK) != 0) {
        perror(path);
        exit(1);
    }
}

static void write_rig(const char *dir, const struct rec_rig *r)
{
    char path[1024], *rig;
    size_t len;
    struct pvx_diag d = {""};
    CHECK(rec_rig_format(r, &rig, &len));
    snprintf(path, sizeof path, "%.900s/rig.yaml", dir);
    bench_check(pvx_file_write(path, rig, len, &d), &d);
    free(rig);
}

static void record(const char *dir, const struct scene *s)
{
    char path[1024];
    size_t nch = (size_t)s->nch;
    struct pvx_diag d = {""};
    const struct rec_grid *g = &s->rig.grid;
    const size_t shape[4] = {(size_t)g->n[2], (size_t)g->n[1], (size_t)g->n[0], nch};
    make_folder(dir);
    write_rig(dir, &s->rig);
    snprintf(path, sizeof path, "%.900s/truth.npy", dir);
    bench_check(cap_npy_save(path, s->truth, shape, s->nch == 1 ? 3 : 4, &d), &d);
    snprintf(path, sizeof path, "%.900s/frames", dir);
    make_folder(path);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        const struct rec_camera *cam = &s->rig.cameras[c];
        size_t n = (size_t)cam->width * (size_t)cam->height * nch;
        float *px = must_floats(n);
        snprintf(path, sizeof path, "%.900s/frames/%.64s", dir, cam->name);
        make_folder(path);
        for (int i = 0; i < FRAMES; i++) {
            for (size_t k = 0; k < n; k++)
                px[k] = s->image[c][k] + (float)(0.01 * s->peak * bench_normal());
            snprintf(path, sizeof path, "%.900s/frames/%.64s/%06d.npy", dir, cam->name, i);
            bench_check(cap_image_save(path, px, cam->width, cam->height, s->nch, &d), &d);
        }
        free(px);
    }
}

static bool record_video(const char *dir, const struct rec_camera *c)
{
    char path[1024];
    float *px = must_floats((size_t)c->width * (size_t)c->height);
    struct pvx_diag d = {""};
    cap_video *v = plume_video(c);
    bool there = v != NULL;
    snprintf(path, sizeof path, "%.900s/frames/%.64s", dir, c->name);
    make_folder(path);
    for (int i = 0; i < PLUME_FRAMES && there; i++) {
        struct cap_image img = plume_next(v, c, 1);
        if (i % 3 != 0)
            continue;
        CHECK(cap_bin(&img, 1, 1, 0, c->height, px));
        snprintf(path, sizeof path, "%.900s/frames/%.64s/%06d.png", dir, c->name, i);
        bench_check(cap_image_save(path, px, c->width, c->height, 1, &d), &d);
    }
    cap_video_close(&v);
    free(px);
    return there;
}

static void record_plume(const char *dir)
{
    char path[1024];
    struct rec_camera cam[PLUME_CAMERAS];
    struct rec_rig r = {.n_cameras = PLUME_CAMERAS, .cameras = cam};
    bool there = plume_rig(1, cam, &r.grid);
    snprintf(path, sizeof path, "%.900s/frames", dir);
    make_folder(path);
    for (int c = 0; c < PLUME_CAMERAS && there; c++)
        there = record_video(dir, &cam[c]);
    if (there)
        write_rig(dir, &r);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    const char *dir = argc > 1 ? argv[1] : ".";
    if (argc > 2 && strcmp(argv[2], "plume") == 0) {
        record_plume(dir);
        return *bench_status();
    }
    CHECK(pvx_pool_new(2, "record", &pool));
    for (int k = 0; k <= N_FLAMES; k++) { /* and one at 128^3 */
        static const int32_t size_128[3] = {320, 240, 128};
        const int kind = k < N_FLAMES ? k : FLAME_SHELL;
        const struct flame *f = &flames[kind];
        struct scene s;
        char path[1024];
        if (kind == FLAME_PLUME || !scene_new(&s, (enum flame_kind)kind, &views_8,
                                              k < N_FLAMES ? size_64 : size_128, f->t, pool))
            continue;
        scene_truth(&s, REC_BOX, pool);
        snprintf(path, sizeof path, "%.900s/%s, %s, %d^3", dir, f->name, f->use, s.rig.grid.n[2]);
        record(path, &s);
        scene_fini(&s);
    }
    pvx_pool_free(&pool);
    return *bench_status();
}
