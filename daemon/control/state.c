#include "daemon/control/state.h"

#include <math.h>

#include "daemon/control/json.h"
#include "daemon/control/state_sync.h"
#include "proto/pvp.h"

#define ROW(number, ...) [number] = {__VA_ARGS__},
const struct dmn_count_def dmn_drop_defs[DMN_N_DROP] = {DMN_DROPS(ROW)};
const struct dmn_count_def dmn_image_defs[DMN_N_IMAGE] = {DMN_IMAGE_FAULTS(ROW)};
const struct dmn_count_def dmn_left_out_defs[DMN_N_LEFT_OUT] = {DMN_LEFT_OUTS(ROW)};

const char *dmn_camera_state_name(enum cap_state s)
{
    switch (s) {
    case CAP_OPENING: return "opening";
    case CAP_RUNNING: return "running";
    case CAP_LOST: return "lost";
    case CAP_ENDED: return "ended";
    }
    return "unknown";
}

/* To the millisecond, however long it runs: six digits end after eleven days. */
static void seconds(struct dmn_json *j, const char *key, double s)
{
    dmn_json_exact(j, key, rint(s * 1e3) / 1e3);
}

static void state_ms(struct dmn_json *j, const char *key, int64_t ns)
{
    dmn_json_num(j, key, (double)ns * 1e-6);
}

static void state_count(struct dmn_json *j, const char *name, const char *unit, const char *help,
                        uint64_t value)
{
    dmn_json_open(j, NULL, '{');
    dmn_json_str(j, "name", name);
    dmn_json_int(j, "value", (long long)value);
    dmn_json_str(j, "unit", unit);
    dmn_json_str(j, "help", help);
    dmn_json_close(j, '}');
}

static void json_sets(struct dmn_json *j, const struct dmn_state *s)
{
    uint64_t dropped = 0;
    for (int i = 0; i < DMN_N_DROP; i++)
        dropped += s->dropped[i];
    dmn_json_open(j, "sets", '{');
    dmn_json_int(j, "produced", (long long)s->produced);
    dmn_json_int(j, "published", (long long)s->published);
    dmn_json_int(j, "dropped", (long long)dropped);
    dmn_json_int(j, "inside", (long long)s->inside);
    dmn_json_int(j, "complete", (long long)s->capture.sets_complete);
    dmn_json_int(j, "partial", (long long)s->capture.sets_partial);
    dmn_json_int(j, "incomplete_dropped", (long long)s->capture.sets_failed);
    dmn_json_int(j, "displaced", (long long)s->capture.sets_dropped);
    dmn_json_close(j, '}');
    dmn_json_open(j, "drops", '[');
    for (int i = 0; i < DMN_N_DROP; i++)
        state_count(j, dmn_drop_defs[i].name, dmn_drop_defs[i].unit, dmn_drop_defs[i].help,
                    s->dropped[i]);
    state_count(j, "incomplete", "sets", "not used: frames of cameras were missing",
                s->capture.sets_failed);
    state_count(j, "displaced", "sets",
                "the queue to the pipeline was full: newer ones took their place",
                s->capture.sets_dropped);
    dmn_json_close(j, ']');
}

static void json_draws(struct dmn_json *j, const struct dmn_draws_state *b)
{
    if (!b->on)
        return;
    dmn_json_open(j, "error_bars", '{');
    dmn_json_bool(j, "sent", !b->none);
    dmn_json_open(j, "doubts", '[');
    for (unsigned i = 0; pvp_doubt_name(i) != NULL; i++)
        if ((b->doubt >> i & 1) != 0)
            dmn_json_str(j, NULL, pvp_doubt_name(i));
    dmn_json_close(j, ']');
    dmn_json_int(j, "in_average", b->in_average);
    dmn_json_int(j, "solves", (long long)b->made);
    dmn_json_num(j, "mean_ms", b->mean_ms);
    dmn_json_open(j, "left_out", '[');
    for (int i = 0; i < DMN_N_LEFT_OUT; i++)
        state_count(j, dmn_left_out_defs[i].name, dmn_left_out_defs[i].unit,
                    dmn_left_out_defs[i].help, b->left_out[i]);
    dmn_json_close(j, ']');
    dmn_json_close(j, '}');
}

static void json_compute(struct dmn_json *j, const struct dmn_compute_state *c)
{
    dmn_json_open(j, "compute", '{');
    dmn_json_str(j, "device", c->device);
    dmn_json_int(j, "sets", (long long)c->there);
    dmn_json_int(j, "raw", (long long)c->raw);
    dmn_json_int(j, "fell_back", (long long)c->here);
    dmn_json_str(j, "why", c->why);
    dmn_json_close(j, '}');
}

