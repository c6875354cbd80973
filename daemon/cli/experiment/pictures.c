/* pictures.c - Figures 3, 4, 7, 8 and 9, of one frame at the experiment's grid.  Each is a unit like a measurement.
 * It is not made again while its file exists. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/mem.h"
#include "daemon/cli/common/silhouettes.h"
#include "daemon/cli/experiment/experiment.h"
#include "daemon/cli/pictures/hull_picture.h"
#include "daemon/cli/pictures/strip.h"

static void pictures_path_of(const struct experiment *x, const char *name, char *path, size_t size)
{
    snprintf(path, size, "%s/%s", x->o->out, name);
}

static bool is_made(const struct experiment *x, const char *key, const char *file)
{
    char path[4300];
    pictures_path_of(x, file, path, sizeof path);
    return experiment_state_find(&x->state, key) != NULL && access(path, R_OK) == 0;
}

/* The solved frame as a dense volume; owner: caller, free(). */
static float *dense_of(const struct experiment_lab *l)
{
    struct rec_sparse v;
    float *dense = pvx_calloc(rec_grid_count(&l->S->grid) * (size_t)l->nch, sizeof *dense);
    rec_frame_volume(l->frame, &v);
    if (dense != NULL)
        rec_sparse_to_dense(&v, dense);
    return dense;
}

/* ---- Figure 3: without hull, and with ---- */

struct hulls {
    struct experiment_lab with, without;
    float *dense[2]; /* with, without */
};

static pvx_err solve_hulls(struct experiment *x, struct hulls *h, double *v, struct pvx_diag *d)
{
    struct experiment_lab_params p = experiment_lab_of(x, x->o->grid);
    struct experiment_error e;
    struct experiment_view view;
    p.frame.solve.solver = "cgls-paper";
    for (int i = 0; i < 2; i++) {
        struct experiment_lab *l = i == 0 ? &h->with : &h->without;
        if (i == 1)
            silhouettes_without_hull(&p.frame);
        PVX_TRY(experiment_lab_open(l, &p, d));
        l->said_lit = i == 1;
        PVX_TRY(experiment_lab_load(l, &x->in, x->set[x->one], d));
        PVX_TRY(experiment_lab_solve(l, experiment_used(x)));
        experiment_lab_compare(l, x->unused, &e);
        view = experiment_lab_view(l, x->unused);
        view.lit = experiment_lab_view(&h->with, x->unused).lit; /* the same for both */
        experiment_ghosts(&view, &v[2 * i], &v[2 * i + 1]);
        if ((h->dense[i] = dense_of(l)) == NULL)
            return pvx_fail(d, PVX_ENOMEM, "out of memory for a volume");
    }
    v[4] =
        experiment_outside(h->dense[1], h->dense[0], rec_grid_count(&h->with.S->grid), h->with.nch);
    return PVX_OK;
}

static pvx_err figure3(struct experiment *x, double *v, struct pvx_diag *d)
{
    struct hulls h = {.with = {.S = NULL}};
    struct dmn_strip_params s = dmn_strip_defaults;
    char path[4300];
    s.deg1 = 90;
    pvx_err e = solve_hulls(x, &h, v, d);
    if (e == PVX_OK) /* the same for both */
        e = dmn_flame_exposure(&h.with.S->grid, h.dense[0], h.with.nch, x->pool, &s.look.exposure);
    pictures_path_of(x, "fig3-without.png", path, sizeof path);
    PVX_THEN(e, dmn_strip_save(&h.with.S->grid, h.dense[1], h.with.nch, &s, x->pool, path, d));
    pictures_path_of(x, "fig3.png", path, sizeof path);
    PVX_THEN(e, dmn_strip_save(&h.with.S->grid, h.dense[0], h.with.nch, &s, x->pool, path, d));
    experiment_lab_close(&h.with);
    experiment_lab_close(&h.without);
    free(h.dense[0]);
    free(h.dense[1]);
    return e;
}

/* ---- Figure 4 ---- */

