/* light.h - shared by the steps of `pyrovox calibrate` that measure a camera's response to light:
 * dark, flat, response, gain, colour, background.
 *
 * Each --frames is a group: pictures of one scene at one exposure.  Mean and variance of each raw sample are kept for
 * every camera that has pictures in it.  A step gets them from calibrate_light_run and calls calibrate_light_save at
 * its end. */
#ifndef CALIBRATE_LIGHT_H
#define CALIBRATE_LIGHT_H
#include <argp.h>

#include "daemon/cli/common/frames_in.h"
#include "recon/light/light.h"

#define CALIBRATE_GROUPS 64

struct calibrate_light_args {
    const char *rig, *out, *frames[CALIBRATE_GROUPS];
    double exposure_ms[CALIBRATE_GROUPS]; /* NAN: from the take */
    size_t n;
    int64_t threads;
    struct frames_in_reading reading;
    bool force;
    bool nothing; /* the step needs no pictures, so no option is required */
};
/* Child of a step's argp.  Its input is a struct calibrate_light_args.  Usage errors end the program with 2. */
extern const struct argp calibrate_light_argp;
/* A camera's pictures of a group. */
struct calibrate_stack {
    struct rec_light_picture picture; /* n 0: it has none */
    double *sum, *sum2;
    double whole, whole2; /* sums of the pictures' means and of their squares */
    float *mean, *var;
    struct rec_light_still still;
    uint64_t samples, saturated;
    double gain;                                         /* from the take; NAN: not known */
    double temperature;                                  /* the same, degrees C */
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
/* For every camera with pictures call one(l, c, p, m, d), then save.  p: its pictures of the m groups that have some.
 * PVX_ENOENT: no camera has pictures. */
PVX_MUST_CHECK pvx_err calibrate_light_cameras(struct calibrate_light *l,
                                               pvx_err (*one)(struct calibrate_light *l, size_t c,
                                                              const struct rec_light_picture *p,
                                                              size_t m, struct pvx_diag *d),
                                               struct pvx_diag *d);
/* Find the noise by photon transfer, write it into camera k and print a line.  Errors: rec_light_noise's. */
PVX_MUST_CHECK pvx_err calibrate_light_noise(struct rec_camera *k,
                                             const struct rec_light_picture *p, size_t m,
                                             struct pvx_diag *why);
/* Write a map of the camera beside the new rig, and its name and hash into *m.  kind: "dark" or "flat". */
PVX_MUST_CHECK pvx_err calibrate_light_map(const struct calibrate_light *l, size_t camera,
                                           const char *kind, const float *v, struct rec_map *m,
                                           struct pvx_diag *d);
/* Copy the identity of a stack's camera into the rig's photometry. */
void calibrate_light_identity(const struct calibrate_stack *s, struct rec_photometry *p);
/* Write the rig to --out. */
PVX_MUST_CHECK pvx_err calibrate_light_save(const struct calibrate_light *l, struct pvx_diag *d);
/* Load the rig, apply its terms `what` (enum dmn_light) to the pictures, read all groups and run `step`.  Returns the
 * exit code.  Errors: the rig's, its maps', those of frames_in.h, PVX_EBUSY (--out exists), PVX_EINVAL (maps would
 * lie elsewhere than --out), PVX_ECANCELED. */
int calibrate_light_run(const struct calibrate_light_args *a, unsigned what,
                        pvx_err (*step)(struct calibrate_light *l, struct pvx_diag *d));
/* The same for a step without options of its own.  what 0: samples are used as they are, without a transfer curve. */
int calibrate_light_main(const char *doc, unsigned what,
                         pvx_err (*step)(struct calibrate_light *l, struct pvx_diag *d), int argc,
                         char **argv);
/* Fail with e and the message "camera NAME: why". */
PVX_MUST_CHECK pvx_err calibrate_light_fail(const struct rec_camera *k, pvx_err e,
                                            const struct pvx_diag *why, struct pvx_diag *d);
#endif
