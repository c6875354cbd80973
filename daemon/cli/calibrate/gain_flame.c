#include "daemon/cli/calibrate/gain.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "daemon/cli/calibrate/report.h"
#include "daemon/cli/common/flame_sets.h"
#include "daemon/control/json.h"

/* ---- integrated emission ---- */

/* Middle of the flame in group g, from the cameras that see all of it, or from all cameras if fewer than two do. */
static pvx_err gain_flame_middle(const struct calibrate_light *l, const struct calibrate_gain *q,
                                 size_t g, double at[3], struct pvx_diag *d)
{
    const struct rec_light_picture *p[REC_MAX_CAMERAS];
    struct rec_camera cam[REC_MAX_CAMERAS];
    size_t n = 0;
    for (int cut = 0; cut < 2 && n < 2; cut++) {
        n = 0;
        for (size_t c = 0; c < l->rig.n_cameras; c++)
            if (calibrate_light_stack(l, g, c)->picture.n > 0 &&
                (cut || q->cut[c].text[0] == '\0')) {
                p[n] = &calibrate_light_stack(l, g, c)->picture;
                cam[n++] = l->rig.cameras[c];
            }
    }
    return rec_light_where(p, cam, n, at, d);
}

/* Add the light of all cameras in group g, for a flame at `at`.  q->cut notes cameras that see only a part of it. */
static pvx_err add_light(const struct calibrate_light *l, struct calibrate_gain *q, size_t g,
                         const double at[3], struct pvx_diag *d)
{
    for (size_t c = 0; c < l->rig.n_cameras; c++) {
        const struct rec_light_picture *p = &calibrate_light_stack(l, g, c)->picture;
        const struct rec_camera *k = &l->rig.cameras[c];
        struct pvx_diag why = {""};
        double v[3];
        if (p->n == 0)
            continue;
        pvx_err e = rec_light_flux(p, k, at, v, &why);
        if (e == PVX_ERANGE)
            q->cut[c] = why;
        else if (e != PVX_OK)
            return calibrate_light_fail(k, e, &why, d);
        for (int a = 0; a < 3 && e == PVX_OK; a++)
            q->light[a][c] += v[a];
    }
    return PVX_OK;
}

static pvx_err gain_flame_integrate(const struct calibrate_light *l, struct calibrate_gain *q,
                                    struct pvx_diag *d)
{
    size_t n = l->rig.n_cameras;
    for (int pass = 0; pass < 2;
         pass++) { /* the first finds the cameras that see all of the flame */
        memset(q->light, 0, sizeof q->light);
        for (size_t g = 0; g < l->a->n; g++) {
            double at[3];
            PVX_TRY(gain_flame_middle(l, q, g, at, d));
            PVX_TRY(add_light(l, q, g, at, d));
        }
    }
    for (int a = 0; a < 3; a++) {
        for (size_t c = 0; c < n; c++)
            if (q->cut[c].text[0] != '\0')
                q->light[a][c] = 0;
        rec_light_gains(q->light[a], n, q->integrated[a]);
    }
    return PVX_OK;
}

/* ---- alternately with the reconstruction ---- */

/* All recordings, one after the other. */
struct reel {
    struct flame_sets sets[CALIBRATE_GROUPS];
    struct flame_sets_args args[CALIBRATE_GROUPS];
    struct rec_check_source from[CALIBRATE_GROUPS];
    size_t n;
};

static pvx_err gain_flame_get(void *ctx, size_t i, struct rec_check_set *out)
{
    struct reel *r = ctx;
    size_t g = 0;
    for (; i >= r->from[g].n; g++)
        i -= r->from[g].n;
    return r->from[g].get(r->from[g].ctx, i, out);
}

static bool gain_flame_progress(void *ctx, double done)
{
    struct reel *r = ctx;
    return r->from[0].progress(r->from[0].ctx, done);
}

static pvx_err gain_flame_load(const struct calibrate_light *l, const struct calibrate_gain *q,
                               struct reel *r, struct rec_check_source *out, struct pvx_diag *d)
{
    *out =
        (struct rec_check_source){.get = gain_flame_get, .progress = gain_flame_progress, .ctx = r};
    for (; r->n < l->a->n; out->n += r->from[r->n++].n) {
        struct flame_sets_args *a = &r->args[r->n];
        struct flame_sets *s = &r->sets[r->n];
        *a = (struct flame_sets_args){.frames = l->a->frames[r->n],
                                      .last = FRAMES_IN_LAST,
                                      .sets = q->sets / (int64_t)l->a->n,
                                      .threads = l->a->threads,
                                      .reading = l->a->reading,
                                      .quiet = q->quiet};
        a->sets = a->sets > 0 ? a->sets : 1;
        *s = (struct flame_sets){.a = a, .light = l->light, .kinds = FRAMES_IN_SAME};
        pvx_err e = rec_rig_copy(&l->as, &s->rig);
        PVX_THEN(e, flame_sets_read(s, d));
        if (e != PVX_OK) {
            flame_sets_fini(s);
            return e;
        }
        r->from[r->n] = flame_sets_source(s, "gains");
    }
    return PVX_OK;
}

