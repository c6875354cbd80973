/* look.h - the pictures of a calibration, and the board in each of them.
 *
 *   DIR/<camera>/<number>.(npy|png|tif|tiff|jpg|jpeg)  every folder with pictures is a camera; the number is the last
 *                            run of digits in a file's name, and pictures of one instant have the same number
 *   DIR/<camera>.(mp4|avi|mkv|mov), or in the folder  videos whose times have one zero; frames of one instant have one
 *                            number, which counts from 0 (pairs.h)
 *   DIR/<camera>.tif, or in the folder  TIFF files of several pages; the number counts pages from 0
 *   FILE.h5                  a take; the number is that of the set
 * In folders every picture is looked at.  Videos, stacks and takes have thousands, so only the instants with the least motion
 * are looked at (reel.h).
 * Ownership: the struct is the caller's.  calibrate_look_fini frees its contents, after an error too. */
#ifndef CALIBRATE_LOOK_H
#define CALIBRATE_LOOK_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/err.h"
#include "base/pool.h"
#include "capture/files/pairs.h"
#include "capture/take/take.h"
#include "recon/board/detect.h"
#include "recon/calib/calib.h"

#define CALIBRATE_NO_VIEW SIZE_MAX

enum calibrate_source { CALIBRATE_FOLDERS, CALIBRATE_REELS, CALIBRATE_TAKE };

struct calibrate_picture {
    uint32_t camera, frame;
    char *path;
    bool unreadable; /* text says why */
    int32_t width, height;
    enum rec_sight outcome;
    char text[240];
    bool legacy;
    uint8_t grid;
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
    enum calibrate_source source;
    enum cap_numbers numbers;
    size_t n_reels;
    struct cap_reel reel[REC_MAX_CAMERAS]; /* of each camera, */
    struct cap_pairs pairs;
    cap_take *take; /* or one take, of this file */
    char *path;
    int take_camera[REC_MAX_CAMERAS];
    uint32_t every;    /* look at one of so many instants; 0: at about CALIBRATE_LOOKED_AT in all */
    uint32_t always;   /* look at this one in any case; REC_NO_FRAME: none */
    uint32_t from, to; /* pictures of other numbers are not looked at */
    struct calibrate_mode { /* how the flame's pictures differ from these; modes.h */
        int32_t binning, x, y, width, height; /* 0: not declared */
    } mode[REC_MAX_CAMERAS];
    uint8_t grid;   /* layout of the aprilgrid in most pictures */
    char said[300]; /* which instants were looked at, in words; "" for folders */
};

/* Find the cameras and their pictures.  `every`, `always`, `from` and `to` may be set after it.  Errors: PVX_ENOENT:
 * no pictures; PVX_EINVAL: a name that no camera can have, two pictures of one number, folders and videos side by
 * side; PVX_ERANGE: too many cameras, numbers too large; a take's. */
PVX_MUST_CHECK pvx_err calibrate_find(struct calibrate_look *l, const char *path,
                                      enum cap_numbers numbers, struct pvx_diag *d);
/* The camera whose name is these `len` characters.  n_cameras: there is none. */
size_t calibrate_camera(const struct calibrate_look *l, const char *name, size_t len);
/* Look at every picture.  The result does not depend on the number of threads.  Errors: PVX_ECANCELED (Ctrl-C); the
 * detector's; PVX_EINVAL: a camera without a picture from..to, with pictures of two sizes, or none that can be
 * read. */
PVX_MUST_CHECK pvx_err calibrate_look(struct calibrate_look *l, const struct rec_board *b,
                                      pvx_pool *pool, bool quiet, struct pvx_diag *d);
/* Store in the picture what was found in it.  The corners are copied. */
PVX_MUST_CHECK pvx_err calibrate_keep(struct calibrate_picture *p, const struct rec_board_sight *s);
/* Fill in the views and the counts from pictures that were looked at.  Call it once.  Errors as calibrate_look. */
PVX_MUST_CHECK pvx_err calibrate_look_count(struct calibrate_look *l, struct pvx_diag *d);
void calibrate_look_fini(struct calibrate_look *l);
#endif
