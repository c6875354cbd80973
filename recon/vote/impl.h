/* impl.h - what the files of the vote share.  Private to recon/vote. */
#ifndef REC_VOTE_IMPL_H
#define REC_VOTE_IMPL_H
#include "recon/vote/vote.h"

/* One solve of (1) of vote.h without some cameras. */
struct rec_trial {
    uint64_t without;
    uint32_t iterations;
    float *x, *y, *step, *scale;    /* [voxels] */
    float *w, *r, *wr;              /* [room] weights, A x - b, W r */
    float *rows;                    /* [3][widest] */
    double misfit[REC_MAX_CAMERAS]; /* of every camera, also of those left out */
};

struct rec_vote {
    const rec_sysmat *S, *level; /* the coarsest */
    int shift;                   /* a bin of it is 2^shift bins of S wide */
    pvx_pool *pool;
    size_t cameras, voxels, room, widest; /* widest: bins of the widest picture */
    uint32_t hold;
    struct rec_subsys *sub;
    float *length[REC_MAX_CAMERAS]; /* [voxels] A_c' A_c 1, where c measured */
    float *chord;                   /* [room] length of the ray in the grid */
    double weigh[REC_MAX_CAMERAS];  /* m_c */
    struct rec_trial *trial;        /* [cameras + 1] */
    float *areas;                   /* of the trials, one piece */
    size_t bytes;

    /* of a frame set */
    const struct rec_vote_set *set;
    float *b, *use;  /* [room] pictures; 1 where they were measured and the ray meets the grid */
    uint8_t *lit;    /* [room] */
    uint8_t *merged; /* a row of each camera's silhouette */
    size_t merged_at[REC_MAX_CAMERAS];
    uint8_t
        *asked; /* [room] the ray meets the grid, and a column is seen in the bin or it is lit */
    uint32_t *table[REC_MAX_CAMERAS]; /* [(bh+1)*(bw+1)] lit bins above and left of a corner */
    int32_t *col, *in_layer;          /* [voxels], [layers] */
    size_t darkest[REC_MAX_CAMERAS], n_darkest;
    int dark_allowed; /* cameras that a voxel may be dark in */
    struct rec_vote_camera {
        double power, signal; /* ||b_c||^2; m_c times that without what noise has of it */
        double noise;         /* m_c times what noise has of all bins */
        uint32_t bins, lit;   /* that meet the grid; of those */
        uint32_t measured, unknown, saturated; /* of those asked; saturated: unknown and bright */
    } of[REC_MAX_CAMERAS];
    double unit; /* P */

    /* from set to set */
    uint64_t picture[REC_MAX_CAMERAS]; /* checksum of what is lit in it */
    uint32_t same[REC_MAX_CAMERAS];    /* sets in a row with that picture, while the others moved */
    /* with `hold` */
    uint64_t out, agree; /* agree: those that would come back */
    uint8_t why[REC_MAX_CAMERAS];
    float cost[REC_MAX_CAMERAS];
    uint32_t agreed[REC_MAX_CAMERAS];
    uint32_t waited;           /* sets since all were asked */
    double usual;              /* R of those believed then, over P */
    enum rec_vote_state state; /* then */
};

/* Noise that K leaves: (1 + 4 + 1)^2 / 16^2 of its power. */
#define REC_VOTE_AFTER_K (36.0 / 256)

/* (3) of vote.h: what a camera may cost at least. */
#define REC_VOTE_ALONE 0.03

struct rec_vote_run {
    rec_vote *v;
    size_t from;
};

static inline bool rec_vote_has(uint64_t set, size_t c)
{
    return (set >> c & 1) != 0;
}

/* In this order: the level's bins that are lit; columns; pictures averaged to the bins, with everything that
 * is known of a camera by itself. */
void rec_vote_light(rec_vote *v);
void rec_vote_pool(rec_vote *v);
/* Columns where a flame may be, and the level's system restricted to them; false: there is none. */
bool rec_vote_restrict(rec_vote *v, struct rec_restrictor *r);
/* `length` of all cameras. */
void rec_vote_lengths(rec_vote *v);
/* Trial 0 with each of these cameras fitted in turn (SART), which is near (1) soon and never there. */
void rec_vote_sweep(rec_vote *v, const size_t *order, size_t n);
/* The misfits of trial 0 as it is. */
void rec_vote_judge(rec_vote *v);
/* Trials [from, to), each from its x. */
void rec_vote_solve(rec_vote *v, size_t from, size_t to);
/* Cameras that send the same picture again and again while the others' change. */
uint64_t rec_vote_frozen(rec_vote *v);
/* With `hold`: whether the set may go without asking every camera, if R of those believed is r times P. */
bool rec_vote_may_wait(const rec_vote *v, double r);
/* What the set's verdict means after the earlier ones; asked: all were. */
void rec_vote_remember(rec_vote *v, struct rec_verdict *o, bool asked);
/* Why camera c does not fit: trial t was solved without it. */
enum rec_wrong rec_vote_cause(const rec_vote *v, const struct rec_trial *t, size_t c);

#endif
