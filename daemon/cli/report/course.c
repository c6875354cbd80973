#include "daemon/cli/report/course.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>

#include "base/file.h"
#include "base/mem.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/report/plot.h"
#include "daemon/volumes/bricks.h"

#define LEVEL 0.1 /* of the brightest voxel */

static const struct course_column volumes[COURSE_MOST] = {
    {"mean", "1/m", "per_m", "mean emission"},
    {"light", "m2", "m2", "light: emission times volume"},
    {"height", "m", "m", "height: 98 % of the light lies below"},
    {"volume", "m3", "m3", "volume above the level"},
    {"most", "1/m", "per_m", "brightest voxel"}};
static const struct course_column temperatures[COURSE_MOST] = {
    {"mean", "K", "K", "mean temperature, where there is one"},
    {"hottest", "K", "K", "hottest voxel"},
    {"soot", "ppm", "ppm", "mean volume fraction of soot, where there is a temperature"},
    {"soot_volume", "mm3", "mm3", "volume of all soot"},
    {"volume", "m3", "m3", "volume that has a temperature"}};

/* ---- reading ---- */

static bool course_wants(const struct course_how *how, const struct pvp_volume *v)
{
    return v->set >= (uint64_t)how->from && v->set <= (uint64_t)how->to;
}

/* The brightest voxel of all sets: the first half of the work. */
static pvx_err course_find_level(vol_reader *r, struct course_how *how, struct cli_progress *bar,
                                 struct pvx_diag *d)
{
    uint64_t n = vol_reader_count(r);
    double most = 0;
    how->measure.level = 0;
    for (uint64_t k = 0; k < n; k++) {
        struct vol_volume v;
        struct vol_measured m;
        PVX_TRY(vol_reader_get(r, k, &v, d));
        v.bars = (struct vol_bars){0};
        if (course_wants(how, &v.v)) {
            PVX_TRY(vol_measure(&v, &how->measure, &m, d));
            most = fmax(most, m.most.v);
        }
        if (!cli_progress(bar, 0.5 * (double)(k + 1) / (double)n))
            return PVX_ECANCELED;
    }
    how->measure.level = LEVEL * most;
    return PVX_OK;
}

/* What all recordings have in common. */
static void course_time(struct course *c, struct course_row *row)
{
    row->time = (double)(row->v.t_exposure_ns - c->row[0].v.t_exposure_ns) * 1e-9;
    c->timed = c->timed || row->v.t_exposure_ns != 0;
    c->with_bars += row->bars;
    c->with_modes += row->modes;
    c->doubted += row->bars && row->doubt != 0;
    c->doubt |= row->bars ? row->doubt : 0;
}

static void course_add(struct course *c, uint64_t place, const struct pvp_volume *v,
                       const struct vol_measured *m)
{
    struct course_row *row = &c->row[c->n++];
    *row = (struct course_row){
        .place = place, .v = *v, .bars = m->bars, .modes = m->modes, .doubt = m->doubt};
    row->figure[COURSE_MEAN] = m->mean;
    row->figure[COURSE_LIGHT] = m->light;
    row->figure[COURSE_HEIGHT] = m->height;
    row->figure[COURSE_VOLUME] = m->volume;
    row->figure[COURSE_BRIGHTEST] = m->most;
    course_time(c, row);
}

/* After the last set. */
static pvx_err course_done(struct course *c, const char *name, uint64_t n, struct pvx_diag *d)
{
    for (size_t i = 0; i < c->n && !c->timed; i++)
        c->row[i].time = NAN;
    return c->n > 0 ? PVX_OK
                    : pvx_fail(d, PVX_ENOENT,
                               "%s: none of its %" PRIu64 " sets is from --from to --to", name, n);
}

