/* spectral_light.c - light of known temperature: regions of pictures, a place in volumes. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/median.h"
#include "daemon/cli/calibrate/spectral.h"
#include "daemon/volumes/volumes.h"

enum { LEAST_SETS = 4 };

/* ---- pictures ----------------------------------------------------------------------------------- */

struct region {
    int32_t x, y, w, h;
};

static pvx_err region_of(const struct calibrate_spectral_args *a, const struct rec_light_picture *p,
                         const char *camera, struct region *out, struct pvx_diag *d)
{
    *out = a->region[2] > 0
               ? (struct region){a->region[0], a->region[1], a->region[2], a->region[3]}
               : (struct region){p->width / 4, p->height / 4, p->width / 2, p->height / 2};
    if (out->w < 1 || out->h < 1 || out->x + out->w > p->width || out->y + out->h > p->height)
        return pvx_fail(d, PVX_EINVAL,
                        "--region %d,%d,%d,%d is not inside the pictures of camera %s, %d x %d",
                        out->x, out->y, out->w, out->h, camera, p->width, p->height);
    return PVX_OK;
}

/* Mean of each colour over the region, and its noise. */
static void region_means(const struct rec_light_picture *p, const struct region *r, double mean[3],
                         double sd[3])
{
    double sum[3] = {0}, var[3] = {0}, n[3] = {0};
    for (int32_t y = r->y; y < r->y + r->h; y++)
        for (int32_t x = r->x; x < r->x + r->w; x++)
            for (int k = 0; k < p->channels; k++) {
                size_t i = ((size_t)y * (size_t)p->width + (size_t)x) * (size_t)p->channels;
                int c = p->cell != NULL ? p->cell[y % 2 * 2 + x % 2] : k;
                i += (size_t)k;
                if (!isfinite(p->mean[i]))
                    continue;
                sum[c] += (double)p->mean[i];
                var[c] += (double)p->var[i];
                n[c]++;
            }
    for (int c = 0; c < 3; c++) {
        mean[c] = sum[c] / n[c];
        sd[c] = sqrt(var[c] / p->n) / n[c];
    }
}

/* Gain and colours of the rig, as they are applied to a flame's pictures. */
static void as_solved(const struct rec_camera *k, double v[3], double sd[3])
{
    double in[3], in_sd[3];
    const double *M = k->photometry.matrix;
    for (int c = 0; c < 3; c++) {
        v[c] *= (double)k->gain[c];
        sd[c] *= (double)k->gain[c];
    }
    memcpy(in, v, sizeof in);
    memcpy(in_sd, sd, sizeof in_sd);
    for (int c = 0; c < 3 && k->photometry.has_matrix; c++) {
        v[c] = M[3 * c] * in[0] + M[3 * c + 1] * in[1] + M[3 * c + 2] * in[2];
        sd[c] = hypot(hypot(M[3 * c] * in_sd[0], M[3 * c + 1] * in_sd[1]), M[3 * c + 2] * in_sd[2]);
    }
}

static pvx_err observe(const struct calibrate_light *l, const struct calibrate_spectral_args *a,
                       size_t g, size_t c, struct rec_known *out, struct pvx_diag *d)
{
    const struct rec_camera *k = &l->rig.cameras[c];
    const struct rec_light_picture *p = &calibrate_light_stack(l, g, c)->picture;
    struct region r;
    if (p->channels == 1 && p->cell == NULL)
        return pvx_fail(d, PVX_EINVAL,
                        "camera %s is grey: a temperature needs the three channels of a colour "
                        "camera",
                        k->name);
    if (p->saturated > 0.001)
        return pvx_fail(d, PVX_EINVAL,
                        "camera %s: %s is saturated in %.1f %% of its samples: expose less",
                        k->name, l->a->frames[g], 100 * p->saturated);
    PVX_TRY(region_of(a, p, k->name, &r, d));
    region_means(p, &r, out->value, out->sd);
    as_solved(k, out->value, out->sd);
    out->kelvin = a->kelvin[g];
    for (int q = 0; q < 3; q++)
        if (!(out->value[q] > 0.002))
            return pvx_fail(
                d, PVX_EINVAL,
                "camera %s: the %s channel sees %.4f of full scale in %s: the source should be in "
                "the region (--region X,Y,W,H), brighter",
                k->name, rec_spectral_channel(q), out->value[q], l->a->frames[g]);
    return PVX_OK;
}

