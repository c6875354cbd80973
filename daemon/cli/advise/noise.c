#include "daemon/cli/advise/advise.h"

pvx_err advise_noise(const struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    struct flame_sets_args some = *s->a;
    struct flame_sets in = {.a = &some, .light = s->light, .kinds = FRAMES_IN_EACH};
    rec_unseen *u = NULL;
    some.sets = REC_CHECK_SETS;
    pvx_err e = rec_rig_copy(&s->rig, &in.rig);
    PVX_THEN(e, flame_sets_read(&in, d));
    if (e == PVX_OK && in.nch == 3)
        e = rec_unseen_new(&in.rig, &in.params, in.pool, &u, d);
    for (in.channel = 0; in.channel < 3 && u != NULL && e == PVX_OK; in.channel++) {
        struct rec_check_source from = flame_sets_source(&in, "noise");
        a->noise[in.channel] = 0;
        for (size_t i = 0; i < from.n && e == PVX_OK; i++) {
            struct rec_check_set set;
            e = from.get(from.ctx, i, &set);
            if (e == PVX_OK) {
                rec_unseen_load(u, set.picture, set.floats);
                a->noise[in.channel] += rec_unseen_sigma(u) / (double)from.n;
            }
            if (e == PVX_OK && !from.progress(from.ctx, (double)(i + 1) / (double)from.n))
                e = PVX_ECANCELED;
        }
    }
    rec_unseen_free(&u);
    flame_sets_fini(&in);
    return e;
}
