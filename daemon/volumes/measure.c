#include "daemon/volumes/measure.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define B     PVP_BRICK
#define CELLS ((size_t)B * B * B)

/* ---- the region ---- */

/* Voxels along axis a whose centres lie from `from` to `to`. */
static void measure_span(struct vol_cells *m, int a, double from, double to)
{
    double n = m->g->n[a], lo = ceil((from - m->g->min[a]) / m->h[a] - 0.5),
           hi = floor((to - m->g->min[a]) / m->h[a] - 0.5) + 1;
    m->lo[a] = (uint32_t)fmin(fmax(lo, 0), n);
    m->hi[a] = (uint32_t)fmin(fmax(hi, m->lo[a]), n);
}

struct vol_cells vol_region_cells(const struct pvp_grid *g, const struct vol_region *r)
{
    struct vol_cells m = {.g = g, .r = r};
    for (int a = 0; a < 3; a++) {
        m.h[a] = (g->max[a] - g->min[a]) / g->n[a];
        m.hi[a] = g->n[a];
        if (r->kind == VOL_BOX)
            measure_span(&m, a, fmin(r->at[a], r->at[a + 3]), fmax(r->at[a], r->at[a + 3]));
        if (r->kind == VOL_SPHERE)
            measure_span(&m, a, r->at[a] - r->at[3], r->at[a] + r->at[3]);
    }
    if (r->kind == VOL_SLICE) { /* the layer that has it; none outside the volume */
        int a = (int)r->at[0];
        double k = floor((r->at[1] - g->min[a]) / m.h[a]);
        bool in = r->at[1] >= g->min[a] && r->at[1] <= g->max[a];
        m.lo[a] = in ? (uint32_t)fmin(k, g->n[a] - 1.0) : 0;
        m.hi[a] = in ? m.lo[a] + 1 : 0;
    }
    return m;
}

bool vol_cells_in(const struct vol_cells *m, const uint32_t at[3])
{
    const struct vol_region *r = m->r;
    double r2 = 0;
    for (int a = 0; a < 3; a++) {
        if (at[a] < m->lo[a] || at[a] >= m->hi[a])
            return false;
        double d = m->g->min[a] + (at[a] + 0.5) * m->h[a] - r->at[a];
        r2 += d * d;
    }
    return r->kind != VOL_SPHERE || r2 <= r->at[3] * r->at[3];
}

uint64_t vol_cells_count(const struct vol_cells *m)
{
    uint64_t n = 0;
    uint32_t at[3];
    if (m->r->kind != VOL_SPHERE)
        return (uint64_t)(m->hi[0] - m->lo[0]) * (m->hi[1] - m->lo[1]) * (m->hi[2] - m->lo[2]);
    for (at[2] = m->lo[2]; at[2] < m->hi[2]; at[2]++)
        for (at[1] = m->lo[1]; at[1] < m->hi[1]; at[1]++)
            for (at[0] = m->lo[0]; at[0] < m->hi[0]; at[0]++)
                n += vol_cells_in(m, at);
    return n;
}

pvx_err vol_region_empty(const struct pvp_grid *g, struct pvx_diag *d)
{
    double mm[3];
    for (int a = 0; a < 3; a++)
        mm[a] = 1000 * (g->max[a] - g->min[a]) / g->n[a];
    return pvx_fail(d, PVX_EINVAL,
                    "no voxel has its centre in the region: the volume goes from %g %g %g to %g %g "
                    "%g m, a voxel has %.3g x %.3g x %.3g mm",
                    g->min[0], g->min[1], g->min[2], g->max[0], g->max[1], g->max[2], mm[0], mm[1],
                    mm[2]);
}

/* ---- sums ---- */

/* Sums over the region, of x or of a mode. */
struct sums {
    double sum;
    double *layer;     /* [nz] */
    uint64_t above[2]; /* voxels above the level: of x + d, x - d; of x alone both are alike */
};

/* The mean of the channels at p, or one of them. */
static double channel_of(const float *p, uint32_t channels, int channel)
{
    double sum = 0;
    if (channel >= 0)
        return (double)p[channel];
    for (uint32_t c = 0; c < channels; c++)
        sum += (double)p[c];
    return sum / channels;
}

