#include "daemon/pipeline/events.h"

#include <stdio.h>
#include <string.h>

#include "base/clock.h"
#include "daemon/control/json.h"
#include "recon/vote/wrong.h"

struct event {
    struct dmn_json j;
    char text[2048];
};

static void open_event(struct event *v, int64_t time_ns, const char *kind)
{
    dmn_json_init(&v->j, v->text, sizeof v->text);
    dmn_json_open(&v->j, NULL, '{');
    dmn_json_int(&v->j, "version", 1);
    dmn_json_int(&v->j, "time_ns", time_ns);
    dmn_json_str(&v->j, "kind", kind);
}

static void close_event(struct event *v, const struct dmn_events_listener *to)
{
    dmn_json_close(&v->j, '}');
    if (dmn_json_end(&v->j) > 0)
        to->say(to->ctx, v->text);
}

static void events_look_at_camera(struct dmn_events *e, const struct dmn_state *now, size_t c,
                                  int64_t time_ns, const struct dmn_events_listener *to)
{
    struct event v;
    const struct cap_camera_stats *k = &now->capture.camera[c];
    bool was = e->camera[c] == CAP_LOST, lost = k->state == CAP_LOST;
    bool was_out = (e->out >> c & 1) != 0, out = (now->votes.out >> c & 1) != 0;
    /* A lost camera that is opened again is not back before it runs. */
    if (lost != was && (lost || k->state == CAP_RUNNING)) {
        open_event(&v, time_ns, lost ? "camera_lost" : "camera_back");
        dmn_json_str(&v.j, "camera", now->camera[c]);
        if (lost)
            dmn_json_str(&v.j, "why", k->error);
        close_event(&v, to);
    }
    if (lost || k->state == CAP_RUNNING)
        e->camera[c] = k->state;
    if (out == was_out)
        return;
    open_event(&v, time_ns, out ? "camera_voted_out" : "camera_believed");
    dmn_json_str(&v.j, "camera", now->camera[c]);
    if (out) {
        dmn_json_str(&v.j, "why", rec_wrong_name((enum rec_wrong)now->votes.why[c]));
        dmn_json_str(&v.j, "remedy", rec_wrong_remedy((enum rec_wrong)now->votes.why[c]));
    }
    close_event(&v, to);
}

/* A take of raw frames, or a recording of volumes. */
struct recording {
    const char *what, *path, *error;
    bool running, failed;
    uint64_t sets, missed;
};

static void look_at_recording(struct dmn_events_recording *e, const struct recording *r,
                              int64_t time_ns, const struct dmn_events_listener *to)
{
    struct event v;
    bool another = e->running && r->running && strcmp(e->path, r->path) != 0;
    if (e->running && (!r->running || another)) {
        bool full = !another && r->failed && strstr(r->error, "disk is full") != NULL;
        open_event(&v, time_ns, full ? "disk_full" : "recording_ended");
        dmn_json_str(&v.j, "path", e->path);
        dmn_json_str(&v.j, "what", r->what);
        if (!another) {
            dmn_json_int(&v.j, "sets", (long long)r->sets);
            dmn_json_int(&v.j, "sets_missed", (long long)r->missed);
            dmn_json_str(&v.j, "why", r->error);
        }
        close_event(&v, to);
    }
    if (r->running && (!e->running || another)) {
        open_event(&v, time_ns, "recording_begun");
        dmn_json_str(&v.j, "path", r->path);
        dmn_json_str(&v.j, "what", r->what);
        close_event(&v, to);
    }
    e->running = r->running;
    snprintf(e->path, sizeof e->path, "%s", r->path);
}

static void look_at_recordings(struct dmn_events *e, const struct dmn_state *now, int64_t time_ns,
                               const struct dmn_events_listener *to)
{
    const struct cap_recorder_stats *r = &now->record;
    const struct dmn_beside_state *v = &now->volumes;
    const struct recording raw = {.what = "raw",
                                  .path = r->path,
                                  .error = r->error,
                                  .running = r->state == CAP_REC_RUNNING,
                                  .failed = r->state == CAP_REC_FAILED,
                                  .sets = r->sets,
                                  .missed = r->sets_missed};
    const struct recording volumes = {.what = "volumes",
                                      .path = v->path,
                                      .error = v->error,
                                      .running = v->running,
                                      .failed = v->failed,
                                      .sets = v->written,
                                      .missed = v->lost};
    look_at_recording(&e->raw, &raw, time_ns, to);
    look_at_recording(&e->volumes, &volumes, time_ns, to);
}

static uint64_t all_dropped(const struct dmn_state *s)
{
    uint64_t n = s->capture.sets_dropped + s->capture.sets_failed;
    for (int i = 0; i < DMN_N_DROP; i++)
        n += s->dropped[i];
    return n;
}

/* Frequent events: reported once a second, with their number. */
static void look_at_counts(struct dmn_events *e, const struct dmn_state *now, int64_t time_ns,
                           const struct dmn_events_listener *to)
{
    struct event v;
    uint64_t dropped = all_dropped(now);
    if (dropped - e->dropped >= DMN_EVENTS_DROPS) {
        open_event(&v, time_ns, "drops");
        dmn_json_int(&v.j, "sets", (long long)(dropped - e->dropped));
        dmn_json_int(&v.j, "total", (long long)dropped);
        close_event(&v, to);
    }
    if (now->connections_refused != e->refused) {
        open_event(&v, time_ns, "key_refused");
        dmn_json_int(&v.j, "connections", (long long)(now->connections_refused - e->refused));
        dmn_json_int(&v.j, "total", (long long)now->connections_refused);
        close_event(&v, to);
    }
    e->dropped = dropped;
    e->refused = now->connections_refused;
}

void dmn_events_look(struct dmn_events *e, const struct dmn_state *now, int64_t time_ns,
                     int64_t mono_ns, const struct dmn_events_listener *to)
{
    if (!e->begun) {
        e->out = now->votes.out;
        for (size_t c = 0; c < now->n_cameras; c++)
            e->camera[c] = now->capture.camera[c].state;
        e->dropped = all_dropped(now);
        e->refused = now->connections_refused;
        e->t_second = mono_ns;
        e->begun = true;
    }
    for (size_t c = 0; c < now->n_cameras; c++)
        events_look_at_camera(e, now, c, time_ns, to);
    e->out = now->votes.out;
    look_at_recordings(e, now, time_ns, to);
    if (mono_ns - e->t_second < PVX_NS_PER_S)
        return;
    e->t_second = mono_ns;
    look_at_counts(e, now, time_ns, to);
}
