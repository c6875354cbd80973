#include "daemon/cli/experiment/report.h"

#include <math.h>
#include <stdlib.h>

#include "base/file.h"
#include "base/mem.h"
#include "daemon/cli/report/html.h"
#include "daemon/cli/report/plot.h"

#define CHANNELS 3
static const char *const colours[2][CHANNELS] = {{"#c0272d", "#1d7a46", "#1f6fb2"},
                                                 {"#5b6670", "", ""}};
static const char *const names[2][CHANNELS] = {{"red", "green", "blue"}, {"grey", "", ""}};
static const char *const rims[2][CHANNELS] = {
    {"red, with the rim", "green, with the rim", "blue, with the rim"},
    {"grey, with the rim", "", ""}};
static const char *const shades[] = {"#1d7a46", "#7a4fb0", "#c0272d", "#a86200", "#1f6fb2"};

struct page {
    FILE *f;
    const struct experiment *x;
    struct experiment_finding finding[EXPERIMENT_FINDINGS];
};

/* ---- pieces ---- */

static const char *const holds[] = {"nothing to measure", "does not hold here", "holds here"};
static const char *const class[] = {"", "bad", "good"};

static void section(const struct page *p, int k, const char *title)
{
    const struct experiment_finding *v = &p->finding[k];
    fprintf(p->f, "<h2>%s</h2>\n<p><b>Paper:</b> ", title);
    html_text(p->f, v->paper);
    fprintf(p->f, " <b>Here:</b> ");
    html_text(p->f, v->here);
    if (v->holds >= 0)
        fprintf(p->f, " <b>It %s.</b>", holds[v->holds + 1]);
    fputs("</p>\n", p->f);
}

static pvx_err picture(const struct page *p, const char *name, const char *caption,
                       struct pvx_diag *d)
{
    return html_picture(p->f, p->x->o->out, name, caption, d);
}

static void figure_of(const struct page *p, const struct plot *plot, const char *caption)
{
    fputs("<figure>", p->f);
    plot_svg(p->f, plot);
    fprintf(p->f, "<figcaption>%s</figcaption></figure>\n", caption);
}

/* ---- plots ---- */

/* A plot of the means of each channel over at[n], from units with keys "PREFIX:at:". */
struct curve {
    const char *prefix, *x, *caption;
    const int *at;
    size_t n;
    bool both;
};

static void curves(const struct page *p, const struct curve *c)
{
    enum {
        MOST = EXPERIMENT_GRIDS > EXPERIMENT_VIEWS_MAX ? EXPERIMENT_GRIDS : EXPERIMENT_VIEWS_MAX
    };
    double x[MOST], y[2 * CHANNELS][MOST], spread[CHANNELS][MOST];
    struct plot_series s[2 * CHANNELS];
    size_t nch = p->x->in.nch == 1 ? 1 : CHANNELS, set = p->x->in.nch == 1;
    for (size_t i = 0; i < c->n; i++) {
        char key[64];
        snprintf(key, sizeof key, "%s:%d:", c->prefix, c->at[i]);
        struct experiment_mean m = experiment_mean_of(p->x, key);
        x[i] = c->at[i];
        for (size_t k = 0; k < nch; k++) {
            y[k][i] = m.mean[EXPERIMENT_INSIDE + k];
            y[nch + k][i] = m.mean[EXPERIMENT_ALL + k];
            spread[k][i] = m.spread[EXPERIMENT_INSIDE + k];
        }
    }
    for (size_t k = 0; k < 2 * nch; k++)
        s[k] = (struct plot_series){.name = k < nch ? names[set][k] : rims[set][k - nch],
                                    .colour = colours[set][k % nch],
                                    .n = c->n,
                                    .x = x,
                                    .y = y[k],
                                    .spread = k < nch ? spread[k] : NULL,
                                    .dashed = k >= nch};
    figure_of(
        p,
        &(struct plot){
            .x = c->x, .y = "mean difference, 0 to 255", .series = s, .n = c->both ? 2 * nch : nch},
        c->caption);
}

static pvx_err experiment_by_frame(const struct page *p)
{
    const struct experiment *x = p->x;
    size_t n = x->sets, grids = (size_t)x->o->n_grids;
    struct plot_series s[EXPERIMENT_GRIDS];
    char name[EXPERIMENT_GRIDS][24];
    double *v = pvx_calloc((grids + 1) * n, sizeof *v);
    PVX_NEED(v);
    for (size_t g = 0; g < grids; g++) {
        for (size_t i = 0; i < n; i++) {
            const double *u = experiment_grid(x, (int)g, i);
            v[i] = (double)x->in.number[x->set[i]];
            v[(g + 1) * n + i] =
                u != NULL && u[EXPERIMENT_VOXELS] > 0 ? experiment_over_channels(x, u) : NAN;
        }
        snprintf(name[g], sizeof name[g], "%d voxels", x->o->grids[g]);
        s[g] = (struct plot_series){.name = name[g],
                                    .colour = shades[g % (sizeof shades / sizeof *shades)],
                                    .n = n,
                                    .x = v,
                                    .y = v + (g + 1) * n};
    }
    figure_of(
        p, &(struct plot){.x = "frame", .y = "mean difference, 0 to 255", .series = s, .n = grids},
        "Mean over the channels, in the model's silhouette. Numbers: fig5.csv.");
    free(v);
    return PVX_OK;
}