static pvx_err figure4(struct experiment *x, struct experiment_lab *l, double *v,
                       struct pvx_diag *d)
{
    const struct rec_hull_counts *k = &rec_frame_get_report(l->frame)->hull;
    bool present[REC_MAX_CAMERAS];
    hull_picture *h = NULL;
    char path[4300];
    for (size_t c = 0; c < l->S->n_cameras; c++)
        present[c] = c != x->unused;
    v[0] = (double)k->inside;
    v[1] = (double)k->partial;
    v[2] = (double)k->outside;
    pictures_path_of(x, "fig4.png", path, sizeof path);
    pvx_err e = hull_picture_new(l->S, &l->rig, l->nch, x->params.hull.min_views, x->pool, &h);
    PVX_THEN(e, hull_picture_save(h, l->frame, present, (uint64_t)x->in.number[x->set[x->one]],
                                  path, d));
    hull_picture_free(&h);
    return e;
}

/* ---- Figure 7: original, reconstruction, difference ---- */

/* The part of a picture to show: bins in the model's or the picture's silhouette, and some around them. */
struct crop {
    size_t x0, y0, w, h;
};
static bool seen_at(const struct experiment_lab *l, size_t r)
{
    float most = 0;
    for (size_t k = 0; k < (size_t)l->nch; k++)
        most = fmaxf(most, l->seen[r * (size_t)l->cs + k]);
    return l->lit[r] != 0 || most >= EXPERIMENT_SHOWS;
}

static struct crop crop_of(const struct experiment_lab *l, size_t c)
{
    enum { AROUND = 6 };
    size_t w = (size_t)l->S->block[c].bw, h = (size_t)l->S->block[c].bh;
    size_t x0 = w, y0 = h, x1 = 0, y1 = 0;
    for (size_t y = 0; y < h; y++)
        for (size_t x = 0; x < w; x++)
            if (seen_at(l, l->S->row0[c] + y * w + x)) {
                x0 = x < x0 ? x : x0;
                x1 = x > x1 ? x : x1;
                y0 = y < y0 ? y : y0;
                y1 = y > y1 ? y : y1;
            }
    if (x0 > x1)
        return (struct crop){0, 0, w, h};
    x0 -= x0 < AROUND ? x0 : AROUND;
    y0 -= y0 < AROUND ? y0 : AROUND;
    x1 = x1 + AROUND < w ? x1 + AROUND : w - 1;
    y1 = y1 + AROUND < h ? y1 + AROUND : h - 1;
    return (struct crop){x0, y0, x1 - x0 + 1, y1 - y0 + 1};
}

/* Correlation of picture and model in bins where either shows light, over all channels of camera c. */
static double likeness(const struct experiment_lab *l, size_t c)
{
    double n = 0, sp = 0, sq = 0, pp = 0, qq = 0, pq = 0;
    for (size_t r = l->S->row0[c]; r < l->S->row0[c + 1]; r++)
        for (size_t k = 0; l->weight[r] > 0 && seen_at(l, r) && k < (size_t)l->nch; k++) {
            double p = (double)l->b[r * (size_t)l->cs + k];
            double q = (double)l->seen[r * (size_t)l->cs + k];
            n++;
            sp += p;
            sq += q;
            pp += p * p;
            qq += q * q;
            pq += p * q;
        }
    double vp = pp - sp * sp / fmax(n, 1), vq = qq - sq * sq / fmax(n, 1);
    return vp > 0 && vq > 0 ? (pq - sp * sq / n) / sqrt(vp * vq) : 0;
}

/* A row of original, reconstruction and |difference|, each `w` bins of `big` pixels. */
static void pictures_three(const struct experiment_lab *l, size_t row, size_t w, size_t big,
                           float *out)
{
    size_t nch = (size_t)l->nch, cs = (size_t)l->cs;
    for (size_t i = 0; i < w * big; i++)
        for (size_t k = 0; k < nch; k++) {
            float p = l->b[(row + i / big) * cs + k], q = l->seen[(row + i / big) * cs + k];
            out[i * nch + k] = p;
            out[(w * big + i) * nch + k] = q;
            out[(2 * w * big + i) * nch + k] = fabsf(p - q);
        }
}

