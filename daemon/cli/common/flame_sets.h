/* flame_sets.h - frame sets of a recording, for the commands that compare a flame with the rig: their options, and
 * the binned pictures, which stay in memory.
 *
 *   --rig FILE --cameras A,B --frames DIR|TAKE.h5 --first N --last N --sets N --background DIR --black X
 *   --binning N --pixel-format NAME --transfer NAME --threads N --quiet
 *
 * A command lists flame_sets_argp() among its children, hands over the struct in ARGP_KEY_INIT as with opt_rig.h, and
 * then calls flame_sets_load.  Strings point into argv.
 * Of a longer recording, runs of FLAME_SETS_RUN consecutive sets are taken, evenly spread.  Only neighbours show
 * whether a camera is one frame late. */
#ifndef FLAME_SETS_H
#define FLAME_SETS_H
#include <argp.h>
#include <stdbool.h>

#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/frames_in.h"
#include "recon/check/judge.h"
#include "recon/check/plausible.h"

#define FLAME_SETS_RUN 10

struct flame_sets_args {
    const char *rig, *cameras, *frames, *background;
    double black; /* share of full scale */
    int64_t first, last, sets, binning, threads;
    struct frames_in_reading reading;
    bool quiet;
};
#define FLAME_SETS_INIT                    \
    {                                      \
        .last = FRAMES_IN_LAST, .sets = 60 \
    }
const struct argp *flame_sets_argp(void);

struct flame_sets {
    const struct flame_sets_args *a;
    struct rec_rig rig;
    const dmn_photometry *light; /* of the rig, borrowed; NULL: pictures as they are */
    dmn_photometry *own;         /* the same, where flame_sets_load read it */
    enum frames_in_kinds kinds;  /* in: FRAMES_IN_GREY, the default: the channels' mean */
    int nch;                     /* of the pictures, 1 or 3 */
    int channel;                 /* the one of them that the source gives */
    pvx_pool *pool;
    struct rec_unseen_params params;    /* binning is set */
    size_t there, n;                    /* frame sets of the recording; those taken */
    uint64_t *number;                   /* [n] */
    float *(*picture)[REC_MAX_CAMERAS]; /* [n] [bins][1 or 4], NULL = missing */
    float *plane[REC_MAX_CAMERAS];      /* the source's, where there are three channels */
    const float *given[REC_MAX_CAMERAS];
    size_t bins[REC_MAX_CAMERAS]; /* of a picture */
    bool floats;
    uint64_t grey;          /* cameras with grey pictures where others have colour; else 0 */
    struct cap_depth depth; /* of the samples in words of 16 bits, all cameras */
    struct cli_progress bar;
};

/* Read the rig and the sets, with the rig's photometry.  s->rig is as dmn_photometry_load leaves it: do not save it.
 * Owner: caller, flame_sets_fini, after an error too. */
PVX_MUST_CHECK pvx_err flame_sets_load(struct flame_sets *s, const struct flame_sets_args *a,
                                       struct pvx_diag *d);
/* The same for a rig that is already in s, with `light` and `kinds`.  If `light` is set, saturated bins are NaN. */
PVX_MUST_CHECK pvx_err flame_sets_read(struct flame_sets *s, struct pvx_diag *d);
void flame_sets_fini(struct flame_sets *s);
/* A source of all the sets.  It borrows s, and shows its progress under `label` unless --quiet. */
struct rec_check_source flame_sets_source(struct flame_sets *s, const char *label);
/* Whether pictures and rig belong together, by the first sets, which follow each other.  u is of s->rig and s->params.
 * Errors: those of rec_plausible_judge. */
PVX_MUST_CHECK pvx_err flame_sets_belong(struct flame_sets *s, rec_unseen *u,
                                         struct rec_plausible_verdict *out);

#endif