/* Error over ms. */
static void solver_cell(const struct page *p, const char *name, enum rec_basis basis,
                        int32_t voxels)
{
    const double *v = experiment_solver(p->x, name, basis, voxels);
    html_cell(p->f, v != NULL ? experiment_over_channels(p->x, v) : NAN, 2);
    html_cell(p->f, v != NULL ? v[EXPERIMENT_MS] : NAN, 1);
}

static void solver_table(const struct page *p, enum rec_basis basis)
{
    int32_t voxels[EXPERIMENT_GRIDS + 1];
    size_t n = experiment_solver_grids(p->x, voxels);
    fprintf(p->f, "<div class=\"wide\"><table class=\"small\"><tr><th>%s</th>",
            rec_basis_name(basis));
    for (size_t g = 0; g < n; g++)
        fprintf(p->f, "<th>%d</th><th>ms</th>", voxels[g]);
    fputs("</tr>\n", p->f);
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        fprintf(p->f, "<tr><td>%s</td>", *name);
        for (size_t g = 0; g < n; g++)
            solver_cell(p, *name, basis, voxels[g]);
        fputs("</tr>\n", p->f);
    }
    fputs("</table></div>\n", p->f);
}

/* Error over time, n points. */
static void against_time(const struct page *p, const struct plot_series *s, size_t n,
                         const char *caption)
{
    figure_of(p,
              &(struct plot){.x = "hull and solution, ms",
                             .y = "mean difference, 0 to 255",
                             .log_x = true,
                             .series = s,
                             .n = n},
              caption);
}

static void point_of(const struct page *p, const char *name, enum rec_basis basis, int32_t voxels,
                     double *ms, double *error)
{
    const double *v = experiment_solver(p->x, name, basis, voxels);
    bool there = v != NULL && v[EXPERIMENT_MS] > 0;
    *ms = there ? v[EXPERIMENT_MS] : 1;
    *error = there ? experiment_over_channels(p->x, v) : NAN;
}

static const char *const basis_colours[] = {[REC_BOX] = "#a86200", [REC_TRILINEAR] = "#1f6fb2"};

static void experiment_by_solver(const struct page *p)
{
    enum { MOST = 32 };
    const char *const *label = rec_solver_names();
    double ms[2][MOST], error[2][MOST];
    struct plot_series s[2];
    size_t n = 0;
    while (label[n] != NULL && n < MOST)
        n++;
    for (size_t b = 0; b < 2; b++) {
        enum rec_basis basis = b == 0 ? REC_BOX : REC_TRILINEAR;
        for (size_t i = 0; i < n; i++)
            point_of(p, label[i], basis, p->x->o->grid, &ms[b][i], &error[b][i]);
        s[b] = (struct plot_series){.name = rec_basis_name(basis),
                                    .colour = basis_colours[basis],
                                    .n = n,
                                    .x = ms[b],
                                    .y = error[b],
                                    .label = label,
                                    .points = true};
    }
    against_time(p, s, 2,
                 "One frame and grid, mean over the channels; the least of three times. Numbers: "
                 "solvers.csv.");
}

/* The default and the paper's solver, from grid to grid. */
static void by_size(const struct page *p)
{
    enum { MOST = EXPERIMENT_GRIDS + 1 };
    const char *const name[2] = {rec_solver_names()[0], "cgls-paper"};
    int32_t voxels[MOST];
    size_t n = experiment_solver_grids(p->x, voxels);
    double ms[4][MOST], error[4][MOST];
    char label[MOST][12], title[4][48];
    const char *labels[MOST];
    struct plot_series s[4];
    for (size_t g = 0; g < n; g++) {
        snprintf(label[g], sizeof label[g], "%d", voxels[g]);
        labels[g] = label[g];
    }
    for (size_t i = 0; i < 4; i++) {
        enum rec_basis basis = i / 2 == 0 ? REC_BOX : REC_TRILINEAR;
        for (size_t g = 0; g < n; g++)
            point_of(p, name[i % 2], basis, voxels[g], &ms[i][g], &error[i][g]);
        snprintf(title[i], sizeof title[i], "%s, %s", i % 2 == 0 ? name[0] : "paper",
                 rec_basis_name(basis));
        s[i] = (struct plot_series){.name = title[i],
                                    .colour = basis_colours[basis],
                                    .n = n,
                                    .x = ms[i],
                                    .y = error[i],
                                    .label = labels,
                                    .dashed = i % 2 != 0};
    }
    against_time(p, s, 4, "The default and the paper's solver, by voxels along the longest side.");
}

/* ---- the page ---- */

