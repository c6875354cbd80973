/* priv.h - shared by the files of this room: one calibration while it is computed. */
#ifndef REC_CALIB_PRIV_H
#define REC_CALIB_PRIV_H
#include "base/median.h"
#include "recon/calib/calib.h"
#include "recon/calib/model.h"
#include "recon/calib/shim.h"

#define SHAPE      4   /* numbers of the board's shape: warp [3], thickness */
#define LEAST      6   /* corners of a view */
#define LOSS       2.0 /* scale of Cauchy's loss, in standard deviations */
#define OUTLIER    4.5 /* a corner beyond this many is wrong; 4 of 10^5 right corners are */
#define WRONG_VIEW 0.3 /* a view with more wrong corners than this is left out */

/* One corner of one view. */
struct seen {
    double x, y; /* m, on the print */
    double u, v; /* px */
    double W[3]; /* whitening: (W0 dx, W1 dx + W2 dy) */
    double r[2]; /* px, seen - expected; of the last rec_calib_measure */
    double far;  /* whitened length of r, over the camera's scale; infinite: behind the camera */
    bool wrong;
};

struct view {
    size_t in; /* index in the input */
    const struct rec_board_view *board;
    uint32_t camera, frame; /* frame: index, not number */
    size_t first, n;        /* of calib.seen */
    enum rec_view_fate fate;
    int n_poses;
    double pose[2][6]; /* board -> camera by this view alone, the better first */
    double fit[2];     /* px rms of the two */
    double area,
        tilt; /* share of the picture that the board fills; angle [rad] between the axes of board and camera */
    double single; /* px rms alone */
    double usual;  /* px: median distance of its corners, alone */
};

struct calib {
    const struct rec_calib_input *in;
    struct rec_calib_report *out;
    struct pvx_diag *d;
    const struct rec_calib_lib *lib;
    size_t nc, nf, nv, ns;
    struct view *view;         /* [nv] by frame, then camera */
    size_t *of_frame;          /* [nf + 1]: its views are view[of_frame[f]] .. */
    struct seen *seen;         /* [ns] */
    bool *placed;              /* [nf]: the board's pose is known */
    uint32_t root;             /* its pose is the gauge */
    double middle[2], half[2]; /* m: of the print */
    unsigned shape_held;
    unsigned lens_held[REC_MAX_CAMERAS]; /* bits */
    bool own_lens[REC_MAX_CAMERAS];      /* stays as estimated from this camera alone */
    bool pose_held[REC_MAX_CAMERAS], joined[REC_MAX_CAMERAS];
    double believed[REC_MAX_CAMERAS][REC_LENS]; /* mean of the prior */
    double scale[REC_MAX_CAMERAS];              /* standard deviation of whitened residuals */
    double alone[REC_MAX_CAMERAS];              /* the same when each camera is alone */
    double chi2;                                /* per degree of freedom, over the corners used */
    /* The covariance refers to the axes and numbers of the fit, so both are kept when the world is moved. */
    double fit_pose[REC_MAX_CAMERAS][6], to_world[6];
    /* The estimated numbers, in one allocation, so that a fold can start from a copy. */
    struct rec_glass window[REC_MAX_CAMERAS]
                           [REC_WINDOWS]; /* in camera axes, by the old rig's poses */
    int32_t windows[REC_MAX_CAMERAS];
    double *state;
    size_t n_state;
    double *shape, (*lens)[REC_LENS], (*pose)[6], (*board)[6];
};

/* The camera's windows in its own axes; returns how many. */
int32_t rec_calib_windows(const struct rec_camera *c, struct rec_glass out[REC_WINDOWS]);
/* Windows of camera axes before the camera c, in its world. */
void rec_calib_glaze(const struct rec_glass *w, int32_t n, struct rec_camera *c);
/* Refuses a board that was held between a camera and its window.  After the last rec_calib_measure_all. */
PVX_MUST_CHECK pvx_err rec_calib_beyond(const struct calib *k);

/* Lens numbers x of a camera with its windows. */
static inline struct rec_model rec_calib_model(const struct calib *k, size_t camera,
                                               const double *x)
{
    return (struct rec_model){x, k->window[camera], k->windows[camera]};
}

/* ---- adjust.c ---- */
struct adjust {
    const bool *camera; /* [nc]; NULL: all */
    const bool *frame;  /* [nf]; NULL: all that are placed */
    bool robust, lens_fixed, pose_fixed;
    int max_iterations;
};
PVX_MUST_CHECK pvx_err rec_calib_adjust(struct calib *k, const struct adjust *a);
/* Covariance [nc*15][nc*15] of lens and pose of every camera; gauge: the root's pose is fixed.  Lenses are free
 * except those that the caller keeps.  Not yet multiplied by chi2. */
