/* light.h - what the steps of `pyrovox calibrate` that measure a camera's response to light share:
 * dark, flat, response, gain, colour, background.
 *
 * Each --frames is a group: pictures of one scene at one exposure, of which mean and variance per raw sample
 * are kept, for every camera that has some.  A step gets them from calibrate_light_run and calls
 * calibrate_light_save at its end. */
#ifndef CALIBRATE_LIGHT_H
#define CALIBRATE_LIGHT_H
#include <argp.h>

#include "daemon/cli/common/frames_in.h"
#include "recon/light/light.h"

#define CALIBRATE_GROUPS 64

struct calibrate_light_args {
    const char *rig, *out, *frames[CALIBRATE_GROUPS];
    double exposure_ms[CALIBRATE_GROUPS]; /* NAN: as the take says */
    size_t n;
    int64_t threads;
    struct frames_in_reading reading;
    bool force;
    bool nothing; /* no pictures are wanted: nothing has to be given */
};
/* Child of a step's argp; its input is the args.  Usage errors end the program with 2. */
extern const struct argp calibrate_light_argp;
/* A camera's pictures of a group. */
struct calibrate_stack {
    struct rec_light_picture picture; /* n 0: it has none */
    double *sum, *sum2;
    double whole, whole2; /* of the pictures' means */
    float *mean, *var;
    struct rec_light_still still;
    uint64_t samples, saturated;
    double gain;                                         /* as the camera said; NAN */
    double temperature;                                  /* the same, degrees C; NAN */
    char serial[REC_SERIAL_MAX], device[REC_SERIAL_MAX]; /* "" = not known (photometry.h) */
};

struct calibrate_light {
    const struct calibrate_light_args *a;
    struct rec_rig rig; /* as it will be written */
    struct rec_rig as;  /* as pictures are read: gains are in `light` where there is some */
    pvx_pool *pool;
    dmn_photometry *light;
    struct calibrate_stack *stack; /* [groups][REC_MAX_CAMERAS] */
};

struct calibrate_stack *calibrate_light_stack(const struct calibrate_light *l, size_t group,
                                              size_t camera);
/* one(camera c, its pictures of the m groups that have some) for every camera with pictures, then save.
 * PVX_ENOENT: no camera has any. */
PVX_MUST_CHECK pvx_err calibrate_light_cameras(struct calibrate_light *l,
                                               pvx_err (*one)(struct calibrate_light *l, size_t c,
                                                              const struct rec_light_picture *p,
                                                              size_t m, struct pvx_diag *d),
                                               struct pvx_diag *d);
/* Noise by photon transfer into camera k, and a line on stdout.  Errors: rec_light_noise's. */
PVX_MUST_CHECK pvx_err calibrate_light_noise(struct rec_camera *k,
                                             const struct rec_light_picture *p, size_t m,
                                             struct pvx_diag *why);
/* A map of camera c beside the new rig, and its name and hash into *m.  kind "dark", "flat". */
PVX_MUST_CHECK pvx_err calibrate_light_map(const struct calibrate_light *l, size_t camera,
                                           const char *kind, const float *v, struct rec_map *m,
                                           struct pvx_diag *d);
/* The identity of a stack's camera into the rig. */
void calibrate_light_identity(const struct calibrate_stack *s, struct rec_photometry *p);
/* The rig to --out. */
PVX_MUST_CHECK pvx_err calibrate_light_save(const struct calibrate_light *l, struct pvx_diag *d);
/* Load the rig, apply `what` (enum dmn_light) of it to the pictures, read all groups, run `step`; exit code.
 * Errors: the rig's, its maps', those of frames_in.h, PVX_EBUSY (--out is there), PVX_EINVAL (maps would lie
 * elsewhere than --out), PVX_ECANCELED. */
int calibrate_light_run(const struct calibrate_light_args *a, unsigned what,
                        pvx_err (*step)(struct calibrate_light *l, struct pvx_diag *d));
/* The same for a step without options of its own.  what 0: samples are taken as they are, without a transfer curve. */
int calibrate_light_main(const char *doc, unsigned what,
                         pvx_err (*step)(struct calibrate_light *l, struct pvx_diag *d), int argc,
                         char **argv);
/* "camera NAME: why" in the place of why. */
PVX_MUST_CHECK pvx_err calibrate_light_fail(const struct rec_camera *k, pvx_err e,
                                            const struct pvx_diag *why, struct pvx_diag *d);
#endif
