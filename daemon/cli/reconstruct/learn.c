#include "daemon/cli/reconstruct/learn.h"

#include <stdio.h>

#include "daemon/cli/common/cli.h"
#include "recon/frame/inside.h"

size_t reconstruct_learn_sets(const struct rec_frame_params *p, size_t cameras, size_t n)
{
    size_t some = n / 10;
    if (!rec_frame_corrects(p) || cameras < REC_SELFCAL_LEAST)
        return 0;
    some = some < RECONSTRUCT_LEARN_LEAST ? RECONSTRUCT_LEARN_LEAST : some;
    some = some > RECONSTRUCT_LEARN_MOST ? RECONSTRUCT_LEARN_MOST : some;
    return n < some ? 0 : some;
}

/* A frame's carver and solver, and what they share. */
struct learner {
    const struct reconstruct_learn *l;
    rec_carver *carver;
    rec_solver *solver;
    rec_frame *frame;
    rec_average *average;
    struct cli_progress bar;
    size_t sets, done;
};

static pvx_err learn_round(struct learner *t)
{
    rec_average_learn(t->average);
    for (size_t k = 0; k < t->sets; k++) {
        rec_frame_reset(t->frame);
        (void)frames_in_load_frame(t->l->in, (2 * k + 1) * t->l->in->n / (2 * t->sets), t->frame);
        rec_frame_carve(t->frame);
        PVX_TRY(rec_frame_solve(t->frame, 0, NULL));
        if (!cli_progress(&t->bar,
                          (double)++t->done / (double)(RECONSTRUCT_LEARN_ROUNDS * t->sets)))
            return PVX_ECANCELED;
    }
    return PVX_OK;
}

static pvx_err learn_rounds(struct learner *t)
{
    struct rec_selfcal_report r = {.gain = true};
    for (int i = 0; i < RECONSTRUCT_LEARN_ROUNDS && (r.gain || r.shift); i++) {
        PVX_TRY(learn_round(t));
        rec_average_tell(t->average, &r);
    }
    if (t->done < RECONSTRUCT_LEARN_ROUNDS * t->sets)
        (void)cli_progress(&t->bar, 1);
    rec_average_fix(t->average);
    return PVX_OK;
}

static void learn_say(const struct rec_selfcal_report *r, const struct rec_rig *rig)
{
    if (!r->gain && !r->shift) {
        fprintf(stderr, "cameras: %u sets agree with the rig, nothing is corrected\n", r->sets);
        return;
    }
    fprintf(stderr, "cameras: corrected by %s, the mean of %u sets\n",
            r->gain && r->shift ? "gain and aim"
            : r->gain           ? "gain"
                                : "aim",
            r->sets);
    for (uint32_t c = 0; c < r->cameras; c++) {
        const struct rec_selfcal_camera *k = &r->camera[c];
        fprintf(stderr, "  %-14s", rig->cameras[c].name);
        if (!k->known)
            fputs(" not known", stderr);
        if (k->known && r->gain)
            fprintf(stderr, " gain %.3f +- %.3f", (double)k->gain, (double)k->gain_error);
        if (k->known && r->shift)
            fprintf(stderr, "%s flame %+.2f +- %.2f px to the right, %+.2f +- %.2f px down",
                    r->gain ? "," : "", (double)k->shift[0], (double)k->shift_error[0],
                    (double)k->shift[1], (double)k->shift_error[1]);
        fputc('\n', stderr);
    }
}

static pvx_err learn_all(const struct reconstruct_learn *l, rec_average **out, struct pvx_diag *d)
{
    struct rec_selfcal_report r = {0};
    struct learner t = {.l = l,
                        .sets = reconstruct_learn_sets(l->params, l->rig->n_cameras, l->in->n),
                        .bar = {.label = "cameras", .quiet = l->quiet}};
    *out = NULL;
    if (t.sets == 0 || l->S->coarse == NULL)
        return PVX_OK;
    pvx_err e = rec_carver_new(l->S, l->rig, l->params, l->pool, &t.carver, d);
    for (size_t c = 0; e == PVX_OK && l->background != NULL && c < l->rig->n_cameras; c++)
        e = rec_carver_background(t.carver, c, l->background[c]);
    PVX_THEN(e, rec_solver_new(l->S, l->params, &t.solver, d));
    PVX_THEN(e, rec_frame_new(t.carver, t.solver, &t.frame, d));
    PVX_THEN(e, rec_average_new(l->rig->n_cameras, l->S->binning, 1, RECONSTRUCT_LEARN_MOST + 1,
                                &t.average));
    if (e == PVX_OK) {
        rec_solver_average(t.solver, t.average);
        e = learn_rounds(&t);
    }
    if (e == PVX_OK)
        rec_average_tell(t.average, &r);
    if (e == PVX_OK && r.sets > 0 && !l->quiet)
        learn_say(&r, l->rig);
    rec_frame_free(&t.frame);
    rec_solver_free(&t.solver);
    rec_carver_free(&t.carver);
    if (r.sets > 0)
        *out = t.average;
    else
        rec_average_free(&t.average);
    return e;
}

pvx_err reconstruct_learn(const struct reconstruct_learn *l, rec_average **out, struct pvx_diag *d)
{
    struct reconstruct_learn again = *l;
    struct rec_frame_params here = *l->params;
    pvx_err e = learn_all(l, out, d);
    if (e == PVX_OK || e == PVX_ECANCELED || here.card == NULL)
        return e;
    here.card = NULL; /* it fails; the pipeline says so */
    again.params = &here;
    return learn_all(&again, out, d);
}
