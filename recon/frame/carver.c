/* carver.c - the first stage: photometry, silhouettes, vote, hull, restricted systems. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "recon/carve/absorb.h"
#include "recon/frame/card.h"

#define REC_DIM_SHARE   0.005F /* gives the floor 0.004 for pictures with a peak of 0.8 */
#define REC_LEAST_FLOOR 0.002F /* of full scale, half an 8-bit step; NUMERICS.md, 3 */

pvx_err rec_carver_new(const rec_sysmat *S, const struct rec_rig *rig,
                       const struct rec_frame_params *p, pvx_pool *pool, rec_carver **out,
                       struct pvx_diag *d)
{
    *out = NULL;
    if (p->nch != 1 && p->nch != 3)
        return pvx_fail(d, PVX_EINVAL, "frame: %d channels, want 1 or 3", p->nch);
    if (rig->n_cameras != S->n_cameras)
        return pvx_fail(d, PVX_EINVAL, "frame: the rig has %zu cameras, the matrix %zu",
                        rig->n_cameras, S->n_cameras);
    rec_carver *k = *out = pvx_calloc(1, sizeof *k);
    if (k == NULL)
        return pvx_fail(d, PVX_ENOMEM, "carver: out of memory");
    size_t rows = S->row0[S->n_cameras];
    k->S = S;
    k->p = *p;
    k->pool = pool;
    rec_kernels_init(&k->kernels, PVX_CPU_BEST);
    for (size_t c = 0; c < S->n_cameras; c++) {
        const struct rec_photometry *light = &rig->cameras[c].photometry;
        memcpy(k->gain[c], rig->cameras[c].gain, sizeof k->gain[c]);
        k->read_noise[c] = light->has_noise ? (float)light->read_noise : 0;
        k->noise_gain[c] = light->has_noise ? (float)light->noise_gain : 0;
    }
    k->plane = pvx_reserve(rows * 4 * sizeof *k->plane);
    bool ok = k->plane != NULL;
    for (size_t c = 0; c < S->n_cameras; c++) {
        const struct rec_sysmat_block *b = &S->block[c];
        k->photo[c] = (struct rec_photo_image){.bw = b->bw,
                                               .bh = b->bh,
                                               .nch = p->nch,
                                               .gain = k->gain[c],
                                               .params = &k->photo_params[c],
                                               .stats = &k->stats[c],
                                               .work = rec_photo_work_new(b->bw, b->bh),
                                               .plane = k->plane + S->row0[c] * 4};
        ok = ok && k->photo[c].work != NULL;
    }
    pvx_err e = ok ? rec_hull_new(S, &k->hull) : PVX_ENOMEM;
    PVX_THEN(e, rec_restrictor_new(S, &k->restrictor));
    if (e == PVX_OK && !p->trust_all)
        e = rec_vote_new(S, &k->kernels, pool, p->hold, &k->vote);
    if (e != PVX_OK) {
        rec_carver_free(out);
        return pvx_fail(d, e, "carver: work areas for %zu rays: %s", rows, pvx_strerror(e));
    }
    e = rec_card_carver(k, d);
    if (e != PVX_OK)
        rec_carver_free(out);
    return e;
}

void rec_carver_free(rec_carver **kp)
{
    rec_carver *k = *kp;
    if (k == NULL)
        return;
    size_t rows = k->S->row0[k->S->n_cameras];
    for (size_t c = 0; c < k->S->n_cameras; c++) {
        free(k->background[c]);
        free(k->photo[c].work);
    }
    pvx_unreserve(k->plane, rows * 4 * sizeof *k->plane);
    rec_vote_free(&k->vote);
    rec_hull_free(&k->hull);
    rec_restrictor_free(&k->restrictor);
    rec_card_carver_fini(k);
    PVX_FREE(*kp);
}

pvx_err rec_carver_background(rec_carver *k, size_t camera, const float *bg)
{
    if (camera >= k->S->n_cameras)
        return PVX_EINVAL;
    k->other_background |= 1ull << camera;
    if (bg == NULL) {
        PVX_FREE(k->background[camera]);
        return PVX_OK;
    }
    size_t n = (k->S->row0[camera + 1] - k->S->row0[camera]) * (k->p.nch == 3 ? 4 : 1);
    if (k->background[camera] == NULL)
        k->background[camera] = pvx_calloc(n, sizeof *bg);
    if (k->background[camera] == NULL)
        return PVX_ENOMEM;
    memcpy(k->background[camera], bg, n * sizeof *bg);
    return PVX_OK;
}

void rec_carver_exchange_background(rec_carver *k, size_t camera, float **bg)
{
    float *before = k->background[camera];
    k->other_background |= 1ull << camera;
    k->background[camera] = *bg;
    *bg = before;
}

