#include "recon/opencl/photo.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/carve/photo_limits.h"
#include "recon/opencl/photo_impl.h"

/* ---- what is made once ---- */

static pvx_err photo_buffers(rec_cl_photo *p, size_t raw_bytes, struct pvx_diag *d)
{
    size_t lanes = p->rows * p->cs * sizeof(float);
    const struct {
        struct rec_cl_buffer *b;
        size_t bytes;
    } all[] = {
        {&p->shot, p->cameras * sizeof *p->shots},
        {&p->limits, p->cameras * sizeof *p->limit},
        {&p->band, p->bands * sizeof *p->sums},
        {&p->at, p->bands * 2 * sizeof(int32_t)},
        {&p->block, p->cameras * REC_PHOTO_BLOCKS * sizeof *p->blocks},
        {&p->back, lanes},
        {&p->plane, p->cs == 4 ? lanes : sizeof(float)},
        {&p->raw, p->rows},
        {&p->clean, p->rows},
        {&p->inverse, REC_CLIPPED_KNOTS * sizeof(float)},
        {&p->noisy, p->cameras * sizeof(int32_t)},
        {&p->raw_picture, p->cameras * sizeof *p->raws},
        {&p->bytes, raw_bytes},
        {&p->maps, p->maps0[p->cameras] * sizeof(uint32_t)},
    };
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        PVX_TRY(rec_cl_buffer_new(p->cl, all[i].bytes, all[i].b, d));
    return PVX_OK;
}

/* The bands' places and the table of h^-1. */
static pvx_err photo_tables(rec_cl_photo *p, struct pvx_diag *d)
{
    float inverse[REC_CLIPPED_KNOTS];
    int32_t(*at)[2] = malloc(p->bands * sizeof *at);
    rec_cl_queue *q = NULL;
    PVX_NEED(at);
    for (size_t b = 0; b < p->bands; b++) {
        int32_t band;
        at[b][0] = (int32_t)rec_bands_find(&p->of, b, &band);
        at[b][1] = band * REC_BAND_ROWS;
    }
    rec_clipped_table(inverse);
    pvx_err e = rec_cl_queue_new(p->cl, &q, d);
    if (e == PVX_OK) {
        rec_cl_upload(q, &p->at, 0, at, p->bands * sizeof *at);
        rec_cl_upload(q, &p->inverse, 0, inverse, sizeof inverse);
        if (!rec_cl_wait(q))
            e = pvx_fail(d, PVX_ENODEV, "%s", rec_cl_lost(p->cl));
    }
    rec_cl_queue_free(&q);
    free(at);
    return e;
}

pvx_err rec_cl_photo_new(rec_cl *cl, const struct rec_photo_image *im, size_t n, size_t raw_bytes,
                         const size_t *maps, rec_cl_photo **out, struct pvx_diag *d)
{
    struct rec_bands of = {0};
    size_t rows = 0;
    *out = NULL;
    for (size_t c = 0; c < n; c++)
        rec_bands_add(&of, im[c].bh);
    size_t bands = rec_bands_all(&of);
    rec_cl_photo *p = pvx_calloc(1, sizeof *p + bands * sizeof *p->sums);
    PVX_NEED(p);
    p->cl = cl;
    p->cameras = n;
    p->bands = bands;
    p->cs = im[0].nch == 3 ? 4 : 1;
    p->of = of;
    for (size_t c = 0; c < n; c++) {
        p->row0[c] = rows;
        p->maps0[c + 1] = p->maps0[c] + (maps != NULL ? maps[c] / sizeof(uint32_t) : 0);
        rows += (size_t)im[c].bw * (size_t)im[c].bh;
    }
    p->row0[n] = p->rows = rows;
    p->blocks = pvx_calloc(n * REC_PHOTO_BLOCKS, sizeof *p->blocks);
    pvx_err e = p->blocks == NULL ? PVX_ENOMEM : photo_buffers(p, raw_bytes, d);
    PVX_THEN(e, photo_tables(p, d));
    *out = p;
    if (e != PVX_OK)
        rec_cl_photo_free(out);
    return e;
}

