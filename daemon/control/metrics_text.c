/* metrics_text.c - a snapshot of the daemon in Prometheus' text format. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "daemon/control/metrics.h"
#include "proto/pvp.h"

static void family(FILE *f, const char *name, const char *type, const char *help)
{
    fprintf(f, "# HELP pyrovox_%s ", name);
    for (const char *p = help; *p != '\0'; p++)
        fputs(*p == '\\' ? "\\\\" : *p == '\n' ? "\\n" : (char[]){*p, '\0'}, f);
    fprintf(f, "\n# TYPE pyrovox_%s %s\n", name, type);
}

/* name{key="value"}; quotes, backslashes and line ends are escaped. */
static void control_label(FILE *f, const char *key, const char *value)
{
    fprintf(f, "%s=\"", key);
    for (const char *p = value; *p != '\0'; p++)
        fputs(*p == '\\'   ? "\\\\"
              : *p == '"'  ? "\\\""
              : *p == '\n' ? "\\n"
                           : (char[]){*p, '\0'},
              f);
    fputc('"', f);
}

static void gauge(FILE *f, const char *name, const char *help, double v)
{
    family(f, name, "gauge", help);
    if (isfinite(v))
        fprintf(f, "pyrovox_%s %.17g\n", name, v);
    else
        fprintf(f, "pyrovox_%s NaN\n", name);
}

static void counter(FILE *f, const char *name, const char *help, uint64_t v)
{
    family(f, name, "counter", help);
    fprintf(f, "pyrovox_%s %llu\n", name, (unsigned long long)v);
}

static void cause(FILE *f, const char *name, const char *why, uint64_t v)
{
    fprintf(f, "pyrovox_%s{", name);
    control_label(f, "cause", why);
    fprintf(f, "} %llu\n", (unsigned long long)v);
}

static void temperature_metrics(FILE *f, const struct dmn_temperature_counts *t)
{
    gauge(f, "temperature_subscribers", "of publish.temperature", (double)t->subscribers);
    counter(f, "temperature_sets_total", "volumes in kelvin that went out", t->made);
    counter(f, "temperature_left_out_total",
            "sets without temperatures, since those of an older set were still being made",
            t->left_out);
    counter(f, "temperature_without_bars_total",
            "sets without temperatures, for lack of error bars", t->without_bars);
}

static void drops(FILE *f, const struct dmn_state *s)
{
    family(f, "sets_dropped_total", "counter",
           "frame sets that did not become a volume, by cause (`pyrovox status` explains each)");
    for (int i = 0; i < DMN_N_DROP; i++)
        cause(f, "sets_dropped_total", dmn_drop_defs[i].name, s->dropped[i]);
    cause(f, "sets_dropped_total", "incomplete", s->capture.sets_failed);
    cause(f, "sets_dropped_total", "displaced", s->capture.sets_dropped);
}

static void draws(FILE *f, const struct dmn_draws_state *b)
{
    if (!b->on)
        return;
    counter(f, "error_bars_solves_total", "sets that were solved once more for the error bars",
            b->made);
    family(f, "error_bars_left_out_total", "counter",
           "sets that were not, by cause (`pyrovox status` explains each)");
    for (int i = 0; i < DMN_N_LEFT_OUT; i++)
        cause(f, "error_bars_left_out_total", dmn_left_out_defs[i].name, b->left_out[i]);
    gauge(f, "error_bars_sent", "1: the last volume had error bars", !b->none);
    gauge(f, "error_bars_late", "1: too few solves were in them",
          !b->none && (b->doubt & PVP_DOUBT_LATE) != 0);
}

static void control_compute(FILE *f, const struct dmn_compute_state *c)
{
    if (c->device[0] == '\0')
        return;
    counter(f, "compute_sets_total", "sets that were solved on the graphics card", c->there);
    counter(f, "compute_raw_total", "sets of these whose pixels were unpacked and judged there too",
            c->raw);
    counter(f, "compute_fell_back_total",
            "sets that were solved on the processors, because the graphics card could not",
            c->here);
}

static void camera_count(FILE *f, const struct dmn_state *s, const struct dmn_count_def *def,
                         const uint64_t *first, size_t stride)
{
    char name[96];
    snprintf(name, sizeof name, "camera_%s_total", def->name);
    family(f, name, "counter", def->help);
    for (size_t c = 0; c < s->n_cameras; c++) {
        fprintf(f, "pyrovox_%s{", name);
        control_label(f, "camera", s->camera[c]);
        fprintf(f, "} %llu\n", (unsigned long long)first[c * stride]);
    }
}