/* Solve each colour, starting from its integrated gains.  Grey pictures have the same gains for all colours. */
static pvx_err alternate(const struct calibrate_light *l, struct calibrate_gain *q,
                         struct pvx_diag *d)
{
    static struct reel r; /* this program runs one step */
    struct rec_check_source from;
    pvx_err e = gain_flame_load(l, q, &r, &from, d);
    q->nch = e == PVX_OK ? r.sets[0].nch : 1;
    memcpy(q->gain, q->integrated, sizeof q->gain);
    for (int a = 0; a < q->nch && e == PVX_OK; a++) {
        for (size_t i = 0; i < r.n; i++)
            r.sets[i].channel = a;
        e = rec_gains(&l->as, &r.sets[0].params, r.sets[0].pool, &from, q->gain[a], &q->rounds[a],
                      &q->why[a]);
        if (e == PVX_EINVAL) /* not solvable: the integrated gains stay */
            e = PVX_OK;
        else if (e != PVX_OK && d != NULL)
            *d = q->why[a];
        else if (!q->rounds[a].accepted)
            pvx_fail(&q->why[a], PVX_EINVAL,
                     "the %zu sets that were held out do not get better (error of unseen views "
                     "%.4f, then %.4f)",
                     q->rounds[a].held_out, q->rounds[a].error[0], q->rounds[a].error[1]);
    }
    for (int a = q->nch; a < 3 && e == PVX_OK; a++)
        memcpy(q->gain[a], q->gain[0], sizeof q->gain[a]);
    for (size_t i = 0; i < r.n; i++)
        flame_sets_fini(&r.sets[i]);
    return e;
}

/* ---- messages ---- */

static void gain_flame_fill(struct dmn_json *j, const void *what)
{
    const struct calibrate_light *l = ((const void *const *)what)[0];
    const struct calibrate_gain *q = ((const void *const *)what)[1];
    dmn_json_open(j, NULL, '{');
    dmn_json_int(j, "version", 1);
    dmn_json_str(j, "rig", l->a->rig);
    dmn_json_open(j, "frames", '[');
    for (size_t g = 0; g < l->a->n; g++)
        dmn_json_str(j, NULL, l->a->frames[g]);
    dmn_json_close(j, ']');
    dmn_json_open(j, "cameras", '[');
    for (size_t c = 0; c < l->rig.n_cameras; c++) {
        bool whole = q->cut[c].text[0] == '\0' && q->light[1][c] > 0;
        dmn_json_open(j, NULL, '{');
        dmn_json_str(j, "name", l->rig.cameras[c].name);
        dmn_json_str(j, "cut_off", q->cut[c].text);
        dmn_json_open(j, "integrated", '[');
        for (int a = 0; a < 3; a++)
            dmn_json_num(j, NULL, whole ? q->integrated[a][c] : (double)NAN);
        dmn_json_close(j, ']');
        dmn_json_open(j, "gain", '[');
        for (int a = 0; a < 3; a++)
            dmn_json_num(j, NULL, q->gain[a][c]);
        dmn_json_close(j, ']');
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
    dmn_json_open(j, "colours", '[');
    for (int a = 0; a < q->nch; a++) {
        const struct rec_gains_report *o = &q->rounds[a];
        dmn_json_open(j, NULL, '{');
        dmn_json_bool(j, "accepted", o->accepted);
        dmn_json_str(j, "why_not", q->why[a].text);
        dmn_json_int(j, "fitted_sets", (long long)o->fitted);
        dmn_json_int(j, "held_out_sets", (long long)o->held_out);
        dmn_json_num(j, "unseen_before", o->rounds > 0 ? o->error[0] : (double)NAN);
        dmn_json_num(j, "unseen_after", o->rounds > 0 ? o->error[1] : (double)NAN);
        dmn_json_open(j, "changed", '[');
        for (uint32_t i = 0; i < o->rounds; i++)
            dmn_json_num(j, NULL, o->changed[i]);
        dmn_json_close(j, ']');
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}

static void gain_flame_say(const struct calibrate_light *l, const struct calibrate_gain *q)
{
    static const char *const colour[] = {"red", "green", "blue"};
    for (size_t c = 0; c < l->rig.n_cameras; c++)
        if (q->cut[c].text[0] != '\0')
            printf("%-12s %s; by the volumes of the others only\n", l->rig.cameras[c].name,
                   q->cut[c].text);
    for (int a = 0; a < q->nch; a++) {
        const struct rec_gains_report *o = &q->rounds[a];
        const char *of = q->nch == 3 ? colour[a] : "all colours";
        if (q->why[a].text[0] != '\0')
            printf("%-12s integrated emission alone: %s\n", of, q->why[a].text);
        else
            printf("%-12s %u rounds by %zu frame sets; %zu judge: error of unseen views %.4f -> "
                   "%.4f\n",
                   of, o->rounds, o->fitted, o->held_out, o->error[0], o->error[1]);
    }
}

pvx_err calibrate_gain_flame(struct calibrate_light *l, struct calibrate_gain *q,
                             struct pvx_diag *d)
{
    if (q->report != NULL)
        PVX_TRY(calibrate_report_possible(q->report, false, d));
    PVX_TRY(gain_flame_integrate(l, q, d));
    PVX_TRY(alternate(l, q, d));
    for (size_t c = 0; c < l->rig.n_cameras; c++)
        for (int a = 0; a < q->nch && q->cut[c].text[0] != '\0'; a++)
            if (q->why[a].text[0] != '\0')
                return pvx_fail(d, PVX_EINVAL,
                                "camera %s: %s; nor do the volumes of the others tell: %s",
                                l->rig.cameras[c].name, q->cut[c].text, q->why[a].text);
    for (size_t c = 0; c < l->rig.n_cameras; c++)
        for (int a = 0; a < 3; a++)
            l->rig.cameras[c].gain[a] = (float)q->gain[a][c];
    gain_flame_say(l, q);
    const void *what[2] = {l, q};
    return q->report != NULL ? calibrate_write_report(q->report, gain_flame_fill, NULL, what, d)
                             : PVX_OK;
}
