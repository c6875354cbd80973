/* calib.h - cameras from what they saw of a board, and how far to trust them.
 *
 * Everything is estimated at once: lenses K_c, poses (R_c, t_c), poses (Q_f, s_f) of the board in every frame, and
 * the board's shape, from corners u_cfi with covariance V_cfi:
 *     min sum_cfi  rho( | V^-1/2 ( pi(K_c, R_c (Q_f b_i + s_f) + t_c) - u_cfi ) |^2 ) + priors         (1)
 *     b = (x, y, w(x,y) [+ thickness on the back]),  w = w1 (X^2 - 1/3) + w2 X Y + w3 (Y^2 - 1/3)       (2)
 * pi: camera.h (1)-(4) with k1 k2 p1 p2 k3, and (8) for a camera that has windows in the old rig: they are known, and
 * stand before the camera as in the old rig.  X, Y: -1..1 over the board, so that w contains no plane.  rho: Cauchy's
 * loss while wrong corners are searched; no loss for the corners that are left.  Triggs, McLauchlan, Hartley,
 * Fitzgibbon: Bundle adjustment - a modern synthesis, 2000.  The priors describe any ordinary lens (adjust.c).  A
 * number that the data do not determine better stays at its prior, and the report says so.
 *
 * Volume error: distance [px] between true and estimated projections of points all through the volume, after the
 * rigid motion of the world that minimises it.  Its expectation comes from the covariance of (1), ceres::Covariance,
 * times the chi^2 per degree of freedom.  It holds when the corners' errors are independent and the squares have the
 * sides that the board's spec gives.  A print that was scaled scales the rig; only rec_calib_options.measured can
 * reveal it.
 *
 * Needs lib/pyrovox/pyrovox-calib.so (shim.h).  Deterministic: the same input gives the same bits.
 * Threads: pure.  Cost: 100 poses before 8 cameras about 1 s. */
#ifndef REC_CALIB_H
#define REC_CALIB_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "recon/board/board.h"
#include "recon/geom/rig.h"

#define REC_CALIB_FOLDS 3
#define REC_CALIB_SIDE  5 /* points along each side of the volume at which the error is computed */
#define REC_CALIB_JOINT 5 /* board poses that two cameras should both see */
#define REC_NO_FRAME    UINT32_MAX
/* Upper bounds of a good and of a fair volume error [voxels], NUMERICS.md. */
#define REC_CALIB_GOOD 0.10
#define REC_CALIB_FAIR 0.15

enum rec_calib_hold { REC_HOLD_LENS = 1, REC_HOLD_POSE = 2 }; /* what is kept as in the old rig */

struct rec_calib_camera {
    char name[REC_NAME_MAX];
    int32_t width, height;
    unsigned hold; /* bits of enum rec_calib_hold; needs a camera of this name in the old rig */
};

/* The distance of two camera centres, measured by another means. */
struct rec_calib_measured {
    uint32_t a, b;
    double metres;
};

enum rec_calib_world {
    REC_WORLD_BEST, /* as REC_WORLD_FLOOR with the frame that most cameras saw; a warning says so */
    REC_WORLD_FLOOR, /* the board lies flat at the bottom of the volume in `floor_frame`, the middle of its
                      * print above (0,0); x along its rows, z to the side from which it is seen */
    REC_WORLD_UP, /* z along `up`, given in the axes of camera `up_camera`; the middle of the volume where
                      * the optical axes meet; x to the right of that camera */
    REC_WORLD_OLD /* the old rig's, by the cameras that both rigs have and that did not move */
};

struct rec_calib_options {
    enum rec_calib_world world;
    uint32_t floor_frame, up_camera;
    double up[3];
    const struct rec_rig *old; /* NULL: none; borrowed */
    const struct rec_calib_measured *measured;
    size_t n_measured;
    bool brief; /* hold out no frames as a check: for a caller that solves again soon */
};

struct rec_calib_input {
    struct rec_board board;
    struct rec_grid grid; /* n[] 0: the finest that the pictures support (rec_rig_finest) */
    size_t n_cameras, n_views;
    const struct rec_calib_camera *camera;
    const struct rec_board_view *view; /* in any order */
    struct rec_calib_options options;
};

/* How a view was used, or why it was left out. */
enum rec_view_fate {
    REC_VIEW_USED,
    REC_VIEW_BROKEN, /* ids or coordinates that this board cannot have */
    REC_VIEW_FEW,    /* fewer than 6 corners, or all on one line */
    REC_VIEW_TWICE,  /* a second view of the same camera and frame */
    REC_VIEW_STILL,  /* nothing moved since frame `like` */
    REC_VIEW_SELF,   /* its corners do not fit a board, whatever the pose */
    REC_VIEW_JOINT   /* does not fit the other cameras' views of the same frame */
};

struct rec_calib_view {
    enum rec_view_fate fate;
    uint32_t like;         /* REC_VIEW_STILL */
    size_t corners, wrong; /* corners of it that were left out one by one */
    double single, joint;  /* px rms of the corners used: camera alone, all together; 0: none */
    float *residual;       /* [corners][2], px, seen - expected, after the joint fit; NULL: none */
};

