/* kept.c - the problem of a frame that will be solved again (inside.h). */
#include <string.h>

#include "base/mem.h"
#include "recon/frame/impl.h"
#include "recon/solve/impl.h"

pvx_err rec_kept_new(const rec_sysmat *S, int nch, rec_kept **out)
{
    rec_kept *k = *out = pvx_calloc(1, sizeof *k);
    PVX_NEED(k);
    k->bytes = rec_grid_count(&S->grid) * (nch == 3 ? 4 : 1) * sizeof *k->expect;
    k->expect = pvx_reserve(k->bytes);
    pvx_err e = k->expect != NULL ? rec_problem_new(S, nch, &k->problem) : PVX_ENOMEM;
    if (e != PVX_OK)
        rec_kept_free(out);
    return e;
}

void rec_kept_free(rec_kept **k)
{
    if (*k == NULL)
        return;
    rec_problem_free(&(*k)->problem);
    if ((*k)->expect != NULL)
        pvx_unreserve((*k)->expect, (*k)->bytes);
    PVX_FREE(*k);
}

void rec_frame_keep(rec_frame *f, rec_kept *k, pvx_pool *pool)
{
    rec_solver *s = f->solver;
    rec_problem *solved = s->problem;
    s->problem = k->problem;
    k->problem = solved;
    rec_selfcal_attach(s->problem, s->selfcal);
    rec_selfcal_attach(solved, NULL); /* the pictures are corrected already */
    if (solved->expect != NULL) {     /* the next solve predicts into the same memory */
        memcpy(k->expect, solved->expect, (size_t)f->sub->n * (size_t)f->cs * sizeof *k->expect);
        solved->expect = k->expect;
    }
    f->sub->pool = pool;
    f->kept = k;
}

rec_kept *rec_frame_release(rec_frame *f)
{
    rec_kept *k = f->kept;
    if (k != NULL)
        f->sub->pool = f->carver->pool;
    f->kept = NULL;
    return k;
}
