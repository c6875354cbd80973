/* impl.h - the slot and the two stages' workspaces.  Private to recon/frame. */
#ifndef REC_FRAME_IMPL_H
#define REC_FRAME_IMPL_H
#include <string.h>

#include "recon/frame/inside.h"
#include "recon/solve/levels.h"
#include "recon/solve/average.h"
#include "recon/solve/solve.h"
#include "recon/solve/temporal.h"
#include "recon/vote/vote.h"

struct rec_cl_matrix;
struct rec_cl_photo;
struct rec_cl_solver;
struct rec_cl_system;

struct rec_carver {
    const rec_sysmat *S;
    struct rec_frame_params p;
    pvx_pool *pool;
    struct rec_kernels kernels;
    rec_vote *vote; /* or NULL: trust_all */
    rec_hull *hull;
    struct rec_restrictor *restrictor;
    float gain[REC_MAX_CAMERAS][3];
    float read_noise[REC_MAX_CAMERAS];  /* of a sample, full scale = 1; 0 = not known */
    float noise_gain[REC_MAX_CAMERAS];  /* variance of a sample over its light, likewise */
    float *background[REC_MAX_CAMERAS]; /* or NULL */
    struct rec_photo_image photo[REC_MAX_CAMERAS]; /* members outside a slot are set once */
    struct rec_photo_params photo_params[REC_MAX_CAMERAS];
    float *plane; /* [rows][4] for mosaics */
    struct rec_photo_stats stats[REC_MAX_CAMERAS];
    struct rec_cl_matrix *matrix;     /* card.h, or NULL */
    size_t columns;                   /* room for them on the card */
    struct rec_cl_photo *there;       /* photometry on the card, or NULL */
    uint64_t other_background;        /* bit c: the card has not yet that of camera c */
    size_t raw0[REC_MAX_CAMERAS + 1]; /* rooms for raw pictures */
};

struct rec_solver {
    struct rec_solve_params p;
    bool coarse; /* start from coarser grids */
    rec_problem *problem;
    struct rec_descent descent; /* with `coarse` */
    enum rec_selfcal_mode mode;
    rec_selfcal *selfcal;              /* or NULL: off */
    rec_average *average;              /* borrowed, or NULL: every set by itself */
    rec_temporal *temporal;            /* or NULL: off */
    struct rec_cl_matrix *matrix;      /* card.h, or NULL, */
    struct rec_cl_solver *card;        /* as */
    struct rec_restrictor *restrictor; /* these */
};

struct rec_systems {
    struct rec_subsys *sub;
    rec_levels *levels;           /* with solver->coarse */
    struct rec_cl_matrix *matrix; /* card.h, or NULL, */
    struct rec_cl_system *card;   /* as this */
};

struct rec_kept {
    rec_problem *problem;
    float *expect; /* [voxels][cs] a copy of the prediction */
    size_t bytes;
};

struct rec_frame {
    rec_carver *carver;
    rec_solver *solver;
    bool alone; /* it owns carver and solver */
    const rec_sysmat *S;
    int nch, cs;
    size_t rows, voxels;

    struct rec_frame_camera camera[REC_MAX_CAMERAS]; /* the caller's entries */
    bool believed[REC_MAX_CAMERAS]; /* present, and not voted out; rec_frame_carve */
    float *b;                       /* [rows][cs] pixels in, right-hand side after carve */
    float *weight;                  /* [rows] */
    float *weight4;                 /* [rows][4] of each channel, where cameras have mosaics */
    uint8_t *lit;                   /* [rows] */
    uint8_t *bytes;                 /* carver->raw0: raw pictures, or NULL */
    struct rec_cl_raw raw[REC_MAX_CAMERAS];
    struct rec_frame_binner bin; /* of raw pictures that b does not have; NULL: b is written */
    double sigma[4], shot[4];    /* rec_pictures */
    bool per_channel;            /* weight4 holds */
    float *least;                /* [rows] with params.at_least: rec_pictures */
    uint8_t *least_of;
    bool any_least;

    int32_t *col;               /* [voxels] */
    float *x;                   /* [voxels][cs] */
    rec_systems *own, *systems; /* of rec_frame_new; those it has now.  Each may be NULL */
    struct rec_subsys *sub;     /* the members of `systems`, or NULL */
    rec_levels *levels;
    rec_kept *kept; /* or NULL */
    struct rec_frame_report report;
};

/* The problem that the frame was solved with. */
static inline rec_problem *rec_frame_problem(const rec_frame *f)
{
    return f->kept != NULL ? f->kept->problem : f->solver->problem;
}

/* Whether the camera's pixels come from a Bayer filter; whether they are also unchanged. */
static inline bool rec_frame_is_bayer(const rec_frame *f, size_t c)
{
    return f->camera[c].cell != NULL && f->cs == 4;
}
static inline bool rec_frame_is_mosaic(const rec_frame *f, size_t c)
{
    return rec_frame_is_bayer(f, c) && f->camera[c].mosaic;
}

/* The carved frame's right-hand side. */
static inline struct rec_pictures rec_frame_pictures(const rec_frame *f)
{
    bool bounds = f->any_least && rec_solver_is_default(f->solver->p.solver);
    struct rec_pictures in = {.b = f->b,
                              .w = f->per_channel ? f->weight4 : f->weight,
                              .per_channel = f->per_channel,
                              .least = bounds ? f->least : NULL,
                              .least_of = bounds ? f->least_of : NULL};
    memcpy(in.sigma, f->sigma, sizeof in.sigma);
    memcpy(in.shot, f->shot, sizeof in.shot);
    return in;
}

/* After photometry: writes the saturated rows to least and least_of. */
void rec_frame_mark_saturated(rec_frame *f);

#endif