/* All exposures are made that of the first. */
static pvx_err same_exposure(double is, size_t first, const char *frames, double *exposure,
                             struct rec_known *k, struct pvx_diag *d)
{
    if (first == 0)
        *exposure = is;
    if (isfinite(is) != isfinite(*exposure))
        return pvx_fail(d, PVX_EINVAL,
                        "%s: the exposures of some pictures are known: say the others by "
                        "--exposure, after their --frames",
                        frames);
    for (int q = 0; q < 3 && isfinite(is); q++) {
        k->value[q] *= *exposure / is;
        k->sd[q] *= *exposure / is;
    }
    return PVX_OK;
}

/* ---- one response for all ----------------------------------------------------------------------- */

/* The colour of the source in each camera: log of red and of blue over green, mean over the groups that it saw. */
struct colours {
    double ratio[2][REC_MAX_CAMERAS];
    size_t seen[REC_MAX_CAMERAS], n;
};

static void colours_add(struct colours *s, size_t c, const struct rec_known *k)
{
    s->ratio[0][c] += log(k->value[0] / k->value[1]);
    s->ratio[1][c] += log(k->value[2] / k->value[1]);
    s->n += s->seen[c]++ == 0;
}

static double colours_middle(const struct colours *s, int which, size_t cameras)
{
    double v[REC_MAX_CAMERAS];
    size_t n = 0;
    for (size_t c = 0; c < cameras; c++)
        if (s->seen[c] > 0)
            v[n++] = s->ratio[which][c] / (double)s->seen[c];
    return pvx_median(v, n);
}

/* Name cameras that see the source in another colour than the middle one, and those that did not see it. */
static pvx_err colours_judge(const struct colours *s, const struct calibrate_light *l,
                             double trusted, struct pvx_diag *d)
{
    static const char *const what[2] = {"red", "blue"};
    for (int i = 0; i < 2; i++) {
        double middle = colours_middle(s, i, l->rig.n_cameras);
        for (size_t c = 0; c < l->rig.n_cameras; c++) {
            double off = s->seen[c] > 0 ? s->ratio[i][c] / (double)s->seen[c] - middle : 0;
            if (s->n > 2 && fabs(off) > REC_KNOWN_SCATTER)
                return pvx_fail(d, PVX_EINVAL,
                                "camera %s sees the source with %.0f %% %s %s over green than the "
                                "others: all cameras must have one response (equal cameras and "
                                "filters, or `calibrate colour`)",
                                l->rig.cameras[c].name, 100 * fabs(expm1(off)),
                                off > 0 ? "more" : "less", what[i]);
            if (s->n > 2 && fabs(off) > trusted)
                fprintf(
                    stderr,
                    "pyrovox: camera %s sees the source with %.1f %% %s %s over green than the "
                    "others, more than --curve-sd: `spectral:` has one response for all cameras, "
                    "so its share of the light gives another temperature (`calibrate colour`)\n",
                    l->rig.cameras[c].name, 100 * fabs(expm1(off)), off > 0 ? "more" : "less",
                    what[i]);
        }
    }
    for (size_t c = 0; c < l->rig.n_cameras; c++)
        if (s->seen[c] == 0)
            fprintf(
                stderr,
                "pyrovox: camera %s did not see the source, and is taken to have the response of "
                "the others\n",
                l->rig.cameras[c].name);
    return PVX_OK;
}

pvx_err calibrate_spectral_pictures(const struct calibrate_light *l,
                                    const struct calibrate_spectral_args *a, struct rec_known *out,
                                    size_t *n, double *exposure, struct pvx_diag *d)
{
    struct colours colours = {.n = 0};
    *n = 0;
    *exposure = NAN;
    for (size_t g = 0; g < l->a->n; g++)
        for (size_t c = 0; c < l->rig.n_cameras; c++) {
            const struct rec_light_picture *p = &calibrate_light_stack(l, g, c)->picture;
            if (p->n == 0)
                continue;
            PVX_TRY(observe(l, a, g, c, &out[*n], d));
            PVX_TRY(same_exposure(p->exposure, *n, l->a->frames[g], exposure, &out[*n], d));
            colours_add(&colours, c, &out[*n]);
            ++*n;
        }
    return *n > 0 ? colours_judge(&colours, l, a->doubt.curve_sd, d)
                  : pvx_fail(d, PVX_ENOENT, "%s: no picture could be used", l->a->frames[0]);
}