void rec_carver_tune(rec_carver *k, const struct rec_photo_params *p)
{
    k->p.photo = *p;
}

void rec_carver_gain(rec_carver *k, size_t camera, const float gain[3])
{
    memcpy(k->gain[camera], gain, sizeof k->gain[camera]);
}

void rec_carver_absorb(rec_carver *k, double absorption)
{
    k->p.absorption = absorption;
}

/* Samples along an axis of a bin.  A colour of a Bayer filter has a quarter of all samples. */
static float per_bin(const rec_carver *k, bool bayer)
{
    return fmaxf((float)k->S->binning * (bayer ? 0.5F : 1), 1);
}

/* The least automatic threshold.  The default floor is made for 8 bits.  If the camera's read noise is known, fainter
 * light can be detected: then the threshold that auto_k gives for this noise in a bin is used, if it is lower. */
static float least_threshold(const rec_carver *k, size_t c, bool bayer)
{
    const struct rec_photo_params *p = &k->p.photo;
    float most = 0;
    if (k->read_noise[c] <= 0)
        return p->floor;
    for (int l = 0; l < k->p.nch; l++)
        most = fmaxf(most, k->gain[c][l]);
    float least = p->auto_k * k->read_noise[c] * most / per_bin(k, bayer);
    return fminf(p->floor, fmaxf(least, REC_LEAST_FLOOR));
}

/* What photometry is told of the pictures. */
static void photo_pictures(rec_frame *f)
{
    rec_carver *k = f->carver;
    size_t cameras = f->S->n_cameras;
    f->per_channel = false;
    for (size_t c = 0; c < cameras; c++) {
        f->believed[c] = f->camera[c].present;
        f->per_channel |= f->believed[c] && rec_frame_is_mosaic(f, c);
    }
    for (size_t c = 0; c < cameras; c++) {
        size_t row0 = f->S->row0[c];
        const struct rec_frame_camera *in = &f->camera[c];
        struct rec_photo_image *im = &k->photo[c];
        k->photo_params[c] = k->p.photo;
        k->photo_params[c].saturation =
            rec_photo_saturation(&k->p.photo, in->floats, in->saturated);
        k->photo_params[c].floor = least_threshold(k, c, rec_frame_is_bayer(f, c));
        k->photo_params[c].dim = in->fine || in->pictures >= 16 ? REC_DIM_SHARE : 0;
        im->absent = !in->present;
        im->img = f->b + row0 * (size_t)f->cs;
        im->cell = rec_frame_is_mosaic(f, c) ? in->cell : NULL;
        im->bayer = rec_frame_is_bayer(f, c) ? f->S->binning : 0;
        im->binning = f->S->binning;
        im->pictures = in->pictures;
        im->noise = in->noise;
        im->background = k->background[c];
        im->weight = f->weight + row0;
        im->weight4 = f->per_channel ? f->weight4 + row0 * 4 : NULL;
        im->lit = f->lit + row0;
    }
}

/* Photometry of all cameras. */
static void photo(rec_frame *f)
{
    rec_carver *k = f->carver;
    photo_pictures(f);
    if (rec_card_photo(f))
        return;
    if (f->bin.bin != NULL) {
        rec_card_bin_here(f);
        photo_pictures(f);
    }
    rec_photo_apply(k->photo, f->S->n_cameras, k->pool);
}

static void absorb_camera(void *ctx, size_t c)
{
    rec_frame *f = ctx;
    size_t row0 = f->S->row0[c];
    const struct rec_absorb_picture p = {
        .c = f->carver->p.absorption,
        .n = f->S->row0[c + 1] - row0,
        .nch = f->nch,
        .lit = f->lit + row0,
        .mean = rec_frame_is_mosaic(f, c) ? f->carver->plane + row0 * 4 : NULL,
        .b = rec_frame_input(f, c),
        .weight = f->weight + row0,
        .weight4 = f->per_channel ? f->weight4 + row0 * 4 : NULL,
        .least = f->any_least ? f->least + row0 : NULL,
    };
    if (f->believed[c])
        rec_absorb_apply(&p);
}

/* Treat a camera as absent.  Its pixels, without weight, and its silhouette stay, so that a report can say why. */
static void dismiss(rec_frame *f, size_t c)
{
    size_t row0 = f->S->row0[c], n = f->S->row0[c + 1] - row0;
    f->believed[c] = false;
    memset(f->least_of + row0, 0, f->any_least ? n : 0);
    memset(f->weight + row0, 0, n * sizeof *f->weight);
    memset(f->weight4 + row0 * 4, 0, f->per_channel ? n * 4 * sizeof *f->weight4 : 0);
}

