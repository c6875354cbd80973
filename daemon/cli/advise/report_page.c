/* report_page.c - the page of `pyrovox report`. */
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/cpu.h"
#include "base/file.h"
#include "base/mem.h"
#include "daemon/cli/advise/report.h"
#include "daemon/cli/report/html.h"
#include "recon/calib/calib.h"
#include "recon/solve/params.h"

/* How the configuration of an offline recording begins (daemon/VOLUMES.md). */
#define RECONSTRUCTED "# options of pyrovox reconstruct"

static void page_row(FILE *f, const char *name, const char *text)
{
    fputs("<tr><th>", f);
    html_text(f, name);
    fputs("</th><td class=\"any\">", f);
    html_text(f, text);
    fputs("</td></tr>\n", f);
}

#define PAGE_ROW(f, name, ...)                      \
    do {                                            \
        char text_[600];                            \
        snprintf(text_, sizeof text_, __VA_ARGS__); \
        page_row(f, name, text_);                   \
    } while (0)

static void page_said(FILE *f, const char *text)
{
    fputs("<p class=\"mute\">", f);
    html_text(f, text);
    fputs("</p>\n", f);
}

/* ---- setup ---- */

#define DATES_FROM \
    946684800 /* 2000-01-01: earlier ones are the time since a film's or a camera's start */

static void page_when(int64_t t_ns, char out[64])
{
    time_t s = (time_t)(t_ns / 1000000000);
    struct tm tm;
    if (s < DATES_FROM || gmtime_r(&s, &tm) == NULL ||
        strftime(out, 64, "%Y-%m-%d %H:%M:%S UTC", &tm) == 0)
        snprintf(out, 64, "not known");
}

static void page_setup(FILE *f, const struct report *r)
{
    const struct pvp_start *s = &r->head->start;
    const struct pvp_grid *g = &s->grid;
    char when[64];
    page_when(r->course.row[0].v.t_exposure_ns, when);
    fputs("<h2>Setup</h2>\n<div class=\"wide\"><table class=\"small\">\n", f);
    page_row(f, "first exposure", when);
    page_row(f, "made by", s->software[0] != '\0' ? s->software : "not known");
    PAGE_ROW(f, "session", "%016" PRIx64, s->session);
    PAGE_ROW(f, "volume", "%g to %g, %g to %g, %g to %g m (x, y, z)", g->min[0], g->max[0],
             g->min[1], g->max[1], g->min[2], g->max[2]);
    PAGE_ROW(f, "voxels", "%u x %u x %u of %.3g x %.3g x %.3g mm, %s basis", g->n[0], g->n[1],
             g->n[2], 1000 * (g->max[0] - g->min[0]) / g->n[0],
             1000 * (g->max[1] - g->min[1]) / g->n[1], 1000 * (g->max[2] - g->min[2]) / g->n[2],
             g->basis == 1 ? "trilinear" : "box");
    PAGE_ROW(f, "channels", "%s", g->channels == 1 ? "one" : "red, green, blue");
    PAGE_ROW(f, "unit", "%s: linear pixel value (1 is full scale) per metre", s->units);
    fputs("</table></div>\n", f);
}

/* Millimetres of the volume's middle that a pixel covers. */
static double page_pixel(const struct report *r, const struct rec_camera *k, double *distance)
{
    const struct pvp_grid *g = &r->head->start.grid;
    double eye[3], d2 = 0;
    rec_camera_centre(k, eye);
    for (int a = 0; a < 3; a++)
        d2 += pow((g->min[a] + g->max[a]) / 2 - eye[a], 2);
    *distance = sqrt(d2);
    if (k->model == REC_TELECENTRIC)
        return k->fx > 0 ? 1000 / k->fx : (double)NAN;
    return k->model == REC_RAYS || !(k->fx > 0) ? (double)NAN : 1000 * *distance / k->fx;
}

