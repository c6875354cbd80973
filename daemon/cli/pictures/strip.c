#include "daemon/cli/pictures/strip.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/files/imgio.h"
#include "recon/view/render.h"

static const double pi = 3.14159265358979323846;

const struct dmn_strip_params dmn_strip_defaults = {.deg0 = 0,
                                                    .deg1 = 120,
                                                    .views = 5,
                                                    .width = 240,
                                                    .height = 320,
                                                    .sub = 2,
                                                    .look = {.gamma = 2.2, .depth = 8}};

struct rec_grid dmn_lit_box(const struct rec_grid *g, const float *dense, int nch)
{
    size_t n = rec_grid_count(g);
    float most = 0;
    for (size_t i = 0; i < n * (size_t)nch; i++)
        most = fmaxf(most, dense[i]);
    int32_t lo[3] = {INT32_MAX, INT32_MAX, INT32_MAX}, hi[3] = {-1, -1, -1};
    for (size_t i = 0; i < n && most > 0; i++) {
        bool lit = false;
        for (int c = 0; c < nch; c++)
            lit |= dense[i * (size_t)nch + (size_t)c] > 0.02f * most;
        if (!lit)
            continue;
        int32_t v[3];
        rec_grid_ijk(g, (int32_t)i, v);
        for (int a = 0; a < 3; a++) {
            lo[a] = v[a] < lo[a] ? v[a] : lo[a];
            hi[a] = v[a] > hi[a] ? v[a] : hi[a];
        }
    }
    struct rec_grid box = *g;
    for (int a = 0; a < 3 && hi[0] >= 0; a++) {
        box.min[a] = g->min[a] + (lo[a] - 1) * rec_grid_h(g, a);
        box.max[a] = g->min[a] + (hi[a] + 2) * rec_grid_h(g, a);
    }
    return box;
}

static int strip_rising(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

pvx_err dmn_auto_exposure(const float *pix, size_t n, double *out)
{
    float most = 0;
    for (size_t i = 0; i < n; i++)
        most = fmaxf(most, pix[i]);
    *out = 0;
    if (!(most > 0))
        return PVX_OK;
    float *lit = pvx_calloc(n, sizeof *lit);
    PVX_NEED(lit);
    size_t m = 0;
    for (size_t i = 0; i < n; i++)
        if (pix[i] > 0.01f * most)
            lit[m++] = pix[i];
    qsort(lit, m, sizeof *lit, strip_rising);
    *out = 1 / lit[(size_t)(0.998 * (double)(m - 1))];
    free(lit);
    return PVX_OK;
}

pvx_err dmn_flame_exposure(const struct rec_grid *g, const float *dense, int nch, pvx_pool *pool,
                           double *out)
{
    enum { SMALL = 160 /* px across */ };
    struct rec_grid box = dmn_lit_box(g, dense, nch);
    size_t n = (size_t)SMALL * SMALL * (size_t)nch;
    float *pix = pvx_calloc(n, sizeof *pix);
    pvx_err e = pix != NULL ? PVX_OK : PVX_ENOMEM;
    *out = 0;
    for (int side = 0; side < 2 && e == PVX_OK; side++) {
        struct rec_camera c;
        double f = 0;
        rec_orbit_camera(&box, side * pi / 2, DMN_ELEVATION_DEG * pi / 180, SMALL, SMALL, &c);
        e = rec_render(g, dense, nch, &(struct rec_eye){.camera = &c, .sub = 1}, pool, pix);
        PVX_THEN(e, dmn_auto_exposure(pix, n, &f));
        *out = f > 0 && (*out == 0 || f < *out) ? f : *out;
    }
    free(pix);
    return e;
}

struct strip {
    const struct rec_grid *g;
    const float *dense;
    int nch;
    const struct dmn_strip_params *p;
    pvx_pool *pool;
    struct rec_grid box; /* around the lit voxels */
};

/* Draw view v of the turntable. */
static pvx_err strip_draw_view(const struct strip *s, int v, float *view)
{
    const struct dmn_strip_params *p = s->p;
    double share = p->views > 1 ? (double)v / (p->views - 1) : 0;
    double angle = (p->deg0 + (p->deg1 - p->deg0) * share) * pi / 180;
    struct rec_camera c;
    rec_orbit_camera(&s->box, angle, DMN_ELEVATION_DEG * pi / 180, p->width, p->height, &c);
    return rec_render(s->g, s->dense, s->nch,
                      &(struct rec_eye){.camera = &c, .bodies = p->bodies, .sub = p->sub}, s->pool,
                      view);
}

pvx_err dmn_strip_save(const struct rec_grid *g, const float *dense, int nch,
                       const struct dmn_strip_params *p, pvx_pool *pool, const char *path,
                       struct pvx_diag *d)
{
    if (p->views < 1 || p->views > 64 || p->width < 1 || p->width > 8192 || p->height < 1 ||
        p->height > 8192 || (nch != 1 && nch != 3))
        return pvx_fail(d, PVX_EINVAL, "%s: a strip has 1 to 64 views of up to 8192 px", path);
    size_t row = (size_t)p->width * (size_t)nch, wide = row * (size_t)p->views;
    size_t n = wide * (size_t)p->height;
    float *view = pvx_calloc(row * (size_t)p->height, sizeof *view);
    float *strip = pvx_calloc(n, sizeof *strip);
    pvx_err e = view != NULL && strip != NULL ? PVX_OK : PVX_ENOMEM;
    struct strip s = {g, dense, nch, p, pool, dmn_lit_box(g, dense, nch)};
    for (int v = 0; v < p->views && e == PVX_OK; v++) {
        e = strip_draw_view(&s, v, view);
        for (int32_t y = 0; y < p->height && e == PVX_OK; y++)
            memcpy(strip + (size_t)y * wide + (size_t)v * row, view + (size_t)y * row,
                   row * sizeof *view);
    }
    struct look look = p->look;
    bool png = pvx_path_ends(path, ".png");
    if (e == PVX_OK && png && !(look.exposure > 0)) {
        e = dmn_auto_exposure(strip, n, &look.exposure);
        look.exposure *= look_headroom(&look);
    }
    if (e != PVX_OK)
        pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
    else
        e = png ? look_save(&look, path, strip, p->width * p->views, p->height, nch, d)
                : cap_image_save(path, strip, p->width * p->views, p->height, nch, d);
    free(view);
    free(strip);
    return e;
}