/* A number of each camera of which something is known. */
static void camera_known(FILE *f, const struct dmn_state *s, const char *name, const char *help,
                         const float *first)
{
    const struct rec_selfcal_camera *k = s->report.selfcal.camera;
    family(f, name, "gauge", help);
    for (size_t c = 0; c < s->n_cameras; c++) {
        if (!k[c].known)
            continue;
        fprintf(f, "pyrovox_%s{", name);
        control_label(f, "camera", s->camera[c]);
        fprintf(f, "} %.6g\n", (double)*(const float *)((const char *)first + c * sizeof *k));
    }
}

static void camera_corrections(FILE *f, const struct dmn_state *s)
{
    const struct rec_selfcal_camera *k = s->report.selfcal.camera;
    gauge(f, "cameras_gain_corrected", "1: pictures are multiplied by camera_gain",
          s->report.selfcal.gain);
    gauge(f, "cameras_aim_corrected", "1: pictures are moved by camera_right_px, camera_down_px",
          s->report.selfcal.shift);
    camera_known(f, s, "camera_gain", "factor on the pictures, by the flame", &k->gain);
    camera_known(f, s, "camera_gain_error", "of it, one sigma", &k->gain_error);
    camera_known(f, s, "camera_right_px", "flame further right than the rig says", &k->shift[0]);
    camera_known(f, s, "camera_right_error_px", "of it, one sigma", &k->shift_error[0]);
    camera_known(f, s, "camera_down_px", "flame further down than the rig says", &k->shift[1]);
    camera_known(f, s, "camera_down_error_px", "of it, one sigma", &k->shift_error[1]);
}

static void control_cameras(FILE *f, const struct dmn_state *s)
{
    family(f, "camera_running", "gauge", "1 while the camera runs");
    for (size_t c = 0; c < s->n_cameras; c++) {
        fputs("pyrovox_camera_running{", f);
        control_label(f, "camera", s->camera[c]);
        fprintf(f, "} %d\n", s->capture.camera[c].state == CAP_RUNNING);
    }
    for (int i = 0; i < CAP_N_COUNT; i++) {
        const struct dmn_count_def def = {cap_count_defs[i].name, cap_count_defs[i].unit,
                                          cap_count_defs[i].help};
        camera_count(f, s, &def, &s->capture.camera[0].count[i],
                     sizeof s->capture.camera[0] / sizeof(uint64_t));
    }
    for (int i = 0; i < DMN_N_IMAGE; i++)
        camera_count(f, s, &dmn_image_defs[i], &s->images[0][i], DMN_N_IMAGE);
    camera_corrections(f, s);
}

static void stages(FILE *f, const struct dmn_state *s)
{
    family(f, "stage_items_total", "counter", "frame sets that a stage has worked on");
    for (int i = 0; i < DMN_N_STAGES; i++) {
        fputs("pyrovox_stage_items_total{", f);
        control_label(f, "stage", s->stage[i].name);
        fprintf(f, "} %llu\n", (unsigned long long)s->stage[i].items);
    }
}

static void latency(FILE *f, const struct dmn_state *s)
{
    family(f, "latency_seconds", "summary", "from a set's last frame received to its volume sent");
    fprintf(f, "pyrovox_latency_seconds{quantile=\"0.5\"} %.9g\n", s->latency_p50_ms * 1e-3);
    fprintf(f, "pyrovox_latency_seconds{quantile=\"0.99\"} %.9g\n", s->latency_p99_ms * 1e-3);
    fprintf(f, "pyrovox_latency_seconds{quantile=\"1\"} %.9g\n", s->latency_max_ms * 1e-3);
    fprintf(f, "pyrovox_latency_seconds_sum %.15g\n", s->latency_sum_s);
    fprintf(f, "pyrovox_latency_seconds_count %llu\n", (unsigned long long)s->latency_n);
}