static void page_cameras(FILE *f, const struct report *r)
{
    size_t none = 0;
    fputs("<h2>Cameras and calibration</h2>\n<div class=\"wide\"><table><tr><th>camera</th>"
          "<th class=\"n\">pixels</th><th class=\"n\">distance, m</th>"
          "<th class=\"n\">mm a pixel</th><th class=\"n\">error, px</th>"
          "<th class=\"n\">voxels</th><th></th><th>photometry</th></tr>\n",
          f);
    for (size_t c = 0; c < r->rig.n_cameras; c++) {
        const struct rec_camera *k = &r->rig.cameras[c];
        const struct rec_uncertainty *u = &k->uncertainty;
        const struct rec_photometry *p = &k->photometry;
        bool known = u->px > 0;
        double distance, pixel = page_pixel(r, k, &distance);
        none += !known;
        fputs("<tr><td>", f);
        html_text(f, k->name);
        fprintf(f, "</td><td class=\"n\">%d x %d</td>", k->width, k->height);
        html_cell(f, distance, 3);
        html_cell(f, pixel, 3);
        html_cell(f, known ? u->px : (double)NAN, 3);
        html_cell(f, known ? u->voxels : (double)NAN, 3);
        fprintf(f, "<td>%s</td><td>%s%s%s%s%s</td></tr>\n", known ? rec_calib_verdict(u) : "",
                p->n_response > 0 ? "response " : "", p->dark.file[0] != '\0' ? "dark " : "",
                p->flat.file[0] != '\0' ? "flat " : "", p->has_matrix ? "colour " : "",
                p->has_noise ? "noise" : "");
    }
    fputs("</table></div>\n", f);
    if (r->head->start.rig_hash == 0 && (r->head->rig == NULL || r->head->rig[0] == '\0'))
        page_said(f,
                  "The recording does not say which rig made it. This is the one that was given.");
    if (none > 0)
        page_said(f, "A dash: the rig does not say what error its calibration has. `pyrovox "
                     "calibrate solve` writes it.");
}

/* ---- rates and losses ---- */

static int page_ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Median and 95th percentile of one number of all rows; NAN of none. */
static void page_spread(const struct course *c, double (*of)(const struct pvp_volume *v),
                        double *room, double out[2])
{
    size_t n = 0;
    for (size_t i = 0; i < c->n; i++) {
        double v = of(&c->row[i].v);
        if (isfinite(v))
            room[n++] = v;
    }
    qsort(room, n, sizeof *room, page_ascending);
    out[0] = n > 0 ? room[n / 2] : (double)NAN;
    out[1] = n > 0 ? room[(size_t)(0.95 * (double)(n - 1) + 0.5)] : (double)NAN;
}
static double page_latency(const struct pvp_volume *v)
{
    return v->latency_ns > 0 ? (double)v->latency_ns * 1e-6 : (double)NAN;
}
static double page_work(const struct pvp_volume *v)
{
    return v->report.total_ns > 0 ? (double)v->report.total_ns * 1e-6 : (double)NAN;
}
static double page_iterations(const struct pvp_volume *v)
{
    return v->report.iterations;
}
static double page_residual(const struct pvp_volume *v)
{
    return 100 * v->report.rel_residual;
}

static void page_losses(FILE *f, const struct report *r)
{
    uint64_t missing[VOL_GAPS] = {0}, ranges[VOL_GAPS] = {0};
    const struct vol_gap *g;
    bool any = false;
    for (uint64_t k = 0; (g = vol_reader_gap(r->volumes, k)) != NULL; k++) {
        missing[g->why] += g->volumes;
        ranges[g->why]++;
    }
    for (int w = 0; w < VOL_GAPS; w++)
        if (ranges[w] > 0) {
            PAGE_ROW(f, any ? "" : "sets without a volume",
                     "%s: %" PRIu64 " ranges of set numbers, at least %" PRIu64 " volumes",
                     vol_gap_names[w], ranges[w], missing[w]);
            any = true;
        }
    if (!any)
        page_row(f, "sets without a volume", "none is listed");
}

static void page_seen(FILE *f, const struct report *r)
{
    const struct course *c = &r->course;
    size_t whole = 0, printed = 0;
    char text[600] = "";
    bool known = false;
    for (size_t i = 0; i < c->n; i++) {
        whole += c->row[i].v.cameras_present == r->rig.n_cameras;
        known = known || c->row[i].v.camera_mask != 0;
    }
    PAGE_ROW(f, "sets with all cameras", "%zu of %zu", whole, c->n);
    for (size_t k = 0; k < r->rig.n_cameras && known; k++) {
        size_t in = 0;
        for (size_t i = 0; i < c->n; i++)
            in += c->row[i].v.camera_mask >> k & 1;
        if (in < c->n && strlen(text) < sizeof text - 100)
            snprintf(text + strlen(text), sizeof text - strlen(text), "%s%s in %zu",
                     printed++ > 0 ? ", " : "", r->rig.cameras[k].name, in);
    }
    if (printed > 0)
        page_row(f, "cameras not in all", text);
}

