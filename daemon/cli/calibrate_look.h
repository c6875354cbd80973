/* calibrate_look.h - the pictures of a calibration, and the board in each of them.
 *
 * DIR/<camera>/<number>.(npy|png|tif|tiff|jpg|jpeg): every folder with pictures in it is a camera; the number is
 * the last run of digits in a file's name, and pictures of one instant have one number.
 * Ownership: the struct is the caller's, fini frees what it holds, after an error too. */
#ifndef CALIBRATE_LOOK_H
#define CALIBRATE_LOOK_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/err.h"
#include "base/pool.h"
#include "recon/board/detect.h"
#include "recon/calib/calib.h"

#define CALIBRATE_NO_VIEW SIZE_MAX

struct calibrate_picture {
    uint32_t camera, frame;
    char *path;
    bool unreadable; /* text says why */
    int32_t width, height;
    enum rec_sight outcome;
    char text[240];
    bool legacy;
    double square, blur;        /* px, of the board in it */
    struct rec_board_view view; /* n > 0 only when found */
    size_t at;                  /* among the views, or CALIBRATE_NO_VIEW */
};

struct calibrate_look {
    size_t n_cameras, n, n_views;
    struct rec_calib_camera camera[REC_MAX_CAMERAS]; /* by name */
    struct calibrate_count {
        size_t pictures, unreadable, sight[REC_N_SIGHTS];
        size_t example[REC_N_SIGHTS]; /* the first picture of that outcome */
    } count[REC_MAX_CAMERAS];
    struct calibrate_picture *picture; /* [n] by camera, then number */
    struct rec_board_view *view;       /* [n_views]; corners are the pictures' */
};

/* What is there.  Errors: PVX_ENOENT: no pictures; PVX_EINVAL: a folder's name that no camera can have, two
 * pictures of one number; PVX_ERANGE: too many cameras, numbers too large. */
PVX_MUST_CHECK pvx_err calibrate_find(struct calibrate_look *l, const char *dir,
                                      struct pvx_diag *d);
/* Every picture looked at; the result does not depend on the number of threads.  Errors: PVX_ECANCELED (Ctrl-C),
 * PVX_EINVAL: a camera with pictures of two sizes, or none that can be read; the detector's. */
PVX_MUST_CHECK pvx_err calibrate_look(struct calibrate_look *l, const struct rec_board *b,
                                      pvx_pool *pool, bool quiet, struct pvx_diag *d);
void calibrate_look_fini(struct calibrate_look *l);
#endif
