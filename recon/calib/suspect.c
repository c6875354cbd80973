/* Faults during the recording that the residuals show: cameras that did not expose together, a camera that was
 * moved halfway, a lens that the model does not fit. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/calib/priv.h"

#define OVER 3.0 /* joint / single residuals: above it the pictures are not of the same instants */
#define WHOLE \
    0.25 /* of the spread is left after a shift of one frame.  With an evenly moving board the camera is then off
          * by 0.8 frames or more, which a free-running camera is not for long */
#define STRUCTURE 0.25 /* px that repeat by place: above it the lens is not of this model */

static double over_of(const struct calib *k, uint32_t c, double *room)
{
    size_t n = 0, m = 0;
    for (size_t i = 0; i < k->nv; i++)
        if (k->view[i].camera == c && rec_calib_compared(k, &k->view[i])) {
            room[n++] = rec_calib_usual(k, &k->view[i]);
            room[k->nv + m++] = k->view[i].usual;
        }
    double single = pvx_median(room + k->nv, m);
    if (n == 0 || !(single > 0))
        return 0;
    double joint = pvx_median(room, n); /* sorts room */
    k->out->camera[c].gross = room[3 * n / 4] / single;
    return joint / single;
}

/* Spread of the poses between c and the others when c's picture of frame f + by counts as one of frame f, relative
 * to the spread without that shift. */
static double shifted_spread(const struct calib *k, uint32_t c, int by)
{
    double ratio[REC_MAX_CAMERAS], pose[6], now, then;
    size_t n = 0;
    for (uint32_t o = 0; o < k->nc; o++)
        if (o != c && rec_calib_pair_pose(k, c, o, 0, pose, &now) >= REC_CALIB_JOINT &&
            rec_calib_pair_pose(k, c, o, by, pose, &then) >= REC_CALIB_JOINT && now > 0)
            ratio[n++] = then / now;
    return n > 0 ? pvx_median(ratio, n) : INFINITY;
}

/* The camera with the largest ratio of joint to single residuals; n: cameras whose ratio is above OVER. */
static uint32_t worst_of(const struct calib *k, uint32_t *n)
{
    uint32_t worst = 0;
    *n = 0;
    for (uint32_t c = 0; c < k->nc; c++) {
        *n += k->out->camera[c].over > OVER;
        if (k->out->camera[c].over > k->out->camera[worst].over)
            worst = c;
    }
    return worst;
}

/* Finds the camera whose pictures fit the others better when they count as those of the frame before or after.
 * All cameras are tried, since it need not be the one with the largest residuals. */
static bool a_frame_off(struct calib *k, uint32_t worst, uint32_t n)
{
    double best = 0.7;
    int who = -1;
    bool late = false;
    for (uint32_t c = 0; c < k->nc; c++) {
        double before = shifted_spread(k, c, 1), after = shifted_spread(k, c, -1);
        if (!(fmin(before, after) < best))
            continue;
        best = fmin(before, after);
        who = (int)c;
        late = before < after;
    }
    if (who < 0)
        return false;
    const char *name = k->in->camera[who].name;
    rec_calib_say(k, best < WHOLE ? REC_CALIB_REFUSED : REC_CALIB_WARNING, REC_CALIB_SYNC, who,
                  REC_NO_FRAME,
                  "%s is %s frame %s: residuals of %u camera%s are up to %.1f times what each has "
                  "alone, and its pictures fit the others %.1f times better one frame %s; give its "
                  "pictures numbers %s by one, or trigger all cameras together",
                  name, best < WHOLE ? "one" : "most of a", late ? "late" : "early", n,
                  n == 1 ? "" : "s", k->out->camera[worst].over, 1 / best,
                  late ? "earlier" : "later", late ? "lower" : "higher");
    return true;
}

/* Residuals that repeat by place in the picture come from the lens.  A fit of one camera alone may distort poses
 * to hide them. */
static bool a_lens(struct calib *k, const double *structure, bool together)
{
    bool any = false;
    for (uint32_t c = 0; c < k->nc; c++) {
        struct rec_calib_of_camera *o = &k->out->camera[c];
        if (together && structure[c] > 0.6 * o->joint)
            o->structure = fmax(o->structure, structure[c]);
        if (!(o->structure > STRUCTURE))
            continue;
        any = true;
        rec_calib_say(k, REC_CALIB_REFUSED, REC_CALIB_LENS, (int)c, REC_NO_FRAME,
                      "%s: %.2f px of its residuals repeat by their place in the picture: no lens "
                      "of this model "
                      "does that; look for a window, water or a fish-eye lens before it",
                      k->in->camera[c].name, o->structure);
    }
    return any;
}

pvx_err rec_calib_suspect(struct calib *k)
{
    double *room = pvx_calloc(2 * k->nv, sizeof *room), structure[REC_MAX_CAMERAS] = {0}, coverage;
    bool moved = false;
    uint32_t n;
    if (room == NULL)
        return PVX_ENOMEM;
    for (uint32_t c = 0; c < k->nc; c++) {
        k->out->camera[c].over = over_of(k, c, room);
        structure[c] = rec_calib_structure(k, c, &coverage);
    }
    free(room);
    uint32_t worst = worst_of(k, &n);
    bool off = n > 0 && a_frame_off(k, worst, n);
    if (!off)
        PVX_TRY(rec_calib_moved(k, &moved));
    if (!a_lens(k, structure, !off && !moved) && n > 0 && !off && !moved)
        rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_SYNC, (int)worst, REC_NO_FRAME,
                      "%s: residuals are %.1f times what it has alone (%u such cameras), and one "
                      "frame earlier or "
                      "later is no better: the cameras do not expose together; trigger them, or "
                      "hold the board "
                      "still for every picture",
                      k->in->camera[worst].name, k->out->camera[worst].over, n);
    return PVX_OK;
}