static pvx_err page_rates(FILE *f, const struct report *r)
{
    static const struct {
        const char *name, *unit;
        int decimals;
        double (*of)(const struct pvp_volume *v);
    } all[] = {{"latency, received to published", " ms", 1, page_latency},
               {"work of a set", " ms", 1, page_work},
               {"iterations", "", 0, page_iterations},
               {"residual of the pictures", " %", 2, page_residual}};
    const struct course *c = &r->course;
    double *room = pvx_calloc(c->n, sizeof *room), v[2], s = c->row[c->n - 1].time;
    size_t status[REC_EMPTY + 1] = {0};
    PVX_NEED(room);
    fputs("<h2>Rates and losses</h2>\n<div class=\"wide\"><table class=\"small\">\n", f);
    PAGE_ROW(f, "sets", "%zu, numbers %" PRIu64 " to %" PRIu64, c->n, c->row[0].v.set,
             c->row[c->n - 1].v.set);
    if (c->timed && s > 0)
        PAGE_ROW(f, "rate", "%.2f sets a second over %.3f s", (double)(c->n - 1) / s, s);
    else
        page_row(f, "rate", "the recording has no times");
    if (r->head->start.fps > 0)
        PAGE_ROW(f, "nominal rate", "%g sets a second", r->head->start.fps);
    page_seen(f, r);
    page_losses(f, r);
    for (size_t i = 0; i < c->n; i++)
        status[c->row[i].v.report.status <= REC_EMPTY ? c->row[i].v.report.status : REC_EMPTY]++;
    for (int k = 0; k <= REC_EMPTY; k++)
        if (status[k] > 0)
            PAGE_ROW(f, rec_status_name((enum rec_status)k), "%zu sets", status[k]);
    for (size_t k = 0; k < sizeof all / sizeof *all; k++) {
        page_spread(c, all[k].of, room, v);
        if (isfinite(v[0]))
            PAGE_ROW(f, all[k].name, "%.*f%s, 95 %% within %.*f%s", all[k].decimals, v[0],
                     all[k].unit, all[k].decimals, v[1], all[k].unit);
    }
    fputs("</table></div>\n", f);
    free(room);
    return PVX_OK;
}

/* ---- volumes ---- */

static const char *const page_slice_names[3] = {"across x: y to the right, z up",
                                                "across y: x to the right, z up",
                                                "across z: x to the right, y up"};

static pvx_err page_slices(FILE *f, const struct report *r, struct pvx_diag *d)
{
    fprintf(f,
            "<h2>One volume</h2>\n<p>Set %" PRIu64 ", three slices through its brightest voxel at "
            "%.3f, %.3f, %.3f m. White is %.4g 1/m.</p>\n<div class=\"slices\">\n",
            r->course.row[r->shown].v.set, r->at[0], r->at[1], r->at[2], r->white[0]);
    for (int b = 0; b < (r->white[1] > 0 ? 2 : 1); b++) {
        if (b == 1)
            fprintf(f,
                    "</div>\n<p>Its error bars, one standard deviation. White is %.4g "
                    "1/m.</p>\n<div class=\"slices\">\n",
                    r->white[1]);
        for (int a = 0; a < 3; a++) {
            char name[32];
            snprintf(name, sizeof name, "%s-%c.png", b == 0 ? "slice" : "bar", 'x' + a);
            PVX_TRY(html_picture(f, r->out, name, page_slice_names[a], d));
        }
    }
    fputs("</div>\n", f);
    return PVX_OK;
}

static void page_bars(FILE *f, const struct course *c)
{
    if (c->with_bars == 0)
        page_said(f,
                  "The recording has no error bars: `pyrovox reconstruct --error-bars` makes one "
                  "that has them.");
    else if (c->with_modes == 0)
        page_said(f, "The recording has error bars of single voxels alone, so sums have none.");
    for (unsigned b = 0; b < 32; b++)
        if ((c->doubt >> b & 1) != 0) {
            fputs("<p><b>Bars in doubt, they may be too small:</b> ", f);
            html_text(f, pvp_doubt_sentence(b) != NULL
                             ? pvp_doubt_sentence(b)
                             : "for a reason that this version does not know");
            fprintf(f, " (%zu of %zu sets have a doubt)</p>\n", c->doubted, c->n);
        }
}

static pvx_err page_plots(FILE *f, const struct course *c, int first)
{
    for (int k = first; k < c->figures; k++) {
        fputs("<figure>", f);
        PVX_TRY(course_svg(f, c, k));
        fputs("<figcaption>", f);
        html_text(f, c->column[k].says);
        fputs("</figcaption></figure>\n", f);
    }
    return PVX_OK;
}

static pvx_err page_course(FILE *f, const struct report *r)
{
    const struct course *c = &r->course;
    fprintf(f,
            "<h2>Course</h2>\n<p>Of the whole volume, the mean of the channels. Volume: of voxels "
            "above %.4g 1/m. Numbers: sets.csv.</p>\n",
            c->how.measure.level);
    page_bars(f, c);
    /* the mean is the light, in another unit */
    return page_plots(f, c, COURSE_LIGHT);
}

static pvx_err page_heat(FILE *f, const struct report *r)
{
    if (r->heat.n == 0)
        return PVX_OK;
    fputs("<h2>Temperature</h2>\n<p>Of the soot, from ", f);
    html_text(f, r->temperature);
    fprintf(f, ", %zu sets. Means are over the voxels that have a temperature.</p>\n", r->heat.n);
    return page_plots(f, &r->heat, 0);
}