void rec_cl_photo_free(rec_cl_photo **pp)
{
    rec_cl_photo *p = *pp;
    if (p == NULL)
        return;
    struct rec_cl_buffer *all[] = {&p->shot,  &p->limits,      &p->band,  &p->at,    &p->block,
                                   &p->back,  &p->plane,       &p->raw,   &p->clean, &p->inverse,
                                   &p->noisy, &p->raw_picture, &p->bytes, &p->maps};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        rec_cl_buffer_free(p->cl, all[i]);
    free(p->blocks);
    PVX_FREE(*pp);
}

void rec_cl_photo_background(rec_cl_photo *p, rec_cl_queue *q, size_t c, const float *bg)
{
    size_t lane = p->cs * sizeof *bg;
    p->background[c] = bg != NULL;
    if (bg == NULL)
        return;
    rec_cl_upload(q, &p->back, p->row0[c] * lane, bg, (p->row0[c + 1] - p->row0[c]) * lane);
    (void)rec_cl_wait(q);
}

/* ---- one set ---- */

static struct rec_cl_picture photo_shot(const rec_cl_photo *p, const struct rec_photo_image *im,
                                        size_t c)
{
    const struct rec_photo_params *how = im->params;
    const struct rec_photo_blocks all = rec_photo_blocks(im);
    struct rec_cl_picture s = {.row0 = (int)p->row0[c],
                               .bw = im->bw,
                               .bh = im->bh,
                               .band0 = (int)p->of.first[c],
                               .bands = (int)(p->of.first[c + 1] - p->of.first[c]),
                               .absent = im->absent,
                               .mosaic = im->cell != NULL,
                               .background = p->background[c],
                               .step = im->work->grain.step,
                               .across = all.across,
                               .every = all.every,
                               .blocks = (all.all + all.every - 1) / all.every,
                               .full = how->saturation < 0 ? REC_PHOTO_FULL : how->saturation,
                               .black = how->black};
    for (int k = 0; k < 4 && im->cell != NULL; k++)
        s.cell[k] = im->cell[k];
    for (int l = 0; l < im->nch; l++) {
        s.scale[l] = im->gain[l];
        s.level[l] = rec_clipped_level(im, l);
    }
    return s;
}

/* The parts of the sums that came down, where photo.c has them. */
static void photo_take(const rec_cl_photo *p, const struct rec_photo_image *im, size_t c,
                       float above[3])
{
    struct rec_photo_work *w = im->work;
    const struct rec_cl_picture_block *block = p->blocks + c * REC_PHOTO_BLOCKS;
    for (int l = 0; l < 3; l++)
        above[l] = INFINITY;
    for (size_t b = 0; b < rec_band_count(im->bh); b++) {
        const struct rec_cl_picture_band *s = &p->sums[p->of.first[c] + b];
        w->band[b] = (struct rec_photo_band){.saturated = (uint32_t)s->saturated,
                                             .not_finite = (uint32_t)s->not_finite,
                                             .peak = im->params->dim > 0 ? s->peak : 0};
        memcpy(&w->band[b].low, s->low, sizeof w->band[b].low);
        for (int l = 0; l < 3 && l < im->nch; l++)
            above[l] = fminf(above[l], s->above[l]);
    }
    for (int32_t m = 0; m < p->shots[c].blocks; m++) {
        struct rec_photo_block *to = &w->block[m];
        memcpy(&to->mean, block[m].mean, sizeof to->mean);
        memcpy(&to->noise2, block[m].noise2, sizeof to->noise2);
        memcpy(&to->low, block[m].low, sizeof to->low);
        memcpy(&to->at_low, block[m].at_low, sizeof to->at_low);
        to->measured = block[m].measured != 0;
    }
}

static void photo_put_clipped(const struct rec_clipped *k, int l, struct rec_cl_picture_limits *to)
{
    to->is_clipped[l] = k->is;
    to->level[l] = k->level;
    to->sigma[l] = k->sigma;
    to->t[l] = k->t;
    to->slope[l] = k->slope;
    to->dark[l] = k->dark;
    to->cut[l] = k->cut;
}

