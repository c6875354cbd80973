/* key_frames.h - the path of a camera, from a file of key frames.
 *
 *     version: 1
 *     keys:
 *       - { t: 0, eye: [2, -1, 0.8] }                                  # seconds, metres
 *       - { t: 3, eye: [0, -2, 1.5], look_at: [0, 0, 0.4], fov: 25 }   # degrees, top to bottom
 *       - { t: 5, camera: cam3 }                                       # the place of a camera of the rig
 *
 * t rises.  A key without look_at, up or fov takes them from the options.  A camera of the rig gives eye, look_at (at
 * the depth of the middle of the volume), up and fov, but not its lens or the centre of its picture.
 * Between keys, eye, look_at, up and log fov are cubics through the keys.  Their slope at a key is that of the
 * parabola through the key and its neighbours (Bessel), at the ends that of the chord.  So the speed does not jump,
 * and keys on a straight line at one speed give a straight path at one speed.
 * Threads: pure after loading. */
#ifndef REC_KEY_FRAMES_H
#define REC_KEY_FRAMES_H
#include <stddef.h>
#include "base/err.h"
#include "recon/geom/rig.h"

#define REC_KEY_FRAMES_MAX   10000
#define REC_KEY_PICTURES_MAX 1000000 /* of a film */

struct rec_key_frame {
    double t, eye[3], look_at[3], up[3], fov_deg;
};

struct rec_key_frames {
    size_t n; /* 2..REC_KEY_FRAMES_MAX */
    struct rec_key_frame *key;
};

/* `base`: values that a key does not give (its look_at is the middle of the volume, or --look-at); rig: for `camera`,
 * may be NULL.  Errors: PVX_EFORMAT, PVX_ENOENT, PVX_ENOMEM with file, line and key; then *out is empty.
 * Owner: caller, until rec_key_frames_fini. */
PVX_MUST_CHECK pvx_err rec_key_frames_load(const char *path, const struct rec_key_frame *base,
                                           const struct rec_rig *rig, struct rec_key_frames *out,
                                           struct pvx_diag *d);
/* The same from memory (fuzzed). */
PVX_MUST_CHECK pvx_err rec_key_frames_parse(const char *text, size_t len, const char *name,
                                            const struct rec_key_frame *base,
                                            const struct rec_rig *rig, struct rec_key_frames *out,
                                            struct pvx_diag *d);
void rec_key_frames_fini(struct rec_key_frames *k);

/* Pictures from the first key to the last, both included if they fall on a multiple of 1 / fps (fps 1..100). */
size_t rec_key_frames_pictures(const struct rec_key_frames *k, int fps);

/* The camera of picture i.  PVX_EINVAL: the camera stands at the point that it looks at, or looks along `up`; d
 * has the time. */
PVX_MUST_CHECK pvx_err rec_key_frames_camera(const struct rec_key_frames *k, size_t i, int fps,
                                             int32_t w, int32_t h, struct rec_camera *out,
                                             struct pvx_diag *d);

#endif
