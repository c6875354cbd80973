/* exchange.h - calibrations of other programs: read into one list of cameras, and written from a rig.
 *
 * Each format has its rule: which way R and t go, where the first pixel's centre is, which lens model, which unit.
 * README.md has them in one table, with their sources.  A reader converts to the conventions of camera.h.  What a file
 * does not say stays open: `unit` 0, `width` 0, no pose.  The caller asks for it by name.
 * Files are added one by one.  A camera may have its lens in one of them and its pose in another, under one name.
 * Refused with the file, the camera and the line: lens models that camera.h does not have, skewed pixels, R that is no
 * rotation, a lens or pose that is given twice.
 * Ownership: the list is the caller's memory, zeroed before the first file.  Threads: one list belongs to one thread. */
#ifndef REC_EXCHANGE_H
#define REC_EXCHANGE_H
#include "recon/geom/rig.h"

enum rec_exchange_format {
    REC_EXCHANGE_AUTO, /* by content */
    REC_EXCHANGE_OPENCV,
    REC_EXCHANGE_ROS,
    REC_EXCHANGE_KALIBR,
    REC_EXCHANGE_COLMAP,
    REC_EXCHANGE_ANIPOSE, /* caliscope's, too */
    REC_EXCHANGE_MATLAB,
    REC_EXCHANGE_JARVIS,
    REC_EXCHANGE_AGISOFT,
    REC_EXCHANGE_BLENDER,
    REC_EXCHANGE_FORMATS
};

/* "opencv"; "auto" for AUTO. */
const char *rec_exchange_name(enum rec_exchange_format f);
/* REC_EXCHANGE_FORMATS: no format has this name. */
enum rec_exchange_format rec_exchange_by_name(const char *name);

struct rec_exchange_camera {
    struct rec_camera c; /* t in the file's unit; width 0: not known */
    bool lens, pose, rectified;
    double rect[9],
        shift
            [3]; /* if rectified: X_rect = rect X_cam, X_rect = X_rect of the first of two + shift */
};

struct rec_exchange {
    double
        centre; /* where the files have the centre of the first pixel, if `centred`; else as their format has it */
    bool centred;
    size_t n;
    struct rec_exchange_camera camera[REC_MAX_CAMERAS];
    double unit;   /* metres per unit of t, as the files say; 0: they do not */
    uint32_t seen; /* formats that were read, bit by bit */
    bool pair; /* R and t of the second of two cameras were read (OpenCV's stereo calibration) */
    double R[9], t[3]; /* these */
    char note[400];    /* what else there is to say, in sentences; "" for nothing */
};

/* Add the cameras of a file, or of COLMAP's folder.  Errors: those of pvx_file_read, PVX_EFORMAT, PVX_EINVAL,
 * PVX_EUNSUP (a known model that is not supported), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_exchange_read(const char *path, enum rec_exchange_format from,
                                         struct rec_exchange *x, struct pvx_diag *d);
/* The same from memory, for formats in one file but HDF5.  `path` names it and its camera. */
PVX_MUST_CHECK pvx_err rec_exchange_parse(const char *text, size_t len, const char *path,
                                          enum rec_exchange_format from, struct rec_exchange *x,
                                          struct pvx_diag *d);
/* After the last file: poses of a pair, OpenCV's or of ROS.  PVX_EINVAL: there are no two cameras. */
PVX_MUST_CHECK pvx_err rec_exchange_end(struct rec_exchange *x, struct pvx_diag *d);

/* The point that is nearest to all cameras' axes, in the files' unit; false: they are parallel. */
bool rec_exchange_aim(const struct rec_exchange *x, double at[3]);

/* Write the cameras of a rig.  `path` is a file, or a folder for ros, colmap and jarvis.  A lens or a name that the
 * format cannot hold is refused with PVX_EUNSUP.  Gains, photometry, blur, bodies and the volume
 * are not written. */
PVX_MUST_CHECK pvx_err rec_exchange_write(const struct rec_rig *r, enum rec_exchange_format to,
                                          const char *path, struct pvx_diag *d);
#endif