PVX_MUST_CHECK pvx_err rec_calib_covariance(struct calib *k, double *cov);
/* Standard deviation of the prior of each number of the lens. */
void rec_calib_beliefs(const struct calib *k, size_t camera, double sigma[REC_LENS]);
/* Point of a corner in board axes by (2) of calib.h. */
void rec_calib_point(const struct calib *k, const struct view *v, const struct seen *s,
                     double X[3]);
/* Sets r and far of all corners of the view, with board -> camera as given. */
void rec_calib_measure(struct calib *k, const struct view *v, const double to_camera[6]);
/* The same for all views of placed frames and joined cameras, with the poses of the state. */
void rec_calib_measure_all(struct calib *k);
/* px rms over the corners of a view that are not wrong. */
double rec_calib_rms(const struct calib *k, const struct view *v);
/* The residuals of one view as a motion of the picture: shift in x and y, growth, turn; the latter two as px at
 * the board's rim.  wrong_too: use its wrong corners too. */
struct drift {
    double m[4], corners;
    uint32_t frame; /* number */
};
struct drift rec_calib_drift(const struct calib *k, const struct view *v, bool wrong_too);
/* px: mean residuals of camera c by place in the picture, over the used views, less what chance contributes.
 * coverage: share of the places that have corners. */
double rec_calib_structure(const struct calib *k, uint32_t c, double *coverage);
/* own.c: standard deviation of fx over fx from the camera's own views alone, with lens and poses of that stage. */
double rec_calib_own_focal(const struct calib *k, uint32_t c);
/* Median distance [px] of all its corners, wrong or not. */
double rec_calib_usual(const struct calib *k, const struct view *v);
void rec_calib_use_state(struct calib *k, double *state);

/* ---- the stages, in this order ---- */
PVX_MUST_CHECK pvx_err rec_calib_take(struct calib *k);  /* take.c: views in, bad ones named */
PVX_MUST_CHECK pvx_err rec_calib_start(struct calib *k); /* start.c: each camera alone */
PVX_MUST_CHECK pvx_err rec_calib_join(struct calib *k);  /* graph.c: cameras and boards placed */
PVX_MUST_CHECK pvx_err rec_calib_together(struct calib *k, double *cov); /* joint.c */
PVX_MUST_CHECK pvx_err rec_calib_suspect(struct calib *k);               /* suspect.c */
PVX_MUST_CHECK pvx_err rec_calib_place(struct calib *k);                 /* world.c */
PVX_MUST_CHECK pvx_err rec_calib_expect(struct calib *k, const struct rec_rig *rig, double *cov,
                                        struct rec_uncertainty *of_camera);         /* expect.c */
PVX_MUST_CHECK pvx_err rec_calib_folds(struct calib *k, const struct rec_rig *rig); /* folds.c */
void rec_calib_verdicts(struct calib *k); /* say.c: what the figures mean */

PVX_MUST_CHECK pvx_err rec_calib_moved(struct calib *k, bool *moved); /* moved.c */
/* The view was compared with other views of its frame. */
bool rec_calib_compared(const struct calib *k, const struct view *v);

/* Best common transform b -> a of two cameras from their own poses, of frames that are `later` apart (a's is the
 * later).  Returns how many such frames there are; spread: median distance from the transform [m]. */
size_t rec_calib_pair_pose(const struct calib *k, uint32_t a, uint32_t b, int later, double pose[6],
                           double *spread);

/* ---- register.c ---- */
#define REC_CALIB_POINTS (REC_CALIB_SIDE * REC_CALIB_SIDE * REC_CALIB_SIDE)
void rec_calib_volume_point(const struct rec_grid *g, int i, double X[3]);
/* Inverse of a symmetric 6x6 matrix; undetermined directions are left out. */
void rec_calib_invert6(double A[36]);
/* The motion m from a's world to b's; robust: cameras that do not fit count less.  PVX_EINVAL: the rigs do not
 * have the same number of cameras, or none sees a's volume. */
struct rec_calib_overlay {
    double px[REC_MAX_CAMERAS], rms, worst; /* remaining distance, of each camera and of all */
    double scale;                           /* size of b over a, from the camera centres */
};
PVX_MUST_CHECK pvx_err rec_calib_register(const struct rec_rig *a, const struct rec_rig *b,
                                          bool robust, double m[6], struct rec_calib_overlay *out);

/* ---- say.c ---- */
PVX_PRINTF(6, 7)
void rec_calib_say(struct calib *k, enum rec_calib_severity severity, enum rec_calib_what what,
                   int camera, uint32_t frame, const char *fmt, ...);
/* The text of the last refusal.  Findings are in order of severity, then of time. */
const char *rec_calib_last_refused(const struct calib *k);
/* The camera keeps lens and pose of the old rig. */
bool rec_calib_stays(const struct calib *k, size_t camera);
/* Rig of the state: K, lens and pose of every camera; grid of the input. */
PVX_MUST_CHECK pvx_err rec_calib_rig(const struct calib *k, struct rec_rig *rig);

#endif