static void ring_metrics(FILE *f, const struct dmn_state *s)
{
    const struct cap_ring_stats *r = &s->ring;
    if (r->frames == 0)
        return;
    gauge(f, "ring_seconds", "raw frames in memory, from the oldest to the newest", r->seconds);
    gauge(f, "ring_bytes", "of raw frames in memory", (double)r->bytes);
    gauge(f, "ring_bytes_limit", "record.ring.memory", (double)r->bytes_max);
    gauge(f, "ring_writing", "1 while a take of a trigger is written", r->writing);
    counter(f, "ring_takes_total", "takes of triggers that were closed", r->takes);
    counter(f, "ring_takes_failed_total", "takes of triggers that could not be written whole",
            r->failed);
    counter(f, "ring_frames_written_total", "frames in takes of triggers", r->written);
    family(f, "ring_frames_lost_total", "counter", "frames that these takes lack, by cause");
    for (int i = 0; i < CAP_RING_N_WHY; i++) {
        fputs("pyrovox_ring_frames_lost_total{", f);
        control_label(f, "cause", cap_ring_why_name((enum cap_ring_why)i));
        fprintf(f, "} %llu\n", (unsigned long long)r->lost[i]);
    }
    family(f, "trigger_fired_total", "counter", "how often a trigger fired");
    for (size_t i = 0; i < s->triggers.n; i++) {
        fputs("pyrovox_trigger_fired_total{", f);
        control_label(f, "trigger", s->triggers.item[i].name);
        fprintf(f, "} %llu\n", (unsigned long long)s->triggers.item[i].fired);
    }
    family(f, "trigger_value", "gauge", "what a trigger judged last");
    for (size_t i = 0; i < s->triggers.n; i++) {
        if (isnan(s->triggers.item[i].value)) /* a line of which nothing is known yet */
            continue;
        fputs("pyrovox_trigger_value{", f);
        control_label(f, "trigger", s->triggers.item[i].name);
        fprintf(f, "} %.9g\n", s->triggers.item[i].value);
    }
    family(f, "trigger_latency_seconds", "summary", "from the exposure to the trigger's event");
    fprintf(f, "pyrovox_trigger_latency_seconds{quantile=\"0.5\"} %.9g\n",
            s->triggers.latency_p50_ms * 1e-3);
    fprintf(f, "pyrovox_trigger_latency_seconds{quantile=\"0.99\"} %.9g\n",
            s->triggers.latency_p99_ms * 1e-3);
    fprintf(f, "pyrovox_trigger_latency_seconds_count %llu\n",
            (unsigned long long)s->triggers.latency_n);
}

char *dmn_metrics_text(const struct dmn_state *s)
{
    char *text = NULL;
    size_t len = 0;
    FILE *f = open_memstream(&text, &len);
    if (f == NULL)
        return NULL;
    gauge(f, "uptime_seconds", "since the start", s->uptime_s);
    gauge(f, "open_to_all", "1: an endpoint lets everybody in (insecure: true)",
          s->open_to[0] != '\0');
    counter(f, "sets_produced_total", "frame sets that the cameras gave", s->produced);
    counter(f, "sets_published_total", "volumes that went out", s->published);
    drops(f, s);
    draws(f, &s->draws);
    control_compute(f, &s->compute);
    gauge(f, "sets_inside", "frame sets under way", (double)s->inside);
    gauge(f, "sets_per_second", "published, over the last second or two", s->sets_per_s);
    latency(f, s);
    gauge(f, "subscribers", "subscriptions that are open", (double)s->subscribers);
    if (s->temperature.on)
        temperature_metrics(f, &s->temperature);
    gauge(f, "clients_listed", "keys that may come in", (double)s->clients_listed);
    counter(f, "connections_refused_total", "keys that are not listed, or of another role",
            s->connections_refused);
    gauge(f, "record_active", "1 while a take of raw frames is written",
          s->record.state != CAP_REC_IDLE);
    gauge(f, "record_sets_missed", "of the take at hand: sets that were not recorded",
          (double)s->record.sets_missed);
    ring_metrics(f, s);
    gauge(f, "volumes_active", "1 while volumes are recorded beside the daemon",
          s->volumes.running);
    gauge(f, "volumes_written", "by the recording at hand", (double)s->volumes.written);
    gauge(f, "volumes_lost", "to the recording at hand: the disk or the way to it was too slow",
          (double)s->volumes.lost);
    gauge(f, "volumes_deaths", "how often its process died", s->volumes.deaths);
    stages(f, s);
    control_cameras(f, s);
    if (fclose(f) != 0) {
        free(text);
        return NULL;
    }
    return text;
}