pvx_err course_read(vol_reader *r, const char *name, const struct course_how *how,
                    struct course *out, struct pvx_diag *d)
{
    struct cli_progress bar = {.label = "measuring", .quiet = how->quiet};
    uint64_t n = vol_reader_count(r);
    *out = (struct course){.how = *how, .column = volumes, .figures = COURSE_MOST};
    double before = isnan(how->measure.level) ? 0.5 : 0;
    vol_reader_modes(r, false);
    if (before > 0)
        PVX_TRY(course_find_level(r, &out->how, &bar, d));
    vol_reader_modes(r, true);
    out->row = pvx_calloc(n + 1, sizeof *out->row);
    PVX_NEED(out->row);
    for (uint64_t k = 0; k < n; k++) {
        struct vol_volume v;
        struct vol_measured m;
        PVX_TRY(vol_reader_get(r, k, &v, d));
        if (course_wants(how, &v.v)) {
            PVX_TRY(vol_measure(&v, &out->how.measure, &m, d));
            course_add(out, k, &v.v, &m);
        }
        if (!cli_progress(&bar, before + (1 - before) * (double)(k + 1) / (double)n))
            return PVX_ECANCELED;
    }
    return course_done(out, name, n, d);
}

/* Sums of a set of temperatures. */
static void course_heat(const struct vol_thermal_set *t, const struct vol_cells *m,
                        struct course_row *row)
{
    const struct pvp_grid *g = m->g;
    double kelvin = 0, soot = 0, V = 1, n = 0;
    struct vol_figure hot = {NAN, NAN};
    uint32_t at[3];
    size_t q = 0, known = 0;
    for (int a = 0; a < 3; a++)
        V *= m->h[a];
    for (at[2] = 0; at[2] < g->n[2]; at[2]++)
        for (at[1] = 0; at[1] < g->n[1]; at[1]++)
            for (at[0] = 0; at[0] < g->n[0]; at[0]++, q++) {
                double T = (double)t->value[VOL_KELVIN][q], f = (double)t->value[VOL_SOOT][q];
                if (isnan(T) || !vol_cells_in(m, at))
                    continue;
                n++;
                kelvin += T;
                soot += isfinite(f) ? f : 0;
                known += isfinite(f);
                if (!(T <= hot.v))
                    hot = (struct vol_figure){T, (double)t->value[VOL_KELVIN_SD][q]};
            }
    bool one = n == 1;
    row->figure[COURSE_KELVIN] = (struct vol_figure){n > 0 ? kelvin / n : NAN, one ? hot.sd : NAN};
    row->figure[COURSE_HOTTEST] = hot;
    row->figure[COURSE_SOOT] = (struct vol_figure){known > 0 ? soot / (double)known : NAN, NAN};
    row->figure[COURSE_SOOT_VOLUME] = (struct vol_figure){known > 0 ? soot * V * 1e3 : NAN, NAN};
    row->figure[COURSE_SOOTY] = (struct vol_figure){n * V, NAN};
}

/* Square of the deviation of each voxel of m that has a number; -1: it is not in the sum. */
static void course_own(const struct vol_thermal_set *t, int field, const struct vol_cells *m,
                       double *own)
{
    const uint32_t *n = m->g->n;
    for (size_t q = 0, voxels = pvp_grid_count(m->g); q < voxels; q++) {
        const uint32_t at[3] = {(uint32_t)(q % n[0]), (uint32_t)(q / n[0] % n[1]),
                                (uint32_t)(q / n[0] / n[1])};
        bool in =
            !isnan(t->value[field][q]) && !isnan(t->value[VOL_KELVIN][q]) && vol_cells_in(m, at);
        own[q] = in ? pow((double)t->value[field + 1][q], 2) : -1;
    }
}

/* Set k of r, and a region of it. */
struct course_hot {
    vol_thermal_reader *r;
    uint64_t k;
    const struct vol_thermal_set *t;
    const struct vol_cells *m;
    double *own; /* [voxels] work space */
};

/* Variance of the sum of a field over the region: sum_k (sum_q d_kq)^2 + sum_q t_q^2 (volumes.h). */
static pvx_err course_sum_bar(const struct course_hot *h, int field, double *var,
                              struct pvx_diag *d)
{
    const size_t voxels = pvp_grid_count(h->m->g);
    const float *mode;
    double *own = h->own;
    *var = 0;
    course_own(h->t, field, h->m, own);
    for (uint32_t i = 0; i < h->t->n_modes; i++) {
        double sum = 0;
        PVX_TRY(vol_thermal_mode(h->r, h->k, field, i, &mode, d));
        for (size_t q = 0; q < voxels; q++)
            if (own[q] >= 0) {
                sum += (double)mode[q];
                own[q] = fmax(own[q] - (double)mode[q] * (double)mode[q], 0);
            }
        *var += sum * sum;
    }
    for (size_t q = 0; q < voxels; q++)
        *var += own[q] >= 0 ? own[q] : 0;
    return PVX_OK;
}

