/* Cross-validation: every third frame is held out, three times.  The cameras come from the other frames, then only
 * the poses of the board in the held-out frames are fitted.  A fit to noise is worse on frames that it did not
 * use. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/calib/priv.h"

/* px rms over the frames of the mask, per degree of freedom; `free`: numbers fitted beside the boards. */
static double rms_of(const struct calib *k, const bool *mask, double free)
{
    double sum = 0, n = 0;
    for (size_t f = 0; f < k->nf; f++)
        free += mask[f] ? 6 : 0;
    for (size_t i = 0; i < k->nv; i++) {
        const struct view *v = &k->view[i];
        for (size_t s = v->first; s < v->first + v->n && mask[v->frame] && v->fate == REC_VIEW_USED;
             s++)
            if (!k->seen[s].wrong) {
                sum += k->seen[s].r[0] * k->seen[s].r[0] + k->seen[s].r[1] * k->seen[s].r[1];
                n += 2;
            }
    }
    return n > free ? sqrt(2 * sum / (n - free)) : NAN;
}

static pvx_err folds_fold(struct calib *k, size_t which, bool *train, bool *test,
                          const struct rec_rig *whole)
{
    struct rec_rig rig;
    double worst;
    size_t n = 0;
    unsigned shape = k->shape_held;
    for (size_t f = 0; f < k->nf; f++) {
        bool out = k->placed[f] && n % REC_CALIB_FOLDS == which;
        n += k->placed[f];
        train[f] = k->placed[f] && !out;
        test[f] = out;
    }
    struct adjust a = {.frame = train, .max_iterations = 10};
    PVX_TRY(rec_calib_adjust(k, &a));
    k->shape_held = (1u << SHAPE) - 1;
    a = (struct adjust){
        .frame = test, .lens_fixed = true, .pose_fixed = true, .max_iterations = 10};
    pvx_err e = rec_calib_adjust(k, &a);
    k->shape_held = shape;
    PVX_TRY(e);
    rec_calib_measure_all(k);
    k->out->fold[which].trained = rms_of(k, train, 15.0 * (double)k->nc);
    k->out->fold[which].held_out = rms_of(k, test, 0);
    PVX_TRY(rec_calib_rig(k, &rig));
    if (rec_calib_distance(whole, &rig, &k->out->fold[which].volume, &worst) != PVX_OK)
        k->out->fold[which].volume = NAN;
    rec_rig_fini(&rig);
    return PVX_OK;
}

pvx_err rec_calib_folds(struct calib *k, const struct rec_rig *whole)
{
    size_t placed = 0;
    for (size_t f = 0; f < k->nf; f++)
        placed += k->placed[f];
    for (size_t i = 0; i < REC_CALIB_FOLDS; i++)
        k->out->fold[i].trained = k->out->fold[i].held_out = k->out->fold[i].volume = NAN;
    if (placed < 2 * REC_CALIB_FOLDS)
        return PVX_OK;
    double *kept = k->state, *copy = pvx_calloc(k->n_state, sizeof *copy);
    bool *mask = pvx_calloc(2 * k->nf, sizeof *mask);
    pvx_err e = copy != NULL && mask != NULL ? PVX_OK : PVX_ENOMEM;
    for (size_t i = 0; i < REC_CALIB_FOLDS && e == PVX_OK; i++) {
        memcpy(copy, kept, k->n_state * sizeof *copy);
        rec_calib_use_state(k, copy);
        e = folds_fold(k, i, mask, mask + k->nf, whole);
        rec_calib_use_state(k, kept);
    }
    if (e == PVX_OK)
        rec_calib_measure_all(k);
    free(copy);
    free(mask);
    return e;
}
