/* report_views.c - what the pictures of the recording add to a report: left-out views, and advice. */
#include <math.h>
#include <stdlib.h>
#include <unistd.h>

#include "daemon/cli/advise/report.h"
#include "recon/check/holdout.h"

#define SETS 3

struct views_sum {
    double miss, all, noise;
};

/* Adds the left-out views of one set. */
static pvx_err views_add(rec_unseen *u, size_t cameras, struct views_sum *sum)
{
    bool sees[REC_MAX_CAMERAS], use[REC_MAX_CAMERAS];
    size_t n = rec_holdout_who(u, sees);
    for (size_t k = 0; k < cameras && n > 3; k++) {
        int32_t voxels;
        double all;
        if (!sees[k])
            continue;
        for (size_t c = 0; c < cameras; c++)
            use[c] = sees[c] && c != k;
        PVX_TRY(rec_unseen_solve(u, use, &voxels));
        if (voxels == 0)
            continue;
        sum[k].miss += rec_holdout_miss(u, k, 0, &all);
        sum[k].all += all;
        sum[k].noise += rec_holdout_noise(u, k);
    }
    return PVX_OK;
}

static pvx_err views_measure(struct report *r, struct flame_sets *s, struct pvx_diag *d)
{
    struct rec_check_source from = flame_sets_source(s, "left-out views");
    struct views_sum sum[REC_MAX_CAMERAS] = {0};
    size_t n = from.n < SETS ? from.n : SETS;
    rec_unseen *u;
    PVX_TRY(rec_unseen_new(&s->rig, &s->params, s->pool, &u, d));
    pvx_err e = PVX_OK;
    for (size_t i = 0; i < n && e == PVX_OK; i++) {
        struct rec_check_set set;
        e = from.get(from.ctx, n > 1 ? i * (from.n - 1) / (n - 1) : 0, &set);
        if (e == PVX_OK) {
            rec_unseen_load(u, set.picture, set.floats);
            e = views_add(u, s->rig.n_cameras, sum);
        }
        if (e == PVX_OK && !from.progress(from.ctx, (double)(i + 1) / (double)n))
            e = PVX_ECANCELED;
    }
    rec_unseen_free(&u);
    r->view_sets = n;
    for (size_t k = 0; k < s->rig.n_cameras; k++) {
        int at = rec_rig_find(&r->rig, s->rig.cameras[k].name);
        if (at >= 0 && sum[k].all > 0)
            r->view[at] = (struct report_view){true, sqrt(sum[k].miss / sum[k].all),
                                               sqrt(sum[k].noise / sum[k].all)};
    }
    return e;
}

static pvx_err views_advise(struct report *r, struct flame_sets *s, struct pvx_diag *d)
{
    struct advice a;
    size_t len;
    PVX_TRY(advise_all(s, &a, d));
    FILE *f = open_memstream(&r->advice, &len);
    if (f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "out of memory for advice");
    advise_print(f, s, &a);
    return fclose(f) == 0 ? PVX_OK : pvx_fail(d, PVX_ENOMEM, "out of memory for advice");
}

/* Only pictures between the first and the last volume. */
static void views_between(struct flame_sets_args *a, const struct course *c)
{
    int64_t first = (int64_t)c->row[0].v.set, last = (int64_t)c->row[c->n - 1].v.set;
    a->first = a->first > first ? a->first : first;
    a->last = a->last < last ? a->last : last;
}

/* Pictures and volumes have the same set numbers, or they are of two recordings. */
static pvx_err views_same(const struct report *r, const struct flame_sets *s, struct pvx_diag *d)
{
    for (size_t i = 0; i < s->n; i++)
        for (size_t k = 0; k < r->course.n; k++)
            if (s->number[i] == r->course.row[k].v.set)
                return PVX_OK;
    return pvx_fail(d, PVX_ESTALE,
                    "%s: none of its sets is in %s, so it is of another recording; its sets have "
                    "numbers from %llu on, the volumes from %llu on",
                    r->a.frames, r->in, (unsigned long long)s->number[0],
                    (unsigned long long)r->course.row[0].v.set);
}

pvx_err report_views(struct report *r, struct pvx_diag *d)
{
    struct flame_sets s;
    if (r->a.frames == NULL)
        return PVX_OK;
    views_between(&r->a, &r->course);
    struct pvx_diag why = {""};
    pvx_err e = flame_sets_load(&s, &r->a, &why);
    if (e == PVX_ENOENT && access(r->a.frames, F_OK) == 0)
        e = pvx_fail(d, PVX_ESTALE,
                     "%s: none of its sets is in %s, so it is of another recording (%s)",
                     r->a.frames, r->in, pvx_diag_text(&why, e));
    else if (e != PVX_OK)
        e = pvx_fail(d, e, "%s", pvx_diag_text(&why, e));
    PVX_THEN(e, views_same(r, &s, d));
    PVX_THEN(e, views_measure(r, &s, d));
    if (e == PVX_OK && s.rig.n_cameras >= 4)
        e = views_advise(r, &s, d);
    flame_sets_fini(&s);
    return e;
}
