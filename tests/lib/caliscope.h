/* caliscope.h - corners that another program found in real pictures, and its cameras (shared/data). */
#ifndef TESTS_CALISCOPE_H
#define TESTS_CALISCOPE_H
#include "recon/calib/calib.h"
#include "tests/t.h"

#define CS_VIEWS   1024
#define CS_CAMERAS 4

struct cs {
    struct rec_board_view view[CS_VIEWS];
    struct rec_board_corner corner[CS_VIEWS][12];
    struct rec_calib_camera camera[CS_CAMERAS];
    struct rec_camera own[CS_CAMERAS];
    struct rec_rig rig; /* of them */
    struct rec_calib_input in;
};

static inline FILE *cs_open(const char *path)
{
    char full[1024];
    const char *root = getenv("PYROVOX_DATA");
    snprintf(full, sizeof full, "%s/calibration/%s",
             root != NULL && *root != 0 ? root : "../shared/data", path);
    return fopen(full, "r");
}

/* Numbers of a line, whatever stands between them. */
static inline int cs_numbers(const char *line, double *out, int most)
{
    int n = 0;
    while (*line != 0 && n < most) {
        char *end;
        out[n] = strtod(line, &end);
        n += end != line;
        line = end != line ? end : line + 1;
    }
    return n;
}

/* Corners "sync, camera, (skip), id, x, y": x at column `x`; false: no such file. */
static inline bool cs_read(struct cs *s, const char *folder, const char *corners, int x)
{
    char path[512], line[512];
    double v[16] = {0};
    memset(s, 0, sizeof *s);
    snprintf(path, sizeof path, "%s/%s", folder, corners);
    FILE *f = cs_open(path);
    if (f == NULL)
        return false;
    while (fgets(line, sizeof line, f) != NULL) {
        if (cs_numbers(line, v, 16) < x + 2 || line[0] < '0' || line[0] > '9')
            continue;
        uint32_t frame = (uint32_t)v[0], camera = (uint32_t)v[1], id = (uint32_t)v[x - 1];
        size_t i = 0;
        while (i < s->in.n_views && (s->view[i].frame != frame || s->view[i].camera != camera))
            i++;
        if (i == CS_VIEWS || camera >= CS_CAMERAS)
            continue;
        if (i == s->in.n_views)
            s->view[s->in.n_views++] =
                (struct rec_board_view){camera, frame, REC_FRONT, 0, s->corner[i]};
        struct rec_board_corner *to = s->corner[i];
        size_t at = s->view[i].n++;
        for (; at > 0 && to[at - 1].id > id; at--)
            to[at] = to[at - 1];
        to[at] = (struct rec_board_corner){id, v[x], v[x + 1], {0.01, 0, 0.01}};
    }
    (void)fclose(f);
    snprintf(path, sizeof path, "%s/camera_array.toml", folder);
    int c = -1;
    for (f = cs_open(path); f != NULL && fgets(line, sizeof line, f) != NULL;) {
        if (strncmp(line, "[cameras.", 9) == 0)
            c = atoi(line + 9);
        if (c < 0 || c >= CS_CAMERAS)
            continue;
        struct rec_camera *own = &s->own[c];
        double K[9] = {0};
        if (strncmp(line, "translation =", 13) == 0)
            (void)cs_numbers(line + 13, own->t, 3);
        if (strncmp(line, "rotation =", 10) == 0)
            (void)cs_numbers(line + 10, own->R, 9);
        if (strncmp(line, "distortions =", 13) == 0)
            (void)cs_numbers(line + 13, own->dist, 5);
        if (strncmp(line, "matrix =", 8) == 0 && cs_numbers(line + 8, K, 9) == 9) {
            own->fx = K[0];
            own->fy = K[4];
            own->cx = K[2];
            own->cy = K[5];
        }
        own->width = s->camera[c].width = 1280;
        own->height = s->camera[c].height = 720;
        snprintf(s->camera[c].name, sizeof s->camera[c].name, "cam%d", c);
        snprintf(own->name, sizeof own->name, "cam%d", c);
    }
    if (f == NULL)
        return false;
    (void)fclose(f);
    s->in.board = (struct rec_board){.kind = REC_CHARUCO,
                                     .cols = 4,
                                     .rows = 5,
                                     .square = 0.054,
                                     .marker = 0.0405,
                                     .dictionary = "4X4_1000",
                                     .inverted = true};
    s->in.n_cameras = CS_CAMERAS;
    s->in.camera = s->camera;
    s->in.view = s->view;
    s->in.grid = (struct rec_grid){{-0.3, -0.3, 0}, {0.3, 0.3, 0.6}, {64, 64, 64}, REC_TRILINEAR};
    s->rig = (struct rec_rig){.grid = s->in.grid, .n_cameras = CS_CAMERAS, .cameras = s->own};
    return true;
}

/* m between the centres of two cameras. */
static inline double cs_baseline(const struct rec_rig *r, int a, int b)
{
    double x[3], y[3];
    rec_camera_centre(&r->cameras[a], x);
    rec_camera_centre(&r->cameras[b], y);
    return sqrt(pow(x[0] - y[0], 2) + pow(x[1] - y[1], 2) + pow(x[2] - y[2], 2));
}
#endif