/* Bars of the means, where the file knows how errors go together. */
static pvx_err course_heat_bars(vol_thermal_reader *r, uint64_t k, const struct vol_thermal_set *t,
                                const struct vol_cells *m, struct course_row *row,
                                struct pvx_diag *d)
{
    const double V = m->h[0] * m->h[1] * m->h[2];
    struct vol_figure *f = row->figure;
    double var;
    row->modes = t->n_modes > 0;
    if (!row->modes || !(f[COURSE_SOOTY].v > 0))
        return PVX_OK;
    double *own = pvx_calloc(pvp_grid_count(m->g), sizeof *own);
    PVX_NEED(own);
    const struct course_hot hot = {r, k, t, m, own};
    pvx_err e = course_sum_bar(&hot, VOL_KELVIN, &var, d);
    f[COURSE_KELVIN].sd = sqrt(var) / (f[COURSE_SOOTY].v / V);
    if (e == PVX_OK && isfinite(f[COURSE_SOOT].v)) {
        e = course_sum_bar(&hot, VOL_SOOT, &var, d);
        f[COURSE_SOOT].sd = sqrt(var) * f[COURSE_SOOT].v / (f[COURSE_SOOT_VOLUME].v / V / 1e3);
        f[COURSE_SOOT_VOLUME].sd = sqrt(var) * V * 1e3;
    }
    free(own);
    return e;
}

pvx_err course_read_thermal(vol_thermal_reader *r, const char *name, const struct course_how *how,
                            struct course *out, struct pvx_diag *d)
{
    struct cli_progress bar = {.label = "measuring", .quiet = how->quiet};
    uint64_t n = vol_thermal_count(r);
    const struct pvp_grid *g = vol_thermal_grid(r);
    *out = (struct course){.how = *how, .column = temperatures, .figures = COURSE_MOST};
    out->how.measure.level = NAN;
    const struct vol_cells m = vol_region_cells(g, &how->measure.region);
    if (vol_cells_count(&m) == 0)
        return vol_region_empty(g, d);
    out->row = pvx_calloc(n + 1, sizeof *out->row);
    PVX_NEED(out->row);
    for (uint64_t k = 0; k < n; k++) {
        struct vol_thermal_set t;
        PVX_TRY(vol_thermal_get(r, k, &t, d));
        const struct pvp_volume v = {.set = t.number, .t_exposure_ns = t.t_exposure_ns};
        if (course_wants(how, &v)) {
            struct course_row *row = &out->row[out->n++];
            *row = (struct course_row){.place = k, .v = v, .bars = true};
            course_heat(&t, &m, row);
            PVX_TRY(course_heat_bars(r, k, &t, &m, row, d));
            course_time(out, row);
        }
        if (!cli_progress(&bar, (double)(k + 1) / (double)n))
            return PVX_ECANCELED;
    }
    return course_done(out, name, n, d);
}

/* A volume in kelvin as a set of temperatures; `value` has room for all of its voxels, each four times. */
static void course_dense(const struct vol_volume *v, float *value, struct vol_thermal_set *out)
{
    size_t n = pvp_grid_count(&v->v.grid);
    struct vol_volume sd = *v;
    *out = (struct vol_thermal_set){.number = v->v.set, .t_exposure_ns = v->v.t_exposure_ns};
    memset(value, 0, VOL_THERMAL_READ * n * sizeof *value);
    for (int k = 0; k < VOL_THERMAL_READ; k++)
        out->value[k] = value + (size_t)k * n;
    vol_to_dense(v, value + VOL_KELVIN * n);
    sd.brick = v->bars.sd;
    if (sd.brick != NULL)
        vol_to_dense(&sd, value + VOL_KELVIN_SD * n);
    for (size_t i = 0; i < n; i++) {
        bool known = value[VOL_KELVIN * n + i] > 0;
        value[VOL_KELVIN * n + i] = known ? value[VOL_KELVIN * n + i] : NAN;
        value[VOL_KELVIN_SD * n + i] = sd.brick != NULL ? value[VOL_KELVIN_SD * n + i] : NAN;
        value[VOL_SOOT * n + i] = value[VOL_SOOT_SD * n + i] = NAN;
    }
}

