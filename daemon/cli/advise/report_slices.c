/* report_slices.c - three slices of a volume, and of its bars, as pictures. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/cli/advise/report.h"
#include "daemon/cli/pictures/look.h"
#include "daemon/volumes/bricks.h"

#define SIDE 360.0 /* pixels of the longest side */

struct slices {
    const struct pvp_grid *g;
    double h[3];
    uint32_t at[3]; /* the voxel where they meet */
};

/* The value of channel c (-1: their mean) at voxel i. */
static double slices_value(const struct slices *s, const float *dense, const uint32_t i[3], int c)
{
    const uint32_t *n = s->g->n, nch = s->g->channels;
    const float *p = dense + (((size_t)i[2] * n[1] + i[1]) * n[0] + i[0]) * nch;
    double sum = 0;
    if (c >= 0)
        return (double)p[c];
    for (uint32_t k = 0; k < nch; k++)
        sum += (double)p[k];
    return sum / nch;
}

/* Where it is brightest. */
static void slices_meet(struct slices *s, const float *dense)
{
    double most = -1;
    uint32_t i[3];
    for (i[2] = 0; i[2] < s->g->n[2]; i[2]++)
        for (i[1] = 0; i[1] < s->g->n[1]; i[1]++)
            for (i[0] = 0; i[0] < s->g->n[0]; i[0]++) {
                double v = slices_value(s, dense, i, -1);
                if (v > most) {
                    most = v;
                    memcpy(s->at, i, sizeof i);
                }
            }
}

/* The largest value in the three slices. */
static double slices_most(const struct slices *s, const float *dense)
{
    double most = 0;
    for (int a = 0; a < 3; a++) {
        const int u = a == 0 ? 1 : 0, v = a == 2 ? 1 : 2;
        uint32_t i[3] = {s->at[0], s->at[1], s->at[2]};
        for (i[u] = 0; i[u] < s->g->n[u]; i[u]++)
            for (i[v] = 0; i[v] < s->g->n[v]; i[v]++)
                for (uint32_t c = 0; c < s->g->channels; c++)
                    most = fmax(most, slices_value(s, dense, i, (int)c));
    }
    return most;
}

/* The slice across axis a, the other two to the right and upwards. */
static pvx_err slices_save(const struct slices *s, const float *dense, int a, double white,
                           const char *path, struct pvx_diag *d)
{
    const int u = a == 0 ? 1 : 0, v = a == 2 ? 1 : 2, nch = (int)s->g->channels;
    double longest = 0;
    for (int k = 0; k < 3; k++)
        longest = fmax(longest, s->g->n[k] * s->h[k]);
    double px = SIDE / longest;
    int32_t w = (int32_t)fmax(round(s->g->n[u] * s->h[u] * px), 1),
            h = (int32_t)fmax(round(s->g->n[v] * s->h[v] * px), 1);
    float *pix = pvx_calloc((size_t)w * (size_t)h * (size_t)nch, sizeof *pix);
    PVX_NEED(pix);
    for (int32_t y = 0; y < h; y++)
        for (int32_t x = 0; x < w; x++) {
            uint32_t i[3] = {s->at[0], s->at[1], s->at[2]};
            i[u] = (uint32_t)fmin((x + 0.5) / w * s->g->n[u], s->g->n[u] - 1.0);
            i[v] = (uint32_t)fmin((h - y - 0.5) / h * s->g->n[v], s->g->n[v] - 1.0);
            for (int c = 0; c < nch; c++)
                pix[((size_t)y * (size_t)w + (size_t)x) * (size_t)nch + (size_t)c] =
                    (float)slices_value(s, dense, i, c);
        }
    struct look look = look_defaults;
    look.exposure = white > 0 ? 1 / white : 1;
    pvx_err e = look_save(&look, path, pix, w, h, nch, d);
    free(pix);
    return e;
}

static pvx_err slices_of(const struct report *r, const struct slices *s, const float *dense,
                         const char *name, double *white, struct pvx_diag *d)
{
    *white = slices_most(s, dense);
    for (int a = 0; a < 3; a++) {
        char path[4300];
        snprintf(path, sizeof path, "%s/%s-%c.png", r->out, name, 'x' + a);
        PVX_TRY(slices_save(s, dense, a, *white, path, d));
    }
    return PVX_OK;
}

pvx_err report_slices(struct report *r, struct pvx_diag *d)
{
    const struct pvp_grid *g = &r->head->start.grid;
    struct slices s = {.g = g};
    struct vol_volume v;
    vol_reader_modes(r->volumes, false);
    PVX_TRY(vol_reader_get(r->volumes, r->course.row[r->shown].place, &v, d));
    float *dense = pvx_calloc(pvp_grid_count(g), sizeof *dense);
    PVX_NEED(dense);
    for (int a = 0; a < 3; a++)
        s.h[a] = (g->max[a] - g->min[a]) / g->n[a];
    vol_to_dense(&v, dense);
    slices_meet(&s, dense);
    for (int a = 0; a < 3; a++)
        r->at[a] = g->min[a] + (s.at[a] + 0.5) * s.h[a];
    pvx_err e = slices_of(r, &s, dense, "slice", &r->white[0], d);
    if (v.bars.sd != NULL && e == PVX_OK) {
        struct vol_volume bars = v;
        bars.brick = v.bars.sd;
        memset(dense, 0, pvp_grid_count(g) * sizeof *dense);
        vol_to_dense(&bars, dense);
        e = slices_of(r, &s, dense, "bar", &r->white[1], d);
    }
    free(dense);
    return e;
}