/* Takes the vote.  Cameras that are not believed become absent, except in the report. */
static void vote(rec_frame *f)
{
    rec_carver *k = f->carver;
    struct rec_verdict *o = &f->report.vote;
    const struct rec_pictures in = rec_frame_pictures(f);
    float noise[REC_MAX_CAMERAS] = {0};
    if (k->vote == NULL)
        return;
    for (size_t c = 0; c < f->S->n_cameras; c++)
        for (int l = 0; l < f->nch && f->believed[c]; l++)
            noise[c] += k->stats[c].sigma[l] * k->stats[c].sigma[l];
    const struct rec_vote_set set = {.channels = f->nch,
                                     .in = &in,
                                     .lit = f->lit,
                                     .present = f->believed,
                                     .noise = noise,
                                     .gains = rec_frame_corrects(&k->p) && !in.per_channel};
    rec_vote_take(k->vote, k->restrictor, &set, o);
    for (size_t c = 0; c < f->S->n_cameras; c++)
        if (o->out >> c & 1)
            dismiss(f, c);
}

/* Sums over the pictures of the believed cameras. */
static void sum_up(rec_frame *f)
{
    const rec_carver *k = f->carver;
    struct rec_frame_report *r = &f->report;
    double sigma = 0;
    memset(f->sigma, 0, sizeof f->sigma);
    memset(f->shot, 0, sizeof f->shot);
    for (size_t c = 0; c < f->S->n_cameras; c++) {
        r->saturated_in[c] = k->stats[c].saturated;
        r->cut[c] = f->camera[c].present ? k->stats[c].cut : 0;
        r->pedestal[c] = f->camera[c].present ? k->stats[c].pedestal : 0;
        if (!f->believed[c])
            continue;
        r->cameras++;
        r->saturated += k->stats[c].saturated;
        r->not_finite += k->stats[c].not_finite;
        for (int l = 0; l < f->nch; l++) {
            sigma += k->stats[c].sigma[l];
            f->sigma[l] += (double)k->stats[c].sigma[l] * k->stats[c].sigma[l];
            float n = per_bin(k, rec_frame_is_bayer(f, c));
            f->shot[l] += (double)(k->noise_gain[c] * k->gain[c][l] / (n * n));
        }
    }
    double n = r->cameras > 0 ? r->cameras : 1;
    r->sigma = (float)(sigma / (n * f->nch));
    for (int l = 0; l < 4; l++) {
        f->sigma[l] = l < f->nch ? sqrt(f->sigma[l] / n) : f->sigma[0];
        f->shot[l] = l < f->nch ? f->shot[l] / n : f->shot[0];
    }
}

/* Hull and restricted systems. */
static void carve_here(rec_frame *f, const uint8_t *const *lit, struct rec_hull_kept *kept)
{
    rec_carver *k = f->carver;
    int64_t t0 = pvx_now_mono();
    rec_hull_carve(k->hull, &k->p.hull, lit, f->believed, k->pool, kept);
    int64_t t1 = pvx_now_mono();
    rec_subsys_restrict(f->sub, k->restrictor, f->col, kept->n, f->believed);
    if (f->levels != NULL) {
        struct rec_pictures in = rec_frame_pictures(f);
        rec_levels_restrict(f->levels, k->restrictor, f->sub, &in);
    }
    f->report.hull_ns = t1 - t0;
    f->report.restrict_ns = pvx_now_mono() - t1;
}

void rec_frame_carve(rec_frame *f)
{
    rec_carver *k = f->carver;
    struct rec_frame_report *r = &f->report;
    const uint8_t *lit[REC_MAX_CAMERAS];
    struct rec_hull_kept kept = {.col = f->col};
    *r = (struct rec_frame_report){0};
    int64_t t0 = pvx_now_mono();
    photo(f);
    f->any_least = false;
    if (k->p.at_least)
        rec_frame_mark_saturated(f);
    if (k->p.absorption > 0)
        pvx_pool_run(k->pool, f->S->n_cameras, absorb_camera, f);
    int64_t t1 = pvx_now_mono();
    vote(f);
    sum_up(f);
    int64_t t2 = pvx_now_mono();
    for (size_t c = 0; c < f->S->n_cameras; c++)
        lit[c] = rec_frame_lit(f, c);
    if (!rec_card_carve(f, lit, &kept))
        carve_here(f, lit, &kept);
    r->absorption = k->p.absorption;
    r->hull = kept.counts;
    r->active_voxels = kept.n;
    r->active_rays = f->sub->rows;
    r->entries = f->sub->nnz;
    r->photo_ns = t1 - t0;
    r->vote_ns = t2 - t1;
}