static pvx_err figure7(struct experiment *x, struct experiment_lab *l, double *v,
                       struct pvx_diag *d)
{
    enum { TALL = 320 /* pixels, at least */ };
    size_t row0 = l->S->row0[x->unused], wide = (size_t)l->S->block[x->unused].bw;
    struct experiment_error err;
    char path[4300];
    experiment_lab_compare(l, x->unused, &err);
    struct crop at = crop_of(l, x->unused);
    size_t big = (TALL + at.h - 1) / at.h;
    size_t row = 3 * at.w * big * (size_t)l->nch, n = row * at.h * big;
    memcpy(v, err.inside, sizeof err.inside);
    memcpy(v + 3, err.all, sizeof err.all);
    v[6] = likeness(l, x->unused);
    float *pix = pvx_calloc(n, sizeof *pix);
    if (pix == NULL)
        return pvx_fail(d, PVX_ENOMEM, "out of memory for a picture");
    for (size_t y = 0; y < at.h * big; y++)
        pictures_three(l, row0 + (at.y0 + y / big) * wide + at.x0, at.w, big, pix + y * row);
    struct look look = look_defaults;
    pvx_err e = dmn_auto_exposure(pix, n, &look.exposure);
    pictures_path_of(x, "fig7.png", path, sizeof path);
    PVX_THEN(e, look_save(&look, path, pix, (int32_t)(3 * at.w * big), (int32_t)(at.h * big),
                          l->nch, d));
    free(pix);
    return e;
}

/* ---- Figure 8 ---- */

/* Solve the frame at set[i] from all cameras, and save a strip of it. */
static pvx_err flame(struct experiment *x, struct experiment_lab *l, size_t i, const char *name,
                     struct pvx_diag *d)
{
    char path[4300];
    PVX_TRY(experiment_lab_load(l, &x->in, x->set[i], d));
    PVX_TRY(experiment_lab_solve(l, experiment_used(x) | (uint64_t)1 << x->unused));
    float *dense = dense_of(l);
    if (dense == NULL)
        return pvx_fail(d, PVX_ENOMEM, "out of memory for a volume");
    pictures_path_of(x, name, path, sizeof path);
    pvx_err e = dmn_strip_save(&l->S->grid, dense, l->nch, &dmn_strip_defaults, x->pool, path, d);
    free(dense);
    return e;
}

static pvx_err figure8(struct experiment *x, struct experiment_lab *l, double *v,
                       struct pvx_diag *d)
{
    size_t other = (x->one + (x->sets + 1) / 2) % x->sets;
    v[0] = (double)x->in.number[x->set[x->one]];
    v[1] = (double)x->in.number[x->set[other]];
    PVX_TRY(flame(x, l, other, "fig8-other.png", d));
    return flame(x, l, x->one, "fig8.png", d);
}

/* ---- all ---- */

enum { HULL, COUNTS, VIEW, FLAMES, FIGURES };
static const struct {
    const char *key, *file;
} figure[FIGURES] = {{"figure:3", "fig3.png"},
                     {"figure:4", "fig4.png"},
                     {"figure:7", "fig7.png"},
                     {"figure:8", "fig8.png"}};

size_t experiment_figures(void)
{
    return FIGURES;
}

static pvx_err pictures_draw(struct experiment *x, struct experiment_lab *l, int i,
                             struct pvx_diag *d)
{
    double v[EXPERIMENT_VALUES] = {0};
    pvx_err e = PVX_OK;
    if (i == COUNTS || i == VIEW) {
        PVX_TRY(experiment_lab_load(l, &x->in, x->set[x->one], d));
        e = experiment_lab_solve(l, experiment_used(x));
    }
    if (e != PVX_OK)
        return pvx_fail(d, e, "%s: %s", figure[i].file, pvx_strerror(e));
    e = i == HULL     ? figure3(x, v, d)
        : i == COUNTS ? figure4(x, l, v, d)
        : i == VIEW   ? figure7(x, l, v, d)
                      : figure8(x, l, v, d);
    if (e == PVX_ECANCELED)
        return e;
    return e == PVX_OK ? experiment_finished(x, figure[i].key, v, d)
                       : pvx_fail(d, e, "%s: %s", figure[i].file, pvx_strerror(e));
}

pvx_err experiment_pictures(struct experiment *x, struct pvx_diag *d)
{
    struct experiment_lab l = {.S = NULL};
    struct experiment_lab_params p = experiment_lab_of(x, x->o->grid);
    pvx_err e = PVX_OK;
    for (int i = 0; i < FIGURES && e == PVX_OK; i++) {
        if (is_made(x, figure[i].key, figure[i].file))
            continue;
        if (cli_stop)
            e = PVX_ECANCELED;
        else if (l.S == NULL)
            e = experiment_lab_open(&l, &p, d);
        PVX_THEN(e, pictures_draw(x, &l, i, d));
    }
    experiment_lab_close(&l);
    return e;
}
