#include "recon/calib/calib.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "base/module.h"
#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

/* ---- out ------------------------------------------------------------------------------------------ */

static void report_views(struct calib *k)
{
    double single = 0, joint = 0, n = 0, sn[REC_MAX_CAMERAS] = {0};
    for (size_t i = 0; i < k->nv; i++) {
        const struct view *v = &k->view[i];
        struct rec_calib_view *o = &k->out->view[v->in];
        struct rec_calib_of_camera *c = &k->out->camera[v->camera];
        o->fate = v->fate;
        o->single = v->single;
        if (v->fate != REC_VIEW_USED && v->fate != REC_VIEW_JOINT)
            continue;
        for (size_t s = 0; s < v->n; s++)
            o->wrong += k->seen[v->first + s].wrong;
        if (!k->placed[v->frame] || !k->joined[v->camera])
            continue;
        o->joint = rec_calib_rms(k, v);
        if ((o->residual = pvx_calloc(2 * v->n, sizeof *o->residual)) != NULL)
            for (size_t s = 0; s < v->n; s++)
                for (int a = 0; a < 2; a++)
                    o->residual[2 * s + (size_t)a] = (float)k->seen[v->first + s].r[a];
        if (v->fate != REC_VIEW_USED)
            continue;
        double corners = (double)(v->n - o->wrong);
        c->used++;
        c->single += v->single * v->single * corners;
        c->joint += o->joint * o->joint * corners;
        sn[v->camera] += corners;
    }
    for (size_t c = 0; c < k->nc; c++) {
        struct rec_calib_of_camera *o = &k->out->camera[c];
        single += o->single;
        joint += o->joint;
        n += sn[c];
        o->single = sqrt(o->single / fmax(sn[c], 1));
        o->joint = sqrt(o->joint / fmax(sn[c], 1));
    }
    k->out->single = sqrt(single / fmax(n, 1));
    k->out->joint = sqrt(joint / fmax(n, 1));
}

static void report_boards(struct calib *k)
{
    double scale = 0;
    for (size_t f = 0; f < k->nf; f++) {
        for (int i = 0; i < 12; i++)
            k->out->board[f][i] = NAN;
        if (k->placed[f]) {
            rec_rotation(k->board[f], k->out->board[f]);
            memcpy(k->out->board[f] + 9, k->board[f] + 3, 3 * sizeof(double));
        }
    }
    memcpy(k->out->warp, k->shape, sizeof k->out->warp);
    k->out->thickness = k->shape[3];
    for (size_t c = 0; c < k->nc; c++)
        scale += k->scale[c] * k->scale[c] / (double)k->nc;
    k->out->chi2 = k->chi2 * scale;
}

/* Everything after the solve: findings, world, uncertainty, folds. */
static pvx_err calib_finish(struct calib *k, double *cov, struct rec_rig *rig)
{
    struct rec_uncertainty of[REC_MAX_CAMERAS];
    report_views(k);
    PVX_TRY(rec_calib_beyond(k));
    PVX_TRY(rec_calib_suspect(k));
    PVX_TRY(rec_calib_place(k));
    PVX_TRY(rec_calib_rig(k, rig));
    PVX_TRY(rec_calib_expect(k, rig, cov, of));
    for (size_t c = 0; c < k->nc; c++) {
        if (rec_calib_stays(k, c)) /* the data did not change it */
            of[c] =
                k->in->options.old->cameras[rec_rig_find(k->in->options.old, k->in->camera[c].name)]
                    .uncertainty;
        k->out->camera[c].expected = rig->cameras[c].uncertainty = of[c];
    }
    report_boards(k);
    if (!k->in->options.brief)
        PVX_TRY(rec_calib_folds(k, rig));
    rec_calib_verdicts(k);
    return PVX_OK;
}

pvx_err rec_calib_solve(const struct rec_calib_input *in, struct rec_rig *rig,
                        struct rec_calib_report *out, struct pvx_diag *d)
{
    static struct pvx_module module = {
        .file = "pyrovox-calib.so", .entry = "rec_calib_module", .version = REC_CALIB_VERSION};
    struct calib k = {.in = in, .out = out, .d = d};
    double *cov = NULL;
    *rig = (struct rec_rig){0};
    *out = (struct rec_calib_report){0};
    k.lib = pvx_module(&module);
    if (k.lib == NULL)
        return pvx_fail(d, PVX_EUNSUP, "the calibration module cannot be loaded: %.500s",
                        module.why);
    pvx_err e = rec_calib_take(&k);
    if (e == PVX_OK)
        e = rec_calib_start(&k);
    if (e == PVX_OK)
        e = rec_calib_join(&k);
    if (e == PVX_OK) {
        size_t N = k.nc * (REC_LENS + 6);
        cov = pvx_calloc(N * N, sizeof *cov);
        e = cov != NULL ? rec_calib_together(&k, cov) : PVX_ENOMEM;
    }
    if (e == PVX_OK)
        e = calib_finish(&k, cov, rig);
    if (e != PVX_OK) {
        rec_rig_fini(rig);
        if (out->view != NULL && k.view != NULL)
            for (size_t i = 0; i < k.nv; i++)
                out->view[k.view[i].in].fate = k.view[i].fate;
    }
    free(cov);
    free(k.view);
    free(k.seen);
    free(k.of_frame);
    free(k.placed);
    free(k.state);
    return e;
}

void rec_calib_report_fini(struct rec_calib_report *r)
{
    for (size_t i = 0; i < r->n_views && r->view != NULL; i++)
        free(r->view[i].residual);
    free(r->camera);
    free(r->view);
    free(r->pair);
    free(r->finding);
    free(r->frame);
    free(r->board);
    *r = (struct rec_calib_report){0};
}
