/* plume.h - ScalarFlow's plume: a real capture by 5 cameras on an arc, H.264 1080x1920, 120 frames at 30/s; where it is:
 * base.h. */
#ifndef BENCH_PLUME_H
#define BENCH_PLUME_H
#include <cjson/cJSON.h>

#include "base/file.h"
#include "bench.h"
#include "capture/files/imgio.h"

#define PLUME_CAMERAS 5
#define PLUME_FRAMES  120

static inline double plume_number(const cJSON *array, int i)
{
    const cJSON *v = cJSON_GetArrayItem(array, i);
    if (!cJSON_IsNumber(v)) {
        fprintf(stderr, "cameras_opencv.json: a number is missing\n");
        exit(1);
    }
    return v->valuedouble;
}

static inline void plume_camera(const cJSON *from, struct rec_camera *c)
{
    const cJSON *K = cJSON_GetObjectItem(from, "K"), *R = cJSON_GetObjectItem(from, "R");
    const cJSON *t = cJSON_GetObjectItem(from, "t"), *file = cJSON_GetObjectItem(from, "file");
    memset(c, 0, sizeof *c);
    if (cJSON_IsString(file)) /* train00.mp4 */
        snprintf(c->name, sizeof c->name, "%.*s", (int)strcspn(file->valuestring, "."),
                 file->valuestring);
    c->width = 1080;
    c->height = 1920;
    c->fx = plume_number(cJSON_GetArrayItem(K, 0), 0);
    c->fy = plume_number(cJSON_GetArrayItem(K, 1), 1);
    c->cx = plume_number(cJSON_GetArrayItem(K, 0), 2);
    c->cy = plume_number(cJSON_GetArrayItem(K, 1), 2);
    for (int i = 0; i < 9; i++)
        c->R[i] = plume_number(cJSON_GetArrayItem(R, i / 3), i % 3);
    for (int i = 0; i < 3; i++) {
        c->t[i] = plume_number(t, i);
        c->gain[i] = 1;
    }
}

/* Cameras of the bins: the same lens with wider pixels, pixel (0,0) again a centre. */
static inline void plume_bin(struct rec_camera *c, int bin)
{
    c->width /= bin;
    c->height /= bin;
    c->fx /= bin;
    c->fy /= bin;
    c->cx = (c->cx + 0.5) / bin - 0.5;
    c->cy = (c->cy + 0.5) / bin - 0.5;
}

/* Cameras of bins of bin x bin pixels, and the data set's own box: world = M (scale u), u in [0,1]^3, axis-parallel with y
 * up; false: it is not there. */
static inline bool plume_rig(int bin, struct rec_camera cam[PLUME_CAMERAS], struct rec_grid *g)
{
    char path[1024], *text;
    size_t len;
    struct pvx_diag d = {""};
    bench_data(path, "scalarflow/cameras_opencv.json");
    if (pvx_file_read(path, 1 << 20, &text, &len, &d) != PVX_OK) {
        bench_not_run("plume", path);
        return false;
    }
    cJSON *root = cJSON_ParseWithLength(text, len);
    const cJSON *list = cJSON_GetObjectItem(root, "cameras");
    const cJSON *M = cJSON_GetObjectItem(root, "voxel_matrix");
    const cJSON *scale = cJSON_GetObjectItem(root, "voxel_scale");
    if (cJSON_GetArraySize(list) != PLUME_CAMERAS) {
        fprintf(stderr, "%s: not five cameras\n", path);
        exit(1);
    }
    for (int c = 0; c < PLUME_CAMERAS; c++) {
        plume_camera(cJSON_GetArrayItem(list, c), &cam[c]);
        plume_bin(&cam[c], bin);
    }
    for (int a = 0; a < 3; a++) { /* corners u = 0 and u = 1; M turns by quarters */
        const cJSON *row = cJSON_GetArrayItem(M, a);
        double p = plume_number(row, 3), q = p;
        for (int k = 0; k < 3; k++)
            q += plume_number(row, k) * plume_number(scale, k);
        g->min[a] = fmin(p, q);
        g->max[a] = fmax(p, q);
    }
    g->n[0] = g->n[2] = 64;
    g->n[1] = 96;
    cJSON_Delete(root);
    free(text);
    return true;
}

/* Of one camera; NULL: no video can be read here. */
static inline cap_video *plume_video(const struct rec_camera *c)
{
    char path[1024], file[128];
    cap_video *v;
    struct pvx_diag d = {""};
    snprintf(file, sizeof file, "scalarflow/%.64s.mp4", c->name);
    bench_data(path, file);
    if (cap_video_open(path, &v, NULL, &d) == PVX_OK)
        return v;
    bench_not_run("plume", d.text);
    return NULL;
}

/* Its next frame, of bin times as many pixels as the camera has each way; borrowed until the next call. */
static inline struct cap_image plume_next(cap_video *v, const struct rec_camera *c, int bin)
{
    struct cap_image img;
    struct pvx_diag d = {""};
    if (cap_video_next(v, &img, NULL, &d) != PVX_OK || img.width != bin * c->width ||
        img.height != bin * c->height) {
        fprintf(stderr, "%s: a frame: %s\n", c->name, d.text);
        exit(1);
    }
    return img;
}

#endif
