#include "recon/check/refine.h"

#include <math.h>
#include <string.h>

#define LINE 0.05
#define STEP 0.7 /* share of a correction that is applied, as all cameras move at once */
#define FEW  6   /* sets for the first choice of believed cameras */

struct refine {
    const struct rec_unseen_params *p;
    pvx_pool *pool;
    const struct rec_check_source *s;
    struct rec_refine_report *out;
    struct pvx_diag *d;
    bool use[REC_MAX_CAMERAS];
    unsigned held;
};

bool rec_rig_in_line(const struct rec_rig *rig)
{
    double a[3] = {0}, b[3] = {0}, x[3], far = 0, off = 0;
    for (size_t i = 0; i < rig->n_cameras; i++)
        for (size_t k = 0; k < i; k++) {
            double p[3], q[3], len = 0;
            rec_camera_centre(&rig->cameras[i], p);
            rec_camera_centre(&rig->cameras[k], q);
            for (int j = 0; j < 3; j++)
                len += (p[j] - q[j]) * (p[j] - q[j]);
            if (len > far) {
                far = len;
                memcpy(a, p, sizeof a);
                memcpy(b, q, sizeof b);
            }
        }
    for (size_t i = 0; i < rig->n_cameras && far > 0; i++) {
        double along = 0, all = 0;
        rec_camera_centre(&rig->cameras[i], x);
        for (int j = 0; j < 3; j++) {
            along += (x[j] - a[j]) * (b[j] - a[j]) / sqrt(far);
            all += (x[j] - a[j]) * (x[j] - a[j]);
        }
        off = fmax(off, all - along * along);
    }
    return off <= LINE * LINE * far;
}

/* Checks sets [from, to) with a rig. */
static pvx_err refine_look(const struct refine *r, const struct rec_rig *rig, size_t from,
                           size_t to, rec_check **k)
{
    struct rec_check_set set;
    PVX_TRY(rec_check_new(rig, r->p, r->pool, k, r->d));
    rec_check_begin(*k, r->use);
    for (size_t i = from; i < to; i++) {
        bool on = r->s->progress == NULL ||
                  r->s->progress(r->s->ctx, (double)(i - from) / (double)(to - from));
        if (!on)
            return PVX_ECANCELED;
        PVX_TRY(r->s->get(r->s->ctx, i, &set));
        PVX_TRY(rec_check_add(*k, &set));
    }
    return PVX_OK;
}

/* (1) of the held-out sets. */
static pvx_err error_of(const struct refine *r, const struct rec_rig *rig, double *error)
{
    static struct rec_check_figures f; /* large */
    rec_check *k;
    double sum = 0, n = 0;
    pvx_err e = refine_look(r, rig, r->out->fitted, r->s->n, &k);
    if (e == PVX_OK) {
        rec_check_get(k, &f);
        for (size_t c = 0; c < rig->n_cameras; c++)
            if (f.camera[c].sets > 0) {
                sum += f.camera[c].residual * f.camera[c].residual;
                n++;
            }
    }
    rec_check_free(&k);
    *error = n > 0 ? sqrt(sum / n) : 1;
    return e;
}

/* Corrects every camera by its own displacements. */
static pvx_err correct(struct refine *r, struct rec_rig *rig)
{
    rec_check *k;
    struct rec_pose_fit fit;
    int32_t binning = rec_unseen_binning(rig, r->p);
    pvx_err e = refine_look(r, rig, 0, r->out->fitted, &k);
    for (size_t c = 0; c < rig->n_cameras && e == PVX_OK; c++)
        if (rec_pose_fit(rec_check_lattice(k, c), &rig->cameras[c], &rig->grid, binning, r->held,
                         &fit)) {
            for (int i = 0; i < 7; i++)
                fit.x[i] *= STEP;
            rec_pose_apply_fit(&rig->cameras[c], &rig->grid, &fit);
            r->out->held[c] = fit.held;
        } else {
            r->out->held[c] = REC_POSE_ALL;
        }
    rec_check_free(&k);
    return e;
}

