#include "recon/frame/card.h"

#include <stdio.h>

#include "base/clock.h"
#include "recon/opencl/photo.h"
#include "recon/opencl/solver.h"

#define SETS  5      /* on the card at a time, about */
#define LEAST 100000 /* room for columns below which nothing is halved */

const char *rec_frame_card_why_not(const struct rec_frame_params *p)
{
    if (!rec_solver_is_default(p->solve.solver))
        return "a solver for comparison";
    if (p->solve.stop == REC_STOP_LCURVE)
        return "the stop at the corner of the L-curve";
    if (p->temporal)
        return "the expectation from the previous volume";
    if (p->at_least)
        return "saturated pixels as lower bounds";
    if (p->again)
        return "error bars";
    if (p->solve.trace != NULL)
        return "a trace of the iterates";
    return NULL;
}

/* ---- what is made once --------------------------------------------------------------------------*/

/* Room for columns: of all voxels, or of a half, a quarter of them if all sets and vectors would take more than half of
 * the device's memory.  With the coarser grids everything over voxels takes 8/7, over rows 4/3. */
static size_t card_columns(const rec_sysmat *S, int cs, uint64_t memory)
{
    double lane = 4.0 * cs, voxels = (double)rec_grid_count(&S->grid), rows = (double)S->win.room;
    double set = 8.0 / 7 * voxels * (5 + lane) + 4.0 / 3 * rows * (lane + 21);
    double vectors = 4.0 / 3 * rows * (5 * lane + 20);
    double column = 8.0 / 7 * (SETS * 28 + 13 * lane + 20);
    size_t n = rec_grid_count(&S->grid);
    while (n > LEAST && SETS * set + vectors + column * (double)n > 0.5 * (double)memory)
        n /= 2;
    return n;
}

/* Of a camera's raw picture, at most: a pixel has up to 6 bytes, and a row may end with some padding. */
static size_t card_raw_bytes(const rec_sysmat *S, size_t c)
{
    size_t side = (size_t)S->binning;
    return 6 * side * side * (size_t)(S->block[c].bw + 1) * (size_t)(S->block[c].bh + 1);
}

/* Photometry on the card, where its floats are the processors' to the bit. */
static pvx_err card_photo_new(rec_carver *k, struct pvx_diag *d)
{
    size_t cameras = k->S->n_cameras, maps[REC_MAX_CAMERAS];
    if (!rec_cl_about(k->p.card)->denormals)
        return PVX_OK;
    for (size_t c = 0; c < cameras; c++) {
        size_t bins = (size_t)k->S->block[c].bw * (size_t)k->S->block[c].bh;
        size_t side = (size_t)k->S->binning;
        k->raw0[c + 1] = k->raw0[c] + card_raw_bytes(k->S, c);
        maps[c] = rec_cl_maps_room(bins * side * side, bins, k->p.nch);
    }
    return rec_cl_photo_new(k->p.card, k->photo, cameras, k->raw0[cameras], maps, &k->there, d);
}

pvx_err rec_card_carver(rec_carver *k, struct pvx_diag *d)
{
    struct rec_cl *cl = k->p.card;
    if (cl == NULL || rec_frame_card_why_not(&k->p) != NULL)
        return PVX_OK;
    k->columns = card_columns(k->S, k->p.nch == 3 ? 4 : 1, rec_cl_about(cl)->memory);
    PVX_TRY(card_photo_new(k, d));
    return rec_cl_matrix_new(cl, k->S, &k->matrix, d);
}

pvx_err rec_card_solver(rec_solver *s, const rec_carver *k, struct pvx_diag *d)
{
    if (k->matrix == NULL || s->card != NULL)
        return PVX_OK;
    PVX_TRY(rec_restrictor_new(k->S, &s->restrictor));
    s->matrix = rec_cl_matrix_share(k->matrix);
    return rec_cl_solver_new(k->matrix, k->p.nch == 3 ? 4 : 1, k->columns, s->problem,
                             s->coarse ? &s->descent : NULL, &s->card, d);
}

pvx_err rec_card_systems(rec_systems *y, const rec_carver *k, struct pvx_diag *d)
{
    if (k->matrix == NULL)
        return PVX_OK;
    y->matrix = rec_cl_matrix_share(k->matrix);
    return rec_cl_system_new(k->matrix, k->p.nch == 3 ? 4 : 1, k->columns, &y->card, d);
}

void rec_card_carver_fini(rec_carver *k)
{
    rec_cl_photo_free(&k->there);
    if (k->matrix != NULL)
        rec_cl_matrix_free(&k->matrix);
}

void rec_card_solver_fini(rec_solver *s)
{
    if (s->card != NULL)
        rec_cl_solver_free(&s->card);
    if (s->matrix != NULL)
        rec_cl_matrix_free(&s->matrix);
    rec_restrictor_free(&s->restrictor);
}

void rec_card_systems_fini(rec_systems *y)
{
    if (y->card != NULL)
        rec_cl_system_free(&y->card);
    if (y->matrix != NULL)
        rec_cl_matrix_free(&y->matrix);
}

/* ---- a frame set --------------------------------------------------------------------------------*/

/* Reports why the set is solved here. */
static void card_say(rec_frame *f, const char *why)
{
    struct rec_frame_report *r = &f->report;
    snprintf(r->why_here, sizeof r->why_here, "%s", why != NULL ? why : "its carver has no card");
}

struct card_copy {
    rec_frame *f;
    const struct rec_cl_raw *raw;
};
static void card_copy(void *ctx, size_t c)
{
    const struct card_copy *j = ctx;
    struct rec_cl_raw *to = &j->f->raw[c];
    *to = j->raw[c];
    to->data = j->f->bytes + j->f->carver->raw0[c];
    if (to->layout != REC_CL_LAYOUT_NONE)
        memcpy(j->f->bytes + j->f->carver->raw0[c], j->raw[c].data, to->bytes);
}

