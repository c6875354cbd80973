#include "daemon/cli/reconstruct/absorb.h"

#include <stdio.h>

#include "daemon/cli/common/flame_sets.h"
#include "recon/check/absorption.h"

static void absorb_say(const struct rec_absorption *a)
{
    if (a->c > 0)
        fprintf(stderr,
                "absorption: c %.3g, an optical depth of %.1f at the brightest pixel: %u of %u "
                "left-out pictures improve, their squared error beyond noise falls by %.0f %%\n",
                a->c, a->depth, a->better, a->views, 100 * a->gain);
    else
        fprintf(stderr,
                "absorption: none; the best c, %.3g, improves only %u of %u left-out pictures, the "
                "squared error beyond noise by %.1f %%\n",
                a->best, a->better, a->views, 100 * a->gain);
}

pvx_err reconstruct_absorb(const struct reconstruct_options *o, double *c, struct pvx_diag *d)
{
    const struct flame_sets_args a = {.rig = o->rig.path,
                                      .cameras = o->rig.cameras,
                                      .frames = o->frames,
                                      .background = o->background,
                                      .black = (double)o->frame.photo.black,
                                      .first = o->first,
                                      .last = o->last,
                                      .sets = 4 * REC_ABSORPTION_SETS,
                                      .threads = o->rig.threads,
                                      .reading = o->reading,
                                      .quiet = o->quiet};
    struct flame_sets s;
    struct rec_absorption found = {0};
    rec_unseen *u = NULL;
    pvx_err e = flame_sets_load(&s, &a, d);
    PVX_THEN(e, rec_unseen_new(&s.rig, &s.params, s.pool, &u, d));
    if (e == PVX_OK) {
        struct rec_check_source from = flame_sets_source(&s, "absorption");
        e = rec_absorption_find(u, &from, &found, d);
    }
    rec_unseen_free(&u);
    flame_sets_fini(&s);
    if (e == PVX_OK && !o->quiet)
        absorb_say(&found);
    *c = found.c;
    return e;
}
