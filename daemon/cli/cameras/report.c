/* report.c - a test of cameras as a table and as JSON. */
#include <math.h>
#include <string.h>

#include "daemon/cli/cameras/camtest.h"
#include "daemon/control/json.h"
#include "daemon/doctor/wrap.h"

static const char *const words[] = {"OK", "WARN", "FAIL"};

static double share(const struct camtest_camera *c)
{
    double bytes = c->frames > 0 ? (double)c->bytes / (double)c->frames * c->hz : 0;
    double mbps = c->stats.health.link_mbps;
    return isfinite(mbps) && mbps > 0 ? bytes * 8e-6 / mbps : NAN;
}

/* Frames that did not arrive whole and in time. */
static uint64_t cameras_lost(const struct camtest_camera *c)
{
    static const enum cap_count causes[] = {CAP_INCOMPLETE, CAP_BAD_SIZE, CAP_BAD_FORMAT,
                                            CAP_BAD_STAMP,  CAP_UNDERRUN, CAP_OVERFLOW,
                                            CAP_LATE,       CAP_ID_GAP};
    uint64_t n = 0;
    for (size_t i = 0; i < sizeof causes / sizeof *causes; i++)
        n += c->count[causes[i]];
    return n;
}

static const char *jitter(const struct camtest_series *s, char out[32])
{
    if (s->n > 1)
        snprintf(out, 32, "%6.2f %6.2f", camtest_std(s) * 1e3, camtest_worst(s) * 1e3);
    else
        snprintf(out, 32, "%6s %6s", "-", "-");
    return out;
}

static void cameras_print_row(FILE *f, const struct camtest_camera *c, int name)
{
    char link[16] = "-", temp[16] = "-", device[32], arrival[32];
    if (isfinite(share(c)))
        snprintf(link, sizeof link, "%.0f%%", share(c) * 100);
    if (isfinite(c->stats.health.temperature_c))
        snprintf(temp, sizeof temp, "%.0f", c->stats.health.temperature_c);
    fprintf(f, "%-*.*s %7.2f %6llu %5llu %s %s %6.1f %5s %3s\n", name, name, c->name, c->hz,
            (unsigned long long)c->frames, (unsigned long long)cameras_lost(c),
            jitter(&c->device, device), jitter(&c->arrival, arrival),
            c->frames > 0 ? (double)c->bytes / (double)c->frames * c->hz * 1e-6 : 0, link, temp);
}

static void print_verdict(FILE *f, const struct camtest *t, uint32_t i, int width)
{
    const struct camtest_camera *c = &t->camera[i];
    char line[1024];
    char own[128], picture[64] = "";
    snprintf(own, sizeof own, "camera %s ", c->name);
    bool named = strncmp(c->what, own, strlen(own)) == 0; /* the source named it already */
    if (c->frames > 0)
        snprintf(picture, sizeof picture, ", %dx%d %s", c->width, c->height,
                 cap_pixfmt_name(c->fmt));
    int n = snprintf(line, sizeof line, "%s%s%s%s", named ? "" : c->name, named ? "" : ": ",
                     c->verdict == CAMTEST_OK ? t->sources.uri[i] : c->what,
                     c->verdict == CAMTEST_OK ? picture : "");
    for (int k = CAP_INCOMPLETE; k < CAP_N_COUNT && n < (int)sizeof line; k++)
        if (c->count[k] > 0)
            n += snprintf(line + n, sizeof line - (size_t)n, "; %s %llu", cap_count_defs[k].name,
                          (unsigned long long)c->count[k]);
    fprintf(f, "%-5s ", words[c->verdict]);
    dmn_wrap(f, line, 6, 6, width);
    if (c->remedy[0] != '\0') {
        fprintf(f, "      -> ");
        dmn_wrap(f, c->remedy, 9, 9, width);
    }
}

void camtest_print(FILE *f, const struct camtest *t, int width)
{
    int name = 6;
    for (uint32_t i = 0; i < t->n; i++)
        if ((int)strlen(t->camera[i].name) > name)
            name = (int)strlen(t->camera[i].name);
    name = name > 12 ? 12 : name;
    fprintf(f, "%-*s %7s %6s %5s %13s %13s\n", name, "", "", "", "", "stamps, ms", "arrival, ms");
    fprintf(f, "%-*s %7s %6s %5s %6s %6s %6s %6s %6s %5s %3s\n", name, "camera", "Hz", "frames",
            "lost", "std", "max", "std", "max", "MB/s", "link", "C");
    for (uint32_t i = 0; i < t->n; i++)
        cameras_print_row(f, &t->camera[i], name);
    char line[400];
    int n = snprintf(line, sizeof line, "%.1f s%s", t->measured_s,
                     t->interrupted ? " (interrupted)" : "");
    if (t->n > 1)
        n += snprintf(line + n, sizeof line - (size_t)n, ", %llu sets, %llu whole",
                      (unsigned long long)t->sets, (unsigned long long)t->whole);
    if (t->n > 1 && t->spread.n > 0)
        snprintf(line + n, sizeof line - (size_t)n,
                 "; exposures of a set apart by %.3f ms, 95 %% below %.3f, worst %.3f",
                 t->spread.mean * 1e3, (double)pvx_hist_quantile(&t->spread_hist, 0.95) * 1e-6,
                 t->spread.max * 1e3);
    fputc('\n', f);
    dmn_wrap(f, line, 0, 0, width);
    fputc('\n', f);
    for (uint32_t i = 0; i < t->n; i++)
        print_verdict(f, t, i, width);
    if (t->what[0] != '\0') {
        fprintf(f, "%-5s ", words[t->verdict]);
        dmn_wrap(f, t->what, 6, 6, width);
        fprintf(f, "      -> ");
        dmn_wrap(f, t->remedy, 9, 9, width);
    }
}

