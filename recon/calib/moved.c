/* Finds a camera that was moved while the pictures were taken: its residuals show a step, and the fit is good once
 * the pictures after the step are not used as that camera's. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/calib/priv.h"

#define STEP_PX   0.3 /* px: a smaller step in the residuals is not called a move */
#define STEP_SIDE 3   /* views on each side of it, at least */

bool rec_calib_compared(const struct calib *k, const struct view *v)
{
    size_t others = 0;
    if (!k->placed[v->frame] || (v->fate != REC_VIEW_USED && v->fate != REC_VIEW_JOINT))
        return false;
    for (size_t i = k->of_frame[v->frame]; i < k->of_frame[v->frame + 1]; i++)
        others += &k->view[i] != v && k->view[i].fate == REC_VIEW_USED;
    return others > 0;
}

static double moved_middle_of(const struct drift *d, size_t n, int j, double *room)
{
    for (size_t i = 0; i < n; i++)
        room[i] = d[i].m[j];
    return pvx_median(room, n);
}

/* Finds the split of d[0..n) with the least sum of distances from the medians of its two sides.  Returns the step
 * between the medians [px]; 0: it is within their own spread. */
static double moved_change(const struct drift *d, size_t n, size_t *at, double *room)
{
    double least = INFINITY, step = 0;
    for (size_t s = STEP_SIDE; s + STEP_SIDE <= n; s++) {
        double gap = 0, spread = 0, sum = 0;
        for (int j = 0; j < 4; j++) {
            double a = moved_middle_of(d, s, j, room), b = moved_middle_of(d + s, n - s, j, room);
            gap += (a - b) * (a - b);
            for (size_t i = 0; i < n; i++) {
                room[i] = fabs(d[i].m[j] - (i < s ? a : b));
                sum += room[i];
            }
            double mad = 1.4826 * pvx_median(room, n);
            spread += mad * mad;
        }
        if (sum < least) {
            least = sum;
            *at = s;
            step = gap > 4 * spread ? sqrt(gap) : 0;
        }
    }
    return step;
}

/* The largest step of all cameras, and its frame.  It does not tell which camera moved: the fit may have given the
 * error to a camera that sees the board from the other side. */
static pvx_err largest_step(const struct calib *k, double *step, uint32_t *frame)
{
    struct drift *d = pvx_calloc(k->nv, sizeof *d);
    double *room = pvx_calloc(k->nv, sizeof *room);
    *step = 0;
    for (uint32_t c = 0; c < k->nc && d != NULL && room != NULL; c++) {
        size_t n = 0, at = 0;
        for (size_t i = 0; i < k->nv; i++)
            if (k->view[i].camera == c && rec_calib_compared(k, &k->view[i]))
                d[n++] = rec_calib_drift(k, &k->view[i], true);
        double px = moved_change(d, n, &at, room);
        if (px > *step) {
            *step = px;
            *frame = d[at].frame;
        }
    }
    pvx_err e = d != NULL && room != NULL ? PVX_OK : PVX_ENOMEM;
    free(d);
    free(room);
    return e;
}

/* Solves without the smaller part of camera c's views, either those before `frame` or those from it on (c = nc:
 * with all views).  Gives the mean squared residuals, in units of each camera's residuals alone, of all views and
 * of the remaining views of c.  Wrong corners count little.  The state is scratch. */
