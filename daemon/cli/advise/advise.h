/* advise.h - the measurements that `pyrovox advise` makes on a recording, and the limits of its verdicts. */
#ifndef ADVISE_H
#define ADVISE_H
#include <stdio.h>

#include "daemon/cli/common/flame_sets.h"
#include "recon/check/absorption.h"
#include "recon/check/gains.h"
#include "recon/check/resolution.h"

#define ADVISE_GRIDS   5
#define ADVISE_MARGINS 3

struct advise_grid {
    int32_t voxels; /* along the longest side */
    double error, ms;
};
/* Brightness of each camera, compared with volumes of the others.  These use the absorption c that was found. */
struct advise_gain {
    bool known, on;               /* known: three cameras see flame in three sets */
    double gain[REC_MAX_CAMERAS]; /* over the median of all */
    size_t worst;                 /* camera */
    double error[2], noise;       /* rec_gains_report */
};
/* Whether pictures are a power of the light. */
struct advise_response {
    double power;    /* turns the pictures into light: 1, or the best of those tried */
    double error[2]; /* of left-out pictures, as they are and by the power */
    bool on;
};
/* Sets that follow each other. */
struct advise_motion {
    bool known, on;       /* known: three sets in a row; on: the volume before helps */
    size_t sets;          /* of the run */
    double voxels;        /* motion of light from set to set, in voxels of the check's grid */
    double change, noise; /* change of pictures from set to set, share: beyond noise, by noise */
    double sigma;
    double error[2],
        ms[2];    /* of left-out pictures and of a solve; without and with the volume before */
    double floor; /* the error that noise alone makes */
    double sure;  /* what the volume before improves, in standard errors over the pictures */
    size_t better, pictures; /* pictures that the volume before improves; all pictures */
};
/* Where a camera stays dark although the volume of the others has light there. */
struct advise_body {
    double share;           /* of the light that the camera should see; 0: no body */
    int32_t from[2], to[2]; /* raw pixels, right and down, last ones included */
    double error[2];        /* of the other cameras' pictures, with these pixels and without */
};
/* Light [m2] and height [m] of the volumes, and levels for triggers on them (daemon/pipeline/triggers.h). */
struct advise_levels {
    size_t sets, dark; /* dark: without flame */
    double dim, least,
        most; /* the most light of a dark set; least and most of the others; 0: no light */
    double above, release; /* between dark and flame, or above all light where no set is dark */
    double height;         /* greatest */
    double change;         /* greatest from a set to the next, %, with flame in both */
    size_t pairs;          /* of such sets */
};
struct advice {
    struct rec_plausible_verdict belong;
    /* pictures, over all sets */
    double brightest;      /* measured value, full scale = 1 */
    double saturated, lit; /* share of the flame's bins at full scale; of all bins that are flame */
    double sigma;          /* noise */
    double level[REC_MAX_CAMERAS];                          /* where each camera is darkest */
    size_t darkest;                                         /* the camera with the highest level */
    double cut[REC_MAX_CAMERAS], pedestal[REC_MAX_CAMERAS]; /* rec_photo_say_cut */
    struct advise_body body[REC_MAX_CAMERAS];
    struct rec_absorption absorption;
    struct advise_gain gain;
    struct advise_response response;
    struct advise_motion motion;
    struct rec_resolution resolution; /* least 0: not known */
    double margin[ADVISE_MARGINS];    /* error with silhouettes grown by so many bins */
    int32_t best_margin, margin_bins; /* the latter in bins of a daemon's pictures */
    double noise[3];                  /* by channel; 0: grey */
    double basis[2];                  /* error of left-out pictures: box, trilinear */
    struct advise_grid grid[ADVISE_GRIDS];
    size_t n_grids, best_grid; /* the coarsest that is not worse by REC_ADVISE_SAME than the best */
    int32_t finest;            /* finest grid that the pictures support, rec_rig_finest */
    struct advise_levels levels;
    double half, all; /* error with every second camera, with all but the one */
};
#define ADVISE_SAME        1.02  /* errors within this factor count as equal */
#define ADVISE_LEVEL       0.002 /* half a step of 8 bits */
#define ADVISE_SATURATED   0.005
#define ADVISE_HIDDEN      0.015 /* share of a camera's light */
#define ADVISE_HIDDEN_BUYS 0.03  /* share of the others' squared error */
/* Shares of the left-out pictures' squared error that is not noise.  ADVISE_ABSORPTION replaces REC_ABSORPTION_GAIN
 * where bodies or full scale take light away as well. */
#define ADVISE_ABSORPTION 0.18
#define ADVISE_BENT       0.2
#define ADVISE_FAR        2    /* voxels from set to set */
#define ADVISE_LEANS      0.01 /* share of the squared error that is not noise; in 3 pictures of 4 */
#define ADVISE_GAIN       0.05 /* deviation from the median */
#define ADVISE_GAIN_BUYS  0.06 /* share of left-out pictures' squared error that is not noise */

/* All that follows, in order.  Errors: PVX_EINVAL: fewer than four cameras; theirs. */
PVX_MUST_CHECK pvx_err advise_all(struct flame_sets *s, struct advice *a, struct pvx_diag *d);
/* A line for each term, then a pyrovoxd.yaml to paste. */
void advise_print(FILE *f, const struct flame_sets *s, const struct advice *a);

/* Black levels are subtracted, bodies masked and gains put into s->rig as they are found, so that each term is judged
 * with the others already corrected.  Errors: PVX_ENOENT: no flame; PVX_ECANCELED; those of unseen.h. */
PVX_MUST_CHECK pvx_err advise_measure(struct flame_sets *s, struct advice *a, struct pvx_diag *d);
/* "raise", "lower" or "fine". */
const char *advise_exposure(const struct flame_sets *s, const struct advice *a);
/* Why no term is recommended yet, a clause: pictures are clipped, or gains are off.  NULL: nothing is in the way. */
const char *advise_first(const struct flame_sets *s, const struct advice *a);
/* The part of advise_measure about light: pictures, absorption, gains. */
PVX_MUST_CHECK pvx_err advise_terms(struct flame_sets *s, struct advice *a, struct pvx_diag *d);
/* Find the dark bodies before each camera.  found [REC_MAX_CAMERAS].  Their bins become NaN in all sets. */
PVX_MUST_CHECK pvx_err advise_bodies(struct flame_sets *s, struct advise_body *found,
                                     struct pvx_diag *d);
/* Absorption and gains, each measured with the other as found so far. */
PVX_MUST_CHECK pvx_err advise_light(struct flame_sets *s, struct advice *a, struct pvx_diag *d);
/* Motion, frame rate, what the volume before improves, resolution. */
PVX_MUST_CHECK pvx_err advise_motion(struct flame_sets *s, struct advice *a, struct pvx_diag *d);
/* What triggers would judge, and levels for them. */
PVX_MUST_CHECK pvx_err advise_levels(struct flame_sets *s, struct advise_levels *out,
                                     struct pvx_diag *d);
/* Noise of each channel.  Reads the files again, in colour. */
PVX_MUST_CHECK pvx_err advise_noise(const struct flame_sets *s, struct advice *a,
                                    struct pvx_diag *d);
/* Whether a power explains the pictures better than absorption and gains do.  advise_straighten turns all pictures
 * into light. */
PVX_MUST_CHECK pvx_err advise_response(struct flame_sets *s, struct advice *a, struct pvx_diag *d);
void advise_straighten(struct flame_sets *s, double power);

#endif