static pvx_err course_kelvin_sets(vol_reader *r, const struct vol_cells *m, float *value,
                                  struct course *out, struct pvx_diag *d)
{
    struct cli_progress bar = {.label = "measuring", .quiet = out->how.quiet};
    uint64_t n = vol_reader_count(r);
    for (uint64_t k = 0; k < n; k++) {
        struct vol_volume v;
        struct vol_thermal_set t;
        PVX_TRY(vol_reader_get(r, k, &v, d));
        if (course_wants(&out->how, &v.v)) {
            struct course_row *row = &out->row[out->n++];
            *row = (struct course_row){
                .place = k, .v = v.v, .bars = v.bars.sd != NULL, .doubt = v.bars.doubt};
            course_dense(&v, value, &t);
            course_heat(&t, m, row);
            course_time(out, row);
        }
        if (!cli_progress(&bar, (double)(k + 1) / (double)n))
            return PVX_ECANCELED;
    }
    return PVX_OK;
}

pvx_err course_read_kelvin(vol_reader *r, const char *name, const struct course_how *how,
                           struct course *out, struct pvx_diag *d)
{
    uint64_t n = vol_reader_count(r);
    const struct pvp_grid *g = &vol_reader_head(r)->start.grid;
    *out = (struct course){.how = *how, .column = temperatures, .figures = COURSE_MOST};
    out->how.measure.level = NAN;
    const struct vol_cells m = vol_region_cells(g, &how->measure.region);
    if (vol_cells_count(&m) == 0)
        return vol_region_empty(g, d);
    float *value = pvx_calloc(VOL_THERMAL_READ * pvp_grid_count(g), sizeof *value);
    out->row = pvx_calloc(n + 1, sizeof *out->row);
    pvx_err e = value != NULL && out->row != NULL ? PVX_OK : PVX_ENOMEM;
    PVX_THEN(e, course_kelvin_sets(r, &m, value, out, d));
    free(value);
    return e == PVX_OK ? course_done(out, name, n, d) : e;
}

void course_free(struct course *c)
{
    PVX_FREE(c->row);
    c->n = 0;
}

/* ---- text ---- */

/* Columns that a terminal shows: a plus-minus sign has two bytes. */
static void course_pad(FILE *f, const char *s, int width)
{
    for (const char *p = s; *p != '\0'; p++)
        width -= ((unsigned char)*p & 0xC0) != 0x80;
    fprintf(f, "  %s%*s", s, width > 0 ? width : 0, "");
}

void course_print(FILE *f, const struct course *c)
{
    char text[VOL_FIGURE_TEXT];
    fprintf(f, "%-8s%10s", "set", c->timed ? "time s" : "");
    for (int k = 0; k < c->figures; k++) {
        snprintf(text, sizeof text, "%s %s", c->column[k].name, c->column[k].unit);
        course_pad(f, text, 20);
    }
    fputs("\n", f);
    for (size_t i = 0; i < c->n; i++) {
        const struct course_row *row = &c->row[i];
        snprintf(text, sizeof text, "%.4f", row->time);
        fprintf(f, "%-8" PRIu64 "%10s", row->v.set, c->timed ? text : "");
        for (int k = 0; k < c->figures; k++)
            course_pad(f, vol_figure_text(row->figure[k], text), 20);
        fputs(row->bars && row->doubt != 0 ? "  bars in doubt\n" : "\n", f);
    }
}

/* ---- CSV ---- */

static void course_number(FILE *f, double v)
{
    if (isfinite(v))
        fprintf(f, ",%.9g", v);
    else
        fputs(",", f);
}