/* ---- volumes ------------------------------------------------------------------------------------ */

/* The voxel at the point, in its brick. */
static pvx_err voxel_at(const struct pvp_grid *g, const double x[3], uint32_t *brick, size_t *cell,
                        struct pvx_diag *d)
{
    uint32_t nb[3], i[3];
    (void)pvp_grid_bricks(g, nb);
    for (int a = 0; a < 3; a++) {
        double u = (x[a] - g->min[a]) / (g->max[a] - g->min[a]) * g->n[a];
        if (!(u >= 0 && u < g->n[a]))
            return pvx_fail(d, PVX_EINVAL,
                            "--thermocouple: %g along %c is outside the volume, %g to %g m", x[a],
                            "xyz"[a], g -> min[a], g -> max[a]);
        i[a] = (uint32_t)u;
    }
    *brick = (i[2] / PVP_BRICK * nb[1] + i[1] / PVP_BRICK) * nb[0] + i[0] / PVP_BRICK;
    *cell = (i[2] % PVP_BRICK * PVP_BRICK + i[1] % PVP_BRICK) * PVP_BRICK + i[0] % PVP_BRICK;
    return PVX_OK;
}

/* Sums over the sets with light there: of the channels' shares of it, their squares, and of the light.  A flame flickers, and
 * its shares do not. */
struct point_sums {
    double share[3], square[3], light, n;
};

static void point_add(struct point_sums *s, const float e[3])
{
    double all = (double)e[0] + (double)e[1] + (double)e[2];
    if (!(all > 0))
        return;
    for (int q = 0; q < 3; q++) {
        double share = (double)e[q] / all;
        s->share[q] += share;
        s->square[q] += share * share;
    }
    s->light += all;
    s->n++;
}

static pvx_err point_read(vol_reader *r, const struct calibrate_spectral_args *a,
                          struct point_sums *s, struct pvx_diag *d)
{
    uint32_t brick = 0;
    size_t cell = 0;
    PVX_TRY(voxel_at(&vol_reader_head(r)->start.grid, a->point, &brick, &cell, d));
    for (uint64_t k = 0; k < vol_reader_count(r); k++) {
        struct vol_volume v;
        PVX_TRY(vol_reader_get(r, k, &v, d));
        for (uint32_t b = 0; b < v.n_bricks; b++)
            if (v.ids[b] == brick)
                point_add(s, v.brick + ((size_t)b * PVP_BRICK * PVP_BRICK * PVP_BRICK + cell) * 3);
    }
    return s->n >= LEAST_SETS
               ? PVX_OK
               : pvx_fail(d, PVX_EINVAL,
                          "%s: %.0f volumes have light at the thermocouple: its noise is from the "
                          "scatter of %d or more",
                          a->volume, s->n, LEAST_SETS);
}

pvx_err calibrate_spectral_point(const struct calibrate_spectral_args *a, struct rec_known *out,
                                 struct pvx_diag *d)
{
    struct point_sums s = {.n = 0};
    vol_reader *r;
    PVX_TRY(vol_reader_open(a->volume, &r, d));
    pvx_err e = vol_reader_emission(r, a->volume, d);
    if (e == PVX_OK && vol_reader_head(r)->start.grid.channels != 3)
        e = pvx_fail(d, PVX_EINVAL, "%s: has one channel: a temperature needs three", a->volume);
    PVX_THEN(e, point_read(r, a, &s, d));
    vol_reader_close(&r);
    PVX_TRY(e);
    out->kelvin = a->point_kelvin;
    for (int q = 0; q < 3; q++) {
        double share = s.share[q] / s.n, var = fmax(0, s.square[q] / s.n - share * share);
        out->value[q] = share * s.light / s.n;
        out->sd[q] = sqrt(var / (s.n - 1)) * s.light / s.n;
    }
    return PVX_OK;
}
