/* levels.c - levels for the conditions of `triggers` in pyrovoxd.yaml, from the volumes of the recording's sets. */
#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "daemon/cli/advise/advise.h"
#include "daemon/pipeline/triggers.h"

#define DARK 0.05 /* of the most light: a set with less shows no flame */

static int levels_ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Light and height of one set.  No hull: no light. */
static pvx_err levels_of(rec_unseen *u, const struct rec_check_set *set, size_t cameras,
                         double *light, double *height)
{
    bool use[REC_MAX_CAMERAS];
    struct rec_sparse v;
    int32_t n = 0;
    rec_unseen_load(u, set->picture, set->floats);
    for (size_t c = 0; c < cameras; c++)
        use[c] = rec_unseen_present(u, c);
    PVX_TRY(rec_unseen_solve(u, use, &n));
    *light = *height = 0;
    if (n == 0)
        return PVX_OK;
    double l = -1;
    rec_unseen_volume(u, &v);
    *light = dmn_trigger_value(&(struct dmn_trigger){.when = DMN_WHEN_LIGHT}, &v, &l);
    *height = dmn_trigger_value(&(struct dmn_trigger){.when = DMN_WHEN_HEIGHT}, &v, &l);
    return PVX_OK;
}

/* From the light of all sets, in ascending order, and the largest changes. */
static void levels_choose(const double *sorted, size_t n, struct advise_levels *l)
{
    l->most = sorted[n - 1];
    while (l->dark < n && sorted[l->dark] < DARK * l->most)
        l->dark++;
    l->least = sorted[l->dark];
    /* Between dark and flame in the geometric mean; without a dark set, above all that was seen. */
    l->dim = l->dark > 0 ? fmax(sorted[l->dark - 1], 0.01 * l->least) : 0;
    l->above = l->dark > 0 ? sqrt(l->dim * l->least) : 1.2 * l->most;
    l->release = l->dark > 0 ? sqrt(l->dim * l->above) : 1.1 * l->most;
}

pvx_err advise_levels(struct flame_sets *s, struct advise_levels *out, struct pvx_diag *d)
{
    struct rec_check_source from = flame_sets_source(s, "triggers");
    rec_unseen *u;
    *out = (struct advise_levels){0};
    double *light = pvx_calloc(s->n + 1, sizeof *light), before = -1;
    size_t lit = 0;
    PVX_NEED(light);
    pvx_err e = rec_unseen_new(&s->rig, &s->params, s->pool, &u, d);
    for (size_t i = 0; i < from.n && e == PVX_OK; i++) {
        struct rec_check_set set;
        double height = 0;
        e = from.get(from.ctx, i, &set);
        PVX_THEN(e, levels_of(u, &set, s->rig.n_cameras, &light[i], &height));
        if (light[i] > 0 && (lit++ == 0 || height > out->height))
            out->height = height;
        if (i > 0 && s->number[i] == s->number[i - 1] + 1 && before > 0 && light[i] > 0 &&
            fmin(before, light[i]) > DARK * fmax(before, light[i])) {
            out->change = fmax(out->change, 100 * fabs(light[i] - before) / before);
            out->pairs++;
        }
        before = light[i];
        if (e == PVX_OK && !from.progress(from.ctx, (double)(i + 1) / (double)from.n))
            e = PVX_ECANCELED;
    }
    rec_unseen_free(&u);
    out->sets = from.n;
    qsort(light, from.n, sizeof *light, levels_ascending);
    if (e == PVX_OK && from.n > 0 && light[from.n - 1] > 0)
        levels_choose(light, from.n, out);
    free(light);
    return e;
}
