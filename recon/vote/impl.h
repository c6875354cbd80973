/* impl.h - shared by the files of the vote.  Private to recon/vote. */
#ifndef REC_VOTE_IMPL_H
#define REC_VOTE_IMPL_H
#include "recon/vote/vote.h"

/* One solve of (1) of vote.h without some cameras. */
struct rec_trial {
    uint64_t without;
    uint32_t iterations;
    float *x, *y, *step, *scale;    /* [voxels] */
    float *w, *r, *wr;              /* [room] weights, A x - b, W r */
    float *rows;                    /* [tallest][widest] */
    double misfit[REC_MAX_CAMERAS]; /* of every camera, also of those left out */
};

struct rec_vote {
    const rec_sysmat *S, *level; /* the coarsest */
    int shift;                   /* a bin of `level` is 2^shift bins of S wide */
    pvx_pool *pool;
    size_t cameras, voxels, room, widest; /* widest: bins of the widest picture */
    size_t tallest;                       /* rows of pictures that K needs at a time */
    uint32_t hold;
    struct rec_subsys *sub;
    float *length[REC_MAX_CAMERAS];   /* [voxels] A_c' A_c 1 over the measured bins of c */
    float *chord;                     /* [room] length of the ray in the grid */
    double weigh[REC_MAX_CAMERAS];    /* m_c */
    int32_t blur[REC_MAX_CAMERAS][2]; /* s of K, along x and y of the picture */
    double after_k[REC_MAX_CAMERAS];  /* share of the noise power that K leaves */
    struct rec_trial *trial;          /* [cameras + 1] */
    float *areas;                     /* of the trials, one piece */
    size_t bytes;

    /* state of one frame set */
    const struct rec_vote_set *set;
    float *b, *use;  /* [room] pictures; 1 where a bin was measured and its ray meets the grid */
    uint8_t *lit;    /* [room] */
    uint8_t *merged; /* scratch: a row of each camera's silhouette */
    size_t merged_at[REC_MAX_CAMERAS];
    uint8_t *asked; /* [room] the ray meets the grid, and the bin is lit or sees a column */
    uint32_t *table[REC_MAX_CAMERAS]; /* [(bh+1)*(bw+1)] lit bins above and left of a corner */
    int32_t *col, *in_layer;          /* [voxels], [layers] */
    size_t darkest[REC_MAX_CAMERAS], n_darkest;
    int dark_allowed; /* number of cameras in which a voxel may be dark */
    struct rec_vote_camera {
        double power, signal;                  /* ||b_c||^2; m_c ||b_c||^2 without its noise */
        double noise;                          /* m_c times the noise power of all bins */
        uint32_t bins, lit;                    /* bins that meet the grid; lit ones of those */
        uint32_t measured, unknown, saturated; /* of those `asked`; saturated: unknown and bright */
    } of[REC_MAX_CAMERAS];
    double unit; /* P */

    /* state from set to set */
    uint64_t picture[REC_MAX_CAMERAS]; /* checksum of its lit bins */
    uint32_t same[REC_MAX_CAMERAS];    /* sets in a row with that picture, while the others moved */
    /* with `hold` */
    uint64_t out, agree; /* cameras that are out; agree: cameras that would come back */
    uint8_t why[REC_MAX_CAMERAS];
    float cost[REC_MAX_CAMERAS];
    uint32_t agreed[REC_MAX_CAMERAS];
    uint32_t waited;           /* sets since every camera was tested */
    double usual;              /* R of the cameras believed then, over P */
    enum rec_vote_state state; /* state then */
};

/* The constant of (3) of vote.h: every camera may cost this much. */
#define REC_VOTE_ALONE 0.03

struct rec_vote_run {
    rec_vote *v;
    size_t from;
};

static inline bool rec_vote_has(uint64_t set, size_t c)
{
    return (set >> c & 1) != 0;
}

/* Call in this order: find the lit bins of the level; restrict the level to the columns where a flame may be; average
 * the pictures to the bins and take the sums that concern one camera alone. */
void rec_vote_light(rec_vote *v);
void rec_vote_pool(rec_vote *v);
/* Finds the columns where a flame may be and restricts the level's system to them; false: there is none. */
bool rec_vote_restrict(rec_vote *v, struct rec_restrictor *r);
/* `length` of all cameras. */
void rec_vote_lengths(rec_vote *v);
/* Fits trial 0 to each of these cameras in turn (SART): soon near the solution of (1), but never exactly there. */
void rec_vote_sweep(rec_vote *v, const size_t *order, size_t n);
/* The misfits of the current x of trial 0. */
void rec_vote_judge(rec_vote *v);
/* Trials [from, to), each from its x. */
void rec_vote_solve(rec_vote *v, size_t from, size_t to);
/* Cameras that send the same picture again and again while the others' change. */
uint64_t rec_vote_frozen(rec_vote *v);
/* With `hold`: whether the set may do without testing every camera, if R of the believed cameras is r times P. */
bool rec_vote_may_wait(const rec_vote *v, double r);
/* Combines the set's verdict with the earlier ones; asked: every camera was tested in this set. */
void rec_vote_remember(rec_vote *v, struct rec_verdict *o, bool asked);
/* Why camera c does not fit: trial t was solved without it. */
enum rec_wrong rec_vote_cause(const rec_vote *v, const struct rec_trial *t, size_t c);
/* Its gain over the others', and the share of its misfit that is left when the picture is divided by it. */
double rec_vote_gain(const rec_vote *v, const struct rec_trial *t, size_t c, double *rest);

#endif