/* Limits of sums, as judge and widen of photo_pass_impl.h form them. */
static void photo_put_limits(const struct rec_photo_image *im, struct rec_cl_picture_limits *to)
{
    const struct rec_photo_work *w = im->work;
    const struct rec_photo_params *how = im->params;
    *to = (struct rec_cl_picture_limits){.means = w->means,
                                         .despeckle = how->threshold < 0 && how->despeckle,
                                         .margin = how->margin,
                                         .clipped = rec_photo_is_clipped(im)};
    for (int l = 0; l < 4; l++) {
        to->limit[l] = w->limit[l];
        to->near[l] = w->faint[l] * 9;
        to->near_cap[l] = w->limit[l] + w->limit[l];
        to->wide[l] = w->fainter[l] * 49;
        to->wide_cap[l] = 4 * w->fainter[l];
    }
    for (int l = 0; l < im->nch; l++) {
        to->noise[l] = w->sigma[l];
        photo_put_clipped(&w->clipped[l], l, to);
    }
}

struct photo_set {
    rec_cl_photo *p;
    const struct rec_photo_image *im;
    struct rec_photo_passes pass;
};

/* Noise and limits of camera c. */
static void photo_decide(void *ctx, size_t c)
{
    const struct photo_set *s = ctx;
    const struct rec_photo_image *im = &s->im[c];
    float above[3];
    if (im->absent)
        return;
    photo_take(s->p, im, c, above);
    im->work->above = above;
    for (int32_t l = 0; l < im->nch; l++) {
        s->pass.noise(im, l);
        rec_clipped_find(im, l);
    }
    im->work->above = NULL;
    rec_photo_set_limits(im);
    photo_put_limits(im, &s->p->limit[c]);
}

void rec_cl_photo_send(rec_cl_photo *p, rec_cl_queue *q, const struct rec_photo_image *im)
{
    for (size_t c = 0; c < p->cameras; c++) {
        im[c].work->grain = rec_photo_grain(&im[c]);
        p->shots[c] = photo_shot(p, &im[c], c);
    }
    rec_cl_upload(q, &p->shot, 0, p->shots, p->cameras * sizeof *p->shots);
}

static void photo_measure(rec_cl_photo *p, rec_cl_queue *q, const struct rec_cl_pictures *to)
{
    const int cs = (int)p->cs, per_channel = to->w4.bytes > 0;
    const struct rec_cl_buffer *w4 = per_channel ? &to->w4 : &to->w; /* it is not written then */
    REC_CL_RUN(q, REC_CL_K_PHOTO_LINEAR, cs, p->bands, REC_CL_FLAT, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->at), REC_CL_BUFFER(&to->b), REC_CL_BUFFER(&p->back),
               REC_CL_BUFFER(&to->w), REC_CL_BUFFER(w4), REC_CL_VALUE(per_channel),
               REC_CL_BUFFER(&p->raw), REC_CL_BUFFER(&to->lit), REC_CL_BUFFER(&p->band));
    REC_CL_RUN(q, REC_CL_K_PHOTO_BLOCKS, cs, p->cameras * (REC_PHOTO_BLOCKS / REC_PHOTO_BLOCK),
               REC_CL_GROUP, REC_CL_BUFFER(&p->shot), REC_CL_BUFFER(&to->b), REC_CL_BUFFER(&to->w),
               REC_CL_BUFFER(&p->block));
    rec_cl_download(q, &p->band, 0, p->sums, p->bands * sizeof *p->sums);
    rec_cl_download(q, &p->block, 0, p->blocks, p->cameras * REC_PHOTO_BLOCKS * sizeof *p->blocks);
    REC_CL_RUN(q, REC_CL_K_PHOTO_PLANE, cs, p->bands, REC_CL_FLAT, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->at), REC_CL_BUFFER(&to->b), REC_CL_BUFFER(&p->plane));
}