pvx_err course_csv(const struct course *c, const char *path, struct pvx_diag *d)
{
    char *text = NULL;
    size_t len;
    FILE *f = open_memstream(&text, &len);
    if (f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path);
    fputs("set,t_exposure_ns,time_s", f);
    for (int k = 0; k < c->figures; k++)
        fprintf(f, ",%s_%s,%s_sd", c->column[k].name, c->column[k].per, c->column[k].name);
    fputs(",level_per_m,doubt\n", f);
    for (size_t i = 0; i < c->n; i++) {
        const struct course_row *row = &c->row[i];
        fprintf(f, "%" PRIu64 ",%" PRId64, row->v.set, row->v.t_exposure_ns);
        course_number(f, row->time);
        for (int k = 0; k < c->figures; k++) {
            struct vol_figure v = row->figure[k];
            course_number(f, v.v);
            course_number(f, v.sd);
        }
        course_number(f, c->how.measure.level);
        fputs(",", f);
        for (unsigned b = 0, first = 1; b < 32; b++)
            if (row->bars && (row->doubt >> b & 1) != 0) {
                fprintf(f, "%s%s", first ? "" : " ",
                        pvp_doubt_name(b) != NULL ? pvp_doubt_name(b) : "unknown");
                first = 0;
            }
        fputs("\n", f);
    }
    pvx_err e = fclose(f) == 0 ? pvx_file_write(path, text, len, d)
                               : pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path);
    free(text);
    return e;
}

/* ---- plots ---- */

/* One figure over time. */
static pvx_err course_draw(FILE *f, const struct course *c, int k,
                           void (*draw)(FILE *f, const struct plot *p))
{
    double *v = pvx_calloc(3 * c->n + 1, sizeof *v);
    char y[80];
    bool bars = false;
    PVX_NEED(v);
    for (size_t i = 0; i < c->n; i++) {
        struct vol_figure g = c->row[i].figure[k];
        v[i] = c->timed ? c->row[i].time : (double)c->row[i].v.set;
        v[c->n + i] = g.v;
        v[2 * c->n + i] = isfinite(g.sd) ? g.sd : 0;
        bars = bars || isfinite(g.sd);
    }
    snprintf(y, sizeof y, "%s, %s", c->column[k].name, c->column[k].unit);
    const struct plot_series s = {.name = bars ? "value, one sigma" : "value",
                                  .colour = "#1f6fb2",
                                  .n = c->n,
                                  .x = v,
                                  .y = v + c->n,
                                  .spread = bars ? v + 2 * c->n : NULL,
                                  .points = c->n == 1};
    draw(f,
         &(struct plot){
             .x = c->timed ? "time, s" : "set", .y = y, .fine_x = c->timed, .series = &s, .n = 1});
    free(v);
    return PVX_OK;
}

pvx_err course_svg(FILE *f, const struct course *c, int k)
{
    return course_draw(f, c, k, plot_svg);
}

pvx_err course_plot(const struct course *c, const char *path, struct pvx_diag *d)
{
    const double wide = PLOT_WIDTH + 20, high = PLOT_HEIGHT;
    char *text = NULL;
    size_t len;
    pvx_err e = PVX_OK;
    FILE *f = open_memstream(&text, &len);
    if (f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path);
    fprintf(f,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" width=\"%.0f\" "
            "height=\"%.0f\" font-family=\"sans-serif\"><rect width=\"100%%\" height=\"100%%\" "
            "fill=\"#fff\"/>\n",
            wide, high * c->figures, wide, high * c->figures);
    for (int k = 0; k < c->figures && e == PVX_OK; k++) {
        fprintf(f, "<g transform=\"translate(0 %.0f)\">", k * high);
        e = course_draw(f, c, k, plot_inside);
        fputs("</g>\n", f);
    }
    fputs("</svg>\n", f);
    if (fclose(f) != 0)
        e = PVX_ENOMEM;
    e = e == PVX_OK ? pvx_file_write(path, text, len, d)
                    : pvx_fail(d, e, "%s: out of memory", path);
    free(text);
    return e;
}