static pvx_err trial(struct calib *k, uint32_t c, uint32_t frame, double *all, double *own)
{
    double n[2] = {0}, sum[2] = {0};
    size_t part[2] = {0};
    for (size_t i = 0; i < k->nv; i++) {
        struct view *v = &k->view[i];
        if (v->fate == REC_VIEW_JOINT)
            v->fate = REC_VIEW_USED;
        part[k->out->frame[v->frame] >= frame] += v->fate == REC_VIEW_USED && v->camera == c;
    }
    for (size_t i = 0; i < k->nv; i++) {
        struct view *v = &k->view[i];
        bool later = k->out->frame[v->frame] >= frame;
        if (v->fate == REC_VIEW_USED && v->camera == c && later == (part[1] <= part[0]))
            v->fate = REC_VIEW_JOINT;
    }
    for (size_t i = 0; i < k->ns; i++)
        k->seen[i].wrong = isinf(k->seen[i].far);
    *all = *own = INFINITY;
    if (c < k->nc && (part[0] < STEP_SIDE || part[1] < STEP_SIDE))
        return PVX_OK;
    PVX_TRY(rec_calib_adjust(k, &(struct adjust){.robust = true, .max_iterations = 20}));
    rec_calib_measure_all(k);
    for (size_t i = 0; i < k->nv; i++)
        for (size_t s = k->view[i].first; s < k->view[i].first + k->view[i].n; s++)
            if (k->view[i].fate == REC_VIEW_USED && k->placed[k->view[i].frame]) {
                double far2 = fmin(k->seen[s].far * k->seen[s].far, OUTLIER * OUTLIER);
                sum[0] += far2;
                n[0]++;
                sum[1] += k->view[i].camera == c ? far2 : 0;
                n[1] += k->view[i].camera == c;
            }
    *all = sum[0] / fmax(n[0], 1);
    *own = sum[1] / fmax(n[1], 1);
    return PVX_OK;
}

/* Finds the camera whose views must go for the others to agree; -1: no single camera. */
static pvx_err who_moved(struct calib *k, uint32_t frame, int *who)
{
    double *kept = k->state, scale[REC_MAX_CAMERAS], all, own, best = INFINITY;
    double *copy = pvx_calloc(k->n_state, sizeof *copy);
    struct view *view = pvx_calloc(k->nv, sizeof *view);
    struct seen *seen = pvx_calloc(k->ns, sizeof *seen);
    pvx_err e = copy != NULL && view != NULL && seen != NULL ? PVX_OK : PVX_ENOMEM;
    *who = -1;
    if (e == PVX_OK) {
        memcpy(view, k->view, k->nv * sizeof *view);
        memcpy(seen, k->seen, k->ns * sizeof *seen);
        memcpy(scale, k->scale, sizeof scale);
        memcpy(k->scale, k->alone, sizeof scale);
    }
    for (uint32_t i = 0; i <= k->nc && e == PVX_OK; i++) {
        uint32_t c = i == 0 ? (uint32_t)k->nc : i - 1; /* first with all views */
        memcpy(copy, kept, k->n_state * sizeof *copy);
        rec_calib_use_state(k, copy);
        e = trial(k, c, frame, &all, &own);
        if (i == 0)
            best = 0.7 * all;
        if (i > 0 && all < best && own < 4) { /* 2: two numbers of unit variance */
            best = all;
            *who = (int)c;
        }
        memcpy(k->view, view, k->nv * sizeof *view);
        memcpy(k->seen, seen, k->ns * sizeof *seen);
    }
    rec_calib_use_state(k, kept);
    if (seen != NULL && view != NULL && copy != NULL)
        memcpy(k->scale, scale, sizeof scale);
    free(copy);
    free(view);
    free(seen);
    return e;
}

pvx_err rec_calib_moved(struct calib *k, bool *moved)
{
    double step;
    uint32_t frame = 0;
    int who;
    *moved = false;
    PVX_TRY(largest_step(k, &step, &frame));
    if (step < STEP_PX)
        return PVX_OK;
    PVX_TRY(who_moved(k, frame, &who));
    if (who < 0)
        return PVX_OK;
    *moved = true;
    rec_calib_say(
        k, REC_CALIB_REFUSED, REC_CALIB_MOVED, who, frame,
        "%s was moved at frame %u: there residuals step by %.1f px, and without its "
        "pictures of one side all others agree; solve the frames before (--to %u) or those "
        "from there on (--from %u), or all others first and then it with --keep RIG "
        "--recover %s --from %u",
        k->in->camera[who].name, frame, step, frame - 1, frame, k->in->camera[who].name, frame);
    return PVX_OK;
}