/* ---- what the pictures say ---- */

static void page_views(FILE *f, const struct report *r)
{
    fputs("<h2>Left-out views</h2>\n", f);
    if (r->a.frames == NULL) {
        page_said(f, "They need the pictures: give --frames.");
        return;
    }
    if (r->rig.n_cameras < 4) {
        page_said(f, "They need four cameras: one is left out, and three make a volume.");
        return;
    }
    fprintf(
        f,
        "<p>The volume of all other cameras, seen by the camera that had no part in it: "
        "difference over the picture, in %zu sets, on a grid of 48 voxels, one channel.</p>\n"
        "<div class=\"wide\"><table class=\"small\"><tr><th>camera</th><th class=\"n\">error, %%"
        "</th><th class=\"n\">noise alone, %%</th></tr>\n",
        r->view_sets);
    for (size_t c = 0; c < r->rig.n_cameras; c++) {
        fputs("<tr><td>", f);
        html_text(f, r->rig.cameras[c].name);
        fputs("</td>", f);
        html_cell(f, r->view[c].known ? 100 * r->view[c].error : (double)NAN, 1);
        html_cell(f, r->view[c].known ? 100 * r->view[c].noise : (double)NAN, 1);
        fputs("</tr>\n", f);
    }
    fputs("</table></div>\n", f);
}

static void page_pre(FILE *f, const char *title, const char *text)
{
    fprintf(f, "<h2>%s</h2>\n<pre>", title);
    for (const char *at = text; *at != '\0';) { /* html_text shows no line ends */
        size_t n = strcspn(at, "\n");
        char *line = strndup(at, n);
        if (line != NULL)
            html_text(f, line);
        free(line);
        fputs("\n", f);
        at += n + (at[n] == '\n');
    }
    fputs("</pre>\n", f);
}

static void page_versions(FILE *f, const struct report *r)
{
    fputs("<h2>Versions and options</h2>\n<div class=\"wide\"><table class=\"small\">\n", f);
    page_row(f, "volumes by", r->head->start.software);
    PAGE_ROW(f, "solver", "%s", r->course.row[0].v.report.solver);
    PAGE_ROW(f, "this report by", "pyrovox %s, kernels %s", PVX_VERSION, pvx_cpu_name(pvx_cpu()));
    fputs("<tr><th>command</th><td class=\"any\"><code>", f);
    for (int i = 0; i < r->argc; i++) {
        html_text(f, i > 0 ? " " : "");
        html_text(f, r->argv[i]);
    }
    fputs("</code></td></tr>\n</table></div>\n", f);
    if (r->head->config != NULL && r->head->config[0] != '\0')
        page_pre(f,
                 strncmp(r->head->config, RECONSTRUCTED, strlen(RECONSTRUCTED)) == 0
                     ? "How it was reconstructed"
                     : "pyrovoxd.yaml, every key",
                 r->head->config);
    else
        page_said(f, "The recording does not say its options: it is a folder of `pyrovox "
                     "reconstruct`, or `pyrovox record` had no configuration of the daemon.");
    if (r->head->rig != NULL && r->head->rig[0] != '\0')
        page_pre(f, "rig.yaml, as it was in effect", r->head->rig);
}

/* ---- the page ---- */

static pvx_err page_body(FILE *f, const struct report *r, struct pvx_diag *d)
{
    html_begin(f, r->in,
               "pre{font-size:.7rem;overflow-x:auto;white-space:pre-wrap}table{font-size:.85rem}"
               ".slices{display:block}.slices figure{display:inline-block;width:32%;"
               "vertical-align:top;padding:.3rem}");
    fputs("<h1>Recording <code>", f);
    html_text(f, r->in);
    fputs("</code></h1>\n", f);
    page_setup(f, r);
    page_cameras(f, r);
    PVX_TRY(page_rates(f, r));
    PVX_TRY(page_slices(f, r, d));
    PVX_TRY(page_course(f, r));
    PVX_TRY(page_heat(f, r));
    page_views(f, r);
    if (r->advice != NULL)
        page_pre(f, "Advice", r->advice);
    page_versions(f, r);
    fputs("</body></html>\n", f);
    return PVX_OK;
}

pvx_err report_page(const struct report *r, struct pvx_diag *d)
{
    char path[4300], *text = NULL;
    size_t len;
    snprintf(path, sizeof path, "%s/report.html", r->out);
    FILE *f = open_memstream(&text, &len);
    if (f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path);
    pvx_err e = page_body(f, r, d);
    if (fclose(f) != 0 && e == PVX_OK)
        e = pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path);
    PVX_THEN(e, pvx_file_write(path, text, len, d));
    free(text);
    return e;
}
