/* What the residuals say went wrong while the pictures were taken: cameras that did not expose together, one
 * that was moved halfway, a lens that the model does not fit. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/calib/priv.h"

#define OVER      3.0 /* joint over single residuals: above it the pictures do not belong together */
#define STRUCTURE 0.25 /* px that repeat by place: above it the lens is not of this model */
#define STEP_PX   0.3  /* px: a smaller step in the residuals is not called a move */
#define STEP_SIDE 3    /* views on each side of it, at least */

/* A view that was compared with others of its frame. */
static bool compared(const struct calib *k, const struct view *v)
{
    size_t others = 0;
    if (!k->placed[v->frame] || (v->fate != REC_VIEW_USED && v->fate != REC_VIEW_JOINT))
        return false;
    for (size_t i = k->of_frame[v->frame]; i < k->of_frame[v->frame + 1]; i++)
        others += &k->view[i] != v && k->view[i].fate == REC_VIEW_USED;
    return others > 0;
}

static double over_of(const struct calib *k, uint32_t c, double *room)
{
    size_t n = 0, m = 0;
    for (size_t i = 0; i < k->nv; i++)
        if (k->view[i].camera == c && compared(k, &k->view[i])) {
            room[n++] = rec_calib_usual(k, &k->view[i]);
            room[k->nv + m++] = k->view[i].usual;
        }
    double single = rec_calib_median(room + k->nv, m);
    return n > 0 && single > 0 ? rec_calib_median(room, n) / single : 0;
}

/* How much smaller the spread of the poses between c and the others becomes when c's pictures are taken for
 * those of the frame before (-1) or after. */
static double shifted_spread(const struct calib *k, uint32_t c, int by)
{
    double ratio[REC_MAX_CAMERAS], pose[6], now, then;
    size_t n = 0;
    for (uint32_t o = 0; o < k->nc; o++)
        if (o != c && rec_calib_pair_pose(k, c, o, 0, pose, &now) >= REC_CALIB_JOINT &&
            rec_calib_pair_pose(k, c, o, by, pose, &then) >= REC_CALIB_JOINT && now > 0)
            ratio[n++] = then / now;
    return n > 0 ? rec_calib_median(ratio, n) : INFINITY;
}

/* Joint residuals far above single ones.  A shift by one frame that helps says it is time; what repeats by its
 * place in the picture is the lens (true: that is left to say); else it is time again, or motion. */
static bool out_of_step(struct calib *k, const double *structure)
{
    uint32_t worst = 0, n = 0;
    for (uint32_t c = 0; c < k->nc; c++) {
        n += k->out->camera[c].over > OVER;
        if (k->out->camera[c].over > k->out->camera[worst].over)
            worst = c;
    }
    if (n == 0)
        return true;
    const char *name = k->in->camera[worst].name;
    double before = shifted_spread(k, worst, 1), after = shifted_spread(k, worst, -1);
    double best = fmin(before, after), over = k->out->camera[worst].over;
    if (best < 0.7)
        rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_SYNC, (int)worst, REC_NO_FRAME,
                      "%s: residuals are %.1f times what it has alone (%u such cameras), and its "
                      "pictures fit the others %.1f times better one frame %s: count its frames "
                      "anew, or trigger all cameras together",
                      name, over, n, 1 / best, before < after ? "earlier" : "later");
    else if (structure[worst] > 0.6 * k->out->camera[worst].joint)
        return true;
    else
        rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_SYNC, (int)worst, REC_NO_FRAME,
                      "%s: residuals are %.1f times what it has alone (%u such cameras), and one "
                      "frame earlier or later is no better: the cameras do not expose together; "
                      "trigger them, or hold the board still for every picture",
                      name, over, n);
    return false;
}

/* ---- a camera that was moved ---------------------------------------------------------------------- */

static double middle_of(const struct drift *d, size_t n, int j, double *room)
{
    for (size_t i = 0; i < n; i++)
        room[i] = d[i].m[j];
    return rec_calib_median(room, n);
}

/* The split of d[0..n) whose sides differ most beyond their own spread.  Returns the step [px], 0: none. */
static double change(const struct drift *d, size_t n, size_t *at, double *room)
{
    double best = 0, step = 0;
    for (size_t s = STEP_SIDE; s + STEP_SIDE <= n; s++) {
        double gap = 0, spread = 0;
        for (int j = 0; j < 4; j++) {
            double a = middle_of(d, s, j, room), b = middle_of(d + s, n - s, j, room);
            gap += (a - b) * (a - b);
            for (size_t i = 0; i < n; i++)
                room[i] = fabs(d[i].m[j] - (i < s ? a : b));
            double mad = 1.4826 * rec_calib_median(room, n);
            spread += mad * mad;
        }
        double over = 1 / (double)s + 1 / (double)(n - s);
        double score = gap / ((spread + 1e-4) * over);
        if (score > best) {
            best = score;
            *at = s;
            step = gap > 25 * spread ? sqrt(gap) : 0;
        }
    }
    return best > 50 ? step : 0;
}

/* The camera whose step is largest; what it does to the others' residuals is smaller. */
static pvx_err moved_camera(struct calib *k, int *moved, double *room)
{
    struct drift *d = pvx_calloc(k->nv, sizeof *d);
    double most = STEP_PX;
    int who = -1;
    uint32_t frame = 0;
    if (d == NULL)
        return PVX_ENOMEM;
    for (uint32_t c = 0; c < k->nc; c++) {
        size_t n = 0, at = 0;
        for (size_t i = 0; i < k->nv; i++)
            if (k->view[i].camera == c && compared(k, &k->view[i]))
                d[n++] = rec_calib_drift(k, &k->view[i], true);
        double step = change(d, n, &at, room);
        if (step > most) {
            most = step;
            who = (int)c;
            frame = d[at].frame;
        }
    }
    free(d);
    if (who < 0)
        return PVX_OK;
    *moved = who;
    rec_calib_say(k, REC_CALIB_REFUSED, REC_CALIB_MOVED, who, frame,
                  "%s was moved before frame %u: its residuals step by %.1f px there; calibrate "
                  "the frames before "
                  "it or from it on",
                  k->in->camera[who].name, frame, most);
    return PVX_OK;
}

pvx_err rec_calib_suspect(struct calib *k)
{
    double *room = pvx_calloc(2 * k->nv, sizeof *room), structure[REC_MAX_CAMERAS], coverage;
    int moved = -1;
    if (room == NULL)
        return PVX_ENOMEM;
    pvx_err e = moved_camera(k, &moved, room);
    for (uint32_t c = 0; c < k->nc; c++) {
        k->out->camera[c].over = over_of(k, c, room);
        structure[c] = rec_calib_structure(k, c, &coverage);
    }
    free(room);
    PVX_TRY(e);
    bool lens_too = moved < 0 && out_of_step(k, structure);
    for (uint32_t c = 0; c < k->nc; c++) {
        double *px = &k->out->camera[c].structure;
        if (lens_too)
            *px = fmax(*px, structure[c]);
        if (*px > STRUCTURE)
            rec_calib_say(k, REC_CALIB_REFUSED, REC_CALIB_LENS, (int)c, REC_NO_FRAME,
                          "%s: %.2f px of its residuals repeat by their place in the picture: no "
                          "lens of this model does that; look for a window, water or a fish-eye "
                          "lens before it",
                          k->in->camera[c].name, *px);
    }
    return PVX_OK;
}