static pvx_err refine_rounds(struct refine *r, const struct rec_rig *first, struct rec_rig *now,
                             struct rec_rig *best)
{
    struct rec_refine_report *o = r->out;
    PVX_TRY(error_of(r, first, &o->error[0]));
    for (uint32_t i = 1; i <= REC_REFINE_ROUNDS; i++) {
        PVX_TRY(correct(r, now));
        (void)rec_gauge_hold(first, now, NULL);
        o->moved[i] = rec_gauge_distance(best, now, NULL);
        for (size_t c = 0; c < first->n_cameras; c++)
            r->use[c] = true;
        PVX_TRY(error_of(r, now, &o->error[i]));
        o->rounds = i;
        if (!(o->error[i] < o->error[o->best]))
            break;
        o->best = i;
        memcpy(best->cameras, now->cameras, now->n_cameras * sizeof *now->cameras);
    }
    o->accepted = o->error[o->best] < (1 - REC_REFINE_GAIN) * o->error[0];
    return PVX_OK;
}

/* Chooses the cameras that take part in the first volumes.  A fault that is not a pose is an error. */
static pvx_err whom_to_believe(struct refine *r, const struct rec_rig *rig)
{
    static struct rec_check_verdict v; /* large */
    struct rec_check_source few = *r->s;
    rec_check *k;
    few.n = few.n < FEW ? few.n : FEW;
    pvx_err e = rec_check_new(rig, r->p, r->pool, &k, r->d);
    if (e == PVX_OK)
        e = rec_check_run(k, rig, &few, &v, r->d);
    rec_check_free(&k);
    PVX_TRY(e);
    for (size_t c = 0; c < rig->n_cameras; c++) {
        enum rec_wrong w = v.figures.camera[c].wrong;
        r->use[c] = v.outcome != REC_CHECK_NAMED || v.figures.use[c];
        if (v.outcome == REC_CHECK_NAMED && (w == REC_WRONG_DARK || w == REC_WRONG_FLOODED ||
                                             w == REC_WRONG_MIRRORED || w == REC_WRONG_LATE))
            return pvx_fail(r->d, PVX_EINVAL, "%s is wrong, but not its pose (%s): %s",
                            rig->cameras[c].name, rec_wrong_name(w), rec_wrong_remedy(w));
    }
    return PVX_OK;
}

pvx_err rec_refine(struct rec_rig *rig, const struct rec_unseen_params *p, pvx_pool *pool,
                   const struct rec_check_source *s, struct rec_refine_report *out,
                   struct pvx_diag *d)
{
    struct refine r = {.p = p, .pool = pool, .s = s, .out = out, .d = d};
    struct rec_rig now = {0}, best = {0};
    *out = (struct rec_refine_report){.fitted = s->n - s->n / 3, .held_out = s->n / 3};
    if (s->n < REC_REFINE_SETS)
        return pvx_fail(d, PVX_EINVAL,
                        "%zu frame sets: a refinement needs %d at least, two thirds to fit and the "
                        "rest to judge",
                        s->n, REC_REFINE_SETS);
    for (size_t c = 0; c < rig->n_cameras; c++)
        if (rig->cameras[c].model == REC_RAYS)
            return pvx_fail(d, PVX_EUNSUP,
                            "%s has model: rays, and rays from a file cannot be moved in it: leave "
                            "it out with --cameras, or make its file again",
                            rig->cameras[c].name);
    PVX_TRY(whom_to_believe(&r, rig));
    out->in_line = rec_rig_in_line(rig);
    r.held = out->in_line ? REC_POSE_FROM | REC_POSE_DISTANCE | REC_POSE_FOCAL : 0;
    pvx_err e = rec_rig_copy(rig, &now);
    if (e == PVX_OK)
        e = rec_rig_copy(rig, &best);
    if (e == PVX_OK)
        e = refine_rounds(&r, rig, &now, &best);
    if (e == PVX_OK) {
        out->all_px = rec_gauge_distance(rig, &best, out->px);
        if (out->accepted)
            memcpy(rig->cameras, best.cameras, rig->n_cameras * sizeof *rig->cameras);
    }
    rec_rig_fini(&now);
    rec_rig_fini(&best);
    return e;
}