struct measuring {
    const struct vol_volume *v;
    const struct vol_measure_how *how;
    struct vol_cells m;
    uint32_t channels;
    double t2; /* sum of t^2 over the region */
    double most, most_var;
    struct sums x, *mode; /* mode [n_modes] */
};

/* t of (1): what the modes leave of sd, mean of the channels. */
static double measure_rest(const struct measuring *s, size_t at)
{
    const struct vol_bars *b = &s->v->bars;
    size_t floats = s->v->n_bricks * CELLS * s->channels;
    double sum = 0;
    int first = s->how->channel < 0 ? 0 : s->how->channel,
        end = s->how->channel < 0 ? (int)s->channels : first + 1;
    for (int c = first; c < end; c++) {
        double t2 = (double)b->sd[at + (size_t)c] * (double)b->sd[at + (size_t)c];
        for (uint32_t k = 0; k < b->n_modes; k++) {
            double d = (double)b->modes[k * floats + at + (size_t)c];
            t2 -= d * d;
        }
        sum += sqrt(fmax(t2, 0));
    }
    return sum / (end - first);
}

static void measure_voxel(struct measuring *s, size_t at, uint32_t z)
{
    const struct vol_bars *b = &s->v->bars;
    size_t floats = s->v->n_bricks * CELLS * s->channels;
    double x = channel_of(s->v->brick + at, s->channels, s->how->channel), var = 0;
    bool above = x > s->how->level;
    s->x.sum += x;
    s->x.layer[z] += x;
    s->x.above[0] += above;
    for (uint32_t k = 0; k < b->n_modes && b->sd != NULL; k++) {
        double d = channel_of(b->modes + k * floats + at, s->channels, s->how->channel);
        s->mode[k].sum += d;
        s->mode[k].layer[z] += d;
        s->mode[k].above[0] += x + d > s->how->level;
        s->mode[k].above[1] += x - d > s->how->level;
        var += d * d;
    }
    if (b->sd != NULL) {
        double t = measure_rest(s, at);
        s->t2 += t * t;
        var += t * t;
    }
    if (x > s->most) {
        s->most = x;
        s->most_var = var;
    }
}

static void measure_bricks(struct measuring *s)
{
    uint32_t nb[3];
    pvp_grid_bricks(s->m.g, nb);
    for (uint32_t i = 0; i < s->v->n_bricks; i++) {
        uint32_t id = s->v->ids[i];
        for (size_t q = 0; q < CELLS; q++) {
            const uint32_t at[3] = {id % nb[0] * B + (uint32_t)(q % B),
                                    id / nb[0] % nb[1] * B + (uint32_t)(q / B % B),
                                    id / nb[0] / nb[1] * B + (uint32_t)(q / B / B)};
            if (vol_cells_in(&s->m, at))
                measure_voxel(s, (i * CELLS + q) * s->channels, at[2]);
        }
    }
}

/* ---- figures ---- */

/* z below which all but VOL_TOP of the light of x + sign d lies; d NULL: of x. */
static double height_of(const struct measuring *s, const struct sums *d, double sign)
{
    const struct vol_cells *m = &s->m;
    double all = s->x.sum + (d != NULL ? sign * d->sum : 0), top = 0;
    for (uint32_t z = m->g->n[2]; all > 0 && z-- > 0;) {
        double layer = s->x.layer[z] + (d != NULL ? sign * d->layer[z] : 0);
        if (top + layer >= VOL_TOP * all)
            return m->g->min[2] + (z + 1 - (VOL_TOP * all - top) / layer) * m->h[2];
        top += layer;
    }
    return m->g->min[2];
}