/* Numbers of a lens, in this order in `held` and `sigma`. */
enum rec_lens_number {
    REC_FX,
    REC_FY,
    REC_CX,
    REC_CY,
    REC_K1,
    REC_K2,
    REC_P1,
    REC_P2,
    REC_K3,
    REC_LENS
};

struct rec_calib_of_camera {
    size_t views, used;
    double single, joint;   /* px rms over the views used */
    double over;            /* joint / single, medians over all views; 1 is ideal */
    double gross;           /* the same with the upper quartile of joint */
    double structure;       /* px: residual that repeats by place in the picture, camera alone */
    unsigned held;          /* bit i: the data do not determine number i of the lens */
    double sigma[REC_LENS]; /* standard deviations, before any number was held */
    double coverage; /* share of the cells of an 8x6 grid over the picture that have corners */
    struct rec_uncertainty expected; /* in the volume; camera.h */
};

struct rec_calib_pair {
    uint32_t a, b;
    uint32_t common; /* frames that both saw */
    double weight;
    bool in_tree;
};

enum rec_calib_severity { REC_CALIB_NOTE, REC_CALIB_WARNING, REC_CALIB_REFUSED };
enum rec_calib_what {
    REC_CALIB_VERDICT, /* the volume error against the tolerance */
    REC_CALIB_HELD,
    REC_CALIB_UNSEEN,    /* a camera without a usable view */
    REC_CALIB_APART,     /* groups of cameras without a common view */
    REC_CALIB_WEAK_PAIR, /* a pair of the tree with fewer than REC_CALIB_JOINT poses */
    REC_CALIB_SYNC,
    REC_CALIB_MOVED,
    REC_CALIB_LENS,
    REC_CALIB_PICTURES, /* left out */
    REC_CALIB_WORLD,
    REC_CALIB_SCALE,
    REC_CALIB_OLD_RIG,
    REC_CALIB_HELD_OUT
};

/* One sentence, with a remedy if there is one.  REFUSED: do not trust the rig. */
struct rec_calib_finding {
    enum rec_calib_severity severity;
    enum rec_calib_what what;
    int camera;     /* -1: none */
    uint32_t frame; /* REC_NO_FRAME: none */
    char text[400];
};

struct rec_calib_report {
    size_t n_cameras, n_views, n_frames, n_pairs, n_findings;
    struct rec_calib_of_camera *camera; /* [n_cameras] */
    struct rec_calib_view *view;        /* [n_views], as in the input */
    struct rec_calib_pair *pair;        /* [n_pairs] */
    struct rec_calib_finding *finding;  /* [n_findings], the worst first */
    uint32_t *frame;                    /* [n_frames] numbers, ascending */
    double (*board)[12];       /* [n_frames]: R [9], t [3], board -> world; NAN: not known */
    double warp[3], thickness; /* m, (2) */
    double single, joint;      /* px rms over all views used */
    double chi2;               /* per degree of freedom, with the corners' own covariances */
    double px, voxels;         /* expected volume error, rms over cameras */
    double voxels_95;          /* of the worst camera */
    /* The same at points of the volume, x fastest: rms over the cameras that see the point; NAN: none sees it. */
    double at[REC_CALIB_SIDE * REC_CALIB_SIDE * REC_CALIB_SIDE];
    struct {
        double trained, held_out; /* px rms, per degree of freedom */
        double volume; /* px: volume error of this fold's rig against the rig of all frames */
    } fold[REC_CALIB_FOLDS];
    int iterations;
};

/* From views to a rig.  `rig` and `out` are valid for fini whatever is returned; after an error `out` holds the
 * results so far.
 * Errors: PVX_EINVAL: the input is invalid, or gives no rig (a camera saw nothing, or groups of cameras have no
 * common view: `d` and the findings name them); PVX_EUNSUP: the module cannot be loaded; PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_calib_solve(const struct rec_calib_input *in, struct rec_rig *rig,
                                       struct rec_calib_report *out, struct pvx_diag *d);
void rec_calib_report_fini(struct rec_calib_report *r);

/* Whether there is a finding of this severity and of this `what` (-1: any). */
bool rec_calib_says(const struct rec_calib_report *r, enum rec_calib_severity severity, int what);

/* "good", "just enough", "not enough" or "does not see the volume", of one camera. */
const char *rec_calib_verdict(const struct rec_uncertainty *u);

/* The verdict of every camera is "good". */
bool rec_calib_good(const struct rec_calib_report *r);

/* px rms and largest distance between the projections of the volume's points by two rigs of the same cameras,
 * after the rigid motion of `b` that minimises the rms.  PVX_EINVAL: no camera sees any of the points. */
PVX_MUST_CHECK pvx_err rec_calib_distance(const struct rec_rig *a, const struct rec_rig *b,
                                          double *rms, double *worst);

#endif