static void json_report(struct dmn_json *j, const struct dmn_state *s)
{
    const struct rec_frame_report *r = &s->report;
    dmn_json_open(j, "last", '{');
    dmn_json_int(j, "set", (long long)s->last_set);
    dmn_json_int(j, "t_exposure_ns", s->last_exposure_ns);
    dmn_json_int(j, "cameras", r->cameras);
    dmn_json_str(j, "status", r->solve.solver == NULL ? "none" : rec_status_name(r->solve.status));
    dmn_json_str(j, "solver", r->solve.solver == NULL ? "" : r->solve.solver);
    dmn_json_int(j, "iterations", r->solve.iterations);
    dmn_json_int(j, "blended_iterations", r->solve.blended);
    dmn_json_num(j, "rel_residual", r->solve.rel_residual);
    dmn_json_num(j, "noise", rec_frame_noise(r, s->nch));
    dmn_json_int(j, "active_voxels", r->active_voxels);
    dmn_json_int(j, "active_rays", r->active_rays);
    dmn_json_int(j, "entries", (long long)r->entries);
    dmn_json_int(j, "saturated", r->saturated);
    dmn_json_int(j, "not_finite", r->not_finite);
    dmn_json_num(j, "sigma", (double)r->sigma);
    dmn_json_int(j, "bytes", (long long)s->bytes);
    dmn_json_open(j, "vote", '{');
    dmn_json_str(j, "state", rec_vote_state_name(r->vote.state));
    dmn_json_num(j, "misfit", (double)r->vote.misfit);
    dmn_json_num(j, "doubt", (double)r->vote.doubt);
    dmn_json_int(j, "sets_torn", (long long)s->votes.torn);
    dmn_json_close(j, '}');
    dmn_json_open(j, "hull", '{');
    dmn_json_int(j, "inside", r->hull.inside);
    dmn_json_int(j, "partial", r->hull.partial);
    dmn_json_int(j, "outside", r->hull.outside);
    dmn_json_close(j, '}');
    dmn_json_open(j, "ms", '{');
    state_ms(j, "photometry", r->photo_ns);
    state_ms(j, "vote", r->vote_ns);
    state_ms(j, "hull", r->hull_ns);
    state_ms(j, "restrict", r->restrict_ns);
    state_ms(j, "solve", r->solve_ns);
    dmn_json_close(j, '}');
    dmn_json_close(j, '}');
}

static void json_rig(struct dmn_json *j, const struct dmn_rig_state *r)
{
    dmn_json_open(j, "rig", '{');
    dmn_json_bool(j, "moved", r->moved);
    dmn_json_num(j, "right_px", r->px[0]);
    dmn_json_num(j, "down_px", r->px[1]);
    dmn_json_int(j, "looks", (long long)r->looks);
    dmn_json_int(j, "alarms", (long long)r->alarms);
    dmn_json_close(j, '}');
}

/* Of the sets together, or with sets 0 of the last one; null where nothing was estimated. */
static void json_selfcal(struct dmn_json *j, const struct rec_selfcal_report *r, size_t c)
{
    const struct rec_selfcal_camera *k = &r->camera[c];
    double none = k->known ? 0 : NAN;
    dmn_json_open(j, "selfcal", '{');
    dmn_json_bool(j, "corrected", k->known && (r->gain || r->shift));
    dmn_json_int(j, "sets", r->sets);
    dmn_json_int(j, "touched", k->touched);
    dmn_json_num(j, "gain", (double)k->gain + none);
    dmn_json_num(j, "gain_error", (double)k->gain_error + none);
    dmn_json_num(j, "right_px", (double)k->shift[0] + none);
    dmn_json_num(j, "down_px", (double)k->shift[1] + none);
    dmn_json_num(j, "right_error_px", (double)k->shift_error[0] + none);
    dmn_json_num(j, "down_error_px", (double)k->shift_error[1] + none);
    dmn_json_close(j, '}');
}