static void measure_figures(const struct measuring *s, struct vol_measured *out)
{
    const struct vol_bars *b = &s->v->bars;
    double V = s->m.h[0] * s->m.h[1] * s->m.h[2], n = (double)out->voxels, var = s->t2;
    double height = 0, volume = 0;
    for (uint32_t k = 0; k < b->n_modes && b->sd != NULL; k++) {
        const struct sums *d = &s->mode[k];
        double up = (height_of(s, d, 1) - height_of(s, d, -1)) / 2,
               more = ((double)d->above[0] - (double)d->above[1]) / 2;
        var += d->sum * d->sum;
        height += up * up;
        volume += more * more;
    }
    bool known = out->modes || (out->bars && out->voxels == 1);
    double sd = known ? sqrt(var) : NAN;
    out->mean = (struct vol_figure){s->x.sum / n, sd / n};
    out->light = (struct vol_figure){V * s->x.sum, V * sd};
    out->height = (struct vol_figure){height_of(s, NULL, 0), out->modes ? sqrt(height) : NAN};
    out->volume =
        (struct vol_figure){V * (double)s->x.above[0], out->modes ? V * sqrt(volume) : NAN};
    out->most = (struct vol_figure){s->most, out->bars ? sqrt(s->most_var) : NAN};
}

pvx_err vol_measure(const struct vol_volume *v, const struct vol_measure_how *how,
                    struct vol_measured *out, struct pvx_diag *d)
{
    const struct pvp_grid *g = &v->v.grid;
    const struct vol_bars *b = &v->bars;
    uint32_t modes = b->sd != NULL ? b->n_modes : 0;
    struct measuring s = {
        .v = v, .how = how, .m = vol_region_cells(g, &how->region), .channels = g->channels};
    if (how->channel >= (int)g->channels)
        return pvx_fail(d, PVX_EINVAL, "the volumes have %u channel%s: there is no channel %d",
                        g->channels, g->channels == 1 ? "" : "s", how->channel + 1);
    *out = (struct vol_measured){.voxels = vol_cells_count(&s.m),
                                 .bars = b->sd != NULL,
                                 .modes = modes > 0,
                                 .doubt = b->doubt};
    if (out->voxels == 0)
        return vol_region_empty(g, d);
    double *layers = calloc((size_t)(modes + 1) * g->n[2], sizeof *layers);
    s.mode = calloc(modes > 0 ? modes : 1, sizeof *s.mode);
    if (layers == NULL || s.mode == NULL) {
        free(layers);
        free(s.mode);
        return pvx_fail(d, PVX_ENOMEM, "out of memory for the figures of a volume");
    }
    s.x.layer = layers;
    for (uint32_t k = 0; k < modes; k++)
        s.mode[k].layer = layers + (size_t)(k + 1) * g->n[2];
    measure_bricks(&s);
    measure_figures(&s, out);
    free(layers);
    free(s.mode);
    return PVX_OK;
}

const char *vol_figure_text(struct vol_figure f, char out[VOL_FIGURE_TEXT])
{
    bool bar = isfinite(f.sd) && f.sd > 0;
    double size = fmax(fabs(f.v), bar ? f.sd : 0);
    if (!isfinite(f.v)) {
        snprintf(out, VOL_FIGURE_TEXT, "-");
        return out;
    }
    if (!bar) {
        snprintf(out, VOL_FIGURE_TEXT, isfinite(f.sd) && f.v != 0 ? "%.4g \u00b1 0" : "%.4g", f.v);
        return out;
    }
    if (f.sd < 1e-6 * fabs(f.v)) { /* its digits would be those of rounding */
        snprintf(out, VOL_FIGURE_TEXT, "%.7g \u00b1 %.1g", f.v, f.sd);
        return out;
    }
    int ten = (int)floor(log10(size)), last = (int)floor(log10(f.sd)) - 1; /* place of a digit */
    if (ten >= -3 && ten < 5 && last > -8) {
        int decimals = last < 0 ? -last : 0;
        snprintf(out, VOL_FIGURE_TEXT, "%.*f \u00b1 %.*f", decimals, f.v, decimals, f.sd);
        return out;
    }
    double unit = pow(10, ten);
    int decimals = ten - last < 0 ? 0 : ten - last > 9 ? 9 : ten - last;
    snprintf(out, VOL_FIGURE_TEXT, "(%.*f \u00b1 %.*f)e%+03d", decimals, f.v / unit, decimals,
             f.sd / unit, ten);
    return out;
}