bool rec_frame_raw(rec_frame *f, const struct rec_cl_raw *raw, const struct rec_frame_binner *bin)
{
    const rec_carver *k = f->carver;
    size_t cameras = f->S->n_cameras;
    f->bin.bin = NULL;
    if (f->bytes == NULL || rec_cl_lost(k->p.card) != NULL)
        return false;
    for (size_t c = 0; c < cameras; c++)
        if (raw[c].layout != REC_CL_LAYOUT_NONE && raw[c].bytes > k->raw0[c + 1] - k->raw0[c])
            return false;
    pvx_pool_run(k->pool, cameras, card_copy, &(struct card_copy){f, raw});
    f->bin = *bin;
    return true;
}

void rec_card_bin_here(rec_frame *f)
{
    const struct rec_frame_binner bin = f->bin;
    float *out[REC_MAX_CAMERAS];
    if (bin.bin == NULL)
        return;
    f->bin.bin = NULL;
    for (size_t c = 0; c < f->S->n_cameras; c++)
        out[c] = f->b + f->S->row0[c] * (size_t)f->cs;
    bool done = bin.bin(bin.ctx, bin.number, f->raw, out);
    for (size_t c = 0; !done && c < f->S->n_cameras; c++)
        f->camera[c].present = false;
}

/* Whether all pictures of the set are raw, and the card can judge them. */
static bool card_can_judge(const rec_frame *f)
{
    const rec_carver *k = f->carver;
    bool can = f->bin.bin != NULL && f->systems->card != NULL && !(k->p.absorption > 0);
    for (size_t c = 0; c < f->S->n_cameras; c++)
        can = can && f->camera[c].present == (f->raw[c].layout != REC_CL_LAYOUT_NONE);
    return can;
}

bool rec_card_photo(rec_frame *f)
{
    rec_carver *k = f->carver;
    struct rec_cl_pictures to;
    if (!card_can_judge(f))
        return false;
    rec_cl_queue *q = f->systems->card->queue;
    rec_cl_system_pictures(f->systems->card, f->per_channel, &to);
    to.here.b = f->b;
    to.here.w = f->weight;
    to.here.w4 = f->per_channel ? f->weight4 : NULL;
    to.here.lit = f->lit;
    for (size_t c = 0; c < f->S->n_cameras; c++)
        if (k->other_background >> c & 1)
            rec_cl_photo_background(k->there, q, c, k->background[c]);
    k->other_background = 0;
    rec_cl_photo_send(k->there, q, k->photo);
    bool done = rec_cl_photo_unpack(k->there, q, f->raw, &to) &&
                rec_cl_photo_apply(k->there, q, k->photo, &to, k->pool);
    if (done)
        f->bin.bin = NULL;
    f->report.raw_on_card = done;
    return done;
}

bool rec_card_carve(rec_frame *f, const uint8_t *const *lit, struct rec_hull_kept *kept)
{
    rec_carver *k = f->carver;
    struct rec_frame_report *r = &f->report;
    struct rec_pictures in = rec_frame_pictures(f);
    const struct rec_cl_carving c = {&k->p.hull, lit,       f->believed,
                                     &in,        f->weight, f->report.raw_on_card};
    bool too_many = false;
    if (k->p.card == NULL)
        return false;
    if (f->systems->card == NULL || f->solver->card == NULL) {
        card_say(f, rec_frame_card_why_not(&k->p));
        return false;
    }
    int64_t t0 = pvx_now_mono();
    bool done = rec_cl_carve(f->systems->card, &c, kept, f->sub, &too_many);
    int64_t t1 = pvx_now_mono();
    if (done && f->levels != NULL)
        rec_levels_restrict(f->levels, k->restrictor, f->sub, &in);
    r->hull_ns = t1 - t0;
    r->restrict_ns = pvx_now_mono() - t1;
    if (too_many)
        snprintf(r->why_here, sizeof r->why_here,
                 "more active voxels than the card has room for (%zu)", k->columns);
    else if (rec_cl_lost(k->p.card) != NULL)
        card_say(f, rec_cl_lost(k->p.card));
    return done && r->why_here[0] == '\0';
}

float *rec_card_begin(rec_frame *f, const struct rec_solve_params *p,
                      const struct rec_sparse *previous)
{
    struct rec_cl_solver *s = f->solver->card;
    const struct rec_frame_params now = {.solve = *p}; /* as rec_solver_tune has them */
    const char *why_not = rec_frame_card_why_not(&now);
    if (why_not != NULL) {
        card_say(f, why_not);
        return NULL;
    }
    rec_cl_solver_begin(s, f->systems->card);
    if (previous != NULL)
        rec_cl_solver_earlier(s, previous->n, previous->index, previous->value);
    return rec_cl_solver_x(s);
}

bool rec_card_end(rec_frame *f, pvx_err e)
{
    f->report.on_card = rec_cl_solver_end(f->solver->card, f->x) && e == PVX_OK;
    if (!f->report.on_card) {
        const char *lost = rec_cl_lost(f->carver->p.card);
        card_say(f, lost != NULL ? lost : pvx_strerror(e));
    }
    return f->report.on_card;
}

void rec_card_leave(rec_frame *f)
{
    struct rec_pictures in = rec_frame_pictures(f);
    struct rec_restrictor *r = f->solver->restrictor;
    rec_subsys_restrict(f->sub, r, f->col, (int32_t)f->report.active_voxels, f->believed);
    if (f->levels != NULL)
        rec_levels_restrict(f->levels, r, f->sub, &in);
}