static void json_cameras(struct dmn_json *j, const struct dmn_state *s)
{
    dmn_json_open(j, "cameras", '[');
    for (size_t c = 0; c < s->n_cameras; c++) {
        const struct cap_camera_stats *k = &s->capture.camera[c];
        dmn_json_open(j, NULL, '{');
        dmn_json_str(j, "name", s->camera[c]);
        dmn_json_str(j, "state", dmn_camera_state_name(k->state));
        dmn_json_num(j, "fps", k->fps);
        dmn_json_num(j, "drift_ppm", k->drift_ppm);
        dmn_json_str(j, "error", k->error);
        dmn_json_open(j, "counts", '{');
        for (int i = 0; i < CAP_N_COUNT; i++)
            dmn_json_int(j, cap_count_defs[i].name, (long long)k->count[i]);
        for (int i = 0; i < DMN_N_IMAGE; i++)
            dmn_json_int(j, dmn_image_defs[i].name, (long long)s->images[c][i]);
        dmn_json_close(j, '}');
        dmn_votes_camera_json(j, &s->votes, c);
        json_selfcal(j, &s->report.selfcal, c);
        json_rig(j, &s->rig[c]);
        dmn_checks_camera_json(j, &s->checks, c);
        dmn_state_sync_camera(j, k);
        dmn_state_health(j, k);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
}

static void json_record(struct dmn_json *j, const struct cap_recorder_stats *r)
{
    dmn_json_open(j, "record", '{');
    dmn_json_str(j, "state", cap_recorder_state_names[r->state]);
    dmn_json_str(j, "path", r->path);
    dmn_json_int(j, "takes", r->takes);
    seconds(j, "seconds", r->seconds);
    dmn_json_int(j, "sets", (long long)r->sets);
    dmn_json_int(j, "frames", (long long)r->frames);
    dmn_json_int(j, "frames_in_no_set", (long long)r->strays);
    dmn_json_int(j, "bytes", (long long)r->bytes);
    dmn_json_int(j, "sets_missed", (long long)r->sets_missed);
    dmn_json_int(j, "frames_missed", (long long)r->frames_missed);
    dmn_json_int(j, "queued", r->queued);
    dmn_json_str(j, "error", r->error);
    dmn_json_close(j, '}');
}

static void json_ring(struct dmn_json *j, const struct dmn_state *s)
{
    const struct cap_ring_stats *r = &s->ring;
    if (r->frames == 0)
        return;
    dmn_json_open(j, "ring", '{');
    seconds(j, "seconds", r->seconds);
    dmn_json_int(j, "frames", r->held);
    dmn_json_int(j, "frames_max", r->frames);
    dmn_json_int(j, "bytes", (long long)r->bytes);
    dmn_json_int(j, "bytes_most", (long long)r->bytes_most);
    dmn_json_int(j, "bytes_max", (long long)r->bytes_max);
    dmn_json_bool(j, "writing", r->writing);
    dmn_json_int(j, "waiting", r->waiting);
    dmn_json_int(j, "triggers", (long long)r->triggers);
    dmn_json_int(j, "extended", (long long)r->extended);
    dmn_json_int(j, "takes", (long long)r->takes);
    dmn_json_int(j, "failed", (long long)r->failed);
    dmn_json_int(j, "written", (long long)r->written);
    dmn_json_open(j, "lost", '{');
    for (int i = 0; i < CAP_RING_N_WHY; i++)
        if (r->lost[i] > 0)
            dmn_json_int(j, cap_ring_why_name((enum cap_ring_why)i), (long long)r->lost[i]);
    dmn_json_close(j, '}');
    dmn_json_str(j, "name", r->name);
    dmn_json_int(j, "t_ns", r->t_ns);
    dmn_json_str(j, "path", r->path);
    dmn_json_str(j, "error", r->error);
    dmn_json_close(j, '}');
}

static void json_triggers(struct dmn_json *j, const struct dmn_triggers_state *t)
{
    dmn_json_open(j, "triggers", '[');
    for (size_t i = 0; i < t->n; i++) {
        dmn_json_open(j, NULL, '{');
        dmn_json_str(j, "name", t->item[i].name);
        dmn_json_str(j, "when", dmn_when_names[t->item[i].when]);
        dmn_json_str(j, "unit", dmn_when_units[t->item[i].when]);
        dmn_json_num(j, "above", t->item[i].above);
        dmn_json_num(j, "value", t->item[i].value);
        dmn_json_bool(j, "ready", t->item[i].ready);
        dmn_json_int(j, "fired", (long long)t->item[i].fired);
        dmn_json_int(j, "last_ns", t->item[i].last_ns);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
    if (t->latency_n == 0)
        return;
    dmn_json_open(j, "trigger_latency_ms", '{');
    dmn_json_int(j, "n", (long long)t->latency_n);
    dmn_json_num(j, "p50", t->latency_p50_ms);
    dmn_json_num(j, "p99", t->latency_p99_ms);
    dmn_json_num(j, "max", t->latency_max_ms);
    dmn_json_close(j, '}');
}

static void json_volumes(struct dmn_json *j, const struct dmn_beside_state *v)
{
    dmn_json_open(j, "record_volumes", '{');
    dmn_json_bool(j, "running", v->running);
    dmn_json_str(j, "path", v->path);
    dmn_json_int(j, "written", (long long)v->written);
    dmn_json_int(j, "lost", (long long)v->lost);
    dmn_json_int(j, "deaths", v->deaths);
    dmn_json_str(j, "error", v->error);
    dmn_json_close(j, '}');
}

static void json_stages(struct dmn_json *j, const struct dmn_state *s)
{
    dmn_json_open(j, "stages", '[');
    for (int i = 0; i < DMN_N_STAGES; i++) {
        const struct dmn_stage_state *t = &s->stage[i];
        dmn_json_open(j, NULL, '{');
        dmn_json_str(j, "name", t->name);
        dmn_json_int(j, "items", (long long)t->items);
        dmn_json_num(j, "mean_ms", t->mean_ms);
        dmn_json_num(j, "p99_ms", t->p99_ms);
        dmn_json_num(j, "max_ms", t->max_ms);
        dmn_json_num(j, "beat_age_s", t->beat_age_s);
        dmn_json_int(j, "queued", (long long)t->queued);
        dmn_json_close(j, '}');
    }
    dmn_json_close(j, ']');
}

size_t dmn_state_json(const struct dmn_state *s, char *out, size_t size)
{
    struct dmn_json j;
    dmn_json_init(&j, out, size);
    dmn_json_open(&j, NULL, '{');
    dmn_json_str(&j, "software", "pyrovoxd " PVX_VERSION);
    seconds(&j, "uptime_s", s->uptime_s);
    dmn_json_str(&j, "open_to_all", s->open_to);
    if (s->keys) {
        dmn_json_open(&j, "keys", '{');
        dmn_json_int(&j, "listed", (long long)s->clients_listed);
        dmn_json_int(&j, "refused", (long long)s->connections_refused);
        dmn_json_close(&j, '}');
    }
    dmn_json_int(&j, "subscribers", (long long)s->subscribers);
    dmn_json_open(&j, "previews", '{');
    dmn_json_int(&j, "subscribers", (long long)s->previews_subscribers);
    dmn_json_int(&j, "made", (long long)s->previews_made);
    dmn_json_close(&j, '}');
    if (s->temperature.on) {
        dmn_json_open(&j, "temperature", '{');
        dmn_json_int(&j, "subscribers", (long long)s->temperature.subscribers);
        dmn_json_int(&j, "made", (long long)s->temperature.made);
        dmn_json_int(&j, "left_out", (long long)s->temperature.left_out);
        dmn_json_int(&j, "without_bars", (long long)s->temperature.without_bars);
        dmn_json_close(&j, '}');
    }
    dmn_json_num(&j, "sets_per_s", s->sets_per_s);
    json_sets(&j, s);
    dmn_json_open(&j, "latency_ms", '{');
    dmn_json_int(&j, "n", (long long)s->latency_n);
    dmn_json_num(&j, "p50", s->latency_p50_ms);
    dmn_json_num(&j, "p99", s->latency_p99_ms);
    dmn_json_num(&j, "max", s->latency_max_ms);
    dmn_json_close(&j, '}');
    dmn_json_open(&j, "spread_ms", '{');
    dmn_json_num(&j, "p50", s->spread_p50_ms);
    dmn_json_num(&j, "p99", s->spread_p99_ms);
    dmn_json_close(&j, '}');
    json_report(&j, s);
    json_draws(&j, &s->draws);
    json_compute(&j, &s->compute);
    dmn_json_open(&j, "matrix", '{');
    dmn_json_open(&j, "voxels", '[');
    for (int a = 0; a < 3; a++)
        dmn_json_int(&j, NULL, s->voxels[a]);
    dmn_json_close(&j, ']');
    dmn_json_int(&j, "binning", s->binning);
    dmn_json_int(&j, "rays", s->rays);
    dmn_json_int(&j, "entries", (long long)s->matrix_entries);
    dmn_json_close(&j, '}');
    json_cameras(&j, s);
    dmn_checks_json(&j, &s->checks, s->n_cameras);
    dmn_json_open(&j, "belong", '{');
    dmn_belong_json(&j, &s->belong, s->camera, s->n_cameras);
    dmn_json_close(&j, '}');
    dmn_state_sync(&j, &s->capture);
    dmn_state_action(&j, &s->capture);
    json_stages(&j, s);
    json_record(&j, &s->record);
    json_volumes(&j, &s->volumes);
    json_ring(&j, s);
    json_triggers(&j, &s->triggers);
    dmn_json_close(&j, '}');
    return dmn_json_end(&j);
}