static void json_series(struct dmn_json *j, const char *key, const struct camtest_series *s)
{
    dmn_json_open(j, key, '{');
    dmn_json_int(j, "n", (long long)s->n);
    dmn_json_num(j, "mean", s->mean * 1e3);
    dmn_json_num(j, "std", camtest_std(s) * 1e3);
    dmn_json_num(j, "max_deviation", camtest_worst(s) * 1e3);
    dmn_json_close(j, '}');
}

static void json_camera(struct dmn_json *j, const struct camtest *t, uint32_t i)
{
    const struct camtest_camera *c = &t->camera[i];
    dmn_json_open(j, NULL, '{');
    dmn_json_str(j, "name", c->name);
    dmn_json_str(j, "uri", t->sources.uri[i]);
    dmn_json_str(j, "verdict", words[c->verdict]);
    dmn_json_str(j, "what", c->what);
    dmn_json_str(j, "remedy", c->remedy);
    dmn_json_int(j, "frames", (long long)c->frames);
    dmn_json_num(j, "hz", c->hz);
    dmn_json_int(j, "width", c->width);
    dmn_json_int(j, "height", c->height);
    dmn_json_str(j, "pixel_format", c->frames > 0 ? cap_pixfmt_name(c->fmt) : "");
    dmn_json_num(j, "bytes_per_s",
                 c->frames > 0 ? (double)c->bytes / (double)c->frames * c->hz : 0);
    json_series(j, "stamps_ms", &c->device);
    json_series(j, "arrival_ms", &c->arrival);
    json_series(j, "offset_ms", &c->offset);
    dmn_json_open(j, "counts", '{');
    for (int k = 0; k < CAP_N_COUNT; k++)
        dmn_json_int(j, cap_count_defs[k].name, (long long)c->count[k]);
    dmn_json_close(j, '}');
    dmn_json_num(j, "temperature_c", c->stats.health.temperature_c);
    dmn_json_num(j, "link_mbps", c->stats.health.link_mbps);
    dmn_json_num(j, "link_share", share(c));
    dmn_json_str(j, "ptp", c->stats.health.ptp);
    dmn_json_num(j, "ptp_offset_ns", c->stats.health.ptp_offset_ns);
    dmn_json_num(j, "drift_ppm", c->stats.drift_ppm);
    dmn_json_num(j, "clock_delay_us", c->stats.clock_delay_us);
    dmn_json_str(j, "error", c->stats.error);
    dmn_json_close(j, '}');
}

static void cameras_report_fill(struct dmn_json *j, const void *what)
{
    const struct camtest *t = what;
    dmn_json_open(j, NULL, '{');
    dmn_json_num(j, "seconds", t->measured_s);
    dmn_json_bool(j, "interrupted", t->interrupted);
    dmn_json_num(j, "fps", t->fps);
    dmn_json_open(j, "sets", '{');
    dmn_json_int(j, "n", (long long)t->sets);
    dmn_json_int(j, "whole", (long long)t->whole);
    dmn_json_num(j, "spread_mean_ms", t->spread.mean * 1e3);
    dmn_json_num(j, "spread_p95_ms", (double)pvx_hist_quantile(&t->spread_hist, 0.95) * 1e-6);
    dmn_json_num(j, "spread_max_ms", t->spread.max * 1e3);
    dmn_json_str(j, "verdict", words[t->verdict]);
    dmn_json_str(j, "what", t->what);
    dmn_json_str(j, "remedy", t->remedy);
    dmn_json_close(j, '}');
    dmn_json_open(j, "cameras", '[');
    for (uint32_t i = 0; i < t->n; i++)
        json_camera(j, t, i);
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}

pvx_err camtest_print_json(FILE *f, const struct camtest *t, struct pvx_diag *d)
{
    return dmn_json_print(f, cameras_report_fill, t, d);
}