static void photo_light(rec_cl_photo *p, rec_cl_queue *q, const struct rec_cl_pictures *to)
{
    const int cs = (int)p->cs, cameras = (int)p->cameras;
    REC_CL_RUN(q, REC_CL_K_PHOTO_JUDGE, cs, p->bands, REC_CL_FLAT, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->limits), REC_CL_BUFFER(&p->at), REC_CL_BUFFER(&to->b),
               REC_CL_BUFFER(&p->plane), REC_CL_BUFFER(&p->raw), REC_CL_BUFFER(&p->band));
    REC_CL_RUN(q, REC_CL_K_PHOTO_NOISY, cs, 1, REC_CL_GROUP, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->limits), REC_CL_VALUE(cameras), REC_CL_BUFFER(&p->band),
               REC_CL_BUFFER(&p->noisy));
    REC_CL_RUN(q, REC_CL_K_PHOTO_WIDEN, cs, p->bands, REC_CL_FLAT, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->limits), REC_CL_BUFFER(&p->at), REC_CL_BUFFER(&p->noisy),
               REC_CL_BUFFER(&to->b), REC_CL_BUFFER(&p->plane), REC_CL_BUFFER(&p->raw));
    REC_CL_RUN(q, REC_CL_K_PHOTO_FINISH, cs, p->bands, REC_CL_FLAT, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->limits), REC_CL_BUFFER(&p->at), REC_CL_BUFFER(&p->raw),
               REC_CL_BUFFER(&p->clean), REC_CL_BUFFER(&to->lit), REC_CL_BUFFER(&p->band));
}

static void photo_grow(rec_cl_photo *p, rec_cl_queue *q, const struct rec_cl_pictures *to)
{
    const int cs = (int)p->cs;
    REC_CL_RUN(q, REC_CL_K_PHOTO_GROW_ROWS, cs, p->bands, REC_CL_FLAT, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->limits), REC_CL_BUFFER(&p->at), REC_CL_BUFFER(&p->clean),
               REC_CL_BUFFER(&p->raw));
    REC_CL_RUN(q, REC_CL_K_PHOTO_GROW_COLUMNS, cs, p->bands, REC_CL_FLAT, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->limits), REC_CL_BUFFER(&p->at), REC_CL_BUFFER(&p->raw),
               REC_CL_BUFFER(&to->lit), REC_CL_BUFFER(&p->band));
}

static void photo_mend(rec_cl_photo *p, rec_cl_queue *q, const struct rec_cl_pictures *to)
{
    REC_CL_RUN(q, REC_CL_K_PHOTO_MEND, (int)p->cs, p->bands, REC_CL_FLAT, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->limits), REC_CL_BUFFER(&p->at), REC_CL_BUFFER(&p->inverse),
               REC_CL_BUFFER(&to->w), REC_CL_BUFFER(&to->b));
}

/* Copies of results to where the host wants them. */
static void photo_bring(const rec_cl_photo *p, rec_cl_queue *q, const struct rec_cl_pictures *to)
{
    const struct {
        const struct rec_cl_buffer *from;
        void *here;
        size_t bytes; /* of a bin */
    } all[] = {{&to->b, to->here.b, p->cs * sizeof(float)},
               {&to->w, to->here.w, sizeof(float)},
               {&to->w4, to->here.w4, 4 * sizeof(float)},
               {&to->lit, to->here.lit, 1}};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        if (all[i].here != NULL && all[i].from->bytes > 0)
            rec_cl_download(q, all[i].from, 0, all[i].here, p->rows * all[i].bytes);
}

bool rec_cl_photo_apply(rec_cl_photo *p, rec_cl_queue *q, const struct rec_photo_image *im,
                        const struct rec_cl_pictures *to, pvx_pool *pool)
{
    struct photo_set s = {.p = p, .im = im};
    bool margin = false, clipped = false;
    rec_photo_passes_init(&s.pass, pvx_cpu());
    photo_measure(p, q, to);
    if (!rec_cl_wait(q))
        return false;
    pvx_pool_run(pool, p->cameras, photo_decide, &s);
    for (size_t c = 0; c < p->cameras; c++) {
        margin |= im[c].params->margin > 0;
        clipped |= rec_photo_is_clipped(&im[c]);
    }
    rec_cl_upload(q, &p->limits, 0, p->limit, p->cameras * sizeof *p->limit);
    photo_light(p, q, to);
    if (margin)
        photo_grow(p, q, to);
    rec_cl_download(q, &p->band, 0, p->sums, p->bands * sizeof *p->sums);
    if (clipped)
        photo_mend(p, q, to);
    photo_bring(p, q, to);
    if (!rec_cl_wait(q))
        return false;
    for (size_t c = 0; c < p->cameras; c++) {
        for (size_t b = 0; b < rec_band_count(im[c].bh); b++)
            im[c].work->band[b].lit = (uint32_t)p->sums[p->of.first[c] + b].lit;
        rec_photo_report(&im[c]);
    }
    return true;
}