static void experiment_head(const struct page *p)
{
    const struct experiment *x = p->x;
    html_begin(p->f, "Experiment", "td:last-child{white-space:nowrap}");
    fputs("<h1>The paper's experiments on <code>", p->f);
    html_text(p->f, x->o->frames);
    fputs("</code></h1>\n<p>", p->f);
    fprintf(p->f,
            "%zu cameras, %zu frames of %zu, bins of %d pixels, %s basis. Reconstructed without "
            "camera <b>",
            x->rig.n_cameras, x->sets, x->in.n, x->matrix.binning,
            rec_basis_name(x->rig.grid.basis));
    html_text(p->f, x->rig.cameras[x->unused].name);
    fprintf(
        p->f,
        "</b>, compared with what it saw; experiments on one frame: frame %lld, %d voxels along "
        "the longest side. Differences are means of |picture - model|, full scale 255, over "
        "the bins in which the model shows light.</p>\n",
        (long long)x->in.number[x->set[x->one]], x->o->grid);
}

static void summary(const struct page *p)
{
    fputs("<div class=\"wide\"><table><tr><th>Figure</th><th>The paper found</th><th>Here</th>"
          "<th></th></tr>\n",
          p->f);
    for (int i = 0; i < EXPERIMENT_FINDINGS; i++) {
        const struct experiment_finding *v = &p->finding[i];
        const char *const cell[] = {v->figure, v->paper, v->here};
        fputs("<tr>", p->f);
        for (int k = 0; k < 3; k++) {
            fputs("<td>", p->f);
            html_text(p->f, cell[k]);
            fputs("</td>", p->f);
        }
        fprintf(p->f, "<td class=\"%s\">%s</td></tr>\n", class[v->holds + 1],
                v -> holds < 0 ? "" : holds[v->holds + 1]);
    }
    fputs("</table></div>\n", p->f);
}

static pvx_err experiment_report_pictures(const struct page *p, struct pvx_diag *d)
{
    section(p, FINDING_HULL, "Figure 3: the visual hull");
    PVX_TRY(picture(p, "fig3-without.png", "Without hull, five views over 90 degrees.", d));
    PVX_TRY(picture(p, "fig3.png", "With it, the same exposure.", d));
    section(p, FINDING_COUNTS, "Figure 4: coefficients");
    PVX_TRY(picture(p, "fig4.png", "Inside red, partly inside green, outside yellow.", d));
    section(p, FINDING_VIEW, "Figure 7: the unused view");
    PVX_TRY(picture(p, "fig7.png", "Original, reconstruction, difference; one exposure.", d));
    section(p, FINDING_FLAMES, "Figure 8: flames from five sides");
    PVX_TRY(picture(p, "fig8.png", "Five views over 120 degrees.", d));
    return picture(p, "fig8-other.png", "Another frame.", d);
}

static pvx_err body(const struct page *p, struct pvx_diag *d)
{
    int views[EXPERIMENT_VIEWS_MAX];
    size_t n = 0;
    for (size_t v = EXPERIMENT_VIEWS_MIN; v <= experiment_views_max(p->x); v++)
        views[n++] = (int)v;
    experiment_head(p);
    summary(p);
    section(p, FINDING_FRAMES, "Figure 5: error by frame");
    if (experiment_by_frame(p) != PVX_OK)
        return pvx_fail(d, PVX_ENOMEM, "out of memory for a figure");
    section(p, FINDING_VIEWS, "Figure 6a: error by number of views");
    curves(p, &(struct curve){.prefix = "views",
                              .x = "views used",
                              .caption = "Mean over the choices of views, and their standard "
                                         "deviation. Numbers: fig6a.csv.",
                              .at = views,
                              .n = n});
    section(p, FINDING_GRIDS, "Figure 6b: error by grid");
    curves(p, &(struct curve){.prefix = "grid",
                              .x = "voxels along the longest side",
                              .caption =
                                  "Mean over the frames and standard deviation; dashed: with the "
                                  "pixels that only the picture's silhouette has. Numbers: "
                                  "fig6b.csv.",
                              .at = p->x->o->grids,
                              .n = (size_t)p->x->o->n_grids,
                              .both = true});
    section(p, FINDING_RIM, "Section 6.2: beside the silhouette");
    section(p, FINDING_SOLVERS, "Error against time");
    experiment_by_solver(p);
    by_size(p);
    solver_table(p, REC_BOX);
    solver_table(p, REC_TRILINEAR);
    PVX_TRY(experiment_report_pictures(p, d));
    fputs("</body></html>\n", p->f);
    return PVX_OK;
}

pvx_err experiment_report(const struct experiment *x, struct pvx_diag *d)
{
    struct page p = {.x = x};
    char path[4300], *text = NULL;
    size_t len;
    snprintf(path, sizeof path, "%s/report.html", x->o->out);
    p.f = open_memstream(&text, &len);
    if (p.f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path);
    experiment_findings(x, p.finding);
    pvx_err e = body(&p, d);
    if (fclose(p.f) != 0 && e == PVX_OK)
        e = pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path);
    PVX_THEN(e, pvx_file_write(path, text, len, d));
    free(text);
    return e;
}
